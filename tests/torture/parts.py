"""Take results and objects apart into named arrays, and compare what two of them hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

__all__ = ["differences", "parts"]

#: Measured in seconds, different each time; an engine's own; many times the same.
UNSEEN = {"seconds", "microseconds", "progress", "kernel", "gaps", "model", "law", "system"}

#: How deep parts have parts, and how many of a list are looked at.
DEPTH, LONGEST = 4, 50


def shown(thing: Any) -> list[str]:
    """Return the names of what an object shows, without its verbs."""
    cls, unseen = type(thing), UNSEEN if hasattr(thing, "step") else UNSEEN - {"model", "law"}
    of_class = {name for name in dir(cls) if not callable(getattr(cls, name, None))}
    names = of_class | {*getattr(thing, "__dict__", ())}
    return sorted(name for name in names - unseen if not name.startswith("_"))


def parts(value: Any, name: str = "", depth: int = DEPTH) -> dict[str, Any]:
    """Take a value apart into arrays, words and numbers by their path."""
    if value is None or isinstance(value, bool | str | bytes | int):
        return {name: value}
    if isinstance(value, float | complex | np.generic | np.ndarray):
        array = np.array(value)
        if array.dtype.kind in "fiubcmM":
            return {name: array.astype(np.int64) if array.dtype.kind in "mM" else array}
        return parts(array.tolist(), name, depth) if array.ndim else {name: str(value)}
    if (callable(value) and not type(value).__module__.startswith("fuzzykf")) or isinstance(value, type):
        return {name: getattr(value, "__qualname__", type(value).__name__)}
    if depth == 0:
        return {name: type(value).__name__}
    if hasattr(value, "_asdict"):
        items: Any = value._asdict().items()
    elif isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list | tuple | set | frozenset):
        items = list(enumerate(value))[:LONGEST]
    elif hasattr(value, "to_numpy"):
        return parts(value.to_numpy(), name, depth)
    elif dataclasses.is_dataclass(value) or type(value).__module__.startswith("fuzzykf"):
        items = ((one, attribute(value, one)) for one in shown(value))
    else:
        return {name: type(value).__name__}
    found = {f"{name}:": type(value).__name__}
    for key, part in items:
        found |= parts(part, f"{name}.{key}", depth - 1)
    return found


def attribute(thing: Any, name: str) -> Any:
    """Return an attribute, or the kind of error where there is none yet."""
    try:
        return getattr(thing, name)
    except Exception as error:
        return f"raises {type(error).__name__}"


def differences(a: dict[str, Any], b: dict[str, Any], tolerance: float, size: float = 1.0) -> str:
    """Say in what two values that were taken apart differ; nothing if they agree.

    With a tolerance, numbers may differ by it relative to the largest of their array, or to
    ``size``.
    """
    if a.keys() != b.keys():
        return f"{sorted(a.keys() ^ b.keys())[:5]} on one side only"
    for name, one in a.items():
        other = b[name]
        if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
            if one.shape != other.shape or one.dtype.kind != other.dtype.kind:
                return f"{name}: {one.dtype}{one.shape} and {other.dtype}{other.shape}"
            if not agree(one, other, tolerance, size):
                return f"{name}: {brief(one)} and {brief(other)}"
        elif type(one) is not type(other) or one != other:
            return f"{name}: {one!r:.200} and {other!r:.200}"
    return ""


def agree(a: np.ndarray, b: np.ndarray, tolerance: float, size: float) -> bool:
    """Whether arrays of one shape agree."""
    if tolerance == 0.0 or a.dtype.kind not in "fc":
        return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    finite = np.isfinite(a)
    if not np.array_equal(a[~finite], b[~finite], equal_nan=True) or not np.isfinite(b[finite]).all():
        return False
    if not finite.any():
        return True
    scale = max(np.abs(a[finite]).max(), np.abs(b[finite]).max(), size)
    return bool((np.abs(a[finite] / scale - b[finite] / scale) <= tolerance).all())


def brief(array: np.ndarray) -> str:
    """Show an array in a line."""
    return np.array2string(array.ravel()[:6], precision=17, max_line_width=1000) + (
        "..." if array.size > 6 else ""
    )

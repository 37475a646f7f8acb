"""How filters show themselves: every attribute, one below the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from fuzzykf.reprs import LINES, WIDTH, fitted, not_built, value_text

__all__ = ["describe"]

#: Largest innovation of which what a property computes is shown, if it was not asked for before.
CHEAP = 20


def describe(filter_: object, *more: str) -> str:
    """Lines ``name = value`` of the public attributes and ``more``; columns are shown as transposed rows.

    Where matrices row by row would take more than `LINES` lines, each has one line.  Nothing changes in the
    filter: what a property would keep, it computes for a copy.
    """
    kind = type(filter_).__name__
    values = {name: value for name, value in vars(filter_).items() if not name.startswith("_")}
    if not values:
        return not_built(kind)
    twin = _twin(filter_)
    for name in more:
        values[name] = _computed(twin, name)
    by_rows = sum(map(_rows, values.values())) < LINES
    show = _by_rows if by_rows else lambda name, value: f"{name} = {_one_line(value)}"
    lines = [f"{kind} object", *(show(name, value) for name, value in values.items())]
    return fitted("\n".join(lines))


def _twin(filter_: object) -> object:
    twin: object = type(filter_).__new__(type(filter_))
    vars(twin).update(vars(filter_))
    return twin


def _computed(twin: object, name: str) -> Any:
    size = getattr(vars(twin).get("S"), "size", 0)
    try:
        if size > CHEAP**2 and vars(twin).get(f"_{name}", 0.0) is None:
            return _Word("not computed yet")
        return getattr(twin, name)
    except Exception as error:  # S is singular, or the filter is not built: the other attributes are shown
        return _Word(f"none ({type(error).__name__})")


class _Word(str):
    """What stands for a value."""

    __slots__ = ()


def _turned(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[0] > value.shape[1] == 1


def _rows(value: Any) -> int:
    """Lines that a value needs where matrices are written row by row."""
    return value.shape[0] if isinstance(value, np.ndarray) and value.ndim == 2 and not _turned(value) else 1


def _by_rows(name: str, value: Any) -> str:
    if not isinstance(value, np.ndarray) or value.size > LINES**2:
        return f"{name} = {_one_line(value)}"
    try:
        text = f"{name} = " + (f"{value.T}.T" if _turned(value) else str(value))
    except Exception:  # an array of objects of somebody else
        return f"{name} = {value_text(value)}"
    return text.replace("\n", "\n" + " " * (len(name) + 3))


def _one_line(value: Any) -> str:
    try:
        return _short(value)
    except Exception:  # as above
        return value_text(value)


def _short(value: Any) -> str:
    if isinstance(value, _Word):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return str(value)
    if _turned(value) and value.size <= LINES:
        return f"{' '.join(str(value.T).split())}.T"
    if isinstance(value, np.ndarray) and value.size <= LINES:
        return " ".join(str(value).split())
    if isinstance(value, list) and all(hasattr(one, "dim_x") for one in value):  # the filters of a bank
        kinds = ", ".join(f"{type(one).__name__}(dim_x={one.dim_x})" for one in value)
        return f"[{kinds}]" if len(kinds) <= 2 * WIDTH else f"list of {len(value)} filters"
    return value_text(value)

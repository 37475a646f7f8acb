"""Memberships as plain values of a file, and back bit for bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.io import decode, encode, number
from fuzzykf.possibility.memberships.bounded import (
    BoxMembership,
    IntervalMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.possibility.memberships.derived import CutMembership, JointMembership
from fuzzykf.possibility.memberships.elliptical import (
    CauchyMembership,
    GaussianMembership,
    ParabolicMembership,
)
from fuzzykf.possibility.memberships.sampled import FunctionMembership, GridMembership
from fuzzykf.possibility.norms import TNorm
from fuzzykf.reprs import value_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.memberships.base import Membership

__all__ = ["from_values", "norm_from_values", "norm_to_values", "to_values"]

#: Memberships that are made from arrays: their attributes, in the order of the arguments.
ARRAYS: dict[type[Membership], tuple[str, ...]] = {
    GaussianMembership: ("center", "matrix"),
    CauchyMembership: ("center", "matrix"),
    ParabolicMembership: ("center", "matrix"),
    TriangularMembership: ("left", "peak", "right"),
    IntervalMembership: ("lower", "upper"),
    SingletonMembership: ("point",),
}

KINDS = {cls.__name__: cls for cls in ARRAYS}


def to_values(name: str, membership: Membership) -> dict[str, Any]:
    """Return a membership as plain values with its kind.

    Parameters
    ----------
    name : str
        What it is of, for messages.
    membership : Membership

    Raises
    ------
    ParameterError
        If it holds a function, or is of a class that nobody here knows.
    """
    kind = type(membership)
    values: dict[str, Any] = {"kind": kind.__name__}
    if kind in ARRAYS:
        return values | {one: encode(getattr(membership, one)) for one in ARRAYS[kind]}
    if isinstance(membership, BoxMembership):
        return values | bounds_to_values(membership.lower, membership.upper)
    if isinstance(membership, GridMembership):
        axes = [axis.tolist() for axis in membership.axes]
        return values | {"axes": axes, "values": membership.values.ravel().tolist()}
    if isinstance(membership, CutMembership):
        base = to_values(f"{name} (what was cut)", membership.base)
        bounds = bounds_to_values(membership.lower, membership.upper)
        return values | {"base": base, "level": membership.level} | bounds
    if isinstance(membership, JointMembership):
        parts = [to_values(f"{name}[{k}]", one) for k, one in enumerate(membership.components)]
        return values | {"components": parts, "t_norm": norm_to_values(membership.t_norm)}
    if isinstance(membership, FunctionMembership):
        what = f"a FunctionMembership of the function {value_text(membership.function)}"
    else:
        what = f"a {kind.__name__} of your own"
    raise ParameterError(
        f"{name}: got {what}, which a file cannot hold, as it holds values and never code; expected a "
        "membership given by numbers (fuzzykf.possibility.memberships.sampled makes one of a grid), or pickle"
    )


def from_values(values: Mapping[str, Any]) -> Membership:
    """Make a membership from what `to_values` returned."""
    kind = values["kind"]
    if kind in KINDS:
        cls: Callable[..., Membership] = KINDS[kind]
        return cls(*(decode(values[one], 2 if one == "matrix" else 1) for one in ARRAYS[KINDS[kind]]))
    if kind == "BoxMembership":
        return BoxMembership(*bounds_from_values(values))
    if kind == "GridMembership":
        axes = tuple(decode(axis, 1) for axis in values["axes"])
        grid = decode(values["values"], 1).reshape([axis.size for axis in axes])
        return GridMembership(axes, grid)
    if kind == "CutMembership":
        base, level = from_values(values["base"]), number(values["level"])
        if level > 0.0:
            return CutMembership(base, level)
        return CutMembership(base, np.stack(bounds_from_values(values), axis=1).tolist())
    if kind == "JointMembership":
        parts = [from_values(one) for one in values["components"]]
        return JointMembership(parts, norm_from_values(values["t_norm"]))
    raise FileFormatError(f"kind: got {kind!r}, expected that of a membership")


def bounds_to_values(lower: FloatArray, upper: FloatArray) -> dict[str, Any]:
    """Return bounds as lists, None where there is none."""
    return {
        "lower": [None if np.isinf(one) else one for one in lower.tolist()],
        "upper": [None if np.isinf(one) else one for one in upper.tolist()],
    }


def bounds_from_values(values: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Return bounds (dim,) from what `bounds_to_values` returned."""
    lower, upper = (decode(values[name], 1) for name in ("lower", "upper"))
    return np.where(np.isnan(lower), -np.inf, lower), np.where(np.isnan(upper), np.inf, upper)


def norm_to_values(norm: TNorm) -> dict[str, Any]:
    """Return a t-norm as plain values."""
    return {"name": norm.name, "scale": norm.scale, "additive": norm.additive, "family": norm.family}


def norm_from_values(values: Mapping[str, Any]) -> TNorm:
    """Make a t-norm from what `norm_to_values` returned."""
    if not isinstance(values["name"], str):
        raise FileFormatError(f"name: got {values['name']!r}, expected the name of a t-norm")
    return TNorm(values["name"], values["scale"], values["additive"], values["family"])

"""What is known of the state at every step: the box, or the membership, that it does not leave.

A constraint C is combined with what is known, and the result is divided by its peak,

    mu(x) <- T(mu(x), C(x)) / sup T(mu, C),

as if a measurement of x had said so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.possibility.mapping import Mapping
from fuzzykf.possibility.memberships import BoxMembership, IntervalMembership, Membership
from fuzzykf.possibility.memberships.derived import as_box, as_membership

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.norms import TNorm

__all__ = ["as_constraint", "as_measurement", "is_crisp", "narrowed"]


def as_constraint(value: Any, dim: int, t_norm: TNorm) -> Membership:
    """Turn what a user gave for a constraint into one membership.

    Parameters
    ----------
    value : Membership, sequence of scalar Membership, or (lower, upper)
        Bounds are numbers or vectors (dim,), infinite where there is none.
    dim : int
        Of the state.
    t_norm : TNorm
        How components combine.

    Returns
    -------
    Membership
        If it is crisp, an `IntervalMembership` or a `BoxMembership`.

    Raises
    ------
    ParameterError, ShapeError
        If it is something else, or of another dimension.
    """
    if isinstance(value, BoxMembership) and value.dim == dim:
        return value
    if isinstance(value, Membership) or (
        isinstance(value, list | tuple) and any(isinstance(one, Membership) for one in value)
    ):
        if not isinstance(value, Membership) and None in value:
            raise ParameterError(
                "constraint: got None for a component, expected memberships, or a box (lower, upper) with "
                "infinite bounds where there is none"
            )
        membership = as_membership("constraint", value, dim, t_norm)
        return as_box(membership) or membership
    return _box(value, dim)


def _box(value: Any, dim: int) -> Membership:
    """Read a box (lower, upper)."""
    expected = f"a membership, or bounds (lower, upper), each a number or of shape ({dim},)"
    if not isinstance(value, list | tuple | np.ndarray) or len(value) != 2:
        raise ParameterError(f"constraint: got {brief(value)}, expected {expected}")
    bounds = []
    for name, bound in zip(("lower", "upper"), value, strict=True):
        array = as_numbers(f"constraint: {name}", bound)
        if array.shape not in {(), (1,), (dim,)}:
            raise ShapeError(f"constraint: got {name} of shape {array.shape}, expected {expected}")
        bounds.append(np.broadcast_to(array, (dim,)))
    try:
        finite = np.isfinite(bounds).all()
        return IntervalMembership(*bounds) if finite else BoxMembership(*bounds)
    except ParameterError as error:
        raise type(error)(f"constraint: {error}") from error


def is_crisp(constraint: Membership) -> bool:
    """Whether a constraint is a box: to apply it twice is then to apply it once."""
    return isinstance(constraint, IntervalMembership | BoxMembership)


def as_measurement(constraint: Membership) -> tuple[Mapping, Membership, FloatArray]:
    """Return the map, the noise and the z of a measurement that says the same: 0 = -x + v, v in C."""
    d = constraint.dim
    return Mapping("constraint", d, d, matrix=-np.eye(d)), constraint, np.zeros(d)


def narrowed(
    lower: FloatArray, upper: FloatArray, constraint: Membership | None
) -> tuple[FloatArray, FloatArray]:
    """Return bounds of a state no further than a box goes: those of a grid end at the node beyond.

    Parameters
    ----------
    lower, upper : ndarray, shape (..., dim)
    constraint : Membership or None
        Bounds outside of it, which ``on_empty`` may have kept, stay as they are.
    """
    if constraint is None or not is_crisp(constraint):
        return lower, upper
    low, high = constraint.support()
    return (
        np.where((lower < low) & (low <= upper), low, lower),
        np.where((upper > high) & (high >= lower), high, upper),
    )

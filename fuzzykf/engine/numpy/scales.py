"""How costs and memberships are related, on arrays: the generators of the t-norms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["Scale", "from_membership", "scaled", "to_membership"]

#: "log": -log(membership); "reciprocal": 1/membership - 1; "complement": 1 - membership.
Scale: TypeAlias = Literal["log", "reciprocal", "complement"]


def from_membership(membership: FloatArray, scale: Scale) -> FloatArray:
    """Costs of memberships: 0 for 1; infinite ("complement": 1) for 0."""
    if scale == "complement":
        return 1.0 - membership
    with np.errstate(divide="ignore", over="ignore"):
        return -np.log(membership) if scale == "log" else 1.0 / membership - 1.0


def to_membership(cost: FloatArray, scale: Scale) -> FloatArray:
    """Memberships of costs."""
    if scale == "log":
        return np.exp(-cost)
    if scale == "reciprocal":
        return 1.0 / (1.0 + cost)
    return np.maximum(0.0, 1.0 - cost)


def scaled(cost: FloatArray, factor: FloatArray, scale: Scale) -> FloatArray:
    """Costs after multiplication of the memberships by a positive factor."""
    if scale == "log":
        return cost - np.log(factor)
    return from_membership(to_membership(cost, scale) * factor, scale)

"""A box as the intervals of this folder hand it on: two bounds, and nothing that costs time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from fuzzykf.possibility.memberships import IntervalMembership

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["Box"]


class Box(NamedTuple):
    """Bounds of a set of states.

    Attributes
    ----------
    lower, upper : ndarray, shape (d,)
        lower <= upper.
    """

    lower: FloatArray
    upper: FloatArray

    @property
    def dim(self) -> int:
        """Number of components."""
        return self.lower.size

    def as_membership(self) -> IntervalMembership:
        """Return the crisp membership of this box."""
        return IntervalMembership(self.lower, self.upper)

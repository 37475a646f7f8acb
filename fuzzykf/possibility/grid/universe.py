"""How large a lattice is and where it lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["Universe"]


@dataclass(frozen=True)
class Universe:
    """How large a lattice is and where it lies.

    Attributes
    ----------
    points : tuple of int
        Nodes per axis.
    domain : ndarray, shape (d, 2), or None
        A fixed box; None lets the lattice follow the live region.
    limit : float
        Without a domain, states of a higher cost are left out.
    bounded : bool
        Whether the states form a bounded set, so that the edges of the lattice are
        those of their support.
    """

    points: tuple[int, ...]
    domain: FloatArray | None
    limit: float
    bounded: bool

    def axis(self, k: int, lower: float, upper: float) -> FloatArray:
        """Return the axis over the given bounds, or over the domain if there is one."""
        if self.domain is not None:
            lower, upper = self.domain[k]
        return np.linspace(lower, upper, self.points[k])

    def is_small(self, k: int, span: float) -> bool:
        """Whether a span is so small a part of the domain that an axis of its own pays."""
        return self.domain is not None and span < 0.5 * float(self.domain[k, 1] - self.domain[k, 0])

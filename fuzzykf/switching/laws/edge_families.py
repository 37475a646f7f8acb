"""Densities of a symmetric law along one edge of a graph: linear in the distance, or constant on a band.

t and s in ]0, 1[ are positions on the edge, a class is 0 or 1.  A family knows its density, the exact
masses of cells, and how to draw; all of them are with respect to the Dirac masses of the classes and
the length along the edge.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.immutable import Immutable, cached_property
from fuzzykf.reprs import reprs
from fuzzykf.switching.laws.fmc1 import FMC1
from fuzzykf.switching.laws.shares import ROUNDING

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["FAMILIES", "Band", "EdgeFamily", "Linear", "as_width"]


class EdgeFamily(Protocol):
    """A density along one edge."""

    @property
    def mass(self) -> float:
        """Probability of the edge, without what crosses to others."""

    @property
    def flow(self) -> float:
        """Joint mass of one class and then the edge."""

    def density(self, distance: FloatArray) -> FloatArray:
        """Density at a distance, also of a class and a position."""

    def marginal(self, t: FloatArray) -> FloatArray:
        """Density at positions, whatever follows, without what crosses to other edges."""

    def from_class(self, F: int) -> FloatArray:
        """Joint masses of the class at 0 and each of F cells, (F,)."""

    def between(self, F: int) -> FloatArray:
        """Joint masses of two cells, (F, F)."""

    def within(self, t: float) -> float:
        """Density of a position (or class) followed by any position on the edge."""

    def draw(self, t: float, u: float) -> float:
        """Map a uniform number to a position that follows another, or a class."""

    @property
    def bends(self) -> tuple[float, ...]:
        """Distances from both ends at which the marginal density is not smooth."""


@reprs("eta", "delta")
class Linear(Immutable):
    """Density eta + (delta - eta) |t - s|, that of FMC1."""

    def __init__(self, name: str, eta: float, delta: float) -> None:
        for part, value in (("eta", eta), ("delta", delta)):
            if not value >= 0.0:
                raise ParameterError(
                    f"{name}, {part}: got {value:.6g}, expected a density, which is not negative"
                )
        self.eta, self.delta = eta, delta

    @property
    def mass(self) -> float:
        """5 eta/3 + 4 delta/3."""
        return 5.0 * self.eta / 3.0 + 4.0 * self.delta / 3.0

    @property
    def flow(self) -> float:
        """(eta + delta)/2."""
        return 0.5 * (self.eta + self.delta)

    @cached_property
    def _law(self) -> FMC1:
        """A law with this density; known to be one once the masses of the graph are."""
        return FMC1(0.0, self.delta, self.eta)

    def density(self, distance: FloatArray) -> FloatArray:
        """Linear in the distance."""
        return self.eta + (self.delta - self.eta) * distance

    def marginal(self, t: FloatArray) -> FloatArray:
        """Quadratic (2020 paper, eq. 23)."""
        return self._law.marginal_density(t)

    def from_class(self, F: int) -> FloatArray:
        """Linear in the number of the cell."""
        h = 1.0 / F
        return self.density((np.arange(F, dtype=np.float64) + 0.5) * h) * h

    def between(self, F: int) -> FloatArray:
        """Linear in the distance of the cells; within one cell the mean distance is h/3."""
        h = 1.0 / F
        cells = np.arange(F)
        distance = np.abs(cells[:, None] - cells).astype(np.float64)
        return self.density(np.where(distance == 0.0, 1.0 / 3.0, distance) * h) * (h * h)

    def within(self, t: float) -> float:
        """As of FMC1."""
        return self._law._inner_mass(t)

    def draw(self, t: float, u: float) -> float:
        """As of FMC1."""
        return self._law._draw_inside(t, u)

    @property
    def bends(self) -> tuple[float, ...]:
        """None."""
        return ()


@reprs("gamma", "width")
class Band(Immutable):
    """Density gamma where |t - s| <= width, that of FMC2, zero elsewhere."""

    def __init__(self, name: str, gamma: float, width: float) -> None:
        if not gamma >= 0.0:
            raise ParameterError(f"{name}, gamma: got {gamma:.6g}, expected a density, which is not negative")
        self.gamma, self.width = gamma, as_width(name, width)

    @property
    def mass(self) -> float:
        """Gamma width (4 - width)."""
        return self.gamma * self.width * (4.0 - self.width)

    @property
    def flow(self) -> float:
        """Gamma width."""
        return self.gamma * self.width

    def density(self, distance: FloatArray) -> FloatArray:
        """Constant on the band, whose rim counts."""
        return np.where(distance <= self.width + ROUNDING, self.gamma, 0.0)

    def marginal(self, t: FloatArray) -> FloatArray:
        """From the classes at both ends, and as wide as the band is within the edge (2020 paper, eq. 31)."""
        inside = np.minimum(t + self.width, 1.0) - np.maximum(t - self.width, 0.0)
        return self.density(t) + self.density(1.0 - t) + self.gamma * inside

    def from_class(self, F: int) -> FloatArray:
        """Length of the band in each cell."""
        h = 1.0 / F
        length = np.clip(self.width - np.arange(F) * h, 0.0, h)
        return self.gamma * np.where(length > ROUNDING, length, 0.0)

    def between(self, F: int) -> FloatArray:
        """Area of the band in each pair of cells, by the law of U - V for uniform U and V.

        Never a difference of large areas: what is left of one by rounding would be no impossible pair.
        """
        h = 1.0 / F
        cells = np.arange(F)
        distance = np.abs(cells[:, None] - cells)
        x = np.clip(self.width / h - distance, -1.0, 1.0)
        x[x < -1.0 + ROUNDING] = -1.0
        area = np.where(x <= 0.0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2)
        same = 1.0 - (1.0 - min(self.width / h, 1.0)) ** 2
        return self.gamma * h * h * np.where(distance == 0, same, area)

    def within(self, t: float) -> float:
        """As wide as the band is within the edge."""
        return self.gamma * (min(1.0, t + self.width) - max(0.0, t - self.width))

    def draw(self, t: float, u: float) -> float:
        """Uniform on the band."""
        low, high = max(0.0, t - self.width), min(1.0, t + self.width)
        return low + u * (high - low)

    @property
    def bends(self) -> tuple[float, ...]:
        """Where the band leaves the edge."""
        return (self.width,)


#: Families by name, with the names of their parameters.
FAMILIES: dict[str, tuple[type[Linear] | type[Band], str]] = {
    "linear": (Linear, "(eta, delta)"),
    "band": (Band, "(gamma, width)"),
}


def as_width(name: str, width: float) -> float:
    """Return the half width of a band, in ]0, 1/2]."""
    if not 0.0 < width <= 0.5:
        raise ParameterError(f"{name}, width: got {width:.6g}, expected a half width in ]0, 0.5]")
    return width

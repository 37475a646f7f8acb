"""FMC1: the fuzzy law that is linear in the distance (2020 paper, eqs. 21 to 25)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.base import ParametricLaw
from fuzzykf.switching.laws.integration import Lines, cell_masses
from fuzzykf.switching.laws.law import FuzzyMarkovLaw, checked_switch
from fuzzykf.switching.laws.shares import ROUNDING, as_number, beta_of, logits_of, softmax

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["FMC1"]


class FMC1(FuzzyMarkovLaw, ParametricLaw):
    """Density linear in the distance |r1 - r2|, see `FuzzyMarkovLaw.fmc1`."""

    kind = "fmc1"
    n_free = n_shares = 3

    def __init__(self, alpha: float, delta: float, eta: float) -> None:
        alpha, delta, eta = (as_number(n, v) for n, v in (("alpha", alpha), ("delta", delta), ("eta", eta)))
        for name, value in (("delta", delta), ("eta", eta)):
            if value < 0.0:
                raise ParameterError(f"{name}: got {value:.6g}, expected a density, which is not negative")
        # eq. (24): alpha + beta
        bound = (1.0 - 2.5 * (delta + eta) + (delta - eta) / 6.0) / 2.0
        if bound < -ROUNDING:
            raise ParameterError(
                f"delta, eta: got {delta:.6g} and {eta:.6g}, for which 5/2 (delta + eta) - (delta - eta)/6 "
                f"= {1.0 - 2.0 * bound:.6g}; expected at most 1"
            )
        beta = beta_of(
            alpha, bound, f"beta (eq. 24) is not negative for delta = {delta:.6g} and eta = {eta:.6g}"
        )
        self.alpha, self.delta, self.eta = alpha, delta, eta
        self.corners = np.array([[alpha, beta], [beta, alpha]])

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the law by name."""
        return {"alpha": self.alpha, "delta": self.delta, "eta": self.eta}

    @property
    def lines(self) -> Lines:
        """Where the density is not smooth."""
        return Lines(kinks=np.array([0.0]), breaks=np.array([0.0, 1.0]), order=4)

    def _interior(self, r1: FloatArray, r2: FloatArray) -> FloatArray:
        density: FloatArray = self.eta + (self.delta - self.eta) * np.abs(r1 - r2)
        return density

    def _edge(self, corner: FloatArray, r: FloatArray) -> FloatArray:
        return self._interior(corner, r)

    def marginal_density(self, r: ArrayLike) -> FloatArray:
        """Return p(r) in closed form."""
        value = checked_switch("r", r)
        delta, eta = self.delta, self.eta
        hard = (value == 0.0) | (value == 1.0)  # eq. (23)
        inside = 1.5 * (delta + eta) + (delta - eta) * (value * value - value)
        return np.where(hard, self.corners[0].sum() + 0.5 * (delta + eta), inside)

    def _inner_mass(self, r: float) -> float:
        return self._below(r, 1.0)

    def _below(self, r: float, s: float) -> float:
        """Mass of the values in ]0, s[ that follow r."""
        slope = self.delta - self.eta
        spread = 0.5 * (r * r - (r - s) * abs(r - s))
        return self.eta * s + slope * spread

    def _draw_inside(self, r: float, u: float) -> float:
        # the distribution function is quadratic on either side of r
        slope = self.delta - self.eta
        level = self.eta  # density at distance zero
        target = u * self._below(r, 1.0) - self._below(r, r)
        side = 1.0 if target >= 0.0 else -1.0
        # level t + slope t^2 / 2 = |target|, in the form that does not cancel
        root = np.sqrt(max(level * level + 2.0 * slope * abs(target), 0.0))
        distance = 2.0 * abs(target) / (level + root) if level + root > 0.0 else 0.0
        return float(min(max(r + side * distance, np.nextafter(0.0, 1.0)), np.nextafter(1.0, 0.0)))

    # ------------------------------------------------------------------ learning

    @classmethod
    def start(cls) -> Self:
        """Return the law from which a search begins."""
        return cls(0.25, 0.03, 0.08)

    def logits(self) -> FloatArray:
        """Return three free numbers: shares 2 alpha, 2 beta, 8 eta / 3 and 7 delta / 3 of the mass."""
        return logits_of(2 * self.alpha, 2 * self.beta, 8 * self.eta / 3, 7 * self.delta / 3)

    def estimates_of(self, law: FMC1) -> dict[str, float]:
        """Return what the logits of a law stand for; alpha follows from these."""
        return {"beta": law.beta, "eta": law.eta, "delta": law.delta}

    @classmethod
    def from_logits(cls, logits: FloatArray) -> Self:
        """Make the law of these shares."""
        a, _, e, d = softmax(logits)
        return cls(alpha=a / 2.0, delta=3.0 * d / 7.0, eta=3.0 * e / 8.0)

    @classmethod
    def on_cells(cls, n_nodes: int) -> Callable[[FloatArray], FloatArray]:
        """Return the map from logits to masses of cells, which are linear in the parameters."""
        bounds = np.linspace(0.0, 1.0, n_nodes + 1) if n_nodes else np.array([0.0])
        of_delta = _without_corners(cell_masses(cls(0.0, 0.1, 0.0), bounds)) / 0.1
        of_eta = _without_corners(cell_masses(cls(0.0, 0.0, 0.1), bounds)) / 0.1

        def joint(logits: FloatArray) -> FloatArray:
            a, b, e, d = softmax(logits)
            masses = (3.0 * e / 8.0) * of_eta + (3.0 * d / 7.0) * of_delta
            masses[[0, -1], [0, -1]] = a / 2.0
            masses[[0, -1], [-1, 0]] = b / 2.0
            normalised: FloatArray = masses / masses.sum()
            return normalised

        return joint


def _without_corners(masses: FloatArray) -> FloatArray:
    masses = masses.copy()
    masses[np.ix_([0, -1], [0, -1])] = 0.0
    return masses

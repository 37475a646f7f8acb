"""FMC2: the fuzzy law that is constant on a band (2020 paper, eqs. 29 to 33)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.base import ParametricLaw
from fuzzykf.switching.laws.integration import Lines
from fuzzykf.switching.laws.law import FuzzyMarkovLaw, checked_switch
from fuzzykf.switching.laws.shares import ROUNDING, as_number, beta_of, logits_of, softmax

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["FMC2"]


class FMC2(FuzzyMarkovLaw, ParametricLaw):
    """Density constant on a band, see `FuzzyMarkovLaw.fmc2`."""

    kind = "fmc2"
    n_free = 3
    n_shares = 2

    def __init__(self, alpha: float, gamma: float, delta: float) -> None:
        alpha, gamma, delta = (
            as_number(n, v) for n, v in (("alpha", alpha), ("gamma", gamma), ("delta", delta))
        )
        if not 0.0 <= delta < 0.5:
            raise ParameterError(f"delta: got {delta:.6g}, expected a half width in [0, 0.5[")
        area = delta * (6.0 - delta)
        if gamma < 0.0:
            raise ParameterError(f"gamma: got {gamma:.6g}, expected a density, which is not negative")
        bound = (1.0 - gamma * area) / 2.0  # eq. (32): alpha + beta
        if bound < -ROUNDING:
            raise ParameterError(
                f"gamma: got {gamma:.6g}, expected a number in [0, {1.0 / area:.6g}] for delta = {delta:.6g} "
                f"(in [0, {max(1.0 - 2.0 * alpha, 0.0) / area:.6g}] for alpha = {alpha:.6g})"
            )
        beta = beta_of(
            alpha,
            bound,
            f"beta (eq. 32) is not negative for gamma = {gamma:.6g} and delta = {delta:.6g}"
            + (
                f"; for alpha = {alpha:.6g}, gamma must be at most {(1.0 - 2.0 * alpha) / area:.6g}"
                if area > 0.0 and 0.0 <= alpha <= 0.5
                else ""
            ),
        )
        self.alpha, self.gamma, self.delta = alpha, gamma, delta
        self.corners = np.array([[alpha, beta], [beta, alpha]])

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the law by name."""
        return {"alpha": self.alpha, "gamma": self.gamma, "delta": self.delta}

    @property
    def lines(self) -> Lines:
        """Where the density is not smooth."""
        # the marginal has kinks at delta and 1 - delta (eq. 31)
        breaks = np.array([0.0, self.delta, 1.0 - self.delta, 1.0])
        return Lines(kinks=np.array([-self.delta, self.delta]), breaks=np.unique(breaks), order=4)

    def _interior(self, r1: FloatArray, r2: FloatArray) -> FloatArray:
        # midpoint nodes fall on the rim of the band exactly, but for rounding
        return np.where(np.abs(r1 - r2) <= self.delta + ROUNDING, self.gamma, 0.0)

    def _edge(self, corner: FloatArray, r: FloatArray) -> FloatArray:
        return self._interior(corner, r)

    def marginal_density(self, r: ArrayLike) -> FloatArray:
        """Return p(r) in closed form."""
        value = checked_switch("r", r)
        hard = (value == 0.0) | (value == 1.0)  # eq. (31)
        low = np.where(value <= self.delta + ROUNDING, 1.0 + value, self.delta)
        high = np.where(value >= 1.0 - self.delta - ROUNDING, 2.0 - value, self.delta)
        return np.where(hard, self.corners[0].sum() + self.gamma * self.delta, self.gamma * (low + high))

    def _inner_mass(self, r: float) -> float:
        return self.gamma * (min(1.0, r + self.delta) - max(0.0, r - self.delta))

    def _draw_inside(self, r: float, u: float) -> float:
        low, high = max(0.0, r - self.delta), min(1.0, r + self.delta)
        return float(min(max(low + u * (high - low), np.nextafter(0.0, 1.0)), np.nextafter(1.0, 0.0)))

    # ------------------------------------------------------------------ learning

    @classmethod
    def start(cls) -> Self:
        """Return the law from which a search begins."""
        return cls(0.25, 0.3, 0.2)

    def logits(self) -> FloatArray:
        """Return three free numbers: two of 2 alpha, 2 beta and the rest of the mass, one of delta."""
        shares = logits_of(2 * self.alpha, 2 * self.beta, 1 - 2 * self.alpha - 2 * self.beta)
        return np.append(shares, _width_logit(np.clip(2.0 * self.delta, 1e-3, 1.0 - 1e-3)))

    def estimates_of(self, law: FMC2) -> dict[str, float]:
        """Return what the logits of a law stand for; alpha follows from these."""
        return {"beta": law.beta, "gamma": law.gamma, "delta": law.delta}

    @classmethod
    def from_logits(cls, logits: FloatArray) -> Self:
        """Make the law of these shares on a band of this width."""
        return cls._from_shares(logits[:2], _half_width(logits))

    @classmethod
    def _from_shares(cls, logits: FloatArray, delta: float) -> Self:
        a, _, band = softmax(logits)
        area = delta * (6.0 - delta)
        return cls(alpha=a / 2.0, gamma=band / area if area else 0.0, delta=delta)

    @classmethod
    def on_cells(cls, n_nodes: int) -> Callable[[FloatArray], FloatArray]:
        """Return the map from logits to masses of cells: those of the band, whose areas are known."""

        def joint(logits: FloatArray) -> FloatArray:
            delta = _half_width(logits)
            a, b, band = softmax(logits[:2])
            masses = band / (delta * (6.0 - delta)) * _band_areas(n_nodes, delta)
            masses[[0, -1], [0, -1]] = a / 2.0
            masses[[0, -1], [-1, 0]] = b / 2.0
            normalised: FloatArray = masses / masses.sum()
            return normalised

        return joint

    @classmethod
    def elsewhere(cls, logits: FloatArray, n_nodes: int) -> list[FloatArray]:
        """Return logits of other widths.

        A pair of nodes off the band has probability zero, and keeps it; one on its
        edge would have to lose all of it.  So the width hardly leaves the multiples of
        the width of a cell that it lies between.
        """
        edges = np.append(np.arange(0.0, 0.5, 1.0 / n_nodes), 0.5) if n_nodes else np.empty(0)
        return [
            np.append(logits[:2], _width_logit(low + high))  # the middle of the interval
            for low, high in pairwise(edges.tolist())
            if not low < _half_width(logits) <= high
        ]

    @classmethod
    def given(cls, before: FloatArray, after: FloatArray) -> tuple[Callable[[FloatArray], Self], int]:
        """Return the laws whose band is as narrow as the transitions of a known switch allow.

        The likelihood falls with delta, and is zero below the largest step.
        """
        hard = np.isin(before, (0.0, 1.0)) & np.isin(after, (0.0, 1.0))
        steps = np.abs(after - before)[~hard]
        if steps.size == 0:
            stay = float((before == after).mean())
            shares = np.array([np.log(max(1.0 - stay, 1e-9) / max(stay, 1e-9)), -50.0])
            return (lambda _: cls._from_shares(shares, 0.0)), 0
        delta = float(steps.max())
        if delta >= 0.5:
            k = int(np.argmax(np.where(hard, 0.0, np.abs(after - before))))
            raise ParameterError(
                f"law: the switch moves from {before[k]:.6g} to {after[k]:.6g} in one step; FMC2 allows "
                "gradual steps of less than 0.5 only (use 'fmc1')"
            )
        return (lambda logits: cls._from_shares(logits, delta)), 2


def _half_width(logits: FloatArray) -> float:
    return 0.5 / (1.0 + float(np.exp(-logits[2])))


def _width_logit(width: float) -> float:
    """Return the logit of the width of the whole band."""
    return float(np.log(width / (1.0 - width)))


def _band_areas(F: int, delta: float) -> FloatArray:
    """Measure of the band |r1 - r2| <= delta in each pair of cells, (F + 2, F + 2), without the corners.

    In the square it depends on the distance of the cells alone: a second difference of
    the function whose second derivative is the indicator of the band.
    """
    areas = np.zeros((F + 2, F + 2))
    if F == 0:
        return areas
    cells = np.arange(F)
    edge = np.clip(delta - cells / F, 0.0, 1.0 / F)
    areas[0, 1:-1] = areas[1:-1, 0] = edge
    areas[-1, 1:-1] = areas[1:-1, -1] = edge[::-1]
    t = np.abs(np.arange(-1, F + 1) / F)
    second = np.where(t <= delta, 0.5 * t * t, delta * t - 0.5 * delta * delta)
    areas[1:-1, 1:-1] = np.maximum(np.diff(second, 2), 0.0)[np.abs(cells[:, None] - cells)]
    return areas

"""The families of fuzzy laws: FMC1 and FMC2 of the paper, and any density given as functions.

They are made by the constructors of `fuzzykf.FuzzyMarkovLaw`.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array
from fuzzykf.switching.laws.integration import Lines, cell_masses
from fuzzykf.switching.laws.law import FuzzyMarkovLaw, checked_switch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.law import Density, Edges

__all__ = ["FMC1", "FMC2", "DensityLaw"]

#: A mass or a density may be negative by this much through rounding; it then counts as zero.
ROUNDING = 1e-12

#: Largest error of the total mass of a density given as a function.
MASS_TOLERANCE = 1e-3


class FMC1(FuzzyMarkovLaw):
    """Density linear in the distance |r1 - r2|, see `FuzzyMarkovLaw.fmc1`."""

    kind = "fmc1"

    def __init__(self, alpha: float, delta: float, eta: float) -> None:
        alpha, delta, eta = (_number(n, v) for n, v in (("alpha", alpha), ("delta", delta), ("eta", eta)))
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
        beta = _beta(
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


class FMC2(FuzzyMarkovLaw):
    """Density constant on a band, see `FuzzyMarkovLaw.fmc2`."""

    kind = "fmc2"

    def __init__(self, alpha: float, gamma: float, delta: float) -> None:
        alpha, gamma, delta = (
            _number(n, v) for n, v in (("alpha", alpha), ("gamma", gamma), ("delta", delta))
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
        beta = _beta(
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


class DensityLaw(FuzzyMarkovLaw):
    """Density given part by part, see `FuzzyMarkovLaw.from_density`."""

    kind = "from_density"

    def __init__(
        self, corners: ArrayLike, edges: Edges, interior: Density | float, kinks: Sequence[float]
    ) -> None:
        masses = as_array("corners", corners, (2, 2))
        if (masses < 0.0).any() or abs(masses[0, 1] - masses[1, 0]) > ROUNDING:
            raise ParameterError(
                f"corners: got {masses.tolist()}, expected four masses, not negative, with "
                "corners[0, 1] = corners[1, 0]"
            )
        shifts = as_array("kinks", list(kinks), (None,))
        if (np.abs(shifts) > 1.0).any():
            raise ParameterError(f"kinks: got {shifts.tolist()}, expected differences r2 - r1 in [-1, 1]")
        self.corners = masses
        self._edges = _edge_functions(edges)
        self._inside = _as_function("interior", interior)
        self._lines = Lines(
            kinks=np.unique(np.concatenate([shifts, -shifts])), breaks=np.linspace(0.0, 1.0, 9), order=12
        )
        grid: FloatArray = (np.arange(32, dtype=np.float64) + 0.5) / 32.0
        values = self._interior(*np.meshgrid(grid, grid, indexing="ij"))
        if not np.allclose(values, values.T, rtol=1e-9, atol=1e-12):
            raise ParameterError(
                "interior: expected a symmetric density, interior(r1, r2) = interior(r2, r1)"
            )
        for k in (0.0, 1.0):
            self._edge(np.full(grid.size, k), grid)
        total = float(cell_masses(self, np.linspace(0.0, 1.0, 5)).sum())
        if abs(total - 1.0) > MASS_TOLERANCE:
            raise ParameterError(
                f"corners, edges, interior: the total mass is {total:.6g}, expected 1; corners + 2 (integral "
                "of both edges) + integral of the interior"
            )

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the law by name."""
        return {}

    @property
    def lines(self) -> Lines:
        """Where the density is not smooth."""
        return self._lines

    def _edge(self, corner: FloatArray, r: FloatArray) -> FloatArray:
        value = np.where(corner == 0.0, _evaluate("edges", self._edges[0], r), 0.0)
        return value + np.where(corner == 1.0, _evaluate("edges", self._edges[1], r), 0.0)

    def _interior(self, r1: FloatArray, r2: FloatArray) -> FloatArray:
        return _evaluate("interior", self._inside, r1, r2)


# --------------------------------------------------------------------------- arguments


def _number(name: str, value: float) -> float:
    return float(as_array(name, value, ()))


def _beta(alpha: float, bound: float, purpose: str) -> float:
    """Beta from alpha and alpha + beta; zero where rounding makes it negative."""
    beta = bound - alpha
    if alpha < 0.0 or beta < -ROUNDING:
        raise ParameterError(
            f"alpha: got {alpha:.6g}, expected a number in [0, {max(bound, 0.0):.6g}], so that {purpose}"
        )
    return max(beta, 0.0)


def _as_function(name: str, density: Density | float) -> Density:
    if callable(density):
        return density
    constant = _number(name, density)

    def constant_density(*r: FloatArray) -> FloatArray:
        return np.full(np.broadcast_shapes(*(np.shape(a) for a in r)), constant)

    return constant_density


def _edge_functions(edges: Edges) -> tuple[Density, Density]:
    if callable(edges):
        both: Density = edges
        if _n_arguments(both) == 1:
            return both, both
        return (lambda r: both(np.zeros_like(r), r)), (lambda r: both(np.ones_like(r), r))
    if np.ndim(edges) == 0:  # type: ignore[arg-type]
        constant = _as_function("edges", edges)  # type: ignore[arg-type]
        return constant, constant
    pair = list(edges)  # type: ignore[arg-type]
    if len(pair) != 2:
        raise ParameterError(f"edges: got {len(pair)} parts, expected the two densities p(0, r) and p(1, r)")
    return _as_function("edges", pair[0]), _as_function("edges", pair[1])


def _n_arguments(function: Density) -> int:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions hide their signature
        return 2
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in positional and p.default is inspect.Parameter.empty for p in parameters)


def _evaluate(name: str, density: Density, *r: FloatArray) -> FloatArray:
    shape = np.broadcast_shapes(*(a.shape for a in r))
    value = np.asarray(density(*r), dtype=np.float64)
    try:
        value = np.broadcast_to(value, shape)
    except ValueError:
        raise ParameterError(f"{name}: returned shape {value.shape} for values of shape {shape}") from None
    if not np.isfinite(value).all() or (value < -ROUNDING).any():
        worst = value.min() if np.isfinite(value).all() else float("nan")
        raise ParameterError(f"{name}: returned {worst}, expected finite densities that are not negative")
    return np.maximum(value, 0.0)

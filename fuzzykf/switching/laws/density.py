"""A fuzzy law from any density given as functions (2020 paper, Remark 4)."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array
from fuzzykf.switching.laws.integration import Lines, cell_masses
from fuzzykf.switching.laws.law import FuzzyMarkovLaw
from fuzzykf.switching.laws.shares import ROUNDING, as_number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.law import Density, Edges

__all__ = ["DensityLaw"]

#: Largest error of the total mass of a density given as a function.
MASS_TOLERANCE = 1e-3


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
        shifts = as_array("kinks", kinks, (None,))
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

    def to_dict(self) -> dict[str, Any]:
        """Refuse: functions are code."""
        raise ParameterError("law: a law given by functions cannot be written to a file")

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


def _as_function(name: str, density: Density | float) -> Density:
    if callable(density):
        return density
    constant = as_number(name, density)

    def constant_density(*r: FloatArray) -> FloatArray:
        return np.full(np.broadcast_shapes(*(np.shape(a) for a in r)), constant)

    return constant_density


def _edge_functions(edges: Edges) -> tuple[Density, Density]:
    if callable(edges):
        both: Density = edges
        if _n_arguments(both) == 1:
            return both, both
        return (lambda r: both(np.zeros_like(r), r)), (lambda r: both(np.ones_like(r), r))
    given: Any = edges
    if not isinstance(given, list | tuple) and np.ndim(given) == 0:
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
    try:
        value = np.asarray(density(*r), dtype=np.float64)
    except TypeError as error:  # such as a function of one argument
        what = "an array" if len(r) == 1 else f"{len(r)} arrays"
        raise ParameterError(
            f"{name}: called with {what} of values of the switch, it raised a TypeError ({error}); expected "
            "a function that returns the density of each"
        ) from error
    try:
        value = np.broadcast_to(value, shape)
    except ValueError:
        raise ParameterError(f"{name}: returned shape {value.shape} for values of shape {shape}") from None
    if not np.isfinite(value).all() or (value < -ROUNDING).any():
        worst = value.min() if np.isfinite(value).all() else float("nan")
        raise ParameterError(f"{name}: returned {worst}, expected finite densities that are not negative")
    return np.maximum(value, 0.0)

"""Crossings of a law on a graph: from one edge to another, past the class that they share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_real, brief
from fuzzykf.switching.laws.edge_families import as_width
from fuzzykf.switching.laws.edges import as_edge, entries
from fuzzykf.switching.laws.shares import ROUNDING

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

    Edges = tuple[tuple[int, int], ...]

__all__ = ["Crossing", "as_crossings", "crossing_pairs"]


class Crossing(NamedTuple):
    """Density kappa between two edges with a common class, where the way past it is at most ``width``."""

    first: int  # numbers of the edges
    second: int
    ends: tuple[int, int]  # at which end, 0 or 1, of each the class is
    kappa: float
    width: float

    @property
    def mass(self) -> float:
        """Joint mass of the first edge and then the second."""
        return 0.5 * self.kappa * self.width**2

    def cells(self, F: int) -> FloatArray:
        """Joint masses of cells of both edges, counted from the common class: (F, F).

        The law of U + V for uniform U and V gives the part of a pair of cells that lies within the width.
        """
        h = 1.0 / F
        cells = np.arange(F)
        x = np.clip(self.width / h - cells[:, None] - cells, 0.0, 2.0)
        x[x < ROUNDING] = 0.0
        area: FloatArray = self.kappa * h * h * np.where(x <= 1.0, 0.5 * x * x, 1.0 - 0.5 * (2.0 - x) ** 2)
        return area

    def others(self, edge: int) -> list[tuple[int, int, int]]:
        """Return (the other edge, end of the class on this one, end on the other) for an edge of the two."""
        ways = ((self.first, self.second, *self.ends), (self.second, self.first, *self.ends[::-1]))
        return [(other, here, there) for own, other, here, there in ways if own == edge]


def crossing_pairs(given: Any, edges: Edges, n_classes: int) -> list[tuple[int, int, str, Any]]:
    """Return numbers of both edges, name and value of each entry of ``crossings``.

    Raises
    ------
    ParameterError
        If the two are no different edges with a class in common, or stand twice.
    """
    found: list[tuple[int, int, str, Any]] = []
    for key, value in entries("crossings", given, "{((a, b), (b, c)): (kappa, width)}"):
        name = f"crossings[{brief(key)}]"
        if not (isinstance(key, tuple | list) and len(key) == 2):
            raise ParameterError(f"crossings: got {brief(key)}, expected a pair of edges ((a, b), (b, c))")
        first, second = (_number(name, edge, edges, n_classes) for edge in key)
        if first == second or any({first, second} == {a, b} for a, b, *_ in found):
            raise ParameterError(
                f"{name}: got a pair of edges twice, or an edge and itself, expected two edges"
            )
        if not set(edges[first]) & set(edges[second]):
            raise ParameterError(f"{name}: expected edges with a class in common, past which one can cross")
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise ParameterError(
                f"{name}: got {brief(value)}, expected a pair of numbers, the second a width"
            )
        found.append((first, second, name, value))
    return found


def as_crossings(given: Any, edges: Edges, n_classes: int, family: str) -> tuple[Crossing, ...]:
    """Return the crossings that a user has given.

    Raises
    ------
    ParameterError
        If there are any for another family than bands, or one is none.
    """
    found = []
    for first, second, name, value in crossing_pairs(given, edges, n_classes):
        if family != "band":
            raise ParameterError(f"{name}: expected none for the family {family!r}, only for 'band'")
        kappa, width = as_real(f"{name}, kappa", value[0]), as_real(f"{name}, width", value[1])
        if not (kappa >= 0.0 and np.isfinite(kappa)):
            raise ParameterError(f"{name}, kappa: got {kappa:.6g}, expected a density, which is not negative")
        (vertex,) = set(edges[first]) & set(edges[second])
        ends = (edges[first].index(vertex), edges[second].index(vertex))
        found.append(Crossing(first, second, ends, kappa, as_width(name, width)))
    return tuple(found)


def _number(name: str, edge: Any, edges: Edges, n_classes: int) -> int:
    a, b = as_edge(name, edge, n_classes)
    for number, known in enumerate(edges):
        if known in ((a, b), (b, a)):
            return number
    raise ParameterError(f"{name}: {(a, b)} is none of the edges {list(edges)}")

"""Exact samples of a law on a graph: a walk among its classes and along its edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.switching.laws.integration import invert_line

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.crossings import Crossing
    from fuzzykf.switching.laws.edge_families import EdgeFamily

__all__ = ["GraphWalk"]

#: Where a walk is before it has begun.
NOWHERE = -1


@dataclass(frozen=True)
class GraphWalk:
    """What a walk needs to know of a law; see `fuzzykf.GraphLaw`.

    Attributes
    ----------
    masses : ndarray, shape (K + E,)
        Probability of each class and of each edge.
    corners : ndarray, shape (K, K)
    edges, densities, crossings : tuple
    """

    masses: FloatArray
    corners: FloatArray
    edges: tuple[tuple[int, int], ...]
    densities: tuple[EdgeFamily, ...]
    crossings: tuple[Crossing, ...]

    def path(self, uniforms: FloatArray) -> FloatArray:
        """Map uniform numbers (n, 2) to the class weights (n, K) of a stationary path."""
        K = len(self.corners)
        weights = np.zeros((len(uniforms), K))
        at, t = NOWHERE, 0.0  # a class, or K plus the number of an edge, and the position on it
        for k, (which, where) in enumerate(uniforms.tolist()):
            at, t = self._next(at, t, which, where)
            if at < K:
                weights[k, at] = 1.0
            else:
                a, b = self.edges[at - K]
                weights[k, a], weights[k, b] = 1.0 - t, t
        return weights

    def _next(self, at: int, t: float, which: float, where: float) -> tuple[int, float]:
        """Map two uniform numbers to what follows."""
        K = len(self.corners)
        masses = self.masses if at == NOWHERE else self._after(at, t)
        below = np.cumsum(masses)
        found = int(np.searchsorted(below, which * below[-1], side="right"))
        found = min(found, int(np.flatnonzero(masses)[-1]))  # rounding may miss the last sum
        if found < K:
            return found, 0.0
        e = found - K
        if at == NOWHERE:
            t = self._first(e, where)
        elif at == found:
            t = self.densities[e].draw(t, where)
        elif at < K:
            t = abs(self.edges[e].index(at) - self.densities[e].draw(0.0, where))
        else:
            t = self._crossed(at - K, e, t, where)
        return found, float(min(max(t, np.nextafter(0.0, 1.0)), np.nextafter(1.0, 0.0)))

    def _after(self, at: int, t: float) -> FloatArray:
        """Masses, not normalised, of the classes and edges that follow, (K + E,)."""
        K = len(self.corners)
        masses = np.zeros(K + len(self.edges))
        if at < K:
            masses[:K] = self.corners[at]
            for e, (edge, density) in enumerate(zip(self.edges, self.densities, strict=True)):
                if at in edge:
                    masses[K + e] = density.flow
            return masses
        density = self.densities[at - K]
        masses[list(self.edges[at - K])] = density.density(np.array([t, 1.0 - t]))
        masses[at] = density.within(t)
        for crossing in self.crossings:
            for other, here, _ in crossing.others(at - K):
                masses[K + other] += crossing.kappa * max(crossing.width - abs(here - t), 0.0)
        return masses

    def _first(self, e: int, where: float) -> float:
        """Draw a position on an edge from its stationary density."""

        def density(t: FloatArray) -> FloatArray:
            found = self.densities[e].marginal(t)
            for crossing, here in ways:
                found = found + crossing.kappa * np.maximum(crossing.width - np.abs(here - t), 0.0)
            return found

        ways = [(c, here) for c in self.crossings for _, here, _ in c.others(e)]
        widths = np.array([*self.densities[e].bends, *(c.width for c, _ in ways)])
        return invert_line(density, where, np.unique(np.concatenate([[0.0, 1.0], widths, 1.0 - widths])))

    def _crossed(self, before: int, e: int, t: float, where: float) -> float:
        """Draw a position on another edge, as near to the common class as the rest of the width."""
        for crossing in self.crossings:
            for other, here, there in crossing.others(before):
                if other == e:
                    return abs(there - where * (crossing.width - abs(here - t)))
        raise AssertionError(f"edge {before} does not cross to edge {e}, and has no mass there")

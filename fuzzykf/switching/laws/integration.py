"""Exact integrals of a density that is smooth except on lines r2 - r1 = constant.

Gauss-Legendre panels between those lines make the integrals of FMC1 and FMC2,
which are piecewise polynomials, exact to rounding, and those of any other
density as accurate as it is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.polynomial.legendre import leggauss

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["JointLaw", "Lines", "cell_masses", "gauss_nodes", "integrate_line", "invert_line"]


@dataclass(frozen=True)
class Lines:
    """Where a joint density is not smooth.

    Attributes
    ----------
    kinks : ndarray
        The density is not smooth on the lines r2 - r1 = kink.
    breaks : ndarray
        Increasing points from 0 to 1; integrals in one variable are cut there.
    order : int
        Gauss-Legendre nodes per panel.
    """

    kinks: FloatArray
    breaks: FloatArray
    order: int


class JointLaw(Protocol):
    """What the integrals need of a law."""

    @property
    def lines(self) -> Lines:
        """Where the density is not smooth."""

    def joint_density(self, r1: ArrayLike, r2: ArrayLike) -> FloatArray:
        """Return p(r1, r2)."""

    def marginal_density(self, r: ArrayLike) -> FloatArray:
        """Return p(r)."""


@cache
def gauss_nodes(order: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights on ]0, 1[."""
    nodes, weights = leggauss(order)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def integrate_line(
    density: Callable[[FloatArray, FloatArray], FloatArray],
    r1: FloatArray,
    low: ArrayLike,
    high: ArrayLike,
    lines: Lines,
) -> FloatArray:
    """Integrate ``density(r1, r2)`` over r2 from ``low`` to ``high``.

    Parameters
    ----------
    density : callable
    r1 : ndarray, shape (n,)
    low, high : array_like
        Bounds in [0, 1], broadcastable to (n,).
    lines : Lines

    Returns
    -------
    ndarray, shape (n,)
    """
    a = np.broadcast_to(np.asarray(low, dtype=np.float64), r1.shape)[:, None]
    b = np.broadcast_to(np.asarray(high, dtype=np.float64), r1.shape)[:, None]
    cuts = np.concatenate(
        [a, b, r1[:, None] + lines.kinks, np.broadcast_to(lines.breaks, (r1.size, lines.breaks.size))], axis=1
    )
    cuts = np.sort(np.clip(cuts, a, b), axis=1)
    widths = np.diff(cuts, axis=1)
    x, w = gauss_nodes(lines.order)
    r2 = cuts[:, :-1, None] + widths[..., None] * x
    # panels of no width may lie on the atoms 0 and 1, where the density means something else
    values = np.where(widths[..., None] > 0.0, density(r1[:, None, None], _open(r2)), 0.0)
    total: FloatArray = ((values @ w) * widths).sum(axis=1)
    return total


def _open(r: FloatArray) -> FloatArray:
    """Keep integration nodes off the atoms that rounding may bring them to."""
    return np.clip(r, np.nextafter(0.0, 1.0), np.nextafter(1.0, 0.0))


def cell_masses(law: JointLaw, bounds: FloatArray) -> FloatArray:
    """Exact joint masses of the cells of [0, 1], the atoms 0 and 1 being cells of their own.

    Parameters
    ----------
    law : FuzzyMarkovLaw
    bounds : ndarray, shape (F + 1,)
        Increasing bounds of the cells, from 0 to 1; (F = 0: anything of length one).

    Returns
    -------
    ndarray, shape (F + 2, F + 2)
        Rows and columns in the order 0, the cells, 1.
    """
    lines, n_cells = law.lines, bounds.size - 1
    masses = np.empty((n_cells + 2, n_cells + 2))
    ends = np.array([0.0, 1.0])
    masses[np.ix_([0, -1], [0, -1])] = law.joint_density(ends[:, None], ends)
    if n_cells == 0:
        return masses
    for row, end in ((0, 0.0), (-1, 1.0)):
        edge = integrate_line(law.joint_density, np.full(n_cells, end), bounds[:-1], bounds[1:], lines)
        masses[row, 1:-1] = edge
        masses[1:-1, row] = edge
    # the inner integrals, as functions of r1, are smooth between bounds shifted by kinks
    shifted = (bounds[:, None] + np.concatenate([[0.0], lines.kinks, -lines.kinks])).reshape(-1)
    cuts = np.unique(np.clip(np.concatenate([shifted, lines.breaks]), 0.0, 1.0))
    cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-14])]
    widths = np.diff(cuts)
    x, w = gauss_nodes(lines.order)
    r1 = _open(cuts[:-1, None] + widths[:, None] * x)
    cell = np.clip(np.searchsorted(bounds, r1[:, 0], side="right") - 1, 0, n_cells - 1)
    masses[1:-1, 1:-1] = 0.0
    for column in range(n_cells):
        inner = integrate_line(
            law.joint_density, r1.reshape(-1), bounds[column], bounds[column + 1], lines
        ).reshape(r1.shape)
        np.add.at(masses[1:-1, column + 1], cell, (inner @ w) * widths)
    return masses


def invert_line(density: Callable[[FloatArray], FloatArray], u: float, breaks: FloatArray) -> float:
    """Find the point of ]0, 1[ below which the fraction ``u`` of the mass of a density lies.

    Parameters
    ----------
    density : callable
        Smooth between the ``breaks``, not negative, not normalised.
    u : float
        Between 0 and 1.
    breaks : ndarray
        Increasing points from 0 to 1.
    """
    from scipy.optimize import brentq

    x, w = gauss_nodes(16)
    widths = np.diff(breaks)
    masses = (density(_open(breaks[:-1, None] + widths[:, None] * x)) @ w) * widths
    target = u * float(masses.sum())
    below = np.cumsum(masses)
    panel = min(int(np.searchsorted(below, target, side="right")), masses.size - 1)
    target -= float(below[panel] - masses[panel])
    start, width = float(breaks[panel]), float(widths[panel])

    def excess(t: float) -> float:
        mass: float = float(density(_open(start + t * width * x)) @ w) * t * width
        return mass - target

    t = 1.0
    if excess(1.0) > 0.0:
        t = float(brentq(excess, 0.0, 1.0, xtol=1e-14)) if excess(0.0) < 0.0 else 0.0
    found: FloatArray = _open(np.array([start + t * width]))
    return float(found[0])

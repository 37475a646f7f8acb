"""(min,+) convolution along lines with a parabola, in linear time.

Everything is in costs: out[l, i] = min over j of cost[l, j] + kernel(x_i - y_j).
The sources y and the targets x are two lattices, y_j = y0 + j dy and x_i = x0 + i dx,
of any origin and step.  A parabola through the best source and its two neighbours
then replaces the minimum over the lattice by the minimum over the continuum
(`refine`): with quadratic costs the result is exact, whatever the step.
"""

from __future__ import annotations

from itertools import chain, repeat
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray, IntArray

__all__ = ["convolve_parabola", "envelope_of_parabolas", "refine"]


#: Elements worked on at a time: the temporaries then stay in the cache.
CHUNK = 1 << 15

#: Admissible error of a refined cost, as told by the change of the second difference.
RELATIVE_ERROR, ABSOLUTE_ERROR = 0.1, 0.02


def convolve_parabola(
    cost: FloatArray, y0: float, dy: float, x0: float, dx: float, n_targets: int, curvature: float
) -> FloatArray:
    """Convolve lines with the kernel curvature (x - y)^2.

    Parameters
    ----------
    cost : ndarray, shape (lines, n)
        Infinite where impossible.
    y0, dy, x0, dx : float
        Origins and steps of sources and targets; steps are positive.
    n_targets : int
    curvature : float
        Positive; 1 / (2 s^2) for a Gaussian of standard deviation s under the product.

    Returns
    -------
    ndarray, shape (lines, n_targets)
        Infinite on lines without any possible source.
    """
    lines, n = cost.shape
    out = np.empty((lines, n_targets))
    block = max(1, CHUNK // max(n, n_targets))
    y = y0 + dy * np.arange(n)
    x = x0 + dx * np.arange(n_targets)
    for start in range(0, lines, block):
        part = cost[start : start + block]
        best = envelope_of_parabolas(part, y0, dy, x0, dx, n_targets, curvature)
        offset = x - y[best]
        padded = np.full((part.shape[0], n + 4), np.inf)
        padded[:, 2:-2] = part
        flat = padded.ravel()
        here = best + 2 + (n + 4) * np.arange(part.shape[0])[:, None]
        near = [flat.take(here + k) + curvature * (offset - k * dy) ** 2 for k in range(-2, 3)]
        out[start : start + block] = refine(*near)
    return out


def refine(
    before: FloatArray, left: FloatArray, middle: FloatArray, right: FloatArray, after: FloatArray
) -> FloatArray:
    """Minimum of the parabola through three equidistant costs, the middle one the least.

    Where the costs beyond do not continue that parabola (an edge or a kink is near) it is
    the least of the three.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        slope = right - left
        bend = left - 2.0 * middle + right
        least = np.minimum(np.minimum(left, middle), right)
        refined = np.maximum(least - slope * slope / (8.0 * bend), 0.0)  # no membership exceeds one
        beside = np.where(left < right, before - 2.0 * left + middle, middle - 2.0 * right + after)
        usable = np.abs(bend - beside) <= 8.0 * (RELATIVE_ERROR * refined + ABSOLUTE_ERROR)
    return np.where(usable & (bend > 0.0) & (least == middle), refined, least)


def envelope_of_parabolas(
    cost: FloatArray, y0: float, dy: float, x0: float, dx: float, n_targets: int, curvature: float
) -> IntArray:
    """For every target, the source of the lowest parabola cost[j] + curvature (x - y_j)^2.

    All parabolas have the same curvature, so that two of them cross once, and the
    envelope is the lower convex hull of the points (y_j, cost_j + curvature y_j^2):
    target x belongs to the hull vertex between whose two crossings it lies.

    Returns
    -------
    ndarray of int, shape (lines, n_targets)
        Zero on lines without any possible source.
    """
    lines, n = cost.shape
    position = np.flatnonzero(np.isfinite(cost))
    if position.size == 0:
        return np.zeros((lines, n_targets), dtype=np.intp)
    line = position // n
    source = position - line * n
    value = cost.ravel()[position]
    source, value, line = _lower_hull(source, value, line, curvature * dy * dy)
    crossing = _crossings(source, value, line, curvature * dy * dy)
    # The first target to the right of each crossing starts the reign of the next vertex.
    first = np.ceil((y0 - x0 + dy * crossing) / dx)
    first = np.minimum(np.maximum(first, 0.0), n_targets).astype(np.intp)
    same_line = line[1:] == line[:-1]
    where = line[:-1][same_line] * (n_targets + 1) + first[same_line]
    steps = np.bincount(where, minlength=lines * (n_targets + 1)).reshape(lines, n_targets + 1)
    rank = np.cumsum(steps[:, :n_targets].ravel()).reshape(lines, n_targets)
    # The running count went on through earlier lines: take each line's own part of it.
    before = np.concatenate(([0], np.cumsum(steps[:, :n_targets].sum(axis=1))[:-1]))
    start = np.searchsorted(line, np.arange(lines))
    vertex = rank - before[:, None] + start[:, None]
    result: IntArray = source[np.minimum(vertex, source.size - 1)]
    result[np.bincount(line, minlength=lines) == 0] = 0
    return result


def _crossings(source: IntArray, value: FloatArray, line: IntArray, bend: float) -> FloatArray:
    """Where (in steps of the sources) the parabolas of consecutive vertices cross."""
    gap = (source[1:] - source[:-1]).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing: FloatArray = (value[1:] - value[:-1]) / (2.0 * bend * gap)
    crossing += 0.5 * (source[1:] + source[:-1])
    crossing[line[1:] != line[:-1]] = np.inf
    return crossing


def _lower_hull(
    source: IntArray, value: FloatArray, line: IntArray, bend: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """Vertices of the lower convex hulls of the points (j, value_j + bend j^2) of each line.

    A point above a chord of two others is no vertex, whether these are or not, so that
    all points above the chord of their neighbours can go at once.  Nearly Gaussian
    memberships lose none.  Where there are dents, chords of farther neighbours clear
    most of each in a few passes, and the rest goes from its rims inwards.
    """
    if not _above_chord(source, value, line, bend, 1).any():
        return source, value, line
    for reach in chain((256, 128, 64, 32, 16, 8, 4, 2), repeat(1)):
        kept = ~_above_chord(source, value, line, bend, reach)
        if reach == 1 and kept.all():
            break
        source, value, line = source[kept], value[kept], line[kept]
    return source, value, line


def _above_chord(
    source: IntArray, value: FloatArray, line: IntArray, bend: float, reach: int
) -> NDArray[np.bool_]:
    """Which points lie on or above the chord of the points ``reach`` before and after."""
    above = np.zeros(source.size, dtype=bool)
    if source.size > 2 * reach:
        a, b, c = source[: -2 * reach], source[reach:-reach], source[2 * reach :]
        fa, fb, fc = value[: -2 * reach], value[reach:-reach], value[2 * reach :]
        with np.errstate(divide="ignore", invalid="ignore"):
            dent = (fb - fa) / (b - a) - (fc - fb) / (c - b)
        above[reach:-reach] = (dent >= bend * (c - a)) & (line[: -2 * reach] == line[2 * reach :])
    return above

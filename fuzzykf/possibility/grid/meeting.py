"""Convolution under the minimum: where the membership of the state and that of the noise meet.

The supremum over x of min(mu(x), mu_W(x' - x)) is taken where one of them rises and the
other falls, hence mostly between two nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.possibility.grid.lattice import Kernel

__all__ = ["meeting"]

#: Bisections between two nodes; one step of the chord method follows.
BISECTIONS = 6


def meeting(
    cost: FloatArray, place: FloatArray, target: FloatArray, kernel: Kernel, source: IntArray
) -> FloatArray:
    """Least maximum of cost and kernel between the best sources and their neighbours.

    Parameters
    ----------
    cost : ndarray, shape (lines, n)
        Linear between the nodes; next to an impossible node, the membership is.
    place : ndarray, shape (n,)
        Where the noise adds to; linear between the nodes.
    target : ndarray, shape (m,)
    kernel : Kernel
        The noise.
    source : ndarray of int, shape (lines, m)
        Best nodes.

    Returns
    -------
    ndarray, shape (lines, m)
    """
    lines = np.arange(cost.shape[0])[:, None]
    here, noise = cost[lines, source], kernel.cost(target - place[source])
    # The cells before and after the best nodes: many short arrays would take longer than a few long ones.
    beside = np.clip(source + np.array([-1, 1])[:, None, None], 0, place.size - 1)
    there = cost[lines, beside]
    with np.errstate(invalid="ignore"):
        before = noise - here
        after = kernel.cost(target - place[beside]) - there
        cell = np.nonzero(np.sign(before) * np.sign(after) < 0.0)
    line = cell[1:]
    ends = place[source[line]], place[beside[cell]]
    found = _between((here[line], there[cell]), ends, target[cell[2]], kernel, (before[line], after[cell]))
    between = np.full(beside.shape, np.inf)
    between[cell] = found
    least: FloatArray = np.minimum(np.maximum(here, noise), between.min(axis=0))
    return least


def _between(
    cost: tuple[FloatArray, FloatArray],
    place: tuple[FloatArray, FloatArray],
    target: FloatArray,
    kernel: Kernel,
    excess: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Least maximum of cost and kernel in cells at whose ends their difference has either sign."""
    low, high = np.zeros(target.size), np.ones(target.size)
    below, above = excess
    sign, least = np.sign(below), np.full(target.size, np.inf)
    for step in range(BISECTIONS + 1):
        part = 0.5 * (low + high)
        if step == BISECTIONS:
            with np.errstate(invalid="ignore"):
                chord = low + (high - low) * below / (below - above)
            part = np.where(np.isfinite(chord), chord, part)
        at = _interpolated(*cost, part)
        noise = kernel.cost(target - (place[0] + part * (place[1] - place[0])))
        least = np.minimum(least, np.maximum(at, noise))
        with np.errstate(invalid="ignore"):
            difference = noise - at
        same = np.sign(difference) == sign
        low, below = np.where(same, part, low), np.where(same, difference, below)
        high, above = np.where(same, high, part), np.where(same, above, difference)
    return least


def _interpolated(start: FloatArray, end: FloatArray, part: FloatArray) -> FloatArray:
    """Costs between two nodes, at least one of which is possible."""
    with np.errstate(invalid="ignore", divide="ignore"):
        value = start + part * (end - start)
        if np.isfinite(value).all():
            return value
        value = np.where(np.isinf(end), start - np.log(1.0 - part), value)
        return np.where(np.isinf(start), end - np.log(part), value)

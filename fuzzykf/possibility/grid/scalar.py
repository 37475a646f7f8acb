"""Prediction of a scalar state through a function: every source against every target.

    mu'(x') = sup over x of T(mu(x), mu_W(x' - f(x)))

Nothing is drawn in between, so that a fold of f (the 0 of x^2), at which the image of a
membership has an edge, is a point like any other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import convolve_table, interpolate, totals
from fuzzykf.possibility.grid.meeting import meeting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.selected import Scale
    from fuzzykf.possibility.grid.lattice import Kernel
    from fuzzykf.possibility.mapping import Mapping

__all__ = ["predict_scalar"]

#: Pairs of source and target worked on at a time.
PAIRS = 1 << 20

#: Where the parabola is wrong by more than this cost, the likeliest source is sought by such steps.
ROUGH, HALVINGS = 1e-3, tuple(0.5**k for k in range(1, 9))


def predict_scalar(
    axis: FloatArray, cost: FloatArray, move: Mapping, target: FloatArray, kernel: Kernel
) -> FloatArray:
    """Predict costs on one axis.

    Parameters
    ----------
    axis, cost : ndarray, shape (n,)
        Equidistant states and their costs.
    move : Mapping
        The map f.  Where it is no number, a state is left out.
    target : ndarray, shape (m,)
    kernel : Kernel
        The noise.

    Returns
    -------
    ndarray, shape (m,)
    """
    with np.errstate(all="ignore"):
        image = move(axis[:, None])[:, 0]
    image = np.where(np.isfinite(image), image, np.nan)
    rows = max(1, PAIRS // axis.size)
    parts = [target[start : start + rows] for start in range(0, target.size, rows)]
    return np.concatenate([_predict_some(axis, cost, move, image, part, kernel) for part in parts])


def _predict_some(
    axis: FloatArray, cost: FloatArray, move: Mapping, image: FloatArray, target: FloatArray, kernel: Kernel
) -> FloatArray:
    """Predict the costs (m,) of some targets."""
    t_norm = kernel.t_norm
    offset = target[:, None] - image
    table = kernel.cost(offset)
    table[~(table < t_norm.impossible)] = np.inf
    lines = cost[None]
    source = convolve_table(lines, table, t_norm.combine)
    if t_norm.additive:
        left, out, right = (totals(lines, table, source, shift, t_norm.combine)[0] for shift in (-1, 0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            # The likeliest source between the nodes, by the parabola through three of them.
            shift = 0.5 * (left - right) / (left - 2.0 * out + right)
            expected = out + 0.25 * (right - left) * shift
        smooth = np.abs(shift) <= 1.0
        position = source[0] + np.where(smooth, shift, 0.0)
        found = _searched(axis, cost, move, target, kernel, position, ())
        rough = np.flatnonzero((out < t_norm.impossible) & ~(np.abs(found - expected) <= ROUGH))
        if rough.size:
            found[rough] = _searched(axis, cost, move, target[rough], kernel, position[rough], HALVINGS)
        out = np.fmin(out, found)
    else:
        out = meeting(lines, image, target, kernel, source)[0]
    # Sources between the nodes: the likeliest noise, and the ends of a noise that stops short.
    for end in (0.0, kernel.lower, kernel.upper):
        extra = kernel.cost(np.array([end])) if np.isfinite(end) else np.full(1, np.inf)
        if extra[0] < t_norm.impossible:
            between = _carried(axis, cost, move, image, target - end, t_norm.scale)
            out = np.minimum(out, t_norm.combine(between, extra))
    return np.asarray(out, dtype=np.float64)


def _searched(
    axis: FloatArray,
    cost: FloatArray,
    move: Mapping,
    target: FloatArray,
    kernel: Kernel,
    position: FloatArray,
    widths: Sequence[float],
) -> FloatArray:
    """Total costs (m,) of sources between the nodes, the better one after each step to either side."""
    t_norm, step = kernel.t_norm, (axis[-1] - axis[0]) / (axis.size - 1)

    def total(position: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            offset = target - move((axis[0] + position * step)[:, None])[:, 0]
            at_source = interpolate(cost, position[:, None], t_norm.scale)
            return np.asarray(t_norm.combine(at_source, kernel.cost(offset)))

    best = total(position)
    for width in widths:
        for side in (-width, width):
            trial = np.clip(position + side, 0.0, axis.size - 1.0)
            found = total(trial)
            position, best = np.where(found < best, trial, position), np.fmin(found, best)
    return best


def _carried(
    axis: FloatArray, cost: FloatArray, move: Mapping, image: FloatArray, wanted: FloatArray, scale: Scale
) -> FloatArray:
    """Least costs (m,) of the states that the map carries to given places, by interpolation."""
    miss = wanted[:, None] - image
    row, cell = np.nonzero(miss[:, :-1] * miss[:, 1:] < 0.0)
    change = image[cell + 1] - image[cell]
    part = miss[row, cell] / change
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    with np.errstate(all="ignore"):
        value = move((axis[cell] + part * step)[:, None])[:, 0]
        better = part + (wanted[row] - value) / change  # one step of the chord method
    part = np.where((better >= 0.0) & (better <= 1.0), better, part)
    out = np.full(wanted.size, np.inf)
    np.minimum.at(out, row, interpolate(cost, (cell + part)[:, None], scale))
    return out

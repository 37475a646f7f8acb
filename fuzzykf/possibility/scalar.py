"""Prediction of a scalar state through a function: every source against every target.

    mu'(x') = sup over x of T(mu(x), mu_W(x' - f(x)))

Nothing is drawn in between, so that a fold of f (the 0 of x^2), at which the image of a
membership has an edge, is a point like any other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import convolve_table, interpolate, totals
from fuzzykf.possibility.meeting import meeting

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.noise import Kernel

__all__ = ["predict_scalar"]


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
    t_norm = kernel.t_norm
    combine: np.ufunc = np.add if t_norm.additive else np.maximum
    with np.errstate(all="ignore"):
        image = move(axis[:, None])[:, 0]
    image = np.where(np.isfinite(image), image, np.nan)
    offset = target[:, None] - image
    table = kernel.cost(offset)
    table[~(table < t_norm.impossible)] = np.inf
    lines = cost[None]
    source = convolve_table(lines, table, combine)
    if t_norm.additive:
        left, out, right = (totals(lines, table, source, shift, combine)[0] for shift in (-1, 0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            # The likeliest source between the nodes, by the parabola through three of them.
            shift = 0.5 * (left - right) / (left - 2.0 * out + right)
        inner = np.flatnonzero(np.abs(shift) <= 1.0)
        position = (source[0] + shift)[inner]
        place = move((axis[0] + position * (axis[-1] - axis[0]) / (axis.size - 1))[:, None])[:, 0]
        total = interpolate(cost, position[:, None], t_norm.scale) + kernel.cost(target[inner] - place)
        out[inner] = np.fmin(out[inner], total)
    else:
        out = meeting(lines, image, target, kernel, source)[0]
    # Sources between the nodes: the likeliest noise, and the ends of a noise that stops short.
    for end in (0.0, kernel.lower, kernel.upper):
        extra = kernel.cost(np.array([end])) if np.isfinite(end) else np.full(1, np.inf)
        if extra[0] < t_norm.impossible:
            between = _carried(axis, cost, move, image, target - end, t_norm.scale)
            out = np.minimum(out, t_norm.combine(between, extra))
    return out


def _carried(
    axis: FloatArray, cost: FloatArray, move: Mapping, image: FloatArray, wanted: FloatArray, scale: str
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

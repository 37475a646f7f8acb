"""The way back over a prediction of a scalar, pair by pair, for costs that are reciprocals of memberships.

What a state costs given all measurements,

    gamma_n(x) = min over x' of gamma_(n+1)(x') + s(x, x'),  s(x, x') = c_n(x) + c_W(x' - f(x)) - c'(x') >= 0,

is a small number plus a difference of large ones.  Logarithms stay small; reciprocals do not, and after a
measurement of possibility p every relative error of c' counts 1/p times.  Pair by pair s is not negative.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import interpolate_lines, refine

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Kernel, Lattice
    from fuzzykf.possibility.mapping import Mapping

__all__ = ["before_scalar"]

#: Pairs of states worked on at a time.
PAIRS = 1 << 20


def before_scalar(
    source: Lattice, later: FloatArray, predicted: Lattice, move: Mapping, kernel: Kernel | None
) -> FloatArray:
    """Costs of the states before a prediction, given all measurements.

    Parameters
    ----------
    source : Lattice
        What was predicted from, c_n.
    later : ndarray, shape (m,)
        Costs of the states after it, given all measurements; infinite where they count no more.
    predicted : Lattice
        The prediction c' on the same m nodes.
    move : Mapping
        The map f, with the peak of the noise.
    kernel : Kernel or None
        The noise, if any.

    Returns
    -------
    ndarray, shape (n,)
    """
    out = np.full(source.cost.shape, np.inf)
    live = np.flatnonzero(source.live(np.inf))
    with np.errstate(all="ignore"):
        image = move(source.axes[0][live][:, None])[:, 0]
    rows = max(1, PAIRS // later.size)
    for start in range(0, live.size, rows):
        part = live[start : start + rows]
        out[part] = _before_some(source.cost[part], image[start : start + rows], later, predicted, kernel)
    return out


def _before_some(
    cost: FloatArray, image: FloatArray, later: FloatArray, predicted: Lattice, kernel: Kernel | None
) -> FloatArray:
    """Costs (n,) of some states, of their images."""
    axis, scale = predicted.axes[0], predicted.t_norm.scale
    best = np.full(cost.shape, np.inf)
    with np.errstate(invalid="ignore", over="ignore"):
        if kernel is not None:
            slack = cost[:, None] + kernel.cost(axis - image[:, None]) - predicted.cost
            total = later + np.where(slack > 0.0, slack, np.where(np.isnan(slack), np.inf, 0.0))
            node = np.argmin(total, axis=1)
            row = np.arange(cost.size)
            near = [
                np.where(
                    (node + k >= 0) & (node + k < axis.size),
                    total[row, (node + k).clip(0, axis.size - 1)],
                    np.inf,
                )
                for k in range(-2, 3)
            ]
            best = refine(*near)
        # Ends between the nodes: of the likeliest noise, and of a noise that stops short.
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        for end in (0.0,) if kernel is None else (0.0, kernel.lower, kernel.upper):
            extra = (
                0.0
                if kernel is None
                else float(kernel.cost(np.array([end]))[0])
                if np.isfinite(end)
                else np.inf
            )
            if np.isfinite(extra):
                place = (image + end - axis[0]) / step
                after, prior = interpolate_lines(np.stack([later, predicted.cost]), place, scale)
                slack = cost + extra - prior
                found = after + np.where(slack > 0.0, slack, 0.0)
                best = np.fmin(best, np.where(np.isnan(found), np.inf, found))
    return best

"""How many nodes a moving grid needs: tails stretch it, and the resolution of what is likely must not suffer.

A lattice covers all states above the floor, so that nothing is lost.  The further tails reach, the fewer of
its nodes lie where the membership is large.  An axis therefore has as many nodes more as it takes for the
likely states to keep their share of ``points``, up to a bound that keeps time and memory in hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.norms import TNorm

__all__ = ["are_too_few", "misses_peak", "most_nodes", "needed_nodes"]

#: States of at least this membership are likely, and they get at least this part of ``points``: as much as
#: those of a Cauchy membership cut off at ten scales.  Those of a Gaussian cut off at six deviations
#: have twice that.
LIKELY, SHARE = 0.5, 0.1

#: An axis has at most so many times ``points`` nodes, by dimension of the state.
MOST, MOST_ELSE = {1: 8, 2: 4}, 2

#: A lattice is laid out anew if it has fewer than this part of the nodes that it needs.
ENOUGH = 0.8


def most_nodes(universe: Universe) -> tuple[int, ...]:
    """Return how many nodes a lattice may have per axis."""
    if universe.domain is not None:
        return universe.points
    times = MOST.get(len(universe.points), MOST_ELSE)
    return tuple(times * n for n in universe.points)


def needed_nodes(
    axes: tuple[FloatArray, ...], cost: FloatArray, t_norm: TNorm, universe: Universe
) -> tuple[int, ...]:
    """Nodes per axis that a lattice with the same bounds needs.

    Parameters
    ----------
    axes : tuple of ndarray
    cost : ndarray, shape (n_1, ..., n_d)
    t_norm : TNorm
    universe : Universe

    Returns
    -------
    tuple of int, length d
        Between the ``points`` of the universe and `most_nodes`.
    """
    best = float(cost.min())
    if universe.domain is not None or not best < t_norm.impossible:
        return universe.points
    counts = []
    for k, (points, most) in enumerate(zip(universe.points, most_nodes(universe), strict=True)):
        size = axes[k].size
        if size == 1:
            counts.append(points)
            continue
        margin = cost.min(axis=tuple(m for m in range(cost.ndim) if m != k))
        extent = _likely_extent(t_norm.membership(t_norm.renormalise(margin, best)))
        wanted = 1.0 + (size - 1) * SHARE * points / extent
        counts.append(int(min(max(points, np.ceil(wanted)), most)))
    return tuple(counts)


def are_too_few(counts: tuple[int, ...], needed: tuple[int, ...], axes: tuple[FloatArray, ...]) -> bool:
    """Whether nodes per axis are clearly fewer than needed, on any axis that has several."""
    return any(a < ENOUGH * b for a, b, axis in zip(counts, needed, axes, strict=True) if axis.size > 1)


def misses_peak(before: FloatArray, after: FloatArray, t_norm: TNorm) -> bool:
    """Whether no node is as likely as some state must be: no prediction makes the likeliest states less so.

    Parameters
    ----------
    before, after : ndarray
        Costs of the state and of its prediction.
    t_norm : TNorm
    """
    likely = float(t_norm.cost(LIKELY))
    return bool(after.min() > t_norm.combine(before.min(), np.float64(likely)))


def _likely_extent(values: FloatArray) -> float:
    """Return the steps over which memberships (n,) stay likely around the best node, linear in between."""
    best, extent = int(np.argmax(values)), 0.0
    for side in (values[best:], values[best::-1]):
        below = np.flatnonzero(side < LIKELY)
        if below.size:
            k = int(below[0])
            extent += k - 1 + float((side[k - 1] - LIKELY) / (side[k - 1] - side[k]))
        else:
            extent += side.size - 1
    return extent

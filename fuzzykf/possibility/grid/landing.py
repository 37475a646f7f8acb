"""Where a map takes the nodes of a lattice, and how far the noise will carry them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import least_outside, span
from fuzzykf.errors import SupportLostError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Lattice
    from fuzzykf.possibility.grid.noise import Kernel
    from fuzzykf.possibility.grid.propagation import Universe
    from fuzzykf.possibility.mapping import Mapping

__all__ = ["Landing", "landing"]


@dataclass(frozen=True, eq=False)
class Landing:
    """Where a map takes the nodes of a lattice.

    Attributes
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        Of all nodes.
    live : ndarray of bool, shape (n_1, ..., n_s)
        The nodes that matter.
    low, high : ndarray, shape (d,)
        Bounds of the images of live nodes and of their neighbours.
    reached : list of (float, float)
        Bounds per axis of what the noise will reach.
    lost : float
        Least cost of a state mapped out of the domain.
    """

    image: FloatArray
    live: np.ndarray
    low: FloatArray
    high: FloatArray
    reached: list[tuple[float, float]]
    lost: float

    def nothing_left(self, universe: Universe) -> SupportLostError:
        """Return the error for a prediction without any possible state."""
        if universe.domain is None:
            return SupportLostError("points: the possible states fall between the nodes; ask for more points")
        where = ", ".join(f"[{a:.6g}, {b:.6g}]" for a, b in zip(self.low, self.high, strict=True))
        return SupportLostError(
            f"domain: all possible states have left {universe.domain.tolist()}, they are within {where}"
        )


def landing(source: Lattice, move: Mapping, kernels: Sequence[Kernel | None], universe: Universe) -> Landing:
    """Map the nodes of a lattice.

    Raises
    ------
    ParameterError
        If the map returns something inadmissible at a possible state.
    """
    limit = universe.limit if universe.domain is None else np.inf
    with np.errstate(all="ignore"):
        image = move.on_grid(source.axes)
    live = source.live(limit)
    move.require_finite(source.axes, image, live)
    low, high = span(image, live)
    reached = [
        _reached(source, image[..., k], live, kernels[k], float(low[k]), float(high[k]), limit)
        for k in range(low.size)
    ]
    return Landing(image, live, low, high, reached, _lost(source, image, universe, low, high))


def _reached(
    source: Lattice,
    image: FloatArray,
    live: np.ndarray,
    kernel: Kernel | None,
    low: float,
    high: float,
    limit: float,
) -> tuple[float, float]:
    """Bounds of what the noise reaches along one axis, state and noise judged together."""
    if kernel is None or np.isinf(limit):
        return low, high
    t_norm = source.t_norm
    cost, there = source.cost[live], image[live]
    left = limit - cost if t_norm.additive else np.full(cost.shape, limit)
    below, above = kernel.reach(np.clip(t_norm.membership(left), np.finfo(float).tiny, 1.0))
    inner, outer = float(there.min()) - low, high - float(there.max())
    lowest, highest = float((there + below).min()), float((there + above).max())
    return min(low, lowest - inner), max(high, highest + outer)


def _lost(
    source: Lattice,
    image: FloatArray,
    universe: Universe,
    low: FloatArray,
    high: FloatArray,
) -> float:
    """Least cost of a possible node mapped out of the domain."""
    if universe.domain is None:
        return np.inf
    slack = 1e-9 * (universe.domain[:, 1] - universe.domain[:, 0])
    if (low >= universe.domain[:, 0] - slack).all() and (high <= universe.domain[:, 1] + slack).all():
        return np.inf
    least = least_outside(image, source.cost, universe.domain + slack[:, None] * [-1.0, 1.0])
    return least if least < source.t_norm.impossible else np.inf

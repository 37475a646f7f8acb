"""Where a map takes the nodes of a lattice, and the image of the membership on another.

With an inverse, each node of the new lattice looks up its pre-image.  Without one, the
cells of the old lattice are mapped forward and drawn with interpolation, the largest
membership winning where images overlap, so that maps that fold (x^2) work too.

What is known exactly stays so as far as a grid allows.  A component that is the same
for all possible states remains an axis of length one.  Where the possible states form a
set of lower dimension (at first only the noise of a known state spreads), axes of the
noise join the source, so that their common image has the full dimension and is drawn
without loss.  Only where even that is not enough a set is blurred by half a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import (
    continue_tails,
    corrected,
    cover,
    flat_cells,
    interpolate,
    least_outside,
    live_cells,
    orientations,
    pull_back,
    samples,
    scaled,
    span,
    stranded,
    tangents,
)
from fuzzykf.errors import SupportLostError
from fuzzykf.possibility.grid.folds import Fold
from fuzzykf.possibility.grid.lattice import Kernel
from fuzzykf.possibility.mapping import grid_points
from fuzzykf.possibility.memberships import GaussianMembership, ParabolicMembership

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.possibility.grid.lattice import Lattice, Universe
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership

__all__ = ["Image", "Landing", "landing", "warp"]

#: A spread of images below this part of their size is none.
CONSTANT = 1e-13

#: Folds are followed in so many dimensions.
PLANE = 2

#: Nodes pulled back at a time.
SLAB = 1 << 15

#: About so many live nodes try a user's inverse.
TRIALS = 64


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
    live: BoolArray
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
    """Map the nodes of a lattice, and find how far the noise will carry them.

    Raises
    ------
    ParameterError
        If the map returns something inadmissible at a possible state.
    """
    live = source.live(universe.limit if universe.domain is None else np.inf)
    image = move.on_grid(source.axes, live)
    low, high = span(image, live)
    reached = list(zip(low.tolist(), high.tolist(), strict=True))
    if universe.domain is not None:
        return Landing(image, live, low, high, reached, _lost(source, image, universe.domain, low, high))
    # State and noise are judged together.
    cost = source.cost[live]
    left = universe.limit - cost if source.t_norm.additive else np.full(cost.shape, universe.limit)
    for k, kernel in enumerate(kernels):
        if kernel is not None:
            there = image[..., k][live]
            below, above = kernel.reach(left)
            inner, outer = float(there.min()) - low[k], high[k] - float(there.max())
            lowest, highest = float((there + below).min()) - inner, float((there + above).max()) + outer
            reached[k] = min(reached[k][0], lowest), max(reached[k][1], highest)
    return Landing(image, live, low, high, reached, np.inf)


def _lost(source: Lattice, image: FloatArray, domain: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Least cost of a possible node mapped out of the domain."""
    slack = 1e-9 * (domain[:, 1] - domain[:, 0])
    if (low >= domain[:, 0] - slack).all() and (high <= domain[:, 1] + slack).all():
        return np.inf
    least = least_outside(image, source.cost, domain + slack[:, None] * [-1.0, 1.0])
    return least if least < source.t_norm.impossible else np.inf


@dataclass(frozen=True, eq=False)
class Image:
    """A warped membership, before the convolution with the noise.

    Attributes
    ----------
    axes : tuple of ndarray
        Of length one where all images agree.
    cost : ndarray
    reached : list of (float, float)
        Bounds per axis of what the noise will reach.
    convolved : set of int
        Axes the noise of which is in the image already.
    lost : float
        Least cost of a state mapped out of the domain.
    fold : Fold or None
        Where a map of the plane folds.
    """

    axes: tuple[FloatArray, ...]
    cost: FloatArray
    reached: list[tuple[float, float]]
    convolved: set[int]
    lost: float
    fold: Fold | None = None


def warp(
    source: Lattice,
    move: Mapping,
    kernels: Sequence[Kernel | None],
    universe: Universe,
    *,
    in_place: bool = False,
) -> Image:
    """Map a membership forward.

    Parameters
    ----------
    source : Lattice
    move : Mapping
    kernels : sequence of (Kernel or None)
        The noise of each axis that will be added.
    universe : Universe
    in_place : bool
        Use the axes of the result after the noise at once.

    Raises
    ------
    ParameterError
        If the map returns something inadmissible at a possible state.
    SupportLostError
        If the whole image lies outside the domain.
    """
    found = landing(source, move, kernels, universe)
    image, live, low, high, reached = found.image, found.live, found.low, found.high, found.reached
    d = low.size
    moving = [k for k in range(d) if high[k] - low[k] > CONSTANT * max(abs(low[k]), abs(high[k]))]
    invertible = len(moving) == len(source.free) == d and move.is_invertible
    extra: dict[int, Kernel] = {}
    if moving and not (invertible or in_place):
        extra = _extra_axes(source, found, moving, kernels, universe)
    axes: list[FloatArray] = [np.array([0.5 * (low[k] + high[k])]) for k in range(d)]
    for k in moving:
        if in_place or k in extra:
            axes[k] = universe.axis(k, *reached[k])
        elif kernels[k] is not None and universe.is_small(k, float(high[k] - low[k])):
            axes[k] = np.linspace(low[k], high[k], universe.points[k])  # the noise will spread it
        else:
            axes[k] = universe.axis(k, float(low[k]), float(high[k]))
    shape = tuple(axis.size for axis in axes)
    cost, fold = np.array(np.inf), None
    if not moving:
        cost = np.full(shape, float(source.cost[live].min()))
    elif invertible:
        if move.matrix is None:
            some = np.flatnonzero(live)[:: max(1, live.size // TRIALS)]
            move.require_inverse(source.points.reshape(-1, d)[some], 1e-3 * source.step)
        cost = _pull_back(source, move, tuple(axes)).reshape(shape)
    if not (cost < source.t_norm.impossible).any():
        # No inverse, or an image so small that it falls between the nodes.
        drawing = _Drawing(source, move, image, universe, extra)
        cost = drawing.draw(moving, axes).reshape(shape)
        fold = drawing.fold(axes) if len(moving) == d == PLANE and move.matrix is None else None
    if universe.domain is None and not universe.bounded:
        cost = continue_tails(cost, universe.limit)
    if universe.domain is not None and found.lost <= source.cost.min():
        # A component known exactly keeps its value, wherever that is.
        outside = [axes[k][0] < a or axes[k][-1] > b for k, (a, b) in enumerate(universe.domain)]
        cost = np.full(shape, np.inf) if any(outside) else cost
    if not (cost < source.t_norm.impossible).any():
        raise found.nothing_left(universe)
    return Image(tuple(axes), cost, reached, set(extra), found.lost, fold)


def _extra_axes(
    source: Lattice, found: Landing, moving: list[int], kernels: Sequence[Kernel | None], universe: Universe
) -> dict[int, Kernel]:
    """Axes that have to join the source for the image to have full dimension.

    These are axes of the noise or, where there is none, of a small extra noise: a set
    without volume that is oblique to the axes cannot be kept on a grid otherwise.  Its
    width, half a step, is entered into ``reached``.
    """
    unit = np.array([found.reached[k][1] - found.reached[k][0] for k in moving])
    values = found.image.reshape(*(source.axes[k].size for k in source.free), -1)[..., moving] / unit
    spanned = tangents(values, found.live.reshape(values.shape[:-1]))
    extra: dict[int, Kernel] = {}
    while spanned.shape[1] < len(moving):
        outside = 1.0 - (spanned**2).sum(axis=1)
        noisy = [m for m, k in enumerate(moving) if kernels[k] is not None and outside[m] > 1e-6]
        best = max(noisy or range(len(moving)), key=lambda m: float(outside[m]))
        k = moving[best]
        kernel = kernels[k]
        if kernel is None or not noisy:
            kernel = _blur(source, found.reached, k, universe)
        extra[k] = kernel
        direction = np.eye(len(moving))[:, best] - spanned @ spanned[best]
        spanned = np.column_stack([spanned, direction / np.linalg.norm(direction)])
    return extra


def _blur(source: Lattice, reached: list[tuple[float, float]], k: int, universe: Universe) -> Kernel:
    """Return a noise that is just wide enough for a grid, and widen the axis for it."""
    axis = universe.axis(k, *reached[k])
    step = float(axis[1] - axis[0])
    if universe.bounded:
        shape: Membership = ParabolicMembership(0.0, step)
    else:
        shape = GaussianMembership(0.0, (0.5 * step) ** 2)
    reached[k] = reached[k][0] - 3.0 * step, reached[k][1] + 3.0 * step
    return Kernel(shape, source.t_norm)


def _pull_back(source: Lattice, move: Mapping, axes: tuple[FloatArray, ...]) -> FloatArray:
    """Costs of the new nodes at their pre-images."""
    if move.matrix is not None:
        inverse = np.asarray(np.linalg.inv(move.matrix))
        first, step = np.array([[a[0], (a[-1] - a[0]) / (a.size - 1)] for a in axes]).T
        origin = np.array([a[0] for a in source.axes])
        return pull_back(
            source.cost,
            inverse * step / source.step[:, None],
            (inverse @ (first - move.shift) - origin) / source.step,
            tuple(a.size for a in axes),
            source.t_norm.scale,
        )
    cost = []
    rows = max(1, SLAB * axes[0].size // int(np.prod([axis.size for axis in axes])))
    for start in range(0, axes[0].size, rows):
        with np.errstate(all="ignore"):
            points = move.inverse(grid_points((axes[0][start : start + rows], *axes[1:])))
        cost.append(source.at(points.reshape(-1, len(axes))))
    return np.concatenate(cost)


class _Drawing:
    """A source lattice, with axes of noise where these are needed, and its forward image."""

    def __init__(
        self,
        source: Lattice,
        move: Mapping,
        image: FloatArray,
        universe: Universe,
        extra: dict[int, Kernel],
    ) -> None:
        self.move = move
        self.t_norm = source.t_norm
        self.free, self.extra = source.free, list(extra)
        self.fixed = np.array([axis[0] for axis in source.axes])
        shape = tuple(source.axes[k].size for k in self.free)
        self.axes = [source.axes[k] for k in self.free]
        cost, values = source.cost.reshape(shape), image.reshape(*shape, -1)
        limit = universe.limit
        for k, kernel in extra.items():
            offset = _offsets(kernel, k, values, universe)
            self.axes.append(offset)
            cost = self.t_norm.combine(cost[..., None], kernel.cost(offset))
            values = np.repeat(values[..., None, :], offset.size, axis=-2)
            values[..., k] += offset
        self.cost, self.image = cost, values
        self.live = (cost < self.t_norm.impossible) & (cost <= (limit if universe.domain is None else np.inf))

    def _map(self, position: FloatArray) -> FloatArray:
        """Images (p, d) of positions (p, s) in steps of the source axes."""
        x = np.tile(self.fixed, (position.shape[0], 1))
        place = [
            axis[0] + position[:, m] * (axis[-1] - axis[0]) / (axis.size - 1)
            for m, axis in enumerate(self.axes)
        ]
        for m, k in enumerate(self.free):
            x[:, k] = place[m]
        with np.errstate(all="ignore"):
            value = self.move(x)
        for m, k in enumerate(self.extra, start=len(self.free)):
            value[:, k] += place[m]
        return value

    def draw(self, moving: list[int], axes: list[FloatArray]) -> FloatArray:
        """Costs (n,) of the nodes of the axes ``moving``: the least over their pre-images."""
        origin = np.array([axes[k][0] for k in moving])
        step = np.array([axes[k][1] - axes[k][0] for k in moving])
        shape = tuple(axes[k].size for k in moving)
        image = (self.image[..., moving] - origin) / step
        out = np.full(int(np.prod(shape)), np.inf)
        if len(self.axes) >= len(moving):
            for part in cover(image, self.cost < self.t_norm.impossible, shape):
                position = part.position
                if self.move.matrix is None and position.size:
                    node = np.stack(np.unravel_index(part.node, shape), axis=1)
                    miss = node - (self._map(position)[:, moving] - origin) / step
                    position = corrected(part, miss, self.cost.shape)
                np.minimum.at(out, part.node, interpolate(self.cost, position, self.t_norm.scale))
        flat = flat_cells(image, self.live)
        self._splat(image, flat, shape, out, np.ones(out.shape, dtype=bool))
        thin = stranded(image, self.live, out.reshape(shape))
        if thin.any():
            self._splat(image, live_cells(thin), shape, out, np.isinf(out))
        best = float(out.min())
        if (flat.size or thin.any()) and best < self.t_norm.impossible:
            out = self.t_norm.renormalise(out, best)
        return out

    def fold(self, axes: list[FloatArray]) -> Fold | None:
        """Return where a map of two axes to the plane folds, if it does."""
        if len(self.axes) != PLANE:
            return None
        signs = orientations(self.image)
        if not signs.min() < 0.0 < signs.max():
            return None
        step = np.array([axis[1] - axis[0] for axis in axes])
        return Fold.of(self.image, self.live, step, self.cost, self.t_norm.scale, self._map)

    def _splat(
        self, image: FloatArray, cells: np.ndarray, shape: tuple[int, ...], out: FloatArray, where: np.ndarray
    ) -> None:
        """Draw cells without volume or between the nodes on the nodes around them.

        Memberships fall linearly to zero over one step, so that the centroid is kept.
        """
        if not cells.size:
            return
        points, position = samples(image, cells)
        there = np.isfinite(points).all(axis=1)
        points, value = points[there], interpolate(self.cost, position[there], self.t_norm.scale)
        base = np.floor(points)
        for corner in np.ndindex(*(2,) * len(shape)):
            node = base + np.array(corner)
            hat = (1.0 - np.abs(points - node)).prod(axis=1)
            inside = np.concatenate([node >= 0, node < np.array(shape)], axis=1).all(axis=1) & (hat > 1e-12)
            index = np.ravel_multi_index(tuple(node[inside].astype(np.intp).T), shape)
            lowered = scaled(value[inside], hat[inside], self.t_norm.scale)
            np.minimum.at(out, index[where[index]], lowered[where[index]])


def _offsets(kernel: Kernel, k: int, image: FloatArray, universe: Universe) -> FloatArray:
    """Nodes along an axis of noise: all that is possible at all, or within the domain."""
    if universe.domain is None:
        (low,), (high,) = kernel.reach(np.array([universe.limit]))
    else:
        low = max(kernel.lower, universe.domain[k, 0] - float(np.nanmax(image[..., k])))
        high = min(kernel.upper, universe.domain[k, 1] - float(np.nanmin(image[..., k])))
    return np.linspace(low, high, universe.points[k])

"""Looking back on a grid.

    gamma_n(x) = c_n(x) + b_n(x),   b_n(x) = min over x' of b'_(n+1)(x') + c_W(x' - f(x))

is the residuum of the t-norm with b'_(n+1) = gamma_(n+1) - c'_(n+1), what later measurements add to the
cost of a predicted state: the convolution with the reflected noise, looked up at the image of each node.  It
needs neither an inverse of f nor a drawing, wherever f folds.  Costs may be negative here: later measurements
can make a state more possible than the prediction did.

The minimum has no residuum.  There b' = max(c_V, b_(n+1)), not normalised on its way, and gamma_n is the
maximum of c_n and b_n, divided by its peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import convolve_joint, interpolate, pull_back, subgrid_minimum
from fuzzykf.immutable import cached_property
from fuzzykf.possibility.grid.belief import convolve_axis
from fuzzykf.possibility.grid.lattice import Kernel, Lattice
from fuzzykf.possibility.grid.noise import shear
from fuzzykf.possibility.grid.residuum import before_scalar
from fuzzykf.possibility.mapping import grid_points
from fuzzykf.possibility.norms import MIN, PRODUCT

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.grid.noise import Noise
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership

__all__ = ["Message", "before_prediction", "before_update", "kept", "smoothed"]

#: Kernels and interpolation take costs below zero for rounding errors: messages are lifted above it.
LIFT = 1.0

#: Nodes along the axis of an image without width.
FEW = 5

#: The steps of a message are fine enough for images if they give them this part of the nodes of a lattice.
COARSE = 0.5

#: A message is continued by so many times its width for a noise without axes.
WIDEST = 2

#: By so much of a step an image may be beyond the last node and be on it nevertheless.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Message:
    """What later measurements say of the states on a lattice.

    Attributes
    ----------
    axes : tuple of ndarray
    cost : ndarray, shape (n_1, ..., n_d)
        Infinite where they exclude a state; may be negative if the t-norm has a generator.
    """

    axes: tuple[FloatArray, ...]
    cost: FloatArray

    @classmethod
    def nothing(cls, lattice: Lattice) -> Message:
        """Return that of no measurements."""
        return cls(lattice.axes, np.zeros(lattice.cost.shape))

    def on(self, axes: tuple[FloatArray, ...]) -> Message:
        """Return the same on other axes."""
        if all(np.array_equal(ours, theirs) for ours, theirs in zip(self.axes, axes, strict=True)):
            return self
        points = grid_points(axes)
        cost = self.at(points.reshape(-1, len(axes))).reshape(points.shape[:-1])
        return Message(axes, cost)

    def at(self, points: FloatArray) -> FloatArray:
        """Costs (m,) at points (m, d), by interpolation; infinite outside the lattice."""
        least = float(self.cost.min())
        if not -np.inf < least < 0.0:
            return _interpolated(self.axes, self.cost, points)
        lift = LIFT - least
        return _interpolated(self.axes, self.cost + lift, points) - lift


def smoothed(lattice: Lattice, message: Message) -> tuple[Lattice, Message] | None:
    """Join what earlier and later measurements say of a state.

    Parameters
    ----------
    lattice : Lattice
        Of the filter.
    message : Message
        On the same axes.

    Returns
    -------
    Lattice
        Its least cost, between the nodes, is 0.
    Message
        What it makes of the filter's: the least cost of the sum is 0 but for the errors of the grid, which
        are taken away here.

    None if no state is left.
    """
    t_norm = lattice.t_norm
    with np.errstate(invalid="ignore"):
        cost = t_norm.combine(lattice.cost, message.cost)
    cost = np.where(lattice.live(np.inf), cost, np.inf)
    if not np.isfinite(cost).any():
        return None
    if not t_norm.additive:
        return Lattice(lattice.axes, t_norm.renormalise(cost, float(cost.min())), t_norm), message
    excess = subgrid_minimum(cost)[0]
    return Lattice(lattice.axes, cost - excess, t_norm), Message(message.axes, message.cost - excess)


def kept(lattice: Lattice, message: Message, limit: float) -> Message:
    """Leave out of a message what is impossible, or costs more than a limit, given all measurements.

    No state before is less costly than the cheapest that it leads to, as c_n(x) + c_W(x' - f(x)) >= c'(x'):
    nothing below the limit is lost.  What is beyond it, a small difference of large costs, has no digits left
    in a scale that is not that of logarithms, and its errors would pass for possible states.

    Parameters
    ----------
    lattice : Lattice
        Of the filter.
    message : Message
        On the same axes.
    limit : float
        Above the least cost.

    Returns
    -------
    Message
    """
    if not lattice.t_norm.additive:
        return message
    possible = _possible(lattice, lattice.cost + message.cost, limit)
    return Message(message.axes, np.where(possible, message.cost, np.inf))


def _possible(lattice: Lattice, total: FloatArray, limit: float) -> BoolArray:
    """Which nodes are possible for the filter, and cost no more than a limit above the least of a total."""
    return lattice.live(np.inf) & (total <= limit + float(total.min()))


def before_update(
    posterior: Lattice, message: Message, prior: Lattice, possibility: float, limit: float
) -> Message:
    """Add to a message what the measurement of this instant says.

    Parameters
    ----------
    posterior : Lattice
    message : Message
        On its axes.
    prior : Lattice
        The prediction, on the same axes.
    possibility : float
        Of the measurement.
    limit : float
        See `kept`.

    Returns
    -------
    Message
        On the same axes.
    """
    t_norm = posterior.t_norm
    if not t_norm.additive:
        # Where the prediction was costlier than the measurement it takes its place: what led there costs as
        # much, so that the maximum over a trajectory stays the same.
        seen = posterior.cost + float(t_norm.cost(possibility))
        return Message(message.axes, np.maximum(seen, message.cost))
    total = posterior.cost + message.cost
    with np.errstate(invalid="ignore"):
        cost = np.where(_possible(posterior, total, limit), total - prior.cost, np.inf)  # and so is the prior
    return Message(message.axes, cost)


def before_prediction(
    source: Lattice,
    message: Message,
    move: Mapping,
    noise: Noise,
    universe: Universe,
    predicted: Lattice | None = None,
) -> Message:
    """Carry a message back over a prediction.

    Parameters
    ----------
    source : Lattice
        What was predicted from.
    message : Message
        On the states after it.
    move : Mapping
        The map f.
    noise : Noise
        Added to f(x).
    universe : Universe
        Its points are those of the convolution.
    predicted : Lattice, optional
        The prediction, on the axes of the message.

    Returns
    -------
    Message
        On the axes of ``source``.
    """
    d, kernels = len(source.axes), noise.kernels
    if predicted is not None and _is_pairwise(predicted) and kernels is not None:
        moved = move.then(np.eye(d), noise.peak) if noise.peak.any() else move
        later = np.where(predicted.live(np.inf), message.cost + predicted.cost, np.inf)
        with np.errstate(invalid="ignore"):
            cost = before_scalar(source, later, predicted, moved, kernels[0]) - source.cost
        return Message(source.axes, np.where(source.live(np.inf), cost, np.inf))
    additive = source.t_norm.additive
    least = float(message.cost.min())
    if not np.isfinite(least):
        return Message(source.axes, np.full(source.cost.shape, np.inf))
    lift = LIFT - least if additive else 0.0
    message = Message(message.axes, message.cost + lift)
    if kernels is None:
        lower, upper = source.bounds(universe.limit)
        oblique = shear(noise.membership, source.t_norm, upper - lower)
        if oblique is None:
            moved = move.then(np.eye(d), noise.peak)
            cost = _before_joint(source, message, moved, noise.membership)
            return Message(source.axes, cost - lift)
        basis, kernels = oblique
        move = move.then(np.asarray(np.linalg.inv(basis)), noise.peak)
        message = _in_basis(message, basis, universe)
    elif noise.peak.any():
        move = move.then(np.eye(d), noise.peak)
    images = _Images(source, move)
    axes, cost = list(message.axes), message.cost
    for k, kernel in enumerate(kernels):
        if kernel is not None:
            points = max(universe.points[k], source.axes[k].size, axes[k].size)  # as fine as either
            reflected = _Reflected(kernel)
            tabulated = reflected.curvature is None
            target = _spanned(images.bounds(k), axes[k], points, tabulated, universe.domain is not None)
            cost = convolve_axis(cost, k, axes[k], target, reflected)
            axes[k] = target
    return Message(source.axes, images.look_up(tuple(axes), cost) - lift)


def _is_pairwise(predicted: Lattice) -> bool:
    """Whether costs are large, and their pairs few."""
    return predicted.t_norm.scale == "reciprocal" and len(predicted.axes) == 1 and predicted.axes[0].size > 1


class _Images:
    """Where a map takes the possible nodes of a lattice; those of a matrix are not laid out.

    Parameters
    ----------
    source : Lattice
    move : Mapping
    """

    def __init__(self, source: Lattice, move: Mapping) -> None:
        self.source, self.move, self.live = source, move, source.live(np.inf)

    @cached_property
    def places(self) -> FloatArray:
        """The images (n_1, ..., n_d, d) of all nodes."""
        return self.move.on_grid(self.source.axes, self.live)

    def bounds(self, k: int) -> tuple[float, float]:
        """Least and largest component of the images of possible nodes."""
        if self.move.matrix is not None:
            return _bounds(self.move.matrix[k], self.move.shift[k], self.source.axes, self.live)
        there = self.places[..., k][self.live]
        return float(there.min()), float(there.max())

    def look_up(self, axes: tuple[FloatArray, ...], cost: FloatArray) -> FloatArray:
        """Costs (n_1, ..., n_d) at the images on another lattice, infinite for impossible nodes."""
        source, move, d = self.source, self.move, len(axes)
        if move.matrix is not None and len(source.free) == d and all(axis.size > 1 for axis in axes):
            found = _pulled(axes, cost, source.axes, move.matrix, move.shift)
            return np.where(self.live, found, np.inf)
        out = np.full(source.cost.shape, np.inf)
        out[self.live] = _interpolated(axes, cost, self.places[self.live])
        return out


def _bounds(
    row: FloatArray, shift: float, axes: tuple[FloatArray, ...], where: BoolArray
) -> tuple[float, float]:
    """Least and largest row x + shift of the nodes x of a lattice, of which some count."""
    d = len(axes)
    terms = [row[k] * axis.reshape([-1 if m == k else 1 for m in range(d)]) for k, axis in enumerate(axes)]
    value = np.broadcast_to(sum(terms, np.asarray(shift)), where.shape)
    if not where.all():
        value = value[where]
    return float(value.min()), float(value.max())


def _spanned(
    bounds: tuple[float, float], axis: FloatArray, points: int, tabulated: bool, in_domain: bool
) -> FloatArray:
    """Return an axis over images, by whole steps of the axis of a message where these are fine enough.

    In a domain nodes stay nodes; and the costs of a noise between equidistant nodes, if they are to be
    tabulated, are few.
    """
    low, high = bounds
    step = float(axis[-1] - axis[0]) / max(axis.size - 1, 1)
    if step > 0.0:
        first, last = (
            int(np.floor((low - axis[0]) / step + ROUNDING)),
            int(np.ceil((high - axis[0]) / step - ROUNDING)),
        )
        if in_domain:
            first, last = min(first, 0), max(last, axis.size - 1)
        size = last - first + 1
        if (in_domain or (tabulated and size >= COARSE * points)) and size <= 3 * axis.size:
            return np.asarray(axis[0] + step * np.arange(first, last + 1), dtype=np.float64)
    if high > low:
        return np.linspace(low, high, points)
    step = step or max(abs(low), 1.0) * 1e-6
    return np.asarray(low + step * (np.arange(FEW) - FEW // 2), dtype=np.float64)


def _interpolated(axes: tuple[FloatArray, ...], cost: FloatArray, points: FloatArray) -> FloatArray:
    """Costs (m,) at points (m, d); along an axis of length one every point counts as on it.

    The messages of known components are looked up by what is predicted of the same components.
    """
    free = [k for k, axis in enumerate(axes) if axis.size > 1]
    if not free:
        return np.full(points.shape[0], float(cost.ravel()[0]))
    origin = np.array([axes[k][0] for k in free])
    step = np.array([(axes[k][-1] - axes[k][0]) / (axes[k].size - 1) for k in free])
    lattice = cost.reshape([axes[k].size for k in free])
    return interpolate(lattice, np.ascontiguousarray((points[:, free] - origin) / step), "log")


def _in_basis(message: Message, basis: FloatArray, universe: Universe) -> Message:
    """Return a message in the coordinates u of x = basis u."""
    d = len(message.axes)
    back = np.asarray(np.linalg.inv(basis))
    possible = np.isfinite(message.cost)
    ends = [_bounds(row, 0.0, message.axes, possible) for row in back]
    axes = tuple(
        np.linspace(low, high, max(points, axis.size)) if high > low else np.array([low])
        for (low, high), points, axis in zip(ends, universe.points, message.axes, strict=True)
    )
    if all(axis.size > 1 for axis in (*axes, *message.axes)):
        return Message(axes, _pulled(message.axes, message.cost, axes, basis, np.zeros(d)))
    points = grid_points(axes)
    cost = message.at(points.reshape(-1, d) @ basis.T).reshape(points.shape[:-1])
    return Message(axes, cost)


def _pulled(
    axes: tuple[FloatArray, ...],
    cost: FloatArray,
    others: tuple[FloatArray, ...],
    matrix: FloatArray,
    shift: FloatArray,
) -> FloatArray:
    """Costs at matrix x + shift for the nodes x of other axes, all of several nodes."""
    origin, step = np.array([[a[0], (a[-1] - a[0]) / (a.size - 1)] for a in axes]).T
    first, stride = np.array([[a[0], (a[-1] - a[0]) / (a.size - 1)] for a in others]).T
    return pull_back(
        cost,
        matrix * stride / step[:, None],
        (matrix @ first + shift - origin) / step,
        tuple(a.size for a in others),
        "log",
    )


def _before_joint(source: Lattice, message: Message, move: Mapping, joint: Membership) -> FloatArray:
    """Carry a message back over a noise that has no axes: offset by offset on the lattice of the message."""
    t_norm, images = source.t_norm, _Images(source, move)
    if any(axis.size == 1 for axis in message.axes):
        return _before_joint_of_points(images, message, joint)
    axes, padding, count = [], [], []
    for k, axis in enumerate(message.axes):
        step, (low, high) = axis[1] - axis[0], images.bounds(k)
        below = max(0, int(np.ceil((axis[0] - low) / step)))
        above = max(0, int(np.ceil((high - axis[-1]) / step)))
        if below + above > WIDEST * axis.size:  # a message far narrower than what leads to it
            return _before_joint_of_points(images, message, joint)
        padding.append((below, above))
        axes.append(axis[0] + step * np.arange(-below, axis.size + above))
        count.append(axes[-1].size - 1)
    cost = np.pad(message.cost, padding, constant_values=np.inf)
    steps = [axis[1] - axis[0] for axis in axes]
    offsets = grid_points(tuple(h * np.arange(-n, n + 1) for h, n in zip(steps, count, strict=True)))
    kernel = joint.cost(joint.peak - offsets, t_norm)  # reflected
    kernel[kernel >= t_norm.impossible] = np.inf
    cost = convolve_joint(cost, kernel, tuple(count), t_norm.combine)
    return images.look_up(tuple(axes), cost)


def _before_joint_of_points(images: _Images, message: Message, joint: Membership) -> FloatArray:
    """Do the same from all nodes of a message, which need not form a lattice with any width."""
    t_norm, live = images.source.t_norm, images.live
    out = np.full(live.shape, np.inf)
    possible = np.isfinite(message.cost)
    best, image = out[live], images.places[live]
    for later, cost in zip(grid_points(message.axes)[possible], message.cost[possible], strict=True):
        noise = joint.cost(later - image + joint.peak, t_norm)
        noise[noise >= t_norm.impossible] = np.inf
        np.minimum(best, t_norm.combine(noise, cost), out=best)
    out[live] = best
    return out


class _Reflected(Kernel):
    """A kernel for messages: of the opposite noise, and with no membership that ends at a finite cost."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self.t_norm = PRODUCT if kernel.t_norm.additive else MIN
        self.lower, self.upper = -kernel.upper, -kernel.lower
        self.kinks = kernel.kinks  # none, or at the peak
        # What is impossible has a finite cost in one scale, beyond which messages below zero would reach.
        self.curvature = kernel.curvature if np.isinf(kernel.t_norm.impossible) else None

    def cost(self, offset: FloatArray) -> FloatArray:
        """Costs of offsets from the peak."""
        cost = self._kernel.cost(-offset)
        return np.where(cost < self._kernel.t_norm.impossible, cost, np.inf)

    def reach(self, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds of the offsets that cost no more than each of many costs."""
        lower, upper = self._kernel.reach(cost)
        return -upper, -lower

"""What an estimator knows of the state on a grid, and how it predicts.

A prediction warps the costs by the map and then convolves them along the noisy axes:

    mu'(x') = sup over (x, w) with x' = f(x) + w of T(mu(x), mu_W(w))

The warp mu_f(y) = sup over x with f(x) = y of mu(x) is pulled back where the inverse is
known and rasterised forward otherwise (`fuzzykf.possibility.grid.warp`).  What remains is one
(min,+) convolution of costs per noisy axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fuzzykf.engine.selected import (
    best_sources,
    continue_tails,
    convolve_joint,
    convolve_parabola,
    interpolate_lines,
    refine,
    totals,
)
from fuzzykf.possibility.grid import conditioning, constraining
from fuzzykf.possibility.grid.lattice import BETWEEN, Kernel, Lattice
from fuzzykf.possibility.grid.meeting import meeting
from fuzzykf.possibility.grid.noise import decompose, shear
from fuzzykf.possibility.grid.resolution import are_too_few, misses_peak, most_nodes, needed_nodes
from fuzzykf.possibility.grid.scalar import predict_scalar
from fuzzykf.possibility.grid.warp import landing, warp
from fuzzykf.possibility.mapping import Mapping, grid_points
from fuzzykf.possibility.protocol import Outcome

if TYPE_CHECKING:
    from typing import TypeAlias

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.folds import Fold
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.grid.noise import Noise
    from fuzzykf.possibility.grid.warp import Image
    from fuzzykf.possibility.memberships import GridMembership, Membership
    from fuzzykf.possibility.norms import TNorm

    Kernels: TypeAlias = tuple[Kernel | None, ...]

__all__ = ["GridBelief", "convolve_axis", "propagate"]

#: The loss of states at an edge is reported from this membership on: of unbounded
#: memberships, which every domain cuts somewhere, and of bounded ones.
LOSS_UNBOUNDED, LOSS_BOUNDED = 0.5, 0.01

#: Steps are the same if they differ by less than this part of them.
SAME = 1e-12

#: A scalar state that moves by a function without an inverse has up to this many pairs of source and target.
DIRECT = 16_000_000


@dataclass(frozen=True, eq=False)
class GridBelief:
    """Costs on a lattice that is fixed or follows the live region."""

    lattice: Lattice
    universe: Universe
    noise: Noise | None = None  # of the latest prediction: it is mostly the same at the next one

    @classmethod
    def of(cls, name: str, membership: Membership, t_norm: TNorm, universe: Universe) -> GridBelief:
        """Sample a membership; components of zero width are kept as known exactly."""
        floor = 0.0 if membership.is_bounded else float(t_norm.membership(universe.limit))
        lower, upper = membership.support(floor)
        counts = universe.points
        while True:
            fine = replace(universe, points=counts)
            axes = tuple(
                np.array([low]) if low == high else fine.axis(k, float(low), float(high))
                for k, (low, high) in enumerate(zip(lower, upper, strict=True))
            )
            lattice = Lattice.of(name, membership, axes, t_norm)
            needed = needed_nodes(axes, lattice.cost, t_norm, universe)
            if not are_too_few(counts, needed, axes):
                return cls(lattice, universe)
            counts = needed

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Centroid and second central moments, by the trapezoidal rule."""
        mean, P = self.lattice.moments
        return mean.reshape(-1, 1), P

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the live nodes."""
        return self.lattice.bounds(self.universe.limit)

    def as_membership(self) -> GridMembership:
        """Return the values on the nodes."""
        return self.lattice.as_membership()

    def mean_of_maximum(self) -> FloatArray:
        """Mean of the nodes of largest membership."""
        return self.lattice.mean_of_maximum()

    def peak(self) -> FloatArray:
        """Likeliest point, between the nodes."""
        return self.lattice.peak()

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Warp by the map, and convolution with the noise."""
        t_norm, universe, parts = self.lattice.t_norm, self.universe, self.noise
        if parts is None or parts.membership is not noise:
            parts = decompose(noise, t_norm)
        if universe.domain is None:
            lattice, lost, notes = _refined(self.lattice, move, parts, universe)
        else:
            lattice, lost = propagate(self.lattice, move, parts, universe)
            notes = lattice.notes(follows=False)
        level = 0.0 if np.isinf(lost) else float(t_norm.membership(lost))
        if level > (LOSS_BOUNDED if universe.bounded else LOSS_UNBOUNDED):
            notes.append(
                f"domain: states of membership up to {level:.3g} leave it at this prediction and count as "
                "impossible from now on; widen the domain, or leave it out so that the grid follows the state"
            )
        return Outcome(GridBelief(lattice, universe, parts), notes=notes)

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Combine with a measurement, on a lattice that fits the result."""
        found = conditioning.condition(self.lattice, measure, noise, z, self.universe)
        if found.lattice is None:
            return Outcome(None, found.possibility, found.reachable, found.notes)
        notes = found.notes or found.lattice.notes(follows=self.universe.domain is None)
        prior = None if found.prior is None else self._with(found.prior)
        return Outcome(self._with(found.lattice), found.possibility, found.reachable, notes, prior=prior)

    def constrain(self, constraint: Membership) -> Outcome:
        """Combine with a constraint, on a lattice that ends where a box does."""
        found = constraining.constrain(self.lattice, constraint, self.universe)
        if found.lattice is self.lattice:
            return Outcome(self)
        belief = None if found.lattice is None else self._with(found.lattice)
        prior = None if found.prior is None else self._with(found.prior)
        return Outcome(belief, found.possibility, found.reachable, found.notes, prior=prior)

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> GridBelief | None:
        """Return what the measurement alone says."""
        lattice = conditioning.restart(self.lattice, measure, noise, z, self.universe)
        return None if lattice is None else self._with(lattice)

    def _with(self, lattice: Lattice) -> GridBelief:
        return GridBelief(lattice, self.universe, self.noise)


def _refined(
    source: Lattice, move: Mapping, noise: Noise, universe: Universe
) -> tuple[Lattice, float, list[str]]:
    """Predict on a moving grid with as many nodes as its likely states ask for; with what is to be told."""
    t_norm = source.t_norm
    # What resolves a state mostly resolves its prediction.
    counts = needed_nodes(source.axes, source.cost, t_norm, universe)
    while True:
        lattice, lost = propagate(source, move, noise, replace(universe, points=counts))
        missed = misses_peak(source.cost, lattice.cost, t_norm)
        needed = needed_nodes(lattice.axes, lattice.cost, t_norm, universe)
        if missed:
            needed = most_nodes(universe)
        if not are_too_few(counts, needed, lattice.axes):
            return lattice, lost, [BETWEEN] if missed else lattice.notes(follows=True)
        counts = tuple(max(both) for both in zip(counts, needed, strict=True))


def propagate(source: Lattice, move: Mapping, noise: Noise, universe: Universe) -> tuple[Lattice, float]:
    """Predict on a lattice.

    Parameters
    ----------
    source : Lattice
    move : Mapping
        The map f.
    noise : Noise
        Added to f(x).
    universe : Universe
        Of the result.

    Returns
    -------
    Lattice
    float
        The least cost (largest membership) that left the domain; infinite if none.

    Raises
    ------
    SupportLostError
        If nothing is left within the domain.
    """
    d = len(source.axes)
    if noise.kernels is None:
        lower, upper = source.bounds(universe.limit)
        oblique = shear(noise.membership, source.t_norm, upper - lower)
        if oblique is not None:
            return _propagate_oblique(source, move, noise.peak, *oblique, universe)
    moved = move.then(np.eye(d), noise.peak) if noise.peak.any() else move
    if noise.kernels is None:
        return _propagate_joint(source, moved, noise.membership, universe)
    kernel, size = noise.kernels[0], source.axes[0].size
    by_function = moved.matrix is None and not moved.is_invertible
    if d == 1 and kernel is not None and by_function and 1 < size <= DIRECT // universe.points[0]:
        return _propagate_scalar(source, moved, kernel, universe)
    return _propagate(source, moved, noise.kernels, universe)


def _propagate_oblique(
    source: Lattice, move: Mapping, peak: FloatArray, basis: FloatArray, kernels: Kernels, universe: Universe
) -> tuple[Lattice, float]:
    """Predict in the coordinates of a basis, in which the noise has axes, and come back from there."""
    d, domain, back = len(source.axes), universe.domain, np.asarray(np.linalg.inv(basis))
    if domain is not None:
        corners = grid_points(tuple(domain)).reshape(-1, d) @ back.T
        domain = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
    lattice, _ = _propagate(source, move.then(back, peak), kernels, replace(universe, domain=domain))
    return _propagate(lattice, Mapping("basis", d, d, matrix=basis), (None,) * d, universe)


def _propagate(source: Lattice, move: Mapping, kernels: Kernels, universe: Universe) -> tuple[Lattice, float]:
    """Predict with one kernel (or none) per axis."""
    image = warp(source, move, kernels, universe)
    axes, cost = list(image.axes), image.cost
    lost = image.lost
    for k, kernel in enumerate(kernels):
        if kernel is None or k in image.convolved:
            continue
        target = universe.axis(k, *image.reached[k])
        if universe.domain is not None:
            lost = min(lost, _spill(cost, k, axes[k], target, kernel))
        elif not universe.bounded and axes[k].size > 1:
            # The best sources of far targets may lie beyond what was kept.
            axes[k], cost = _wider(axes[k], cost, k, universe.limit)
        cost = convolve_axis(cost, k, axes[k], target, kernel)
        axes[k] = target
    if image.fold is not None:
        for k, kernel in enumerate(kernels):
            if kernel is not None and k not in image.convolved:
                cost = np.minimum(cost, _from_fold(image, image.fold, k, axes, kernels))
    return Lattice(tuple(axes), cost, source.t_norm), lost


def _from_fold(image: Image, fold: Fold, k: int, axes: list[FloatArray], kernels: Kernels) -> FloatArray:
    """Costs of what the noise of one axis, and that of the other, carry from a fold of the plane."""
    other, kernel = 1 - k, kernels[k]
    assert kernel is not None
    cost = fold.spread(k, image.axes[other], axes[k], kernel)
    beside = kernels[other]
    if beside is None or other in image.convolved:
        return cost
    return convolve_axis(cost, other, image.axes[other], axes[other], beside)


def _propagate_scalar(
    source: Lattice, move: Mapping, kernel: Kernel, universe: Universe
) -> tuple[Lattice, float]:
    """Predict a scalar state through a function, from every source to every target."""
    found = landing(source, move, (kernel,), universe)
    axis, cost, target = source.axes[0], source.cost, universe.axis(0, *found.reached[0])
    lost = found.lost
    if universe.domain is not None:
        if found.low[0] > target[-1] or found.high[0] < target[0]:
            raise found.nothing_left(universe)
        lost = min(lost, _spill(cost, 0, found.image[:, 0], target, kernel))
    elif not universe.bounded:
        axis, cost = _wider(axis, cost, 0, universe.limit)
    cost = predict_scalar(axis, cost, move, target, kernel)
    if not (cost < source.t_norm.impossible).any():
        raise found.nothing_left(universe)
    return Lattice((target,), cost, source.t_norm), lost


def _wider(axis: FloatArray, cost: FloatArray, k: int, limit: float) -> tuple[FloatArray, FloatArray]:
    """Continue the tails along one axis by an eighth on either side."""
    more = axis.size // 8
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    wide = np.linspace(axis[0] - more * step, axis[-1] + more * step, axis.size + 2 * more)
    padding = [(more, more) if m == k else (0, 0) for m in range(cost.ndim)]
    return wide, continue_tails(np.pad(cost, padding, constant_values=np.inf), limit)


def _spill(cost: FloatArray, k: int, axis: FloatArray, target: FloatArray, kernel: Kernel) -> float:
    """Least cost that the noise carries just beyond the ends of the target axis."""
    others = tuple(m for m in range(cost.ndim) if m != k)
    margin = cost.min(axis=others)
    step = target[1] - target[0]
    beyond = np.array([target[0] - step, target[-1] + step])
    table = kernel.cost(beyond[:, None] - axis)
    total = kernel.t_norm.combine(np.broadcast_to(margin, table.shape), table)
    least = float(total.min())
    return least if least < kernel.t_norm.impossible else np.inf


def convolve_axis(
    cost: FloatArray, k: int, axis: FloatArray, target: FloatArray, kernel: Kernel
) -> FloatArray:
    """Convolve costs along one axis with a scalar noise kernel.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
    k : int
        Which axis.
    axis, target : ndarray
        Coordinates along it, before (possibly a single one) and after.
    kernel : Kernel

    Returns
    -------
    ndarray
        Of length ``target.size`` along axis ``k``.
    """
    t_norm = kernel.t_norm
    lines = np.ascontiguousarray(np.moveaxis(cost, k, -1))
    shape = lines.shape[:-1]
    lines = lines.reshape(-1, axis.size)
    if axis.size == 1:
        out = t_norm.combine(lines, np.broadcast_to(kernel.cost(target - axis[0]), (1, target.size)))
    elif kernel.curvature is not None:
        y0, dy, x0, dx = axis[0], axis[1] - axis[0], target[0], target[1] - target[0]
        out = convolve_parabola(lines, y0, dy, x0, dx, target.size, kernel.curvature)
    else:
        out = _convolve_tabulated(lines, axis, target, kernel)
    return np.ascontiguousarray(np.moveaxis(out.reshape(*shape, target.size), -1, k))


def _convolve_tabulated(
    lines: FloatArray, axis: FloatArray, target: FloatArray, kernel: Kernel
) -> FloatArray:
    """Convolve lines with a kernel of any other shape."""
    t_norm = kernel.t_norm
    table = _table(axis, target, kernel)
    source = best_sources(lines, table, t_norm.combine)
    step = axis[1] - axis[0]
    if t_norm.additive:
        near = [totals(lines, table, source, shift, t_norm.combine) for shift in range(-2, 3)]
        offset_used = target - axis[source]
        smooth = np.ones(source.shape, dtype=bool)
        for kink in kernel.kinks:
            smooth &= np.abs(offset_used - kink) >= step
        out = np.where(smooth, refine(*near), near[2])
    else:
        out = meeting(lines, axis, target, kernel, source)
    # Sources between the nodes: the likeliest noise, and the ends of a noise that stops short.
    for end in (0.0, kernel.lower, kernel.upper):
        extra = kernel.cost(np.array([end]))[0] if np.isfinite(end) else np.inf
        if extra < t_norm.impossible:
            between = interpolate_lines(lines, (target - end - axis[0]) / step, t_norm.scale)
            out = np.minimum(out, t_norm.combine(between, np.full(1, extra)))
    return out


def _table(axis: FloatArray, target: FloatArray, kernel: Kernel) -> FloatArray:
    """Costs (m, n) of the noise that leads from each source to each target; infinite where impossible."""
    step, other = (float(line[-1] - line[0]) / max(line.size - 1, 1) for line in (axis, target))
    if abs(step - other) <= SAME * step:
        # One number a diagonal, from the last row to the first: each row is a view of them.
        offset = np.concatenate([target[:0:-1] - axis[0], target[0] - axis])
        cost = kernel.cost(offset)
        cost[~(cost < kernel.t_norm.impossible)] = np.inf
        return sliding_window_view(cost, axis.size)[::-1]
    table = kernel.cost(target[:, None] - axis)
    table[table >= kernel.t_norm.impossible] = np.inf
    return table


def _propagate_joint(
    source: Lattice, move: Mapping, joint: Membership, universe: Universe
) -> tuple[Lattice, float]:
    """Predict with a noise that has no axes: offset by offset on the lattice of the result."""
    d, t_norm = len(source.axes), source.t_norm
    # Kernels of the components alone tell how far the noise reaches.
    shadows = tuple(Kernel(joint.project([k]), t_norm) for k in range(d))
    image = warp(source, move, shadows, universe, in_place=True)
    axes = tuple(universe.axis(k, *image.reached[k]) for k in range(d))
    if any(axis.size == 1 for axis in image.axes):
        cost = _gather(Lattice(image.axes, image.cost, t_norm), axes, joint)
        return Lattice(axes, cost, t_norm), image.lost
    step = [axis[1] - axis[0] for axis in axes]
    count, limit = [], universe.limit
    for k, shadow in enumerate(shadows):
        (below,), (above,) = shadow.reach(np.array([limit]))
        half = max(-below, above) / step[k]
        count.append(int(min(np.ceil(half), axes[k].size)))
    offsets = grid_points(tuple(h * np.arange(-n, n + 1) for h, n in zip(step, count, strict=True)))
    kernel = joint.cost(offsets + joint.peak, t_norm)
    kernel[(kernel >= t_norm.impossible) | (kernel > limit)] = np.inf
    cost = convolve_joint(image.cost, kernel, tuple(count), t_norm.combine)
    return Lattice(axes, cost, t_norm), image.lost


def _gather(source: Lattice, axes: tuple[FloatArray, ...], joint: Membership) -> FloatArray:
    """Costs of the new nodes from all old ones, which need not lie on the same lattice."""
    points = grid_points(axes)
    cost = np.full(points.shape[:-1], np.inf)
    live = source.live(np.inf)
    for start, value in zip(source.points[live], source.cost[live], strict=True):
        noise = joint.cost(points - start + joint.peak, source.t_norm)
        np.minimum(cost, source.t_norm.combine(noise, value), out=cost)
    return cost

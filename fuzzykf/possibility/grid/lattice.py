"""What a grid consists of: a universe, the costs of states on a lattice in it, and those of a noise.

Costs take the place of memberships (see `fuzzykf.possibility.norms`).  None of these
objects changes once it is made; prediction and update, beside this module, make new ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import interpolate, live_cells, moments_about, sharpness, subgrid_minimum
from fuzzykf.errors import ParameterError
from fuzzykf.immutable import cached_property
from fuzzykf.possibility.mapping import grid_points
from fuzzykf.possibility.memberships import EllipticalMembership, GridMembership, TriangularMembership

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["BETWEEN", "Kernel", "Lattice", "Universe"]

#: Nodes wanted per standard deviation of the sharpest direction, for integrals to 0.1 %.
RESOLUTION = 0.7

#: A step is cut into at most so many parts.
MOST_PARTS = 6

#: A node stands alone if the memberships beside it are below this.
LONE = 0.1

#: What is told of such a node.
BETWEEN = (
    "points: the likeliest states lie between neighbouring nodes of a grid that covers all states above the "
    "floor; centroid and spread are inaccurate (ask for more points, or raise the floor)"
)

#: Costs beyond the best by more than this do not count in integrals.
NEGLIGIBLE = 60.0

#: Cells integrated at a time.
SLAB = 1 << 12

#: By scale: of which family the costs are a multiple of its quadratic form, and that multiple.
FORMS = {"log": ("gaussian", 0.5), "reciprocal": ("cauchy", 1.0), "complement": ("parabolic", 1.0)}


@dataclass(frozen=True)
class Universe:
    """How large a lattice is and where it lies.

    Attributes
    ----------
    points : tuple of int
        Nodes per axis.
    domain : ndarray, shape (d, 2), or None
        A fixed box; None lets the lattice follow the live region.
    limit : float
        Without a domain, states of a higher cost are left out.
    bounded : bool
        Whether the states form a bounded set, so that the edges of the lattice are
        those of their support.
    """

    points: tuple[int, ...]
    domain: FloatArray | None
    limit: float
    bounded: bool

    def axis(self, k: int, lower: float, upper: float) -> FloatArray:
        """Return the axis over the given bounds, or over the domain if there is one."""
        if self.domain is not None:
            lower, upper = self.domain[k]
        return np.linspace(lower, upper, self.points[k])

    def is_small(self, k: int, span: float) -> bool:
        """Whether a span is so small a part of the domain that an axis of its own pays."""
        return self.domain is not None and span < 0.5 * float(self.domain[k, 1] - self.domain[k, 0])


@dataclass(frozen=True, eq=False)
class Lattice:
    """Costs on the nodes of a regular lattice; an immutable value.

    Attributes
    ----------
    axes : tuple of ndarray
        Equidistant coordinates; an axis of length one is a component known exactly.
    cost : ndarray, shape (n_1, ..., n_d)
        Costs in the scale of ``t_norm``; the least, between the nodes, is 0.
    t_norm : TNorm
    """

    axes: tuple[FloatArray, ...]
    cost: FloatArray
    t_norm: TNorm

    @classmethod
    def of(cls, name: str, membership: Membership, axes: tuple[FloatArray, ...], t_norm: TNorm) -> Lattice:
        """Sample a membership.

        Raises
        ------
        ParameterError
            If no node is possible; ``name`` says whose fault that is.
        """
        cost = membership.cost(grid_points(axes), t_norm)
        if not (cost < t_norm.impossible).any():
            raise ParameterError(
                f"{name}: no node of the grid is possible; ask for more points, or for a domain that "
                "holds the support"
            )
        return cls(axes, cost, t_norm)

    @cached_property
    def free(self) -> list[int]:
        """The axes of more than one node."""
        return [k for k, axis in enumerate(self.axes) if axis.size > 1]

    @property
    def points(self) -> FloatArray:
        """The nodes, shape (n_1, ..., n_d, d)."""
        return grid_points(self.axes)

    @cached_property
    def step(self) -> FloatArray:
        """Distances of neighbouring nodes (d,), zero along axes of length one."""
        return np.array([(axis[-1] - axis[0]) / max(axis.size - 1, 1) for axis in self.axes])

    def at(self, points: FloatArray) -> FloatArray:
        """Costs (m,) at points (m, d), by interpolation; impossible outside the lattice."""
        free = self.free
        off = np.zeros(points.shape[0], dtype=bool)
        for k, axis in enumerate(self.axes):
            if axis.size == 1:
                off |= np.abs(points[:, k] - axis[0]) > 1e-9 * max(abs(axis[0]), 1e-300)
        if not free:
            value = np.full(points.shape[0], float(self.cost.ravel()[0]))
        else:
            origin, step = np.array([self.axes[k][0] for k in free]), self.step[free]
            shape = tuple(self.axes[k].size for k in free)
            position = points if len(free) == len(self.axes) else points[:, free]
            value = interpolate(self.cost.reshape(shape), (position - origin) / step, self.t_norm.scale)
        value[off] = np.inf
        return value

    def bounds(self, limit: float) -> tuple[FloatArray, FloatArray]:
        """Bounds (d,) of the states whose cost is at most ``limit``: the nodes beyond the last such nodes."""
        live = self.live(limit)
        lower, upper = np.empty(len(self.axes)), np.empty(len(self.axes))
        for k, axis in enumerate(self.axes):
            there = np.flatnonzero(live.any(axis=tuple(m for m in range(live.ndim) if m != k)))
            lower[k], upper[k] = axis[max(there[0] - 1, 0)], axis[min(there[-1] + 1, axis.size - 1)]
        return lower, upper

    def live(self, limit: float) -> BoolArray:
        """Which nodes have a cost of at most ``limit`` and are not impossible."""
        possible = self.cost < self.t_norm.impossible
        return possible if limit == np.inf else possible & (self.cost <= limit)

    def memberships(self) -> FloatArray:
        """Memberships of the nodes, divided by the largest."""
        best = float(self.cost.min())
        return self.t_norm.membership(self.t_norm.renormalise(self.cost, best))

    def as_membership(self) -> GridMembership:
        """Return the same as a membership, linear between the nodes."""
        return GridMembership(self.axes, self.memberships())

    @cached_property
    def _sharpness(self) -> float:
        return sharpness(self.cost)

    @cached_property
    def parts(self) -> int:
        """Into how many parts a step has to be cut for sums over nodes to be integrals.

        A ridge that runs obliquely may be thinner than the cells; its costs are known
        between the nodes nevertheless.
        """
        return max(1, int(np.ceil(RESOLUTION * np.sqrt(max(self._sharpness, 0.0)))))

    def _is_lone(self) -> bool:
        """Whether the likeliest node stands alone along some axis, and nothing is known around it."""
        if self._sharpness > 0.0:
            return False
        best = [int(b) for b in np.unravel_index(int(np.argmin(self.cost)), self.cost.shape)]
        values = self.t_norm.renormalise(self.cost, float(self.cost[tuple(best)]))
        for k in self.free:
            line = values[tuple(slice(None) if m == k else b for m, b in enumerate(best))]
            beside = np.delete(line[max(best[k] - 1, 0) : best[k] + 2], min(best[k], 1))
            if (self.t_norm.membership(beside) < LONE).all():
                return True
        return False

    def notes(self, *, follows: bool) -> list[str]:
        """Warn of a membership that is far narrower than the cells of a grid that may follow it."""
        if follows and self._is_lone():
            return [BETWEEN]
        if self.parts > MOST_PARTS:
            return [
                "points: in some direction the membership is narrower than a tenth of the cells; centroid "
                "and spread are inaccurate (ask for more points, or choose components that are less "
                "correlated)"
            ]
        return []

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Centroid (d,) and second central moments (d, d), by the trapezoidal rule."""
        # About the likeliest node, which is within the spread of the mean: nothing cancels.
        best = np.unravel_index(int(np.argmin(self.cost)), self.cost.shape)
        center = np.array([axis[k] for axis, k in zip(self.axes, best, strict=True)])
        if self.parts > 1:
            shift, about = self._moments_within_cells(center)
        else:
            shift, about = moments_about(self.memberships(), self.axes, center)
        return center + shift, about - np.outer(shift, shift)

    def _moments_within_cells(self, center: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First and second moments about a point, by the midpoint rule on parts of live cells."""
        free, d = self.free, len(self.axes)
        cost = self.cost.reshape([self.axes[k].size for k in free])
        best = float(cost.min())
        parts = min(self.parts, MOST_PARTS)
        grid = (np.arange(parts) + 0.5) / parts
        inner = grid_points((grid,) * len(free)).reshape(-1, len(free))
        cells = live_cells(cost <= best + NEGLIGIBLE)
        total, first, second = 0.0, np.zeros(d), np.zeros((d, d))
        origin = np.array([axis[0] for axis in self.axes]) - center
        for start in range(0, cells.shape[0], SLAB):
            position = (cells[start : start + SLAB, None, :] + inner).reshape(-1, len(free))
            value = interpolate(cost, position, self.t_norm.scale)
            mass = self.t_norm.membership(self.t_norm.renormalise(value, best))
            deviation = np.tile(origin, (position.shape[0], 1))
            deviation[:, free] += position * self.step[free]
            total += float(mass.sum())
            first += mass @ deviation
            second += (mass[:, None] * deviation).T @ deviation
        return first / total, second / total

    def peak(self) -> FloatArray:
        """Return the point (d,) of largest membership, between the nodes."""
        _, position = subgrid_minimum(self.cost)
        return np.array([axis[0] for axis in self.axes]) + position * self.step

    def mean_of_maximum(self) -> FloatArray:
        """Mean (d,) of the nodes of largest membership."""
        best = self.cost <= self.cost.min() + 1e-9
        return np.asarray(self.points[best].mean(axis=0))

    def resampled(self, axes: tuple[FloatArray, ...]) -> Lattice:
        """Return the same membership on other axes."""
        points = grid_points(axes)
        cost = self.at(points.reshape(-1, len(axes))).reshape(points.shape[:-1])
        return Lattice(axes, cost, self.t_norm)


class Kernel:
    """A scalar noise membership as the kernel of a convolution, its peak moved to zero.

    Attributes
    ----------
    t_norm : TNorm
    lower, upper : float
        Bounds of the offsets that are possible.
    curvature : float or None
        If the cost is curvature * offset^2.
    kinks : tuple of float
        Offsets at which the cost is not smooth.
    """

    def __init__(self, membership: Membership, t_norm: TNorm) -> None:
        self.t_norm = t_norm
        self._membership, self._peak = membership, float(membership.peak[0])
        self.lower, self.upper = (float(bound[0]) - self._peak for bound in membership.support())
        self.kinks = (0.0,) if isinstance(membership, TriangularMembership) else ()
        self.curvature: float | None = None
        self._bend: float | None = None  # the same where costs do not add, too
        family, part = FORMS[t_norm.scale]
        if isinstance(membership, EllipticalMembership) and membership.family == family:
            self._bend = part / float(membership.matrix[0, 0])
            self.curvature = self._bend if t_norm.family == family else None

    @classmethod
    def quadratic(cls, variance: float, t_norm: TNorm) -> Kernel:
        """Return the kernel of a scalar noise of the family of a t-norm, by its matrix."""
        kernel = cls.__new__(cls)
        kernel.t_norm, kernel.kinks = t_norm, ()
        kernel.curvature = kernel._bend = FORMS[t_norm.scale][1] / variance
        kernel.upper = float(np.sqrt(t_norm.impossible / kernel.curvature))
        kernel.lower = -kernel.upper
        return kernel

    def cost(self, offset: FloatArray) -> FloatArray:
        """Costs of offsets from the peak."""
        if self._bend is not None:
            return self._bend * (offset * offset)
        return self._membership.cost((offset + self._peak)[..., None], self.t_norm)

    def reach(self, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds of the offsets that cost no more than each of many costs."""
        if self.curvature is not None:
            half = np.sqrt(np.maximum(cost, 0.0) / self.curvature)
            return -half, half
        level = np.clip(self.t_norm.membership(cost), np.finfo(float).tiny, 1.0)
        lower, upper = self._membership.reach(level)
        return lower[:, 0] - self._peak, upper[:, 0] - self._peak

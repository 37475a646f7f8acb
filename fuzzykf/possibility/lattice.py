"""A membership as costs on a regular lattice, and what can be read from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.grid import interpolate, subgrid_minimum
from fuzzykf.errors import ParameterError
from fuzzykf.possibility.memberships import GridMembership

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Lattice", "grid_points"]


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

    @property
    def free(self) -> list[int]:
        """The axes of more than one node."""
        return [k for k, axis in enumerate(self.axes) if axis.size > 1]

    @property
    def points(self) -> FloatArray:
        """The nodes, shape (n_1, ..., n_d, d)."""
        return grid_points(self.axes)

    @property
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
            value = interpolate(
                self.cost.reshape(shape), (points[:, free] - origin) / step, self.t_norm.scale
            )
        value[off] = np.inf
        return value

    def bounds(self, limit: float) -> tuple[FloatArray, FloatArray]:
        """Bounds (d,) of the nodes whose cost is at most ``limit`` (and not impossible)."""
        live = self.live(limit)
        lower, upper = np.empty(len(self.axes)), np.empty(len(self.axes))
        for k, axis in enumerate(self.axes):
            there = np.flatnonzero(live.any(axis=tuple(m for m in range(live.ndim) if m != k)))
            lower[k], upper[k] = axis[there[0]], axis[there[-1]]
        return lower, upper

    def live(self, limit: float) -> np.ndarray:
        """Which nodes have a cost of at most ``limit`` and are not impossible."""
        return (self.cost <= limit) & (self.cost < self.t_norm.impossible)

    def memberships(self) -> FloatArray:
        """Memberships of the nodes, divided by the largest."""
        best = float(self.cost.min())
        return self.t_norm.membership(self.t_norm.renormalise(self.cost, best))

    def as_membership(self) -> GridMembership:
        """Return the same as a membership, linear between the nodes."""
        return GridMembership(self.axes, self.memberships())

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Centroid (d,) and second central moments (d, d), by the trapezoidal rule."""
        mass = self.memberships()
        d = mass.ndim
        unit = np.eye(d, dtype=np.intp)
        best = np.unravel_index(int(np.argmax(mass)), mass.shape)
        start = np.array([axis[k] for axis, k in zip(self.axes, best, strict=True)])
        about = _moments_about(mass, self.axes, start)
        mean = start + np.array([about[tuple(unit[k])] for k in range(d)]) / about[(0,) * d]
        about = _moments_about(mass, self.axes, mean)
        P = np.array([[about[tuple(unit[j] + unit[k])] for j in range(d)] for k in range(d)])
        return mean, P / about[(0,) * d]

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


def grid_points(axes: tuple[FloatArray, ...]) -> FloatArray:
    """All nodes (n_1, ..., n_d, d) of the lattice with these axes."""
    points = np.empty((*(axis.size for axis in axes), len(axes)))
    for k, axis in enumerate(axes):
        points[..., k] = axis.reshape([-1 if m == k else 1 for m in range(len(axes))])
    return points


def _moments_about(mass: FloatArray, axes: tuple[FloatArray, ...], center: FloatArray) -> FloatArray:
    """All moments of order 0 to 2 per axis about a point, shape (3, ..., 3)."""
    for axis, c in zip(reversed(axes), reversed(center), strict=True):
        weight = np.ones(axis.size)
        weight[[0, -1]] *= 0.5
        deviation = axis - c
        basis = np.stack([weight, weight * deviation, weight * deviation**2], axis=1)
        mass = np.moveaxis(mass @ basis, -1, 0)
    return mass

"""Costs on regular lattices: interpolation between the nodes, curvature, tails and moments.

A lattice is given by its origin, its steps and its shape; positions are measured
in steps from the origin.  Within a cell costs are interpolated linearly and corrected
for their second differences: quadratic costs, that is Gaussian memberships, come out
exact at any resolution.  Where the second differences at the two ends of an edge do
not agree (at the edge of a compact support, at a kink) the memberships are
interpolated linearly instead.

How costs and memberships are related is their scale, given by the generator of a t-norm.
"""

from __future__ import annotations

from itertools import pairwise, product
from math import hypot
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = [
    "CUT",
    "Scale",
    "continue_tails",
    "from_membership",
    "interpolate",
    "interpolate_lines",
    "least_outside",
    "moments_about",
    "pull_back",
    "scaled",
    "sharpness",
    "subgrid_minimum",
    "to_membership",
]

#: "log": -log(membership); "reciprocal": 1/membership - 1; "complement": 1 - membership.
Scale: TypeAlias = Literal["log", "reciprocal", "complement"]

#: Elements worked on at a time: the temporaries then stay in the cache.
CHUNK = 1 << 15

#: Second differences agree if they differ by less than this part of them, or by this cost.
ROUGHNESS, NEGLIGIBLE = 0.5, 0.02

#: Only tails that have reached this part of the limit were cut off by it.
CUT = 0.7

#: A tail is smooth, or a parabola, if its second difference changes by less than this.
TAIL_ROUGHNESS, EXACT = 0.02, 1e-8

#: Positions are on nodes if they are off by less than this (in steps): the rounding of 10^4 steps.
ON_NODE = 1e-11

#: How far (in steps) beyond the last node a position still counts as on it.
SLACK = 1e-9


def from_membership(membership: FloatArray, scale: Scale) -> FloatArray:
    """Costs of memberships: 0 for 1; infinite ("complement": 1) for 0."""
    if scale == "complement":
        return 1.0 - membership
    with np.errstate(divide="ignore", over="ignore"):
        return -np.log(membership) if scale == "log" else 1.0 / membership - 1.0


def to_membership(cost: FloatArray, scale: Scale) -> FloatArray:
    """Memberships of costs."""
    if scale == "log":
        return np.exp(-cost)
    if scale == "reciprocal":
        return 1.0 / (1.0 + cost)
    return np.maximum(0.0, 1.0 - cost)


def scaled(cost: FloatArray, factor: FloatArray, scale: Scale) -> FloatArray:
    """Costs after multiplication of the memberships by a positive factor."""
    if scale == "log":
        return cost - np.log(factor)
    return from_membership(to_membership(cost, scale) * factor, scale)


def interpolate(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Costs between the nodes of a lattice; infinite outside it.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
        At least four nodes along each axis.
    position : ndarray, shape (m, d)
        In steps from the first node; NaN for nowhere.
    scale : {"log", "reciprocal", "complement"}
        How costs and memberships are related.

    Returns
    -------
    ndarray, shape (m,)
    """
    out = np.full(position.shape[0], np.inf)
    for start in range(0, position.shape[0], CHUNK):
        part = position[start : start + CHUNK]
        within = np.ones(part.shape[0], dtype=bool)
        for along, n in zip(part.T, cost.shape, strict=True):
            within &= (along >= -SLACK) & (along <= n - 1 + SLACK)
        inside = np.flatnonzero(within)
        if inside.size == part.shape[0]:
            out[start : start + CHUNK] = _interpolate(cost, part, scale)
        elif inside.size:
            out[start + inside] = _interpolate(cost, part[inside], scale)
    return out


def _interpolate(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Interpolate at positions inside the lattice."""
    d = cost.ndim
    flat = cost.ravel()
    strides = [int(stride) // cost.itemsize for stride in cost.strides]
    corners, fractions = [], {}
    for k in range(d):
        along = position[:, k]
        corner = np.rint(along)
        # Where the map leaves a coordinate alone, all positions are nodes along its axis.
        if np.abs(along - corner).max(initial=0.0) > ON_NODE:
            corner = np.minimum(np.maximum(np.floor(along), 0.0), cost.shape[k] - 2.0)
            fractions[k] = np.minimum(np.maximum(along - corner, 0.0), 1.0)
        corners.append(corner.astype(np.intp))
    node = sum(corner * stride for corner, stride in zip(corners, strides, strict=True))
    value = np.zeros(position.shape[0])
    with np.errstate(invalid="ignore", over="ignore"):
        for offsets in product((0, 1), repeat=len(fractions)):
            weight, shift = np.ones(1), 0
            for (k, t), offset in zip(fractions.items(), offsets, strict=True):
                weight = weight * (t if offset else 1.0 - t)
                shift += strides[k] * offset
            value += weight * flat.take(node + shift)
        for k, t in fractions.items():
            # Four nodes along the edge that is nearest in the other directions.
            place = np.minimum(np.maximum(corners[k] - 1, 0), cost.shape[k] - 4) * strides[k]
            for m in range(d):
                if m != k:
                    nearest = corners[m] + (fractions[m] > 0.5) if m in fractions else corners[m]
                    place += nearest * strides[m]
            four = [flat.take(place + j * strides[k]) for j in range(4)]
            value -= 0.5 * t * (1.0 - t) * _bend(*four)
    edge = np.flatnonzero(~np.isfinite(value))
    if edge.size:
        value[edge] = _interpolate_memberships(cost, position[edge], scale)
    return np.maximum(value, 0.0, out=value)  # no membership exceeds one


def _bend(first: FloatArray, second: FloatArray, third: FloatArray, fourth: FloatArray) -> FloatArray:
    """Second difference between four nodes in a row; NaN where its two values disagree."""
    slope = third - second
    low, high = slope - (second - first), (fourth - third) - slope
    allowed = ROUGHNESS * (np.abs(low) + np.abs(high)) + NEGLIGIBLE
    agreed = (np.abs(low - high) <= allowed) & (allowed < np.inf)
    return np.where(agreed, np.where(np.abs(low) < np.abs(high), low, high), np.nan)


def _interpolate_memberships(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Interpolate linearly in the memberships of the 2^d nodes around each position.

    Infinite if none of them is possible: a finite cost of the impossible would be bent below its limit by
    what refines sums.
    """
    d = cost.ndim
    flat = cost.ravel()
    strides = np.array(cost.strides) // cost.itemsize
    base = np.clip(np.floor(position), 0, np.array(cost.shape) - 2)
    fraction = np.clip(position - base, 0.0, 1.0)
    node = base.astype(np.intp) @ strides
    corners = np.array(list(product((0, 1), repeat=d)))
    values = flat[node[:, None] + corners @ strides]
    weight = np.where(corners, fraction[:, None, :], 1.0 - fraction[:, None, :]).prod(axis=2)
    if scale != "log":
        return _possible((weight * to_membership(values, scale)).sum(axis=1), scale)
    # Relative to the best corner, memberships too small for a float do not vanish.
    best = values.min(axis=1)
    shift = np.where(np.isfinite(best), best, 0.0)
    return shift + _possible((weight * to_membership(values - shift[:, None], scale)).sum(axis=1), scale)


def _possible(membership: FloatArray, scale: Scale) -> FloatArray:
    """Costs of memberships, infinite for 0 in every scale."""
    return np.where(membership > 0.0, from_membership(membership, scale), np.inf)


def pull_back(
    cost: FloatArray, matrix: FloatArray, shift: FloatArray, shape: tuple[int, ...], scale: Scale
) -> FloatArray:
    """Costs at the positions shift + matrix n, for all nodes n of another lattice.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
        At least four nodes along each axis.
    matrix : ndarray, shape (d, d)
        Steps of this lattice per step of the other.
    shift : ndarray, shape (d,)
        Position of the first node of the other lattice.
    shape : tuple of int, length d
        Of the other lattice.
    scale : {"log", "reciprocal", "complement"}

    Returns
    -------
    ndarray, shape ``shape``
    """
    out = np.empty(shape)
    flat = out.reshape(-1)
    for start in range(0, flat.size, CHUNK):
        number = np.arange(start, min(start + CHUNK, flat.size))
        position = np.empty((number.size, len(shape)))
        position[:] = shift
        for k, node in enumerate(np.unravel_index(number, shape)):
            for i, part in enumerate(matrix[:, k]):
                position[:, i] += part * node
        flat[start : start + CHUNK] = interpolate(cost, position, scale)
    return out


def least_outside(image: FloatArray, cost: FloatArray, box: FloatArray) -> float:
    """Least cost of the nodes whose image is outside a box.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        NaN counts as inside.
    cost : ndarray, shape (n_1, ..., n_s)
    box : ndarray, shape (d, 2)
        Bounds.

    Returns
    -------
    float
        Infinite if there is none.
    """
    outside = np.zeros(cost.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for k, (low, high) in enumerate(box):
            outside |= (image[..., k] < low) | (image[..., k] > high)
    return float(cost[outside].min(initial=np.inf))


def interpolate_lines(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Costs between the nodes of many lines, at the same positions on each.

    Parameters
    ----------
    cost : ndarray, shape (lines, n)
        n >= 4.
    position : ndarray, shape (m,)
        In steps from the first node.

    Returns
    -------
    ndarray, shape (lines, m)
        Infinite outside the lines.
    """
    n = cost.shape[1]
    node = np.clip(np.floor(position), 0, n - 2).astype(np.intp)
    t = np.clip(position - node, 0.0, 1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        value: FloatArray = (1.0 - t) * cost[:, node] + t * cost[:, node + 1]
        first = np.clip(node - 1, 0, n - 4)
        value -= 0.5 * t * (1.0 - t) * _bend(*(cost[:, first + j] for j in range(4)))
    line, edge = np.nonzero(~np.isfinite(value))
    if line.size:
        value[line, edge] = _between(cost[line, node[edge]], cost[line, node[edge] + 1], t[edge], scale)
    value[:, (position < -SLACK) | (position > n - 1 + SLACK)] = np.inf
    np.maximum(value, 0.0, out=value)
    return value


def _between(low: FloatArray, high: FloatArray, fraction: FloatArray, scale: Scale) -> FloatArray:
    """Costs at a fraction of the way between two nodes, linear in the memberships."""
    best = np.minimum(low, high)
    shift = np.where(np.isfinite(best), best, 0.0) if scale == "log" else np.zeros(best.shape)
    weighted = (1.0 - fraction) * to_membership(low - shift, scale)
    weighted += fraction * to_membership(high - shift, scale)
    return shift + _possible(weighted, scale)


def subgrid_minimum(cost: FloatArray) -> tuple[float, FloatArray]:
    """Least cost between the nodes, by the quadratic through the best node's neighbours.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
        At least one finite value; axes of length one are held fixed.

    Returns
    -------
    value : float
    position : ndarray, shape (d,)
        In steps from the first node.  At an edge, or where the neighbours do not
        form a bowl, it is that of the best node.
    """
    best, axes, slope, hessian = _bowl(cost)
    position = np.array(best, dtype=np.float64)
    value = float(cost[best])
    step = _descent(slope, hessian) if axes else None
    if step is not None and max(map(abs, step)) <= 1.0:
        position[axes] += step
        value += 0.5 * sum(a * b for a, b in zip(slope, step, strict=True))
    return value, position


def sharpness(cost: FloatArray) -> float:
    """Largest second derivative (per squared step, in any direction) at the best node; 0 if unknown."""
    _, axes, _, hessian = _bowl(cost)
    if len(axes) == 2:  # what LAPACK would take ten times as long for
        (a, b), (_, c) = hessian
        return 0.5 * (a + c) + hypot(0.5 * (a - c), b)
    return float(np.linalg.eigvalsh(hessian)[-1]) if len(axes) > 1 else hessian[0][0] if axes else 0.0


def _descent(slope: list[float], hessian: list[list[float]]) -> list[float] | None:
    """Step from a point to the minimum of a quadratic, by its gradient and Hessian; None if there is none."""
    if len(slope) > 2:
        curvatures, directions = np.linalg.eigh(hessian)
        if not curvatures[0] > 0.0:
            return None
        step: list[float] = (directions @ (-(slope @ directions) / curvatures)).tolist()
        return step
    first, rest = hessian[0], hessian[1:]
    if not first[0] > 0.0:
        return None
    if not rest:
        return [-slope[0] / first[0]]
    part = first[1] / first[0]
    left = rest[0][1] - part * first[1]
    if not left > 0.0:
        return None
    second = (part * slope[0] - slope[1]) / left
    return [-slope[0] / first[0] - part * second, second]


def _bowl(cost: FloatArray) -> tuple[tuple[int, ...], list[int], list[float], list[list[float]]]:
    """Best node, axes along which costs are smooth around it, gradient and Hessian there.

    All these are a handful of numbers, for which arrays would be a burden.
    """
    best = tuple(int(b) for b in np.unravel_index(int(np.argmin(cost)), cost.shape))
    axes = [k for k in range(cost.ndim) if 0 < best[k] < cost.shape[k] - 1]
    window = cost[tuple(slice(b - 1, b + 2) if k in axes else b for k, b in enumerate(best))]
    if axes and np.isfinite(window).all() and all(_is_smooth(cost, best, k) for k in axes):
        return best, axes, *_quadratic(window)
    return best, [], [], []


def _is_smooth(cost: FloatArray, node: tuple[int, ...], k: int) -> bool:
    """Whether the second differences along an axis at a node and at its neighbours agree."""
    near = slice(max(node[k] - 2, 0), node[k] + 3)
    line = cost[tuple(near if m == k else b for m, b in enumerate(node))].tolist()
    slopes = [second - first for first, second in pairwise(line)]
    bends = [second - first for first, second in pairwise(slopes)]
    return all(_agree(low, high) for low, high in pairwise(bends))


def _agree(low: float, high: float) -> bool:
    """Whether two second differences are about the same; see `_bend`."""
    allowed = ROUGHNESS * (abs(low) + abs(high)) + NEGLIGIBLE
    return abs(low - high) <= allowed < np.inf


def _quadratic(window: FloatArray) -> tuple[list[float], list[list[float]]]:
    """Gradient and Hessian at the centre of a window of 3 x ... x 3 nodes."""
    d, value = window.ndim, window.ravel().tolist()
    strides = [3 ** (d - 1 - k) for k in range(d)]
    centre = sum(strides)
    slope, hessian = [0.0] * d, [[0.0] * d for _ in range(d)]
    for k, i in enumerate(strides):
        up, down = value[centre + i], value[centre - i]
        slope[k] = 0.5 * (up - down)
        hessian[k][k] = up - 2.0 * value[centre] + down
        for m, j in enumerate(strides[:k]):
            mixed = value[centre + i + j] - value[centre + i - j]
            mixed += value[centre - i - j] - value[centre - i + j]
            hessian[k][m] = hessian[m][k] = 0.25 * mixed
    return slope, hessian


def continue_tails(cost: FloatArray, limit: float) -> FloatArray:
    """Continue costs into the impossible nodes at the ends of all lines, where these are smooth tails.

    A lattice that was cut off where memberships are small, and then mapped, does not
    fill the box around its image.  What is missing is no edge of the support.

    Parameters
    ----------
    cost : ndarray
    limit : float
        Cost at which the lattice was cut off.  Only tails that would nearly reach it at
        the next node are continued, and nothing beyond has a much lower cost.

    Returns
    -------
    ndarray
        By the last parabola, or line if that bends down.
    """
    cost = np.array(cost)
    for axis in range(cost.ndim):
        if cost.shape[axis] > 4 and not np.isfinite(cost).all():
            lines = np.moveaxis(cost, axis, -1)
            flat = np.array(lines).reshape(-1, lines.shape[-1])
            _continue_ends(flat, limit)
            _continue_ends(flat[:, ::-1], limit)
            cost = np.moveaxis(flat.reshape(lines.shape), -1, axis)
    return np.ascontiguousarray(cost)


def _continue_ends(lines: FloatArray, limit: float) -> None:
    """Fill, in place, what follows the last finite node of each line."""
    n = lines.shape[1]
    finite = np.isfinite(lines)
    last = n - 1 - finite[:, ::-1].argmax(axis=1)
    chosen = np.flatnonzero(finite.any(axis=1) & (last < n - 1) & (last >= 3))
    last = last[chosen]
    four = [lines[chosen, last - k] for k in range(4)]
    with np.errstate(invalid="ignore", over="ignore"):
        slope = four[0] - four[1]
        bend = slope - (four[1] - four[2])
        change = np.abs(bend - (four[1] - 2.0 * four[2] + four[3]))
        smooth = change <= TAIL_ROUGHNESS * (np.abs(bend) + 1.0)
        beyond = four[0] + slope + np.maximum(bend, 0.0)
    kept = smooth & np.isfinite(change) & (beyond >= CUT * limit)
    chosen, last = chosen[kept], last[kept]
    start, slope, bend = four[0][kept], slope[kept], np.maximum(bend[kept], 0.0)
    # Only an exact parabola is trusted to come down again.
    slope = np.where(change[kept] <= EXACT * (bend + 1.0), slope, np.maximum(slope, 0.0))
    steps = np.arange(n) - last[:, None]
    with np.errstate(over="ignore"):
        tail = start[:, None] + slope[:, None] * steps + 0.5 * bend[:, None] * steps * (steps + 1.0)
    lines[chosen] = np.where(steps > 0, np.maximum(tail, CUT * limit), lines[chosen])


def moments_about(
    mass: FloatArray, axes: tuple[FloatArray, ...], center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First and second moments about a point, by the trapezoidal rule.

    Parameters
    ----------
    mass : ndarray, shape (n_1, ..., n_d)
        Of which some is positive.
    axes : tuple of ndarray
        Coordinates of the nodes.
    center : ndarray, shape (d,)
        A point within the spread of the mass, so that nothing cancels.

    Returns
    -------
    first : ndarray, shape (d,)
    second : ndarray, shape (d, d)
    """
    for axis, c in zip(reversed(axes), reversed(center), strict=True):
        weight = np.ones(axis.size)
        weight[[0, -1]] *= 0.5
        deviation = axis - c
        basis = np.stack([weight, weight * deviation, weight * deviation**2], axis=1)
        mass = np.moveaxis(mass @ basis, -1, 0)
    d = len(axes)
    unit = np.eye(d, dtype=np.intp)
    mass = mass / mass[(0,) * d]
    first = np.array([mass[tuple(unit[k])] for k in range(d)])
    return first, np.array([[mass[tuple(unit[j] + unit[k])] for j in range(d)] for k in range(d)])

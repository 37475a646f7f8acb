"""Interpolation of costs on regular lattices.

A lattice is given by its origin, its steps and its shape; positions are measured
in steps from the origin.  Within a cell costs are interpolated linearly and corrected
for their second differences: quadratic costs, that is Gaussian memberships, come out
exact at any resolution.  Where the second differences at the two ends of an edge do
not agree (at the edge of a compact support, at a kink) the memberships are
interpolated linearly instead.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fuzzykf.engine.scales import from_membership, to_membership

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.engine.scales import Scale

__all__ = ["extrapolate", "interpolate", "interpolate_lines", "subgrid_minimum"]

IntArray: TypeAlias = NDArray[np.intp]

#: Elements worked on at a time: the temporaries then stay in the cache.
CHUNK = 1 << 15

#: Second differences agree if they differ by less than this part of them, or by this cost.
ROUGHNESS, NEGLIGIBLE = 0.5, 0.02

#: How far (in steps) beyond the last node a position still counts as on it.
SLACK = 1e-9


def interpolate(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Costs between the nodes of a lattice; infinite outside it.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
        At least three nodes along each axis.
    position : ndarray, shape (m, d)
        In steps from the first node; NaN for nowhere.
    scale : {"log", "reciprocal", "complement"}
        How costs and memberships are related.

    Returns
    -------
    ndarray, shape (m,)
    """
    out = np.full(position.shape[0], np.inf)
    bends = [np.ascontiguousarray(second_differences(cost, k)) for k in range(cost.ndim)]
    for start in range(0, position.shape[0], CHUNK):
        part = position[start : start + CHUNK]
        last = np.array(cost.shape) - 1
        inside = np.flatnonzero(((part >= -SLACK) & (part <= last + SLACK)).all(axis=1))
        if inside.size == part.shape[0]:
            out[start : start + CHUNK] = _interpolate(cost, bends, part, scale)
        elif inside.size:
            out[start + inside] = _interpolate(cost, bends, part[inside], scale)
    return out


def second_differences(cost: FloatArray, axis: int) -> FloatArray:
    """Second difference along each edge of a lattice, NaN where its ends disagree.

    Parameters
    ----------
    cost : ndarray
        At least three nodes along ``axis``.
    axis : int

    Returns
    -------
    ndarray
        One shorter than ``cost`` along ``axis``; of the values at the two ends of the
        edge the smaller one.
    """
    lines = np.moveaxis(cost, axis, -1)
    with np.errstate(invalid="ignore", over="ignore"):
        slope = lines[..., 1:] - lines[..., :-1]
        bend = slope[..., 1:] - slope[..., :-1]
        low = np.concatenate([bend[..., :1], bend], axis=-1)
        high = np.concatenate([bend, bend[..., -1:]], axis=-1)
        agreed = np.where(agree(low, high), np.where(np.abs(low) < np.abs(high), low, high), np.nan)
    return np.moveaxis(agreed, -1, axis)


def agree(first: FloatArray, second: FloatArray) -> NDArray[np.bool_]:
    """Whether two second differences could belong to one smooth function; not for NaN or inf."""
    with np.errstate(invalid="ignore"):
        allowed = ROUGHNESS * (np.abs(first) + np.abs(second)) + NEGLIGIBLE
        return np.asarray(np.abs(first - second) <= allowed) & np.isfinite(allowed)


def _interpolate(cost: FloatArray, bends: list[FloatArray], position: FloatArray, scale: Scale) -> FloatArray:
    """Interpolate at positions inside the lattice."""
    d, shape = cost.ndim, cost.shape
    flat = cost.ravel()
    strides = np.array(cost.strides) // cost.itemsize
    last = np.array(shape) - 2.0
    base = np.minimum(np.maximum(np.floor(position), 0.0), last)
    t = np.minimum(np.maximum(position - base, 0.0), 1.0)
    corner = base.astype(np.intp)
    node = corner @ strides
    value = np.zeros(position.shape[0])
    with np.errstate(invalid="ignore", over="ignore"):
        for offsets in product((0, 1), repeat=d):
            weight = t[:, 0] if offsets[0] else 1.0 - t[:, 0]
            for k in range(1, d):
                weight = weight * (t[:, k] if offsets[k] else 1.0 - t[:, k])
            value += weight * flat.take(node + int(strides @ np.array(offsets)))
        nearest = corner + (t > 0.5)
        for k, bend in enumerate(bends):
            index = nearest.copy()
            index[:, k] = corner[:, k]
            place = index @ (np.array(bend.strides) // bend.itemsize)
            value -= 0.5 * t[:, k] * (1.0 - t[:, k]) * bend.ravel().take(place)
    edge = np.flatnonzero(~np.isfinite(value))
    if edge.size:
        value[edge] = _interpolate_memberships(cost, position[edge], scale)
    return np.maximum(value, 0.0, out=value)  # no membership exceeds one


def _interpolate_memberships(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Interpolate linearly in the memberships of the 2^d nodes around each position."""
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
        return from_membership((weight * to_membership(values, scale)).sum(axis=1), scale)
    # Relative to the best corner, memberships too small for a float do not vanish.
    best = values.min(axis=1)
    shift = np.where(np.isfinite(best), best, 0.0)
    return shift + from_membership(
        (weight * to_membership(values - shift[:, None], scale)).sum(axis=1), scale
    )


def interpolate_lines(cost: FloatArray, position: FloatArray, scale: Scale) -> FloatArray:
    """Costs between the nodes of many lines, at the same positions on each.

    Parameters
    ----------
    cost : ndarray, shape (lines, n)
        n >= 3.
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
        value -= 0.5 * t * (1.0 - t) * second_differences(cost, 1)[:, node]
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
    return shift + from_membership(weighted, scale)


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
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    position = np.array(best, dtype=np.float64)
    value = float(cost[best])
    axes = [k for k in range(cost.ndim) if 0 < best[k] < cost.shape[k] - 1]
    smooth = all(
        _is_smooth(cost[tuple(slice(None) if m == k else best[m] for m in range(cost.ndim))], best[k])
        for k in axes
    )
    if axes and smooth:
        window = cost[tuple(slice(b - 1, b + 2) if k in axes else b for k, b in enumerate(best))]
        if np.isfinite(window).all():
            slope, hessian = _quadratic(window)
            if np.linalg.eigvalsh(hessian)[0] > 0.0:
                step = -np.linalg.solve(hessian, slope)
                if np.abs(step).max() <= 1.0:
                    position[axes] += step
                    value += 0.5 * float(slope @ step)
    return value, position


def _is_smooth(line: FloatArray, node: int) -> bool:
    """Whether the second difference at a node agrees with those of its neighbours."""
    with np.errstate(invalid="ignore"):
        bend = np.diff(line[max(node - 2, 0) : node + 3], 2)
    return bool(agree(bend[1:], bend[:-1]).all())


def _quadratic(window: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient and Hessian at the centre of a window of 3 x ... x 3 nodes."""
    d = window.ndim
    centre = (1,) * d

    def at(**moves: int) -> float:
        return float(window[tuple(c + moves.get(f"k{k}", 0) for k, c in enumerate(centre))])

    slope, hessian = np.empty(d), np.empty((d, d))
    for k in range(d):
        up, down = at(**{f"k{k}": 1}), at(**{f"k{k}": -1})
        slope[k] = 0.5 * (up - down)
        hessian[k, k] = up - 2.0 * at() + down
        for m in range(k):
            signs = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
            mixed = sum(s * at(**{f"k{k}": a, f"k{m}": b}) for a, b, s in signs)
            hessian[k, m] = hessian[m, k] = 0.25 * mixed
    return slope, hessian


def extrapolate(cost: FloatArray, axis: int, before: int, after: int) -> FloatArray:
    """Continue costs beyond a lattice: by their last parabola, or line where that bends down.

    Parameters
    ----------
    cost : ndarray
        At least three nodes along ``axis``.
    axis : int
    before, after : int
        How many nodes to add on either side.

    Returns
    -------
    ndarray
        Infinite beyond impossible nodes.
    """
    lines = np.moveaxis(cost, axis, -1)
    parts = [lines]
    if before:
        parts.insert(0, _continue(lines[..., 2::-1], before)[..., ::-1])
    if after:
        parts.append(_continue(lines[..., -3:], after))
    return np.moveaxis(np.concatenate(parts, axis=-1), -1, axis)


def _continue(three: FloatArray, count: int) -> FloatArray:
    k = np.arange(1, count + 1)
    with np.errstate(invalid="ignore"):
        slope = three[..., 2] - three[..., 1]
        bend = np.maximum(slope - (three[..., 1] - three[..., 0]), 0.0)
        values = three[..., 2:3] + slope[..., None] * k + 0.5 * bend[..., None] * k * (k + 1)
    return np.where(np.isfinite(values), values, np.inf)

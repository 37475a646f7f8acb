"""Forward mapping of a lattice: which target nodes its cells cover, and from where.

The cells of the source lattice are cut into simplices, the images of which are
simplices of the images of the corners.  A target node inside one has its pre-image
at the same barycentric coordinates.  Cells therefore leave no holes between them,
however the map stretches or turns them, and a node that several cells cover gets
several pre-images.
"""

from __future__ import annotations

from itertools import combinations, pairwise, permutations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "Cover",
    "corrected",
    "cover",
    "flat_cells",
    "live_cells",
    "orientations",
    "samples",
    "span",
    "stranded",
    "tangents",
]


#: Cells, and pairs of simplex and target node, worked on at a time.
CHUNK = 1 << 17

#: Coordinates within a simplex may exceed their range by this rounding error.
SLACK = 1e-7

#: About so many cells show the rank of a map, and so few that it is full.
SAMPLE, FEW = 256, 8

#: A cell is flat if its image is thinner than this part of its length.
FLATNESS = 1e-9


class Cover(NamedTuple):
    """Target nodes inside image simplices, and their pre-images.

    Attributes
    ----------
    node : ndarray of int, shape (p,)
        Flat index of the target node.
    position : ndarray, shape (p, s)
        Its pre-image, in steps of the source lattice.
    inverse : ndarray, shape (p, d, d)
        Change of the pre-image along ``axes`` per step of the target.
    axes : tuple of int
        The source axes that span the simplex.
    """

    node: IntArray
    position: FloatArray
    inverse: FloatArray
    axes: tuple[int, ...]


def cover(image: FloatArray, alive: BoolArray, shape: tuple[int, ...]) -> Iterator[Cover]:
    """Find the pre-images of the nodes of a target lattice, part after part.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        Images of the source nodes, in steps from the first target node; s >= d.  If
        s > d, the faces of dimension d of all cells are mapped.
    alive : ndarray of bool, shape (n_1, ..., n_s)
        Cells without any such corner are left out.
    shape : tuple of int, length d
        Shape of the target lattice.

    Yields
    ------
    Cover
    """
    sources, d = image.ndim - 1, image.shape[-1]
    for axes in combinations(range(sources), d):
        base = live_cells(alive, axes)
        for start in range(0, base.shape[0], CHUNK):
            for order in permutations(axes):
                yield from _cover_simplices(image, base[start : start + CHUNK], order, shape)


def live_cells(alive: BoolArray, axes: tuple[int, ...] | None = None) -> IntArray:
    """Lowest corners (c, s) of the cells, or faces spanned by ``axes``, that have a live corner."""
    for axis in range(alive.ndim) if axes is None else axes:
        n = alive.shape[axis]
        alive = alive.take(range(n - 1), axis=axis) | alive.take(range(1, n), axis=axis)
    return np.argwhere(alive)


def _cover_simplices(
    image: FloatArray, base: IntArray, order: tuple[int, ...], shape: tuple[int, ...]
) -> Iterator[Cover]:
    """Cover by the simplices that run from the lowest to the highest corner, axis by axis of ``order``."""
    d = len(order)
    flat = image.reshape(-1, d)
    strides = np.array([int(np.prod(image.shape[k + 1 : -1])) for k in range(image.ndim - 1)])
    index = base @ strides
    corners = [flat[index]]
    for axis in order:
        index = index + strides[axis]
        corners.append(flat[index])
    edges = np.stack([high - low for low, high in pairwise(corners)], axis=-1)
    points = np.stack(corners)
    low = np.maximum(np.ceil(points.min(axis=0) - SLACK), 0.0)
    high = np.minimum(np.floor(points.max(axis=0) + SLACK), np.array(shape) - 1.0)
    extent = np.maximum(high - low + 1.0, 0.0)
    count = extent.prod(axis=1)
    determinant = _determinant(edges)
    chosen = np.flatnonzero((count > 0) & (np.abs(determinant) > 0.0) & np.isfinite(count))
    ends = np.cumsum(count[chosen])
    begin = 0
    while begin < chosen.size:
        done = ends[begin - 1] if begin else 0.0
        end = max(begin + 1, int(np.searchsorted(ends, done + CHUNK)))
        part = chosen[begin:end]
        begin = end
        inverse = _adjugate(edges[part]) / determinant[part][:, None, None]
        owner, node = _nodes(low[part].astype(np.intp), extent[part].astype(np.intp))
        within = np.einsum("pij,pj->pi", inverse[owner], node - corners[0][part][owner])
        # Inside if 1 >= within_1 >= ... >= within_d >= 0.
        ordered = np.diff(within, axis=1, prepend=1.0, append=0.0).max(axis=1) <= SLACK
        owner, node, within = owner[ordered], node[ordered], within[ordered]
        position = base[part][owner].astype(np.float64)
        position[:, list(order)] += np.clip(within, 0.0, 1.0)
        yield Cover(np.ravel_multi_index(tuple(node.T), shape), position, inverse[owner], order)


def _nodes(low: IntArray, extent: IntArray) -> tuple[IntArray, IntArray]:
    """All nodes (p, d) of boxes of integers, and the box to which each belongs."""
    count = extent.prod(axis=1)
    owner = np.repeat(np.arange(count.size), count)
    rest = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    node = np.empty((owner.size, low.shape[1]), dtype=np.intp)
    for k in range(low.shape[1] - 1, -1, -1):
        rest, node[:, k] = np.divmod(rest, extent[owner, k])
    return owner, node + low[owner]


def _determinant(a: FloatArray) -> FloatArray:
    """Return the determinants of matrices (..., d, d) for d up to 3."""
    if a.shape[-1] == 1:
        return a[..., 0, 0]
    if a.shape[-1] == 2:
        determinant: FloatArray = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
        return determinant
    triple: FloatArray = (a[..., :, 0] * np.cross(a[..., :, 1], a[..., :, 2])).sum(axis=-1)
    return triple


def _adjugate(a: FloatArray) -> FloatArray:
    """Return the adjugates of matrices (..., d, d) for d up to 3: inverse times determinant."""
    if a.shape[-1] == 1:
        return np.ones_like(a)
    if a.shape[-1] == 2:
        result = np.empty_like(a)
        result[..., 0, 0], result[..., 1, 1] = a[..., 1, 1], a[..., 0, 0]
        result[..., 0, 1], result[..., 1, 0] = -a[..., 0, 1], -a[..., 1, 0]
        return result
    columns = [a[..., :, k] for k in range(3)]
    return np.stack([np.cross(columns[(k + 1) % 3], columns[(k + 2) % 3]) for k in range(3)], axis=-2)


def corrected(part: Cover, miss: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """One Newton step from pre-images towards the exact ones, where it is as small as it should be.

    Parameters
    ----------
    part : Cover
    miss : ndarray, shape (p, d)
        Target nodes less the images of their pre-images, in steps of the target.
    shape : tuple of int
        Of the source lattice.

    Returns
    -------
    ndarray, shape (p, s)
        Positions like those of ``part``.
    """
    axes = list(part.axes)
    change = np.einsum("pij,pj->pi", part.inverse, miss)
    moved = part.position.copy()
    moved[:, axes] += change
    with np.errstate(invalid="ignore"):
        admissible = [np.abs(change) <= 0.5, moved >= 0.0, moved <= np.array(shape) - 1.0]
    good = np.asarray(np.concatenate(admissible, axis=1).all(axis=1))
    return np.where(good[:, None], moved, part.position)


def span(image: FloatArray, live: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Bounds of the finite images of live nodes and of their neighbours, up to which cells reach.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
    live : ndarray of bool, shape (n_1, ..., n_s)

    Returns
    -------
    low, high : ndarray, shape (d,)

    Raises
    ------
    ValueError
        If there is none.
    """
    parts = [image[..., k] for k in range(image.shape[-1])]
    if not live.all():
        wide = live.copy()
        for axis in range(live.ndim):  # with the neighbours along this axis
            along, before = np.moveaxis(wide, axis, 0), np.moveaxis(wide.copy(), axis, 0)
            along[1:] |= before[:-1]
            along[:-1] |= before[1:]
        parts = [part[wide] for part in parts]
    finite = np.logical_and.reduce([np.isfinite(part) for part in parts])
    if not finite.all():
        parts = [part[finite] for part in parts]
    return np.array([part.min() for part in parts]), np.array([part.max() for part in parts])


def stranded(image: FloatArray, live: BoolArray, out: FloatArray) -> BoolArray:
    """Find the live source nodes none of whose surrounding target nodes has been drawn.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        Images of the source nodes, in steps from the first target node.
    live : ndarray of bool, shape (n_1, ..., n_s)
    out : ndarray, shape (m_1, ..., m_d)
        Costs of the target nodes, infinite where nothing has been drawn.

    Returns
    -------
    ndarray of bool, shape (n_1, ..., n_s)
    """
    drawn = np.pad(np.isfinite(out), 1)
    near = np.zeros(live.shape, dtype=bool)
    position = np.where(np.isfinite(image), image, -2.0)
    inside = ((position > -1.0) & (position < np.array(out.shape))).all(axis=-1)
    base = np.floor(np.clip(position, -1.0, np.array(out.shape) - 1.0)).astype(np.intp) + 1
    for corner in product((0, 1), repeat=out.ndim):
        near |= drawn[tuple(base[..., k] + corner[k] for k in range(out.ndim))]
    isolated: BoolArray = live & inside & ~near
    return isolated


def flat_cells(image: FloatArray, alive: BoolArray) -> IntArray:
    """Find the cells whose image has no volume; `cover` sees nothing of them.

    A map that is constant in places, or of deficient rank, has such cells.

    Returns
    -------
    ndarray of int, shape (c, s)
        Their lowest corners.
    """
    sources, d = image.ndim - 1, image.shape[-1]
    base = live_cells(alive)
    if sources < d:
        return base
    centre = tuple(base.T)
    gram = np.zeros((base.shape[0], d, d))
    for axis in range(sources):
        nearby = tuple(base[:, k] + (k == axis) for k in range(sources))
        edge = image[nearby] - image[centre]
        gram += edge[:, :, None] * edge[:, None, :]
    size = np.trace(gram, axis1=1, axis2=2)
    flat: IntArray = base[_determinant(gram) <= (FLATNESS**2) * size**d]
    return flat


def orientations(image: FloatArray) -> FloatArray:
    """Find on which side the images of the cells of a plane lie: they turn where a map folds.

    Parameters
    ----------
    image : ndarray, shape (n_1, n_2, 2)

    Returns
    -------
    ndarray, shape (2, n_1 - 1, n_2 - 1)
        Of both triangles of each cell, 1.0 or -1.0; 0.0 if the image is flat, or not finite.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        right, up = np.diff(image, axis=0), np.diff(image, axis=1)
        one = np.stack([right[:, :-1], right[:, 1:]])
        other = np.stack([up[1:], up[:-1]])
        area = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
        size = np.hypot(one[..., 0], one[..., 1]) * np.hypot(other[..., 0], other[..., 1])
        thick = (np.abs(area) > FLATNESS * size) & np.isfinite(area)
    return np.where(thick, np.sign(area), 0.0)


def tangents(image: FloatArray, alive: BoolArray) -> FloatArray:
    """Directions in which the images of cells extend, where they extend in most directions.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        Images of the source nodes, in units in which directions can be compared.
    alive : ndarray of bool, shape (n_1, ..., n_s)

    Returns
    -------
    ndarray, shape (d, r)
        Orthonormal columns; r is the rank of the map.
    """
    cells = live_cells(alive)
    for sample in (FEW, SAMPLE):
        columns = _directions(image, cells[:: max(1, cells.shape[0] // sample)])
        if columns.shape[1] == image.shape[-1]:
            break
    return columns


def _directions(image: FloatArray, base: IntArray) -> FloatArray:
    """Directions in which the images of some cells extend, where they extend in most."""
    here = image[tuple(base.T)]
    edges = [image[tuple((base + step).T)] - here for step in np.eye(base.shape[1], dtype=np.intp)]
    if not edges or not base.size:
        return np.zeros((image.shape[-1], 0))
    edge = np.stack(edges, axis=-1)
    edge = edge[np.isfinite(edge).all(axis=(1, 2))]
    directions, size, _ = np.linalg.svd(edge, full_matrices=False)
    rank = (size > FLATNESS * size.max(initial=0.0)).sum(axis=1)
    most = int(np.argmax(rank))
    columns: FloatArray = directions[most][:, : int(rank[most])]
    return columns


def samples(image: FloatArray, base: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points in the cells, so dense that their images are at most half a step apart.

    Parameters
    ----------
    image : ndarray, shape (n_1, ..., n_s, d)
        Images of the source nodes, in steps of the target.
    base : ndarray of int, shape (c, s)
        Lowest corners of the cells.

    Returns
    -------
    points : ndarray, shape (p, d)
        Images, interpolated linearly.
    position : ndarray, shape (p, s)
        In steps of the source lattice.
    """
    sources, d = base.shape[1], image.shape[-1]
    corners = list(product((0, 1), repeat=sources))
    values = np.stack([image[tuple(base[:, k] + c[k] for k in range(sources))] for c in corners])
    span = (values.max(axis=0) - values.min(axis=0)).max(initial=0.0)
    parts = max(2, int(np.ceil(2.0 * span)) + 1)
    grid = np.linspace(0.0, 1.0, parts)
    inner = np.array(list(product(grid, repeat=sources)))
    weight = np.array([np.where(c, inner, 1.0 - inner).prod(axis=1) for c in corners])
    points = np.einsum("kp,kcd->cpd", weight, values).reshape(-1, d)
    position = (base[:, None, :] + inner).reshape(-1, sources)
    return points, position

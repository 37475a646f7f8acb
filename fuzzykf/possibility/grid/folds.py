"""Folds of a plane, and what noise carries from them.

    mu'(x') = sup over x of T(mu(x), mu_W(x' - f(x)))

Where f folds (the zero of x^2, the kink of |x|) the image of a membership ends with a jump, mostly between
two nodes of the lattice on which it is drawn, and a convolution from node to node misses what lies beyond the
last one.  The cells around a fold are therefore cut into patches, and their images add to the noise from
where they are: along the axis of a noise every point of a patch that falls on a line of nodes is a source for
all targets of that line, as every state is for a scalar (`fuzzykf.possibility.grid.scalar`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter, uniform_filter

from fuzzykf.engine.selected import interpolate, orientations

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray
    from fuzzykf.engine.selected import Scale
    from fuzzykf.possibility.grid.lattice import Kernel

__all__ = ["Fold", "folded_cells"]

#: The sides of a cell at a fold are cut into so many parts, and those of a cell next to one.
PARTS, PARTS_BESIDE = 16, 2

#: Images are next to a fold if they are no further from it than so many steps.
NEXT = 2.0

#: A point is on a line of nodes if it is off by less than this, in steps.
SLACK = 1e-9

#: Pairs of source and target worked on at a time.
PAIRS = 1 << 20


def folded_cells(image: FloatArray, live: BoolArray, step: FloatArray) -> tuple[IntArray, IntArray]:
    """Find the cells at which a map of the plane turns its orientation, and those that come next to them.

    Parameters
    ----------
    image : ndarray, shape (n_1, n_2, 2)
        Of the nodes, not finite where there is none.
    live : ndarray of bool, shape (n_1, n_2)
        Cells without such a corner are left out.
    step : ndarray, shape (2,)
        Of the lattice on which the image is drawn: how near is next.

    Returns
    -------
    at, beside : ndarray of int, shape (c, 2)
        Their lowest corners.
    """
    none = np.zeros((0, 2), dtype=np.intp)
    signs = orientations(image)
    low, high = signs.min(axis=0), signs.max(axis=0)
    with np.errstate(invalid="ignore"):
        right, up = np.diff(image, axis=0) / step, np.diff(image, axis=1) / step
        centre = 0.25 * (image[1:, 1:] + image[1:, :-1] + image[:-1, 1:] + image[:-1, :-1]) / step
    turned = (minimum_filter(low, 3) < 0.0) & (maximum_filter(high, 3) > 0.0)
    if not turned.any():
        return none, none
    nearest = tuple(distance_transform_edt(~turned, return_distances=False, return_indices=True))
    normal = _normals(right[:, :-1], up[:-1])[nearest]
    with np.errstate(invalid="ignore"):
        beside = np.abs((normal * (centre - centre[nearest])).sum(axis=-1)) <= NEXT
    possible = live[1:, 1:] | live[1:, :-1] | live[:-1, 1:] | live[:-1, :-1]
    return np.argwhere(turned & possible), np.argwhere(beside & ~turned & possible)


def _normals(right: FloatArray, up: FloatArray) -> FloatArray:
    """Directions (n, m, 2) across the images of folds, in which the images of both sides cancel."""
    edges = np.nan_to_num(np.stack([right, up], axis=-1), nan=0.0, posinf=0.0, neginf=0.0)
    mean = uniform_filter(edges, size=(3, 3, 1, 1))
    return np.asarray(np.linalg.svd(mean)[0][..., :, 1])


@dataclass(frozen=True, eq=False)
class Fold:
    """The patches of the image around the folds of a map of the plane.

    Attributes
    ----------
    patches : tuple of (ndarray, ndarray)
        Images (c, p + 1, p + 1, 2) and costs (c, p + 1, p + 1) of the points into which cells are cut.
    """

    patches: tuple[tuple[FloatArray, FloatArray], ...]

    @classmethod
    def of(
        cls,
        image: FloatArray,
        live: BoolArray,
        step: FloatArray,
        cost: FloatArray,
        scale: Scale,
        mapped: Callable[[FloatArray], FloatArray],
    ) -> Fold | None:
        """Cut the cells at the folds of a map; None if there are none.

        Parameters
        ----------
        image, live, step
            See `folded_cells`.
        cost : ndarray, shape (n_1, n_2)
        scale : str
            Of the costs.
        mapped : callable
            Images (p, 2) of positions (p, 2), in steps of the lattice.
        """
        at, beside = folded_cells(image, live, step)
        if not at.size:
            return None
        patches = []
        for cells, parts in ((at, PARTS), (beside, PARTS_BESIDE)):
            inner = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, parts + 1),) * 2, indexing="ij"), axis=-1)
            position = (cells[:, None, None, :] + inner).reshape(-1, 2)
            shape = (cells.shape[0], parts + 1, parts + 1)
            found = interpolate(cost, position, scale).reshape(shape)
            patches.append((mapped(position).reshape(*shape, 2), found))
        return cls(tuple(patches))

    def spread(self, k: int, lines: FloatArray, target: FloatArray, kernel: Kernel) -> FloatArray:
        """Carry the patches along the axis of a noise.

        Parameters
        ----------
        k : {0, 1}
            Axis of the noise.
        lines : ndarray, shape (n,)
            Equidistant nodes of the other axis.
        target : ndarray, shape (m,)
            Nodes along axis ``k``.
        kernel : Kernel
            The noise.

        Returns
        -------
        ndarray, shape (m, n) for k = 0, (n, m) for k = 1
            Costs; infinite where no patch leads.
        """
        line, place, cost = self._sources(k, lines)
        out = np.full((lines.size, target.size), np.inf)
        order = np.argsort(line, kind="stable")
        line, place, cost = line[order], place[order], cost[order]
        size = max(1, PAIRS // target.size)
        for start in range(0, line.size, size):
            part = slice(start, start + size)
            noise = kernel.cost(target - place[part, None])
            noise[~(noise < kernel.t_norm.impossible)] = np.inf
            total = kernel.t_norm.combine(cost[part, None], noise)
            first = np.flatnonzero(np.diff(line[part], prepend=-1))
            rows = line[part][first]
            out[rows] = np.minimum(out[rows], np.minimum.reduceat(total, first, axis=0))
        return out.T if k == 0 else out

    def _sources(self, k: int, lines: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Where edges of the patches cross lines of nodes: number of the line, place along it, and cost."""
        step = (lines[-1] - lines[0]) / (lines.size - 1)
        pairs = []
        for place, cost in self.patches:
            values = np.stack([(place[..., 1 - k] - lines[0]) / step, place[..., k], cost])
            a, b = values[:, :, :-1], values[:, :, 1:]  # along both sides, and along a diagonal
            pairs += [(a, b), (values[..., :-1], values[..., 1:]), (a[..., :-1], b[..., 1:])]
        start, end = (
            np.concatenate([pair[side].reshape(3, -1) for pair in pairs], axis=1) for side in (0, 1)
        )
        there = np.isfinite(start).all(axis=0) & np.isfinite(end).all(axis=0)
        start, end = start[:, there], end[:, there]
        low = np.maximum(np.ceil(np.minimum(start[0], end[0]) - SLACK), 0.0)
        high = np.minimum(np.floor(np.maximum(start[0], end[0]) + SLACK), lines.size - 1.0)
        count = np.maximum(high - low + 1.0, 0.0).astype(np.intp)
        owner = np.repeat(np.arange(count.size), count)
        line = low[owner] + np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        start, change = start[:, owner], (end - start)[:, owner]
        with np.errstate(invalid="ignore", divide="ignore"):
            part = (line - start[0]) / change[0]
        part = np.clip(np.where(np.isfinite(part), part, 0.0), 0.0, 1.0)
        return line.astype(np.intp), start[1] + part * change[1], start[2] + part * change[2]

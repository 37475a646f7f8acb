# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Forward mapping of a lattice; see `fuzzykf.engine.numpy.raster`."""

from itertools import combinations, permutations

from fuzzykf.engine.compiled.arrays cimport at, axes_of, doubles, lattice, whole
from fuzzykf.engine.numpy.raster import CHUNK, Cover

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["corrected", "cover", "flat_cells", "live_cells", "span", "stranded"]

cdef extern from "src/raster.h" nogil:
    enum: FK_AXES
    enum: FK_IMAGE
    ctypedef Py_ssize_t fk_index
    ctypedef struct fk_raster:
        int s, d
        int order[FK_IMAGE]
        fk_index stride[FK_AXES]
        fk_index shape[FK_IMAGE]
        const double *image
    ctypedef struct fk_cover:
        fk_index *node
        double *position
        double *inverse
    void fk_live_corners(int, const fk_index *, const int *, unsigned char *) noexcept
    void fk_dilate(int, const fk_index *, unsigned char *) noexcept
    fk_index fk_span(int, const double *, const unsigned char *, fk_index, double *, double *) noexcept
    fk_index fk_count(const unsigned char *, fk_index) noexcept
    void fk_places(int, const fk_index *, const unsigned char *, fk_index *) noexcept
    fk_index fk_cover_simplices(
        const fk_raster *, const fk_index *, fk_index, fk_index, fk_cover, fk_index *, fk_index *
    ) noexcept
    void fk_correct(
        int, int, const int *, const fk_index *, const double *, const double *, fk_index, double *
    ) noexcept
    void fk_keep_stranded(
        int, const fk_index *, const double *, const double *, fk_index, unsigned char *
    ) noexcept
    void fk_keep_flat(int, int, const fk_index *, const double *, unsigned char *) noexcept


cdef unsigned char *bytes_of(cnp.ndarray flags) noexcept nogil:
    return <unsigned char *> cnp.PyArray_DATA(flags)


cdef cnp.ndarray flags_of(object alive):
    """Return a copy, contiguous, of an array of bool."""
    cdef cnp.ndarray flags = np.array(alive, dtype=np.bool_, order="C", copy=True)
    if not 1 <= cnp.PyArray_NDIM(flags) <= FK_AXES:
        raise ValueError(f"alive: got shape {np.shape(flags)}, expected 1 to {FK_AXES} axes")
    return flags


cdef cnp.ndarray image_for(object image, cnp.ndarray flags, int most=FK_IMAGE):
    """Return images of the nodes that may be alive."""
    cdef cnp.ndarray values = lattice(image, "image")
    cdef int s = cnp.PyArray_NDIM(flags)
    if (
        cnp.PyArray_NDIM(values) != s + 1 or np.shape(values)[:s] != np.shape(flags)
        or not 1 <= values.shape[s] <= most
    ):
        raise ValueError(f"image: got shape {np.shape(values)}, expected {np.shape(flags)} and 1 to {most} components")
    return values


cdef int live_corners(cnp.ndarray flags, tuple axes, fk_index *shape) except -1:
    """Turn flags of nodes into flags of the lowest corners of cells."""
    cdef int chosen[FK_AXES]
    cdef int s = cnp.PyArray_NDIM(flags), k
    for k in range(s):
        shape[k] = flags.shape[k]
        chosen[k] = 0
    for axis in axes:
        if not 0 <= axis < s:
            raise ValueError(f"axes: got {axes}, expected numbers from 0 to {s - 1}")
        chosen[axis] = 1
    with nogil:
        fk_live_corners(s, shape, chosen, bytes_of(flags))
    return 0


cdef cnp.ndarray places_of(cnp.ndarray flags, fk_index *shape):
    """Indices (count, s) of the flags that are set."""
    cdef int s = cnp.PyArray_NDIM(flags)
    cdef Py_ssize_t size = flags.size, count
    with nogil:
        count = fk_count(bytes_of(flags), size)
    cdef cnp.ndarray places = np.empty((count, s), dtype=np.intp)
    with nogil:
        fk_places(s, shape, bytes_of(flags), whole(places))
    return places


def live_cells(alive, axes=None):
    cdef cnp.ndarray flags = flags_of(alive)
    cdef fk_index shape[FK_AXES]
    live_corners(flags, tuple(range(cnp.PyArray_NDIM(flags)) if axes is None else axes), shape)
    return places_of(flags, shape)


def flat_cells(image, alive):
    cdef cnp.ndarray flags = flags_of(alive)
    cdef fk_index shape[FK_AXES]
    cdef int s = cnp.PyArray_NDIM(flags), d
    cdef cnp.ndarray values = image_for(image, flags)
    live_corners(flags, tuple(range(s)), shape)
    d = <int> values.shape[s]
    if s >= d:
        with nogil:
            fk_keep_flat(s, d, shape, at(values), bytes_of(flags))
    return places_of(flags, shape)


def cover(image, alive, shape):
    flags = flags_of(alive)
    values = image_for(image, flags)
    sources = flags.ndim
    d = values.shape[sources]
    if len(shape) != d or not all(0 <= n < 2**31 for n in shape):
        raise ValueError(f"shape: got {shape}, expected {d} lengths")
    for axes in combinations(range(sources), d):
        base = live_cells(flags, axes)
        for start in range(0, base.shape[0], CHUNK):
            for order in permutations(axes):
                yield from _simplices(values, base[start : start + CHUNK], order, shape)


def _simplices(cnp.ndarray values, cnp.ndarray base, order, shape):
    """Cover by the simplices along the axes of ``order``, as many nodes at a time as there is room for."""
    next_, need, room = 0, 0, min(CHUNK, 2 * base.shape[0])  # most maps keep the size of cells
    while next_ < base.shape[0]:
        part, next_, need = simplices_from(values, base, order, shape, next_, max(need, room))
        room = CHUNK
        if part.node.size:
            yield part


cdef tuple simplices_from(
    cnp.ndarray values, cnp.ndarray base, tuple order, tuple shape, Py_ssize_t next_, Py_ssize_t most
):
    cdef fk_raster r
    cdef fk_cover out
    cdef fk_index need, found, n = base.shape[0]
    cdef int k
    r.s, r.d, r.image = <int> base.shape[1], <int> len(order), at(values)
    r.stride[r.s - 1] = 1
    for k in range(r.s - 1, 0, -1):
        r.stride[k - 1] = r.stride[k] * values.shape[k]
    for k in range(r.d):
        r.order[k], r.shape[k] = order[k], shape[k]
    cdef cnp.ndarray node = np.empty(most, dtype=np.intp), position = np.empty((most, r.s))
    cdef cnp.ndarray inverse = np.empty((most, r.d, r.d))
    out.node, out.position, out.inverse = whole(node), at(position), at(inverse)
    with nogil:
        found = fk_cover_simplices(&r, whole(base), n, most, out, &next_, &need)
    return Cover(node[:found], position[:found], inverse[:found], order), next_, need


def corrected(part, miss, shape):
    cdef int s = <int> len(shape), d = <int> len(part.axes), k
    cdef int order[FK_IMAGE]
    cdef fk_index lengths[FK_AXES]
    if not 1 <= d <= FK_IMAGE or not d <= s <= FK_AXES or not all(0 <= axis < s for axis in part.axes):
        raise ValueError(f"part: got axes {part.axes} of {s}, expected 1 to {FK_IMAGE} of them")
    for k in range(s):
        lengths[k] = shape[k]
    for k in range(d):
        order[k] = part.axes[k]
    cdef cnp.ndarray position = np.array(doubles(part.position, "position", (-1, s)))
    cdef Py_ssize_t n = position.shape[0]
    cdef cnp.ndarray inverse = doubles(part.inverse, "inverse", (n, d, d)), off = doubles(miss, "miss", (n, d))
    with nogil:
        fk_correct(s, d, order, lengths, at(inverse), at(off), n, at(position))
    return position


def span(image, live):
    cdef cnp.ndarray flags = flags_of(live)
    cdef cnp.ndarray values = image_for(image, flags, FK_AXES)
    cdef int s = cnp.PyArray_NDIM(flags)
    cdef int d = <int> values.shape[s]
    cdef Py_ssize_t n = flags.size, count
    cdef fk_index shape[FK_AXES]
    cdef cnp.ndarray low = np.empty(d), high = np.empty(d)
    axes_of(flags, shape)
    with nogil:
        fk_dilate(s, shape, bytes_of(flags))
        count = fk_span(d, at(values), bytes_of(flags), n, at(low), at(high))
    if not count:
        raise ValueError("live: expected a node with a finite image")
    return low, high


def stranded(image, live, out):
    cdef cnp.ndarray flags = flags_of(live), target = lattice(out, "out")
    cdef cnp.ndarray values = image_for(image, flags, FK_AXES)
    cdef int d = <int> values.shape[cnp.PyArray_NDIM(flags)]
    cdef fk_index shape[FK_AXES]
    cdef Py_ssize_t n = flags.size
    if cnp.PyArray_NDIM(target) != d:
        raise ValueError(f"out: got shape {np.shape(target)}, expected {d} axes")
    axes_of(target, shape)
    with nogil:
        fk_keep_stranded(d, shape, at(target), at(values), n, bytes_of(flags))
    return flags

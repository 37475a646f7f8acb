# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Convolution of lines of costs with a tabulated kernel; see `fuzzykf.engine.numpy.kernels`."""

from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, axes_of, doubles, integers, lattice, whole

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["convolve_bounded", "convolve_convex", "convolve_joint", "convolve_table", "is_convex", "totals"]

cdef extern from "src/search.h" nogil:
    enum: FK_ADD
    enum: FK_MULTIPLY
    enum: FK_MAXIMUM
    enum: FK_BLOCK
    enum: FK_AXES
    ctypedef Py_ssize_t fk_index
    void fk_table(int, const double *, const double *, fk_index, fk_index, fk_index, fk_index *) noexcept
    void fk_finite_range(const double *, fk_index, fk_index, fk_index, fk_index *, fk_index *) noexcept
    void fk_convex(
        const double *, const double *, fk_index, fk_index, fk_index, const fk_index *, const fk_index *,
        fk_index *, fk_index *, fk_index *
    ) noexcept
    void fk_block_least(const double *, fk_index, double *) noexcept
    void fk_bounded(
        int, const double *, const double *, const double *, const double *, fk_index, fk_index, fk_index,
        fk_index *
    ) noexcept
    void fk_totals(
        int, const double *, const double *, fk_index, fk_index, fk_index, const fk_index *, fk_index, double *
    ) noexcept
    int fk_is_convex(const double *, fk_index, fk_index, fk_index) noexcept
    void fk_joint(
        int, int, const fk_index *, const double *, const fk_index *, const double *, const fk_index *, double *
    ) noexcept


cdef int how(object combine) except -1:
    for code, ufunc in ((FK_ADD, np.add), (FK_MULTIPLY, np.multiply), (FK_MAXIMUM, np.maximum)):
        if combine is ufunc:
            return code
    raise ValueError(f"combine: got {combine!r}, expected np.add, np.multiply or np.maximum")


cdef cnp.ndarray rows_of(object table, Py_ssize_t n):
    """Return a table whose rows have no gaps, as it is if it is a view of one number a diagonal; -1 admits any n."""
    cdef cnp.ndarray rows = cnp.PyArray_FROMANY(
        table, cnp.NPY_DOUBLE, 0, 0, cnp.NPY_ARRAY_ALIGNED | cnp.NPY_ARRAY_NOTSWAPPED | cnp.NPY_ARRAY_FORCECAST
    )
    cdef Py_ssize_t size = sizeof(double)
    if cnp.PyArray_NDIM(rows) == 2 and (n == -1 or rows.shape[1] == n):
        if cnp.PyArray_STRIDE(rows, 1) == size and cnp.PyArray_STRIDE(rows, 0) % size == 0:
            return rows
    return doubles(rows, "table", (-1, n))


cdef Py_ssize_t stride_of(cnp.ndarray rows) noexcept:
    """How many numbers lead from row to row."""
    return cnp.PyArray_STRIDE(rows, 0) // <Py_ssize_t> sizeof(double)


cdef cnp.ndarray table_for(object table, cnp.ndarray lines):
    if lines.shape[1] < 1:
        raise ValueError("cost: got lines without nodes, expected at least one")
    return rows_of(table, lines.shape[1])


def convolve_table(cost, table, combine=np.add):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1)), rows = table_for(table, lines)
    cdef Py_ssize_t count = lines.shape[0], n = lines.shape[1], m = rows.shape[0], line
    cdef cnp.ndarray source = np.empty((count, m), dtype=np.intp)
    cdef int code = how(combine)
    cdef const double *costs = at(lines)
    cdef const double *entries = at(rows)
    cdef Py_ssize_t stride = stride_of(rows)
    cdef fk_index *to = whole(source)
    with nogil:
        for line in range(count):
            fk_table(code, costs + line * n, entries, stride, n, m, to + line * m)
    return source


def convolve_convex(cost, table):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1)), rows = table_for(table, lines)
    cdef Py_ssize_t count = lines.shape[0], n = lines.shape[1], m = rows.shape[0], line
    cdef cnp.ndarray source = np.empty((count, m), dtype=np.intp)
    cdef cnp.ndarray room = np.empty((4, m + 2), dtype=np.intp)
    cdef fk_index *first = whole(room)
    cdef fk_index *last = first + m + 2
    cdef const double *costs = at(lines)
    cdef const double *entries = at(rows)
    cdef Py_ssize_t stride = stride_of(rows)
    cdef fk_index *to = whole(source)
    with nogil:
        fk_finite_range(entries, stride, n, m, first, last)
        for line in range(count):
            fk_convex(
                costs + line * n, entries, stride, n, m, first, last, to + line * m, last + m + 2,
                last + 2 * (m + 2),
            )
    return source


def convolve_bounded(cost, table, combine=np.add):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1)), rows = table_for(table, lines)
    cdef Py_ssize_t count = lines.shape[0], n = lines.shape[1], m = rows.shape[0], line, row
    cdef Py_ssize_t blocks = (n + FK_BLOCK - 1) // FK_BLOCK
    cdef cnp.ndarray source = np.empty((count, m), dtype=np.intp)
    cdef Buffer bounds = Buffer((<size_t> m + 1) * blocks + n)
    cdef double *cost_least = bounds.data + m * blocks
    cdef double *nothing = cost_least + blocks  # zeros: with them, the least of the kernel alone is found
    cdef int code = how(combine)
    cdef const double *costs = at(lines)
    cdef const double *entries = at(rows)
    cdef Py_ssize_t stride = stride_of(rows)
    cdef fk_index *to = whole(source)
    with nogil:
        for row in range(m):
            fk_block_least(entries + row * stride, n, bounds.data + row * blocks)
        for line in range(count):
            if line:  # neighbouring lines are alike
                memcpy(to + line * m, to + (line - 1) * m, m * sizeof(fk_index))
            else:
                fk_table(FK_ADD, nothing, entries, stride, n, m, to)
            fk_block_least(costs + line * n, n, cost_least)
            fk_bounded(
                code, costs + line * n, cost_least, entries, bounds.data, stride, n, m, to + line * m
            )
    return source


cdef cnp.ndarray sources_for(object source, cnp.ndarray lines, cnp.ndarray rows):
    cdef cnp.ndarray s = integers(source, "source", (lines.shape[0], rows.shape[0]))
    cdef Py_ssize_t k, size = s.size, n = lines.shape[1]
    cdef const fk_index *value = whole(s)
    for k in range(size):
        if value[k] < 0 or value[k] >= n:
            raise ValueError(f"source: got {value[k]}, expected at least 0 and below {n}")
    return s


def totals(cost, table, source, Py_ssize_t shift, combine=np.add):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1)), rows = table_for(table, lines)
    cdef cnp.ndarray s = sources_for(source, lines, rows)
    cdef Py_ssize_t count = lines.shape[0], n = lines.shape[1], m = rows.shape[0], line
    cdef cnp.ndarray out = np.empty((count, m))
    cdef int code = how(combine)
    cdef const double *costs = at(lines)
    cdef const double *entries = at(rows)
    cdef Py_ssize_t stride = stride_of(rows)
    cdef const fk_index *sources = whole(s)
    cdef double *to = at(out)
    if not -n <= shift <= n:
        shift = n  # beyond all ends
    with nogil:
        for line in range(count):
            fk_totals(
                code, costs + line * n, entries, stride, n, m, sources + line * m, shift, to + line * m
            )
    return out


def is_convex(table):
    cdef cnp.ndarray rows = rows_of(table, -1)
    cdef Py_ssize_t m = rows.shape[0], n = rows.shape[1], stride = stride_of(rows)
    cdef int convex
    with nogil:
        convex = fk_is_convex(at(rows), stride, n, m)
    return convex != 0


def convolve_joint(cost, kernel, center, combine=np.add):
    cdef cnp.ndarray source = lattice(cost, "cost"), offsets = lattice(kernel, "kernel")
    cdef int d = cnp.PyArray_NDIM(source), code = how(combine), k
    cdef fk_index shape[FK_AXES]
    cdef fk_index kernel_shape[FK_AXES]
    cdef fk_index middle[FK_AXES]
    if cnp.PyArray_NDIM(offsets) != d or len(center) != d:
        raise ValueError(f"kernel, center: expected {d} axes, as cost has")
    if code == FK_MULTIPLY:
        raise ValueError("combine: got np.multiply, expected np.add or np.maximum")
    axes_of(source, shape)
    axes_of(offsets, kernel_shape)
    for k in range(d):
        middle[k] = center[k]
        if not -1000000000 <= middle[k] <= 1000000000:
            raise ValueError(f"center: got {center}, expected places in the kernel")
    cdef cnp.ndarray out = np.empty(np.shape(source))
    with nogil:
        fk_joint(code, d, shape, at(source), kernel_shape, at(offsets), middle, at(out))
    return out

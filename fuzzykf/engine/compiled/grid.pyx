# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Costs on regular lattices: interpolation, tails and moments; see `fuzzykf.engine.numpy.grid`."""

from fuzzykf.engine.compiled.arrays cimport Buffer, at, axes_of, doubles, lattice

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["continue_tails", "interpolate", "interpolate_lines", "least_outside", "moments_about", "pull_back"]

cdef extern from "src/interpolation.h" nogil:
    enum: FK_LOG
    enum: FK_RECIPROCAL
    enum: FK_COMPLEMENT
    enum: FK_AXES
    enum: FK_POSITIONS
    ctypedef Py_ssize_t fk_index
    ctypedef struct fk_lattice:
        int d, scale
        fk_index shape[FK_AXES]
        fk_index stride[FK_AXES]
        const double *cost
    void fk_interpolate(const fk_lattice *, const double *, fk_index, double *) noexcept
    void fk_interpolate_lines(
        const double *, fk_index, fk_index, const double *, fk_index, int, double *
    ) noexcept
    void fk_pull_back(
        const fk_lattice *, const double *, const double *, const fk_index *, fk_index, fk_index, double *, double *
    ) noexcept
    double fk_least_outside(const double *, const double *, fk_index, int, const double *) noexcept
    void fk_continue_tails(int, const fk_index *, double *, double) noexcept

cdef extern from "src/moments.h" nogil:
    void fk_moments(
        int, const fk_index *, const double *, const double *const *, double *, double *
    ) noexcept


cdef int code_of(object scale) except -1:
    for code, name in ((FK_LOG, "log"), (FK_RECIPROCAL, "reciprocal"), (FK_COMPLEMENT, "complement")):
        if scale == name:
            return code
    raise ValueError(f"scale: got {scale!r}, expected 'log', 'reciprocal' or 'complement'")


cdef fk_lattice lattice_of(cnp.ndarray nodes, object scale) except *:
    cdef fk_lattice g
    cdef int k
    g.d, g.scale, g.cost = cnp.PyArray_NDIM(nodes), code_of(scale), at(nodes)
    axes_of(nodes, g.shape)
    for k in range(g.d):
        g.stride[k] = cnp.PyArray_STRIDE(nodes, k) // <Py_ssize_t> sizeof(double)
        if g.shape[k] < 4:
            raise ValueError(f"cost: got shape {np.shape(nodes)}, expected at least 4 nodes along each axis")
    return g


def interpolate(cost, position, scale):
    cdef cnp.ndarray nodes = lattice(cost, "cost")
    cdef fk_lattice g = lattice_of(nodes, scale)
    cdef cnp.ndarray places = doubles(position, "position", (-1, g.d))
    cdef Py_ssize_t n = places.shape[0]
    cdef cnp.ndarray out = np.empty(n)
    with nogil:
        fk_interpolate(&g, at(places), n, at(out))
    return out


def pull_back(cost, matrix, shift, shape, scale):
    cdef cnp.ndarray nodes = lattice(cost, "cost")
    cdef fk_lattice g = lattice_of(nodes, scale)
    cdef cnp.ndarray rows = doubles(matrix, "matrix", (g.d, g.d)), start = doubles(shift, "shift", (g.d,))
    cdef cnp.ndarray out = np.empty(tuple(shape))
    cdef fk_index lengths[FK_AXES]
    cdef Py_ssize_t size = out.size, count, done = 0
    if cnp.PyArray_NDIM(out) != g.d:
        raise ValueError(f"shape: got {shape}, expected {g.d} lengths")
    axes_of(out, lengths)
    cdef Buffer position = Buffer(<size_t> min(size, <Py_ssize_t> FK_POSITIONS) * g.d)
    with nogil:
        while done < size:
            count = min(size - done, <Py_ssize_t> FK_POSITIONS)
            fk_pull_back(&g, at(rows), at(start), lengths, done, count, position.data, at(out) + done)
            done += count
    return out


def least_outside(image, cost, box):
    cdef cnp.ndarray costs = lattice(cost, "cost"), bounds = doubles(box, "box", (-1, 2))
    cdef int d = <int> bounds.shape[0]
    cdef cnp.ndarray values = doubles(image, "image", (*np.shape(costs), d))
    cdef Py_ssize_t n = costs.size
    cdef double least
    with nogil:
        least = fk_least_outside(at(values), at(costs), n, d, at(bounds))
    return least


def interpolate_lines(cost, position, scale):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1)), places = doubles(position, "position", (-1,))
    cdef Py_ssize_t count = lines.shape[0], n = lines.shape[1], m = places.shape[0]
    cdef int code = code_of(scale)
    if n < 4:
        raise ValueError(f"cost: got shape {np.shape(lines)}, expected at least 4 nodes on each line")
    cdef cnp.ndarray out = np.empty((count, m))
    with nogil:
        fk_interpolate_lines(at(lines), count, n, at(places), m, code, at(out))
    return out


def continue_tails(cost, double limit):
    cdef cnp.ndarray result = lattice(cost, "cost")
    cdef fk_index shape[FK_AXES]
    result = np.array(result)
    axes_of(result, shape)
    with nogil:
        fk_continue_tails(cnp.PyArray_NDIM(result), shape, at(result), limit)
    return result


def moments_about(mass, axes, center):
    cdef cnp.ndarray masses = lattice(mass, "mass")
    cdef int d = cnp.PyArray_NDIM(masses), k
    cdef fk_index shape[FK_AXES]
    cdef const double *deviations[FK_AXES]
    axes_of(masses, shape)
    cdef cnp.ndarray middle = doubles(center, "center", (d,)), first = np.empty(d), second = np.empty((d, d))
    if len(axes) != d or masses.size == 0:
        raise ValueError(f"mass: got shape {np.shape(masses)}, expected the lengths of {len(axes)} axes")
    # What is subtracted here is owned by the list for as long as the sums take.
    cdef list held = [doubles(axis, "axes", (shape[k],)) - middle[k] for k, axis in enumerate(axes)]
    for k in range(d):
        deviations[k] = at(held[k])
    with nogil:
        fk_moments(d, shape, at(masses), deviations, at(first), at(second))
    return first, second

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Convolution of lines of costs with a parabola; see `fuzzykf.engine.numpy.convolution`."""

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["convolve_parabola", "envelope_of_parabolas", "refine"]

cdef extern from "src/convolution.h" nogil:
    ctypedef Py_ssize_t fk_index
    ctypedef struct fk_parabolas:
        double y0, dy, x0, dx
        fk_index n, m
        double curvature
    void fk_refine_all(
        fk_index, const double *, const double *, const double *, const double *, const double *, double *
    ) noexcept
    void fk_envelope(const fk_parabolas *, const double *, fk_index *, fk_index *, double *) noexcept
    void fk_convolve_parabola(
        const fk_parabolas *, const double *, double *, fk_index *, fk_index *, double *, double *
    ) noexcept


cdef fk_parabolas parabolas(
    cnp.ndarray cost, double y0, double dy, double x0, double dx, Py_ssize_t n_targets, double curvature
) except *:
    cdef fk_parabolas p
    if n_targets < 0:
        raise ValueError(f"n_targets: got {n_targets}, expected at least 0")
    if not (dy > 0.0 and dx > 0.0 and curvature > 0.0):
        raise ValueError(f"dy, dx, curvature: got {dy}, {dx}, {curvature}, expected positive numbers")
    p.y0, p.dy, p.x0, p.dx = y0, dy, x0, dx
    p.n, p.m, p.curvature = cost.shape[1], n_targets, curvature
    return p


def convolve_parabola(
    cost, double y0, double dy, double x0, double dx, Py_ssize_t n_targets, double curvature
):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1))
    cdef fk_parabolas p = parabolas(lines, y0, dy, x0, dx, n_targets, curvature)
    cdef Py_ssize_t count = lines.shape[0], line
    cdef cnp.ndarray result = np.empty((count, n_targets))
    cdef Buffer room = Buffer(3 * <size_t> p.n + n_targets + 4)
    cdef double *slope = room.data
    cdef double *padded = slope + p.n
    cdef fk_index *vertex = <fk_index *> (padded + p.n + 4)
    cdef const double *source = at(lines)
    cdef double *to = at(result)
    with nogil:
        for line in range(count):
            fk_convolve_parabola(
                &p, source + line * p.n, to + line * p.m, vertex + p.n, vertex, slope, padded
            )
    return result


def envelope_of_parabolas(
    cost, double y0, double dy, double x0, double dx, Py_ssize_t n_targets, double curvature
):
    cdef cnp.ndarray lines = doubles(cost, "cost", (-1, -1))
    cdef fk_parabolas p = parabolas(lines, y0, dy, x0, dx, n_targets, curvature)
    cdef Py_ssize_t count = lines.shape[0], line
    cdef cnp.ndarray result = np.empty((count, n_targets), dtype=np.intp)
    cdef Buffer room = Buffer(2 * <size_t> p.n)
    cdef fk_index *vertex = <fk_index *> (room.data + p.n)
    cdef const double *source = at(lines)
    cdef fk_index *to = <fk_index *> cnp.PyArray_DATA(result)
    with nogil:
        for line in range(count):
            fk_envelope(&p, source + line * p.n, to + line * p.m, vertex, room.data)
    return result


def refine(before, left, middle, right, after):
    cdef cnp.ndarray m = doubles(middle, "middle", np.shape(middle))
    cdef tuple shape = np.shape(m)
    cdef cnp.ndarray b = doubles(before, "before", shape), l = doubles(left, "left", shape)
    cdef cnp.ndarray r = doubles(right, "right", shape), a = doubles(after, "after", shape)
    cdef cnp.ndarray result = np.empty(shape)
    cdef Py_ssize_t n = m.size
    with nogil:
        fk_refine_all(n, at(b), at(l), at(m), at(r), at(a), at(result))
    return result

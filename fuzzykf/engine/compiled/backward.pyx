# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Back along a filtered series, and the most likely path; see `fuzzykf.engine.numpy.backward`."""

from libc.stdint cimport int64_t
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport Kernel, fk_engine, fk_kernel, fk_padded, versions

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["best_path", "smooth_back"]


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


cdef int check(fk_kernel *k, Py_ssize_t n) except -1:
    if k.is_signed:
        raise ValueError("kernel: expected transitions without negative weights")
    if n > 1 and k.M1 != k.M2:
        raise ValueError(f"U: got {n} steps, expected one: the tables lead from {k.M1} nodes to {k.M2}")
    return 0


def smooth_back(Kernel kernel not None, log_p, U, after):
    cdef fk_kernel *k = &kernel.k
    cdef cnp.ndarray u = doubles(U, "U", (-1, 1 + k.w + k.q))
    cdef size_t n = u.shape[0]
    cdef cnp.ndarray p = doubles(log_p, "log_p", (n, k.M1)), after_ = doubles(after, "after", (k.M2,))
    check(k, n)
    cdef cnp.ndarray gamma = np.empty((n, k.M1))
    cdef int M = max(k.M1, k.M2)
    cdef Buffer room = Buffer(fk_padded(M) + 16 * <size_t> k.M1)
    cdef const double *from_p = at(p)
    cdef const double *from_u = at(u)
    cdef double *to = at(gamma)
    memcpy(room.data, at(after_), k.M2 * sizeof(double))
    with nogil:
        engine().smooth_back(k, n, from_p, from_u, room.data, to, room.data + fk_padded(M))
    return gamma


def best_path(Kernel kernel not None, score, U):
    cdef fk_kernel *k = &kernel.k
    cdef cnp.ndarray u = doubles(U, "U", (-1, 1 + k.w + k.q)), start = doubles(score, "score", (k.M1,))
    cdef size_t n = u.shape[0]
    check(k, n)
    cdef cnp.ndarray pointers = np.empty((n, k.M2), dtype=np.int64), end = np.empty(k.M2 if n else k.M1)
    cdef int M = max(k.M1, k.M2)
    cdef Buffer room = Buffer(4 * fk_padded(M))
    cdef const double *from_u = at(u)
    cdef int64_t *to = <int64_t *> cnp.PyArray_DATA(pointers)
    memcpy(room.data, at(start), k.M1 * sizeof(double))
    with nogil:
        engine().best_path(k, n, room.data, from_u, to, room.data + fk_padded(M))
    memcpy(at(end), room.data, end.shape[0] * sizeof(double))
    return end, pointers

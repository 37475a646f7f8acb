# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Back along a filtered series, and the most likely path; see `fuzzykf.engine.numpy.backward`."""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport Kernel, fk_engine, fk_kernel, fk_padded, versions

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["best_path", "smooth_back"]

cdef double LOG_ZERO = -1e307


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


cdef void path_step(
    int depth, int M, const double *log_pairs, const int64_t *source, double *score, double *best, int64_t *pointers
) noexcept nogil:
    """Do a step of Viterbi's recursion with these log-densities of pairs, (depth, M)."""
    cdef int s, j
    cdef double peak = -INFINITY, total
    for j in range(M):
        best[j] = -INFINITY
        pointers[j] = source[j]
    for s in range(depth):
        for j in range(M):
            total = score[source[s * M + j]] + log_pairs[s * M + j]
            if total > best[j]:
                best[j] = total
                pointers[j] = source[s * M + j]
    for j in range(M):
        peak = max(peak, best[j])
    for j in range(M):
        score[j] = max(best[j] - peak, LOG_ZERO)


def best_path(Kernel kernel not None, score, U, given=None):
    cdef fk_kernel *k = &kernel.k
    cdef cnp.ndarray u = doubles(U, "U", (-1, 1 + k.w + k.q)), start = doubles(score, "score", (k.M1,))
    cdef size_t n = u.shape[0], t = 0, stop, one, g = 0 if given is None else len(given[0]), width = 1 + k.w + k.q
    check(k, n)
    cdef cnp.ndarray pointers = np.empty((n, k.M2), dtype=np.int64), end = np.empty(k.M2 if n else k.M1)
    cdef int M = max(k.M1, k.M2)
    cdef Buffer room = Buffer(4 * fk_padded(M))
    where_, pairs_, source_ = ((), np.empty((0, 1, M)), np.zeros((1, M))) if given is None else given
    cdef cnp.ndarray where = np.ascontiguousarray(where_, dtype=np.int64), pairs = doubles(pairs_, "given", (g, -1, M))
    cdef int depth = <int> pairs.shape[1]
    cdef cnp.ndarray source = np.ascontiguousarray(source_, dtype=np.int64)
    cdef const int64_t *sources = <const int64_t *> cnp.PyArray_DATA(source)
    cdef const double *from_u = at(u)
    cdef const double *from_pairs = at(pairs)
    cdef const int64_t *steps = <const int64_t *> cnp.PyArray_DATA(where)
    cdef int64_t *to = <int64_t *> cnp.PyArray_DATA(pointers)
    if g and not (k.M1 == k.M2 and 0 <= where[0] and where[g - 1] < <int64_t> n and (np.diff(where) > 0).all()):
        raise ValueError(f"given: got {where.tolist()}, expected steps below {n} in their order")
    if g and not ((<object> source).shape == (depth, M) and 0 <= source.min() and source.max() < M):
        raise ValueError(f"given: got nodes of shape {(<object> source).shape}, expected {(depth, M)}, below {M}")
    memcpy(room.data, at(start), k.M1 * sizeof(double))
    with nogil:
        for one in range(g + 1):
            stop = <size_t> steps[one] if one < g else n
            if stop > t:
                engine().best_path(
                    k, stop - t, room.data, from_u + t * width, to + t * k.M2, room.data + fk_padded(M)
                )
            if one < g:
                path_step(
                    depth, M, from_pairs + one * depth * M, sources, room.data, room.data + fk_padded(M), to + stop * M
                )
            t = stop + 1
    memcpy(at(end), room.data, end.shape[0] * sizeof(double))
    return end, pointers

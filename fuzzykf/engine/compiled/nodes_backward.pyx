# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The smoothers of IMM and GPB2 on the nodes of a switch; see `fuzzykf.engine.numpy.nodes_backward`."""

from libc.math cimport INFINITY
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.nodes cimport (
    NodeKernel, NodeSpan, fk_nodes_back_scratch, fk_nodes_engine, nodes_versions,
)
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport fk_padded, load, store

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["smooth_nodes"]


cdef inline const fk_nodes_engine *engine() noexcept nogil:
    return nodes_versions + level


def smooth_nodes(NodeKernel kernel not None, table, ys, by_density):
    cdef int M = kernel.k.M, m = kernel.k.m, q = kernel.k.q, rows = 1 + m + m * m, j, best
    cdef bint density = by_density
    cdef cnp.ndarray tables = doubles(table, "table", (-1, rows, M))
    cdef Py_ssize_t n = tables.shape[0], t
    if n < 1:
        raise ValueError("table: got no states, expected one at least")
    cdef cnp.ndarray seen = doubles(ys, "ys", (n, q))
    cdef cnp.ndarray smoothed = np.array(tables), path = np.empty(n, dtype=np.intp)
    cdef cnp.ndarray pointers = np.zeros((n, fk_padded(M)), dtype=np.intc)
    cdef NodeSpan span = NodeSpan(kernel, 1, n)
    cdef Buffer room = Buffer(fk_padded(M) * (1 + <size_t> rows) + fk_nodes_back_scratch(M, m))
    cdef double *score = room.data
    cdef double *scratch = room.data + fk_padded(M)
    cdef double *after = span.one.table
    cdef double *now = span.two.table
    cdef double *to = span.three.table
    cdef double *known = room.data + fk_padded(M) + fk_nodes_back_scratch(M, m)
    cdef double *swap
    cdef int *next_ = <int *> cnp.PyArray_DATA(pointers)
    cdef Py_ssize_t *way = <Py_ssize_t *> cnp.PyArray_DATA(path)
    with nogil:
        span.turn_to(0, 0)
        load(after, at(tables) + (n - 1) * rows * M, rows, M)
        load(known, at(tables) + (n - 1) * rows * M, rows, M)
        memcpy(score, after, M * sizeof(double))
        for t in range(n - 2, -1, -1):
            span.turn_to(0, t + 1)
            load(now, at(tables) + t * rows * M, rows, M)
            engine().back(
                &span.k, density, now, at(seen) + (t + 1) * q, known, after, to, score, next_ + t * fk_padded(M), scratch
            )
            store(at(smoothed) + t * rows * M, to, rows, M)
            swap, after, to = after, to, after
            swap, known, now = known, now, known
        best = 0
        for j in range(M):
            if score[j] > score[best]:
                best = j
        way[0] = best
        for t in range(1, n):
            way[t] = next_[(t - 1) * fk_padded(M) + way[t - 1]]
    return smoothed, path

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Posterior of the states of a hidden Markov chain; see `fuzzykf.engine.numpy.hidden_markov`."""

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport FK_SPARSE, fk_arrows, fk_engine, fk_forward_backward_logs, versions

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["forward_backward"]


def forward_backward(first, transition, log_emission):
    cdef cnp.ndarray e = doubles(log_emission, "log_emission", (-1, -1, -1))
    cdef int T = <int> e.shape[0], M = <int> e.shape[1]
    if M < 1 or e.shape[2] != M:
        raise ValueError(f"log_emission: got shape {np.shape(e)}, expected (T, M, M)")
    cdef cnp.ndarray f_ = doubles(first, "first", (M,)), t_ = doubles(transition, "transition", (M, M))
    cdef cnp.ndarray gamma = np.empty((T + 1, M)), xi = np.empty((T, M, M)), log_likelihood = np.empty(T)
    cdef cnp.ndarray places = np.array(np.nonzero(t_), dtype=np.intc)
    cdef size_t count = places.shape[1]
    cdef Buffer scratch = Buffer(T + 3 * M + count)
    cdef fk_arrows arrows
    arrows.n, arrows.sources, arrows.to = <size_t> M * M, NULL, NULL
    if count <= FK_SPARSE * arrows.n:
        arrows.n, arrows.sources = count, <const int *> cnp.PyArray_DATA(places)
        arrows.to = arrows.sources + count
    cdef const double *start_ = at(f_)
    cdef const double *move = at(t_)
    cdef const double *emission = at(e)
    cdef double *to_gamma = at(gamma)
    cdef double *to_xi = at(xi)
    cdef double *to_values = at(log_likelihood)
    with nogil:
        if not versions[level].forward_backward(T, M, &arrows, start_, move, emission, to_gamma, to_xi, to_values, scratch.data):
            fk_forward_backward_logs(T, M, start_, move, emission, to_gamma, to_xi, to_values, scratch.data)
    return gamma, xi, log_likelihood

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""What a filter says of measured states, and its gradient; see `fuzzykf.engine.numpy.state_score`."""

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles, integers, whole

cimport numpy as cnp

import numpy as np

from fuzzykf.engine.numpy.state_score import MixtureLaw, PairMoves, ScoreGradient, check_moves

cnp.import_array()

cdef extern from "src/state_score.h" nogil:
    ctypedef struct fk_moves:
        int M, m
        size_t T, P
        const Py_ssize_t *source
        const Py_ssize_t *target
        const double *log_weight
        const double *offset
        const double *A
        const double *C
        const double *xs
    ctypedef struct fk_moves_slope:
        double *log_weight
        double *offset
        double *A
        double *C
    size_t fk_score_room(int, int, size_t)
    int fk_score_forward_any(const fk_moves *, double *, double *, double *, double *, double *)
    const double *fk_score_backward_any(
        const fk_moves *, const fk_moves_slope *, double, const double *, double *, double *, double *
    )

__all__ = ["score_gradient", "score_states"]


cdef class _Forward:
    """A series, its states and its scores."""

    cdef fk_moves k
    cdef object held
    cdef cnp.ndarray states, log_density, log_likelihood
    cdef Buffer room
    cdef int ok

    def __init__(self, nodes, moves, first, xs, cnp.ndarray share):
        cdef cnp.ndarray pairs = integers(nodes, "nodes", (2, -1)), states
        cdef list tables = [
            doubles(one, name, (-1,) * np.ndim(one))
            for name, one in zip(("log_weight", "offset", "A", "C", "xs"), (*moves, xs), strict=True)
        ]
        cdef Py_ssize_t M = len(first.log_p), m = first.mean.shape[1], T = len(xs) - 1
        self.held = (pairs, tables)
        self.k.M, self.k.m, self.k.T, self.k.P = <int> M, <int> m, T, pairs.shape[1]
        self.k.source, self.k.target = whole(pairs), whole(pairs) + pairs.shape[1]
        self.k.log_weight, self.k.offset = at(tables[0]), at(tables[1])
        self.k.A, self.k.C, self.k.xs = at(tables[2]), at(tables[3]), at(tables[4])
        self.states = states = np.empty((T + 1, M, 1 + m + m * m))
        states[0, :, 0], states[0, :, 1 : 1 + m] = first.log_p, first.mean
        states[0, :, 1 + m :] = first.covariance.reshape(M, m * m)
        self.log_density, self.log_likelihood = np.empty(T + 1), np.empty(T + 1)
        self.room = Buffer(fk_score_room(self.k.M, self.k.m, self.k.P))
        with nogil:
            self.ok = fk_score_forward_any(
                &self.k, at(self.states), at(share), at(self.log_density), at(self.log_likelihood), self.room.data
            )
        if self.ok < 0:
            raise np.linalg.LinAlgError("the covariance of a state is not positive definite")
        if not self.ok:
            self.log_density[:] = self.log_likelihood[:] = np.nan


def score_states(nodes, moves, first, xs):
    check_moves(nodes, moves, first, xs)
    cdef _Forward forward = _Forward(nodes, moves, first, xs, np.empty(moves.log_weight.shape))
    return forward.log_density, forward.log_likelihood


def score_gradient(nodes, moves, first, xs, double alpha):
    check_moves(nodes, moves, first, xs)
    by = PairMoves(*(np.zeros(np.shape(one)) for one in moves))
    cdef cnp.ndarray share = by.log_weight
    cdef _Forward forward = _Forward(nodes, moves, first, xs, share)
    if not forward.ok:
        for one in by:
            one[...] = np.nan
        nothing = MixtureLaw(*(np.full(np.shape(one), np.nan) for one in first))
        return ScoreGradient(forward.log_density, forward.log_likelihood, by, nothing)
    cdef int M = forward.k.M, m = forward.k.m
    cdef cnp.ndarray one_side = np.zeros((M, 1 + m + m * m)), other = np.zeros((M, 1 + m + m * m)), g
    cdef fk_moves_slope to
    cdef const double *last
    to.log_weight, to.offset, to.A, to.C = at(by.log_weight), at(by.offset), at(by.A), at(by.C)
    with nogil:
        last = fk_score_backward_any(
            &forward.k, &to, alpha, at(forward.states), at(one_side), at(other), forward.room.data
        )
    g = one_side if last == at(one_side) else other
    law = MixtureLaw(g[:, 0].copy(), g[:, 1 : 1 + m].copy(), g[:, 1 + m :].reshape(M, m, m).copy())
    return ScoreGradient(forward.log_density, forward.log_likelihood, by, law)

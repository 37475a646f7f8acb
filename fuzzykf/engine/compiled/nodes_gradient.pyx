# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The gradient of the log-likelihood of IMM on nodes; see `fuzzykf.engine.numpy.nodes_gradient`."""

from libc.math cimport exp, isfinite, isnan
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.nodes cimport (
    NodeKernel, NodeSpan, fk_nodes, fk_nodes_engine, fk_nodes_observe, nodes_versions,
)
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport fk_padded, fk_state, load

cimport numpy as cnp

import numpy as np

from fuzzykf.engine.numpy.nodes import NodeSpace
from fuzzykf.engine.numpy.nodes_gradient import NodeGradient, check_series, no_gradient

cnp.import_array()

cdef extern from "src/nodes_gradient.h" nogil:
    enum:
        FK_NODES_LARGEST
    ctypedef struct fk_node:
        const double *F
        const double *b
        const double *Q
        const double *H
        const double *d
        const double *R
    ctypedef struct fk_node_slope:
        double *F
        double *b
        double *Q
        double *H
        double *d
        double *R
    ctypedef struct fk_node_step:
        int n_seen
        int seen[FK_NODES_LARGEST]
        const double *y
        const double *before
        const double *after
        const double *p_before
        const double *p_after
        double *g_before
        double *g_after
        double *g_log_T
        double *scratch
    int fk_nodes_seen(int, const double *, int *)
    void fk_node_begin_back(const fk_nodes *, const fk_node *, const fk_node_slope *, const fk_node_step *)
    void fk_node_step_back(const fk_nodes *, const fk_node *, const fk_node_slope *, const fk_node_step *)

__all__ = ["node_gradient"]


cdef inline const fk_nodes_engine *engine() noexcept nogil:
    return nodes_versions + level


def node_gradient(NodeKernel kernel not None, table, ys):
    space = NodeSpace(*kernel.parameters)
    check_series(space, np.asarray(table), np.asarray(ys))
    cdef int M = kernel.k.M, m = kernel.k.m, q = kernel.k.q, rows = 1 + m + m * m, i, j
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, q)), law = doubles(table, "table", (rows, M))
    cdef Py_ssize_t n = y.shape[0]
    cdef cnp.ndarray states = np.empty((n, M, rows)), first = np.ascontiguousarray(law.T)
    cdef double total = forward(kernel, n, at(y), at(law), at(states)), p
    if not isfinite(total):
        return no_gradient(space)
    by_space = NodeSpace(*(np.zeros(np.shape(one)) for one in space))
    cdef cnp.ndarray by_law = np.zeros((M, rows)), by_T = np.zeros((M, M))
    backward(kernel, by_space, n, at(y), at(first), at(states), at(by_law), at(by_T))
    for i in range(M):  # from derivatives by logarithms
        p = exp(at(law)[i])
        at(by_law)[i * rows] = at(by_law)[i * rows] / p if p > 0.0 else 0.0
        for j in range(M):
            p = kernel.k.transition[i * fk_padded(M) + j]
            at(by_T)[i * M + j] = at(by_T)[i * M + j] / p if p > 0.0 else 0.0
    by_p, by_x, by_P = by_law[:, 0].copy(), by_law[:, 1 : 1 + m].copy(), by_law[:, 1 + m :].reshape(M, m, m)
    return NodeGradient(total, by_space, by_T, by_p, by_x, by_P)


cdef double forward(NodeKernel kernel, Py_ssize_t n, const double *y, const double *law, double *states) except? -1.0:
    """Filter a series, with the states after its observations put one node after another."""
    cdef int M = kernel.k.M, m = kernel.k.m, rows = 1 + m + m * m, ok = 1, i, r
    cdef size_t ld = fk_padded(M)
    cdef NodeSpan span = NodeSpan(kernel, 1, n)
    cdef fk_state *now = &span.one
    cdef fk_state *next_ = &span.two
    cdef double total = 0.0
    cdef Py_ssize_t t
    with nogil:
        load(now.table, law, rows, M)
        for t in range(n):
            span.turn_to(0, t)
            if t > 0:
                engine().move(&span.k, now.table, next_.table, span.scratch)
                now, next_ = next_, now
            ok = fk_nodes_observe(engine(), &span.k, y + t * kernel.k.q, now, span.scratch)
            if not ok:
                break
            total += now.total
            if isnan(total):  # no node gives it a density
                break
            for i in range(M):
                for r in range(rows):
                    states[(t * M + i) * rows + r] = now.table[r * ld + i]
    if not ok:
        raise np.linalg.LinAlgError("the covariance of an observation is not positive definite")
    return total


cdef int backward(
    NodeKernel kernel, object by_space, Py_ssize_t n, const double *y, const double *first, const double *states,
    double *by_law, double *by_log_T,
) except -1:
    """Go back from the last observation, and fill in the derivatives, those by logarithms of probabilities."""
    cdef int M = kernel.k.M, m = kernel.k.m, q = kernel.k.q, i
    cdef Py_ssize_t size = M * (1 + m + m * m), t
    cdef Buffer room = Buffer(2 * size + 4 * M)
    cdef double *p_before = room.data + 2 * size
    cdef double *p_after = p_before + M
    cdef const double *parameters[6]
    cdef double *slopes[6]
    cdef Py_ssize_t by_step[6]
    cdef cnp.ndarray one, slope
    cdef fk_node node
    cdef fk_node_slope to
    cdef fk_node_step s
    for i in range(6):
        one, slope = kernel.parameters[i], by_space[i]
        parameters[i], slopes[i] = at(one), at(slope)
        by_step[i] = one.size // one.shape[1] if one.shape[1] > 1 else 0
    s.g_after, s.g_before, s.g_log_T = room.data, room.data + size, by_log_T
    s.scratch = p_after + M
    with nogil:
        probabilities(M, size // M, states + (n - 1) * size, p_after)
        for t in range(n - 1, -1, -1):
            s.y, s.n_seen = y + t * q, fk_nodes_seen(q, y + t * q, s.seen)
            s.before, s.after = first if t == 0 else states + (t - 1) * size, states + t * size
            probabilities(M, size // M, s.before, p_before)
            s.p_before, s.p_after = p_before, p_after
            node.F, node.b = parameters[0] + t * by_step[0], parameters[1] + t * by_step[1]
            node.Q, node.H = parameters[2] + t * by_step[2], parameters[3] + t * by_step[3]
            node.d, node.R = parameters[4] + t * by_step[4], parameters[5] + t * by_step[5]
            to.F, to.b = slopes[0] + t * by_step[0], slopes[1] + t * by_step[1]
            to.Q, to.H = slopes[2] + t * by_step[2], slopes[3] + t * by_step[3]
            to.d, to.R = slopes[4] + t * by_step[4], slopes[5] + t * by_step[5]
            if t == 0:
                fk_node_begin_back(&kernel.k, &node, &to, &s)
                break
            fk_node_step_back(&kernel.k, &node, &to, &s)
            s.g_after, s.g_before = s.g_before, s.g_after
            p_after, p_before = p_before, p_after
        memcpy(by_law, s.g_after, size * sizeof(double))


cdef inline void probabilities(int M, Py_ssize_t size, const double *states, double *p) noexcept nogil:
    """From the logarithms that states of ``size`` numbers begin with."""
    cdef int i
    for i in range(M):
        p[i] = exp(states[i * size])

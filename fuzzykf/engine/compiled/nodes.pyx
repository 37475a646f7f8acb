# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""IMM and GPB2 on the nodes of a switch; see `fuzzykf.engine.numpy.nodes`."""

from libc.math cimport NAN, exp, isnan
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    fk_engine, fk_output, fk_padded, fk_room, fk_summarise, fk_summary, fk_table_size, load, outputs, rank, store,
    versions,
)

cimport numpy as cnp

import numpy as np

cnp.import_array()

cdef extern from "src/nodes_engines.h" nogil:
    const fk_nodes_engine *fk_nodes_engines

nodes_versions = fk_nodes_engines

__all__ = ["NodeKernel", "before_node_step", "filter_nodes", "first_node_step", "node_step", "pack_nodes"]

#: Most states, and most components of an observation, that are covered here.
LARGEST = FK_NODES_LARGEST

cdef double LOG_ZERO = -1e307


cdef inline const fk_nodes_engine *engine() noexcept nogil:
    return nodes_versions + level


cdef class NodeKernel:
    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        raise TypeError("the tables of the compiled core are made anew, not pickled")


def pack_nodes(space, log_transition):
    F, b, Q, H, d, R = space
    cdef int M, m, q, i, j, n, block, blocks
    if np.ndim(F) != 5 or np.ndim(H) != 5:
        raise ValueError("F, H: expected arrays of 5 axes, for series, steps, nodes and the two of a matrix")
    M, m, q = np.shape(F)[2], np.shape(F)[3], np.shape(H)[3]
    if not (M > 0 and 0 < m <= FK_NODES_LARGEST and 0 < q <= FK_NODES_LARGEST):
        raise ValueError(f"expected nodes, and 1 to {LARGEST} states and observed components, got {(M, m, q)}")
    cdef NodeKernel kernel = NodeKernel.__new__(NodeKernel)
    cdef fk_nodes *k = &kernel.k
    cdef size_t ld = fk_padded(M)
    kernel.parameters = (
        doubles(F, "F", (-1, -1, M, m, m)), doubles(b, "b", (-1, -1, M, m)), doubles(Q, "Q", (-1, -1, M, m, m)),
        doubles(H, "H", (-1, -1, M, q, m)), doubles(d, "d", (-1, -1, M, q)), doubles(R, "R", (-1, -1, M, q, q)),
    )
    k.M, k.m, k.q, blocks = M, m, q, <int> ld // 8
    cdef cnp.ndarray log_T = doubles(log_transition, "log_transition", (M, M))
    cdef cnp.ndarray T = np.exp(log_T)
    kernel.memory = Buffer((2 + 3 * <size_t> M) * ld + fk_nodes_parameters(M, m, q))
    cdef double *mask = kernel.memory.data
    cdef double *entered = mask + ld
    cdef double *to_T = entered + ld
    cdef double *to_log_T = to_T + M * ld
    cdef double *into = to_log_T + M * ld
    cdef double *to = into + M * ld
    kernel.places = Buffer(blocks + 1 + <size_t> M * blocks)  # whole numbers, in room for doubles
    cdef int *first = <int *> kernel.places.data
    cdef int *source = first + blocks + 1
    for i in range(M):
        mask[i] = 1.0
        for j in range(<int> ld):
            to_log_T[i * ld + j] = into[i * ld + j] = LOG_ZERO
            if j < M and at(log_T)[j * M + i] > 0.5 * LOG_ZERO:
                into[i * ld + j] = at(log_T)[j * M + i]
            if j < M and at(log_T)[i * M + j] > 0.5 * LOG_ZERO:
                to_log_T[i * ld + j], to_T[i * ld + j], entered[j] = at(log_T)[i * M + j], at(T)[i * M + j], 1.0
    n = 0
    for block in range(blocks):
        first[block] = n
        for i in range(M):
            for j in range(8 * block, 8 * block + 8):
                if to_log_T[i * ld + j] > 0.5 * LOG_ZERO:
                    source[n] = i
                    n += 1
                    break
        if n == first[block]:  # none leads there; something has to stand for it
            source[n] = 0
            n += 1
    first[blocks] = n
    k.first, k.source, k.mask, k.entered = first, source, mask, entered
    k.transition, k.log_transition, k.log_into = to_T, to_log_T, into
    cdef const double *spread[6]
    cdef cnp.ndarray one
    cdef int *rows = [m * m, m, m * m, q * m, q, q * q]
    for i in range(6):
        one = kernel.parameters[i]
        spread[i] = NULL
        if one.shape[0] == 1 and one.shape[1] == 1:
            fk_nodes_spread(M, rows[i], at(one), to)
            spread[i] = to
            to += rows[i] * ld
    k.F, k.b, k.Q, k.H, k.d, k.R = spread[0], spread[1], spread[2], spread[3], spread[4], spread[5]
    return kernel


cdef class NodeSpan:
    def __cinit__(self, NodeKernel kernel, Py_ssize_t s, Py_ssize_t n):
        cdef fk_nodes *k = &kernel.k
        cdef size_t table = fk_table_size(k.M, k.m), row = fk_padded(k.M), moments = fk_padded(k.m + k.m * k.m)
        self.memory = Buffer(
            3 * table + row + moments + fk_nodes_scratch(k.M, k.m) + fk_nodes_parameters(k.M, k.m, k.q)
        )
        cdef double *data = self.memory.data
        self.k = kernel.k
        self.one.table, self.two.table, self.three.table = data, data + table, data + 2 * table
        self.one.log_known = self.two.log_known = self.three.log_known = 1
        data += 3 * table
        self.p, self.x, self.scratch = data, data + row, data + row + moments
        data = self.scratch + fk_nodes_scratch(k.M, k.m)
        cdef const double **pointers = [k.F, k.b, k.Q, k.H, k.d, k.R]
        cdef int *rows = [k.m * k.m, k.m, k.m * k.m, k.q * k.m, k.q, k.q * k.q]
        cdef cnp.ndarray one
        cdef Py_ssize_t size
        cdef int i
        for i in range(6):
            one = kernel.parameters[i]
            self.rows[i] = rows[i]
            size = k.M * self.rows[i]
            self.targets[i] = NULL
            if pointers[i] != NULL:
                continue
            if one.shape[0] not in (1, s) or one.shape[1] not in (1, n):
                raise ValueError(f"parameters: got shape {np.shape(one)}, expected those of {(s, n)} series and steps")
            self.sources[i], self.targets[i] = at(one), data
            self.by_step[i] = size if one.shape[1] > 1 else 0
            self.by_series[i] = size * one.shape[1] if one.shape[0] > 1 else 0
            pointers[i] = data
            data += self.rows[i] * row
        self.k.F, self.k.b, self.k.Q = pointers[0], pointers[1], pointers[2]
        self.k.H, self.k.d, self.k.R = pointers[3], pointers[4], pointers[5]

    cdef void turn_to(self, Py_ssize_t series, Py_ssize_t step) noexcept nogil:
        """Put the parameters of a step into their places."""
        cdef int i
        for i in range(6):
            if self.targets[i] != NULL and (step == 0 or self.by_step[i]):
                fk_nodes_spread(
                    self.k.M, <int> self.rows[i],
                    self.sources[i] + series * self.by_series[i] + step * self.by_step[i], self.targets[i],
                )


def first_node_step(NodeKernel kernel not None, table, ys):
    return step_of_many(kernel, False, True, table, ys)


def node_step(NodeKernel kernel not None, every_pair, table, ys):
    return step_of_many(kernel, every_pair, False, table, ys)


cdef tuple step_of_many(NodeKernel kernel, bint every_pair, bint begins, table, ys):
    """One step of each of several series."""
    cdef int M = kernel.k.M, m = kernel.k.m, q = kernel.k.q, rows = 1 + m + m * m, ok = 1
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, q))
    cdef Py_ssize_t s = y.shape[0], a
    cdef cnp.ndarray tables = doubles(table, "table", (s, rows, M)), new = np.empty((s, rows, M)), total = np.empty(s)
    cdef NodeSpan span = NodeSpan(kernel, s, 1)
    cdef fk_state *to
    with nogil:
        for a in range(s):
            span.turn_to(a, 0)
            load(span.one.table, at(tables) + a * rows * M, rows, M)
            if begins:
                to = &span.one
                ok = fk_nodes_observe(engine(), &span.k, at(y) + a * q, to, span.scratch)
            else:
                to = &span.two
                ok = fk_nodes_advance(engine(), &span.k, every_pair, &span.one, to, at(y) + a * q, span.scratch)
            if not ok:
                break
            at(total)[a] = to.total
            store(at(new) + a * rows * M, to.table, rows, M)
    if not ok:
        raise singular()
    return new, total


cdef object singular():
    return np.linalg.LinAlgError("the covariance of an observation is not positive definite")


def before_node_step(NodeKernel kernel not None, table):
    cdef int M = kernel.k.M, m = kernel.k.m, rows = 1 + m + m * m, r, j
    cdef cnp.ndarray tables = doubles(table, "table", (-1, rows, M))
    cdef Py_ssize_t s = tables.shape[0], a
    cdef cnp.ndarray mu = np.empty((s, M)), x = np.empty((s, M, m)), P = np.empty((s, M, m, m))
    cdef NodeSpan span = NodeSpan(kernel, s, 1)
    cdef size_t ld = fk_padded(M)
    cdef double *new = span.two.table
    for a in range(s):
        span.turn_to(a, 0)
        load(span.one.table, at(tables) + a * rows * M, rows, M)
        engine().move(&span.k, span.one.table, new, span.scratch)
        for j in range(M):
            at(mu)[a * M + j] = exp(new[j])
            for r in range(m):
                at(x)[(a * M + j) * m + r] = new[(1 + r) * ld + j]
            for r in range(m * m):
                at(P)[(a * M + j) * m * m + r] = new[(1 + m + r) * ld + j]
    return mu, x, P


def filter_nodes(NodeKernel kernel not None, every_pair, table, begins, ys, dict out, tuple switch):
    cdef int M = kernel.k.M, m = kernel.k.m, q = kernel.k.q, rows = 1 + m + m * m, ok = 1, r
    cdef bint pairs = every_pair, starts = begins, prior = "x_prior" in out or "P_prior" in out
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, -1, q))
    cdef Py_ssize_t s = y.shape[0], n = y.shape[1], a, t
    if n < 1:
        raise ValueError("ys: got no observations, expected one at least")
    cdef cnp.ndarray tables = doubles(table, "table", (s, rows, M))
    cdef cnp.ndarray before = np.empty((s, rows, M)), last = np.empty((s, rows, M))
    cdef fk_output o = outputs(out, s, n, m, M)
    cdef fk_output o_prior
    cdef fk_summary summary
    cdef Buffer values = Buffer(2 * <size_t> fk_padded(M))
    cdef cnp.ndarray ranking = rank(
        &summary, M, values.data, switch[0], switch[1], switch[2], switch[3]
    )
    cdef NodeSpan span = NodeSpan(kernel, s, n)
    cdef fk_room room
    room.p, room.x = span.p, span.x
    cdef fk_state *now
    cdef fk_state *next_
    cdef fk_state *swap
    cdef const double *one
    o_prior.x, o_prior.P = o.x_prior, o.P_prior
    o_prior.mu = o_prior.modes = o_prior.means = o_prior.log_likelihood = o_prior.table = o_prior.sign = NULL
    with nogil:
        for a in range(s):
            now, next_ = &span.one, &span.two
            load(now.table, at(tables) + a * rows * M, rows, M)
            for t in range(n):
                one = at(y) + (a * n + t) * q
                span.turn_to(a, t)
                if t == n - 1:
                    store(at(before) + a * rows * M, now.table, rows, M)
                if starts and t == 0:
                    memcpy(next_.table, now.table, fk_table_size(M, m) * sizeof(double))
                    if prior:
                        fk_summarise(versions + level, &summary, next_, M, m, a * n, &o_prior, &room)
                    ok = fk_nodes_observe(engine(), &span.k, one, next_, span.scratch)
                elif not pairs:
                    engine().move(&span.k, now.table, next_.table, span.scratch)
                    if prior:
                        fk_summarise(versions + level, &summary, next_, M, m, a * n + t, &o_prior, &room)
                    ok = fk_nodes_observe(engine(), &span.k, one, next_, span.scratch)
                else:
                    if prior:
                        engine().move(&span.k, now.table, span.three.table, span.scratch)
                        fk_summarise(versions + level, &summary, &span.three, M, m, a * n + t, &o_prior, &room)
                    ok = fk_nodes_advance(engine(), &span.k, pairs, now, next_, one, span.scratch)
                if not ok:
                    break
                swap, now, next_ = now, next_, now
                fk_summarise(versions + level, &summary, now, M, m, a * n + t, &o, &room)
                if isnan(now.total):  # no node gives it a density
                    break
            if not ok:
                break
            store(at(last) + a * rows * M, now.table, rows, M)
            if isnan(now.total):
                for r in range(rows * M):
                    at(last)[a * rows * M + r] = NAN
    if not ok:
        raise singular()
    return before, last

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Steps in which something is missing; see `fuzzykf.engine.numpy.gaps`, in NumPy."""

from libc.math cimport isnan
from libc.string cimport memcpy, memset

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport fk_padded, load, store

cimport numpy as cnp

import numpy as np

from fuzzykf.engine.numpy import gaps as numpy_gaps

cnp.import_array()

cdef extern from "src/gaps_engines.h" nogil:
    const fk_gaps_engine *fk_gaps_engines

gaps_versions = fk_gaps_engines

__all__ = ["GapTables", "pack_gaps", "step_in_part"]

#: Most numbers of X, Y and the window together that are covered here.
LARGEST = FK_GAPS_LARGEST

cdef double LOG_ZERO = -1e307


cdef inline const fk_gaps_engine *engine() noexcept nogil:
    return gaps_versions + level


cdef class GapTables:
    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        raise TypeError("the tables of the compiled core are made anew, not pickled")


def pack_gaps(step, noise, M1):
    Axx, H, G, c, _, Ayy, Ny, _ = step.pairs
    cdef int depth, M2, m = np.shape(Axx)[3], q = np.shape(Ny)[2], w = np.shape(H)[3], s, j, r
    depth, M2 = np.shape(step.transition)
    cdef GapTables tables = GapTables.__new__(GapTables)
    tables.step, tables.noise = step, noise
    cdef fk_gaps *k = &tables.k
    k.M1, k.M2, k.m, k.q, k.w, k.depth, k.size = M1, M2, m, q, w, depth, fk_gap_size(m, q, w)
    k.is_sparse = step.slots is not None
    if m + q + w > LARGEST or (np.asarray(step.transition) < 0.0).any():
        raise ValueError(f"expected no negative weights and up to {LARGEST} numbers, got {m + q + w}")
    cdef int ld = fk_padded(M2)
    with np.errstate(divide="ignore"):
        logs = np.maximum(np.log(step.transition), LOG_ZERO)
    lead = (depth, M2)
    parts = [
        step.transition, logs, Ayy, Ny, H + G @ Ayy, c + (G @ Ny[..., None])[..., 0], Axx, noise,
    ]
    cdef cnp.ndarray cells = doubles(
        np.concatenate([np.reshape(part, (*lead, -1)) for part in parts], axis=-1).transpose(0, 2, 1), "step",
        (depth, k.size, M2),
    )
    tables.memory = Buffer(<size_t> depth * k.size * ld + <size_t> (q * w))
    cdef double *to = tables.memory.data
    for s in range(depth):
        for r in range(k.size):
            memcpy(to + (<size_t> s * k.size + r) * ld, at(cells) + (<size_t> s * k.size + r) * M2, M2 * sizeof(double))
            for j in range(M2, ld):  # lanes beyond hold what the last one does
                to[(<size_t> s * k.size + r) * ld + j] = at(cells)[(<size_t> s * k.size + r) * M2 + M2 - 1]
    k.cells = to
    there = np.abs(np.asarray(Ayy)) * (np.asarray(step.transition) != 0.0)[..., None, None]
    cdef cnp.ndarray sees = doubles(there.max(axis=(0, 1)), "Ayy", (q, w))
    memcpy(to + <size_t> depth * k.size * ld, at(sees), q * w * sizeof(double))
    k.sees = to + <size_t> depth * k.size * ld
    tables.places = Buffer(<size_t> depth * ld)
    cdef int *source = <int *> tables.places.data
    of = np.repeat(np.arange(depth)[:, None], M2, axis=1) if step.slots is None else step.slots.source
    cdef cnp.ndarray sources = np.array(of, dtype=np.intc)
    cdef const int *given = <const int *> cnp.PyArray_DATA(sources)
    for s in range(depth):
        for j in range(ld):
            source[s * ld + j] = given[s * M2 + (j if j < M2 else M2 - 1)]
    k.source = source
    return tables


cdef class GapRoom:
    def __cinit__(self, GapTables tables, int n):
        cdef fk_gaps *k = &tables.k
        cdef int M = max(k.M1, k.M2), most = max(n, k.depth), e = k.m + k.w + k.q, r
        cdef size_t state = fk_gap_state(M, most, e), table = <size_t> (1 + k.m + k.m * k.m) * fk_padded(M)
        cdef size_t scratch = max(fk_gap_scratch(k, most), fk_gap_prior_scratch(k))
        self.memory = Buffer(4 * state + table + scratch + fk_padded(M))
        for r in range(4):
            self.rows[r] = self.memory.data + r * state
        self.table = self.memory.data + 4 * state
        self.log_p = self.table + table
        self.scratch = self.log_p + fk_padded(M)


cdef int open_state(double *rows, object table, object root, object branches, window, int M, int m) except -1:
    """Put a state of Python into rows of branches; how many a node has."""
    cdef cnp.ndarray w_ = doubles(window, "window", (-1,))
    cdef int nu = 0, e, n, b, i, r, c, ld = fk_padded(M)
    for r in range(<int> w_.shape[0]):
        nu += isnan(at(w_)[r])
    e = m + nu
    if branches is not None:
        table, root = branches.table, branches.root
    n = np.shape(table)[1] // M
    cdef cnp.ndarray t_ = doubles(table, "table", (1 + e + e * e, n * M))
    cdef cnp.ndarray f_ = doubles(root, "root", (n * M, e, e))
    cdef Buffer T = Buffer(e * e)
    cdef const double *from_table = at(t_)
    cdef const double *from_root = at(f_)
    cdef double *to
    cdef int of
    memset(rows, 0, fk_gap_state(M, n, e) * sizeof(double))
    for b in range(n):
        to = rows + <size_t> b * fk_gap_rows(e) * ld
        for i in range(M):
            to[i] = from_table[b * M + i]
            for r in range(e):
                of = m + r if r < nu else r - nu  # u stands first
                to[(1 + r) * ld + i] = from_table[<size_t> (1 + of) * n * M + b * M + i]
                for c in range(e):
                    T.data[r * e + c] = from_root[(<size_t> (b * M + i) * e + of) * e + c]
            fk_to_lower(e, T.data)
            for r in range(e * e):
                to[(1 + e + r) * ld + i] = T.data[r]
    return n


cdef tuple laid_out(const double *rows, int n, int M, int e, int nu):
    """Return rows of branches as a table (1 + e + e e, n M), no signs and roots (n M, e, e), of (X, u)."""
    cdef int b, i, r, c, s, m = e - nu, ld = fk_padded(M), of_r, of_c
    cdef Py_ssize_t k
    cdef cnp.ndarray table = np.empty((1 + e + e * e, n * M)), root = np.empty((n * M, e, e))
    cdef double *to = at(table)
    cdef double *to_root = at(root)
    cdef const double *one
    cdef double a
    for b in range(n):
        one = rows + <size_t> b * fk_gap_rows(e) * ld
        for i in range(M):
            k = b * M + i
            to[k] = one[i]
            for r in range(e):
                of_r = nu + r if r < m else r - m
                to[(1 + r) * n * M + k] = one[(1 + of_r) * ld + i]
                for c in range(e):
                    of_c = nu + c if c < m else c - m
                    to_root[(k * e + r) * e + c] = one[(1 + e + of_r * e + of_c) * ld + i]
                    a = 0.0
                    for s in range(min(of_r, of_c) + 1):
                        a += one[(1 + e + of_r * e + s) * ld + i] * one[(1 + e + of_c * e + s) * ld + i]
                    to[(1 + e + r * e + c) * n * M + k] = a
    return table, None, root


cdef tuple shown_state(
    const double *rows, int n, const double *of_x, int M, int m, const double *window, int w, GapRoom room
):
    """Return table, root and branches of a state with something unknown, whose table of X alone is ``of_x``."""
    cdef int nu = 0, e, t, ld = fk_padded(M)
    for t in range(w):
        nu += isnan(window[t])
    e = m + nu
    engine().merge(M, n, e, rows, room.rows[3], room.scratch)
    branches = None if n == 1 else numpy_gaps.Branches(*laid_out(rows, n, M, e, nu))
    table, _, root = laid_out(room.rows[3], 1, M, e, nu)
    cdef cnp.ndarray shown = np.empty((1 + m + m * m, M))
    store(at(shown), of_x, 1 + m + m * m, M)
    table[:1 + m] = shown[:1 + m]  # to the bit what a series says of them
    table[1 + e:].reshape(e, e, M)[:m, :m] = shown[1 + m:].reshape(m, m, M)
    return table, root, branches


def step_in_part(gaps, table, sign, window, root, y, after, branches=None):
    cdef GapTables tables = gaps
    cdef fk_gaps *k = &tables.k
    cdef cnp.ndarray w_ = doubles(window, "window", (k.w,)), y_ = doubles(y, "y", (k.q,)), out
    cdef cnp.ndarray after_ = doubles(after, "after", (-1,)), source
    cdef int m = k.m, rows = 1 + k.m + k.m * k.m, w_to = <int> after_.shape[0], n, n_to = 0
    cdef double value = 0.0
    if sign is not None:
        raise ValueError("sign: the tables have no negative weights")
    if branches is None:
        n = 1
    else:
        n = np.shape(branches.table)[1] // k.M1
    cdef GapRoom room = GapRoom(tables, n)
    cdef cnp.ndarray log_p = doubles(np.asarray(table)[0], "table", (k.M1,))
    if np.isnan(w_).any():
        if root is None and branches is None:
            return numpy_gaps.step_in_part(gaps, table, sign, window, root, y, after, branches)
        open_state(room.rows[0], table, root, branches, window, k.M1, m)
        memcpy(room.log_p, at(log_p), k.M1 * sizeof(double))
    else:
        source = doubles(table, "table", (rows, k.M1))
        load(room.table, at(source), rows, k.M1)
        fk_open_complete(k.M1, m, room.table, room.rows[0])
    if not engine().step(
        k, room.rows[0], n, room.log_p, at(w_), at(y_), w_to, room.table, room.rows[1], &n_to, &value, room.scratch
    ):
        return numpy_gaps.step_in_part(gaps, table, sign, window, root, y, after, branches)
    if n_to:
        return_table, return_root, left = shown_state(room.rows[1], n_to, room.table, k.M2, m, at(after_), w_to, room)
        return return_table, None, return_root, left, value
    out = np.empty((rows, k.M2))
    store(at(out), room.table, rows, k.M2)
    return out, None, None, None, value

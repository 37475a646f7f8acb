# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Whole series in which something is missing; see `fuzzykf.engine.numpy.gap_series`."""

from libc.math cimport isnan
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, at_or_null, doubles
from fuzzykf.engine.compiled.gaps cimport (
    GapRoom, GapTables, fk_gap_state, fk_gaps, fk_gaps_engine, fk_open_complete, gaps_versions, open_state,
    shown_state,
)
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    Kernel, Summary, Workspace, fk_chunk_tables, fk_chunk_weights, fk_engine, fk_filter, fk_first, fk_kernel,
    fk_load_mass, fk_output, fk_padded, fk_probabilities, fk_room, fk_state, fk_store_mass, fk_summarise,
    fk_table_size, fk_to_logs, load, outputs, store, versions,
)

cimport numpy as cnp

import numpy as np

from fuzzykf.engine.numpy.gap_series import GapState as State, first_in_part
from fuzzykf.engine.numpy.series import state_table

cnp.import_array()

__all__ = ["filter_gappy", "fit_together"]


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


cdef bint complete(const double *values, int n) noexcept nogil:
    cdef int k
    for k in range(n):
        if isnan(values[k]):
            return False
    return True


cdef void window_of(const double *y, int order, int q, double *window) noexcept nogil:
    """Lay out the observations up to ``y``, newest first."""
    cdef int lag
    for lag in range(order):
        memcpy(window + lag * q, y - lag * q, q * sizeof(double))


cdef object shown(
    const fk_state *state, const double *rows, int n, int M, int m, const double *window, int w, GapRoom room
):
    """Return a state, in logarithms."""
    cdef cnp.ndarray table
    if n:
        return State(*shown_state(rows, n, state.table, M, m, window, w, room))
    table = np.empty((1 + m + m * m, M))
    store(at(table), state.table, 1 + m + m * m, M)
    return State(table, None, None)


cdef class Firsts:
    """What is known after first observations in which something is missing, conditioned in NumPy."""

    cdef Buffer memory  # the table of X alone and the rows of each state
    cdef cnp.ndarray which  # (s,): which state is that of a series; -1 if its first observation is complete
    cdef cnp.ndarray values  # their log-likelihoods
    cdef size_t table, size

    def __cinit__(self, begin, cnp.ndarray y, int M, int m, int q):
        cdef cnp.ndarray of_x
        cdef double *to
        firsts = np.asarray(y)[:, 0]
        gone = np.isnan(firsts)
        whole = gone.all(axis=1)
        part = np.flatnonzero(gone.any(axis=1) & ~whole)
        self.which = np.full(len(firsts), -1, dtype=np.intp)
        self.which[part], self.which[whole] = np.arange(len(part)), len(part)
        self.table = fk_table_size(M, m)
        self.size = self.table + fk_gap_state(M, 1, m + q)
        states = [*firsts[part], *([np.full(q, np.nan)] if whole.any() else [])]
        self.values, self.memory = np.empty(len(states)), Buffer(max(len(states), 1) * self.size)
        for k, one in enumerate(states):
            state, self.values[k] = first_in_part(begin, one)
            of_x = doubles(state_table(state.table, m), "table", (1 + m + m * m, M))
            to = self.memory.data + <size_t> k * self.size
            load(to, at(of_x), 1 + m + m * m, M)
            open_state(to + self.table, state.table, state.root, None, one, M, m)


def fit_together(gaps, kernel):
    return isinstance(gaps, GapTables) and isinstance(kernel, Kernel)


def filter_gappy(
    gaps, kernel, Summary summary not None, begin, ys, Py_ssize_t start, Py_ssize_t stop, dict out, mass=None,
    dict kept=None
):
    cdef GapTables tables = gaps
    cdef Kernel packed = kernel
    cdef fk_kernel *k = &packed.k
    cdef fk_gaps *g = &tables.k
    cdef int M = k.M1, m = k.m, q = k.q, w = k.w, d = k.m + k.q, rows = 1 + k.m + k.m * k.m, order = k.w // k.q
    cdef int n_now = 0, n_old = -1, n_to, ld = fk_padded(k.M1), swapped, n_begin = 0
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, -1, q))
    cdef Py_ssize_t s = y.shape[0], n = y.shape[1], a, t, end, first = start + (start == 0)
    if k.is_signed or k.M2 != M or g.M1 != M or g.M2 != M or (g.m, g.q, g.w) != (m, q, w) or w % q:
        raise ValueError("gaps, kernel: expected the same tables without negative weights, as many nodes before as after")
    if not (0 <= start < stop <= n and first >= order):
        raise ValueError(f"start, stop: got {(start, stop)}, expected observations with whole windows, {n} in all")
    cdef cnp.ndarray l_ = None, mean = None, S_ = None, f_ = None, given = None, begun, known
    cdef bint is_state = isinstance(begin, State)
    cdef GapRoom gap_room
    cdef Firsts firsts
    cdef Py_ssize_t *which = NULL
    cdef double *of_firsts = NULL
    cdef double *first_values = NULL
    if start == 0:
        if w != q:
            raise ValueError("start: got 0, expected 0 with tables of order one alone")
        l_, mean = doubles(begin[0], "log_initial", (M,)), doubles(begin[1], "mean", (M, d))
        S_, f_ = doubles(begin[2], "covariance", (M, d, d)), doubles(begin[3], "factor", (M, q, q))
        firsts = Firsts(begin, y, M, m, q)
        which, of_firsts = <Py_ssize_t *> cnp.PyArray_DATA(firsts.which), firsts.memory.data
        first_values = at(firsts.values)
    elif is_state and begin.root is not None:
        if s != 1:
            raise ValueError(f"begin: got the state of one series for {s}")
        if begin.branches is not None:
            n_begin = np.shape(begin.branches.table)[1] // M
    else:
        given = doubles(np.expand_dims(begin.table, 0) if is_state else begin[0], "table", (s, rows, M))
    gap_room = GapRoom(tables, max(n_begin, 1))
    cdef cnp.ndarray before = np.empty((s, rows, M)), last = np.empty((s, rows, M)), mass_ = None
    cdef cnp.ndarray reached = np.empty(s, dtype=np.intp)
    if mass is not None:
        if not (mass.dtype == np.float64 and mass.flags.carray and mass.shape == (2, s, M)):
            raise ValueError(f"mass: expected a contiguous array of float64, shape {(2, s, M)}")
        mass_ = mass
    cdef double *to_mass = at_or_null(mass_)
    cdef Py_ssize_t *to_reached = <Py_ssize_t *> cnp.PyArray_DATA(reached)
    cdef fk_output o = outputs(out, s, n, m, M)
    cdef Workspace work = Workspace(packed)
    cdef size_t ahead = fk_chunk_tables(k) if k.is_scalar else 0, pairs = fk_chunk_weights(k) if k.is_scalar else 0
    cdef Buffer more = Buffer(ahead + pairs + 1 + w + q + q * (3 + m) + 2 * w)
    cdef double *root = more.data + ahead + pairs + 1 + w + q
    cdef double *window = root + q * (3 + m)
    cdef fk_room room
    room.p, room.x, room.scratch = work.p, work.x, work.scratch
    room.tables, room.weights, room.u = more.data, more.data + ahead, more.data + ahead + pairs
    cdef const double *one
    cdef const double *series = at(y)
    cdef const double *log_initial = at_or_null(l_)
    cdef const double *means = at_or_null(mean)
    cdef const double *covariances = at_or_null(S_)
    cdef const double *factors = at_or_null(f_)
    cdef const double *tables_before = at_or_null(given)
    cdef double *to_before = at(before)
    cdef double *to_last = at(last)
    cdef fk_state *now = &work.one
    cdef fk_state *old = &work.one
    cdef fk_state *other
    cdef double *rows_now = gap_room.rows[0]
    cdef double *rows_old = gap_room.rows[1]
    cdef double *swap
    cdef double *x
    cdef double *P
    cdef const double *one_first
    cdef Py_ssize_t end_at
    cdef double value = 0.0
    cdef bint keeps = kept is not None
    if start and given is None:
        window_of(series + (start - 1) * q, order, q, window)
        known = np.empty(w)
        memcpy(at(known), window, w * sizeof(double))
        n_begin = open_state(rows_now, begin.table, begin.root, begin.branches, known, M, m)
        begun = doubles(state_table(begin.table, m), "table", (rows, M))
        load(work.one.table, at(begun), rows, M)
    with nogil:
        for a in range(s):
            one = series + a * n * q
            now, old, n_now, n_old = &work.one, &work.two, 0, -1  # there is no old one
            end_at = stop
            if start == 0 and which[a] >= 0:
                one_first = of_firsts + which[a] * firsts.size
                memcpy(work.one.table, one_first, firsts.table * sizeof(double))
                memcpy(rows_now, one_first + firsts.table, (firsts.size - firsts.table) * sizeof(double))
                n_now = 1
                work.one.linear, work.one.log_known, work.one.total = 0, 1, first_values[which[a]]
                if isnan(work.one.total):
                    end_at = first
                fk_summarise(engine(), &summary.s, &work.one, M, m, a * n, &o, &room)
                if keeps:
                    with gil:
                        kept[0] = shown(now, rows_now, n_now, M, m, one, w, gap_room)
            elif start == 0:
                work.one.total = fk_first(
                    M, m, q, log_initial, means, covariances, factors, one, work.one.table, ld, root
                )
                work.one.linear, work.one.log_known = 0, 1
                fk_summarise(engine(), &summary.s, &work.one, M, m, a * n, &o, &room)
            else:
                work.one.linear, work.one.log_known, work.one.total = 0, 1, 0.0
                if tables_before == NULL:
                    n_now = n_begin
                else:
                    load(work.one.table, tables_before + a * rows * M, rows, M)
                    if to_mass != NULL and k.is_scalar:
                        fk_load_mass(&work.one, to_mass + (s + a) * M, M)
            t = first
            while t < end_at:
                if n_now == 0 and complete(one + t * q, q):
                    end = t + 1
                    while end < end_at and complete(one + end * q, q):
                        end += 1
                    swapped = fk_filter(
                        engine(), k, &summary.s, now, old, one + (t - 1) * q, end - t, &o, a * n + t, &room
                    )
                    if swapped:
                        other = now
                        now = old
                        old = other
                    n_old = 0
                    t = end
                    continue
                window_of(one + (t - 1) * q, order, q, window)
                if o.x_prior != NULL or o.P_prior != NULL:
                    x = o.x_prior + (a * n + t) * m if o.x_prior != NULL else room.x
                    P = o.P_prior + (a * n + t) * m * m if o.P_prior != NULL else room.x + m
                    if n_now:
                        (gaps_versions + level).prior(
                            g, rows_now, n_now, now.table, window, x, P, gap_room.scratch
                        )
                    else:
                        room.u[0] = 1.0
                        memcpy(room.u + 1, window, w * sizeof(double))
                        engine().prior(
                            k, &summary.s, fk_probabilities(engine(), now, M, room.p), now.table, room.u, x, P,
                            room.scratch,
                        )
                if n_now == 0:
                    fk_to_logs(now, M)
                    fk_open_complete(M, m, now.table, gap_room.rows[2])
                n_to = 0
                if not (gaps_versions + level).step(
                    g, rows_now if n_now else gap_room.rows[2], n_now if n_now else 1, now.table, window, one + t * q, w,
                    old.table, rows_old, &n_to, &value, gap_room.scratch
                ):
                    break
                old.linear, old.log_known, old.total = 0, 1, value
                fk_summarise(engine(), &summary.s, old, M, m, a * n + t, &o, &room)
                other = now
                now = old
                old = other
                swap = rows_now
                rows_now = rows_old
                rows_old = swap
                n_old = n_now
                n_now = n_to
                if keeps and n_now:
                    window_of(one + t * q, order, q, window)
                    with gil:
                        kept[t] = shown(now, rows_now, n_now, M, m, window, w, gap_room)
                t += 1
            to_reached[a] = t
            if n_old < 0:
                other = now
            else:
                other = old
            if to_mass != NULL:
                fk_store_mass(to_mass + a * M, other, M)
                fk_store_mass(to_mass + (s + a) * M, now, M)
            fk_to_logs(now, M)
            fk_to_logs(other, M)
            store(to_last + a * rows * M, now.table, rows, M)
            store(to_before + a * rows * M, other.table, rows, M)
    t = to_reached[s - 1]
    one = series + (s - 1) * n * q
    window_of(one + (t - 1) * q, order, q, window)
    now_shown = before_shown = shown(now, rows_now, n_now, M, m, window, w, gap_room)
    if n_old >= 0:
        if n_old:
            window_of(one + (t - 2) * q, order, q, window)
        before_shown = shown(old, rows_old, n_old, M, m, window, w, gap_room)
    return before, last, reached, (before_shown, now_shown)

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Whole series, filtered and summarised in one go; see `fuzzykf.engine.numpy.series`."""

from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, at_or_null, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    Kernel, Summary, Workspace, fk_advance, fk_chunk_tables, fk_chunk_weights, fk_engine, fk_filter, fk_first,
    fk_kernel, fk_load_mass, fk_log_likelihood, fk_output, fk_padded, fk_room, fk_state, fk_store_mass,
    fk_summarise, fk_to_logs, load, outputs, start, store, versions,
)

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["filter_series", "run", "step_many"]


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


def filter_series(
    Kernel kernel not None, Summary summary not None, tuple begin, ys, Py_ssize_t start, Py_ssize_t stop, dict out,
    mass=None,
):
    cdef fk_kernel *k = &kernel.k
    cdef int M = k.M1, m = k.m, q = k.q, d = k.m + k.q, rows = 1 + k.m + k.m * k.m, swapped
    if k.M2 != M or k.w % q:
        raise ValueError("kernel: expected as many nodes before as after")
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, -1, q))
    cdef Py_ssize_t s = y.shape[0], n = y.shape[1], a, first = start + (start == 0)
    if not (0 <= start < stop <= n and first >= (k.w // q if stop > first else 0)):
        raise ValueError(f"start, stop: got {(start, stop)}, expected observations with complete windows, {n} in all")
    cdef cnp.ndarray l_ = None, mean = None, S_ = None, f_ = None, tables = None, signs = None
    if start == 0:
        if k.is_signed or k.w != q:
            raise ValueError("kernel: expected tables without negative weights, of order one")
        l_, mean = doubles(begin[0], "log_initial", (M,)), doubles(begin[1], "mean", (M, d))
        S_, f_ = doubles(begin[2], "covariance", (M, d, d)), doubles(begin[3], "factor", (M, q, q))
    else:
        tables = doubles(begin[0], "table", (s, rows, M))
        if k.is_signed:
            signs = doubles(np.ones((s, M)) if begin[1] is None else begin[1], "sign", (s, M))
    cdef cnp.ndarray before = np.empty((s, rows, M)), last = np.empty((s, rows, M)), mass_ = None
    if mass is not None:
        if not (mass.dtype == np.float64 and mass.flags.carray and mass.shape == (2, s, M)):
            raise ValueError(f"mass: expected a contiguous array of float64, shape {(2, s, M)}")
        mass_ = mass
    cdef double *to_mass = at_or_null(mass_)
    if "sign" in out and not k.is_signed:
        raise ValueError("sign: the tables have no negative weights")
    cdef fk_output o = outputs(out, s, n, m, M)
    cdef Workspace work = Workspace(kernel)
    cdef size_t ahead = fk_chunk_tables(k) if k.is_scalar else 0, pairs = fk_chunk_weights(k) if k.is_scalar else 0
    cdef Buffer more = Buffer(ahead + pairs + 1 + k.w + q + q * (3 + m))
    cdef double *root = more.data + ahead + pairs + 1 + k.w + q
    cdef fk_room room
    room.p, room.x, room.scratch = work.p, work.x, work.scratch
    room.tables, room.weights, room.u = more.data, more.data + ahead, more.data + ahead + pairs
    cdef const double *one
    cdef const double *log_initial = at_or_null(l_)
    cdef const double *means = at_or_null(mean)
    cdef const double *covariances = at_or_null(S_)
    cdef const double *factors = at_or_null(f_)
    cdef const double *from_tables = at_or_null(tables)
    cdef const double *from_signs = at_or_null(signs)
    cdef const double *series = at(y)
    cdef double *to_before = at(before)
    cdef double *to_last = at(last)
    cdef fk_state *now
    cdef fk_state *old
    cdef int ld = fk_padded(M)
    with nogil:
        for a in range(s):
            one = series + a * n * q
            if start == 0:
                work.one.total = fk_first(
                    M, m, q, log_initial, means, covariances, factors, one, work.one.table, ld, root
                )
                work.one.linear, work.one.log_known = 0, 1
                fk_summarise(engine(), &summary.s, &work.one, M, m, a * n, &o, &room)
            else:
                load(work.one.table, from_tables + a * rows * M, rows, M)
                work.one.linear, work.one.log_known, work.one.total = 0, 1, 0.0
                if k.is_signed:
                    memcpy(work.one.sign, from_signs + a * M, M * sizeof(double))
                if to_mass != NULL and k.is_scalar:
                    fk_load_mass(&work.one, to_mass + (s + a) * M, M)
            now = &work.one
            old = &work.one
            if stop > first:
                swapped = fk_filter(
                    engine(), k, &summary.s, &work.one, &work.two, one + (first - 1) * q, stop - first, &o,
                    a * n + first, &room
                )
                now = &work.two if swapped else &work.one
                old = &work.one if swapped else &work.two
            if to_mass != NULL:
                fk_store_mass(to_mass + a * M, old, M)
                fk_store_mass(to_mass + (s + a) * M, now, M)
            fk_to_logs(now, M)
            fk_to_logs(old, M)
            store(to_last + a * rows * M, now.table, rows, M)
            store(to_before + a * rows * M, old.table, rows, M)
    return before, last


def run(Kernel kernel not None, table, sign, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q, M2 = k.M2, rows = 1 + k.m + k.m * k.m
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t n = u.shape[0], t
    if n > 1 and k.M1 != M2:
        raise ValueError(f"table: {k.M1} nodes become {M2}, expected as many before as after")
    cdef cnp.ndarray tables = np.empty((n, rows, M2)), log_likelihood = np.empty(n)
    cdef cnp.ndarray signs = np.empty((n, M2)) if k.is_signed else None
    cdef Workspace work = Workspace(kernel)
    start(work, kernel, table, sign)
    cdef fk_state *one = &work.one
    cdef fk_state *two = &work.two
    cdef fk_state *swap
    cdef double *to = at(tables)
    cdef double *values = at(log_likelihood)
    cdef double *to_signs = at_or_null(signs)
    cdef const double *source = at(u)
    cdef fk_state copy
    with nogil:
        for t in range(n):
            fk_advance(engine(), k, one, two, source + t * width, work.scratch)
            values[t] = fk_log_likelihood(two)
            store(to + t * rows * M2, two.table, rows, M2)
            if two.linear:
                copy = two[0]
                copy.table = work.p
                memcpy(work.p, two.table, fk_padded(M2) * sizeof(double))
                fk_to_logs(&copy, M2)
                memcpy(to + t * rows * M2, work.p, M2 * sizeof(double))
            if to_signs != NULL:
                memcpy(to_signs + t * M2, two.sign, M2 * sizeof(double))
            swap = one
            one = two
            two = swap
    return tables, signs, log_likelihood


def step_many(Kernel kernel not None, table, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q, M1 = k.M1, M2 = k.M2, rows = 1 + k.m + k.m * k.m
    if k.is_signed:
        raise ValueError("kernel: expected transitions without negative weights")
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t s = u.shape[0], t
    cdef cnp.ndarray tables = doubles(table, "table", (s, rows, M1))
    cdef cnp.ndarray new = np.empty((s, rows, M2)), log_likelihood = np.empty(s)
    cdef Workspace work = Workspace(kernel)
    cdef double *to = at(new)
    cdef double *values = at(log_likelihood)
    cdef const double *state = at(tables)
    cdef const double *source = at(u)
    with nogil:
        for t in range(s):
            load(work.one.table, state + t * rows * M1, rows, M1)
            work.one.linear = 0
            fk_advance(engine(), k, &work.one, &work.two, source + t * width, work.scratch)
            values[t] = fk_log_likelihood(&work.two)
            fk_to_logs(&work.two, M2)
            store(to + t * rows * M2, work.two.table, rows, M2)
    return new, log_likelihood

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Steps of the switching recursion; see `fuzzykf.engine.numpy.switching`, in NumPy."""

from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, at_or_null, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    Kernel, Workspace, fk_advance, fk_engine, fk_first, fk_forward_backward_logs, fk_kernel, fk_log_likelihood,
    fk_padded, fk_state, fk_to_logs, load, start, store, versions,
)

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["first_step", "forward_backward", "log_pairs", "node_mean", "run", "step", "step_many"]


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


def first_step(log_initial, mean, covariance, factor, ys):
    cdef cnp.ndarray y_ = doubles(ys, "ys", (-1, -1))
    cdef int M = np.shape(log_initial)[0], q = <int> y_.shape[1], d = np.shape(mean)[1], m = d - q
    cdef int rows = 1 + m + m * m
    cdef Py_ssize_t s = y_.shape[0], a
    if M < 1 or m < 0 or q < 1:
        raise ValueError(f"expected at least one node and one observation, got {(M, m, q)}")
    cdef cnp.ndarray l_ = doubles(log_initial, "log_initial", (M,)), mean_ = doubles(mean, "mean", (M, d))
    cdef cnp.ndarray S_ = doubles(covariance, "covariance", (M, d, d)), f_ = doubles(factor, "factor", (M, q, q))
    cdef cnp.ndarray table = np.empty((s, rows, M)), log_likelihood = np.empty(s)
    cdef Buffer scratch = Buffer(q * (1 + m))
    cdef double *to = at(table)
    cdef double *values = at(log_likelihood)
    cdef const double *y = at(y_)
    for a in range(s):
        values[a] = fk_first(
            M, m, q, at(l_), at(mean_), at(S_), at(f_), y + a * q, to + a * rows * M, M, scratch.data
        )
    return table, log_likelihood


def step(Kernel kernel not None, table, sign, window, y):
    cdef fk_kernel *k = &kernel.k
    cdef int M2 = k.M2, rows = 1 + k.m + k.m * k.m
    cdef cnp.ndarray w_ = doubles(window, "window", (k.w,)), y_ = doubles(y, "y", (k.q,)), signs
    cdef Workspace work = Workspace(kernel)
    cdef Buffer u = Buffer(1 + k.w + k.q)
    start(work, kernel, table, sign)
    u.data[0] = 1.0
    memcpy(u.data + 1, at(w_), k.w * sizeof(double))
    memcpy(u.data + 1 + k.w, at(y_), k.q * sizeof(double))
    fk_advance(engine(), k, &work.one, &work.two, u.data, work.scratch)
    value = fk_log_likelihood(&work.two)
    fk_to_logs(&work.two, M2)
    cdef cnp.ndarray out = np.empty((rows, M2))
    store(at(out), work.two.table, rows, M2)
    if not k.is_signed:
        return out, None, value
    signs = np.empty(M2)
    memcpy(at(signs), work.two.sign, M2 * sizeof(double))
    return out, signs, value


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


def log_pairs(Kernel kernel not None, U):
    cdef fk_kernel *k = &kernel.k
    cdef int width = 1 + k.w + k.q
    cdef cnp.ndarray u = doubles(U, "U", (-1, width))
    cdef Py_ssize_t n = u.shape[0], pairs = <Py_ssize_t> k.M1 * k.M2, t
    cdef cnp.ndarray out = np.empty((n, pairs))
    cdef double *to = at(out)
    cdef const double *source = at(u)
    with nogil:
        for t in range(n):
            engine().log_pairs(k, source + t * width, to + t * pairs)
    return out


def node_mean(p, means):
    cdef cnp.ndarray x_ = doubles(means, "means", (-1, -1))
    cdef int m = <int> x_.shape[0], M = <int> x_.shape[1], ld = fk_padded(M)
    cdef cnp.ndarray p_ = doubles(p, "p", (M,)), mean = np.empty(m)
    cdef Buffer table = Buffer(<size_t> (1 + m) * ld)
    memcpy(table.data, at(p_), M * sizeof(double))
    load(table.data + ld, at(x_), m, M)
    engine().posterior(M, m, table.data, table.data, at(mean), NULL)
    return mean


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


def forward_backward(first, transition, log_emission):
    cdef cnp.ndarray e = doubles(log_emission, "log_emission", (-1, -1, -1))
    cdef int T = <int> e.shape[0], M = <int> e.shape[1]
    if M < 1 or e.shape[2] != M:
        raise ValueError(f"log_emission: got shape {np.shape(e)}, expected (T, M, M)")
    cdef cnp.ndarray f_ = doubles(first, "first", (M,)), t_ = doubles(transition, "transition", (M, M))
    cdef cnp.ndarray gamma = np.empty((T + 1, M)), xi = np.empty((T, M, M)), log_likelihood = np.empty(T)
    cdef Buffer scratch = Buffer(T + 3 * M)
    cdef const double *start_ = at(f_)
    cdef const double *move = at(t_)
    cdef const double *emission = at(e)
    cdef double *to_gamma = at(gamma)
    cdef double *to_xi = at(xi)
    cdef double *to_values = at(log_likelihood)
    with nogil:
        if not engine().forward_backward(T, M, start_, move, emission, to_gamma, to_xi, to_values, scratch.data):
            fk_forward_backward_logs(T, M, start_, move, emission, to_gamma, to_xi, to_values, scratch.data)
    return gamma, xi, log_likelihood

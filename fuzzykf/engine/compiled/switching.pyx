# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Steps of the switching recursion; see `fuzzykf.engine.numpy.switching`, in NumPy."""

from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    Kernel, Workspace, fk_advance, fk_engine, fk_first, fk_kernel, fk_log_likelihood, fk_padded, fk_to_logs, load,
    start, store, versions,
)

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["first_step", "log_pairs", "node_mean", "step"]


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
    cdef Buffer scratch = Buffer(q * (3 + m))
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

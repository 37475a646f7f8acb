# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Whole series, filtered and summarised in one go."""

from fuzzykf.engine.compiled.arrays cimport Buffer, at, at_or_null, doubles
from fuzzykf.engine.compiled.processor cimport level
from fuzzykf.engine.compiled.tables cimport (
    Kernel, Summary, Workspace, fk_chunk_tables, fk_chunk_weights, fk_engine, fk_filter, fk_first, fk_kernel,
    fk_output, fk_padded, fk_room, fk_state, fk_summarise, fk_to_logs, store, versions,
)

cimport numpy as cnp

import numpy as np

cnp.import_array()


cdef inline const fk_engine *engine() noexcept nogil:
    return versions + level


cdef fk_output outputs(dict out, Py_ssize_t s, Py_ssize_t n, int m, int M) except *:
    """Addresses of the arrays to fill, (s, n, ...), after a check of each."""
    cdef dict shapes = {
        "x": (m,), "P": (m, m), "x_prior": (m,), "P_prior": (m, m), "mu": (M,), "switch": (),
        "switch_mean": (), "log_likelihood": (),
    }
    for name, array in out.items():
        if not (
            isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            and array.shape == (s, n, *shapes[name])
        ):
            raise ValueError(f"{name}: expected a contiguous array of float64, shape {(s, n, *shapes[name])}")
    cdef fk_output o
    o.x, o.P, o.x_prior = at_or_null(out.get("x")), at_or_null(out.get("P")), at_or_null(out.get("x_prior"))
    o.P_prior, o.mu = at_or_null(out.get("P_prior")), at_or_null(out.get("mu"))
    o.modes, o.means = at_or_null(out.get("switch")), at_or_null(out.get("switch_mean"))
    o.log_likelihood = at_or_null(out.get("log_likelihood"))
    return o


def filter_series(Kernel kernel not None, Summary summary not None, law, ys, dict out):
    """Filter complete series, one after the other, from the initial law on.

    Parameters
    ----------
    kernel : Kernel
        Constant tables of an observation that depends on the one before it; no negative weights.
    summary : Summary
    law : tuple
        log_initial, mean, covariance, factor, as in `first_step`.
    ys : ndarray, shape (s, n, q)
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in.  ``x_prior`` and ``P_prior`` of the first observation are not.

    Returns
    -------
    before, last : ndarray, shape (1 + m + m*m, M)
        The states of the last series after the last two observations.
    """
    cdef fk_kernel *k = &kernel.k
    cdef int M = k.M1, m = k.m, q = k.q, d = k.m + k.q, rows = 1 + k.m + k.m * k.m, r
    if k.is_signed or k.w != q or k.M2 != M:
        raise ValueError("kernel: expected constant tables without negative weights, of order one")
    cdef cnp.ndarray y = doubles(ys, "ys", (-1, -1, q))
    cdef Py_ssize_t s = y.shape[0], n = y.shape[1], a
    if s < 1 or n < 1:
        raise ValueError("ys: expected at least one observation")
    cdef cnp.ndarray l_ = doubles(law[0], "log_initial", (M,)), mean = doubles(law[1], "mean", (M, d))
    cdef cnp.ndarray S_ = doubles(law[2], "covariance", (M, d, d)), f_ = doubles(law[3], "factor", (M, q, q))
    cdef fk_output o = outputs(out, s, n, m, M)
    cdef Workspace work = Workspace(kernel)
    cdef size_t ahead = fk_chunk_tables(M) if k.is_scalar else 0, pairs = fk_chunk_weights(M) if k.is_scalar else 0
    cdef Buffer more = Buffer(ahead + pairs + 1 + 2 * q + q * (1 + m))
    cdef double *root = more.data + ahead + pairs + 1 + 2 * q
    cdef fk_room room
    room.p, room.x, room.scratch = work.p, work.x, work.scratch
    room.tables, room.weights, room.u = more.data, more.data + ahead, more.data + ahead + pairs
    cdef const double *one
    cdef const double *log_initial = at(l_)
    cdef const double *means = at(mean)
    cdef const double *covariances = at(S_)
    cdef const double *factors = at(f_)
    cdef const double *series = at(y)
    cdef fk_state *last = &work.one
    cdef fk_state *before = &work.two
    cdef int ld = fk_padded(M)
    with nogil:
        for a in range(s):
            one = series + a * n * q
            work.one.total = fk_first(
                M, m, q, log_initial, means, covariances, factors, one, work.one.table, ld, root
            )
            work.one.linear, work.one.log_known = 0, 1
            fk_summarise(engine(), &summary.s, &work.one, M, m, a * n, &o, &room)
            r = fk_filter(
                engine(), k, &summary.s, &work.one, &work.two, one, n - 1, &o, a * n + 1, &room
            )
        if r:
            last = &work.two
            before = &work.one
        fk_to_logs(last, M)
        fk_to_logs(before, M)
    cdef cnp.ndarray tables = np.empty((2, rows, M))
    store(at(tables), before.table, rows, M)
    store(at(tables) + rows * M, last.table, rows, M)
    return tables[0].copy(), tables[1].copy()

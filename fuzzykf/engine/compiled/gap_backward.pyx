# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Back into observations of which a part was missing; see `fuzzykf.engine.numpy.gap_backward`."""

from libc.math cimport isnan
from libc.string cimport memcpy, memset

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.gaps cimport GapTables, fk_gap_rows, fk_gap_state, fk_gaps, open_state

cimport numpy as cnp

import numpy as np

from fuzzykf.engine.numpy import gap_backward as numpy_backward

cnp.import_array()

cdef extern from "src/gap_back.h" nogil:
    ctypedef struct fk_holes:
        int nu
        int *u
    fk_holes fk_find_holes(const fk_gaps *, const double *, const double *, int, int *) noexcept
    size_t fk_told_scratch(const fk_gaps *, int, int) noexcept
    int fk_told(
        const fk_gaps *, const fk_holes *, const double *, int, const double *, const double *, const double *,
        const double *, double *, double *, double *, double *, double *
    ) noexcept
    void fk_carry(
        const fk_gaps *, const fk_holes *, const double *, const double *, const double *, const double *,
        const double *, int, int, double *, double *, double *
    ) noexcept
    void fk_tell_apart(
        const fk_gaps *, int, const double *, int, int, double, const double *, const double *, const double *,
        const double *, double *, double *, double *
    ) noexcept
    void fk_smoothed(
        const fk_gaps *, int, const double *, int, const double *, const double *, const double *, double *, double *,
        double *, double *
    ) noexcept

__all__ = ["back_into_gap"]

_Moments, _SmoothedGap = numpy_backward.Moments, numpy_backward.SmoothedGap


cdef tuple whole_window(const double *mean, const double *root, int n, const int *u, int nu, const double *window, int w):
    """Return mean (n, w) and root (n, w, nu) of whole windows, from those of what is unknown of them."""
    cdef cnp.ndarray means = np.empty((n, w)), roots = np.zeros((n, w, nu))
    cdef double *to = at(means)
    cdef double *to_root = at(roots)
    cdef int b, t, r
    for b in range(n):
        for t in range(w):
            to[b * w + t] = window[t]
        for r in range(nu):
            to[b * w + u[r]] = mean[b * nu + r]
            memcpy(to_root + (<size_t> b * w + u[r]) * nu, root + (<size_t> b * nu + r) * nu, nu * sizeof(double))
    return means, roots


cdef void node_of(const double *state, int i, int ld, int e, int nu, double *mean, double *root) noexcept nogil:
    """Copy mean (nu) and root (nu, nu) of u in node i of a state of one branch."""
    cdef int r, c
    for r in range(nu):
        mean[r] = state[(1 + r) * ld + i]
        for c in range(nu):
            root[r * nu + c] = state[(1 + e + r * e + c) * ld + i]


def back_into_gap(gaps, table, sign, window, root, y, p, told=None, branches=None, size=None):
    cdef GapTables tables = gaps
    cdef fk_gaps *k = &tables.k
    cdef int M = k.M1, m = k.m, w = k.w, n = 1, nu, e, i, w_own, w_to = k.q, r_to = 0, ld
    cdef cnp.ndarray w_ = doubles(window, "window", (w,)), y_ = doubles(y, "y", (k.q,))
    cdef cnp.ndarray given = doubles(p, "p", (k.M2 if told is None else k.depth * k.M2,)), mean_ = None, root_ = None
    w_own = w if size is None else size
    if branches is not None:
        n = np.shape(branches.table)[1] // M
    if told is not None:
        w_to, r_to = told.root.shape[1:]
        mean_ = doubles(told.mean, "told", (k.depth * k.M2, w_to))
        root_ = doubles(told.root, "told", (k.depth * k.M2, w_to, r_to))
    cdef Buffer places = Buffer(w + 2 * k.q)
    cdef fk_holes holes = fk_find_holes(k, at(w_), at(y_), w_to, <int *> places.data)
    nu, ld = holes.nu, <int> (fk_gap_state(M, 1, 0))
    e = nu + m
    if sign is not None or root is None or nu == 0 or r_to > w_to + k.q:
        return numpy_backward.back_into_gap(gaps, table, sign, window, root, y, p, told, branches, size)
    cdef size_t state = fk_gap_state(M, 1, e), rest = <size_t> n * (m + m * m) + 2 * <size_t> M * (1 + nu) * (1 + nu)
    cdef Buffer room = Buffer(
        state + fk_gap_state(M, n, e) + <size_t> n * M * (nu + nu * nu) + fk_told_scratch(k, n, nu) + rest
    )
    cdef double *nodes = room.data
    cdef double *rows = nodes + state
    cdef double *mean = rows + fk_gap_state(M, n, e)
    cdef double *roots = mean + <size_t> n * M * nu
    cdef double *scratch = roots + <size_t> n * M * nu * nu
    cdef double *of_node = scratch + M  # what is told to the branches of the nodes
    cdef double *root_of_node = of_node + M * nu
    cdef double *known = root_of_node + M * nu * nu
    cdef cnp.ndarray shares = np.empty(n * M), mu = np.empty(M), x = np.empty((M, m)), P = np.empty((M, m, m))
    cdef cnp.ndarray log_pairs = None
    open_state(nodes, table, root, None, w_, M, m)
    if branches is None:
        memcpy(rows, nodes, state * sizeof(double))
    else:
        open_state(rows, table, root, branches, w_, M, m)
    if told is None:
        log_pairs = np.empty((k.depth, k.M2))
        if not fk_told(
            k, &holes, rows, n, nodes, at(w_), at(y_), at(given), at(shares), mean, roots, at(log_pairs), scratch
        ):
            return numpy_backward.back_into_gap(gaps, table, sign, window, root, y, p, told, branches, size)
    elif branches is None:
        fk_carry(
            k, &holes, nodes, at(w_), at(given), at(mean_), at(root_), w_to, r_to, at(shares), mean, roots
        )
    else:
        fk_carry(
            k, &holes, nodes, at(w_), at(given), at(mean_), at(root_), w_to, r_to, scratch, of_node, root_of_node
        )
        for i in range(M):
            node_of(nodes, i, ld, e, nu, known, known + nu)
            fk_tell_apart(
                k, nu, rows, n, i, scratch[i], known, known + nu, of_node + i * nu, root_of_node + i * nu * nu,
                at(shares), mean, roots
            )
    fk_smoothed(k, nu, rows, n, at(shares), mean, roots, at(mu), at(x), at(P), scratch)
    left = _Moments(*whole_window(mean, roots, n * M, holes.u, nu, at(w_), w_own))
    return _SmoothedGap(shares, left, mu, x, P, log_pairs)

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Banks of Kalman filters that switch, along a whole series; see `fuzzykf.engine.numpy.imm`."""

from cpython.mem cimport PyMem_Free, PyMem_Malloc
from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport at, at_or_null, doubles
from fuzzykf.engine.compiled.kalman cimport fk_kalman_inverse, versions
from fuzzykf.engine.compiled.processor cimport level

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["filter_bank", "filter_bank_many"]


cdef inline const fk_kalman_engine *engine() noexcept nogil:
    return versions + level


cdef class Bank:
    """Filters at work, which start from the estimates and weights that they are given."""

    cdef fk_bank b
    cdef fk_kalman *filters
    cdef int n
    cdef int m
    cdef tuple owners  # of what the pointers lead to
    cdef const double *x
    cdef const double *P
    cdef const double *log_mu

    def __cinit__(self, xs, Ps, log_mu, log_M, dict model, bint every_pair):
        cdef cnp.ndarray log_M_ = doubles(log_M, "log_M", (-1, -1)), Ps_ = doubles(Ps, "Ps", (-1, -1, -1))
        cdef cnp.ndarray R = doubles(model["R"], "R", (-1, -1, -1))
        cdef int K = <int> log_M_.shape[0], n = <int> Ps_.shape[1], m = <int> R.shape[1], k
        if not (0 < n <= FK_KALMAN_LARGEST and 0 < m <= FK_KALMAN_LARGEST and K > 0):
            raise ValueError(f"Ps: got shape {np.shape(Ps)} for {m} observed components, expected fewer")
        doubles(Ps_, "Ps", (K, n, n))
        doubles(log_M_, "log_M", (K, K))
        doubles(R, "R", (K, m, m))
        cdef cnp.ndarray xs_ = doubles(xs, "xs", (K, n)), log_mu_ = doubles(log_mu, "log_mu", (K,))
        cdef cnp.ndarray F = doubles(model["F"], "F", (K, n, n)), Q = doubles(model["Q"], "Q", (K, n, n))
        cdef cnp.ndarray H = doubles(model["H"], "H", (K, m, n))
        cdef cnp.ndarray alpha_sq = doubles(np.broadcast_to(np.ravel(model["alpha_sq"]), (K,)), "alpha_sq", (K,))
        cdef size_t own = fk_bank_size(K, n, every_pair) * sizeof(double)
        cdef fk_kalman *f
        self.filters = <fk_kalman *> PyMem_Malloc(K * (sizeof(fk_kalman) + sizeof(fk_kalman *)) + own)
        if self.filters == NULL:
            raise MemoryError
        self.n, self.m, self.owners = n, m, (xs_, Ps_, log_mu_, log_M_, F, Q, H, R)
        self.x, self.P, self.log_mu = at(xs_), at(Ps_), at(log_mu_)
        self.b.modes, self.b.every_pair, self.b.f = K, every_pair, <fk_kalman **> (self.filters + K)
        for k in range(K):
            self.b.f[k] = f = self.filters + k
            f.n, f.m, f.alpha_sq = n, m, at(alpha_sq)[k]
            f.F, f.Q, f.H, f.R = at(F) + k * n * n, at(Q) + k * n * n, at(H) + k * m * n, at(R) + k * m * m
        fk_bank_place(&self.b, n, <double *> (self.b.f + K))
        self.b.log_M = at(log_M_)
        start(self)

    def __dealloc__(self):
        PyMem_Free(self.filters)


cdef void start(Bank bank) noexcept nogil:
    """Return to where every series starts."""
    cdef int K = bank.b.modes, n = bank.n, k
    memcpy(bank.b.log_mu, bank.log_mu, K * sizeof(double))
    for k in range(K):
        bank.filters[k].n_seen = 0
        bank.b.log_likelihood[k] = bank.b.own[k] = 0.0
        memcpy(bank.filters[k].x, bank.x + k * n, n * sizeof(double))
        memcpy(bank.filters[k].P, bank.P + k * n * n, n * n * sizeof(double))


cdef int read_output(Bank bank, dict out, tuple steps, fk_bank_output *o) except -1:
    """Find the arrays that are to be filled, each with the leading axes ``steps``."""
    cdef int n = bank.n
    cdef dict shapes = {
        "x": (n,), "P": (n, n), "x_prior": (n,), "P_prior": (n, n), "mu": (bank.b.modes,), "log_likelihood": (),
    }
    for name, array in out.items():
        if not (
            isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            and array.shape == (*steps, *shapes[name])
        ):
            raise ValueError(f"{name}: expected a contiguous array of float64, shape {(*steps, *shapes[name])}")
    o.x, o.P, o.x_prior = at_or_null(out.get("x")), at_or_null(out.get("P")), at_or_null(out.get("x_prior"))
    o.P_prior, o.mu = at_or_null(out.get("P_prior")), at_or_null(out.get("mu"))
    o.log_likelihood = at_or_null(out.get("log_likelihood"))
    return 0


def filter_bank(xs, Ps, log_mu, log_M, zs, dict model, bint every_pair, dict out):
    """See `fuzzykf.engine.numpy.imm.filter_bank`."""
    cdef Bank bank = Bank(xs, Ps, log_mu, log_M, model, every_pair)
    cdef cnp.ndarray zs_ = doubles(zs, "zs", (-1, bank.m))
    cdef size_t n_steps = zs_.shape[0], done
    cdef const double *observed = at(zs_)
    cdef fk_bank_output o
    cdef int became
    read_output(bank, out, (n_steps,), &o)
    with nogil:
        done = fk_bank_filter(engine(), &bank.b, observed, n_steps, &o, &became)
    if done < n_steps:
        return None
    return state_of(bank, bank.n, bank.m)


def filter_bank_many(xs, Ps, log_mu, log_M, zs, dict model, bint every_pair, dict out):
    """See `fuzzykf.engine.numpy.imm.filter_bank_many`."""
    cdef Bank bank = Bank(xs, Ps, log_mu, log_M, model, every_pair)
    cdef cnp.ndarray zs_ = doubles(zs, "zs", (-1, -1, bank.m))
    cdef size_t n_series = zs_.shape[0], n_steps = zs_.shape[1], s, done
    cdef const double *observed = at(zs_)
    cdef fk_bank_output whole, one
    cdef int became = FK_BANK_UPDATED
    cdef cnp.ndarray lost = np.zeros(n_series, dtype=np.bool_)
    cdef cnp.npy_bool *is_lost = <cnp.npy_bool *> cnp.PyArray_DATA(lost)
    read_output(bank, out, (n_series, n_steps), &whole)
    with nogil:
        for s in range(n_series):
            start(bank)
            one = fk_bank_output_from(&bank.b, &whole, s * n_steps)
            done = fk_bank_filter(engine(), &bank.b, observed + s * n_steps * bank.m, n_steps, &one, &became)
            if became == FK_BANK_SINGULAR:
                break
            if became == FK_BANK_IMPOSSIBLE:
                is_lost[s] = True
                one = fk_bank_output_from(&bank.b, &one, done)
                fk_bank_output_blank(&bank.b, &one, n_steps - done)
    if became == FK_BANK_SINGULAR:
        raise np.linalg.LinAlgError("S is not positive definite")
    return lost


cdef dict state_of(Bank bank, int n, int m):
    """All that is left of a series, by name, with a leading axis for the modes."""
    cdef int K = bank.b.modes, k
    cdef fk_kalman *f
    cdef dict shapes = {
        "xs": (n,), "Ps": (n, n), "xs_prior": (n,), "Ps_prior": (n, n), "log_mu": (), "log_cbar": (), "modes": (),
        "own": (), "y": (m,), "S": (m, m), "SI": (m, m), "K": (n, m),
    }
    cdef dict state = {name: np.empty((K, *shape)) for name, shape in shapes.items()}
    cdef double **to = [
        at(state["xs"]), at(state["Ps"]), at(state["xs_prior"]), at(state["Ps_prior"]), at(state["y"]),
        at(state["S"]), at(state["SI"]), at(state["K"]),
    ]
    memcpy(at(state["log_mu"]), bank.b.log_mu, K * sizeof(double))
    memcpy(at(state["log_cbar"]), bank.b.log_cbar, K * sizeof(double))
    memcpy(at(state["modes"]), bank.b.log_likelihood, K * sizeof(double))
    memcpy(at(state["own"]), bank.b.own, K * sizeof(double))
    for k in range(K):
        f = bank.b.f[k]
        memcpy(to[0] + k * n, f.x, n * sizeof(double))
        memcpy(to[1] + k * n * n, f.P, n * n * sizeof(double))
        memcpy(to[2] + k * n, f.x_prior, n * sizeof(double))
        memcpy(to[3] + k * n * n, f.P_prior, n * n * sizeof(double))
        if f.n_seen:
            memcpy(to[4] + k * m, f.y, m * sizeof(double))
            memcpy(to[5] + k * m * m, f.S, m * m * sizeof(double))
            fk_kalman_inverse(f, to[6] + k * m * m)
            memcpy(to[7] + k * n * m, f.K, n * m * sizeof(double))
    if bank.b.f[0].n_seen == 0:
        for name in ("y", "S", "SI", "K"):
            del state[name]
    return state

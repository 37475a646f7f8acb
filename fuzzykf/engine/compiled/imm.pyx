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

__all__ = ["filter_bank"]


cdef inline const fk_kalman_engine *engine() noexcept nogil:
    return versions + level


cdef class Bank:
    """Filters at work."""

    cdef fk_bank b
    cdef fk_kalman *filters

    def __cinit__(self, int modes):
        cdef int k
        cdef size_t size = modes * (sizeof(fk_kalman) + sizeof(fk_kalman *)) + fk_bank_size(modes) * sizeof(double)
        self.filters = <fk_kalman *> PyMem_Malloc(size)
        if self.filters == NULL:
            raise MemoryError
        self.b.modes, self.b.f = modes, <fk_kalman **> (self.filters + modes)
        fk_bank_place(&self.b, <double *> (self.b.f + modes))
        for k in range(modes):
            self.b.f[k] = self.filters + k

    def __dealloc__(self):
        PyMem_Free(self.filters)


def filter_bank(xs, Ps, log_mu, log_M, zs, dict model, dict out):
    """See `fuzzykf.engine.numpy.imm.filter_bank`."""
    cdef cnp.ndarray log_M_ = doubles(log_M, "log_M", (-1, -1)), Ps_ = doubles(Ps, "Ps", (-1, -1, -1))
    cdef cnp.ndarray R = doubles(model["R"], "R", (-1, -1, -1))
    cdef int K = <int> log_M_.shape[0], n = <int> Ps_.shape[1], m = <int> R.shape[1], k
    if not (0 < n <= FK_KALMAN_LARGEST and 0 < m <= FK_KALMAN_LARGEST and K > 0):
        raise ValueError(f"Ps: got shape {np.shape(Ps)} for {m} observed components, expected fewer")
    doubles(Ps_, "Ps", (K, n, n))
    doubles(log_M_, "log_M", (K, K))
    doubles(R, "R", (K, m, m))
    cdef cnp.ndarray xs_ = doubles(xs, "xs", (K, n)), log_mu_ = doubles(log_mu, "log_mu", (K,))
    cdef cnp.ndarray zs_ = doubles(zs, "zs", (-1, m))
    cdef cnp.ndarray F = doubles(model["F"], "F", (K, n, n)), Q = doubles(model["Q"], "Q", (K, n, n))
    cdef cnp.ndarray H = doubles(model["H"], "H", (K, m, n))
    cdef cnp.ndarray alpha_sq = doubles(np.broadcast_to(np.ravel(model["alpha_sq"]), (K,)), "alpha_sq", (K,))
    cdef size_t n_steps = zs_.shape[0], done
    cdef const double *observed = at(zs_)
    cdef Bank bank = Bank(K)
    cdef fk_kalman *f
    cdef fk_bank_output o
    cdef dict shapes = {
        "x": (n,), "P": (n, n), "x_prior": (n,), "P_prior": (n, n), "mu": (K,), "log_likelihood": (),
    }
    for name, array in out.items():
        if not (
            isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            and array.shape == (n_steps, *shapes[name])
        ):
            raise ValueError(f"{name}: expected a contiguous array of float64, shape {(n_steps, *shapes[name])}")
    o.x, o.P, o.x_prior = at_or_null(out.get("x")), at_or_null(out.get("P")), at_or_null(out.get("x_prior"))
    o.P_prior, o.mu = at_or_null(out.get("P_prior")), at_or_null(out.get("mu"))
    o.log_likelihood = at_or_null(out.get("log_likelihood"))
    bank.b.log_M = at(log_M_)
    memcpy(bank.b.log_mu, at(log_mu_), K * sizeof(double))
    for k in range(K):
        f = bank.b.f[k]
        f.n, f.m, f.n_seen, f.alpha_sq = n, m, 0, at(alpha_sq)[k]
        f.F, f.Q, f.H, f.R = at(F) + k * n * n, at(Q) + k * n * n, at(H) + k * m * n, at(R) + k * m * m
        memcpy(f.x, at(xs_) + k * n, n * sizeof(double))
        memcpy(f.P, at(Ps_) + k * n * n, n * n * sizeof(double))
        bank.b.log_likelihood[k] = 0.0
    with nogil:
        done = fk_bank_filter(engine(), &bank.b, observed, n_steps, &o)
    if done < n_steps:
        return None
    return state_of(bank, n, m)


cdef dict state_of(Bank bank, int n, int m):
    """All that is left of a series, by name, with a leading axis for the modes."""
    cdef int K = bank.b.modes, k
    cdef fk_kalman *f
    cdef dict shapes = {
        "xs": (n,), "Ps": (n, n), "xs_prior": (n,), "Ps_prior": (n, n), "log_mu": (), "log_cbar": (), "modes": (),
        "y": (m,), "S": (m, m), "SI": (m, m), "K": (n, m),
    }
    cdef dict state = {name: np.empty((K, *shape)) for name, shape in shapes.items()}
    cdef double **to = [
        at(state["xs"]), at(state["Ps"]), at(state["xs_prior"]), at(state["Ps_prior"]), at(state["y"]),
        at(state["S"]), at(state["SI"]), at(state["K"]),
    ]
    memcpy(at(state["log_mu"]), bank.b.log_mu, K * sizeof(double))
    memcpy(at(state["log_cbar"]), bank.b.log_cbar, K * sizeof(double))
    memcpy(at(state["modes"]), bank.b.log_likelihood, K * sizeof(double))
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

# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The linear Kalman filter, one step and along a whole series; see `fuzzykf.engine.numpy.kalman`."""

from libc.string cimport memcpy

from fuzzykf.engine.compiled.arrays cimport at, at_or_null, doubles
from fuzzykf.engine.compiled.processor cimport level

cimport numpy as cnp

import numpy as np

cnp.import_array()

cdef extern from "src/kalman_engines.h" nogil:
    const fk_kalman_engine *fk_kalman_engines

versions = fk_kalman_engines

__all__ = ["filter_linear", "predict_linear", "update_linear"]

#: Most states, and most components of an observation, that are covered here.
LARGEST = FK_KALMAN_LARGEST


cdef inline const fk_kalman_engine *engine() noexcept nogil:
    return versions + level


cdef tuple vector(int n, bint column):
    """Shape of a vector of n components."""
    if column:
        return (n, 1)
    return (n,)


cdef int begin(fk_kalman *f, x, P, int m) except -1:
    """Start a filter from a state; returns whether it is a column, or flat."""
    cdef int column = np.ndim(x) == 2
    cdef cnp.ndarray P_ = doubles(P, "P", (-1, -1))
    f.n, f.m = <int> P_.shape[0], m
    if not (0 < P_.shape[0] <= FK_KALMAN_LARGEST and P_.shape[1] == f.n and 0 < m <= FK_KALMAN_LARGEST):
        raise ValueError(f"P: got shape {np.shape(P)} for {m} observed components, expected at most {LARGEST}")
    cdef cnp.ndarray x_ = doubles(x, "x", vector(f.n, column))
    memcpy(f.x, at(x_), f.n * sizeof(double))
    memcpy(f.P, at(P_), f.n * f.n * sizeof(double))
    return column


cdef cnp.ndarray array_of(const double *values, int rows, int columns):
    """Copy numbers into an array, flat where there are no columns."""
    cdef cnp.npy_intp shape[2]
    shape[0], shape[1] = rows, columns
    cdef cnp.ndarray array = cnp.PyArray_SimpleNew(2 if columns else 1, shape, cnp.NPY_DOUBLE)
    memcpy(at(array), values, rows * max(columns, 1) * sizeof(double))
    return array


cdef tuple innovation_of(fk_kalman *f, int column):
    """Return y, S, S^-1 and K."""
    cdef double SI[FK_KALMAN_SQUARE]
    fk_kalman_inverse(f, SI)
    return (
        array_of(f.y, f.m, column), array_of(f.S, f.m, f.m), array_of(SI, f.m, f.m), array_of(f.K, f.n, f.m)
    )


def predict_linear(x, P, F, Q, double alpha_sq):
    """See `fuzzykf.engine.numpy.kalman.predict_linear`."""
    cdef fk_kalman f
    cdef int column = begin(&f, x, P, 1)
    cdef cnp.ndarray F_ = doubles(F, "F", (f.n, f.n)), Q_ = doubles(Q, "Q", (f.n, f.n))
    f.F, f.Q, f.alpha_sq = at(F_), at(Q_), alpha_sq
    engine().predict(&f)
    return array_of(f.x_prior, f.n, column), array_of(f.P_prior, f.n, f.n)


def update_linear(x, P, z, H, R):
    """See `fuzzykf.engine.numpy.kalman.update_linear`."""
    cdef fk_kalman f
    cdef cnp.ndarray R_ = doubles(R, "R", (-1, -1))
    cdef int column = begin(&f, x, P, <int> R_.shape[0])
    cdef cnp.ndarray H_ = doubles(H, "H", (f.m, f.n)), z_ = doubles(z, "z", vector(f.m, column))
    doubles(R_, "R", (f.m, f.m))
    f.H, f.R = at(H_), at(R_)
    memcpy(f.x_prior, f.x, f.n * sizeof(double))
    memcpy(f.P_prior, f.P, f.n * f.n * sizeof(double))
    if not engine().update(&f, at(z_)):
        raise np.linalg.LinAlgError("S is not positive definite")
    return array_of(f.x, f.n, column), array_of(f.P, f.n, f.n), *innovation_of(&f, column)


def filter_linear(x, P, zs, F, Q, H, R, double alpha_sq, controls, dict out):
    """See `fuzzykf.engine.numpy.kalman.filter_linear`."""
    cdef fk_kalman f
    cdef cnp.ndarray R_ = doubles(R, "R", (-1, -1))
    cdef int column = begin(&f, x, P, <int> R_.shape[0]), n = f.n, m = f.m
    cdef cnp.ndarray H_ = doubles(H, "H", (m, n)), zs_ = doubles(zs, "zs", (-1, m)), u = None
    cdef cnp.ndarray F_ = doubles(F, "F", (n, n)), Q_ = doubles(Q, "Q", (n, n))
    cdef size_t n_steps = zs_.shape[0], done
    cdef fk_kalman_output o
    cdef const double *control = NULL
    cdef const double *observed = at(zs_)
    cdef dict shapes = {"x": (n,), "P": (n, n), "x_prior": (n,), "P_prior": (n, n), "log_likelihood": ()}
    doubles(R_, "R", (m, m))
    if controls is not None:
        u = doubles(controls, "controls", (n_steps, n))
        control = at(u)
    for name, array in out.items():
        if not (
            isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            and array.shape == (n_steps, *shapes[name])
        ):
            raise ValueError(f"{name}: expected a contiguous array of float64, shape {(n_steps, *shapes[name])}")
    o.x, o.P, o.x_prior = at_or_null(out.get("x")), at_or_null(out.get("P")), at_or_null(out.get("x_prior"))
    o.P_prior, o.log_likelihood = at_or_null(out.get("P_prior")), at_or_null(out.get("log_likelihood"))
    f.F, f.Q, f.H, f.R, f.alpha_sq, f.n_seen = at(F_), at(Q_), at(H_), at(R_), alpha_sq, 0
    with nogil:
        done = fk_kalman_filter(engine(), &f, observed, n_steps, control, &o)
    if done < n_steps:
        raise np.linalg.LinAlgError(f"S is not positive definite at step {done}")
    return innovation_of(&f, column) if f.n_seen else None

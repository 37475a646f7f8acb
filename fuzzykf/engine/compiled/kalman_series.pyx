# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""The linear Kalman filter along many series side by side; see `fuzzykf.engine.numpy.kalman_series`."""

from libc.stdlib cimport free, malloc

from fuzzykf.engine.compiled.arrays cimport Buffer, at, doubles
from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, fk_kalman_engine, versions
from fuzzykf.engine.compiled.processor cimport level

cimport numpy as cnp

import numpy as np

cnp.import_array()

cdef extern from "src/kalman_lanes_engines.h" nogil:
    ctypedef struct fk_linear:
        int n, m
        const double *F
        const double *Q
        const double *H
        const double *R
        size_t F_stride, Q_stride, H_stride, R_stride
        double alpha_sq
    ctypedef struct fk_many_output:
        void *x
        void *P
        void *x_prior
        void *P_prior
        void *log_likelihood
        int is_single
    ctypedef struct fk_many:
        fk_linear model
        const double *z
        const double *u
        const double *x
        const double *P
        size_t count, n_steps, u_stride
        fk_many_output out
    ctypedef struct fk_lanes_engine:
        pass
    const fk_lanes_engine *fk_lanes_engines
    size_t fk_many_room(const fk_linear *, size_t) noexcept
    size_t fk_many_filter(
        const fk_lanes_engine *, const fk_kalman_engine *, const fk_many *, double *, size_t *
    ) noexcept

__all__ = ["filter_linear_many"]


cdef cnp.ndarray matrices(object value, str name, int rows, int columns, Py_ssize_t steps, size_t *stride):
    """Return a matrix, or one for each step; writes how far they are apart."""
    cdef cnp.ndarray array
    stride[0] = 0
    if np.ndim(value) != 3:
        return doubles(value, name, (rows, columns))
    array = doubles(value, name, (-1, rows, columns))
    if array.shape[0] < steps:
        raise ValueError(f"{name}: got {array.shape[0]} matrices, expected one for each of the {steps} steps")
    stride[0] = rows * columns
    return array


cdef void *place(dict out, str name, tuple shape, object dtype) except? NULL:
    """Return where a field goes; NULL if it is not wanted."""
    array = out.get(name)
    if array is None:
        return NULL
    if not (isinstance(array, np.ndarray) and array.dtype == dtype and array.flags.carray and array.shape == shape):
        raise ValueError(f"{name}: expected a contiguous array of {dtype}, shape {shape}")
    return cnp.PyArray_DATA(<cnp.ndarray> array)


def filter_linear_many(x, P, zs, F, Q, H, R, double alpha_sq, controls, dict out):
    """See `fuzzykf.engine.numpy.kalman_series.filter_linear_many`."""
    cdef cnp.ndarray P_ = doubles(P, "P", (-1, -1)), zs_ = doubles(zs, "zs", (-1, -1, -1))
    cdef int n = <int> P_.shape[0], m = <int> zs_.shape[2]
    if not (0 < n <= FK_KALMAN_LARGEST and 0 < m <= FK_KALMAN_LARGEST):
        raise ValueError(f"P, zs: got {n} states, {m} observed components, expected at most {FK_KALMAN_LARGEST}")
    cdef cnp.ndarray x_ = doubles(x, "x", (n,))
    doubles(P_, "P", (n, n))
    cdef Py_ssize_t count = zs_.shape[0], steps = zs_.shape[1]
    cdef fk_many work
    cdef fk_linear *model = &work.model
    cdef cnp.ndarray F_ = matrices(F, "F", n, n, steps, &model.F_stride), u = None
    cdef cnp.ndarray Q_ = matrices(Q, "Q", n, n, steps, &model.Q_stride)
    cdef cnp.ndarray H_ = matrices(H, "H", m, n, steps, &model.H_stride)
    cdef cnp.ndarray R_ = matrices(R, "R", m, m, steps, &model.R_stride)
    model.n, model.m, model.alpha_sq = n, m, alpha_sq
    model.F, model.Q, model.H, model.R = at(F_), at(Q_), at(H_), at(R_)
    work.z, work.x, work.P, work.u, work.u_stride = at(zs_), at(x_), at(P_), NULL, 0
    work.count, work.n_steps = count, steps
    if controls is not None:
        u = doubles(controls, "controls", (-1, steps, n))
        if u.shape[0] not in (1, count):
            raise ValueError(f"controls: got those of {u.shape[0]} series, expected {count} or 1")
        work.u = at(u)
        work.u_stride = steps * n if u.shape[0] == count else 0
    dtype = np.dtype(np.float32 if any(one.dtype == np.float32 for one in out.values()) else np.float64)
    work.out.is_single = dtype.itemsize == 4
    work.out.x = place(out, "x", (count, steps, n), dtype)
    work.out.P = place(out, "P", (count, steps, n, n), dtype)
    work.out.x_prior = place(out, "x_prior", (count, steps, n), dtype)
    work.out.P_prior = place(out, "P_prior", (count, steps, n, n), dtype)
    work.out.log_likelihood = place(out, "log_likelihood", (count, steps), dtype)
    if count == 0 or steps == 0:
        return
    cdef Buffer room = Buffer(fk_many_room(model, count))
    cdef size_t *indices = <size_t *> malloc(2 * count * sizeof(size_t))
    cdef size_t done
    if indices == NULL:
        raise MemoryError
    with nogil:
        done = fk_many_filter(fk_lanes_engines + level, versions + level, &work, room.data, indices)
        free(indices)
    if done < <size_t> steps:
        raise np.linalg.LinAlgError(f"S is not positive definite at step {done}")

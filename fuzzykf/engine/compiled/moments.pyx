# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Moments of memberships on a lattice; see `fuzzykf.engine.numpy.moments`."""

from fuzzykf.engine.compiled.arrays cimport at, axes_of, doubles, lattice

cimport numpy as cnp

import numpy as np

cnp.import_array()

__all__ = ["moments_about"]

cdef extern from "src/moments.h" nogil:
    enum: FK_AXES
    ctypedef Py_ssize_t fk_index
    void fk_moments(
        int, const fk_index *, const double *, const double *const *, double *, double *
    ) noexcept


def moments_about(mass, axes, center):
    cdef cnp.ndarray masses = lattice(mass, "mass")
    cdef int d = cnp.PyArray_NDIM(masses), k
    cdef fk_index shape[FK_AXES]
    cdef const double *deviations[FK_AXES]
    axes_of(masses, shape)
    cdef cnp.ndarray middle = doubles(center, "center", (d,)), first = np.empty(d), second = np.empty((d, d))
    if len(axes) != d or masses.size == 0:
        raise ValueError(f"mass: got shape {np.shape(masses)}, expected the lengths of {len(axes)} axes")
    # What is subtracted here is owned by the list for as long as the sums take.
    cdef list held = [doubles(axis, "axes", (shape[k],)) - middle[k] for k, axis in enumerate(axes)]
    for k in range(d):
        deviations[k] = at(held[k])
    with nogil:
        fk_moments(d, shape, at(masses), deviations, at(first), at(second))
    return first, second

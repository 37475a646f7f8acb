# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, auto_pickle=False
"""Memory, and arrays of doubles with a checked shape."""

from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free

cimport numpy as cnp

import numpy as np

cnp.import_array()


cdef class Buffer:
    def __cinit__(self, size_t size):
        self.raw = calloc(size * sizeof(double) + 64, 1)
        if self.raw == NULL:
            raise MemoryError
        self.data = <double *> ((<uintptr_t> self.raw + 63) // 64 * 64)

    def __dealloc__(self):
        free(self.raw)


cdef cnp.ndarray doubles(object value, str name, tuple shape):
    """Return a contiguous array of doubles of this shape, which may be ``value`` itself; -1 admits any."""
    cdef cnp.ndarray array
    cdef int k
    cdef int expected = <int> len(shape)
    array = cnp.PyArray_FROMANY(value, cnp.NPY_DOUBLE, 0, 0, cnp.NPY_ARRAY_CARRAY_RO | cnp.NPY_ARRAY_FORCECAST)
    if cnp.PyArray_NDIM(array) == expected:
        for k in range(expected):
            if shape[k] != -1 and cnp.PyArray_DIM(array, k) != <Py_ssize_t> shape[k]:
                break
        else:
            return array
    raise ValueError(f"{name}: got shape {np.shape(array)}, expected {shape}")



cdef cnp.ndarray integers(object value, str name, tuple shape):
    """Return a contiguous array of indices of this shape, which may be ``value`` itself; -1 admits any."""
    cdef cnp.ndarray array = np.asarray(value)
    cdef int k
    cdef int expected = <int> len(shape)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{name}: got an array of {array.dtype}, expected whole numbers")
    array = cnp.PyArray_FROMANY(array, cnp.NPY_INTP, 0, 0, cnp.NPY_ARRAY_CARRAY_RO | cnp.NPY_ARRAY_FORCECAST)
    if cnp.PyArray_NDIM(array) == expected:
        for k in range(expected):
            if shape[k] != -1 and cnp.PyArray_DIM(array, k) != <Py_ssize_t> shape[k]:
                break
        else:
            return array
    raise ValueError(f"{name}: got shape {np.shape(array)}, expected {shape}")


cdef cnp.ndarray lattice(object value, str name):
    """Return a contiguous array of doubles of 1 to 16 axes, which may be ``value`` itself."""
    cdef cnp.ndarray array
    array = cnp.PyArray_FROMANY(value, cnp.NPY_DOUBLE, 0, 0, cnp.NPY_ARRAY_CARRAY_RO | cnp.NPY_ARRAY_FORCECAST)
    if not 1 <= cnp.PyArray_NDIM(array) <= 16:
        raise ValueError(f"{name}: got shape {np.shape(array)}, expected 1 to 16 axes")
    return array


cdef void axes_of(cnp.ndarray array, Py_ssize_t *shape) noexcept:
    """Write the shape of a lattice."""
    cdef int k
    for k in range(cnp.PyArray_NDIM(array)):
        shape[k] = cnp.PyArray_DIM(array, k)

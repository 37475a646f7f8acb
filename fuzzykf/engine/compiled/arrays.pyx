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


"""Memory, and arrays of doubles with a checked shape."""

cimport numpy as cnp


cdef class Buffer:
    """Zeros at an address that is a multiple of 64."""

    cdef void *raw
    cdef double *data


cdef cnp.ndarray doubles(object value, str name, tuple shape)


cdef inline double *at(cnp.ndarray array) noexcept nogil:
    return <double *> cnp.PyArray_DATA(array)


cdef inline double *at_or_null(object array) noexcept:
    return NULL if array is None else <double *> cnp.PyArray_DATA(<cnp.ndarray> array)


cdef cnp.ndarray integers(object value, str name, tuple shape)
cdef cnp.ndarray lattice(object value, str name)
cdef void axes_of(cnp.ndarray array, Py_ssize_t *shape) noexcept


cdef inline Py_ssize_t *whole(cnp.ndarray array) noexcept nogil:
    return <Py_ssize_t *> cnp.PyArray_DATA(array)

"""Memory, and arrays of doubles with a checked shape."""

cimport numpy as cnp


cdef class Buffer:
    """Zeros at an address that is a multiple of 64."""

    cdef void *raw
    cdef double *data


cdef cnp.ndarray doubles(object value, str name, tuple shape)


cdef inline double *at(cnp.ndarray array) noexcept:
    return <double *> cnp.PyArray_DATA(array)


cdef inline double *at_or_null(object array) noexcept:
    return NULL if array is None else <double *> cnp.PyArray_DATA(<cnp.ndarray> array)

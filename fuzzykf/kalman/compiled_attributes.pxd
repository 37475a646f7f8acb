"""A filter at work, and the attributes that are to be written."""

from cpython.object cimport PyObject

from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, FK_KALMAN_SQUARE, fk_kalman

cdef enum:
    ENTRIES = 11  # attributes that a step writes


cdef struct Member:
    # a filter at work: its arithmetic, and copies of what cannot be used where it is
    fk_kalman f
    double F[FK_KALMAN_SQUARE]
    double Q[FK_KALMAN_SQUARE]
    double H[FK_KALMAN_SQUARE]
    double R[FK_KALMAN_SQUARE]
    double SI[FK_KALMAN_SQUARE]
    double z[FK_KALMAN_LARGEST]
    bint flat


cdef struct Entry:
    # an attribute to be written
    PyObject *name
    const double *values
    int rows, columns  # no columns: a flat array
    PyObject *array
    bint is_new


cdef int read_state(dict d, Member *member) except -1
cdef int read_motion(dict d, Member *member) except -1
cdef int read_observation(dict d, Member *member) except -1
cdef int read_z(object z, int m, double *values) except -1
cdef int is_missing(object z, int m) except -1
cdef int skip(dict d, Member *member, Entry *entries, int count) except -1
cdef int prior_entries(Member *member, Entry *entries, bint state) noexcept
cdef int posterior_entries(Member *member, Entry *entries) noexcept
cdef int reserve(dict d, Entry *entries, int count) except -1
cdef int commit(dict d, Entry *entries, int count) except -1
cdef int forget_likelihoods(dict d) except -1
cdef int overrides(object filter_) except -1
cdef int is_plain(object filter_, dict d, bint verbs) except -1
cdef int has_own_verbs(dict d) except -1
cdef int is_begun(dict d) except -1
cdef void entry(Entry *e, str name, const double *values, int rows, int columns) noexcept
cdef int forget(dict d, str name) except -1
cdef void release(Entry *entries, int count) noexcept

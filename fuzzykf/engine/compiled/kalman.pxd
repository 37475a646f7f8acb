"""A linear Kalman filter as C structure: filled from the attributes of a filter, and written back to them."""

from cpython.object cimport PyObject

cdef extern from "src/kalman.h" nogil:
    int FK_KALMAN_LARGEST
    ctypedef struct fk_kalman:
        int n, m, n_seen
        const double *F
        const double *Q
        const double *H
        const double *R
        double alpha_sq
        double *x
        double *P
        double *x_prior
        double *P_prior
        double *y
        double *S
        double *K
    ctypedef struct fk_kalman_output:
        double *x
        double *P
        double *x_prior
        double *P_prior
        double *log_likelihood
    ctypedef struct fk_kalman_engine:
        void (*predict)(fk_kalman *) noexcept nogil
        int (*update)(fk_kalman *, const double *) noexcept nogil
        size_t (*filter)(
            fk_kalman *, const double *, size_t, const double *, const fk_kalman_output *
        ) noexcept nogil
    double fk_kalman_log_likelihood(const fk_kalman *) noexcept
    void fk_kalman_inverse(const fk_kalman *, double *) noexcept

cdef const fk_kalman_engine *versions  # one per kind of processor

cdef enum:
    LARGEST = 16  # FK_KALMAN_LARGEST
    SQUARE = LARGEST * LARGEST
    ENTRIES = 11  # attributes that a step writes


cdef struct Member:
    # a filter at work: its arithmetic, and copies of what cannot be used where it is
    fk_kalman f
    double F[SQUARE]
    double Q[SQUARE]
    double H[SQUARE]
    double R[SQUARE]
    double SI[SQUARE]
    double z[LARGEST]
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
cdef int prior_entries(Member *member, Entry *entries, bint state) noexcept
cdef int posterior_entries(Member *member, Entry *entries) noexcept
cdef int reserve(dict d, Entry *entries, int count) except -1
cdef int commit(dict d, Entry *entries, int count) except -1
cdef int forget_likelihoods(dict d) except -1
cdef int is_plain(object filter_, dict d, int verbs) except -1

"""The structures of steps in which something is missing, their owners, and the versions of the arithmetic."""

from fuzzykf.engine.compiled.arrays cimport Buffer

cimport numpy as cnp

cdef extern from "src/gaps.h" nogil:
    enum:
        FK_GAPS_LARGEST
    ctypedef struct fk_gaps:
        int M1, M2, m, q, w, depth, is_sparse, size
        const double *cells
        const int *source
        const double *sees
    ctypedef struct fk_gaps_engine:
        int (*step)(
            const fk_gaps *, const double *, int, const double *, const double *, const double *, int, double *,
            double *, int *, double *, double *
        ) noexcept nogil
        void (*merge)(int, int, int, const double *, double *, double *) noexcept nogil
        void (*prior)(
            const fk_gaps *, const double *, int, const double *, const double *, double *, double *, double *
        ) noexcept nogil
    int fk_gap_size(int, int, int) noexcept
    int fk_gap_rows(int) noexcept
    size_t fk_gap_scratch(const fk_gaps *, int) noexcept
    size_t fk_gap_state(int, int, int) noexcept
    size_t fk_gap_prior_scratch(const fk_gaps *) noexcept
    void fk_open_complete(int, int, const double *, double *) noexcept
    void fk_to_lower(int, double *) noexcept

cdef const fk_gaps_engine *gaps_versions  # one per kind of processor


cdef class GapTables:
    """Tables of one step in the layout of the compiled core; see `fuzzykf.engine.numpy.gaps.GapTables`."""

    cdef fk_gaps k
    cdef Buffer memory, places
    cdef readonly object step, noise


cdef class GapRoom:
    """States with something unknown that change places, and room for the arithmetic of a step."""

    cdef Buffer memory
    cdef double *rows[4]  # states
    cdef double *table
    cdef double *log_p
    cdef double *scratch


cdef int open_state(double *rows, object table, object root, object branches, window, int M, int m) except -1
cdef tuple shown_state(
    const double *rows, int n, const double *of_x, int M, int m, const double *window, int w, GapRoom room
)

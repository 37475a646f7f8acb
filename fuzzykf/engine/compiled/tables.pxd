"""The structures of the recursion, their owners, and the versions of the arithmetic."""

from fuzzykf.engine.compiled.arrays cimport Buffer

from libc.stdint cimport int64_t

cimport numpy as cnp

cdef extern from "src/series.h" nogil:
    ctypedef struct fk_kernel:
        int M1, M2, m, q, w, blocks, stride, is_signed, is_scalar, is_sparse
        double *cells
        double *mask
        const int *first
        const int *source
    ctypedef struct fk_summary:
        int stride, n_atoms, n_edges, is_plain, M
        const double *cells
        const double *twice
        const double *noise
        const double *ahead
        const double *nodes
        const double *weights
        const int *order
        const int *ends
        const int *widest
    ctypedef struct fk_room:
        double *p
        double *x
        double *u
        double *scratch
        double *tables
        double *weights
    ctypedef struct fk_state:
        double *table
        double *sign
        int linear, log_known
        double total
    ctypedef struct fk_output:
        double *x
        double *P
        double *x_prior
        double *P_prior
        double *mu
        double *modes
        double *means
        double *log_likelihood
        double *table
        double *sign
    ctypedef struct fk_arrows:
        size_t n
        const int *sources "from"
        const int *to
    ctypedef struct fk_engine:
        const char *instructions
        void (*log_pairs)(const fk_kernel *, const double *, double *) noexcept nogil
        void (*smooth_back)(
            const fk_kernel *, size_t, const double *, const double *, double *, double *, double *
        ) noexcept nogil
        void (*best_path)(
            const fk_kernel *, size_t, double *, const double *, int64_t *, double *
        ) noexcept nogil
        void (*prior)(
            const fk_kernel *, const fk_summary *, const double *, const double *, const double *, double *,
            double *, double *
        ) noexcept nogil
        void (*posterior)(int, int, const double *, const double *, double *, double *) noexcept nogil
        int (*in_range)(int, int, const double *) noexcept nogil
        int (*forward_backward)(
            int, int, const fk_arrows *, const double *, const double *, const double *, double *, double *, double *, double *
        ) noexcept nogil
    const double FK_SPARSE
    const double FK_FARTHEST
    int fk_padded(int) noexcept
    size_t fk_table_size(int, int) noexcept
    size_t fk_scratch_size(int, int) noexcept
    int fk_cell_size(int, int, int) noexcept
    size_t fk_slot(const fk_kernel *, int, int, int) noexcept
    int fk_slot_of(const fk_kernel *, int, int) noexcept
    int fk_slots(const fk_kernel *) noexcept
    int fk_deepest(const fk_kernel *) noexcept
    int fk_lay_out(int, int, int, const double *, int *) noexcept
    void fk_fill_sources(const fk_kernel *, const double *, int *) noexcept
    void fk_fill_rest(fk_kernel *, const double *) noexcept
    void fk_fill(
        fk_kernel *, int, int, double, const double *, const double *, const double *, const double *,
        const double *, const double *, const double *, const double *
    ) noexcept
    double fk_first(
        int, int, int, const double *, const double *, const double *, const double *, const double *,
        double *, int, double *
    ) noexcept
    void fk_forward_backward_logs(
        int, int, const double *, const double *, const double *, double *, double *, double *, double *
    ) noexcept
    double fk_log_likelihood(const fk_state *) noexcept
    void fk_to_logs(fk_state *, int) noexcept
    void fk_load_mass(fk_state *, const double *, int) noexcept
    void fk_store_mass(double *, const fk_state *, int) noexcept
    const double *fk_probabilities(const fk_engine *, const fk_state *, int, double *) noexcept
    void fk_advance(const fk_engine *, const fk_kernel *, fk_state *, fk_state *, const double *, double *) noexcept
    void fk_fill_ahead(int, int, int, const double *, double *, double *) noexcept
    size_t fk_chunk_tables(const fk_kernel *) noexcept
    size_t fk_chunk_weights(const fk_kernel *) noexcept
    void fk_summarise(
        const fk_engine *, const fk_summary *, const fk_state *, int, int, size_t, const fk_output *,
        const fk_room *
    ) noexcept
    int fk_filter(
        const fk_engine *, const fk_kernel *, const fk_summary *, fk_state *, fk_state *, const double *, size_t,
        const fk_output *, size_t, const fk_room *
    ) noexcept

cdef const fk_engine *versions  # one per kind of processor


cdef class Kernel:
    """Tables of one step in the layout of the compiled core; see `fuzzykf.engine.numpy.tables.Kernel`."""

    cdef fk_kernel k
    cdef Buffer memory, places


cdef class Summary:
    """What the moments before an observation and the estimate of the switch need."""

    cdef fk_summary s
    cdef Buffer memory
    cdef cnp.ndarray ranking, widest


cdef class Workspace:
    """Two states that change places, and room for the arithmetic of a step."""

    cdef Buffer memory
    cdef fk_state one, two, three
    cdef double *p
    cdef double *x
    cdef double *scratch


cdef void load(double *to, const double *source, int rows, int M) noexcept nogil
cdef void store(double *to, const double *source, int rows, int M) noexcept nogil
cdef int start(Workspace work, Kernel kernel, object table, object sign) except -1
cdef fk_output outputs(dict out, Py_ssize_t s, Py_ssize_t n, int m, int M) except *
cdef cnp.ndarray rank(fk_summary *s, int M, double *room, nodes, weights, atoms, ranking)

"""The structures of state-space models on nodes, their owner, and the versions of the arithmetic."""

from fuzzykf.engine.compiled.arrays cimport Buffer
from fuzzykf.engine.compiled.tables cimport fk_state

cdef extern from "src/nodes.h" nogil:
    enum:
        FK_NODES_LARGEST
    ctypedef struct fk_nodes:
        int M, m, q
        const int *first
        const int *source
        const double *mask
        const double *entered
        const double *transition
        const double *log_transition
        const double *log_into
        const double *F
        const double *b
        const double *Q
        const double *H
        const double *d
        const double *R
    ctypedef struct fk_nodes_engine:
        void (*move)(const fk_nodes *, const double *, double *, double *) noexcept nogil
        void (*back)(
            const fk_nodes *, int, const double *, const double *, const double *, const double *, double *, double *,
            int *, double *
        ) noexcept nogil
    size_t fk_nodes_scratch(int, int) noexcept
    size_t fk_nodes_back_scratch(int, int) noexcept
    size_t fk_nodes_parameters(int, int, int) noexcept
    void fk_nodes_spread(int, int, const double *, double *) noexcept
    int fk_nodes_observe(const fk_nodes_engine *, const fk_nodes *, const double *, fk_state *, double *) noexcept
    int fk_nodes_advance(
        const fk_nodes_engine *, const fk_nodes *, int, const fk_state *, fk_state *, const double *, double *
    ) noexcept

cdef const fk_nodes_engine *nodes_versions  # one per kind of processor


cdef class NodeKernel:
    """Parameters of steps in the layout of the compiled core; see `fuzzykf.engine.numpy.nodes.NodeKernel`."""

    cdef fk_nodes k  # what depends on the step or the series is NULL
    cdef Buffer memory, places
    cdef tuple parameters  # as they came, (s, n, M, ...)


cdef class NodeSpan:
    """States that change places, and room for the arithmetic of a step and for its parameters."""

    cdef Buffer memory
    cdef fk_nodes k
    cdef fk_state one, two, three
    cdef double *p
    cdef double *x
    cdef double *scratch
    cdef double *room  # of the parameters that vary
    cdef const double *sources[6]
    cdef double *targets[6]
    cdef Py_ssize_t rows[6]
    cdef Py_ssize_t by_series[6]  # how far apart, in numbers; 0 where they are shared
    cdef Py_ssize_t by_step[6]

    cdef void turn_to(self, Py_ssize_t series, Py_ssize_t step) noexcept nogil

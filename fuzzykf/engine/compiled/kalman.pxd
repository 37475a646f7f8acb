"""The structures of the Kalman filter, and the versions of its arithmetic."""

cdef extern from "src/kalman.h" nogil:
    enum:
        FK_KALMAN_LARGEST
        FK_KALMAN_SQUARE
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
    size_t fk_kalman_filter(
        const fk_kalman_engine *, fk_kalman *, const double *, size_t, const double *, const fk_kalman_output *
    ) noexcept
    double fk_kalman_log_likelihood(const fk_kalman *) noexcept
    void fk_kalman_inverse(const fk_kalman *, double *) noexcept

cdef const fk_kalman_engine *versions  # one per kind of processor

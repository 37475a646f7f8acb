"""The structures of a bank of Kalman filters."""

from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, FK_KALMAN_SQUARE, fk_kalman, fk_kalman_engine

cdef extern from "src/imm.h" nogil:
    ctypedef struct fk_bank:
        int modes
        fk_kalman **f
        double *log_mu
        const double *log_M
        double *log_cbar
        double *omega
        double *log_likelihood
        double total
        double *weights
        double *x
        double *P
        double *x_prior
        double *P_prior
    ctypedef struct fk_bank_output:
        double *x
        double *P
        double *x_prior
        double *P_prior
        double *mu
        double *log_likelihood
    size_t fk_bank_size(size_t) noexcept
    void fk_bank_place(fk_bank *, double *) noexcept
    void fk_bank_weights(fk_bank *) noexcept
    void fk_bank_predict(const fk_kalman_engine *, fk_bank *) noexcept
    int fk_bank_update(const fk_kalman_engine *, fk_bank *, const double *) noexcept
    size_t fk_bank_filter(
        const fk_kalman_engine *, fk_bank *, const double *, size_t, const fk_bank_output *
    ) noexcept

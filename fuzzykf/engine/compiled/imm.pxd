"""The structures of a bank of Kalman filters."""

from fuzzykf.engine.compiled.kalman cimport FK_KALMAN_LARGEST, FK_KALMAN_SQUARE, fk_kalman, fk_kalman_engine

cdef extern from "src/imm.h" nogil:
    enum:
        FK_BANK_SINGULAR
        FK_BANK_UPDATED
        FK_BANK_IMPOSSIBLE
    ctypedef struct fk_bank:
        int modes
        int every_pair
        fk_kalman **f
        double *log_mu
        const double *log_M
        double *log_cbar
        double *omega
        double *log_likelihood
        double total
        double *own
        double *log_joint
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
    size_t fk_bank_size(size_t, size_t, int) noexcept
    void fk_bank_place(fk_bank *, int, double *) noexcept
    void fk_bank_weights(fk_bank *) noexcept
    void fk_bank_predict(const fk_kalman_engine *, fk_bank *) noexcept
    int fk_bank_update(const fk_kalman_engine *, fk_bank *, const double *) noexcept
    void fk_pairs_predict_all(const fk_kalman_engine *, fk_bank *, double *, double *) noexcept
    int fk_pairs_update_all(
        const fk_kalman_engine *, fk_bank *, const double *, const double *, const double *
    ) noexcept
    int fk_bank_step(const fk_kalman_engine *, fk_bank *, const double *) noexcept
    fk_bank_output fk_bank_output_from(const fk_bank *, const fk_bank_output *, size_t) noexcept
    void fk_bank_output_blank(const fk_bank *, const fk_bank_output *, size_t) noexcept
    size_t fk_bank_filter(
        const fk_kalman_engine *, fk_bank *, const double *, size_t, const fk_bank_output *, int *
    ) noexcept

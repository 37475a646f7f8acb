"""Derivatives of regressions by their parameters, see `fuzzykf.switching.learning.regression`.

The log-density of targets t given regressors p is, with e = t - beta p and D = diag exp(-g),

    log N = -(e' T' D T e + sum g + dim t log 2 pi) / 2,

so that the derivatives of a weighted sum of these need nothing but the weighted second moments of (t, p).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.switching.learning.regression import Regression

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["by_covariance", "log_densities", "of_pairs", "to_regimes", "weighted_slope"]

_LOG_2PI = float(np.log(2.0 * np.pi))


def of_pairs(fit: Regression, shares: FloatArray) -> Regression:
    """Interpolate at shares (P, B) of the regimes."""
    return Regression(*(np.tensordot(shares, part, axes=1) for part in fit))


def to_regimes(slope: Regression, shares: FloatArray) -> Regression:
    """Turn derivatives by what was interpolated into those by what regimes (or pairs of them) have."""
    return Regression(*(np.tensordot(shares.T, part, axes=1) for part in slope))


def log_densities(fit: Regression, targets: FloatArray, regressors: FloatArray) -> FloatArray:
    """Log-densities of n targets (n, t) given regressors (n, p) under P regressions, (n, P).

    Examples
    --------
    >>> import numpy as np
    >>> fit = Regression(np.array([[[2.0]]]), np.ones((1, 1, 1)), np.zeros((1, 1)))
    >>> log_densities(fit, np.array([[2.0]]), np.ones((1, 1))).round(3)
    array([[-0.919]])
    """
    P, t, _ = fit.beta.shape
    scaled = fit.T * np.exp(-0.5 * fit.g)[..., None]
    rows = np.concatenate([scaled, -scaled @ fit.beta], axis=-1).reshape(P * t, -1)
    density: FloatArray = np.concatenate([targets, regressors], axis=1) @ (rows.T * np.sqrt(0.5))
    density *= density
    if t > 1:
        density = density.reshape(-1, P, t).sum(axis=-1)
    density *= -1.0
    density -= 0.5 * (fit.g.sum(axis=1) + t * _LOG_2PI)
    return density


def weighted_slope(fit: Regression, weight: FloatArray, moment: FloatArray) -> Regression:
    """Differentiate weighted sums of log-densities.

    Parameters
    ----------
    fit : Regression
        Of P pairs.
    weight : ndarray, shape (P,)
        Sums of weights, which may be negative.
    moment : ndarray, shape (P, t + p, t + p)
        Weighted sums of u u', u = (targets, regressors).
    """
    t = fit.g.shape[1]
    S_tt, S_tp, S_pp = moment[:, :t, :t], moment[:, :t, t:], moment[:, t:, t:]
    across = S_tp - fit.beta @ S_pp  # of residuals and regressors
    residual = S_tt - fit.beta @ np.swapaxes(S_tp, -1, -2)
    residual = residual - across @ np.swapaxes(fit.beta, -1, -2)
    scaled = fit.T * np.exp(-fit.g)[..., None]  # D T
    square = np.einsum("pki,pij,pkj->pk", fit.T, residual, fit.T, optimize=True)
    return Regression(
        beta=np.swapaxes(fit.T, -1, -2) @ scaled @ across,
        T=np.tril(-scaled @ residual, -1),
        g=0.5 * (np.exp(-fit.g) * square - weight[:, None]),
    )


def by_covariance(fit: Regression, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn derivatives by covariances (P, t, t) into those by T and g.

    The covariance is C = L diag exp(g) L' with L = T^-1, so that

        dC = -L dT C - C dT' L' + L diag(exp(g) dg) L'.
    """
    L = np.linalg.inv(fit.T)  # unit lower triangular
    turned = np.swapaxes(L, -1, -2) @ slope
    by_g = np.exp(fit.g) * np.einsum("pij,pji->pi", turned, L)
    return np.tril(-2.0 * turned @ fit.covariance, -1), by_g

"""What an estimator in closed form shows of an update as a Kalman filter does: residual, gain, likelihood."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.possibility.closed_form import over_all
from fuzzykf.possibility.mapping import as_map
from fuzzykf.possibility.representation import required_quadratic

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.possibility.closed_form import Posterior
    from fuzzykf.possibility.memberships import Membership

__all__ = ["residual_matrix", "show_gain", "show_likelihood", "show_no_gain"]

#: The components of a measurement that is missing.
NONE_SEEN = np.zeros(0, dtype=np.intp)


def residual_matrix(est: Any, noise: Membership, H: Any) -> FloatArray:
    """Return S = H P H' + R (dim_z, dim_z) of all components, before an update.

    Parameters
    ----------
    est : FuzzyRelationEstimator
        In closed form.
    noise : Membership
        Of the measurement.
    H : array_like or None
        Of this measurement only; None means that of the estimator.
    """
    full = as_map("H", est.H if H is None else H, (est.dim_z, est.dim_x))
    S: FloatArray = full @ est.P @ full.T + required_quadratic("R", noise, est.representation)[1]
    return S


def show_gain(est: Any, found: Posterior | None, seen: IntArray, S: FloatArray) -> None:
    """Set y, S, SI and K after an update; those of missing components are zero.

    Parameters
    ----------
    est : FuzzyRelationEstimator
        In closed form; of a Gaussian membership the likelihood is set as well.
    found : Posterior or None
        None if nothing was learned.
    seen : ndarray of int
        The components that were not missing.
    S : ndarray, shape (dim_z, dim_z)
        See `residual_matrix`.
    """
    y, est.SI, est.K = over_all(found, seen, est.dim_x, est.dim_z)
    est.y, est.S = y if est.x.ndim == 1 else y.reshape(-1, 1), S
    if est.representation == "gaussian":
        if found is None:
            show_likelihood(est, 0.0, 0.0)
        else:
            show_likelihood(est, found.log_likelihood, float(np.sqrt(found.surprise)))


def show_no_gain(est: Any) -> None:
    """Set the same where there was no measurement."""
    show_gain(est, None, NONE_SEEN, np.zeros((est.dim_z, est.dim_z)))


def show_likelihood(est: Any, log_likelihood: float, mahalanobis: float) -> None:
    """Set what only a Gaussian membership, read as a density, has."""
    est.log_likelihood = log_likelihood
    # As in filterpy, a likelihood too small for a float is the smallest one.
    est.likelihood = max(float(np.exp(log_likelihood)), sys.float_info.min)
    est.mahalanobis = mahalanobis

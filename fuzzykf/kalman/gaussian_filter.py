"""What the Kalman filter and the extended one share: attributes, the update, the likelihoods."""

from __future__ import annotations

import sys
from math import exp, log
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import Filter
from fuzzykf.engine.selected import seen_components
from fuzzykf.errors import NumericalRangeError, ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.kalman.arguments import (
    as_covariance,
    as_square,
    as_state,
    check_in_range,
    dimension,
    given_matrix,
)
from fuzzykf.kalman.describe import describe
from fuzzykf.kalman.updates import distance, log_density

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, Numbers

__all__ = ["HOOKS", "LEAST_LIKELIHOOD", "LEAST_LOG_LIKELIHOOD", "GaussianFilter"]

#: What filterpy reports as log-likelihood and likelihood before the first update.
LEAST_LIKELIHOOD = sys.float_info.min
LEAST_LOG_LIKELIHOOD = log(LEAST_LIKELIHOOD)

#: What the verbs of a linear filter call or read.
HOOKS = (
    *("get_prediction", "_observation", "_state", "remember_origin", "_skip"),
    *("_set_prior", "_set_posterior", "_set_innovation"),
    *("__getattribute__", "__setattr__"),
    *("dim_x", "dim_z", "x", "P", "F", "Q", "H", "R", "z", "y", "S", "SI", "K", "alpha", "inv"),
    *("x_prior", "P_prior", "x_post", "P_post"),
    *("_alpha_sq", "_log_likelihood", "_likelihood", "_mahalanobis"),
)


class _StateAttribute:
    """The attribute x: assigning a flat state makes all vectors of the filter flat, and back.

    It only has a setter, so that x is read from, and found in, the ordinary dictionary
    of attributes.
    """

    def __set__(self, instance: GaussianFilter, value: Any) -> None:
        try:
            ndim = np.ndim(value)
        except ValueError as error:
            raise ShapeError(f"x: expected an array of numbers, got {brief(value)}") from error
        instance.__dict__["x"] = value
        if ndim in (1, 2) and np.ndim(instance.__dict__.get("y", value)) != ndim:
            instance._turn(ndim)


class GaussianFilter(Filter):
    """State, update and likelihoods of a filter with one mean and one covariance.

    The attributes are those of filterpy's filters and may be assigned at any time.
    Every verb computes all it needs before it assigns anything, so that an error
    leaves the filter as it was.

    Parameters
    ----------
    dim_x, dim_z, dim_u : int
        Dimensions of state, observation and control.
    x, P, F, Q, R : array_like, optional
        Initial values of these attributes, checked.
    """

    x: Any = _StateAttribute()
    Q: Any
    F: Any
    R: Any
    B: Any
    z: Any
    y: Any
    S: Any
    SI: Any
    K: Any
    x_post: Any
    P_post: Any
    inv: Callable[[Any], Any]

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dim_u: int = 0,
        *,
        x: Numbers = None,
        P: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
        R: Numbers = None,
    ) -> None:
        self.dim_x = dimension("dim_x", dim_x, 1)
        self.dim_z = dimension("dim_z", dim_z, 1)
        self.dim_u = dimension("dim_u", dim_u, 0)
        self.x = np.zeros((dim_x, 1)) if x is None else as_state(x, dim_x).copy()
        if not np.isfinite(self.x).all():
            raise ParameterError(f"x: got {self.x.ravel().tolist()}, expected finite numbers")
        self.P = np.eye(dim_x) if P is None else as_covariance("P", P, dim_x).copy()
        self.F = np.eye(dim_x) if F is None else given_matrix("F", F, (dim_x, dim_x))
        self.Q = np.eye(dim_x) if Q is None else as_covariance("Q", Q, dim_x).copy()
        self.R = np.eye(dim_z) if R is None else as_covariance("R", R, dim_z).copy()
        self.z = np.full((dim_z, 1), None)
        self.y = np.zeros((dim_z, 1))
        self.S = np.zeros((dim_z, dim_z))
        self.SI = np.zeros((dim_z, dim_z))
        self.K = np.zeros((dim_x, dim_z))
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()
        self.x_post, self.P_post = self.x.copy(), self.P.copy()
        if self.x.ndim == 1:
            self._turn(1)
        self.inv = np.linalg.inv
        self._I = np.eye(dim_x)
        self._alpha_sq = 1.0
        self._log_likelihood: float | None = LEAST_LOG_LIKELIHOOD
        self._likelihood: float | None = LEAST_LIKELIHOOD
        self._mahalanobis: float | None = None

    # ------------------------------------------------------------------ state

    def _state(self) -> tuple[FloatArray, FloatArray]:
        return as_state(self.x, self.dim_x), as_square("P", self.P, self.dim_x)

    def _turn(self, ndim: int) -> None:
        """Give all vectors the form of x, flat or column."""
        for name in ("x_prior", "x_post", "y", "z"):
            value = np.asarray(getattr(self, name))
            setattr(self, name, value.reshape(-1) if ndim == 1 else value.reshape(-1, 1))

    def _check(self, x: FloatArray, P: FloatArray) -> None:
        """Refuse what is no number before it becomes the estimate."""
        try:
            check_in_range(x=x, P=P)
        except NumericalRangeError:
            for name in ("x", "P", "F", "Q", "H", "R"):  # nobody checks what is assigned
                held = getattr(self, name, 0.0)
                if callable(held):  # a function of dt, whose matrices are checked
                    continue
                held = as_numbers(name, held)
                if not np.isfinite(held).all():
                    raise ParameterError(
                        f"{name}: got {brief(held.tolist())}, expected finite numbers"
                    ) from None
            raise

    def _set_prior(self, x: FloatArray, P: FloatArray) -> None:
        self._check(x, P)
        self.__dict__["x"], self.P = x, P
        self.x_prior, self.P_prior = x.copy(), P.copy()

    def _set_posterior(self, x: FloatArray, P: FloatArray) -> None:
        self._check(x, P)
        self.__dict__["x"], self.P = x, P
        self.x_post, self.P_post = x.copy(), P.copy()
        self._log_likelihood = self._likelihood = self._mahalanobis = None

    def _set_innovation(
        self,
        x: FloatArray,
        P: FloatArray,
        z: FloatArray,
        y: FloatArray,
        S: FloatArray,
        SI: FloatArray,
        K: FloatArray,
    ) -> None:
        self._set_posterior(x, P)
        self.z, self.y, self.S, self.SI, self.K = z, y, S, SI, K

    def _skip(self, x: FloatArray, P: FloatArray, m: int) -> None:
        """Update without an observation: the prediction is the new estimate."""
        self._set_posterior(x.copy(), P.copy())
        self.z = np.full(m if x.ndim == 1 else (m, 1), None)
        self.y = np.zeros(self.z.shape)
        self._log_likelihood, self._likelihood, self._mahalanobis = 0.0, 1.0, 0.0

    def _end_series(
        self,
        prior: tuple[FloatArray, FloatArray],
        posterior: tuple[FloatArray, FloatArray],
        z: FloatArray,
        innovation: tuple[FloatArray, ...] | None,
    ) -> None:
        """Stay at the end of a series: its latest moments, x (dim_x,) and P, and observation (dim_z,).

        ``innovation`` has y, S, SI and K of the latest step of which something was observed.
        """
        (x_prior, P_prior), (x, P), form = prior, posterior, np.shape(self.x)
        self._set_prior(x_prior.reshape(form).copy(), P_prior.copy())
        x, P = x.reshape(form).copy(), P.copy()
        if innovation is not None:
            y, self.S, self.SI, self.K = innovation
            self.y = y.reshape(-1, 1) if x.ndim == 2 else y
        if np.isnan(z).all():
            self._skip(x, P, len(z))
        else:
            self._set_innovation(x, P, z.reshape(self.y.shape).copy(), self.y, self.S, self.SI, self.K)

    # ------------------------------------------------------------------ likelihoods

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones.

        0 if it was missing; that of its observed components if some were missing;
        ``log(sys.float_info.min)`` before the first update, as in filterpy.
        """
        if self._log_likelihood is None:
            y, z, seen = self.y, self.z, None
            if y.size > 1 and type(z) is np.ndarray and z.shape == y.shape:
                seen = seen_components(z)
            self._log_likelihood = log_density(y, self.S, seen)
        return self._log_likelihood

    @property
    def likelihood(self) -> float:
        """Exponential of `log_likelihood`, but never less than ``sys.float_info.min``."""
        if self._likelihood is None:
            value = self.log_likelihood
            self._likelihood = max(exp(value), LEAST_LIKELIHOOD) if value < 709.0 else np.inf
        return self._likelihood

    @property
    def mahalanobis(self) -> float:
        """Distance of the latest observation from its prediction, in standard deviations."""
        if self._mahalanobis is None:
            self._mahalanobis = distance(self.y, self.SI)
        return self._mahalanobis

    def __repr__(self) -> str:
        """Show every public attribute, one below the other."""
        return describe(self, "log_likelihood", "likelihood", "mahalanobis")

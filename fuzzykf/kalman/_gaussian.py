"""What the Kalman filter and the extended one share: attributes, the update, the likelihoods."""

from __future__ import annotations

import sys
from math import exp, log, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import Filter
from fuzzykf.engine.numpy import kalman as engine
from fuzzykf.engine.numpy.kalman import seen_components
from fuzzykf.gaussian import as_array
from fuzzykf.kalman._arguments import (
    SINGULAR,
    SingularInnovationError,
    as_covariance,
    as_square,
    as_state,
    dimension,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["GaussianFilter", "describe"]

_NUMPY_INVERSE = np.linalg.inv

#: What filterpy reports as log-likelihood and likelihood before the first update.
LEAST_LIKELIHOOD = sys.float_info.min
LEAST_LOG_LIKELIHOOD = log(LEAST_LIKELIHOOD)


class _StateAttribute:
    """The attribute x: assigning a flat state makes all vectors of the filter flat, and back.

    It only has a setter, so that x is read from, and found in, the ordinary dictionary
    of attributes.
    """

    def __set__(self, instance: GaussianFilter, value: Any) -> None:
        instance.__dict__["x"] = value
        ndim = np.ndim(value)
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
    P: Any
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
        x: ArrayLike | None = None,
        P: ArrayLike | None = None,
        F: ArrayLike | None = None,
        Q: ArrayLike | None = None,
        R: ArrayLike | None = None,
    ) -> None:
        self.dim_x = dimension("dim_x", dim_x, 1)
        self.dim_z = dimension("dim_z", dim_z, 1)
        self.dim_u = dimension("dim_u", dim_u, 0)
        self.x = np.zeros((dim_x, 1)) if x is None else as_state(x, dim_x).copy()
        self.P = np.eye(dim_x) if P is None else as_covariance("P", P, dim_x).copy()
        self.F = np.eye(dim_x) if F is None else as_array("F", F, (dim_x, dim_x))
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

    def _set_prior(self, x: FloatArray, P: FloatArray) -> None:
        self.__dict__["x"], self.P = x, P
        self.x_prior, self.P_prior = x.copy(), P.copy()

    def _turn(self, ndim: int) -> None:
        """Give all vectors the form of x, flat or column."""
        for name in ("x_prior", "x_post", "y", "z"):
            value = np.asarray(getattr(self, name))
            setattr(self, name, value.reshape(-1) if ndim == 1 else value.reshape(-1, 1))

    def _set_posterior(self, x: FloatArray, P: FloatArray) -> None:
        self.__dict__["x"], self.P = x, P
        self.x_post, self.P_post = x.copy(), P.copy()
        self._log_likelihood = self._likelihood = self._mahalanobis = None

    # ------------------------------------------------------------------ update

    def _skip(self, x: FloatArray, P: FloatArray, m: int) -> None:
        """Update without an observation: the prediction is the new estimate."""
        self._set_posterior(x.copy(), P.copy())
        self.z = np.full(m if x.ndim == 1 else (m, 1), None)
        self.y = np.zeros(self.z.shape)
        self._log_likelihood, self._likelihood, self._mahalanobis = 0.0, 1.0, 0.0

    def _correct(
        self,
        x: FloatArray,
        P: FloatArray,
        z: FloatArray,
        y: FloatArray,
        H: FloatArray,
        R: FloatArray,
        M: FloatArray | None = None,
    ) -> None:
        """Update with the residual y = z - H x; NaN in z marks what is missing."""
        seen = seen_components(z)
        if seen is not None:
            y = np.where(seen.reshape(y.shape), y, 0.0)
        x, P, S, SI, K = self._conditioned(x, P, y, H, R, M, seen)
        self._set_innovation(x, P, z, y, S, SI, K)

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

    def _conditioned(
        self,
        x: FloatArray,
        P: FloatArray,
        y: FloatArray,
        H: FloatArray,
        R: FloatArray,
        M: FloatArray | None = None,
        seen: np.ndarray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return x, P, S, SI and K after conditioning on the components seen of y."""
        block_inverse = engine.inverse if self.inv is _NUMPY_INVERSE else self.inv
        invert = block_inverse
        if seen is not None:

            def invert(S: FloatArray) -> FloatArray:
                return engine.inverse_seen(S, seen, block_inverse)

        try:
            if M is None:
                return engine.update(x, P, y, H, R, self._I, invert)
            return engine.update_correlated(x, P, y, H, R, M, self._I, invert)
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error

    # ------------------------------------------------------------------ likelihoods

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones.

        0 if it was missing; that of its observed components if some were missing;
        ``log(sys.float_info.min)`` before the first update, as in filterpy.
        """
        if self._log_likelihood is None:
            y, S = self.y.ravel(), self.S
            if y.size > 1 and type(self.z) is np.ndarray and self.z.shape == self.y.shape:
                seen = seen_components(self.z)
                if seen is not None:
                    y, S = y[seen], S[np.ix_(seen, seen)]
            self._log_likelihood = engine.log_normal(y, S)
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
            y = self.y.ravel()
            self._mahalanobis = sqrt(max(float(y.dot(self.SI).dot(y)), 0.0))
        return self._mahalanobis

    def __repr__(self) -> str:
        """Show every public attribute, one below the other."""
        names = [name for name in self.__dict__ if not name.startswith("_")]
        names += ["log_likelihood", "likelihood", "mahalanobis"]
        return describe(self, names)


def describe(filter_: object, names: list[str]) -> str:
    """Lines ``name = value``; columns are shown as transposed rows."""
    lines = [f"{type(filter_).__name__} object"]
    for name in names:
        value = getattr(filter_, name)
        turned = isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[0] > value.shape[1] == 1
        text = f"{name} = " + (f"{value.T}.T" if turned else str(value))
        lines.append(text.replace("\n", "\n" + " " * (len(name) + 3)))
    return "\n".join(lines)

"""The updates of a linear filter beside the usual one: steady state, correlated noise, part by part."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import as_observation
from fuzzykf.engine.numpy import kalman as engine
from fuzzykf.engine.numpy.kalman import seen_components
from fuzzykf.errors import ShapeError
from fuzzykf.kalman._arguments import (
    SINGULAR,
    SingularInnovationError,
    as_covariance,
    as_matrix,
    as_square,
    control_term,
    fits,
    observation_matrix,
)
from fuzzykf.kalman._gaussian import GaussianFilter
from fuzzykf.kalman._moments import update_linear

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["LinearUpdates"]


class LinearUpdates(GaussianFilter):
    """Updates of a filter with an observation matrix H and a noise correlation M."""

    H: Any
    M: Any

    def _observation(self, R: Any, H: Any) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return x, P, H and R for this call; H and R are its own or the filter's."""
        x, P, n, m = self.x, self.P, self.dim_x, self.dim_z
        if H is None:
            H = self.H
        else:
            H = observation_matrix("H", H, n)
            m = H.shape[0]
        R = self.R if R is None else as_covariance("R", R, m)
        if not fits(n, m, x, P, H, R):
            (x, P), H, R = self._state(), as_matrix("H", H, (m, n)), as_square("R", R, m)
        return x, P, H, R

    def _conditioned_on(
        self, x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return x, P, y, S, SI and K after conditioning on the components of z that are not NaN."""
        if self.inv is not np.linalg.inv:
            y, seen = z - H.dot(x), seen_components(z)
            if seen is not None:
                y = np.where(seen.reshape(y.shape), y, 0.0)
            x, P, S, SI, K = self._conditioned(x, P, y, H, R, None, seen)
            return x, P, y, S, SI, K
        try:
            return update_linear(x, P, z, H, R)
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error

    def predict_steadystate(self, u: ArrayLike | None = None, B: ArrayLike | None = None) -> None:
        """Predict the state and leave its covariance as it is.

        Use it with `update_steadystate`, after K and P have converged.

        Parameters
        ----------
        u : array_like, optional
            Control input.
        B : array_like, shape (dim_x, dim_u), optional
            Used instead of the attribute ``B``.

        Raises
        ------
        ShapeError
            If the shapes do not agree.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf.kalman import KalmanFilter
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], F=[[0.5]])
        >>> for _ in range(50):
        ...     _ = kf.step(0.0)
        >>> P = kf.P.copy()
        >>> kf.predict_steadystate()
        >>> kf.update_steadystate(1.0)
        >>> bool(kf.x == kf.K), bool((kf.P == P).all())
        (True, True)
        """
        self._remember()
        x, P = self._state()
        F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
        x = F.dot(x) + control_term(self.B if B is None else B, u, x)
        self._set_prior(x, P.copy())

    def update_steadystate(self, z: ArrayLike | None) -> None:
        """Update the state with the gain K as it is; P, S and K stay.

        Parameters
        ----------
        z : array_like
            The observation; None or NaN where missing.  A missing component counts
            as if it had been observed where it was predicted, the gain being fixed.

        Raises
        ------
        ShapeError
            If the shapes do not agree.
        """
        self._remember()
        x, P = self._state()
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        K = as_matrix("K", self.K, (self.dim_x, self.dim_z))
        value = as_observation(z, self.dim_z)
        if value is None:
            self._skip(x, P, self.dim_z)
            return
        value = value.reshape(-1, 1) if x.ndim == 2 else value
        y = value - H.dot(x)
        seen = seen_components(value)
        if seen is not None:
            y = np.where(seen.reshape(y.shape), y, 0.0)
        self._set_posterior(x + K.dot(y), P.copy())
        self.z, self.y = value, y
        if seen is not None:
            S = as_square("S", self.S, self.dim_z)
            self._log_likelihood = engine.log_normal(y.ravel()[seen], S[np.ix_(seen, seen)])

    def update_correlated(
        self, z: ArrayLike | None, R: ArrayLike | None = None, H: ArrayLike | None = None
    ) -> None:
        """Update where the noise of the observation correlates with the error of the prediction.

        With M = Cov(x - x_prior, v), the gain is K = (P H' + M) S^-1 with
        S = H P H' + H M + M' H' + R.

        Parameters
        ----------
        z : array_like
            The observation; None or NaN where missing.
        R : array_like, optional
            Used instead of the attribute ``R``; a scalar means that multiple of the identity.
        H : array_like, shape (m, dim_x), optional
            Used instead of the attribute ``H``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; an inadmissible ``R``; an S that cannot be inverted.

        References
        ----------
        D. Simon, Optimal State Estimation, Wiley 2006, section 7.1.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> kf.M = [[0.5]]
        >>> kf.update_correlated(3.0)
        >>> kf.K, kf.P
        (array([[0.5]]), array([[0.25]]))
        """
        self._remember()
        x, P, H, R = self._observation(R, H)
        M = as_matrix("M", self.M, (self.dim_x, H.shape[0]))
        value = as_observation(z, H.shape[0])
        if value is None:
            self._skip(x, P, H.shape[0])
            return
        value = value.reshape(-1, 1) if x.ndim == 2 else value
        self._correct(x, P, value, value - H.dot(x), H, R, M)

    def update_sequential(
        self, start: int, z_i: ArrayLike, R_i: ArrayLike | None = None, H_i: ArrayLike | None = None
    ) -> None:
        """Update with some neighbouring components of an observation.

        Where R is block diagonal, one call per block gives the same estimate as one
        update with all components.  The entries of z, y and K that belong to the
        block are written, S and SI are not; the likelihoods are those of the block
        given all that came before it.

        Parameters
        ----------
        start : int
            Index of the first component of the block.
        z_i : array_like
            The components; NaN where missing.
        R_i : array_like, optional
            Their noise covariance; by default that block of ``R``.
        H_i : array_like, shape (m, dim_x), optional
            Their rows of the observation matrix; by default those of ``H``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; a block outside the observation; an inadmissible ``R_i``.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf.kalman import KalmanFilter
        >>> whole = KalmanFilter(dim_x=2, dim_z=2, H=np.eye(2))
        >>> parts = whole.copy()
        >>> whole.update([1.0, 2.0])
        >>> parts.update_sequential(0, 1.0)
        >>> parts.update_sequential(1, 2.0)
        >>> bool(np.allclose(whole.x, parts.x))
        True
        """
        self._remember()
        x, P = self._state()
        length = np.size(z_i)
        stop = start + length
        if not 0 <= start < stop <= self.dim_z:
            raise ShapeError(
                f"start, z_i: got components {start} to {stop - 1}, expected some of 0 to {self.dim_z - 1}"
            )
        block = slice(start, stop)
        if H_i is None:
            H = as_matrix("H", self.H, (self.dim_z, self.dim_x))[block]
        else:
            H = as_matrix(
                "H_i", np.reshape(np.asarray(H_i, dtype=np.float64), (length, -1)), (length, self.dim_x)
            )
        R = (
            as_square("R", self.R, self.dim_z)[block, block]
            if R_i is None
            else as_covariance("R_i", R_i, length)
        )
        value = as_observation(np.ravel(np.asarray(z_i, dtype=np.float64)), length)
        z, y, K = self._whole(x.ndim)
        log_likelihood, distance = 0.0, 0.0
        if value is None:
            z[block], y[block] = np.nan, 0.0
            x, P = x.copy(), P.copy()
        else:
            value = value.reshape(-1, 1) if x.ndim == 2 else value
            y_i, seen = value - H.dot(x), seen_components(value)
            if seen is not None:
                y_i = np.where(seen.reshape(y_i.shape), y_i, 0.0)
            x, P, S_i, SI_i, K_i = self._conditioned(x, P, y_i, H, R, None, seen)
            z[block], y[block], K[:, block] = value, y_i, K_i
            flat = y_i.ravel()
            distance = float(flat.dot(SI_i).dot(flat))
            kept = slice(None) if seen is None else seen
            log_likelihood = engine.log_normal(flat[kept], S_i[kept][:, kept])
        self._set_posterior(x, P)
        self.z, self.y, self.K = z, y, K
        self._log_likelihood, self._mahalanobis = log_likelihood, sqrt(max(distance, 0.0))

    def _whole(self, ndim: int) -> tuple[np.ndarray, FloatArray, FloatArray]:
        """Copy z, y and K of a whole observation, to write a block into."""
        m = self.dim_z
        shape = (m,) if ndim == 1 else (m, 1)
        if np.size(self.z) == m and np.shape(self.K) == (self.dim_x, m):
            return np.array(self.z).reshape(shape), np.array(self.y).reshape(shape), np.array(self.K)
        return np.full(shape, None), np.zeros(shape), np.zeros((self.dim_x, m))

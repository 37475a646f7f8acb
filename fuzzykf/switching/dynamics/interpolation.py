"""Interpolation of covariances that stay positive definite."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["LogCovariance", "compose", "decompose"]


#: A residual variance below this share of the variance itself is rounding, hence zero.
SINGULAR = 1e-13


def decompose(V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take semi-definite matrices apart into their modified Cholesky factors, T V T' = diag(exp g).

    T is unit lower triangular: row k holds minus the coefficients of the regression
    of component k on the earlier ones, and exp(g_k) is the variance of its residual;
    g_k is minus infinity where there is none.

    Parameters
    ----------
    V : ndarray, shape (..., d, d)

    Returns
    -------
    T : ndarray, shape (..., d, d)
    g : ndarray, shape (..., d)
    """
    d = V.shape[-1]
    L = np.broadcast_to(np.eye(d), V.shape).copy()
    rest, variance = V.copy(), np.empty(V.shape[:-1])
    for k in range(d):
        residual = rest[..., k, k]
        residual = np.where(residual > SINGULAR * V[..., k, k], residual, 0.0)
        divisor = np.where(residual > 0.0, residual, np.inf)
        below = rest[..., k + 1 :, k] / divisor[..., None]
        rest[..., k + 1 :, k + 1 :] -= below[..., :, None] * rest[..., k, None, k + 1 :]
        L[..., k + 1 :, k], variance[..., k] = below, residual
    with np.errstate(divide="ignore"):
        return np.linalg.inv(L).astype(np.float64, copy=False), np.log(variance)


def compose(T: FloatArray, g: FloatArray) -> FloatArray:
    """Return the covariance that `decompose` takes apart."""
    inverse = np.linalg.solve(T, np.broadcast_to(np.eye(T.shape[-1]), T.shape))
    root = inverse * np.exp(0.5 * g)[..., None, :]
    product = root @ np.swapaxes(root, -1, -2)
    return product.astype(np.float64, copy=False)


class LogCovariance:
    """Covariances of n regimes (or pairs), interpolated in their modified Cholesky factors.

    In one dimension this is the interpolation of the log-variance.  The result is
    positive definite at every point.  A regime of its own is returned as given, also where
    its covariance is singular; between regimes a residual variance may be zero in all of
    them, and is zero then, but not in some only.

    Parameters
    ----------
    name : str
        For error messages.
    values : ndarray, shape (n, d, d)

    Examples
    --------
    >>> import numpy as np
    >>> between = LogCovariance("V", np.array([[[1.0]], [[4.0]]]))
    >>> round(float(between(np.array([0.5, 0.5]))[0, 0]), 12)
    2.0
    """

    def __init__(self, name: str, values: FloatArray) -> None:
        self.name, self.values = name, values
        self._T, g = decompose(values)
        none = np.isneginf(g)
        self._singular = none.all(axis=0)  # (d,): components without residual in every regime
        odd = none & ~self._singular
        self._odd = int(np.argmax(odd.any(axis=1))) if odd.any() else None
        self._g = np.where(none, 0.0, g)

    def __call__(self, shares: FloatArray) -> FloatArray:
        """Interpolate at ``shares`` (..., n), which sum to one along the last axis."""
        n, d = self.values.shape[0], self.values.shape[-1]
        flat = shares.reshape(-1, n)
        pure = flat.max(axis=1) >= 1.0 - 1e-15
        result = np.empty((len(flat), d, d))
        result[pure] = self.values[np.argmax(flat[pure], axis=1)]
        if not pure.all():
            if self._odd is not None:
                raise NotPositiveDefiniteError(
                    f"{self.name}: the matrix number {self._odd} is singular where others are not; between "
                    "regimes covariances are interpolated in their logarithm, which that does not admit"
                )
            mixed = flat[~pure]
            g = np.where(self._singular, -np.inf, mixed @ self._g)
            result[~pure] = compose((mixed @ self._T.reshape(n, -1)).reshape(-1, d, d), g)
        return result.reshape(*shares.shape[:-1], d, d)

    def pull_back(self, shares: FloatArray, by_result: FloatArray) -> FloatArray:
        """Return the gradient by the values (n, d, d) of what has a gradient by the results.

        Residual variances that are zero stay so.

        Parameters
        ----------
        shares : ndarray, shape (N, n)
        by_result : ndarray, shape (N, d, d)
            Symmetric.
        """
        pure = shares.max(axis=1) >= 1.0 - 1e-15
        by_values = np.zeros_like(self.values)
        np.add.at(by_values, np.argmax(shares[pure], axis=1), by_result[pure])
        if pure.all():
            return by_values
        mixed, G = shares[~pure], by_result[~pure]
        n, d = self._g.shape
        # at the results V = L D L', L = T^-1: dV = dL D L' + L dD L' + L D dL', dL = -L dT L
        variance = np.exp(np.where(self._singular, -np.inf, mixed @ self._g))
        L = np.linalg.inv((mixed @ self._T.reshape(n, -1)).reshape(-1, d, d))
        turned = np.swapaxes(L, -1, -2) @ G @ L
        by_T = -2.0 * turned * variance[:, None, :] @ np.swapaxes(L, -1, -2)
        by_g = np.diagonal(turned, axis1=-2, axis2=-1) * variance
        # at the values, with W = T dV T': dD = diag W, and dL = L times what is below the diagonal of W D^-1
        by_T, by_g = np.tensordot(mixed.T, by_T, 1), mixed.T @ by_g
        inverse = np.where(self._singular, 0.0, np.exp(-self._g))
        T_t = np.swapaxes(self._T, -1, -2)
        by_W = np.tril(-by_T @ T_t * inverse[:, None, :], -1) + np.eye(d) * (by_g * inverse)[:, None, :]
        by_V = T_t @ by_W @ self._T
        both: FloatArray = by_values + 0.5 * (by_V + np.swapaxes(by_V, -1, -2))
        return both

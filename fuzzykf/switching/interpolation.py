"""Interpolation of covariances that stay positive definite."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray

__all__ = ["LogCovariance", "compose", "decompose"]


def decompose(V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take positive definite matrices apart into their modified Cholesky factors, T V T' = diag(exp g).

    T is unit lower triangular: row k holds minus the coefficients of the regression
    of component k on the earlier ones, and exp(g_k) is the variance of its residual.

    Parameters
    ----------
    V : ndarray, shape (..., d, d)

    Returns
    -------
    T : ndarray, shape (..., d, d)
    g : ndarray, shape (..., d)
    """
    L = np.linalg.cholesky(V).astype(np.float64, copy=False)
    diagonal = np.diagonal(L, axis1=-2, axis2=-1)
    T = np.linalg.solve(L / diagonal[..., None, :], np.broadcast_to(np.eye(V.shape[-1]), V.shape))
    return np.tril(T), 2.0 * np.log(diagonal)


def compose(T: FloatArray, g: FloatArray) -> FloatArray:
    """Return the covariance that `decompose` takes apart."""
    inverse = np.linalg.solve(T, np.broadcast_to(np.eye(T.shape[-1]), T.shape))
    root = inverse * np.exp(0.5 * g)[..., None, :]
    product = root @ np.swapaxes(root, -1, -2)
    return product.astype(np.float64, copy=False)


class LogCovariance:
    """Covariances of n regimes (or pairs), interpolated in their modified Cholesky factors.

    In one dimension this is the interpolation of the log-variance.  The result is
    positive definite at every point, and a regime of its own is returned as given, also
    where its covariance is singular.

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
        self._factors: tuple[FloatArray, FloatArray] | None
        try:
            self._factors = decompose(values)
        except np.linalg.LinAlgError:
            self._factors = None

    def __call__(self, shares: FloatArray) -> FloatArray:
        """Interpolate at ``shares`` (..., n), which sum to one along the last axis."""
        n, d = self.values.shape[0], self.values.shape[-1]
        flat = shares.reshape(-1, n)
        pure = flat.max(axis=1) >= 1.0 - 1e-15
        result = np.empty((len(flat), d, d))
        result[pure] = self.values[np.argmax(flat[pure], axis=1)]
        if not pure.all():
            if self._factors is None:
                singular = int(np.argmin(np.linalg.eigvalsh(self.values)[:, 0]))
                raise NotPositiveDefiniteError(
                    f"{self.name}: the matrix number {singular} is singular; between regimes covariances are "
                    "interpolated in their logarithm, which needs positive definite ones"
                )
            T, g = self._factors
            mixed = flat[~pure]
            result[~pure] = compose((mixed @ T.reshape(n, -1)).reshape(-1, d, d), mixed @ g)
        return result.reshape(*shares.shape[:-1], d, d)

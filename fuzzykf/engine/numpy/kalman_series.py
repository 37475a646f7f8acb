"""Kernels of the linear Kalman filter for whole series: many at once, and the smoother."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.kalman import correct_stack, gain_stack, predict_stack
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import LOG_2PI

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray

__all__ = ["filter_linear_many", "rts_gains", "smooth_linear"]


@QUIET
def filter_linear_many(
    x: FloatArray,
    P: FloatArray,
    zs: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    H: FloatArray,
    R: FloatArray,
    alpha_sq: float,
    controls: FloatArray | None,
    out: dict[str, FloatArray],
) -> None:
    """Run one linear filter along many series at once.

    The covariances do not depend on what is observed, only on which components
    are.  So series are kept in groups with one covariance each, which split when
    their patterns of missing components part.

    Parameters
    ----------
    x, P : ndarray, shapes (n,) and (n, n)
        Where every series starts.
    zs : ndarray, shape (series, steps, m)
        NaN where missing.
    F, Q, H, R : ndarray, shapes (n, n), (n, n), (m, n), (m, m)
        Or with a leading axis for the steps, or more of them, which all series share.
    controls : ndarray, shape (series or 1, steps, n), or None
        The terms B u.
    out : dict of ndarray
        Filled: ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, as far
        as they are there, each of shape (series, steps, ...), float64 or float32.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance S of a residual is not positive definite.
    """
    n_series, n_steps, _ = zs.shape
    x, P = np.broadcast_to(x, (n_series, len(x))), P[None]
    group = np.zeros(n_series, dtype=np.intp)
    all_seen: NDArray[np.bool_] = np.asarray(~np.isnan(zs), dtype=np.bool_)
    zs = np.where(all_seen, zs, 0.0)
    every = F, Q, H, R
    for t in range(n_steps):
        F, Q, H, R = (one if one.ndim == 2 else one[t] for one in every)
        x = x @ F.T
        if controls is not None:
            x = x + controls[:, t]
        P = predict_stack(P, F, Q, alpha_sq)
        if "x_prior" in out:
            out["x_prior"][:, t] = x
        if "P_prior" in out:
            out["P_prior"][:, t] = P if len(P) == n_series else P[group]
        y, seen = zs[:, t] - x @ H.T, all_seen[:, t]  # the gain is zero where nothing was seen
        pattern = None
        if not seen.all():
            P, group, pattern = _split(P, group, seen)
        _, SI, K, log_det = gain_stack(P, H, R, pattern)
        prior, P = P, correct_stack(P, K, H, R)
        if pattern is not None:  # as it was where nothing was seen
            P = np.where(np.asarray(pattern.any(axis=1))[:, None, None], P, prior)
        x = x + _apply(K, y, group)
        if "x" in out:
            out["x"][:, t] = x
        if "P" in out:
            out["P"][:, t] = P if len(P) == n_series else P[group]
        if "log_likelihood" in out:
            count = seen.sum(axis=1)
            distance = (_apply(SI, y, group) * y).sum(axis=1)
            distance[np.isnan(distance) & np.isfinite(y).all(axis=1)] = np.inf  # terms beyond all numbers
            log_det = log_det if len(P) == n_series else log_det[group]
            out["log_likelihood"][:, t] = -0.5 * (distance + count * LOG_2PI + log_det)


def _split(
    P: FloatArray, group: NDArray[np.intp], seen: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.bool_]]:
    """Part the groups of series whose patterns ``seen`` (series, m) differ.

    Returns the covariance of each new group, the group of each series, and the
    pattern of each group.
    """
    if len(P) == len(group):
        return P, group, seen
    label = group
    for column in seen.T:
        label = np.unique(2 * label + column, return_inverse=True)[1]
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    if len(first) == len(group):
        return P[group], group, seen
    return P[group[first]], label, seen[first]


def _apply(A: FloatArray, v: FloatArray, group: NDArray[np.intp]) -> FloatArray:
    """Products A[group[k]] v[k] for the vectors v (series, k)."""
    if len(A) == 1:
        shared: FloatArray = v @ A[0].T
        return shared
    if len(A) != len(v):
        A = A[group]
    product: FloatArray = (A @ v[..., None])[..., 0]
    return product


@QUIET
def rts_gains(P: FloatArray, P_prior: FloatArray, F: FloatArray) -> FloatArray:
    """Gains C_k = P_k F_{k+1}' (P_{k+1}^-)^-1 of the smoother of Rauch, Tung and Striebel.

    Where a predicted covariance is singular its pseudo-inverse takes the place of
    the inverse: the rows of P F' lie in its range, so that the gain is exact.

    Parameters
    ----------
    P : ndarray, shape (n - 1, d, d)
        Filtered covariances at 0 .. n - 2.
    P_prior, F : ndarray, shape (n - 1, d, d)
        Predicted covariances and transitions at 1 .. n - 1.
    """
    FP = F @ P
    try:
        np.linalg.cholesky(P_prior)
        solved: FloatArray = np.asarray(np.linalg.solve(P_prior, FP), dtype=np.float64)
    except np.linalg.LinAlgError:
        solved = np.asarray(np.linalg.pinv(P_prior, hermitian=True) @ FP, dtype=np.float64)
    gains: FloatArray = solved.mT
    return gains


@QUIET
def smooth_linear(
    x: FloatArray, P: FloatArray, x_prior: FloatArray, C: FloatArray, F: FloatArray, Q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Backward recursion of the smoother along one series.

    x^s_k = x_k + C_k (x^s_{k+1} - x^-_{k+1});
    P^s_k = (I - C_k F) P_k (I - C_k F)' + C_k (P^s_{k+1} + Q) C_k', which equals
    P_k + C_k (P^s_{k+1} - P^-_{k+1}) C_k' but cannot become indefinite.

    Parameters
    ----------
    x, x_prior : ndarray, shape (n, d)
    P : ndarray, shape (n, d, d)
    C, F, Q : ndarray, shape (n - 1, d, d)
        Gains from `rts_gains`; transitions and noise covariances at 1 .. n - 1.
    """
    x, P = x.copy(), P.copy()
    A: FloatArray = np.eye(x.shape[1]) - C @ F
    for k in range(len(x) - 2, -1, -1):
        x[k] += C[k].dot(x[k + 1] - x_prior[k + 1])
        P[k] = A[k].dot(P[k]).dot(A[k].T) + C[k].dot(P[k + 1] + Q[k]).dot(C[k].T)
    smoothed: FloatArray = 0.5 * (P + P.mT)
    return x, smoothed

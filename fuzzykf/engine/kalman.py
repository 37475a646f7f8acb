"""Kernels of the Kalman filters: one filter, stacks of filters, whole series.

All functions work on float64 arrays whose shapes their callers have checked.
``x`` is a column (n, 1) or flat (n,) in the functions for one filter, and
(..., n) in those for stacks, whose leading axes broadcast.  ``n`` is the
dimension of the state, ``m`` that of an observation.
"""

from __future__ import annotations

from functools import cache
from math import inf, log
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.gaussian import LOG_2PI, log_density

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.base import FloatArray

__all__ = [
    "correct_stack",
    "filter_many",
    "gain_stack",
    "inverse",
    "inverse_seen",
    "inverse_stack",
    "log_normal",
    "log_normal_stack",
    "predict",
    "predict_stack",
    "rts_gains",
    "smooth",
    "update",
    "update_correlated",
]

_HALF = np.array(0.5)  # numpy converts a Python float at every use

#: A pivot that is smaller than this fraction of its diagonal entry is rounding error.
PIVOT_TOLERANCE = 4.0 * float(np.finfo(np.float64).eps)


# --------------------------------------------------------------------------- one filter


def predict(
    x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: float
) -> tuple[FloatArray, FloatArray]:
    """Return F x and alpha^2 F P F' + Q, equations (69) and (70) of the 2001 paper."""
    P = F.dot(P).dot(F.T)
    if alpha_sq != 1.0:
        P *= alpha_sq
    P += Q
    return F.dot(x), P


def update(
    x: FloatArray,
    P: FloatArray,
    y: FloatArray,
    H: FloatArray,
    R: FloatArray,
    identity: FloatArray,
    invert: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Condition on the residual y: equations (72), (73), and (74) in Joseph's form.

    S = H P H' + R, K = P H' S^-1, x + K y, (I - K H) P (I - K H)' + K R K'.

    Returns
    -------
    x, P, S, S^-1, K
    """
    PHT = P.dot(H.T)
    S = H.dot(PHT)
    S += R
    SI = invert(S)
    K = PHT.dot(SI)
    A = identity - K.dot(H)
    P = A.dot(P).dot(A.T)
    P += K.dot(R).dot(K.T)
    P = P + P.T
    P *= _HALF
    return x + K.dot(y), P, S, SI, K


def update_correlated(
    x: FloatArray,
    P: FloatArray,
    y: FloatArray,
    H: FloatArray,
    R: FloatArray,
    M: FloatArray,
    identity: FloatArray,
    invert: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """`update` where the error of x and the noise of z have the covariance M (n, m).

    S = H P H' + H M + M' H' + R, K = (P H' + M) S^-1, and Joseph's form has two
    terms more, -(I - K H) M K' and its transpose.
    """
    PHT, HM = P.dot(H.T), H.dot(M)
    S = H.dot(PHT) + HM + HM.T + R
    SI = invert(S)
    K = (PHT + M).dot(SI)
    A = identity - K.dot(H)
    cross = A.dot(M).dot(K.T)
    P = A.dot(P).dot(A.T) + K.dot(R).dot(K.T) - cross - cross.T
    return x + K.dot(y), 0.5 * (P + P.T), S, SI, K


def inverse(S: FloatArray) -> FloatArray:
    """Inverse of a positive definite matrix; LinAlgError for any other.

    Up to two dimensions by the pivots of L D L' in plain floats: a call of LAPACK
    costs more than all other arithmetic of a small filter.
    """
    m = S.shape[0]
    if m == 1:
        s = float(S[0, 0])
        if not 0.0 < s < inf:
            raise np.linalg.LinAlgError("S is not positive definite")
        return np.array(((1.0 / s,),))
    if m == 2:
        (a, b), (_, c) = S.tolist()
        if 0.0 < a < inf:
            ratio = b / a
            pivot = c - ratio * b
            if PIVOT_TOLERANCE * c < pivot < inf:
                off = -ratio / pivot
                return np.array(((1.0 / a - ratio * off, off), (off, 1.0 / pivot)))
        raise np.linalg.LinAlgError("S is not positive definite")
    dposv, identity = _positive_solver(m)
    _, SI, info = dposv(S, identity, lower=1)
    if info != 0:
        raise np.linalg.LinAlgError("S is not positive definite")
    solution: FloatArray = SI
    return solution


@cache
def _positive_solver(m: int) -> tuple[Callable[..., Any], FloatArray]:
    """LAPACK's solver by Cholesky factors, and an identity; scipy is loaded at the first use."""
    from scipy.linalg.lapack import dposv

    return dposv, np.eye(m)


def inverse_seen(S: FloatArray, seen: np.ndarray, invert: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Inverse of the block of S that belongs to the components seen, zero elsewhere.

    With it in the place of S^-1 every formula of the update conditions on these
    components alone.
    """
    block = np.ix_(seen, seen)
    SI = np.zeros_like(S)
    SI[block] = invert(np.ascontiguousarray(S[block]))
    return SI


def log_normal(y: FloatArray, S: FloatArray) -> float:
    """Log of N(y; 0, S) for flat y.

    Where S is singular, the density on its range (minus infinity outside it), as
    scipy's ``allow_singular`` has it: what remains when an update used a
    pseudo-inverse.
    """
    m = y.shape[0]
    if m == 1:
        s = float(S[0, 0])
        if s > 0.0:
            r = float(y[0])
            return -0.5 * (r * (r / s) + LOG_2PI + log(s))
    try:
        return float(log_density(y, np.asarray(np.linalg.cholesky(S), dtype=np.float64)))
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(S)
    kept = values > 1e6 * np.finfo(np.float64).eps * np.abs(values).max()
    part = vectors.T @ y
    if np.abs(part[~kept]).max(initial=0.0) > 1e-8 * np.abs(part).max(initial=0.0):
        return -inf
    part, values = part[kept], values[kept]
    return float(-0.5 * ((part * part / values).sum() + len(values) * LOG_2PI + np.log(values).sum()))


# --------------------------------------------------------------------------- stacks of filters


def inverse_stack(S: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses and log-determinants of positive definite matrices (..., m, m).

    LinAlgError if one of them is not positive definite.
    """
    m = S.shape[-1]
    if m == 1:
        s = S[..., 0, 0]
        if not (s > 0.0).all():
            raise np.linalg.LinAlgError("S is not positive definite")
        return 1.0 / S, np.log(s)
    if m == 2:
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        if not (a > 0.0).all():
            raise np.linalg.LinAlgError("S is not positive definite")
        ratio = b / a
        pivot = c - ratio * b
        if not (pivot > PIVOT_TOLERANCE * c).all():
            raise np.linalg.LinAlgError("S is not positive definite")
        SI = np.empty_like(S)
        off = -ratio / pivot
        SI[..., 0, 0] = 1.0 / a - ratio * off
        SI[..., 0, 1] = SI[..., 1, 0] = off
        SI[..., 1, 1] = 1.0 / pivot
        return SI, np.log(a) + np.log(pivot)
    factor = np.linalg.cholesky(S)
    pivots = np.diagonal(factor, axis1=-2, axis2=-1)
    root = np.linalg.inv(factor)
    return np.swapaxes(root, -1, -2) @ root, 2.0 * np.log(pivots).sum(axis=-1)


def predict_stack(P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: FloatArray | float) -> FloatArray:
    """Return alpha^2 F P F' + Q for covariances (..., n, n); alpha^2 broadcasts against them."""
    moved: FloatArray = F @ P @ np.swapaxes(F, -1, -2)
    moved *= alpha_sq
    moved += Q
    return moved


def gain_stack(
    P: FloatArray, H: FloatArray, R: FloatArray, seen: np.ndarray | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return S, S^-1, K and log det S for covariances (..., n, n).

    ``seen`` (..., m) marks the components observed (None: all); inverse and
    determinant are those of their block, as in `inverse_seen`.
    """
    PHT = P @ np.swapaxes(H, -1, -2)
    S = H @ PHT
    S += R
    if seen is None:
        SI, log_det = inverse_stack(S)
    else:
        block = seen[..., :, None] & seen[..., None, :]
        SI, log_det = inverse_stack(np.where(block, S, np.eye(S.shape[-1])))
        SI = np.where(block, SI, 0.0)
    return S, SI, PHT @ SI, log_det


def correct_stack(P: FloatArray, K: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Joseph's form of the updated covariance for covariances (..., n, n)."""
    A = np.eye(P.shape[-1]) - K @ H
    P = A @ P @ np.swapaxes(A, -1, -2)
    P += K @ R @ np.swapaxes(K, -1, -2)
    P = P + np.swapaxes(P, -1, -2)
    P *= 0.5
    return P


def log_normal_stack(
    y: FloatArray, SI: FloatArray, log_det: FloatArray, seen: np.ndarray | None
) -> FloatArray:
    """Log of N(y; 0, S) for y (..., m), zero where nothing was seen."""
    count = y.shape[-1] if seen is None else seen.sum(axis=-1)
    distance = ((SI @ y[..., None])[..., 0] * y).sum(axis=-1)
    value: FloatArray = -0.5 * (distance + count * LOG_2PI + log_det)
    return value


# --------------------------------------------------------------------------- whole series


def filter_many(
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
    controls : ndarray, shape (series or 1, steps, n), or None
        The terms B u.
    out : dict of ndarray
        Filled: ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, as far
        as they are there, each of shape (series, steps, ...).
    """
    n_series, n_steps, _ = zs.shape
    x, P = np.broadcast_to(x, (n_series, len(x))), P[None]
    group = np.zeros(n_series, dtype=np.intp)
    all_seen: np.ndarray = np.asarray(~np.isnan(zs))
    zs = np.where(all_seen, zs, 0.0)
    complete = np.atleast_1d(all_seen.all(axis=(0, 2)))
    for t in range(n_steps):
        x = x @ F.T
        if controls is not None:
            x = x + controls[:, t]
        P = predict_stack(P, F, Q, alpha_sq)
        if "x_prior" in out:
            out["x_prior"][:, t] = x
        if "P_prior" in out:
            out["P_prior"][:, t] = P if len(P) == n_series else P[group]
        y, seen = zs[:, t] - x @ H.T, None
        if not complete[t]:
            P, group, seen = _split(P, group, all_seen[:, t])
            y = np.where(all_seen[:, t], y, 0.0)
        _, SI, K, log_det = gain_stack(P, H, R, seen)
        P = correct_stack(P, K, H, R)
        x = x + _apply(K, y, group)
        if "x" in out:
            out["x"][:, t] = x
        if "P" in out:
            out["P"][:, t] = P if len(P) == n_series else P[group]
        if "log_likelihood" in out:
            count = all_seen[:, t].sum(axis=1)
            distance = (_apply(SI, y, group) * y).sum(axis=1)
            log_det = log_det if len(P) == n_series else log_det[group]
            out["log_likelihood"][:, t] = -0.5 * (distance + count * LOG_2PI + log_det)


def _split(P: FloatArray, group: np.ndarray, seen: np.ndarray) -> tuple[FloatArray, np.ndarray, np.ndarray]:
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
        return P[group], np.arange(len(group)), seen
    return P[group[first]], label, seen[first]


def _apply(A: FloatArray, v: FloatArray, group: np.ndarray) -> FloatArray:
    """Products A[group[k]] v[k] for the vectors v (series, k)."""
    if len(A) == 1:
        shared: FloatArray = v @ A[0].T
        return shared
    if len(A) != len(v):
        A = A[group]
    product: FloatArray = (A @ v[..., None])[..., 0]
    return product


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
        solved = np.linalg.solve(P_prior, FP)
    except np.linalg.LinAlgError:
        solved = np.linalg.pinv(P_prior, hermitian=True) @ FP
    return np.swapaxes(solved, -1, -2)


def smooth(
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
    A = np.eye(x.shape[1]) - C @ F
    for k in range(len(x) - 2, -1, -1):
        x[k] += C[k].dot(x[k + 1] - x_prior[k + 1])
        P[k] = A[k].dot(P[k]).dot(A[k].T) + C[k].dot(P[k + 1] + Q[k]).dot(C[k].T)
    return x, 0.5 * (P + np.swapaxes(P, -1, -2))

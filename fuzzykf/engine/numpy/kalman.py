"""Kernels of the Kalman filters: one filter, a step or a series, and stacks of filters.

All functions work on float64 arrays whose shapes their callers have checked.
``x`` is a column (n, 1) or flat (n,) in the functions for one filter, and
(..., n) in those for stacks, whose leading axes broadcast.  ``n`` is the
dimension of the state, ``m`` that of an observation.
"""

from __future__ import annotations

from functools import cache
from math import inf, isfinite, isnan, log
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import LOG_2PI, log_density

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray

__all__ = [
    "correct_stack",
    "filter_linear",
    "gain_stack",
    "inverse",
    "inverse_seen",
    "inverse_stack",
    "log_normal",
    "log_normal_stack",
    "predict_linear",
    "predict_stack",
    "seen_components",
    "update_correlated",
    "update_linear",
    "update_residual",
]

_HALF = np.array(0.5)  # numpy converts a Python float at every use

#: A pivot that is smaller than this fraction of its diagonal entry is rounding error.
PIVOT_TOLERANCE = 16.0 * float(np.finfo(np.float64).eps)


# --------------------------------------------------------------------------- one filter


@QUIET
def predict_linear(
    x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: float
) -> tuple[FloatArray, FloatArray]:
    """Return F x and alpha^2 F P F' + Q, equations (69) and (70) of the 2001 paper."""
    P = F.dot(P).dot(F.T)
    if alpha_sq != 1.0:
        P *= alpha_sq
    P += Q
    return F.dot(x), P


@QUIET
def update_residual(
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

    Raises
    ------
    LinAlgError
        If S cannot be inverted, or P overflows.
    """
    PHT = P.dot(H.T)
    S = H.dot(PHT)
    S += R
    SI = invert(S)
    K = PHT.dot(SI)
    A = identity - K.dot(H)
    P = A.dot(P).dot(A.T)
    P += K.dot(R).dot(K.T)
    symmetric = P.T.copy()  # numpy adds arrays of one order much faster than P and P.T
    symmetric += P
    symmetric *= _HALF
    if not isfinite(symmetric.trace()):
        raise np.linalg.LinAlgError("the covariance has left the range of numbers")
    return x + K.dot(y), symmetric, S, SI, K


@QUIET
def update_linear(
    x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Condition on z, in which NaN is missing, with a positive definite S.

    Returns
    -------
    x, P, y, S, S^-1, K
        y is zero where z is missing, and S^-1 the inverse of the block that was observed,
        bordered by zeros.
    """
    y = z - H.dot(x)
    seen = seen_components(z)
    invert = inverse
    if seen is not None:
        y = np.where(seen.reshape(y.shape), y, 0.0)

        def invert(S: FloatArray) -> FloatArray:
            return inverse_seen(S, seen, inverse)

    x, P, S, SI, K = update_residual(x, P, y, H, R, _identity(len(P)), invert)
    return x, P, y, S, SI, K


@QUIET
def filter_linear(
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
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Run one linear filter along one series.

    Parameters
    ----------
    x, P : ndarray, shapes (n,) or (n, 1), and (n, n)
        Where the series starts.
    zs : ndarray, shape (steps, m)
        NaN where missing.
    controls : ndarray, shape (steps, n), or None
        The terms B u.
    out : dict of ndarray
        Filled: ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, as far as they are
        there, each of shape (steps, ...).

    Returns
    -------
    y, S, SI, K : ndarray
        Of the latest step of which something was observed; None if there is none.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance S of a residual is not positive definite.
    """
    zs = zs[..., None] if x.ndim == 2 else zs
    innovation = None
    for t, z in enumerate(zs):
        x, P = predict_linear(x, P, F, Q, alpha_sq)
        if controls is not None:
            x = x + controls[t].reshape(x.shape)
        for name, value in (("x_prior", x), ("P_prior", P)):
            if name in out:
                out[name][t] = value.reshape(out[name][t].shape)
        log_likelihood = 0.0
        if not np.isnan(z).all():
            x, P, y, S, SI, K = update_linear(x, P, z, H, R)
            innovation = y, S, SI, K
            if "log_likelihood" in out:
                seen = seen_components(z)
                kept = slice(None) if seen is None else seen
                log_likelihood = log_normal(y.ravel()[kept], S[kept][:, kept])
        for name, value in (("x", x), ("P", P)):
            if name in out:
                out[name][t] = value.reshape(out[name][t].shape)
        if "log_likelihood" in out:
            out["log_likelihood"][t] = log_likelihood
    return innovation


def seen_components(z: FloatArray) -> np.ndarray | None:
    """Which components of z were observed, (m,); None if all were."""
    if len(z) == 1 or not any(map(isnan, z.ravel().tolist())):
        return None  # a single component that is missing has been dealt with before
    seen: np.ndarray = np.logical_not(np.isnan(z.ravel()))
    return seen


@QUIET
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
    """`update_residual` where the error of x and the noise of z have the covariance M (n, m).

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
    factor, SI, info = _positive_solver()(S, _identity(m), lower=1)
    if info != 0:
        raise np.linalg.LinAlgError("S is not positive definite")
    for pivot, entry in zip(factor.diagonal().tolist(), S.diagonal().tolist(), strict=True):
        if not pivot * pivot > PIVOT_TOLERANCE * entry:
            raise np.linalg.LinAlgError("S is singular, to rounding error")
    solution: FloatArray = SI
    return solution


@cache
def _positive_solver() -> Callable[..., Any]:
    """LAPACK's solver by Cholesky factors; scipy is loaded at the first use."""
    from scipy.linalg.lapack import dposv

    solver: Callable[..., Any] = dposv
    return solver


@cache
def _identity(n: int) -> FloatArray:
    identity = np.eye(n)
    identity.flags.writeable = False
    return identity


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
    if m == 2:  # in plain floats, as `inverse`
        (u, v), ((a, b), (_, c)) = y.tolist(), S.tolist()
        if 0.0 < a < inf:
            ratio = b / a
            pivot = c - ratio * b
            if PIVOT_TOLERANCE * c < pivot < inf:
                v -= ratio * u
                distance: float = u * (u / a) + v * (v / pivot)
                return -0.5 * (distance + 2.0 * LOG_2PI + log(a) + log(pivot))
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
    if m == 2 and S.size <= 64:
        return _inverse_few(S)
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
    if not (pivots * pivots > PIVOT_TOLERANCE * np.diagonal(S, axis1=-2, axis2=-1)).all():
        raise np.linalg.LinAlgError("S is singular, to rounding error")
    root = np.linalg.inv(factor)
    return root.mT @ root, 2.0 * np.log(pivots).sum(axis=-1)


def _inverse_few(S: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`inverse_stack` for a few 2 x 2 matrices, in plain floats as `inverse`."""
    inverses, log_dets = [], []
    for a, b, _, c in S.reshape(-1, 4).tolist():
        ratio = b / a if a > 0.0 else inf
        pivot = c - ratio * b
        if not (0.0 < a < inf and PIVOT_TOLERANCE * c < pivot < inf):
            raise np.linalg.LinAlgError("S is not positive definite")
        off = -ratio / pivot
        inverses.append((1.0 / a - ratio * off, off, off, 1.0 / pivot))
        log_dets.append(log(a) + log(pivot))
    return np.array(inverses).reshape(S.shape), np.array(log_dets).reshape(S.shape[:-2])


@QUIET
def predict_stack(P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: FloatArray | float) -> FloatArray:
    """Return alpha^2 F P F' + Q for covariances (..., n, n); alpha^2 broadcasts against them."""
    moved: FloatArray = F @ P @ F.mT
    if not (isinstance(alpha_sq, float) and alpha_sq == 1.0):
        moved *= alpha_sq
    moved += Q
    return moved


@QUIET
def gain_stack(
    P: FloatArray, H: FloatArray, R: FloatArray, seen: np.ndarray | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return S, S^-1, K and log det S for covariances (..., n, n).

    ``seen`` (..., m) marks the components observed (None: all); inverse and
    determinant are those of their block, as in `inverse_seen`.
    """
    PHT = P @ H.mT
    S = H @ PHT
    S += R
    if seen is None:
        SI, log_det = inverse_stack(S)
    else:
        block = seen[..., :, None] & seen[..., None, :]
        SI, log_det = inverse_stack(np.where(block, S, _identity(S.shape[-1])))
        SI = np.where(block, SI, 0.0)
    return S, SI, PHT @ SI, log_det


@QUIET
def correct_stack(P: FloatArray, K: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Joseph's form of the updated covariance for covariances (..., n, n)."""
    A = _identity(P.shape[-1]) - K @ H
    P = A @ P @ A.mT
    P += K @ R @ K.mT
    symmetric: FloatArray = P.mT.copy()
    symmetric += P
    symmetric *= _HALF
    return symmetric


def log_normal_stack(
    y: FloatArray, SI: FloatArray, log_det: FloatArray, seen: np.ndarray | None
) -> FloatArray:
    """Log of N(y; 0, S) for y (..., m), zero where nothing was seen."""
    count = y.shape[-1] if seen is None else seen.sum(axis=-1)
    distance = (y[..., None, :] @ (SI @ y[..., None]))[..., 0, 0]
    value: FloatArray = -0.5 * (distance + count * LOG_2PI + log_det)
    return value

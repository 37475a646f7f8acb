"""Steps of the smoother where a part of the window of latest observations was missing.

There the future tells of r_n and X_n through the missing part u of the window.  Given the next
node j, what it tells of the next window is a function L_j(u'), the ratio of the
smoothed to the filtered law of u', taken as Gaussian:

    L_j(u') proportional to exp(-(u' - a)' Lam (u' - a)/2 + eta' (u' - a)),
    Lam = Vs^-1 - Vf^-1,  eta = Vs^-1 (ms - mf),  a = mf,

with mf, Vf the filtered and ms, Vs the smoothed moments given j.  Against the law of u' in
each pair (i, j) it gives the weight of the pair, and the moments of u' in it; those of
the window before follow by regression, and those of X from that.

All of this is exact if the future is linear and Gaussian given j, as with a single class.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import mixture_moments, symmetrize

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.inference.mixture import Mixture

__all__ = ["Moments", "smooth_state", "step_back"]

#: Shares of the variance of u' that the future leaves; below, it is taken as known.
_KNOWN = 1e-12


class Moments(NamedTuple):
    """Mean (..., w) and covariance (..., w, w) of a window."""

    mean: FloatArray
    covariance: FloatArray


def step_back(
    tables: PairTables,
    mixture: Mixture,
    y: FloatArray,
    filtered: Moments,
    smoothed: Moments,
    gamma: FloatArray,
) -> tuple[FloatArray, Moments]:
    """Step back into an observation in whose window, or in the next, a part is missing.

    Parameters
    ----------
    tables : PairTables
        Of the step from here to the next observation ``y``, NaN where missing.
    mixture : Mixture
        What the filter knew here.
    filtered, smoothed : Moments
        Of the next window, given each next node, leading shape (M,).
    gamma : ndarray, shape (M,)
        Smoothed probabilities of the next nodes.

    Returns
    -------
    gamma : ndarray, shape (M,)
    window : Moments
        Smoothed moments of the window here, given each node.
    """
    m, q = tables.pairs.dim_x, y.size
    following = slice(m, m + filtered.mean.shape[1])  # the next window, which begins with y
    before = engine.pair_moments(tables.transition, tables.pairs, mixture.table, mixture.sign, mixture.window)
    x, P = engine.window_moments(mixture.table, mixture.window)
    after = engine.condition_pairs(before, y, m)
    law = Moments(after.mean[..., following], after.covariance[..., following, following])
    log_evidence, updated = _weigh(law, filtered, smoothed)
    joint = engine.collapse_weights(after.log_w + log_evidence, after.sign)[2] * gamma  # p(i, j | y_1..N)
    total = joint.sum(axis=1)
    # regression of the window here on the next one
    S = before.covariance[..., following, following]
    J = _divide(before.covariance[..., m + q :, following], S)
    mean = x[:, None, m:] + (J @ (updated.mean - before.mean[..., following])[..., None])[..., 0]
    change = J @ (updated.covariance - S) @ np.swapaxes(J, -1, -2)
    # a node that is impossible by now keeps any finite moments
    share = np.where(total[:, None] != 0.0, joint, 1.0)
    share = share / share.sum(axis=1, keepdims=True)
    return total, Moments(*mixture_moments(share, mean, P[:, None, m:, m:] + change))


def smooth_state(mixture: Mixture, window: Moments, m: int) -> tuple[FloatArray, FloatArray]:
    """Moments of X per node, given the smoothed moments of the window.

    With B = P_xw P_ww^-1: x + B (ms - mf) and P_xx + B (Vs - P_ww) B'.
    """
    mean, P = engine.window_moments(mixture.table, mixture.window)
    B = _divide(P[:, :m, m:], P[:, m:, m:])
    x = mean[:, :m] + (B @ (window.mean - mean[:, m:])[..., None])[..., 0]
    change = window.covariance - P[:, m:, m:]
    return x, symmetrize(P[:, :m, :m] + B @ change @ np.swapaxes(B, -1, -2))


def _weigh(law: Moments, filtered: Moments, smoothed: Moments) -> tuple[FloatArray, Moments]:
    """Weigh the law of the next window in each pair by what the future tells of it.

    Parameters
    ----------
    law : Moments
        Given each pair, leading shape (M1, M2).
    filtered, smoothed : Moments
        Given each next node, leading shape (M2,).

    Returns
    -------
    log_evidence : ndarray, shape (M1, M2)
        Logarithm of the mean of L_j under the law of the pair.
    updated : Moments
        Of the law of the pair times L_j.
    """
    std = np.sqrt(np.diagonal(filtered.covariance, axis1=-2, axis2=-1))
    scale = np.where(std > 0.0, std, 1.0)  # in units of it, whatever those of the components are
    both = scale[..., :, None] * scale[..., None, :]
    information, vector = _message(
        filtered.covariance / both,
        smoothed.covariance / both,
        (smoothed.mean - filtered.mean) / scale,
        std == 0.0,
    )
    off, C = (law.mean - filtered.mean) / scale, law.covariance / both
    A = np.eye(off.shape[-1]) + C @ information
    covariance: FloatArray = np.linalg.solve(A, C)
    shift = np.linalg.solve(A, (off + (C @ vector[..., None])[..., 0])[..., None])[..., 0]
    log_evidence = 0.5 * (
        ((vector - (information @ off[..., None])[..., 0]) * shift).sum(axis=-1)
        + (vector * off).sum(axis=-1)
        - np.linalg.slogdet(A)[1]
    )
    return log_evidence, Moments(filtered.mean + scale * shift, symmetrize(covariance) * both)


def _message(
    filtered: FloatArray, smoothed: FloatArray, moved: FloatArray, known: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Lam (M, w, w) and eta (M, w) of the future, zero for the ``known`` parts of a window (M, w).

    Parameters
    ----------
    filtered, smoothed : ndarray, shape (M, w, w)
        Covariances Vf and Vs.
    moved : ndarray, shape (M, w)
        ms - mf.
    known : ndarray of bool, shape (M, w)
    """
    unit = np.where(known[..., :, None] & known[..., None, :], np.eye(known.shape[-1]), 0.0)
    L = np.linalg.cholesky(filtered + unit)
    half = np.linalg.solve(L, smoothed + unit)
    ratio = np.linalg.solve(L, np.swapaxes(half, -1, -2)).astype(np.float64, copy=False)
    values, vectors = np.linalg.eigh(symmetrize(ratio))
    # mixtures may widen what one class can only narrow; then nothing is known of the direction
    values = np.clip(values, _KNOWN, 1.0)
    T = np.swapaxes(vectors, -1, -2) @ np.linalg.inv(L)
    Tt = np.swapaxes(T, -1, -2)
    vector = Tt @ ((T @ moved[..., None]) / values[..., None])
    return Tt @ ((1.0 / values - 1.0)[..., None] * T), vector[..., 0]


def _divide(B: FloatArray, S: FloatArray) -> FloatArray:
    """B S^+ for semi-definite S, whatever the units of its components."""
    std = np.sqrt(np.maximum(np.diagonal(S, axis1=-2, axis2=-1), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    inverse = np.linalg.pinv(S / (scale[..., :, None] * scale[..., None, :]), hermitian=True)
    quotient: FloatArray = (B / scale[..., None, :]) @ inverse / scale[..., None, :]
    return quotient

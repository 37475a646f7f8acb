"""NumPy kernel of the smoothers of IMM and GPB2 on the nodes of a switch, backward from the last observation.

With what the filter knew at n of node i, and what is known of everything at n + 1 of node j (s), for each
pair (i, j) and with the parameters of j, as Rauch, Tung and Striebel,

    x- = F x_i + b,    P- = F P_i F' + Q,    G = P_i F' P-^-1,
    x_ij = x_i + G (x_j^s - x-),    P_ij = P_i + G (P_j^s - P-) G',

weighed by p(i | j) = c mu_i T_ij N(x_j^s; x-, P-) and mu_j^s, and merged over j.  Kim's weights (1994) lack
the density.  What P- knows without error, given the components before it, is left out of its inverse; in the
density its variance is that of x_j^s, so that units count for nothing where the P- differ in rank.  (With it
in all directions a quiet mode, whose noise nearly vanishes, tells too little of itself.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.nodes import Pairs, merged, moved, reached, unpacked
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.engine.numpy.tables import LOG_ZERO
from fuzzykf.gaussian import LOG_2PI

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.numpy.nodes import NodeKernel

__all__ = ["smooth_nodes"]

#: A variance given other components that is a smaller part of what it is the rest of, for each state, is
#: rounding error.
CERTAIN = 4.0 * float(np.finfo(np.float64).eps)


@QUIET
def smooth_nodes(kernel: NodeKernel, table: FloatArray, by_density: bool) -> tuple[FloatArray, IntArray]:
    """Smooth a series that has been filtered.

    Parameters
    ----------
    kernel : NodeKernel
        Of the steps into each of the observations, or of one step like all others.
    table : ndarray, shape (n, 1 + m + m*m, M)
        States after each observation.
    by_density : bool
        Whether weights have the density of the next state, and not Kim's.

    Returns
    -------
    table : ndarray, shape (n, 1 + m + m*m, M)
        States given all observations.
    path : ndarray of int, shape (n,)
        Numbers of the nodes of the most likely path.
    """
    n, _, M = table.shape
    i, j = np.nonzero(kernel.log_transition > -np.inf)  # sorted by i, which they are merged in
    pairs = Pairs(j, i, np.searchsorted(i, np.arange(M)))
    log_p, x, P = unpacked(table)
    smoothed = table.copy()
    next_nodes = np.empty((n, M), dtype=np.intp)
    log_mu, xs, Ps = log_p[-1], x[-1], P[-1]
    score = log_mu
    for k in range(n - 2, -1, -1):
        F, b, Q, *_ = (one[0] for one in kernel.space.at(k + 1).take(j))
        mean, spread, log_density = _looked_back(x[k][i], P[k][i], F, b, Q, xs[j], Ps[j])
        log_w = np.full((M, M), -np.inf)
        log_w[i, j] = log_p[k][i] + kernel.log_transition[i, j] + (log_density if by_density else 0.0)
        log_w -= _sum(log_w, 0)  # p(i | j)
        total = score + log_w
        next_nodes[k] = total.argmax(axis=1)
        score = total.max(axis=1)
        log_w += log_mu
        log_mu = _sum(log_w, 1)[:, 0]
        share = np.exp(log_w - np.where(np.isneginf(log_mu), 0.0, log_mu)[:, None])[i, j]
        xs, Ps = reached(log_mu, *(one[0] for one in merged(share[None], mean[None], spread[None], pairs)))
        smoothed[k, 0] = np.maximum(log_mu, LOG_ZERO)
        smoothed[k, 1:] = np.concatenate([xs.T, Ps.reshape(M, -1).T])
    path = np.empty(n, dtype=np.intp)
    path[0] = score.argmax()
    for k in range(1, n):
        path[k] = next_nodes[k - 1, path[k - 1]]
    return smoothed, path


def _sum(log_w: FloatArray, axis: int) -> FloatArray:
    """Logarithms of sums of weights along an axis, which stays; 0 of no weight along the first."""
    top = log_w.max(axis=axis, keepdims=True)
    floor = np.where(np.isneginf(top), 0.0, top)
    total = np.exp(log_w - floor).sum(axis=axis, keepdims=True)
    none = 0.0 if axis == 0 else -np.inf  # who is not reached is divided by one
    return np.where(total > 0.0, np.log(np.where(total > 0.0, total, 1.0)) + floor, none)


def _looked_back(
    x: FloatArray, P: FloatArray, F: FloatArray, b: FloatArray, Q: FloatArray, xs: FloatArray, Ps: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moments of the states of pairs (N, ...) given all observations, and log-densities of the next ones."""
    ahead, P_ahead = moved(x, P, F, b, Q)
    off = xs - ahead
    # of the terms that P_ahead is the sum of, which may cancel
    deviation = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    size = (np.abs(F) @ deviation[..., None])[..., 0] ** 2 + np.diagonal(Q, axis1=-2, axis2=-1)
    L, weight = _factored(P_ahead, size)
    gain = _gain(L, weight, F @ P)
    rest = np.eye(x.shape[-1]) - gain @ F
    spread = rest @ P @ np.swapaxes(rest, -1, -2) + gain @ (Q + Ps) @ np.swapaxes(gain, -1, -2)
    mean = x + (gain @ off[..., None])[..., 0]
    return mean, 0.5 * (spread + np.swapaxes(spread, -1, -2)), _log_density(L, weight, Ps, off)


def _factored(S: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """L (N, m, m) and 1 / D (N, m) of S = L D L', L with ones in the diagonal that are left out.

    Pivots that are rounding error, beside the ``size`` (N, m), leave their component out, and 1 / D is zero:
    those before it say all of it.
    """
    m = S.shape[-1]
    L, weight, D = np.zeros_like(S), np.zeros(S.shape[:-1]), np.zeros(S.shape[:-1])
    for a in range(m):
        pivot = S[:, a, a].copy()
        for t in range(a):
            known = (L[:, a, :t] * L[:, t, :t] * D[:, :t]).sum(axis=-1)
            L[:, a, t] = (S[:, a, t] - known) * weight[:, t]
            pivot -= L[:, a, t] ** 2 * D[:, t]
        there = pivot > CERTAIN * m * size[:, a]
        D[:, a] = np.where(there, pivot, 0.0)
        weight[:, a] = there / np.where(there, pivot, 1.0)
    return L, weight


def _gain(L: FloatArray, weight: FloatArray, across: FloatArray) -> FloatArray:
    """Gain (N, m, m) of the regression on what has the covariance L D L'.

    ``across`` (N, m, m) is the covariance of that (rows) with what is estimated.
    """
    m, Z = across.shape[-1], _solved(L, across)
    Z *= weight[..., None]
    for a in range(m - 2, -1, -1):
        Z[:, a] -= (L[:, a + 1 :, a, None] * Z[:, a + 1 :]).sum(axis=1)
    return np.swapaxes(Z, -1, -2)


def _log_density(L: FloatArray, weight: FloatArray, Ps: FloatArray, off: FloatArray) -> FloatArray:
    """Return log N(off; 0, L D L'), (N,); of certain components with the variance that Ps (N, m, m) has."""
    m, white = off.shape[-1], _solved(L, off[..., None])[..., 0]
    certain = weight == 0.0
    if certain.any():
        known = _solved(L, np.swapaxes(_solved(L, Ps), -1, -2))  # L^-1 Ps L'^-1
        D = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)
        D = D[..., None] * np.eye(m) + np.where(certain[:, :, None] & certain[:, None, :], known, 0.0)
        L, weight = _factored(D, np.diagonal(D, axis1=-2, axis2=-1))
        white = _solved(L, white[..., None])[..., 0]
    there = weight > 0.0
    log_det = np.log(np.where(there, weight, 1.0)) - there * LOG_2PI
    value: FloatArray = -0.5 * (white**2 * weight - log_det).sum(axis=-1)
    return value


def _solved(L: FloatArray, A: FloatArray) -> FloatArray:
    """L^-1 A for L (N, m, m) with ones in the diagonal that are left out."""
    X = A.copy()
    for a in range(1, A.shape[1]):
        X[:, a] -= (L[:, a, :a, None] * X[:, :a]).sum(axis=1)
    return X

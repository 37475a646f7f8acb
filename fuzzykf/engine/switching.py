"""NumPy kernels of the exact switching recursion.

The state of a filter is what is known of every node j after the latest
observation: ``log_p`` (M,), the logarithm of its probability, and ``moments``
(m + m*m, M), whose first m rows are the mean and whose other rows are the
covariance of X given the node.  Nodes are the last axis, so that for a scalar
state mean and variance move through the pairs together.

Weights live in the log domain with one maximum per column: a node whose
probability underflows keeps exact conditional moments.  Zero probability is
`LOG_ZERO`, finite, so that no difference becomes NaN.
"""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray

__all__ = ["LOG_ZERO", "Kernel", "first_step", "pack", "run", "step"]

#: Stand-in for log 0: sums of a few stay finite, and exp of it is zero.
LOG_ZERO = -1e300

_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)


class Kernel(NamedTuple):
    """Tables of one step in the layout of the kernels.

    With u = (1, w, y') the first q M1 M2 entries of ``rows @ u`` are the whitened
    innovations of y' divided by sqrt(2), the other m M1 M2 are H w + G y' + c.
    """

    log_scale: FloatArray  # (M1, M2): log P_ij + the constants of the Gaussian density
    sign: FloatArray | None  # (M1, M2): sign of P_ij, if some are negative
    rows: FloatArray  # ((q + m) M1 M2, 1 + w + q)
    propagate: FloatArray  # scalar state: (2, M1, M2), Axx and Axx^2; else (M1, M2, m, m), Axx
    C: FloatArray  # (M1, M2), or (M1, M2, m, m)
    ones: FloatArray  # (M1,)
    shape: tuple[int, int, int, int]  # M1, M2, m, q


def pack(
    transition: FloatArray,
    factor: FloatArray,
    Axx: FloatArray,
    H: FloatArray,
    G: FloatArray,
    c: FloatArray,
    C: FloatArray,
    Ayy: FloatArray,
    Ny: FloatArray,
) -> Kernel:
    """Bring the tables of a step into the layout of the kernels.

    ``factor`` holds the lower Cholesky factors of Qyy; the others are as in
    `fuzzykf.switching.tables.PairCoefficients`, with leading shape (M1, M2).
    """
    M1, M2 = transition.shape
    m, q = Axx.shape[-1], factor.shape[-1]
    identity = np.broadcast_to(np.eye(q), (M1, M2, q, q))
    innovation = np.concatenate([-Ny[..., None], -Ayy, identity], axis=-1)
    white = np.linalg.solve(factor, innovation) * np.sqrt(0.5)
    offset = np.concatenate([c[..., None], H, G], axis=-1)
    columns = white.shape[-1]
    rows = np.concatenate(
        [np.moveaxis(white, 2, 0).reshape(-1, columns), np.moveaxis(offset, 2, 0).reshape(-1, columns)]
    )
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        log_transition = np.maximum(np.log(np.abs(transition)), LOG_ZERO)
    if m == 1:
        a = Axx[..., 0, 0]
        propagate, noise = np.stack([a, a * a]), np.ascontiguousarray(C[..., 0, 0])
    else:
        propagate, noise = np.ascontiguousarray(Axx), np.ascontiguousarray(C)
    return Kernel(
        log_scale=log_transition - log_det - q * _HALF_LOG_2PI,
        sign=np.sign(transition) if (transition < 0.0).any() else None,
        rows=rows,
        propagate=propagate,
        C=noise,
        ones=np.ones(M1),
        shape=(M1, M2, m, q),
    )


def first_step(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, factor: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Condition the law of (r_1, Z_1) on the first observation.

    Parameters
    ----------
    log_initial : ndarray, shape (M,)
    mean, covariance : ndarray, shapes (M, d) and (M, d, d)
    factor : ndarray, shape (M, q, q)
        Lower Cholesky factors of the covariances of Y_1.
    y : ndarray, shape (q,)

    Returns
    -------
    log_p, moments, log_likelihood
    """
    q = y.size
    m = mean.shape[1] - q
    white = np.linalg.solve(factor, (y - mean[:, m:])[..., None])[..., 0]
    root = np.linalg.solve(factor, np.swapaxes(covariance[:, :m, m:], -1, -2))  # L^-1 Cov(Y, X)
    x = mean[:, :m] + (np.swapaxes(root, -1, -2) @ white[..., None])[..., 0]
    P = covariance[:, :m, :m] - np.swapaxes(root, -1, -2) @ root
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    log_w = log_initial - 0.5 * (white * white).sum(axis=-1) - log_det - q * _HALF_LOG_2PI
    top = log_w.max()
    log_likelihood = float(top) + log(float(np.exp(log_w - top).sum()))
    P = np.maximum(P, 0.0) if m == 1 else P
    moments = np.concatenate([x.T, P.reshape(-1, m * m).T])
    return log_w - log_likelihood, moments, log_likelihood


def step(
    kernel: Kernel, log_p: FloatArray, sign_p: FloatArray | None, moments: FloatArray, u: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray, float]:
    """Move the state of a filter to the next observation.

    Parameters
    ----------
    kernel : Kernel
    log_p, moments : ndarray, shapes (M1,) and (m + m*m, M1)
        The state at n.
    sign_p : ndarray, shape (M1,), or None
        Signs of the masses, if the chain has negative weights.
    u : ndarray
        (1, w, y').

    Returns
    -------
    log_p, sign_p, moments, log_likelihood
        The state at n + 1 and log p(y' | y_1..n).
    """
    M1, M2, m, q = kernel.shape
    product = (kernel.rows @ u).reshape(q + m, M1, M2)
    if q == 1:
        log_w = product[0]
        np.multiply(log_w, log_w, out=log_w)
    else:
        log_w = np.add.reduce(product[:q] * product[:q], axis=0)
    np.subtract(kernel.log_scale, log_w, out=log_w)
    log_column, sign_p, moments = _advance(kernel, log_p, sign_p, moments, log_w, product[q:])
    top = log_column.max()
    masses = np.exp(log_column - top)
    if sign_p is not None:
        masses *= sign_p
    total = float(masses.sum())
    log_likelihood = float(top) + (log(total) if total > 0.0 else float("nan"))
    return log_column - log_likelihood, sign_p, moments, log_likelihood


def _advance(
    kernel: Kernel,
    log_p: FloatArray,
    sign_p: FloatArray | None,
    moments: FloatArray,
    log_w: FloatArray,
    offset: FloatArray,
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Sum the pairs into nodes: unnormalised log masses and conditional moments.

    ``log_w`` (M1, M2) holds log(P_ij N(y'; ...)) and is overwritten; ``offset``
    (m, M1, M2) holds H w + G y' + c and is overwritten for a scalar state.
    """
    m = kernel.shape[2]
    log_w += log_p[:, None]
    top = np.maximum.reduce(log_w, axis=0)
    log_w -= top
    w = np.exp(log_w, out=log_w)
    if kernel.sign is not None:
        w *= kernel.sign
        if sign_p is not None:
            w *= sign_p[:, None]
    column = kernel.ones @ w
    if kernel.sign is not None:
        sign_p = np.where(column < 0.0, -1.0, 1.0)
        column = np.where(column == 0.0, np.finfo(np.float64).tiny, column)
    w /= column  # o_ij = p(r_n = i | r_{n+1} = j, y_1..n+1)
    if m == 1:
        pairs = kernel.propagate * moments[:, :, None]
        x, P = pairs
        x += offset[0]
        P += kernel.C
        new = np.add.reduce(w * pairs, axis=1)
        x -= new[0]
        np.multiply(x, x, out=x)
        x *= w
        new[1] += kernel.ones @ x
    else:
        new = _advance_vector(kernel, w, moments, offset)
    log_column = np.log(column if sign_p is None else np.abs(column))
    log_column += top
    return log_column, sign_p, new


def _advance_vector(kernel: Kernel, w: FloatArray, moments: FloatArray, offset: FloatArray) -> FloatArray:
    M1, M2, m, _ = kernel.shape
    Axx = kernel.propagate
    x = moments[:m].T
    P = moments[m:].T.reshape(M1, m, m)
    x_pair = (Axx @ x[:, None, :, None])[..., 0] + np.moveaxis(offset, 0, -1)
    P_pair = Axx @ P[:, None] @ np.swapaxes(Axx, -1, -2) + kernel.C
    mean = np.einsum("ij,ijk->jk", w, x_pair)
    deviation = np.swapaxes(x_pair - mean, 0, 1)  # (M2, M1, m)
    weighted = deviation * w.T[..., None]
    P_node = np.einsum("ij,ijkl->jkl", w, P_pair) + np.swapaxes(weighted, -1, -2) @ deviation
    P_node = 0.5 * (P_node + np.swapaxes(P_node, -1, -2))
    return np.concatenate([mean.T, P_node.reshape(M2, m * m).T])


#: How many numbers the tables of a chunk of observations may hold.
_CHUNK = 1 << 18


def run(
    kernel: Kernel, log_p: FloatArray, sign_p: FloatArray | None, moments: FloatArray, U: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray, FloatArray]:
    """Run `step` along a series with constant tables.

    The densities of all observations are computed ahead of the recursion, in chunks.

    Parameters
    ----------
    kernel, log_p, sign_p, moments
        As in `step`.
    U : ndarray, shape (n, 1 + w + q)
        Rows (1, w, y').

    Returns
    -------
    log_p : ndarray, shape (n, M)
    sign_p : ndarray, shape (n, M), or None
    moments : ndarray, shape (n, m + m*m, M)
    log_likelihood : ndarray, shape (n,)
    """
    n = len(U)
    M1, M2, m, q = kernel.shape
    all_log_p, all_moments = np.empty((n, M2)), np.empty((n, m + m * m, M2))
    all_signs = None if kernel.sign is None else np.empty((n, M2))
    log_likelihood = np.empty(n)
    chunk = max(1, _CHUNK // ((q + m) * M1 * M2))
    for start in range(0, n, chunk):
        part = U[start : start + chunk]
        product = (part @ kernel.rows.T).reshape(len(part), q + m, M1, M2)
        log_w = kernel.log_scale - (product[:, :q] ** 2).sum(axis=1)
        peaks = np.empty(len(part))
        # inside the loop masses are scaled by their maximum only; their sums follow at once
        for k in range(len(part)):
            log_p, sign_p, moments = _advance(kernel, log_p, sign_p, moments, log_w[k], product[k, q:])
            peaks[k] = peak = np.maximum.reduce(log_p)
            log_p -= peak
            all_log_p[start + k] = log_p
            all_moments[start + k] = moments
            if all_signs is not None:
                all_signs[start + k] = sign_p
        block = slice(start, start + len(part))
        masses = np.exp(all_log_p[block])
        if all_signs is not None:
            masses *= all_signs[block]
        with np.errstate(invalid="ignore", divide="ignore"):
            log_total = np.log(masses.sum(axis=1))
        all_log_p[block] -= log_total[:, None]
        log_likelihood[block] = peaks + log_total
        log_likelihood[start + 1 : start + len(part)] -= log_total[:-1]
        log_p = all_log_p[start + len(part) - 1].copy()
    return all_log_p, all_signs, all_moments, log_likelihood

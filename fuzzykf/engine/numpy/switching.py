"""NumPy kernels of the exact switching recursion, where nothing is missing (else see `gaps`).

The state of a filter is what is known of every node j after the latest
observation, one column per node: ``table`` (1 + m + m*m, M) holds the logarithm of
its probability, the mean and the covariance of X given the node.

Weights live in the log domain with one maximum per column: a node whose
probability underflows keeps exact conditional moments.  Zero probability is
`LOG_ZERO`, finite, so that no difference becomes NaN.

For a scalar state and few nodes a step of NumPy costs what its calls cost, not its
arithmetic.  There the way from nodes to pairs is one product with a small matrix
(`FewNodes`), since a BLAS call is three times cheaper than broadcasting, and the
maxima are taken only where a sum comes near the ends of the floating-point range.
"""

from __future__ import annotations

from math import isqrt, log
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.outliers import NEAR, QUIET, far_nodes, far_pairs
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.engine.numpy.tables import Kernel

__all__ = [
    "LARGEST_MEAN",
    "are_far",
    "first_step",
    "is_in_range",
    "layout",
    "log_pairs",
    "log_sum",
    "node_mean",
    "step",
]

_ONE = np.ones(1)
_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)

#: Sums of weights between these lose nothing without a maximum taken out.
_TINY, _HUGE = 1e-250, 1e250

#: The largest mean of a node, whose square, and that of differences, has to be a number; and covariance.
LARGEST_MEAN, LARGEST_COVARIANCE = 1e153, 1e306


def is_in_range(table: FloatArray) -> BoolArray:
    """Whether states (..., 1 + e + e*e, M) are numbers, and the moments of their mixtures are, too: (...)."""
    e = (isqrt(4 * table.shape[-2] - 3) - 1) // 2
    mean, covariance = np.abs(table[..., 1 : 1 + e, :]), np.abs(table[..., 1 + e :, :])
    fits = (mean <= LARGEST_MEAN).all(axis=(-2, -1)) & (covariance <= LARGEST_COVARIANCE).all(axis=(-2, -1))
    return np.asarray(fits & ~np.isnan(table[..., 0, :]).any(axis=-1))


@QUIET
def first_step(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, factor: FloatArray, ys: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Condition the law of (r_1, Z_1) on the first observation of each of several series.

    Parameters
    ----------
    log_initial : ndarray, shape (M,)
    mean, covariance : ndarray, shapes (M, d) and (M, d, d)
    factor : ndarray, shape (M, q, q)
        Lower Cholesky factors of the covariances of Y_1.
    ys : ndarray, shape (s, q)

    Returns
    -------
    table : ndarray, shape (s, 1 + m + m*m, M)
    log_likelihood : ndarray, shape (s,)
    """
    s, q = ys.shape
    M, m = len(mean), mean.shape[1] - q
    white = np.linalg.solve(factor, np.moveaxis(ys[:, None] - mean[:, m:], 0, -1))  # (M, q, s)
    root = np.linalg.solve(factor, np.swapaxes(covariance[:, :m, m:], -1, -2))  # L^-1 Cov(Y, X)
    x = mean[:, :m, None] + np.swapaxes(root, -1, -2) @ white
    P = covariance[:, :m, :m] - np.swapaxes(root, -1, -2) @ root
    if m == 1:
        P = np.maximum(P, 0.0)  # the subtraction may leave a rounding error below zero
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    log_w = log_initial[:, None] - 0.5 * (white * white).sum(axis=1) - log_det[:, None] - q * _HALF_LOG_2PI
    top = log_w.max(axis=0)
    log_likelihood = top + np.log(np.exp(log_w - top).sum(axis=0))
    table = np.empty((s, 1 + m + m * m, M))
    table[:, 0] = (log_w - log_likelihood).T
    for k in np.flatnonzero((top < NEAR) & (top > DEAD)):
        relative, best = far_nodes(log_initial - log_det - q * _HALF_LOG_2PI, mean[:, m:], factor, ys[k])
        total = log_sum(relative, None)
        table[k, 0], log_likelihood[k] = relative - total, best + total
    table[:, 1 : 1 + m] = x.T
    table[:, 1 + m :] = P.reshape(M, m * m).T
    return table, log_likelihood


@QUIET
def step(
    kernel: Kernel, table: FloatArray, sign: FloatArray | None, window: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray | None, float]:
    """Move the state of a filter to the next observation.

    Parameters
    ----------
    kernel : Kernel
    table : ndarray, shape (1 + m + m*m, M1)
        The state at n.
    sign : ndarray, shape (M1,), or None
        Signs of the masses, if the chain has negative weights.
    window, y : ndarray, shapes (w,) and (q,)
        The latest observations, and the new one.

    Returns
    -------
    table, sign, log_likelihood
        The state at n + 1 and log p(y' | y_1..n).
    """
    _, M2, m, q = kernel.shape
    p = kernel.depth * M2
    if kernel.few is not None:
        u = np.concatenate((_ONE, window, y, table.ravel()))
        pairs = kernel.few.whole.dot(u)
        white, log_w = pairs[:p], pairs[p : 2 * p]
        np.multiply(white, white, white)
        np.subtract(log_w, white, log_w)
        table, log_total, best = collapse_few(
            kernel, log_w, pairs[2 * p : 3 * p], pairs[3 * p :], table[0], u
        )
        table[0] -= log_total
        return table, None, log_total + best
    u = np.concatenate((_ONE, window, y))
    product = (kernel.rows @ u).reshape(q + m, p)
    log_w = kernel.log_scale - np.add.reduce(product[:q] ** 2, axis=0)
    return collapse(kernel, log_w, product[q:], table, sign, u)


def are_far(top: FloatArray) -> bool:
    """Whether the best log-weight of a node that can be reached, (..., M2), is lost among its digits."""
    return bool(((top < NEAR) & (top > DEAD)).any()) if top.min() < NEAR else False


def _signed(
    kernel: Kernel, w: FloatArray, column: FloatArray, sign: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Give the weights w (M1, M2) the signs of the chain; sums over i, and their signs."""
    assert kernel.sign is not None
    w *= kernel.sign
    if sign is not None:
        w *= sign[:, None]
    column = kernel.ones.dot(w)
    column = np.where(column == 0.0, np.finfo(np.float64).tiny, column)
    return column, np.where(column < 0.0, -1.0, 1.0)


def collapse_few(
    kernel: Kernel, log_w: FloatArray, x: FloatArray, P: FloatArray, log_p: FloatArray, u: FloatArray
) -> tuple[FloatArray, float, float]:
    """Sum pairs into nodes, scalar state: flat arrays (depth M2,), of which x is overwritten.

    ``log_p`` (M1,) and ``u``, which begins with (1, w, y'), are what ``log_w`` was made from.  Returns the
    new table, its first row not normalised, the logarithm of its total, and the log-density
    to which that is relative: zero, but for outliers.
    """
    M2 = kernel.shape[1]
    few = kernel.few
    assert few is not None
    spread, p = few.spread, log_w.size
    weighted = np.empty(2 * p)
    w, wx = weighted[:p], weighted[p:]
    np.exp(log_w, w)
    first = x[log_w.argmax()]  # what all have in common then cancels to the last bit, however large
    np.subtract(x, first, x)
    np.multiply(w, x, wx)
    both = weighted.dot(few.sums)
    column = both[:M2]
    sums: list[float] = column.tolist()
    total = sum(sums)
    top = None
    best = 0.0
    if not (min(sums) > _TINY and total < _HUGE):  # an outlier, or a node out of reach
        top = base = np.maximum.reduce(log_w.reshape(-1, M2), axis=0)
        if are_far(top):
            relative, reference, best = far_pairs(kernel, log_p, u)
            log_w, top = relative.ravel(), np.maximum.reduce(relative, axis=0)
            base = top + reference
        np.exp(log_w - spread.dot(top), w)
        np.multiply(w, x, wx)
        both = weighted.dot(few.sums)
        column = both[:M2]
    table = np.empty((3, M2))
    beyond = np.divide(both[M2:], column, table[1])
    np.subtract(x, spread.dot(beyond), x)
    beyond += first
    np.multiply(x, x, x)
    np.add(x, P, x)
    np.multiply(x, w, x)
    np.divide(x.dot(spread), column, table[2])
    new_log_p = np.log(column, table[0])
    if top is None:
        return table, log(total), best
    new_log_p += base
    _bury(table, top)
    return table, log_sum(new_log_p, None), best


def layout(log_p: FloatArray, mean: FloatArray, P: FloatArray) -> FloatArray:
    """Lay out (M,), (M, m) and (M, m, m) as a table, always in the same order of memory.

    Sums over a state that was saved and read again are then the same to the last bit.
    """
    return np.ascontiguousarray(np.concatenate([log_p[None], mean.T, P.reshape(len(P), -1).T]))


def _bury(table: FloatArray, top: FloatArray) -> None:
    """Set nodes that no path reaches to zero: moments might grow without bound, logarithms add up."""
    if float(top.min()) < DEAD:
        is_lost = top < DEAD
        table[0, is_lost] = np.maximum(table[0, is_lost], LOG_ZERO)  # what is no number remains none
        table[1:, is_lost] = 0.0


def log_sum(log_p: FloatArray, sign: FloatArray | None) -> float:
    """Logarithm of the sum of masses from their logarithms and signs; NaN where it is not positive."""
    top = float(log_p.max())
    masses = np.exp(log_p - top)
    total = float(masses.sum() if sign is None else masses.dot(sign))
    return top + (log(total) if total > 0.0 else float("nan"))  # the caller looks at negative masses


def collapse(
    kernel: Kernel,
    log_w: FloatArray,
    offset: FloatArray,
    table: FloatArray,
    sign: FloatArray | None,
    u: FloatArray,
) -> tuple[FloatArray, FloatArray | None, float]:
    """Sum pairs into nodes, for any state and any number of nodes.

    ``log_w`` (depth M2,) holds log(P_ij N(y'; ...)), ``offset`` (m, depth M2) holds
    H w + G y' + c; both were made from ``u``, (1, w, y').
    Returns the new table, the signs of its masses and the log-likelihood.
    """
    (M1, M2, m, _), nodes = kernel.shape, kernel.nodes
    w = log_w.reshape(-1, M2) + table[0][nodes]
    top = base = np.maximum.reduce(w, axis=0)
    best = 0.0
    if are_far(top):
        w, reference, best = far_pairs(kernel, table[0], u)
        top = np.maximum.reduce(w, axis=0)
        base = top + reference
    w -= top
    np.exp(w, out=w)
    column = kernel.ones.dot(w)
    if kernel.sign is not None:
        column, sign = _signed(kernel, w, column, sign)
    w /= column  # o_ij = p(r_n = i | r_{n+1} = j, y_1..n+1)
    x = table[1 : 1 + m].T
    P = table[1 + m :].T.reshape(M1, m, m)
    shift = np.moveaxis(offset.reshape(m, -1, M2), 0, -1)
    Axx = kernel.Axx
    if m == 1:
        x_pair = Axx[..., 0] * x[nodes] + shift
        P_pair = Axx * Axx * P[nodes] + kernel.C
    else:
        x_pair = (Axx @ x[nodes][..., None])[..., 0] + shift
        P_pair = Axx @ P[nodes] @ np.swapaxes(Axx, -1, -2) + kernel.C
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    first = x_pair[np.abs(w).argmax(axis=0), np.arange(M2)]
    x_pair -= first
    beyond = np.einsum("ij,ijk->jk", w, x_pair)
    mean = first + beyond
    deviation = np.swapaxes(x_pair - beyond, 0, 1)  # (M2, depth, m)
    spread = np.swapaxes(deviation * w.T[..., None], -1, -2) @ deviation
    P_node = np.einsum("ij,ijkl->jkl", w, P_pair) + spread
    P_node = 0.5 * (P_node + np.swapaxes(P_node, -1, -2))
    log_p = np.log(column if sign is None else np.abs(column)) + base
    log_total = log_sum(log_p, sign)
    log_p -= log_total
    table = layout(log_p, mean, P_node)
    _bury(table, top)
    return table, sign, log_total + best


def node_mean(p: FloatArray, means: FloatArray) -> FloatArray:
    """Mean (m,) of a mixture with weights p (M,) and means (m, M)."""
    mean: FloatArray = means.dot(p)
    return mean


def log_pairs(kernel: Kernel, U: FloatArray) -> FloatArray:
    """Return log |P_ij| + log N(y'; Ayy w + Ny, Qyy) for rows (1, w, y') of U: (n, M1 M2)."""
    log_w, slots = slot_logs(kernel, U), kernel.slots
    if slots is None:
        return log_w
    M1, M2 = kernel.shape[:2]
    return np.stack([slots.spread(one.reshape(-1, M2), M1, LOG_ZERO).ravel() for one in log_w])


def slot_logs(kernel: Kernel, U: FloatArray) -> FloatArray:
    """Do `log_pairs` slot by slot: (n, depth M2)."""
    _, M2, _, q = kernel.shape
    p = kernel.depth * M2
    white = (U[:, None] @ kernel.rows[: q * p].T)[:, 0]  # row by row, see `by_rows` of whole series
    white *= white
    log_w: FloatArray = kernel.log_scale - (white if q == 1 else white.reshape(-1, q, p).sum(axis=1))
    return log_w

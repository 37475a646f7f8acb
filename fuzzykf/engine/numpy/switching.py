"""NumPy kernels of the exact switching recursion.

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

The next observation is predicted from the latest ones, so a gap leaves not only X but also a
part u of the window w unknown.  Then the rows of ``table`` are those of s = (X, u), and the general
pair formulas apply to X and the whole window:

    s'_ij = F_ij s + b_ij + noise,   s' = (X', Y', w),

conditioned on what is there of Y', and collapsed over i by moment matching.
"""

from __future__ import annotations

from math import isqrt, log
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.outliers import NEAR, QUIET, far_nodes, far_pairs, far_parts
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.numpy.tables import Kernel

__all__ = [
    "PairMoments",
    "are_far",
    "before_step",
    "collapse_weights",
    "condition_pairs",
    "first_step",
    "first_step_in_part",
    "log_pairs",
    "node_mean",
    "pair_moments",
    "step",
    "step_in_part",
    "window_moments",
    "window_table",
]

_ONE = np.ones(1)
_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)

#: Sums of weights between these lose nothing without a maximum taken out.
_TINY, _HUGE = 1e-250, 1e250


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
        total = _log_sum(relative, None)
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
    M1, M2, m, q = kernel.shape
    if kernel.few is not None:
        u = np.concatenate((_ONE, window, y, table.ravel()))
        pairs = kernel.few.whole.dot(u)
        n = M1 * M2
        white, log_w = pairs[:n], pairs[n : 2 * n]
        np.multiply(white, white, white)
        np.subtract(log_w, white, log_w)
        table, log_total, best = collapse_few(
            kernel, log_w, pairs[2 * n : 3 * n], pairs[3 * n :], table[0], u
        )
        table[0] -= log_total
        return table, None, log_total + best
    u = np.concatenate((_ONE, window, y))
    product = (kernel.rows @ u).reshape(q + m, M1 * M2)
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
    """Sum pairs into nodes, scalar state: flat arrays (M1 M2,), of which x is overwritten.

    ``log_p`` (M1,) and ``u``, which begins with (1, w, y'), are what ``log_w`` was made from.  Returns the
    new table, its first row not normalised, the logarithm of its total, and the log-density
    to which that is relative: zero, but for outliers.
    """
    M1, M2 = kernel.shape[:2]
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
        top = base = np.maximum.reduce(log_w.reshape(M1, M2), axis=0)
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
    _bury(table, top)
    new_log_p += base
    return table, _log_sum(new_log_p, None), best


def _table(log_p: FloatArray, mean: FloatArray, P: FloatArray) -> FloatArray:
    """Lay out (M,), (M, m) and (M, m, m) as a table, always in the same order of memory.

    Sums over a state that was saved and read again are then the same to the last bit.
    """
    return np.ascontiguousarray(np.concatenate([log_p[None], mean.T, P.reshape(len(P), -1).T]))


def _bury(table: FloatArray, top: FloatArray) -> None:
    """Set the moments of nodes that no path reaches to zero, or they might grow without bound."""
    if float(top.min()) < DEAD:
        table[1:, top < DEAD] = 0.0


def _log_sum(log_p: FloatArray, sign: FloatArray | None) -> float:
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

    ``log_w`` (M1 M2,) holds log(P_ij N(y'; ...)), ``offset`` (m, M1 M2) holds
    H w + G y' + c; both were made from ``u``, (1, w, y').
    Returns the new table, the signs of its masses and the log-likelihood.
    """
    M1, M2, m, _ = kernel.shape
    w = log_w.reshape(M1, M2) + table[0][:, None]
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
    shift = np.moveaxis(offset.reshape(m, M1, M2), 0, -1)
    Axx = kernel.Axx
    if m == 1:
        x_pair = Axx[..., 0] * x[:, None] + shift
        P_pair = Axx * Axx * P[:, None] + kernel.C
    else:
        x_pair = (Axx @ x[:, None, :, None])[..., 0] + shift
        P_pair = Axx @ P[:, None] @ np.swapaxes(Axx, -1, -2) + kernel.C
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    first = x_pair[np.abs(w).argmax(axis=0), np.arange(M2)]
    x_pair -= first
    beyond = np.einsum("ij,ijk->jk", w, x_pair)
    mean = first + beyond
    deviation = np.swapaxes(x_pair - beyond, 0, 1)  # (M2, M1, m)
    spread = np.swapaxes(deviation * w.T[..., None], -1, -2) @ deviation
    P_node = np.einsum("ij,ijkl->jkl", w, P_pair) + spread
    P_node = 0.5 * (P_node + np.swapaxes(P_node, -1, -2))
    log_p = np.log(column if sign is None else np.abs(column)) + base
    log_total = _log_sum(log_p, sign)
    log_p -= log_total
    table = _table(log_p, mean, P_node)
    _bury(table, top)
    return table, sign, log_total + best


def node_mean(p: FloatArray, means: FloatArray) -> FloatArray:
    """Mean (m,) of a mixture with weights p (M,) and means (m, M)."""
    mean: FloatArray = means.dot(p)
    return mean


def log_pairs(kernel: Kernel, U: FloatArray) -> FloatArray:
    """Return log |P_ij| + log N(y'; Ayy w + Ny, Qyy) for rows (1, w, y') of U: (n, M1 M2)."""
    M1, M2, _, q = kernel.shape
    p = M1 * M2
    white = U @ kernel.rows[: q * p].T
    white *= white
    log_w: FloatArray = kernel.log_scale - (white if q == 1 else white.reshape(-1, q, p).sum(axis=1))
    return log_w


# --------------------------------------------------------------------------- what is missing


class PairMoments(NamedTuple):
    """Weights of the pairs of nodes, and moments of s' = (X', Y', w) given each."""

    log_w: FloatArray  # (M1, M2): log p_i + log |P_ij|, and the density of what is there of Y'
    sign: FloatArray | None  # (M1, M2)
    mean: FloatArray  # (M1, M2, e)
    covariance: FloatArray  # (M1, M2, e, e)
    reference: FloatArray | float = 0.0  # (M2,): that to which the weights of each column are relative
    best: float = 0.0  # that to which the references are relative


def window_moments(table: FloatArray, window: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (M, m + w) and covariance of X and the whole window, per node.

    Parameters
    ----------
    table : ndarray, shape (1 + e + e*e, M)
        Of s = (X, u), u the parts of the window that are missing.
    window : ndarray, shape (w,)
        NaN where missing.
    """
    missing, M, e = np.isnan(window), table.shape[1], (isqrt(4 * len(table) - 3) - 1) // 2
    m = e - int(missing.sum())
    at = np.flatnonzero(np.concatenate([np.ones(m, dtype=bool), missing]))
    mean, covariance = np.empty((M, m + window.size)), np.zeros((M, m + window.size, m + window.size))
    mean[:, m:] = window
    mean[:, at] = table[1 : 1 + e].T
    covariance[:, at[:, None], at] = table[1 + e :].T.reshape(M, e, e)
    return mean, covariance


def window_table(
    log_p: FloatArray, mean: FloatArray, covariance: FloatArray, window: FloatArray
) -> FloatArray:
    """Return the table of (X, u) from moments of X and the whole window, per node."""
    m = mean.shape[1] - window.size
    at = np.flatnonzero(np.concatenate([np.ones(m, dtype=bool), np.isnan(window)]))
    return _table(log_p, mean[:, at], covariance[:, at[:, None], at])


def pair_moments(
    transition: FloatArray,
    pairs: tuple[FloatArray, ...],
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
) -> PairMoments:
    """Move X and the window through every pair of nodes, before Y' is seen.

    Parameters
    ----------
    transition : ndarray, shape (M1, M2)
    pairs : tuple of ndarray
        Axx, H, G, c, C, Ayy, Ny, Qyy of the regressions of X' and Y', leading shape (M1, M2).
    table, sign, window
        The state, as in `step`; NaN where the window is missing.
    """
    Axx, H, G, c, C, Ayy, Ny, Qyy = pairs
    m, q, w = Axx.shape[-1], Qyy.shape[-1], window.size
    x, P = window_moments(table, window)
    F = np.zeros((*transition.shape, m + q + w, m + w))
    F[..., :m, :m] = Axx
    F[..., :m, m:] = H + G @ Ayy
    F[..., m : m + q, m:] = Ayy
    F[..., m + q :, m:] = np.eye(w)
    mean = (F @ x[:, None, :, None])[..., 0]
    mean[..., :m] += c + (G @ Ny[..., None])[..., 0]
    mean[..., m : m + q] += Ny
    covariance = F @ P[:, None] @ np.swapaxes(F, -1, -2)
    cross = G @ Qyy
    covariance[..., :m, :m] += C + cross @ np.swapaxes(G, -1, -2)
    covariance[..., :m, m : m + q] += cross
    covariance[..., m : m + q, :m] += np.swapaxes(cross, -1, -2)
    covariance[..., m : m + q, m : m + q] += Qyy
    with np.errstate(divide="ignore"):
        log_w = np.maximum(np.log(np.abs(transition)), LOG_ZERO) + table[0][:, None]
    signs = np.sign(transition) if (transition < 0.0).any() else None
    if signs is not None and sign is not None:
        signs = signs * sign[:, None]
    return PairMoments(log_w, signs, mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)))


def condition_pairs(pairs: PairMoments, y: FloatArray, m: int) -> PairMoments:
    """Condition every pair on the parts of y (q,) that are there, whose density joins the weights."""
    there = ~np.isnan(y)
    if not there.any():
        return pairs
    at = m + np.flatnonzero(there)
    log_w, sign, mean, covariance, *_ = pairs
    S = covariance[..., at[:, None], at]
    factor = np.linalg.cholesky(S).astype(np.float64, copy=False)
    root = np.linalg.solve(factor, covariance[..., at, :])  # L^-1 Cov(Y', s')
    residual = (y[there] - mean[..., at])[..., None]
    white = np.linalg.solve(factor, residual).astype(np.float64, copy=False)
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    small = log_w - log_det - at.size * _HALF_LOG_2PI
    log_w = small - 0.5 * (white * white).sum(axis=(-1, -2))
    reference, best = pairs.reference, pairs.best
    if are_far(log_w.max(axis=0)):
        log_w, reference, best = far_parts(white[..., 0], small, mean[..., at], factor)
    mean = mean + (np.swapaxes(root, -1, -2) @ white)[..., 0]
    covariance = covariance - np.swapaxes(root, -1, -2) @ root
    mean[..., at] = y[there]
    covariance[..., at, :] = 0.0
    covariance[..., :, at] = 0.0
    covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    return PairMoments(log_w, sign, mean, covariance, reference, best)


def collapse_weights(
    log_w: FloatArray, sign: FloatArray | None
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Column sums in the log domain, their signs, and o_ij = w_ij / sum_k w_kj."""
    top = log_w.max(axis=0)
    w = np.exp(log_w - top)
    if sign is None:
        column = w.sum(axis=0)
        return np.log(column) + top, None, w / column
    w *= sign
    column = w.sum(axis=0)
    column = np.where(column == 0.0, np.finfo(np.float64).tiny, column)
    return np.log(np.abs(column)) + top, np.where(column < 0.0, -1.0, 1.0), w / column


def _collapse_pairs(pairs: PairMoments, window: FloatArray) -> tuple[FloatArray, FloatArray | None, float]:
    """Sum pairs into nodes and keep of the window what is missing; table, signs and the log of the total."""
    log_p, sign, o = collapse_weights(pairs.log_w, pairs.sign)
    first = pairs.mean[np.abs(o).argmax(axis=0), np.arange(o.shape[1])]
    off = pairs.mean - first
    beyond = np.einsum("ij,ijk->jk", o, off)
    mean = first + beyond
    off -= beyond
    covariance = np.transpose(o[..., None] * off, (1, 2, 0)) @ np.swapaxes(off, 0, 1)  # of the means, per j
    covariance += np.einsum("ij,ijkl->jkl", o, pairs.covariance)
    is_lost = log_p < DEAD
    log_p = log_p + pairs.reference
    log_total = _log_sum(log_p, sign)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    table = window_table(log_p - log_total, mean, covariance, window)
    table[1:, is_lost] = 0.0
    return table, sign, log_total + pairs.best


@QUIET
def first_step_in_part(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, y: FloatArray
) -> tuple[FloatArray, float]:
    """Condition the law of (r_1, Z_1) on the parts of y (q,) that are there; arguments as in `first_step`."""
    alone = PairMoments(log_initial[None], None, mean[None], covariance[None])  # one imaginary predecessor
    pairs = condition_pairs(alone, y, mean.shape[1] - y.size)
    table, _, log_total = _collapse_pairs(pairs, y)
    return table, 0.0 if np.isnan(y).all() else log_total


@QUIET
def step_in_part(
    transition: FloatArray,
    pairs: tuple[FloatArray, ...],
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    y: FloatArray,
    after: FloatArray,
) -> tuple[FloatArray, FloatArray | None, float]:
    """Do a `step` where parts of the observation y (q,), of the window, or of both are missing.

    Parameters
    ----------
    transition, pairs, table, sign, window
        As in `pair_moments`.
    y : ndarray, shape (q,)
    after : ndarray, shape (w',)
        The window after it: y and what is kept of ``window``.

    Returns
    -------
    table, sign, log_likelihood
        The log-likelihood is that of the parts that are there; 0 if none is.
    """
    m = pairs[0].shape[-1]
    keep = slice(0, m + after.size)
    log_w, signs, mean, covariance, *_ = pair_moments(transition, pairs, table, sign, window)
    seen = condition_pairs(PairMoments(log_w, signs, mean[..., keep], covariance[..., keep, keep]), y, m)
    table, signs, log_total = _collapse_pairs(seen, after)
    return table, signs, 0.0 if np.isnan(y).all() else log_total


def before_step(
    transition: FloatArray,
    pairs: tuple[FloatArray, ...],
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    mass: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Probabilities (M2,) of the next nodes, mean and covariance of (X', Y'), before Y' is seen.

    Parameters
    ----------
    transition, pairs, table, sign, window
        As in `pair_moments`.
    mass : ndarray, shape (M1,), optional
        The probabilities, where more digits are known of them than ``table`` has.
    """
    d = pairs[0].shape[-1] + pairs[-1].shape[-1]
    moments = pair_moments(transition, pairs, table, sign, window)
    p = np.exp(table[0]) if mass is None else mass
    if sign is not None:
        p = p * sign
    weights = p[:, None] * transition
    means = moments.mean[..., :d].reshape(-1, d)
    first = means[weights.argmax()]
    off = means - first
    beyond = weights.ravel() @ off
    mean = first + beyond
    off -= beyond
    covariance = (off * weights.reshape(-1, 1)).T @ off
    covariance += np.einsum("ij,ijkl->kl", weights, moments.covariance[..., :d, :d])
    return p @ transition, mean, 0.5 * (covariance + covariance.T)

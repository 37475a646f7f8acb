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
"""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.tables import DEAD

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.numpy.tables import Kernel

__all__ = [
    "first_step",
    "forward_backward",
    "log_pairs",
    "node_mean",
    "node_moments",
    "probabilities",
    "run",
    "step",
    "step_many",
]


_ONE = np.ones(1)
_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)

#: Sums of weights between these lose nothing without a maximum taken out.
_TINY, _HUGE = 1e-250, 1e250

#: Masses along a series are brought back to one when their total has left e^-100 to e^100.
_DRIFT = 100.0

#: Totals below this have lost digits to underflow.
_LOST = 1e-290

#: A state of lost probability (at most 1e-290) matters if the future favours it by more than this.
_FAVOURED = 1e250

#: How many numbers the tables of a chunk of observations may hold.
_CHUNK = 1 << 15


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
    table[:, 1 : 1 + m] = x.T
    table[:, 1 + m :] = P.reshape(M, m * m).T
    return table, log_likelihood


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
        pairs = kernel.few.whole.dot(np.concatenate((_ONE, window, y, table.ravel())))
        n = M1 * M2
        white, log_w = pairs[:n], pairs[n : 2 * n]
        np.multiply(white, white, white)
        np.subtract(log_w, white, log_w)
        table, log_likelihood = _collapse_few(kernel, log_w, pairs[2 * n : 3 * n], pairs[3 * n :])
        table[0] -= log_likelihood
        return table, None, log_likelihood
    product = (kernel.rows @ np.concatenate((_ONE, window, y))).reshape(q + m, M1 * M2)
    log_w = kernel.log_scale - np.add.reduce(product[:q] ** 2, axis=0)
    return _collapse(kernel, log_w, product[q:], table, sign)


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


def _collapse_few(
    kernel: Kernel, log_w: FloatArray, x: FloatArray, P: FloatArray
) -> tuple[FloatArray, float]:
    """Sum pairs into nodes, scalar state: flat arrays (M1 M2,), of which x is overwritten.

    Returns the new table, its first row not normalised, and the logarithm of its total.
    """
    M1, M2 = kernel.shape[:2]
    few = kernel.few
    assert few is not None
    spread, p = few.spread, log_w.size
    weighted = np.empty(2 * p)
    w, wx = weighted[:p], weighted[p:]
    np.exp(log_w, w)
    np.multiply(w, x, wx)
    both = weighted.dot(few.sums)
    column = both[:M2]
    sums: list[float] = column.tolist()
    total = sum(sums)
    top = None
    if not (min(sums) > _TINY and total < _HUGE):  # an outlier, or a node out of reach
        top = np.maximum.reduce(log_w.reshape(M1, M2), axis=0)
        np.exp(log_w - spread.dot(top), w)
        np.multiply(w, x, wx)
        both = weighted.dot(few.sums)
        column = both[:M2]
    table = np.empty((3, M2))
    mean = np.divide(both[M2:], column, table[1])
    np.subtract(x, spread.dot(mean), x)
    np.multiply(x, x, x)
    np.add(x, P, x)
    np.multiply(x, w, x)
    np.divide(x.dot(spread), column, table[2])
    log_p = np.log(column, table[0])
    if top is None:
        return table, log(total)
    _bury(table, top)
    log_p += top
    return table, _log_sum(log_p, None)


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


def _collapse(
    kernel: Kernel, log_w: FloatArray, offset: FloatArray, table: FloatArray, sign: FloatArray | None
) -> tuple[FloatArray, FloatArray | None, float]:
    """Sum pairs into nodes, for any state and any number of nodes.

    ``log_w`` (M1 M2,) holds log(P_ij N(y'; ...)), ``offset`` (m, M1 M2) holds
    H w + G y' + c.  Returns the new table, the signs of its masses and the log-likelihood.
    """
    M1, M2, m, _ = kernel.shape
    w = log_w.reshape(M1, M2) + table[0][:, None]
    top = np.maximum.reduce(w, axis=0)
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
    mean = np.einsum("ij,ijk->jk", w, x_pair)
    deviation = np.swapaxes(x_pair - mean, 0, 1)  # (M2, M1, m)
    spread = np.swapaxes(deviation * w.T[..., None], -1, -2) @ deviation
    P_node = np.einsum("ij,ijkl->jkl", w, P_pair) + spread
    P_node = 0.5 * (P_node + np.swapaxes(P_node, -1, -2))
    log_p = np.log(column if sign is None else np.abs(column)) + top
    log_likelihood = _log_sum(log_p, sign)
    log_p -= log_likelihood
    table = _table(log_p, mean, P_node)
    _bury(table, top)
    return table, sign, log_likelihood


def probabilities(table: FloatArray, sign: FloatArray | None = None) -> FloatArray:
    """Probabilities (..., M) of the nodes of a state (..., 1 + m + m*m, M)."""
    p: FloatArray = np.exp(table[..., 0, :])
    return p if sign is None else p * sign


def node_moments(table: FloatArray, m: int) -> tuple[FloatArray, FloatArray]:
    """Means (..., M, m) and covariances (..., M, m, m) given each node."""
    flat = np.swapaxes(table[..., 1:, :], -1, -2)
    return flat[..., :m], flat[..., m:].reshape(*flat.shape[:-1], m, m)


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


def run(
    kernel: Kernel, table: FloatArray, sign: FloatArray | None, U: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Run `step` along a series with constant tables.

    The densities of all observations are computed ahead of the recursion, in chunks.

    Parameters
    ----------
    kernel, table, sign
        As in `step`.
    U : ndarray, shape (n, 1 + w + q)
        Rows (1, w, y').

    Returns
    -------
    tables : ndarray, shape (n, 1 + m + m*m, M)
    signs : ndarray, shape (n, M), or None
    log_likelihood : ndarray, shape (n,)
    """
    n = len(U)
    M1, M2, m, q = kernel.shape
    p = M1 * M2
    tables = np.empty((n, 1 + m + m * m, M2))
    signs = None if kernel.sign is None else np.empty((n, M2))
    log_likelihood = np.empty(n)
    chunk = max(1, _CHUNK // ((q + m) * p))
    for start in range(0, n, chunk):
        part = U[start : start + chunk]
        log_w = log_pairs(kernel, part)
        if kernel.few is not None:
            mix = kernel.few.mix
            pairs = np.empty((len(part), 3 * p))
            pairs[:, :p] = log_w
            np.matmul(part, kernel.rows[p:].T, out=pairs[:, p : 2 * p])
            pairs[:, 2 * p :] = kernel.C.ravel()
            log_totals, carried = np.empty(len(part)), np.zeros(len(part))
            log_total = 0.0
            for k, row in enumerate(pairs):
                if not -_DRIFT < log_total < _DRIFT:
                    table[0] -= log_total
                    log_total = 0.0
                carried[k] = log_total
                np.add(row, mix.dot(table.ravel()), row)
                table, log_total = _collapse_few(kernel, row[:p], row[p : 2 * p], row[2 * p :])
                log_totals[k] = log_total
                tables[start + k] = table
            block = slice(start, start + len(part))
            log_likelihood[block] = log_totals - carried
            tables[block, 0] -= log_totals[:, None]
            table = tables[start + len(part) - 1]
        else:
            offsets = (part @ kernel.rows[q * p :].T).reshape(-1, m, p)
            for k, (row, offset) in enumerate(zip(log_w, offsets, strict=True), start):
                table, sign, log_likelihood[k] = _collapse(kernel, row, offset, table, sign)
                tables[k] = table
                if signs is not None:
                    signs[k] = sign
    return tables, signs, log_likelihood


# --------------------------------------------------------------------------- many series


def step_many(kernel: Kernel, table: FloatArray, U: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Run `step` for many series side by side; no negative weights.

    Parameters
    ----------
    kernel : Kernel
    table : ndarray, shape (s, 1 + m + m*m, M1)
    U : ndarray, shape (s, 1 + w + q)
        Rows (1, w, y').

    Returns
    -------
    table : ndarray, shape (s, 1 + m + m*m, M2)
    log_likelihood : ndarray, shape (s,)
    """
    M1, M2, m, q = kernel.shape
    s = len(U)
    w = log_pairs(kernel, U).reshape(s, M1, M2)
    w += table[:, 0, :, None]
    top = w.max(axis=1)
    w -= top[:, None]
    np.exp(w, out=w)
    column = w.sum(axis=1)
    w /= column[:, None]
    offset = (U @ kernel.rows[q * M1 * M2 :].T).reshape(s, m, M1, M2)
    new = np.empty((s, 1 + m + m * m, M2))
    if m == 1:
        a, C = kernel.Axx[..., 0, 0], kernel.C[..., 0, 0]
        x = offset[:, 0]
        x += a * table[:, 1, :, None]
        new[:, 1] = np.einsum("sij,sij->sj", w, x)
        x -= new[:, 1, None]
        x *= x
        x += a * a * table[:, 2, :, None] + C
        new[:, 2] = np.einsum("sij,sij->sj", w, x)
    else:
        moments = np.swapaxes(table[:, 1:], 1, 2)
        x_node, P_node = moments[..., :m], moments[..., m:].reshape(s, M1, 1, m, m)
        x_pair = (kernel.Axx @ x_node[:, :, None, :, None])[..., 0] + np.moveaxis(offset, 1, -1)
        P_pair = kernel.Axx @ P_node @ np.swapaxes(kernel.Axx, -1, -2) + kernel.C
        mean = np.einsum("sij,sijk->sjk", w, x_pair)
        x_pair -= mean[:, None]
        P = np.einsum("sij,sijkl->sjkl", w, P_pair)
        P += np.einsum("sijk,sijl->sjkl", w[..., None] * x_pair, x_pair)
        P = 0.5 * (P + np.swapaxes(P, -1, -2))
        new[:, 1 : 1 + m] = np.swapaxes(mean, 1, 2)
        new[:, 1 + m :] = np.swapaxes(P.reshape(s, M2, m * m), 1, 2)
    log_p = np.log(column) + top
    peak = log_p.max(axis=1, keepdims=True)
    log_likelihood = np.log(np.exp(log_p - peak).sum(axis=1)) + peak[:, 0]
    new[:, 0] = log_p - log_likelihood[:, None]
    return new, log_likelihood


# --------------------------------------------------------------------------- hidden Markov chains


def forward_backward(
    first: FloatArray, transition: FloatArray, log_emission: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Posterior of the states of a chain given one stretch of observations.

    Parameters
    ----------
    first : ndarray, shape (M,)
        Probabilities of the first state.
    transition : ndarray, shape (M, M)
    log_emission : ndarray, shape (T, M, M)
        Log-density of what is observed at each transition, given the pair of states.

    Returns
    -------
    gamma : ndarray, shape (T + 1, M)
        Posterior probability of each state.
    xi : ndarray, shape (T, M, M)
        Posterior probability of each pair.
    log_likelihood : ndarray, shape (T,)
    """
    peaks = log_emission.max(axis=(1, 2), initial=-np.inf)
    moves = np.exp(log_emission - peaks[:, None, None])
    moves *= transition
    scaled = _scaled_messages(first, moves)
    if scaled is None:  # what floating-point numbers cannot hold may matter here
        return _in_logarithms(first, transition, log_emission)
    alpha, beta, scale = scaled
    xi = alpha[:-1, :, None] * moves
    xi *= (beta[1:] / scale[:, None])[:, None, :]
    return alpha * beta, xi, np.log(scale) + peaks


def _scaled_messages(
    first: FloatArray, moves: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Forward messages that sum to one, backward ones scaled alike, and totals; None if they underflow."""
    T, M = len(moves), first.size
    alpha, beta, scale = np.empty((T + 1, M)), np.empty((T + 1, M)), np.empty(T)
    ones = np.ones(M)
    alpha[0] = now = first
    for n, move in enumerate(moves):
        now = now.dot(move)
        total = now.dot(ones)
        if not total > _LOST:
            return None
        now /= total
        alpha[n + 1], scale[n] = now, total
    beta[T] = now = ones
    with np.errstate(over="ignore", invalid="ignore"):
        for n in range(T - 1, -1, -1):
            now = moves[n].dot(now)
            now /= scale[n]
            beta[n] = now
    return (alpha, beta, scale) if beta.max() < _FAVOURED else None


def _in_logarithms(
    first: FloatArray, transition: FloatArray, log_emission: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same as `forward_backward`, several times slower, whatever the densities."""
    T, M = len(log_emission), first.size
    with np.errstate(divide="ignore"):
        moves = log_emission + np.log(transition)
        now = np.log(first)
    alpha, beta, scale = np.empty((T + 1, M)), np.empty((T + 1, M)), np.empty(T)
    alpha[0] = now
    for n, move in enumerate(moves):
        now = _log_sums(now[:, None] + move, 0)
        scale[n] = _log_sums(now, 0)
        now = now - scale[n]
        alpha[n + 1] = now
    beta[T] = now = np.zeros(M)
    for n in range(T - 1, -1, -1):
        now = _log_sums(moves[n] + now, 1) - scale[n]
        beta[n] = now
    xi = np.exp(alpha[:-1, :, None] + moves + (beta[1:] - scale[:, None])[:, None, :])
    return np.exp(alpha + beta), xi, scale


def _log_sums(a: FloatArray, axis: int) -> FloatArray:
    """Logarithms of sums of exponentials; minus infinity stands for zero."""
    top = a.max(axis=axis)
    top = np.where(top > -np.inf, top, 0.0)
    with np.errstate(divide="ignore"):
        sums: FloatArray = np.log(np.exp(a - np.expand_dims(top, axis)).sum(axis=axis)) + top
    return sums

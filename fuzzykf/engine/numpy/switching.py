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
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["DEAD", "LOG_ZERO", "Kernel", "first_step", "log_pairs", "node_mean", "pack", "run", "step"]

#: Stand-in for log 0: sums of a few stay finite, and exp of it is zero.
LOG_ZERO = -1e300

#: Below this a logarithm stands for a probability of zero, not for a small one.
DEAD = 0.5 * LOG_ZERO

_ONE = np.ones(1)
_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)

#: Up to so many nodes the pairs of a scalar state are reached by a matrix product.
_FEW_NODES = 16

#: Sums of weights between these lose nothing without a maximum taken out.
_TINY, _HUGE = 1e-250, 1e250

#: Masses along a series are brought back to one when their total has left e^-100 to e^100.
_DRIFT = 100.0

#: How many numbers the tables of a chunk of observations may hold.
_CHUNK = 1 << 15


class FewNodes(NamedTuple):
    """Ways between nodes and pairs as matrices, for a scalar state."""

    mix: FloatArray  # (3 M1 M2, 3 M1): a state, as seen by the pairs
    whole: FloatArray  # (4 M1 M2, 1 + w + q + 3 M1): rows and mix at once
    spread: FloatArray  # (M1 M2, M2): a quantity of j, as seen by the pairs
    sums: FloatArray  # (2 M1 M2, 2 M2): sums over i of two quantities


class Kernel(NamedTuple):
    """Tables of one step in the layout of the kernels; pairs (i, j) are flat, j fastest.

    With u = (1, w, y') the first q M1 M2 entries of ``rows @ u`` are the whitened
    innovations of y' divided by sqrt(2), the other m M1 M2 are H w + G y' + c.
    """

    shape: tuple[int, int, int, int]  # M1, M2, m, q
    log_scale: FloatArray  # (M1 M2,): log P_ij and the constants of the Gaussian density
    sign: FloatArray | None  # (M1, M2): sign of P_ij, if some are negative
    rows: FloatArray  # ((q + m) M1 M2, 1 + w + q)
    Axx: FloatArray  # (M1, M2, m, m)
    C: FloatArray  # (M1, M2, m, m)
    ones: FloatArray  # (M1,)
    few: FewNodes | None  # for a scalar state and few nodes


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
    `fuzzykf.switching.dynamics.pairs.PairCoefficients`, with leading shape (M1, M2).
    """
    M1, M2 = transition.shape
    m, q = Axx.shape[-1], factor.shape[-1]
    identity = np.broadcast_to(np.eye(q), (M1, M2, q, q))
    innovation = np.concatenate([-Ny[..., None], -Ayy, identity], axis=-1)
    white = np.linalg.solve(factor, innovation) * np.sqrt(0.5)
    offset = np.concatenate([c[..., None], H, G], axis=-1)
    width = white.shape[-1]
    rows = np.concatenate(
        [np.moveaxis(white, 2, 0).reshape(-1, width), np.moveaxis(offset, 2, 0).reshape(-1, width)]
    )
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        log_transition = np.maximum(np.log(np.abs(transition)), LOG_ZERO)
    log_scale = (log_transition - log_det - q * _HALF_LOG_2PI).reshape(-1)
    few = None
    if m == 1 and q == 1 and max(M1, M2) <= _FEW_NODES and (transition >= 0.0).all():
        few = _pack_few(log_scale, rows, Axx.reshape(-1, 1), C.reshape(-1), M1, M2)
    return Kernel(
        shape=(M1, M2, m, q),
        log_scale=log_scale,
        sign=np.sign(transition) if (transition < 0.0).any() else None,
        rows=rows,
        Axx=np.ascontiguousarray(Axx),
        C=np.ascontiguousarray(C),
        ones=np.ones(M1),
        few=few,
    )


def _pack_few(
    log_scale: FloatArray, rows: FloatArray, a: FloatArray, C: FloatArray, M1: int, M2: int
) -> FewNodes:
    p, width = M1 * M2, rows.shape[1]
    pick = np.repeat(np.eye(M1), M2, axis=0)  # (p, M1): a quantity of i, as seen by the pairs
    spread = np.tile(np.eye(M2), (M1, 1))
    zero = np.zeros_like(pick)
    mix = np.block([[pick, zero, zero], [zero, a * pick, zero], [zero, zero, a * a * pick]])
    constants = np.zeros((3 * p, width))
    constants[:p, 0], constants[p : 2 * p], constants[2 * p :, 0] = log_scale, rows[p:], C
    innovations = np.concatenate([rows[:p], np.zeros((p, 3 * M1))], axis=1)
    whole = np.concatenate([innovations, np.concatenate([constants, mix], axis=1)])
    sums = np.kron(np.eye(2), spread).astype(np.float64)
    return FewNodes(mix, np.ascontiguousarray(whole), spread, sums)


def first_step(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, factor: FloatArray, y: FloatArray
) -> tuple[FloatArray, float]:
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
    table, log_likelihood
    """
    q = y.size
    m = mean.shape[1] - q
    white = np.linalg.solve(factor, (y - mean[:, m:])[..., None])[..., 0]
    root = np.linalg.solve(factor, np.swapaxes(covariance[:, :m, m:], -1, -2))  # L^-1 Cov(Y, X)
    x = mean[:, :m] + (np.swapaxes(root, -1, -2) @ white[..., None])[..., 0]
    P = covariance[:, :m, :m] - np.swapaxes(root, -1, -2) @ root
    if m == 1:
        P = np.maximum(P, 0.0)  # the subtraction may leave a rounding error below zero
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    log_w = log_initial - 0.5 * (white * white).sum(axis=-1) - log_det - q * _HALF_LOG_2PI
    top = log_w.max()
    log_likelihood = float(top) + log(float(np.exp(log_w - top).sum()))
    table = _table(log_w - log_likelihood, x, P)
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

"""Whole series of the switching recursion, filtered and summarised; NumPy."""

from __future__ import annotations

from math import isqrt
from typing import TYPE_CHECKING, cast

import numpy as np

from fuzzykf.engine.numpy.outliers import NEAR, QUIET, far_pairs
from fuzzykf.engine.numpy.switching import collapse, collapse_few, first_step, slot_logs
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray
    from fuzzykf.engine.numpy.tables import Kernel, Summary

__all__ = [
    "filter_series",
    "most_likely",
    "node_moments",
    "prior_moments",
    "probabilities",
    "run",
    "state_table",
    "step_many",
    "summarise",
]

#: How many numbers the tables of a chunk of observations may hold.
_TABLES = 1 << 15

#: Observations whose prior moments are computed at once, and how many numbers they may take.
_CHUNK, _NUMBERS = 512, 1 << 20

#: Numbers that the pairs of a block of series may hold.
_BLOCK = 1 << 16


@QUIET
def filter_series(
    kernel: Kernel,
    summary: Summary,
    begin: tuple[FloatArray | None, ...],
    ys: FloatArray,
    start: int,
    stop: int,
    out: dict[str, FloatArray],
    mass: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Filter complete observations start, ..., stop - 1 of each series with constant tables.

    One series gives the same numbers to the bit whether it is filtered at once or in parts.

    Parameters
    ----------
    kernel : Kernel
        Tables of every step into these observations (into the later ones, if start is 0).
    summary : Summary
    begin : tuple
        The state of each series before them, ``table`` (s, 1 + m + m*m, M) and ``sign`` (s, M) or
        None; if start is 0 the arguments of `first_step` without y.
    ys : ndarray, shape (s, n, q)
        The window of each step is complete.
    start, stop : int
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in from start to stop: fields of a result, ``table`` and, with negative weights,
        ``sign``.  ``x_prior`` and ``P_prior`` of the first observation of all are not.
    mass : ndarray, shape (2, s, M), optional
        Probabilities of the nodes of ``before`` and ``last``, NaN where an engine has their logarithms
        alone, as here: filled in, and ``mass[1]`` read as that of the states before.

    Returns
    -------
    before, last : ndarray, shape (s, 1 + m + m*m, M)
        The states after the last two observations; the last one twice where there is one alone.
    """
    M1, M2, m, q = kernel.shape
    switch = summary.switch
    s, order = len(ys), (kernel.rows.shape[1] - 1 - q) // q
    if start == 0:
        log_initial, mean, covariance, factor = cast("tuple[FloatArray, ...]", begin)
        table, log_likelihood = first_step(log_initial, mean, covariance, factor, ys[:, 0])
        sign = None
        summarise(out, slice(0, 1), table[:, None], None, log_likelihood[:, None], switch)
        start = 1
    else:
        table, sign = cast("tuple[FloatArray, FloatArray | None]", begin)
    before = table
    if start == stop:
        return before, table
    windows = np.concatenate([ys[:, start - 1 - lag : stop - 1 - lag] for lag in range(order)], axis=-1)
    if s == 1:
        U = np.concatenate([np.ones((stop - start, 1)), windows[0], ys[0, start:stop]], axis=1)
        tables, signs, log_likelihood = run(kernel, table[0], None if sign is None else sign[0], U)
        both = np.concatenate([table, tables])
        both_signs = None
        if signs is not None:
            both_signs = np.concatenate([np.ones((1, M1)) if sign is None else sign, signs])
        chunk = max(1, min(_CHUNK, _NUMBERS // (kernel.depth * M2 * m)))
        for a in range(start, stop, chunk):
            b = min(a + chunk, stop)
            old, new = slice(a - start, b - start), slice(a - start + 1, b - start + 1)
            new_signs = None if both_signs is None else both_signs[None, new]
            summarise(out, slice(a, b), both[None, new], new_signs, log_likelihood[None, old], switch)
            old_signs = None if both_signs is None else both_signs[None, old]
            _store_prior(out, slice(a, b), m, summary, both[None, old], old_signs, windows[:, old])
        return both[None, -2], both[None, -1]
    last = np.empty((s, *table.shape[1:]))
    before = np.empty_like(last)
    size = max(1, _BLOCK // (kernel.depth * M2))
    for a in range(0, s, size):
        block = slice(a, a + size)
        part = {name: values[block] for name, values in out.items()}
        now = table[block]
        for k in range(start, stop):
            window = windows[block, k - start]
            _store_prior(part, slice(k, k + 1), m, summary, now[:, None], None, window[:, None])
            U = np.concatenate([np.ones((len(now), 1)), window, ys[block, k]], axis=1)
            before[block] = now
            now, log_likelihood = step_many(kernel, now, U)
            summarise(part, slice(k, k + 1), now[:, None], None, log_likelihood[:, None], switch)
        last[block] = now
    return before, last


def run(
    kernel: Kernel, table: FloatArray, sign: FloatArray | None, U: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Run `fuzzykf.engine.numpy.switching.step` along a series with constant tables.

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
    _, M2, m, q = kernel.shape
    p = kernel.depth * M2
    tables = np.empty((n, 1 + m + m * m, M2))
    signs = None if kernel.sign is None else np.empty((n, M2))
    log_likelihood = np.empty(n)
    chunk = max(1, _TABLES // ((q + m) * p))
    for start in range(0, n, chunk):
        part = U[start : start + chunk]
        log_w = slot_logs(kernel, part)
        if kernel.few is not None:
            mix = kernel.few.mix
            pairs = np.empty((len(part), 3 * p))
            pairs[:, :p] = log_w
            pairs[:, p : 2 * p] = by_rows(part, kernel.rows[p:].T)
            pairs[:, 2 * p :] = kernel.C.ravel()
            for k, row in enumerate(pairs):
                np.add(row, mix.dot(table.ravel()), row)
                table, log_total, best = collapse_few(
                    kernel, row[:p], row[p : 2 * p], row[2 * p :], table[0], part[k]
                )
                table[0] -= log_total
                tables[start + k], log_likelihood[start + k] = table, log_total + best
        else:
            offsets = by_rows(part, kernel.rows[q * p :].T).reshape(-1, m, p)
            for k, (u, row, offset) in enumerate(zip(part, log_w, offsets, strict=True), start):
                table, sign, log_likelihood[k] = collapse(kernel, row, offset, table, sign, u)
                tables[k] = table
                if signs is not None:
                    signs[k] = sign
    return tables, signs, log_likelihood


def step_many(kernel: Kernel, table: FloatArray, U: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Run `fuzzykf.engine.numpy.switching.step` for many series side by side; no negative weights.

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
    _, M2, m, q = kernel.shape
    s, p, nodes = len(U), kernel.depth * M2, (slice(None), *kernel.nodes)
    w = slot_logs(kernel, U).reshape(s, -1, M2)
    w += table[:, 0][nodes]
    top = w.max(axis=1)
    base, best = top.copy(), np.zeros(s)
    for k in np.flatnonzero(((top < NEAR) & (top > DEAD)).any(axis=1)):
        w[k], reference, best[k] = far_pairs(kernel, table[k, 0], U[k])
        top[k] = w[k].max(axis=0)
        base[k] = top[k] + reference
    w -= top[:, None]
    np.exp(w, out=w)
    column = w.sum(axis=1)
    w /= column[:, None]
    offset = (U @ kernel.rows[q * p :].T).reshape(s, m, -1, M2)
    new = np.empty((s, 1 + m + m * m, M2))
    if m == 1:
        a, C = kernel.Axx[..., 0, 0], kernel.C[..., 0, 0]
        x = offset[:, 0]
        x += a * table[:, 1][nodes]
        first = np.take_along_axis(x, w.argmax(axis=1)[:, None], axis=1)
        x -= first
        beyond = np.einsum("sij,sij->sj", w, x)
        new[:, 1] = first[:, 0] + beyond
        x -= beyond[:, None]
        x *= x
        x += a * a * table[:, 2][nodes] + C
        new[:, 2] = np.einsum("sij,sij->sj", w, x)
    else:
        moments = np.swapaxes(table[:, 1:], 1, 2)
        x_node, P_node = moments[..., :m], moments[..., m:].reshape(s, -1, m, m)
        x_pair = (kernel.Axx @ x_node[nodes][..., None])[..., 0] + np.moveaxis(offset, 1, -1)
        P_pair = kernel.Axx @ P_node[nodes] @ np.swapaxes(kernel.Axx, -1, -2) + kernel.C
        first = np.take_along_axis(x_pair, w.argmax(axis=1)[:, None, :, None], axis=1)
        x_pair -= first
        beyond = np.einsum("sij,sijk->sjk", w, x_pair)
        mean = first[:, 0] + beyond
        x_pair -= beyond[:, None]
        P = np.einsum("sij,sijkl->sjkl", w, P_pair)
        P += np.einsum("sijk,sijl->sjkl", w[..., None] * x_pair, x_pair)
        P = 0.5 * (P + np.swapaxes(P, -1, -2))
        new[:, 1 : 1 + m] = np.swapaxes(mean, 1, 2)
        new[:, 1 + m :] = np.swapaxes(P.reshape(s, M2, m * m), 1, 2)
    is_lost = top < DEAD  # no path reaches these nodes
    new[:, 1:][np.broadcast_to(is_lost[:, None], new[:, 1:].shape)] = 0.0
    log_p = np.log(column) + base
    log_p[is_lost] = np.maximum(log_p[is_lost], LOG_ZERO)
    peak = log_p.max(axis=1, keepdims=True)
    log_total = np.log(np.exp(log_p - peak).sum(axis=1)) + peak[:, 0]
    new[:, 0] = log_p - log_total[:, None]
    return new, log_total + best


def summarise(
    out: dict[str, FloatArray],
    at: slice | IntArray,
    table: FloatArray,
    sign: FloatArray | None,
    log_likelihood: FloatArray,
    switch: tuple[FloatArray, FloatArray, BoolArray, IntArray],
) -> None:
    """Fill in what is known after observations.

    Parameters
    ----------
    out : dict of str to ndarray, shape (s, n, ...)
    at : slice or ndarray of int
        Which of the n observations.
    table : ndarray, shape (s, k, 1 + m + m*m, M)
    sign : ndarray, shape (s, k, M), or None
    log_likelihood : ndarray, shape (s, k)
    switch : tuple
        The arguments of `most_likely` beside the probabilities.
    """
    p, nodes = probabilities(table, sign), switch[0]
    fields = {"log_likelihood": log_likelihood, "mu": p, "table": table, "sign": sign}
    if "x" in out or "P" in out:
        moments = np.swapaxes(table[..., 1:, :], -1, -2)
        m = (isqrt(4 * moments.shape[-1] + 1) - 1) // 2  # there are m + m*m of them
        # from the likeliest on: what all have in common then cancels to the last bit, however large
        first = np.take_along_axis(moments[..., :m], p.argmax(axis=-1)[..., None, None], axis=-2)
        off = moments[..., :m] - first
        beyond = p[..., None, :] @ off
        fields["x"] = (first + beyond)[..., 0, :]
        off -= beyond
        between = np.swapaxes(off, -1, -2) @ (p[..., None] * off)
        P = between + (p[..., None, :] @ moments[..., m:]).reshape(between.shape)
        fields["P"] = 0.5 * (P + np.swapaxes(P, -1, -2))
    if "switch" in out:
        fields["switch"] = most_likely(p, *switch)
    if "switch_mean" in out:
        fields["switch_mean"] = by_rows(p, nodes[:, None])[..., 0]
    for name, values in fields.items():
        if name in out:
            out[name][:, at] = values


def _store_prior(
    out: dict[str, FloatArray],
    at: slice,
    m: int,
    summary: Summary,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
) -> None:
    """Fill in the moments of the state before the observations that follow those states."""
    if "x_prior" not in out and "P_prior" not in out:
        return
    x, P = prior_moments(summary, probabilities(table, sign), *node_moments(table, m), window)
    for name, values in (("x_prior", x), ("P_prior", P)):
        if name in out:
            out[name][:, at] = values


def prior_moments(
    summary: Summary, p: FloatArray, x: FloatArray, P: FloatArray, window: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (..., m) and covariance (..., m, m) of X' before Y' is seen.

    Parameters
    ----------
    summary : Summary
    p : ndarray, shape (..., M)
    x, P : ndarray, shapes (..., M, m) and (..., M, m, m)
    window : ndarray, shape (..., w)
    """
    lead, slots, m = p.shape[:-1], summary.transition.size, x.shape[-1]
    # x_ij of each pair, and the central moments of their mixture
    constant = summary.offset[0] + by_rows(window, summary.offset[1:])
    mean = (constant + by_rows(x.reshape(*lead, -1), summary.carried)).reshape(*lead, slots, m)
    weights = (p[(..., *summary.nodes)] * summary.transition).reshape(*lead, slots)
    first = np.take_along_axis(mean, weights.argmax(axis=-1)[..., None, None], axis=-2)
    mean -= first
    beyond = (weights[..., None, :] @ mean)[..., 0, :]
    centre = first[..., 0, :] + beyond
    mean -= beyond[..., None, :]
    between = np.swapaxes(weights[..., None] * mean, -1, -2) @ mean
    inside = by_rows((p[..., None, None] * P).reshape(*lead, -1), summary.twice)
    within = inside + by_rows(p, summary.noise)
    P = between + within.reshape(*lead, m, m)
    return centre, 0.5 * (P + np.swapaxes(P, -1, -2))


def most_likely(
    mu: FloatArray, nodes: FloatArray, weights: FloatArray, atoms: BoolArray, ranking: IntArray
) -> FloatArray:
    """MPM estimate of the switch, (...), by the rule of the 2020 paper (section VI-B).

    The likeliest stratum comes first: all hard values together, or what lies between the same
    classes; on a tie the earlier one, and hard values last.  Beside a single edge hard values need
    more than half of the probability.  In the stratum it is the likeliest of the hard values, on a tie
    the later one, or the value with the largest density: mass divided by weight, summed over its nodes.

    Parameters
    ----------
    mu : ndarray, shape (..., M)
    nodes : ndarray, shape (M,) or (M, K)
    weights, atoms : ndarray, shape (M,)
    ranking : ndarray of int, shape (2, M)
        Numbers of the nodes stratum by stratum and value by value, atoms last; for each 1 if it is the
        last of its value, 2 if it is the last of its stratum as well, else 0.
    """
    order, ends = ranking
    soft = order.size - np.count_nonzero(atoms)
    if np.count_nonzero(ends) == order.size and not (ends[: max(soft - 1, 0)] == 2).any():
        return nodes[_most_likely_node(mu, weights, order[:soft], order[soft:])]  # nearly always
    mass = mu[..., order]
    value_ends, strata_ends = np.flatnonzero(ends), np.flatnonzero(ends == 2)
    level = np.add.reduceat(mass / np.where(atoms, 1.0, weights)[order], _begins(value_ends), axis=-1)
    stop = np.searchsorted(value_ends, strata_ends) + 1  # of each stratum, among the values
    best = np.stack(
        [
            order[value_ends[start + np.argmax(level[..., start:end], axis=-1)]]
            for start, end in zip([0, *stop[:-1]], stop, strict=True)
        ],
        axis=-1,
    )
    total = np.add.reduceat(mass, _begins(strata_ends), axis=-1)
    if len(stop) == 2 and atoms[order[-1]]:
        chosen = (total[..., 1] > 0.5).astype(np.intp)
    else:
        chosen = np.argmax(total, axis=-1)
    estimate: FloatArray = nodes[np.take_along_axis(best, chosen[..., None], axis=-1)[..., 0]]
    return estimate


def _most_likely_node(mu: FloatArray, weights: FloatArray, inner: IntArray, hard: IntArray) -> IntArray:
    """Return what `most_likely` chooses among nodes of one edge at most, none of which share a value."""
    likeliest = densest = np.empty(0, dtype=np.intp)
    if hard.size:
        likeliest = hard[np.argmax(mu[..., hard], axis=-1)]
    if inner.size:
        densest = inner[np.argmax(mu[..., inner] / weights[inner], axis=-1)]
    if not (hard.size and inner.size):
        return likeliest if hard.size else densest
    return np.where(mu[..., hard].sum(axis=-1) > 0.5, likeliest, densest)


def _begins(ends: IntArray) -> IntArray:
    """Return where the parts begin whose last places are given."""
    return np.append(0, ends[:-1] + 1)


# --------------------------------------------------------------------------- what a state says


def probabilities(table: FloatArray, sign: FloatArray | None = None) -> FloatArray:
    """Probabilities (..., M) of the nodes of a state (..., 1 + m + m*m, M)."""
    p: FloatArray = np.exp(table[..., 0, :])
    return p if sign is None else p * sign


def node_moments(table: FloatArray, m: int) -> tuple[FloatArray, FloatArray]:
    """Means (..., M, m) and covariances (..., M, m, m) given each node."""
    flat = np.swapaxes(table[..., 1:, :], -1, -2)
    return flat[..., :m], flat[..., m:].reshape(*flat.shape[:-1], m, m)


def state_table(table: FloatArray, m: int) -> FloatArray:
    """Rows (1 + m + m*m, M) of X alone, in a table (1 + e + e*e, M) of X and what else is unknown."""
    e = (isqrt(4 * len(table) - 3) - 1) // 2
    if e == m:
        return table
    rows = np.arange(e * e).reshape(e, e)[:m, :m].ravel()
    state: FloatArray = table[np.concatenate([np.arange(1 + m), 1 + e + rows])]
    return state


def by_rows(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Products (..., l) of rows (..., k) with a matrix (k, l), whatever rows stand beside them.

    Multiplied all at once, the last bit of each would depend on how many they are.
    """
    products: FloatArray = (rows[..., None, :] @ matrix)[..., 0, :]
    return products

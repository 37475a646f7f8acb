"""Whole series of the switching recursion, filtered and summarised; NumPy."""

from __future__ import annotations

from math import isqrt
from typing import TYPE_CHECKING, cast

import numpy as np

from fuzzykf.engine.numpy.switching import first_step, node_moments, probabilities, run, step_many
from fuzzykf.gaussian import mixture_moments, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray
    from fuzzykf.engine.numpy.tables import Kernel, Summary

__all__ = [
    "filter_series",
    "most_likely",
    "prior_moments",
    "summarise",
]

#: Observations whose prior moments are computed at once, and how many numbers they may take.
_CHUNK, _NUMBERS = 512, 1 << 20

#: Numbers that the pairs of a block of series may hold.
_BLOCK = 1 << 16


def filter_series(
    kernel: Kernel,
    summary: Summary,
    begin: tuple[FloatArray | None, ...],
    ys: FloatArray,
    start: int,
    stop: int,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Filter complete observations start, ..., stop - 1 of each series with constant tables.

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

    Returns
    -------
    before, last : ndarray, shape (s, 1 + m + m*m, M)
        The states after the last two observations; the last one twice where there is one alone.
    """
    M1, M2, m, q = kernel.shape
    switch = summary.nodes, summary.weights, summary.atoms
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
        chunk = max(1, min(_CHUNK, _NUMBERS // (M1 * M2 * m)))
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
    size = max(1, _BLOCK // (M1 * M2))
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


def summarise(
    out: dict[str, FloatArray],
    at: slice | IntArray,
    table: FloatArray,
    sign: FloatArray | None,
    log_likelihood: FloatArray,
    switch: tuple[FloatArray, FloatArray, BoolArray],
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
        Nodes, weights and atoms, (M,) each.
    """
    p, (nodes, weights, atoms) = probabilities(table, sign), switch
    fields = {"log_likelihood": log_likelihood, "mu": p, "table": table, "sign": sign}
    if "x" in out or "P" in out:
        m = (isqrt(4 * table.shape[-2] - 3) - 1) // 2  # there are 1 + m + m*m rows
        fields["x"], fields["P"] = mixture_moments(p, *node_moments(table, m))
    if "switch" in out:
        fields["switch"] = most_likely(p, nodes, weights, atoms)
    if "switch_mean" in out:
        fields["switch_mean"] = p @ nodes
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
    lead, (M1, M2), m = p.shape[:-1], summary.transition.shape, x.shape[-1]
    # x_ij of each pair, and the central moments of their mixture
    constant = summary.offset[0] + window @ summary.offset[1:]
    mean = (constant + x.reshape(*lead, M1 * m) @ summary.carried).reshape(*lead, M1 * M2, m)
    weights = (p[..., :, None] * summary.transition).reshape(*lead, M1 * M2)
    centre = np.einsum("...p,...pk->...k", weights, mean)
    mean -= centre[..., None, :]
    between = np.einsum("...pk,...pl->...kl", weights[..., None] * mean, mean)
    within = (p[..., None, None] * P).reshape(*lead, -1) @ summary.twice + p @ summary.noise
    return centre, symmetrize(between + within.reshape(*lead, m, m))


def most_likely(mu: FloatArray, nodes: FloatArray, weights: FloatArray, atoms: BoolArray) -> FloatArray:
    """MPM estimate of the switch, (...), by the rule of the 2020 paper (section VI-B).

    If the hard values together have more than half of the probability, the likelier of them, on a tie
    the later one; else the node in between with the largest density (mass divided by weight).

    Parameters
    ----------
    mu : ndarray, shape (..., M)
    nodes, weights, atoms : ndarray, shape (M,)
    """
    last_first, inner = np.flatnonzero(atoms)[::-1], np.flatnonzero(~atoms)
    hard = soft = np.empty(0)
    if last_first.size:
        hard = nodes[last_first][np.argmax(mu[..., last_first], axis=-1)]
    if inner.size:
        soft = nodes[inner][np.argmax(mu[..., inner] / weights[inner], axis=-1)]
    if not (last_first.size and inner.size):
        return hard if last_first.size else soft
    estimate: FloatArray = np.where(mu[..., last_first].sum(axis=-1) > 0.5, hard, soft)
    return estimate

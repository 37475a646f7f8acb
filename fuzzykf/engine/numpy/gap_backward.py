"""NumPy kernel of the smoother where a part of the window of latest observations was missing.

There the future tells of r_n and X_n through the missing part u of the window.  Given the next
node j, what it tells of the next window is a function L_j(u'), the ratio of the
smoothed to the filtered law of u', taken as Gaussian:

    L_j(u') proportional to exp(-(u' - a)' Lam (u' - a)/2 + eta' (u' - a)),
    Lam = Vs^-1 - Vf^-1,  eta = Vs^-1 (ms - mf),  a = mf,

with mf, Vf the filtered and ms, Vs the smoothed moments given j.  Against the law of u' in
each pair (i, j) it gives the weight of the pair, and the moments of u' in it; those of
the window before follow by regression, and those of X from that.

In a gap the filter keeps the components of the nodes apart, its branches: the pairs (i, j) of a node and that
before it.  A complete observation after the gap is told to every branch, which is exact.  Further back into
the gap L_j, of the moments of the nodes, is told to theirs.  So a gap of one observation is smoothed exactly,
and all of them if the future is linear and Gaussian given j, as with a single class.
Covariances go through it as roots, as in `fuzzykf.engine.numpy.gaps`.  Where weights are negative the
matrices come first.  What is known of a window has rows of zeros in either: whatever is not zero there is
taken for unknown, and the rounding of two laws would be compared.  A mixture by weights of both signs may
have less than no variance in a node of little mass, which counts as zero there; `smooth_back` refuses it of
all nodes together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.gaps import (
    apart,
    collapse_weights,
    condition_pairs,
    merge_branches,
    pair_mixture,
    window_moments,
    window_root,
)
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import covariance_root, lower_factor, mixture_moments, mixture_root, solve_lower, square

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.numpy.gaps import Branches, GapTables, PairMixture, SlotPairs
    from fuzzykf.engine.numpy.slots import Slots

__all__ = ["Moments", "SmoothedGap", "back_into_gap", "by_row", "gap_log_pairs", "window_known"]

#: Where the future leaves at most this share of the variance of u', it is taken for an observation of it.
_TELLING = 0.5


class Moments(NamedTuple):
    """Mean (..., w) of a window, and a root (..., w, r) of its covariance, zero where it is known."""

    mean: FloatArray
    root: FloatArray


class SmoothedGap(NamedTuple):
    """What the whole series says of an observation in whose window a part is missing."""

    p: FloatArray  # (b,): smoothed probabilities of the branches
    told: Moments  # of the window, given each branch
    mu: FloatArray  # (M,): smoothed probabilities of the nodes
    x: FloatArray  # (M, m): means of X given each node
    P: FloatArray  # (M, m, m)
    log_pairs: FloatArray | None  # (depth, M2): log |P_ij| p(y | i, j, all before), if y ends the gap


def window_known(table: FloatArray, root: FloatArray | None, window: FloatArray) -> Moments:
    """Return what a filter knew of the window, per node or branch, whose table and root these are."""
    mean, covariance = window_moments(table, window)
    m = mean.shape[1] - window.size
    if not np.isnan(window).any():
        return Moments(mean[:, m:], np.zeros((*mean[:, m:].shape, 1)))
    return Moments(mean[:, m:], window_root(covariance, root, window)[:, m:])


@QUIET
def back_into_gap(
    gaps: GapTables,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    root: FloatArray | None,
    y: FloatArray,
    p: FloatArray,
    told: Moments | None = None,
    branches: Branches | None = None,
    size: int | None = None,
) -> SmoothedGap:
    """Go back into an observation in whose window a part is missing.

    Parameters
    ----------
    gaps : GapTables
        Of the step from here to the next observation ``y``.
    table, sign, window, root
        What the filter knew here, as in `pair_mixture`.
    y : ndarray, shape (q,)
        NaN where missing.
    p : ndarray, shape (k,)
        Smoothed probabilities of the next branches, or of the nodes (M2,) if nothing is unknown then.
    told : Moments, optional
        Smoothed ones of the next window, given each next branch; None if nothing is unknown of it.
    branches : Branches, optional
        The components of the nodes here.
    size : int, optional
        How many numbers of ``window`` are observations: all, but for inputs and features.
    """
    size = window.size if size is None else size
    step, noise, M1 = gaps.step, gaps.noise, table.shape[1]
    m, q = step.pairs[0].shape[-1], y.size
    parts = (table, sign, root) if branches is None else branches
    log_pairs = None
    if told is None:
        moved = pair_mixture(*apart(step, noise, M1, branches), parts[0], parts[1], window, parts[2])
        after = condition_pairs(moved, y, m)
        joint = collapse_weights(after.log_w, after.sign)[2] * p  # p(i, j | y_1..N)
        given = Moments(after.mean[..., m : m + q], np.zeros((*after.mean.shape[:-1], q, 1)))
        found = _regress_rows(step, M1, moved, joint, given, q, size)
        log_pairs = _log_pairs(step, after, table[0])
    else:
        moved = pair_mixture(step, noise, table, sign, window, root)
        joint = p.reshape(step.transition.shape)
        given = Moments(*(part.reshape(*joint.shape, *part.shape[1:]) for part in told))
        total, carried = _regress_rows(step, M1, moved, joint, given, q, size)
        found = total, carried
        if branches is not None:
            law = window_known(branches.table, branches.root, window[:size])
            law = Moments(*(part.reshape(-1, M1, *part.shape[1:]) for part in law))
            filtered = window_known(table, root, window[:size])
            found = _told_apart(branches, law, filtered, total, carried)
    x, P = _smooth_state(parts[0], parts[2], window[:size], found[1], m)
    return SmoothedGap(*found, *merge_branches(found[0], x, P, M1), log_pairs)


def gap_log_pairs(
    gaps: GapTables,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    root: FloatArray | None,
    y: FloatArray,
    branches: Branches | None = None,
) -> FloatArray:
    """Log |P_ij| + log p(what is there of y | i, j, all before), (depth, M2); parameters as above."""
    parts = (table, sign, root) if branches is None else branches
    step, noise = apart(gaps.step, gaps.noise, table.shape[1], branches)
    m = step.pairs[0].shape[-1]
    after = condition_pairs(pair_mixture(step, noise, parts[0], parts[1], window, parts[2]), y, m)
    return _log_pairs(gaps.step, after, table[0])


def _log_pairs(step: SlotPairs, after: PairMixture, log_p: FloatArray) -> FloatArray:
    shape = (-1, *step.transition.shape)
    sign = None if after.sign is None else after.sign.reshape(shape)
    log_w = collapse_weights(after.log_w.reshape(shape), sign)[0] + after.reference
    found: FloatArray = log_w - log_p[step.nodes]
    return found


def _regress_rows(
    step: SlotPairs, M1: int, before: PairMixture, joint: FloatArray, told: Moments, q: int, size: int
) -> tuple[FloatArray, Moments]:
    """Sum up over the nodes j that follow, given the smoothed moments of the next window in each pair.

    The window here are ``size`` numbers; what inputs and features add to it in the step is known.
    """
    m, w = step.pairs[0].shape[-1], told.mean.shape[-1]
    root, here = _root_of(before), slice(m + q, m + q + size)
    J, left = _regress(root[..., m : m + w, :], root[..., here, :])
    mean = before.mean[..., here] + _times(J, told.mean - before.mean[..., m : m + w])
    root = np.concatenate([J @ told.root, left], axis=-1)
    joint, mean, root = by_row(step.slots, M1, joint, mean, root)
    total = joint.sum(axis=1)
    # what is impossible by now keeps any finite moments
    share = np.where(total[:, None] != 0.0, joint, 1.0)
    share = share / share.sum(axis=1, keepdims=True)
    if before.sign is None:
        return total, Moments(*mixture_root(share, mean, root))
    mean, covariance = mixture_moments(share, mean, square(root))
    return total, Moments(mean, covariance_root(covariance))


def by_row(slots: Slots | None, M1: int, joint: FloatArray, *parts: FloatArray) -> list[FloatArray]:
    """Bring what is known of pairs (n depth, M2) from the slots of columns to rows of the n M1 branches."""
    if slots is None:
        return [joint, *parts]
    at, there = slots.rows(M1)
    n = joint.size // slots.source.size
    at = (np.arange(n)[:, None, None] * slots.source.size + at).reshape(n * M1, -1)
    joint = np.where(np.tile(there, (n, 1)), joint.reshape(-1)[at], 0.0)
    return [joint, *(part.reshape(-1, *part.shape[2:])[at] for part in parts)]


def _told_apart(
    branches: Branches, law: Moments, filtered: Moments, gamma: FloatArray, window: Moments
) -> tuple[FloatArray, Moments]:
    """Tell branches, with these laws of the window (n, M), what is known of their nodes (M,)."""
    log_evidence, updated = _weigh(law, filtered, window)
    signs = None if branches.sign is None else branches.sign.reshape(-1, gamma.size)
    shares = collapse_weights(branches.table[0].reshape(-1, gamma.size) + log_evidence, signs)[2]
    return (shares * gamma).ravel(), Moments(*(part.reshape(-1, *part.shape[2:]) for part in updated))


def _smooth_state(
    table: FloatArray, root: FloatArray | None, window: FloatArray, told: Moments, m: int
) -> tuple[FloatArray, FloatArray]:
    """Moments of X per branch, given the smoothed moments of the window, from the regression of X on it."""
    mean, P = window_moments(table, window)
    root = window_root(P, root, window)
    B, left = _regress(root[:, m:], root[:, :m])
    x = mean[:, :m] + _times(B, told.mean - mean[:, m:])
    return x, square(np.concatenate([B @ told.root, left], axis=-1))


def _weigh(law: Moments, filtered: Moments, smoothed: Moments) -> tuple[FloatArray, Moments]:
    """Weigh the law of the next window in each pair by what the future tells of it.

    With Vs = Ls Ls', Vf = Lf Lf' and the singular values s of Lf^-1 Ls, Lam = T' (1 - s^2) T and
    eta = T' T (ms - mf), T = V' Ls^-1.  In the directions in which the future tells much it is an
    observation of T u', whose density does not cancel, however far the means of the pairs lie apart.

    Parameters
    ----------
    law : Moments
        Given each branch, leading shape (M1, M2).
    filtered, smoothed : Moments
        Given each node, leading shape (M2,).

    Returns
    -------
    log_evidence : ndarray, shape (M1, M2)
        Logarithm of the mean of L_j under the law of the branch, up to what depends on j alone.
    updated : Moments
        Of the law of the branch times L_j.
    """
    open_ = np.flatnonzero(filtered.root.any(axis=(0, -1)))
    if not open_.size:
        return np.zeros(law.mean.shape[:2]), law
    Lf, Ls = (lower_factor(moments.root[:, open_]) for moments in (filtered, smoothed))
    half = solve_lower(_regular(Lf), Ls)
    s, V = np.linalg.svd(half)[1:]
    # mixtures may widen what one class can only narrow; then nothing is known of the direction
    told = np.maximum(1.0 - s * s, 0.0)
    T = V @ solve_lower(_regular(Ls), np.eye(open_.size))
    tau = _times(T, (smoothed.mean - filtered.mean)[:, open_])
    off, root = law.mean[..., open_] - filtered.mean[:, open_], law.root[..., open_, :]

    is_told = told >= 1.0 - _TELLING
    Y = np.where(is_told, np.sqrt(told), 0.0)[..., None] * T
    A, B, root = _observe(Y, root)
    seen = np.where(is_told, tau / np.sqrt(np.where(is_told, told, 1.0)), 0.0)
    white = solve_lower(A, (_times(Y, off) - seen)[..., None])
    off = off - (B @ white)[..., 0]
    log_evidence = -0.5 * (white * white).sum(axis=(-1, -2)) - _log_diagonal(A)

    tau, told = np.where(is_told, 0.0, tau), np.where(is_told, 0.0, told)
    A, _, root = _observe(np.sqrt(told)[..., None] * T, root)
    t = _times(T, off)
    pull = np.swapaxes(root, -1, -2) @ np.swapaxes(T, -1, -2) @ (tau - told * t)[..., None]
    log_evidence += (tau * t - 0.5 * told * t * t).sum(axis=-1) + 0.5 * (pull * pull).sum(axis=(-1, -2))
    log_evidence -= _log_diagonal(A)
    mean, whole = law.mean.copy(), np.zeros((*law.mean.shape, root.shape[-1]))
    mean[..., open_] = filtered.mean[:, open_] + off + (root @ pull)[..., 0]
    whole[..., open_, :] = root
    return log_evidence, Moments(mean, whole)


def _observe(Y: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition a law with this root on Y u + noise of unit variance.

    Returns A, B and the root that is left, where A A' = Y C Y' + I and B A' = C Y'.
    """
    f = root.shape[-2]
    upper = np.concatenate([np.broadcast_to(np.eye(f), (*root.shape[:-1], f)), Y @ root], axis=-1)
    lower = np.concatenate([np.zeros((*root.shape[:-1], f)), root], axis=-1)
    whole = lower_factor(np.concatenate([upper, lower], axis=-2))
    return whole[..., :f, :f], whole[..., f:, :f], whole[..., f:, f:]


def _regress(given: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients of the regression on the variables with root ``given``, and the root of what it leaves.

    Variables that are known, whose rows are zero in all of ``given``, have no part in it.
    """
    n, w = given.shape[-2], root.shape[-2]
    open_ = np.flatnonzero(given.any(axis=(*range(given.ndim - 2), -1)))
    whole = lower_factor(np.concatenate([given[..., open_, :], root], axis=-2))
    k = open_.size
    J = np.zeros((*root.shape[:-2], w, n))
    L, cross = _regular(whole[..., :k, :k]), whole[..., k:, :k]
    # J L = cross, solved from the last column on
    turned = solve_lower(np.swapaxes(L, -1, -2)[..., ::-1, ::-1], np.swapaxes(cross, -1, -2)[..., ::-1, :])
    J[..., open_] = np.swapaxes(turned[..., ::-1, :], -1, -2)
    return J, whole[..., k:, k:]


def _regular(L: FloatArray) -> FloatArray:
    """Put a one where the diagonal of a triangular root is zero: in nodes that are impossible."""
    d = L.shape[-1]
    return L + np.where(np.diagonal(L, axis1=-2, axis2=-1) == 0.0, 1.0, 0.0)[..., None] * np.eye(d)


def _root_of(pairs: PairMixture) -> FloatArray:
    return covariance_root(pairs.covariance) if pairs.root is None else pairs.root


def _times(A: FloatArray, v: FloatArray) -> FloatArray:
    product: FloatArray = (A @ v[..., None])[..., 0]
    return product


def _log_diagonal(A: FloatArray) -> FloatArray:
    total: FloatArray = np.log(np.diagonal(A, axis1=-2, axis2=-1)).sum(axis=-1)
    return total

"""Steps of the smoother where a part of the window of latest observations was missing.

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

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import covariance_root, lower_factor, mixture_moments, mixture_root, solve_lower, square

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.inference.mixture import Mixture

__all__ = ["Moments", "branches_of", "pairs_ahead", "smooth_state", "step_back", "window_known"]

#: Where the future leaves at most this share of the variance of u', it is taken for an observation of it.
_TELLING = 0.5


class Moments(NamedTuple):
    """Mean (..., w) of a window, and a root (..., w, r) of its covariance, zero where it is known."""

    mean: FloatArray
    root: FloatArray


def branches_of(mixture: Mixture) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Return table, signs and root of the branches of a mixture; those of its nodes where each is one."""
    return mixture.branches or (mixture.table, mixture.sign, mixture.root)


def window_known(mixture: Mixture, m: int) -> Moments:
    """Return what a filter knew of the window, per branch."""
    table, _, root = branches_of(mixture)
    return _window(mixture, table, root, m)


def window_before(tables: Any, known: FloatArray, y: FloatArray) -> FloatArray:
    """Return the window of a step, with inputs and features where there are some."""
    window: FloatArray = tables.window(known, y) if tables.is_driven else known
    return window


def gap_tables(tables: Any, known: FloatArray) -> tuple[PairTables, FloatArray]:
    """Return tables and window of a step in which something is missing."""
    if not tables.is_driven:
        return tables, known
    assert tables.next_law is not None  # whoever looks back knows what stood for what is missing
    return tables.in_gap(*tables.next_law), tables.without_features(known)


def pairs_ahead(
    tables: PairTables, mixture: Mixture, y: FloatArray
) -> tuple[engine.PairMixture, engine.PairMixture]:
    """Move all branches of a mixture through every slot of a step, before and after what is there of y."""
    table, sign, root = branches_of(mixture)
    tables, window = gap_tables(tables, mixture.window)
    step = engine.apart(tables.in_slots, tables.noise_root, mixture.table.shape[1], mixture.branches)
    before = engine.pair_mixture(*step, table, sign, window, root)
    return before, engine.condition_pairs(before, y, tables.pairs.dim_x)


def step_back(
    tables: PairTables,
    mixture: Mixture,
    following: Mixture,
    y: FloatArray,
    window: Moments,
    gamma: FloatArray,
) -> tuple[FloatArray, Moments]:
    """Step back into an observation in whose window, or in the next, a part is missing.

    Parameters
    ----------
    tables : PairTables
        Of the step from here to the next observation ``y``, NaN where missing.
    mixture, following : Mixture
        What the filter knew here, and after ``y``.
    window : Moments
        Smoothed ones of the next window, given each next branch, leading shape (k,).
    gamma : ndarray, shape (k,)
        Smoothed probabilities of the next branches.

    Returns
    -------
    gamma : ndarray, shape (b,)
    window : Moments
        Smoothed moments of the window here, given each branch.
    """
    m, q = tables.pairs.dim_x, y.size
    shown = slice(m, m + following.window.size)  # the next window, which begins with y
    if not following.unknown:
        before, after = pairs_ahead(tables, mixture, y)
        joint = engine.collapse_weights(after.log_w, after.sign)[2] * gamma  # p(i, j | y_1..N)
        seen = after.mean[..., shown]
        told = Moments(seen, np.zeros((*seen.shape, 1)))
        return _regress_rows(tables, before, joint, told, q, mixture.window.size)
    M2 = following.table.shape[1]
    joint = gamma.reshape(-1, M2)
    if not mixture.unknown:
        return _by_row(tables, joint)[0].sum(axis=1), window_known(mixture, m)
    at, known = gap_tables(tables, mixture.window)
    state = mixture.table, mixture.sign, known, mixture.root
    before = engine.pair_mixture(at.in_slots, at.noise_root, *state)
    told = Moments(*(part.reshape(-1, M2, *part.shape[1:]) for part in window))
    return _told_apart(mixture, *_regress_rows(tables, before, joint, told, q, mixture.window.size), m)


def _regress_rows(
    tables: PairTables, before: engine.PairMixture, joint: FloatArray, told: Moments, q: int, size: int
) -> tuple[FloatArray, Moments]:
    """Sum up over the nodes j that follow, given the smoothed moments of the next window in each pair.

    The window here are ``size`` numbers; what inputs and features add to it in the step is known.
    """
    m, w = tables.pairs.dim_x, told.mean.shape[-1]
    root, here = _root_of(before), slice(m + q, m + q + size)
    J, left = _regress(root[..., m : m + w, :], root[..., here, :])
    mean = before.mean[..., here] + _times(J, told.mean - before.mean[..., m : m + w])
    root = np.concatenate([J @ told.root, left], axis=-1)
    joint, mean, root = _by_row(tables, joint, mean, root)
    total = joint.sum(axis=1)
    # what is impossible by now keeps any finite moments
    share = np.where(total[:, None] != 0.0, joint, 1.0)
    share = share / share.sum(axis=1, keepdims=True)
    if before.sign is None:
        return total, Moments(*mixture_root(share, mean, root))
    mean, covariance = mixture_moments(share, mean, square(root))
    return total, Moments(mean, covariance_root(covariance))


def _by_row(tables: PairTables, joint: FloatArray, *parts: FloatArray) -> list[FloatArray]:
    """Bring what is known of pairs (n depth, M2) from the slots of columns to rows of the n M1 branches."""
    slots, M1 = tables.in_slots.slots, len(tables.transition)
    if slots is None:
        return [joint, *parts]
    at, there = slots.rows(M1)
    n = joint.size // slots.source.size
    at = (np.arange(n)[:, None, None] * slots.source.size + at).reshape(n * M1, -1)
    joint = np.where(np.tile(there, (n, 1)), joint.reshape(-1)[at], 0.0)
    return [joint, *(part.reshape(-1, *part.shape[2:])[at] for part in parts)]


def _told_apart(mixture: Mixture, gamma: FloatArray, window: Moments, m: int) -> tuple[FloatArray, Moments]:
    """Tell the branches of a mixture what is known of its nodes (M,)."""
    if mixture.branches is None:
        return gamma, window
    table, sign, _ = mixture.branches
    law = Moments(*(part.reshape(-1, gamma.size, *part.shape[1:]) for part in window_known(mixture, m)))
    filtered = _window(mixture, mixture.table, mixture.root, m)
    log_evidence, updated = _weigh(law, filtered, window)
    signs = None if sign is None else sign.reshape(-1, gamma.size)
    shares = engine.collapse_weights(table[0].reshape(-1, gamma.size) + log_evidence, signs)[2]
    return (shares * gamma).ravel(), Moments(*(part.reshape(-1, *part.shape[2:]) for part in updated))


def smooth_state(mixture: Mixture, window: Moments, m: int) -> tuple[FloatArray, FloatArray]:
    """Moments of X per branch, given the smoothed moments of the window, from the regression of X on it."""
    table, _, root = branches_of(mixture)
    mean, P = engine.window_moments(table, mixture.window)
    root = engine.window_root(P, root, mixture.window)
    B, left = _regress(root[:, m:], root[:, :m])
    x = mean[:, :m] + _times(B, window.mean - mean[:, m:])
    return x, square(np.concatenate([B @ window.root, left], axis=-1))


def _window(mixture: Mixture, table: FloatArray, root: FloatArray | None, m: int) -> Moments:
    """Moments of the window of a mixture in its nodes or branches, whose table and root these are."""
    mean, covariance = engine.window_moments(table, mixture.window)
    if not mixture.unknown:
        return Moments(mean[:, m:], np.zeros((*mean[:, m:].shape, 1)))
    return Moments(mean[:, m:], engine.window_root(covariance, root, mixture.window)[:, m:])


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


def _root_of(pairs: engine.PairMixture) -> FloatArray:
    return covariance_root(pairs.covariance) if pairs.root is None else pairs.root


def _times(A: FloatArray, v: FloatArray) -> FloatArray:
    product: FloatArray = (A @ v[..., None])[..., 0]
    return product


def _log_diagonal(A: FloatArray) -> FloatArray:
    total: FloatArray = np.log(np.diagonal(A, axis1=-2, axis2=-1)).sum(axis=-1)
    return total

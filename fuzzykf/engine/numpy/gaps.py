"""NumPy kernels of the exact switching recursion where something is missing.

The next observation is predicted from the latest ones, so a gap leaves not only X but also a
part u of the window w unknown.  Then the rows of ``table`` are those of s = (X, u), and the general
pair formulas apply to X and the whole window:

    s'_ij = F_ij s + b_ij + noise,   s' = (X', Y', w),

conditioned on what is there of Y', and collapsed over i by moment matching where nothing is unknown
afterwards.  Elsewhere the components of a node j, one for each node i before it, stay apart as its
`Branches`: an observation changes their weights, which mean and covariance of the node cannot know.  So a gap
of one observation is exact.  After a further one that is missing each component is that of a pair again, the
mean and covariance of all that came before.

After an outlier what the nodes expect lies as far apart as the outlier is far off, and so does what is
unknown of s; what an observation then leaves of its covariance is lost in a difference of matrices.
So covariances go through all this as roots, by orthogonal transformations that leave small columns their
digits beside large ones.  Negative weights have no roots: chains that have them (the rule 'product')
keep the matrices themselves.
"""

from __future__ import annotations

from math import isqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.outliers import QUIET, far_parts
from fuzzykf.engine.numpy.slots import Slots, lay_out, node_index
from fuzzykf.engine.numpy.switching import are_far, layout, log_sum
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO
from fuzzykf.gaussian import (
    LOG_2PI,
    covariance_root,
    lower_factor,
    mixture_moments,
    mixture_root,
    solve_lower,
    square,
    symmetrize,
)

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

__all__ = [
    "Branches",
    "GapTables",
    "PairMixture",
    "SlotPairs",
    "apart",
    "before_step",
    "collapse_weights",
    "condition_pairs",
    "first_step_in_part",
    "in_slots",
    "merge_branches",
    "noise_root",
    "pack_gaps",
    "pair_mixture",
    "step_in_part",
    "window_moments",
    "window_root",
    "window_table",
]


class SlotPairs(NamedTuple):
    """Tables of a step slot by slot: those of all pairs, or of the pairs of positive probability alone.

    Where the nodes are branches, see `apart`, there are as many slots for each of a node's.
    """

    transition: FloatArray  # (depth, M2)
    pairs: tuple[FloatArray, ...]  # Axx, H, G, c, C, Ayy, Ny, Qyy of the regressions of X' and Y'
    slots: Slots | None  # None if all pairs have one
    nodes: tuple[Any, ...]  # see `node_index`


def in_slots(transition: FloatArray, pairs: tuple[FloatArray, ...]) -> SlotPairs:
    """Lay out tables (M1, M2, ...), see `lay_out`."""
    slots = lay_out(transition)
    if slots is not None:
        transition, pairs = slots.probabilities(transition), tuple(slots.take(part) for part in pairs)
    return SlotPairs(transition, tuple(pairs), slots, node_index(slots))


class Branches(NamedTuple):
    """The components of the nodes in a gap, laid out as a state with a node for each.

    There are ``depth`` of each node j, one for each slot of the step to it: column ``s M + j`` of the table.
    """

    table: FloatArray  # (1 + e + e*e, depth M): log p(s, j), mean and covariance of (X, u) in it
    sign: FloatArray | None  # (depth M,)
    root: FloatArray | None  # (depth M, e, e)


class PairMixture(NamedTuple):
    """Weights of the pairs of nodes, and moments of s' = (X', Y', w) given each; M1 counts slots."""

    log_w: FloatArray  # (M1, M2): log p_i + log |P_ij|, and the density of what is there of Y'
    sign: FloatArray | None  # (M1, M2)
    mean: FloatArray  # (M1, M2, e)
    covariance: FloatArray  # (M1, M2, e, e)
    root: FloatArray | None  # (M1, M2, e, r), whose square the covariance is; None if there are signs
    reference: FloatArray | float = 0.0  # (M2,): that to which the weights of each column are relative
    best: float = 0.0  # that to which the references are relative


def _unknown(m: int, window: FloatArray) -> IntArray:
    """Where s = (X, u) stands in (X, w)."""
    there: IntArray = np.flatnonzero(np.concatenate([np.ones(m, dtype=bool), np.isnan(window)]))
    return there


def window_moments(table: FloatArray, window: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (M, m + w) and covariance of X and the whole window, per node.

    Parameters
    ----------
    table : ndarray, shape (1 + e + e*e, M)
        Of s = (X, u), u the parts of the window that are missing.
    window : ndarray, shape (w,)
        NaN where missing.
    """
    M, e = table.shape[1], (isqrt(4 * len(table) - 3) - 1) // 2
    m = e - int(np.isnan(window).sum())
    at = _unknown(m, window)
    mean, covariance = np.empty((M, m + window.size)), np.zeros((M, m + window.size, m + window.size))
    mean[:, m:] = window
    mean[:, at] = table[1 : 1 + e].T
    covariance[:, at[:, None], at] = table[1 + e :].T.reshape(M, e, e)
    return mean, covariance


def window_root(covariance: FloatArray, root: FloatArray | None, window: FloatArray) -> FloatArray:
    """Return a root (M, m + w, r) of the covariance of X and the whole window, per node.

    Parameters
    ----------
    covariance : ndarray, shape (M, m + w, m + w)
        As `window_moments` returns it.
    root : ndarray, shape (M, e, e), or None
        Root of the covariance of s = (X, u), if one is known: it has more digits.
    window : ndarray, shape (w,)
    """
    if root is None:
        return covariance_root(covariance)
    whole = np.zeros((*covariance.shape[:-1], root.shape[-1]))
    whole[:, _unknown(covariance.shape[-1] - window.size, window)] = root
    return whole


def window_table(
    log_p: FloatArray, mean: FloatArray, covariance: FloatArray, window: FloatArray
) -> FloatArray:
    """Return the table of (X, u) from moments of X and the whole window, per node."""
    at = _unknown(mean.shape[1] - window.size, window)
    return layout(log_p, mean[:, at], covariance[:, at[:, None], at])


def _move(step: SlotPairs, table: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F (depth, M2, e, m + w), the means F x + b, and log p_i + log |P_ij|."""
    Axx, H, G, c, _, Ayy, Ny, _ = step.pairs
    m, q, w = Axx.shape[-1], Ny.shape[-1], H.shape[-1]
    F = np.zeros((*step.transition.shape, m + q + w, m + w))
    F[..., :m, :m] = Axx
    F[..., :m, m:] = H + G @ Ayy
    F[..., m : m + q, m:] = Ayy
    F[..., m + q :, m:] = np.eye(w)
    mean = (F @ x[step.nodes][..., None])[..., 0]
    mean[..., :m] += c + (G @ Ny[..., None])[..., 0]
    mean[..., m : m + q] += Ny
    with np.errstate(divide="ignore"):
        log_w = np.maximum(np.log(np.abs(step.transition)), LOG_ZERO) + table[0][step.nodes]
    return F, mean, log_w


def _spread(step: SlotPairs, F: FloatArray, P: FloatArray) -> FloatArray:
    """Covariance of s' in each pair, (depth, M2, e, e), from that of X and the window, (M, m + w, m + w)."""
    G, C, Qyy = step.pairs[2], step.pairs[4], step.pairs[7]
    m, q = G.shape[-2:]
    covariance = F @ P[step.nodes] @ np.swapaxes(F, -1, -2)
    cross = G @ Qyy
    covariance[..., :m, :m] += C + cross @ np.swapaxes(G, -1, -2)
    covariance[..., :m, m : m + q] += cross
    covariance[..., m : m + q, :m] += np.swapaxes(cross, -1, -2)
    covariance[..., m : m + q, m : m + q] += Qyy
    return symmetrize(covariance)


def apart(
    step: SlotPairs, noise: FloatArray, M1: int, branches: Branches | None
) -> tuple[SlotPairs, FloatArray]:
    """Return the tables, and the `noise_root`, of a step from the branches of M1 nodes."""
    if branches is None:
        return step, noise
    n = branches.table.shape[1] // M1
    depth, M2 = step.transition.shape
    source = np.repeat(np.arange(M1)[:, None], M2, axis=1) if step.slots is None else step.slots.source
    nodes = (np.arange(n)[:, None, None] * M1 + source).reshape(n * depth, M2)

    def repeated(values: FloatArray) -> FloatArray:
        return np.broadcast_to(values, (n, *values.shape)).reshape(n * depth, *values.shape[1:])

    pairs = tuple(repeated(part) for part in step.pairs)
    return SlotPairs(repeated(step.transition), pairs, None, (nodes,)), repeated(noise)


class GapTables(NamedTuple):
    """What `step_in_part` asks for."""

    step: SlotPairs
    noise: FloatArray  # (depth, M2, m + q, m + q): the `noise_root` of its pairs
    M1: int


def pack_gaps(step: SlotPairs, noise: FloatArray, M1: int) -> GapTables:
    """Bring the tables of a step into the layout of the kernel for gaps."""
    return GapTables(step, noise, M1)


def noise_root(pairs: tuple[FloatArray, ...]) -> FloatArray:
    """Root of the covariance of the noise of (X', Y') in each pair, (..., m + q, m + q)."""
    G, C, Qyy = pairs[2], pairs[4], pairs[7]
    m, q = G.shape[-2:]
    root = np.zeros((*G.shape[:-2], m + q, m + q))
    factor = np.linalg.cholesky(Qyy)
    root[..., :m, :m] = covariance_root(C)
    root[..., :m, m:] = G @ factor
    root[..., m:, m:] = factor
    return root


def pair_mixture(
    step: SlotPairs,
    noise: FloatArray,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    root: FloatArray | None,
) -> PairMixture:
    """Move X and the window through every pair of nodes, before Y' is seen.

    Parameters
    ----------
    step : SlotPairs
    noise : ndarray, shape (depth, M2, m + q, m + q)
        The `noise_root` of its pairs.
    table, sign, window
        The state, as in `step`; NaN where the window is missing.
    root : ndarray, shape (M1, e, e), or None
        Root of the covariance of s = (X, u), if one is known.
    """
    x, P = window_moments(table, window)
    F, mean, log_w = _move(step, table, x)
    if (step.transition < 0.0).any():
        signs = np.sign(step.transition)
        signs = signs if sign is None else signs * sign[:, None]
        return PairMixture(log_w, signs, mean, _spread(step, F, P), None)
    known = F @ window_root(P, root, window)[step.nodes]
    fresh = np.zeros((*F.shape[:-1], noise.shape[-1]))
    fresh[..., : noise.shape[-1], :] = noise
    root = np.concatenate([known, fresh], axis=-1)
    return PairMixture(log_w, None, mean, square(root), root)


def condition_pairs(pairs: PairMixture, y: FloatArray, m: int) -> PairMixture:
    """Condition every pair on the parts of y (q,) that are there, whose density joins the weights."""
    there = ~np.isnan(y)
    if not there.any():
        return pairs
    log_w, sign, mean, covariance, root, *_ = pairs
    at = m + np.flatnonzero(there)
    rest = np.delete(np.arange(mean.shape[-1]), at)
    k, e = at.size, mean.shape[-1]
    left = None
    if root is None:
        S = covariance[..., at[:, None], at]
        factor = np.linalg.cholesky(S).astype(np.float64, copy=False)
        cross = np.linalg.solve(factor, covariance[..., at[:, None], rest])  # L^-1 Cov(Y', rest)
        square_left = covariance[..., rest[:, None], rest] - np.swapaxes(cross, -1, -2) @ cross
    else:
        # [L 0; cross' left]: a root of the covariance of (Y', rest) says all that is asked for
        whole = lower_factor(root[..., np.concatenate([at, rest]), :])
        factor, cross = whole[..., :k, :k], np.swapaxes(whole[..., k:, :k], -1, -2)
        if not np.diagonal(factor, axis1=-2, axis2=-1).all():
            raise np.linalg.LinAlgError("an observation without any spread")
        left = np.zeros((*mean.shape, e - k))
        left[..., rest, :] = whole[..., k:, k:]
        square_left = square(whole[..., k:, k:])
    white = solve_lower(factor, (y[there] - mean[..., at])[..., None])
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    small = log_w - log_det - 0.5 * k * LOG_2PI
    log_w = small - 0.5 * (white * white).sum(axis=(-1, -2))
    reference, best = pairs.reference, pairs.best
    if are_far(log_w.max(axis=0)):
        log_w, reference, best = far_parts(white[..., 0], small, mean[..., at], factor)
    moved = np.empty(mean.shape)
    moved[..., at] = y[there]
    moved[..., rest] = mean[..., rest] + (np.swapaxes(cross, -1, -2) @ white)[..., 0]
    covariance = np.zeros((*mean.shape, e))
    covariance[..., rest[:, None], rest] = symmetrize(square_left)
    return PairMixture(log_w, sign, moved, covariance, left, reference, best)


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


def _merge(
    pairs: PairMixture,
) -> tuple[FloatArray, FloatArray | None, FloatArray, FloatArray, FloatArray | None]:
    """Sum components (n, k) over the first: logarithms of masses, signs, means, covariances, roots."""
    log_p, sign, o = collapse_weights(pairs.log_w, pairs.sign)
    means, root = pairs.mean, None
    if pairs.root is None:
        first = means[np.abs(o).argmax(axis=0), np.arange(o.shape[1])]
        off = means - first
        beyond = np.einsum("ij,ijk->jk", o, off)
        off -= beyond
        mean = first + beyond
        covariance = np.transpose(o[..., None] * off, (1, 2, 0)) @ np.swapaxes(off, 0, 1)  # of the means
        covariance += np.einsum("ij,ijkl->jkl", o, pairs.covariance)
    else:
        mean, root = mixture_root(o.T, np.swapaxes(means, 0, 1), np.swapaxes(pairs.root, 0, 1))
        covariance = square(root)
    return log_p, sign, mean, symmetrize(covariance), root


def _unknown_of(pairs: PairMixture, window: FloatArray) -> PairMixture:
    """Keep of the pairs what is unknown of the state and the window."""
    at = _unknown(pairs.mean.shape[-1] - window.size, window)
    return pairs._replace(
        mean=pairs.mean[..., at],
        covariance=pairs.covariance[..., at[:, None], at],
        root=None if pairs.root is None else pairs.root[..., at, :],
    )


def _join(pairs: PairMixture, n: int) -> PairMixture:
    """Merge the n branches in which pairs (n depth, M2) begin, so that one way leads to a slot."""
    if n == 1:
        return pairs
    M2, e = pairs.mean.shape[1:]
    flat = PairMixture(
        pairs.log_w.reshape(n, -1),
        None if pairs.sign is None else pairs.sign.reshape(n, -1),
        pairs.mean.reshape(n, -1, e),
        pairs.covariance.reshape(n, -1, e, e),
        None if pairs.root is None else pairs.root.reshape(n, -1, *pairs.root.shape[2:]),
    )
    log_w, sign, mean, covariance, root = _merge(flat)
    return PairMixture(
        np.maximum(log_w, LOG_ZERO).reshape(-1, M2),
        None if sign is None else sign.reshape(-1, M2),
        mean.reshape(-1, M2, e),
        covariance.reshape(-1, M2, e, e),
        None if root is None else root.reshape(-1, M2, e, e),
        pairs.reference,
        pairs.best,
    )


def _collapse_pairs(
    pairs: PairMixture,
) -> tuple[FloatArray, FloatArray | None, FloatArray | None, float, float]:
    """Sum pairs into nodes.

    Returns the table, signs, the root of the covariances (M2, e, e), the log of the total, and that
    relative to ``pairs.best``.
    """
    log_p, sign, mean, covariance, root = _merge(pairs)
    is_lost = log_p < DEAD
    log_p = np.where(is_lost, LOG_ZERO, log_p + pairs.reference)
    log_total = log_sum(log_p, sign)
    table = layout(log_p - log_total, mean, covariance)
    table[1:, is_lost] = 0.0
    if root is not None:
        root[is_lost] = 0.0
    return table, sign, root, log_total + pairs.best, log_total


def _branches(pairs: PairMixture, log_total: float) -> Branches | None:
    """Keep pairs (depth, M2) apart, unless one alone leads to each node."""
    depth, _, e = pairs.mean.shape
    if depth == 1:
        return None
    is_lost = (pairs.log_w < DEAD).ravel()
    log_p = np.where(is_lost, LOG_ZERO, (pairs.log_w + pairs.reference - log_total).ravel())
    table = layout(log_p, pairs.mean.reshape(-1, e), pairs.covariance.reshape(-1, e, e))
    root = None
    if pairs.root is not None:
        root = lower_factor(pairs.root).reshape(-1, e, e)
        root[is_lost] = 0.0
    table[1:, is_lost] = 0.0
    return Branches(table, None if pairs.sign is None else pairs.sign.ravel(), root)


def merge_branches(
    p: FloatArray, mean: FloatArray, covariance: FloatArray, M: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum masses (n M,), and mix means (n M, e) and covariances (n M, e, e), over the branches of M nodes."""
    p = p.reshape(-1, M)
    total = p.sum(axis=0)
    share = np.where(total != 0.0, p, 1.0)  # a node that is impossible by now keeps any finite moments
    share = share / share.sum(axis=0)
    moments = mean.reshape(len(p), M, -1), covariance.reshape(len(p), M, *covariance.shape[1:])
    return total, *mixture_moments(share.T, *(np.swapaxes(a, 0, 1) for a in moments))


@QUIET
def first_step_in_part(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray | None, float]:
    """Condition the law of (r_1, Z_1) on the parts of y (q,) that are there; arguments as in `first_step`.

    Returns the table, the root and the log-likelihood, as `step_in_part` does.
    """
    # one imaginary predecessor
    alone = PairMixture(
        log_initial[None], None, mean[None], covariance[None], covariance_root(covariance)[None]
    )
    pairs = _unknown_of(condition_pairs(alone, y, mean.shape[1] - y.size), y)
    table, _, left, log_total, _ = _collapse_pairs(pairs)
    return table, left, 0.0 if np.isnan(y).all() else log_total


@QUIET
def step_in_part(
    gaps: GapTables,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    root: FloatArray | None,
    y: FloatArray,
    after: FloatArray,
    branches: Branches | None = None,
) -> tuple[FloatArray, FloatArray | None, FloatArray | None, Branches | None, float]:
    """Do a `step` where parts of the observation y (q,), of the window, or of both are missing.

    Parameters
    ----------
    gaps : GapTables
    table, sign, window, root
        As in `pair_mixture`.
    y : ndarray, shape (q,)
    after : ndarray, shape (w',)
        The window after it: y and what is kept of ``window``.
    branches : Branches, optional
        The components of the nodes, where they are not merged.

    Returns
    -------
    table, sign, root, branches, log_likelihood
        The root is that of the covariances of the table, (M2, e, e), or None if there are signs.
        Branches are None where nothing is unknown, and where each node has but one.
        The log-likelihood is that of the parts that are there; 0 if none is.
    """
    step, noise = gaps.step, gaps.noise
    m, n = step.pairs[0].shape[-1], 1
    kept = slice(0, m + after.size)
    if branches is not None and _tells(step, window, y):  # else nothing is lost by moments of the nodes
        n = branches.table.shape[1] // table.shape[1]
        step, noise = apart(step, noise, table.shape[1], branches)
        table, sign, root = branches
    moved = pair_mixture(step, noise, table, sign, window, root)
    moved = moved._replace(
        mean=moved.mean[..., kept],
        covariance=moved.covariance[..., kept, kept],
        root=None if moved.root is None else moved.root[..., kept, :],
    )
    pairs = _unknown_of(condition_pairs(moved, y, m), after)
    is_open = bool(np.isnan(after).any())
    if is_open:
        pairs = _join(pairs, n)
    table, signs, root, log_likelihood, log_total = _collapse_pairs(pairs)
    left = _branches(pairs, log_total) if is_open else None
    return table, signs, root, left, 0.0 if np.isnan(y).all() else log_likelihood


def _tells(step: SlotPairs, window: FloatArray, y: FloatArray) -> bool:
    """Whether what is there of y depends, in some pair, on what is missing of the window."""
    Ayy = step.pairs[5][..., ~np.isnan(y), :][..., np.isnan(window)]
    return bool(Ayy[step.transition != 0.0].any())


def before_step(
    step: SlotPairs,
    table: FloatArray,
    sign: FloatArray | None,
    window: FloatArray,
    mass: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Probabilities (M2,) of the next nodes, mean and covariance of (X', Y'), before Y' is seen.

    Parameters
    ----------
    step, table, sign, window
        As in `pair_mixture`.
    mass : ndarray, shape (M1,), optional
        The probabilities, where more digits are known of them than ``table`` has.
    """
    d = step.pairs[0].shape[-1] + step.pairs[-1].shape[-1]
    x, P = window_moments(table, window)
    F, means, _ = _move(step, table, x)
    p = np.exp(table[0]) if mass is None else mass
    if sign is not None:
        p = p * sign
    weights = p[step.nodes] * step.transition
    means = means[..., :d].reshape(-1, d)
    first = means[weights.argmax()]
    off = means - first
    beyond = weights.ravel() @ off
    mean = first + beyond
    off -= beyond
    covariance = (off * weights.reshape(-1, 1)).T @ off
    covariance += np.einsum("ij,ijkl->kl", weights, _spread(step, F, P)[..., :d, :d])
    mu = p @ step.transition if step.slots is None else weights.sum(axis=0)
    return mu, mean, symmetrize(covariance)

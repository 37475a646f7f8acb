"""What a filter says of states that were measured, and the gradient of that in reverse mode; NumPy.

A filter on the nodes knows of each node j after an observation its probability p_j, and the mean m_j and the
covariance V_j of X given the node.  Its score is the log-density of a measured state x under the mixture,

    log sum_j p_j N(x; m_j, V_j).

In a step from node i to node j, a pair has the log-weight w = log P_ij + log N(y'; ...), and X' given the
pair is A X + u with noise of covariance C.  With o_ij the share of node i in what reaches node j,

    log q_j = log sum_i p_i exp(w_ij),   p'_j = q_j / sum q,   o_ij = p_i exp(w_ij) / q_j,
    m'_j = sum_i o_ij (A m_i + u),   V'_j = sum_i o_ij (A V_i A' + C + d d'),   d = A m_i + u - m'_j,

where log sum q is the log-density of the observation.  The way back carries the derivatives g of all that
follows by log p_j, m_j and V_j.  A measured state of posterior share r_j, with h = V_j^-1 (x - m_j), adds

    g_p += r_j,   g_m += r_j h,   g_V += r_j (h h' - V_j^-1) / 2.

Tables have a row for each step and a column for each pair that can be, so that weights and means may depend
on whatever is known of the past: observations, inputs, the clock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import solve_lower, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

__all__ = ["MixtureLaw", "PairMoves", "ScoreGradient", "check_moves", "score_gradient", "score_states"]

_LOG_2PI = float(np.log(2.0 * np.pi))


class PairMoves(NamedTuple):
    """What T steps do at each of P pairs of nodes, or derivatives by it."""

    log_weight: FloatArray  # (T, P): of the transition and of what is observed
    offset: FloatArray  # (T, P, m)
    A: FloatArray  # (P, m, m)
    C: FloatArray  # (P, m, m)


class MixtureLaw(NamedTuple):
    """What is known of each of M nodes, or derivatives by it; the logarithms need not be those of a law."""

    log_p: FloatArray  # (M,)
    mean: FloatArray  # (M, m)
    covariance: FloatArray  # (M, m, m)


class ScoreGradient(NamedTuple):
    """The sum of the scores, and of a multiple of the log-densities of the observations, differentiated."""

    log_density: FloatArray  # (T + 1,): of the states, NaN where they were not measured
    log_likelihood: FloatArray  # (T + 1,): of the observations
    moves: PairMoves
    first: MixtureLaw


@QUIET
def score_states(
    nodes: IntArray, moves: PairMoves, first: MixtureLaw, xs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Score the states of a series.

    Parameters
    ----------
    nodes : ndarray of int, shape (2, P)
        Node before and after each pair.
    moves : PairMoves
    first : MixtureLaw
        After the first observation, weighted by its density.
    xs : ndarray, shape (T + 1, m)
        States, NaN where missing: a row counts if all of it was measured.

    Returns
    -------
    log_density, log_likelihood : ndarray, shape (T + 1,)
        Of the states, NaN where missing, and of the observations, each given those before.  All are NaN if
        no node gives an observation a density.

    Raises
    ------
    ValueError
        If shapes do not agree.
    numpy.linalg.LinAlgError
        If the covariance of a state is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> one = np.ones((1, 1, 1))
    >>> moves = PairMoves(np.zeros((2, 1)), np.zeros((2, 1, 1)), 0.5 * one, 0.75 * one)
    >>> law = MixtureLaw(np.zeros(1), np.zeros((1, 1)), one)
    >>> score_states(
    ...     np.zeros((2, 1), dtype=int), moves, law, np.array([[0.0], [np.nan], [2.0]])
    ... )[0].round(3)
    array([-0.919,    nan, -2.919])
    """
    check_moves(nodes, moves, first, xs)
    _, log_density, log_likelihood = _forward(nodes, moves, first, xs)
    return log_density, log_likelihood


@QUIET
def score_gradient(
    nodes: IntArray, moves: PairMoves, first: MixtureLaw, xs: FloatArray, alpha: float
) -> ScoreGradient:
    """Differentiate the sum of scores, and ``alpha`` times that of the log-densities of the observations.

    Entries are differentiated as if each were free, those of covariances as if they stay symmetric.

    Parameters
    ----------
    nodes, moves, first, xs
        See `score_states`.
    alpha : float

    Returns
    -------
    ScoreGradient
        NaN if no node gives an observation a density.
    """
    check_moves(nodes, moves, first, xs)
    states, log_density, log_likelihood = _forward(nodes, moves, first, xs)
    if not states:
        nothing = (np.full(one.shape, np.nan) for one in moves), (np.full(one.shape, np.nan) for one in first)
        return ScoreGradient(log_density, log_likelihood, PairMoves(*nothing[0]), MixtureLaw(*nothing[1]))
    source, target = nodes
    M, m = first.mean.shape
    by = PairMoves(*(np.zeros(one.shape) for one in moves))
    g = MixtureLaw(np.zeros(M), np.zeros((M, m)), np.zeros((M, m, m)))
    for n in range(len(xs) - 1, -1, -1):
        g = _measured_back(g, states[n], xs[n])
        p = np.exp(states[n].log_p)
        by_q = g.log_p - p * g.log_p.sum() + alpha * p
        if n == 0:
            return ScoreGradient(log_density, log_likelihood, by, g._replace(log_p=by_q))
        before = states[n - 1]
        share, x, P = _pairs(nodes, moves, n - 1, before)
        off = x - states[n].mean[target]
        g_P, g_x = g.covariance[target], g.mean[target]
        turned = (g_P @ off[..., None])[..., 0]
        # by the log of a share, less what all the shares of a node have in common, as they sum to one
        value = ((g_x + turned) * off).sum(axis=1) + (g_P * P).sum(axis=(1, 2))
        common = np.bincount(target, share * value, minlength=M)
        by.log_weight[n - 1] = share * (value - common[target] + by_q[target])
        by.offset[n - 1] = share[:, None] * (g_x + 2.0 * turned)
        by_P = share[:, None, None] * g_P
        by.A[:] += by.offset[n - 1][:, :, None] * before.mean[source][:, None, :]
        by.A[:] += 2.0 * by_P @ moves.A @ before.covariance[source]
        by.C[:] += by_P
        back = np.swapaxes(moves.A, -1, -2)
        g = MixtureLaw(
            np.asarray(np.bincount(source, by.log_weight[n - 1], minlength=M), dtype=np.float64),
            _gathered(source, (back @ by.offset[n - 1][..., None])[..., 0], M),
            _gathered(source, back @ by_P @ moves.A, M),
        )
    raise AssertionError("a series has a first row")


def check_moves(nodes: IntArray, moves: PairMoves, first: MixtureLaw, xs: FloatArray) -> None:
    """Refuse what does not belong to one series."""
    T, P = moves.log_weight.shape
    M, m = first.mean.shape
    expected = {
        "nodes": (nodes, (2, P)),
        "offset": (moves.offset, (T, P, m)),
        "A": (moves.A, (P, m, m)),
        "C": (moves.C, (P, m, m)),
        "log_p": (first.log_p, (M,)),
        "covariance": (first.covariance, (M, m, m)),
        "xs": (xs, (T + 1, m)),
    }
    for name, (value, shape) in expected.items():
        if value.shape != shape:
            raise ValueError(f"{name}: got shape {value.shape}, expected {shape}")
    if P and not (nodes.min() >= 0 and nodes.max() < M):
        raise ValueError(f"nodes: got {nodes.min()} to {nodes.max()}, expected 0 to {M - 1}")


def _forward(
    nodes: IntArray, moves: PairMoves, first: MixtureLaw, xs: FloatArray
) -> tuple[list[MixtureLaw], FloatArray, FloatArray]:
    """Return what is known after each observation, and the scores; nothing, and NaN, where that ends."""
    log_density, log_likelihood = np.full(len(xs), np.nan), np.full(len(xs), np.nan)
    states: list[MixtureLaw] = []
    target, M = nodes[1], len(first.log_p)
    for n in range(len(xs)):
        if n == 0:
            log_q, mean, covariance = first
        else:
            share, x, P = _pairs(nodes, moves, n - 1, states[-1])
            log_q = _log_sums(states[-1].log_p[nodes[0]] + moves.log_weight[n - 1], target, M)
            mean = _gathered(target, share[:, None] * x, M)
            off = x - mean[target]
            covariance = _gathered(target, share[:, None, None] * (P + off[:, :, None] * off[:, None, :]), M)
        top = log_q.max()
        total = top + np.log(np.exp(log_q - top).sum())
        if not np.isfinite(total):
            return [], np.full(len(xs), np.nan), np.full(len(xs), np.nan)
        states.append(MixtureLaw(log_q - total, mean, covariance))
        log_likelihood[n] = total
        if np.isfinite(xs[n]).all():
            terms = states[-1].log_p + _residuals(states[-1], xs[n])[2]
            peak = terms.max()
            log_density[n] = peak + np.log(np.exp(terms - peak).sum())
    return states, log_density, log_likelihood


def _pairs(
    nodes: IntArray, moves: PairMoves, n: int, before: MixtureLaw
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares (P,) of the pairs in the nodes they lead to, and the moments of X' given them."""
    source, target = nodes
    w = before.log_p[source] + moves.log_weight[n]
    log_q = _log_sums(w, target, len(before.log_p))[target]
    share = np.where(np.isneginf(log_q), 0.0, np.exp(w - np.where(np.isneginf(log_q), 0.0, log_q)))
    x = (moves.A @ before.mean[source][..., None])[..., 0] + moves.offset[n]
    P = moves.A @ before.covariance[source] @ np.swapaxes(moves.A, -1, -2) + moves.C
    return share, x, P


def _log_sums(w: FloatArray, target: IntArray, M: int) -> FloatArray:
    """Logarithms of the sums of weights that lead to each node."""
    top = np.full(M, -np.inf)
    np.maximum.at(top, target, w)
    base = np.where(np.isneginf(top), 0.0, top)
    with np.errstate(divide="ignore"):
        sums: FloatArray = base + np.log(np.bincount(target, np.exp(w - base[target]), minlength=M))
    return sums


def _gathered(where: IntArray, values: FloatArray, M: int) -> FloatArray:
    """Sum what pairs have, (P, ...), into nodes, (M, ...)."""
    total: FloatArray = np.zeros((M, *values.shape[1:]))
    np.add.at(total, where, values)
    return total


def _residuals(state: MixtureLaw, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inverse factors L^-1 of the covariances, whitened residuals, and log-densities, of the nodes that are.

    Others have zeros, and minus infinity.
    """
    m = state.mean.shape[1]
    possible = state.log_p > -np.inf
    L = np.linalg.cholesky(np.where(possible[:, None, None], symmetrize(state.covariance), np.eye(m)))
    root = solve_lower(L, np.broadcast_to(np.eye(m), L.shape)) * possible[:, None, None]
    white = (root @ (x - state.mean)[..., None])[..., 0]
    log_det = np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(axis=-1)
    log_density = -0.5 * (white * white).sum(axis=1) - log_det - 0.5 * m * _LOG_2PI
    return root, white, np.where(possible, log_density, -np.inf)


def _measured_back(g: MixtureLaw, state: MixtureLaw, x: FloatArray) -> MixtureLaw:
    """Add the derivatives of the score of a measured state."""
    if not np.isfinite(x).all():
        return g
    root, white, log_density = _residuals(state, x)
    terms = state.log_p + log_density
    r = np.exp(terms - terms.max())
    r /= r.sum()
    back = np.swapaxes(root, -1, -2)
    h = (back @ white[..., None])[..., 0]
    by_V = 0.5 * r[:, None, None] * (h[:, :, None] * h[:, None, :] - back @ root)
    return MixtureLaw(g.log_p + r, g.mean + r[:, None] * h, g.covariance + by_V)

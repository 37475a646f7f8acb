"""What switching filters do with missing observations.

The next observation of a switching system is predicted from the latest ones, so a
gap leaves not only X but also a part of the window w unknown.  Then mean and
covariance of s = (X, w) are kept per node, and the general pair formulas apply:

    s'_ij = F_ij s + b_ij + noise,   s' = (X', Y', w without its oldest),

conditioned on what is there of Y', and collapsed over i by moment matching.  The
result is exact for a single class and for gaps at the end of a series (hence for
forecasts of means and covariances); with several classes an observation after a gap
makes it an approximation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.switching import DEAD, LOG_ZERO
from fuzzykf.gaussian import cholesky, log_density, logsumexp, symmetrize
from fuzzykf.switching.inference.recursion import NodeState, node_moments, node_probabilities

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

__all__ = ["GapState", "advance_gap", "close_gap", "open_gap", "pair_prediction", "start_gap"]


class GapState(NamedTuple):
    """What is known of each node while a part of the window is not."""

    log_p: FloatArray  # (M,)
    sign: FloatArray | None  # (M,), only for chains with negative weights
    mean: FloatArray  # (M, m + w): of s = (X, w)
    covariance: FloatArray  # (M, m + w, m + w); zero for known parts of w
    known: NDArray[np.bool_]  # (w,): which parts of the window were observed


class PairPrediction(NamedTuple):
    """Moments of s' given the pair of nodes, before Y' is seen."""

    log_w: FloatArray  # (M1, M2): log p_i + log |P_ij|
    sign: FloatArray | None  # (M1, M2)
    mean: FloatArray  # (M1, M2, e)
    covariance: FloatArray  # (M1, M2, e, e)


def open_gap(state: NodeState | GapState, window: FloatArray, m: int) -> GapState:
    """Return a state with the window as a part of it, whether it is known or not."""
    if isinstance(state, GapState):
        return state
    x, P = node_moments(state, m)
    M, w = len(x), window.size
    mean = np.concatenate([x, np.broadcast_to(window, (M, w))], axis=1)
    covariance = np.zeros((M, m + w, m + w))
    covariance[:, :m, :m] = P
    return GapState(state.table[0], state.sign, mean, covariance, np.ones(w, dtype=bool))


def close_gap(state: GapState, m: int) -> tuple[NodeState | GapState, FloatArray]:
    """Return the ordinary state and its window once all of the window is known."""
    window = np.where(state.known, state.mean[0, m:], np.nan)
    return (marginal_state(state, m) if state.known.all() else state), window


def marginal_state(state: GapState, m: int) -> NodeState:
    """Forget the window: probabilities and moments of X alone."""
    P = state.covariance[:, :m, :m].reshape(-1, m * m)
    table = np.concatenate([state.log_p[None], state.mean[:, :m].T, P.T])
    return NodeState(np.ascontiguousarray(table), state.sign)


def start_gap(law: InitialLaw, log_initial: FloatArray, y: FloatArray) -> tuple[GapState, float]:
    """Condition the law of (r_1, Z_1) on a first observation of which parts are missing."""
    prediction = PairPrediction(
        log_initial[None], None, law.mean[None], law.covariance[None]
    )  # one imaginary predecessor
    return _condition(prediction, y, np.empty(0, dtype=bool), len(law.mean[0]) - y.size)


def pair_prediction(tables: PairTables, state: GapState) -> PairPrediction:
    """Move s = (X, w) through every pair of nodes.

    The new window is (Y', w), as long as the tables of the next step may want it; the
    caller drops its oldest part.
    """
    Axx, H, G, c, C, Ayy, Ny, Qyy = tables.pairs
    M1, M2 = tables.transition.shape
    m, q = tables.pairs.dim_x, tables.pairs.dim_z
    w = state.known.size
    F = np.zeros((M1, M2, m + q + w, m + w))
    F[..., :m, :m] = Axx
    F[..., :m, m:] = H + G @ Ayy
    F[..., m : m + q, m:] = Ayy
    F[..., m + q :, m:] = np.eye(w)
    b = np.zeros((M1, M2, m + q + w))
    b[..., :m] = c + (G @ Ny[..., None])[..., 0]
    b[..., m : m + q] = Ny
    mean = (F @ state.mean[:, None, :, None])[..., 0] + b
    covariance = F @ state.covariance[:, None] @ np.swapaxes(F, -1, -2)
    cross = G @ Qyy
    covariance[..., :m, :m] += C + cross @ np.swapaxes(G, -1, -2)
    covariance[..., :m, m : m + q] += cross
    covariance[..., m : m + q, :m] += np.swapaxes(cross, -1, -2)
    covariance[..., m : m + q, m : m + q] += Qyy
    with np.errstate(divide="ignore"):
        log_w = np.maximum(np.log(np.abs(tables.transition)), LOG_ZERO) + state.log_p[:, None]
    sign = np.sign(tables.transition) if (tables.transition < 0.0).any() else None
    if sign is not None and state.sign is not None:
        sign = sign * state.sign[:, None]
    return PairPrediction(log_w, sign, mean, symmetrize(covariance))


def advance_gap(tables: PairTables, state: GapState, y: FloatArray, width: int) -> tuple[GapState, float]:
    """Take the next observation into account, of which parts (NaN) or all may be missing.

    Parameters
    ----------
    tables : PairTables
    state : GapState
    y : ndarray, shape (q,)
    width : int
        Length of the window to keep.

    Returns
    -------
    state, log_likelihood
        The log-likelihood is that of the parts that are there; 0 if none is.
    """
    m = tables.pairs.dim_x
    prediction = pair_prediction(tables, state)
    keep = slice(0, m + width)
    shorter = PairPrediction(
        prediction.log_w, prediction.sign, prediction.mean[..., keep], prediction.covariance[..., keep, keep]
    )
    return _condition(shorter, y, state.known[: width - y.size], m)


def _condition(
    prediction: PairPrediction, y: FloatArray, known: NDArray[np.bool_], m: int
) -> tuple[GapState, float]:
    """Condition every pair on the observed parts of y, and collapse pairs into nodes."""
    there = ~np.isnan(y)
    log_w, _, mean, covariance = condition_pairs(prediction, y, m)
    log_p, sign, o = collapse_weights(log_w, prediction.sign)
    node_mean = np.einsum("ij,ijk->jk", o, mean)
    off = mean - node_mean
    between = np.transpose(o[..., None] * off, (1, 2, 0)) @ np.swapaxes(off, 0, 1)  # of the means, per j
    node_covariance = np.einsum("ij,ijkl->jkl", o, covariance) + between
    dead = log_p < DEAD  # no path reaches these nodes: their moments must not grow without bound
    node_mean[np.ix_(dead, np.concatenate([np.ones(m, dtype=bool), ~there, ~known]))] = 0.0
    node_covariance[dead] = 0.0
    total = log_p.max()
    masses = np.exp(log_p - total) if sign is None else sign * np.exp(log_p - total)
    log_total = float(total + np.log(masses.sum()))
    state = GapState(
        log_p - log_total, sign, node_mean, symmetrize(node_covariance), np.concatenate([there, known])
    )
    return state, log_total if there.any() else 0.0


def condition_pairs(prediction: PairPrediction, y: FloatArray, m: int) -> PairPrediction:
    """Condition every pair on the observed parts of y, whose density joins the weights."""
    there = ~np.isnan(y)
    if not there.any():
        return prediction
    at = m + np.flatnonzero(there)
    log_w, sign, mean, covariance = prediction
    factor = _factor(prediction, at)
    residual = y[there] - mean[..., at]
    root = np.linalg.solve(factor, covariance[..., at, :])  # L^-1 Cov(Y', s')
    white = np.linalg.solve(factor, residual[..., None])
    mean = mean + (np.swapaxes(root, -1, -2) @ white)[..., 0]
    covariance = symmetrize(covariance - np.swapaxes(root, -1, -2) @ root)
    mean[..., at] = y[there]
    covariance[..., at, :] = 0.0
    covariance[..., :, at] = 0.0
    return PairPrediction(log_w + log_density(residual, factor), sign, mean, covariance)


def _factor(prediction: PairPrediction, at: NDArray[np.intp]) -> FloatArray:
    S = prediction.covariance[..., at[:, None], at]
    return cholesky(S, lambda k: f"covariance of the predicted observation, pair {k}")


def observed_log_density(prediction: PairPrediction, y: FloatArray, m: int) -> FloatArray:
    """Log-density of the observed parts of y per pair, (M1, M2); 0 if nothing is observed."""
    at = m + np.flatnonzero(~np.isnan(y))
    if at.size == 0:
        return np.zeros(prediction.log_w.shape)
    return log_density(y[at - m] - prediction.mean[..., at], _factor(prediction, at))


def collapse_weights(
    log_w: FloatArray, sign: FloatArray | None
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Column sums in the log domain, their signs, and o_ij = w_ij / sum_k w_kj."""
    if sign is None:
        log_p = logsumexp(log_w, axis=0)
        return log_p, None, np.exp(log_w - log_p)
    top = log_w.max(axis=0)
    w = sign * np.exp(log_w - top)
    column = w.sum(axis=0)
    column = np.where(column == 0.0, np.finfo(np.float64).tiny, column)
    return np.log(np.abs(column)) + top, np.where(column < 0.0, -1.0, 1.0), w / column


def predicted_moments(tables: PairTables, state: GapState) -> tuple[FloatArray, FloatArray]:
    """Mean (m + q,) and covariance of (X', Y') given the observations so far."""
    prediction = pair_prediction(tables, state)
    d = tables.pairs.dim_x + tables.pairs.dim_z
    weights = node_probabilities(NodeState(state.log_p[None], state.sign))[:, None] * tables.transition
    mean = np.einsum("ij,ijk->k", weights, prediction.mean[..., :d])
    off = (prediction.mean[..., :d] - mean).reshape(-1, d)
    within = np.einsum("ij,ijkl->kl", weights, prediction.covariance[..., :d, :d])
    covariance = within + (weights.reshape(-1, 1) * off).T @ off
    return mean, symmetrize(covariance)

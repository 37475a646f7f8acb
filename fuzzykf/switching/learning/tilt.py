"""How inputs act on the transitions of a hidden switch: softmax regressions on the nodes.

With s_j the shares of the regimes in node j and inputs u_n in standard units,

    P_ij(n) = P_ij exp(s_j' tilt u_n) / Z_i(n),   Z_i(n) = sum over k of P_ik exp(s_k' tilt u_n).

Given the posterior gamma of the nodes, what the maximisation raises of it is

    sum over n of [sum_j gamma_n+1(j) s_j' tilt u_n - sum_i gamma_n(i) log Z_i(n)] - ridge |tilt|^2 / 2,

which is concave: Newton's method finds the maximum.  For P itself the sum of pairs log P minus that of
gamma log Z is bounded from below by what it is with Z linear in P, whose maximum are counts divided by the
mean of exp(s_j' tilt u_n) / Z_i(n): as if each pair had been seen as often as without inputs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.switching.dynamics.tilt import log_totals

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.learning.data import TrainingData

__all__ = [
    "RIDGE_TILT",
    "Moves",
    "evened",
    "log_normalisers",
    "maximised",
    "n_free",
    "no_tilt",
    "of_known",
    "tilted",
]

#: Weight of the ridge: a standard normal law of each log-odds, for an input of deviation one.
RIDGE_TILT = 1.0

#: Newton steps at most, and the relative gain at which they end.
STEPS, LITTLE = 20, 1e-10

#: Rounds of tilt and probabilities, where the switch is known.
ROUNDS = 20


class Moves(NamedTuple):
    """What the data say of T transitions of the switch."""

    before: FloatArray  # (T, M): posterior of the node before each
    after: FloatArray  # (T, M): and of the node after it
    us: FloatArray  # (T, k): inputs of the time after it, in standard units


def no_tilt(data: TrainingData, K: int) -> FloatArray | None:
    """Return inputs without effect on K regimes, (K, k); None where there are none, or nothing to act on."""
    k = 0 if data.further is None else len(data.further.inputs)
    return np.zeros((K, k)) if k and K > 1 else None


def n_free(tilt: FloatArray | None) -> int:
    """Return how many free parameters a tilt has: what all regimes have in common moves nothing."""
    return 0 if tilt is None else (len(tilt) - 1) * tilt.shape[1]


def tilted(transition: FloatArray, push: FloatArray, us: FloatArray) -> FloatArray:
    """Return log P_ij(n) - log P_ij, (T, M, M), where inputs (T, k) push each node by ``push`` (M, k)."""
    found: FloatArray = (us @ push.T)[:, None, :] - log_normalisers(transition, push, us)[:, :, None]
    return found


def log_normalisers(transition: FloatArray, push: FloatArray, us: FloatArray) -> FloatArray:
    """Return log Z_i(n), (T, M)."""
    return log_totals(transition, us @ push.T)


def maximised(tilt: FloatArray, transition: FloatArray, shares: FloatArray, moves: Moves) -> FloatArray:
    """Return the tilt (K, k) that posteriors of the switch make likeliest, from one near it on.

    Parameters
    ----------
    tilt : ndarray, shape (K, k)
    transition : ndarray, shape (M, M)
        Without inputs.
    shares : ndarray, shape (M, K)
        Of the regimes in the nodes.
    moves : Moves
    """
    arrived = (moves.after @ shares).T @ moves.us
    value, slope, curvature = _at(tilt, arrived, transition, shares, moves)
    for _ in range(STEPS):
        step = np.linalg.solve(curvature, slope.ravel()).reshape(tilt.shape)
        size = 1.0
        while True:
            trial = _at(tilt + size * step, arrived, transition, shares, moves)
            if trial[0] >= value or size < 1e-6:
                break
            size *= 0.5
        gain = trial[0] - value
        if not gain > 0.0:
            break
        tilt = tilt + size * step
        value, slope, curvature = trial
        if gain < LITTLE * max(1.0, abs(value)):
            break
    return tilt


def _at(
    tilt: FloatArray, arrived: FloatArray, transition: FloatArray, shares: FloatArray, moves: Moves
) -> tuple[float, FloatArray, FloatArray]:
    """Value, gradient (K, k), and negative curvature (K k, K k)."""
    push, (before, _, us) = shares @ tilt, moves
    log_Z = log_normalisers(transition, push, us)
    value = float((arrived * tilt).sum() - (before * log_Z).sum() - 0.5 * RIDGE_TILT * (tilt * tilt).sum())
    P = transition * np.exp((us @ push.T)[:, None, :] - log_Z[:, :, None])  # (T, M, M)
    mean = P @ shares  # (T, M, K)
    slope = arrived - np.einsum("tm,tmk->tk", before, mean).T @ us - RIDGE_TILT * tilt
    second = np.einsum("tm,tmj,ja,jb->tab", before, P, shares, shares, optimize=True)
    second -= np.einsum("tm,tma,tmb->tab", before, mean, mean, optimize=True)
    curvature = np.einsum("tab,tc,td->acbd", second, us, us, optimize=True).reshape(tilt.size, tilt.size)
    return value, slope, curvature + RIDGE_TILT * np.eye(tilt.size)


def evened(
    pairs: FloatArray, tilt: FloatArray, transition: FloatArray, shares: FloatArray, moves: Moves
) -> FloatArray:
    """Return expected transitions (M, M) as if there had been no inputs."""
    push = shares @ tilt
    log_Z = log_normalisers(transition, push, moves.us)
    weight = np.exp((moves.us @ push.T)[:, None, :] - log_Z[:, :, None])
    visits = moves.before.sum(axis=0)[:, None]
    ratio = np.einsum("tm,tmj->mj", moves.before, weight)
    found: FloatArray = np.where(visits > 0.0, pairs * visits / np.where(ratio > 0.0, ratio, 1.0), pairs)
    return found


def of_known(
    counts: FloatArray, transition: FloatArray, shares: FloatArray, data: TrainingData
) -> tuple[FloatArray, FloatArray | None]:
    """Return transition probabilities and tilt of regimes that are known, the latter None without inputs.

    Parameters
    ----------
    counts : ndarray, shape (K, K)
        Of transitions.
    transition : ndarray, shape (K, K)
        Without inputs.
    shares : ndarray, shape (N, K)
        1 for the regime of each row, else 0.
    data : TrainingData
    """
    tilt = no_tilt(data, len(counts))
    if tilt is None or data.further is None:
        return transition, None
    moves, regimes = Moves(shares[data.before], shares[data.after], data.further.us), np.eye(len(counts))
    seen = counts.sum(axis=1, keepdims=True) > 0.0
    for _ in range(ROUNDS):  # each raises the likelihood: in P the scale of a row does not count
        tilt = maximised(tilt, transition, regimes, moves)
        rows = np.where(seen, evened(counts, tilt, transition, regimes, moves), 1.0)
        transition = rows / rows.sum(axis=1, keepdims=True)
    return transition, tilt

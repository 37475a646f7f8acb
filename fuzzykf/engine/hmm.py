"""NumPy kernels of hidden Markov chains whose observations depend on pairs of states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray

__all__ = ["forward_backward"]

#: Smallest probability of a state that is told from zero.
_FLOOR = 1e-300


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
    T, M = len(log_emission), first.size
    peaks = log_emission.max(axis=(1, 2), initial=-np.inf)
    moves = np.exp(log_emission - peaks[:, None, None])
    moves *= transition
    alpha, scale = np.empty((T + 1, M)), np.empty(T)
    alpha[0] = now = first
    for n in range(T):
        now = now.dot(moves[n])
        total = now.sum()
        if not total > _FLOOR:  # every likely state has become impossible
            moves[n], shift = _rescued(alpha[n], transition, log_emission[n])
            peaks[n] = shift
            now = alpha[n].dot(moves[n])
            total = now.sum()
        now = np.maximum(now / total, _FLOOR)
        alpha[n + 1], scale[n] = now, total
    beta = np.empty((T + 1, M))
    beta[T] = now = np.ones(M)
    for n in range(T - 1, -1, -1):
        now = moves[n].dot(now) / scale[n]
        beta[n] = now
    xi = alpha[:-1, :, None] * moves * beta[1:, None, :]
    xi /= scale[:, None, None]
    gamma = alpha * beta
    return gamma, xi, np.log(scale) + peaks


def _rescued(alpha: FloatArray, transition: FloatArray, log_emission: FloatArray) -> tuple[FloatArray, float]:
    """Scale a step by the best pair that is possible, not by the best pair of all."""
    with np.errstate(divide="ignore"):
        shift = float((log_emission + np.log(alpha)[:, None] + np.log(transition)).max())
    return np.exp(np.minimum(log_emission - shift, 600.0)) * transition, shift

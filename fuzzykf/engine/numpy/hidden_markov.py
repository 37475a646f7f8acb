"""Posterior of the states of a hidden Markov chain; NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.slots import SPARSE

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["forward_backward"]

#: Totals below this have lost digits to underflow.
_LOST = 1e-290

#: A state of lost probability (at most 1e-290) matters if the future favours it by more than this.
_FAVOURED = 1e250


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
    i, j = np.nonzero(transition)
    if i.size > SPARSE * transition.size:
        peaks = log_emission.max(axis=(1, 2), initial=-np.inf)
        moves = np.exp(log_emission - peaks[:, None, None])
        moves *= transition
    else:  # the exponentials cost more than all else
        of_pairs = log_emission[:, i, j]
        peaks = of_pairs.max(axis=1, initial=-np.inf)
        of_pairs -= peaks[:, None]
        np.exp(of_pairs, out=of_pairs)
        moves = np.zeros(log_emission.shape)
        moves[:, i, j] = of_pairs * transition[i, j]
    scaled = _scaled_messages(first, moves)
    if scaled is None:  # what floating-point numbers cannot hold may matter here
        return _in_logarithms(first, transition, log_emission)
    alpha, beta, scale = scaled
    xi = moves
    xi *= alpha[:-1, :, None]
    xi *= (beta[1:] / scale[:, None])[:, None, :]
    return alpha * beta, xi, np.log(scale) + peaks


def _scaled_messages(
    first: FloatArray, moves: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Forward messages that sum to one, backward ones scaled alike, and totals; None if they underflow."""
    T, M = len(moves), first.size
    alpha, beta, scale = np.empty((T + 1, M)), np.empty((T + 1, M)), np.empty(T)
    ones = np.ones(M)
    alpha[0] = now = first
    for n, move in enumerate(moves):
        now = now.dot(move)
        total = now.dot(ones)
        if not total > _LOST:
            return None
        now /= total
        alpha[n + 1], scale[n] = now, total
    beta[T] = now = ones
    with np.errstate(over="ignore", invalid="ignore"):
        for n in range(T - 1, -1, -1):
            now = moves[n].dot(now)
            now /= scale[n]
            beta[n] = now
    return (alpha, beta, scale) if beta.max() < _FAVOURED else None


def _in_logarithms(
    first: FloatArray, transition: FloatArray, log_emission: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same as `forward_backward`, several times slower, whatever the densities."""
    T, M = len(log_emission), first.size
    with np.errstate(divide="ignore"):
        moves = np.where(transition == 0.0, -np.inf, log_emission + np.log(transition))
        now = np.log(first)
    alpha, beta, scale = np.empty((T + 1, M)), np.empty((T + 1, M)), np.empty(T)
    alpha[0] = now
    for n, move in enumerate(moves):
        now = _log_sums(now[:, None] + move, 0)
        scale[n] = _log_sums(now, 0)
        now = now - scale[n]
        alpha[n + 1] = now
    beta[T] = now = np.zeros(M)
    for n in range(T - 1, -1, -1):
        now = _log_sums(moves[n] + now, 1) - scale[n]
        beta[n] = now
    xi = np.exp(alpha[:-1, :, None] + moves + (beta[1:] - scale[:, None])[:, None, :])
    return np.exp(alpha + beta), xi, scale


def _log_sums(a: FloatArray, axis: int) -> FloatArray:
    """Logarithms of sums of exponentials; minus infinity stands for zero."""
    top = a.max(axis=axis)
    top = np.where(top > -np.inf, top, 0.0)
    with np.errstate(divide="ignore"):
        sums: FloatArray = np.log(np.exp(a - np.expand_dims(top, axis)).sum(axis=axis)) + top
    return sums

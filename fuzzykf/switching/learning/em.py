"""Learning with a hidden switch: expectation and maximisation on the nodes.

On the nodes (R, Z) is a hidden Markov chain with emission p(z_{n+1} | z_n, i, j).  The
expectation step is one forward-backward pass; the maximisation step needs only the
weighted second moments of each pair of nodes, and the expected numbers of transitions.
The likelihood is that of each stretch of data given its first (x, y).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import forward_backward
from fuzzykf.switching.learning.gaussians import transition_vectors
from fuzzykf.switching.learning.regression import Cells

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning.chains import ChainFamily
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.gaussians import GaussianEstimate

__all__ = ["Estimate", "Posterior", "cells_of", "expectation", "pair_shares", "run_em"]


@dataclass
class Estimate:
    """Parameters on the way, in standard units."""

    chain: ChainFamily
    gaussian: GaussianEstimate


@dataclass(frozen=True)
class Posterior:
    """What an expectation step finds.

    Attributes
    ----------
    gamma : ndarray, shape (N, M)
        Probability of each node at each row of the data.
    pairs : ndarray, shape (M, M)
        Expected numbers of transitions.
    moment : ndarray, shape (M, M, f, f)
        Weighted second moments of v = (1, y, y', x, x').
    first : ndarray, shape (M,)
        Expected numbers of stretches that begin in each node.
    log_likelihood : float
    """

    gamma: FloatArray
    pairs: FloatArray
    moment: FloatArray
    first: FloatArray
    log_likelihood: float


def pair_shares(shares: FloatArray) -> FloatArray:
    """Shares of the pairs of regimes in the pairs of nodes: (M * M, K * K)."""
    M, K = shares.shape
    return (shares[:, None, :, None] * shares[None, :, None, :]).reshape(M * M, K * K)


def expectation(estimate: Estimate, shares: FloatArray, data: TrainingData, v: FloatArray) -> Posterior:
    """Posterior of the nodes, and the statistics that the maximisation needs."""
    m = data.dim_x
    q = data.z.shape[1] - m
    M, f = len(shares), v.shape[1]
    W, constant = estimate.gaussian.rows(pair_shares(shares))
    W = np.moveaxis(W, 1, 0).reshape(-1, f)
    gamma = np.empty((len(data.z), M))
    pairs, first = np.zeros((M, M)), np.zeros(M)
    moment = np.zeros((M * M, f * f))
    total = 0.0
    stops = np.append(data.starts[1:], len(data.z))
    done = 0
    for start, stop in zip(data.starts, stops, strict=True):
        T = int(stop - start) - 1
        part = v[done : done + T]
        done += T
        white = (part @ W.T).reshape(T, q + m, M * M)
        log_emission = constant - 0.5 * (white * white).sum(axis=1)
        posterior, xi, log_likelihood = forward_backward(
            estimate.chain.initial, estimate.chain.transition, log_emission.reshape(T, M, M)
        )
        gamma[start:stop] = posterior
        first += posterior[0]
        if T:
            flat = xi.reshape(T, M * M)
            pairs += flat.sum(axis=0).reshape(M, M)
            moment += flat.T @ (part[:, :, None] * part[:, None, :]).reshape(T, f * f)
        total += float(log_likelihood.sum())
    return Posterior(gamma, pairs, moment.reshape(M, M, f, f), first, total)


def cells_of(posterior: Posterior, shares: FloatArray) -> Cells:
    """Bring the statistics of the pairs of nodes to the form of a regression."""
    weight = posterior.pairs.reshape(-1)
    f = posterior.moment.shape[-1]
    mean = posterior.moment.reshape(-1, f, f) / np.where(weight > 0.0, weight, 1.0)[:, None, None]
    return Cells(pair_shares(shares), weight, mean)


def run_em(
    estimate: Estimate,
    shares: FloatArray,
    data: TrainingData,
    *,
    max_iter: int,
    tolerance: float,
    tick: Callable[[], None] | None = None,
) -> tuple[Estimate, Posterior, list[float], bool]:
    """Alternate expectation and maximisation until the posterior density stands still.

    Parameters
    ----------
    estimate : Estimate
        Where to begin.
    shares : ndarray, shape (M, K)
        Shares of the regimes in the nodes.
    data : TrainingData
    max_iter : int
    tolerance : float
        Gain per observation at which to stop.
    tick : callable, optional
        Called after each iteration.

    Returns
    -------
    estimate, posterior, trace, converged
        The trace holds log-likelihood plus log-prior at each expectation step, which never
        decreases.
    """
    v = transition_vectors(data)
    converged = False
    posterior = expectation(estimate, shares, data, v)
    trace = [posterior.log_likelihood + estimate.gaussian.log_prior]
    for _ in range(max_iter):
        gaussian = estimate.gaussian.maximise(cells_of(posterior, shares))
        estimate.chain.maximise(posterior.pairs, posterior.first)
        estimate = Estimate(estimate.chain, gaussian)
        posterior = expectation(estimate, shares, data, v)
        trace.append(posterior.log_likelihood + estimate.gaussian.log_prior)
        if tick is not None:
            tick()
        if trace[-1] - trace[-2] < tolerance * len(v):
            converged = True
            break
    return estimate, posterior, trace, converged

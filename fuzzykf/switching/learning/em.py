"""Learning with a hidden switch: expectation and maximisation on the nodes.

On the nodes (R, Z) is a hidden Markov chain with emission p(z_{n+1} | z_n, i, j).  The
expectation step is one forward-backward pass; the maximisation step needs only the
weighted second moments of each pair of nodes, and the expected numbers of transitions.
The likelihood is that of each stretch of data given its first (x, y).

Given the switch a transition factors into p(y' | y, i, j) and p(x' | x, y, y', i, j).  Where x' (or x, if the
state depends on it) is missing, the second factor is left out, and the state regression learns nothing.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.selected import forward_backward
from fuzzykf.switching.learning.gaussians import transition_vectors
from fuzzykf.switching.learning.regression import Cells, Evidence
from fuzzykf.switching.learning.tilt import (
    RIDGE_TILT,
    Moves,
    evened,
    log_normalisers,
    maximised,
    tilted,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.laws.chain import SwitchChain
    from fuzzykf.switching.laws.learners import ChainFamily
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.gaussians import GaussianEstimate

__all__ = [
    "Counts",
    "Estimate",
    "Posterior",
    "Settled",
    "cells_of",
    "expectation",
    "extrapolated",
    "pair_shares",
    "run_em",
]


@dataclass
class Estimate:
    """Parameters on the way, in standard units."""

    chain: ChainFamily
    gaussian: GaussianEstimate
    tilt: FloatArray | None = None  # (K, k): how inputs act on the transitions, where there are some

    @property
    def vector(self) -> FloatArray:
        """All parameters, those of the chain first, the tilt last."""
        tilt = () if self.tilt is None else (self.tilt.ravel(),)
        return np.concatenate([self.chain.vector, self.gaussian.vector, *tilt])

    @property
    def log_prior(self) -> float:
        """Log-density of the prior of all parameters, but for a constant."""
        ridge = 0.0 if self.tilt is None else -0.5 * RIDGE_TILT * float((self.tilt * self.tilt).sum())
        return self.gaussian.log_prior + self.chain.log_prior + ridge


class Settled(NamedTuple):
    """Parameters that no maximisation moves any more.

    Attributes
    ----------
    law : object
        The law of the switch, or its chain where regimes are hard.
    chain : SwitchChain
    gaussian : GaussianEstimate
    tilt : ndarray, shape (K, k), or None
        How inputs, in standard units, act on the transitions: see `fuzzykf.switching.learning.tilt`.
    """

    law: Any
    chain: SwitchChain
    gaussian: GaussianEstimate
    tilt: FloatArray | None = None


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
        Weighted second moments of v = (1, y, y', x, x'), x being zero where it is not known.
    state_pairs, state_moment : ndarray
        The same of the transitions that have a state (`TrainingData.has_state`); the same objects if all do.
    first : ndarray, shape (M,)
        Expected numbers of stretches that begin in each node.
    log_likelihood : float
    """

    gamma: FloatArray
    pairs: FloatArray
    moment: FloatArray
    state_pairs: FloatArray
    state_moment: FloatArray
    first: FloatArray
    log_likelihood: float


class Counts(NamedTuple):
    """Expected numbers of transitions, (M, M), and of stretches that begin in each node, (M,)."""

    pairs: FloatArray
    first: FloatArray

    def log_likelihood(self, chain: ChainFamily) -> float:
        """Sum of pairs log P and first log pi, with the floor under probabilities that chains have."""
        P, p = (np.log(np.maximum(a, 1e-300)) for a in (chain.transition, chain.initial))
        return float((self.pairs * P).sum() + self.first @ p)


@dataclass(frozen=True)
class Point:
    """An estimate, what the data say of it, and the density that is raised."""

    estimate: Estimate
    posterior: Posterior
    value: float


def pair_shares(shares: FloatArray) -> FloatArray:
    """Shares of the pairs of regimes in the pairs of nodes: (M * M, K * K)."""
    M, K = shares.shape
    return (shares[:, None, :, None] * shares[None, :, None, :]).reshape(M * M, K * K)


def expectation(
    estimate: Estimate | Settled, shares: FloatArray, data: TrainingData, v: FloatArray
) -> Posterior:
    """Posterior of the nodes, and the statistics that the maximisation needs."""
    m = data.dim_x
    q = data.z.shape[1] - m
    M, f = len(shares), v.shape[1]
    transition = estimate.chain.transition
    tilt = estimate.tilt
    possible = np.flatnonzero(transition.reshape(-1))  # no others are looked at
    regimes = pair_shares(shares)[possible]
    W, constant = estimate.gaussian.rows(regimes)
    constant_y = None if data.has_state.all() else estimate.gaussian.observation_constant(regimes)
    W = np.moveaxis(W, 1, 0).reshape(-1, f)
    gamma = np.empty((len(data.z), M))
    pairs, first = np.zeros((M, M)), np.zeros(M)
    moment = np.zeros((M * M, f * f))  # of the transitions that have a state
    pairs_without, without = np.zeros((M, M)), np.zeros((M * M, f * f))
    total = 0.0
    stops = np.append(data.starts[1:], len(data.z))
    done = 0
    for start, stop in zip(data.starts, stops, strict=True):
        T = int(stop - start) - 1
        part, has_state = v[done : done + T], data.has_state[done : done + T]
        done += T
        white = (part @ W.T).reshape(T, q + m, possible.size)
        log_emission = constant - 0.5 * (white * white).sum(axis=1)
        if constant_y is not None:
            of_y = white[~has_state, :q]
            log_emission[~has_state] = constant_y - 0.5 * (of_y * of_y).sum(axis=1)
        spread = _spread_out(log_emission, possible, M)
        if tilt is not None:
            assert data.further is not None
            spread += tilted(transition, shares @ tilt, data.further.us[done - T : done])
        posterior, xi, log_likelihood = forward_backward(estimate.chain.initial, transition, spread)
        gamma[start:stop] = posterior
        first += posterior[0]
        if T:
            flat = xi.reshape(T, M * M)
            squares = (part[:, :, None] * part[:, None, :]).reshape(T, f * f)
            if constant_y is not None:
                pairs_without += flat[~has_state].sum(axis=0).reshape(M, M)
                without[possible] += flat[np.ix_(~has_state, possible)].T @ squares[~has_state]
                flat, squares = flat[has_state], squares[has_state]
            pairs += flat.sum(axis=0).reshape(M, M)
            if possible.size < M * M:
                flat = flat[:, possible]
            moment[possible] += flat.T @ squares
        total += float(log_likelihood.sum())
    moment = moment.reshape(M, M, f, f)
    if constant_y is None:
        return Posterior(gamma, pairs, moment, pairs, moment, first, total)
    every = moment + without.reshape(M, M, f, f)
    return Posterior(gamma, pairs + pairs_without, every, pairs, moment, first, total)


def _spread_out(log_emission: FloatArray, possible: IntArray, M: int) -> FloatArray:
    """Bring what possible pairs have, (T, P), to all of them, (T, M, M)."""
    T = len(log_emission)
    if possible.size == M * M:
        return log_emission.reshape(T, M, M)
    full = np.repeat(log_emission[:, :1], M * M, axis=1)  # of a size that takes no digits from the others
    full[:, possible] = log_emission
    return full.reshape(T, M, M)


def cells_of(posterior: Posterior, shares: FloatArray) -> Evidence:
    """Bring the statistics of the pairs of nodes to the form of regressions; impossible pairs have none."""
    regimes = pair_shares(shares)
    f = posterior.moment.shape[-1]

    def cells(pairs: FloatArray, moment: FloatArray) -> Cells:
        weight = pairs.reshape(-1)
        seen = weight > 0.0
        mean = moment.reshape(-1, f, f)[seen] / weight[seen][:, None, None]
        return Cells(regimes[seen], weight[seen], mean)

    every = cells(posterior.pairs, posterior.moment)
    if posterior.state_pairs is posterior.pairs:
        return Evidence(every, every)
    return Evidence(every, cells(posterior.state_pairs, posterior.state_moment))


def run_em(
    estimate: Estimate,
    shares: FloatArray,
    data: TrainingData,
    *,
    max_iter: int,
    tolerance: float,
    accelerate: bool = False,
    tick: Callable[[], None] | None = None,
    before: Counts | None = None,
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
    accelerate : bool
        After every two steps, go on along the curve through the last three estimates (see
        `extrapolated`), if the density rises.  Each such step counts as an iteration.
    tick : callable, optional
        Called after each iteration.
    before : Counts, optional
        What the switch did in rows before the data, which joins what it does in them.

    Returns
    -------
    estimate, posterior, trace, converged
        The trace holds log-likelihood plus log-prior (and the expected log-likelihood of what was before)
        at each expectation step, which never decreases.
    """
    M = len(shares)
    before = Counts(np.zeros((M, M)), np.zeros(M)) if before is None else before
    v = transition_vectors(data)
    little = tolerance * len(v)

    def judged(found: Estimate) -> Point:
        posterior = expectation(found, shares, data, v)
        prior = found.log_prior + before.log_likelihood(found.chain)
        return Point(found, posterior, posterior.log_likelihood + prior)

    path = [judged(estimate)]
    trace = [path[0].value]
    longest = 4.0
    converged = False
    while len(trace) <= max_iter and not converged:
        now = path[-1]
        chain, tilt = _moved_switch(now, before, shares, data)
        gaussian = now.estimate.gaussian.maximise(cells_of(now.posterior, shares))
        path.append(judged(Estimate(chain, gaussian, tilt)))
        trace.append(path[-1].value)
        converged = trace[-1] - trace[-2] < little
        if tick is not None:
            tick()
        if accelerate and len(path) == 3 and len(trace) <= max_iter:
            farther, length = extrapolated(path[0].estimate, path[1].estimate, path[2].estimate, longest)
            path = path[2:]
            if farther is not None:
                trial = judged(farther)
                if trial.value >= trace[-1]:
                    converged = converged and trial.value - trace[-1] < little
                    path = [trial]
                    trace.append(trial.value)
                    longest = max(longest, 4.0 * length)
                else:
                    longest = max(0.5 * length, 2.0)
    return path[-1].estimate, path[-1].posterior, trace, converged


def _moved_switch(
    now: Point, before: Counts, shares: FloatArray, data: TrainingData
) -> tuple[ChainFamily, FloatArray | None]:
    """Maximise over the chain and, where there are inputs, over how these act on it, one after the other."""
    estimate, posterior = now.estimate, now.posterior
    chain, first = copy(estimate.chain), posterior.first + before.first
    if estimate.tilt is None or data.further is None:
        chain.maximise(posterior.pairs + before.pairs, first)
        return chain, None
    moves = Moves(posterior.gamma[data.before], posterior.gamma[data.after], data.further.us)
    old = estimate.chain.transition
    tilt = estimate.tilt
    if not before.pairs.any():  # what earlier rows say of it is not known, so it stays
        tilt = maximised(tilt, old, shares, moves)
    chain.maximise(evened(posterior.pairs, tilt, old, shares, moves) + before.pairs, first)

    def value(one: ChainFamily) -> float:
        log_Z = log_normalisers(one.transition, shares @ tilt, moves.us)
        counts = Counts(posterior.pairs + before.pairs, first)
        return counts.log_likelihood(one) + one.log_prior - float((moves.before * log_Z).sum())

    return (chain if value(chain) >= value(estimate.chain) else estimate.chain), tilt


def extrapolated(
    first: Estimate, second: Estimate, third: Estimate, longest: float
) -> tuple[Estimate | None, float]:
    """Go on along the parabola through three estimates that followed one another.

    Expectation-maximisation creeps where much is hidden: its steps shrink by a constant
    factor.  With r the first step, v the difference of the two steps and a = |r| / |v|, the
    point theta + 2 a r + a^2 v is where such steps would end.

    Parameters
    ----------
    first, second, third : Estimate
    longest : float
        Largest a; 1 is the third estimate itself.

    Returns
    -------
    Estimate or None
        None where the steps do not shrink, or there is no model.
    float
        The a that was used.

    References
    ----------
    R. Varadhan, C. Roland, "Simple and globally convergent methods for accelerating the
    convergence of any EM algorithm", Scandinavian Journal of Statistics 35 (2008), scheme S3.
    """
    r = second.vector - first.vector
    v = third.vector - second.vector - r
    size = float(np.linalg.norm(v))
    a = min(float(np.linalg.norm(r)) / size, longest) if size > 0.0 else 1.0
    if not a > 1.0:
        return None, a
    vector = first.vector + 2.0 * a * r + a * a * v
    k, end = first.chain.vector.size, vector.size - (0 if third.tilt is None else third.tilt.size)
    chain, gaussian = third.chain.at(vector[:k]), third.gaussian.at(vector[k:end])
    tilt = None if third.tilt is None else vector[end:].reshape(third.tilt.shape)
    return (None if chain is None or gaussian is None else Estimate(chain, gaussian, tilt)), a

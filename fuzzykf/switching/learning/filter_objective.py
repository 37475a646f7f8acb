"""What a model that serves its filter is learned from, and the exact gradient of that.

The joint likelihood trains the equation of X' on the true X, which a filter never sees.  Here the filter
itself is judged, at the states that were measured,

    sum log p(x_n | y_1..n) + alpha sum log p(y_n | y_1..n-1) - ridge,

with p(x_n | ...) the mixture over the nodes.  The numbers that are moved are the coefficients of whitened
regressors, the factors and log-variances of both regressions, and the free numbers of the law.  The ridge
draws the coefficients of the regimes (but for those of X) towards their mean.  Each pair of regimes is taken
to have seen one residual of the size that is common to all of them, so that no variance goes to zero where
states are alike.

Where there are inputs u_n, in standard units, they act on the transitions as well: with s_j the shares of the
regimes in node j, and a matrix ``tilt`` that has a ridge,

    P_ij(n) prop. to P_ij exp(s_j' tilt u_n).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.selected import MixtureLaw, PairMoves, first_step, score_gradient, score_states
from fuzzykf.errors import FuzzykfError
from fuzzykf.gaussian import cholesky
from fuzzykf.switching.laws.law_numbers import ByTables, ChainTables, LogitNumbers
from fuzzykf.switching.learning.em import pair_shares
from fuzzykf.switching.learning.regression import Regression
from fuzzykf.switching.learning.slopes import (
    by_covariance,
    log_densities,
    of_pairs,
    to_regimes,
    weighted_slope,
)
from fuzzykf.switching.learning.tilt import RIDGE_TILT, log_normalisers

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.laws.chain import SwitchChain
    from fuzzykf.switching.laws.law_numbers import LawNumbers
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.gaussians import RegressionEstimate

__all__ = ["ALPHA", "RIDGE", "FilterObjective", "Stretch", "Whitened", "stretches"]

#: Weight of the log-likelihood of the observations.
ALPHA = 0.1

#: Weight of the ridge, in observations.
RIDGE = 100.0

#: Of whitened regressors: a share of the variance that no direction is below.
_LEAST = 1e-8


class Stretch(NamedTuple):
    """Consecutive rows in which y is complete."""

    x: FloatArray  # (T + 1, m), NaN where not measured
    y: FloatArray  # (T + 1, q)
    before: FloatArray  # (T, p): regressors of the observation of each step
    after: FloatArray  # (T, l): those of the state, but for the state before
    us: FloatArray  # (T, k): inputs
    first: MixtureLaw  # what the first observation says of each node, before the law of the switch does


class Whitened:
    """The numbers of a regression, with coefficients of regressors that are whitened.

    Parameters
    ----------
    fit : Regression
        Of B regimes, or pairs of them.
    regressors : ndarray, shape (n, p)
        From which they are whitened.
    n_bare : int
        So many regressors, the first ones, stay as they are and have no ridge.
    """

    def __init__(self, fit: Regression, regressors: FloatArray, n_bare: int = 0) -> None:
        self._shape, self._n_bare = fit.beta.shape, n_bare
        self._common = np.log(np.exp(fit.g).mean(axis=0))
        t, p = self._shape[1:]
        S = regressors[:, n_bare:].T @ regressors[:, n_bare:] / len(regressors)
        S += _LEAST * np.diag(np.diagonal(S))
        self._root = np.eye(p)
        self._root[n_bare:, n_bare:] = np.linalg.cholesky(S)
        self._below = np.tril_indices(t, -1)

    def pack(self, fit: Regression) -> FloatArray:
        """Return the numbers of a regression."""
        T = fit.T[:, *self._below]
        return np.concatenate([(fit.beta @ self._root).ravel(), T.ravel(), fit.g.ravel()])

    def unpack(self, numbers: FloatArray) -> Regression:
        """Return the regression of these numbers."""
        beta, T, g = self._split(numbers)
        full = np.tile(np.eye(self._shape[1]), (self._shape[0], 1, 1))
        full[:, *self._below] = T
        bare: Any = np.linalg.solve(self._root.T, np.swapaxes(beta, -1, -2)).swapaxes(-1, -2)
        return Regression(bare, full, g)

    def slope(self, by: Regression) -> FloatArray:
        """Turn derivatives by a regression into those by its numbers."""
        beta = np.linalg.solve(self._root, np.swapaxes(by.beta, -1, -2)).swapaxes(-1, -2)
        return np.concatenate([beta.ravel(), by.T[:, *self._below].ravel(), by.g.ravel()])

    def ridge(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Half the squared distance of coefficients from their mean over the regimes, and its gradient."""
        beta, T, g = self._split(numbers)
        off = beta - beta.mean(axis=0)
        off[:, :, : self._n_bare] = 0.0
        slope = np.concatenate([off.ravel(), np.zeros(T.size + g.size)])
        return 0.5 * float((off * off).sum()), slope

    def seen_before(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Half of sum (g + exp(common - g)), and its gradient: one residual of common size in each regime."""
        beta, T, g = self._split(numbers)
        size = np.exp(self._common - g)
        slope = np.concatenate([np.zeros(beta.size + T.size), 0.5 * (1.0 - size).ravel()])
        return 0.5 * float((g + size).sum()), slope

    def _split(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        B, t, p = self._shape
        beta, T, g = np.split(numbers, np.cumsum([B * t * p, B * len(self._below[0])]))
        return beta.reshape(B, t, p), T.reshape(B, -1), g.reshape(B, t)


class _Point(NamedTuple):
    """What numbers stand for."""

    observation: Regression
    state: Regression
    logits: FloatArray  # of the law
    tables: ChainTables
    tilt: FloatArray  # (K, k)


class FilterObjective:
    """The objective as a function of numbers, in standard units.

    Parameters
    ----------
    estimate : RegressionEstimate
        Where to begin, and what may depend on what.
    law : LawNumbers or None
        None if there is nothing to move in it.
    chain : SwitchChain
        That of the law at which the search begins.
    learned : list of Stretch
    """

    def __init__(
        self, estimate: RegressionEstimate, law: LawNumbers | None, chain: SwitchChain, learned: list[Stretch]
    ) -> None:
        self.estimate, self._law, self._learned = estimate, law, learned
        self._fixed = ChainTables(chain.initial, chain.transition)
        self._p = estimate.dim_x if estimate.state_feedback else 0
        # where free numbers widen bands of the chain, pairs that are impossible now may be possible later
        possible = np.ones_like(chain.transition) if isinstance(law, LogitNumbers) else chain.transition
        self._nodes: IntArray = np.array(np.nonzero(possible > 0.0), dtype=np.intp)
        M = len(chain)
        self._shares = pair_shares(chain.class_weights)[self._nodes[0] * M + self._nodes[1]]
        self._n_states = max(sum(int(np.isfinite(one.x).all(axis=1).sum()) for one in learned), 1)
        self._of_observation = Whitened(estimate.observation, np.concatenate([one.before for one in learned]))
        state = np.concatenate([one.after for one in learned])
        bare = np.zeros((len(state), self._p))  # the state before stays in standard units
        self._of_state = Whitened(estimate.state, np.concatenate([bare, state], axis=1), self._p)
        parts = self._of_observation.pack(estimate.observation), self._of_state.pack(estimate.state)
        logits = np.empty(0) if law is None else law.start
        self._is_free = np.isfinite(logits)  # what is at minus infinity stays there
        self._logits = logits
        self._class_weights = chain.class_weights
        n_inputs = learned[0].us.shape[1] if len(chain) > 1 else 0
        self._tilt = chain.class_weights.shape[1], n_inputs
        free = logits[self._is_free]
        self._cuts = np.cumsum([*(one.size for one in parts), free.size])
        self.start: FloatArray = np.concatenate([*parts, free, np.zeros(self._tilt[0] * n_inputs)])

    def at(self, numbers: FloatArray, inflation: float = 1.0) -> tuple[RegressionEstimate, Any, FloatArray]:
        """Return the Gaussian part of these numbers, the law or None if it has none, and the tilt (K, k).

        Parameters
        ----------
        numbers : ndarray
        inflation : float
            What the covariances of the noise of the state are multiplied by.
        """
        point = self._unpack(numbers)
        state = point.state._replace(g=point.state.g + np.log(inflation))
        law = None if self._law is None else self._law.value(point.logits)
        return self.estimate.with_regressions(point.observation, state), law, point.tilt

    def scores(
        self, numbers: FloatArray, stretches: list[Stretch], inflation: float = 1.0
    ) -> list[FloatArray]:
        """Return the log-densities of the states of each stretch, NaN where they were not measured."""
        point = self._unpack(numbers)
        found = []
        for one in stretches:
            moves, first = self._moves(point, one)
            found.append(score_states(self._nodes, moves._replace(C=inflation * moves.C), first, one.x)[0])
        return found

    def mean_score(self, numbers: FloatArray, inflation: float = 1.0) -> float:
        """Return the mean log-density of the states that are learned from; minus infinity without one."""
        try:
            found = np.concatenate(self.scores(numbers, self._learned, inflation))
        except (FuzzykfError, np.linalg.LinAlgError):
            return -np.inf
        density = found[np.concatenate([np.isfinite(one.x).all(axis=1) for one in self._learned])]
        return float(density.mean()) if np.isfinite(density).all() else -np.inf

    def value(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Return the objective per measured state, and its gradient; NaN where there is none.

        Raises
        ------
        ParameterError
            If there is no law of these numbers.
        numpy.linalg.LinAlgError
            If a covariance is singular.
        """
        point, m = self._unpack(numbers), self.estimate.dim_x
        of_pairs_y, of_pairs_x = self._at_pairs(point)
        P = len(self._shares)
        total, by_T, by_p = 0.0, np.zeros(P), np.zeros(len(point.tables.initial))
        by_tilt = np.zeros(self._tilt)
        moment, weight = 0.0, np.zeros(P)
        by_beta = np.zeros((P, *of_pairs_x.beta.shape[1:]))
        by_C = np.zeros((P, m, m))
        for one in self._learned:
            moves, first = self._moves(point, one)
            found = score_gradient(self._nodes, moves, first, one.x, ALPHA)
            total += float(np.nansum(found.log_density) + ALPHA * found.log_likelihood.sum())
            by = found.moves
            u = np.concatenate([one.y[1:], one.before], axis=1)
            products = (u[:, :, None] * u[:, None, :]).reshape(len(u), u.shape[1] ** 2)
            moment = moment + by.log_weight.T @ products
            weight += by.log_weight.sum(axis=0)
            moved, tilted = self._tilt_back(point, one.us, by.log_weight)
            by_T += moved
            by_tilt += tilted
            by_p += found.first.log_p
            by_beta[..., : self._p] += by.A[..., : self._p]
            by_state = by.offset.reshape(len(u), P * m).T @ one.after
            by_beta[..., self._p :] += by_state.reshape(P, m, -1)
            by_C += by.C
        width = u.shape[1]
        slope_y = weighted_slope(of_pairs_y, weight, np.reshape(moment, (P, width, width)))
        slope_x = Regression(by_beta, *by_covariance(of_pairs_x, by_C))
        parts = [
            self._of_observation.slope(to_regimes(slope_y, self._shares)),
            self._of_state.slope(to_regimes(slope_x, self._shares)),
        ]
        if self._law is not None:
            transition = np.zeros_like(point.tables.transition)
            transition[*self._nodes] = by_T
            by_tables = ByTables(
                point.tables,
                _by_probability(by_p, point.tables.initial),
                _by_probability(transition, point.tables.transition),
            )
            parts.append(self._law.gradient(point.logits, by_tables)[self._is_free])
        for k, whitened in enumerate((self._of_observation, self._of_state)):
            own = np.split(numbers, self._cuts)[k]
            (ridge, slope), (before, by_before) = whitened.ridge(own), whitened.seen_before(own)
            total -= RIDGE * ridge + before
            parts[k] = parts[k] - RIDGE * slope - by_before
        total -= 0.5 * RIDGE_TILT * float((point.tilt * point.tilt).sum())
        parts.append((by_tilt - RIDGE_TILT * point.tilt).ravel())
        return total / self._n_states, np.concatenate(parts) / self._n_states

    def _unpack(self, numbers: FloatArray) -> _Point:
        of_y, of_x, free, tilt = np.split(numbers, self._cuts)
        logits = self._logits.copy()
        logits[self._is_free] = free
        tables = self._fixed if self._law is None else self._law.tables(logits)
        regressions = self._of_observation.unpack(of_y), self._of_state.unpack(of_x)
        return _Point(*regressions, logits, tables, tilt.reshape(self._tilt))

    def _at_pairs(self, point: _Point) -> tuple[Regression, Regression]:
        return of_pairs(point.observation, self._shares), of_pairs(point.state, self._shares)

    def _moves(self, point: _Point, one: Stretch) -> tuple[PairMoves, MixtureLaw]:
        observation, state = self._at_pairs(point)
        m = self.estimate.dim_x
        with np.errstate(divide="ignore"):
            log_p = np.log(point.tables.initial)
        A = np.zeros((len(self._shares), m, m))
        A[..., : self._p] = state.beta[..., : self._p]
        weight = log_densities(observation, one.y[1:], one.before)
        weight += self._log_transitions(point, one.us)
        slopes = state.beta[..., self._p :].reshape(-1, one.after.shape[1])
        offset = (one.after @ slopes.T).reshape(len(one.after), len(self._shares), m)
        moves = PairMoves(weight, offset, A, state.covariance)
        return moves, one.first._replace(log_p=log_p + one.first.log_p)

    def _log_transitions(self, point: _Point, us: FloatArray) -> FloatArray:
        """Log P_ij(n) of the pairs, (T, P); (P,) where inputs do not act on it."""
        with np.errstate(divide="ignore"):
            log_T: FloatArray = np.log(point.tables.transition[*self._nodes])
        if not self._tilt[1]:
            return log_T
        before, after = self._nodes
        push = self._class_weights @ point.tilt
        log_Z = log_normalisers(point.tables.transition, push, us)
        moved: FloatArray = log_T + (us @ push.T)[:, after] - log_Z[:, before]
        return moved

    def _tilt_back(self, point: _Point, us: FloatArray, by_log: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Turn derivatives by log P_ij(n), (T, P), into those by log P_ij, (P,), and by the tilt."""
        if not self._tilt[1]:
            return by_log.sum(axis=0), np.zeros(self._tilt)
        before, after = self._nodes
        M = len(self._class_weights)
        leaves = np.zeros((M, by_log.shape[1]))
        leaves[before, np.arange(before.size)] = 1.0
        P = np.exp(self._log_transitions(point, us))
        rest = by_log - P * (by_log @ leaves.T)[:, before]
        reached = np.zeros((by_log.shape[1], M))
        reached[np.arange(after.size), after] = 1.0
        return rest.sum(axis=0), self._class_weights.T @ (rest @ reached).T @ us


def _by_probability(g: FloatArray, p: FloatArray) -> FloatArray:
    """Turn derivatives by logarithms into those by what they are of, zero where that is."""
    return np.divide(g, p, out=np.zeros_like(g), where=p > 0.0)


def stretches(data: TrainingData, system: SwitchingSystem, end: int | None = None) -> list[Stretch]:
    """Return the stretches of the data with what the first observation says of each node.

    Parameters
    ----------
    data : TrainingData
    system : SwitchingSystem
        In the units of the data; its law of Z_1 given a node is taken as known.
    end : int, optional
        Rows of the data from here on are left out.
    """
    m, scale = data.dim_x, data.scale
    law = system.initial()
    mean = (law.mean - scale.mean) / scale.std
    covariance = law.covariance / scale.std[:, None] / scale.std
    factor = cholesky(covariance[:, m:, m:], lambda k: f"covariance of Y_1 in node {k[0]}")
    M = len(mean)
    found = []
    stops = np.append(data.starts[1:], len(data.z))
    for start, stop in zip(data.starts, stops if end is None else np.minimum(stops, end), strict=True):
        if stop <= start:
            continue
        done = int(np.searchsorted(data.before, start))
        x, y = data.z[start:stop, :m], data.z[start:stop, m:]
        table, log_likelihood = first_step(np.zeros(M), mean, covariance, factor, y[:1])
        log_p, moments = table[0, 0] + log_likelihood[0], table[0, 1:]
        first = MixtureLaw(log_p, moments[:m].T, moments[m:].T.reshape(M, m, m))
        steps = slice(done, done + len(y) - 1)
        one = np.ones((len(y) - 1, 1))
        before, after, us = [y[:-1], one], [y[:-1], y[1:], one], np.empty((len(y) - 1, 0))
        if data.further is not None:
            common, own_y, own_next = (part[steps] for part in data.further.columns)
            before, after, us = [*before, common, own_y], [*after, common, own_next], data.further.us[steps]
        of_y, of_x = (np.concatenate(parts, axis=1) for parts in (before, after))
        found.append(Stretch(np.ascontiguousarray(x), np.ascontiguousarray(y), of_y, of_x, us, first))
    return found

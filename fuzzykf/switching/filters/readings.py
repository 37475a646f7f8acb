"""What users read from a switching filter: made from its state when it is read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.gaussian import mixture_moments
from fuzzykf.switching.inference import recursion
from fuzzykf.switching.inference.belief import Belief, Source, node_state, predict_observation, predict_state

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem

__all__ = ["Readings"]


class Readings:
    """Properties of a switching filter, which owns the state that they are computed from."""

    _system: SwitchingSystem
    _belief: Belief | None
    _before: Source | None
    _predicted: bool
    _z: FloatArray
    _log_likelihood: float
    dim_x: int
    dim_z: int

    def _initial_law(self) -> InitialLaw:
        return self._system.initial()

    def _next_tables(self) -> PairTables:
        raise NotImplementedError

    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Moments of the state before the latest observation, or of the next one after predict."""
        m = self.dim_x
        if not self._prior_is_known():
            return np.full(m, np.nan), np.full((m, m), np.nan)
        source = self._source()
        if source is None:
            law = self._initial_law()
            return mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m])
        return predict_state(source.tables, source.belief)

    def _source(self) -> Source | None:
        """From what the latest observation was predicted, or the next one is after predict."""
        if self._predicted and self._belief is not None:
            return Source(self._belief, self._next_tables())
        return self._before

    def _predicted_observation(self) -> tuple[FloatArray, FloatArray]:
        source = self._source()
        law = self._initial_law() if source is None else None
        return predict_observation(source, law, self.dim_x)

    def _prior_is_known(self) -> bool:
        return True

    @property
    def x(self) -> FloatArray:
        """Estimate of the state, (dim_x, 1)."""
        if self._belief is None or self._predicted:
            return self._prior()[0][:, None]
        state = node_state(self._belief, self.dim_x)
        return recursion.posterior_mean(state, self.dim_x)[:, None]

    @property
    def P(self) -> FloatArray:
        """Covariance of the state, (dim_x, dim_x)."""
        if self._belief is None or self._predicted:
            return self._prior()[1]
        return recursion.posterior_moments(node_state(self._belief, self.dim_x), self.dim_x)[1]

    @property
    def x_prior(self) -> FloatArray:
        """Estimate before the latest observation, (dim_x, 1)."""
        return self._prior()[0][:, None]

    @property
    def P_prior(self) -> FloatArray:
        """Covariance before the latest observation, (dim_x, dim_x)."""
        return self._prior()[1]

    @property
    def nodes(self) -> FloatArray:
        """Values of the switch at the nodes, (M,)."""
        return self._system.chain.nodes

    @property
    def mu(self) -> FloatArray:
        """Probability of each node of the switch, (M,)."""
        if self._belief is None:
            return self._initial_law().probability.copy()
        state = node_state(self._belief, self.dim_x)
        if self._predicted:
            return recursion.predict_probabilities(self._next_tables(), state)
        return recursion.node_probabilities(state)

    @property
    def switch(self) -> float:
        """Most likely value of the switch, by the MPM rule of the paper."""
        return float(recursion.most_likely_switch(self._system.chain, self.mu))

    @property
    def switch_mean(self) -> float:
        """Posterior mean of the switch."""
        return float(self.mu @ self.nodes)

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones."""
        return self._log_likelihood

    @property
    def z(self) -> FloatArray:
        """The latest observation, (dim_z, 1); NaN where it is missing, and before any."""
        return self._z[:, None].copy()

    def _innovation(self) -> tuple[FloatArray, FloatArray]:
        q = self.dim_z
        if self._belief is None:
            return np.zeros(q), np.zeros((q, q))
        law = self._initial_law() if self._before is None else None
        mean, covariance = predict_observation(self._before, law, self.dim_x)
        return self._z - mean, covariance

    @property
    def y(self) -> FloatArray:
        """Innovation of the latest observation, (dim_z, 1); zero where it is missing."""
        return np.nan_to_num(self._innovation()[0])[:, None]

    @property
    def S(self) -> FloatArray:
        """Covariance of the innovation, (dim_z, dim_z): that of the predictive mixture."""
        return self._innovation()[1]

    @property
    def nis(self) -> float:
        """Normalised innovation squared, y' S^-1 y, of what was observed; 0 where nothing was."""
        if self._belief is None:
            return 0.0
        y, S = self._innovation()
        there = np.flatnonzero(~np.isnan(y))
        part = y[there]
        return float(part @ np.linalg.solve(S[there[:, None], there], part))

    @property
    def mahalanobis(self) -> float:
        """Square root of `nis`, under filterpy's name."""
        return float(np.sqrt(self.nis))

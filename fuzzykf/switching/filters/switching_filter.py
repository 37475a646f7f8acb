"""The base of the switching filters: state, checks, calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.base import Filter, FilterResult, as_many, as_observation, as_observations, check_keep, index_of
from fuzzykf.engine.selected import Stepper
from fuzzykf.errors import ParameterError, SequenceError
from fuzzykf.gaussian import mixture_moments
from fuzzykf.results import field_shapes
from fuzzykf.switching.inference import many, recursion
from fuzzykf.switching.inference.belief import (
    Belief,
    Source,
    begin,
    node_state,
    predict_observation,
    predict_state,
    proceed,
)
from fuzzykf.switching.inference.forecast import forecast
from fuzzykf.switching.inference.recursion import NodeState
from fuzzykf.switching.inference.series import SHOWN, Trajectory, run_series, summarise
from fuzzykf.switching.inference.smoother import smooth_series
from fuzzykf.switching.inference.steady import filter_steady, is_steady

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem

__all__ = ["SwitchingFilter"]


class SwitchingFilter(Stepper, Filter):
    """Exact recursive filter of a switching system.

    `OFSRFilter` and `CGOMSMFilter` make the system from a model.  Use this class
    for a system of your own: any object with `initial` and `pair_tables`.

    The first observation belongs to the initial law: there are no dynamics before it,
    and a predict before the first update only shows that law.  After an update, the next
    one needs a predict; a second predict in a row stands for a missing observation.

    Parameters
    ----------
    system : SwitchingSystem

    Attributes
    ----------
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x)
        Mean and covariance of the state given the observations so far; after `predict`,
        of the next state.
    x_prior, P_prior : ndarray
        The same before the latest observation was seen.
    mu : ndarray, shape (M,)
        Probability of each node of the switch; sums to one.
    nodes : ndarray, shape (M,)
        Values of the switch at the nodes.
    switch, switch_mean : float
        Estimate of the switch by its posterior marginal (MPM), and its posterior mean.
    log_likelihood : float
        Log-density of the latest observation given the earlier ones; 0 before any.
    y, S : ndarray, shapes (dim_z, 1) and (dim_z, dim_z)
        Innovation of the latest observation and its covariance.
    nis, mahalanobis : float
        Normalised innovation squared, y' S^-1 y, and its square root.
    """

    def __init__(self, system: SwitchingSystem) -> None:
        self._system = system
        self.dim_x, self.dim_z = system.dim_x, system.dim_z
        self._start()

    def _start(self) -> None:
        self._n = 0  # observations taken, missing ones included
        self._predicted = False
        self._belief: Belief | None = None
        self._z: FloatArray = np.full(self.dim_z, np.nan)
        self._log_likelihood = 0.0
        self._before: Source | None = None  # from which the latest observation was predicted

    def reset(self) -> None:
        """Return to the initial law, before any observation."""
        self._start()

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        return self._system.initial()

    def _next_tables(self) -> PairTables:
        return self._system.pair_tables(self._n - 1)

    # ------------------------------------------------------------------ verbs

    def predict(self) -> None:
        """Move to the time of the next observation.

        Before the first observation this shows the initial law and may be repeated.
        Later, a predict that follows a predict says that the observation in between is
        missing.
        """
        if self._predicted and self._n > 0:
            self._take(np.full(self.dim_z, np.nan))
        self._predicted = True

    def update(self, z: ArrayLike | None) -> None:
        """Take the observation ``z`` into account.

        Parameters
        ----------
        z : array_like or None
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z).  None or
            NaN where it, or a part of it, is missing; see `fuzzykf.switching.inference.missing` for
            what stays exact then.

        Raises
        ------
        SequenceError
            If no `predict` came since the last update.
        ShapeError, ParameterError
            If ``z`` has a wrong shape or is infinite.
        """
        if self._n > 0 and not self._predicted:
            raise SequenceError(
                "update: called twice without a predict in between; a switching filter takes one observation "
                "per time (use step, or stack simultaneous measurements into one z)"
            )
        y = as_observation(z, self.dim_z)
        self._take(np.full(self.dim_z, np.nan) if y is None else y)

    def _step_any(self, z: ArrayLike | None) -> FloatArray:
        """Do a step with any observation; `step` comes here unless it can be compiled."""
        y = as_observation(z, self.dim_z)  # what is refused leaves the filter as it was
        if y is not None and self._hand_over() and not np.isnan(y).any():
            estimate: FloatArray = self.step(y)
            return estimate
        self.predict()
        try:
            self._take(np.full(self.dim_z, np.nan) if y is None else y)
        except Exception:
            self._predicted = False
            raise
        return self.x

    def _hand_over(self) -> bool:
        """Let the engine take the steps to come, if their tables are constant and the state complete."""
        belief, steady_from = self._belief, self._system.steady_from
        if belief is None or not isinstance(belief.state, NodeState) or self._system.chain.is_signed:
            return False
        if steady_from is None or self._n <= steady_from or self._predicted:
            return False
        own, base = type(self), SwitchingFilter
        if own.predict is base.predict and own.update is base.update and own._take is base._take:
            return self._arm(self._next_tables(), belief.state.table, belief.window, belief.state.mass)
        return False

    @staticmethod
    def _as_belief(table: FloatArray, window: FloatArray, mass: FloatArray) -> Belief:
        """Return a complete state of the engine as a belief."""
        return Belief(NodeState(table, None, mass), window)

    #: How the engine returns what the latest observation was predicted from.
    _as_source = Source

    def _take(self, y: FloatArray) -> None:
        before = None
        if self._belief is None:
            belief, log_likelihood = begin(self._initial_law(), y)
        else:
            tables = self._next_tables()
            width = min(self._n + 1, self._system.order) * self.dim_z
            belief, log_likelihood = proceed(tables, self._belief, y, width)
            before = Source(self._belief, tables)
        self._belief, self._log_likelihood, self._before = belief, log_likelihood, before
        self._z = y
        self._n += 1
        self._predicted = False

    def filter(self, zs: Iterable[ArrayLike | None] | ArrayLike, *, keep_nodes: bool = False) -> FilterResult:
        """Filter a whole series from the initial law on.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        keep_nodes : bool
            Keep mean and covariance of the state given each node, from which
            `FilterResult.interval` takes its quantiles.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``nodes``, ``switch``,
            ``switch_mean`` and ``log_likelihood``.  The filter stays at the last
            observation, so that `step` continues.
        """
        ys = as_observations(zs, self.dim_z)
        if not keep_nodes and is_steady(self._system, ys[None]) and not np.isnan(ys).any():
            return self._filter_steady(ys, index_of(zs))
        trajectory = run_series(self._system, ys)
        self._adopt(trajectory, ys)
        return summarise(
            self._system.chain, trajectory, self.dim_x, keep_nodes=keep_nodes, index=index_of(zs)
        )

    def _filter_steady(self, ys: FloatArray, index: object) -> FilterResult:
        """Let the engine filter a complete series at once."""
        shapes = field_shapes(SHOWN, state=self.dim_x, node=len(self._system.chain))
        out = many.allocate((1, len(ys)), shapes)
        before, last = filter_steady(self._system, ys[None], out)
        self._start()
        self._n, self._belief = len(ys), Belief(NodeState(last), ys[-1].copy())
        if len(ys) > 1:
            belief = Belief(NodeState(before), ys[-2].copy())
            self._before = Source(belief, self._system.pair_tables(self._n - 2))
        self._z, self._log_likelihood = ys[-1].copy(), float(out["log_likelihood"][0, -1])
        fields = {name: values[0] for name, values in out.items()}
        return FilterResult(**fields, nodes=self._system.chain.nodes, index=index)

    def _adopt(self, trajectory: Trajectory, ys: FloatArray) -> None:
        """Stay at the last observation of a series."""
        self._start()
        if len(ys):
            self._n, self._belief, self._before = len(ys), trajectory.last, trajectory.before
            self._z, self._log_likelihood = ys[-1].copy(), float(trajectory.log_likelihood[-1])

    def smooth(self, zs: Iterable[ArrayLike | None] | ArrayLike, *, keep_nodes: bool = False) -> FilterResult:
        """Estimate every state of a series from all of it.

        Exact for complete observations, see `fuzzykf.switching.inference.smoother`; the filter
        stays at the last observation.

        Parameters
        ----------
        zs, keep_nodes
            As in `filter`.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``mu``, ``nodes``, ``switch``, ``switch_mean``, the most
            likely ``switch_path``, and the ``log_likelihood`` of the filter.
        """
        ys = as_observations(zs, self.dim_z)
        trajectory = run_series(self._system, ys, priors=False)
        self._adopt(trajectory, ys)
        return smooth_series(self._system, trajectory, ys, keep_nodes=keep_nodes, index=index_of(zs))

    def filter_many(
        self,
        zs: ArrayLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        *,
        threads: int = 1,
    ) -> FilterResult:
        """Filter many series, each from the initial law on; the filter stays as it is.

        Complete series go side by side, many times faster than one after the other; a
        series with gaps, or padded at its end, goes alone.

        Parameters
        ----------
        zs : array_like, shape (series, n, dim_z)
            Or (series, n) if ``dim_z`` is 1; NaN where missing.
        keep : sequence of str
            Which fields to store: names among ``x``, ``P``, ``x_prior``, ``P_prior``,
            ``mu``, ``switch``, ``switch_mean``, ``log_likelihood``.
        threads : int
            How many threads the compiled engine shares complete series among; results are
            the same to the bit.  NumPy uses one.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series.
        """
        if threads < 1:
            raise ParameterError(f"threads: got {threads}, expected at least 1")
        names = check_keep(keep, SHOWN)
        series = as_many(zs, self.dim_z)
        out = many.filter_series(self._system, series, names, lambda one: self.copy().filter(one), threads)
        return FilterResult(**out, nodes=self.nodes if "mu" in out else None)

    def forecast(self, steps: int) -> FilterResult:
        """Predict states and observations ahead; the filter stays where it is.

        Means and covariances are exact if the window of the latest observations is known.

        Parameters
        ----------
        steps : int
            Number of steps ahead of the latest observation, whether `predict` was called since
            or not.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``z_prior``, ``S`` (mean and covariance of the
            observations), ``mu``, ``nodes``, ``switch`` and ``switch_mean``.
        """
        return forecast(self._system, self._belief, self._n, steps)

    # ------------------------------------------------------------------ what users read

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

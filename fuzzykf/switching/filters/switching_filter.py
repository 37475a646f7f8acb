"""The base of the switching filters: state, checks, calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.base import Filter, FilterResult, as_many, as_observation, as_observations, check_keep, index_of
from fuzzykf.engine.selected import Stepper
from fuzzykf.errors import ParameterError, SequenceError
from fuzzykf.results import field_shapes
from fuzzykf.switching.filters.readings import Readings
from fuzzykf.switching.inference import many
from fuzzykf.switching.inference.belief import Belief, Source, begin, proceed
from fuzzykf.switching.inference.recursion import NodeState
from fuzzykf.switching.inference.series import SHOWN, Trajectory, run_series, summarise
from fuzzykf.switching.inference.steady import filter_steady, is_steady

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem

__all__ = ["SwitchingFilter"]


class SwitchingFilter(Stepper, Readings, Filter):
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
        from fuzzykf.switching.inference.smoother import smooth_series

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
        from fuzzykf.switching.inference.forecast import forecast

        return forecast(self, steps)

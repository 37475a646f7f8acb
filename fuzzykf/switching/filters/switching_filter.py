"""The base of the switching filters: state, checks, calls."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from fuzzykf.base import (
    MOST_THREADS,
    Filter,
    FilterResult,
    as_observation,
    as_observations,
    check_keep,
    index_of,
)
from fuzzykf.errors import ParameterError, SequenceError
from fuzzykf.fixed_lag import as_lag
from fuzzykf.gaussian import as_count, as_flag
from fuzzykf.immutable import Unassignable
from fuzzykf.labels import check_many, labels_of, match_row, match_series
from fuzzykf.many import read_many, stacked
from fuzzykf.overrides import ACCESS, VERBS, is_patched, lookups, overrides
from fuzzykf.reprs import WIDTH, shown, value_text
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.filters.driver import NOWHERE, driver_of, read_step
from fuzzykf.switching.filters.looking_back import SwitchingWayBack, smooth_series
from fuzzykf.switching.filters.stepper import STREAMS, Stepper
from fuzzykf.switching.filters.walk import walk
from fuzzykf.switching.inference.exact import EXACT
from fuzzykf.switching.inference.forecast import forecast
from fuzzykf.switching.inference.method import Method
from fuzzykf.switching.inference.mixture import Mixture, Source, most_likely_key, most_likely_switch
from fuzzykf.switching.inference.series import (
    FOUND,
    SHOWN,
    Stand,
    Trajectory,
    class_weights_of,
    result_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Iterator

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.many import ManySeries
    from fuzzykf.switching.dynamics.pairs import Ahead, InitialLaw, PairTables, SwitchingSystem

__all__ = ["READ", "SwitchingFilter"]

#: The verbs, what they call, what is read after each step of a series, and how anything is read and written.
READ = (*VERBS, *ACCESS, "_take", "_initial_law", "_next_tables", "_ahead", *SHOWN)


class SwitchingFilter(Stepper, Filter):
    """Recursive filter of a switching system.

    `OFSRFilter` and `CGOMSMFilter` are subclasses that take a model.  Use this class
    for your own system: any object with the methods of `SwitchingSystem`.

    The initial law is that of the first observation: no dynamics precede it, and a predict
    before the first update has no effect.  Every later update needs a predict before it;
    two predicts in a row mean a missing observation.

    Parameters
    ----------
    system : SwitchingSystem
        Dynamics of switch, state and observation.
    method : Method
        Filtering method; by default the exact one, which requires that Y alone is Markov given the switch.

    Attributes
    ----------
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x)
        Mean and covariance of the state given the observations so far; after `predict`,
        of the next state.
    x_prior, P_prior : ndarray
        Mean and covariance before the latest observation.
    mu : ndarray, shape (M,)
        Probability of each node of the switch; sums to one.
    nodes : ndarray, shape (M,)
        Values of the switch at the nodes.
    class_weights : ndarray, shape (K,)
        Expected share of each class in the value of the switch.
    switch, switch_mean : float
        Most likely value of the switch (maximum of the posterior marginal, MPM), and its posterior mean.
        For more than two classes, values are class weights: ``nodes`` is (M, K), ``switch`` is (K,), and
        ``switch_mean`` is None.
    log_likelihood : float
        Log-density of the latest observation given the earlier ones; 0 before any.
    y, S : ndarray, shapes (dim_z, 1) and (dim_z, dim_z)
        Innovation of the latest observation and its covariance.
    nis, mahalanobis : float
        Normalised innovation squared, y' S^-1 y, and its square root.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FadeLaw
    >>> from fuzzykf.switching import SwitchingFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.broadcast_to(np.block([[z, 0.8 * z], [0.8 * z, z]]), (2, 2, 4, 4))
    >>> model = CGOFMSModel(
    ...     FadeLaw.between(40, 10), [[0.0, 3.0], [0.0, 0.0]], pair, dim_x=1
    ... )
    >>> f = SwitchingFilter(model.placed(n_nodes=5))
    >>> f.step(2.5).shape, f.mu.shape
    ((1, 1), (12,))
    """

    # filterpy's users assign them; here that would say nothing
    F, H, Q, R, B, M = (Unassignable("its model has the parameters: make another one") for _ in range(6))

    def __init__(self, system: SwitchingSystem, method: Method = EXACT) -> None:
        if not hasattr(system, "pair_tables"):
            raise ParameterError(
                f"system: got {type(system).__name__}, expected a SwitchingSystem (a model has placed())"
            )
        self._system, self._method, self._driver = system, method, driver_of(type(self), system, method)
        self.dim_x, self.dim_z = system.dim_x, system.dim_z
        self._start()

    def _start(self) -> None:
        self._n = 0  # observations taken, missing ones included
        self._predicted = False
        self._mixture: Mixture | None = None
        self._z = np.full(self.dim_z, np.nan)
        self._log_likelihood = 0.0
        self._before: Source | None = None  # from which the latest observation was predicted
        self._steady: PairTables | None = None  # the tables of all steps to come, once they are constant
        self._onwards = NOWHERE
        self.__dict__.pop("_sequel", None)

    def reset(self) -> None:
        """Return to the initial law, before any observation."""
        self._start()

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        return self._system.initial()

    def _next_tables(self) -> PairTables:
        if self._driver is not None:
            driven: PairTables = self._driver.tables(self._onwards)
            return driven
        if self._steady is not None:
            return self._steady
        tables, steady_from = self._system.pair_tables(self._n - 1), self._system.steady_from
        if steady_from is not None and self._n > steady_from:
            self._steady = tables
        return tables

    # ------------------------------------------------------------------ verbs

    def predict(self, u: ArrayLike | None = None) -> None:
        """Move to the time of the next observation.

        Before the first observation, this shows the initial law and may be repeated.
        Later, two predicts in a row mean that the observation in between is missing.

        Parameters
        ----------
        u : array_like, shape (k,) or (k, 1), optional
            Inputs at that time, if the model has inputs; a number if there is only one.  Not used before the
            first observation.

        Raises
        ------
        ShapeError, ParameterError
            If ``u`` has the wrong shape, is not finite, is missing, or the model has no inputs.
        """
        told = None if u is None and self._driver is None else read_step(self._driver, u, self._n)
        if self._predicted and self._n > 0:
            self._take(np.full(self.dim_z, np.nan))
        self._predicted = True
        if told is not None:
            self._onwards = replace(self._onwards, u=told)

    def update(self, z: Numbers) -> None:
        """Take the observation ``z`` into account.

        Parameters
        ----------
        z : array_like or None
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z).  None if
            it is missing, NaN for a missing component.

        Raises
        ------
        SequenceError
            If `predict` was not called since the last update.
        ShapeError, ParameterError
            If ``z`` has the wrong shape or is infinite.
        """
        if self._n > 0 and not self._predicted:
            raise SequenceError(
                "update: called twice without a predict in between; a switching filter takes one observation "
                "per time (use step, or stack simultaneous measurements into one z)"
            )
        z = z if isinstance(z, float | np.ndarray) else match_row(z, labels_of(self))
        y = as_observation(z, self.dim_z)
        self._take(np.full(self.dim_z, np.nan) if y is None else y)

    def _step_any(self, z: Numbers, u: ArrayLike | None = None) -> FloatArray:
        """Do a step with any observation; `step` comes here unless it can be compiled."""
        z = z if isinstance(z, float | np.ndarray) else match_row(z, labels_of(self))
        y = as_observation(z, self.dim_z)  # what is refused leaves the filter as it was
        if u is None and self._hand_over():
            estimate: FloatArray = self.step(np.full(self.dim_z, np.nan) if y is None else y)
            return estimate
        return self._step_by_verbs(z, u)

    def _step_by_verbs(self, z: Numbers, u: ArrayLike | None = None) -> FloatArray:
        """Predict and update; an error leaves the filter as it was."""
        with self._as_it_was_on_error():
            self.predict(*(() if u is None else (u,)))
            self.update(z)
        return self.x

    def _is_plain(self) -> bool:
        """Whether the engine may take steps and series, the verbs being those of fuzzykf."""
        return not (type(self)._overrides() or is_patched(self))

    @classmethod
    def _overrides(cls) -> bool:
        """Whether a subclass, or who patched the class, has changed a verb or what it calls or shows."""
        return overrides(cls, _OWN)

    #: What a verb changes.  It stands in the stepper where that is compiled, and not in ``__dict__``.
    _STATE: ClassVar[tuple[str, ...]] = (
        "_n",
        "_predicted",
        "_mixture",
        "_z",
        "_log_likelihood",
        "_before",
        "_steady",
    )

    @contextmanager
    def _as_it_was_on_error(self) -> Iterator[None]:
        put_back = self._kept()
        try:
            yield
        except BaseException:
            put_back()
            raise

    def _kept(self) -> Callable[[], None]:
        """Return what puts attributes and state of now back."""
        attributes, state = self.__dict__.copy(), {name: getattr(self, name) for name in self._STATE}

        def put_back() -> None:
            self.__dict__.clear()
            self.__dict__.update(attributes)
            for name, value in state.items():
                setattr(self, name, value)

        return put_back

    def _set_aside(self) -> Callable[[], None]:
        put_back = self._kept()  # the state is of values that no verb writes into
        super()._set_aside()
        return put_back

    if not STREAMS:
        step = _step_any

    def _hand_over(self) -> bool:
        """Let the engine take the steps to come, if their tables are constant."""
        known, steady_from = self._mixture, self._system.steady_from
        if not STREAMS or known is None or not self._method.streams:
            return False
        if steady_from is None or self._n <= steady_from or self._predicted or self._system.chain.is_signed:
            return False
        return self._is_plain() and self._arm(self._next_tables(), known, self._method.every_pair)

    @staticmethod
    def _as_mixture(table: FloatArray, window: FloatArray, mass: FloatArray | None) -> Mixture:
        """Return a complete state of the engine."""
        return Mixture(table, window, None, mass)

    #: How the engine returns what the latest observation was predicted from.
    _as_source = Source

    def _take(self, y: FloatArray) -> None:
        before, onwards = None, self._onwards
        if self._driver is not None:
            onwards = self._driver.after(onwards, self._mixture, y)
        if self._mixture is None:
            mixture, log_likelihood = self._method.first(self._initial_law(), y)
        else:
            tables: Any = self._next_tables()
            if onwards.past is not None:  # whoever looks back finds what stood for what is missing
                tables = tables.with_next(onwards.past[0], onwards.spread)
            width = min(self._n + 1, self._system.order) * self.dim_z
            mixture, log_likelihood = self._method.advance(tables, self._mixture, y, width)
            before = Source(self._mixture, tables)
        self._mixture, self._log_likelihood, self._before = mixture, log_likelihood, before
        self._z = y
        self._n += 1
        self._predicted, self._onwards = False, onwards

    def filter(
        self,
        zs: ManyNumbers,
        *,
        keep_nodes: bool = False,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the initial law, or with ``resume`` from the current state.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.  From a table,
            the columns on which the model was learned are taken, if it knows their names.
        keep_nodes : bool
            Store mean and covariance of the state given each node; `FilterResult.interval` then
            returns quantiles of their mixture.
        resume : bool
            Continue from the current state, as `step` would.  Filtering a series in parts then gives
            exactly the result for the whole.  A `predict` since the latest observation counts as a
            missing observation.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``nodes``, ``switch``,
            ``switch_mean`` and ``log_likelihood``.  The filter ends at the last
            observation, so `step` continues the series.

        Raises
        ------
        ShapeError, ParameterError
            If ``zs`` has the wrong shape, infinite values, other columns than the model, or another time
            step.
        """
        zs = self._named(zs)
        ys, index = as_observations(zs, self.dim_z), index_of(zs)
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        if resume:
            self._check_next(index)
        sequel = self.__dict__.get("_sequel") if resume else None
        if self._is_plain():
            stand = self._stand() if resume else None
            states: bool | Literal["nodes"] = keep_nodes and "nodes"
            trajectory = self._method.run(self._system, ys, FOUND, states=states, stand=stand)
            if len(ys) or not resume:
                self._adopt(trajectory, ys, stand)
        else:
            trajectory, _ = self._by_verbs(ys, states=keep_nodes, resume=resume)
        if sequel is not None:  # the count of observations goes on as well
            self._sequel = sequel
        if index is not None:
            self._follow(index)
            warn_of_steps(index)
        result = result_of(self._system.chain, trajectory, self.dim_x, keep_nodes, index)
        return result.with_coords(zs) if hasattr(zs, "coords") else result

    def _named(self, zs: Any, argument: str = "zs") -> Any:
        """Return the observations of a series, by the names that the model knows of them.

        Every verb that is given a series begins here.  Arrays go by position, see
        `fuzzykf.labels.match_series`.
        """
        return zs if isinstance(zs, np.ndarray) else match_series(zs, labels_of(self), self.dim_z, argument)

    def _read_many(self, zs: Any, by: Any) -> ManySeries:
        labels = labels_of(self)
        if by is None:  # with a key each series is looked at by itself
            check_many(zs, labels)
        return read_many(zs, self.dim_z, by, self._named if labels else None)

    def _by_verbs(
        self, ys: FloatArray, *given: Any, states: bool = False, resume: bool = False
    ) -> tuple[Trajectory, FloatArray]:
        """Filter a series by the verbs, which somebody has changed; an error leaves the filter as it was."""
        with self._as_it_was_on_error():
            if not resume:
                self.reset()
            return walk(self, self._system, ys, states, *given)

    def _stand(self) -> Stand | None:
        """Return where the filter stands; None before any observation, where the initial law is."""
        return None if self._mixture is None else Stand(self._n, self._mixture, self._predicted)

    def _adopt(self, trajectory: Trajectory, ys: FloatArray, stand: Stand | None = None) -> None:
        """Stay at the last observation of a series, which began at ``stand``."""
        self._start()
        if len(ys):
            before = 0 if stand is None else stand.n + stand.skips
            self._n, self._mixture, self._before = before + len(ys), trajectory.last, trajectory.before
            self._z, self._log_likelihood = ys[-1].copy(), float(trajectory.fields["log_likelihood"][-1])

    def smooth(self, zs: ManyNumbers, *, keep_nodes: bool = False) -> FilterResult:
        """Smooth a series: estimate every state given all observations.

        Exact for complete observations and gaps of a single step.  The filter ends at the last
        observation.

        Parameters
        ----------
        zs, keep_nodes
            As in `filter`.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``mu``, ``nodes``, ``switch``, ``switch_mean``, the most
            likely ``switch_path``, and the ``log_likelihood`` of the filter.

        Raises
        ------
        ParameterError
            If the method has no smoother, or a subclass overrides `predict` or `update` and does more than
            replace observations (an outlier by NaN, for instance).
        """
        return smooth_series(self, zs, keep_nodes)

    def smooth_lag(self, zs: ManyNumbers, lag: int, *, keep_nodes: bool = False) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given the observations up to ``lag`` steps later.

        As exact as `smooth`.  The filter ends at the last observation.

        Parameters
        ----------
        zs, keep_nodes
            As in `filter`.
        lag : int
            Number of steps to look ahead, at least 0: row n is the estimate given the observations up to
            n + lag, or to the end.  0 is `filter`; the length of the series is `smooth`.

        Returns
        -------
        FilterResult
            As from `smooth`, without the most likely path.

        Raises
        ------
        ParameterError
            If ``lag`` is not an integer of at least 0; as from `smooth`.

        See Also
        --------
        fuzzykf.FixedLag : The same step by step.
        """
        return smooth_series(self, zs, keep_nodes, as_lag(lag))

    _way_back = SwitchingWayBack  # of `fuzzykf.FixedLag`

    @property
    def has_smoother(self) -> bool:
        """Whether `smooth` is available."""
        return getattr(type(self._method), "smooth", Method.smooth) is not Method.smooth

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        *,
        by: Hashable | None = None,
        threads: int = 1,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each from the initial law or, with ``resume``, from the current state.

        The filter itself does not change.  Series of equal length are filtered together, which is many
        times faster than one by one; with the compiled engine those with gaps are, too.  Where a subclass
        has changed a method, each series is filtered alone.

        Parameters
        ----------
        zs : array_like, DataFrame, DataArray, list, tuple or mapping
            Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1; NaN where missing.  Or a frame with a
            column for each series (pairs (series, component) if ``dim_z`` is not 1), or a list or mapping of
            series of any lengths, each as `filter` takes it.
        keep : sequence of str
            Fields to store, from ``x``, ``P``, ``x_prior``, ``P_prior``,
            ``mu``, ``class_weights``, ``switch``, ``switch_mean``, ``log_likelihood``.
        by : hashable, optional
            Column (or index level) that names the series of each row, if the frame holds all series one after
            another.
        threads : int
            Number of threads of the compiled engine for complete series; results do not depend on it.  The
            NumPy engine uses one.
        resume : bool
            As in `filter`.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.  Names and index are kept, see `FilterResult.to_dataframe`.
        """
        threads = as_count("threads", threads, 1, MOST_THREADS)
        names = check_keep(keep, SHOWN)
        many = self._read_many(zs, by)
        resume = as_flag("resume", resume)
        stand = self._stand() if resume else None

        def several(series: FloatArray, _: Any) -> dict[str, FloatArray]:
            if self._is_plain() or not len(series):
                return self._method.run_many(self._system, series, names, threads, stand)
            given = {"resume": True} if resume else {}
            return stacked(self._filter_each(series, [given] * len(series)), names)

        return many.filtered(several, self.nodes)

    def forecast(self, steps: int) -> FilterResult:
        """Forecast states and observations; the filter does not change.

        Means and covariances are exact if the latest observations are complete.

        Parameters
        ----------
        steps : int
            Number of steps after the latest observation, whether or not `predict` was called since.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``z_prior``, ``S`` (mean and covariance of the
            observations), ``mu``, ``nodes``, ``switch`` and ``switch_mean``.
        """
        found = forecast(self._method, self._system, self._mixture, self._n, steps)
        return replace(found, index=self._index_ahead(steps))

    def _position(self) -> int:
        return self._n

    def _passed_since(self, position: int) -> int:
        return self._n - position

    # ------------------------------------------------------------------ what users read

    def _ahead(self) -> Ahead:
        """Return what was known before the latest observation or, after predict, is of the next time."""
        if self._predicted and self._mixture is not None:
            return self._method.ahead(self._next_tables(), self._mixture)
        if self._before is not None:
            return self._method.ahead(self._before.tables, self._before.mixture)
        return self._initial_law().ahead(self.dim_x)

    @property
    def x(self) -> FloatArray:
        """Estimate of the state, (dim_x, 1)."""
        if self._mixture is None or self._predicted:
            return self.x_prior
        return self._mixture.mean(self.dim_x)[:, None]

    @property
    def P(self) -> FloatArray:
        """Covariance of the state, (dim_x, dim_x)."""
        if self._mixture is None or self._predicted:
            return self.P_prior
        return self._mixture.moments(self.dim_x)[1]

    @property
    def x_prior(self) -> FloatArray:
        """Estimate before the latest observation, (dim_x, 1)."""
        return self._ahead().x[:, None]

    @property
    def P_prior(self) -> FloatArray:
        """Covariance before the latest observation, (dim_x, dim_x)."""
        return self._ahead().P

    @property
    def nodes(self) -> FloatArray:
        """Values of the switch at the nodes, (M,), or class weights (M, K) for more than two classes.

        Several nodes may share a value, see `SwitchChain.by_value`.
        """
        return self._system.chain.nodes

    @property
    def mu(self) -> FloatArray:
        """Probability of each node of the switch, (M,)."""
        if self._mixture is None or self._predicted:
            return self._ahead().mu
        return self._mixture.probabilities

    @property
    def class_weights(self) -> FloatArray:
        """Expected share of each class in the value of the switch, (K,)."""
        return class_weights_of(self._system.chain, self.mu)

    @property
    def switch(self) -> Any:
        """Most likely value of the switch, by the MPM rule; (K,) for more than two classes."""
        found = most_likely_switch(self._system.chain, self.mu)
        return float(found) if found.ndim == 0 else found

    @property
    def _switch_key(self) -> float:
        """Number by which results keep the value of the switch, see `SwitchChain.keys`."""
        chain = self._system.chain
        return float(self.switch) if chain.nodes.ndim == 1 else float(most_likely_key(chain, self.mu))

    @property
    def switch_mean(self) -> float | None:
        """Posterior mean of the switch; None for more than two classes, see `class_weights`."""
        return float(self.mu @ self.nodes) if self.nodes.ndim == 1 else None

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones."""
        return self._log_likelihood

    @property
    def z(self) -> FloatArray:
        """The latest observation, (dim_z, 1); NaN where missing, and before the first."""
        return self._z[:, None].copy()

    def _innovation(self) -> tuple[FloatArray, FloatArray]:
        q = self.dim_z
        if self._mixture is None:
            return np.zeros(q), np.zeros((q, q))
        if self._before is None:
            ahead = self._initial_law().ahead(self.dim_x)
        else:
            ahead = self._method.ahead(self._before.tables, self._before.mixture)
        return self._z - ahead.z, ahead.S

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
        """Normalised innovation squared, y' S^-1 y, of the observed components; 0 if there are none."""
        if self._mixture is None:
            return 0.0
        y, S = self._innovation()
        there = np.flatnonzero(~np.isnan(y))
        part = y[there]
        return float(part @ np.linalg.solve(S[there[:, None], there], part))

    @property
    def mahalanobis(self) -> float:
        """Square root of `nis`, as in filterpy."""
        return float(np.sqrt(self.nis))

    # ------------------------------------------------------------------ copies and pickles

    def __getstate__(self) -> dict[str, Any]:
        """Return the state by name, whichever engine owns it."""
        owned = ("_n", "_predicted", "_mixture", "_before", "_z", "_log_likelihood")
        return {**self.__dict__, **{name: getattr(self, name) for name in owned}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the state over, for whichever engine owns it."""
        for name, value in state.items():
            setattr(self, name, value)

    @shown
    def __repr__(self) -> str:
        ahead = ", predicted one step ahead" if self._predicted and self._n else ""
        head = (
            f"{type(self).__name__}(dim_x={self.dim_x}, dim_z={self.dim_z}): "
            f"{len(self._system.chain)} nodes, observations seen: {self._n}{ahead}"
        )
        model = getattr(self, "model", None)
        return head if model is None else f"{head}\n  model: {value_text(model, 2 * WIDTH)}"


#: What the verbs are, before anybody changes it.
_OWN = lookups(SwitchingFilter, READ)

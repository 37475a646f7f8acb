"""The filter of switching state-space models."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.base import (
    MOST_THREADS,
    FilterResult,
    as_observation,
    as_observations,
    check_keep,
    index_of,
)
from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.fixed_lag import as_lag
from fuzzykf.gaussian import as_choice, as_count, as_flag
from fuzzykf.hindsight import warn_of_hindsight
from fuzzykf.immutable import Unassignable, keeps
from fuzzykf.io import decode, encode
from fuzzykf.labels import labels_of, match_row
from fuzzykf.many import stacked
from fuzzykf.observations import check_ahead, check_aligned
from fuzzykf.overrides import lookups, overrides
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.filters.inputs import (
    NOTHING,
    Inputs,
    Told,
    read_control,
    read_controls,
    read_controls_of_many,
    read_each,
    read_seen,
)
from fuzzykf.switching.filters.looking_back import smooth_trajectory
from fuzzykf.switching.filters.saved import SavedFilter
from fuzzykf.switching.filters.switching_filter import READ, SwitchingFilter
from fuzzykf.switching.inference.forecast import MOST_STEPS, forecast
from fuzzykf.switching.inference.mixture import Source
from fuzzykf.switching.inference.registry import METHODS
from fuzzykf.switching.inference.series import FOUND, SHOWN, check_explained, result_of, smoothed_result
from fuzzykf.switching.models.hard import CGOMSModel
from fuzzykf.switching.state_space.model import SwitchingStateSpace

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.switching.dynamics.nodes import NodeLaw
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

__all__ = ["SwitchingKalmanFilter"]

#: Methods of filtering a state-space model.
CHOICES = ("imm", "gpb2")


@keeps("model", "method", "n_nodes", "rule")
class SwitchingKalmanFilter(SavedFilter):
    """Interacting Kalman filters on the nodes of a hard or fuzzy switch.

    The initial law is that of the first observation; a control given with it is not used.

    Parameters
    ----------
    model : SwitchingStateSpace or CGOMSModel
        A `CGOMSModel` must come from `CGOMSModel.from_pairwise`; it is filtered in pairwise form, without
        ``u``, ``R`` or ``H``.
    method : {"imm", "gpb2"}
        "imm" merges the estimates that lead to a node before each step.  "gpb2" updates every pair of nodes
        and merges afterwards; it is slower, has the better likelihood, and is more accurate where offsets
        or gains fade.
    n_nodes : int
        Number of nodes within each fade or edge; ignored for a chain or a transition matrix.
    rule : {"cell", "midpoint", "gauss", "product"}
        How the law is discretised, see `FuzzyMarkovLaw.discretize`.

    Raises
    ------
    ParameterError
        If ``model`` is of another class, the law cannot have that many nodes, or an option is unknown.
    NotStableError
        If the initial state is to be stationary, but no stationary state exists.

    Notes
    -----
    Neither method is exact: the number of components of the posterior grows with each step.  Missing
    observations and components need no further approximation.  For a pairwise model, "gpb2" is exact if
    `CGOMSModel.exactness` says so and nothing is missing; "imm" is exact if the state does not act on the
    next observation.  If the covariance of an observation is
    singular, a `NotPositiveDefiniteError` names the node.

    See Also
    --------
    fuzzykf.switching.SwitchingFilter : Methods and attributes.
    KnownSwitchFilter : Lower bound of the error.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FadeLaw, SwitchingKalmanFilter, SwitchingStateSpace
    >>> model = SwitchingStateSpace(
    ...     FadeLaw.between(60, 20),
    ...     F=0.99,
    ...     b=[0.1],
    ...     Q=0.09,
    ...     H=[[[1.0]], [[0.3]]],
    ...     R=0.25,
    ...     x0=[10.0],
    ...     P0=4.0,
    ... )
    >>> f = SwitchingKalmanFilter(model)
    >>> f.step(9.5).shape, f.mu.shape
    ((1, 1), (12,))
    >>> truth = model.simulate(200, np.random.default_rng(1))
    >>> result = f.filter(truth.y)
    >>> result.x.shape, result.class_weights.shape
    ((200, 1), (200, 2))
    """

    model: SwitchingStateSpace | CGOMSModel
    _system: Any  # a SpaceSystem or a JointSystem

    H, R = (Unassignable("give it to update, step or filter, or make another model") for _ in range(2))

    def __init__(
        self,
        model: SwitchingStateSpace | CGOMSModel,
        *,
        method: Literal["imm", "gpb2"] = "imm",
        n_nodes: int = 5,
        rule: str = "cell",
    ) -> None:
        if not isinstance(model, SwitchingStateSpace | CGOMSModel):
            raise ParameterError(
                f"model: got {type(model).__name__}, expected a SwitchingStateSpace (from_filters makes one "
                "of Kalman filters), or a CGOMSModel made by from_pairwise"
            )
        as_choice("method", method, CHOICES)
        self.model, self.method, self.n_nodes, self.rule = model, method, n_nodes, rule
        system: Any
        if isinstance(model, CGOMSModel):
            system, name = model.jointly(n_nodes, rule), f"joint_{method}"
        else:
            system, name = model.placed(n_nodes, rule), method
        super().__init__(system, METHODS[name])

    @property
    def _mix(self) -> str | None:
        """How an R that is told is mixed; None where none can be told."""
        return self.model.form.mix if isinstance(self.model, SwitchingStateSpace) else None

    def _options(self) -> dict[str, Any]:
        # where there are no fewer classes than nodes none lie between, whatever is asked for
        n_nodes = int(self.n_nodes) if self.n_nodes < len(self._system.chain) else 0
        return {"method": self.method, "n_nodes": n_nodes, "rule": self.rule}

    def _start(self) -> None:
        super()._start()
        self._next = NOTHING  # of the step to the next observation, and how that is seen while it is taken
        self._latest = NOTHING  # of that to the latest one

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        law: NodeLaw = self._system.initial()
        told = self._next if self._mixture is None else self._latest
        return law if told.H is None and told.R is None else law.seen_by(told.H, told.R)

    def _next_tables(self) -> PairTables:
        tables: Any = super()._next_tables()
        told = self._next
        changed = {name: one for name, one in (("H", told.H), ("R", told.R)) if one is not None}
        if told.u is not None:
            changed["b"] = tables.b + self._system.B @ told.u
        found: PairTables = replace(tables, **changed) if changed else tables
        return found

    # ------------------------------------------------------------------ verbs

    def predict(self, u: ArrayLike | None = None) -> None:
        """Move to the time of the next observation.

        Before the first observation, this has no effect and may be repeated.  Later, two predicts in a row
        mean that the observation in between is missing.

        Parameters
        ----------
        u : array_like, shape (k,) or (k, 1), optional
            Control that acts on this step; a number if there is only one.  By default none.

        Raises
        ------
        ShapeError, ParameterError
            If ``u`` has the wrong shape, is not finite, or the model has no ``B``.
        """
        control = read_control(u, self._system)
        super().predict()
        self._next = Told(control) if self._n else NOTHING

    def update(self, z: Numbers, R: Any = None, H: Any = None) -> None:
        """Take the observation ``z`` into account.

        Parameters
        ----------
        z : array_like or None
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z).  None if it is missing, NaN
            for a missing component.
        R : array_like, shape (q, q) or (K, q, q), or callable, optional
            Used instead of ``R`` of the model; a number means that multiple of the identity.
        H : array_like, shape (q, m) or (K, q, m), or callable, optional
            Used instead of ``H`` of the model.

        Raises
        ------
        SequenceError
            If `predict` was not called since the last update.
        ShapeError, ParameterError
            If ``z``, ``R`` or ``H`` has the wrong shape or is infinite.
        NotPositiveDefiniteError
            If ``R`` is indefinite, or the covariance of the observation is singular at a node.
        """
        noise, seen = (read_seen(*one, self._system, self._mix) for one in (("R", R), ("H", H)))
        before = self._next
        self._next = Told(before.u, seen, noise)
        try:
            super().update(z)
        except BaseException:
            self._next = before
            raise

    def _take(self, y: FloatArray) -> None:
        super()._take(y)
        self._latest, self._next = self._next, NOTHING

    def step(self, z: Numbers, u: ArrayLike | None = None, R: Any = None, H: Any = None) -> FloatArray:
        """Predict, then update with ``z``; an error leaves the filter as it was.

        Parameters
        ----------
        z, R, H
            As in `update`.
        u
            As in `predict`.

        Returns
        -------
        ndarray, shape (dim_x, 1)
        """
        if u is None and R is None and H is None:
            x: FloatArray = super().step(z)
            self._latest = NOTHING
            return x
        z = z if isinstance(z, float | np.ndarray) else match_row(z, labels_of(self))
        as_observation(z, self.dim_z)  # what is refused leaves the filter as it was
        look = {name: one for name, one in (("R", R), ("H", H)) if one is not None}
        with self._as_it_was_on_error():
            self.predict(*(() if u is None else (u,)))
            self.update(z, **look)
        return self.x

    @classmethod
    def _overrides(cls) -> bool:
        return SwitchingFilter._overrides() or overrides(cls, _OWN)

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        keep_nodes: bool = False,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the initial law, or with ``resume`` from the current state.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : array_like, shape (n, k), or (n,) if there is one control, optional
            Controls: ``us[n]`` acts on the step to observation n; ``us[0]`` is not used unless the filter
            resumes.  None in a list means no control.
        Rs, Hs : sequence of n, optional
            Passed to `update` one by one; None means that of the model.
        keep_nodes, resume : bool
            As in `SwitchingFilter.filter`.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``nodes``, ``class_weights``, ``switch``,
            ``switch_mean`` and ``log_likelihood``.  The filter ends at the last observation, so
            `step` continues the series.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; if an argument does not have one value per observation.  The
            filter is then unchanged.
        """
        zs = self._named(zs)
        check_aligned(zs=zs, us=us, Rs=Rs, Hs=Hs)
        ys, index = as_observations(zs, self.dim_z), index_of(zs)
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        if resume:
            self._check_next(index)
        sequel = self.__dict__.get("_sequel") if resume else None
        stand = self._stand() if resume else None
        inputs = self._read(len(ys), us, Rs, Hs, begins=stand is None)
        if self._is_plain():
            system = self._driven(inputs, stand, len(ys))
            trajectory = self._method.run(system, ys, FOUND, states=keep_nodes, stand=stand)
            if len(ys) or not resume:
                self._adopt(trajectory, ys, stand)
                if len(ys):
                    self._latest = inputs.told(-1)
        else:
            given = _by_step(inputs, Rs, Hs, len(ys))
            trajectory, _ = self._by_verbs(ys, *given, states=keep_nodes, resume=resume)
        if sequel is not None:  # the count of observations goes on as well
            self._sequel = sequel
        if index is not None:
            self._follow(index)
            warn_of_steps(index)
        result = result_of(self._system.chain, trajectory, self.dim_x, keep_nodes, index)
        return result.with_coords(zs) if hasattr(zs, "coords") else result

    def smooth(
        self,
        zs: ManyNumbers,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        weights: Literal["density", "kim"] = "density",
        keep_nodes: bool = False,
    ) -> FilterResult:
        """Smooth a series: estimate every state given all observations.

        Approximate, like the filter: estimates at each node are merged after each backward step.  If ``H`` or
        ``d`` switches, "gpb2" is far more accurate.  The filter ends at the last observation.

        Parameters
        ----------
        zs, us, Rs, Hs, keep_nodes
            As in `filter`.
        weights : {"density", "kim"}
            Weights of the nodes in a backward step: "density" uses the likelihood of all later observations;
            "kim" does not (Kim 1994), which is nearly always worse, and not available for pairwise models.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``mu``, ``nodes``, ``class_weights``, ``switch``, ``switch_mean``, the most
            likely ``switch_path``, and the ``log_likelihood`` of the filter.

        Warns
        -----
        HindsightWarning
            If later observations move the states by more than their covariances admit.  The model is then
            wrong, or the filter has lost the switch, and smoothing may be worse than filtering.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if a subclass overrides `predict` or `update` and does more than replace
            observations.
        """
        return self._look_back(zs, (us, Rs, Hs), weights, keep_nodes)

    def smooth_lag(
        self,
        zs: ManyNumbers,
        lag: int,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        weights: Literal["density", "kim"] = "density",
        keep_nodes: bool = False,
    ) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given the observations up to ``lag`` steps later.

        Approximate, like `smooth`.  The filter ends at the last observation.

        Parameters
        ----------
        zs, us, Rs, Hs, keep_nodes
            As in `filter`.
        lag : int
            Number of steps to look ahead, at least 0: row n is the estimate given the observations up to
            n + lag, or to the end.  0 is `filter`; the length of the series is `smooth`.
        weights : {"density", "kim"}
            As in `smooth`.

        Returns
        -------
        FilterResult
            As from `smooth`, without the most likely path.

        Warns
        -----
        HindsightWarning
            As from `smooth`.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `smooth`; if ``lag`` is not an integer of at least 0.

        See Also
        --------
        fuzzykf.FixedLag : The same step by step.
        """
        return self._look_back(zs, (us, Rs, Hs), weights, keep_nodes, as_lag(lag))

    def _look_back(
        self, zs: Any, told: tuple[Any, Any, Any], weights: Any, keep_nodes: Any, lag: int | None = None
    ) -> FilterResult:
        """Do `smooth`, or with a lag `smooth_lag`."""
        us, Rs, Hs = told
        zs, keep_nodes = self._named(zs), as_flag("keep_nodes", keep_nodes)
        as_choice("weights", weights, ("density", "kim") if self._mix else ("density",))
        check_aligned(zs=zs, us=us, Rs=Rs, Hs=Hs)
        ys, index = as_observations(zs, self.dim_z), index_of(zs)
        inputs = self._read(len(ys), us, Rs, Hs)
        system = self._driven(inputs, None, len(ys))
        with self._as_it_was_on_error():
            walked = None
            if not self._is_plain():
                walked, ys = self._by_verbs(ys, *_by_step(inputs, Rs, Hs, len(ys)))
            trajectory = self._method.run(system, ys, FOUND, states=True)
            if walked is not None:
                check_explained(type(self).__name__, walked, trajectory)
            kim = {} if weights == "density" else {"by_density": False}
            smoothed = smooth_trajectory(self._method, system, trajectory, ys, lag, **kim)
            if walked is None:
                self._adopt(trajectory, ys)
                self._latest = inputs.told(-1) if len(ys) else NOTHING
        if index is not None:
            self._follow(index)
            warn_of_steps(index)
        result = smoothed_result(self._system.chain, trajectory, smoothed, keep_nodes, index)
        warn_of_hindsight(trajectory.fields, result, level=4)
        return result.with_coords(zs) if hasattr(zs, "coords") else result

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        by: Hashable | None = None,
        threads: int = 1,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each as `filter` does; the filter itself does not change.

        All series are filtered together, with or without gaps, and share the threads.

        Parameters
        ----------
        zs, keep, by, threads, resume
            As in `SwitchingFilter.filter_many`.
        us : array_like, DataFrame, list, tuple or mapping, optional
            Controls: shape (n, k), the same for all series, or one set per series, in the forms of ``zs``.
        Rs, Hs : sequence of n, optional
            As in `filter`, the same for all series.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series.
        """
        threads = as_count("threads", threads, 1, MOST_THREADS)
        names = check_keep(keep, SHOWN)
        many = self._read_many(zs, by)
        resume = as_flag("resume", resume)
        stand = self._stand() if resume else None
        controls = read_controls_of_many(us, many, self._system, stand is None)
        told = self._read(many.values.shape[1], None, Rs, Hs)._replace(us=controls)

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            s, n = series.shape[:2]
            inputs = told.rows(rows, n)
            if self._is_plain() or not s:
                return self._method.run_many(self._driven(inputs, stand, n), series, names, threads, stand)
            looks = {name: a[:n] for name, a in (("Rs", Rs), ("Hs", Hs)) if a is not None}
            each = [looks | one | {"resume": resume} for one in inputs.arguments(s)]
            return stacked(self._filter_each(series, each), names)

        return many.filtered(several, self.nodes)

    def forecast(self, steps: int, us: Any = None) -> FilterResult:
        """Forecast states and observations; the filter does not change.

        Parameters
        ----------
        steps : int
            Number of steps after the latest observation, whether or not `predict` was called since.
        us : array_like, shape (steps, k), optional
            Control of each step.  By default none, except one already given to `predict` for the first step.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``z_prior``, ``S`` (mean and covariance of the observations), ``mu``,
            ``nodes``, ``class_weights``, ``switch`` and ``switch_mean``.
        """
        steps = as_count("steps", steps, 1, MOST_STEPS)
        ahead = self._index_ahead(steps)
        check_ahead(ahead, steps, {"us": us})
        controls = read_controls(us, steps, self._system, begins=self._n == 0)
        if controls is None and self._next.u is not None:
            controls = np.zeros((1, steps, len(self._next.u)))
            controls[0, 0] = self._next.u
        system: Any = Inputs(controls).drive(self._system, self._n)
        found = forecast(self._method, system, self._mixture, self._n, steps)
        return replace(found, index=ahead)

    def _read(self, n: int, us: Any, Rs: Any, Hs: Any, begins: bool = True) -> Inputs:
        """Return what is told along a series."""
        system, mix = self._system, self._mix
        noise, seen = (read_each(*one, n, system, mix) for one in (("Rs", Rs), ("Hs", Hs)))
        return Inputs(read_controls(us, n, system, begins), seen, noise)

    def _driven(self, inputs: Inputs, stand: Any, n: int) -> Any:
        """Return the system along series of n observations that go on from where the filter stands."""
        if stand is not None and stand.skips:
            inputs = inputs.after(self._next.u, self._system, n)
        return inputs.drive(self._system, 0 if stand is None else stand.n)

    # ------------------------------------------------------------------ files

    def _export_state(self) -> dict[str, Any]:
        own = self._system.tables
        before: Any = None if self._before is None else self._before.tables
        told = {} if before is None else {
            name: getattr(before, name).tolist()
            for name in ("b", "H", "R")
            if not np.array_equal(getattr(before, name), getattr(own, name))
        }  # fmt: skip
        seen = {"R": encode(self._latest.R), "H": encode(self._latest.H)}
        seen |= {"u": encode(self._next.u), "before_told": told}
        return super()._export_state() | seen

    def _import_state(self, values: dict[str, Any]) -> None:
        super()._import_state(values)
        own = self._system.tables
        told = {name: decode(value, 2 if name == "b" else 3) for name, value in values["before_told"].items()}
        R, H, u = (decode(values[name], ndim) for name, ndim in (("R", 3), ("H", 3), ("u", 1)))
        shapes = {"R": R, "H": H} | {f"before_told {name}": one for name, one in told.items()}
        for name, one in shapes.items():
            if one is not None and one.shape != getattr(own, name[-1]).shape:
                raise FileFormatError(f"{name}: got shape {one.shape}, which does not fit the model")
        if u is not None and (u.size != self._system.dim_u or not self._predicted):
            raise FileFormatError(f"u: got {u.tolist()}, which does not fit the model")
        self._latest, self._next = Told(None, H, R), Told(u)
        if self._before is not None and told:
            tables: Any = self._before.tables
            self._before = Source(self._before.mixture, replace(tables, **told))


def _by_step(inputs: Inputs, Rs: Any, Hs: Any, n: int) -> tuple[Any, Any]:
    """Return what `predict` and `update` are given at each of n steps."""
    moves = None if inputs.us is None else [(u,) for u in inputs.us[0]]
    return moves, [{k: a[row] for k, a in (("R", Rs), ("H", Hs)) if a is not None} for row in range(n)]


#: What the verbs are, what they call and what is read after each, before anybody changes it.
_OWN = lookups(SwitchingKalmanFilter, READ)

"""The filter for a switch that is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import FilterResult, as_observation, as_observations, check_keep, index_of
from fuzzykf.errors import ParameterError
from fuzzykf.fixed_lag import as_lag
from fuzzykf.gaussian import as_flag
from fuzzykf.immutable import keeps
from fuzzykf.labels import labels_of, match_row
from fuzzykf.many import stacked
from fuzzykf.observations import check_aligned
from fuzzykf.overrides import lookups, overrides
from fuzzykf.reprs import WIDTH, shown, value_text
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.dynamics.model import SwitchingModel
from fuzzykf.switching.dynamics.pairs import Ahead
from fuzzykf.switching.filters.inputs import (
    NOTHING,
    Inputs,
    Told,
    read_control,
    read_controls,
    read_controls_of_many,
)
from fuzzykf.switching.filters.known_inputs import read_looks, read_seen_along
from fuzzykf.switching.filters.known_series import (
    GIVEN_ONCE,
    NEVER_GIVEN,
    Before,
    filter_side_by_side,
    path_of,
    rivals_of,
    tables_between,
)
from fuzzykf.switching.filters.known_values import (
    may_be,
    read_many_and_switches,
    read_switch,
    read_switches,
    unknown_nodes,
    with_switch,
)
from fuzzykf.switching.filters.looking_back import smooth_trajectory
from fuzzykf.switching.filters.switching_filter import READ, SwitchingFilter
from fuzzykf.switching.inference.registry import METHODS
from fuzzykf.switching.inference.series import (
    FOUND,
    SHOWN,
    Stand,
    Trajectory,
    check_explained,
    result_of,
    smoothed_result,
)

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

__all__ = ["KnownSwitchFilter"]


@keeps("model")
class KnownSwitchFilter(SwitchingFilter):
    """Exact filter for a known switch: the best filter of its model class.

    On data of the model, no filter has a smaller mean squared error.  On other data, a filter of another
    class can be better: one with feedback if this model has none, or one that was learned if this model
    is wrong.

    Parameters
    ----------
    model : CGOFMSModel, CGOMSModel or SwitchingStateSpace
        Model of state and observation given the switch.

    Notes
    -----
    Pass the value of the switch with each observation, to `predict` or to `update`.  If `predict` does not
    get it, ``x_prior`` and ``P_prior`` are NaN.  For a state-space model, this is the Kalman filter along the
    switch; controls, R and H are passed as to `SwitchingKalmanFilter` and evaluated at the known value.

    See Also
    --------
    fuzzykf.switching.SwitchingFilter : Methods and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, KnownSwitchFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2),
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> truth = model.simulate(50, np.random.default_rng(0))
    >>> KnownSwitchFilter(model).filter(truth.y, truth.r).x.shape
    (50, 1)
    """

    _system: Any  # a KnownPath

    def __init__(self, model: SwitchingModel) -> None:
        if not isinstance(model, SwitchingModel):
            raise ParameterError(
                f"model: got {type(model).__name__}, expected a CGOFMSModel, CGOMSModel or a "
                "SwitchingStateSpace"
            )
        self.model = model
        super().__init__(model.along(np.empty(0)), METHODS[model.form.known_method])

    def _start(self) -> None:
        super()._start()
        # value of the switch at the latest observation: a number, or class weights (K,), at all times
        self._r: Any = np.full(self.model.n_classes, np.nan) if self.model.takes_weights else np.nan
        self._r_next: Any = None  # at the next one, once known
        self._next = NOTHING  # of the step there, and how that is seen while it is taken
        self._latest = NOTHING  # of that to the latest one
        self._tables: PairTables | None = None  # of the step between them
        self._told_at_predict = False

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        r = self._r if self._r_next is None else self._r_next
        told = self._next if self._mixture is None else self._latest
        law: Any = self.model.along(np.array([r])).initial()
        found: InitialLaw = law if told.H is None and told.R is None else law.seen_by(told.H, told.R)
        return found

    def _next_tables(self) -> PairTables:
        if self._tables is None:
            raise ParameterError("r: the value of the switch at the next observation is not known yet")
        tables: Any = self._tables
        told = {name: one for name, one in (("H", self._next.H), ("R", self._next.R)) if one is not None}
        found: PairTables = replace(tables, **told) if told else tables
        return found

    def _ahead(self) -> Ahead:
        if self._told_at_predict:
            return super()._ahead()
        m, q = self.dim_x, self.dim_z
        nothing = np.full(m, np.nan), np.full((m, m), np.nan), np.full(q, np.nan), np.full((q, q), np.nan)
        return Ahead(np.ones(1), *nothing)

    @classmethod
    def _overrides(cls) -> bool:
        return SwitchingFilter._overrides() or overrides(cls, _OWN)

    # ------------------------------------------------------------------ verbs

    def predict(self, r: ArrayLike | None = None, u: ArrayLike | None = None) -> None:  # type: ignore[override]
        """Move to the time of the next observation.

        Parameters
        ----------
        r : float or array_like, optional
            Value of the switch at that time, unless it is passed to `update`.  For a fuzzy switch between
            more than two classes: class weights (K,) or the number of a class.
        u : array_like, shape (k,) or (k, 1), optional
            Control that acts on this step, for a state-space model with controls; a number if there is one.

        Raises
        ------
        ParameterError
            If ``r`` is not a value of the switch, or contradicts an earlier one.
        NotPositiveDefiniteError
            If the noise covariance of the model is indefinite at these values.
        """
        control = read_control(u, self._system)
        value, n, now = None if r is None else read_switch(r, self.model), self._n, self._r
        if self._predicted and n > 0:  # the observation at the value given before is missing
            if self._r_next is None:
                raise ParameterError(NEVER_GIVEN)
            n, now = n + 1, self._r_next
        elif value is not None and not may_be(value, self._r_next):
            raise ParameterError(GIVEN_ONCE.format(value, self._r_next))
        tables = self._tables if value is None else tables_between(self.model, n, now, value, control)
        super().predict()
        self._next = Told(control) if self._n else NOTHING
        if value is not None:
            self._r_next, self._tables = value, tables
        self._told_at_predict = self._r_next is not None

    def update(self, z: Numbers, r: ArrayLike | None = None, R: Any = None, H: Any = None) -> None:
        """Take an observation into account.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float or array_like, optional
            Value of the switch at its time, unless given to `predict`.
        R : array_like, shape (q, q) or (K, q, q), or callable, optional
            Used instead of ``R`` of a state-space model; a number means that multiple of the identity.
        H : array_like, shape (q, m) or (K, q, m), or callable, optional
            Used instead of ``H`` of a state-space model.

        Raises
        ------
        ParameterError
            If ``r`` was passed to both `predict` and `update`, or to neither; if the model has no R and H.
        ShapeError, NotPositiveDefiniteError
            If ``z``, ``R`` or ``H`` has the wrong shape, or ``R`` is indefinite.
        """
        if r is None and self._r_next is None:
            raise ParameterError(
                "r: missing; the value of the switch has to be given to predict or to update (use "
                f"{rivals_of(self._system)} if it is not known)"
            )
        value = self._r_next if r is None else read_switch(r, self.model)
        if r is not None and self._r_next is not None:
            raise ParameterError(GIVEN_ONCE.format(value, self._r_next))
        shares = self.model.class_weights(np.array([value]))
        H, R = (read_seen_along(name, given, shares, self._system) for name, given in (("H", H), ("R", R)))
        before = self._r_next, self._tables, self._next
        if r is not None:
            self._tables = tables_between(self.model, self._n, self._r, value, self._next.u)
        self._r_next, self._next = value, Told(self._next.u, H, R)
        try:
            super().update(z)
        except BaseException:
            self._r_next, self._tables, self._next = before
            raise

    def _take(self, y: FloatArray) -> None:
        super()._take(y)
        assert self._r_next is not None
        self._r, self._r_next, self._tables = self._r_next, None, None
        self._latest, self._next = self._next, NOTHING

    def step(  # type: ignore[override]
        self,
        z: Numbers,
        r: ArrayLike | None = None,
        u: ArrayLike | None = None,
        R: Any = None,
        H: Any = None,
    ) -> FloatArray:
        """Predict, then update with ``z``, at the value ``r`` of the switch.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float or array_like
            Value of the switch at its time, as for `predict`.
        u : array_like, optional
            As for `predict`.
        R, H : array_like, optional
            As for `update`.

        Returns
        -------
        ndarray, shape (dim_x, 1)
        """
        if r is None:
            raise ParameterError("r: missing; expected the value of the switch at this observation")
        z = z if isinstance(z, float | np.ndarray) else match_row(z, labels_of(self))
        as_observation(z, self.dim_z)  # what is refused leaves the filter as it was
        look = {name: one for name, one in (("R", R), ("H", H)) if one is not None}
        with self._as_it_was_on_error():
            self.predict(r, *(() if u is None else (u,)))
            self.update(z, **look)
        return self.x

    _STATE = (*SwitchingFilter._STATE, "_r", "_r_next", "_next", "_latest", "_tables", "_told_at_predict")

    # ------------------------------------------------------------------ whole series

    def filter(  # type: ignore[override]
        self,
        zs: ManyNumbers,
        r: ArrayLike,
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
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1.
        r : array_like, shape (n,)
            Values of the switch.  For a fuzzy switch between more than two classes: class weights (n, K) or
            numbers of classes (n,).
        us : array_like, shape (n, k), optional
            Controls of a state-space model: ``us[n]`` acts on the step to observation n; ``us[0]`` is not
            used unless the filter resumes.  None in a list means no control.
        Rs, Hs : sequence of n, optional
            Passed to `update` one by one, for a state-space model; None means that of the model.
        keep_nodes, resume : bool
            As in `SwitchingFilter.filter`.

        Returns
        -------
        FilterResult

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If ``r`` does not match ``zs`` or, with ``resume``, the earlier `predict`; if an argument does not
            have one value per observation; as from `predict` and `update`.
        """
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        if resume:
            self._check_next(index_of(zs))
        ys, r, path, told = self._read(zs, r, us, Rs, Hs, resume)
        if self._is_plain():
            stand = self._stand() if resume else None
            trajectory = self._method.run(path, ys, FOUND, states=keep_nodes, stand=stand)
            if len(ys) or not resume:
                self._adopt_path(trajectory, ys, path, told, stand)
        else:
            given = self._by_step(r, told, Rs, Hs)
            trajectory, _ = self._by_verbs(ys, *given, states=keep_nodes, resume=resume)
        self._follow(index_of(zs))
        warn_of_steps(index_of(zs))
        result = result_of(path.chain, trajectory, self.dim_x, keep_nodes, index_of(zs))
        return with_switch(result, r, self.model).with_coords(zs)

    def smooth(  # type: ignore[override]
        self,
        zs: ManyNumbers,
        r: ArrayLike,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        keep_nodes: bool = False,
    ) -> FilterResult:
        """Smooth a series: estimate every state given all observations and switches.

        Parameters
        ----------
        zs, r, us, Rs, Hs, keep_nodes
            As in `filter`.

        Returns
        -------
        FilterResult
        """
        return self._look_back(zs, r, (us, Rs, Hs), keep_nodes)

    def smooth_lag(  # type: ignore[override]
        self,
        zs: ManyNumbers,
        lag: int,
        r: ArrayLike,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        *,
        keep_nodes: bool = False,
    ) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given observations and switches up to ``lag`` steps later.

        Parameters
        ----------
        zs, r, us, Rs, Hs, keep_nodes
            As in `filter`.
        lag : int
            Number of steps to look ahead, at least 0; see `SwitchingFilter.smooth_lag`.

        Returns
        -------
        FilterResult

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `smooth`; if ``lag`` is not an integer of at least 0.
        """
        return self._look_back(zs, r, (us, Rs, Hs), keep_nodes, as_lag(lag))

    def _look_back(
        self, zs: Any, r: Any, told: tuple[Any, Any, Any], keep_nodes: Any, lag: int | None = None
    ) -> FilterResult:
        """Do `smooth`, or with a lag `smooth_lag`."""
        ys, r, path, inputs = self._read(zs, r, *told)
        keep_nodes = as_flag("keep_nodes", keep_nodes)
        with self._as_it_was_on_error():
            walked = None
            if not self._is_plain():
                walked, ys = self._by_verbs(ys, *self._by_step(r, inputs, *told[1:]))
            fields = ("log_likelihood",) if walked is None else FOUND
            trajectory = self._method.run(path, ys, fields, states=True)
            if walked is not None:
                check_explained(type(self).__name__, walked, trajectory)
            smoothed = smooth_trajectory(self._method, path, trajectory, ys, lag)
            if walked is None:
                self._adopt_path(trajectory, ys, path, inputs)
        self._follow(index_of(zs))
        warn_of_steps(index_of(zs))
        result = smoothed_result(path.chain, trajectory, smoothed, keep_nodes, index_of(zs))
        result = with_switch(result, r, self.model).with_coords(zs)
        return replace(result, switch_path=r) if lag is None else result

    def filter_many(  # type: ignore[override]
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        *,
        r: ManySeriesLike | str | Sequence[str] = None,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        by: Hashable | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series with their switches, each as `filter` does.

        The filter itself does not change.  All series are filtered together, with or without gaps; those of
        a model converted from a `CGLSSM` are filtered one by one.

        Parameters
        ----------
        zs, keep, by
            As in `SwitchingFilter.filter_many`.
        r : array_like, shape (series, n), DataFrame, list, tuple or mapping
            Values of the switch, in the form of ``zs``; with ``by``, the name of their column.  For a fuzzy
            switch between more than two classes: numbers of classes, or class weights (series, n, K); with
            ``by``, the names of their columns.
        us : array_like, DataFrame, list, tuple or mapping, optional
            Controls of a state-space model: shape (n, k), the same for all series, or one set per series.
        Rs, Hs : sequence of n, optional
            As in `filter`, the same for all series, evaluated at the switch of each.
        resume : bool
            As in `filter`.

        Returns
        -------
        FilterResult
        """
        names = check_keep(keep, SHOWN)
        many, switches = read_many_and_switches(zs, r, by, self.model, self._read_many)
        n, resume = many.values.shape[1], as_flag("resume", resume)
        looks = read_looks(n, Rs=Rs, Hs=Hs)
        before, stand = self._before_series(resume), self._stand() if resume else None
        told = Inputs(read_controls_of_many(us, many, self._system, before.n == 0))

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            s, n = series.shape[:2]
            values, inputs = switches[rows][:, :n], told.rows(rows, n)
            seen = {name: one[:n] for name, one in looks.items()}
            found = None
            if s and n and self._is_plain():
                found = filter_side_by_side(self.model, series, values, inputs.us, seen, before, stand)
            if found is not None:
                return {name: found[name] for name in names if name in found}
            given: dict[str, Any] = {"resume": True} | seen if resume else seen
            each = inputs.arguments(s)
            arguments = [{"r": r, **given, **one} for r, one in zip(values, each, strict=True)]
            return stacked(self._filter_each(series, arguments), names)

        return many.filtered(several, unknown_nodes(self.model))

    def forecast(self, steps: int) -> FilterResult:
        """Not available: a forecast needs the future switches.

        Parameters
        ----------
        steps : int
            Number of steps.

        Raises
        ------
        ParameterError
            Always.  Call `predict` with the switch of each step, or use another filter.
        """
        raise ParameterError(
            f"steps: got {steps}; the future of a known switch is not known: call predict(r) for each step, "
            f"or forecast with {rivals_of(self._system)}"
        )

    def _read(
        self,
        zs: ManyNumbers,
        r: ArrayLike,
        us: Any = None,
        Rs: Any = None,
        Hs: Any = None,
        resume: bool = False,
    ) -> tuple[FloatArray, FloatArray, Any, Inputs]:
        """Return observations, values of the switch, their path, and what else is told along them.

        The path begins where the filter is if it resumes.
        """
        zs = self._named(zs)
        check_aligned(zs=zs, r=r, us=us, Rs=Rs, Hs=Hs)
        ys = as_observations(zs, self.dim_z)
        switches, before = read_switches(r, len(ys), self.model), self._before_series(resume)
        controls = read_controls(us, len(ys), self._system, before.n == 0)
        return ys, switches, *path_of(self.model, switches, controls, {"Rs": Rs, "Hs": Hs}, before)

    @staticmethod
    def _by_step(r: FloatArray, told: Inputs, Rs: Any, Hs: Any) -> tuple[Any, Any]:
        """Return what `predict` and `update` are given at each step."""
        moves = list(zip(r, *([] if told.us is None else [told.us[0]]), strict=True))
        return moves, [{k: a[n] for k, a in (("R", Rs), ("H", Hs)) if a is not None} for n in range(len(r))]

    def _before_series(self, resume: bool) -> Before:
        stands = self._n, self._predicted, self._r, self._r_next, self._next
        return Before(*stands) if resume else Before()

    def _stand(self) -> Stand | None:
        stand = super()._stand()
        return None if stand is None else replace(stand, origin=stand.n - 1)

    def _adopt_path(
        self, trajectory: Trajectory, ys: FloatArray, path: Any, told: Inputs, stand: Stand | None = None
    ) -> None:
        self._adopt(trajectory, ys, stand)
        if len(ys):
            last, self._latest = path.r[-1], told.told(-1)
            self._r, self._told_at_predict = last.copy() if last.ndim else float(last), True

    # ------------------------------------------------------------------ what users read

    @property
    def nodes(self) -> FloatArray:
        """The known value of the switch, (1,) or class weights (1, K); NaN before it is known."""
        value = self._r_next if self._predicted or self._n == 0 else self._r
        unknown = np.full(self.model.n_classes, np.nan) if self.model.takes_weights else np.nan
        return np.array([unknown if value is None or np.isnan(value).all() else value])

    @property
    def mu(self) -> FloatArray:
        """Probability of the known value: one."""
        return np.ones(1)

    @property
    def switch(self) -> Any:
        """The known value of the switch."""
        value = self.nodes[0]
        return value if value.ndim else float(value)

    @property
    def class_weights(self) -> FloatArray:
        """Share of each class in the known value of the switch, (K,); NaN before it is known."""
        unknown, value = np.full(self.model.n_classes, np.nan), self.nodes
        return unknown if np.isnan(value).any() else self.model.class_weights(value)[0]

    @property
    def switch_mean(self) -> float | None:
        """The known value of the switch; None for more than two classes."""
        return None if self.model.takes_weights else float(self.nodes[0])

    @property
    def _switch_key(self) -> float:
        return 0.0

    @shown
    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(dim_x={self.dim_x}, dim_z={self.dim_z}): the switch is known, "
            f"observations seen: {self._n}\n  model: {value_text(self.model, 2 * WIDTH)}"
        )


#: What the verbs are, what they call and what is read after each, before anybody changes it.
_OWN = lookups(KnownSwitchFilter, READ)

"""The filter for a switch that is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import FilterResult, as_observation, as_observations, check_keep, index_of
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_flag, as_numbers, brief
from fuzzykf.labels import labels_of, match_row
from fuzzykf.many import read_many, stacked
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
from fuzzykf.switching.laws.chain import shares_of

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.many import ManySeries
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

__all__ = ["KnownSwitchFilter"]

_NEVER_GIVEN = "r: the value of the switch at the missing observation was never given"
_GIVEN_ONCE = "r: got {} after {}; the switch is given once per observation"


class KnownSwitchFilter(SwitchingFilter):
    """Exact filter for a switch that is known: the best that any filter can do.

    Parameters
    ----------
    model : CGOFMSModel, CGOMSModel or SwitchingStateSpace

    Notes
    -----
    The value of the switch goes with each observation: to `predict`, or to `update`.
    Without it at `predict`, ``x_prior`` and ``P_prior`` are NaN.  Of a state-space model it is the Kalman
    filter along the switch; where controls act, they go to `predict`, as `SwitchingKalmanFilter` takes them.

    See Also
    --------
    fuzzykf.switching.filters.switching_filter.SwitchingFilter : Verbs and attributes.

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
        self._r: Any = (
            np.nan
        )  # value of the switch at the latest observation: a number, or class weights (K,)
        self._r_next: Any = None  # at the next one, once known
        self._next = NOTHING  # what else is told of the step there: a control
        self._tables: PairTables | None = None  # of the step between them
        self._told_at_predict = False

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        r = self._r if self._r_next is None else self._r_next
        return self.model.along(np.array([r])).initial()

    def _next_tables(self) -> PairTables:
        if self._tables is None:
            raise ParameterError("r: the value of the switch at the next observation is not known yet")
        return self._tables

    def _tables_between(self, n: int, before: Any, after: Any, u: FloatArray | None) -> Any:
        """Prove the step from observation ``n`` - 1 to ``n``; nothing changes if it is refused."""
        if not n:
            return None
        path: Any = self.model.along(np.array([before, after]), start=n - 1)
        return (path if u is None else path.driven(np.stack([0.0 * u, u]))).pair_tables(0)

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

    def predict(self, r: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Move to the time of the next observation.

        Parameters
        ----------
        r : float or array_like, optional
            Value of the switch at that time; else it has to come with `update`.  Of a fuzzy switch between
            more than two classes, class weights (K,) or the number of a class.
        u : array_like, shape (k,) or (k, 1), optional
            Control that leads there, of a state-space model that has such; a number if there is one.

        Raises
        ------
        ParameterError
            If ``r`` is not a value of the switch, or another one was given before.
        NotPositiveDefiniteError
            If the noise of the model is indefinite between the values.
        """
        control = read_control(u, self._system)
        value, n, now = None if r is None else self._checked(r), self._n, self._r
        if self._predicted and n > 0:  # the observation at the value given before is missing
            if self._r_next is None:
                raise ParameterError(_NEVER_GIVEN)
            n, now = n + 1, self._r_next
        elif value is not None and not _may_be(value, self._r_next):
            raise ParameterError(_GIVEN_ONCE.format(value, self._r_next))
        tables = self._tables if value is None else self._tables_between(n, now, value, control)
        super().predict()
        self._next = Told(control) if self._n else NOTHING
        if value is not None:
            self._r_next, self._tables = value, tables
        self._told_at_predict = self._r_next is not None

    def update(self, z: Numbers, r: ArrayLike | None = None) -> None:
        """Take an observation into account.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float or array_like, optional
            Value of the switch at its time, unless given to `predict`.

        Raises
        ------
        ParameterError
            If ``r`` was given to `predict` as well, or to neither.
        """
        if r is None and self._r_next is None:
            raise ParameterError(
                "r: missing; the value of the switch has to be given to predict or to update (use an "
                "OFSRFilter or a CGOMSMFilter if it is not known)"
            )
        before = self._r_next, self._tables
        if r is not None:
            value = self._checked(r)
            if self._r_next is not None:
                raise ParameterError(_GIVEN_ONCE.format(value, self._r_next))
            self._tables = self._tables_between(self._n, self._r, value, self._next.u)
            self._r_next = value
        try:
            super().update(z)
        except Exception:
            self._r_next, self._tables = before
            raise

    def _take(self, y: FloatArray) -> None:
        super()._take(y)
        assert self._r_next is not None
        self._r, self._r_next, self._tables, self._next = self._r_next, None, None, NOTHING

    def step(self, z: Numbers, r: ArrayLike | None = None, u: ArrayLike | None = None) -> FloatArray:
        """Predict, then update with ``z``, at the value ``r`` of the switch.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float or array_like
            Value of the switch at its time, as for `predict`.
        u : array_like, optional
            As for `predict`.

        Returns
        -------
        ndarray, shape (dim_x, 1)
        """
        if r is None:
            raise ParameterError("r: missing; expected the value of the switch at this observation")
        z = z if isinstance(z, float | np.ndarray) else match_row(z, labels_of(self))
        as_observation(z, self.dim_z)  # what is refused leaves the filter as it was
        with self._as_it_was_on_error():
            self.predict(r, *(() if u is None else (u,)))
            self.update(z)
        return self.x

    _STATE = (*SwitchingFilter._STATE, "_r", "_r_next", "_next", "_tables", "_told_at_predict")

    @property
    def _takes_weights(self) -> bool:
        return self.model.takes_weights

    def _checked(self, r: Any) -> Any:
        """Return one value of the switch: a number, or class weights (K,)."""
        value = self._of_weights(_as_switches(r), 1)
        if self._takes_weights and value.size == self.model.n_classes:
            return self.model.class_weights(value.reshape(1, -1))[0]
        if value.size != 1:
            weights = f", class weights ({self.model.n_classes},) or a class" if self._takes_weights else ""
            raise ShapeError(f"r: got shape {value.shape}, expected one value of the switch{weights}")
        shares = self.model.class_weights(value.reshape(1))
        return shares[0] if self._takes_weights else float(value.reshape(()))

    def _of_weights(self, r: FloatArray, ndim: int) -> FloatArray:
        """Return values of the switch, where class weights (K,), (n, K), ... with ``ndim`` axes were given.

        Between two classes that is the share of the second, of a hard switch the number of the class.
        """
        K = self.model.n_classes
        if self._takes_weights or K == 1 or r.ndim != ndim or r.shape[-1] != K:
            return r
        shares: FloatArray = shares_of(np.atleast_2d(r), K).reshape(r.shape)
        if K == 2:
            between: FloatArray = shares[..., 1]
            return between
        number = shares.argmax(axis=-1)
        if (np.take_along_axis(shares, number[..., None], axis=-1) < 1.0).any():
            raise ParameterError(
                f"r: got {brief(r.tolist())}, expected regimes 0 to {K - 1}, or class weights of 0 and 1"
            )
        regime: FloatArray = number.astype(np.float64)
        return regime

    def filter(  # type: ignore[override]
        self,
        zs: ManyNumbers,
        r: ArrayLike,
        us: Any = None,
        *,
        keep_nodes: bool = False,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series from the initial law on, or with ``resume`` from where the filter stands.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1.
        r : array_like, shape (n,)
            Values of the switch, or class weights (n, K).  Of a fuzzy switch between more than two classes
            these, or numbers of classes (n,).
        us : array_like, shape (n, k), optional
            Controls of a state-space model: ``us[n]`` moves to observation n, ``us[0]`` is not used, unless
            the filter resumes.
        keep_nodes, resume : bool
            As in `SwitchingFilter.filter`.

        Returns
        -------
        FilterResult

        Raises
        ------
        ShapeError, ParameterError
            If ``r`` does not go with ``zs``, or, with ``resume``, with what was given to `predict`.
        """
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        if resume:
            self._check_next(index_of(zs))
        ys, path = self._read(zs, r, us, resume)
        told: FloatArray = path.r[len(path.r) - len(ys) :]
        if self._is_plain():
            stand = self._stand() if resume else None
            trajectory = self._method.run(path, ys, FOUND, states=keep_nodes, stand=stand)
            if len(ys) or not resume:
                self._adopt_path(trajectory, ys, path, stand)
        else:
            controls = [] if us is None else [path.us[len(path.r) - len(ys) :]]
            moves = list(zip(told, *controls, strict=True))
            trajectory, _ = self._by_verbs(ys, moves, states=keep_nodes, resume=resume)
        self._follow(index_of(zs))
        warn_of_steps(index_of(zs))
        result = result_of(path.chain, trajectory, self.dim_x, keep_nodes, index_of(zs))
        return self._told(result, told).with_coords(zs)

    def smooth(  # type: ignore[override]
        self, zs: ManyNumbers, r: ArrayLike, *, keep_nodes: bool = False
    ) -> FilterResult:
        """Estimate every state of a series from all of it, and its switches.

        Parameters
        ----------
        zs, r, keep_nodes
            As in `filter`.

        Returns
        -------
        FilterResult
        """
        ys, path = self._read(zs, r)
        keep_nodes = as_flag("keep_nodes", keep_nodes)
        if self._is_plain():
            trajectory = self._method.run(path, ys, ("log_likelihood",), states=True)
            smoothed = self._method.smooth(path, trajectory, ys)
            self._adopt_path(trajectory, ys, path)
        else:
            with self._as_it_was_on_error():
                walked, ys = self._by_verbs(ys, [(one,) for one in path.r])
                trajectory = self._method.run(path, ys, FOUND, states=True)
                check_explained(type(self).__name__, walked, trajectory)
                smoothed = self._method.smooth(path, trajectory, ys)
        self._follow(index_of(zs))
        warn_of_steps(index_of(zs))
        result = smoothed_result(path.chain, trajectory, smoothed, keep_nodes, index_of(zs))
        return replace(self._told(result, path.r), switch_path=path.r).with_coords(zs)

    def filter_many(  # type: ignore[override]
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        *,
        r: ManySeriesLike | str | Sequence[str] = None,
        us: Any = None,
        by: Hashable | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series with their switches, each as `filter` would; the filter stays as it is.

        Parameters
        ----------
        zs, keep, by
            As in `SwitchingFilter.filter_many`.
        r : array_like, shape (series, n), DataFrame, list, tuple or mapping
            Values of the switch, of the same series and rows; with ``by`` the name of their column.  Of a
            fuzzy switch between more than two classes, numbers of classes, or class weights
            (series, n, K), which several components of an observation could be; with ``by`` the names
            of their columns.
        us : array_like, DataFrame, list, tuple or mapping, optional
            Controls of a state-space model: of shape (n, k) for all series, or for each its own.
        resume : bool
            As in `filter`.

        Returns
        -------
        FilterResult
        """
        names = check_keep(keep, SHOWN)
        many, switches = self._read_many_and_switches(zs, r, by)
        given: dict[str, Any] = {"resume": True} if as_flag("resume", resume) else {}
        told = Inputs(read_controls_of_many(us, many, self._system, not (resume and self._n)))

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            paths = switches[rows][:, : series.shape[1]]
            each = told.rows(rows, series.shape[1]).arguments(len(series))
            arguments = [{"r": path, **given, **one} for path, one in zip(paths, each, strict=True)]
            return stacked(self._filter_each(series, arguments), names)

        return many.filtered(several, self._no_nodes())

    def _read_many_and_switches(self, zs: Any, r: Any, by: Any) -> tuple[ManySeries, FloatArray]:
        """Return many series, and their switches (series, n), or (series, n, K) where these are weights."""
        K = self.model.n_classes
        if by is None or not hasattr(zs, "columns"):
            many = self._read_many(zs, by)
            if r is None:
                raise ShapeError(f"r: got nothing, expected the switches, shape {many.values.shape[:2]}")
            if self._takes_weights and _axes_of_many(r) == 3:
                return many, many.beside("r", r, K)
            return many, many.beside("r", r)[..., 0]
        names = list(r) if self._takes_weights and isinstance(r, list | tuple) else [r]
        wanted = (1, K) if self._takes_weights else (1,)
        known = all(isinstance(name, str) and name in zs.columns and name != by for name in names)
        if not known or len(names) not in wanted or len(set(names)) < len(names):
            columns = f"a column of zs, or {K} of class weights" if self._takes_weights else "a column of zs"
            raise ParameterError(f"r: got {brief(r)}, expected {columns}, as 'by' is given")
        switches = zs[[*([by] if by in zs.columns else []), *names]]  # as named, whatever their order there
        values = read_many(switches, len(names), by).values
        return self._read_many(zs.drop(columns=names), by), values if len(names) > 1 else values[..., 0]

    def forecast(self, steps: int) -> FilterResult:
        """Refuse: a forecast needs the switches of the future.

        Raises
        ------
        ParameterError
            Always; call `predict` with the switch of each step, or use another filter.
        """
        raise ParameterError(
            f"steps: got {steps}; the future of a known switch is not known: call predict(r) for each step, "
            "or forecast with an OFSRFilter or a CGOMSMFilter"
        )

    def _told(self, result: FilterResult, r: FloatArray) -> FilterResult:
        """Return a result with what was told of the switch."""
        weights = self.model.class_weights(r)
        mean = None if self._takes_weights else r
        nodes = self._no_nodes()
        return replace(result, nodes=nodes, switch=r, switch_mean=mean, class_weights=weights)

    def _no_nodes(self) -> FloatArray | None:
        """Return what results have for nodes: none that stays, but class weights (1, K) show their shape."""
        return np.full((1, self.model.n_classes), np.nan) if self._takes_weights else None

    def _read(
        self, zs: ManyNumbers, r: ArrayLike, us: Any = None, resume: bool = False
    ) -> tuple[FloatArray, Any]:
        """Return observations and path of the switch, which begins where the filter is if it resumes."""
        zs = self._named(zs)
        check_aligned(zs=zs, r=r, us=us)
        ys = as_observations(zs, self.dim_z)
        switches = self._of_weights(_as_switches(r), 2)
        switches = self.model.class_weights(switches) if self._takes_weights else switches.reshape(-1)
        if len(switches) != len(ys):
            raise ShapeError(f"r: got {len(switches)} values, expected {len(ys)}, one per observation")
        begins = not resume or self._n == 0
        controls = read_controls(us, len(ys), self._system, begins)
        if begins:
            if resume and len(switches) and not _may_be(switches[0], self._r_next):
                raise ParameterError(_GIVEN_ONCE.format(switches[0], self._r_next))
            path: Any = self.model.along(switches)
            return ys, path if controls is None else path.driven(controls[0])
        if self._predicted and self._r_next is None:
            raise ParameterError(_NEVER_GIVEN)
        begin = [self._r] if self._r_next is None else [self._r, self._r_next]
        path = self.model.along(np.concatenate([begin, switches]), start=self._n - 1)
        if controls is None and self._next.u is None:
            return ys, path
        moves = np.zeros((len(path.r), self._system.dim_u))
        if self._next.u is not None:
            moves[1] = self._next.u
        moves[len(begin) :] = 0.0 if controls is None else controls[0]
        return ys, path.driven(moves)

    def _stand(self) -> Stand | None:
        stand = super()._stand()
        return None if stand is None else replace(stand, origin=stand.n - 1)

    def _adopt_path(
        self, trajectory: Trajectory, ys: FloatArray, path: Any, stand: Stand | None = None
    ) -> None:
        self._adopt(trajectory, ys, stand)
        if len(ys):
            last = path.r[-1]
            self._r, self._told_at_predict = last.copy() if last.ndim else float(last), True

    # ------------------------------------------------------------------ what users read

    @property
    def nodes(self) -> FloatArray:
        """The known value of the switch, (1,) or class weights (1, K); NaN before it is known."""
        value = self._r_next if self._predicted or self._n == 0 else self._r
        unknown = np.full(self.model.n_classes, np.nan) if self._takes_weights else np.nan
        return np.array([unknown if value is None or np.isnan(value).all() else value])

    @property
    def mu(self) -> FloatArray:
        """Its probability, which is one."""
        return np.ones(1)

    @property
    def switch(self) -> Any:
        """The known value of the switch."""
        value = self.nodes[0]
        return value if value.ndim else float(value)

    @property
    def class_weights(self) -> FloatArray:
        """Share of each class in the known value of the switch, (K,); NaN before it is known."""
        value = self.nodes
        return (
            np.full(self.model.n_classes, np.nan)
            if np.isnan(value).any()
            else self.model.class_weights(value)[0]
        )

    @property
    def switch_mean(self) -> float | None:
        """The known value of the switch; None between more than two classes."""
        return None if self._takes_weights else float(self.nodes[0])

    @property
    def _switch_key(self) -> float:
        return 0.0

    @shown
    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(dim_x={self.dim_x}, dim_z={self.dim_z}): the switch is known, "
            f"observations seen: {self._n}\n  model: {value_text(self.model, 2 * WIDTH)}"
        )


def _may_be(value: Any, given: Any) -> bool:
    """Whether a value of the switch is the one that was given before, if any was."""
    return given is None or bool(np.array_equal(value, given))


def _axes_of_many(r: Any) -> int:
    """Return how many axes the switches of many series have, in any of the forms that series come in."""
    if hasattr(r, "columns"):
        return 2 + (getattr(r.columns, "nlevels", 1) > 1)
    if hasattr(r, "ndim"):
        return int(r.ndim)
    members = list(r.values()) if isinstance(r, Mapping) else r
    if not isinstance(members, list | tuple):
        return 0
    return 1 + (_axes_of_many(members[0]) if members else 0)


def _as_switches(r: ArrayLike) -> FloatArray:
    return as_numbers("r", r).copy()


#: What the verbs are, what they call and what is read after each, before anybody changes it.
_OWN = lookups(KnownSwitchFilter, READ)

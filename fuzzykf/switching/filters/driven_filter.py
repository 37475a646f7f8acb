"""Filters of models that may have inputs, or features of the window of observations."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import as_observations, check_keep, index_of
from fuzzykf.errors import FileFormatError
from fuzzykf.fixed_lag import as_lag
from fuzzykf.gaussian import as_count, as_flag
from fuzzykf.io import decode, encode
from fuzzykf.many import stacked
from fuzzykf.observations import check_ahead, check_aligned
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.dynamics.told_inputs import told_inputs, told_inputs_of_many
from fuzzykf.switching.filters.driver import NOWHERE, Onwards, refuse
from fuzzykf.switching.filters.looking_back import smooth_trajectory
from fuzzykf.switching.filters.saved import SavedFilter
from fuzzykf.switching.inference.driven import Onward, along, starting_past
from fuzzykf.switching.inference.forecast import MOST_STEPS, forecast
from fuzzykf.switching.inference.mixture import Source
from fuzzykf.switching.inference.series import FOUND, SHOWN, check_explained, result_of, smoothed_result

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike
    from fuzzykf.base import FilterResult
    from fuzzykf.switching.dynamics.inputs import DrivenSystem, InputSystem

__all__ = ["DrivenFilter"]


class DrivenFilter(SavedFilter):
    """A filter whose model may have inputs, or features of the window of observations.

    A model without either is told nothing, and costs nothing more.  With inputs every step but that to the
    first observation has to be told them.  Lags and products are exact in gaps and forecasts; hinges there
    take the moments of a normal law.
    """

    @property
    def _driven(self) -> InputSystem | None:
        """The system, if its steps depend on more than the latest observation."""
        return None if self._driver is None else self._driver.system

    @property
    def has_inputs(self) -> bool:
        """Whether the model has inputs, which each step then needs."""
        return self._driven is not None and self._driven.dim_u is not None

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: Any = None,
        *,
        keep_nodes: bool = False,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the initial law, or with ``resume`` from the current state.

        Parameters
        ----------
        zs, keep_nodes, resume
            As in `SwitchingFilter.filter`.
        us : array_like, shape (n, k), or (n,) if there is one input, optional
            Inputs of a model with inputs: ``us[n]`` belongs to observation n; ``us[0]`` is not used unless
            the filter resumes.  Columns of a table are matched by name.

        Returns
        -------
        FilterResult
            As from `SwitchingFilter.filter`.

        Raises
        ------
        ShapeError, ParameterError
            As from `SwitchingFilter.filter`; if ``us`` is missing, not finite, does not have one row per
            observation, or the model has no inputs.
        """
        system = self._driven
        if system is None:
            if us is not None:
                refuse("us", us)
            return super().filter(zs, keep_nodes=keep_nodes, resume=resume)
        zs = self._named(zs)
        check_aligned(zs=zs, us=us)
        ys, index = as_observations(zs, self.dim_z), index_of(zs)
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        if resume:
            self._check_next(index)
        sequel = self.__dict__.get("_sequel") if resume else None
        stand = self._stand() if resume else None
        told = told_inputs("us", us, len(ys), system, stand is None)
        if self._is_plain():
            trajectory, onwards, _ = self._run(system, ys, told, FOUND, keep_nodes, stand)
            if len(ys) or not resume:
                self._adopt(trajectory, ys, stand)
                self._onwards = onwards
        else:
            trajectory, _ = self._by_verbs(ys, _moves(system, told), states=keep_nodes, resume=resume)
        if sequel is not None:  # the count of observations goes on as well
            self._sequel = sequel
        if index is not None:
            self._follow(index)
            warn_of_steps(index)
        result = result_of(self._system.chain, trajectory, self.dim_x, keep_nodes, index)
        return result.with_coords(zs) if hasattr(zs, "coords") else result

    def _run(
        self, system: InputSystem, ys: FloatArray, us: FloatArray, names: Any, states: bool, stand: Any
    ) -> tuple[Any, Onwards, DrivenSystem]:
        """Filter a series by the method; return what it found, what goes on from there, and the system."""
        past, whole = (None, ys) if stand is None else (self._onwards.past, ys)
        if stand is not None and stand.skips:  # the observation that was skipped stands before the others
            whole = np.concatenate([np.full((1, self.dim_z), np.nan), ys])
            skipped = np.empty(0) if self._onwards.u is None else self._onwards.u
            us = np.concatenate([skipped[None], us])
        spread = None if stand is None else self._onwards.spread
        run, full, spreads = along(self._method, system, whole, us, past, spread, stand)
        trajectory = self._method.run(run, ys, names, states=states, stand=stand)
        n_past = system.features.n_past
        if not len(whole):
            return trajectory, NOWHERE if stand is None else self._onwards, run
        lead = starting_past(full[0], n_past) if past is None else past[::-1]
        lately = np.concatenate([lead, full])[: -n_past - 1 : -1].copy()
        return trajectory, Onwards(lately, None, spreads[-1]), run

    def smooth(self, zs: ManyNumbers, us: Any = None, *, keep_nodes: bool = False) -> FilterResult:
        """Smooth a series: estimate every state given all observations.

        Parameters
        ----------
        zs, us, keep_nodes
            As in `filter`.

        Returns
        -------
        FilterResult
            As from `SwitchingFilter.smooth`.
        """
        if self._driven is None:
            if us is not None:
                refuse("us", us)
            return super().smooth(zs, keep_nodes=keep_nodes)
        return self._look_back(self._driven, zs, us, keep_nodes)

    def smooth_lag(
        self, zs: ManyNumbers, lag: int, us: Any = None, *, keep_nodes: bool = False
    ) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given the observations up to ``lag`` steps later.

        Parameters
        ----------
        zs, us, keep_nodes
            As in `filter`.
        lag : int
            Number of steps to look ahead, at least 0.

        Returns
        -------
        FilterResult
            As from `SwitchingFilter.smooth_lag`.
        """
        if self._driven is None:
            if us is not None:
                refuse("us", us)
            return super().smooth_lag(zs, lag, keep_nodes=keep_nodes)
        return self._look_back(self._driven, zs, us, keep_nodes, as_lag(lag))

    def _look_back(
        self, system: InputSystem, zs: Any, us: Any, keep_nodes: Any, lag: int | None = None
    ) -> FilterResult:
        zs, keep_nodes = self._named(zs), as_flag("keep_nodes", keep_nodes)
        check_aligned(zs=zs, us=us)
        ys, index = as_observations(zs, self.dim_z), index_of(zs)
        told = told_inputs("us", us, len(ys), system, True)
        with self._as_it_was_on_error():
            walked = None
            if not self._is_plain():
                walked, ys = self._by_verbs(ys, _moves(system, told))
            trajectory, onwards, run = self._run(system, ys, told, FOUND, True, None)
            if walked is not None:
                check_explained(type(self).__name__, walked, trajectory)
            smoothed = smooth_trajectory(self._method, run, trajectory, ys, lag)
            if walked is None:
                self._adopt(trajectory, ys)
                self._onwards = onwards
        if index is not None:
            self._follow(index)
            warn_of_steps(index)
        result = smoothed_result(self._system.chain, trajectory, smoothed, keep_nodes, index)
        return result.with_coords(zs) if hasattr(zs, "coords") else result

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: Any = None,
        *,
        by: Hashable | None = None,
        threads: int = 1,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each as `filter` does; the filter itself does not change.

        With inputs or window features, series are filtered one by one.

        Parameters
        ----------
        zs, keep, by, threads, resume
            As in `SwitchingFilter.filter_many`.
        us : array_like, DataFrame, list, tuple or mapping, optional
            Inputs: shape (n, k), the same for all series, or one set per series, in the forms of ``zs``.

        Returns
        -------
        FilterResult
            As from `SwitchingFilter.filter_many`.
        """
        system = self._driven
        if system is None:
            if us is not None:
                refuse("us", us)
            return super().filter_many(zs, keep, by=by, threads=threads, resume=resume)
        names, many = check_keep(keep, SHOWN), self._read_many(zs, by)
        resume = as_flag("resume", resume)
        told = told_inputs_of_many(us, many, system, not resume or self._mixture is None)

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            own = told if len(told) == 1 else told[rows]
            given = [
                {"us": own[min(k, len(own) - 1)][: series.shape[1]], "resume": resume}
                for k in range(len(series))
            ]
            if system.dim_u is None:
                given = [{"resume": resume} for _ in given]
            return stacked(self._filter_each(series, given), names)

        return many.filtered(several, self.nodes)

    def forecast(self, steps: int, us: Any = None) -> FilterResult:
        """Forecast states and observations; the filter does not change.

        Lags and products of window features are exact; hinges use the moments of a normal distribution.

        Parameters
        ----------
        steps : int
            Number of steps after the latest observation, whether or not `predict` was called since.
        us : array_like, shape (steps, k), optional
            Inputs of each step, if the model has inputs.

        Returns
        -------
        FilterResult
            As from `SwitchingFilter.forecast`.
        """
        system = self._driven
        if system is None:
            if us is not None:
                refuse("us", us)
            return super().forecast(steps)
        steps = as_count("steps", steps, 1, MOST_STEPS)
        ahead = self._index_ahead(steps)
        check_ahead(ahead, steps, {"us": us})
        told = told_inputs("us", us, steps, system, self._n == 0)
        spread = self._onwards.spread
        spread = np.zeros(self.dim_z) if spread is None else spread
        onward: Any = Onward(system, self._onwards.past, spread, told, self._n)
        found = forecast(self._method, onward, self._mixture, self._n, steps)
        return replace(found, index=ahead)

    # ------------------------------------------------------------------ files

    def _export_state(self) -> dict[str, Any]:
        state = super()._export_state()
        if self._driven is None:
            return state
        before: Any = None if self._before is None else self._before.tables
        told = None if before is None else {name: encode(value) for name, value in before.told().items()}
        return state | {
            "past": encode(self._onwards.past),
            "u": encode(self._onwards.u),
            "spread": encode(self._onwards.spread),
            "before_told": told,
        }

    def _import_state(self, values: dict[str, Any]) -> None:
        super()._import_state(values)
        system = self._driven
        if system is None:
            return
        past, u, spread = (decode(values[k], n) for k, n in (("past", 2), ("u", 1), ("spread", 1)))
        shape = system.features.n_past, self.dim_z
        if (past is None) != (self._n == 0) or (past is not None and past.shape != shape):
            raise FileFormatError("past: does not fit the model")
        if (past is None) != (spread is None) or (spread is not None and spread.size != self.dim_z):
            raise FileFormatError("spread: does not fit the model")
        if u is not None and u.size != system.dim_u:
            raise FileFormatError(f"u: got {u.tolist()}, which does not fit the model")
        self._onwards = Onwards(past, u, spread)
        if self._before is not None:
            tables: Any = system.told_tables(
                {k: decode(v, 2 if k == "past" else 1) for k, v in values["before_told"].items()}
            )
            self._before = Source(self._before.mixture, tables)


def _moves(system: InputSystem, us: FloatArray) -> list[tuple[Any, ...]] | None:
    """Return what `predict` is given at each step."""
    return None if system.dim_u is None else [(u,) for u in us]

"""Whole series through a bank of filters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import Filter, FilterResult, as_many, as_observations, check_keep
from fuzzykf.engine import selected
from fuzzykf.engine.numpy import imm as engine
from fuzzykf.errors import ParameterError
from fuzzykf.kalman import _bank as bank
from fuzzykf.kalman._arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman._series import (
    FIELDS,
    as_batch,
    as_result,
    collect,
    field_shapes,
    filter_each,
    given_per_step,
    unchanged_on_error,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["BankSeries"]


class BankSeries(Filter):
    """Methods of a bank of filters that take a whole series, or many."""

    N: int
    method: str
    filters: Sequence[Any]
    _log_cbar: FloatArray | None

    def _log_weights(self) -> FloatArray:
        raise NotImplementedError

    def _log_transition(self) -> FloatArray:
        raise NotImplementedError

    def _set_weights(self, log_mu: FloatArray, mu: FloatArray) -> None:
        raise NotImplementedError

    def _is_plain(self) -> bool:
        """Whether the verbs are this package's, and so may be done for all of a series at once."""
        raise NotImplementedError

    def filter(
        self, zs: Iterable[ArrayLike | None] | ArrayLike, us: Sequence[Any] | None = None
    ) -> FilterResult:
        """Run predict and update along a series, from the current estimates on.

        The filter ends at the last observation, so that `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : sequence of n controls, optional
            Given to `predict` one by one.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, the mode
            probabilities ``mu`` (n, N), the numbers of the modes in ``nodes``, and that of
            the likeliest mode in ``switch``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the bank is then as it was before.
        """
        stored = self._collect(zs, us)
        modes = np.arange(self.N, dtype=np.float64)
        return as_result(stored, zs, nodes=modes, switch=modes[stored["mu"].argmax(axis=1)])

    def _collect(self, zs: Any, us: Sequence[Any] | None) -> dict[str, FloatArray]:
        series = as_observations(zs, self.dim_z)
        if (
            us is None
            and len(series)
            and self.method == "imm"
            and self._log_cbar is None
            and self._is_plain()
        ):
            stored = self._filter_at_once(series)
            if stored is not None:
                return stored
        controls = given_per_step({"us": us}, len(series))
        self._remember()
        with unchanged_on_error(self, *self.filters):
            return collect(
                self,
                series,
                lambda k: self.predict(**controls[k]),
                lambda _, z: self.update(z),
                {**field_shapes(self.dim_x), "mu": (self.N,)},
            )

    def _filter_at_once(self, series: FloatArray) -> dict[str, FloatArray] | None:
        """Do predict and update for a whole series; None if filters are not alike, or one fails."""
        model = bank.linear_model(self.filters, ("F", "Q", "H", "R"))
        if model is None:
            return None
        self._remember()
        model["alpha_sq"] = np.asarray(bank.fading(self.filters))
        shapes = {**field_shapes(self.dim_x), "mu": (self.N,)}
        stored = {name: np.empty((len(series), *shape)) for name, shape in shapes.items()}
        xs, Ps = bank.member_states(self.filters)
        largest = max(self.dim_x, self.dim_z)
        run = selected.filter_bank if largest <= selected.LARGEST_LINEAR else engine.filter_bank
        state = run(xs, Ps, self._log_weights(), self._log_transition(), series, model, stored)
        if state is None:
            return None
        bank.put_state(self.filters, state, series[-1])
        form = self.filters[0].x.shape
        for name, values in stored.items():
            if name not in ("mu", "log_likelihood"):
                setattr(self, name, values[-1].reshape(form if name[0] == "x" else values[-1].shape).copy())
        self.x_post, self.P_post = self.x.copy(), self.P.copy()
        self._set_weights(state["log_mu"], np.exp(state["log_mu"]))
        self.mode_log_likelihood, self.log_likelihood = state["modes"], float(stored["log_likelihood"][-1])
        self.likelihood = np.exp(state["modes"])
        return stored

    def batch_filter(self, zs: Sequence[ArrayLike | None] | ArrayLike) -> tuple[FloatArray, ...]:
        """Run `filter` and return filterpy's four arrays.

        Parameters
        ----------
        zs : array_like
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            After the updates and after the predictions; means of shape (n, dim_x, 1), or
            (n, dim_x) if x is flat.
        """
        return as_batch(self._collect(zs, None), np.ndim(self.x) == 1)

    def filter_many(self, zs: ArrayLike, keep: Iterable[str] = ("x", "P", "log_likelihood")) -> FilterResult:
        """Filter many series, each from the current estimates on.

        A bank of plain Kalman filters of one shape takes all series at once; any
        other takes them one after another.  The bank itself does not change.

        Parameters
        ----------
        zs : array_like, shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1
            NaN where missing; pad series of unequal length with NaN.
        keep : sequence of str
            What to store, of ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``log_likelihood``.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; or an unknown name in ``keep``.
        """
        names = check_keep(keep, (*FIELDS, "mu"))
        series = as_many(zs, self.dim_z)
        model = bank.linear_model(self.filters, ("F", "Q", "H", "R"))
        if model is None or self._log_cbar is not None:
            return filter_each(self, series, names)
        model["alpha_sq"] = np.asarray(bank.fading(self.filters))
        shapes = {**field_shapes(self.dim_x), "mu": (self.N,)}
        out = {name: np.empty((*series.shape[:2], *shapes[name])) for name in names}
        xs, Ps = bank.member_states(self.filters)
        log_mu, log_M, every_pair = self._log_weights(), self._log_transition(), self.method == "gpb2"
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                lost = engine.filter_many(xs, Ps, log_mu, log_M, series, model, every_pair, out)
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error
        if lost.any():
            raise ParameterError(
                f"zs: series {int(lost.argmax())} has an observation that no mode gives a positive density"
            )
        return FilterResult(**out)

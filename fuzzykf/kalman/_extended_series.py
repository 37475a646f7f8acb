"""Whole series through an extended filter whose functions were given at construction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.base import FilterResult, as_many, as_observations, check_keep
from fuzzykf.kalman._arguments import as_square
from fuzzykf.kalman._gaussian import GaussianFilter
from fuzzykf.kalman._series import (
    FIELDS,
    as_batch,
    as_result,
    collect,
    field_shapes,
    filter_each,
    given_per_step,
    per_step,
    unchanged_on_error,
)
from fuzzykf.kalman.smoothing import smooth_moments

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["ExtendedSeries"]


class ExtendedSeries(GaussianFilter):
    """Methods of an extended filter that take a whole series, or many."""

    def filter(
        self,
        zs: Iterable[ArrayLike | None] | ArrayLike,
        us: Sequence[Any] | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> FilterResult:
        """Run predict and update along a series, from the current x and P on.

        The filter ends at the last observation, so that `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : sequence of n controls, optional
            Given to `predict` one by one.
        fx_args, hx_args : sequence of n dict, optional
            Keyword arguments of each prediction and of each update.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior`` and ``log_likelihood``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the filter is then as it was before.
        """
        return as_result(self._collect(zs, us, fx_args, hx_args, field_shapes(self.dim_x)), zs)

    def _collect(
        self, zs: Any, us: Any, fx_args: Any, hx_args: Any, shapes: dict[str, tuple[int, ...]]
    ) -> dict[str, FloatArray]:
        series = as_observations(zs, self.dim_z)
        n = len(series)
        controls, before, after = (
            given_per_step({"us": us}, n),
            per_step("fx_args", fx_args, n),
            per_step("hx_args", hx_args, n),
        )
        self._remember()
        with unchanged_on_error(self):
            return collect(
                self,
                series,
                lambda k: self.predict(**controls[k], **(before[k] or {})),
                lambda k, z: self.update(z, **(after[k] or {})),
                shapes,
            )

    def smooth(
        self,
        zs: Iterable[ArrayLike | None] | ArrayLike,
        us: Sequence[Any] | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> FilterResult:
        """Run `filter`, then the extended smoother of Rauch, Tung and Striebel backwards.

        The smoother uses the Jacobians of the forward pass.

        Parameters
        ----------
        zs, us, fx_args, hx_args
            As in `filter`; the filter ends at the last observation.

        Returns
        -------
        FilterResult
            ``x`` and ``P`` given the whole series, and the ``log_likelihood`` of the filter.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`.
        """
        d = self.dim_x
        out = self._collect(zs, us, fx_args, hx_args, {**field_shapes(d), "F": (d, d)})
        Q = as_square("Q", self.Q, d)
        x, P = smooth_moments(out["x"], out["P"], out["x_prior"], out["P_prior"], out["F"], Q, 1.0)
        return as_result({"x": x, "P": P, "log_likelihood": out["log_likelihood"]}, zs)

    def batch_filter(
        self,
        zs: Sequence[ArrayLike | None] | ArrayLike,
        us: Sequence[Any] | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> tuple[FloatArray, ...]:
        """Run `filter` and return filterpy's four arrays.

        Parameters
        ----------
        zs, us, fx_args, hx_args
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            After the updates and after the predictions; means of shape (n, dim_x, 1), or
            (n, dim_x) if x is flat.
        """
        x, _ = self._state()
        return as_batch(self._collect(zs, us, fx_args, hx_args, field_shapes(self.dim_x)), x.ndim == 1)

    def filter_many(
        self,
        zs: ArrayLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: Sequence[Any] | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> FilterResult:
        """Filter many series, each from the current x and P on.

        The functions are called for one state at a time, so that this takes as long
        as filtering the series one after another.  The filter itself does not change.

        Parameters
        ----------
        zs : array_like, shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1
            NaN where missing; pad series of unequal length with NaN.
        keep : sequence of str
            What to store, of ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``.
        us, fx_args, hx_args
            As in `filter`; the same for every series.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; or an unknown name in ``keep``.
        """
        names = check_keep(keep, FIELDS)
        return filter_each(self, as_many(zs, self.dim_z), names, us=us, fx_args=fx_args, hx_args=hx_args)

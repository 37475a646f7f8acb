"""Whole series through a linear filter, and filterpy's check of shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import FilterResult, as_many, as_observations, check_keep
from fuzzykf.engine.numpy import kalman_series as engine
from fuzzykf.errors import ShapeError
from fuzzykf.kalman._arguments import SINGULAR, SingularInnovationError, as_matrix, as_square
from fuzzykf.kalman._moments import filter_linear
from fuzzykf.kalman._series import (
    FIELDS,
    as_batch,
    as_result,
    collect,
    field_shapes,
    given_per_step,
    unchanged_on_error,
)
from fuzzykf.kalman._variants import LinearUpdates
from fuzzykf.kalman.smoothing import rts_smoother, smooth_moments

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["LinearSeries"]


class DimensionError(ShapeError, AssertionError):
    """A matrix of the wrong shape, found by `LinearSeries.test_matrix_dimensions`.

    It is an AssertionError too, which is what filterpy raises there.
    """


class LinearSeries(LinearUpdates):
    """Methods of a linear filter that take a whole series, or many."""

    def filter(
        self, zs: Iterable[ArrayLike | None] | ArrayLike, us: Sequence[Any] | None = None
    ) -> FilterResult:
        """Run predict and update along a series, from the current x and P on.

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
            With ``x``, ``P``, ``x_prior``, ``P_prior`` and ``log_likelihood``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the filter is then as it was before.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> result = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]).filter([1.0, None, 2.0])
        >>> result.x.ravel().round(3)
        array([0.667, 0.667, 1.636])
        """
        series = as_observations(zs, self.dim_z)
        self._remember()
        if us is None and len(series) and self._is_plain():
            return as_result(self._filter_at_once(series), zs)
        controls = given_per_step({"us": us}, len(series))
        with unchanged_on_error(self):
            stored = collect(
                self,
                series,
                lambda k: self.predict(**controls[k]),
                lambda _, z: self.update(z),
                field_shapes(self.dim_x),
            )
        return as_result(stored, zs)

    def _is_plain(self) -> bool:
        """Whether the verbs are this package's, and so may be done for all of a series at once."""
        return False

    def _filter_at_once(self, series: FloatArray, keep: tuple[str, ...] = FIELDS) -> dict[str, FloatArray]:
        """Do predict and update for a whole series, and stay at its last observation."""
        n, m = self.dim_x, self.dim_z
        (x, P), Q, F = self._state(), as_square("Q", self.Q, n), as_matrix("F", self.F, (n, n))
        H, R = as_matrix("H", self.H, (m, n)), as_square("R", self.R, m)
        shapes = field_shapes(n)
        stored = {name: np.empty((len(series), *shapes[name])) for name in keep}
        try:
            innovation = filter_linear(x, P, series, F, Q, H, R, self._alpha_sq, None, stored)
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error
        form, z = x.shape, series[-1]
        self._set_prior(stored["x_prior"][-1].reshape(form).copy(), stored["P_prior"][-1].copy())
        x, P = stored["x"][-1].reshape(form).copy(), stored["P"][-1].copy()
        if innovation is not None:
            self.y, self.S, self.SI, self.K = innovation
        if np.isnan(z).all():
            self._skip(x, P, m)
        else:
            self._set_innovation(x, P, z.reshape(self.y.shape).copy(), self.y, self.S, self.SI, self.K)
        return stored

    def smooth(
        self, zs: Iterable[ArrayLike | None] | ArrayLike, us: Sequence[Any] | None = None
    ) -> FilterResult:
        """Run `filter`, then the smoother of Rauch, Tung and Striebel backwards.

        Parameters
        ----------
        zs, us
            As in `filter`; the filter ends at the last observation.

        Returns
        -------
        FilterResult
            ``x`` and ``P`` given the whole series, and the ``log_likelihood`` of the filter.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> result = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]).smooth([1.0, None, 2.0])
        >>> result.x.ravel().round(3)
        array([0.909, 1.273, 1.636])
        """
        forward = self.filter(zs, us)
        n, d = len(forward), self.dim_x
        x, P, x_prior, P_prior = forward.x, forward.P, forward.x_prior, forward.P_prior
        assert x is not None
        assert P is not None
        assert x_prior is not None
        assert P_prior is not None
        F = np.broadcast_to(as_matrix("F", self.F, (d, d)), (n, d, d))
        x, P = smooth_moments(x, P, x_prior, P_prior, F, as_square("Q", self.Q, d), self._alpha_sq)
        return FilterResult(x=x, P=P, log_likelihood=forward.log_likelihood, index=forward.index)

    def filter_many(
        self,
        zs: ArrayLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: ArrayLike | None = None,
    ) -> FilterResult:
        """Filter many series at once, each from the current x and P on.

        The filter itself does not change.

        Parameters
        ----------
        zs : array_like, shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1
            NaN where missing; pad series of unequal length with NaN.
        keep : sequence of str
            What to store, of ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``.
        us : array_like, shape (series, n, dim_u) or (n, dim_u), optional
            Controls; the latter are the same for every series.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; an unknown name in ``keep``; an S that cannot be inverted.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf.kalman import KalmanFilter
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> result = kf.filter_many([[1.0, 2.0, 3.0], [1.0, np.nan, np.nan]], keep=["x"])
        >>> result.x[..., 0].round(3)
        array([[0.667, 1.5  , 2.429],
               [0.667, 0.667, 0.667]])
        """
        names = check_keep(keep, FIELDS)
        series = as_many(zs, self.dim_z)
        n, m = self.dim_x, self.dim_z
        x, P = self._state()
        F, Q = as_matrix("F", self.F, (n, n)), as_square("Q", self.Q, n)
        H, R = as_matrix("H", self.H, (m, n)), as_square("R", self.R, m)
        controls = None if us is None else self._control_series(us, series.shape[:2])
        shapes = field_shapes(n)
        out = {name: np.empty((*series.shape[:2], *shapes[name])) for name in names}
        try:
            engine.filter_many(x.reshape(n), P, series, F, Q, H, R, self._alpha_sq, controls, out)
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error
        return FilterResult(**out)

    def _control_series(self, us: ArrayLike, shape: tuple[int, int]) -> FloatArray:
        controls = np.asarray(us, dtype=np.float64)
        B = np.asarray(self.B, dtype=np.float64) if self.B is not None else None
        if B is None or B.ndim != 2:
            raise ShapeError(f"B: got shape {np.shape(self.B)}, expected ({self.dim_x}, dim_u) to go with us")
        k = B.shape[1]
        if controls.shape == (shape[1], k):
            controls = controls[None]
        if controls.shape not in {(1, shape[1], k), (*shape, k)}:
            raise ShapeError(f"us: got shape {np.shape(us)}, expected {(*shape, k)} or {(shape[1], k)}")
        term: FloatArray = controls @ B.T
        return term

    def batch_filter(
        self,
        zs: Sequence[ArrayLike | None] | ArrayLike,
        Fs: Sequence[Any] | None = None,
        Qs: Sequence[Any] | None = None,
        Hs: Sequence[Any] | None = None,
        Rs: Sequence[Any] | None = None,
        Bs: Sequence[Any] | None = None,
        us: Sequence[Any] | None = None,
        update_first: bool = False,
        saver: Any = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Filter a series whose matrices may change from step to step.

        Parameters
        ----------
        zs : sequence of n observations
            None or NaN where missing.
        Fs, Qs, Hs, Rs, Bs, us : sequence of n values, optional
            Matrices and controls of each step; None, as a whole or for single steps,
            means the attribute of the filter (for ``us``: no control).
        update_first : bool
            Update before predicting, instead of after it.
        saver : filterpy.common.Saver, optional
            Its ``save`` is called after each step.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            After the updates and after the predictions; means of shape (n, dim_x, 1), or
            (n, dim_x) if x is flat.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the filter is then as it was before.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> means, covariances, means_p, covariances_p = kf.batch_filter([1.0, 2.0], Rs=[1.0, 2.0])
        >>> means.shape, means.ravel().round(3)
        ((2, 1, 1), array([0.667, 1.273]))
        """
        observations = zs.to_numpy() if hasattr(zs, "to_numpy") else zs
        if not hasattr(observations, "__len__"):
            observations = list(observations)  # type: ignore[arg-type]
        n, d = len(observations), self.dim_x  # type: ignore[arg-type]
        given = (Fs, Qs, Hs, Rs, Bs, us, saver)
        if n and not update_first and all(one is None for one in given) and self._is_plain():
            self._remember()
            x, _ = self._state()
            series = as_observations(observations, self.dim_z)
            return as_batch(self._filter_at_once(series, FIELDS[:4]), x.ndim == 1)  # no log-likelihood
        moves = given_per_step({"us": us, "Bs": Bs, "Fs": Fs, "Qs": Qs}, n)
        looks = given_per_step({"Rs": Rs, "Hs": Hs}, n)
        self._remember()
        x, _ = self._state()
        shape: tuple[int, ...] = (n, d) if x.ndim == 1 else (n, d, 1)
        means, means_p = np.empty(shape), np.empty(shape)
        covariances, covariances_p = np.empty((n, d, d)), np.empty((n, d, d))

        def predict(k: int) -> None:
            self.predict(**moves[k])
            means_p[k], covariances_p[k] = self.x, self.P

        def update(k: int) -> None:
            self.update(observations[k], **looks[k])  # type: ignore[index]
            means[k], covariances[k] = self.x, self.P

        verbs: tuple[Callable[[int], None], ...] = (update, predict) if update_first else (predict, update)
        with unchanged_on_error(self):
            for k in range(n):
                for verb in verbs:
                    verb(k)
                if saver is not None:
                    saver.save()
        return means, covariances, means_p, covariances_p

    def rts_smoother(
        self,
        Xs: ArrayLike,
        Ps: ArrayLike,
        Fs: Sequence[Any] | None = None,
        Qs: Sequence[Any] | None = None,
        inv: Callable[[Any], Any] = np.linalg.inv,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Smooth the output of `batch_filter`; see `fuzzykf.kalman.rts_smoother`.

        Parameters
        ----------
        Xs, Ps, inv
            As there.
        Fs, Qs : sequence, optional
            As there; by default the attributes ``F`` and ``Q`` at every step.

        Returns
        -------
        x, P, K, Pp : ndarray
            As there.
        """
        n = len(np.asarray(Xs))
        Fs = [self.F] * n if Fs is None else Fs
        Qs = [self.Q] * n if Qs is None else Qs
        return rts_smoother(Xs, Ps, Fs, Qs, inv)

    def test_matrix_dimensions(
        self,
        z: ArrayLike | None = None,
        H: ArrayLike | None = None,
        R: ArrayLike | None = None,
        F: ArrayLike | None = None,
        Q: ArrayLike | None = None,
    ) -> None:
        """Check the shapes of x, P, Q, F, H, R and, if it is given, z.

        Parameters
        ----------
        z, H, R, F, Q : array_like, optional
            Checked instead of the attributes of these names.

        Raises
        ------
        ShapeError
            Names the matrix, its shape and the expected one.  It is an AssertionError as well.
        """
        n = self.dim_x
        H = self.H if H is None else H
        rows = np.shape(H)[0] if np.ndim(H) == 2 else self.dim_z
        column = np.ndim(self.x) == 2
        whole = (rows, 1) if column else (rows,)
        one = {(), (1,), (1, 1)} if rows == 1 else set()
        expected: dict[str, tuple[Any, set[tuple[int, ...]]]] = {
            "x": (self.x, {(n,), (n, 1)}),
            "P": (self.P, {(n, n)}),
            "Q": (self.Q if Q is None else Q, {(n, n)}),
            "F": (self.F if F is None else F, {(n, n)}),
            "H": (H, {(rows, n)}),
            "R": (self.R if R is None else R, {(rows, rows)} | one),
        }
        if z is not None:
            expected["z"] = (z, {whole} | one)
        for name, (value, admissible) in expected.items():
            if np.shape(value) not in admissible:
                shapes = " or ".join(str(shape) for shape in sorted(admissible, key=len, reverse=True))
                raise DimensionError(f"{name}: got shape {np.shape(value)}, expected {shapes}")

"""The extended Kalman filter, with filterpy's calls and with functions given once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.base import as_observations, check_keep
from fuzzykf.engine.selected import predict_stack, seen_components
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count, as_flag, brief
from fuzzykf.kalman.arguments import as_covariance, as_matrix, as_square, as_state, as_vector, control_term
from fuzzykf.kalman.controls import check_rows, control_moves, control_width, read_controls, takes_columns
from fuzzykf.kalman.forecast import MOST_STEPS, expected_nonlinear, forecast
from fuzzykf.kalman.gaussian_filter import GaussianFilter
from fuzzykf.kalman.linearization import (
    linearize_observation,
    observation_functions,
    transition_jacobian,
    with_control,
)
from fuzzykf.kalman.series import (
    FIELDS,
    as_batch,
    as_result,
    begin,
    collect,
    field_shapes,
    named_per_step,
    unchanged_on_error,
    whole_verb,
)
from fuzzykf.kalman.smoothing import check_motion, smooth_result
from fuzzykf.kalman.updates import condition, observed
from fuzzykf.many import as_output_type, as_stored, read_many, stacked
from fuzzykf.observations import check_aligned

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence

    from numpy.typing import DTypeLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.base import FilterResult
    from fuzzykf.estimation.result import LikelihoodFit
    from fuzzykf.kalman.series import PerStep

__all__ = ["ExtendedKalmanFilter"]


class ExtendedKalmanFilter(GaussianFilter):
    """Extended Kalman filter of x_k = f(x_{k-1}) + w_k, z_k = h(x_k) + v_k.

    It takes the place of ``filterpy.kalman.ExtendedKalmanFilter``, where functions are passed to `update`
    at each step.  If they are passed to the constructor instead, `step`, `filter`, `smooth` and
    `batch_filter` work as in the linear filter.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.
    dim_u : int
        Number of components of the control; for information only, as in filterpy.
    fx : callable, optional
        ``fx(x, **fx_args)`` maps a flat state (dim_x,) to the next.  A control is passed as the keyword
        argument ``u``, unless it is None or the number 0.  By default F x + B u.
    FJacobian : callable, optional
        Jacobian of ``fx``, with the same arguments; returns (dim_x, dim_x), or a number if that is (1, 1).
        By default computed by central differences.
    hx : callable, optional
        ``hx(x, **hx_args)`` maps a flat state to an observation (dim_z,).
    HJacobian : callable, optional
        Jacobian of ``hx``, with the same arguments; returns (dim_z, dim_x), or a number if that is (1, 1).
        By default computed by central differences.
    residual : callable
        ``residual(z, hx(x))``, the difference of two observations; wrap angles here.
    x, P, F, Q, R : array_like, optional
        Initial values of the attributes of the same names; unlike a later
        assignment they are checked.

    Attributes
    ----------
    x, P, F, Q, R, B, x_prior, P_prior, x_post, P_post, z, y, S, SI, K
        As in `KalmanFilter`; ``B`` is initially 0.  With ``fx`` given, ``F`` is its
        Jacobian at the latest prediction.
    fx, FJacobian, hx, HJacobian, residual
        As given.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If a dimension is below one, a matrix has the wrong shape, or a covariance is not positive
        semi-definite.

    Notes
    -----
    Prediction: x^- = f(x), P^- = F P F' + Q with F the Jacobian of f at x.  Update:
    K = P G' (G P G' + R)^-1, x + K (z - g(x)), with G the Jacobian of g at x^-.  These
    are equations (69) to (75) of the source; P is updated in Joseph's form instead
    of (74).

    References
    ----------
    J. R. Layne, K. M. Passino, A fuzzy dynamic model based state estimator, Fuzzy Sets and
    Systems 122 (2001), 45-72, section 4.1.

    Examples
    --------
    >>> import numpy as np
    >>> def distance(x):
    ...     return np.hypot(x[:1], 1.0)
    >>> ekf = ExtendedKalmanFilter(dim_x=1, dim_z=1, hx=distance, Q=0.01, R=0.01)
    >>> ekf.x = np.array([2.0])
    >>> ekf.filter([3.2, 3.1, 3.2]).x.ravel().round(2)
    array([3.06, 2.98, 3.02])
    """

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dim_u: int = 0,
        *,
        fx: Callable[..., Any] | None = None,
        FJacobian: Callable[..., Any] | None = None,
        hx: Callable[..., Any] | None = None,
        HJacobian: Callable[..., Any] | None = None,
        residual: Callable[[Any, Any], Any] = np.subtract,
        x: Numbers = None,
        P: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
        R: Numbers = None,
    ) -> None:
        functions = {"fx": fx, "FJacobian": FJacobian, "hx": hx, "HJacobian": HJacobian, "residual": residual}
        for name, function in functions.items():
            if function is not None and not callable(function):
                raise ParameterError(f"{name}: got {brief(function)}, expected a function")
        super().__init__(dim_x, dim_z, dim_u, x=x, P=P, F=F, Q=Q, R=R)
        self.B = 0
        self.fx, self.FJacobian = fx, FJacobian
        self.hx, self.HJacobian = hx, HJacobian
        self.residual = residual

    # ------------------------------------------------------------------ prediction

    def predict_x(self, u: Any = 0, **fx_args: Any) -> None:
        """Predict x without its covariance; override it for your own dynamics.

        Parameters
        ----------
        u : array_like
            Control input.
        **fx_args
            Passed to ``fx``.
        """
        x = as_state(self.x, self.dim_x)
        if self.fx is None:
            if fx_args:
                raise ParameterError(f"fx: got the arguments {', '.join(fx_args)}, but the filter has no fx")
            F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
            self.x = F.dot(x) + control_term(self.B, u, x)
        else:
            moved = self.fx(x.flatten(), **with_control(fx_args, u))
            self.x = as_vector("fx", moved, x.ravel()).reshape(x.shape)

    def predict(self, u: Any = 0, **fx_args: Any) -> None:
        """Move the estimate to the time of the next observation.

        Parameters
        ----------
        u : array_like
            Control input; None or 0 for none.
        **fx_args
            Passed to ``fx`` and ``FJacobian``, for instance the time.

        Raises
        ------
        ParameterError, ShapeError
            If shapes do not agree, a function returns an inadmissible value, or arguments are given without
            an ``fx``.
        """
        with whole_verb(self):
            u = 0 if u is None else u
            x, P = self._state()
            Q = as_square("Q", self.Q, self.dim_x)
            F = None
            if self.fx is not None:
                F = transition_jacobian(self.fx, self.FJacobian, x.flatten(), with_control(fx_args, u))
            with unchanged_on_error(self):
                self.predict_x(u, **fx_args)
                if F is not None:
                    self.F = F
                F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
                x = as_state(self.x, self.dim_x)
                self._set_prior(x, predict_stack(P, F, Q, 1.0))

    # ------------------------------------------------------------------ update

    def update(
        self,
        z: Numbers,
        HJacobian: Callable[..., Any] | None = None,
        Hx: Callable[..., Any] | None = None,
        R: Numbers = None,
        args: Any = (),
        hx_args: Any = (),
        residual: Callable[[Any, Any], Any] | None = None,
        **hx_kwargs: Any,
    ) -> None:
        """Take an observation into account.

        Parameters
        ----------
        z : array_like
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z); None or
            NaN where missing.
        HJacobian, Hx : callable, optional
            Used instead of the attributes ``HJacobian`` and ``hx``.  As in filterpy, they
            get x as the filter holds it, flat or as a column.  With ``Hx`` only, the Jacobian is computed by
            central differences.
        R : array_like, optional
            Used instead of the attribute ``R``; a scalar means that multiple of the identity.
        args, hx_args : tuple
            Further positional arguments of ``HJacobian`` and of ``Hx``.
        residual : callable, optional
            Used instead of the attribute ``residual``.
        **hx_kwargs
            Keyword arguments of both functions, for instance the time.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If shapes are wrong, z is infinite, ``Hx`` is missing, ``R`` is inadmissible, or S cannot be
            inverted.

        Examples
        --------
        >>> import numpy as np
        >>> ekf = ExtendedKalmanFilter(dim_x=1, dim_z=1)
        >>> ekf.x = np.array([2.0])
        >>> ekf.update(5.0, HJacobian=lambda x: np.array([2.0 * x]), Hx=lambda x: x**2)
        >>> ekf.x.round(3)
        array([2.235])
        """
        with whole_verb(self):
            x, P = self._state()
            if z is None:
                self._skip(x, P, self.dim_z)
                return
            args = args if isinstance(args, tuple) else (args,)
            hx_args = hx_args if isinstance(hx_args, tuple) else (hx_args,)
            residual = self.residual if residual is None else residual
            for name, function in (("HJacobian", HJacobian), ("Hx", Hx), ("residual", residual)):
                if function is not None and not callable(function):
                    raise ParameterError(f"{name}: got {brief(function)}, expected a function")
            own, given = (self.hx, self.HJacobian), (Hx, HJacobian)
            functions = observation_functions(own, given, x.shape, args, hx_args, hx_kwargs)
            predicted, H = linearize_observation(*functions, x, residual)
            m = predicted.size
            noise = as_square("R", self.R, m) if R is None else as_covariance("R", R, m)
            value = observed(z, m, x)
            if value is None:
                self._skip(x, P, m)
                return
            # the residual function may be anything: it sees the prediction where z is missing
            seen = seen_components(value)
            known = value.copy() if seen is None else np.where(np.isnan(value), predicted, value)
            y = as_vector("residual", residual(known, predicted), predicted)
            if seen is not None:
                y = np.where(seen.reshape(y.shape), y, 0.0)
            x, P, S, SI, K = condition(x, P, y, H, noise, self._I, self.inv, seen)
            self._set_innovation(x, P, value, y, S, SI, K)

    def predict_update(
        self,
        z: Numbers,
        HJacobian: Callable[..., Any] | None = None,
        Hx: Callable[..., Any] | None = None,
        args: Any = (),
        hx_args: Any = (),
        u: Any = 0,
    ) -> None:
        """Predict, then update; an error leaves the filter unchanged.

        Parameters
        ----------
        z, HJacobian, Hx, args, hx_args
            As in `update`.
        u
            As in `predict`.
        """
        with whole_verb(self), unchanged_on_error(self):
            self.predict(u)
            self.update(z, HJacobian, Hx, args=args, hx_args=hx_args)

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        *,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the current x and P.

        The filter ends at the last observation, so `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : sequence of n controls, or array_like of shape (n, dim_u), optional
            Passed to `predict` one by one.  A pandas index must equal that of ``zs``.
        fx_args, hx_args : sequence of n dict, optional
            Keyword arguments of each prediction and of each update.
        resume : bool
            Accepted for compatibility with switching filters; the filter always starts from its current x
            and P.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior`` and ``log_likelihood``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the filter is then unchanged.
        """
        begin(self, zs, resume, fx_args is not None)
        return as_result(self, self._collect(zs, us, fx_args, hx_args), zs, fx_args is not None)

    def _collect(
        self,
        zs: Any,
        us: Any,
        fx_args: Any,
        hx_args: Any,
        moved: Callable[[int, FloatArray, FloatArray], None] | None = None,
    ) -> dict[str, FloatArray]:
        check_aligned(zs=zs, us=us, fx_args=fx_args, hx_args=hx_args)
        series = as_observations(zs, self.dim_z)
        n = len(series)
        before, after = named_per_step("fx_args", fx_args, n), named_per_step("hx_args", hx_args, n)
        moves = [dict(**control, **before[k]) for k, control in enumerate(control_moves(us, n, [self]))]
        with whole_verb(self):
            looks = after
            return collect(self, series, field_shapes(self.dim_x), moves, looks, moved=moved)

    def smooth(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> FilterResult:
        """Smooth a series: run `filter`, then the extended Rauch-Tung-Striebel smoother.

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
            As from `filter`; if a subclass overrides `predict` so that P does not move by F and Q, as the
            backward pass assumes.
        """
        d = self.dim_x
        motions: list[tuple[FloatArray, FloatArray]] = []

        def moved(k: int, x: FloatArray, P: FloatArray) -> None:
            """Keep how the state moved, which changes from step to step."""
            F, Q = as_matrix("F", self.F, (d, d)).copy(), as_square("Q", self.Q, d).copy()
            check_motion(self, k, None, predict_stack(P, F, Q, 1.0), "F and Q")
            motions.append((F, Q))

        forward = as_result(self, self._collect(zs, us, fx_args, hx_args, moved), zs, fx_args is not None)
        F, Q = np.array(motions).reshape(len(motions), 2, d, d).swapaxes(0, 1)
        return smooth_result(forward, F, Q)

    def forecast(
        self,
        steps: int,
        us: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
    ) -> FilterResult:
        """Forecast states and observations; the filter does not change.

        Parameters
        ----------
        steps : int
            Number of predictions from the current x and P.
        us, fx_args, hx_args
            As in `filter`, one per step.  A pandas index must equal that of the rows ahead, if these are
            known.

        Returns
        -------
        FilterResult
            With ``x``, ``P`` and, if the filter has ``hx``, mean ``z_prior`` and covariance ``S`` of
            the observations, to first order.

        Raises
        ------
        ShapeError, ParameterError
            As from `predict`; if ``steps`` is below one.
        """

        def moves(n: int) -> list[dict[str, Any]]:
            before = named_per_step("fx_args", fx_args, n)
            return [dict(**u, **before[k]) for k, u in enumerate(control_moves(us, n, [self]))]

        def expected(f: Any, k: int) -> Any:
            return expected_nonlinear(f, after[k])

        after = named_per_step("hx_args", hx_args, as_count("steps", steps, 1, MOST_STEPS))
        given = {"us": us, "fx_args": fx_args, "hx_args": hx_args}
        return forecast(self, steps, given, moves, expected)

    def batch_filter(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        *,
        resume: bool = False,
    ) -> tuple[FloatArray, ...]:
        """Run `filter` and return filterpy's four arrays.

        Parameters
        ----------
        zs, us, fx_args, hx_args, resume
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            After the updates and after the predictions; means of shape (n, dim_x, 1), or
            (n, dim_x) if x is flat.
        """
        as_flag("resume", resume)
        x, _ = self._state()
        return as_batch(self, self._collect(zs, us, fx_args, hx_args), zs, x.ndim == 1)

    def fit(
        self,
        zs: ManyNumbers | ManySeriesLike,
        *,
        free: Mapping[str, Any] | None = None,
        us: ManySeriesLike | PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        n_starts: int = 1,
        rng: np.random.Generator | None = None,
        max_iter: int = 500,
        tolerance: float = 1e-7,
        progress: bool | None = None,
    ) -> LikelihoodFit[Self]:
        """Learn noise covariances or other parameters from observations, by maximum likelihood.

        Like `KalmanFilter.fit`, for filters whose functions were passed to the constructor.  The likelihood
        is that of the linearised system, and its gradient is computed by central differences, with two
        passes through the series per free parameter.

        Parameters
        ----------
        zs, free, us, n_starts, rng, max_iter, tolerance, progress
            As in `KalmanFilter.fit`, except that ``free`` cannot include ``H``, nor ``F`` and ``B`` with an
            ``fx``.
        fx_args, hx_args
            As in `filter`; the same for every series.

        Returns
        -------
        LikelihoodFit
            As from `KalmanFilter.fit`.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `KalmanFilter.fit`, and from `filter`.

        Examples
        --------
        >>> import numpy as np
        >>> rng = np.random.default_rng(0)
        >>> x = np.cumsum(0.1 * rng.normal(size=100))
        >>> ekf = ExtendedKalmanFilter(
        ...     1, 1, hx=np.exp, HJacobian=lambda x: np.exp(x)[None], Q=0.01
        ... )
        >>> fit = ekf.fit(np.exp(x) + 0.2 * rng.normal(size=100), free={"R": "full"})
        >>> round(fit.estimates["R[0, 0]"], 3)
        0.043
        """
        from fuzzykf.kalman.learning.fit import fit_filter

        options: dict[str, Any] = {"n_starts": n_starts, "rng": rng, "max_iter": max_iter}
        given: dict[str, Any] = {"us": us, "fx_args": fx_args, "hx_args": hx_args, "progress": progress}
        return fit_filter(self, zs, free=free, tolerance=tolerance, **given, **options)

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: ManySeriesLike | PerStep = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        *,
        by: Hashable | None = None,
        dtype: DTypeLike = np.float64,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each starting from the current x and P.

        The filter itself does not change.  The functions are called for one state at a time, so this takes as
        long as filtering the series one by one.

        Parameters
        ----------
        zs : array_like, DataFrame, DataArray, list, tuple or mapping
            Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1; NaN where missing.  Or a frame with a
            column for each series (pairs (series, component) if ``dim_z`` is not 1), or a list or mapping of
            series of any lengths, each as `filter` takes it.
        keep : sequence of str
            Fields to store, from ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``.
        us : array_like, DataFrame, DataArray, list, tuple or mapping, optional
            Controls, the same for all series or one set per series, as in `KalmanFilter.filter_many`.  With
            ``fx``, ``dim_u`` resolves ambiguous shapes.
        fx_args, hx_args
            As in `filter`; the same for every series.
        by : hashable, optional
            Column (or index level) that names the series of each row, if the frame holds all series one after
            another.
        dtype : numpy.float64 or numpy.float32
            Type in which results are stored.  Computations are in double precision.
        resume : bool
            As in `filter`.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.  Names and index are kept, see `FilterResult.to_dataframe`.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if a name in ``keep`` is unknown.
        """
        as_flag("resume", resume)
        names, dtype = check_keep(keep, FIELDS), as_output_type(dtype)
        given = {"fx_args": fx_args, "hx_args": hx_args}
        many = read_many(zs, self.dim_z, by, uneven=fx_args is not None)
        check_rows(many, **given)
        controls = None if us is None else read_controls(us, many, control_width([self]))

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            each = [given] * len(series)
            if controls is not None:
                own = controls.of(rows, series.shape[:2], takes_columns([self]))
                each = [{**given, **one} for one in own]
            found = stacked(self._filter_each(series, each), names)
            return as_stored(found, dtype)

        return many.filtered(several)

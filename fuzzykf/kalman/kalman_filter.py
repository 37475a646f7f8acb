"""The linear Kalman filter, with the interface of filterpy's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.base import FilterResult, as_observations
from fuzzykf.engine.selected import predict_linear
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_flag, as_numbers, as_real
from fuzzykf.kalman import linear_series, variants
from fuzzykf.kalman.arguments import (
    as_covariance,
    as_matrix,
    as_square,
    as_state,
    check_dimensions,
    control_term,
    fits,
    given_matrix,
    observation_matrix,
)
from fuzzykf.kalman.forecast import expected_linear, forecast
from fuzzykf.kalman.gaussian_filter import HOOKS, LEAST_LOG_LIKELIHOOD, GaussianFilter
from fuzzykf.kalman.looking_back import LinearWayBack, smooth_lag
from fuzzykf.kalman.series import as_batch, as_result, given_per_step, one_by_one, run_verbs, whole_verb
from fuzzykf.kalman.smoothing import rts_smoother, smooth_result
from fuzzykf.kalman.step_arguments import given_motion, motion_over, read_series, read_steps
from fuzzykf.kalman.stepper import LinearStepper
from fuzzykf.kalman.updates import condition, condition_linear, log_density, observed, zero_where_missing
from fuzzykf.observations import check_aligned
from fuzzykf.overrides import VERBS, is_patched, lookups, overrides

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Mapping

    from numpy.typing import ArrayLike, DTypeLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.estimation.result import LikelihoodFit
    from fuzzykf.kalman.series import PerStep

__all__ = ["KalmanFilter"]


class KalmanFilter(LinearStepper, GaussianFilter):
    """Kalman filter of x_k = F x_{k-1} + B u_k + w_k, z_k = H x_k + v_k.

    It takes the place of ``filterpy.kalman.KalmanFilter``: construct it, assign the
    matrices, then call `predict` and `update` in turn, or `step`, or one of the
    methods for whole series.  Attributes may be assigned at any
    time; if ``x`` is set to a flat array, all vectors become flat.  A scalar ``P``, ``Q`` or
    ``R`` stands for that multiple of the identity; ``F``, ``H`` and ``B`` may be scalars where
    they have one row and column.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.
    dim_u : int
        Number of components of the control; for information only, as in filterpy.
    x, P, F, H, Q, R, B : array_like, optional
        Initial values of the attributes of the same names; unlike a later
        assignment they are checked.  ``F`` and ``Q`` may be functions.

    Attributes
    ----------
    x : ndarray, shape (dim_x, 1) or (dim_x,)
        Estimate of the state; zero at first.
    P : ndarray, shape (dim_x, dim_x)
        Its covariance; the identity at first.
    F, Q : ndarray, shape (dim_x, dim_x)
        Transition and covariance of the process noise; identities at first.  Each may instead be a
        function of the elapsed time that returns the matrix; every prediction then needs ``dt``.
    H : ndarray, shape (dim_z, dim_x)
        Observation matrix; zero at first.
    R : ndarray, shape (dim_z, dim_z)
        Covariance of the observation noise; the identity at first.
    B : ndarray, shape (dim_x, dim_u), or None
        Control matrix.
    M : ndarray, shape (dim_x, dim_z)
        Covariance of prediction error and observation noise, for `update_correlated`.
    x_prior, P_prior, x_post, P_post : ndarray
        Copies of x and P after the latest prediction and after the latest update.
    z, y : ndarray, shape (dim_z, 1) or (dim_z,)
        Latest observation and its residual y = z - H x_prior.
    S, SI : ndarray, shape (dim_z, dim_z)
        Covariance of the residual and its inverse.  Where components of z are
        missing, SI is the inverse of the block of the others, bordered by zeros.
    K : ndarray, shape (dim_x, dim_z)
        Gain.
    inv : callable
        Inverts S.  As long as it is `numpy.linalg.inv`, S has to be positive definite.
    log_likelihood, likelihood, mahalanobis : float
        Fit of the latest observation; see the properties below.
    alpha : float
        Fading memory; see below.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If a dimension is below one, a matrix has the wrong shape, or a covariance is not positive
        semi-definite.

    See Also
    --------
    ExtendedKalmanFilter, IMMEstimator

    Notes
    -----
    A missing observation (None, or NaN in all components) leaves x and P as
    predicted and has the log-likelihood 0.  Of an observation with NaN in some
    components the others are used.  The covariance is updated in Joseph's form.

    An array read from an attribute does not change when the filter moves on.  Writing into it
    changes the filter.

    References
    ----------
    R. E. Kalman, A new approach to linear filtering and prediction problems,
    J. Basic Engineering 82 (1960), 35-45.

    Examples
    --------
    >>> import numpy as np
    >>> kf = KalmanFilter(dim_x=2, dim_z=1)
    >>> kf.F = np.array([[1.0, 1.0], [0.0, 1.0]])
    >>> kf.H = np.array([[1.0, 0.0]])
    >>> kf.Q = 0.01
    >>> for z in (1.0, 2.0, None, 4.0):
    ...     kf.predict()
    ...     kf.update(z)
    >>> kf.x.round(2)
    array([[3.78],
           [0.9 ]])
    """

    H: Any
    M: Any

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dim_u: int = 0,
        *,
        x: Numbers = None,
        P: Numbers = None,
        F: Numbers | Callable[[float], Any] = None,
        H: Numbers = None,
        Q: Numbers | Callable[[float], Any] = None,
        R: Numbers = None,
        B: Numbers = None,
    ) -> None:
        super().__init__(dim_x, dim_z, dim_u, x=x, P=P, R=R)
        self.F, self.Q = given_motion(F, Q, dim_x)
        self.H = np.zeros((dim_z, dim_x)) if H is None else given_matrix("H", H, (dim_z, dim_x))
        self.M = np.zeros((dim_x, dim_z))
        self.B = None if B is None else given_matrix("B", B, (dim_x, None), may_be_one=dim_u <= 1)

    @property
    def alpha(self) -> float:
        """Fading memory: P is predicted as alpha^2 F P F' + Q; 1 is the plain Kalman filter.

        Values slightly above 1 let old observations count for less (D. Simon,
        Optimal State Estimation, Wiley 2006, section 7.4).
        """
        return float(self._alpha_sq**0.5)

    @alpha.setter
    def alpha(self, value: float) -> None:
        expected = "a number of at least 1 and less than 1e150"
        alpha = as_real("alpha", value, expected)
        if not 1.0 <= alpha < 1e150:
            raise ParameterError(f"alpha: got {value!r}, expected {expected}")
        self._alpha_sq = alpha**2

    # ------------------------------------------------------------------ verbs

    def predict(
        self,
        u: Numbers = None,
        B: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
        *,
        dt: float | None = None,
    ) -> None:
        """Move the estimate to the time of the next observation.

        Parameters
        ----------
        u : array_like, optional
            Control input, shape (dim_u, 1), or (dim_u,) if x is flat.
        B, F, Q : array_like, optional
            Used instead of the attributes of these names; a scalar ``Q`` means that
            multiple of the identity.
        dt : float, optional
            Elapsed time, at least 0; needed if ``F`` or ``Q`` is a function of it.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If shapes do not agree, ``Q`` is not a covariance, ``dt`` is missing where ``F`` or ``Q`` is a
            function, or given where neither is.

        Examples
        --------
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, B=[[2.0]])
        >>> kf.predict(u=3.0)
        >>> kf.x, kf.P
        (array([[6.]]), array([[2.]]))
        """
        if dt is not None:
            F, Q = motion_over(self, dt, F, Q)
        elif u is None and B is None and F is None and Q is None and self._predict_at_once():
            return
        with whole_verb(self):
            self._set_prior(*self.get_prediction(u, B, F, Q))

    def update(self, z: Numbers, R: Numbers = None, H: Numbers = None) -> None:
        """Take an observation into account.

        Parameters
        ----------
        z : array_like
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z); None or
            NaN where missing.
        R : array_like, optional
            Used instead of the attribute ``R``; a scalar means that multiple of the identity.
        H : array_like, shape (m, dim_x), optional
            Used instead of the attribute ``H``; z and R then have m components.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; an infinite z; an inadmissible ``R``; an S that cannot be inverted.

        Examples
        --------
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> kf.update(2.0)
        >>> kf.x, kf.P, round(kf.log_likelihood, 12)
        (array([[1.]]), array([[0.5]]), -2.265512123485)
        """
        if R is None and H is None and self._update_at_once(z):
            return
        with whole_verb(self):
            x, P, H, R = self._observation(R, H)
            value = observed(z, H.shape[0], x)
            if value is None:
                self._skip(x, P, H.shape[0])
                return
            x, P, y, S, SI, K = condition_linear(x, P, value, H, R, self._I, self.inv)
            self._set_innovation(x, P, value, y, S, SI, K)

    def _observation(self, R: Any, H: Any) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return x, P, H and R for this call; H and R are its own or the filter's."""
        x, P, n, m = self.x, self.P, self.dim_x, self.dim_z
        if H is None:
            H = self.H
        else:
            H = observation_matrix("H", H, n, m)
            m = H.shape[0]
        R = self.R if R is None else as_covariance("R", R, m)
        if not fits(n, m, x, P, H, R):
            (x, P), H, R = self._state(), as_matrix("H", H, (m, n)), as_square("R", R, m)
        return x, P, H, R

    def _step_any(self, z: Numbers) -> FloatArray:
        """Do a step with any observation, by the verbs; an error leaves the filter as it was."""
        return self._step_or_stay(z)

    def _is_plain(self) -> bool:
        return (
            type(self)._overrides() == 0
            and not overrides(type(self), _READ)
            and self.inv is np.linalg.inv
            and not is_patched(self, _PATCHED)
        )

    @classmethod
    def _overrides(cls) -> int:
        return overrides(cls, _HOOKS) | overrides(cls, _VERBS) << 1

    # ------------------------------------------------------------------ other verbs

    def predict_steadystate(self, u: Numbers = None, B: Numbers = None) -> None:
        """Predict the state; the covariance does not change.

        Use it with `update_steadystate`, after K and P have converged.

        Parameters
        ----------
        u : array_like, optional
            Control input.
        B : array_like, shape (dim_x, dim_u), optional
            Used instead of the attribute ``B``.

        Raises
        ------
        ShapeError
            If the shapes do not agree.

        Examples
        --------
        >>> import numpy as np
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], F=[[0.5]])
        >>> for _ in range(50):
        ...     _ = kf.step(0.0)
        >>> P = kf.P.copy()
        >>> kf.predict_steadystate()
        >>> kf.update_steadystate(1.0)
        >>> bool(kf.x == kf.K), bool((kf.P == P).all())
        (True, True)
        """
        with whole_verb(self):
            x, P = self._state()
            F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
            x = F.dot(x) + control_term(self.B if B is None else B, u, x)
            self._set_prior(x, P.copy())

    def update_steadystate(self, z: Numbers) -> None:
        """Update the state with the current gain K; P, S and K do not change.

        Parameters
        ----------
        z : array_like
            The observation; None or NaN where missing.  A missing component counts
            as observed exactly at its prediction, because the gain is fixed.

        Raises
        ------
        ShapeError
            If the shapes do not agree.
        """
        with whole_verb(self):
            x, P = self._state()
            H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
            K = as_matrix("K", self.K, (self.dim_x, self.dim_z))
            value = observed(z, self.dim_z, x)
            if value is None:
                self._skip(x, P, self.dim_z)
                return
            x, y, seen = variants.update_with_gain(x, value, H, K)
            self._set_posterior(x, P.copy())
            self.z, self.y = value, y
            if seen is not None:
                self._log_likelihood = log_density(y, as_square("S", self.S, self.dim_z), seen)

    def update_correlated(self, z: Numbers, R: Numbers = None, H: Numbers = None) -> None:
        """Update with observation noise that is correlated with the prediction error.

        With M = Cov(x - x_prior, v), the gain is K = (P H' + M) S^-1 with
        S = H P H' + H M + M' H' + R.

        Parameters
        ----------
        z : array_like
            The observation; None or NaN where missing.
        R : array_like, optional
            Used instead of the attribute ``R``; a scalar means that multiple of the identity.
        H : array_like, shape (m, dim_x), optional
            Used instead of the attribute ``H``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; an inadmissible ``R``; an S that cannot be inverted.

        References
        ----------
        Simon, D., Optimal State Estimation, Wiley 2006, section 7.1.

        Examples
        --------
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> kf.M = [[0.5]]
        >>> kf.update_correlated(3.0)
        >>> kf.K, kf.P
        (array([[0.5]]), array([[0.25]]))
        """
        with whole_verb(self):
            x, P, H, R = self._observation(R, H)
            M = as_matrix("M", self.M, (self.dim_x, H.shape[0]))
            value = observed(z, H.shape[0], x)
            if value is None:
                self._skip(x, P, H.shape[0])
                return
            y, seen = zero_where_missing(value - H.dot(x), value)
            x, P, S, SI, K = condition(x, P, y, H, R, self._I, self.inv, seen, M)
            self._set_innovation(x, P, value, y, S, SI, K)

    def update_sequential(self, start: int, z_i: Numbers, R_i: Numbers = None, H_i: Numbers = None) -> None:
        """Update with a block of adjacent components of an observation.

        Where R is block diagonal, one call per block gives the same estimate as one
        update with all components.  The entries of z, y and K that belong to the
        block are written, S and SI are not; the likelihoods are those of the block
        given all that came before it.

        Parameters
        ----------
        start : int
            Index of the first component of the block.
        z_i : array_like
            The components; NaN where missing.
        R_i : array_like, optional
            Their noise covariance; by default that block of ``R``.
        H_i : array_like, shape (m, dim_x), optional
            Their rows of the observation matrix; by default those of ``H``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; a block outside the observation; an inadmissible ``R_i``.

        Examples
        --------
        >>> import numpy as np
        >>> whole = KalmanFilter(dim_x=2, dim_z=2, H=np.eye(2))
        >>> parts = whole.copy()
        >>> whole.update([1.0, 2.0])
        >>> parts.update_sequential(0, 1.0)
        >>> parts.update_sequential(1, 2.0)
        >>> bool(np.allclose(whole.x, parts.x))
        True
        """
        with whole_verb(self):
            (x, P), m = self._state(), self.dim_z
            block = variants.block_of(start, as_numbers("z_i", z_i).size, m)
            H, R = variants.block_matrices(block, H_i, R_i, self.H, self.R, (m, self.dim_x))
            whole = variants.whole_observation(self.z, self.y, self.K, (m, 1)[: x.ndim], (self.dim_x, m))
            x, P, log_likelihood, mahalanobis = variants.update_block(
                x, P, z_i, H, R, block, whole, self._I, self.inv
            )
            self._set_posterior(x, P)
            self.z, self.y, self.K = whole
            self._log_likelihood, self._mahalanobis = log_likelihood, mahalanobis

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        dt: PerStep | float | None = None,
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
        Rs, Hs : sequence of n, optional
            Matrix of each observation, as an array (n, ...) or a list.  None in a list means the attribute; a
            scalar in ``Rs`` (or ``Qs``) means that multiple of the identity.  A pandas index must equal that
            of ``zs``.
        Fs, Qs : sequence of n, optional
            Matrix of each prediction, likewise: entry k leads to observation k.
        dt : float or sequence of n floats, optional
            Time elapsed before each observation, if ``F`` or ``Q`` is a function of it; ``dt[0]`` is the time
            before the first.  ``Fs`` and ``Qs`` take precedence over the functions.
        resume : bool
            Accepted for compatibility with switching filters; a Kalman filter always starts from its current
            x and P.

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
        >>> result = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]).filter([1.0, None, 2.0])
        >>> result.x.ravel().round(3)
        array([0.667, 0.667, 1.636])
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], Q=lambda dt: 0.5 * dt)
        >>> kf.filter([1.0, 2.0], dt=[1.0, 0.25], Rs=[None, 4.0]).x.ravel().round(2)
        array([0.6 , 0.81])
        """
        told = {"us": us, "Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "dt": dt}
        series, steps = read_series(self, zs, told, resume)
        with whole_verb(self):
            return as_result(self, linear_series.forward(self, series, steps), zs, steps.uneven)

    def smooth(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        dt: PerStep | float | None = None,
    ) -> FilterResult:
        """Smooth a series: run `filter`, then the Rauch-Tung-Striebel smoother.

        Parameters
        ----------
        zs, us, Rs, Qs, Fs, Hs, dt
            As in `filter`; the filter ends at the last observation.

        Returns
        -------
        FilterResult
            ``x`` and ``P`` given the whole series, and the ``log_likelihood`` of the filter.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if a subclass overrides `predict` so that the state does not move by F, B and Q,
            as the backward pass assumes.

        Examples
        --------
        >>> result = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]).smooth([1.0, None, 2.0])
        >>> result.x.ravel().round(3)
        array([0.909, 1.273, 1.636])
        """
        told = {"us": us, "Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "dt": dt}
        series, steps = read_series(self, zs, told)
        with whole_verb(self):
            stored, F, noise = linear_series.forward_and_motions(self, series, steps)
            return smooth_result(as_result(self, stored, zs, steps.uneven), F, noise)

    def smooth_lag(
        self,
        zs: ManyNumbers,
        lag: int,
        us: PerStep | None = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        dt: PerStep | float | None = None,
    ) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given the observations up to ``lag`` steps later.

        Parameters
        ----------
        zs, us, Rs, Qs, Fs, Hs, dt
            As in `filter`; the filter ends at the last observation.
        lag : int
            Number of steps to look ahead, at least 0: row n is the estimate given the observations up to
            n + lag, or to the end.  0 is `filter`; the length of the series is `smooth`.

        Returns
        -------
        FilterResult
            ``x`` and ``P``, and the ``log_likelihood`` of the filter.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `smooth`; if ``lag`` is not an integer of at least 0.  The filter is then unchanged.

        See Also
        --------
        fuzzykf.FixedLag : The same step by step.

        Examples
        --------
        >>> result = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]).smooth_lag(
        ...     [1.0, None, 2.0], lag=1
        ... )
        >>> result.x.ravel().round(3)
        array([0.667, 1.273, 1.636])
        """
        return smooth_lag(self, zs, lag, {"us": us, "Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "dt": dt})

    _way_back = LinearWayBack  # of `fuzzykf.FixedLag`

    def forecast(
        self, steps: int, us: PerStep | None = None, *, dt: PerStep | float | None = None
    ) -> FilterResult:
        """Forecast states and observations; the filter does not change.

        Parameters
        ----------
        steps : int
            Number of predictions from the current x and P.  A `predict` since the latest observation is
            not counted.
        us : sequence of controls, or array_like of shape (steps, dim_u), optional
            One per step.  A pandas index must equal that of the rows ahead, if these are known.
        dt : float or sequence of floats, optional
            Elapsed time of each step, as in `filter`.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, and mean ``z_prior`` and covariance ``S`` of the observations.

        Raises
        ------
        ShapeError, ParameterError
            As from `predict`; if ``steps`` is below one.

        Examples
        --------
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> kf.filter([1.0, 2.0]).x.ravel().round(2)
        array([0.67, 1.5 ])
        >>> kf.forecast(2).S.ravel().round(3)
        array([2.625, 3.625])
        """
        told: dict[str, Any] = {"us": us, "dt": dt}
        return forecast(self, steps, told, lambda n: read_steps(self, n, **told).moves(), expected_linear)

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: ManySeriesLike | PerStep = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        dt: ManySeriesLike | PerStep | float | None = None,
        by: Hashable | None = None,
        threads: int = 1,
        dtype: DTypeLike = np.float64,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series at once, each starting from the current x and P.

        The filter itself does not change.  Complete series share their covariances, which do not depend on
        the observations; a series with gaps has its own from its first gap on.

        Parameters
        ----------
        zs : array_like, DataFrame, DataArray, list, tuple or mapping
            Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1; NaN where missing.  Or a frame with a
            column for each series (pairs (series, component) if ``dim_z`` is not 1), or a list or mapping of
            series of any lengths, each as `filter` takes it.
        keep : sequence of str
            Fields to store, from ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``.
        us : array_like, DataFrame, DataArray, list, tuple or mapping, optional
            Controls.  Shape (n, dim_u), or anything `filter` takes: the same for every series.  Shape
            (series, n, dim_u), (series, n) if ``dim_u`` is 1, or a frame, list or mapping like ``zs``: one
            set per series.  A pandas index must equal that of the rows.
        Rs, Qs, Fs, Hs : sequence of n, optional
            As in `filter`; the same for every series.
        dt : float, sequence of n floats, array_like, DataFrame, list or mapping, optional
            As in `filter`, the same for every series; or one set per series, (series, n) or like ``zs``, in
            which case the series are filtered one by one.
        by : hashable, optional
            Column (or index level) that names the series of each row, if the frame holds all series one after
            another.
        threads : int
            Number of threads of the compiled engine; results do not depend on it.  The NumPy engine uses one.
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
            Wrong shapes; an unknown name in ``keep``; an S that cannot be inverted.

        Examples
        --------
        >>> import numpy as np
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> result = kf.filter_many([[1.0, 2.0, 3.0], [1.0, np.nan, np.nan]], keep=["x"])
        >>> result.x[..., 0].round(3)
        array([[0.667, 1.5  , 2.429],
               [0.667, 0.667, 0.667]])
        """
        as_flag("resume", resume)
        told = {"Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "dt": dt}
        return linear_series.filter_many(self, zs, by, keep, us, told, threads, dtype)

    def batch_filter(
        self,
        zs: ManyNumbers,
        Fs: PerStep | None = None,
        Qs: PerStep | None = None,
        Hs: PerStep | None = None,
        Rs: PerStep | None = None,
        Bs: PerStep | None = None,
        us: PerStep | None = None,
        update_first: bool = False,
        saver: Any = None,
        *,
        resume: bool = False,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Filter a series with matrices that may change from step to step.

        Parameters
        ----------
        zs : sequence of n observations
            None or NaN where missing.
        Fs, Qs, Hs, Rs, Bs, us : sequence of n values, optional
            Matrices and controls of each step; None, for all or for single steps, means the attribute of the
            filter (for ``us``: no control).  A pandas index must equal that of ``zs``.
        update_first : bool
            Update before predicting, instead of after it.
        saver : filterpy.common.Saver, optional
            Its ``save`` is called after each step.
        resume : bool
            As in `filter`.

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
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]])
        >>> means, covariances, means_p, covariances_p = kf.batch_filter(
        ...     [1.0, 2.0], Rs=[1.0, 2.0]
        ... )
        >>> means.shape, means.ravel().round(3)
        ((2, 1, 1), array([0.667, 1.273]))
        """
        as_flag("resume", resume)
        check_aligned(zs=zs, us=us, Fs=Fs, Qs=Qs, Hs=Hs, Rs=Rs, Bs=Bs)
        update_first, observations = as_flag("update_first", update_first), one_by_one(zs)
        n = len(observations)
        with whole_verb(self):
            x, _ = self._state()
            given = (Fs, Qs, Hs, Rs, Bs, us, saver)
            if n and not update_first and all(one is None for one in given) and self._is_plain():
                series = as_observations(observations, self.dim_z)
                stored = linear_series.filter_at_once(
                    self, series, read_steps(self, n), linear_series.MOMENTS
                )
                return as_batch(self, stored, zs, x.ndim == 1)
            moves, looks = given_per_step(n, us=us, Bs=Bs, Fs=Fs, Qs=Qs), given_per_step(n, Rs=Rs, Hs=Hs)
            return run_verbs(self, zs, observations, moves, looks, update_first, saver)

    def fit(
        self,
        zs: ManyNumbers | ManySeriesLike,
        *,
        free: Mapping[str, Any] | None = None,
        us: ManySeriesLike | PerStep | None = None,
        n_starts: int = 1,
        rng: np.random.Generator | None = None,
        max_iter: int = 500,
        tolerance: float = 1e-7,
        progress: bool | None = None,
    ) -> LikelihoodFit[Self]:
        """Learn noise covariances or other parameters from observations, by maximum likelihood.

        The search starts from the attributes of the filter; the filter itself does not change.  As in
        `filter`, ``x`` and ``P`` belong to the time before the first prediction.

        Parameters
        ----------
        zs : array_like, DataFrame, list or mapping
            A series as in `filter`, or several as in `filter_many`; each starts at x and P.  NaN where
            missing.
        free : mapping of str to object, optional
            Attributes to learn; by default ``{"Q": "full", "R": "diagonal"}``.  For ``Q``, ``R`` and ``P``:
            "full" (all entries), "diagonal" (variances), ("scale", M) (a multiple of the covariance M), or a
            boolean mask of entries.  For ``F``, ``H``, ``B`` and ``x``: "full" or a boolean mask.  The mask
            of a covariance must be block diagonal up to a permutation, so that the result stays a
            covariance.
        us : optional
            Controls, as in `filter` or `filter_many`.
        n_starts : int
            Number of searches.  The first starts at the attributes, the others at random points around them.
        rng : numpy.random.Generator, optional
            Needed if ``n_starts`` is above 1.
        max_iter : int
            Largest number of iterations of a search.
        tolerance : float
            Gain in log-likelihood at which a search stops.
        progress : bool, optional
            Whether to show a progress bar.  By default it appears after two seconds in a terminal or
            notebook.

        Returns
        -------
        LikelihoodFit
            With estimates, standard errors, intervals, ``summary()``, and ``model``, a new filter with the
            estimated parameters, before the first observation.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if ``free`` is inadmissible, a free variance is zero at the start, nothing was
            observed, or `alpha` is not 1.

        Notes
        -----
        Some steps of expectation-maximisation come first, then quasi-Newton steps with the exact gradient
        (Fisher's identity, from the smoothed states), then steps of Newton.  For a subclass that
        overrides `predict` or `update`, the gradient is computed by finite differences.

        References
        ----------
        R. H. Shumway, D. S. Stoffer, An approach to time series smoothing and forecasting using the EM
        algorithm, J. Time Series Analysis 3 (1982), 253-264.

        Examples
        --------
        >>> import numpy as np
        >>> rng = np.random.default_rng(0)
        >>> level = np.cumsum(rng.normal(size=300))
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], P=100.0)
        >>> fit = kf.fit(level + 2.0 * rng.normal(size=300))
        >>> {name: round(value, 2) for name, value in fit.estimates.items()}
        {'Q[0, 0]': 1.38, 'R[0, 0]': 4.02}
        >>> fit.model.Q.round(2)
        array([[1.38]])
        """
        from fuzzykf.kalman.learning.fit import fit_filter

        options: dict[str, Any] = {"n_starts": n_starts, "rng": rng, "max_iter": max_iter}
        return fit_filter(self, zs, free=free, us=us, progress=progress, tolerance=tolerance, **options)

    def rts_smoother(
        self,
        Xs: ArrayLike,
        Ps: ArrayLike,
        Fs: PerStep | None = None,
        Qs: PerStep | None = None,
        inv: Callable[[Any], Any] = np.linalg.inv,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Smooth the output of `batch_filter`.

        Parameters
        ----------
        Xs, Ps, inv
            As in `fuzzykf.kalman.rts_smoother`.
        Fs, Qs : sequence, optional
            Likewise; by default the attributes ``F`` and ``Q`` at every step.

        Returns
        -------
        x, P, K, Pp : ndarray
            As from `fuzzykf.kalman.rts_smoother`.
        """
        n = len(np.atleast_1d(as_numbers("Xs", Xs)))
        Fs = [self.F] * n if Fs is None else Fs
        Qs = [self.Q] * n if Qs is None else Qs
        return rts_smoother(Xs, Ps, Fs, Qs, inv)

    # ------------------------------------------------------------------ without a change of state

    def get_prediction(
        self,
        u: Numbers = None,
        B: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the x and P to which `predict` would lead; the filter does not change.

        Parameters
        ----------
        u, B, F, Q : array_like, optional
            As in `predict`.

        Returns
        -------
        x, P : ndarray
            Predicted mean and covariance.
        """
        n, x, P = self.dim_x, self.x, self.P
        transition: Any = self.F if F is None else given_matrix("F", F, (n, n))
        noise = self.Q if Q is None else as_covariance("Q", Q, n)
        if not fits(n, n, x, P, transition, noise):
            (x, P), noise = self._state(), as_square("Q", noise, n)
            transition = as_matrix("F", transition, (n, n))
        moved, P = predict_linear(x, P, transition, noise, self._alpha_sq)
        if u is not None:
            moved = moved + control_term(self.B if B is None else B, u, x)
        return moved, P

    def get_update(self, z: Numbers = None) -> tuple[FloatArray, FloatArray]:
        """Return the x and P to which `update` would lead; the filter does not change.

        Parameters
        ----------
        z : array_like or None
            Observation, as in `update`.

        Returns
        -------
        x, P : ndarray
            Updated mean and covariance.
        """
        x, P, H, R = self._observation(None, None)
        value = observed(z, self.dim_z, x)
        if value is None:
            return x.copy(), P.copy()
        x, P, *_ = condition_linear(x, P, value, H, R, self._I, self.inv)
        return x, P

    def residual_of(self, z: Numbers) -> FloatArray:
        """Return z - H x_prior, NaN where z is missing.

        Parameters
        ----------
        z : array_like or None
            Observation, as in `update`.

        Returns
        -------
        ndarray, shape (dim_z, 1) or (dim_z,)
        """
        x = as_state(self.x_prior, self.dim_x)
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        value = observed(z, self.dim_z, x)
        expected: FloatArray = H.dot(x)
        return np.full(expected.shape, np.nan) if value is None else value - expected

    def measurement_of_state(self, x: ArrayLike) -> FloatArray:
        """Return H x.

        Parameters
        ----------
        x : array_like, shape (dim_x, 1) or (dim_x,)
            A state.

        Returns
        -------
        ndarray, shape (dim_z, 1) or (dim_z,)
        """
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        state = as_state(as_numbers("x", x), self.dim_x)
        if not np.isfinite(state).all():
            raise ParameterError(f"x: got {state.ravel().tolist()}, expected finite numbers")
        measurement: FloatArray = H.dot(state)
        return measurement

    def log_likelihood_of(self, z: Numbers) -> float:
        """Return the log-density of z under N(H x, S), with x and S as they are now.

        For None it is ``log(sys.float_info.min)``, as in filterpy.

        Parameters
        ----------
        z : array_like or None
            Observation, as in `update`.

        Returns
        -------
        float
        """
        x, _ = self._state()
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        S = as_matrix("S", self.S, (self.dim_z, self.dim_z))
        value = observed(z, self.dim_z, x)
        if value is None:
            return LEAST_LOG_LIKELIHOOD
        y, seen = zero_where_missing(value - H.dot(x), value)
        return log_density(y, S, seen)

    def test_matrix_dimensions(
        self,
        z: Numbers = None,
        H: Numbers = None,
        R: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
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
        given = {"Q": Q, "F": F, "H": H, "R": R}
        matrices = {name: getattr(self, name) if value is None else value for name, value in given.items()}
        check_dimensions(self.dim_x, self.dim_z, {"x": self.x, "P": self.P, **matrices}, z)


#: What the verbs are, and what they call or read, before anybody changes it.
_VERBS = lookups(KalmanFilter, VERBS)
_PATCHED = (*VERBS, "get_prediction")
_HOOKS = lookups(KalmanFilter, HOOKS)
#: What is read after each step of a series.
_READ = lookups(KalmanFilter, ("log_likelihood",))

"""The linear Kalman filter, with the interface of filterpy's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import as_observation
from fuzzykf.engine.numpy import kalman as engine
from fuzzykf.engine.selected import LinearStepper
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array
from fuzzykf.kalman._arguments import as_covariance, as_matrix, as_square, as_state, control_term, fits
from fuzzykf.kalman._gaussian import LEAST_LOG_LIKELIHOOD
from fuzzykf.kalman._linear_series import LinearSeries
from fuzzykf.kalman._moments import predict_linear
from fuzzykf.kalman._overrides import lookups, overrides

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["KalmanFilter"]


class KalmanFilter(LinearStepper, LinearSeries):
    """Kalman filter of x_k = F x_{k-1} + B u_k + w_k, z_k = H x_k + v_k.

    It takes the place of ``filterpy.kalman.KalmanFilter``: construct it, assign the
    matrices, then call `predict` and `update` in turn, or `step`, or one of the
    methods for whole series.  All attributes are plain and may be assigned at any
    time; if a flat ``x`` is assigned, all vectors become flat.  ``P``, ``Q`` and
    ``R`` may be scalars, which stand for that multiple of the identity.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.
    dim_u : int
        Number of components of the control; informative, as in filterpy.
    x, P, F, H, Q, R, B : array_like, optional
        Initial values of the attributes of the same names; unlike a later
        assignment they are checked.

    Attributes
    ----------
    x : ndarray, shape (dim_x, 1) or (dim_x,)
        Estimate of the state; zero at first.
    P : ndarray, shape (dim_x, dim_x)
        Its covariance; the identity at first.
    F, Q : ndarray, shape (dim_x, dim_x)
        Transition and covariance of the process noise; identities at first.
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
    log_likelihood, likelihood, mahalanobis, alpha : float
        See there.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If a dimension is below one, or a matrix has a wrong shape or is no covariance.

    See Also
    --------
    ExtendedKalmanFilter, IMMEstimator

    Notes
    -----
    A missing observation (None, or NaN in all components) leaves x and P as
    predicted and has the log-likelihood 0.  Of an observation with NaN in some
    components the others are used.  The covariance is updated in Joseph's form.

    An array that has been read from an attribute does not change later, unless the reader
    writes into it: then the filter sees that.

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

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dim_u: int = 0,
        *,
        x: ArrayLike | None = None,
        P: ArrayLike | None = None,
        F: ArrayLike | None = None,
        H: ArrayLike | None = None,
        Q: ArrayLike | None = None,
        R: ArrayLike | None = None,
        B: ArrayLike | None = None,
    ) -> None:
        super().__init__(dim_x, dim_z, dim_u, x=x, P=P, F=F, Q=Q, R=R)
        self.H = np.zeros((dim_z, dim_x)) if H is None else as_array("H", H, (dim_z, dim_x))
        self.M = np.zeros((dim_x, dim_z))
        self.B = None if B is None else as_array("B", B, (dim_x, None))

    @property
    def alpha(self) -> float:
        """Fading memory: P is predicted as alpha^2 F P F' + Q; 1 is the plain Kalman filter.

        Values slightly above 1 let old observations count for less (D. Simon,
        Optimal State Estimation, Wiley 2006, section 7.4).
        """
        root: float = self._alpha_sq**0.5
        return root

    @alpha.setter
    def alpha(self, value: float) -> None:
        given: Any = value
        if not isinstance(given, (int, float, np.integer, np.floating)) or not 1.0 <= given < np.inf:
            raise ParameterError(f"alpha: got {value!r}, expected a finite number of at least 1")
        self._alpha_sq = float(value) ** 2

    # ------------------------------------------------------------------ verbs

    def predict(
        self,
        u: ArrayLike | None = None,
        B: ArrayLike | None = None,
        F: ArrayLike | None = None,
        Q: ArrayLike | None = None,
    ) -> None:
        """Move the estimate to the time of the next observation.

        Parameters
        ----------
        u : array_like, optional
            Control input, shape (dim_u, 1), or (dim_u,) if x is flat.
        B, F, Q : array_like, optional
            Used instead of the attributes of these names; a scalar ``Q`` means that
            multiple of the identity.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If shapes do not agree, or ``Q`` is no covariance.

        Examples
        --------
        >>> kf = KalmanFilter(dim_x=1, dim_z=1, B=[[2.0]])
        >>> kf.predict(u=3.0)
        >>> kf.x, kf.P
        (array([[6.]]), array([[2.]]))
        """
        if u is None and B is None and F is None and Q is None and self._predict_at_once():
            return
        self._remember()
        self._set_prior(*self.get_prediction(u, B, F, Q))

    def update(self, z: ArrayLike | None, R: ArrayLike | None = None, H: ArrayLike | None = None) -> None:
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
        self._remember()
        x, P, H, R = self._observation(R, H)
        value = as_observation(z, H.shape[0])
        if value is None:
            self._skip(x, P, H.shape[0])
            return
        if x.ndim == 2:
            value = value.reshape(-1, 1)
        x, P, y, S, SI, K = self._conditioned_on(x, P, value, H, R)
        self._set_innovation(x, P, value, y, S, SI, K)

    def _step_any(self, z: ArrayLike | None) -> Any:
        """Do a step with any observation, by the verbs; an error leaves the filter as it was."""
        before = self.__dict__.copy()
        try:
            self.predict()
            self.update(z)
        except BaseException:
            self.__dict__.clear()
            self.__dict__.update(before)
            raise
        return self.x

    def _is_plain(self) -> bool:
        return (
            type(self)._overrides() == 0
            and not overrides(type(self), _READ)
            and self.inv is np.linalg.inv
            and self.__dict__.keys().isdisjoint(("predict", "update", "get_prediction"))
        )

    @classmethod
    def _overrides(cls) -> int:
        return overrides(cls, _HOOKS) | overrides(cls, _VERBS) << 1

    # ------------------------------------------------------------------ without a change of state

    def get_prediction(
        self,
        u: ArrayLike | None = None,
        B: ArrayLike | None = None,
        F: ArrayLike | None = None,
        Q: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return x and P that `predict` with the same arguments would lead to."""
        n, x, P = self.dim_x, self.x, self.P
        transition: Any = self.F if F is None else F
        noise = self.Q if Q is None else as_covariance("Q", Q, n)
        if not fits(n, n, x, P, transition, noise):
            (x, P), noise = self._state(), as_square("Q", noise, n)
            transition = as_matrix("F", transition, (n, n))
        moved, P = predict_linear(x, P, transition, noise, self._alpha_sq)
        if u is not None:
            moved = moved + control_term(self.B if B is None else B, u, x)
        return moved, P

    def get_update(self, z: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Return x and P that ``update(z)`` would lead to."""
        x, P, H, R = self._observation(None, None)
        value = as_observation(z, self.dim_z)
        if value is None:
            return x.copy(), P.copy()
        x, P, *_ = self._conditioned_on(x, P, value.reshape(-1, 1) if x.ndim == 2 else value, H, R)
        return x, P

    def residual_of(self, z: ArrayLike) -> FloatArray:
        """Return z - H x_prior, NaN where z is missing."""
        x = as_state(self.x_prior, self.dim_x)
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        value = as_observation(z, self.dim_z)
        value = np.full(self.dim_z, np.nan) if value is None else value
        residual: FloatArray = (value.reshape(-1, 1) if x.ndim == 2 else value) - H.dot(x)
        return residual

    def measurement_of_state(self, x: ArrayLike) -> FloatArray:
        """Return H x."""
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        measurement: FloatArray = H.dot(as_state(np.asarray(x, dtype=np.float64), self.dim_x))
        return measurement

    def log_likelihood_of(self, z: ArrayLike | None) -> float:
        """Return the log-density of z under N(H x, S), with x and S as they are now.

        For None it is ``log(sys.float_info.min)``, as in filterpy.
        """
        x, _ = self._state()
        H = as_matrix("H", self.H, (self.dim_z, self.dim_x))
        S = as_matrix("S", self.S, (self.dim_z, self.dim_z))
        value = as_observation(z, self.dim_z)
        if value is None:
            return LEAST_LOG_LIKELIHOOD
        kept = ~np.isnan(value)
        y = value - H.dot(x).ravel()
        return engine.log_normal(y[kept], S[np.ix_(kept, kept)])


#: What the verbs are, and what they call or read, before anybody changes it.
_VERBS = lookups(KalmanFilter, ("predict", "update"))
_HOOKS = lookups(
    KalmanFilter,
    (
        *("get_prediction", "_observation", "_state", "_conditioned_on", "_remember", "_skip"),
        *("_set_prior", "_set_posterior", "_set_innovation"),
        *("__getattribute__", "__setattr__"),
        *("dim_x", "dim_z", "x", "P", "F", "Q", "H", "R", "z", "y", "S", "SI", "K", "alpha", "inv"),
        *("x_prior", "P_prior", "x_post", "P_post"),
        *("_alpha_sq", "_log_likelihood", "_likelihood", "_mahalanobis"),
    ),
)
#: What is read after each step of a series.
_READ = lookups(KalmanFilter, ("log_likelihood",))

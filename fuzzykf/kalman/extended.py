"""The extended Kalman filter, with filterpy's calls and with functions given once."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import as_observation
from fuzzykf.engine.numpy import kalman as engine
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array
from fuzzykf.kalman._arguments import (
    as_covariance,
    as_matrix,
    as_square,
    as_state,
    as_vector,
    control_term,
)
from fuzzykf.kalman._extended_series import ExtendedSeries
from fuzzykf.kalman._series import unchanged_on_error
from fuzzykf.kalman.jacobian import central_jacobian

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["ExtendedKalmanFilter"]


class ExtendedKalmanFilter(ExtendedSeries):
    """Extended Kalman filter of x_k = f(x_{k-1}) + w_k, z_k = h(x_k) + v_k.

    It takes the place of ``filterpy.kalman.ExtendedKalmanFilter``, whose calls give
    the functions to `update` at each step.  If they are given at construction
    instead, `step`, `filter`, `smooth` and `batch_filter` work as in the linear filter.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.
    dim_u : int
        Number of components of the control; informative, as in filterpy.
    fx : callable, optional
        ``fx(x, **fx_args)`` takes and returns a flat state (dim_x,).  A control given to
        `predict` reaches it as the keyword argument ``u``, unless it is None or the number 0.
        By default the state moves by F x + B u.
    FJacobian : callable, optional
        Of the same arguments; returns (dim_x, dim_x).  By default central differences,
        see `fuzzykf.kalman.jacobian.central_jacobian`.
    hx : callable, optional
        ``hx(x, **hx_args)`` takes a flat state and returns (dim_z,).
    HJacobian : callable, optional
        Of the same arguments; returns (dim_z, dim_x).  By default central differences.
    residual : callable
        ``residual(z, hx(x))``, the difference of two observations; wrap angles here.
    x, P, F, Q, R : array_like, optional
        Initial values of the attributes of the same names; unlike a later
        assignment they are checked.

    Attributes
    ----------
    x, P, F, Q, R, B, x_prior, P_prior, x_post, P_post, z, y, S, SI, K
        As in `KalmanFilter`; ``B`` is 0 at first.  With ``fx`` given, ``F`` is its
        Jacobian at the latest prediction.
    fx, FJacobian, hx, HJacobian, residual
        The functions.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If a dimension is below one, or a matrix has a wrong shape or is no covariance.

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
        x: ArrayLike | None = None,
        P: ArrayLike | None = None,
        F: ArrayLike | None = None,
        Q: ArrayLike | None = None,
        R: ArrayLike | None = None,
    ) -> None:
        functions = {"fx": fx, "FJacobian": FJacobian, "hx": hx, "HJacobian": HJacobian, "residual": residual}
        for name, function in functions.items():
            if function is not None and not callable(function):
                raise ParameterError(f"{name}: got {function!r}, expected a function")
        super().__init__(dim_x, dim_z, dim_u, x=x, P=P, F=F, Q=Q, R=R)
        self.B = 0
        self.fx, self.FJacobian = fx, FJacobian
        self.hx, self.HJacobian = hx, HJacobian
        self.residual = residual

    # ------------------------------------------------------------------ prediction

    def predict_x(self, u: Any = 0, **fx_args: Any) -> None:
        """Move x alone; override it to move the state in a way of your own.

        Parameters
        ----------
        u : array_like
            Control input.
        **fx_args
            Reach ``fx``.
        """
        x = as_state(self.x, self.dim_x)
        if self.fx is None:
            if fx_args:
                raise ParameterError(f"fx: got the arguments {', '.join(fx_args)}, but the filter has no fx")
            F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
            self.x = F.dot(x) + control_term(self.B, u, x)
        else:
            arguments = fx_args if _is_no_control(u) else {"u": u, **fx_args}
            self.x = as_vector("fx", self.fx(x.ravel(), **arguments), x.ravel()).reshape(x.shape)

    def predict(self, u: Any = 0, **fx_args: Any) -> None:
        """Move the estimate to the time of the next observation.

        Parameters
        ----------
        u : array_like
            Control input; None or 0 for none.
        **fx_args
            Reach ``fx`` and ``FJacobian``, for instance the time.

        Raises
        ------
        ParameterError, ShapeError
            If shapes do not agree, a function returns something else than it should,
            or arguments are given for an ``fx`` that is not there.
        """
        self._remember()
        u = 0 if u is None else u
        x, P = self._state()
        Q = as_square("Q", self.Q, self.dim_x)
        F = None if self.fx is None else self._transition_jacobian(x.ravel(), u, fx_args)
        with unchanged_on_error(self):
            self.predict_x(u, **fx_args)
            if F is not None:
                self.F = F
            F = as_matrix("F", self.F, (self.dim_x, self.dim_x))
            x = as_state(self.x, self.dim_x)
            self._set_prior(x, engine.predict_stack(P, F, Q, 1.0))

    def _transition_jacobian(self, x: FloatArray, u: Any, fx_args: Mapping[str, Any]) -> FloatArray:
        fx, n = self.fx, self.dim_x
        assert fx is not None
        arguments = fx_args if _is_no_control(u) else {"u": u, **fx_args}
        if self.FJacobian is None:
            return central_jacobian(lambda at: as_vector("fx", fx(at, **arguments), x), x)
        return as_array("FJacobian", self.FJacobian(x.copy(), **arguments), (n, n))

    # ------------------------------------------------------------------ update

    def update(
        self,
        z: ArrayLike | None,
        HJacobian: Callable[..., Any] | None = None,
        Hx: Callable[..., Any] | None = None,
        R: ArrayLike | None = None,
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
            Used instead of the attributes ``HJacobian`` and ``hx``.  As in filterpy they
            are given x as the filter holds it, flat or as a column.  With ``Hx`` alone the
            Jacobian comes from central differences.
        R : array_like, optional
            Used instead of the attribute ``R``; a scalar means that multiple of the identity.
        args, hx_args : tuple
            More positional arguments of ``HJacobian`` and of ``Hx``.
        residual : callable, optional
            Used instead of the attribute ``residual``.
        **hx_kwargs
            Keyword arguments of both functions, for instance the time.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            Wrong shapes; an infinite z; no ``Hx``; an inadmissible ``R``; an S that
            cannot be inverted.

        Examples
        --------
        >>> import numpy as np
        >>> ekf = ExtendedKalmanFilter(dim_x=1, dim_z=1)
        >>> ekf.x = np.array([2.0])
        >>> ekf.update(5.0, HJacobian=lambda x: np.array([2.0 * x]), Hx=lambda x: x**2)
        >>> ekf.x.round(3)
        array([2.235])
        """
        self._remember()
        x, P = self._state()
        if z is None:
            self._skip(x, P, self.dim_z)
            return
        args = args if isinstance(args, tuple) else (args,)
        hx_args = hx_args if isinstance(hx_args, tuple) else (hx_args,)
        residual = self.residual if residual is None else residual
        h, jacobian = self._functions(x.shape, HJacobian, Hx, args, hx_args, hx_kwargs)
        predicted = np.asarray(h(x.ravel().copy()), dtype=np.float64)
        m = predicted.size
        predicted = as_vector("Hx", predicted, np.empty(m if x.ndim == 1 else (m, 1)))
        if jacobian is None:
            H = central_jacobian(lambda at: as_vector("Hx", h(at), np.empty(m)), x.ravel(), residual)
        else:
            H = as_matrix("HJacobian", jacobian(x.ravel().copy()), (m, self.dim_x))
        noise = as_square("R", self.R, m) if R is None else as_covariance("R", R, m)
        value = as_observation(z, m)
        if value is None:
            self._skip(x, P, m)
            return
        value = value.reshape(predicted.shape)
        # the residual function may be anything: it sees the prediction where z is missing
        y = as_vector("residual", residual(np.where(np.isnan(value), predicted, value), predicted), predicted)
        self._correct(x, P, value, y, H, noise)

    def _functions(
        self,
        shape: tuple[int, ...],
        HJacobian: Callable[..., Any] | None,
        Hx: Callable[..., Any] | None,
        args: tuple[Any, ...],
        hx_args: tuple[Any, ...],
        hx_kwargs: Mapping[str, Any],
    ) -> tuple[Callable[[FloatArray], Any], Callable[[FloatArray], Any] | None]:
        """Return h and its Jacobian as functions of a flat x; None for an unknown Jacobian.

        Functions given to `update` are handed x in the form of the filter, as filterpy does.
        """
        h, jacobian = self.hx if Hx is None else Hx, HJacobian
        if h is None:
            raise ParameterError("Hx: got None, expected a function, for the filter as hx or for this update")
        h_shape = (-1,) if Hx is None else shape
        jacobian_shape = shape
        if jacobian is None and Hx is None:
            jacobian, jacobian_shape = self.HJacobian, (-1,)
        observe = partial(_apply, h, h_shape, hx_args, hx_kwargs)
        if jacobian is None:
            return observe, None
        return observe, partial(_apply, jacobian, jacobian_shape, args, hx_kwargs)

    def predict_update(
        self,
        z: ArrayLike | None,
        HJacobian: Callable[..., Any] | None = None,
        Hx: Callable[..., Any] | None = None,
        args: Any = (),
        hx_args: Any = (),
        u: Any = 0,
    ) -> None:
        """Predict, then update; both or, if an error is raised, neither.

        Parameters
        ----------
        z, HJacobian, Hx, args, hx_args
            As in `update`.
        u
            As in `predict`.
        """
        self._remember()
        with unchanged_on_error(self):
            self.predict(u)
            self.update(z, HJacobian, Hx, args=args, hx_args=hx_args)


def _is_no_control(u: Any) -> bool:
    return u is None or (np.isscalar(u) and u == 0)


def _apply(
    function: Callable[..., Any],
    shape: tuple[int, ...],
    args: tuple[Any, ...],
    kwargs: Mapping[str, Any],
    x: FloatArray,
) -> Any:
    return function(x.reshape(shape), *args, **kwargs)

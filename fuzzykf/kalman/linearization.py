"""A user's functions of the state: their values and Jacobians, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_numbers
from fuzzykf.kalman.arguments import as_matrix, as_vector, given_matrix
from fuzzykf.kalman.jacobian import central_jacobian

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fuzzykf.arrays import FloatArray

    Function = Callable[..., Any]

__all__ = ["linearize_observation", "observation_functions", "transition_jacobian", "with_control"]


def with_control(arguments: Mapping[str, Any], u: Any) -> Mapping[str, Any]:
    """Return the keyword arguments of a transition; u is among them unless it is None or the number 0."""
    return arguments if u is None or (np.isscalar(u) and u == 0) else {"u": u, **arguments}


def transition_jacobian(
    fx: Function, jacobian: Function | None, x: FloatArray, arguments: Mapping[str, Any]
) -> FloatArray:
    """Jacobian of ``fx`` at x (n,), by central differences unless there is a function for it."""
    if jacobian is None:
        return central_jacobian(lambda at: as_vector("fx", fx(at, **arguments), x), x)
    return given_matrix("FJacobian", jacobian(x.copy(), **arguments), (len(x), len(x)))


def observation_functions(
    own: tuple[Function | None, Function | None],
    given: tuple[Function | None, Function | None],
    form: tuple[int, ...],
    args: tuple[Any, ...],
    hx_args: tuple[Any, ...],
    kwargs: Mapping[str, Any],
) -> tuple[Function, Function | None]:
    """Return h and its Jacobian as functions of a flat x; None for an unknown Jacobian.

    ``own`` are the functions of a filter, ``given`` those of one update, which are handed x in the
    form of the filter, as filterpy does.
    """
    (h, jacobian), flat = given, (-1,)
    h_form, jacobian_form = form, form
    if h is None and jacobian is None:
        jacobian, jacobian_form = own[1], flat
    if h is None:
        h, h_form = own[0], flat
    if h is None:
        raise ParameterError("Hx: got None, expected a function, for the filter as hx or for this update")
    slope = None if jacobian is None else _bound(jacobian, jacobian_form, args, kwargs)
    return _bound(h, h_form, hx_args, kwargs), slope


def _bound(
    function: Function, form: tuple[int, ...], args: tuple[Any, ...], kwargs: Mapping[str, Any]
) -> Function:
    return lambda x: function(x.reshape(form), *args, **kwargs)


def linearize_observation(
    h: Function, jacobian: Function | None, x: FloatArray, residual: Function
) -> tuple[FloatArray, FloatArray]:
    """Return h(x), in the form of x, and the Jacobian of h at x."""
    predicted = as_numbers("Hx", h(x.flatten()))
    m = predicted.size
    predicted = as_vector("Hx", predicted, np.empty(m if x.ndim == 1 else (m, 1)))
    if jacobian is None:
        flat = np.empty(m)
        return predicted, central_jacobian(lambda at: as_vector("Hx", h(at), flat), x.ravel(), residual)
    return predicted, as_matrix("HJacobian", jacobian(x.flatten()), (m, x.size))

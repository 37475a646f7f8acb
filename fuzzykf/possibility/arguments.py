"""What an estimator and its verbs are given: matrices or functions, and noises by membership or by matrix."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_numbers, is_whole
from fuzzykf.possibility.mapping import Mapping, as_map, control
from fuzzykf.possibility.memberships import Membership
from fuzzykf.possibility.memberships.derived import as_membership
from fuzzykf.possibility.representation import FAMILIES, as_center, as_matrix, as_used, no_matrix

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

__all__ = [
    "check_given",
    "given_maps",
    "is_membership",
    "measurement",
    "motion",
    "set_matrices",
    "with_noise",
]


def given_maps(
    dim_x: int, dim_z: int, fx: Any, hx: Any, F: Any, H: Any, B: Any
) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
    """Return F, H and B as they are given at construction, copied; F is the identity and H zero if not.

    Raises
    ------
    ParameterError, ShapeError
        A matrix beside the function in whose place it would be; a wrong shape.
    """
    for name, matrix, other, function in (("F", F, "fx", fx), ("B", B, "fx", fx), ("H", H, "hx", hx)):
        if matrix is not None and function is not None:
            raise ParameterError(f"{name}: got a matrix beside {other}; expected one of the two")
    if fx is None:
        F = np.eye(dim_x) if F is None else as_map("F", F, (dim_x, dim_x)).copy()
    if hx is None:
        H = np.zeros((dim_z, dim_x)) if H is None else as_map("H", H, (dim_z, dim_x)).copy()
    if B is not None:
        B = as_numbers("B", B)
        B = as_array("B", B * np.eye(dim_x) if B.ndim == 0 else B, (dim_x, None)).copy()
    return F, H, B


def check_given(dim_x: Any, dim_z: Any, fx: Any, fx_inverse: Any, fx_interval: Any) -> None:
    """Check the sizes, and that functions come with the one that they belong to.

    Raises
    ------
    ParameterError
        A size that is no whole number from 1 on; an inverse or extension without a function.
    """
    for name, value in (("dim_x", dim_x), ("dim_z", dim_z)):
        if not is_whole(value) or value < 1:
            raise ParameterError(f"{name}: got {value!r}, expected a whole number of at least 1")
    if fx is None and (fx_inverse is not None or fx_interval is not None):
        raise ParameterError("fx: got None, expected the function that belongs to fx_inverse or fx_interval")


def set_matrices(est: Any, **given: Any) -> None:
    """Set Q, R, x and P of a new estimator to copies of what was given, checked.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If the representation has no such attribute; a wrong shape; no covariance.
    """
    for name, value in given.items():
        if value is None:
            continue
        if name == "x" and est.is_closed_form:  # the setter would turn attributes that are not there yet
            est._belief = replace(est._belief, x=as_center(value, est.dim_x))
        else:
            setattr(est, name, np.array(as_numbers(name, value)))


def motion(
    est: Any, u: Any, B: Any, F: Any, Q: Any, fx_arguments: dict[str, Any]
) -> tuple[Mapping, Membership]:
    """Return the map and the noise of a prediction (the parameters are those of `predict`)."""
    d, noise = est.dim_x, est._process_noise
    if is_membership(Q):
        noise, Q = as_used("Q", as_membership("Q", Q, d, est.t_norm), est.representation), None
    if est.fx is None:
        _refuse("predict", fx_arguments, "fx")
        matrix = as_map("F", est.F if F is None else F, (d, d))
        shift = control(u, est.B if B is None else B, d)
        noise = noise if Q is None else with_noise("Q", noise, Q, est.representation)
        return Mapping("F", d, d, matrix=matrix, shift=shift), noise
    given = {k: v for k, v in (("u", u), ("B", B), ("F", F), ("Q", Q)) if v is not None} | fx_arguments
    function, inverse, interval = est.fx, est.fx_inverse, est.fx_interval
    return Mapping("fx", d, d, function=function, inverse=inverse, interval=interval, arguments=given), noise


def measurement(
    est: Any, seen: IntArray, R: Any, H: Any, hx_arguments: dict[str, Any]
) -> tuple[Mapping, Membership]:
    """Return the map to the components seen, and the noise of all (the parameters are those of `update`)."""
    d, q, noise = est.dim_x, est.dim_z, est._measurement_noise
    if is_membership(R):
        noise, R = as_used("R", as_membership("R", R, q, est.t_norm), est.representation), None
    if est.hx is None:
        _refuse("update", hx_arguments, "hx")
        if H is None and est.H is est._blank_H and not np.any(est.H):
            raise ParameterError(
                "H: got no matrix, so that z would say nothing of the state; expected one of shape "
                f"({q}, {d}), by H=... or est.H = ..., or a function hx"
            )
        matrix = as_map("H", est.H if H is None else H, (q, d))
        noise = noise if R is None else with_noise("R", noise, R, est.representation)
        return Mapping("H", d, q, matrix=matrix, components=seen), noise
    given = {k: v for k, v in (("R", R), ("H", H)) if v is not None} | hx_arguments
    interval = est.hx_interval
    return Mapping("hx", d, q, function=est.hx, interval=interval, arguments=given, components=seen), noise


def is_membership(value: Any) -> bool:
    """Whether a noise is given by a membership, or by one for each component."""
    return isinstance(value, Membership) or (
        isinstance(value, list | tuple) and any(isinstance(one, Membership) for one in value)
    )


def with_noise(name: str, noise: Membership, value: Any, representation: Any) -> Membership:
    """Return a noise with another matrix Q or R, around the same peak.

    Raises
    ------
    ParameterError
        If the representation has no such matrices.
    """
    if representation not in FAMILIES:
        raise no_matrix(name, representation, "process_noise" if name == "Q" else "measurement_noise")
    return FAMILIES[representation](noise.peak, as_matrix(name, value, noise.dim))


def _refuse(verb: str, arguments: dict[str, Any], function: str) -> None:
    if arguments:
        raise TypeError(
            f"{verb}() got an unexpected keyword argument {next(iter(arguments))!r}; "
            f"only {function} could use it"
        )

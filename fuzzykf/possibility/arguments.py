"""What an estimator and its verbs are given: matrices or functions, and noises by membership or by matrix."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_numbers, is_whole
from fuzzykf.possibility.mapping import as_map
from fuzzykf.possibility.memberships import Membership
from fuzzykf.possibility.memberships.derived import as_membership
from fuzzykf.possibility.representation import FAMILIES, as_center, as_matrix, as_used, no_matrix

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = [
    "check_given",
    "given_maps",
    "is_membership",
    "noise_of_step",
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


def noise_of_step(est: Any, name: Literal["Q", "R"], value: Any) -> tuple[Membership, Any]:
    """Return the noise of one prediction or measurement, and what is left of the argument for a function.

    Parameters
    ----------
    est : FuzzyRelationEstimator
    name : {"Q", "R"}
        Of the argument, by which the noise is known.
    value : Membership, sequence of (Membership or None), or array_like
        A matrix beside a function is not the noise, but an argument of that.
    """
    noise, dim, function = (
        (est._process_noise, est.dim_x, est.fx)
        if name == "Q"
        else (est._measurement_noise, est.dim_z, est.hx)
    )
    if is_membership(value):
        return as_used(name, as_membership(name, value, dim, est.t_norm), est.representation), None
    if function is not None:
        return noise, value
    return with_noise(name, noise, value, est.representation), None


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

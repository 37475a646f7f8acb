"""Conditioning a mean and a covariance on an observation, components of which may be missing."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import as_observation
from fuzzykf.engine.selected import (
    QUIET,
    inverse,
    inverse_seen,
    log_normal,
    seen_components,
    update_correlated,
    update_linear,
    update_residual,
)
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, Numbers

__all__ = ["condition", "condition_linear", "distance", "log_density", "observed", "zero_where_missing"]

_NUMPY_INVERSE = np.linalg.inv


def observed(z: Numbers, m: int, x: FloatArray) -> FloatArray | None:
    """Return an observation of m components in the form of x, flat or column; None where all are missing."""
    value = as_observation(z, m)
    return value.reshape(-1, 1) if value is not None and x.ndim == 2 else value


def zero_where_missing(y: FloatArray, z: FloatArray) -> tuple[FloatArray, np.ndarray | None]:
    """Return the residual y, 0 where z is missing, and which components were seen (None: all)."""
    seen = seen_components(z)
    return (y, seen) if seen is None else (np.where(seen.reshape(y.shape), y, 0.0), seen)


@QUIET
def condition(
    x: FloatArray,
    P: FloatArray,
    y: FloatArray,
    H: FloatArray,
    R: FloatArray,
    identity: FloatArray,
    inv: Callable[[Any], Any],
    seen: np.ndarray | None = None,
    M: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return x, P, S, SI and K after conditioning on the components seen of the residual y.

    ``M`` is the covariance of the error of x and the noise of y, and ``inv`` inverts S, which has
    to be positive definite if that is `numpy.linalg.inv`.
    """
    block_inverse = inverse if inv is _NUMPY_INVERSE else inv
    invert = block_inverse
    if seen is not None:

        def invert(S: FloatArray) -> FloatArray:
            return inverse_seen(S, seen, block_inverse)

    try:
        if M is None:
            return update_residual(x, P, y, H, R, identity, invert)
        return update_correlated(x, P, y, H, R, M, identity, invert)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error


@QUIET
def condition_linear(
    x: FloatArray,
    P: FloatArray,
    z: FloatArray,
    H: FloatArray,
    R: FloatArray,
    identity: FloatArray,
    inv: Callable[[Any], Any],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return x, P, y, S, SI and K after conditioning on the components of z that are not NaN."""
    if inv is not _NUMPY_INVERSE:
        y, seen = zero_where_missing(z - H.dot(x), z)
        x, P, S, SI, K = condition(x, P, y, H, R, identity, inv, seen)
        return x, P, y, S, SI, K
    try:
        return update_linear(x, P, z, H, R)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error


def log_density(y: FloatArray, S: FloatArray, seen: np.ndarray | None) -> float:
    """Log of N(y; 0, S) of the components seen of a residual, flat or column."""
    y = y.ravel()
    return log_normal(y, S) if seen is None else log_normal(y[seen], S[np.ix_(seen, seen)])


@QUIET
def distance(y: FloatArray, SI: FloatArray) -> float:
    """Length of a residual, flat or column, in standard deviations: the root of y' S^-1 y."""
    y = y.ravel()
    return sqrt(max(float(y.dot(SI).dot(y)), 0.0))

"""Updates beside the usual one: with a gain that is given, and with a block of an observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import QUIET
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief, is_whole
from fuzzykf.kalman.arguments import as_covariance, as_matrix, as_square
from fuzzykf.kalman.updates import condition, distance, log_density, observed, zero_where_missing

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, Numbers

__all__ = ["block_matrices", "block_of", "update_block", "update_with_gain", "whole_observation"]


@QUIET
def update_with_gain(
    x: FloatArray, z: FloatArray, H: FloatArray, K: FloatArray
) -> tuple[FloatArray, FloatArray, np.ndarray | None]:
    """Return x + K y, the residual y = z - H x, and which components of z were seen (None: all).

    A missing component counts as if it had been observed where it was predicted.
    """
    y, seen = zero_where_missing(z - H.dot(x), z)
    return x + K.dot(y), y, seen


def block_of(start: int, length: int, m: int) -> slice:
    """Which of m components a block of neighbours is."""
    if not is_whole(start):
        raise ParameterError(f"start, z_i: got {brief(start)}, expected the number of the first component")
    start = int(start)
    stop = start + length
    if not 0 <= start < stop <= m:
        raise ShapeError(f"start, z_i: got components {start} to {stop - 1}, expected some of 0 to {m - 1}")
    return slice(start, stop)


def block_matrices(
    block: slice, H_i: Any, R_i: Any, H: Any, R: Any, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of a block: those given, or its parts of H, of that shape, and of R."""
    (m, n), length = shape, block.stop - block.start
    if H_i is None:
        H_i = as_matrix("H", H, shape)[block]
    else:
        H_i = as_numbers("H_i", H_i)
        H_i = as_array("H_i", np.atleast_2d(H_i) if length == 1 else H_i, (length, n))
    if R_i is None:
        return H_i, as_square("R", R, m)[block, block]
    return H_i, as_covariance("R_i", R_i, length)


def whole_observation(
    z: Any, y: Any, K: Any, form: tuple[int, ...], shape: tuple[int, int]
) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Copy z and y, of that form, and K, of that shape, to write a block into; make new ones if unfit."""
    if np.size(z) == form[0] and np.shape(K) == shape:
        return np.array(z).reshape(form), np.array(y).reshape(form), np.array(K)
    return np.full(form, None), np.zeros(form), np.zeros(shape)


@QUIET
def update_block(
    x: FloatArray,
    P: FloatArray,
    z_i: Numbers,
    H: FloatArray,
    R: FloatArray,
    block: slice,
    whole: tuple[np.ndarray, FloatArray, FloatArray],
    identity: FloatArray,
    inv: Callable[[Any], Any],
) -> tuple[FloatArray, FloatArray, float, float]:
    """Condition on a block z_i of an observation; H and R are those of the block.

    Its entries are written into ``whole``, the arrays z, y and K of the whole observation.

    Returns
    -------
    x, P
    log_likelihood, mahalanobis : float
        Of the block.
    """
    z, y, K = whole
    value = observed(np.ravel(as_numbers("z_i", z_i)), len(R), x)
    if value is None:
        z[block], y[block] = np.nan, 0.0
        return x.copy(), P.copy(), 0.0, 0.0
    y_i, seen = zero_where_missing(value - H.dot(x), value)
    x, P, S_i, SI_i, K_i = condition(x, P, y_i, H, R, identity, inv, seen)
    z[block], y[block], K[:, block] = value, y_i, K_i
    return x, P, log_density(y_i, S_i, seen), distance(y_i, SI_i)

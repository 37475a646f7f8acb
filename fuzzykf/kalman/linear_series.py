"""Whole series through a linear filter, all at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.selected import filter_linear, filter_linear_many
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman.series import empty_fields, field_shapes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fuzzykf.arrays import FloatArray

__all__ = ["LinearModel", "control_matrix", "control_terms", "controls_of", "filter_many", "filter_one"]


class LinearModel(NamedTuple):
    """The attributes of a linear filter as arrays of the right shapes."""

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray
    H: FloatArray
    R: FloatArray
    alpha_sq: float


def filter_one(
    model: LinearModel, series: FloatArray, names: Iterable[str]
) -> tuple[dict[str, FloatArray], tuple[FloatArray, ...] | None]:
    """Do predict and update for a series (n, m).

    Returns
    -------
    stored : dict of ndarray
        The fields named.
    innovation : tuple of ndarray, or None
        y, S, SI and K of the latest step of which something was observed.
    """
    x, P, F, Q, H, R, alpha_sq = model
    stored = empty_fields(names, field_shapes(len(P)), len(series))
    try:
        return stored, filter_linear(x, P, series, F, Q, H, R, alpha_sq, None, stored)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error


def filter_many(
    model: LinearModel, series: FloatArray, names: Iterable[str], terms: FloatArray | None, rows: Any
) -> dict[str, FloatArray]:
    """Return the fields named for many series (series, n, m).

    They are those ``rows`` of the series that the terms B u of `control_terms` belong to, up to their end.
    """
    controls = None if terms is None else (terms if len(terms) == 1 else terms[rows])[:, : series.shape[1]]
    x, P, F, Q, H, R, alpha_sq = model
    out = empty_fields(names, field_shapes(len(P)), *series.shape[:2])
    try:
        filter_linear_many(x.ravel(), P, series, F, Q, H, R, alpha_sq, controls, out)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    if "log_likelihood" in out:  # of a distance beyond all numbers, whose terms have cancelled to NaN
        out["log_likelihood"][np.isnan(out["log_likelihood"])] = -np.inf
    return out


def control_matrix(B: Any, dim_x: int) -> FloatArray:
    """Return the control matrix of a filter; a number is one of one row and column."""
    matrix = None if B is None else as_numbers("B", B)
    if matrix is not None and dim_x == 1 and matrix.shape in {(), (1,)}:
        return matrix.reshape(1, 1)
    if matrix is None or matrix.ndim != 2:
        raise ShapeError(f"B: got shape {np.shape(B)}, expected ({dim_x}, dim_u) to go with us")
    return matrix


def control_terms(B: Any, us: Any, shape: tuple[int, ...], dim_x: int) -> FloatArray:
    """Return the terms B u (series or 1, n, dim_x) for many observations of the shape (series, n)."""
    controls = as_numbers("us", us)
    matrix = control_matrix(B, dim_x)
    one, many = (shape[1], matrix.shape[1]), (*shape, matrix.shape[1])
    if controls.shape == one:
        controls = controls[None]
    if controls.shape not in {(1, *one), many}:
        raise ShapeError(f"us: got shape {np.shape(us)}, expected {many} or {one}")
    if not (np.isfinite(controls).all() and np.isfinite(matrix).all()):
        raise ParameterError("us, B: got NaN or infinity, expected finite numbers")
    terms: FloatArray = controls @ matrix.T
    return terms


def controls_of(us: Any, rows: Any, shape: tuple[int, ...], flat: bool) -> list[dict[str, FloatArray]] | None:
    """Return the controls of some of the series, of the shape (s, n), as the filter of each takes them."""
    if us is None:
        return None
    controls = as_numbers("us", us)
    own = np.broadcast_to(
        controls[: shape[1]] if controls.ndim == 2 else controls[rows, : shape[1]],
        (*shape, controls.shape[-1]),
    )
    return [{"us": one if flat else one[..., None]} for one in own]

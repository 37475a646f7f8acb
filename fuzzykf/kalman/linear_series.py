"""Whole series through a linear filter, all at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.selected import filter_linear, filter_linear_many
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman.series import empty_fields, field_shapes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fuzzykf.arrays import FloatArray

__all__ = ["LinearModel", "filter_many", "filter_one"]


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

    They are those ``rows`` of the series that the terms B u, see `fuzzykf.kalman.controls.linear_controls`,
    belong to, up to their end.
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

"""Inputs as filters are told them: of one step, of each step of a series, or of many series."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.labels import columns_of, match_columns
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries

__all__ = ["told_inputs", "told_inputs_of_many"]


def told_inputs(name: str, us: Any, n: int, system: Any, begins: bool) -> FloatArray:
    """Return inputs (n, k) of a series; those of its first observation are not used if it ``begins``.

    Raises
    ------
    ShapeError, ParameterError
        If they are missing, have a wrong shape, lack a name of the model or are not finite where they are
        used; if there are some and the model has no inputs.
    """
    k = system.dim_u
    if k is None:
        if us is not None:
            raise ParameterError(f"{name}: got {brief(us)}, but the model has no inputs; expected None")
        return np.empty((n, 0))
    names = system.form.inputs
    if us is None:
        if n <= (1 if begins else 0):
            return np.zeros((n, k))
        raise ParameterError(f"{name}: missing; the model has the inputs {listed(names)}, known at all times")
    columns = columns_of(us)
    if columns is not None and names != tuple(f"u{j}" for j in range(k)):
        us = us.to_numpy()[:, match_columns(columns, names, name)]
    array = as_numbers(name, us.to_numpy() if hasattr(us, "to_numpy") else us)
    if array.shape not in {(n, k), (n, k, 1)} and not (k == 1 and array.shape == (n,)):
        also = f" or ({n},)" if k == 1 else ""
        raise ShapeError(
            f"{name}: got shape {array.shape}, expected ({n}, {k}){also}, a row for each observation and a "
            f"column for each of {listed(names)}"
        )
    return _proved(name, array.reshape(n, k), begins)


def told_inputs_of_many(us: Any, many: ManySeries, system: Any, begins: bool) -> FloatArray:
    """Return inputs of many series, (series, n, k), or (1, n, k) where these share them."""
    k, n = system.dim_u, many.values.shape[1]
    plain = us is None or k is None
    if plain or (isinstance(us, np.ndarray) and us.shape in {(n, k), (n, k, 1), *([(n,)] if k == 1 else [])}):
        return told_inputs("us", us, n, system, begins)[None]
    if hasattr(us, "columns") and len(us) == n and len(us.columns) == k:
        return told_inputs("us", us, n, system, begins)[None]
    found = many.beside("us", us, k)
    for row, one in enumerate(found):
        end = n if many.lengths is None else many.lengths[row]
        _proved("us", one[:end], begins)
    return np.nan_to_num(found)  # beyond the end of a series, and where it is not used


def _proved(name: str, us: FloatArray, begins: bool) -> FloatArray:
    """Return inputs (n, k) that are finite where they are used; zero where they are not."""
    us = us.copy()
    if begins:
        us[:1] = 0.0
    if not np.isfinite(us).all():
        row = int(np.argwhere(~np.isfinite(us))[0][0])
        raise ParameterError(
            f"{name}: row {row} is {us[row].tolist()}, expected finite numbers: inputs are known at all times"
        )
    return us

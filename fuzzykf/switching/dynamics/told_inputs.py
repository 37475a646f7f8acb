"""Inputs as filters are told them: of one step, of each step of a series, or of many series."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.labels import Labels, columns_of, match_columns, match_row
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries

__all__ = ["by_name", "told_inputs", "told_inputs_of_many", "told_step"]


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
    array = as_numbers(name, by_name(name, us, names))
    if array.shape not in {(n, k), (n, k, 1)} and not (k == 1 and array.shape == (n,)):
        also = f" or ({n},)" if k == 1 else ""
        raise ShapeError(
            f"{name}: got shape {array.shape}, expected ({n}, {k}){also}, a row for each observation and a "
            f"column for each of {listed(names)}"
        )
    return _proved(name, array.reshape(n, k), begins)


def by_name(name: str, us: Any, names: tuple[str, ...]) -> Any:
    """Return the columns of a table in the order of the inputs of a model; an array goes by position.

    So does a table with other names where inputs were learned from an array and are called u0, u1, ...

    Raises
    ------
    ParameterError
        If a name is missing, or stands twice.
    """
    at = _places(name, us, names)
    values = us.to_numpy() if hasattr(us, "to_numpy") else us
    return values if at is None else values[:, at]


def _places(name: str, us: Any, names: tuple[str, ...]) -> list[int] | None:
    """Return where the inputs of a model stand among the columns of a table; None if they go by position."""
    columns = columns_of(us)
    if columns is None or us.ndim != 2:
        return None
    nameless = names == tuple(f"u{j}" for j in range(len(names)))
    if nameless and not set(names) & {str(one) for one in columns}:
        return None
    has_clock = any(one.startswith("clock_") for one in names)
    remedy = "; clock_inputs(index, workday=True, ...) makes those of a clock" if has_clock else ""
    return match_columns(columns, names, name, remedy)


def _in_order(us: Any, names: tuple[str, ...]) -> Any:
    """Return a table of one series with its columns in the order of the inputs; its index stays."""
    at = _places("us", us, names)
    if at is None:
        return us
    return us.iloc[:, at] if hasattr(us, "iloc") else us.to_numpy()[:, at]


def told_step(name: str, u: Any, system: Any) -> FloatArray:
    """Return the inputs (k,) of one step: an array goes by position, a row of a table by its names.

    Raises
    ------
    ShapeError, ParameterError
        If there are not as many as the model has, a name is missing, or one is not finite.
    """
    k, names = system.dim_u, system.form.inputs
    array = as_numbers(name, match_row(u, Labels(observations=names), name))
    if array.shape not in {(k,), (k, 1), (1, k)} and not (k == 1 and array.shape == ()):
        raise ShapeError(
            f"{name}: got shape {array.shape}, expected ({k},), a number for each of {listed(names)}"
        )
    array = array.reshape(k)
    if not np.isfinite(array).all():
        raise ParameterError(
            f"{name}: got {array.tolist()}, expected finite numbers: inputs are known at all times"
        )
    return array.copy()


def told_inputs_of_many(us: Any, many: ManySeries, system: Any, begins: bool) -> FloatArray:
    """Return inputs of many series, (series, n, k), or (1, n, k) where these share them."""
    k, n = system.dim_u, many.values.shape[1]
    plain = us is None or k is None
    if plain or (isinstance(us, np.ndarray) and us.shape in {(n, k), (n, k, 1), *([(n,)] if k == 1 else [])}):
        return told_inputs("us", us, n, system, begins)[None]
    names = system.form.inputs
    is_shared = hasattr(us, "columns") and len(us) == n
    if is_shared and (len(us.columns) == k or set(names) <= {str(one) for one in us.columns}):
        return told_inputs("us", us, n, system, begins)[None]
    if isinstance(us, Mapping):
        us = {key: _in_order(one, names) for key, one in us.items()}
    elif isinstance(us, list | tuple):
        us = [_in_order(one, names) for one in us]
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

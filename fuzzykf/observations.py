"""What filters take: one observation, a series, many series, what goes with them row by row.

Shapes, missing data and indexes are decided here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from math import isfinite
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import brief, is_complex
from fuzzykf.missing import as_floats, is_bytes
from fuzzykf.texts import counted
from fuzzykf.times import check_increasing

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, ManyNumbers, Numbers

__all__ = [
    "PerStep",
    "as_listed",
    "as_many",
    "as_observation",
    "as_observations",
    "check_ahead",
    "check_aligned",
    "index_of",
    "is_uneven",
    "named_per_step",
    "one_per_step",
    "per_step",
]


#: Arguments of whole series that say how each step moves the state.
MOTIONS = ("Fs", "Qs", "dt", "fx_args")


class _Rows(Protocol):
    """An array, or an object of pandas or xarray."""

    def __len__(self) -> int: ...

    def __array__(self) -> np.ndarray[Any, Any]: ...


#: What has a value for each step: a list, an array, a table of pandas.
PerStep: TypeAlias = Sequence[Any] | _Rows


def as_observation(z: Numbers, dim_z: int) -> FloatArray | None:
    """Turn one observation into a flat vector, or None where all of it is missing.

    Parameters
    ----------
    z : array_like or None
        A scalar (if ``dim_z`` is 1), a flat vector, a row, a column or a list.
        None, or NaN in every component, means missing.  NaN in some components
        means that these are missing.
    dim_z : int
        Number of components.

    Returns
    -------
    ndarray of shape (dim_z,) or None
        A new array; NaN marks missing components.

    Raises
    ------
    ShapeError
        If ``z`` has another shape, or is not numeric.

    Examples
    --------
    >>> as_observation([[1.0], [2.0]], 2)
    array([1., 2.])
    >>> as_observation(float("nan"), 1) is None
    True
    """
    if z is None or z is np.ma.masked or type(z).__name__ == "NAType":
        return None
    if dim_z == 1 and isinstance(z, float) and isfinite(z):  # the usual case in real time
        return np.array([z])
    try:
        value = np.array(z if type(z) is np.ndarray and z.dtype == np.float64 else as_floats(z))
    except (TypeError, ValueError, OverflowError) as error:
        numbers = counted(dim_z, "number")
        raise ShapeError(f"z: expected {numbers}, got {brief(z)}{_why_no_number(z)}") from error
    shape = value.shape
    if not (
        shape in ((dim_z,), (dim_z, 1), (1, dim_z)) or (dim_z == 1 and value.size == 1 and value.ndim <= 2)
    ):
        allowed = f"({dim_z},), ({dim_z}, 1) or (1, {dim_z})"
        if dim_z == 1:
            allowed = "a scalar, (1,) or (1, 1)"
        raise ShapeError(f"z: got shape {shape}, expected {allowed}")
    value = value.reshape(dim_z)
    if all(map(isfinite, value.tolist())):  # a small vector: faster than asking numpy twice
        return value
    if np.isinf(value).any():
        raise ParameterError(f"z: got {value.tolist()}, expected finite numbers (NaN where missing)")
    return None if np.isnan(value).all() else value


def _why_no_number(z: Any) -> str:
    """Return what a message says of a value that is not made of numbers, where that is known."""
    if isinstance(z, Mapping):
        return ", which goes by name, but no names are known here: pass the numbers alone"
    while isinstance(z, list | tuple) and z:
        z = z[0]
    z = z.ravel()[0] if isinstance(z, np.ndarray) and z.size else z
    return ", which is text: make a number of it first" if isinstance(z, str) else ""


def as_observations(zs: ManyNumbers, dim_z: int) -> FloatArray:
    """Turn a series of observations into an array, NaN where something is missing.

    Parameters
    ----------
    zs : array_like or iterable
        Shape (n, dim_z) or (n, dim_z, 1); also (n,) if ``dim_z`` is 1.  Lists may
        hold None.  A pandas Series or DataFrame is accepted.
    dim_z : int
        Number of components of one observation.

    Returns
    -------
    ndarray of shape (n, dim_z)
        A new array.

    Raises
    ------
    ShapeError
        If the series, or one of its observations, has another shape.

    Examples
    --------
    >>> as_observations([1.0, None, 3.0], 1)
    array([[ 1.],
           [nan],
           [ 3.]])
    """
    if isinstance(zs, np.ndarray) and zs.ndim == 0:
        raise ShapeError(f"zs: got shape (), expected a series of observations, not {brief(zs.item())}")
    is_plain = type(zs) is np.ndarray and zs.dtype == np.float64
    if not is_plain and is_complex(zs):
        raise ParameterError("zs: got complex numbers, expected real ones")
    # members of these are no observations, or in no order
    if not is_plain and (isinstance(zs, str | Mapping | Set) or is_bytes(zs)):
        raise ParameterError(f"zs: got {brief(zs)} ({type(zs).__name__}), expected a series of observations")
    if not isinstance(zs, np.ndarray):
        check_aligned(zs=zs)
        try:
            given: Any = zs
            zs = given.to_numpy() if hasattr(given, "to_numpy") else list(given)
        except TypeError as error:
            raise ShapeError(f"zs: got {brief(zs)}, expected a series of observations") from error
    if isinstance(zs, list) or zs.dtype == object:
        rows = []
        for k, z in enumerate(zs):
            try:
                rows.append(as_observation(z, dim_z))
            except (ShapeError, ParameterError) as error:
                raise type(error)(f"zs: observation {k}, {error}") from error
        missing = np.full(dim_z, np.nan)
        return np.array([missing if z is None else z for z in rows]).reshape(len(rows), dim_z)
    try:
        series = np.array(zs if is_plain else as_floats(zs))
    except (TypeError, ValueError) as error:
        raise ShapeError(f"zs: expected numbers, got an array of {zs.dtype}") from error
    n = series.shape[0] if series.ndim else -1
    allowed = {(n, dim_z), (n, dim_z, 1), (n, 1, dim_z)}
    if dim_z == 1:
        allowed.add((n,))
    if n < 0 or series.shape not in allowed:
        expected = f"(n, {dim_z}) or (n, {dim_z}, 1)" + (" or (n,)" if dim_z == 1 else "")
        raise ShapeError(f"zs: got shape {series.shape}, expected {expected}")
    series = series.reshape(n, dim_z)
    if np.isinf(series).any():
        row = int(np.flatnonzero(np.isinf(series).any(axis=1))[0])
        raise ParameterError(
            f"zs: observation {row} is {series[row].tolist()}, expected finite numbers (NaN where missing)"
        )
    return series


def as_many(zs: Any, dim_z: int) -> FloatArray:
    """Return many series as an array (series, n, dim_z), NaN where missing.

    Parameters
    ----------
    zs : array_like
        Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1.
    dim_z : int

    Returns
    -------
    ndarray, shape (series, n, dim_z)
        Read-only; shares memory with ``zs`` where possible.

    Raises
    ------
    ShapeError, ParameterError
        If the shape is wrong, or a number is infinite.

    Examples
    --------
    >>> from fuzzykf.base import as_many
    >>> as_many([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], dim_z=1).shape
    (2, 3, 1)
    """
    if is_complex(zs):
        raise ParameterError("zs: got complex numbers, expected real ones")
    try:
        array = as_floats(zs).view()
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(
            f"zs: expected numbers of shape (series, n, {dim_z}); pad series of unequal length with NaN"
        ) from error
    if dim_z == 1 and array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.shape[2] != dim_z:
        expected = f"(series, n, {dim_z})" + (" or (series, n)" if dim_z == 1 else "")
        raise ShapeError(f"zs: got shape {array.shape}, expected {expected}")
    if np.isinf(array).any():
        series, step = (int(k) for k in np.argwhere(np.isinf(array))[0][:2])
        raise ParameterError(
            f"zs: observation {step} of series {series} is {array[series, step].tolist()}, "
            "expected finite numbers (NaN where missing)"
        )
    array.flags.writeable = False
    return array


# --------------------------------------------------------------------------- step by step


def as_listed(name: str, values: Any, n: int) -> Sequence[Any]:
    """Return what holds a value for each step, of which there are ``n``; a number or a text does not.

    A table of pandas counts by position: its labels are those of the observations, see `check_aligned`.
    """
    if hasattr(values, "to_numpy"):
        values = values.to_numpy()
    listed = isinstance(values, Sequence) or (hasattr(values, "__len__") and hasattr(values, "__array__"))
    if not listed or isinstance(values, str | bytes) or (isinstance(values, np.ndarray) and values.ndim == 0):
        raise ShapeError(f"{name}: got {brief(values)}, expected one value for each of the {n} observations")
    each: Sequence[Any] = values
    return each


def per_step(name: str, values: Any, n: int) -> Sequence[Any]:
    """Return one value per step; None for all of them where nothing was given."""
    if values is None:
        return [None] * n
    each = as_listed(name, values, n)
    if len(each) < n:
        raise ShapeError(f"{name}: got {len(each)} values, expected one for each of the {n} observations")
    return each


def one_per_step(name: str, values: Any, n: int) -> Sequence[Any]:
    """Return one value per step, of which there may be no more."""
    each = as_listed(name, values, n)
    if len(each) != n:
        raise ShapeError(f"{name}: got {len(each)} values, expected one for each of the {n} observations")
    return each


def is_uneven(told: Mapping[str, Any]) -> bool:
    """Whether what is told of the steps, by the names of the arguments, says how each moves the state.

    They may then differ in length.
    """
    return any(told.get(name) is not None for name in MOTIONS)


def named_per_step(name: str, values: Any, n: int) -> list[dict[str, Any]]:
    """Return keyword arguments for each step; none where nothing, or None, was given."""
    found: list[dict[str, Any]] = []
    for k, one in enumerate(per_step(name, values, n)[:n]):
        if not (one is None or isinstance(one, Mapping)):
            raise ParameterError(
                f"{name}[{k}]: got {brief(one)}, expected a dict of keyword arguments, or None"
            )
        found.append(dict(one or {}))
    return found


# --------------------------------------------------------------------------- indexes


def index_of(table: Any) -> Any:
    """Return the row index of a pandas object or a DataArray, or None.

    Parameters
    ----------
    table : object

    Returns
    -------
    pandas.Index or None

    Examples
    --------
    >>> import pandas as pd
    >>> from fuzzykf.base import index_of
    >>> index_of(pd.Series([1.0, 2.0], index=["a", "b"])).tolist()
    ['a', 'b']
    """
    if not hasattr(table, "to_numpy"):
        return None
    if hasattr(table, "dims") and hasattr(table, "indexes"):
        return table.indexes.get(table.dims[0]) if table.dims else None
    index = getattr(table, "index", None)
    return None if callable(index) else index  # a list has a method of that name


def check_aligned(**tables: Any) -> None:
    """Raise unless the tables of pandas among these have one index, in one order; times in theirs.

    Arrays and lists have no index: they go by position, with anything.  An index of times has to
    increase, for a series that stands in another order is another one; so has an index of durations.

    Parameters
    ----------
    **tables
        What goes together, by the names of the arguments; None where an argument was not given.

    Raises
    ------
    ParameterError
        Names two that differ, with both ends of their indexes; or the row whose time (or duration) is
        not later than that of the row before, or missing.

    Examples
    --------
    >>> import pandas as pd
    >>> check_aligned(x=pd.Series([1.0, 2.0]), y=[3.0, 4.0])
    """
    found = {name: index_of(table) for name, table in tables.items()}
    indexed = {name: index for name, index in found.items() if hasattr(index, "equals")}
    names = list(indexed)
    if names:
        check_increasing(indexed[names[0]], lambda row: f"{names[0]}: the index of row {row}")
    for other in names[1:]:
        one = names[0]
        if not indexed[one].equals(indexed[other]):
            raise ParameterError(
                f"{one}, {other}: rows of different indexes; {one} has {_ends(indexed[one])} and {other} has "
                f"{_ends(indexed[other])}; expected the same in the same order (join them first, or pass "
                "arrays, which go together by position)"
            )


def _ends(index: Any) -> str:
    if len(index) == 0:
        return "no row"
    return f"{len(index)} from {index[0]} to {index[-1]}"


def check_ahead(ahead: Any, steps: int, tables: Mapping[str, Any]) -> None:
    """Raise unless the tables for a forecast have the index of its rows, where that is known.

    Rows that are numbered from 0 go by position if those ahead are numbered: so are those of a table that
    was made for the forecast alone.

    Parameters
    ----------
    ahead : object
        Index of the rows ahead; None if nobody knows it.
    steps : int
    tables : mapping of str to object
        By the names of the arguments.

    Raises
    ------
    ParameterError
        As from `check_aligned`.
    """
    for name, table in tables.items():
        index = index_of(table)
        if ahead is None or not hasattr(index, "equals"):
            check_aligned(**{name: table})
        elif not (ahead.dtype.kind in "iu" and list(index) == list(range(steps))):
            check_aligned(forecast=ahead.to_series(), **{name: index[:steps].to_series()})

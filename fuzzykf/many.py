"""Many series as they come in: an array, a frame, a list of series of any length, or a mapping of them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fuzzykf.errors import NumericalRangeError, ParameterError, ShapeError
from fuzzykf.gaussian import brief
from fuzzykf.labels import columns_of
from fuzzykf.missing import as_floats
from fuzzykf.observations import as_many, as_observations, check_aligned, index_of
from fuzzykf.results import FilterResult
from fuzzykf.sequel import is_timed, warn_of_steps
from fuzzykf.tables import coords_of
from fuzzykf.texts import listed
from fuzzykf.times import has_times

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from fuzzykf.arrays import FloatArray, IntArray

    #: Of a series as it came, what is to be read of it: columns that are chosen by name.
    Chosen = Callable[[Any], Any]

__all__ = ["ManySeries", "as_output_type", "as_stored", "over_threads", "read_many", "stacked"]

_Found = TypeVar("_Found")


@dataclass(frozen=True, eq=False)
class ManySeries:
    """Many series, side by side.

    Attributes
    ----------
    values : ndarray, shape (series, n, dim_z)
        NaN where something is missing, and beyond the end of a series.
    names : sequence or None
        What the series are called.
    index : object or None
        The index of the rows, which all series share; where they do not, a list with one for each.
    lengths : ndarray of int, shape (series,), or None
        How many rows each has, if they are not all of one length.
    coords : tuple or None
        Of a DataArray, see `FilterResult`.
    """

    values: FloatArray
    names: Sequence[Any] | None = None
    index: Any = None
    lengths: IntArray | None = None
    coords: Any = None

    def filtered(
        self, several: Callable[[FloatArray, Any], Mapping[str, FloatArray]], nodes: FloatArray | None = None
    ) -> FilterResult:
        """Filter the series, those of one length together, and say in the result which is which.

        Parameters
        ----------
        several : callable
            Of series (s, n, dim_z) and their places among all; returns fields (s, n, ...).
        nodes : ndarray, shape (M,), optional
            What the columns of ``mu`` belong to.

        Returns
        -------
        FilterResult
            NaN beyond the end of a series.
        """
        fields: dict[str, FloatArray] = {}
        if self.lengths is None:
            fields = dict(several(self.values, slice(None)))
        else:
            shape = self.values.shape[:2]
            for n in np.unique(self.lengths):
                rows = np.flatnonzero(self.lengths == n)
                for name, found in several(self.values[rows, :n], rows).items():
                    if name not in fields:
                        fields[name] = np.full((*shape, *found.shape[2:]), np.nan, found.dtype)
                    fields[name][rows, :n] = found
        return FilterResult(
            **fields,
            nodes=nodes if "mu" in fields or (nodes is not None and nodes.ndim == 2) else None,
            index=self.index,
            names=self.names,
            lengths=self.lengths,
            coords=self.coords,
        )

    def beside(self, name: str, values: Any, size: int = 1, *, uneven: bool = False) -> FloatArray:
        """Read what goes with each observation, in any of the forms that series come in.

        Parameters
        ----------
        name : str
            The argument, for errors.
        values : array_like, DataFrame, list, tuple or mapping
        size : int
            How many numbers go with each.
        uneven : bool
            As in `read_many`.

        Returns
        -------
        ndarray, shape (series, n, size)
            NaN where something is missing, and beyond the end of a series.

        Raises
        ------
        ShapeError, ParameterError
            If it is of other series, or of other rows.
        """
        try:
            other = read_many(values, size, uneven=uneven)
        except (ShapeError, ParameterError) as error:
            raise type(error)(str(error).replace("zs:", f"{name}:", 1)) from error
        if other.values.shape[:2] != self.values.shape[:2] or not _equal(other.lengths, self.lengths):
            got = _sizes(other)
            raise ShapeError(f"{name}: got {got}, expected one value for each of {_sizes(self)}")
        if other.names is not None and self.names is not None and list(other.names) != list(self.names):
            raise ParameterError(
                f"{name}: got the series {_named(other.names)}, expected those of zs in their order, "
                f"{_named(self.names)}"
            )
        for mine, theirs in zip(_indexes(self), _indexes(other), strict=True):
            if mine is not None and theirs is not None and not mine.equals(theirs):
                raise ParameterError(f"zs, {name}: rows of different indexes; expected the same")
        return other.values


def as_output_type(dtype: Any) -> np.dtype[np.floating[Any]]:
    """Return the type of the numbers that are stored.

    Raises
    ------
    ParameterError
        If it is neither float64 nor float32, of the byte order of this machine.
    """
    for known in (np.dtype(np.float64), np.dtype(np.float32)):
        try:
            if dtype is not None and np.dtype(dtype) == known:
                return known
        except TypeError:
            break
    raise ParameterError(f"dtype: got {brief(dtype)}, expected float64 or float32")


def as_stored(fields: Mapping[str, FloatArray], dtype: Any) -> dict[str, FloatArray]:
    """Return fields as numbers of the type that is stored, see `as_output_type`.

    Raises
    ------
    NumericalRangeError
        If a number is too large for it.
    """
    stored: dict[str, FloatArray] = {}
    for name, values in fields.items():
        with np.errstate(over="ignore"):
            stored[name] = values.astype(dtype, copy=False)
        if dtype != values.dtype and (np.isinf(stored[name]) & np.isfinite(values)).any():
            raise NumericalRangeError(
                f"{name}: got numbers up to {np.nanmax(np.abs(values)):.3g} in size, which {dtype} cannot "
                "hold; expected dtype=numpy.float64"
            )
    return stored


def over_threads(several: Callable[[slice], _Found], n: int, threads: int) -> list[_Found]:
    """Do ``several`` for n series, in as many parts as there are threads; what it returns for each."""
    cuts = [n * k // threads for k in range(threads + 1)]
    blocks = [slice(a, b) for a, b in pairwise(cuts) if b > a] or [slice(0)]
    if len(blocks) == 1:
        return [several(blocks[0])]
    with ThreadPoolExecutor(len(blocks)) as pool:
        return list(pool.map(several, blocks))


def stacked(results: Sequence[FilterResult], names: Iterable[str]) -> dict[str, FloatArray]:
    """Return the fields named of results of one length, each with a leading axis for the series."""
    if not results:
        raise ShapeError("zs: got no series, expected at least one")
    return {name: np.stack([getattr(result, name) for result in results]) for name in names}


def read_many(
    zs: Any, dim_z: int, by: Any = None, chosen: Chosen | None = None, *, uneven: bool = False
) -> ManySeries:
    """Return many series, whatever they come in.

    Parameters
    ----------
    zs : array_like, DataFrame, DataArray, list, tuple or mapping
        An array (series, n, dim_z), or (series, n) if ``dim_z`` is 1.  A frame, whose columns are the series
        (if ``dim_z`` is 1) or pairs (series, component); with ``by`` a frame whose rows are those of all
        series.  A list or a mapping of series, each as `Filter.filter` takes it, of any length.
    dim_z : int
    by : hashable, optional
        The column, or the level of the index, that says which series a row belongs to.
    chosen : callable, optional
        Of a series as it came, returns what is to be read of it.
    uneven : bool
        Whether the steps are told, so that nobody is warned of times that are not apart by one step.

    Raises
    ------
    ShapeError, ParameterError
        If the shape is another one, a number is infinite, or it cannot be told what is a series.

    Examples
    --------
    >>> read_many({"a": [1.0, 2.0], "b": [3.0]}, 1).values[..., 0]
    array([[ 1.,  2.],
           [ 3., nan]])
    """
    many = _read(zs, dim_z, by, chosen or _as_it_is)
    if not uneven:
        _warn_of_steps(many)
    return many


def _warn_of_steps(many: ManySeries) -> None:
    if not isinstance(many.index, list):
        warn_of_steps(many.index)
        return
    for k, index in enumerate(many.index):
        warn_of_steps(index, f"series {k if many.names is None else repr(many.names[k])}")


def _read(zs: Any, dim_z: int, by: Any, chosen: Chosen) -> ManySeries:
    if by is not None:
        return _of_rows(zs, dim_z, by, chosen)
    if isinstance(zs, Mapping):
        return _of_list(list(zs.values()), dim_z, list(zs), chosen)
    if hasattr(zs, "columns") and hasattr(zs, "to_numpy"):
        return _of_columns(zs, dim_z, chosen)
    if hasattr(zs, "dims") and hasattr(zs, "indexes"):
        return _of_dimensions(zs, dim_z, chosen)
    if isinstance(zs, list | tuple) and zs and all(map(_is_series, zs)):
        if any(index_of(one) is not None for one in zs) or len({len(one) for one in zs}) > 1:
            return _of_list(list(zs), dim_z, None, chosen)
        try:
            return ManySeries(as_many(zs, dim_z))
        except ShapeError as error:
            try:  # observations in another form, None for one of several components
                return _of_list(list(zs), dim_z, None, chosen)
            except (ShapeError, ParameterError):
                raise error from None
    return ManySeries(as_many(zs, dim_z))


def _as_it_is(zs: Any) -> Any:
    return zs


def _is_series(value: Any) -> bool:
    """Whether a member of a list may be a series, and no number."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return hasattr(value, "__len__") and not isinstance(value, str | bytes | bytearray)


def _of_list(series: list[Any], dim_z: int, names: Sequence[Any] | None, chosen: Chosen) -> ManySeries:
    """Read series one by one."""
    if not series:
        raise ShapeError("zs: got no series, expected at least one")
    found: list[FloatArray] = []
    order: list[Any] | None = None
    for k, one in enumerate(series):
        try:
            one, order = _as_ordered(chosen(one), order)
            found.append(as_observations(one, dim_z))
        except (ShapeError, ParameterError) as error:
            which = f"series {k}" if names is None else f"series {names[k]!r}"
            raise type(error)(f"zs: {which}, {str(error).removeprefix('zs: ')}") from error
    if names is None:
        own = [getattr(one, "name", None) for one in series]
        names = own if None not in own and len(set(own)) == len(own) else None
    indexes = [index_of(one) for one in series]
    shared = _shared(indexes)
    lengths = np.array([len(one) for one in found])
    values = np.full((len(found), lengths.max(), dim_z), np.nan)
    for k, one in enumerate(found):
        values[k, : len(one)] = one
    ragged = bool((lengths != lengths[0]).any())
    return ManySeries(values, names, shared, lengths if ragged else None)


def _as_ordered(one: Any, order: list[Any] | None) -> tuple[Any, list[Any] | None]:
    """Return a table with its columns in the order of those before it, and that order."""
    columns = columns_of(one) if hasattr(one, "columns") else None
    if columns is None or order is None or columns == order or len(columns) == 1:  # a name of the series
        return one, order if columns is None else columns
    if len(columns) != len(order) or set(columns) != set(order):
        raise ParameterError(f"zs: got the columns {_named(columns)}, expected {_named(order)} as before")
    return one[order], order


def _shared(indexes: list[Any]) -> Any:
    """Return the index of all series where it is one, else a list; None where no series has one."""
    first = indexes[0]
    if all(one is None for one in indexes):
        return None
    if hasattr(first, "equals") and all(one is not None and first.equals(one) for one in indexes):
        return first
    return indexes


def _of_columns(frame: Any, dim_z: int, chosen: Chosen) -> ManySeries:
    """Read a frame whose columns are the series, or pairs of a series and a component."""
    columns, index = frame.columns, index_of(frame)
    if len(set(columns)) < len(columns):
        raise ParameterError(f"zs: two columns have one name; they are {_named(columns)}")
    if is_timed(columns) and not is_timed(index):
        raise ParameterError("zs: its columns are times, expected those in the rows: zs.T")
    if dim_z == 1:
        values = _numbers(frame)
        check_aligned(zs=frame)
        return ManySeries(values.T[..., None], columns, index)
    if getattr(columns, "nlevels", 1) < 2:
        raise ShapeError(
            f"zs: got the columns {_named(columns)}, expected pairs (series, component), as the filter takes "
            f"{dim_z} components; of a frame whose rows are those of all series, 'by' names the column that "
            "tells them apart; one series alone goes to filter"
        )
    if columns.nlevels == 2 and columns.names[0] is None and columns.names[1] is not None:
        frame = frame.swaplevel(axis=1)  # as pivot leaves them: what was spread has a name, values have none
        columns = frame.columns
    names = columns.droplevel(list(range(1, columns.nlevels))).unique()
    return _of_list([frame[name] for name in names], dim_z, names, chosen)


def _numbers(frame: Any) -> FloatArray:
    """Return the numbers of a frame (n, columns)."""
    try:
        values = as_floats(frame.to_numpy())
    except (TypeError, ValueError, OverflowError) as error:
        for name in frame.columns:
            try:
                as_floats(frame[name].to_numpy())
            except (TypeError, ValueError, OverflowError) as cause:
                kind = getattr(frame[name], "dtype", type(frame[name]).__name__)
                raise ParameterError(
                    f"zs: the column {name!r} holds {kind}, expected numbers: each column is a series "
                    f"('by' names a column of keys, zs.set_index({name!r}) one of times)"
                ) from cause
        raise ShapeError("zs: expected numbers") from error
    if np.isinf(values).any():
        row, column = (int(k) for k in np.argwhere(np.isinf(values))[0])
        raise ParameterError(
            f"zs: observation {row} of series {frame.columns[column]!r} is {values[row, column]}, "
            "expected finite numbers (NaN where missing)"
        )
    return values


def _of_dimensions(array: Any, dim_z: int, chosen: Chosen) -> ManySeries:
    """Read a DataArray (series, n) or (series, n, component)."""
    if array.ndim < 2:
        raise ShapeError(f"zs: got the dimensions {array.dims}, expected those of series and of rows")
    series, rows = array.dims[:2]
    names, index = array.indexes.get(series), array.indexes.get(rows)
    if (is_timed(names) or str(series).lower() == "time") and not is_timed(index):
        raise ParameterError(
            f"zs: its first dimension, {series!r}, counts times, expected series first: "
            f"zs.transpose({rows!r}, {series!r}, ...)"
        )
    if chosen is _as_it_is:
        check_aligned(zs=array[0] if len(array) else None)
        return ManySeries(as_many(array.to_numpy(), dim_z), names, index, coords=coords_of(array, 2))
    many = _of_list([array[k] for k in range(len(array))], dim_z, None, chosen)
    return ManySeries(many.values, names, index, coords=coords_of(array, 2))


def _of_rows(frame: Any, dim_z: int, by: Any, chosen: Chosen) -> ManySeries:
    """Read a frame whose rows are those of all series."""
    if not hasattr(frame, "groupby") or not hasattr(frame, "columns"):
        raise ParameterError(
            f"by: got {brief(by)}, which goes with a DataFrame; zs is a {type(frame).__name__}"
        )
    levels = [level for level in frame.index.names if level is not None]
    if not isinstance(by, Hashable) or (by not in frame.columns and by not in levels):
        raise ParameterError(f"by: got {brief(by)}, expected one of {_named([*frame.columns, *levels])}")
    is_column = by in frame.columns
    keys = frame[by] if is_column else frame.index.get_level_values(by)
    places: dict[Any, list[int]] = {}
    for row, (key, is_missing) in enumerate(zip(keys, keys.isna(), strict=True)):
        if is_missing:
            raise ParameterError(f"by: row {row} has no value of {by!r}, expected the name of its series")
        places.setdefault(key, []).append(row)
    rest = frame.drop(columns=by) if is_column else _without_level(frame, by)
    times = [name for name in rest.columns if has_times(rest[name])]
    if len(times) == 1 and not has_times(rest.index):  # a column of times is no observation
        rest = rest.set_index(times[0])
    import pandas as pd

    names = pd.Index(list(places), name=by, tupleize_cols=False)
    return _of_list([rest.iloc[rows] for rows in places.values()], dim_z, names, chosen)


def _without_level(part: Any, level: Any) -> Any:
    """Return rows without a level of their index; numbered anew where it was the only one."""
    if part.index.nlevels == 1:
        return part.reset_index(drop=True)
    return part.set_axis(part.index.droplevel(level))


def _named(names: Iterable[Any]) -> str:
    return listed([str(name) for name in names])


def _equal(a: Any, b: Any) -> bool:
    return (a is None) == (b is None) and (a is None or np.array_equal(a, b))


def _indexes(many: ManySeries) -> list[Any]:
    count = len(many.values)
    return many.index if isinstance(many.index, list) else [many.index] * count


def _sizes(many: ManySeries) -> str:
    series, n = many.values.shape[:2]
    if many.lengths is None:
        return f"{series} series of {n}"
    return f"{series} series of {', '.join(map(str, many.lengths[:5]))}{', ...' if series > 5 else ''}"

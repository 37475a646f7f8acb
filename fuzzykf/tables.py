"""Results as a table of pandas, and as a Dataset of xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.gaussian import brief
from fuzzykf.times import has_times

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    import xarray as xr

    from fuzzykf.arrays import FloatArray

    #: The fields of results: names of the axes, description, name of the covariance.
    Fields = Mapping[str, Any]
    Bounds = tuple[FloatArray, FloatArray] | None

__all__ = ["as_dataframe", "as_dataset", "bounds_as_frames", "coords_of", "is_pandas"]

#: Axes of what has a column, or some, in a table with a row for each step.
_TABULATED = (("step",), ("step", "state"), ("step", "observation"), ("step", "class"))


def is_pandas(index: Any) -> bool:
    """Whether an index is one of pandas."""
    return hasattr(index, "equals") and hasattr(index, "nlevels")


def as_dataframe(result: Any, fields: Fields, index: Any, bounds: Bounds) -> pd.DataFrame:
    """Return a row for each step, of many series one after another; see `FilterResult.to_dataframe`.

    Parameters
    ----------
    result : FilterResult
    fields : mapping of str to ResultField
    index : sequence or None
        Index of the rows of a series, in place of that of the result.
    bounds : tuple of ndarray, or None
        Ends of the interval of the state, of the shape of x.
    """
    pandas = _pandas()
    columns: dict[str, FloatArray] = {}
    for name, known in fields.items():
        value = getattr(result, name)
        if value is None or known.axes not in _TABULATED:
            continue
        if name == "class_weights" and result.switch_mean is not None:
            continue  # it says all of two classes
        count = value.ndim - len(result.shape) + 1
        columns |= _columns(name, value, count)
        covariance = None if known.spread is None else getattr(result, known.spread)
        if covariance is not None:
            std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
            columns |= _columns(name, std, count, "_std")
        if name == "x" and bounds is not None:
            columns |= _columns(name, bounds[0], count, "_lower") | _columns(name, bounds[1], count, "_upper")
    try:
        rows, inside = result.index if index is None else index, slice(None)
        if result.is_many:
            rows, inside = _rows_of_many(pandas, result, index)
        frame: pd.DataFrame = pandas.DataFrame({name: v[inside] for name, v in columns.items()}, index=rows)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"index: got {brief(index)}, expected one entry a step ({error})") from error
    return frame


def _columns(name: str, values: FloatArray, axes: int, suffix: str = "") -> dict[str, FloatArray]:
    """Name the columns of a field: ``x``, or ``x0``, ``x1``, ... for several components."""
    if axes == 1:
        return {f"{name}{suffix}": values}
    m = values.shape[-1]
    return {f"{name}{'' if m == 1 else k}{suffix}": values[..., k] for k in range(m)}


def _rows_of_many(pd: Any, result: Any, index: Any) -> tuple[pd.MultiIndex, Any]:
    """Return the index (series, step) of all rows, and which cells (series, n) these are."""
    series, n = result.shape
    lengths = np.full(series, n) if result.lengths is None else result.lengths
    names = pd.RangeIndex(series) if result.names is None else pd.Index(result.names, tupleize_cols=False)
    inside = np.arange(n) < lengths[:, None]
    own = _own_indexes(result, index)
    parts = [pd.RangeIndex(k) if one is None else one for one, k in zip(own, lengths, strict=True)]
    parts = [part if is_pandas(part) else pd.Index(part) for part in parts]
    if any(len(part) != k for part, k in zip(parts, lengths, strict=True)):
        raise ValueError(f"the series have {', '.join(map(str, lengths[:5]))} steps")
    steps = parts[0].append(parts[1:])
    labels = [names.name or "series", _name_of(own[0])]
    return pd.MultiIndex.from_arrays([names.repeat(lengths), steps], names=labels), inside


def _own_indexes(result: Any, index: Any) -> list[Any]:
    """Return the index of each of many series."""
    if index is None and isinstance(result.index, list):
        return result.index
    return [result.index if index is None else index] * result.shape[0]


def _name_of(index: Any) -> str:
    """Return what the rows are called."""
    name = getattr(index, "name", None)
    return str(name) if name is not None else ("time" if has_times(index) else "step")


def as_dataset(result: Any, fields: Fields) -> xr.Dataset:
    """Return a variable for each field, with its axes by name; see `FilterResult.to_xarray`.

    Parameters
    ----------
    result : FilterResult
    fields : mapping of str to ResultField
    """
    try:
        import xarray as xr
    except ImportError as error:
        raise MissingDependencyError("to_xarray needs xarray: pip install 'fuzzykf[dask]'") from error
    many = result.is_many
    own = _own_indexes(result, None) if many else [result.index]
    step, name_of_series = _name_of(own[0]), getattr(result.names, "name", None) or "series"
    dims_given, given = ((), {}) if result.coords is None else result.coords
    if dims_given:
        step = str(dims_given[-1])
        name_of_series = str(dims_given[0])
    variables = {}
    for name, known in fields.items():
        value = getattr(result, name)
        if value is None or name == "nodes":
            continue
        dims = [step if axis == "step" else axis for axis in known.axes]
        if value.ndim > len(dims) + many:  # a value of the switch between several classes
            dims.append("class")
        variables[name] = ([name_of_series, *dims] if many else dims, value, {"long_name": known.description})
    coordinates: dict[str, Any] = dict(given)
    taken = {*fields, "state", "node", "class", "observation", "length"}
    for name in (step, name_of_series if many else None, *given):
        if name in taken:
            raise ParameterError(
                f"to_xarray: the index or a coordinate is called {name!r}, as a field or a dimension of "
                "results is; rename it before filtering"
            )
    if np.ndim(result.nodes) == 2:
        about = {"long_name": fields["nodes"].description}
        coordinates["class_weights_of_node"] = (("node", "class"), result.nodes, about)
    elif result.nodes is not None and result.mu is not None:
        coordinates["node"] = ("node", result.nodes, {"long_name": fields["nodes"].description})
    if many and result.names is not None:
        coordinates[name_of_series] = (name_of_series, np.array([*result.names, None], dtype=object)[:-1])
        if is_pandas(result.names) and result.names.nlevels == 1:
            coordinates[name_of_series] = (name_of_series, _plain(result.names))
        elif all(isinstance(one, str) for one in result.names):
            coordinates[name_of_series] = (name_of_series, list(result.names))
    if many and result.lengths is not None:
        coordinates["length"] = (name_of_series, result.lengths, {"long_name": "number of rows"})
    if is_pandas(result.index) and result.index.nlevels == 1:
        coordinates[step] = (step, _plain(result.index))
    elif many and isinstance(result.index, list):
        coordinates[f"{step}_of_series"] = ((name_of_series, step), _padded(own, result.shape))
    elif result.index is not None and not many:
        coordinates[step] = (step, np.asarray(result.index))
    return xr.Dataset(variables, coordinates)


def coords_of(zs: Any, axes: int) -> tuple[tuple[Any, ...], dict[Any, Any]] | None:
    """Return the first dimensions of a DataArray, and its coordinates along these; None of anything else.

    Parameters
    ----------
    zs : object
    axes : int
        Number of dimensions.
    """
    if not (hasattr(zs, "dims") and hasattr(zs, "coords") and hasattr(zs, "indexes")):
        return None
    dims = tuple(zs.dims[:axes])
    return dims, {name: one.variable for name, one in zs.coords.items() if {*one.dims} <= {*dims}}


def _plain(index: Any) -> Any:
    """Return an index as xarray keeps it."""
    return index.astype("object") if index.dtype.kind not in "iufbMmOU" else index


def _padded(indexes: list[Any], shape: tuple[int, int]) -> Any:
    """Return the indexes of series (series, n), nothing beyond the end of each."""
    times = all(getattr(getattr(one, "dtype", None), "kind", "") == "M" for one in indexes)
    kinds = {str(getattr(one, "dtype", "object")) for one in indexes}
    plain = times and len(kinds) == 1 and "," not in next(iter(kinds))  # a zone has no dtype of NumPy
    padded = np.full(shape, np.datetime64("NaT", "ns") if plain else None, dtype=None if plain else object)
    for k, one in enumerate(indexes):
        if one is not None:
            padded[k, : len(one)] = np.asarray(one) if plain else list(one)
    return padded


def bounds_as_frames(lower: FloatArray, upper: FloatArray, index: Any) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the ends of an interval (n, m) as frames with an index; columns are named as x is."""
    pd = _pandas()
    low, high = (pd.DataFrame(_columns("x", values, 2), index=index) for values in (lower, upper))
    return low, high


def _pandas() -> Any:
    try:
        import pandas
    except ImportError as error:
        raise MissingDependencyError("to_dataframe needs pandas: pip install 'fuzzykf[cli]'") from error
    return pandas

"""What goes in: the variables of the Dataset and the filter, checked before any work is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.labels import Labels, check_no_state, check_step, match_columns, names_of
from fuzzykf.missing import as_floats
from fuzzykf.times import check_increasing

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    import xarray as xr

    from fuzzykf.arrays import FloatArray
    from fuzzykf.base import Filter, FilterResult

__all__ = [
    "check_components",
    "find_filter",
    "find_input",
    "find_observations",
    "match_components",
    "probe",
]


def find_observations(
    ds: xr.Dataset, name: Hashable | None, dim: Hashable, component: Hashable | None, taken: set[Hashable]
) -> xr.DataArray:
    """Return the variable to be filtered, with time and components last."""
    there = [variable for variable in ds.data_vars if variable not in taken]
    listed = ", ".join(map(repr, there)) or "none"
    if name is None:
        if len(there) != 1:
            raise ParameterError(f"observations: name the variable to filter; ds has {listed}")
        name = there[0]
    if name not in ds.variables:
        raise ParameterError(f"observations: ds has no variable {name!r}; it has {listed}")
    series = ds[name]
    core = (dim,) if component is None else (dim, component)
    for argument, wanted in zip(("dim", "component"), core, strict=False):
        if wanted not in series.dims:
            raise ParameterError(f"{argument}: got {wanted!r}, expected one of the dimensions {series.dims}")
        if len(series.chunksizes.get(wanted, ())) > 1:
            raise ParameterError(
                f"ds: {name!r} is chunked along {wanted!r}, but a filter runs through the whole of a series; "
                f"chunk it by series instead: ds.chunk({{{wanted!r}: -1, ...}})"
            )
    if series.dtype.kind not in "biufO":
        raise ParameterError(f"observations: {name!r} holds {series.dtype}, expected real numbers")
    if not series.size:
        raise ShapeError(f"observations: {name!r} is empty, its sizes are {dict(series.sizes)}")
    _check_order(ds, dim)
    return _as_numbers(series).transpose(..., *core)


def _as_numbers(series: xr.DataArray) -> xr.DataArray:
    """Return a variable of objects as one of numbers, NaN where something is missing.

    Blocks are read where they are filtered, so that nothing is computed before that.
    """
    if series.dtype != object:
        return series
    read = _ReadNumbers(repr(series.name))
    if series.chunks is None:
        return series.copy(data=read(series.values))
    nothing = np.empty((0,) * series.ndim)
    return series.copy(data=series.data.map_blocks(read, dtype=np.float64, meta=nothing))


@dataclass(frozen=True)
class _ReadNumbers:
    """Reads objects as numbers; a class, since closures do not travel to workers."""

    name: str

    def __call__(self, values: Any) -> FloatArray:
        """Return an array of floats."""
        try:
            return as_floats(values)
        except (TypeError, ValueError, OverflowError) as error:
            raise ParameterError(
                f"observations: {self.name} holds something that is no real number ({error}); expected "
                "numbers, and None, NaN or NA where something is missing"
            ) from error


def _check_order(ds: xr.Dataset, dim: Hashable) -> None:
    """Refuse rows whose times or durations, the coordinate of ``dim`` if it has such, do not increase."""
    check_increasing(ds.indexes.get(dim), lambda row: f"ds: {dim!r} of row {row}")


def find_filter(model: Any, n_nodes: int | None, rule: str | None) -> tuple[Any, bool, Filter]:
    """Return what travels to the workers, whether it has to be called there, and a filter."""
    from fuzzykf.switching.models.base import SwitchingModel

    options = {key: value for key, value in (("n_nodes", n_nodes), ("rule", rule)) if value is not None}
    makes_its_own = isinstance(model, SwitchingModel)
    if not (makes_its_own and model.is_fuzzy):
        for key, value in options.items():
            raise ParameterError(f"{key}: got {value!r}, expected nothing unless model is a CGOFMSModel")
    if makes_its_own:
        made: Filter = model.filter(**options)
        return made, False, made
    if hasattr(model, "filter_many") and not isinstance(model, type):
        return model, False, model
    if callable(model):
        made = model()
        if hasattr(made, "filter_many"):
            return model, True, made
        raise ParameterError(f"model: it returned {type(made).__name__}, expected a filter")
    raise ParameterError(
        f"model: got {type(model).__name__}, expected a CGOFMSModel, a CGOMSModel, a filter, "
        "or a function that returns a filter"
    )


def match_components(
    series: xr.DataArray, dim: Hashable, component: Hashable | None, filter_: Filter
) -> xr.DataArray:
    """Return the observations that the model of a filter was learned on, by the coordinate of the components.

    Raises
    ------
    ParameterError
        If a component is missing, the variable is a state of the model, or its times are not as far apart as
        those that were learned on.
    """
    labels = getattr(getattr(filter_, "model", None), "labels", None)
    if not isinstance(labels, Labels) or not labels:
        return series
    check_no_state([str(series.name)], labels, "observations")
    check_step(
        series.indexes.get(dim),
        labels,
        "ds",
        f"drop the coordinate {dim!r}, so that rows are taken as they come",
    )
    there = None if component is None else series.indexes.get(component)
    columns = None if there is None else names_of(list(there))
    if columns is None:
        return series
    if labels.observations is None:
        check_no_state(map(str, columns), labels, "component")
        return series
    positions = match_columns(columns, labels.observations, f"component: {component!r}")
    same = positions == list(range(len(columns)))
    return series if same else series.isel({component: positions})


def check_components(series: xr.DataArray, component: Hashable | None, dim_z: int) -> None:
    """Refuse observations of another size than the filter takes."""
    size = 1 if component is None else series.sizes[component]
    if size != dim_z:
        where = "no dimension of components was named" if component is None else f"{component!r} has {size}"
        raise ShapeError(f"component: the filter takes observations of {dim_z} components, but {where}")


def find_input(
    ds: xr.Dataset, key: str, name: Hashable, series: xr.DataArray, dim: Hashable, component: Hashable | None
) -> xr.DataArray:
    """Return a further input, time after the series and its own dimensions last."""
    if name not in ds.variables:
        raise ParameterError(f"inputs: ds has no variable {name!r}, which {key!r} asks for")
    value = ds[name]
    if dim not in value.dims:
        raise ParameterError(f"inputs: {name!r} has the dimensions {value.dims}, expected {dim!r} among them")
    own = [d for d in value.dims if d == component or d not in series.dims]
    return value.transpose(..., dim, *own)


def probe(
    filter_: Filter, names: tuple[str, ...] | None, others: Mapping[str, xr.DataArray], dim: Hashable
) -> FilterResult:
    """Filter one missing observation: this checks ``keep`` and ``inputs``, and shows all shapes."""
    options: dict[str, Any] = {} if names is None else {"keep": names}
    for key, value in others.items():
        last = value.dims[value.dims.index(dim) + 1 :]
        options[key] = np.zeros((1, 1, *(value.sizes[d] for d in last)))
        if last:
            options[key][..., 0] = 1.0  # class weights sum to one
    try:
        return filter_.filter_many(np.full((1, 1, filter_.dim_z), np.nan), **options)
    except TypeError as error:
        if not others:
            raise
        raise ParameterError(f"inputs: {type(filter_).__name__} does not take them: {error}") from error

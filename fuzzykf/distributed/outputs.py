"""What comes out: names, dimensions, coordinates and attributes of the results."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.distributed.stores import MARK
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.results import FIELDS

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence
    from typing import Any

    import xarray as xr

    from fuzzykf.base import Filter, FilterResult

__all__ = ["DIMS", "check_names", "describe", "dims_of"]

_STATE, _SQUARE = ("state",), ("state", "state_column")

#: Dimensions of each field of a filtered series after those of the series and of time.
DIMS = {name: known.axes[1:] for name, known in FIELDS.items() if known.streamed}


def dims_of(name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return the dimensions of a field whose shape at one step is known.

    A value of the switch between more than two classes has one more: it is class weights.
    """
    dims = DIMS[name]
    return dims if len(shape) == len(dims) else (*dims, "class")


def check_names(
    series: xr.DataArray, shapes: Mapping[str, tuple[int, ...]], states: Sequence[str] | None, dim_x: int
) -> None:
    """Refuse names that two things would have."""
    for name in (*shapes, *(d for field, shape in shapes.items() for d in dims_of(field, shape))):
        if name in series.dims or name in series.coords:
            raise ParameterError(
                f"ds: its dimension or coordinate {name!r} has the name of a result; "
                f"rename it first: ds.rename({name}=...)"
            )
    if states is not None and (isinstance(states, str) or len(states) != dim_x):
        raise ShapeError(
            f"states: got {states!r}, expected {dim_x} names, one for each component of the state"
        )


def describe(
    result: xr.Dataset,
    ds: xr.Dataset,
    observations: Hashable,
    filter_: Filter,
    probe: FilterResult,
    states: Sequence[str] | None,
    units: str | None,
) -> xr.Dataset:
    """Add coordinates and attributes to the results of a filter on ``ds[observations]``."""
    for name, variable in result.data_vars.items():
        dims = DIMS[str(name)]
        variable.attrs = {"long_name": FIELDS[str(name)].description}
        if units is not None and dims in (_STATE, _SQUARE):
            variable.attrs["units"] = units if dims == _STATE else f"({units})^2"
    if "node" in result.dims and probe.nodes is not None and np.isfinite(probe.nodes).all():
        if probe.nodes.ndim == 1:
            result = result.assign_coords(node=("node", probe.nodes, {"long_name": "value of the switch"}))
        else:
            about = {"long_name": FIELDS["nodes"].description}
            result = result.assign_coords(class_weights_of_node=(("node", "class"), probe.nodes, about))
    if states is not None:
        result = result.assign_coords({d: list(states) for d in _SQUARE if d in result.dims})
    kept = {key: value for key, value in ds.attrs.items() if key != MARK}  # what it says is of the old store
    result.attrs = {**kept, **_provenance(filter_, observations)}
    return result.drop_encoding()  # chunks and filters of the old store, which need not fit the new one


def _provenance(filter_: Filter, observations: Hashable) -> dict[str, str]:
    """Say how the results were made: text only, which any store can hold."""
    from fuzzykf import __version__
    from fuzzykf.io import Document, as_document

    options: dict[str, Any] = getattr(filter_, "_options", dict)()
    listed = ", ".join(f"{key}={value!r}" for key, value in options.items())
    about = {
        "fuzzykf_version": __version__,
        "fuzzykf_filter": f"{type(filter_).__name__}({listed})",
        "fuzzykf_observations": str(observations),
    }
    model = getattr(filter_, "model", None)
    if isinstance(model, Document):
        try:
            document = as_document(type(model).__name__, model.to_dict())
        except ParameterError:  # a law given by functions cannot be written down
            return about
        about["fuzzykf_model"] = json.dumps(document, allow_nan=False)
    return about

"""The function that users call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from fuzzykf.base import check_keep
from fuzzykf.distributed.blocks import apply, in_blocks
from fuzzykf.distributed.inputs import (
    check_components,
    find_filter,
    find_input,
    find_observations,
    match_components,
    probe,
)
from fuzzykf.distributed.outputs import DIMS, check_names, describe
from fuzzykf.distributed.stores import check_chunks, check_store, refuse_cut_short, write
from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.gaussian import as_flag

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence

    import xarray as xr

    from fuzzykf.base import Filter
    from fuzzykf.switching import CGOFMSModel, CGOMSModel

__all__ = ["filter_dataset"]


def filter_dataset(
    ds: xr.Dataset,
    model: CGOFMSModel | CGOMSModel | Filter | Callable[[], Filter],
    observations: Hashable | None = None,
    *,
    dim: Hashable = "time",
    component: Hashable | None = None,
    inputs: Mapping[str, Hashable] | None = None,
    keep: Iterable[str] | None = None,
    n_nodes: int | None = None,
    rule: str | None = None,
    states: Sequence[str] | None = None,
    units: str | None = None,
    store: Any = None,
    mode: str = "w-",
    encoding: Mapping[str, Mapping[str, Any]] | None = None,
    missing_chunks: Literal["raise", "fill"] = "raise",
    resume: bool = False,
) -> xr.Dataset:
    """Filter all series of a Dataset with Dask, block by block.

    All dimensions except ``dim`` and ``component`` index series.  Series may be chunked, time may not,
    because a filter runs through whole series.  The result is lazy; it is computed on the current Dask
    scheduler, a ``dask.distributed.Client`` or threads.  Blocks of lost workers are computed again.

    Parameters
    ----------
    ds : xarray.Dataset
        The series.  If they are not chunked, they are split into blocks of 128 MiB including results.
    model : CGOFMSModel, CGOMSModel, Filter or callable
        A model (filtered by `OFSRFilter` or `CGOMSMFilter`), any object with ``filter_many``, or a function
        without arguments that returns such an object.  The function is called once per block on the worker,
        for filters that cannot be pickled.  Each series starts from the initial law of a switching filter, or
        from x and P of another.
    observations : hashable, optional
        Name of the variable to filter, with NaN (or None, NA) where missing; may be omitted if there is only
        one besides those of ``inputs``.
    dim : hashable
        Dimension of time.
    component : hashable, optional
        Dimension of the components of an observation, if there are several.  They are matched by name if the
        dimension has a coordinate and the model has labels.
    inputs : mapping, optional
        Time-dependent arguments of ``filter_many``, and the variables that hold them: ``{"r": "valve"}`` for
        `KnownSwitchFilter`, ``{"us": "heating"}`` for `KalmanFilter`.  They have the dimension ``dim``, and
        those of the series if they differ between series; other dimensions are last.
    keep : iterable of str, optional
        Fields to compute, as in ``filter_many``; by default ``x``, ``P`` and, from a
        probabilistic filter, ``log_likelihood``.
    n_nodes : int, optional
        Number of nodes of `OFSRFilter`, by default 5; for a `CGOFMSModel` only.
    rule : str, optional
        Quadrature rule of `OFSRFilter`, by default "cell"; for a `CGOFMSModel` only.
    states : sequence of str, optional
        Names of the components of the state, for the coordinate of ``state``.
    units : str, optional
        Unit of the state, for attributes.
    store : path, zarr store or mapping, optional
        Where to write the result, as in ``xarray.Dataset.to_zarr``.  Each worker writes its blocks, and the
        function returns when all are written.
    mode : {"w-", "w", "r+"}
        Create a new store, overwrite an existing one, or continue an interrupted one: called with the same
        arguments, only missing blocks are computed.
    encoding : mapping, optional
        Encoding of each field, as in ``xarray.Dataset.to_zarr``: ``{"x": {"dtype": "float32"}}`` halves the
        size of ``x``.  Chunks have checksums, unless ``compressors`` are given.
    missing_chunks : {"raise", "fill"}
        Whether chunks of ``ds`` missing in its Zarr store are an error or mean fill values.
    resume : bool
        Start every series from the current state, as in ``filter_many``.

    Returns
    -------
    xarray.Dataset
        One variable per field, with dimensions (series..., ``dim``, ...): ``state`` for ``x``, ``state`` and
        ``state_column`` for ``P``, ``node`` for ``mu`` (its coordinate holds the values of the switch) and
        ``class`` for ``class_weights``.  For a fuzzy switch between more than two classes, ``switch`` also
        has the dimension ``class``, and ``class_weights_of_node`` holds the values.  Coordinates are kept.
        Attributes are those of ``ds``, the filter, its model (as from `CGOFMSModel.save`) and the version.
        Lazy; with ``store``, opened from there.

    Raises
    ------
    MissingDependencyError
        If dask or xarray is not installed, or zarr where there is a ``store``.
    ParameterError, ShapeError
        If an argument does not match ``ds`` or the filter, or time is chunked; if the variable is a state of
        the model, or the time step is not that of its training data; if ``ds`` comes from an incomplete
        store; with ``mode="r+"``, if ``store`` has other contents.
    FileExistsError
        If ``mode`` is "w-" and the store exists.

    See Also
    --------
    fuzzykf.Filter.filter_many : The same for arrays.

    Notes
    -----
    With the compiled engine, results are exactly those of ``filter_many`` on all series at once, for any
    blocks.  With NumPy, or on processors with different vector instructions, they agree up to rounding.

    The attribute ``fuzzykf_complete`` of a store is "no" until all of it is written, then "yes".

    An error on a worker is raised here, with a note that names the block.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from fuzzykf import KalmanFilter
    >>> from fuzzykf.distributed import filter_dataset
    >>> readings = np.random.default_rng(0).normal(size=(100, 24))
    >>> ds = xr.Dataset({"load": (("meter", "time"), readings)}).chunk(meter=25)
    >>> result = filter_dataset(ds, KalmanFilter(1, 1, H=[[1.0]]), keep=["x", "P"])
    >>> result.x.dims, result.chunksizes["meter"]
    (('meter', 'time', 'state'), (25, 25, 25, 25))
    >>> result.x.isel(meter=7, time=-1).compute().shape
    (1,)
    """
    xr = _xarray()
    if not isinstance(ds, xr.Dataset):
        raise ParameterError(f"ds: got {type(ds).__name__}, expected an xarray.Dataset")
    if missing_chunks not in ("raise", "fill"):
        raise ParameterError(f"missing_chunks: got {missing_chunks!r}, expected 'raise' or 'fill'")
    refuse_cut_short(ds)
    names = dict(inputs or {})
    series = find_observations(ds, observations, dim, component, set(names.values()))
    make, is_factory, filter_ = find_filter(model, n_nodes, rule)
    series = match_components(series, dim, component, filter_)
    check_components(series, component, filter_.dim_z)
    others = {key: find_input(ds, key, name, series, dim, component) for key, name in names.items()}
    if missing_chunks == "raise":
        check_chunks(ds, [series.name, *names.values()])
    wanted = None if keep is None else check_keep(keep, tuple(DIMS))
    found = probe(filter_, wanted, others, dim)
    shapes = {name: getattr(found, name).shape[2:] for name in DIMS if getattr(found, name) is not None}
    for name in wanted or ():
        if name not in shapes:
            raise ParameterError(
                f"keep: got {name!r}, which {type(filter_).__name__} does not find for this model, expected "
                f"names among {', '.join(shapes) or 'those that it finds'}"
            )
    if not shapes:
        raise ParameterError("keep: got no name, expected at least one field")
    check_names(series, shapes, states, filter_.dim_x)
    core = (dim,) if component is None else (dim, component)
    series = in_blocks(series, core, filter_.dim_z, shapes)
    loops = tuple(d for d in series.dims if d not in core)
    if store is not None:
        check_store(ds, series, loops, store, mode)
    result = apply(make, is_factory, series, others, core, shapes, as_flag("resume", resume))
    result = describe(result, ds, series.name, filter_, found, states, units)
    if store is None:
        return result
    write(result, loops, store, mode, encoding or {})
    return xr.open_zarr(store, consolidated=False)


def _xarray() -> Any:
    try:
        import dask.array  # noqa: F401
        import xarray
    except ImportError as error:
        raise MissingDependencyError(
            "filter_dataset needs dask and xarray: pip install 'fuzzykf[dask]'"
        ) from error
    return xarray

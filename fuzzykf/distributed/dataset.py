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
    """Filter all series of a Dataset, block by block, on the Dask scheduler that is in use.

    All dimensions but ``dim`` and ``component`` count series, whatever they are called and however
    many they are.  The series may be chunked, time may not: a filter runs through the whole of a
    series.  Nothing is computed before the result is asked for or written; then it is on whatever
    scheduler Dask uses, `dask.distributed.Client` or threads.  A block that is lost with its worker
    is computed again.

    Parameters
    ----------
    ds : xarray.Dataset
        Series that are not chunked are cut into blocks that take 128 MiB with their results.
    model : CGOFMSModel, CGOMSModel, Filter or callable
        A model is filtered with `OFSRFilter` or `CGOMSMFilter`; any object with ``filter_many``
        will do, and each series starts where its ``filter_many`` starts: from the initial law of a
        switching filter, from x and P of another.  A callable without
        arguments returns such an object; it is called once for each block, on the worker, for
        filters that cannot be pickled.
    observations : hashable, optional
        Name of the variable to filter, NaN where missing (None or NA in one of objects); may be omitted
        if there is but one beside those of ``inputs``.
    dim : hashable
        The dimension of time.
    component : hashable, optional
        The dimension of the components of an observation, if there are several.  If it has a coordinate, and
        the model knows what it was learned on, they are taken by these names.
    inputs : mapping, optional
        Other arguments of ``filter_many`` that have a value at each time, and the variables that
        hold them: ``{"r": "valve"}`` for `KnownSwitchFilter`, ``{"us": "heating"}`` for
        `KalmanFilter`.  They have the dimension ``dim``, and those of the series where they differ
        between series; further dimensions come last.
    keep : iterable of str, optional
        The fields to compute, as in ``filter_many``; by default ``x``, ``P`` and, from a
        probabilistic filter, ``log_likelihood``.
    n_nodes : int, optional
        Nodes of `OFSRFilter`, by default 5; for a `CGOFMSModel` only.
    rule : str, optional
        Quadrature of `OFSRFilter`, by default "cell"; for a `CGOFMSModel` only.
    states : sequence of str, optional
        Names of the components of the state, the coordinate of the dimension ``state``.
    units : str, optional
        Unit of the state, for the attributes of what is measured in it.
    store : path, zarr store or mapping, optional
        Where to write the result, as `xarray.Dataset.to_zarr` takes it.  The function then
        returns when all is written, each block by the worker that computed it.
    mode : {"w-", "w", "r+"}
        Whether to write to a new store only, over whatever is there, or to go on in a store that
        was cut short: with the arguments of the call that began it, only blocks that are not
        there are computed.
    encoding : mapping, optional
        How to store each field, as in `xarray.Dataset.to_zarr`:
        ``{"x": {"dtype": "float32"}}`` halves what ``x`` takes.  Unless a field has ``compressors`` of
        its own, its chunks have a checksum, by which damage is found when they are read.
    missing_chunks : {"raise", "fill"}
        Whether a chunk of ``ds`` that is not in its Zarr store is an error, or stands for fill values.
    resume : bool
        Let every series go on from where the filter stands, as in ``filter_many``.

    Returns
    -------
    xarray.Dataset
        One variable for each field, of dimensions (series..., ``dim``, ...): ``state`` for ``x``,
        ``state`` and ``state_column`` for ``P``, ``node`` for ``mu``, whose coordinate holds the
        values of the switch, ``class`` for ``class_weights``.  Of a fuzzy switch between more than two
        classes ``switch`` has the dimension ``class``, too, and ``class_weights_of_node`` holds the values.
        Coordinates of the observations are kept.  Attributes are those of ``ds``, and the filter, its model
        (as `CGOFMSModel.save` writes it) and the version.  Lazy; with ``store``, opened from there.

    Raises
    ------
    MissingDependencyError
        If dask or xarray is not installed, or zarr where there is a ``store``.
    ParameterError, ShapeError
        If an argument does not fit ``ds`` or the filter, or time is chunked; if the variable is a state of
        the model, or times are not as far apart as those that it was learned on; if ``ds`` comes from
        a store that was cut short or lacks chunks, or, with ``mode="r+"``, something else is in ``store``.
    FileExistsError
        If ``mode`` is "w-" and the store exists.

    See Also
    --------
    fuzzykf.Filter.filter_many : The same on an array.

    Notes
    -----
    With the compiled engine results are those of ``filter_many`` on all series at once, to the
    bit, however they are cut into blocks.  With NumPy, or between processors that have different
    vector instructions, they agree to rounding.

    The attribute ``fuzzykf_complete`` of a store is "no" until all of it is written, then "yes".

    An error on a worker is raised here as it is; its note says which block it came from.

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

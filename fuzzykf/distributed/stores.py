"""Zarr stores: whole or known not to be, finished where they were cut short, checked where they are read.

A store says in an attribute, `MARK`, whether all of its blocks are written; that they are is
written last.  Each chunk is written at once or not at all, so a block is done if its chunks are there.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import MissingDependencyError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping

    import xarray as xr

__all__ = ["MARK", "check_chunks", "check_store", "refuse_cut_short", "write"]

#: Attribute of a store; "no" until all is written, then "yes".
MARK = "fuzzykf_complete"

_MODES = "'w-', 'w' or 'r+'"


def check_store(
    ds: xr.Dataset, series: xr.DataArray, loops: tuple[Hashable, ...], store: Any, mode: str
) -> None:
    """Refuse, before any work is done, what cannot be written."""
    try:
        import zarr  # noqa: F401
    except ImportError as error:
        raise MissingDependencyError("store needs zarr: pip install 'fuzzykf[dask]'") from error
    if mode not in ("w-", "w", "r+"):
        raise ParameterError(f"mode: got {mode!r}, expected {_MODES}")
    if str(store) in {str(one.encoding.get("source")) for one in (ds, series)}:
        raise ParameterError(f"store: {store} is also read from; name another one")
    for d in loops:
        sizes = series.chunksizes[d]
        if len(set(sizes[:-1])) > 1 or sizes[-1] > sizes[0]:
            raise ParameterError(
                f"ds: the chunks along {d!r} have sizes from {min(sizes)} to {max(sizes)}, but a store needs "
                f"chunks of one size, the last one excepted: ds.chunk({{{d!r}: {max(sizes)}}})"
            )


# --------------------------------------------------------------------------- what is read


def refuse_cut_short(ds: xr.Dataset) -> None:
    """Refuse results that were not written to their end."""
    if ds.attrs.get(MARK) == "no":
        place = ds.encoding.get("source", "the store it comes from")
        raise ParameterError(
            f"ds: {place} was cut short, and what is missing reads as NaN; finish it first, by the call that "
            "began it, with mode='r+'"
        )


def check_chunks(ds: xr.Dataset, names: Iterable[Hashable]) -> None:
    """Refuse variables that lack a chunk in the store that they come from.

    Raises
    ------
    ParameterError
        Zarr would take the chunk for one that holds nothing but fill values.
    """
    source = ds.encoding.get("source")
    from_store = [name for name in names if "chunks" in ds[name].encoding]
    if source is None or not from_store:
        return
    try:
        import zarr

        group = zarr.open_group(str(source), mode="r")
    except (ImportError, OSError, ValueError, KeyError):  # no store of Zarr: a netCDF file also has chunks
        return
    for name in from_store:
        array = group.get(str(name))
        if not isinstance(array, zarr.Array):  # renamed since
            continue
        there, all_keys = _keys(array), [_key(array, at) for at in np.ndindex(*_grid(array))]
        missing = [key for key in all_keys if key not in there]
        if missing:
            raise ParameterError(
                f"ds: of {name!r}, {len(missing):,} of {len(all_keys):,} chunks are missing in {source}, the "
                f"first of them {missing[0]}; they would read as fill values. Zarr leaves out chunks of fill "
                "values alone unless told otherwise: if that is why, say missing_chunks='fill'"
            )


def _keys(array: Any) -> set[str]:
    """Return what is stored of an array, chunks and all."""
    from zarr.core.sync import sync

    place = array.store_path.path
    prefix = f"{place}/" if place else ""

    async def listed() -> set[str]:
        return {key.removeprefix(prefix) async for key in array.store_path.store.list_prefix(prefix)}

    found: set[str] = sync(listed())
    return found


def _stored_chunks(array: Any) -> tuple[int, ...]:
    """Size of what is stored at once: a chunk, or a shard of them."""
    sizes: tuple[int, ...] = getattr(array, "shards", None) or array.chunks
    return sizes


def _grid(array: Any) -> tuple[int, ...]:
    return tuple(-(-n // size) for n, size in zip(array.shape, _stored_chunks(array), strict=True))


def _key(array: Any, at: tuple[int, ...]) -> str:
    key: str = array.metadata.encode_chunk_key(at)
    return key


# --------------------------------------------------------------------------- what is written


def write(
    result: xr.Dataset,
    loops: tuple[Hashable, ...],
    store: Any,
    mode: str,
    encoding: Mapping[str, Mapping[str, Any]],
) -> None:
    """Write results, each block by the worker that computes it; say that they are whole when they are.

    Parameters
    ----------
    result : xarray.Dataset
        Lazy.
    loops : tuple of hashable
        The dimensions that count series, in which it is cut into blocks.
    store, mode, encoding
        As in `filter_dataset`.
    """
    import zarr

    result = result.assign_attrs({MARK: "no"})
    # consolidated metadata are no part of Zarr's format 3, and not worth it for a few variables; a
    # chunk is written even if it holds nothing, so that one that is not there is known to be missing
    options: dict[str, Any] = {"consolidated": False, "write_empty_chunks": True}
    group = _begun(result, store) if mode == "r+" else None
    if group is None:
        all_encoding = {name: _checksum() | dict(encoding.get(str(name), {})) for name in result.data_vars}
        all_encoding |= {name: dict(value) for name, value in encoding.items() if name not in all_encoding}
        result.to_zarr(store, mode="w" if mode == "r+" else mode, encoding=all_encoding, **options)
    elif group.attrs[MARK] != "yes":
        _go_on(result, loops, group, store, options)
    zarr.open_group(store, mode="r+").attrs[MARK] = "yes"


def _checksum() -> dict[str, Any]:
    """Return how a field is compressed: Zarr's own way, and a sum by which damage is found."""
    import zarr

    if zarr.config.get("default_zarr_format", 3) != 3:
        return {}
    return {"compressors": (zarr.codecs.ZstdCodec(level=0, checksum=True),)}


def _begun(result: xr.Dataset, store: Any) -> Any:
    """Return the group of a store that these results were begun in; None if it has not come that far.

    Raises
    ------
    ParameterError
        If something else is there.
    """
    import zarr

    try:
        group = zarr.open_group(store, mode="r+")
    except FileNotFoundError:
        return None
    there = dict(group.attrs)
    if not there and not any(True for _ in group.arrays()):
        return None
    told, wanted = _comparable(there), _comparable(result.attrs)
    if MARK not in there or told != wanted:
        differing = sorted(key for key in {*told, *wanted} if told.get(key) != wanted.get(key))
        what = f"differs in {', '.join(differing)}" if MARK in there else "was not written by filter_dataset"
        raise ParameterError(f"store: {store} {what}, so that these results cannot go on in it")
    arrays = dict(group.arrays())
    for name, variable in result.data_vars.items():
        array = arrays.get(str(name))
        if array is None:
            return None  # cut short before there was a place for each field
        if array.shape != variable.shape:
            raise ParameterError(
                f"store: {name!r} has the shape {array.shape} in {store}, here {variable.shape}"
            )
    return group if all(str(name) in arrays for name in result.variables) else None


def _comparable(attrs: Mapping[str, Any]) -> dict[str, str]:
    """Return attributes as they compare after a journey through a store."""
    return {str(key): repr(np.asarray(value).tolist()) for key, value in attrs.items() if key != MARK}


def _go_on(
    result: xr.Dataset, loops: tuple[Hashable, ...], group: Any, store: Any, options: dict[str, Any]
) -> None:
    """Compute the blocks that are not in a store, and write them."""
    import dask

    fields = {str(name): group[str(name)] for name in result.data_vars}
    there = {name: _keys(array) for name, array in fields.items()}
    _remove_parts(fields, there)
    coordinates = result.drop_vars(list(result.data_vars))
    if coordinates.variables:  # small, and written first, but perhaps not all
        coordinates.to_zarr(store, mode="r+", **options)
    writes = []
    for region in _regions(result, loops):
        if all(_holds(array, there[name], result[name].dims, region) for name, array in fields.items()):
            continue
        part = result[list(fields)].isel(region).drop_vars(list(result.coords))
        writes.append(part.to_zarr(store, region=region, mode="r+", compute=False, **options))
    dask.compute(*writes)


def _regions(result: xr.Dataset, loops: tuple[Hashable, ...]) -> Iterator[dict[Hashable, slice]]:
    """Yield where each block lies."""
    cuts = []
    for d in loops:
        stops = np.cumsum(result.chunksizes[d]).tolist()
        cuts.append([slice(start, stop) for start, stop in zip([0, *stops], stops, strict=False)])
    for block in product(*cuts):
        yield dict(zip(loops, block, strict=True))


def _holds(array: Any, there: set[str], dims: tuple[Hashable, ...], region: dict[Hashable, slice]) -> bool:
    """Whether all chunks of a region are stored."""
    ranges = []
    for d, n, size in zip(dims, array.shape, _stored_chunks(array), strict=True):
        part = region.get(d, slice(0, n))
        ranges.append(range(part.start // size, -(-part.stop // size)))
    return all(_key(array, at) in there for at in product(*ranges))


def _remove_parts(fields: Mapping[str, Any], there: Mapping[str, set[str]]) -> None:
    """Remove the files that writers who were killed have begun."""
    from zarr.core.sync import sync

    for name, array in fields.items():
        store, place = array.store_path.store, array.store_path.path
        for key in there[name]:
            if key.endswith(".partial"):
                sync(store.delete(f"{place}/{key}"))

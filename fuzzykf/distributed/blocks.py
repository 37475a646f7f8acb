"""The blocks of series that travel to the workers."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fuzzykf.distributed.outputs import dims_of

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence

    import xarray as xr

    from fuzzykf.arrays import FloatArray

__all__ = ["BLOCK_BYTES", "Block", "apply", "in_blocks"]

#: Bytes that observations and results of a block may take where this module cuts the blocks.
BLOCK_BYTES = 1 << 27


@dataclass(frozen=True)
class Block:
    """The filter of one block, as it travels to a worker.

    Attributes
    ----------
    make : Filter or callable
        The filter, or what makes it on the worker.
    is_factory : bool
        Which of these it is.
    names : tuple of str
        The fields to compute.
    core : int
        Number of dimensions of the observations that do not count series: time, components.
    inputs : dict of str to int
        The other arguments of ``filter_many``, and how many such dimensions each has.
    loops : tuple of hashable
        The dimensions that count series.
    resume : bool
        Whether every series goes on from where the filter stands.
    """

    __name__: ClassVar[str] = "filter_many"  # what dask calls its tasks

    make: Any
    is_factory: bool
    names: tuple[str, ...]
    core: int
    inputs: dict[str, int]
    loops: tuple[Hashable, ...]
    resume: bool = False

    def __call__(self, zs: FloatArray, *arrays: FloatArray) -> FloatArray | tuple[FloatArray, ...]:
        """Filter observations (series..., n[, q]).

        Parameters
        ----------
        zs : ndarray
        *arrays : ndarray
            The other inputs, and for each dimension of the series where the block lies in it.
        """
        lead = zs.shape[: zs.ndim - self.core]
        values, positions = arrays[: len(self.inputs)], arrays[len(self.inputs) :]
        others: dict[str, Any] = {
            key: _flat(value, lead, core)
            for (key, core), value in zip(self.inputs.items(), values, strict=True)
        }
        if self.resume:  # filters of yesterday do not know the argument
            others["resume"] = True
        filter_ = self.make() if self.is_factory else self.make
        try:
            found = filter_.filter_many(_flat(zs, lead, self.core), keep=self.names, **others)
        except Exception as error:
            error.add_note(
                f"fuzzykf: series are counted from the beginning of {self._place(lead, positions)}"
            )
            raise
        results = [getattr(found, name) for name in self.names]
        fields = tuple(result.reshape(*lead, *result.shape[1:]) for result in results)
        return fields[0] if len(fields) == 1 else fields

    def _place(self, lead: tuple[int, ...], positions: Sequence[FloatArray]) -> str:
        begins = [int(position.flat[0]) for position in positions]
        slices = zip(self.loops, begins, lead, strict=True)
        return f"ds.isel({', '.join(f'{d}=slice({begin}, {begin + size})' for d, begin, size in slices)})"


def _flat(value: FloatArray, lead: tuple[int, ...], core: int) -> FloatArray:
    """Return (series, ...) of (series..., ...); dimensions of the series that are missing are added."""
    last = value.shape[value.ndim - core :]
    return np.broadcast_to(value, (*lead, *last)).reshape(prod(lead), *last)


def in_blocks(
    series: xr.DataArray, core: tuple[Hashable, ...], dim_z: int, shapes: Mapping[str, tuple[int, ...]]
) -> xr.DataArray:
    """Cut series that are not chunked so that a block with its results fits `BLOCK_BYTES`."""
    if series.chunks is not None:
        return series
    from dask.array.core import normalize_chunks

    numbers = dim_z + sum(prod(shape) for shape in shapes.values())
    wanted = tuple(-1 if d in core else "auto" for d in series.dims)
    limit = max(1, BLOCK_BYTES * dim_z // numbers)
    chunks = normalize_chunks(wanted, series.shape, limit=limit, dtype=np.dtype(np.float64))
    return series.chunk(dict(zip(series.dims, chunks, strict=True)))


def apply(
    make: Any,
    is_factory: bool,
    series: xr.DataArray,
    others: Mapping[str, xr.DataArray],
    core: tuple[Hashable, ...],
    shapes: Mapping[str, tuple[int, ...]],
    resume: bool = False,
) -> xr.Dataset:
    """Set up the work on all blocks; nothing is computed.

    Parameters
    ----------
    make, is_factory
        As in `Block`.
    series : xarray.DataArray
        The observations, chunked; time and components last.
    others : mapping of str to xarray.DataArray
        The other inputs; time and dimensions of their own last.
    core : tuple of hashable
        The dimensions of time and, if there is one, of the components.
    shapes : mapping of str to tuple of int
        The fields to compute, and the shape of each at one step.
    resume : bool
        As in `Block`.

    Returns
    -------
    xarray.Dataset
    """
    import dask.array as da
    import xarray as xr

    loops, chunks = tuple(d for d in series.dims if d not in core), series.chunksizes
    inputs = [
        value.chunk({d: chunks[d] if d in loops else -1 for d in value.dims}).transpose(
            *loops, ..., missing_dims="ignore"
        )
        for value in others.values()
    ]
    own = [[d for d in value.dims if d not in loops] for value in inputs]
    block = Block(
        make,
        is_factory,
        tuple(shapes),
        len(core),
        {key: len(dims) for key, dims in zip(others, own, strict=True)},
        loops,
        resume,
    )
    positions = [xr.DataArray(da.arange(series.sizes[d], chunks=(chunks[d],)), dims=d) for d in loops]
    dims = {name: dims_of(name, shape) for name, shape in shapes.items()}
    sizes = {d: n for name, shape in shapes.items() for d, n in zip(dims[name], shape, strict=True)}
    fields = xr.apply_ufunc(
        block,
        series,
        *inputs,
        *positions,
        input_core_dims=[list(core), *own, *([] for _ in positions)],
        output_core_dims=[[core[0], *dims[name]] for name in shapes],
        dask="parallelized",
        output_dtypes=[np.float64] * len(shapes),
        dask_gufunc_kwargs={"output_sizes": sizes},
        keep_attrs=True,
    )
    return xr.Dataset(dict(zip(shapes, (fields,) if len(shapes) == 1 else fields, strict=True)))

"""Many series on many machines: a filter over an xarray Dataset, in blocks of series, on Dask.

The work is cut by series.  A block holds some series over their whole time, goes to
`Filter.filter_many`, and its results are passed on or written before the next blocks come, so that
a worker holds a few blocks at a time however large the whole is.
"""

from __future__ import annotations

from fuzzykf.distributed.dataset import filter_dataset

__all__ = ["filter_dataset"]

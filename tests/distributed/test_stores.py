"""A store is whole or says that it is not; what is missing is found, and made good."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from fuzzykf import KalmanFilter
from fuzzykf.distributed import filter_dataset
from fuzzykf.errors import ParameterError

dask = pytest.importorskip("dask", reason="the extra [dask] is not installed")
xr = pytest.importorskip("xarray", reason="the extra [dask] is not installed")
zarr = pytest.importorskip("zarr", reason="the extra [dask] is not installed")

N_SERIES, N_BLOCKS = 23, 8  # three to a block, the last one has two


class Counting:
    """A filter that remembers what it was given, and may break down."""

    dim_x, dim_z = 1, 1

    def __init__(self, die_after=None):
        self.f, self.seen, self.die_after = KalmanFilter(1, 1, H=[[1.0]]), [], die_after

    def filter_many(self, zs, keep=("x", "P")):
        if zs.shape[1] > 1:
            if self.die_after is not None and len(self.seen) >= self.die_after:
                raise KeyboardInterrupt
            self.seen.append(len(zs))
        return self.f.filter_many(zs, keep=keep)

    def __dask_tokenize__(self):
        return "counting"


@pytest.fixture(autouse=True)
def one_thread():
    with dask.config.set(scheduler="synchronous"):
        yield


@pytest.fixture
def ds():
    readings = np.random.default_rng(0).normal(size=(N_SERIES, 5))
    times = np.arange(5).astype("datetime64[h]").astype("datetime64[ns]")
    made = xr.Dataset(
        {"load": (("meter", "time"), readings)},
        coords={"time": times, "meter": 100 + np.arange(N_SERIES)},
        attrs={"title": "a street", "scale": np.float64(2.0), "bounds": (1, 2)},
    )
    return made.chunk(meter=3)


def run(ds, filter_, store, **options):
    return filter_dataset(ds, filter_, keep=["x", "P"], store=store, **options)


def cut_short(ds, store, after):
    with pytest.raises(KeyboardInterrupt):
        run(ds, Counting(after), store)


def test_a_whole_store_says_so(ds, tmp_path):
    result = run(ds, Counting(), tmp_path / "out.zarr")
    assert result.attrs["fuzzykf_complete"] == "yes"
    again = filter_dataset(result[["x"]].isel(state=0), KalmanFilter(1, 1, H=[[1.0]]))  # may be read from
    assert "fuzzykf_complete" not in again.attrs


def test_a_store_that_was_cut_short_is_refused_and_finished(ds, tmp_path):
    whole = run(ds, Counting(), tmp_path / "whole.zarr").load()
    store = tmp_path / "out.zarr"
    cut_short(ds, store, 5)
    opened = xr.open_zarr(store, consolidated=False)
    assert opened.attrs["fuzzykf_complete"] == "no"
    with pytest.raises(ParameterError, match=r"out\.zarr was cut short.*mode='r\+'"):
        filter_dataset(opened[["x"]].isel(state=0), Counting())
    with pytest.raises(FileExistsError):
        run(ds, Counting(), store)
    rest = Counting()
    result = run(ds, rest, store, mode="r+")
    assert len(rest.seen) == N_BLOCKS - 5
    xr.testing.assert_identical(result.load(), whole)
    nothing = Counting()
    run(ds, nothing, store, mode="r+")
    assert nothing.seen == []


def test_a_store_is_begun_where_there_is_none(ds, tmp_path):
    all_ = Counting()
    assert run(ds, all_, tmp_path / "out.zarr", mode="r+").attrs["fuzzykf_complete"] == "yes"
    assert len(all_.seen) == N_BLOCKS


def test_blocks_of_several_dimensions_are_finished(tmp_path):
    readings = np.random.default_rng(0).normal(size=(4, 5, 6))
    ds = xr.Dataset({"load": (("a", "time", "b"), readings)}).chunk(a=2, b=4)
    whole = run(ds, Counting(), tmp_path / "whole.zarr").load()
    cut_short(ds, tmp_path / "out.zarr", 3)
    rest = Counting()
    xr.testing.assert_identical(run(ds, rest, tmp_path / "out.zarr", mode="r+").load(), whole)
    assert len(rest.seen) == 1


def test_a_writer_that_was_killed_leaves_nothing_behind(ds, tmp_path):
    ds.to_zarr(tmp_path / "in.zarr", consolidated=False)
    code = """
import os, signal, sys
import dask, xarray as xr
from fuzzykf import KalmanFilter
from fuzzykf.distributed import filter_dataset
from zarr.storage import _local

real, done = _local._put, []
def put(path, value, exclusive=False):
    if "/c/" in str(path) and not exclusive:
        done.append(path)
        if len(done) == 9:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(".0123.partial").write_bytes(b"half")
            os.kill(os.getpid(), signal.SIGKILL)
    return real(path, value, exclusive)
_local._put = put
ds = xr.open_zarr(sys.argv[1], consolidated=False)
with dask.config.set(scheduler="synchronous"):
    filter_dataset(ds, KalmanFilter(1, 1, H=[[1.0]]), keep=["x", "P"], store=sys.argv[2])
"""
    store = tmp_path / "out.zarr"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "in.zarr"), str(store)], check=False, capture_output=True
    )
    assert done.returncode == -9, done.stderr
    assert list(store.rglob("*.partial"))
    read = xr.open_zarr(tmp_path / "in.zarr", consolidated=False)
    result = run(read, KalmanFilter(1, 1, H=[[1.0]]), store, mode="r+")
    assert not list(store.rglob("*.partial"))
    expected = KalmanFilter(1, 1, H=[[1.0]]).filter_many(ds["load"].values)
    np.testing.assert_array_equal(result.x.values, expected.x)
    np.testing.assert_array_equal(result.time.values, ds.time.values)
    np.testing.assert_array_equal(result.meter.values, ds.meter.values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda ds: ds.assign_attrs(title="another street"), "differs in title, so that"),
        (lambda ds: ds.rename(load="power"), "differs in fuzzykf_observations"),
        (lambda ds: ds.isel(time=slice(4)), r"'x' has the shape \(23, 5, 1\)"),
    ],
)
def test_other_results_do_not_go_on_in_a_store(ds, tmp_path, change, message):
    cut_short(ds, tmp_path / "out.zarr", 5)
    with pytest.raises(ParameterError, match=message):
        run(change(ds), Counting(), tmp_path / "out.zarr", mode="r+")


def test_a_store_of_somebody_else_is_left_alone(ds, tmp_path):
    ds.to_zarr(tmp_path / "other.zarr", consolidated=False)
    with pytest.raises(ParameterError, match=r"other\.zarr was not written by filter_dataset"):
        run(ds, Counting(), tmp_path / "other.zarr", mode="r+")


def test_a_chunk_that_is_missing_is_an_error_unless_it_is_said_to_be_fill(ds, tmp_path):
    path = tmp_path / "in.zarr"
    ds.to_zarr(path, consolidated=False)
    (path / "load" / "c" / "4" / "0").unlink()
    read = xr.open_zarr(path, consolidated=False)
    message = r"of 'load', 1 of 8 chunks are missing in .*in\.zarr, the first of them c/4/0.*missing_chunks"
    for lacking in (read, read.isel(meter=slice(6, 18))):
        with pytest.raises(ParameterError, match=message):
            filter_dataset(lacking, Counting())
    result = filter_dataset(read, Counting(), missing_chunks="fill").compute()
    assert np.isfinite(result.x).all()
    with pytest.raises(ParameterError, match="missing_chunks: got 'skip', expected 'raise' or 'fill'"):
        filter_dataset(read, Counting(), missing_chunks="skip")


def test_results_that_are_all_missing_are_written(ds, tmp_path):
    class Nothing(Counting):
        def filter_many(self, zs, keep=("x", "P")):
            found = super().filter_many(zs, keep)
            found.x[:] = np.nan
            return found

    result = run(ds, Nothing(), tmp_path / "out.zarr")
    assert len(list((tmp_path / "out.zarr" / "x").glob("c/*/0/0"))) == N_BLOCKS
    filter_dataset(result[["x"]].isel(state=0), Counting())  # no chunk is missing


@pytest.mark.parametrize("field", ["x", "P"])
def test_damage_is_found_by_checksums(ds, tmp_path, field):
    result = run(ds, Counting(), tmp_path / "out.zarr")
    (chunk,) = (tmp_path / "out.zarr" / field).glob("c/2/0/*" + ("/0" if field == "P" else ""))
    content = bytearray(chunk.read_bytes())
    damaged = xr.open_zarr(tmp_path / "out.zarr", consolidated=False)  # reads a chunk when it is asked for
    for at in sorted({*range(0, len(content), 3), len(content) - 1}):
        content[at] ^= 1
        chunk.write_bytes(content)
        try:
            values = damaged[field].values
        except Exception:
            values = None
        # the one bit that does not matter is that of the frame which says so
        assert values is None or np.array_equal(values, result[field].values)
        content[at] ^= 1
    assert values is None  # the last bytes are the sum

"""`filter_dataset` gives what `filter_many` gives, block by block, and survives the death of a worker."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FilterResult,
    FuzzyMarkovLaw,
    FuzzyRelationEstimator,
    IMMEstimator,
    IntervalMembership,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    engine,
)
from fuzzykf.distributed import filter_dataset
from fuzzykf.errors import MissingDependencyError, ParameterError, ShapeError

da = pytest.importorskip("dask.array", reason="the extra [dask] is not installed")
distributed = pytest.importorskip("distributed", reason="the extra [dask] is not installed")
xr = pytest.importorskip("xarray", reason="the extra [dask] is not installed")
dask = pytest.importorskip("dask", reason="the extra [dask] is not installed")
zarr = pytest.importorskip("zarr", reason="the extra [dask] is not installed")


def assert_same(found, expected) -> None:
    """Assert equality to the bit; NumPy's sums depend on how many series go side by side."""
    if engine.info().name == "compiled":
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def kalman_filter(dim_z=1) -> KalmanFilter:
    kf = KalmanFilter(2, dim_z, F=[[1.0, 1.0], [0.0, 1.0]], H=np.eye(2)[:dim_z])
    kf.Q = 0.01 * np.eye(2)
    return kf


def tracker() -> IMMEstimator:
    calm, lively = KalmanFilter(1, 1, H=[[1.0]], Q=0.01), KalmanFilter(1, 1, H=[[1.0]], Q=1.0)
    return IMMEstimator([calm, lively], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])


def estimator() -> FuzzyRelationEstimator:
    """A random walk of bounded steps, seen with a bounded error."""
    return FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x,
        hx=lambda x: x,
        state=IntervalMembership(-5.0, 5.0),
        process_noise=IntervalMembership(-2.0, 2.0),
        measurement_noise=IntervalMembership(-4.0, 4.0),
    )


@pytest.fixture(scope="module")
def ds():
    """Eleven series, some with gaps, in chunks of four, with what else a Dataset carries."""
    rng = np.random.default_rng(2)
    readings = rng.normal(size=(11, 30))
    readings[3, 10:14] = np.nan
    readings[7, 25:] = np.nan
    return xr.Dataset(
        {"reading": (("meter", "time"), readings, {"units": "kW"})},
        coords={
            "meter": [f"M{k:02d}" for k in range(11)],
            "time": ("time", np.datetime64("2024-01-01", "ns") + np.arange(30) * np.timedelta64(15, "m")),
            "street": ("meter", list("AABBBCCDDEE"), {"long_name": "street"}),
            "hour": ("time", np.arange(30) / 4.0),
        },
        attrs={"title": "a street"},
    ).chunk(meter=4)


# ------------------------------------------------------------------ what it computes


@pytest.mark.parametrize(
    ("make", "keep"),
    [
        (OFSRFilter, ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")),
        (lambda model: CGOMSMFilter(model.harden()), ("mu", "x")),
        (lambda _: kalman_filter(), ("x", "P", "x_prior", "P_prior", "log_likelihood")),
        (lambda _: tracker(), ("x", "P", "mu", "log_likelihood")),
        (lambda _: estimator(), ("x", "P", "possibility", "lower", "upper")),
    ],
    ids=["fuzzy", "hard", "kalman", "imm", "estimator"],
)
def test_it_gives_what_filter_many_gives_for_all_series_at_once(make, keep, ds, fuzzy_model) -> None:
    f = make(fuzzy_model)
    result = filter_dataset(ds, f, keep=keep)
    assert set(result.data_vars) == set(keep)
    assert all(dask.is_dask_collection(result[name].data) for name in keep)
    expected = f.filter_many(ds.reading.values, keep=keep)
    computed = result.compute(scheduler="threads")
    for name in keep:
        assert result[name].dims[:2] == ("meter", "time")
        assert_same(computed[name].values, getattr(expected, name))


def test_a_model_is_filtered_with_its_exact_filter(ds, fuzzy_model) -> None:
    few = filter_dataset(ds, fuzzy_model, n_nodes=2, rule="midpoint", keep=["x"])
    assert_same(few.x.values, OFSRFilter(fuzzy_model, 2, "midpoint").filter_many(ds.reading.values).x)
    hard = filter_dataset(ds, fuzzy_model.harden(), keep=["x"])
    assert_same(hard.x.values, CGOMSMFilter(fuzzy_model.harden()).filter_many(ds.reading.values).x)


def test_what_is_kept_by_default_is_what_the_filter_has(ds, fuzzy_model) -> None:
    assert set(filter_dataset(ds, fuzzy_model).data_vars) == {"x", "P", "log_likelihood"}
    assert set(filter_dataset(ds, estimator()).data_vars) == {"x", "P"}


def test_a_filter_in_the_middle_of_its_series_travels_and_stays_as_it_was(ds) -> None:
    kf = kalman_filter()
    for z in (3.0, 4.0):
        kf.step(z)
    before = kf.x.copy(), kf.P.copy()
    result = filter_dataset(ds, kf, keep=["x"]).compute(scheduler="threads")
    assert_same(result.x.values, kf.filter_many(ds.reading.values).x)
    np.testing.assert_array_equal(kf.x, before[0])
    np.testing.assert_array_equal(kf.P, before[1])


def test_a_function_makes_a_filter_for_each_block(ds) -> None:
    calls = []

    def make():
        calls.append(threading.get_ident())
        return kalman_filter()

    result = filter_dataset(ds, make, keep=["x"])
    assert len(calls) == 1  # for the shapes
    computed = result.compute(scheduler="threads")
    assert len(calls) == 1 + 3
    assert_same(computed.x.values, kalman_filter().filter_many(ds.reading.values).x)


def test_known_switches_and_controls_come_from_further_variables(ds, fuzzy_model) -> None:
    rng = np.random.default_rng(3)
    r, u = rng.uniform(size=(11, 30)), rng.normal(size=(30, 2))
    more = ds.assign(valve=(("meter", "time"), r), heating=(("time", "heater"), u))

    f = KnownSwitchFilter(fuzzy_model)
    found = filter_dataset(more[["reading", "valve"]], f, inputs={"r": "valve"}, keep=["x", "log_likelihood"])
    expected = f.filter_many(ds.reading.values, r=r)
    assert_same(found.x.values, expected.x)
    assert_same(found.log_likelihood.values, expected.log_likelihood)

    # Controls that are the same for all series, and controls that are not.
    kf = kalman_filter()
    kf.B = np.array([[0.5, 0.0], [0.1, 1.0]])
    expected = kf.filter_many(ds.reading.values, us=u)
    for variable in (more.heating, more.heating.expand_dims(meter=more.meter)):
        with_controls = more.assign(heating=variable)
        found = filter_dataset(with_controls, kf, "reading", inputs={"us": "heating"})
        assert_same(found.x.values, expected.x)


@pytest.fixture(scope="module")
def ring():
    """A fuzzy model of three classes."""
    law = FadeLaw(3, {(0, 1): (0.1, 6), (1, 2): (0.1, 5), (2, 0): (0.2, 4)})
    pair = np.kron([[1.0, 0.8], [0.8, 1.0]], [[1.0, 0.5], [0.5, 1.0]])
    return CGOFMSModel(law, np.outer([0.0, 2.0, -1.0], [1.0, 1.0]), np.broadcast_to(pair, (3, 3, 4, 4)), 1)


@pytest.mark.parametrize("keep", [("class_weights", "switch"), ("mu", "x"), ("switch",)])
def test_switches_between_several_classes_are_weights(keep, ds, ring, tmp_path) -> None:
    readings = ds[["reading"]].drop_vars(list(ds.coords))
    found = filter_dataset(readings, ring, "reading", n_nodes=3, keep=keep)
    expected = OFSRFilter(ring, 3).filter_many(ds.reading.values, keep=keep)
    assert found.sizes.get("class", 3) == 3
    for name in keep:
        assert_same(found[name].values, getattr(expected, name))
    for name in {"class_weights", "switch"} & set(keep):
        assert found[name].dims == ("meter", "time", "class")
    if "mu" in keep:
        np.testing.assert_array_equal(found.class_weights_of_node.values, OFSRFilter(ring, 3).nodes)
    stored = filter_dataset(readings, ring, "reading", n_nodes=3, keep=keep, store=tmp_path / "found.zarr")
    assert_same(stored[keep[0]].values, found[keep[0]].values)
    with pytest.raises(ParameterError, match="keep: got 'switch_mean', which OFSRFilter does not find"):
        filter_dataset(readings, ring, "reading", n_nodes=3, keep=["x", "switch_mean"])


def test_known_class_weights_come_from_a_variable(ds, ring) -> None:
    weights = np.random.default_rng(3).dirichlet(np.ones(3), (11, 30))
    more = ds[["reading"]].assign(season=(("meter", "time", "kind"), weights))
    f = KnownSwitchFilter(ring)
    found = filter_dataset(more, f, "reading", inputs={"r": "season"}, keep=["x", "switch", "class_weights"])
    assert_same(found.x.values, f.filter_many(ds.reading.values, r=weights).x)
    assert found.switch.dims == found.class_weights.dims == ("meter", "time", "class")
    np.testing.assert_array_equal(found.switch.values, weights)
    labels = more.assign(season=(("meter", "time"), weights.argmax(axis=2)))
    found = filter_dataset(labels, f, "reading", inputs={"r": "season"}, keep=["x"])
    assert_same(found.x.values, f.filter_many(ds.reading.values, r=weights.argmax(axis=2)).x)


def test_series_may_have_any_number_of_dimensions_in_any_order(fuzzy_model) -> None:
    z = np.random.default_rng(4).normal(size=(20, 3, 5))
    field = xr.Dataset({"rain": (("day", "row", "column"), z)}).chunk(row=2, column=2)
    found = filter_dataset(field, fuzzy_model, dim="day", keep=["x", "mu"])
    assert found.mu.dims == ("row", "column", "day", "node")
    expected = OFSRFilter(fuzzy_model).filter_many(z.reshape(20, 15).T, keep=["x", "mu"])
    assert_same(found.x.values, expected.x.reshape(3, 5, 20, 1))
    assert_same(found.mu.values, expected.mu.reshape(3, 5, 20, 7))

    single = xr.Dataset({"rain": ("day", z[:, 0, 0])})
    found = filter_dataset(single, fuzzy_model, dim="day", keep=["x"])
    assert found.x.dims == ("day", "state")
    np.testing.assert_allclose(found.x.values, OFSRFilter(fuzzy_model).filter(z[:, 0, 0]).x, rtol=1e-12)


def test_observations_may_have_components() -> None:
    z = np.random.default_rng(5).normal(size=(6, 2, 15))
    ds = xr.Dataset({"position": (("object", "axis", "time"), z)}).chunk(object=4)
    found = filter_dataset(ds, kalman_filter(2), component="axis", states=["east", "north"])
    expected = kalman_filter(2).filter_many(z.swapaxes(1, 2))
    assert_same(found.P.values, expected.P)
    assert_same(found.x.sel(state="north").values, expected.x[..., 1])
    assert found.P.sel(state="east", state_column="north").dims == ("object", "time")


def test_series_that_are_not_chunked_are_cut_to_a_size_that_counts_the_results(
    monkeypatch, fuzzy_model
) -> None:
    # A step of a series takes 8 bytes for z, and 8 (1 + 1 + 1) for x, P and log_likelihood.
    monkeypatch.setattr("fuzzykf.distributed.blocks.BLOCK_BYTES", 32 * 50 * 10)
    ds = xr.Dataset({"reading": (("meter", "time"), np.zeros((35, 50)))})
    result = filter_dataset(ds, fuzzy_model)
    assert result.chunksizes["meter"] == (10, 10, 10, 5)
    assert result.chunksizes["time"] == (50,)
    assert dask.is_dask_collection(result.x.data)


# ------------------------------------------------------------------ what it says


def test_coordinates_stay_and_those_of_the_nodes_come(ds, fuzzy_model) -> None:
    result = filter_dataset(ds, fuzzy_model, keep=["x", "P", "mu"], units="kW", states=["power"])
    for name in ("meter", "time", "street", "hour"):
        xr.testing.assert_identical(result[name].variable, ds[name].variable)
    np.testing.assert_array_equal(result.node, OFSRFilter(fuzzy_model).nodes)
    assert result.state.values.tolist() == result.state_column.values.tolist() == ["power"]
    assert result.x.attrs["units"] == "kW"
    assert result.P.attrs["units"] == "(kW)^2"
    assert "units" not in result.mu.attrs
    assert result.mu.attrs["long_name"] == "probability of each node (or class, or mode) of the switch"


def test_the_attributes_say_how_it_was_made_and_bring_the_model_back(ds, fuzzy_model, tmp_path) -> None:
    attrs = filter_dataset(ds, fuzzy_model, n_nodes=3).attrs
    assert attrs["title"] == "a street"
    assert attrs["fuzzykf_filter"] == "OFSRFilter(n_nodes=3, rule='cell')"
    assert attrs["fuzzykf_observations"] == "reading"
    json.loads(attrs["fuzzykf_model"])
    (tmp_path / "model.json").write_text(attrs["fuzzykf_model"])
    again = CGOFMSModel.load(tmp_path / "model.json")
    zs = ds.reading.values[0]
    np.testing.assert_array_equal(OFSRFilter(again).filter(zs).x, OFSRFilter(fuzzy_model).filter(zs).x)
    assert "fuzzykf_model" not in filter_dataset(ds, kalman_filter()).attrs


def test_a_law_given_by_functions_cannot_be_written_and_is_left_out(ds) -> None:
    law = FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, lambda r1, r2: 0.1 + 0.0 * r1 * r2)
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.broadcast_to(np.block([[z, 0.8 * z], [0.8 * z, z]]), (2, 2, 4, 4))
    model = CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], pair, dim_x=1)
    assert "fuzzykf_model" not in filter_dataset(ds, lambda: OFSRFilter(model)).attrs


# ------------------------------------------------------------------ from Zarr to Zarr


def test_a_store_is_written_block_by_block_and_opened(ds, fuzzy_model, tmp_path) -> None:
    source = ds.drop_vars(["meter", "street"]).chunk(meter=3)
    source.to_zarr(tmp_path / "in.zarr", consolidated=False)
    read = xr.open_zarr(tmp_path / "in.zarr", consolidated=False)
    encoding = {"P": {"dtype": "float32"}}
    result = filter_dataset(read, fuzzy_model, store=tmp_path / "out.zarr", encoding=encoding)
    assert result.encoding["source"] == str(tmp_path / "out.zarr")
    expected = OFSRFilter(fuzzy_model).filter_many(ds.reading.values)
    assert_same(result.x.values, expected.x)
    assert_same(result.log_likelihood.values, expected.log_likelihood)
    assert result.P.dtype == np.float32
    assert zarr.open_group(tmp_path / "out.zarr")["x"].chunks == (3, 30, 1)

    before = (tmp_path / "out.zarr" / "zarr.json").read_bytes()
    with pytest.raises(FileExistsError):
        filter_dataset(read, kalman_filter(), store=tmp_path / "out.zarr")
    assert (tmp_path / "out.zarr" / "zarr.json").read_bytes() == before
    assert filter_dataset(read, kalman_filter(), store=tmp_path / "out.zarr", mode="w").sizes["state"] == 2
    with pytest.raises(ParameterError, match="is also read from"):
        filter_dataset(read, fuzzy_model, store=tmp_path / "in.zarr", mode="w")
    np.testing.assert_array_equal(read.reading, ds.reading)


def test_no_more_than_a_few_blocks_are_in_memory(tmp_path) -> None:
    # 24 blocks of 1 MiB go in and 24 of 6 MiB come out; each of two threads holds what it works on.
    n_blocks, series, steps = 24, 128, 1024
    readings = da.random.default_rng(0).normal(size=(n_blocks * series, steps), chunks=(series, steps))
    ds = xr.Dataset({"reading": (("meter", "time"), readings)})
    block = 7 * 8 * series * steps

    class Quick:  # costs nothing, so that as many blocks as can be are on their way
        dim_x, dim_z = 2, 1

        def filter_many(self, zs, keep):
            return FilterResult(x=np.ones((*zs.shape[:2], 2)), P=np.ones((*zs.shape[:2], 2, 2)))

    raw = {name: {"compressors": None} for name in ("x", "P")}
    with dask.config.set(scheduler="threads", num_workers=2):
        tracemalloc.start()
        filter_dataset(ds, Quick(), keep=["x", "P"], store=tmp_path / "out.zarr", encoding=raw)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 6 * block < n_blocks * block / 3


# ------------------------------------------------------------------ on a cluster

N_SERIES, N_BLOCKS = 2000, 20


@pytest.fixture
def slow_filter(fuzzy_model):
    """The fuzzy filter, slow enough to be interrupted."""

    class Slow:  # a local class, which travels by value: workers cannot import this file
        def __init__(self, f):
            self.f, self.dim_x, self.dim_z = f, f.dim_x, f.dim_z

        def filter_many(self, zs, keep):
            time.sleep(0.1)
            return self.f.filter_many(zs, keep=keep)

    return Slow(OFSRFilter(fuzzy_model))


@pytest.fixture
def many(tmp_path):
    """A store of two thousand series, some with gaps, in twenty blocks."""
    rng = np.random.default_rng(7)
    readings = rng.normal(size=(N_SERIES, 48))
    readings[::25, 7] = np.nan
    ds = xr.Dataset({"reading": (("meter", "time"), readings)}).chunk(meter=N_SERIES // N_BLOCKS)
    ds.to_zarr(tmp_path / "in.zarr", consolidated=False)
    return xr.open_zarr(tmp_path / "in.zarr", consolidated=False)


def kill_a_worker_when(count, cluster) -> tuple[int, int]:
    """Kill a worker as soon as some blocks are done; return how many were, and the dead process."""
    deadline = time.monotonic() + 60.0
    while (done := count()) < 3:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    pid = next(iter(cluster.workers.values())).pid
    os.kill(pid, signal.SIGKILL)
    return done, pid


def test_from_zarr_to_zarr_nothing_is_missing_after_a_worker_was_killed(
    many, slow_filter, fuzzy_model, tmp_path
) -> None:
    out, keep = tmp_path / "out.zarr", ("x", "P", "mu", "log_likelihood")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    forked = {"distributed.worker.multiprocessing-method": "forkserver"}  # three workers import packages once
    with (
        dask.config.set(forked),
        distributed.LocalCluster(**options) as cluster,
        distributed.Client(cluster) as client,
        ThreadPoolExecutor() as pool,
    ):
        pids = set(client.run(os.getpid).values())
        killing = pool.submit(kill_a_worker_when, lambda: len(list(out.glob("x/c/*/0/0"))), cluster)
        result = filter_dataset(many, slow_filter, keep=keep, store=out)
        done, killed = killing.result()
    assert len(pids) == 2
    assert os.getpid() not in pids
    assert killed in pids
    assert 0 < done < N_BLOCKS  # in the middle, however busy the machine
    local = OFSRFilter(fuzzy_model).filter_many(many.reading.values, keep=keep)
    for name in keep:
        assert result[name].sizes["meter"] == N_SERIES
        assert_same(result[name].values, getattr(local, name))


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("change", "options", "error", "message"),
    [
        (lambda ds: ds.reading, {}, ParameterError, "ds: got DataArray, expected an xarray.Dataset"),
        (lambda ds: ds.chunk(time=10), {}, ParameterError, r"chunked along 'time'.*ds.chunk\({'time': -1"),
        (lambda ds: ds.assign(other=ds.reading), {}, ParameterError, "ds has 'reading', 'other'"),
        (None, {"observations": "power"}, ParameterError, "no variable 'power'; it has 'reading'"),
        (None, {"observations": "street"}, ParameterError, "dim: got 'time', expected one of"),
        (
            None,
            {"dim": "when"},
            ParameterError,
            r"dim: got 'when', expected one of the dimensions \('meter', ",
        ),
        (
            lambda ds: ds.chunk(meter=-1),
            {"component": "meter"},
            ShapeError,
            "of 1 components, but 'meter' has 11",
        ),
        (lambda ds: ds.astype(str), {}, ParameterError, "'reading' holds <U"),
        (lambda ds: ds.isel(meter=slice(0)), {}, ShapeError, "'reading' is empty"),
        (None, {"model": "kalman"}, ParameterError, "model: got str, expected a CGOFMSModel"),
        (None, {"model": dict}, ParameterError, "model: it returned dict, expected a filter"),
        (None, {"model": lambda: kalman_filter(2)}, ShapeError, "2 components, but no dimension of"),
        (None, {"model": kalman_filter(), "n_nodes": 3}, ParameterError, "n_nodes: got 3, expected nothing"),
        (None, {"n_nodes": -1}, ParameterError, "n_nodes"),
        (None, {"keep": ["x", "y"]}, ParameterError, "keep: got 'y', expected names among x, P"),
        (None, {"keep": []}, ParameterError, "keep: got no name"),
        (None, {"keep": ["possibility"]}, ParameterError, "keep: got 'possibility'"),
        (None, {"inputs": {"r": "valve"}}, ParameterError, "no variable 'valve', which 'r' asks for"),
        (None, {"inputs": {"r": "street"}}, ParameterError, "'street' has the dimensions .*expected 'time'"),
        (None, {"inputs": {"r": "hour"}}, ParameterError, "OFSRFilter does not take them: .*'r'"),
        (None, {"states": ["a", "b"]}, ShapeError, "expected 1 names"),
        (lambda ds: ds.rename(meter="x"), {}, ParameterError, "'x' has the name of a result"),
        (lambda ds: ds.rename(hour="node"), {"keep": ["mu"]}, ParameterError, "'node' has the name"),
        (None, {"store": "out.zarr", "mode": "r"}, ParameterError, "mode: got 'r'"),
        (
            lambda ds: ds.chunk(meter=(3, 5, 3)),
            {"store": "out.zarr"},
            ParameterError,
            "'meter' have sizes from 3 to 5, but a store needs chunks of one size",
        ),
    ],
)
def test_what_does_not_fit_is_refused_before_any_work(
    change, options, error, message, ds, fuzzy_model, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=message):
        filter_dataset(ds if change is None else change(ds), **{"model": fuzzy_model, **options})
    assert list(tmp_path.iterdir()) == []


def test_the_error_of_a_block_says_where_the_block_is(ds, fuzzy_model) -> None:
    bad = ds.copy(deep=True)
    bad["reading"] = ds.reading.where((ds.meter != "M09") | (ds.time != ds.time[3]), np.inf)
    with pytest.raises(ParameterError, match="observation 3 of series 1 is") as caught:
        filter_dataset(bad, fuzzy_model).compute(scheduler="threads")
    assert caught.value.__notes__ == [
        "fuzzykf: series are counted from the beginning of ds.isel(meter=slice(8, 11))"
    ]


@pytest.mark.parametrize("package", ["xarray", "dask.array", "zarr"])
def test_without_a_package_the_extra_is_named(package, ds, fuzzy_model, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'fuzzykf\[dask\]'"):
        filter_dataset(ds, fuzzy_model, store=tmp_path / "out.zarr")


def test_importing_it_loads_neither_dask_nor_xarray() -> None:
    code = "import sys, fuzzykf.distributed; print({'dask', 'xarray', 'zarr', 'pandas'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "set()\n"


# --------------------------------------------------------------------------- names


def two_observations() -> CGOMSModel:
    """A model of "load" from "t" and "h", hour by hour."""
    z = np.array([[1.0, 0.4, 0.3], [0.4, 1.0, 0.0], [0.3, 0.0, 2.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    model = CGOMSModel([[1.0]], [[0.0, 1.0, -1.0]], pair[None, None], 1)
    return model.labelled(states=["load"], observations=["t", "h"], step=np.timedelta64(1, "h"))


def named_dataset(components, step="h", name="weather"):
    values = np.random.default_rng(0).normal(size=(3, 12, len(components)))
    hours = np.datetime64("2024-01-01", "ns") + np.arange(12) * np.timedelta64(1, step)
    return xr.Dataset(
        {name: (("meter", "time", "what"), values)}, {"time": hours, "what": list(components)}
    ), values


@pytest.mark.parametrize("of", ["model", "filter"])
@pytest.mark.parametrize("components", [("t", "h"), ("h", "t"), ("load", "h", "wind", "t"), (0, 1)])
def test_components_are_those_that_were_learned_on(components, of) -> None:
    ds, values = named_dataset(components)
    model = two_observations()
    found = filter_dataset(ds, model if of == "model" else model.filter(), component="what")
    positions = [0, 1] if 0 in components else [components.index("t"), components.index("h")]
    assert_same(found.x.to_numpy(), model.filter().filter_many(values[..., positions]).x)


@pytest.mark.parametrize(
    ("dataset", "message"),
    [
        (
            lambda: named_dataset(("t", "wind"))[0],
            "component: 'what': got no column 'h'; the model was learned on",
        ),
        (lambda: named_dataset(("t", "h"), name="load")[0], "observations: got 'load', a state of the model"),
        (
            lambda: named_dataset(("t", "h"), step="D")[0],
            "ds: its rows are 1 day, 0:00:00 apart, but the model",
        ),
    ],
)
def test_variables_that_were_not_learned_on_are_refused(dataset, message) -> None:
    with pytest.raises(ParameterError, match=message):
        filter_dataset(dataset(), two_observations(), component="what")


# ------------------------------------------------------------------ objects

OBJECTS = np.array([[1.0, None, 3.0], [np.nan, 2, np.float32(4.0)], [5.0, pd.NA, True]], dtype=object)


@pytest.mark.parametrize("chunks", [{}, {"meter": 1}, {"meter": 2}])
def test_a_variable_of_objects_is_read_as_filter_many_reads_it(chunks) -> None:
    ds = xr.Dataset({"load": (("meter", "time"), OBJECTS, {"units": "kW"})})
    result = filter_dataset(ds.chunk(chunks) if chunks else ds, kalman_filter(), keep=["x", "log_likelihood"])
    expected = kalman_filter().filter_many(OBJECTS)
    computed = result.compute(scheduler="threads")
    assert_same(computed.x.values, expected.x)
    assert_same(computed.log_likelihood.values, expected.log_likelihood)


@pytest.mark.parametrize("chunks", [{}, {"meter": 1}])
@pytest.mark.parametrize("cell", ["high", "1.5", 1j, b"1", np.datetime64("2014-01-01"), [1.0, 2.0]])
def test_an_object_that_is_no_number_is_refused(chunks, cell) -> None:
    values = OBJECTS.copy()
    values[1, 1] = cell
    ds = xr.Dataset({"load": (("meter", "time"), values)})
    with pytest.raises(ParameterError, match="observations: 'load' holds something that is no real number"):
        filter_dataset(ds.chunk(chunks) if chunks else ds, kalman_filter()).compute(scheduler="threads")


def test_objects_in_blocks_are_not_read_before_the_result_is_asked_for() -> None:
    def fails(block):
        raise RuntimeError("computed")

    values = da.from_array(OBJECTS, chunks=(1, 3)).map_blocks(
        fails, dtype=object, meta=np.empty((0, 0), object)
    )
    result = filter_dataset(xr.Dataset({"load": (("meter", "time"), values)}), kalman_filter())
    with pytest.raises(RuntimeError, match="computed"):
        result.compute(scheduler="threads")

"""What a year of quarter hours of many meters costs: processor time and bytes, for docs/howto/clusters.md.

Run with ``pytest tests/benchmarks/test_distributed.py --benchmark-only -s``.  Processor time, not
wall time, because it is cores that are paid for.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from fuzzykf import KalmanFilter, OFSRFilter
from fuzzykf.distributed import filter_dataset

dask = pytest.importorskip("dask", reason="the extra [dask] is not installed")
xr = pytest.importorskip("xarray", reason="the extra [dask] is not installed")

STEPS, SERIES, ROUNDS, METERS = 35_040, 128, 2, 1_000_000


@pytest.fixture(scope="module")
def readings(fuzzy_model):
    """Series of a year of what the model says, with an error of their own and three decimals."""
    rng = np.random.default_rng(0)
    year = fuzzy_model.simulate(STEPS, rng).y[:, 0]
    errors = rng.normal(scale=0.1, size=(SERIES, STEPS))
    return (np.stack([np.roll(year, 271 * k) for k in range(SERIES)]) + errors).round(3)


def kalman_filter(_model) -> KalmanFilter:
    return KalmanFilter(2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]], Q=0.01)


def report(benchmark, n_series, used) -> float:
    nanoseconds = 1e9 * min(used) / (n_series * STEPS)
    hours = 1e-9 * nanoseconds * STEPS * METERS / 3600
    benchmark.extra_info.update({"ns per series-step": round(nanoseconds)})
    print(
        f"\n{benchmark.name}: {nanoseconds:.0f} ns of processor time per series-step; "
        f"a million meters for a year, {METERS * STEPS:.3g} steps: {hours:.1f} core-hours"
    )
    return nanoseconds


@pytest.mark.parametrize("make", [OFSRFilter, kalman_filter], ids=["fuzzy", "kalman"])
@pytest.mark.parametrize("gaps", ["complete", "first missing", "1 % missing"])
def test_filter_many(benchmark, make, gaps, readings, fuzzy_model) -> None:
    f, zs, used = make(fuzzy_model), readings.copy(), []
    if gaps == "first missing":
        zs[:, 0] = np.nan
    elif gaps == "1 % missing":  # at random, of each meter others
        zs[np.random.default_rng(1).random(zs.shape) < 0.01] = np.nan

    def run() -> None:
        start = time.process_time()
        f.filter_many(zs)
        used.append(time.process_time() - start)

    benchmark.pedantic(run, rounds=ROUNDS)
    report(benchmark, len(zs), used)


def test_from_zarr_to_zarr(benchmark, readings, fuzzy_model, tmp_path) -> None:
    ds = xr.Dataset({"reading": (("meter", "time"), readings)}).chunk(meter=SERIES // 2)
    ds.to_zarr(tmp_path / "in.zarr", consolidated=False)
    source, used = xr.open_zarr(tmp_path / "in.zarr", consolidated=False), []

    def run() -> None:
        start = time.process_time()
        with dask.config.set(scheduler="synchronous"):
            filter_dataset(source, fuzzy_model, store=tmp_path / "out.zarr", mode="w")
        used.append(time.process_time() - start)

    benchmark.pedantic(run, rounds=ROUNDS)
    report(benchmark, SERIES, used)
    for name in ("in.zarr/reading", "out.zarr/x", "out.zarr/P", "out.zarr/log_likelihood"):
        size = sum(file.stat().st_size for file in (tmp_path / name).rglob("*") if file.is_file())
        each = size / readings.size
        print(
            f"  {name}: {each:.2f} of 8 bytes a number on disk; of a million meters "
            f"{8e-9 * METERS * STEPS:.0f} GB, on disk {1e-9 * each * METERS * STEPS:.0f} GB"
        )

"""Runs on Dask whose workers, or whose script, are killed in the middle.

A worker that is killed is made good: the result is that of one process, to the bit.  A script that is
killed leaves a store that says so: it is refused where it is read, and the same call finishes it.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from report import Report
from systems import system

from fuzzykf.distributed import filter_dataset
from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fuzzykf.base import FilterResult

__all__ = ["run"]

#: How often workers are killed, and scripts.
WORKERS, SCRIPTS = 7, 3

SERIES, STEPS, PER_BLOCK = 80, 60, 4

#: How long a block takes, in seconds, so that there is a middle.
PAUSE = 0.15

FIELDS = ("x", "P", "log_likelihood")

#: A run that has not ended after so many seconds hangs.
PATIENCE = 120.0


class Slow:
    """A filter that takes its time."""

    def __init__(self) -> None:
        self.f = system("hard", (2, 1), 1).make()
        self.dim_x, self.dim_z = self.f.dim_x, self.f.dim_z

    def filter_many(self, zs: np.ndarray, keep: Iterable[str] = FIELDS) -> FilterResult:
        """Filter many series, after a pause."""
        if zs.shape[1] > 1:  # else it is asked what it will return
            time.sleep(PAUSE)
        return self.f.filter_many(zs, keep=keep)

    def __dask_tokenize__(self) -> str:
        return "slow"


def readings(seed: int) -> xr.Dataset:
    """Draw the observations."""
    values = np.random.default_rng(seed).normal(size=(SERIES, STEPS))
    return xr.Dataset({"reading": (("meter", "time"), values)}).chunk(meter=PER_BLOCK)


def filtered(ds: xr.Dataset, store: Path, mode: str = "w-") -> xr.Dataset:
    """Filter into a store."""
    return filter_dataset(ds, Slow, keep=FIELDS, store=str(store), mode=mode)


def differing(result: xr.Dataset, expected: FilterResult) -> list[str]:
    """Return the fields that are not those of one process, to the bit."""
    return [name for name in FIELDS if not np.array_equal(result[name].values, getattr(expected, name))]


def begun(store: Path) -> int:
    """Return how many chunks of the states are there."""
    return sum(1 for _ in (store / "x").glob("c/*/0/0"))


def wait_until(store: Path, chunks: int) -> None:
    """Wait until so many chunks are written."""
    deadline = time.monotonic() + PATIENCE
    while begun(store) < chunks and time.monotonic() < deadline:
        time.sleep(0.01)


def finished(ds: xr.Dataset, store: Path, expected: FilterResult) -> list[str]:
    """Judge a store that was cut short: it is refused where it is read, and finished by the same call."""
    faults = []
    try:
        there = xr.open_zarr(str(store), consolidated=False)
    except (FileNotFoundError, KeyError, ValueError):
        pass  # killed before there was a store to read
    else:
        if there.attrs.get("fuzzykf_complete") != "no":
            faults.append(f"a store of {begun(store)} chunks says {there.attrs.get('fuzzykf_complete')!r}")
        try:
            filter_dataset(there[["x"]].isel(state=0), Slow)
            faults.append("a store that was cut short is read")
        except ParameterError:
            pass
    faults += [f"{name} differs after going on" for name in differing(filtered(ds, store, "r+"), expected)]
    faults += [f"{path.name} is left" for path in store.rglob("*.partial")]
    return faults


# --------------------------------------------------------------------------- workers


def kill_a_worker(client: Any, store: Path, chunks: int, rng: random.Random) -> None:
    """Kill one of the workers once so many chunks are written."""
    pids = sorted(client.run(os.getpid).values())
    wait_until(store, chunks)
    os.kill(rng.choice(pids), signal.SIGKILL)


def with_a_worker_killed(
    client: Any, ds: xr.Dataset, store: Path, expected: FilterResult, rng: random.Random
) -> list[str]:
    """Filter on a cluster of which a worker is killed."""
    chunks = rng.randrange(SERIES // PER_BLOCK // 2)
    client.wait_for_workers(2, timeout=PATIENCE)
    killer = threading.Thread(target=kill_a_worker, args=(client, store, chunks, rng))
    killer.start()
    try:
        result = filtered(ds, store)
    except Exception as error:  # it may give up, but has to say so and leave what can be finished
        faults = finished(ds, store, expected)
        return [f"{type(error).__name__} after {chunks} chunks; {fault}" for fault in faults]
    finally:
        killer.join()
    faults = [f"{name} differs, killed after {chunks} chunks" for name in differing(result, expected)]
    if result.attrs.get("fuzzykf_complete") != "yes":
        faults.append("a whole store does not say so")
    return faults


def kill_workers(kills: int, folder: Path, seed: int) -> list[str]:
    """Filter again and again, each time on a new cluster, since Dask need not replace who is killed."""
    import dask
    from distributed import Client, LocalCluster

    rng, ds, faults = random.Random(seed), readings(seed), []
    expected = Slow().filter_many(ds["reading"].values)
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 60}
    for n in range(kills):
        with (
            dask.config.set({"logging.distributed": "critical"}),
            LocalCluster(**options) as cluster,
            Client(cluster) as client,
        ):
            wrong = with_a_worker_killed(client, ds, folder / f"workers{n}.zarr", expected, rng)
        faults += [f"worker, kill {n}: {fault}" for fault in wrong]
    return faults


# --------------------------------------------------------------------------- scripts


def script(seed: int, store: Path) -> None:
    """Filter in this process, by threads."""
    import dask

    with dask.config.set(scheduler="threads", num_workers=2):
        filtered(readings(seed), store)


def kill_scripts(kills: int, folder: Path, seed: int) -> list[str]:
    """Kill scripts in the middle, and go on where they were."""
    import dask

    rng, ds, faults = random.Random(seed), readings(seed), []
    expected = Slow().filter_many(ds["reading"].values)
    for n in range(kills):
        store, chunks = folder / f"script{n}.zarr", rng.randrange(SERIES // PER_BLOCK - 2)
        process = multiprocessing.get_context("spawn").Process(target=script, args=(seed, store))
        process.start()
        wait_until(store, chunks)
        time.sleep(rng.uniform(0.0, PAUSE))
        process.kill()
        process.join()
        with dask.config.set(scheduler="threads", num_workers=2):
            wrong = finished(ds, store, expected)
        faults += [f"script, kill {n} after {chunks} chunks: {fault}" for fault in wrong]
    return faults


def run(share: float, seed: int) -> Report:
    """Kill workers, then scripts."""
    workers, scripts = (max(1, round(number * share)) for number in (WORKERS, SCRIPTS))
    with tempfile.TemporaryDirectory() as folder:
        faults = kill_workers(workers, Path(folder), seed) + kill_scripts(scripts, Path(folder), seed)
    figures = {
        "workers killed": workers,
        "scripts killed": scripts,
        "blocks of a run": SERIES // PER_BLOCK,
    }
    return Report("Dask with kills in the middle", figures, faults)

"""Pickle, copy and save every public object, on either engine, and go on with it on either engine.

What one engine pickled and the same one loads must go on bit for bit; on the other engine to 1e-12.  So must
what was made in a gap, on either: the compiled engine is in the middle of it, a copy leaves it by the verbs.
"""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from parts import differences, parts
from report import Report

from fuzzykf.errors import FuzzykfError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["run"]

ENGINES = ("numpy", "compiled")

#: How often each object is tried in the full run, with other data each time.
ROUNDS = 25

#: Agreement of one engine with the other.  Learning iterates, and with it the rounding grows.
TOLERANCE, LEARNED = 1e-12, 1e-8

#: Seconds after which a process of this part hangs.
PATIENCE = 1800.0


# --------------------------------------------------------------------------- stages and sequels


def observations(name: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return data for a filter that is in no trouble with them."""
    from specimens import FILTERS

    return rng.normal(scale=0.5, size=(n, FILTERS[name][0]))


def switch_of(name: str, n: int) -> dict[str, Any]:
    """Return the argument that a filter with a known switch needs beside the data."""
    from specimens import known_switch

    return {"r": known_switch(n)} if name.startswith("KnownSwitch") else {}


def steps(f: Any, name: str, zs: np.ndarray) -> None:
    """Do one step after the other; what a filter refuses is left out."""
    for k, z in enumerate(zs):
        with suppress(FuzzykfError):
            f.step(None if np.isnan(z).all() else z, **({"r": float(k % 2)} if switch_of(name, 1) else {}))


def stages(name: str, seed: int) -> Iterator[tuple[str, Any]]:
    """Yield a filter in every state of its life; of anything else, the object."""
    from specimens import FILTERS, specimen

    rng = np.random.default_rng([seed, len(name)])
    yield "fresh", specimen(name)
    if name not in FILTERS:
        return
    zs = observations(name, 5, rng)
    holes = zs.copy()
    holes[3:] = np.nan
    partly = zs.copy()
    partly[4, 0] = np.nan
    for stage, data in (("after steps", zs), ("in a gap", holes), ("in part of a gap", partly)):
        steps(f := specimen(name), name, data)
        yield stage, f
    f = specimen(name)
    steps(f, name, zs[:2])
    f.predict(**({"r": 1.0} if switch_of(name, 1) else {}))
    yield "predicted", f
    for verb in ("filter", "smooth", "forecast"):
        f = specimen(name)
        possible = hasattr(f, verb) and getattr(f, "has_smoother", True)
        if possible and not (verb == "forecast" and switch_of(name, 1)):
            if verb == "forecast":
                steps(f, name, zs)
                f.forecast(3)
            else:
                with suppress(FuzzykfError):
                    getattr(f, verb)(zs, **switch_of(name, 5))
            yield f"after {verb}", f


def sequel(thing: Any, name: str, seed: int) -> dict[str, Any]:
    """Go on with an object, and return everything that it shows on the way."""
    from specimens import FILTERS

    rng = np.random.default_rng([seed, 1, len(name)])
    found = parts(thing, "before")
    if name in FILTERS:
        zs = observations(name, 4, rng)
        zs[1] = np.nan
        for k in range(4):
            steps(thing, name, zs[k : k + 1])
            found |= parts(thing, f"step {k}")
        thing.reset()
        found |= parts(thing, "reset")
        with suppress(FuzzykfError):
            found |= parts(thing.filter(zs, **switch_of(name, 4)), "filter")
    if hasattr(thing, "simulate"):
        found |= parts(thing.simulate(5, rng), "simulate")
    if name.startswith("CGO"):
        f = thing.filter() if hasattr(thing, "simulate") else thing
        found |= parts(f.filter(rng.normal(size=(4, f.dim_z))), "filter")
    if hasattr(thing, "sample"):
        found |= parts(thing.sample(5, rng), "sample")
    if name.endswith("Membership"):
        found |= parts(thing(rng.normal(size=(3, 2 if name[:5] in ("Gauss", "Joint") else 1))), "call")
    if "Norm" in name:
        found |= parts(thing(rng.random(3), rng.random(3)), "call")
    if "TConorm" in name:
        found |= parts(thing(rng.random((2, 3)), axis=0), "call")
    if hasattr(thing, "fit_transform"):
        data = rng.normal(size=(24, 2)) if name == "Standardizer" else rng.normal(size=24)
        time = (
            {}
            if name == "Standardizer"
            else {"time": np.datetime64("2014-01-07", "s") + np.arange(24) * 3600}
        )
        found |= parts(thing.transform(data, **time), "transform")
    if name == "FitResult":
        found |= parts(thing.bootstrap(1, rng)[0], "bootstrap")
    return found


# --------------------------------------------------------------------------- processes


def saver_faults(thing: Any, name: str, stage: str) -> list[str]:
    """Keep a filter in filterpy's Saver, which copies everything that it finds."""
    from specimens import FILTERS

    if name not in FILTERS:
        return []
    from filterpy.common import Saver

    saver = Saver(thing)
    saver.save()
    kept = np.asarray(saver.x[-1])
    same = kept.shape == np.shape(thing.x) and np.array_equal(kept, thing.x, equal_nan=True)
    return [] if same else [f"Saver kept x = {kept.tolist()}, not {np.asarray(thing.x).tolist()}"]


def in_gap(stage: str) -> float:
    """Return how far apart what goes on from a stage may be on one engine."""
    return TOLERANCE if stage.endswith("gap") else 0.0


def make(folder: Path, rounds: range) -> list[str]:
    """Pickle everything in this process's engine, copy it, and write down how it goes on."""
    from specimens import SPECIMENS

    faults, number, made = [], 0, []
    for seed in rounds:
        for name in SPECIMENS:
            for stage, thing in stages(name, seed):
                where = f"{name}, {stage}, round {seed}"
                try:
                    content = pickle.dumps(thing, 2 if number % 2 else pickle.HIGHEST_PROTOCOL)
                    again = copy.deepcopy(thing)
                    faults += [f"{where}: {fault}" for fault in saver_faults(thing, name, stage)]
                    expected = sequel(thing, name, seed)
                    found = differences(expected, sequel(again, name, seed), in_gap(stage))
                except Exception as error:
                    faults.append(f"{where}: {type(error).__name__}: {error}")
                    continue
                faults += [f"{where}: deepcopy: {found}"] if found else []
                (folder / f"{number}.pickle").write_bytes(pickle.dumps((content, expected)))
                made.append((number, name, stage, seed))
                number += 1
    (folder / "made").write_bytes(pickle.dumps(made))
    return faults


def load(folder: Path, tolerances: dict[str, float]) -> dict[str, tuple[int, list[str]]]:
    """Load everything that engines made in this process's engine, and go on with it."""
    there = [engine for engine in tolerances if (folder / engine / "made").exists()]
    return {engine: loaded(folder / engine, tolerances[engine]) for engine in there}


def loaded(folder: Path, tolerance: float) -> tuple[int, list[str]]:
    """Load everything that one engine made; return how many, and what is wrong."""
    faults, loads = [], 0
    for number, name, stage, seed in pickle.loads((folder / "made").read_bytes()):
        content, expected = pickle.loads((folder / f"{number}.pickle").read_bytes())
        loads += 1
        where = f"{name}, {stage}, round {seed}"
        try:
            allowed = LEARNED if tolerance and name == "FitResult" else max(tolerance, in_gap(stage))
            found = differences(expected, sequel(pickle.loads(content), name, seed), allowed)
        except Exception as error:
            found = f"{type(error).__name__}: {error}"
        faults += [f"{where}: {found}"] if found else []
    return loads, faults


def work(engine: str, task: str, args: tuple[Any, ...], results: Any) -> None:
    """Do a task in this process, with the engine that its environment names."""
    from fuzzykf import engine as engines

    assert engines.info().name == engine
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        results.send({"make": make, "load": load}[task](*args))


def on(engine: str, task: str, *args: Any) -> Any:
    """Do a task in a process of its own; one that dies raises EOFError."""
    context = multiprocessing.get_context("spawn")
    before = os.environ.get("FUZZYKF_ENGINE")
    os.environ["FUZZYKF_ENGINE"] = engine
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(engine, task, args, there))
    try:
        process.start()
        there.close()
        if not here.poll(PATIENCE):
            raise TimeoutError(f"{task} on {engine}: nothing after {PATIENCE:.0f} s")
        return here.recv()
    finally:
        process.kill()
        process.join()
        os.environ.pop("FUZZYKF_ENGINE") if before is None else os.environ.update(FUZZYKF_ENGINE=before)


def run(share: float, seed: int) -> Report:
    """Pickle on each engine, load on each engine."""
    rounds = range(seed - 1, seed - 1 + max(1, round(ROUNDS * share)))
    report = Report("pickles, copies and Savers of every object, from each engine to each")
    with tempfile.TemporaryDirectory() as folder:
        for engine in ENGINES:
            made = Path(folder) / engine
            made.mkdir()
            try:
                faults = on(engine, "make", made, rounds)
                report.faults += [f"made on {engine}: {fault}" for fault in faults]
                objects = len(pickle.loads((made / "made").read_bytes()))
                report.figures[f"objects made on {engine}"] = objects
            except (EOFError, TimeoutError) as error:
                report.faults.append(f"made on {engine}: the process ended: {error!r}")
        for other in ENGINES:
            tolerances = {engine: 0.0 if other == engine else TOLERANCE for engine in ENGINES}
            try:
                found = on(other, "load", Path(folder), tolerances)
            except (EOFError, TimeoutError) as error:
                report.faults.append(f"loaded on {other}: the process ended: {error!r}")
                continue
            for engine, (loads, faults) in found.items():
                report.figures[f"pickles from {engine} loaded on {other}"] = loads
                report.faults += [f"from {engine} on {other}: {fault}" for fault in faults]
    return report

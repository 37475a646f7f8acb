"""All the goals of the engine in one table: beside filterpy, pykalman, simdkalman and loops in C.

``nox -s benchmarks -- -k table -s`` prints it.  The works of a row are measured in turn in one
process; a row gives the median time of each, and the median and the quartiles of the ratio over
the rounds.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator
from filterpy.kalman import KalmanFilter as TheirKalmanFilter

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, KalmanFilter, OFSRFilter, engine

#: Observations of a series, and how often each work is measured.
N, ROUNDS = 2000, 40

#: Goals of the rows; without AVX-512 60, 90 and 10 are enough for the first, the second and m = 4.
GOALS = {
    "OFSRFilter.step / filterpy KalmanFilter(1, 1)": 80,
    "OFSRFilter.filter / filterpy KalmanFilter(1, 1)": 130,
    "OFSRFilter.step / filterpy IMMEstimator of 7": 3000,
    "OFSRFilter.step, m = 4, q = 2 / filterpy KalmanFilter(4, 2)": 17,
    "OFSRFilter.filter, m = 4, q = 2 / filterpy KalmanFilter(4, 2)": 17,
    "KalmanFilter(2, 1).step / filterpy's": 10,
    "KalmanFilter(4, 2).step / filterpy's": 10,
    "KalmanFilter(4, 2).filter / filterpy's batch_filter": 250,
    "filter_many, 10,000 x 1,000, 2 threads / simdkalman (2, 1)": 5,
    "grid of 1000 x 1000, Gaussian noise / loops in C": 12,
    "rocket, 100 steps / loops in C": 200,
}


def beside(name):
    """Import a module of this folder, which is no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --------------------------------------------------------------------------- works


def kalman(kind, m, q):
    f = kind(m, q)
    f.F, f.H, f.Q, f.R = 0.9 * np.eye(m), np.eye(q, m), 0.2 * np.eye(m), 0.5 * np.eye(q)
    return f


def predict_update(f, values):
    def work():
        for z in values:
            f.predict()
            f.update(z)

    return work


def steps(f, values):
    def work():
        step = f.step
        for z in values:
            step(z)

    return work


def vector_model():
    """Four states, two observations, correlated."""
    rng = np.random.default_rng(6)
    root = rng.normal(size=(6, 6)) * 0.3 + np.eye(6)
    S = root @ root.T
    pair = np.block([[S, 0.3 * S], [0.3 * S, S]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(6), np.ones(6)], np.broadcast_to(pair, (2, 2, 12, 12)), 4)


def theirs(y, y4):
    """What others do: name to (work, number of steps)."""
    few, columns = 50, [z[:, None] for z in y4[:50]]
    imm = IMMEstimator(
        [kalman(TheirKalmanFilter, 1, 1) for _ in range(7)], np.full(7, 1 / 7), np.full((7, 7), 1 / 7)
    )
    batch = kalman(TheirKalmanFilter, 4, 2)
    works = {
        f"filterpy KalmanFilter({m}, {q})": (predict_update(kalman(TheirKalmanFilter, m, q), zs), few)
        for m, q, zs in ((1, 1, y[:few, 0].tolist()), (2, 1, y[:few, 0].tolist()), (4, 2, columns))
    }
    works["filterpy IMMEstimator of 7"] = predict_update(imm, y[:5, 0].tolist()), 5
    works["filterpy's batch_filter"] = lambda: batch.batch_filter(columns), few
    try:
        from pykalman import KalmanFilter as PyKalmanFilter
    except ImportError:
        return works
    f = PyKalmanFilter(0.9 * np.eye(4), np.eye(2, 4), 0.2 * np.eye(4), 0.5 * np.eye(2))
    works["pykalman's filter"] = lambda: f.filter(y4[:few]), few
    return works


def ours(scalar, vector, y, y4):
    """What fuzzykf does on one instruction set: name to (work, number of steps)."""
    values, columns = y[:, 0].tolist(), [z[:, None] for z in y4]
    batch = kalman(KalmanFilter, 4, 2)
    return {
        "OFSRFilter.step": (steps(scalar, values), N),
        "OFSRFilter.filter": (lambda: scalar.filter(y), N),
        "OFSRFilter.step, m = 4, q = 2": (steps(vector, list(y4)), N),
        "OFSRFilter.filter, m = 4, q = 2": (lambda: vector.filter(y4), N),
        "KalmanFilter(2, 1).step": (steps(kalman(KalmanFilter, 2, 1), values), N),
        "KalmanFilter(4, 2).step": (steps(kalman(KalmanFilter, 4, 2), columns), N),
        "KalmanFilter(4, 2).filter": (lambda: batch.filter(y4), N),
    }


#: Rows: what fuzzykf does, what it is compared with, and what the latter is called in the goals.
PAIRS = [
    ("OFSRFilter.step", "filterpy KalmanFilter(1, 1)", None),
    ("OFSRFilter.filter", "filterpy KalmanFilter(1, 1)", None),
    ("OFSRFilter.step", "filterpy IMMEstimator of 7", None),
    ("OFSRFilter.step, m = 4, q = 2", "filterpy KalmanFilter(4, 2)", None),
    ("OFSRFilter.filter, m = 4, q = 2", "filterpy KalmanFilter(4, 2)", None),
    ("KalmanFilter(2, 1).step", "filterpy KalmanFilter(2, 1)", "filterpy's"),
    ("KalmanFilter(4, 2).step", "filterpy KalmanFilter(4, 2)", "filterpy's"),
    ("KalmanFilter(4, 2).filter", "filterpy's batch_filter", None),
    ("KalmanFilter(4, 2).filter", "pykalman's filter", None),
]


def instruction_sets():
    """Names of what the compiled engine can use here, and how to choose; NumPy has one."""
    if engine.info().name == "numpy":
        return {"numpy": lambda: None}
    from fuzzykf.engine.compiled import processor

    return {
        name: lambda name=name: processor.use_instructions(name)
        for name in reversed(processor.available_instructions())
    }


# --------------------------------------------------------------------------- measuring


def measure(works, rounds, least=5e-3):
    """Seconds per step of each work, (rounds,), all in turn in each round.

    A short work is repeated within a round for at least ``least`` seconds, so that it does not
    pay for the caches that the others have filled.
    """

    def seconds(work, repeats):
        start = time.perf_counter()
        for _ in range(repeats):
            work()
        return time.perf_counter() - start

    repeats = {name: 1 + int(least / seconds(work, 1)) for name, (work, _) in works.items()}
    found = {name: [] for name in works}
    for _ in range(rounds):
        for name, (work, units) in works.items():
            found[name].append(seconds(work, repeats[name]) / units / repeats[name])
    return {name: np.array(times) for name, times in found.items()}


def spell(seconds):
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.0f} ns"


def row(label, own, other, engine_name):
    """Print a row in Markdown; returns the median ratio."""
    ratio = np.broadcast_to(other / own, own.shape)
    low, middle, high = np.quantile(ratio, [0.25, 0.5, 0.75])
    times = f"{spell(np.median(own))} | {spell(np.median(other))}"
    spread = f"{middle:.3g} ({low:.3g} to {high:.3g})"
    print(f"| {label} | {engine_name} | {times} | {spread} | {GOALS.get(label, '')} |", flush=True)
    return float(middle)


def test_table(benchmark, fuzzy_model):
    scalar, vector = OFSRFilter(fuzzy_model, 5), OFSRFilter(vector_model(), 5)
    y, y4 = (f.model.simulate(N, np.random.default_rng(0)).y for f in (scalar, vector))
    sets = instruction_sets()
    print(f"\n\n{engine.info()}; F = 5, series of {N} observations, {ROUNDS} rounds in turn")
    print("| fuzzykf / the other | engine | fuzzykf | the other | ratio, median (quartiles) | goal |")
    print("|---|---|---|---|---|---|")
    ratios = {}

    def rows():
        for name, choose in sets.items():
            choose()
            times = measure(theirs(y, y4) | ours(scalar, vector, y, y4), ROUNDS)
            for own, other, called in PAIRS:
                if other in times:
                    label = f"{own} / {called or other}"
                    ratios[f"{label}, {name}"] = row(label, times[own], times[other], name)

    benchmark.pedantic(rows, rounds=1)
    next(iter(sets.values()))()
    benchmark.extra_info.update({name: round(ratio, 2) for name, ratio in ratios.items()})


def test_table_of_many_series(benchmark, fuzzy_model):
    simdkalman = pytest.importorskip("simdkalman")
    series, length = 10_000, 1_000
    many = np.random.default_rng(1).normal(1.5, 1.5, (series, length, 1))
    f = OFSRFilter(fuzzy_model, 5)
    other = simdkalman.KalmanFilter(
        state_transition=[[1.0, 1.0], [0.0, 1.0]],
        process_noise=np.diag([0.1, 0.01]),
        observation_model=[[1.0, 0.0]],
        observation_noise=1.0,
    )

    def rows():
        for name, choose in instruction_sets().items():
            choose()
            works = {
                "own": (lambda: f.filter_many(many, threads=2), series * length),
                "other": (
                    lambda: other.compute(many[..., 0], 0, filtered=True, smoothed=False),
                    series * length,
                ),
            }
            times = measure(works, 3)
            label = "filter_many, 10,000 x 1,000, 2 threads / simdkalman (2, 1)"
            benchmark.extra_info[name] = row(label, times["own"], times["other"], name)

    print()
    benchmark.pedantic(rows, rounds=1)
    next(iter(instruction_sets().values()))()


def test_table_of_grids(benchmark):
    grids = beside("test_grid_speed")
    if grids.literal.library() is None:
        pytest.skip("there is no C compiler for the loops")

    def rows():
        own, loops = grids.grid_propagation()
        plane = row("grid of 1000 x 1000, Gaussian noise / loops in C", own, loops, engine.info().name)
        own, loops, *_ = grids.rocket_run()
        rocket = row("rocket, 100 steps / loops in C", own, np.array(loops), engine.info().name)
        benchmark.extra_info.update(plane=round(plane, 2), rocket=round(rocket, 2))

    print()
    benchmark.pedantic(rows, rounds=1)


MEMORY = """
import numpy as np
from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
def peak():  # getrusage would count the memory of the process that started this one, too
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
z = np.array([[0.5, 0.3], [0.3, 1.0]])
pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
f = OFSRFilter(CGOFMSModel(law, [[0, 0], [4, 6]], [[pair, pair], [pair, pair]], 1), 5)
ys = np.random.default_rng(1).normal(1.5, 1.5, (10_000, 1_000, 1))
f.filter_many(ys[:2], threads=2)
before = peak()
result = f.filter_many(ys, threads=2)
output = sum(a.nbytes for a in (result.x, result.P, result.log_likelihood)) / 2**20
print(peak() - before - output)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak of memory is read from /proc")
def test_memory_of_many_series(benchmark):
    # beyond input and output, of a process that does nothing else; the goal: below 50 MB
    command = [sys.executable, "-c", MEMORY]
    measured = benchmark.pedantic(
        lambda: subprocess.run(command, capture_output=True, text=True, check=True), rounds=1
    )
    megabytes = benchmark.extra_info["megabytes"] = float(measured.stdout)
    label = "memory of filter_many, 10,000 x 1,000, beyond input and output"
    print(f"\n| {label} | {engine.info().name} | {megabytes:.1f} MB | | | below 50 MB |")

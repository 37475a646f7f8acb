"""Measure and draw the cost of a step against nodes, dimensions and number of series.

Run from anywhere: ``python docs/_static/make_performance.py`` with the package and its test
requirements installed; takes some minutes, on a machine with nothing else to do.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
NODES = [0, 2, 5, 6, 10, 14, 22, 30, 46]
SIZES = [(1, 1), (2, 1), (2, 2), (4, 2), (6, 3), (8, 4)]
SERIES = [1, 10, 100, 1000, 10_000]
ROUNDS = 4


def fastest(work, units, seconds=0.2):
    """Nanoseconds per unit of the fastest of several runs."""
    work()
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times) / units * 1e9


def least(rounds):
    """Least of all numbers at the same place in nested lists and dictionaries."""
    first = rounds[0]
    if isinstance(first, dict):
        return {key: least([one[key] for one in rounds]) for key in first}
    if isinstance(first, list):
        return [least([one[k] for one in rounds]) for k in range(len(first))]
    return min(rounds)


def model(m, q):
    """Return a model of m states and q observations, all correlated."""
    from fuzzykf import CGOFMSModel, FuzzyMarkovLaw

    d = m + q
    root = np.random.default_rng(6).normal(size=(d, d)) * 0.3 + np.eye(d)
    S = root @ root.T
    pair = np.broadcast_to(np.block([[S, 0.3 * S], [0.3 * S, S]]), (2, 2, 2 * d, 2 * d))
    return CGOFMSModel(
        FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), [np.zeros(d), 2 * np.ones(d)], pair, m
    )


def measure_ours(n):
    """Nanoseconds per step of whole series on the engine in use: against nodes, and against sizes."""
    from fuzzykf import OFSRFilter

    small = model(1, 1)
    y = small.simulate(n, np.random.default_rng(0)).y
    nodes, sizes = [], []
    for F in NODES:
        f = OFSRFilter(small, F)
        nodes.append(fastest(partial(f.filter, y), n))
    for m, q in SIZES:
        f = OFSRFilter(model(m, q), 5)
        sizes.append(
            fastest(
                partial(f.filter, f.model.simulate(n, np.random.default_rng(0)).y), n
            )
        )
    return {"nodes": nodes, "sizes": sizes}


def measure_numpy():
    """Measure the same in a process that runs on NumPy."""
    code = "import json, make_performance as m; print(json.dumps(m.measure_ours(1000)))"
    environment = os.environ | {"FUZZYKF_ENGINE": "numpy"}
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=HERE,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(run.stdout)


def measure_filterpy():
    """Nanoseconds of predict and update of filterpy's Kalman filter, for each size."""
    from filterpy.kalman import KalmanFilter

    found = []
    for m, q in SIZES:
        f = KalmanFilter(m, q)
        f.F, f.H, f.Q, f.R = (
            0.9 * np.eye(m),
            np.eye(q, m),
            0.2 * np.eye(m),
            0.5 * np.eye(q),
        )
        zs = np.ones((50, q, 1))

        def work(f=f, zs=zs):
            for z in zs:
                f.predict()
                f.update(z)

        found.append(fastest(work, len(zs)))
    return found


def measure_many():
    """Nanoseconds per observation of many series of 1,000, with one thread and with two."""
    from fuzzykf import OFSRFilter

    f = OFSRFilter(model(1, 1), 5)
    ys = np.random.default_rng(1).normal(1.0, 1.5, (SERIES[-1], 1000, 1))
    return {
        threads: [
            fastest(partial(f.filter_many, ys[:s], threads=threads), s * 1000)
            for s in SERIES
        ]
        for threads in (1, 2)
    }


def main():
    import matplotlib.pyplot as plt

    from fuzzykf.engine.compiled import processor

    rounds = []
    for _ in range(
        ROUNDS
    ):  # in turn: the speed of a machine moves from one minute to the next
        ours = {}
        for name in reversed(processor.available_instructions()):
            processor.use_instructions(name)
            ours[name] = measure_ours(4000)
        processor.use_instructions(processor.available_instructions()[-1])
        rounds.append([ours, measure_many(), measure_filterpy()])
    ours, many, filterpy = least(rounds)
    ours["NumPy"] = measure_numpy()

    style = {"x86-64-v4": "o-", "x86-64-v3": "s--", "portable": "^-.", "NumPy": "D:"}
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(11.0, 3.8), layout="constrained"
    )
    for (name, values), color in zip(
        ours.items(), ("C0", "C1", "C2", "C4"), strict=False
    ):
        left.plot(
            NODES, values["nodes"], style[name], color=color, markersize=4, label=name
        )
        middle.plot(
            range(len(SIZES)),
            values["sizes"],
            style[name],
            color=color,
            markersize=4,
            label=name,
        )
    left.axhline(
        filterpy[0], color="0.3", linewidth=1, label="filterpy KalmanFilter(1, 1)"
    )
    middle.plot(
        range(len(SIZES)),
        filterpy,
        "x-",
        color="0.3",
        linewidth=1,
        label="filterpy KalmanFilter",
    )
    middle.set_xticks(range(len(SIZES)), [f"{m}, {q}" for m, q in SIZES])
    for threads, mark in ((1, "o-"), (2, "s--")):
        label = f"{threads} thread{'s' * (threads > 1)}"
        right.plot(
            SERIES,
            many[threads],
            mark,
            color=f"C{threads - 1}",
            markersize=4,
            label=label,
        )
    left.set(
        xlabel="nodes F between the hard values", title="OFSRFilter.filter, scalar"
    )
    middle.set(xlabel="states m, observations q", title="OFSRFilter.filter, F = 5")
    right.set(
        xlabel="series of 1,000 observations",
        title="OFSRFilter.filter_many, F = 5",
        xscale="log",
    )
    for axes in (left, middle):
        axes.set_yscale("log")
    for axes in (left, middle, right):
        axes.set_ylabel("nanoseconds per observation")
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    right.set_ylim(bottom=0.0)
    figure.savefig(HERE / "performance.png", dpi=140)
    print(json.dumps({"ours": ours, "filterpy": filterpy, "many": many}, indent=1))


if __name__ == "__main__":
    main()

"""Time of learning a state-space model, in runs of its filter over the same series.

Run with ``pytest tests/benchmarks/test_learning_state_space.py --benchmark-only -s``.  Both are measured in
one run, and the filter between two fits, so that other work on the machine counts for both.  Nothing passes
or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from fuzzykf import FadeLaw, SwitchingKalmanFilter, SwitchingStateSpace, engine

STEPS, ROUNDS = 2_000, 3


def model(low, high, process, bias, law):
    """The sensor of the studies: its noise fades, and a bias comes up."""
    R = np.array([low, high])[:, None, None] ** 2
    d = [[0.0], [bias]]
    return SwitchingStateSpace(law, F=0.95, H=1.0, Q=process**2, R=R, d=d, x0=[0.0], P0=0.92, mix="log")


LAWS = {"fades": FadeLaw.between(60, 20), "hard": [[0.97, 0.03], [0.03, 0.97]]}

FREE = {
    "two": {"R": "full"},
    "five": {"R": "full", "Q": "full", "d": "full"},
    "with the law": {"R": "full", "Q": "full", "d": "full", "law": True},
}


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("free", FREE)
def test_fit_in_runs_of_the_filter(kind, free, benchmark):
    truth = model(0.3, 3.0, 0.3, 2.0, LAWS["fades"])
    ys = truth.simulate(STEPS, np.random.default_rng(0)).y
    start = model(0.6, 1.5, 0.6, 1.0, LAWS[kind])
    f = SwitchingKalmanFilter(start, n_nodes=5)
    passes, fit = [], None

    def filtered():
        begun = time.perf_counter()
        f.filter(ys)
        return time.perf_counter() - begun

    def learned():
        nonlocal fit
        before = [filtered() for _ in range(10)]
        begun = time.perf_counter()
        fit = start.fit(ys, free=FREE[free], n_nodes=5)
        took = time.perf_counter() - begun
        passes.append(took / np.median(before + [filtered() for _ in range(10)]))

    benchmark.pedantic(learned, rounds=ROUNDS)
    found = {"passes": float(np.median(passes)), "free": fit.n_parameters, "engine": engine.info().name}
    benchmark.extra_info.update(found)
    print(
        f"\n{kind}, {fit.n_parameters} numbers free, {STEPS:,} steps: {found['passes']:.0f} runs of the "
        f"filter (goal: 1,500 for five; this was {found['engine']})"
    )

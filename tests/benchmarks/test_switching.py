"""Speed of the switching filters as ratios to filterpy, both measured in turn in one run.

Run with ``pytest tests/benchmarks --benchmark-only -s``; the ratios are printed and stored in
the extra information of each benchmark.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from fuzzykf import CGOMSMFilter, OFSRFilter

N, ROUNDS = 1000, 12


@pytest.fixture(scope="module")
def y():
    return np.random.default_rng(0).normal(1.5, 1.5, N)


def steps(f, values):
    step = f.step
    for z in values:
        step(z)


def predict_update(f, values):
    for z in values:
        f.predict()
        f.update(z)


def seconds(run):
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


@pytest.fixture
def compare(benchmark, y):
    """Time a run against filterpy's predict and update on the same observations, in turn."""
    values = y.tolist()
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.F[:], kalman.H[:], kalman.Q[:], kalman.R[:] = 0.9, 1.0, 0.2, 0.5
    baseline = []

    def setup():  # runs before each round
        baseline.append(seconds(lambda: predict_update(kalman, values)))

    def measure(run):
        benchmark.pedantic(run, setup=setup, rounds=ROUNDS, warmup_rounds=1)
        own, other = (1e6 * t / N for t in (benchmark.stats.stats.min, min(baseline)))
        found = {
            "us per observation": own,
            "us of filterpy": other,
            "times faster than filterpy": other / own,
        }
        benchmark.extra_info.update({name: round(value, 2) for name, value in found.items()})
        print(f"\n{benchmark.name}:", ", ".join(f"{value:.2f} {name}" for name, value in found.items()))

    return measure


@pytest.mark.benchmark(group="step, F = 5, scalar")
@pytest.mark.parametrize("verbs", [steps, predict_update])
def test_step(compare, fuzzy_model, y, verbs):
    # the goal: not slower than filterpy
    f, values = OFSRFilter(fuzzy_model, 5), y.tolist()
    f.step(0.0)
    compare(lambda: verbs(f, values))


@pytest.mark.benchmark(group="filter, F = 5, scalar")
def test_filter(compare, fuzzy_model, y):
    # the goal: at least 1.5 times faster than filterpy
    f = OFSRFilter(fuzzy_model, 5)
    compare(lambda: f.filter(y))


@pytest.mark.benchmark(group="filter, three hard regimes, two states")
def test_hard_filter(compare, hard_model, y):
    f = CGOMSMFilter(hard_model)
    compare(lambda: f.filter(y))


@pytest.mark.benchmark(group="filter, cost against F")
@pytest.mark.parametrize("n_nodes", [0, 2, 5, 10, 14, 15, 20, 40, 80])
def test_cost_against_nodes(compare, fuzzy_model, y, n_nodes):
    # (F + 2)^2 pairs; up to about ten nodes the calls cost more than the arithmetic
    f = OFSRFilter(fuzzy_model, n_nodes)
    compare(lambda: f.filter(y))

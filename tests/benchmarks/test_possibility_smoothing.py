"""The possibilistic smoother against its filter: ratios of one series in turn in one run, with quartiles.

Run with ``nox -s benchmarks -- -k possibility_smoothing -s``.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time
import warnings

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    engine,
)

WALK = np.array([[1.0, 1.0], [0.0, 1.0]])


def bent(noise, t_norm="product"):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x + 0.5 * np.sin(x),
        hx=lambda x: x,
        state=GaussianMembership(0.0, 1.0),
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 1.0),
        t_norm=t_norm,
    )


def plane(noise):
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 0.5),
        points=101,
    )
    est.F, est.H = WALK, [[1.0, 0.0]]
    return est


def boxes():
    est = FuzzyRelationEstimator(
        2,
        1,
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        process_noise=IntervalMembership([-0.01, -0.05], [0.01, 0.05]),
        measurement_noise=IntervalMembership(-0.5, 0.5),
    )
    est.F, est.H = WALK, [[1.0, 0.0]]
    return est


GAUSS = GaussianMembership(0.0, 0.1)
MODELS = {
    "scalar": lambda: bent(GAUSS),
    "scalar, Cauchy noise": lambda: bent(CauchyMembership(0.0, 0.3)),
    "scalar, minimum": lambda: bent(GAUSS, "min"),
    "plane": lambda: plane([None, GAUSS]),
    "plane, correlated noise": lambda: plane(GaussianMembership([0.0, 0.0], [[0.02, 0.03], [0.03, 0.1]])),
    "boxes": boxes,
}


def series(name):
    """Thirty measurements of a walk, or two hundred of a moving point with bounded noise."""
    rng = np.random.default_rng(1)
    if name != "boxes":
        return np.cumsum(0.3 * rng.standard_normal(30)) + rng.standard_normal(30)
    x, seen = np.zeros(2), []
    for _ in range(200):
        x = WALK @ x + rng.uniform([-0.01, -0.05], [0.01, 0.05])
        seen.append(x[0] + rng.uniform(-0.5, 0.5))
    return np.array(seen)


def spent(work):
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        work()
    return time.process_time() - start


@pytest.mark.parametrize("name", MODELS)
def test_smoothing_against_filtering(benchmark, name):
    make, zs = MODELS[name], series(name)

    def in_turn(rounds=13):
        times = [(spent(lambda: make().filter(zs)), spent(lambda: make().smooth(zs))) for _ in range(rounds)]
        return np.array(times[1:]).T  # warm

    filtered, smoothed = benchmark.pedantic(in_turn, rounds=1)
    low, middle, high = np.percentile(smoothed / filtered, [25, 50, 75])
    figures = {"times_the_filter": middle, "from": low, "to": high, "milliseconds": 1e3 * smoothed.min()}
    benchmark.extra_info.update({key: round(value, 3) for key, value in figures.items()})
    print(f"\n{engine.info()}\n{name}: " + ", ".join(f"{key} {value:.3g}" for key, value in figures.items()))

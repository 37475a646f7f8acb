"""Many series through one Kalman filter, beside simdkalman and beside one after the other.

Ratios of times measured in turn in one run, of warm works on one thread; nothing passes or fails by a clock::

    pytest tests/benchmarks/test_kalman_many.py --benchmark-only -s
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import KalmanFilter, engine

SERIES, LENGTH, ROUNDS = 10_000, 1_000, 3

_spec = importlib.util.spec_from_file_location("kalman_rows", Path(__file__).with_name("kalman_rows.py"))
rows = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(rows)


def make():
    """Position and velocity, of which the position is seen."""
    return KalmanFilter(2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]], Q=np.diag([0.1, 0.01]), R=1.0)


def looped(zs):
    """Return work: 100 of the series one after the other."""
    return lambda: [make().filter(series) for series in zs[:100]], 100 * LENGTH


@pytest.mark.parametrize("missing", [0.0, 0.05])
def test_many_series(benchmark, capsys, missing):
    rng = np.random.default_rng(1)
    zs = rng.normal(1.5, 1.5, (SERIES, LENGTH, 1))
    zs[rng.random(zs.shape) < missing] = np.nan
    f, steps = make(), SERIES * LENGTH
    works = {
        "x": (lambda: f.filter_many(zs, keep=["x"]), steps),
        "x, P": (lambda: f.filter_many(zs, keep=["x", "P"]), steps),
        "x, P in float32": (lambda: f.filter_many(zs, keep=["x", "P"], dtype=np.float32), steps),
        "x, P, log_likelihood": (lambda: f.filter_many(zs), steps),
        "filter, one by one": looped(zs),
    }
    try:
        import simdkalman
    except ImportError:
        pass
    else:
        peer = simdkalman.KalmanFilter(f.F, f.Q, f.H, 1.0)
        options = {"filtered": True, "smoothed": False, "observations": False}
        works["simdkalman"] = lambda: peer.compute(zs[..., 0], 0, **options), steps
    times = benchmark.pedantic(lambda: rows.measure(works, ROUNDS), rounds=1)
    peers = [name for name in ("simdkalman", "filter, one by one") if name in works]
    with capsys.disabled():
        print(
            f"\n{engine.info().name}, KalmanFilter(2, 1), {SERIES} series of {LENGTH}, {missing:.0%} missing"
        )
        for name in works.keys() - set(peers):
            for peer in peers:
                ratio = float(np.median(times[peer] / times[name]))
                benchmark.extra_info[f"{name} / {peer}"] = round(ratio, 2)
                print(
                    f"  {name:<22}{np.median(times[name]) * 1e9:>7.1f} ns a step, {ratio:>6.1f} times {peer}"
                )


@pytest.mark.skipif(importlib.util.find_spec("simdkalman") is None, reason="simdkalman is not installed")
def test_what_is_timed_is_the_same(benchmark):
    import simdkalman

    zs, f = np.random.default_rng(1).normal(size=(5, 30, 1)), make()
    peer = simdkalman.KalmanFilter(f.F, f.Q, f.H, 1.0)
    start = {"initial_value": np.zeros(2), "initial_covariance": f.F @ f.P @ f.F.T + f.Q}
    found = peer.compute(zs[..., 0], 0, filtered=True, smoothed=False, **start).filtered.states
    result = f.filter_many(zs)
    np.testing.assert_allclose(result.x, found.mean, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(result.P, found.cov, rtol=1e-10, atol=1e-12)
    benchmark.pedantic(lambda: None, rounds=1)

"""How much faster than filterpy: ratios of times measured alternately in one run.

Nothing here passes or fails by a clock.  Run with::

    pytest tests/benchmarks/test_kalman_speed.py --benchmark-only -s
"""

from __future__ import annotations

import statistics
import timeit

import numpy as np
import pytest

from fuzzykf import kalman

theirs = pytest.importorskip("filterpy.kalman")


def compare(benchmark, capsys, what, ours, reference, number, per_call=(1, 1)):
    """Time both alternately, report the median ratio, and let pytest-benchmark time ours."""
    pairs = []
    for _ in range(25):
        a, b = timeit.timeit(reference, number=number), timeit.timeit(ours, number=number)
        pairs.append((a / per_call[0] / number, b / per_call[1] / number))
    ratio = statistics.median(a / b for a, b in pairs)
    slow, fast = (1e6 * statistics.median(times) for times in zip(*pairs, strict=True))
    benchmark.extra_info.update(ratio=round(ratio, 2), filterpy_us=round(slow, 2), fuzzykf_us=round(fast, 2))
    with capsys.disabled():
        print(f"\n{what}: filterpy {slow:.2f} us, fuzzykf {fast:.2f} us, {ratio:.2f} times as fast")
    benchmark.pedantic(ours, rounds=5, iterations=number, warmup_rounds=1)


def make(module, n, m, seed=0):
    rng = np.random.default_rng(seed)
    f = module.KalmanFilter(n, m)
    f.F = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    f.F *= 0.9 / np.abs(np.linalg.eigvals(f.F)).max()
    f.H = rng.normal(size=(m, n))
    f.Q *= 1.0 + seed
    return f


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2), (6, 3)])
def test_step(benchmark, capsys, n, m):
    ours, reference = make(kalman, n, m), make(theirs, n, m)
    z = np.ones((m, 1))

    def step():
        reference.predict()
        reference.update(z)

    compare(benchmark, capsys, f"step ({n}, {m})", lambda: ours.step(z), step, 1000)
    np.testing.assert_allclose(ours.x, reference.x, rtol=1e-9)


@pytest.mark.parametrize("missing", [0.0, 0.1])
@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2)])
def test_many_series(benchmark, capsys, n, m, missing):
    # filterpy one series after another against all 1,000 at once, per step of one series; 50 of
    # filterpy's take about as long as all of ours, so that other work on the machine slows both
    ours, reference = make(kalman, n, m), make(theirs, n, m)
    rng = np.random.default_rng(1)
    zs = rng.normal(size=(1000, 20, m))
    zs[rng.random(zs.shape) < missing] = np.nan

    def some_series():
        for z in zs[:50].reshape(-1, m):
            reference.predict()
            reference.update(z)

    name = f"filter_many ({n}, {m}), {missing:.0%} missing"
    compare(benchmark, capsys, name, lambda: ours.filter_many(zs), some_series, 1, per_call=(1000, 20_000))


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2), (6, 3)])
def test_imm_of_three_modes(benchmark, capsys, n, m):
    M = np.full((3, 3), 0.05) + 0.85 * np.eye(3)
    ours, reference = (
        module.IMMEstimator([make(module, n, m, seed) for seed in range(3)], [1.0, 1.0, 1.0], M)
        for module in (kalman, theirs)
    )
    z = np.ones((m, 1))

    def step(imm):
        imm.predict()
        imm.update(z)

    compare(benchmark, capsys, f"IMM ({n}, {m}), 3 modes", lambda: step(ours), lambda: step(reference), 100)
    np.testing.assert_allclose(ours.x, reference.x, rtol=1e-8)

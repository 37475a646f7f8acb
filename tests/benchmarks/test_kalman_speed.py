"""How much faster than filterpy and pykalman: ratios of times measured in turn in one run.

Nothing here passes or fails by a clock.  A line gives the fastest round of each, which other work
on the machine disturbs least, their ratio, and the quartiles of the ratio over the
rounds.  Run with::

    pytest tests/benchmarks/test_kalman_speed.py --benchmark-only -s
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import engine, kalman

theirs = pytest.importorskip("filterpy.kalman")

_spec = importlib.util.spec_from_file_location("kalman_rows", Path(__file__).with_name("kalman_rows.py"))
rows = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(rows)

SIZES = [(2, 1), (4, 2), (6, 3)]
PEERS = ("filterpy", "pykalman")


def report(benchmark, capsys, what, works):
    """Print a line for each pair of one of ours and one of the peers."""
    times = benchmark.pedantic(lambda: rows.measure(works), rounds=1)
    with capsys.disabled():
        print(f"\n{engine.info().name}, {what}")
        for own in works.keys() - set(PEERS):
            for peer in (name for name in PEERS if name in works):
                slow, fast = times[peer], times[own]
                ratio, quartiles = slow.min() / fast.min(), np.quantile(slow / fast, [0.25, 0.75])
                benchmark.extra_info[f"{own}, {peer}"] = round(float(ratio), 2)
                print(
                    f"  {own:<18}{fast.min() * 1e6:>9.3f} us {peer:>9}{slow.min() * 1e6:>9.2f} us"
                    f"{ratio:>9.2f} ({quartiles[0]:.1f} to {quartiles[1]:.1f}) times as fast"
                )


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_step(benchmark, capsys, n, m):
    report(benchmark, capsys, f"KalmanFilter ({n}, {m})", rows.steps(n, m))


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_sequence(benchmark, capsys, n, m):
    report(benchmark, capsys, f"KalmanFilter ({n}, {m}), per step of a series", rows.sequences(n, m))


@pytest.mark.parametrize("missing", [0.0, 0.1])
@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2)])
def test_many_series(benchmark, capsys, n, m, missing):
    name = f"KalmanFilter ({n}, {m}), per step of 1,000 series, {missing:.0%} missing"
    report(benchmark, capsys, name, rows.many_series(n, m, missing))


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_imm_of_three_modes(benchmark, capsys, n, m):
    report(benchmark, capsys, f"IMM ({n}, {m}), 3 modes", rows.bank_steps(n, m))


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2)])
def test_imm_sequence(benchmark, capsys, n, m):
    report(benchmark, capsys, f"IMM ({n}, {m}), 3 modes, per step of a series", rows.bank_sequences(n, m))


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_what_is_timed_is_the_same(benchmark, n, m):
    ours, reference, zs = rows.make(kalman, n, m), rows.make(theirs, n, m), rows.observations(30, m)
    result = ours.filter(zs)
    means, covariances, *_ = reference.batch_filter(list(zs[..., None]))
    np.testing.assert_allclose(result.x, means[..., 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.P, covariances, rtol=1e-9, atol=1e-12)
    works = rows.sequences(n, m)
    if "pykalman" in works:
        means, covariances = works["pykalman"][0]()
        expected = rows.make(kalman, n, m).filter(rows.observations(2000, m)[:40])
        np.testing.assert_allclose(means, expected.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(covariances, expected.P, rtol=1e-9, atol=1e-12)
    banks = rows.make_bank(kalman, n, m), rows.make_bank(theirs, n, m)
    for z in zs[..., None]:
        banks[0].step(z)
        banks[1].predict()
        banks[1].update(z)
    np.testing.assert_allclose(banks[0].x, banks[1].x, rtol=1e-8)
    benchmark.pedantic(lambda: None, rounds=1)

"""Speed of switching state-space filters as ratios, measured in turn in one run: four states, seven nodes.

Run with ``pytest tests/benchmarks/test_state_space.py --benchmark-only -s``.  A line gives the fastest
round of each work, which other work on the machine disturbs least, and its ratio to the work it is held
against.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

import fuzzykf
from fuzzykf import IMMEstimator, SwitchingKalmanFilter, SwitchingStateSpace, engine

theirs = pytest.importorskip("filterpy.kalman")

K, N, ROUNDS = 7, 500, 15
SERIES = 1000
F = np.eye(4) + np.diag([1.0, 0.0, 1.0], 1)
H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
M = np.full((K, K), 0.05 / (K - 1)) + (0.95 - 0.05 / (K - 1)) * np.eye(K)


def filters(module):
    made = []
    for k in range(K):
        f = module.KalmanFilter(dim_x=4, dim_z=2)
        f.F, f.H, f.Q, f.R = F.copy(), H.copy(), 0.01 * (k + 1) * np.eye(4), (1.0 + k) * np.eye(2)
        made.append(f)
    return made


def steps(f, zs):
    step = f.step
    for z in zs:
        step(z)


def predict_update(f, zs):
    for z in zs:
        f.predict()
        f.update(z)


@pytest.fixture(scope="module")
def works():
    """Works by name: what runs, and how many observations it takes."""
    zs = np.random.default_rng(0).normal(size=(N, 2)).cumsum(axis=0)
    mu = np.full(K, 1 / K)
    bank, peer = IMMEstimator(filters(fuzzykf), mu, M), theirs.IMMEstimator(filters(theirs), mu, M)
    covariances = [(0.01 * (k + 1) * np.eye(4), (1.0 + k) * np.eye(2)) for k in range(K)]
    Q, R = (np.array(one) for one in zip(*covariances, strict=True))
    model = SwitchingStateSpace(M, F, H, Q, R, x0=np.zeros(4), P0=10.0 * np.eye(4))
    imm, gpb2 = (SwitchingKalmanFilter(model, method=method) for method in ("imm", "gpb2"))
    many = np.repeat(zs[None], SERIES, axis=0)
    return {
        "IMMEstimator.step": (lambda: steps(bank, zs), N),
        "filterpy IMM": (lambda: predict_update(peer, zs[:20]), 20),
        "imm step": (lambda: steps(imm, zs), N),
        "imm series": (lambda: imm.filter(zs), N),
        "imm many": (lambda: imm.filter_many(many), N * SERIES),
        "imm many, 2 threads": (lambda: imm.filter_many(many, threads=2), N * SERIES),
        "gpb2 step": (lambda: steps(gpb2, zs), N),
        "gpb2 series": (lambda: gpb2.filter(zs), N),
    }


@pytest.mark.parametrize(
    ("work", "base", "goal"),
    [
        ("imm step", "IMMEstimator.step", "at most .75"),
        ("imm series", "IMMEstimator.step", "at most .5"),
        ("imm step", "filterpy IMM", "at most 1 / 250"),
        ("gpb2 step", "imm step", "at most 7"),
        ("gpb2 series", "imm series", "at most 7"),
        ("imm many", "imm series", "at most 1 with threads"),
        ("imm many, 2 threads", "imm series", "at most 1"),
    ],
)
def test_ratio(benchmark, capsys, works, work, base, goal):
    times = {work: [], base: []}

    def in_turn():
        for name, found in times.items():
            run, n = works[name]
            start = time.perf_counter()
            run()
            found.append((time.perf_counter() - start) / n)

    rounds = 3 if "many" in work else ROUNDS
    benchmark.pedantic(in_turn, rounds=rounds, warmup_rounds=1)
    own, other = (1e6 * min(times[name][1:]) for name in (work, base))
    benchmark.extra_info["ratio"] = round(own / other, 4)
    with capsys.disabled():
        ratio = f"{own / other:.3f}" if own > 0.02 * other else f"1 / {other / own:.0f}"
        print(f"\n{engine.info().name}: {work} {own:.2f} us, {base} {other:.2f} us: {ratio} ({goal})")

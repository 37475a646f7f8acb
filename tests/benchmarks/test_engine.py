"""The compiled engine against filterpy and simdkalman, as one table of ratios.

Run with ``nox -s benchmarks -- -k engine -s``, or
``pytest tests/benchmarks/test_engine.py --benchmark-only -s -o addopts=--import-mode=importlib``.
All are measured in turn in one process; a row gives the fastest round of each, which other work
on the machine disturbs least, their ratio, and the quartiles of the ratio over the
rounds.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter, engine

N, ROUNDS, SERIES, LENGTH = 2000, 40, 2000, 500


def kalman(m, q):
    f = KalmanFilter(m, q)
    f.F, f.H, f.Q, f.R = 0.9 * np.eye(m), np.eye(q, m), 0.2 * np.eye(m), 0.5 * np.eye(q)
    return f


def predict_update(f, values):
    for z in values:
        f.predict()
        f.update(z)


def steps(f, values):
    step = f.step
    for z in values:
        step(z)


def vector_model():
    """Four states, two observations, correlated."""
    rng = np.random.default_rng(6)
    root = rng.normal(size=(6, 6)) * 0.3 + np.eye(6)
    S = root @ root.T
    pair = np.block([[S, 0.3 * S], [0.3 * S, S]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(6), np.ones(6)], np.broadcast_to(pair, (2, 2, 12, 12)), 4)


def instruction_sets():
    """Names of what the compiled engine can use here, and how to choose; None for NumPy."""
    if engine.info().name == "numpy":
        return {"numpy": lambda: None}
    from fuzzykf.engine.compiled import processor

    return {
        f"compiled, {name}": lambda name=name: processor.use_instructions(name)
        for name in processor.available_instructions()
    }


def many_with_simdkalman(ys):
    """Work of simdkalman's KalmanFilter (2, 1) on the same series, None where it is not installed."""
    try:
        import simdkalman
    except ImportError:
        return None
    f = simdkalman.KalmanFilter(
        state_transition=[[1.0, 1.0], [0.0, 1.0]],
        process_noise=np.diag([0.1, 0.01]),
        observation_model=[[1.0, 0.0]],
        observation_noise=1.0,
    )
    return lambda: f.compute(ys[..., 0], 0, filtered=True, smoothed=False)


def measure(works, rounds):
    """Seconds per unit of each work, (rounds,), all in turn in each round."""
    found = {name: [] for name in works}
    for _ in range(rounds + 1):
        for name, (work, units, prepare) in works.items():
            prepare()
            start = time.perf_counter()
            work()
            found[name].append((time.perf_counter() - start) / units)
    return {name: np.array(times[1:]) for name, times in found.items()}


def row(name, own, other, other_name):
    ratio, quartiles = other.min() / own.min(), np.quantile(other / own, [0.25, 0.75])
    print(
        f"{name:<60}{own.min() * 1e9:>8.0f} ns{other.min() * 1e9:>9.0f} ns"
        f"{ratio:>8.1f} ({quartiles[0]:.0f} to {quartiles[1]:.0f}) times {other_name}"
    )
    return float(ratio)


def test_table(benchmark, fuzzy_model):
    scalar, vector = OFSRFilter(fuzzy_model, 5), OFSRFilter(vector_model(), 5)
    y = fuzzy_model.simulate(N, np.random.default_rng(0)).y
    y4 = vector.model.simulate(N, np.random.default_rng(0)).y
    many = np.random.default_rng(1).normal(1.5, 1.5, (SERIES, LENGTH, 1))
    values, values4 = y[:, 0].tolist(), list(y4)
    few = 50
    imm = IMMEstimator([kalman(1, 1) for _ in range(7)], np.full(7, 1 / 7), np.full((7, 7), 1 / 7))
    kf1, kf4 = kalman(1, 1), kalman(4, 2)
    columns4 = [z[:, None] for z in y4[:few]]

    def nothing():
        pass

    works = {
        "KF(1, 1)": (lambda: predict_update(kf1, values[:few]), few, nothing),
        "KF(4, 2)": (lambda: predict_update(kf4, columns4), few, nothing),
        "IMM of 7": (lambda: predict_update(imm, values[:5]), 5, nothing),
    }
    sets = instruction_sets()
    for name, choose in sets.items():
        works |= {
            f"step, {name}": (lambda: steps(scalar, values), N, choose),
            f"filter, {name}": (lambda: scalar.filter(y), N, choose),
            f"step 4, {name}": (lambda: steps(vector, values4), N, choose),
            f"filter 4, {name}": (lambda: vector.filter(y4), N, choose),
        }
    times = benchmark.pedantic(lambda: measure(works, ROUNDS), rounds=1)

    print(f"\n\n{engine.info()}; F = 5; the best of {ROUNDS} rounds in turn")
    ratios = {}
    for name in sets:
        for label, own, other in (
            ("OFSRFilter.step", "step", "KF(1, 1)"),
            ("OFSRFilter.filter, per step", "filter", "KF(1, 1)"),
            ("OFSRFilter.step", "step", "IMM of 7"),
            ("m = 4, q = 2: OFSRFilter.step", "step 4", "KF(4, 2)"),
            ("m = 4, q = 2: OFSRFilter.filter, per step", "filter 4", "KF(4, 2)"),
        ):
            ratio = row(f"{label}, {name}", times[f"{own}, {name}"], times[other], other)
            ratios[f"{label}, {name}, {other}"] = round(ratio, 1)

    simdkalman = many_with_simdkalman(many)
    for name, choose in sets.items():
        both = {"own": (lambda: scalar.filter_many(many, threads=2), SERIES * LENGTH, choose)}
        if simdkalman is not None:
            both["simdkalman"] = (simdkalman, SERIES * LENGTH, nothing)
        found = measure(both, 3)
        label = f"filter_many, 2 threads, {SERIES} x {LENGTH}, {name}"
        if simdkalman is None:
            print(f"{label:<58}{np.median(found['own']) * 1e9:>9.0f} ns (simdkalman is not installed)")
        else:
            ratios[label] = row(label, found["own"], found["simdkalman"], "simdkalman (2, 1)")
    benchmark.extra_info.update(ratios)


@pytest.mark.parametrize("n_nodes", [0, 2, 5, 6, 10, 14, 20, 40])
def test_cost_against_nodes(benchmark, fuzzy_model, n_nodes):
    # (F + 2)^2 pairs, eight at a time: the cost jumps where a column of lanes is added
    f = OFSRFilter(fuzzy_model, n_nodes)
    y = fuzzy_model.simulate(N, np.random.default_rng(0)).y
    benchmark.pedantic(lambda: f.filter(y), rounds=ROUNDS, warmup_rounds=1)
    print(f"\nF = {n_nodes}: {benchmark.stats.stats.median / N * 1e9:.0f} ns per step")

"""Speed of the switching filters as ratios, to filterpy or to one another, measured in turn in one run.

Run with ``pytest tests/benchmarks --benchmark-only -s``; the ratios are printed and stored in
the extra information of each benchmark.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from fuzzykf import CGOFMSModel, CGOMSMFilter, FadeLaw, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.engine import selected as engine

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
def in_turn(benchmark):
    """Time a run against another on ``n`` observations, in turn."""

    def measure(run, other, n, name):
        others = []
        benchmark.pedantic(
            run, setup=lambda: others.append(seconds(other)), rounds=ROUNDS, warmup_rounds=1
        )  # the setup runs before each round
        own, base = (1e6 * t / n for t in (benchmark.stats.stats.min, min(others)))
        found = {"us per observation": own, f"us of {name}": base, f"times faster than {name}": base / own}
        benchmark.extra_info.update({key: round(value, 2) for key, value in found.items()})
        print(f"\n{benchmark.name}:", ", ".join(f"{value:.2f} {key}" for key, value in found.items()))

    return measure


@pytest.fixture
def compare(in_turn, y):
    """Time a run against filterpy's predict and update on the same observations, in turn."""
    values = y.tolist()
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.F[:], kalman.H[:], kalman.Q[:], kalman.R[:] = 0.9, 1.0, 0.2, 0.5
    return lambda run: in_turn(run, lambda: predict_update(kalman, values), N, "filterpy")


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


# --------------------------------------------------------------------------- gaps in steps

#: By nodes, states, observations.
GAPPY = {
    "7, 1, 1": lambda fuzzy, _: OFSRFilter(fuzzy, 5),
    "2, 1, 1": lambda fuzzy, _: OFSRFilter(fuzzy, 0),
    "3, 2, 1": lambda _, hard: CGOMSMFilter(hard),
    "7, 2, 2": lambda *_: filter_of("seven nodes", 2, 2),
}


@pytest.mark.benchmark(group="step(None) and the step after it, in complete steps")
@pytest.mark.parametrize("size", GAPPY)
def test_gaps_in_steps(in_turn, fuzzy_model, hard_model, size):
    # the goal: at most 60
    f = GAPPY[size](fuzzy_model, hard_model)
    z = np.full(f.dim_z, 0.3)
    steps(f, [z] * 3)

    def gaps():
        steps(f, [None, z] * N)

    in_turn(lambda: steps(f, [z] * N), gaps, N, "a gap and the step after it")


# --------------------------------------------------------------------------- gaps in series

HOLES = {
    "1 % missing": lambda n: np.flatnonzero(np.random.default_rng(1).random(n) < 0.01),
    "30 % missing, six in a row": lambda n: np.flatnonzero(np.arange(n) % 20 < 6),
}
KEPT = {
    "smooth": lambda f, values: f.smooth(values),
    "filter, nodes kept": lambda f, values: f.filter(values, keep_nodes=True),
}


@pytest.mark.benchmark(group="series with gaps of 20,000 rows, F = 5, scalar, against complete ones")
@pytest.mark.parametrize("holes", HOLES)
@pytest.mark.parametrize("work", KEPT)
def test_gaps_in_series(in_turn, fuzzy_model, work, holes):
    # the goal: at most 1.5 with 1 % missing
    f, n = OFSRFilter(fuzzy_model, 5), 20_000
    complete = fuzzy_model.simulate(n, np.random.default_rng(0)).y[:, 0]
    gappy = complete.copy()
    gappy[HOLES[holes](n)] = np.nan
    in_turn(lambda: KEPT[work](f, complete), lambda: KEPT[work](f, gappy), n, "with gaps")


# --------------------------------------------------------------------------- pairs of probability zero

RING = {(0, 1): (1 / 20, 10), (1, 2): (1 / 30, 8), (2, 3): (1 / 15, 12), (3, 0): (1 / 25, 6)}

#: By law: 49 pairs of 7 nodes, all positive; 24 of 144; 49 of 576.
LAWS = {
    "seven nodes": FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16),
    "fade": FadeLaw.between(40, 10),
    "ring": FadeLaw(4, RING, jumps={(0, 2): 0.002}),
}


def filter_of(law, m, q):
    """A filter with five cells of each fade, or five inner nodes."""
    K, d, rng = LAWS[law].n_classes, m + q, np.random.default_rng(1)
    covariances = np.empty((K, K, 2 * d, 2 * d))
    for i, j in np.ndindex(K, K):
        cross = 0.3 * np.eye(d) + 0.1 * rng.normal(size=(d, d))
        covariances[i, j] = np.block([[np.eye(d), cross.T], [cross, np.eye(d)]])
    return OFSRFilter(CGOFMSModel(LAWS[law], rng.normal(size=(K, d)), covariances, m), 5)


def with_gaps(values):
    values = values[:100].copy()
    values[3::9] = np.nan
    return values


WORKS = {
    "step": lambda f, values: steps(f, values.tolist() if values.ndim == 1 else list(values)),
    "filter": lambda f, values: f.filter(values),
    "filter_many": lambda f, values: f.filter_many(np.split(values, 20)),
    "smooth": lambda f, values: f.smooth(values),
    "filter with gaps": lambda f, values: f.filter(with_gaps(values)),
    "smooth with gaps": lambda f, values: f.smooth(with_gaps(values)),
}


@pytest.mark.benchmark(group="pairs of probability zero")
@pytest.mark.parametrize("work", WORKS)
@pytest.mark.parametrize("size", [(1, 1), (2, 2)], ids=["scalar", "two by two"])
@pytest.mark.parametrize("law", ["fade", "ring"])
def test_pairs_of_probability_zero(in_turn, y, law, size, work):
    # the goal: a step at most 1.8 times (fade, 1.2 on NumPy) and 3 times (ring) that of seven nodes
    values = y if size[1] == 1 else np.stack([y, y[::-1]], axis=1)
    few, dense = filter_of(law, *size), filter_of("seven nodes", *size)
    few.step(values[0])
    dense.step(values[0])
    n = 100 if "gaps" in work else N
    in_turn(lambda: WORKS[work](few, values), lambda: WORKS[work](dense, values), n, "seven nodes")


@pytest.mark.benchmark(group="pairs of probability zero")
@pytest.mark.parametrize("law", ["fade", "ring"])
def test_messages_of_pairs_of_probability_zero(in_turn, law):
    runs = []
    for name in (law, "seven nodes"):
        chain = LAWS[name].discretize(5)
        densities = np.random.default_rng(2).normal(size=(200, len(chain), len(chain)))
        runs.append((chain.initial, chain.transition, densities))
    few, dense = runs
    in_turn(
        lambda: engine.forward_backward(*few), lambda: engine.forward_backward(*dense), 200, "seven nodes"
    )

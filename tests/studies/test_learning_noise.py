"""What is learned of a fading sensor from its observations alone, and what a hard switch makes of the same.

The systems are those of the theory page on state-space models.  Their switch stays for a random number of
steps and moves by even ramps, which is no law of fades.  Starts are far from the truth, and the same for all
series.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from fuzzykf import FadeLaw, KnownSwitchFilter, SwitchingKalmanFilter, SwitchingStateSpace

pytestmark = pytest.mark.study

SEEDS, STEPS = 10, 2_000

#: Steps at 0 or 1: a geometric number of this mean, and so many more; and of a ramp.
DWELL, LEAST, LENGTH = 60, 5, 20

SYMMETRIC = [[0.97, 0.03], [0.03, 0.97]]


def ramps(n, rng):
    """Stays of random length; between them even steps, of which the last one arrives."""
    up, pieces, k = np.arange(1, LENGTH + 1) / LENGTH, [], int(rng.integers(2))
    forgotten = 10 * (DWELL + LEAST + LENGTH)  # so that a series begins anywhere in a stay or a ramp
    while sum(map(len, pieces)) < forgotten + n:
        stay = rng.geometric(1.0 / DWELL) + LEAST
        pieces += [np.full(stay, float(k)), up if k == 0 else 1.0 - up]
        k = 1 - k
    return np.concatenate(pieces)[forgotten : forgotten + n]


def noise(law, low=0.3, high=3.0, process=0.3):
    """A sensor whose noise fades between two levels."""
    R = np.array([low, high])[:, None, None] ** 2
    return SwitchingStateSpace(law, F=0.95, H=1.0, Q=process**2, R=R, x0=[0.0], P0=0.92, mix="log")


def sun(law, low=0.2, high=0.6, process=0.3, bias=2.0):
    """A sensor in the sun: its gain fades, which is known, while a bias and more noise come up."""
    R = np.array([low, high])[:, None, None] ** 2
    gain, offset = [[[1.0]], [[0.4]]], [[0.0], [bias]]
    return SwitchingStateSpace(law, F=0.95, H=gain, Q=process**2, R=R, d=offset, x0=[0.0], P0=0.92, mix="log")


class Case(NamedTuple):
    """A system, from where and from how many starts it is learned, what is free beside noise and law."""

    make: object
    begin: dict
    n_starts: int
    more: dict
    truth: dict


NOISES = {"low": 0.3, "high": 3.0, "process": 0.3}

CASES = {
    "noise": Case(noise, {"low": 0.6, "high": 1.5, "process": 0.6}, 1, {}, NOISES),
    "sun": Case(
        sun,
        {"low": 0.4, "high": 0.4, "process": 0.6, "bias": 1.0},
        8,  # from the first alone, whose classes have one noise, the bias was found in none of the ten
        {"d": [[False], [True]]},
        {"low": 0.2, "high": 0.6, "process": 0.3, "bias": 2.0},
    ),
}

ESTIMATES = {"low": "R[0][0, 0]", "high": "R[1][0, 0]", "process": "Q[0, 0]", "bias": "d[1][0]"}


def learned(case, law, seed):
    """Standard deviations, and the bias, that are learned from one series."""
    rng = np.random.default_rng([list(CASES).index(case), seed])
    make, begin, n_starts, more, truth = CASES[case]
    r = ramps(STEPS, rng)
    form = make(FadeLaw.between(DWELL, LENGTH)).form
    ys = form.simulate(np.stack([1.0 - r, r], axis=1), r, rng).y
    free = {"Q": "full", "R": "full", "law": True} | more
    fit = make(law, **begin).fit(ys, free=free, n_nodes=5, n_starts=n_starts, rng=rng)
    assert fit.converged
    found = {name: fit.estimates[ESTIMATES[name]] for name in truth}
    return {name: value if name == "bias" else value**0.5 for name, value in found.items()}


LAWS = {"fades": FadeLaw.between(30, 10), "hard": SYMMETRIC}


@pytest.fixture(scope="module")
def found():
    """Estimates (seeds,) by system, switch and name."""
    result = {}
    for case in CASES:
        for kind, law in LAWS.items():
            rows = [learned(case, law, seed) for seed in range(SEEDS)]
            result[case, kind] = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return result


def test_levels_of_noise_are_found(found, write_table):
    header = [
        "System",
        "Parameter",
        "Truth",
        "Fades: median",
        "range",
        "within",
        "Hard: median",
        "range",
        "within",
    ]
    rows = []
    for case, (*_, truth) in CASES.items():
        for name, value in truth.items():
            row = [case, ESTIMATES[name] if name == "bias" else f"√{ESTIMATES[name]}", f"{value:g}"]
            margin = 0.1 if name == "bias" else 0.2
            for kind in LAWS:
                one = found[case, kind][name]
                near = int((np.abs(one / value - 1.0) <= margin).sum())
                row += [f"{np.median(one):.3g}", f"{one.min():.3g} to {one.max():.3g}"]
                row.append(f"{near} of {SEEDS} ({100 * margin:.0f} %)")
            rows.append(row)
    write_table("learning_noise", header, rows)
    for name, value in NOISES.items():
        one = found["noise", "fades"][name]
        assert (np.abs(one / value - 1.0) <= 0.2).sum() >= 9, name
        assert np.median(one) == pytest.approx(value, rel=0.05), name
    assert (np.abs(found["sun", "fades"]["bias"] / 2.0 - 1.0) <= 0.1).sum() >= 9


@pytest.mark.parametrize(("make", "most"), [(noise, 0.03), (sun, 0.15)], ids=["noise", "sun"])
def test_the_likelihood_misses_little_a_step(make, most):
    """Against the sum over all paths of a hard switch; means over 20 series of twelve observations."""
    n, T = 12, np.array([[0.8, 0.2], [0.2, 0.8]])
    model, paths = make(T), np.array(list(product([0, 1], repeat=n)))
    log_p = np.log(0.5) + np.log(T[paths[:, :-1], paths[:, 1:]]).sum(axis=1)
    missed = []
    for seed in range(20):
        y = model.simulate(n, np.random.default_rng(seed)).y
        known = KnownSwitchFilter(model).filter_many(
            np.repeat(y[None], len(paths), axis=0), r=paths.astype(float), keep=("log_likelihood",)
        )
        exact = np.logaddexp.reduce(log_p + known.log_likelihood.sum(axis=1))
        missed.append(abs(SwitchingKalmanFilter(model).filter(y).log_likelihood.sum() - exact) / n)
    assert np.mean(missed) < most

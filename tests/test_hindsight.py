"""A smoother warns where the states move by more than the model admits, and only there."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from fuzzykf import FadeLaw, SwitchingKalmanFilter, SwitchingStateSpace
from fuzzykf.errors import HindsightWarning
from fuzzykf.hindsight import FEWEST, hindsight_ratio

#: A speed that is seen by a sensor whose offset fades.
PARTS = {"F": 0.98, "Q": 0.2**2, "H": 1.0, "R": 0.7**2, "d": [[0.0], [5.0]], "x0": [0.0], "P0": 1.0}
HARD = [[59 / 60, 1 / 60], [1 / 60, 59 / 60]]


def faded(n=300, seed=5):
    """A series of it, from one class to the other and back over 20 steps each."""
    model = SwitchingStateSpace(FadeLaw.between(60, 20), **PARTS)
    return model, model.simulate(n, np.random.default_rng(seed))


def warns(f, zs):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = f.smooth(zs)
    assert all(one.category is HindsightWarning for one in caught)
    return result, bool(caught)


@pytest.mark.parametrize("method", ["imm", "gpb2"])
def test_it_warns_of_a_hard_switch_where_a_sensor_fades(method) -> None:
    counts, errors = {"fades": 0, "hard": 0}, {"fades": np.zeros(2), "hard": np.zeros(2)}
    for seed in range(12):
        model, truth = faded(seed=seed)
        for name, law in (("fades", model), ("hard", SwitchingStateSpace(HARD, **PARTS))):
            f = SwitchingKalmanFilter(law, method=method)
            smoothed, warned = warns(f, truth.y)
            counts[name] += warned
            errors[name] += [((one.x - truth.x) ** 2).mean() for one in (f.filter(truth.y), smoothed)]
    assert counts["hard"] >= 6  # in the others the sensor has not faded, or not for long
    assert counts["fades"] <= 1
    assert errors["hard"][1] > errors["hard"][0]
    assert errors["fades"][1] < 0.8 * errors["fades"][0]


def test_of_few_observations_nothing_is_said() -> None:
    hard = SwitchingKalmanFilter(SwitchingStateSpace(HARD, **PARTS))
    truth = faded()[1]
    with pytest.warns(HindsightWarning, match="worse than filtering"):
        hard.smooth(truth.y)
    assert not warns(hard, truth.y[: FEWEST - 1])[1]


def test_states_that_hardly_move_are_not_worth_a_word() -> None:
    # with next to no noise the state is known from its start on: what comes later moves it by chance
    model = SwitchingStateSpace(
        [[0.8, 0.2], [0.3, 0.7]], [[[0.5]], [[0.6]]], 1.0, 1e-6, 1.0, x0=[0.0], P0=1.0
    )
    f = SwitchingKalmanFilter(model)
    assert not any(warns(f, model.simulate(300, np.random.default_rng(seed)).y)[1] for seed in range(10))


def test_the_ratio_is_one_of_what_the_model_admits_and_has_no_units() -> None:
    rng = np.random.default_rng(0)
    P, Ps = np.tile(np.diag([4.0, 0.0]), (500, 1, 1)), np.tile(np.diag([1.0, 0.0]), (500, 1, 1))
    x = np.zeros((500, 2))
    xs = np.stack([np.sqrt(3.0) * rng.normal(size=500), np.zeros(500)], axis=1)  # the second is known
    ratio = hindsight_ratio(x, P, xs, Ps)
    assert ratio == pytest.approx(1.0, abs=0.2)
    assert hindsight_ratio(1e6 * x, 1e12 * P, 1e6 * xs, 1e12 * Ps) == pytest.approx(ratio, rel=1e-12)
    assert hindsight_ratio(x, P, 2.0 * xs, Ps) == pytest.approx(4.0 * ratio, rel=1e-12)


def test_nothing_that_moves_and_nothing_that_is_learned() -> None:
    x, P = np.zeros((60, 1)), np.ones((60, 1, 1))
    assert hindsight_ratio(x, P, x, P) == 0.0
    assert hindsight_ratio(x, P, x + 1.0, P) == np.inf
    assert hindsight_ratio(x, 0.0 * P, x + 1.0, P) == 0.0

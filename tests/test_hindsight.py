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


@pytest.mark.parametrize("method", ["imm", "gpb2"])
def test_it_warns_of_a_hard_switch_where_a_sensor_fades(method) -> None:
    model, truth = faded()
    hard = SwitchingKalmanFilter(SwitchingStateSpace(HARD, **PARTS), method=method)
    with pytest.warns(HindsightWarning, match="worse than what is filtered"):
        smoothed = hard.smooth(truth.y)
    filtered = hard.filter(truth.y)
    assert np.mean((smoothed.x - truth.x) ** 2) > np.mean((filtered.x - truth.x) ** 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        soft = SwitchingKalmanFilter(model, method=method)
        smoothed = soft.smooth(truth.y)
        hard.smooth(truth.y[: FEWEST - 1])  # of few observations nothing is said
    assert np.mean((smoothed.x - truth.x) ** 2) < 0.8 * np.mean((soft.filter(truth.y).x - truth.x) ** 2)


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

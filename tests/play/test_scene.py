"""What the page shows is drawn from the model, and moves as the sliders do."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import KalmanFilter
from fuzzykf.errors import ParameterError
from fuzzykf.play.scene import BOUNDS, PERSISTENCE, Settings, scene


def errors(**settings):
    return [one["error"] for one in scene(Settings(**settings))["filters"]]


def test_without_contrast_all_are_the_kalman_filter() -> None:
    found = scene(Settings(contrast=0.0, n=150))
    kf = KalmanFilter(1, 1, x=[0.0], P=1.0, F=PERSISTENCE, H=[[1.0]], Q=1.0 - PERSISTENCE**2, R=0.25)
    expected = []
    for k, y in enumerate(found["observation"]):
        if k:  # the first observation belongs to the initial law
            kf.predict()
        kf.update(y)
        expected.append([kf.x.item(), np.sqrt(kf.P.item())])
    for one in found["filters"]:
        np.testing.assert_allclose(np.c_[one["mean"], one["std"]], expected, atol=3e-5)  # 5 digits are shown


def test_the_kalman_filter_takes_the_switch_for_noise_of_its_variance() -> None:
    # at 0 and at 1 a third of the time each, and for the last third anywhere between
    variance = 2 / 3 * 1 / 4 + 1 / 3 * 1 / 12
    Q, R = 1.0 - PERSISTENCE**2, 0.25 + 16.0 * variance
    P = 1.0
    for _ in range(200):  # Riccati's equation
        prior = PERSISTENCE**2 * P + Q
        P = prior - prior**2 / (prior + R)
    single = scene(Settings(dwell=40, length=20, contrast=4.0, noise=0.5))["filters"][2]
    assert single["switch"] is None
    assert single["std"][-1] == pytest.approx(np.sqrt(P), rel=2e-3)  # a fade has nine nodes


def test_the_picture_shows_the_equation_of_the_observation() -> None:
    found = scene(Settings(contrast=4.0, noise=0.05))
    r = np.array(found["switch"])
    assert {0.0, 1.0} < set(r)
    noise = np.array(found["observation"]) - np.array(found["state"]) - 4.0 * r
    assert 0.04 < noise.std() < 0.06


def at_rest(**settings):
    """Share of the steps in which the switch is at 0 or 1."""
    return np.mean(np.isin(scene(Settings(n=1000, **settings))["switch"], [0.0, 1.0]))


def test_each_slider_moves_what_it_is_called() -> None:
    start = scene(Settings())
    assert at_rest(dwell=10) < at_rest(dwell=100)
    assert at_rest(length=4) > at_rest(length=80)
    quiet, loud = errors(noise=0.1, contrast=0.0), errors(noise=3.0, contrast=0.0)
    assert max(quiet) < 0.2 < 0.5 < min(loud)
    spread = [np.std(scene(Settings(contrast=c))["observation"]) for c in (0.0, 10.0)]
    assert spread[0] < spread[1]
    assert scene(Settings()) == start
    assert scene(Settings(seed=1)) != start


def test_whoever_knows_that_the_switch_fades_is_best_on_average() -> None:
    means = np.mean([errors(seed=seed, dwell=20, length=40) for seed in range(4)], axis=0)
    assert means[0] < min(means[1:])


@pytest.mark.parametrize("corner", [0, 1])
def test_the_ends_of_all_sliders_are_finite(corner) -> None:
    found = scene(Settings(**{name: ends[corner] for name, ends in BOUNDS.items()}))
    for one in found["filters"]:
        assert np.isfinite([*one["mean"], *one["std"], one["error"]]).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"dwell": "4"}, "dwell: got 4, expected a number from 5 to 200"),
        ({"length": "nan"}, "length: got nan, expected"),
        ({"noise": "loud"}, "noise: got 'loud', expected a number"),
        ({"seed": "-1"}, "seed: got -1, expected"),
        ({"seed": "0.5"}, "seed: got '0.5', expected a number"),
        ({"n": "1000000"}, "n: got 1,000,000, expected at most 5,000"),
        ({"fade": "3"}, "'fade': no such setting, expected one of dwell, length, "),
    ],
)
def test_settings_that_are_no_good_are_named(given, message) -> None:
    with pytest.raises(ParameterError, match=message):
        Settings.from_text(given)

"""The rocket experiment of the 2001 paper: its equations, its noises, and a few launches."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2001_rocket import PRINTED, ROCKET, dynamics, jacobian, launch


def test_on_the_ground_the_first_step_is_that_of_the_printed_numbers() -> None:
    # Thrust 4000 * 100 / 20100, gravity 9.8, no drag.
    moved = dynamics(np.zeros(2), 0)
    assert moved == pytest.approx([0.0, 2.0 * (4000.0 * 100.0 / 20100.0 - 9.8)])


def test_drag_and_gravity_at_altitude() -> None:
    h, v, k = 50_000.0, 1000.0, 40
    mass = 20100.0 - 100.0 * 2.0 * k
    expected = v + 2.0 * (
        4000.0 * 100.0 / mass - 9.8 * 6.37e6 / (6.37e6 + h) - 0.5 * v**2 * 1.21 * 1.0 * 0.3 / mass
    )
    assert dynamics(np.array([h, v]), k) == pytest.approx([h + 2.0 * v, expected])


def test_the_jacobian_is_the_derivative() -> None:
    x, k, step = np.array([50_000.0, 1000.0]), 40, np.array([10.0, 0.1])
    for j in range(2):
        d = np.eye(2)[j] * step
        assert jacobian(x, k)[:, j] == pytest.approx(
            (dynamics(x + d, k) - dynamics(x - d, k)) / (2 * step[j]), rel=1e-6
        )


def test_many_states_move_at_once() -> None:
    x = np.random.default_rng(0).uniform(0, 1000, (4, 5, 2))
    assert dynamics(x, 3)[2, 1] == pytest.approx(dynamics(x[2, 1], 3))


@pytest.mark.parametrize(("noise", "w_cut", "v_cut"), [("cut", 1, 1), ("measurement", 1, 0), ("both", 0, 0)])
def test_noises_are_cut_where_they_are_said_to_be(noise, w_cut, v_cut) -> None:
    rng = np.random.default_rng(1)
    w, v = [], []
    for _ in range(20):
        states, z, _ = launch(rng, noise)
        before = np.vstack([np.zeros(2), states[:-1]])
        moved = np.array([dynamics(x, k) for k, x in enumerate(before)])
        assert states[:, 0] == pytest.approx(moved[:, 0])  # noise enters the velocity alone
        w.append(states[:, 1] - moved[:, 1])
        v.append(z - states[:, 0])
    for values, scale, cut in ((np.concatenate(w), 15.0, w_cut), (np.concatenate(v), 1000.0, v_cut)):
        inside = np.mean(np.abs(values) <= scale * (1 + 1e-9))
        assert inside == 1.0 if cut else 0.4 < inside < 0.65  # half of a Cauchy law is within its scale


def test_the_printed_tables_have_the_wins_that_the_text_counts() -> None:
    won = {what: sum(b < a for a, b in zip(*columns, strict=True)) for what, columns in PRINTED.items()}
    assert won == {"altitude": 14, "velocity": 10}


@pytest.fixture(scope="module")
def outcome():
    """Two launches per noise, the fewest that have an error."""
    return perform(ROCKET, runs=2, seed=1)


def test_the_fuzzy_estimator_withstands_outliers_of_the_measurement(outcome) -> None:
    values = outcome.samples["measurement"]
    assert np.median(values["fuzzy altitude"]) < np.median(values["EKF altitude"])


def test_it_does_not_withstand_process_noise_outside_of_its_universe(outcome) -> None:
    values = outcome.samples["both"]
    assert np.median(values["fuzzy altitude"]) > np.median(values["EKF altitude"])


def test_the_grid_does_not_decide_who_wins() -> None:
    # One launch of the same noise on 101 nodes per axis instead of 51: what changes is small
    # against the lead over the extended Kalman filter.
    piece = dict(ROCKET.pieces["measurement"])
    coarse, fine = (
        ROCKET.run(np.random.default_rng(5), 1, **(piece | {"points": points})) for points in (51, 101)
    )
    assert np.array_equal(coarse["states"], fine["states"])
    for what in ("altitude", "velocity"):
        lead = fine[f"EKF {what}"] - fine[f"fuzzy {what}"]
        assert lead > 0.0
        assert abs(coarse[f"fuzzy {what}"] - fine[f"fuzzy {what}"]) < 0.1 * lead


def test_the_picture_shows_the_three_noises(outcome, tmp_path) -> None:
    assert write(outcome, tmp_path)[2].stat().st_size > 10_000
    figure = outcome.experiment.draw(outcome.samples)
    assert len(figure.axes) == 6
    assert figure.axes[3].get_ylabel() == "of the fuzzy estimator (m²)"

"""The interval experiment of the 2001 paper: its estimators against the package's, run by run."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import ExtendedKalmanFilter, FuzzyRelationEstimator, IntervalMembership
from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2001_intervals import (
    INTERVALS,
    PRINTED,
    SYSTEMS,
    extended_kalman_filter,
    interval_estimator,
    simulate,
)

TABLES = list(SYSTEMS)


@pytest.mark.parametrize("table", TABLES)
def test_the_intervals_are_those_of_the_fuzzy_relation_estimator(table) -> None:
    system = SYSTEMS[table]
    x, z = simulate(system, np.random.default_rng(0), 2, 40)
    centres = interval_estimator(system, z, 10)
    for run in range(2):
        est = FuzzyRelationEstimator(
            1,
            1,
            fx=system.f,
            hx=system.g,
            state=IntervalMembership(0.0, 0.0),
            process_noise=IntervalMembership(-system.w, system.w),
            measurement_noise=IntervalMembership(-0.5, 0.5),
        )
        assert est.representation == "interval"
        for k in range(40):
            est.predict()
            if k % 10 == 9:
                est.update(z[k, run])
            assert centres[k, run] == pytest.approx(est.x.item(), rel=1e-9, abs=1e-9)
            lower, upper = est.membership.lower.item(), est.membership.upper.item()
            assert lower - 1e-9 <= x[k, run] <= upper + 1e-9  # the bound is guaranteed


@pytest.mark.parametrize("table", TABLES)
def test_the_extended_kalman_filter_is_the_package_s(table) -> None:
    system = SYSTEMS[table]
    _, z = simulate(system, np.random.default_rng(1), 1, 40)
    ekf = ExtendedKalmanFilter(
        1, 1, fx=system.f, hx=system.g, x=[0.0], P=[[0.0]], Q=[[(2 * system.w) ** 2 / 12]], R=[[1 / 12]]
    )
    found = extended_kalman_filter(system, z, 10)
    for k in range(40):
        ekf.predict()
        if k % 10 == 9:
            ekf.update(z[k])
        # central differences are not exact: of a cubic they are off by the square of the step
        assert found[k, 0] == pytest.approx(ekf.x.item(), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("table", ["Table 2", "Table 4"])
def test_from_zero_the_ekf_has_no_gain_where_the_measurement_is_a_cube(table) -> None:
    _, z = simulate(SYSTEMS[table], np.random.default_rng(2), 3, 100)
    assert (extended_kalman_filter(SYSTEMS[table], z, 10) == 0.0).all()


def test_the_printed_tables_have_the_wins_that_the_text_counts() -> None:
    won = [sum(b < a for a, b in zip(*PRINTED[table], strict=True)) for table in TABLES]
    assert won == [15, 15, 16, 18]
    assert all(len(column) == 20 for columns in PRINTED.values() for column in columns)


@pytest.fixture(scope="module")
def outcome():
    """The experiment at its quick size, which is fast."""
    return perform(INTERVALS, runs=INTERVALS.quick_runs, seed=3)


def test_the_printed_energies_are_those_of_the_mean_error(outcome) -> None:
    rows = {row.quantity: row for row in outcome.rows}
    for table in ("Table 1", "Table 3", "Table 4"):
        for name in ("EKF", "fuzzy"):
            row = rows[f"{table}, ½ (mean error)²: energies of the {name}, median"]
            assert row.verdict == "reproduced with a correction"
            assert rows[f"{table}, ½ e'e: energies of the {name}, median"].verdict == "not reproduced"


def test_under_true_energy_the_kalman_filter_holds_its_own_on_the_linear_system(outcome) -> None:
    values = outcome.samples["Table 1"]
    assert np.mean(values["fuzzy true"] < values["EKF true"]) < 0.55
    assert np.mean(values["fuzzy mean"] < values["EKF mean"]) > 0.7


def test_shares_of_won_runs_come_with_an_interval(outcome) -> None:
    row = next(row for row in outcome.rows if row.quantity.endswith("won by the fuzzy estimator"))
    lower, upper = row.interval
    assert lower < row.ours < upper
    assert upper - lower == pytest.approx(2 * 1.96 * row.standard_error, rel=0.01)


def test_the_picture_shows_the_four_tables(outcome, tmp_path) -> None:
    assert write(outcome, tmp_path)[2].stat().st_size > 10_000
    figure = outcome.experiment.draw(outcome.samples)
    assert [axes.get_title()[:7] for axes in figure.axes] == TABLES

"""The mean of the time of day is that of the rows learned on, and needs to know the time."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzykfError, compare_models
from fuzzykf.comparison import Clock, LearningPart, candidate, compare, prepare
from fuzzykf.comparison.candidates.daily import LearnedDay
from fuzzykf.times import read_times


def hours(n, step=3600):
    return np.datetime64("2014-01-06T00:00", "s") + np.arange(n) * np.timedelta64(step, "s")


def part(n, seed=0, step=3600):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 1)) + np.sin(np.arange(n)[:, None] / 24 * 2 * np.pi)
    return LearningPart(x=x, y=rng.normal(size=(n, 1)), clock=Clock.of(read_times(hours(n, step))))


def test_mean_and_spread_are_those_of_the_hours_of_either_kind_of_day() -> None:
    # Oracle: the rows of each cell, by hand; ten weeks have twenty days off.
    here = part(70 * 24)
    here.x[[5, 29], 0] = np.nan
    learned = LearnedDay(here)
    assert learned.description == "means of each 1 h of working days and of others"
    clock = Clock.of(read_times(hours(72 * 24)[-48:]))  # a Monday and a Tuesday
    there = learned.at(clock)
    found = there.restore(here.y[:0], np.zeros((48, 1)))
    k = np.arange(70 * 24)
    for hour in (0, 5, 23):
        cell = here.x[(k % 24 == hour) & (k // 24 % 7 < 5), 0]
        cell = cell[~np.isnan(cell)]
        assert found.mean[hour, 0] == pytest.approx(cell.mean())
        assert found.std[hour, 0] == pytest.approx(cell.std(ddof=1))
    np.testing.assert_array_equal(found.mean[:24], found.mean[24:])
    assert found.log_likelihood is None
    step = there.stepper()
    np.testing.assert_array_equal([step(z) for z in np.zeros((48, 1))], found.mean)


@pytest.mark.parametrize(
    ("n", "step", "told"),
    [
        (20 * 24, 3600, "means of each 1 h of working days and of others"),
        (8 * 24, 3600, "means of each 1 h"),
        (8 * 288, 300, "means of each 1 h of working days and of others"),
        (40 * 288, 300, "means of each 5 minutes of working days and of others"),
    ],
)
def test_cells_are_as_fine_as_there_are_rows_for(n, step, told) -> None:
    assert LearnedDay(part(n, step=step)).description == told


def test_without_times_or_rows_enough_it_is_refused() -> None:
    here = part(30 * 24)
    without = LearningPart(x=here.x, y=here.y)
    with pytest.raises(FuzzykfError, match="needs times, and the rows have none"):
        LearnedDay(without)
    with pytest.raises(FuzzykfError, match="needs 5 rows of it at least, and there are times of day with 4"):
        LearnedDay(part(4 * 24))
    with pytest.raises(FuzzykfError, match="needs the times of the 3 rows to restore"):
        LearnedDay(here).restore(here.y, here.y[:3])
    night = here.clock.hour < 8.0
    times = read_times(here.clock.times.clock[night])
    half = LearningPart(x=here.x[night], y=here.y[night], clock=Clock.of(times))
    with pytest.raises(FuzzykfError, match="no row to learn on has the time of day of 2014-01-06T08:00:00"):
        LearnedDay(half).at(here.clock[:9]).restore(here.y[:0], here.y[:9])


def test_it_is_compared_where_times_are_known_and_left_out_elsewhere() -> None:
    here = part(30 * 24)
    x, y, rng = here.x[:, 0], here.y[:, 0], np.random.default_rng(0)
    named = {"candidates": ["line", "daily-profile"], "n_folds": 2, "n_resamples": 100}
    found = compare_models(x, y, rng, time=hours(len(x)), **named)
    assert found.best == "daily-profile"
    missing = compare_models(x, y, rng, **named)
    assert "needs times" in missing.failures["daily-profile"]
    task = prepare(x, y, time=hours(len(x)))
    table = compare(task, rng, methods=named["candidates"], n_folds=2, n_resamples=100)
    assert table.scores[1].rmse == pytest.approx(found.scores[1].rmse)
    assert table.scores[1].title == candidate("daily-profile").title == "mean of the time of day"

"""What the methods start from is learned on the first part, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.comparison import ClockSwitch, prepare, quantile_switch
from fuzzykf.errors import ParameterError, ShapeError

HOUR = np.timedelta64(3600, "s")


def hours(n, start="2014-01-06T00:00"):  # a Monday
    return np.datetime64(start, "s") + np.arange(n) * HOUR


def series(n=400, seed=1):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n), rng.normal(size=n)


# ------------------------------------------------------------------ the profile


def test_the_profile_does_not_see_the_part_to_be_compared() -> None:
    time = hours(600)
    x, y = series(600)
    task = prepare(x, y, time=time, profile=True, train=0.5)
    changed = x.copy()
    changed[300:] += 50.0
    other = prepare(changed, y, time=time, profile=True, train=0.5)
    np.testing.assert_array_equal(task.profile.means_, other.profile.means_)
    np.testing.assert_allclose(other.state[300:] - task.state[300:], 50.0)
    assert task.switch_source == other.switch_source


def test_a_time_of_day_without_a_row_to_learn_on_is_an_error_that_names_it() -> None:
    # The learning part ends before the first weekend.
    time = hours(300)
    x, y = series(300)
    with pytest.raises(ParameterError, match="2014-01-11T00:00:00 is a day off, and the learning part"):
        prepare(x, y, time=time, profile=True, train=0.34)


def test_a_given_working_day_counts_more_than_the_calendar() -> None:
    time = hours(480)
    x, y = series(480)
    task = prepare(x, y, time=time, workday=np.zeros(480, dtype=bool), profile=True)
    assert np.isnan(task.profile.means_[1]).all()
    assert np.isfinite(task.profile.means_[0]).all()


# ------------------------------------------------------------------ the switch


def test_the_clock_switch_of_the_paper() -> None:
    # Section VII of the 2020 paper: 0 from 1 to 5 at night, 1 from 1 to 5 in the afternoon.
    switch = ClockSwitch(low=1.0, high=13.0)
    r = switch(hours(24))
    expected = [
        0.125,
        *[0.0] * 5,
        *[k / 8 for k in range(1, 8)],
        *[1.0] * 5,
        *[k / 8 for k in range(7, 1, -1)],
    ]
    np.testing.assert_allclose(r, expected)


def test_the_clock_switch_finds_the_lowest_and_the_highest_hours() -> None:
    time = hours(24 * 30)
    values = -np.cos(2 * np.pi * (np.arange(24 * 30) % 24 - 4) / 24)  # lowest at 4, highest at 16
    assert ClockSwitch.learn(time, values) == ClockSwitch(low=2.0, high=14.0)


def test_the_plateaus_leave_an_hour_in_between_even_where_the_extremes_are_neighbours() -> None:
    # Lowest from 0 to 4; the highest four hours would be those from 4 to 8.
    values = np.tile([0.0, 0, 0, 0, 6, 9, 9, 9, 9, 0, *[5.0] * 13, 9.0], 20)
    assert ClockSwitch.learn(hours(480), values) == ClockSwitch(low=0.0, high=5.0)


def test_the_clock_switch_comes_from_the_state_before_its_profile_is_taken_away() -> None:
    time = hours(24 * 30)
    rng = np.random.default_rng(2)
    x = -np.cos(2 * np.pi * (np.arange(720) % 24 - 4) / 24) + 0.1 * rng.normal(size=720)
    task = prepare(x, rng.normal(size=720), time=time, profile=True, switch="clock")
    assert task.switch_source.startswith("the clock, 0 from 2:00 to 6:00, 1 from 14:00 to 18:00")


def test_the_switch_is_hidden_unless_a_rule_is_asked_for() -> None:
    task = prepare(*series(), time=hours(400))
    assert task.switch is None
    assert task.switch_source == "hidden, learned with each model"


def test_the_quantiles_of_the_observation_can_make_the_switch() -> None:
    x, y = series(1000)
    task = prepare(x, y, train=0.5, switch="quantiles")
    low, high = np.quantile(y[:500], [0.2, 0.8])
    assert quantile_switch(y[:500]) == pytest.approx((low, high))
    np.testing.assert_array_equal(task.switch == 0.0, y <= low)
    np.testing.assert_array_equal(task.switch == 1.0, y >= high)
    assert task.switch_source.startswith("the observation")


def test_daily_rows_have_no_time_of_day_for_the_clock() -> None:
    x, y = series()
    time = np.datetime64("2014-01-01", "s") + np.arange(400) * np.timedelta64(86400, "s")
    with pytest.raises(ParameterError, match="no row between 1:00 and 5:00"):
        prepare(x, y, time=time, switch="clock")


# ------------------------------------------------------------------ bad input


@pytest.mark.parametrize("train", [0.0, 1.0, -0.2, 1.5, np.nan])
def test_a_share_outside_0_to_1_is_refused(train) -> None:
    with pytest.raises(ParameterError, match=r"train: got .* expected a share between 0 and 1"):
        prepare(*series(), train=train)


@pytest.mark.parametrize(("n", "train"), [(30, 0.6), (400, 0.1), (400, 0.95)])
def test_too_few_rows_on_either_side_are_refused(n, train) -> None:
    with pytest.raises(ParameterError, match=f"of {n} rows are .* expected at least 100 and 50"):
        prepare(*series(n), train=train)


def test_a_constant_column_is_refused() -> None:
    x, y = series()
    with pytest.raises(ParameterError, match="observation: it is 3 in all 200 rows"):
        prepare(x, np.full(400, 3.0))
    with pytest.raises(ParameterError, match="state: it is 3 in all 200 rows"):
        prepare(np.full(400, 3.0), y)


def test_an_observation_that_mostly_stands_still_cannot_make_the_switch() -> None:
    x, y = series()
    with pytest.raises(ParameterError, match="are both 0, so they cannot make the switch"):
        prepare(x, np.where(np.arange(400) % 10 == 0, y, 0.0), switch="quantiles")


def test_what_needs_a_time_says_so() -> None:
    with pytest.raises(ParameterError, match="profile: the time of day needs a column of times"):
        prepare(*series(), profile=True)
    with pytest.raises(ParameterError, match="switch: the time of day needs a column of times"):
        prepare(*series(), switch="clock")
    with pytest.raises(ParameterError, match="switch: got 'sun'"):
        prepare(*series(), switch="sun")


def test_columns_of_different_length_are_refused() -> None:
    x, y = series()
    with pytest.raises(ShapeError, match="observation: got shape"):
        prepare(x, y[:-1])
    with pytest.raises(ShapeError, match="time: got shape"):
        prepare(x, y, time=hours(399))

"""Standardising and the daily profile: learned where `fit` was called, applied anywhere, undone exactly."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fuzzykf import compare_models
from fuzzykf.comparison import prepare, quantile_switch
from fuzzykf.comparison.scores import block_length
from fuzzykf.errors import ParameterError, SequenceError, ShapeError
from fuzzykf.preprocessing import DailyProfile, Standardizer, hour_of_day, is_constant

HOUR = np.timedelta64(3600, "s")


def hours(n, start="2014-01-06T00:00"):  # a Monday
    return np.datetime64(start, "s") + np.arange(n) * HOUR


# ------------------------------------------------------------------ standardising


def test_the_training_part_becomes_standard_and_the_rest_follows_it() -> None:
    rng = np.random.default_rng(0)
    train, rest = rng.normal(3.0, 2.0, (500, 2)), rng.normal(9.0, 5.0, (20, 2))
    standardizer = Standardizer().fit(train)
    standard = standardizer.transform(train)
    np.testing.assert_allclose(standard.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(standard.std(axis=0), 1.0)
    # Oracle: the definition, with the moments of the training part.
    np.testing.assert_allclose(standardizer.transform(rest), (rest - train.mean(axis=0)) / train.std(axis=0))


@settings(max_examples=50, deadline=None)
@given(values=arrays(float, (7, 2), elements=st.floats(-1e6, 1e6)))
def test_standardising_is_undone_exactly(values) -> None:
    standardizer = Standardizer().fit(np.arange(12.0).reshape(6, 2) ** 2)
    back = standardizer.inverse_transform(standardizer.transform(values))
    np.testing.assert_allclose(back, values, rtol=1e-12, atol=1e-9)


def test_missing_values_do_not_count_and_stay_missing() -> None:
    values = np.array([1.0, np.nan, 3.0])
    standardizer = Standardizer().fit(values)
    assert (standardizer.mean_, standardizer.scale_) == (2.0, 1.0)
    np.testing.assert_array_equal(standardizer.transform(values), [-1.0, np.nan, 1.0])


def test_a_pandas_object_keeps_its_index_and_its_names() -> None:
    series = pd.Series([1.0, 2.0, 4.0], index=pd.date_range("2014", periods=3, freq="D"), name="load")
    found = Standardizer().fit_transform(series)
    assert found.index.equals(series.index)
    assert found.name == "load"
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": [3.0, 5.0]}, index=[7, 8])
    pd.testing.assert_frame_equal(
        Standardizer().fit_transform(frame), pd.DataFrame({"a": [-1.0, 1.0], "b": [-1.0, 1.0]}, index=[7, 8])
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([2.0, 2.0, 2.0], "column 0 is 2 in every row"),
        ([np.nan, np.nan], "column 0 holds no number"),
        ([1.0, np.inf], "row 1 is infinite"),
        ([["a"], ["b"]], "expected an array of numbers"),
        (np.zeros((2, 2, 2)), r"got shape \(2, 2, 2\)"),
    ],
)
def test_what_has_no_scale_is_refused(values, message) -> None:
    with pytest.raises(ParameterError, match=message):
        Standardizer().fit(values)


NOISE = np.random.default_rng(0).normal(size=400)

#: Columns that vary, by their level and by how much.
VARYING = {
    "a level and noise": (1e7, 5e-4),
    "a clock of 10 MHz": (1e7, 1e-2),
    "coordinates from the middle of the earth": (6378137.0, 1e-3),
    "seconds since 1970": (1.4e9, 1e-3),
    "a negative level": (-1e12, 1.0),
    "the last digits": (1.0, 1e-14),
    "a small unit": (0.0, 1e-200),
    "a large unit": (1e150, 1e160),
    "near the end of the range": (0.0, 1e306),
}


@pytest.mark.parametrize("name", VARYING)
def test_columns_that_vary_are_not_constant_and_have_a_scale(name) -> None:
    level, size = VARYING[name]
    column = level + size * NOISE
    # Oracle: the deviations from the level as they were rounded, which are exact, in a unit of their own.
    rounded = (column - level) / size
    standardizer = Standardizer().fit(column)
    np.testing.assert_allclose(standardizer.scale_ / size, rounded.std(), rtol=1e-9)
    np.testing.assert_allclose(
        (standardizer.mean_ - level) / size, rounded.mean(), atol=1e-15 * abs(level) / size + 1e-9
    )
    standard = standardizer.transform(column)
    assert abs(standard.std() - 1.0) < 0.05
    assert not is_constant(column)
    assert prepare(column, NOISE).n_train == prepare(NOISE, column).n_train == 200
    assert np.diff(quantile_switch(column)) > 0.0
    assert block_length(np.convolve(column, np.ones(20) / 20, "valid")) > 1


CONSTANT = {
    "one number": np.full(400, 2.5),
    "nothing": np.zeros(400),
    "rounding": np.where(NOISE > 0, 0.3, 0.1 + 0.2),
    "rounding at a level": np.where(NOISE > 0, 1e7, np.nextafter(1e7, 2e7)),
}


@pytest.mark.parametrize("name", CONSTANT)
def test_columns_that_vary_by_rounding_alone_are_constant(name) -> None:
    column = CONSTANT[name]
    assert is_constant(column)
    with pytest.raises(ParameterError, match=r"column 0 is .* in every row.*, so it has no scale"):
        Standardizer().fit(column)
    with pytest.raises(ParameterError, match=r"state: it is .* in all 200 rows to learn on"):
        prepare(column, NOISE)
    with pytest.raises(ParameterError, match=r"observation: it is .* in all 200 rows to learn on"):
        prepare(NOISE, column)
    with pytest.raises(ParameterError, match=r"are both .*, so they cannot make the switch"):
        quantile_switch(column)
    assert block_length(column) == 1
    with pytest.raises(ParameterError, match=r"x: column 1 is .* in every row"):
        compare_models(
            np.column_stack([NOISE, column]), NOISE, np.random.default_rng(0), candidates=["regression"]
        )


def test_two_states_are_compared_each_in_its_own_scale() -> None:
    # A coordinate in metres and one in the smallest of units count alike.
    y = NOISE + np.random.default_rng(1).normal(size=400)
    x = np.column_stack([6378137.0 + 1e-3 * NOISE, 1e-200 * NOISE])
    options = {"candidates": ["regression"], "n_folds": 1, "n_resamples": 100}
    (score,) = compare_models(x, y, np.random.default_rng(0), **options).scores
    plain = np.column_stack([NOISE, NOISE])
    (expected,) = compare_models(plain, y, np.random.default_rng(0), **options).scores
    assert score.rmse == pytest.approx(expected.rmse, rel=1e-4)


def test_other_columns_than_in_training_are_refused() -> None:
    with pytest.raises(ShapeError, match="got 2 columns, expected 1"):
        Standardizer().fit([1.0, 2.0]).transform(np.zeros((3, 2)))


@pytest.mark.parametrize("step", [Standardizer(), DailyProfile()])
def test_nothing_is_transformed_before_something_was_learned(step) -> None:
    arguments = (hours(1),) if isinstance(step, DailyProfile) else ()
    for verb in (step.transform, step.inverse_transform):
        with pytest.raises(SequenceError, match="call fit first"):
            verb([1.0], *arguments)


# ------------------------------------------------------------------ the profile


def test_the_profile_is_the_mean_of_each_hour_and_kind_of_day() -> None:
    # Oracle: two weeks of a series that is 100 on working days plus the hour, which it must return.
    time = hours(14 * 24)
    workday = np.is_busday(time.astype("datetime64[D]"))
    hour = np.arange(14 * 24) % 24
    values = 100.0 * workday + hour + np.where(np.arange(14 * 24) < 7 * 24, -1.0, 1.0)
    profile = DailyProfile().fit(values, time)
    np.testing.assert_allclose(profile.at(time), 100.0 * workday + hour)
    np.testing.assert_allclose(
        profile.transform(values, time), np.where(np.arange(14 * 24) < 7 * 24, -1.0, 1.0)
    )


def test_taking_the_profile_away_is_undone_by_adding_it_on_other_days_too() -> None:
    rng = np.random.default_rng(1)
    profile = DailyProfile().fit(rng.normal(size=240), hours(240))
    later = hours(100, "2014-03-03T00:00")
    values = rng.normal(size=100)
    there = profile.transform(values, later)
    assert np.abs(there - values).max() > 0.1
    np.testing.assert_allclose(profile.inverse_transform(there, later), values)
    # The kind of day counts both ways.
    days_off = np.zeros(100, dtype=bool)
    with pytest.raises(ParameterError, match="is a day off"):
        DailyProfile().fit(values[:24], later[:24]).inverse_transform(there, later, days_off)


def test_a_given_working_day_counts_more_than_the_calendar() -> None:
    profile = DailyProfile().fit(np.arange(48.0), hours(48), np.zeros(48, dtype=bool))
    assert np.isnan(profile.means_[1]).all()
    assert np.isfinite(profile.means_[0]).all()


def test_a_time_of_day_without_a_row_to_learn_on_is_an_error_that_names_it() -> None:
    profile = DailyProfile().fit(np.arange(48.0), hours(48))  # Monday and Tuesday
    with pytest.raises(ParameterError, match="2014-01-11T00:00:00 is a day off, and the learning part"):
        profile.at(hours(200))


@pytest.mark.parametrize(("minutes", "slots"), [(15, 96), (17, 24), (180, 8), (60 * 24, 1), (60 * 48, 24)])
def test_the_slot_is_the_step_between_rows_where_that_divides_the_day(minutes, slots) -> None:
    time = np.datetime64("2014-01-06", "s") + np.arange(2000) * np.timedelta64(60 * minutes, "s")
    assert DailyProfile().fit(np.ones(2000), time).means_.shape == (2, slots)


def test_a_slot_can_be_given_and_has_to_divide_the_day() -> None:
    assert DailyProfile(slot=6.0).fit(np.ones(48), hours(48)).means_.shape == (2, 4)
    for slot in (0.0, -1.0, 5.0, np.nan, np.inf):
        with pytest.raises(ParameterError, match="expected a number of hours that divides 24"):
            DailyProfile(slot=slot)


@settings(max_examples=50, deadline=None)
@given(parts=st.integers(1, 1440), second=st.integers(0, 86399))
def test_every_second_of_a_day_is_in_the_slot_that_holds_it(parts, second) -> None:
    # Oracle: integer arithmetic, free of rounding.
    if 86400 % parts:
        parts = 1
    profile = DailyProfile(slot=24.0 / parts)
    profile.slot_, profile.means_ = profile.slot, np.tile(np.arange(float(parts)), (2, 1))
    moment = np.datetime64("2014-01-06", "s") + np.array([second]) * np.timedelta64(1, "s")
    assert profile.at(moment) == second * parts // 86400


@pytest.mark.parametrize("minutes", [1, 5, 12, 15, 30, 90])
def test_every_slot_begins_where_it_should(minutes) -> None:
    # Rounding must not push the first second of a slot into the one before.
    parts = 1440 // minutes
    profile = DailyProfile(slot=24.0 / parts)
    profile.slot_, profile.means_ = profile.slot, np.tile(np.arange(float(parts)), (2, 1))
    starts = np.datetime64("2014-01-06", "s") + np.arange(parts) * np.timedelta64(60 * minutes, "s")
    np.testing.assert_array_equal(profile.at(starts), np.arange(parts))


def test_columns_have_a_profile_each_and_gaps_do_not_count() -> None:
    values = np.column_stack([np.arange(48) % 24, 10.0 * (np.arange(48) % 24)])
    values[30, 1] = np.nan
    profile = DailyProfile().fit(values, hours(48))
    assert profile.means_.shape == (2, 24, 2)
    np.testing.assert_allclose(profile.at(hours(24)), values[:24])
    assert np.isnan(profile.transform(values, hours(48))[30, 1])
    with pytest.raises(ShapeError, match="got 1 columns, expected 2"):
        profile.transform(values[:, 0], hours(48))


def test_pandas_brings_its_own_times_as_the_clock_on_the_spot_shows_them() -> None:
    index = pd.date_range("2014-01-06", periods=48, freq="h", tz="Australia/Brisbane")
    series = pd.Series(np.arange(48.0) % 24, index=index, name="load")
    profile = DailyProfile().fit(series)
    found = profile.transform(series)
    assert found.index.equals(index)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    np.testing.assert_array_equal(profile.means_[1], np.arange(24.0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0],), "time: missing"),
        (([1.0, 2.0], hours(3)), r"time: got shape \(3,\)"),
        (([1.0, 2.0], [1, 2]), "time: got numbers of type int64"),
        (([1.0, 2.0], ["noon", "night"]), "time: row 0 is 'noon', expected a time as in"),
        (([1.0, 2.0], np.array(["2014", "NaT"], dtype="datetime64[s]")), "time: row 1 is not a time"),
        (([1.0, 2.0], hours(2), [True]), r"workday: got shape \(1,\)"),
        (([1.0, 2.0], hours(2), [0, 2]), "workday: row 1 is 2, expected True or False"),
        (([1.0, np.inf], hours(2)), "row 1 is infinite"),
    ],
)
def test_what_is_no_series_with_times_is_refused_and_nothing_learned(arguments, message) -> None:
    profile = DailyProfile()
    with pytest.raises(ParameterError, match=message):
        profile.fit(*arguments)
    assert not hasattr(profile, "means_")


def test_the_hour_of_the_day_counts_seconds() -> None:
    assert hour_of_day(np.array(["2014-01-31T23:59:59"], dtype="datetime64[s]")) == 86399 / 3600


# ------------------------------------------------------------------ names

FRAME = pd.DataFrame(
    {"t": np.arange(72.0) % 7, "h": 100.0 + np.arange(72.0) % 5},
    index=pd.date_range("2014-01-06", periods=72, freq="h"),
)
CUBE = xr.DataArray(
    FRAME.to_numpy(), coords={"time": FRAME.index, "of": ["t", "h"]}, dims=("time", "of"), name="met"
)
STEPS = {"Standardizer": Standardizer, "DailyProfile": DailyProfile}

#: What else may hold the columns that were learned: what is given, and how its columns are called after it.
SAME = {
    "another order": (FRAME[["h", "t"]], ["t", "h"]),
    "columns beside them": (FRAME.assign(load=7.0)[["load", "h", "t"]], ["t", "h"]),
    "columns without names": (FRAME.set_axis([0, 1], axis=1), [0, 1]),
    "a DataArray in another order": (CUBE.isel(of=[1, 0]), None),
    "an array": (FRAME.to_numpy(), None),
}


def verbs(step, values):
    """What both verbs return, times given where the step asks for them and ``values`` has none."""
    time = {"time": FRAME.index} if isinstance(step, DailyProfile) and isinstance(values, np.ndarray) else {}
    return [verb(values, **time) for verb in (step.transform, step.inverse_transform)]


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("given", SAME)
def test_columns_are_taken_by_the_names_that_were_learned_and_arrays_by_position(kind, given) -> None:
    values, names = SAME[given]
    step = STEPS[kind]().fit(FRAME)
    for found, expected in zip(verbs(step, values), verbs(step, FRAME), strict=True):
        np.testing.assert_array_equal(np.asarray(found), expected.to_numpy())
        if names is not None:
            assert list(found.columns) == names
            assert found.index.equals(FRAME.index)
    again = pickle.loads(pickle.dumps(step))
    np.testing.assert_array_equal(np.asarray(verbs(again, values)[0]), verbs(step, FRAME)[0].to_numpy())
    assert "names_=('t', 'h')" in repr(again)


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("learned", [FRAME["t"], FRAME[["t"]], FRAME["t"].rename(None)])
def test_a_series_goes_by_position_whatever_it_is_called(kind, learned) -> None:
    step = STEPS[kind]().fit(learned)
    plain = FRAME["t"].rename("load")
    for found, expected in zip(verbs(step, plain), verbs(step, learned), strict=True):
        assert found.name == "load"
        np.testing.assert_array_equal(found.to_numpy(), expected.to_numpy().reshape(-1))


#: What is learned on, what is refused after it, and what the message says.
STRANGE = {
    "a name that is missing": (FRAME, FRAME[["t"]], "got no column 'h'; .* on t, h, and the columns are t: "),
    "strange names": (FRAME, FRAME.set_axis(["a", "b"], axis=1), r"the columns are a, b.*values\.to_numpy"),
    "a column of another name": (FRAME["t"], FRAME[["h"]], "got no column 't'; .*, and the columns are h"),
    "a DataArray": (FRAME, CUBE.assign_coords(of=["t", "x"]), "got no column 'h'; .*the columns are t, x"),
    "a name twice": (FRAME, FRAME[["t", "h", "h"]], "2 columns are called 'h', expected one"),
    "too many columns": (FRAME, FRAME.assign(x=1.0).to_numpy(), "got 3 columns, expected 2"),
    "too few columns": (FRAME, FRAME["t"], "got 1 columns, expected 2"),
}


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("case", STRANGE)
def test_what_lacks_a_column_that_was_learned_is_refused_with_what_is_there(kind, case) -> None:
    learned, values, message = STRANGE[case]
    step = STEPS[kind]().fit(learned)
    time = {"time": FRAME.index} if kind == "DailyProfile" else {}
    for verb in (step.transform, step.inverse_transform):
        with pytest.raises(ParameterError, match=f"values: .*{message}"):
            verb(values, **time)


@pytest.mark.parametrize("kind", STEPS)
def test_two_columns_of_one_name_are_not_learned_and_what_was_known_stays(kind) -> None:
    step = STEPS[kind]().fit(FRAME)
    before = {name: np.array(value) for name, value in vars(step).items()}
    with pytest.raises(ParameterError, match="values: 2 columns are called 't', expected one"):
        step.fit(FRAME[["t", "t"]])
    for name, value in before.items():
        np.testing.assert_array_equal(vars(step)[name], value)


# ------------------------------------------------------------------ clocks

NAIVE = pd.date_range("2014-01-06", periods=48, freq="h")
MELBOURNE = NAIVE.tz_localize("Australia/Melbourne")


@pytest.mark.parametrize(
    ("learned", "given"),
    [(NAIVE, MELBOURNE), (MELBOURNE, NAIVE), (NAIVE, ["2014-01-06T00:00+01:00"])],
    ids=["naive, then a zone", "a zone, then naive", "naive, then offsets"],
)
def test_times_with_a_zone_and_without_one_do_not_go_together(learned, given) -> None:
    profile = DailyProfile().fit(np.arange(48.0) % 24, learned)
    for verb in (profile.transform, profile.inverse_transform):
        with pytest.raises(ParameterError, match=r"time: got times with.*, but the profile was learned on"):
            verb(np.zeros(len(given)), given)
    with pytest.raises(ParameterError, match="nobody knows which clock is meant"):
        profile.at(given)


def test_times_of_another_zone_are_what_their_own_clock_shows() -> None:
    profile = DailyProfile().fit(np.arange(48.0) % 24, MELBOURNE)
    berlin = pd.date_range("2014-02-03T08:00", periods=3, freq="h", tz="Europe/Berlin")
    np.testing.assert_array_equal(profile.at(berlin), [8.0, 9.0, 10.0])
    again = pickle.loads(pickle.dumps(profile))
    with pytest.raises(ParameterError, match="times without a zone"):
        again.at(NAIVE)


def test_a_coordinate_of_times_is_taken_as_an_index_is() -> None:
    values = pd.Series(np.arange(72.0) % 24 + np.arange(72.0), FRAME.index)
    array = xr.DataArray(values.to_numpy(), coords={"time": FRAME.index}, dims="time")
    profile, expected = DailyProfile().fit(array), DailyProfile().fit(values)
    np.testing.assert_array_equal(profile.means_, expected.means_)
    np.testing.assert_array_equal(profile.transform(array), expected.transform(values).to_numpy())
    with pytest.raises(ParameterError, match="time: missing"):
        DailyProfile().fit(array.drop_vars("time"))

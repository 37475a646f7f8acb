"""Inputs of a clock are what clock and calendar on the spot show, under names that say what they are."""

from __future__ import annotations

import copy
import math
import pickle
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOMSModel, InputColumns, WindowFeatures, clock_inputs
from fuzzykf.clock import factors_of, is_of_clock, made_inputs
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.times import read_times

#: Four days over a weekend and new year, every 90 minutes.
MOMENTS = [datetime(2015, 12, 31, 0, 30) + timedelta(minutes=90 * k) for k in range(64)]
NAMES = ["clock_sin1", "clock_cos1", "clock_sin2", "clock_cos2", "clock_workday"]
PRODUCTS = ["clock_workday * clock_sin1", "clock_workday * clock_cos1"]


def told_by(moment: datetime) -> list[float]:
    """Oracle: what a clock with hands and a calendar with weeks show."""
    turn = 2 * math.pi * (60 * moment.hour + moment.minute) / 1440
    waves = [math.sin(turn), math.cos(turn), math.sin(2 * turn), math.cos(2 * turn)]
    day = 1.0 if moment.isoweekday() <= 5 else 0.0
    begin, end = datetime(moment.year, 1, 1), datetime(moment.year + 1, 1, 1)
    season = 2 * math.pi * ((moment - begin) / (end - begin))
    return [*waves, day, day * waves[0], day * waves[1], math.sin(season), math.cos(season)]


def test_the_columns_are_what_clock_and_calendar_show() -> None:
    found = clock_inputs(MOMENTS, harmonics=2, workday=True, day_of_year=True)
    assert found.columns == (*NAMES, *PRODUCTS, "clock_year_sin", "clock_year_cos")
    np.testing.assert_allclose(found.to_numpy(), [told_by(one) for one in MOMENTS], atol=1e-12)


def test_without_more_said_there_are_three_harmonics_of_the_day_alone() -> None:
    found = clock_inputs(MOMENTS)
    assert found.columns == tuple(f"clock_{wave}{k}" for k in (1, 2, 3) for wave in ("sin", "cos"))


def test_the_hour_is_that_on_the_spot_and_the_index_stays() -> None:
    index = pd.date_range("2014-10-26", periods=6, freq="h", tz="Europe/Berlin", name="when")
    hours = np.array([0, 1, 2, 2, 3, 4])  # clocks are put back
    for time in (index, index.to_series(), pd.DataFrame({"load": range(6)}, index), pd.Series(1.0, index)):
        found = clock_inputs(time, harmonics=1)
        assert found.index.equals(index)
        np.testing.assert_allclose(found["clock_sin1"], np.sin(2 * np.pi * hours / 24), atol=1e-15)


def test_times_in_a_column_keep_the_index_of_their_table() -> None:
    table = pd.DataFrame({"when": ["2014-01-31T06:00", "2014-01-31T18:00"]}, index=["a", "b"])
    found = clock_inputs(table["when"], harmonics=1)
    assert list(found.index) == ["a", "b"]
    np.testing.assert_array_equal(found, [[1.0, 0.0], [-1.0, 0.0]])


def test_working_days_that_are_told_are_called_otherwise_than_those_of_the_calendar() -> None:
    days = np.arange(64) % 3 == 0
    found = clock_inputs(MOMENTS, harmonics=1, workday=days)
    assert found.columns[2:] == ("workday", "workday * clock_sin1", "workday * clock_cos1")
    np.testing.assert_array_equal(found["workday"], days)
    np.testing.assert_array_equal(found["workday * clock_cos1"], days * found["clock_cos1"])
    assert clock_inputs(MOMENTS, workday=False).columns == clock_inputs(MOMENTS).columns
    assert clock_inputs(MOMENTS, harmonics=0, workday=True).columns == ("clock_workday",)


def test_a_harmonic_that_rows_are_too_far_apart_to_show_is_exactly_constant() -> None:
    hours = np.datetime64("2014-01-01", "s") + np.arange(48) * np.timedelta64(1, "h")
    finest = clock_inputs(hours, harmonics=12)["clock_sin12"]
    np.testing.assert_array_equal(finest, np.zeros(48))
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 48))
    with pytest.raises(ParameterError, match="inputs: 'clock_sin12' is constant"):
        CGOMSModel.fit(x, y, inputs=clock_inputs(hours, harmonics=12), n_starts=1, max_iter=1)


def test_names_make_the_columns_again() -> None:
    found = clock_inputs(MOMENTS, workday=True, day_of_year=True)
    assert all(map(is_of_clock, found.columns))
    again = made_inputs(found.columns[::-1], read_times(MOMENTS), {})
    np.testing.assert_array_equal(again, found.to_numpy()[:, ::-1])
    told = clock_inputs(MOMENTS, workday=np.ones(64))
    assert [name for name in told.columns if not is_of_clock(name)] == [
        "workday",
        "workday * clock_sin1",
        "workday * clock_cos1",
    ]
    assert not any(map(is_of_clock, ("clock", "clock_sin0", "clock_sin", "sin1", "clock_sin1 * wind", "")))
    assert factors_of("wind * clock_cos3") == ["wind", "clock_cos3"]


#: What is refused, and what is said of it.
REFUSED = {
    "no times": ({"time": [1.0, 2.0]}, "time: got numbers of type float64, expected times"),
    "no index of times": ({"time": pd.Series([1.0])}, "time: got a Series whose index has no times"),
    "no time": ({"time": ["2014-01-01", None]}, "time: row 1 is not a time"),
    "too many": ({"harmonics": 25}, "harmonics: got 25, expected at most 24"),
    "a negative number": ({"harmonics": -1}, "harmonics: got -1, expected"),
    "nothing": ({"harmonics": 0}, "harmonics: got 0 without workday and day_of_year"),
    "other rows": ({"workday": [True]}, r"workday: got shape \(1,\), expected \(64,\)"),
    "no day": ({"workday": np.full(64, 2.0)}, "workday: row 0 is 2, expected True or False"),
    "a missing day": ({"workday": [None] + [1.0] * 63}, "workday: row 0 is missing"),
    "no flag": ({"day_of_year": "yes"}, "day_of_year: got 'yes'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_clock_is_refused(case) -> None:
    options, message = REFUSED[case]
    with pytest.raises((ParameterError, ShapeError), match=message):
        clock_inputs(**{"time": MOMENTS, **options})


def test_working_days_of_another_table_are_refused() -> None:
    index = pd.date_range("2014-01-01", periods=3, freq="D")
    with pytest.raises(ParameterError, match="time, workday: rows of different indexes"):
        clock_inputs(index, workday=pd.Series([True] * 3, index[::-1].sort_values() + pd.Timedelta("1D")))


def test_columns_with_names_are_taken_apart_by_rows_and_by_name() -> None:
    table = InputColumns(["a", "b"], [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    assert repr(table) == "InputColumns(3 rows of a, b)"
    np.testing.assert_array_equal(table[1:]["b"], [4.0, 6.0])
    np.testing.assert_array_equal(np.asarray(table), table.to_numpy())
    np.testing.assert_array_equal(table[table["a"] > 1.0], [[3.0, 4.0], [5.0, 6.0]])
    assert copy.deepcopy(table) is table
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(table)), table)
    with pytest.raises(ValueError, match="read-only"):
        table.to_numpy()[0, 0] = 9.0
    for bad, message in (
        (lambda: table["c"], "column: got 'c', expected one of a, b"),
        (lambda: InputColumns(["a", "a"], [[1.0, 2.0]]), "columns: got a twice"),
        (lambda: InputColumns(["a"], [[1.0, 2.0]]), r"values: got shape \(1, 2\)"),
        (lambda: InputColumns(["a"], [[np.nan]]), "values: entry"),
    ):
        with pytest.raises((ParameterError, ShapeError), match=message):
            bad()


def test_models_and_filters_take_columns_with_names_as_they_take_a_frame() -> None:
    rng = np.random.default_rng(3)
    hours = np.datetime64("2014-01-06", "s") + np.arange(120) * np.timedelta64(1, "h")
    inputs = clock_inputs(hours, harmonics=1)
    frame = pd.DataFrame(inputs.to_numpy(), columns=inputs.columns)
    y = np.cumsum(rng.normal(size=120)) * 0.3 + inputs["clock_sin1"]
    x = y + inputs["clock_cos1"] + 0.1 * rng.normal(size=120)
    options = {"n_regimes": 1, "n_starts": 1, "max_iter": 3, "features": WindowFeatures(order=2)}
    fits = [CGOMSModel.fit(x[:90], y[:90], inputs=u[:90], **options) for u in (inputs, frame)]
    models = [fit.model for fit in fits]
    assert models[0].form.inputs == models[1].form.inputs == ("clock_sin1", "clock_cos1")
    swapped = InputColumns(inputs.columns[::-1], inputs.to_numpy()[:, ::-1])
    found = []
    for model, us in ((models[0], inputs), (models[1], frame), (models[0], swapped)):
        f = model.filter()
        many = f.filter_many(np.stack([y[:30], y[30:60]]), us=us[:30])
        ahead = (f.filter(y[:90], us=us[:90]), f.forecast(5, us=us[90:95]))[1]
        drawn = model.simulate(10, np.random.default_rng(0), us=us[:10])
        found.append(np.concatenate([many.x.ravel(), ahead.x.ravel(), drawn.x.ravel()]))
    for one, other in pairwise(found):
        np.testing.assert_allclose(one, other, rtol=1e-12)

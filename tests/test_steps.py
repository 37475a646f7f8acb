"""Equal steps are told from unequal ones in whatever unit they are equal, and missing rows are counted."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.steps import find_steps, other_step, step_note
from fuzzykf.times import read_times

TENTHS = np.datetime64("2014-01-01", "ms") + 100 * np.arange(50) * np.timedelta64(1, "ms")
YEAR = pd.date_range("2014-01-01", "2015-01-01", freq="h", tz="Europe/Berlin")
NIGHTS = pd.date_range("2014-01-01", "2015-01-01", freq="D", tz="Europe/Berlin")
MONTHS = np.arange("2013-01", "2015-06", dtype="datetime64[M]")
FRAMES = np.datetime64("2014-01-01", "ms") + np.round(np.arange(300) * 1000 / 30).astype("timedelta64[ms]")

#: Series without a gap, which are no reason for a note.
REGULAR = {
    "tenths of a second": (TENTHS, np.timedelta64(100, "ms")),
    "hours with offsets": (YEAR, np.timedelta64(1, "h")),
    "hours with offsets, as text": ([one.isoformat() for one in YEAR], np.timedelta64(1, "h")),
    "midnights with offsets": (NIGHTS, np.timedelta64(1, "D")),
    "midnights with offsets, as objects": (NIGHTS.to_pydatetime(), np.timedelta64(1, "D")),
    "first days of months": (MONTHS, np.timedelta64(1, "M")),
    "last days of months": ((MONTHS + 1).astype("datetime64[D]") - 1, np.timedelta64(1, "M")),
    "15th of months at noon": (MONTHS.astype("datetime64[h]") + 14 * 24 + 12, np.timedelta64(1, "M")),
    "quarters": (MONTHS[::3], np.timedelta64(3, "M")),
    "years": (np.arange("2010", "2020", dtype="datetime64[Y]"), np.timedelta64(12, "M")),
    "months with offsets": (
        pd.date_range("2014", periods=12, freq="MS", tz="Europe/Berlin"),
        np.timedelta64(1, "M"),
    ),
    "thirtieths of a second, rounded": (FRAMES, np.timedelta64(33, "ms")),
    "two rows": (["2014-01-01", "2014-01-05"], np.timedelta64(4, "D")),
}


@pytest.mark.parametrize("name", REGULAR)
def test_equal_steps_are_found(name) -> None:
    stamps, step = REGULAR[name]
    times = read_times(stamps)
    steps = find_steps(times)
    assert steps.is_regular
    assert steps.step == step
    assert not steps.missing.any()
    assert steps.missing.shape == (len(times) - 1,)
    assert step_note(times, "t") is None


@pytest.mark.parametrize("name", [name for name in REGULAR if name not in ("two rows", "years")])
def test_rows_that_are_taken_away_are_missed_where_they_were(name) -> None:
    stamps, step = REGULAR[name]
    gone = [3, 4, 7]
    kept = np.delete(np.arange(len(stamps)), gone)
    steps = find_steps(read_times(stamps[kept] if hasattr(stamps, "dtype") else [stamps[k] for k in kept]))
    if "rounded" in name:  # steps of 33 and 34 ms are no whole number of one
        assert steps.step is None
        return
    assert steps.step == step
    np.testing.assert_array_equal(np.flatnonzero(steps.missing), [2, 4])
    np.testing.assert_array_equal(steps.missing[[2, 4]], [2, 1])


@settings(max_examples=50, deadline=None)
@given(
    step=st.sampled_from([1, 60, 900, 3600, 86400]),
    kept=st.lists(st.booleans(), min_size=20, max_size=40).filter(lambda kept: sum(kept) > 15),
)
def test_missing_rows_are_counted(step, kept) -> None:
    # Oracle: the rows that were left out, between the first and the last that were not.
    rows = np.flatnonzero(kept)
    apart = np.diff(rows)
    if 2 * (apart == 1).sum() < len(apart) or not (apart == 1).any():
        return
    steps = find_steps(read_times(np.datetime64("2014-01-01T00:00:00") + step * rows))
    assert steps.step == np.timedelta64(step, "s")
    np.testing.assert_array_equal(steps.missing, apart - 1)


def test_rows_without_a_time_are_no_gap() -> None:
    stamps = ["2014-01-01", "2014-01-02", "", "2014-01-04", "2014-01-05", "", ""]
    assert find_steps(read_times(stamps, gaps=True)).is_regular
    stamps[3:5] = ["2014-01-06", "2014-01-07"]
    steps = find_steps(read_times(stamps, gaps=True))
    np.testing.assert_array_equal(steps.missing, [0, 2, 0, 0, 0, 0])
    for few in (["2014-01-01", "", "2014-01-03"], ["", ""], ["2014-01-01"]):
        times = read_times(few, gaps=True)
        assert find_steps(times).step is None


@pytest.mark.parametrize(
    ("stamps", "note"),
    [
        (
            ["2014-01-01T00:00", "2014-01-01T01:00", "2014-01-01T02:00", "2014-01-01T05:00"],
            "2 rows are missing (column t, steps of 1:00:00): 2 after 2014-01-01T02:00:00; a model has "
            "a fixed time step: add rows with empty cells for missing times",
        ),
        (
            ["2014-01", "2014-02", "2014-03", "2014-05"],
            "1 row is missing (column t, steps of 1 month): 1 after ",
        ),
        (
            np.delete(np.datetime64("2014-01-01") + np.arange(40), [2, 5, 9, 13, 17]),
            "1 after 2014-01-05T00:00:00, 1 after 2014-01-09T00:00:00 and 2 places more;",
        ),
        (
            ["2014-01-01T00:00", "2014-01-01T00:07", "2014-01-01T01:00"],
            "the steps between rows vary from 0:07:00 to 0:53:00 (column t); a model has",
        ),
        (
            # The clocks of Berlin were put forward, and nothing is missing.
            ["2014-03-30T00:00", "2014-03-30T01:00", "2014-03-30T03:00", "2014-03-30T04:00"],
            "(if clocks were put forward there, no row is missing; use times with UTC offsets)",
        ),
        (pd.date_range("2014", periods=4, freq="7ns").delete(2), "steps of 7 nanoseconds"),
    ],
)
def test_unequal_steps_are_said(stamps, note) -> None:
    assert note in step_note(read_times(stamps), "t")


def test_the_hint_at_spring_is_given_only_there() -> None:
    day = ["2014-03-30T09:00", "2014-03-30T10:00", "2014-03-30T12:00"]
    assert "forward" not in step_note(read_times(day), "t")
    zoned = [f"2014-03-30T0{k}:00Z" for k in (0, 1, 3, 4)]
    assert "forward" not in step_note(read_times(zoned), "t")


def test_a_row_without_a_time_where_none_is_missing_is_told_as_such():
    stamps = ["2024-01-01T00:00", "2024-01-01T01:00", "", "2024-01-01T02:00", "2024-01-01T03:00"]
    note = step_note(read_times(stamps, gaps=True), "time")
    assert note.startswith("rows without a time occur where no step is missing (column time)")
    del stamps[3]  # now one is
    assert step_note(read_times(stamps, gaps=True), "time") is None


@pytest.mark.parametrize("name", REGULAR)
def test_rows_are_as_far_apart_as_themselves_and_not_as_far_as_twice(name) -> None:
    stamps, _ = REGULAR[name]
    times = read_times(stamps)
    step = find_steps(times).step
    assert other_step(times, step) is None
    assert other_step(times, 2 * step) is not None
    # neither is told of rows that show no step
    assert other_step(times[:1], 2 * step) is None
    assert other_step(read_times(["2014-01-01", "2014-01-02", "2014-01-09T03:00"]), step) is None

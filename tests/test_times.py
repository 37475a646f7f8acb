"""Times mean the same in whatever they come: the local clock for the hour, the instant for order."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOMSModel, DailyProfile, KalmanFilter, compare_models
from fuzzykf.comparison import ClockSwitch, prepare
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.observations import check_aligned
from fuzzykf.preprocessing import hour_of_day
from fuzzykf.times import has_times, is_time, read_times, written_times

BERLIN = ZoneInfo("Europe/Berlin")
#: Four half hours around the one in which the clocks of Berlin go back: 2:30 is shown twice.
INSTANTS = np.datetime64("2014-10-26T00:00", "s") + 30 * np.arange(4) * np.timedelta64(60, "s")
AWARE = [moment.replace(tzinfo=UTC).astimezone(BERLIN) for moment in INSTANTS.astype(object)]
TEXT = [moment.isoformat() for moment in AWARE]
CLOCK = np.array([moment.replace(tzinfo=None) for moment in AWARE], dtype="datetime64[s]")
INDEX = pd.DatetimeIndex(AWARE)

#: The same four times in all forms that know their zone, ...
ZONED = {
    "text": TEXT,
    "text with a space": [text.replace("T", " ") for text in TEXT],
    "array of text": np.array(TEXT),
    "array of objects": np.array(AWARE, dtype=object),
    "datetimes of one zone": AWARE,
    "datetimes with offsets": [m.astimezone(timezone(m.utcoffset())) for m in AWARE],
    "index": INDEX,
    "series": pd.Series(INDEX),
    "series of objects": pd.Series(AWARE, dtype=object),
    "series of text": pd.Series(TEXT),
    "timestamps": list(INDEX),
    "tuple of timestamps": tuple(INDEX),
}

DAYS = np.array(["2014-01-30", "2014-01-31", "2014-02-03"], dtype="datetime64[s]")

#: ... and three days in all forms that do not.
NAIVE = {
    "datetime64[s]": DAYS,
    "datetime64[D]": DAYS.astype("datetime64[D]"),
    "datetime64[ns]": DAYS.astype("datetime64[ns]"),
    "datetimes": DAYS.astype(object).tolist(),
    "dates": DAYS.astype("datetime64[D]").astype(object).tolist(),
    "scalars": list(DAYS),
    "text": ["2014-01-30", "2014-01-31T00:00", "2014-02-03 00:00:00.0"],
    "text without signs": ["20140130", "20140131T00", "20140203T0000"],
    "bytes": np.array([b"2014-01-30", b"2014-01-31", b"2014-02-03"]),
    "weeks": ["2014-W05-4", "2014-W05-5", "2014-W06-1"],
    "index": pd.DatetimeIndex(DAYS),
    "series": pd.Series(DAYS),
    "periods": pd.PeriodIndex(DAYS, freq="D"),
    "series of periods": pd.Series(pd.PeriodIndex(DAYS, freq="D")),
    "list of periods": list(pd.PeriodIndex(DAYS, freq="D")),
    "objects: periods": pd.Index(list(pd.PeriodIndex(DAYS, freq="D")), dtype=object),
    "list of timestamps": list(pd.DatetimeIndex(DAYS)),
    "objects: timestamps": np.array(list(pd.DatetimeIndex(DAYS)), dtype=object),
    "categories": pd.Series(["2014-01-30", "2014-01-31", "2014-02-03"], dtype="category"),
    "masked": np.ma.array(DAYS, mask=[False] * 3),
}


@pytest.mark.parametrize("form", ZONED)
def test_times_with_a_zone_have_a_local_clock_and_an_instant(form) -> None:
    times = read_times(ZONED[form])
    assert times.has_offsets
    assert times.clock.dtype == times.instant.dtype == "datetime64[s]"
    np.testing.assert_array_equal(times.clock, CLOCK)
    np.testing.assert_array_equal(times.instant, INSTANTS)
    np.testing.assert_array_equal(hour_of_day(ZONED[form]), [2.0, 2.5, 2.0, 2.5])


@pytest.mark.parametrize("form", NAIVE)
def test_times_without_a_zone_are_what_the_clock_shows(form) -> None:
    times = read_times(NAIVE[form])
    assert not times.has_offsets
    for found in (times.clock, times.instant):
        assert found.dtype == "datetime64[s]"
        np.testing.assert_array_equal(found, DAYS)


@pytest.mark.parametrize(
    ("stamps", "unit", "step"),
    [
        (["2014-01-01T00:00:00.0", "2014-01-01T00:00:00.1"], "ms", 100),
        (["2014-01-01T00:00:00,000001", "2014-01-01T00:00:00,000003"], "us", 2),
        (["2014-01-01T00:00:00.000000001", "2014-01-01T00:00:00.000000004"], "ns", 3),
        (pd.date_range("2014", periods=2, freq="7ns"), "ns", 7),
        (pd.Series(pd.date_range("2014", periods=2, freq="7ns", tz="UTC").astype(object)), "ns", 7),
        (np.array(["2014-01-01T00:00:00.250", "2014-01-01T00:00:00.500"], dtype="datetime64[us]"), "ms", 250),
        ([datetime(2014, 1, 1, 0, 0, 0, 500), datetime(2014, 1, 1, 0, 0, 0, 750)], "us", 250),
        ([np.datetime64("2014-01-01T00:00:00.000000005"), datetime(2015, 1, 1)], "ns", None),
    ],
)
def test_parts_of_a_second_are_kept(stamps, unit, step) -> None:
    times = read_times(stamps)
    assert times.clock.dtype == f"datetime64[{unit}]"
    if step is not None:
        assert np.diff(times.instant).astype(int) == step


@pytest.mark.parametrize(
    ("stamps", "format", "clock"),
    [
        (["03/29/2024", "03/30/2024"], "%m/%d/%Y", ["2024-03-29", "2024-03-30"]),
        (
            ["29.03.2024 05:30", "29.03.2024 06:30"],
            "%d.%m.%Y %H:%M",
            ["2024-03-29T05:30", "2024-03-29T06:30"],
        ),
        (["29.03.2024 +0530"], "%d.%m.%Y %z", ["2024-03-29"]),
        (["1396051200", "1396051200.1"], "unix", ["2014-03-29T00:00:00.0", "2014-03-29T00:00:00.1"]),
        (
            ["-1", "0", "1.000000001"],
            "unix",
            ["1969-12-31T23:59:59", "1970-01-01", "1970-01-01T00:00:01.000000001"],
        ),
        (["1396051200250"], "unix_ms", ["2014-03-29T00:00:00.25"]),
        ([1396051200, 1396051260], "unix", ["2014-03-29", "2014-03-29T00:01"]),
        (np.array([1396051200.5]), "unix", ["2014-03-29T00:00:00.5"]),
        (np.array([1396051200250]), "unix_ms", ["2014-03-29T00:00:00.25"]),
        (
            pd.Series([1396051200, 1396051200.5], dtype=object),
            "unix",
            ["2014-03-29", "2014-03-29T00:00:00.5"],
        ),
    ],
)
def test_other_times_are_read_if_a_format_is_given(stamps, format, clock) -> None:
    times = read_times(stamps, format=format)
    np.testing.assert_array_equal(times.clock, np.array(clock, dtype="datetime64[ns]"))
    assert times.has_offsets == (format.startswith("unix") or "%z" in format)


def test_missing_times_are_let_in_only_where_they_may_be() -> None:
    masked = np.ma.array(DAYS, mask=[0, 1, 0])
    for stamps in (
        ["2014-01-30", "", "2014-02-03"],
        [DAYS[0], None, DAYS[2]],
        pd.Series(DAYS).where([True, False, True]),
        [DAYS[0], np.ma.masked, DAYS[2]],
        masked,
    ):
        with pytest.raises(ParameterError, match=r"time: row 1 is not a time.*: expected one in every row"):
            read_times(stamps)
        found = read_times(stamps, gaps=True)
        np.testing.assert_array_equal(found.clock, np.where([0, 1, 0], np.datetime64("NaT"), DAYS))
    with pytest.raises(
        ParameterError, match="row 2 is '2014-01-29', not later than '2014-01-30' in the last row before"
    ):
        read_times(["2014-01-30", "", "2014-01-29"], gaps=True)


# ------------------------------------------------------------------ what is refused

HOURS = np.datetime64("2014-03-03T05:00", "s") + np.arange(5) * np.timedelta64(3600, "s")
BACK, TWICE = HOURS[[0, 1, 3, 2, 4]], HOURS[[0, 1, 2, 2, 3]]


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (BACK, "row 3 is 2014-03-03T07:00:00, not later than 2014-03-03T08:00:00 in the row before$"),
        (
            TWICE,
            "row 3 is 2014-03-03T07:00:00, not later than 2014-03-03T07:00:00 in .*: it stands twice, exp",
        ),
        (pd.Series(TWICE), "row 3 is 2014-03-03 07:00:00, not later than"),
        (pd.DatetimeIndex(BACK, tz="UTC"), r"row 3 is 2014-03-03 07:00:00\+00:00, not later than"),
        (
            ["2014-03-03", "2014-03-02"],
            "row 1 is '2014-03-02', not later than '2014-03-03' in the row before",
        ),
        # The clock goes on, the instant does not.
        (
            ["2014-03-03T05:00+00:00", "2014-03-03T06:00+01:00"],
            r"row 1 is '2014-03-03T06:00\+01:00', not later",
        ),
        (CLOCK, "row 2 is 2014-10-26T02:00:00, not later than .*put back there.*give one in every row"),
        (
            ["2014-10-26T01:30", "2014-10-26T01:30"],
            "if clocks were put back there, .* as in 2014-10-26T01:30",
        ),
        (HOURS[::-1] - np.timedelta64(5, "h"), "row 1 is .*in the row before$"),  # at night, but not once
        ([date(2014, 1, 1), "noon"], "row 1 is 'noon', expected a time as in 2014-01-31T16:30$"),
        (["03/29/2024"], "row 0 is '03/29/2024', expected a time as in"),
        (["1396051200"], "row 0 is '1396051200', expected a time as in"),
        (["2014-02-30"], "row 0 is '2014-02-30', expected a time as in .*day"),
        (["2014"], "row 0 is '2014', expected a time as in"),
        (["2014-01-01T00:00:00.0000000001"], "no digits beyond those of a nanosecond"),
        (
            ["2014-01-01", "2014-01-02T00:00Z"],
            "row 1 is '2014-01-02T00:00Z', expected an offset in every row or in",
        ),
        ([1, 2], "time: got numbers of type int64, expected times; numbers of seconds since 1970"),
        ([True, False], "time: got numbers of type bool"),
        ([1j], "time: got numbers of type complex"),
        ([timedelta(1)], "row 0 is 1 day, 0:00:00, expected a time, got timedelta"),
        ([[1], [2, 3]], "time: got lists of unequal length"),
        ([["2014-01-01"]], r"time: got shape \(1, 1\), expected \(n,\)"),
        (None, r"time: got shape \(\), expected"),
        (np.array([1], dtype="datetime64[ps]"), "none finer than a nanosecond"),
    ],
)
def test_what_are_no_times_in_order_is_refused_with_its_row(stamps, message) -> None:
    with pytest.raises(ParameterError, match=message):
        read_times(stamps)


@pytest.mark.parametrize(
    ("stamps", "format", "message"),
    [
        (["2014-01-01"], "iso", "got the format 'iso', expected 'unix', 'unix_ms', or a date with its year"),
        (["12:30"], "%H:%M", "or a date with its year"),
        (["2014"], "%Y-%Q", "the format '%Y-%Q' cannot be read: 'Q' is a bad directive"),
        (["2014"], "%Y%", "the format '%Y%' cannot be read: stray %"),
        (["2014"], 5, "got the format 5"),
        (["2014-01-01"], "%d.%m.%Y", "row 0 is '2014-01-01', expected a time in the format '%d.%m.%Y'"),
        (["1_0"], "unix", "row 0 is '1_0', expected a number of seconds"),
        (["1e9"], "unix", "row 0 is '1e9', expected a number of seconds"),
        (["9" * 20], "unix", "expected a number of seconds"),
        ([np.nan, 1.0], "unix", "row 0 is nan, expected a number of seconds"),
        ([1 << 60], "unix_ms", "row 0 is 1152921504606846976, expected a number of seconds"),
        (DAYS, "unix", "got times, expected text or numbers beside the format 'unix'"),
    ],
)
def test_a_format_that_is_none_or_does_not_fit_is_refused(stamps, format, message) -> None:
    with pytest.raises(ParameterError, match=message):
        read_times(stamps, format=format)


#: Indexes of durations, and of objects, that are not in order, and what is said of them.
STAMPS = list(pd.DatetimeIndex(DAYS))
DISORDER = {
    "durations": (pd.to_timedelta([1, 3, 2], unit="h"), "row 2 is 0 days 02:00:00, not later than 0 days 03"),
    "equal durations": (
        pd.to_timedelta([1, 1], unit="h"),
        "row 1 is 0 days 01:00:00, not later than 0 days 01",
    ),
    "a missing duration": (
        pd.to_timedelta([1, None], unit="h"),
        "row 1 is NaT, expected a duration in every row",
    ),
    "objects: durations": (
        pd.Index([timedelta(2), timedelta(1)], dtype=object),
        "row 1 is 1 day, 0:00:00, not la",
    ),
    "objects: a first that is missing": (
        pd.Index([None, timedelta(2)], dtype=object),
        "row 0 is None, expected a",
    ),
    "objects: no duration": (
        pd.Index([timedelta(2), "3"], dtype=object),
        "row 1 is '3', expected a duration",
    ),
    "stamps": (pd.DatetimeIndex(STAMPS[::-1]), "row 1 is 2014-01-31 00:00:00, not later than 2014-02-03"),
    "objects: stamps after None": (
        pd.Index([None, *STAMPS], dtype=object),
        "row 0 is not a time .None.: expected",
    ),
    "objects: dates": (
        pd.Index([date(2014, 1, 2), date(2014, 1, 1)], dtype=object),
        "row 1 is 2014-01-01, not lat",
    ),
    "objects: periods": (
        pd.Index(list(pd.PeriodIndex(DAYS[::-1], freq="D")), dtype=object),
        "row 1 is 2014-01-31, not later than 2014-02-03",
    ),
}


@pytest.mark.parametrize("kind", DISORDER)
def test_an_index_of_times_or_durations_has_to_increase_in_whatever_form(kind) -> None:
    index, message = DISORDER[kind]
    zs = pd.Series(np.arange(float(len(index))), index)
    for call in (KalmanFilter(1, 1, H=[[1.0]]).filter, KalmanFilter(1, 1, H=[[1.0]]).smooth):
        with pytest.raises(ParameterError, match=f"zs: the index of {message}"):
            call(zs)
    with pytest.raises(ParameterError, match=f"x: the index of {message}"):
        CGOMSModel.fit(zs, zs)


@pytest.mark.filterwarnings("ignore::fuzzykf.errors.StepsWarning")  # days are missing in the last
@pytest.mark.parametrize(
    "index",
    [
        pd.to_timedelta([1, 2, 3], unit="h"),
        pd.Index([timedelta(1), timedelta(2), timedelta(3)], dtype=object),
        pd.Index([3, 1, 2]),
        pd.Index(["c", "a", None], dtype=object),
        pd.Index([None] * 3, dtype=object),
        pd.Index(list(pd.PeriodIndex(DAYS, freq="D")), dtype=object),
    ],
)
def test_an_index_in_order_or_of_names_is_let_in(index) -> None:
    result = KalmanFilter(1, 1, H=[[1.0]]).filter(pd.Series([1.0, 2.0, 3.0], index))
    assert result.index is index


def test_what_holds_times_is_told_from_what_does_not() -> None:
    assert all(has_times(one) for one in (INDEX, pd.Index(AWARE, dtype=object), pd.DatetimeIndex(DAYS), DAYS))
    assert has_times(pd.PeriodIndex(DAYS, freq="D"))
    for first in (None, pd.NaT, np.nan, np.datetime64("NaT")):  # what is missing tells nothing
        for stamp in (INDEX[0], DAYS[0], date(2014, 1, 1), pd.Period("2014-01", freq="M")):
            assert has_times(pd.Index([first, stamp], dtype=object))
        assert not has_times(pd.Index([first, "2014-01-01"], dtype=object))
    assert not any(
        has_times(one) for one in (None, pd.RangeIndex(3), pd.Index(["a"]), pd.Index([], dtype=object))
    )
    assert is_time("2014-03-29T01:00Z")
    assert not any(map(is_time, ("monday", "12:30", "29.03.2014", "1.5", "")))


# ------------------------------------------------------------------ one rule, wherever times go in

RNG = np.random.default_rng(0)
N = 240
X, Y = RNG.normal(size=N), RNG.normal(size=N)
GOOD = np.datetime64("2014-10-23T05:00", "s") + np.arange(N) * np.timedelta64(3600, "s")
WRONG = {"back": GOOD[[*range(9), 10, 9, *range(11, N)]], "twice": GOOD[[*range(9), 8, *range(10, N)]]}


def dataset(times):
    xr = pytest.importorskip("xarray", reason="the extra [dask] is not installed")
    pytest.importorskip("dask", reason="the extra [dask] is not installed")
    from fuzzykf import KalmanFilter
    from fuzzykf.distributed import filter_dataset

    ds = xr.Dataset({"y": ("time", Y)}, coords={"time": times})
    return filter_dataset(ds, KalmanFilter(1, 1, H=[[1.0]]), keep=["x"])


def compare(x, **options):
    return compare_models(
        x, Y, np.random.default_rng(0), candidates=["regression"], n_folds=1, n_resamples=100, **options
    )


#: Everything that takes the times of a series, and the verbs that take them as an index.
USERS = {
    "profile fit": lambda t: DailyProfile().fit(X, t),
    "profile transform": lambda t: DailyProfile().fit(X, GOOD).transform(X, t),
    "profile inverse": lambda t: DailyProfile().fit(X, GOOD).inverse_transform(X, t),
    "compare_models": lambda t: compare(X, time=t),
    "compare_models with a profile": lambda t: compare(X, time=t, profile=True),
    "prepare": lambda t: prepare(X, Y, time=t),
    "dataset": dataset,
    "profile of an index": lambda t: DailyProfile().fit(pd.Series(X, t)),
    "compare_models of an index": lambda t: compare(pd.Series(X, t)),
    "fit of an index": lambda t: CGOMSModel.fit(pd.Series(X, t), Y, n_switches=1),
    "alignment": lambda t: check_aligned(x=pd.Series(X, t), y=Y),
}


@pytest.mark.parametrize("user", USERS)
def test_rows_that_are_not_in_order_are_refused_by_all_that_take_times(user) -> None:
    USERS[user](GOOD)
    for times in WRONG.values():
        with pytest.raises(FuzzykfError, match=r"not later than .* in the row before"):
            USERS[user](times)


@pytest.mark.parametrize("user", ["dataset", "compare_models of an index", "fit of an index", "alignment"])
def test_durations_that_are_not_in_order_are_refused_by_all_that_take_an_index(user) -> None:
    USERS[user](GOOD - GOOD[0])
    for times in WRONG.values():
        with pytest.raises(FuzzykfError, match=r"not later than .* in the row before"):
            USERS[user](times - GOOD[0])


INDEXED = ["dataset", "profile of an index", "compare_models of an index", "fit of an index", "alignment"]


@pytest.mark.parametrize("zone", ["", "+10:00"])
@pytest.mark.parametrize("user", INDEXED)
def test_an_index_of_text_that_nobody_has_parsed_has_to_be_in_order_as_well(user, zone) -> None:
    USERS[user]([f"{time}{zone}" for time in GOOD])
    for times in (*WRONG.values(), GOOD[::-1]):
        with pytest.raises(FuzzykfError, match=r"is '2014-.*', not later than '2014-.*' in the row before"):
            USERS[user]([f"{time}{zone}" for time in times])
    with pytest.raises(FuzzykfError, match="expected an offset in every row or in none"):
        USERS[user]([*GOOD[:-2].astype(str), f"{GOOD[-2]}Z", str(GOOD[-1])])


#: Indexes of text that hold no times, which may be in any order.
NO_TIMES = {
    "names": ["b", "a", "c"],
    "a name between dates": ["2014-02-03", "autumn", "2014-01-01"],
    "numbers of eight digits": ["20140203", "20140102", "20140101"],
    "nothing between dates": ["2014-02-03", None, "2014-01-01"],
    "pairs": pd.MultiIndex.from_tuples([("2014-02", 1), ("2014-01", 1), ("2014-01", 2)]),
}


@pytest.mark.parametrize("case", NO_TIMES)
def test_text_that_is_no_time_throughout_may_be_in_any_order(case) -> None:
    index = pd.Index(NO_TIMES[case])
    check_aligned(x=pd.Series([1.0, 2.0, 3.0], index), y=[1.0, 2.0, 3.0])
    assert written_times(index) is None


HALVES = ["01:00", "01:30", "02:00", "02:30", "02:00", "02:30", "03:00"]

#: Clocks that go back at night, and whether it may be that they were put back by an hour.
PUT_BACK = {
    "half hours in October": (
        HALVES,
        "2014-10-26",
        True,
    ),
    "half hours in April": (
        HALVES,
        "2014-04-06",
        True,
    ),
    "half hours in January": (
        HALVES,
        "2014-01-19",
        False,
    ),
    "hours in October": (["01:00", "02:00", "02:00", "03:00"], "2014-10-26", True),
    "hours in January": (["01:00", "02:00", "02:00", "03:00"], "2014-01-26", False),
    "hours in July": (["01:00", "02:00", "02:00", "03:00"], "2014-07-27", False),
    "hours at noon": (["11:00", "12:00", "12:00", "13:00"], "2014-10-26", False),
    "a half hour twice": (["01:00", "01:30", "01:30", "02:00"], "2014-10-26", False),
    "too far back": (["01:00", "01:30", "02:00", "02:30", "01:30", "02:00"], "2014-10-26", False),
    "not the whole hour again": (["01:00", "01:30", "02:00", "02:30", "02:00", "03:00"], "2014-10-26", False),
    "the file ends in it": (["01:00", "01:30", "02:00", "02:30", "02:00"], "2014-10-26", True),
    "nothing but two rows": (["02:00", "02:00"], "2014-10-26", True),
    "nothing but two rows in January": (["02:00", "02:00"], "2014-01-26", False),
}


@pytest.mark.parametrize("case", PUT_BACK)
def test_clocks_are_spoken_of_where_rows_show_an_hour_of_the_night_twice(case) -> None:
    clocks, day, spoken_of = PUT_BACK[case]
    with pytest.raises(ParameterError, match="not later than") as caught:
        read_times([f"{day}T{clock}" for clock in clocks])
    assert ("if clocks were put back there" in str(caught.value)) == spoken_of


@pytest.mark.parametrize("zone", [None, "Australia/Brisbane"])
@pytest.mark.parametrize("form", ["series", "index", "objects", "text", "periods"])
def test_all_forms_of_times_give_one_profile_and_one_switch(form, zone) -> None:
    index = pd.DatetimeIndex(GOOD, tz=zone)  # the clock shows the same
    given = {
        "series": pd.Series(index),
        "index": index,
        "objects": index.to_pydatetime().tolist(),
        "text": [moment.isoformat() for moment in index],
        "periods": pd.PeriodIndex(GOOD, freq="h"),
    }[form]
    expected = DailyProfile().fit(X, GOOD)
    profile = DailyProfile().fit(X, given)
    np.testing.assert_array_equal(profile.means_, expected.means_)
    np.testing.assert_array_equal(profile.at(given), expected.at(GOOD))
    assert ClockSwitch.learn(given, X) == ClockSwitch.learn(GOOD, X)
    task, known = (prepare(X, Y, time=t, profile=True, switch="clock") for t in (given, GOOD))
    np.testing.assert_array_equal(task.state, known.state)
    np.testing.assert_array_equal(task.switch, known.switch)
    np.testing.assert_array_equal(task.time, GOOD)
    scores = [compare(X, time=t, profile=True).scores[0].rmse for t in (given, GOOD)]
    assert scores[0] == scores[1]


def test_the_hour_that_a_clock_shows_twice_counts_twice_in_a_profile() -> None:
    index = pd.date_range("2014-10-20", periods=14 * 24 + 1, freq="h", tz=BERLIN)
    hour = np.asarray(index.hour, dtype=float)
    profile = DailyProfile().fit(hour, index)
    np.testing.assert_allclose(profile.means_, np.tile(np.arange(24.0), (2, 1)))
    np.testing.assert_allclose(profile.transform(hour, pd.Series(index)), 0.0)


def test_a_profile_is_asked_at_times_in_any_order() -> None:
    profile = DailyProfile().fit(X, GOOD)
    np.testing.assert_array_equal(profile.at(GOOD[::-1]), profile.at(GOOD)[::-1])


def test_lengths_are_named() -> None:
    with pytest.raises(ShapeError, match=r"time: got shape \(3,\), expected \(240,\)"):
        prepare(X, Y, time=DAYS)

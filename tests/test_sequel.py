"""The index of a forecast is what follows the index of the series."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel, ExtendedKalmanFilter, IMMEstimator, KalmanFilter, OFSRFilter
from fuzzykf.errors import ParameterError, StepsWarning
from fuzzykf.sequel import sequel_of

BERLIN = "Europe/Berlin"

#: An index, and the three entries that follow.
INDEXES = {
    "hours": (
        pd.date_range("2026-01-01", periods=5, freq="h", name="hour"),
        ["05:00", "06:00", "07:00"],
        "%H:%M",
    ),
    "hours without a frequency": (
        pd.DatetimeIndex(["2026-01-01 22:00", "2026-01-01 23:00"]),
        ["02 00", "02 01", "02 02"],
        "%d %H",
    ),
    "days over a change of clocks": (
        pd.date_range("2026-03-26", periods=3, freq="D", tz=BERLIN),
        ["29 00 +0100", "30 00 +0200", "31 00 +0200"],
        "%d %H %z",
    ),
    "hours over a change of clocks": (
        pd.DatetimeIndex(pd.date_range("2026-03-28 23:00", periods=3, freq="h", tz=BERLIN).to_list()),
        ["03 +0200", "04 +0200", "05 +0200"],
        "%H %z",
    ),
    "ends of months": (
        pd.DatetimeIndex(["2025-11-30", "2025-12-31", "2026-01-31"]),
        ["02-28", "03-31", "04-30"],
        "%m-%d",
    ),
    "months, one missing": (
        pd.DatetimeIndex(["2026-01-01", "2026-02-01", "2026-04-01"]),
        ["05", "06", "07"],
        "%m",
    ),
    "hours, two missing": (
        pd.DatetimeIndex(["2026-01-01 00:00", "2026-01-01 01:00", "2026-01-01 04:00"]),
        ["05", "06", "07"],
        "%H",
    ),
    "working days": (pd.bdate_range("2026-01-01", periods=7), ["12", "13", "14"], "%d"),
    "working days, some missing": (
        pd.bdate_range("2026-01-01", periods=9).delete([3, 6]),
        ["14", "15", "16"],
        "%d",
    ),
    "periods": (pd.period_range("2026-01", periods=3, freq="M"), ["04", "05", "06"], "%m"),
}


@pytest.mark.parametrize("case", INDEXES)
def test_times_go_on(case):
    index, expected, form = INDEXES[case]
    found = sequel_of(index).ahead(3)
    assert found.strftime(form).tolist() == expected
    assert found.name == index.name
    assert type(found) is type(index)
    assert sequel_of(index).ahead(1, skip=2).strftime(form).tolist() == expected[2:]


@pytest.mark.parametrize(
    ("index", "expected"),
    [
        (pd.RangeIndex(5, name="k"), [5, 6]),
        (pd.RangeIndex(10, 0, -2), [0, -2]),
        (pd.Index([1, 3, 5]), [7, 9]),
        (pd.Index([0.1, 0.2, 0.3, 0.4]), [0.5, 0.6]),
        (pd.to_timedelta([1, 2, 3], unit="s"), list(pd.to_timedelta([4, 5], unit="s"))),
    ],
)
def test_numbers_go_on(index, expected):
    found = sequel_of(index).ahead(2)
    if index.dtype.kind == "f":
        np.testing.assert_allclose(found, expected, rtol=1e-15)
    else:
        assert found.tolist() == expected
    assert found.name == index.name


@pytest.mark.parametrize(
    "index",
    [
        None,
        [1, 2, 3],
        pd.Index(["a", "b"]),
        pd.Index([1, 2, 4]),
        pd.Index([1, 1]),
        pd.DatetimeIndex(["2026-01-01"]),
        pd.DatetimeIndex(["2026-01-01", "2026-01-02", "2026-01-03 12:00"]),
        pd.MultiIndex.from_product([["a"], [1, 2]]),
        pd.RangeIndex(0),
    ],
)
def test_nothing_is_known_of_what_follows(index):
    found = sequel_of(index)
    assert found is None or found.ahead(2) is None


def linear():
    return KalmanFilter(1, 1, 1, F=[[0.9]], H=[[1.0]], Q=[[0.2]], R=[[0.5]], B=[[1.0]])


def extended():
    return ExtendedKalmanFilter(1, 1, fx=np.sin, hx=np.tanh, Q=0.2, R=0.5)


def bank():
    return IMMEstimator([linear(), linear()], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]])


@pytest.fixture
def fuzzy(fuzzy_model):
    return lambda: OFSRFilter(fuzzy_model, 3)


def hard():
    z = np.array([[0.5, 0.3], [0.3, 1.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    return CGOMSMFilter(
        CGOMSModel([[0.9, 0.1], [0.2, 0.8]], [[0.0, 0.0], [1.0, 2.0]], [[pair, pair], [pair, pair]], dim_x=1)
    )


MAKERS = [linear, extended, bank, hard, "fuzzy"]
HOURS = pd.date_range("2026-01-01", periods=5, freq="h", name="hour")
LOAD = pd.Series([0.3, 1.0, np.nan, 2.0, -0.4], HOURS)
AHEAD = pd.date_range("2026-01-01 05:00", periods=3, freq="h", name="hour")


@pytest.fixture(params=MAKERS, ids=lambda make: make if isinstance(make, str) else make.__name__)
def f(request):
    return (request.getfixturevalue(request.param) if isinstance(request.param, str) else request.param)()


def test_a_forecast_goes_on_where_the_series_ends(f):
    f.filter(LOAD)
    for one in (f, f.copy(), copy.deepcopy(f), pickle.loads(pickle.dumps(f))):
        assert one.forecast(3).index.equals(AHEAD)
        assert one.forecast(3).index.name == "hour"
    np.testing.assert_array_equal(f.forecast(3).to_dataframe()["x"], f.forecast(3).x[:, 0])
    assert f.filter_many(LOAD.to_frame(), resume=True).index.equals(HOURS)
    assert f.forecast(1).index.equals(AHEAD[:1])


def test_after_further_observations_the_index_is_that_of_their_end_or_none(f):
    f.filter(LOAD)
    f.step(0.2)
    moved = f.forecast(2).index
    if f.dim_x and isinstance(f, OFSRFilter | CGOMSMFilter):
        assert moved.equals(AHEAD[1:])  # a switching filter counts its observations
    else:
        assert moved is None
    f.filter(LOAD.to_numpy())
    assert f.forecast(2).index is None
    f.filter(LOAD)
    f.reset()
    assert f.forecast(1).index is None


@pytest.mark.parametrize("make", [linear, extended, "fuzzy", hard])
def test_a_smoother_ends_at_the_end_too(make, request):
    f = (request.getfixturevalue(make) if isinstance(make, str) else make)()
    assert f.smooth(LOAD).index.equals(HOURS)
    assert f.forecast(3).index.equals(AHEAD)
    with pytest.warns(StepsWarning, match="2 rows are missing"):
        f.smooth(GAPPY)


def test_parts_of_a_series_end_at_the_last(fuzzy):
    f = fuzzy()
    f.filter(LOAD[:3])
    f.filter(LOAD[3:], resume=True)
    assert f.forecast(3).index.equals(AHEAD)


def test_coordinates_of_a_data_array_are_kept(f):
    array = LOAD.to_xarray().assign_coords(feeder="east", of_day=("hour", np.arange(5)))
    found = f.filter(array)
    assert found.to_xarray().feeder == "east"
    assert found.to_xarray().of_day.values.tolist() == [0, 1, 2, 3, 4]
    assert found.index.equals(HOURS)
    assert found.to_xarray().indexes["hour"].equals(HOURS)
    np.testing.assert_array_equal(found.x, f.filter(LOAD).x if hasattr(f, "nodes") else found.x)
    assert f.forecast(3).index.equals(AHEAD)


LATER = {
    "overlap": HOURS[3:],
    "earlier": HOURS[:2],
    "a jump": HOURS + pd.Timedelta(days=2),
    "a zone": (HOURS + pd.Timedelta(hours=5)).tz_localize(BERLIN),
}


@pytest.mark.parametrize("kind", LATER)
def test_a_part_that_does_not_follow_is_refused(f, kind):
    index = LATER[kind]
    f.filter(LOAD)
    before = f.x.copy()
    with pytest.raises(
        ParameterError, match=r"zs: begins at .*, but the filter stands at 2026-01-01 04:00:00"
    ):
        f.filter(pd.Series(0.1, index), resume=True)
    np.testing.assert_array_equal(f.x, before)
    f.filter(pd.Series(0.1, AHEAD), resume=True)
    assert f.forecast(1).index[0] == AHEAD[-1] + pd.Timedelta(hours=1)
    f.filter(pd.Series(0.1, index).to_numpy(), resume=True)  # arrays have no times
    f.filter(LOAD.reset_index(drop=True), resume=True)  # parts are numbered anew


def test_periods_that_are_missing_are_told():
    months = pd.period_range("2026-01", periods=6, freq="M")
    linear().filter(pd.Series(0.1, months))  # a warning is an error here
    with pytest.warns(StepsWarning, match="1 row is missing"):
        linear().filter(pd.Series(0.1, months.delete(3)))


def test_the_index_of_unequal_steps_still_has_to_go_on():
    f = linear()
    uneven = pd.Series([1.0, 2.0, 3.0], HOURS[[0, 1, 4]] + pd.to_timedelta([0, 3, 5], unit="min"))
    with pytest.warns(StepsWarning, match="the steps between rows vary from"):
        f.filter(uneven)
    with pytest.raises(ParameterError, match="so that resume expects a later time next"):
        f.filter(uneven[:1], resume=True)


GAPPY = LOAD.drop(HOURS[[2, 3]])


@pytest.mark.parametrize("verb", ["filter", "filter_many"])
def test_rows_that_an_index_lacks_are_told(f, verb):
    zs = {"a": LOAD, "b": GAPPY} if verb == "filter_many" else GAPPY
    name = "series 'b'" if verb == "filter_many" else "zs"
    with pytest.warns(
        StepsWarning, match=rf"2 rows are missing \(index of {name}, .* NaN \(asfreq, reindex\)"
    ):
        getattr(f, verb)(zs)
    getattr(f, verb)({"a": LOAD} if verb == "filter_many" else LOAD)  # a warning is an error here


@pytest.mark.parametrize(
    "index",
    [
        pd.bdate_range("2026-01-01", periods=9),
        pd.DatetimeIndex(pd.bdate_range("2026-01-01", periods=9).to_numpy()).delete(4),
        pd.date_range("2026-01-31", periods=5, freq="ME"),
        pd.DatetimeIndex(pd.date_range("2026-01-31", periods=5, freq="ME").to_numpy()),
        pd.date_range("2026-03-28", periods=5, freq="D", tz=BERLIN),
        pd.DatetimeIndex(["2026-01-01", "2026-01-02"]),
    ],
)
def test_nothing_is_told_of_equal_steps(index):
    linear().filter(pd.Series(0.1, index))  # a warning is an error here


def test_whole_numbers_that_are_left_out_are_warned_of():
    f = KalmanFilter(1, 1, F=[[1.0]], H=[[1.0]])
    zs = pd.Series(np.arange(8.0), index=[0, 1, 2, 4, 5, 6, 7, 10])
    with pytest.warns(StepsWarning, match="zs: the index leaves out numbers in 2 of 7 steps"):
        f.filter(zs)
    for index in (np.arange(8) * 5, np.arange(8)[::-1], [3, 9, 11, 30, 31, 50, 77, 90], np.arange(8.0) ** 2):
        f.filter(pd.Series(np.arange(8.0), index=index))  # no warning: steps that are equal, or no count

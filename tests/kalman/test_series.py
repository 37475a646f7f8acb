"""batch_filter is filter with another result: of every filter, with every index."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter

DAYS = pd.date_range("2024-01-01", periods=4, freq="D")
ZS = pd.Series([1.0, np.nan, 3.0, 4.0], DAYS)
AHEAD = pd.date_range("2024-01-05", periods=2, freq="D")


class OwnVerb(KalmanFilter):
    """A filter with a verb of its own, which goes through series step by step."""

    def update(self, z, R=None, H=None):
        super().update(z, R, H)


def linear(kind=KalmanFilter, Q=1.0):
    return kind(1, 1, 1, F=[[0.9]], H=[[1.0]], B=[[2.0]], Q=Q, R=0.5)


def bank(method):
    return IMMEstimator([linear(), linear(Q=4.0)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


MAKERS = {
    "KalmanFilter": linear,
    "own verb": lambda: linear(OwnVerb),
    "ExtendedKalmanFilter": lambda: ExtendedKalmanFilter(1, 1, fx=lambda x, u=0.0: 0.9 * x + u, hx=np.tanh),
    "IMM": lambda: bank("imm"),
    "GPB2": lambda: bank("gpb2"),
}

#: What else `batch_filter` may be given: arguments of all filters, and of the linear one.
GIVEN = {"nothing": {}, "controls": {"us": [1.0, 0.0, 2.0, 0.5]}, "resume": {"resume": True}}
OF_LINEAR = {"Rs": {"Rs": [1.0] * 4}, "a saver": {"saver": type("Saver", (), {"save": lambda self: None})()}}
CASES = [(who, what) for who in MAKERS for what in GIVEN] + [
    (who, what) for who in ("KalmanFilter", "own verb") for what in OF_LINEAR
]


@pytest.mark.parametrize(("who", "what"), CASES)
def test_a_forecast_goes_on_after_it(who, what) -> None:
    f, given = MAKERS[who](), (GIVEN | OF_LINEAR)[what]
    f.batch_filter(ZS, **given)
    assert f.forecast(2).index.equals(AHEAD)
    f.batch_filter(ZS.to_numpy(), **given)
    assert f.forecast(2).index is None


def test_there_is_no_index_where_the_last_verb_was_predict() -> None:
    f = linear()
    f.batch_filter(ZS)
    f.batch_filter(ZS, update_first=True)
    assert f.forecast(1).index is None


@pytest.mark.parametrize("what", ["nothing", "controls"])
@pytest.mark.parametrize("who", MAKERS)
def test_it_resumes_as_filter_does(who, what) -> None:
    # both go on from x and P in any case: halves give what the whole gives
    given = GIVEN[what]
    halves = [{name: values[part] for name, values in given.items()} for part in (slice(2), slice(2, 4))]
    f, g = MAKERS[who](), MAKERS[who]()
    parts = [f.batch_filter(ZS[:2], **halves[0]), f.batch_filter(ZS[2:], **halves[1], resume=True)]
    whole = g.filter(ZS, **given)
    for name, *found in zip(("x", "P", "x_prior", "P_prior"), *parts, strict=True):
        np.testing.assert_allclose(
            np.concatenate(found).reshape(getattr(whole, name).shape), getattr(whole, name), rtol=1e-12
        )
    with pytest.raises(ParameterError, match="resume: got 'yes', expected True or False"):
        f.batch_filter(ZS, resume="yes")


#: Indexes that are those of no series, and what is said of them.
NO_SERIES = {
    "reversed": (DAYS[::-1], "zs: the index of row 1 is 2024-01-03 00:00:00, not later than"),
    "twice the same": (DAYS[[0, 1, 1, 2]], "zs: the index of row 2 is 2024-01-02 00:00:00, not later than"),
    "missing": (DAYS.insert(2, pd.NaT)[:4], "zs: the index of row 2 is not a time"),
    "durations": (pd.to_timedelta([1, 3, 2, 4], unit="s"), "zs: the index of row 2 is 0 days 00:00:02"),
}


@pytest.mark.parametrize("index", NO_SERIES)
@pytest.mark.parametrize(("who", "what"), CASES)
def test_an_index_has_to_increase(who, what, index) -> None:
    f, (rows, message) = MAKERS[who](), NO_SERIES[index]
    before = f.x.copy(), f.P.copy()
    with pytest.raises(ParameterError, match=message):
        f.filter(ZS.set_axis(rows))
    with pytest.raises(ParameterError, match=message):
        f.batch_filter(ZS.set_axis(rows), **(GIVEN | OF_LINEAR)[what])
    np.testing.assert_array_equal(f.x, before[0])
    np.testing.assert_array_equal(f.P, before[1])

"""What goes with observations row by row: its index, and controls of many series in every form."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter, batch_filter, rts_smoother

DAYS = pd.date_range("2024-01-01", periods=4, freq="D")
ZS = pd.Series([1.0, np.nan, 3.0, 4.0], DAYS)
WIDE = pd.DataFrame({"a": ZS, "b": ZS + 1.0})
US = pd.Series([1.0, 0.0, 2.0, 0.5], DAYS, name="u")


class OwnVerb(KalmanFilter):
    """A filter with a verb of its own, which goes through series step by step."""

    def predict(self, u=None, B=None, F=None, Q=None):
        super().predict(u, B, F, Q)


def linear(kind=KalmanFilter, Q=1.0):
    return kind(1, 1, 1, F=[[0.9]], H=[[1.0]], B=[[2.0]], Q=Q, R=0.5)


def extended():
    return ExtendedKalmanFilter(1, 1, 1, fx=lambda x, u=0.0: 0.9 * x + 2.0 * u, hx=lambda x: x, Q=1.0, R=0.5)


def bank(method="imm"):
    return IMMEstimator([linear(), linear(Q=4.0)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


MAKERS = {
    "KalmanFilter": linear,
    "own verb": lambda: linear(OwnVerb),
    "ExtendedKalmanFilter": extended,
    "IMM": bank,
    "GPB2": lambda: bank("gpb2"),
}


# ------------------------------------------------------------------ indexes

ONE = pd.Series([[[0.9]]] * 4, DAYS)  # a matrix for each row
RISING, COVARIANCES = np.arange(4.0)[:, None] ** 2, np.ones((4, 1, 1))

#: Verbs with what goes with the observations: who has them, the argument, the call with a table.
VERBS = {
    "filter": (MAKERS, "us", US, lambda f, zs, t: f.filter(zs, us=t).x),
    "smooth": (list(MAKERS)[:3], "us", US, lambda f, zs, t: f.smooth(zs, us=t).x),
    "batch_filter": (list(MAKERS)[:3], "us", US, lambda f, zs, t: f.batch_filter(zs, us=t)[0]),
    **{
        f"batch_filter {name}": (
            list(MAKERS)[:2],
            name,
            table,
            lambda f, zs, t, name=name: f.batch_filter(zs, us=np.ones(4), **{name: t})[0],
        )
        for name, table in {"Rs": US + 1, "Qs": US + 1, "Fs": ONE, "Hs": ONE, "Bs": ONE}.items()
    },
    "filter_many": (
        list(MAKERS)[:3],
        "us",
        US.to_frame(),
        lambda f, zs, t: f.filter_many(pd.DataFrame({"a": zs, "b": zs}), us=t).x[1],
    ),
    "filter_many of a mapping": (
        list(MAKERS)[:3],
        "us",
        US.to_frame(),
        lambda f, zs, t: f.filter_many({"a": zs.to_numpy()[:1], "b": zs}, us=t).x[1],
    ),
    "rts_smoother": (
        list(MAKERS)[:2],
        "Qs",
        US,
        lambda f, zs, t: f.rts_smoother(RISING, COVARIANCES, pd.Series([1.0] * 4, zs.index), t)[0],
    ),
    "the function rts_smoother": (
        ["KalmanFilter"],
        "Qs",
        US,
        lambda f, zs, t: rts_smoother(RISING, COVARIANCES, pd.Series([1.0] * 4, zs.index), t)[0],
    ),
    "the function batch_filter": (
        ["KalmanFilter"],
        "Rs",
        US + 1,
        lambda f, zs, t: batch_filter([0.0], 1.0, zs, [1.0] * 4, [1.0] * 4, [1.0] * 4, t)[0],
    ),
}

#: Tables whose index is another one.
OTHERS = {
    "reversed": lambda t: t[::-1],
    "a day later": lambda t: t.set_axis(DAYS + pd.Timedelta("1D")),
    "numbered": lambda t: t.reset_index(drop=True),
    "a row less": lambda t: t[:3],
    "a row more": lambda t: pd.concat([t, t[:1].set_axis([pd.Timestamp("2024-01-05")])]),
}

CASES = [(verb, who) for verb, (names, *_) in VERBS.items() for who in names]


@pytest.mark.parametrize(("verb", "who"), CASES)
def test_what_goes_with_observations_has_their_index(verb, who) -> None:
    _, name, table, call = VERBS[verb]
    found = call(MAKERS[who](), ZS, table)
    np.testing.assert_array_equal(found, call(MAKERS[who](), ZS, table.to_numpy()))
    other_numbers = call(MAKERS[who](), ZS, table * 0.5 if table is not ONE else ONE.map(lambda F: [[0.1]]))
    assert not np.array_equal(found, other_numbers)  # so that the table counts
    for other in OTHERS.values():
        f = MAKERS[who]()
        x, P = f.x.copy(), f.P.copy()
        with pytest.raises(ParameterError, match=f"{name}.*: rows of different indexes; .* has 4 from"):
            call(f, ZS, other(table))
        np.testing.assert_array_equal(f.x, x)
        np.testing.assert_array_equal(f.P, P)


@pytest.mark.parametrize("who", MAKERS)
def test_controls_of_a_forecast_have_the_index_of_the_rows_ahead(who) -> None:
    ahead = pd.Series([1.0, -2.0], pd.date_range("2024-01-05", periods=2))
    f = MAKERS[who]()
    expected = f.copy().forecast(2, us=ahead).x  # where nobody knows the rows ahead: by position
    np.testing.assert_array_equal(expected, f.forecast(2, us=[1.0, -2.0]).x)
    with pytest.raises(ParameterError, match="us: the index of row 1 is 2024-01-05"):
        f.forecast(2, us=ahead[::-1])
    f.filter(ZS)
    expected = f.forecast(2, us=[1.0, -2.0]).x
    assert not np.allclose(expected, f.forecast(2).x)
    np.testing.assert_array_equal(f.forecast(2, us=ahead).x, expected)
    np.testing.assert_array_equal(f.forecast(1, us=ahead).x, expected[:1])
    for us in (US, ahead[::-1], ahead.shift(freq="D"), ahead[:1], ahead.reset_index(drop=True)):
        with pytest.raises(ParameterError, match="forecast, us: rows of different indexes; forecast has 2"):
            f.forecast(2, us=us)
    f.filter(ZS.reset_index(drop=True))
    for us in ([1.0, -2.0], [1.0, -2.0, 9.0]):
        np.testing.assert_array_equal(
            f.forecast(2, us=pd.Series(us, range(4, 4 + len(us)))).x, f.forecast(2, us=us).x
        )
    np.testing.assert_array_equal(f.forecast(2, us=pd.Series(us[:2])).x, f.forecast(2, us=us).x)
    with pytest.raises(
        ParameterError, match=r"forecast, us: .*forecast has 2 from 4 to 5 and us has 2 from 0"
    ):
        f.forecast(2, us=pd.Series([0.0] * 6))

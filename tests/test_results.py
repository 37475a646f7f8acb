"""Results of whole series: intervals and tables."""

from __future__ import annotations

import builtins
import sys

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from fuzzykf import FilterResult
from fuzzykf.errors import MissingDependencyError, ParameterError


def result(m=1, **fields):
    n = 4
    x = np.arange(n * m, dtype=float).reshape(n, m)
    P = np.broadcast_to(np.diag(np.arange(1.0, m + 1) ** 2), (n, m, m))
    return FilterResult(x=x, P=P, **fields)


def test_length():
    assert len(result()) == 4
    assert len(FilterResult(log_likelihood=np.zeros(3))) == 3
    assert len(FilterResult(nodes=np.zeros(3))) == 0
    assert len(FilterResult(nodes=np.zeros(3), mu=np.zeros((5, 3)))) == 5


@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_interval_of_a_normal_law(level):
    r = result(m=2)
    lower, upper = r.interval(level)
    expected = scipy.stats.norm.interval(level, loc=r.x, scale=[[1.0, 2.0]])
    np.testing.assert_allclose(lower, expected[0], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(upper, expected[1], rtol=1e-12)


def test_interval_defaults_to_ninety_percent():
    np.testing.assert_array_equal(result().interval()[0], result().interval(0.9)[0])


def test_interval_of_many_series():
    r = FilterResult(x=np.zeros((3, 4, 2)), P=np.broadcast_to(np.eye(2), (3, 4, 2, 2)))
    assert r.interval()[1].shape == (3, 4, 2)


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, 90, np.nan])
def test_bad_level(level):
    with pytest.raises(ParameterError, match=r"level: got .*, expected a number between 0 and 1"):
        result().interval(level)


def test_interval_without_moments():
    with pytest.raises(ParameterError, match="the result holds no x and P"):
        FilterResult(mu=np.zeros((2, 2))).interval()


def test_dataframe_of_one_component():
    frame = result(
        x_prior=np.ones((4, 1)),
        P_prior=np.full((4, 1, 1), 9.0),
        switch=np.zeros(4),
        switch_mean=np.full(4, 0.5),
        log_likelihood=np.full(4, -1.0),
        lower=np.zeros((4, 1)),
        upper=np.ones((4, 1)),
        possibility=np.ones(4),
    ).to_dataframe()
    assert frame.columns.tolist() == [
        "x", "x_std", "x_prior", "x_prior_std", "lower", "upper", "switch", "switch_mean", "possibility",
        "log_likelihood",
    ]  # fmt: skip
    np.testing.assert_array_equal(frame["x"], np.arange(4))
    assert (frame["x_std"] == 1.0).all()
    assert (frame["x_prior_std"] == 3.0).all()


def test_dataframe_of_components_and_index():
    frame = result(m=2, index=list("abcd")).to_dataframe()
    assert frame.columns.tolist() == ["x0", "x1", "x0_std", "x1_std"]
    assert frame.index.tolist() == list("abcd")
    np.testing.assert_array_equal(frame["x1"], [1, 3, 5, 7])
    assert (frame["x1_std"] == 2.0).all()
    assert result(index=list("abcd")).to_dataframe(index=[4, 5, 6, 7]).index.tolist() == [4, 5, 6, 7]
    assert FilterResult(x=np.zeros((2, 1))).to_dataframe().columns.tolist() == ["x"]


def test_dataframe_of_many_series():
    x = np.arange(12.0).reshape(3, 4, 1)
    frame = FilterResult(x=x, P=x[..., None] ** 2, log_likelihood=-x[..., 0]).to_dataframe()
    assert frame.index.names == ["series", "step"]
    assert frame.columns.tolist() == ["x", "x_std", "log_likelihood"]
    assert frame.loc[(2, 1), "x"] == 9.0
    assert frame.loc[(2, 1), "x_std"] == 9.0
    assert len(frame) == 12
    days = pd.date_range("2026-01-01", periods=4, name="day")
    named = FilterResult(x=x, names=pd.Index(list("abc"), name="meter"), index=days).to_dataframe()
    assert named.index.names == ["meter", "day"]
    np.testing.assert_array_equal(named.xs(days[2], level="day")["x"], [2.0, 6.0, 10.0])
    assert FilterResult(x=x).to_dataframe(index=list("wxyz")).loc[(1, "z"), "x"] == 7.0
    with pytest.raises(ParameterError, match=r"index: got .* expected one entry a step"):
        FilterResult(x=x).to_dataframe(index=[1, 2])


def test_series_end_where_they_end():
    x = np.arange(8.0).reshape(2, 4, 1)
    hours = pd.date_range("2026-01-01", periods=4, freq="h", tz="Europe/Berlin", name="hour")
    many = FilterResult(
        x=x, names=["a", "b"], index=[hours[:2], hours], lengths=np.array([2, 4]), mu=x, nodes=np.zeros(1)
    )
    assert len(many.to_dataframe()) == 6
    assert many.to_dataframe().index.names == ["series", "hour"]
    assert many.to_dataframe().loc["a"].index.equals(hours[:2])
    assert repr(many).startswith("FilterResult of 2 series of up to 4 steps")
    one = many.one("a")
    np.testing.assert_array_equal(one.x, [[0.0], [1.0]])
    assert one.index.equals(hours[:2])
    np.testing.assert_array_equal(one.nodes, [0.0])
    assert not one.is_many
    ds = many.to_xarray()
    assert ds.sizes == {"series": 2, "hour": 4, "state": 1, "node": 1}
    assert ds["length"].values.tolist() == [2, 4]
    assert ds["hour_of_series"].values[0, 1] == hours[1]
    assert pd.isna(ds["hour_of_series"].values[0, 2])
    assert ds.sel(series="b").x.values.ravel().tolist() == [4.0, 5.0, 6.0, 7.0]
    naive = FilterResult(
        x=x, index=[hours[:2].tz_localize(None), hours.tz_localize(None)], lengths=many.lengths
    )
    assert naive.to_xarray()["hour_of_series"].dtype.kind == "M"
    assert np.isnat(naive.to_xarray()["hour_of_series"].values[0, 2])
    with pytest.raises(ParameterError, match="name: got 'c', expected one of a, b"):
        many.one("c")
    with pytest.raises(ParameterError, match="one: the result is of one series"):
        one.one("a")


def test_dataset_of_one_series():
    days = pd.date_range("2026-01-01", periods=4, name="day")
    ds = result(m=2, index=days).to_xarray()
    assert ds.x.dims == ("day", "state")
    assert ds.P.dims == ("day", "state", "state_column")
    assert ds.indexes["day"].equals(days)
    assert ds.x.attrs["long_name"].startswith("mean of the state")
    assert "day" not in result().to_xarray().coords
    periods = FilterResult(x=np.zeros((3, 1)), index=pd.period_range("2026-01", periods=3, freq="M"))
    assert periods.to_xarray().time.values[2] == pd.Period("2026-03", "M")
    switch = FilterResult(mu=np.full((2, 3), 1 / 3), nodes=np.array([0.0, 0.5, 1.0]), index=["a", "b"])
    assert switch.to_xarray().node.values.tolist() == [0.0, 0.5, 1.0]
    assert switch.to_xarray().step.values.tolist() == ["a", "b"]


@pytest.mark.parametrize("m", [1, 2])
def test_intervals_keep_an_index_of_pandas(m):
    days = pd.date_range("2026-01-01", periods=4)
    plain, dated = result(m=m), result(m=m, index=days)
    lower, upper = dated.interval(0.8)
    assert lower.index.equals(days)
    assert lower.columns.tolist() == (["x"] if m == 1 else ["x0", "x1"])
    np.testing.assert_array_equal(lower, plain.interval(0.8)[0])
    np.testing.assert_array_equal(upper, plain.interval(0.8)[1])
    frame = dated.to_dataframe(level=0.8)
    ends = frame[[c for c in frame if c.endswith("_lower")]]
    np.testing.assert_array_equal(ends, lower)
    assert isinstance(result(m=m, index=list("abcd")).interval()[0], np.ndarray)
    with pytest.raises(ParameterError, match="level: got 2"):
        dated.to_dataframe(level=2)


def test_dataframe_without_pandas(monkeypatch):
    load = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "pandas":
            raise ImportError(name)
        return load(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "pandas", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        MissingDependencyError, match=r"to_dataframe needs pandas: pip install 'fuzzykf\[cli\]'"
    ):
        result().to_dataframe()


def test_results_are_values():
    with pytest.raises(AttributeError):
        result().x = np.zeros((4, 1))

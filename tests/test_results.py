"""Results of whole series: intervals and tables."""

from __future__ import annotations

import builtins
import sys

import numpy as np
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
    with pytest.raises(ParameterError, match=r"many series \(x has shape \(3, 4, 1\)\); select one"):
        FilterResult(x=np.zeros((3, 4, 1))).to_dataframe()


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

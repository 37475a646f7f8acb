"""Shapes and missing data of observations, and what a filter inherits."""

from __future__ import annotations

import copy

import numpy as np
import pandas as pd
import pytest

from fuzzykf import Filter
from fuzzykf.base import as_many, as_observation, as_observations, check_keep
from fuzzykf.errors import ParameterError, ShapeError

# --------------------------------------------------------------------------- one observation


@pytest.mark.parametrize(
    "z",
    [
        2,
        2.0,
        np.float32(2),
        np.int64(2),
        [2],
        (2.0,),
        [[2.0]],
        np.array(2.0),
        np.array([[2]]),
        pd.Series([2]),
    ],
)
def test_scalar_observations(z):
    y = as_observation(z, 1)
    assert y.shape == (1,)
    assert y.dtype == np.float64
    assert y[0] == 2.0


@pytest.mark.parametrize("z", [[1, 2], (1.0, 2.0), [[1.0, 2.0]], [[1.0], [2.0]], np.array([1, 2])])
def test_vector_observations(z):
    np.testing.assert_array_equal(as_observation(z, 2), [1.0, 2.0])


@pytest.mark.parametrize("z", [None, np.nan, [np.nan], [[np.nan]], np.float64("nan"), [None]])
def test_missing_scalars(z):
    assert as_observation(z, 1) is None


def test_missing_vectors():
    assert as_observation(None, 2) is None
    assert as_observation([np.nan, np.nan], 2) is None
    np.testing.assert_array_equal(as_observation([np.nan, 1.0], 2), [np.nan, 1.0])
    np.testing.assert_array_equal(as_observation([None, 1.0], 2), [np.nan, 1.0])


def test_observations_are_copied():
    for z in (np.array([1.0, 2.0]), np.array([[1.0], [2.0]])):
        y = as_observation(z, 2)
        y[0] = 9.0
        assert z.ravel()[0] == 1.0


@pytest.mark.parametrize(
    ("z", "dim_z", "error", "message"),
    [
        ([1, 2], 1, ShapeError, r"z: got shape \(2,\), expected a scalar, \(1,\) or \(1, 1\)"),
        (1.0, 2, ShapeError, r"z: got shape \(\), expected \(2,\), \(2, 1\) or \(1, 2\)"),
        ([[1, 2], [3, 4]], 2, ShapeError, r"z: got shape \(2, 2\), expected \(2,\), \(2, 1\) or \(1, 2\)"),
        ([[[1.0]]], 1, ShapeError, r"z: got shape \(1, 1, 1\)"),
        ([], 1, ShapeError, r"z: got shape \(0,\)"),
        ("abc", 1, ShapeError, "z: expected 1 number, got 'abc', which is text"),
        ({"a": 1.0}, 1, ShapeError, "which goes by name, but no names are known here"),
        ([1, [2, 3]], 2, ShapeError, "z: expected 2 numbers"),
        (1j, 1, ShapeError, "z: expected 1 number, got 1j"),
        (np.inf, 1, ParameterError, r"z: got \[inf\], expected finite numbers \(NaN where missing\)"),
        ([1.0, -np.inf], 2, ParameterError, r"z: got \[1\.0, -inf\], expected finite"),
        ([np.nan, np.inf], 2, ParameterError, r"z: got \[nan, inf\], expected finite"),
    ],
)
def test_bad_observations(z, dim_z, error, message):
    with pytest.raises(error, match=message):
        as_observation(z, dim_z)


# --------------------------------------------------------------------------- a series


@pytest.mark.parametrize(
    "zs",
    [
        [1, 2, 3],
        (1.0, 2.0, 3.0),
        range(1, 4),
        np.array([1, 2, 3]),
        np.array([[1], [2], [3]]),
        np.array([[[1]], [[2]], [[3]]]),
        np.array([1, 2, 3], dtype=object),
        [np.array([1.0]), 2.0, [[3.0]]],
        pd.Series([1, 2, 3]),
        pd.DataFrame({"a": [1, 2, 3]}),
        (z for z in (1, 2, 3)),
    ],
    ids=lambda zs: type(zs).__name__,
)
def test_scalar_series(zs):
    y = as_observations(zs, 1)
    assert y.dtype == np.float64
    np.testing.assert_array_equal(y, [[1.0], [2.0], [3.0]])


@pytest.mark.parametrize(
    "convert",
    [np.asarray, lambda a: a[..., None], lambda a: a[:, None, :], list, lambda a: a.tolist(), pd.DataFrame],
)
def test_vector_series(convert):
    zs = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(as_observations(convert(zs), 2), zs)


def test_missing_in_a_series():
    expected = [[1.0], [np.nan], [3.0]]
    for zs in ([1.0, None, 3.0], [1.0, np.nan, 3.0], np.array([1.0, np.nan, 3.0]), pd.Series([1, None, 3])):
        np.testing.assert_array_equal(as_observations(zs, 1), expected)
    vectors = [[1.0, 2.0], None, [np.nan, 3.0], [None, 4.0]]
    expected = [[1.0, 2.0], [np.nan, np.nan], [np.nan, 3.0], [np.nan, 4.0]]
    np.testing.assert_array_equal(as_observations(vectors, 2), expected)


def test_empty_series():
    for zs in ([], np.empty((0, 1)), np.array([])):
        assert as_observations(zs, 1).shape == (0, 1)
    assert as_observations([], 3).shape == (0, 3)


def test_series_are_copied():
    zs = np.ones((3, 1))
    as_observations(zs, 1)[0] = 9.0
    assert zs[0, 0] == 1.0


@pytest.mark.parametrize(
    ("zs", "dim_z", "error", "message"),
    [
        (
            np.zeros((3, 2)),
            1,
            ShapeError,
            r"zs: got shape \(3, 2\), expected \(n, 1\) or \(n, 1, 1\) or \(n,\)",
        ),
        (np.zeros(3), 2, ShapeError, r"zs: got shape \(3,\), expected \(n, 2\) or \(n, 2, 1\)$"),
        (np.array(1.0), 1, ShapeError, r"zs: got shape \(\)"),
        (np.zeros((2, 2, 2)), 2, ShapeError, r"zs: got shape \(2, 2, 2\)"),
        ([1.0, [1.0, 2.0]], 1, ShapeError, r"z: got shape \(2,\)"),
        (["a", "b"], 1, ShapeError, "z: expected 1 number, got 'a'"),
        (np.array(["a", "b"]), 1, ShapeError, "zs: expected numbers, got an array of <U1"),
        (
            np.array([0.0, np.inf]),
            1,
            ParameterError,
            r"zs: observation 1 is \[inf\], expected finite numbers",
        ),
        ([0.0, np.inf], 1, ParameterError, r"z: got \[inf\], expected finite numbers"),
    ],
)
def test_bad_series(zs, dim_z, error, message):
    with pytest.raises(error, match=message):
        as_observations(zs, dim_z)


def test_many_series():
    zs = np.arange(12.0)
    np.testing.assert_array_equal(as_many(zs.reshape(2, 6), 1), zs.reshape(2, 6, 1))
    np.testing.assert_array_equal(as_many(zs.reshape(2, 3, 2), 2), zs.reshape(2, 3, 2))
    np.testing.assert_array_equal(as_many([[1.0, None]], 1), [[[1.0], [np.nan]]])
    for bad, dim_z, message in (
        (zs, 1, r"zs: got shape \(12,\), expected \(series, n, 1\) or \(series, n\)"),
        (zs.reshape(3, 4), 2, r"zs: got shape \(3, 4\), expected \(series, n, 2\)$"),
        ([[1.0], [1.0, 2.0]], 1, "pad series of unequal length with NaN"),
        ([[0.0, 0.0], [0.0, np.inf]], 1, r"zs: observation 1 of series 1 is \[inf\]"),
    ):
        with pytest.raises(ParameterError, match=message):
            as_many(bad, dim_z)


def test_keep():
    assert check_keep("x", ("x", "P")) == ("x",)
    assert check_keep(iter(["P", "x"]), ("x", "P")) == ("P", "x")
    with pytest.raises(ParameterError, match="keep: got 'Q', expected names among x, P"):
        check_keep(["x", "Q"], ("x", "P"))


# --------------------------------------------------------------------------- what a filter inherits


class Mean(Filter):
    """The running mean of what was seen: the smallest filter there is."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P, self.n = np.zeros((1, 1)), np.eye(1), 0
        self.x_prior, self.P_prior = self.x, self.P

    def predict(self):
        self.remember_origin()
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()

    def update(self, z):
        self.remember_origin()
        y = as_observation(z, 1)
        if y is not None:
            self.n += 1
            self.x = self.x + (y[:, None] - self.x) / self.n


class Likely(Mean):
    log_likelihood = 0.0

    def update(self, z):
        super().update(z)
        self.log_likelihood = -float(self.n)


def test_step_returns_the_estimate():
    f = Mean()
    assert f.step(2.0).tolist() == [[2.0]]
    assert f.step(None).tolist() == [[2.0]]
    assert f.step([4.0]) is f.x
    assert f.x.tolist() == [[3.0]]


def test_inherited_filter():
    result = Mean().filter([2.0, None, 4.0])
    np.testing.assert_array_equal(result.x, [[2.0], [2.0], [3.0]])
    np.testing.assert_array_equal(result.x_prior, [[0.0], [2.0], [2.0]])
    assert (result.P.shape, result.P_prior.shape) == ((3, 1, 1), (3, 1, 1))
    assert result.log_likelihood is None
    assert result.index is None
    np.testing.assert_array_equal(Likely().filter([2.0, 1.0]).log_likelihood, [-1.0, -2.0])
    assert Mean().filter([]).x.shape == (0, 1)
    series = pd.Series([1.0, 2.0], index=["a", "b"])
    assert Mean().filter(series).to_dataframe().index.tolist() == ["a", "b"]


def test_inherited_batch_filter():
    means, covariances, means_p, covariances_p = Mean().batch_filter([2.0, 4.0])
    np.testing.assert_array_equal(means, [[[2.0]], [[3.0]]])
    np.testing.assert_array_equal(means_p, [[[0.0]], [[2.0]]])
    assert covariances.shape == covariances_p.shape == (2, 1, 1)


def test_inherited_filter_many():
    f = Mean()
    result = f.filter_many([[2.0, 4.0], [1.0, np.nan]], keep=("x",))
    np.testing.assert_array_equal(result.x[..., 0], [[2.0, 3.0], [1.0, 1.0]])
    assert result.P is None
    assert f.n == 0
    with pytest.raises(ParameterError, match="keep: got 'log_likelihood', expected names among"):
        f.filter_many([[1.0]], keep=("x", "log_likelihood"))
    with pytest.raises(ShapeError, match="got no series, expected at least one"):
        f.filter_many(np.empty((0, 3)))


def test_reset_returns_to_the_first_verb():
    f = Mean()
    f.reset()  # nothing to return to
    f.x = np.array([[5.0]])  # set by the user before the first verb: part of the beginning
    f.step(1.0)
    f.step(3.0)
    f.reset()
    assert (f.x.tolist(), f.n) == ([[5.0]], 0)
    f.step(8.0)
    assert f.x.tolist() == [[8.0]]
    f.reset()
    assert f.x.tolist() == [[5.0]]


def test_reset_survives_changes_in_place():
    f = Mean()
    f.step(1.0)
    f.x[:] = 7.0
    f.reset()
    assert f.x.tolist() == [[0.0]]


def test_copies_are_independent():
    f = Mean()
    f.step(1.0)
    g = f.copy()
    g.step(5.0)
    assert f.x.tolist() == [[1.0]]
    assert copy.deepcopy(f).x.tolist() == [[1.0]]
    g.reset()
    assert (g.x.tolist(), f.x.tolist()) == ([[0.0]], [[1.0]])


def test_the_contract_has_to_be_filled():
    with pytest.raises(TypeError, match="abstract"):
        Filter()


def test_filter_many_keeps_what_the_filter_fills_by_default():
    # a filter without a likelihood has none to keep, and says so only if it is asked for
    from fuzzykf import FuzzyRelationEstimator, IntervalMembership

    bound = IntervalMembership(-1.0, 1.0)
    estimator = FuzzyRelationEstimator(
        1, 1, state=bound, process_noise=bound, measurement_noise=bound, hx=lambda x: x
    )
    zs = np.array([[0.1, 0.2, 0.3], [0.3, np.nan, 0.1]])
    result = estimator.filter_many(zs)
    for k, one in enumerate(zs):
        np.testing.assert_array_equal(result.x[k], estimator.copy().filter(one).x)
    assert result.log_likelihood is None
    with pytest.raises(ParameterError, match="keep: got 'log_likelihood'"):
        estimator.filter_many(zs, keep=["log_likelihood"])


def test_an_attribute_that_has_the_name_of_a_field_but_is_none_of_it_stays_out() -> None:
    class Named(Mean):
        switch = "on"
        mu = None
        possibility = np.zeros(7)
        log_likelihood = -1.5

    result = Named().filter([1.0, 2.0])
    assert result.switch is None
    assert result.mu is None
    assert result.possibility is None
    np.testing.assert_array_equal(result.log_likelihood, [-1.5, -1.5])


@pytest.mark.parametrize(
    "zs",
    [{0: 5.0}, {1.0, 2.0}, b"12", bytearray(b"12"), memoryview(b"12"), "12"],
    ids=lambda zs: type(zs).__name__,
)
def test_what_is_no_series_is_refused(zs):
    # the keys of a mapping, and the members of a set, are no observations
    with pytest.raises(ParameterError, match=rf"zs: got .*\({type(zs).__name__}\), expected a series"):
        as_observations(zs, 1)


def test_the_observation_that_is_no_number_is_named():
    with pytest.raises(ShapeError, match=r"zs: observation 1, z: expected 1 number, got 'b'"):
        as_observations([1.0, "b"], 1)


def test_an_index_of_times_has_to_increase():
    pd = pytest.importorskip("pandas")
    zs = pd.Series([1.0, 2.0], index=pd.to_datetime(["2020-01-02", "2020-01-01"]))
    with pytest.raises(ParameterError, match="zs: the index of row 1 is 2020-01-01"):
        as_observations(zs, 1)

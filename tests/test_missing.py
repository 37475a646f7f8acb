"""What is missing is missing, whatever it comes in; what is no number is refused."""

from __future__ import annotations

import datetime

import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    DailyProfile,
    ExtendedKalmanFilter,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    Standardizer,
)
from fuzzykf.comparison import prepare
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.missing import as_floats

PLAIN = [1.0, np.nan, 0.5, -0.3]

#: The same four observations in every dress.
DRESSES = {
    "masked": np.ma.array([1.0, -999.0, 0.5, -0.3], mask=[0, 1, 0, 0]),
    "masked column": np.ma.array([[1.0], [-999.0], [0.5], [-0.3]], mask=[[0], [1], [0], [0]]),
    "masked whole numbers with NaN": np.ma.array([1.0, np.nan, 0.5, -0.3], mask=[0, 0, 0, 0]),
    "masked objects": np.ma.array([1.0, "?", 0.5, -0.3], mask=[0, 1, 0, 0], dtype=object),
    "masked by iteration": list(np.ma.array([1.0, -999.0, 0.5, -0.3], mask=[0, 1, 0, 0])),
    "list of masked rows": [np.ma.array([v], mask=[k == 1]) for k, v in enumerate([1.0, -999.0, 0.5, -0.3])],
    "None": [1.0, None, 0.5, -0.3],
    "NA in a list": [1.0, pd.NA, 0.5, -0.3],
    "NA in objects": np.array([1.0, pd.NA, 0.5, -0.3], dtype=object),
    "nullable Series": pd.Series([1.0, None, 0.5, -0.3], dtype="Float64"),
    "Series of objects": pd.Series([1.0, pd.NA, 0.5, -0.3], dtype=object),
    "nullable frame": pd.DataFrame({"y": pd.array([1.0, None, 0.5, -0.3], dtype="Float64")}),
}

#: What is no measurement.
NONSENSE = {
    "a text": "0.3",
    "texts": ["0.3", "0.4"],
    "an array of texts": np.array(["0.3", "0.4"]),
    "objects: texts": np.array([np.str_("0.3"), 0.4], dtype=object),
    "objects: times": np.array([np.datetime64("2026-01-01"), 0.4], dtype=object),
    "objects: complex": np.array([np.complex128(1.0), 0.4], dtype=object),
    "a time": datetime.datetime(2026, 1, 1),
    "a stamp": pd.Timestamp("2026-01-01"),
    "times": np.array(["2026-01-01", "2026-01-02"], dtype="datetime64[s]"),
    "spans": np.array([1, 2], dtype="timedelta64[s]"),
    "bytes": b"12",
    "bytes that can be changed": bytearray(b"12"),
    "bytes that are looked at": memoryview(b"12"),
    "a list of bytes": [b"1", b"2"],
    "a list of bytes that can be changed": [bytearray(b"1"), bytearray(b"2")],
    "a list of bytes that are looked at": [memoryview(b"1"), memoryview(b"2")],
    "raw memory": np.void(b"12"),
    "periods": [pd.Period("2026-01"), pd.Period("2026-02")],
    "stamps in a list": [pd.Timestamp("2026-01-01"), None],
    "complex": 1.0 + 2.0j,
    "complex numbers": [1.0 + 2.0j, 1.0],
}


@pytest.fixture(scope="module")
def filters(fuzzy_model):
    """Ways to make one of each kind of filter of a scalar observation."""

    def kalman():
        f = KalmanFilter(1, 1)
        f.F, f.H, f.Q, f.R = 0.9 * np.eye(1), np.eye(1), 0.1 * np.eye(1), 0.2 * np.eye(1)
        return f

    def extended():
        f = ExtendedKalmanFilter(1, 1)
        f.F, f.Q, f.R = 0.9 * np.eye(1), 0.1 * np.eye(1), 0.2 * np.eye(1)
        f.hx, f.H_jacobian = (lambda x: x), (lambda x: np.eye(1))
        return f

    def bank():
        return IMMEstimator([kalman(), kalman()], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])

    def estimator():
        one = GaussianMembership([0.0], [[1.0]])
        return FuzzyRelationEstimator(1, 1, H=[[1.0]], state=one, process_noise=one, measurement_noise=one)

    return {
        "OFSRFilter": lambda: OFSRFilter(fuzzy_model, 3),
        "CGOMSMFilter": lambda: CGOMSMFilter(fuzzy_model.harden()),
        "KalmanFilter": kalman,
        "ExtendedKalmanFilter": extended,
        "IMMEstimator": bank,
        "FuzzyRelationEstimator": estimator,
    }


FILTERS = [
    "OFSRFilter",
    "CGOMSMFilter",
    "KalmanFilter",
    "ExtendedKalmanFilter",
    "IMMEstimator",
    "FuzzyRelationEstimator",
]


@pytest.mark.parametrize("dress", DRESSES)
@pytest.mark.parametrize("name", FILTERS)
def test_series_with_something_missing(filters, name, dress) -> None:
    zs = DRESSES[dress]
    expected, result = filters[name]().filter(PLAIN), filters[name]().filter(zs)
    np.testing.assert_array_equal(np.asarray(result.x), np.asarray(expected.x))
    np.testing.assert_array_equal(np.asarray(result.P), np.asarray(expected.P))
    for verb in ("smooth", "batch_filter"):
        f, g = filters[name](), filters[name]()
        if hasattr(f, verb) and getattr(f, "has_smoother", True) and name != "ExtendedKalmanFilter":
            one, other = getattr(f, verb)(PLAIN), getattr(g, verb)(zs)
            one, other = (r.x if verb == "smooth" else r[0] for r in (one, other))
            np.testing.assert_array_equal(np.asarray(other), np.asarray(one))


@pytest.mark.parametrize("dress", DRESSES)
@pytest.mark.parametrize("name", FILTERS)
def test_observations_one_after_the_other(filters, name, dress) -> None:
    zs = DRESSES[dress]
    f, g, h = filters[name](), filters[name](), filters[name]()
    values = zs.iloc[:, 0] if isinstance(zs, pd.DataFrame) else zs
    for plain, z in zip(PLAIN, values, strict=True):
        f.step(plain)
        g.step(z)
        h.predict()
        h.update(z)
        np.testing.assert_allclose(g.x, f.x, rtol=1e-13)
        np.testing.assert_allclose(h.x, f.x, rtol=1e-13)


@pytest.mark.parametrize("name", [name for name in FILTERS if name != "FuzzyRelationEstimator"])
def test_many_series(filters, name) -> None:
    data = np.array([[1.0, -999.0, 0.5], [0.2, 0.1, -999.0]])
    masked = np.ma.array(data, mask=data == -999.0)
    expected = filters[name]().filter_many(np.where(data == -999.0, np.nan, data)).x
    for zs in (masked, list(masked), pd.DataFrame(masked.filled(np.nan)).astype("Float64").to_numpy()):
        np.testing.assert_array_equal(filters[name]().filter_many(zs).x, expected)


@pytest.mark.parametrize("nonsense", NONSENSE)
@pytest.mark.parametrize("name", FILTERS)
def test_what_is_no_number_is_refused_and_changes_nothing(filters, name, nonsense) -> None:
    f, value = filters[name](), NONSENSE[nonsense]
    f.step(0.1)
    before = np.array(f.x)
    for call in (f.step, f.filter):
        with pytest.raises((ShapeError, ParameterError), match=r"^zs?: "):
            call(value)
        np.testing.assert_array_equal(f.x, before)
    f.predict()
    with pytest.raises((ShapeError, ParameterError), match=r"^z: "):
        f.update(value)


def test_a_known_switch(fuzzy_model) -> None:
    r = [0.0, 0.5, 1.0, 1.0]
    expected = KnownSwitchFilter(fuzzy_model).filter(PLAIN, r).x
    for zs in DRESSES.values():
        np.testing.assert_array_equal(np.asarray(KnownSwitchFilter(fuzzy_model).filter(zs, r).x), expected)


def test_learning_and_preparation(fuzzy_model) -> None:
    trajectory = fuzzy_model.simulate(150, np.random.default_rng(0))
    x, y = trajectory.x[:, 0], trajectory.y[:, 0].copy()
    gone = np.zeros(150, dtype=bool)
    gone[[20, 70, 71]] = True
    plain = np.where(gone, np.nan, y)
    masked = np.ma.array(np.where(gone, -999.0, y), mask=gone)
    nullable = pd.Series(plain).astype("Float64")
    options = {"law": "fmc1", "n_nodes": 1, "form": "regression", "max_iter": 3, "n_starts": 1}
    expected = CGOFMSModel.fit(x, plain, **options)
    for value in (masked, nullable, list(masked)):
        assert CGOFMSModel.fit(x, value, **options).log_likelihood == expected.log_likelihood
    scaled = Standardizer().fit(plain).transform(plain)
    for value in (masked, nullable):
        np.testing.assert_array_equal(
            np.asarray(Standardizer().fit(value).transform(value), dtype=float), scaled
        )


def test_parameters_are_not_masked(fuzzy_model) -> None:
    with pytest.raises(FuzzykfError, match="means: entry"):
        CGOFMSModel(
            fuzzy_model.law,
            np.ma.array([[0.0, 3.0], [0.0, 0.0]], mask=[[0, 1], [0, 0]]),
            fuzzy_model.form.covariances,
            1,
        )


def test_as_floats() -> None:
    for value in DRESSES.values():
        np.testing.assert_array_equal(as_floats(value).ravel(), PLAIN)
    given = np.arange(3.0)
    assert as_floats(given) is given
    np.testing.assert_array_equal(as_floats([True, 2]), [1.0, 2.0])
    assert np.isnan(as_floats(np.ma.masked))
    with pytest.raises(ValueError, match=r"unequal length|inhomogeneous"):
        as_floats([[1.0, 2.0], [3.0]])
    for value in NONSENSE.values():
        with pytest.raises((TypeError, ValueError)):
            as_floats(value)


@pytest.mark.parametrize(
    "hide",
    [
        lambda days: np.ma.array(days, mask=[1] + 47 * [0]),
        lambda days: pd.array(days, "boolean").take(range(48)),
    ],
)
def test_a_working_day_may_not_be_missing(hide):
    time = pd.date_range("2014-01-06", periods=48, freq="h")
    days = hide(np.arange(48) < 24)
    if not isinstance(days, np.ma.MaskedArray):
        days[0] = pd.NA
    with pytest.raises(
        ParameterError, match="workday: row 0 is missing, expected True or False in every row"
    ):
        DailyProfile().fit(np.arange(48.0), time, days)
    with pytest.raises(ParameterError, match="workday: row 0 is missing"):
        prepare(np.arange(48.0), np.arange(48.0) ** 2, workday=days)

"""What is told of single steps of a series is what the verbs are told; tables in, tables out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    KalmanFilter,
)
from fuzzykf.errors import ParameterError, ShapeError, StepsWarning

F, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
ZS = [1.0, None, 2.0, 2.5]
US = [[0.1], [0.0], [-0.2], [0.3]]
TOLD = {
    "us": US,
    "Rs": [None, 0.3, [[2.0]], GaussianMembership(0.0, 0.1)],
    "Qs": [0.1, None, np.eye(2), GaussianMembership([0.0, 0.0], 0.2 * np.eye(2))],
    "Fs": [None, F, np.eye(2), None],
    "Hs": [None, None, [[1.0, 0.5]], None],
}
GAUSS, BOX = GaussianMembership(0.0, 1.0), IntervalMembership(-1.0, 1.0)


def gaussian(**options):
    return FuzzyRelationEstimator(2, 1, 1, F=F, H=H, Q=0.1 * np.eye(2), R=0.5, B=[[0.0], [1.0]], **options)


def by_verbs(est, zs, told):
    xs = []
    for k, z in enumerate(zs):
        rows = {name: values[k] for name, values in told.items()}
        est.predict(rows.get("us"), F=rows.get("Fs"), Q=rows.get("Qs"), **(rows.get("fx_args") or {}))
        est.update(z, R=rows.get("Rs"), H=rows.get("Hs"), **(rows.get("hx_args") or {}))
        xs.append(est.x.ravel())
    return np.array(xs)


def test_steps_are_what_the_verbs_are_told() -> None:
    est, other = gaussian(), gaussian()
    assert np.array_equal(est.filter(ZS, **TOLD).x, by_verbs(other, ZS, TOLD))
    assert np.array_equal(est.step(1.0), other.step(1.0))  # it ends there


def test_it_is_the_kalman_filter_told_the_same() -> None:
    told = TOLD | {"us": np.array(US)[..., None], "Rs": [0.5, 0.3, 2.0, 0.1], "Qs": [0.1, 0.1, 1.0, 0.2]}
    kf = KalmanFilter(2, 1, 1, F=F, H=H, Q=0.1 * np.eye(2), R=0.5, B=[[0.0], [1.0]])
    for verb in ("filter", "smooth"):
        found, expected = getattr(gaussian(), verb)(ZS, **told), getattr(kf, verb)(ZS, **told)
        np.testing.assert_allclose(found.x, expected.x, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(found.P, expected.P, rtol=1e-10, atol=1e-14)
        kf = KalmanFilter(2, 1, 1, F=F, H=H, Q=0.1 * np.eye(2), R=0.5, B=[[0.0], [1.0]])


@pytest.mark.parametrize("points", [None, 101])
def test_memberships_of_single_steps_on_boxes_and_grids(points) -> None:
    shapes = [None, IntervalMembership(-0.2, 0.2), IntervalMembership(-3.0, 3.0), BOX]
    given = {"state": BOX, "process_noise": IntervalMembership(-0.3, 0.3), "measurement_noise": BOX, "H": 1.0}
    est = FuzzyRelationEstimator(1, 1, points=points, **given)
    zs, told = [0.4, 0.1, 0.5, 0.3], {"Rs": shapes, "Qs": shapes}
    assert np.array_equal(est.copy().filter(zs, **told).x, by_verbs(est.copy(), zs, told))
    filtered, smoothed = est.copy().filter(zs, **told), est.smooth(zs, **told)
    assert (smoothed.lower >= filtered.lower - 1e-12).all()
    assert (smoothed.upper <= filtered.upper + 1e-12).all()
    assert (smoothed.upper - smoothed.lower)[0] < (filtered.upper - filtered.lower)[0]


def test_keyword_arguments_of_functions() -> None:
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x, dt=1.0: x + dt,
        hx=lambda x, gain=1.0: gain * x,
        state=GAUSS,
        process_noise=GAUSS,
        measurement_noise=GAUSS,
        points=51,
    )
    told = {"fx_args": [{"dt": 0.5}, None, {"dt": 2.0}], "hx_args": [None, {"gain": 2.0}, None]}
    zs = [0.4, 3.0, 3.5]
    assert np.array_equal(est.copy().filter(iter(zs), **told).x, by_verbs(est.copy(), zs, told))
    assert np.isfinite(est.smooth(zs, **told).x).all()


def test_tables_go_by_their_index() -> None:
    days = pd.date_range("2024-01-01", periods=4)
    zs = pd.Series([1.0, np.nan, 2.0, 2.5], days)
    us = pd.DataFrame(US, days)
    found = gaussian().filter(zs, us, Rs=pd.Series([0.5, 0.3, 2.0, 0.1], days))
    expected = gaussian().filter(ZS, US, Rs=[0.5, 0.3, 2.0, 0.1])
    assert np.array_equal(found.x, expected.x)
    assert found.to_dataframe().index.equals(days)
    assert gaussian().smooth(zs, us).to_dataframe().index.equals(days)
    with pytest.raises(ParameterError, match="zs, us: rows of different indexes"):
        gaussian().filter(zs, us.shift(freq="D"))
    uneven = zs.drop(days[1])
    with pytest.warns(StepsWarning):
        gaussian().filter(uneven)
    gaussian().filter(uneven, Qs=[0.1, 0.2, 0.1])  # told how long they are
    est = gaussian()
    est.filter(zs[:2])
    with pytest.raises(ParameterError):
        est.filter(zs[3:], resume=True)
    est.filter(zs[2:], resume=True)


@pytest.mark.parametrize(
    ("told", "error", "message"),
    [
        ({"Rs": [1.0]}, ShapeError, "Rs: got 1 values, expected one for each of the 4"),
        ({"us": [1.0]}, ShapeError, "us: got 1 values"),
        ({"Rs": 1.0}, ShapeError, "Rs: got 1.0, expected one value for each"),
        ({"Qs": [1.0, 1.0, -1.0, 1.0]}, ParameterError, "Q: "),
        ({"fx_args": [{"dt": 1.0}] * 4}, TypeError, "unexpected keyword argument 'dt'"),
        ({"fx_args": [1.0] * 4}, ParameterError, r"fx_args\[0\]: got 1.0"),
    ],
)
def test_what_is_wrong_leaves_the_estimator(told, error, message) -> None:
    for verb in ("filter", "smooth"):
        est = gaussian()
        with pytest.raises(error, match=message):
            getattr(est, verb)(ZS, **told)
        assert np.array_equal(est.x, np.zeros((2, 1)))


# ------------------------------------------------------------------ many series


def test_many_series_are_each_filtered_alone() -> None:
    est = gaussian(constraint=GaussianMembership([0.0, 0.0], 9.0 * np.eye(2)))
    series = {"a": [1.0, 2.0, np.nan], "b": [0.5, 0.1]}
    own = {"a": [0.1, 0.2, 0.3], "b": [0.0, 1.0]}
    rs = [0.5, 0.3, 2.0]
    shared = est.filter_many(series, ["x", "possibility", "lower"], US[:3], Rs=rs)
    each = est.filter_many(series, "x", own, Rs=rs)
    for k, (name, zs) in enumerate(series.items()):
        n = len(zs)
        alone = est.copy().filter(zs, US[:n], Rs=rs[:n])
        assert np.array_equal(shared.x[k, :n], alone.x)
        assert np.array_equal(shared.possibility[k, :n], alone.possibility)
        assert np.array_equal(each.x[k, :n], est.copy().filter(zs, [[u] for u in own[name]], Rs=rs[:n]).x)
    assert np.isnan(shared.x[1, 2]).all()
    assert list(shared.names) == ["a", "b"]
    assert np.array_equal(est.x, np.zeros((2, 1)))
    array = np.array([own["a"], own["a"]])[..., None]
    found = est.filter_many(np.array([series["a"], series["a"]]), us=array, Rs=rs)
    assert np.array_equal(found.x[1], each.x[0])


def test_many_series_of_a_table() -> None:
    days = pd.date_range("2024-01-01", periods=3)
    frame = pd.DataFrame({"a": [1.0, 2.0, 0.0], "b": [0.5, 0.1, 0.2]}, days)
    est = FuzzyRelationEstimator(
        1, 1, H=1.0, state=GAUSS, process_noise=GAUSS, measurement_noise=CauchyMembership(0.0, 1.0), points=51
    )
    found = est.filter_many(frame, ["x", "upper"], Rs=pd.Series([None, BOX, None], days))
    assert found.to_dataframe().index.get_level_values(-1).unique().equals(days)
    assert found.x.shape == (2, 3, 1)
    with pytest.raises(ParameterError, match="zs, Rs: rows of different indexes"):
        est.filter_many(frame, Rs=pd.Series([None] * 3, days.shift(1)))
    with pytest.raises(ShapeError, match="Rs: got 2 values"):
        est.filter_many(frame, Rs=[None, BOX])

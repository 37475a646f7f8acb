"""Where double precision ends there is one error, on every engine, and the filter is as it was."""

from __future__ import annotations

import copy
import warnings

import numpy as np
import pytest

from fuzzykf import (
    ExtendedKalmanFilter,
    GaussianMembership,
    IMMEstimator,
    IntervalMembership,
    KalmanFilter,
    ParabolicMembership,
    kalman,
)
from fuzzykf.errors import FuzzykfError, NumericalRangeError, ParameterError
from fuzzykf.possibility.norms import HAMACHER, LUKASIEWICZ


@pytest.fixture(autouse=True)
def _no_warning_leaks():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def growing(F=1e60):
    return KalmanFilter(1, 1, H=[[1.0]], F=[[F]])


def extended():
    return ExtendedKalmanFilter(1, 1, fx=lambda x: 1e60 * x, hx=lambda x: x)


def bank(method="imm", make=growing):
    return IMMEstimator([make(), make()], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], method=method)


MAKERS = {
    "KalmanFilter": growing,
    "ExtendedKalmanFilter": extended,
    "IMMEstimator": bank,
    "of extended filters": lambda: bank(make=extended),
    "GPB2": lambda: bank("gpb2"),
}


def state(f):
    members = [dict(one.__dict__) for one in getattr(f, "filters", ())]
    return copy.deepcopy([dict(f.__dict__), *members])


#: Objects without an equality of their own; the members of a bank are compared one by one.
UNCOMPARED = ("filters", "inv", "_branches")


def assert_same(one, other):
    np.testing.assert_equal(
        [{k: v for k, v in d.items() if k not in UNCOMPARED} for d in one],
        [{k: v for k, v in d.items() if k not in UNCOMPARED} for d in other],
    )


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_a_covariance_that_grows_beyond_all_numbers_is_refused(make):
    for verb in (lambda f: f.step(None), lambda f: f.predict()):
        f = make()
        f.step(1.0)
        for _ in range(2):  # 1e120, 1e240
            verb(f)
        before = state(f)
        with pytest.raises(
            NumericalRangeError, match=r"^P: would become \[\[inf\]\], which double precision"
        ):
            verb(f)
        assert_same(state(f), before)
        assert np.isfinite(f.P).all()
    f = make()
    before = state(f)
    for whole in (lambda: f.filter([1.0] + 4 * [None]), lambda: f.batch_filter([1.0] + 4 * [None])):
        with pytest.raises(NumericalRangeError, match="cannot hold"):
            whole()
        assert_same(state(f), before)
    with pytest.raises(NumericalRangeError, match="cannot hold"):
        f.filter_many([[1.0, *4 * [np.nan]]] * 2)
    assert_same(state(f), before)


def test_a_state_beyond_all_numbers_is_refused():
    f = KalmanFilter(1, 1, H=[[1.0]], x=[1e308])
    with pytest.raises(NumericalRangeError, match=r"x: would become \[-inf\]"):
        f.step(-1.7e308)
    assert f.x == pytest.approx([1e308])


@pytest.mark.parametrize(
    "call",
    [
        lambda: kalman.predict(0.0, 1.0, F=1e200),
        lambda: kalman.predict_steadystate(1e300, F=1e300),
        lambda: kalman.update_steadystate(1.0, -1e308, 1e30),
        lambda: kalman.rts_smoother(
            np.full((3, 1), 1e300), np.ones((3, 1, 1)), [[[1e90]]] * 3, [np.eye(1)] * 3
        ),
        lambda: growing().smooth([1.0, None, None, None, None]),
    ],
)
def test_functions_refuse_it(call):
    with pytest.raises(NumericalRangeError, match="would become"):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: kalman.rts_smoother(np.zeros((2, 1)), np.ones((2, 1, 1)), [np.eye(1)] * 2, [1.0, np.inf]),
            r"Qs\[1\]",
        ),
        (lambda: ParabolicMembership(0.0, 1e308), "scale: "),
        (lambda: IntervalMembership(1e308, -1e308), "lower, upper: "),
        (lambda: HAMACHER.renormalise(np.zeros(1), -1.0), "best: got -1, expected a cost of at least 0"),
        (
            lambda: LUKASIEWICZ.renormalise(np.zeros(1), 1.0),
            "best: got 1, expected a cost of at least 0 and below 1",
        ),
        (lambda: KalmanFilter(1, 1).batch_filter([1.0], update_first=np.ones(2)), "update_first: "),
        (
            lambda: ExtendedKalmanFilter(1, 1, hx=lambda x: x).filter([1.0], hx_args=[object]),
            r"hx_args\[0\]: ",
        ),
    ],
)
def test_what_would_have_leaked_is_named(call, message):
    with pytest.raises(FuzzykfError, match=message):
        call()


def test_memberships_at_the_ends_of_numbers():
    plane = GaussianMembership([0.0, 0.0], np.eye(2))
    np.testing.assert_array_equal(plane.negative_log(np.full((3, 2), -np.inf)), np.inf)
    assert GaussianMembership(2.0, 1e308).matrix == pytest.approx(1e308)
    assert IntervalMembership(-1.7e308, 1.7e308).peak == 0.0


# ------------------------------------------------------------------ a refused verb leaves no trace


VERBS = {
    "update": lambda f: f.update("no number"),
    "predict": lambda f: f.predict(F=np.eye(3)),
    "update_sequential": lambda f: f.update_sequential(5, 1.0),
    "update_steadystate": lambda f: f.update_steadystate("no number"),
    "predict_steadystate": lambda f: f.predict_steadystate(u="no number", B=np.eye(2)),
    "update_correlated": lambda f: f.update_correlated("no number"),
    "filter": lambda f: f.filter(["no number"]),
    "smooth": lambda f: f.smooth(["no number"]),
    "batch_filter": lambda f: f.batch_filter([1.0], Fs=[np.eye(3)]),
}


@pytest.mark.parametrize("verb", VERBS.values(), ids=VERBS)
def test_a_refused_verb_does_not_move_the_origin_of_reset(verb):
    f = KalmanFilter(2, 1, H=[[1.0, 0.0]])
    with pytest.raises(FuzzykfError):
        verb(f)
    f.H, f.Q, f.x = np.array([[0.0, 1.0]]), 9.0, np.array([[5.0], [6.0]])
    f.predict()
    f.update(1.0)
    f.reset()
    np.testing.assert_array_equal(f.x.ravel(), [5.0, 6.0])
    np.testing.assert_array_equal(f.H, [[0.0, 1.0]])


def test_a_refused_update_of_an_extended_filter_does_not_either():
    f = ExtendedKalmanFilter(1, 1, hx=lambda x: x)
    with pytest.raises(FuzzykfError):
        f.update("no number")
    f.x = np.array([[5.0]])
    f.step(1.0)
    f.reset()
    assert f.x == 5.0


def test_members_of_another_package_that_write_into_their_arrays_are_put_back():
    unscented = pytest.importorskip("filterpy.kalman")
    fails = [False]

    def bends(x, dt):
        if fails[0]:
            raise RuntimeError
        return 0.9 * x + 0.1 * x**2

    def make():
        members = []
        for fx in (lambda x, dt: 0.5 * x, bends):
            points = unscented.MerweScaledSigmaPoints(1, 0.1, 2.0, 1.0)
            one = unscented.UnscentedKalmanFilter(1, 1, 1.0, hx=lambda x: x, fx=fx, points=points)
            one.x = np.array([1.0])
            members.append(one)
        return IMMEstimator(members, [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]])

    f, expected = make(), make()
    for one in (f, expected):
        one.step([1.0])
        one.predict()
    fails[0] = True
    with pytest.raises(RuntimeError):
        f.predict()
    fails[0] = False
    f.update([1.2])
    expected.update([1.2])
    np.testing.assert_array_equal(f.x, expected.x)
    np.testing.assert_array_equal(f.P, expected.P)


# ------------------------------------------------------------------ functions that write into their argument


@pytest.mark.parametrize("jacobian", [None, lambda x: 2.0 * np.eye(2)])
def test_functions_may_write_into_the_state_that_they_are_given(jacobian):
    def make(double):
        functions = {"fx": double, "hx": double, "FJacobian": jacobian, "HJacobian": jacobian}
        return ExtendedKalmanFilter(2, 2, **functions, x=[[1.0], [2.0]])

    f, expected = make(lambda x: x.__imul__(2.0)), make(lambda x: 2.0 * x)
    np.testing.assert_allclose(f.step([1.0, 1.0]), expected.step([1.0, 1.0]), rtol=1e-9)
    np.testing.assert_allclose(f.P, expected.P, rtol=1e-9)

    def breaks(x):
        x *= 2.0
        raise RuntimeError

    f.fx = breaks
    x = f.x.copy()
    with pytest.raises(RuntimeError):
        f.step([1.0, 1.0])
    np.testing.assert_array_equal(f.x, x)


@pytest.mark.parametrize("value", ["a", 10**400, [1j]], ids=["text", "too large", "complex"])
def test_what_functions_return_that_is_no_number_is_named(value):
    with pytest.raises(ParameterError, match="Hx: "):
        ExtendedKalmanFilter(1, 1, hx=lambda x: value).step(1.0)
    with pytest.raises(ParameterError, match="residual: "):
        ExtendedKalmanFilter(1, 1, hx=lambda x: x, residual=lambda a, b: value).step(1.0)


@pytest.mark.parametrize("value", [None, np.nan, np.inf])
@pytest.mark.parametrize("name", ["Q", "F", "R", "H"])
def test_what_was_assigned_and_is_no_number_is_named(name, value):
    f = KalmanFilter(1, 1, H=[[1.0]])
    setattr(f, name, value if value is None else [[value]])
    with pytest.raises(ParameterError, match=rf"\b{name}\b"):
        f.step(1.0)


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_many_series_of_no_observation_are_none(make):
    assert make().filter_many(np.zeros((3, 0, 1)), keep=("x", "P")).x.shape == (3, 0, 1)

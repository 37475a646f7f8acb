"""The module functions: the same numbers as the class, in the form of what came in."""

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import (
    KalmanFilter,
    batch_filter,
    predict,
    predict_steadystate,
    update,
    update_steadystate,
)


@pytest.mark.parametrize("flat", [False, True])
def test_functions_and_class_agree(system, flat):
    x = system["x"] if flat else system["x"][:, None]
    F, Q, H, R, P = (system[name] for name in ("F", "Q", "H", "R", "P"))
    f = KalmanFilter(3, 2, x=x, P=P, F=F, Q=Q, H=H, R=R)
    f.alpha, f.B = 1.1, np.ones((3, 1))
    u = np.array([2.0]) if flat else np.array([[2.0]])
    f.predict(u)
    x, P = predict(x, P, F, Q, u, f.B, alpha=1.1)
    assert x.shape == f.x.shape
    for z in ([1.0, 2.0], [np.nan, 1.0]):
        f.update(z)
        x, P, y, K, S, log_likelihood = update(x, P, z, R, H, return_all=True)
        for ours, theirs in ((x, f.x), (P, f.P), (y, f.y), (K, f.K), (S, f.S)):
            np.testing.assert_allclose(ours, theirs, rtol=1e-13)
        assert log_likelihood == pytest.approx(f.log_likelihood, rel=1e-13)
    np.testing.assert_allclose(predict_steadystate(x, F, u, f.B), F @ x + f.B @ u)
    np.testing.assert_allclose(
        update_steadystate(x, [1.0, 2.0], K, H), x + K @ (np.reshape([1.0, 2.0], y.shape) - H @ x)
    )


def test_numbers_in_numbers_out():
    x, P = predict(10.0, 3.0, u=1.0, Q=4.0)
    assert (np.ndim(x), np.ndim(P), x, P) == (0, 0, 11.0, 7.0)
    x, P, y, K, S, log_likelihood = update(x, P, 12.0, 9.0, return_all=True)
    assert (x, P) == (pytest.approx(11 + 7 / 16), pytest.approx(7 * 9 / 16))
    assert (y.shape, K.shape, np.ndim(S), S) == ((1,), (1,), 0, 16.0)
    assert log_likelihood == pytest.approx(-0.5 * (1 / 16 + np.log(2 * np.pi * 16)))
    assert predict_steadystate(2.0, F=3.0) == 6.0
    assert update_steadystate(2.0, 3.0, 0.5) == 2.5


def test_nothing_observed_returns_what_came_in():
    x, P = np.ones(2), np.eye(2)
    for z in (None, [np.nan, np.nan]):
        assert update(x, P, z, 1.0) == (x, P)
        assert update(x, P, z, 1.0, return_all=True) == (x, P, None, None, None, None)
        assert update_steadystate(x, z, np.eye(2)) is x


def test_h_is_the_identity_by_default_and_may_be_a_number():
    x, _ = update(np.zeros(2), np.eye(2), [2.0, 4.0], 1.0)
    np.testing.assert_allclose(x, [1.0, 2.0])
    x, _ = update(np.zeros(2), np.eye(2), [2.0, 4.0], 1.0, H=2.0)
    np.testing.assert_allclose(x, [0.8, 1.6])
    x, _ = update(np.zeros(1), np.eye(1), 2.0, 1.0, H=[1.0])
    np.testing.assert_allclose(x, [1.0])


@pytest.mark.parametrize("update_first", [False, True])
def test_batch_filter_is_that_of_the_class(system, update_first):
    x, P = system["x"], system["P"]
    lists = [[system[name]] * 9 for name in ("F", "Q", "H", "R")]
    Bs, us = [np.ones((3, 1))] * 9, list(np.linspace(0, 1, 9)[:, None])
    f = KalmanFilter(3, 2, x=x, P=P)
    saves = []
    saver = type("Saver", (), {"save": lambda self: saves.append(0)})()
    ours = batch_filter(x, P, list(system["zs"]), *lists, Bs, us, update_first, saver)
    theirs = f.batch_filter(list(system["zs"]), *lists, Bs, us, update_first)
    for a, b in zip(ours, theirs, strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)
    assert len(saves) == 9


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: predict(np.zeros((1, 2)), np.eye(2)), ShapeError, r"x: got shape \(1, 2\)"),
        (lambda: predict(np.zeros(2), np.eye(3)), ShapeError, r"P: got shape \(3, 3\), expected \(2, 2\)"),
        (lambda: predict(np.zeros(2), np.eye(2), F=np.eye(3)), ShapeError, r"F: got shape \(3, 3\)"),
        (lambda: predict(np.zeros(2), np.eye(2), Q=-1.0), NotPositiveDefiniteError, "Q"),
        (
            lambda: predict(np.zeros(2), [[1.0, 2.0], [2.0, 1.0]]),
            NotPositiveDefiniteError,
            "P: .*eigenvalue -1",
        ),
        (lambda: predict(np.zeros(2), np.eye(2), alpha=0.5), ParameterError, "alpha: got 0.5"),
        (lambda: update(np.zeros(2), np.eye(2), [1.0], 1.0), ShapeError, "z: got shape"),
        (lambda: update(np.zeros(2), np.eye(2), [1.0, 1.0], np.eye(3)), ShapeError, "R: got shape"),
        (
            lambda: update(np.zeros(2), np.zeros((2, 2)), [1.0, 1.0], 0.0),
            NotPositiveDefiniteError,
            "S = H P H'",
        ),
        (lambda: update_steadystate(np.zeros(2), [1.0, 1.0], np.eye(3)), ShapeError, "K: got shape"),
        (
            lambda: batch_filter(np.zeros(1), np.eye(1), [1.0], [], [1.0], [1.0], [1.0]),
            ShapeError,
            "Fs: got 0",
        ),
    ],
)
def test_wrong_input_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call()

"""The rivals are what they are called: the baselines agree with independent computations."""

from __future__ import annotations

import time

import numpy as np
import pytest

from fuzzykf import CGOMSModel
from fuzzykf.comparison import Task, methods

TRANSITION = np.array([[0.9, 0.05], [0.2, 0.7]])
OFFSET = np.array([0.3, -1.0])
NOISE = np.array([[0.5, 0.2], [0.2, 0.4]])


def autoregression(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(NOISE)
    z = np.empty((n, 2))
    z[0] = np.linalg.solve(np.eye(2) - TRANSITION, OFFSET)
    for k in range(1, n):
        z[k] = OFFSET + TRANSITION @ z[k - 1] + root @ rng.normal(size=2)
    return z


def task(n: int, n_train: int) -> Task:
    z = autoregression(n)
    return Task(
        state=z[:, 0], observation=z[:, 1], switch=np.zeros(n), n_train=n_train, switch_source="not used here"
    )


def test_the_linear_model_finds_the_autoregression_it_was_simulated_from() -> None:
    z = autoregression(200_000)
    model = methods.fit_linear_model(z[:, 0], z[:, 1])
    np.testing.assert_allclose(model.transition, TRANSITION, atol=0.01)
    np.testing.assert_allclose(model.offset, OFFSET, atol=0.03)
    np.testing.assert_allclose(model.noise, NOISE, atol=0.01)


def test_the_usual_state_space_model_is_a_special_case_of_the_linear_model() -> None:
    # X' = a X + U, Y' = b X' + V with correlated U and V, written as one autoregression.
    rng = np.random.default_rng(1)
    n, a, b = 400_000, 0.95, 2.0
    u, v = np.linalg.cholesky(np.array([[1.0, 0.3], [0.3, 0.5]])) @ rng.normal(size=(2, n))
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = a * x[k - 1] + u[k]
    model = methods.fit_linear_model(x, b * x + v)
    np.testing.assert_allclose(model.transition, [[a, 0.0], [b * a, 0.0]], atol=0.03)


def test_the_kalman_filter_is_the_conditional_mean_under_the_joint_gaussian() -> None:
    # Oracle: mean and covariance of all states and observations written out and conditioned.
    whole = task(220, 210)
    found = methods.kalman_filter(whole)
    model = methods.fit_linear_model(whole.state[:210], whole.observation[:210])
    y, n = whole.observation[210:], 10
    mean, covariance = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    mean[:2], covariance[:2, :2] = model.mean, model.covariance
    for k in range(1, n):
        now, before = slice(2 * k, 2 * k + 2), slice(2 * k - 2, 2 * k)
        mean[now] = model.offset + model.transition @ mean[before]
        covariance[now, : 2 * k] = model.transition @ covariance[before, : 2 * k]
        covariance[: 2 * k, now] = covariance[now, : 2 * k].T
        covariance[now, now] = (
            model.transition @ covariance[before, before] @ model.transition.T + model.noise
        )
    for k in range(n):
        seen = 2 * np.arange(k + 1) + 1
        gain = covariance[2 * k, seen] @ np.linalg.inv(covariance[np.ix_(seen, seen)])
        assert found.mean[k] == pytest.approx(mean[2 * k] + gain @ (y[: k + 1] - mean[seen]), abs=1e-9)
        variance = covariance[2 * k, 2 * k] - gain @ covariance[seen, 2 * k]
        assert found.std[k] == pytest.approx(np.sqrt(variance), abs=1e-9)
    seen = 2 * np.arange(n) + 1
    deviation, block = y - mean[seen], covariance[np.ix_(seen, seen)]
    joint = -0.5 * (deviation @ np.linalg.solve(block, deviation) + np.linalg.slogdet(2 * np.pi * block)[1])
    assert found.log_likelihood.sum() == pytest.approx(joint, abs=1e-8)


def test_linear_regression_is_the_least_squares_line() -> None:
    whole = task(400, 300)
    found = methods.linear_regression(whole)
    coefficients, (square_sum,), *_ = np.polyfit(whole.observation[:300], whole.state[:300], 1, full=True)
    np.testing.assert_allclose(found.mean, np.polyval(coefficients, whole.observation[300:]))
    np.testing.assert_allclose(found.std, np.sqrt(square_sum / 298))
    assert found.log_likelihood is None


@pytest.mark.parametrize(
    ("Axx", "expected"), [(0.99, None), (1.02, "stays at 1, the error of the state grows by 0.02 ")]
)
def test_a_state_that_drifts_while_the_switch_stays_is_noted(Axx, expected) -> None:
    pairs = np.ones((2, 2, 1, 1))
    model = CGOMSModel.from_regressions(
        [[0.9, 0.1], [0.1, 0.9]],
        Ayy=0.5 * pairs,
        Ny=0 * pairs[..., 0],
        Qyy=pairs,
        Axx=np.array([[[[0.5]], [[3.0]]], [[[3.0]], [[Axx]]]]),  # leaving a regime does not count
        H=0 * pairs,
        G=pairs,
        c=0 * pairs[..., 0],
        C=pairs,
        means=np.zeros((2, 2)),
        covariances=np.broadcast_to(np.eye(2), (2, 2, 2)),
    )
    notes = methods.growth_notes(model.on_nodes())
    assert len(notes) == (expected is not None)
    for note in notes:
        assert expected in note


def test_the_time_of_a_step_is_in_microseconds() -> None:
    assert 1000.0 <= methods._microseconds(lambda _: time.sleep(0.001), np.zeros(5)) < 100_000.0

"""Kalman filter and IMM as rivals: what they are called, by independent computations."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter as FilterpyKalmanFilter

from fuzzykf import FuzzykfError
from fuzzykf.comparison import LearningPart
from fuzzykf.comparison.candidates.linear import (
    LearnedIMM,
    LearnedKalman,
    fit_linear_model,
    learn_imm,
    learn_kalman,
)
from fuzzykf.kalman import KalmanFilter

TRANSITION = np.array([[0.9, 0.05], [0.2, 0.7]])
OFFSET = np.array([0.3, -1.0])
NOISE = np.array([[0.5, 0.2], [0.2, 0.4]])


def autoregression(n, seed=0, transition=TRANSITION, offset=OFFSET):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(NOISE)
    z = np.empty((n, 2))
    z[0] = np.linalg.solve(np.eye(2) - transition, offset)
    for k in range(1, n):
        z[k] = offset + transition @ z[k - 1] + root @ rng.normal(size=2)
    return z[:, :1], z[:, 1:]


def regimes(n, seed=0):
    """Two regimes of long stay in which the observation depends on the state in opposite ways."""
    rng = np.random.default_rng(seed)
    r = (np.cumsum(rng.random(n) < 0.02) % 2).astype(float)
    x, y = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        x[k] = 0.9 * x[k - 1] + 0.5 * rng.normal()
        y[k] = (2.0 if r[k] else -2.0) + (1.5 if r[k] else 0.5) * x[k] + 0.5 * rng.normal()
    return x[:, None], y[:, None], r


def test_the_linear_model_finds_the_autoregression_it_was_simulated_from() -> None:
    model = fit_linear_model(*autoregression(100_000))
    np.testing.assert_allclose(model.transition, TRANSITION, atol=0.01)
    np.testing.assert_allclose(model.offset, OFFSET, atol=0.04)
    np.testing.assert_allclose(model.noise, NOISE, atol=0.01)


def test_the_usual_state_space_model_is_a_special_case_of_the_linear_model() -> None:
    # X' = a X + U, Y' = b X' + V with correlated U and V, written as one autoregression.
    rng = np.random.default_rng(1)
    n, a, b = 200_000, 0.95, 2.0
    u, v = np.linalg.cholesky(np.array([[1.0, 0.3], [0.3, 0.5]])) @ rng.normal(size=(2, n))
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = a * x[k - 1] + u[k]
    model = fit_linear_model(x[:, None], (b * x + v)[:, None])
    np.testing.assert_allclose(model.transition, [[a, 0.0], [b * a, 0.0]], atol=0.03)


def test_weights_and_gaps_decide_which_steps_count() -> None:
    # Oracle: the regression on those steps alone, written out.
    x, y = autoregression(300)
    weight = np.arange(300) % 3 / 2.0
    x[100] = np.nan
    model = fit_linear_model(x, y, weight)
    z = np.hstack([x, y])
    steps = [k for k in range(299) if np.isfinite(z[[k, k + 1]]).all() for _ in range(int(2 * weight[k + 1]))]
    design = np.column_stack([np.ones(len(steps)), z[steps]])
    expected, *_ = np.linalg.lstsq(design, z[np.array(steps) + 1])
    np.testing.assert_allclose(model.offset, expected[0], atol=1e-10)
    np.testing.assert_allclose(model.transition, expected[1:].T, atol=1e-10)


def test_the_kalman_filter_is_the_conditional_mean_under_the_joint_gaussian() -> None:
    # Oracle: mean and covariance of all states and observations written out and conditioned.
    x, y = autoregression(220)
    model = fit_linear_model(x[:210], y[:210])
    found = learn_kalman(LearningPart(x=x[:210], y=y[:210])).restore(y[:0], y[210:])
    y, n = y[210:, 0], 10
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
        assert found.mean[k, 0] == pytest.approx(mean[2 * k] + gain @ (y[: k + 1] - mean[seen]), abs=1e-9)
        variance = covariance[2 * k, 2 * k] - gain @ covariance[seen, 2 * k]
        assert found.std[k, 0] == pytest.approx(np.sqrt(variance), abs=1e-9)
    seen = 2 * np.arange(n) + 1
    deviation, block = y - mean[seen], covariance[np.ix_(seen, seen)]
    joint = -0.5 * (deviation @ np.linalg.solve(block, deviation) + np.linalg.slogdet(2 * np.pi * block)[1])
    assert found.log_likelihood.sum() == pytest.approx(joint, abs=1e-8)


def test_filterpy_and_fuzzykf_give_the_same_and_what_came_before_counts() -> None:
    x, y = autoregression(400)
    model = fit_linear_model(x[:300], y[:300])
    ours, theirs = (LearnedKalman(model, 1, kf) for kf in (KalmanFilter, FilterpyKalmanFilter))
    warm, cold = ours.restore(y[:300], y[300:]), ours.restore(y[:0], y[300:])
    assert abs(warm.mean[0, 0] - cold.mean[0, 0]) > 1e-3
    other = theirs.restore(y[:300], y[300:])
    for name in ("mean", "std", "log_likelihood"):
        np.testing.assert_allclose(getattr(warm, name), getattr(other, name), rtol=1e-8, atol=1e-8)


def test_a_gap_is_bridged_and_the_uncertainty_grows_in_it() -> None:
    x, y = autoregression(400)
    gap = y[300:].copy()
    gap[40:50] = np.nan
    found = learn_kalman(LearningPart(x=x[:300], y=y[:300])).restore(y[:300], gap)
    assert (np.diff(found.std[39:50, 0]) > 0).all()
    assert np.isfinite(found.mean).all()


def test_an_imm_of_equal_regimes_is_the_kalman_filter() -> None:
    x, y = autoregression(300)
    model = fit_linear_model(x, y)
    imm = LearnedIMM([model, model], np.array([[0.9, 0.1], [0.3, 0.7]]), np.array([0.75, 0.25]), 1)
    kalman = LearnedKalman(model, 1, KalmanFilter)
    for name in ("mean", "std", "log_likelihood"):
        np.testing.assert_allclose(
            getattr(imm.restore(y[:50], y[50:]), name),
            getattr(kalman.restore(y[:50], y[50:]), name),
            rtol=1e-7,
            atol=1e-7,
        )


def test_on_a_switching_system_the_imm_beats_the_one_linear_model() -> None:
    # The regimes are learned without the switch; the error has to come near that of an IMM that was told it.
    x, y, r = regimes(3000)
    part = LearningPart(x=x[:2000], y=y[:2000], tolerance=1e-4)
    told = LearningPart(x=x[:2000], y=y[:2000], r=r[:2000])
    error = {
        name: np.sqrt(np.mean((learned.restore(y[:2000], y[2000:]).mean - x[2000:]) ** 2))
        for name, learned in (
            ("imm", learn_imm(part)),
            ("told", learn_imm(told)),
            ("kalman", learn_kalman(part)),
        )
    }
    assert error["imm"] < 0.9 * error["kalman"]
    assert error["imm"] < 1.05 * error["told"]


def test_a_regime_that_is_hardly_visited_is_named() -> None:
    x, y = autoregression(200)
    r = np.zeros(200)
    r[50:53] = 1.0
    with pytest.raises(FuzzykfError, match=r"regime 1 of the hard model is too rare: .* has 3"):
        learn_imm(LearningPart(x=x, y=y, r=r))


def test_a_step_in_real_time_is_predict_and_update() -> None:
    x, y = autoregression(150)
    learned = learn_kalman(LearningPart(x=x, y=y))
    f = learned._new_filter()
    f.predict(np.ones((1, 1)))
    f.update(y[0])
    learned._new_filter = lambda: f  # the stepper works on this one
    step = learned.stepper()
    expected = learned.model.offset + learned.model.transition @ f.x[:, 0]
    step(np.array([np.nan]))  # a missing observation: the state moves by the model
    np.testing.assert_allclose(f.x[:, 0], expected)

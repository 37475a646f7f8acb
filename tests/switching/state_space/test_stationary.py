"""Moments of the state in the long run: what the recursion of moments comes to, from wherever it starts."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.switching.laws.chain import stationary_back, stationary_distribution
from fuzzykf.switching.state_space.stationary import LongRun

T = np.array([[0.8, 0.15, 0.05, 0.0], [0.1, 0.6, 0.3, 0.0], [0.3, 0.0, 0.7, 0.0], [0.5, 0.5, 0.0, 0.0]])


def stationary():
    p = np.linalg.matrix_power(T, 2000)[0]
    return np.where(p > 1e-12, p, 0.0)


def matrices(m, size, seed=0):
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(4, m, m))
    root = rng.normal(size=(4, m, m))
    return (
        size * F / np.abs(np.linalg.eigvals(F)).max(),
        rng.normal(size=(4, m)),
        root @ np.swapaxes(root, 1, 2),
    )


def moved(p, F, b, Q, mean, P):
    """One step of the moments given each node, by the law of total covariance; nodes without mass stay."""
    there = np.flatnonzero(p)
    new_mean, new_P = mean.copy(), P.copy()
    for j in there:
        beta = p * T[:, j] / p[j]
        before = beta @ mean
        spread = sum(beta[i] * (P[i] + np.outer(mean[i] - before, mean[i] - before)) for i in there)
        new_mean[j], new_P[j] = F[j] @ before + b[j], F[j] @ spread @ F[j].T + Q[j]
    return new_mean, new_P


@pytest.mark.parametrize("m", [1, 2, 3])
def test_the_recursion_comes_to_them_and_stays(m):
    p = stationary()
    F, b, Q = matrices(m, 0.8)
    found = LongRun(p, T, F, b, Q)
    assert found.radius < 1.0
    mean, P = 3.0 + np.zeros((4, m)), 5.0 * np.eye(m) + np.zeros((4, m, m))
    for _ in range(400):
        mean, P = moved(p, F, b, Q, mean, P)
    there = p > 0.0
    np.testing.assert_allclose(found.mean[there], mean[there], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(found.covariance[there], P[there], rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(found.covariance, np.swapaxes(found.covariance, 1, 2))
    # the last node is never there: something harmless
    assert there.tolist() == [True, True, True, False]
    np.testing.assert_array_equal(found.mean[3], 0.0)
    np.testing.assert_array_equal(found.covariance[3], np.eye(m))


@pytest.mark.parametrize(("size", "m"), [(0.6, 1), (0.9, 2), (1.1, 2)])
def test_the_radii_are_the_growth_of_the_moments(size, m):
    p = stationary()
    F, b, Q = matrices(m, size, seed=1)
    found, zero = LongRun(p, T, F, b, Q), np.zeros((4, m))
    P, mean = np.array([np.eye(m)] * 3 + [0.0 * np.eye(m)]), 1.0 + zero
    mean[3] = 0.0  # where the switch never is
    growth = []
    for _ in range(300):
        old = np.abs(P[:3]).max()
        P = moved(p, F, zero, 0.0 * Q, zero, P)[1]
        growth.append(np.abs(P[:3]).max() / old)
        P /= np.abs(P[:3]).max()
    assert np.exp(np.mean(np.log(growth[-50:]))) == pytest.approx(found.radius, rel=1e-6)
    scale = 0.0
    for _ in range(600):
        mean = moved(p, F, zero, Q, mean, 0.0 * P)[0]
        scale += np.log(np.abs(mean[:3]).max())
        mean /= np.abs(mean[:3]).max()
    assert np.exp(scale / 600) == pytest.approx(found.mean_radius, rel=2e-2)
    assert found.mean_radius**2 <= found.radius + 1e-12  # means settle wherever second moments do


def test_one_node_is_the_equation_of_lyapunov():
    F, b, Q = (one[:1] for one in matrices(3, 0.9, seed=2))
    found = LongRun(np.ones(1), np.ones((1, 1)), F, b, Q)
    np.testing.assert_allclose(found.mean[0], np.linalg.solve(np.eye(3) - F[0], b[0]), rtol=1e-12)
    P = found.covariance[0]
    np.testing.assert_allclose(F[0] @ P @ F[0].T + Q[0], P, rtol=1e-10)
    assert found.radius == pytest.approx(np.abs(np.linalg.eigvals(F[0])).max() ** 2)


@pytest.mark.parametrize("settles", [True, False], ids=["moments", "means"])
@pytest.mark.parametrize("m", [1, 2])
def test_derivatives_are_those_of_differences(m, settles):
    rng = np.random.default_rng(1)
    there = T[:3, :3] / T[:3, :3].sum(axis=1, keepdims=True)
    start = (there, *(one[:3] for one in matrices(m, 0.8)))
    turn = rng.normal(size=(3, 3)) * (there > 0.0)
    way = [turn - there * turn.sum(axis=1, keepdims=True), *(rng.normal(size=one.shape) for one in start[1:])]
    way[3] = way[3] + np.swapaxes(way[3], 1, 2)
    of_mean, root = rng.normal(size=(3, m)), rng.normal(size=(3, m, m))
    of_covariance = root + np.swapaxes(root, 1, 2) if settles else np.zeros((3, m, m))

    def long_run(step):
        transition, *rest = (one + step * along for one, along in zip(start, way, strict=True))
        return LongRun(stationary_distribution(transition), transition, *rest)

    def value(step):
        found = long_run(step)
        return (found.mean * of_mean).sum() + (found.covariance * of_covariance).sum()

    slope = long_run(0.0).pull_back(of_mean, of_covariance if settles else None)
    p = stationary_distribution(there)
    by = (slope.transition + stationary_back(p, there, slope.p), *slope[2:])
    exact = sum((one * along).sum() for one, along in zip(by, way, strict=True))
    assert exact == pytest.approx((value(1e-5) - value(-1e-5)) / 2e-5, rel=1e-8)

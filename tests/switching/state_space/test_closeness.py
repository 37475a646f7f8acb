"""The ratio of errors, against closed forms, path averages and simulation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from fuzzykf import CGOMSModel, KnownSwitchFilter
from fuzzykf.errors import ClosenessWarning, ParameterError


def one_class(seed, m=2, q=1):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(m, m))
    A *= 0.8 / np.linalg.norm(A, 2)
    return A, rng.normal(size=(q, m)), rng.normal(size=(m, m)), rng.normal(size=(q, q)) + 2.0 * np.eye(q)


def convert(transition, A, B, C, D, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ClosenessWarning)
        return CGOMSModel.from_cglssm(transition, A, B, C, D, **options)


THREE = {
    "transition": [[0.9, 0.1, 0.0], [0.05, 0.9, 0.05], [0.2, 0.0, 0.8]],
    "A": [[[0.95, 0.2], [0.0, 0.9]], [[0.8, -0.5], [0.5, 0.8]], [[0.1, 0.0], [0.0, 0.5]]],
    "B": [[[1.0, 0.0]]] * 3,
    "C": [np.diag([0.2, 0.5]), np.eye(2), np.diag([3.0, 1.0])],
    "D": [[[1.0]], [[3.0]], [[0.5]]],
}


# --------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("weights", [None, [1.0, 0.0], [0.2, 5.0]])
def test_one_class_by_the_equations_of_riccati_and_lyapunov(seed, weights):
    A, B, C, D = one_class(seed)
    G = solve_discrete_lyapunov(A, C @ C.T)
    P = G - G @ B.T @ np.linalg.inv(B @ G @ B.T + D @ D.T) @ B @ G
    S = A @ P @ A.T + C @ C.T
    K = S @ B.T @ np.linalg.inv(B @ S @ B.T + D @ D.T)
    remaining = np.eye(2) - K @ B
    converted = solve_discrete_lyapunov(remaining @ A, remaining @ C @ C.T @ remaining.T + K @ D @ D.T @ K.T)
    prior = solve_discrete_are(A.T, B.T, C @ C.T, D @ D.T)
    kalman = prior - prior @ B.T @ np.linalg.inv(B @ prior @ B.T + D @ D.T) @ B @ prior
    w = np.ones(2) if weights is None else np.array(weights)
    expected = np.diag(converted) @ w / (np.diag(kalman) @ w)
    assert expected > 1.0
    model = convert([[1.0]], [A], [B], [C], [D])
    assert model.closeness(weights) == pytest.approx(expected, rel=1e-5)


def test_the_construction_of_the_paper_in_one_dimension():
    # the estimate obeys x' <- a x + K (y' - E y): no feedback, everything in scalars
    a, c, d = 0.6, 1.0, 1.5
    G = c**2 / (1 - a**2)
    J = G / (G + d**2)
    P = G - J * G
    S = c**2 + a**2 * P
    V = S + d**2
    K = S / V
    E = a * J
    model = convert([[1.0]], [[[a]]], [[[1.0]]], [[[c]]], [[[d]]], construction="markov_x")
    # e' = a e - K(a x - E y) + (1 - K) c u - K d v with y = x + d v0; second moments of (e, x, v0)
    N = np.array([[(1 - K) * c, -K * d], [c, 0.0], [0.0, 1.0]])
    F = np.array([[a, -K * (a - E), K * E * d], [0.0, a, 0.0], [0.0, 0.0, 0.0]])
    M = solve_discrete_lyapunov(F, N @ N.T)
    prior = solve_discrete_are(np.array([[a]]), np.eye(1), np.eye(1) * c**2, np.eye(1) * d**2)[0, 0]
    kalman = prior * d**2 / (prior + d**2)
    assert model.closeness() == pytest.approx(M[0, 0] / kalman, rel=1e-5)


def test_a_longer_window_comes_nearer_and_at_last_there():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ClosenessWarning)
        ratios = [CGOMSModel.from_cglssm(**THREE, order=k).closeness() for k in (1, 2, 3, 5, 8)]
    assert (np.diff(ratios) < 0.0).all()
    assert 1.0 < ratios[-1] < 1.02
    A, B, C, D = one_class(1)
    assert convert([[1.0]], [A], [B], [C], [D], order=12).closeness() == pytest.approx(1.0, abs=1e-6)


def test_a_state_seen_without_noise_is_known_to_both():
    model = convert([[1.0]], np.full((1, 1, 1), 0.9), *[np.ones((1, 1, 1))] * 2, np.zeros((1, 1, 1)))
    assert model.closeness() == 1.0


# --------------------------------------------------------------------------- several classes


def path_errors(model, rng, runs=2000, n=64):
    """Mean error covariances of both filters over random paths, exactly along each path."""
    space, T = model.cglssm.space, model.transition
    r = (rng.random((runs, 1)) > np.cumsum(model.initial)).sum(axis=1)
    system, m = model.on_nodes(), model.dim_x
    first = system.initial().covariance
    J = first[:, :m, m:] @ np.linalg.inv(first[:, m:, m:])
    P = (first[:, :m, :m] - J @ first[:, m:, :m])[r]
    M, kalman, converted = P, [], []
    for k in range(n):
        before, r = r, (rng.random((runs, 1)) > np.cumsum(T, axis=1)[r]).sum(axis=1)
        A, B, C, D = (a[r] for a in space)
        Q, R = C @ C.swapaxes(1, 2), D @ D.swapaxes(1, 2)
        S = A @ P @ A.swapaxes(1, 2) + Q
        gain = S @ B.swapaxes(1, 2) @ np.linalg.inv(B @ S @ B.swapaxes(1, 2) + R)
        P = S - gain @ B @ S
        pairs = system.pair_tables(k).pairs
        F, K = pairs.Axx[before, r], pairs.G[before, r]
        rest = np.eye(m) - K @ B
        M = F @ M @ F.swapaxes(1, 2) + rest @ Q @ rest.swapaxes(1, 2) + K @ R @ K.swapaxes(1, 2)
        kalman.append(np.trace(P, axis1=1, axis2=2).mean())
        converted.append(np.trace(M, axis1=1, axis2=2).mean())
    return np.mean(converted[n // 2 :]), np.mean(kalman[n // 2 :])


@pytest.mark.parametrize("order", [1, 3])
def test_three_classes_against_an_average_over_paths(order):
    # the ratio may be too small by the memory of two steps, and by the scatter of the paths
    model = convert(**THREE, order=order)
    converted, kalman = path_errors(model, np.random.default_rng(3))
    ratio = model.closeness()
    assert ratio == pytest.approx(converted / kalman, rel=0.01)


@pytest.mark.study
@pytest.mark.parametrize(
    "options", [{}, {"order": 3}, {"noise": "averaged", "order": 2}, {"construction": "clip"}]
)
def test_three_classes_against_simulation(options):
    model = convert(**THREE, **options)
    rng = np.random.default_rng(4)
    squares = np.zeros(2)
    for _ in range(300):
        truth = model.cglssm.simulate(140, rng)
        x = KnownSwitchFilter(model).filter(truth.y, truth.r).x
        kalman = kalman_filter(model.cglssm, truth)
        for k, estimate in enumerate((x, kalman)):
            squares[k] += ((estimate - truth.x)[40:] ** 2).sum()
    assert model.closeness() == pytest.approx(squares[0] / squares[1], rel=0.03)


def kalman_filter(system, truth):
    A, B, C, D = system.space
    j = truth.r.astype(int)
    x, P, out = np.zeros(system.dim_x), system.initial_covariance[j[0]], []
    for n, y in enumerate(truth.y):
        k = j[n]
        if n:
            x, P = A[k] @ x, A[k] @ P @ A[k].T + C[k] @ C[k].T
        gain = P @ B[k].T @ np.linalg.inv(B[k] @ P @ B[k].T + D[k] @ D[k].T)
        x, P = x + gain @ (y - B[k] @ x), P - gain @ B[k] @ P
        out.append(x)
    return np.array(out)


@pytest.mark.parametrize("construction", ["gain", "clip", "markov_x"])
def test_a_start_elsewhere_ends_at_the_same_ratio(construction):
    parameters = {
        "transition": [[0.8, 0.2], [0.4, 0.6]],
        "A": [[[0.3]], [[0.5]]],
        "B": [[[1.0]], [[0.5]]],
        "C": [[[1.0]], [[2.0]]],
        "D": [[[1.0]], [[1.0]]],
    }
    stationary = convert(**parameters, construction=construction)
    moving = convert(
        **parameters,
        construction=construction,
        initial_probability=[1.0, 0.0],
        initial_covariance=[[[0.1]], [[0.1]]],
        mode="time_varying",
    )
    assert moving.closeness() == pytest.approx(stationary.closeness(), rel=1e-5)


def test_a_periodic_chain_settles():
    parameters = {
        "transition": [[0.0, 1.0], [1.0, 0.0]],
        "A": [[[0.9]], [[0.9]]],
        "B": [[[1.0]], [[0.1]]],
        "C": [[[1.0]], [[1.0]]],
        "D": [[[1.0]], [[1.0]]],
        "initial_covariance": [[[1.0]], [[1.0]]],
        "initial_probability": [1.0, 0.0],
    }
    model = convert(**parameters, mode="time_varying")
    P, M, seen = 0.5, 0.5, []
    for k in range(400):  # regimes 1, 0, 1, 0, ...; scalars throughout
        pairs = model.on_nodes().pair_tables(k).pairs
        i, j = k % 2, (k + 1) % 2
        b, K = (1.0, 0.1)[j], pairs.G[i, j, 0, 0]
        S = 0.81 * P + 1.0
        P = S / (b * b * S + 1.0)
        M = (1 - K * b) ** 2 * (0.81 * M + 1.0) + K * K
        seen.append((M, P))
    converted, kalman = np.mean(seen[200:], axis=0)
    assert model.closeness() == pytest.approx(converted / kalman, rel=1e-5)


# --------------------------------------------------------------------------- what users see


def test_the_warning_says_how_far_and_what_helps():
    slow = {"A": [[[0.99]]], "B": [[[1.0]]], "C": [[[0.1]]], "D": [[[1.0]]]}
    with pytest.warns(
        ClosenessWarning, match=r"is 1\.76 times that of the Kalman filter .*larger order"
    ) as seen:
        model = CGOMSModel.from_cglssm([[1.0]], **slow)
    assert seen[0].filename == __file__  # it points to the caller
    assert model.closeness() > 1.25
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        CGOMSModel.from_cglssm([[1.0]], **slow, order=8)


def test_no_warning_when_a_model_is_loaded(tmp_path):
    model = convert([[1.0]], [[[0.99]]], [[[1.0]]], [[[0.1]]], [[[1.0]]])
    model.save(tmp_path / "model.json")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert CGOMSModel.load(tmp_path / "model.json").closeness() == model.closeness()


@pytest.mark.parametrize("weights", [[1.0, -1.0], [0.0, 0.0], [1.0], [1.0, np.nan]])
def test_weights_that_are_refused(weights):
    A, B, C, D = one_class(0)
    model = convert([[1.0]], [A], [B], [C], [D])
    with pytest.raises(ParameterError, match="weights"):
        model.closeness(weights)

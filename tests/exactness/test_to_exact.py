"""State-space models turned into exact ones, against the enumeration of all paths of the nodes.

Two things are shown: that the tables are the regressions in the given model, from the joint Gaussian of all
times path by path; and that filter and smoother are exact for the model that these tables make.
"""

from __future__ import annotations

import warnings
from itertools import pairwise, product
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import (
    CGOMSMFilter,
    FadeLaw,
    FuzzyMarkovLaw,
    KalmanFilter,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingStateSpace,
)
from fuzzykf.errors import ClosenessWarning

SEEDS = st.integers(0, 10**6)
TOLERANCE = {"rtol": 1e-9, "atol": 1e-9}


def exact(model, order, n_nodes=5):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ClosenessWarning)
        return model.to_exact(order, n_nodes)


def definite(rng, *shape):
    root = 0.5 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def random_model(seed, M, m, q, K=2, far=1.0):
    """A model on a chain of nodes, some arrows of which are missing; a node may never come first."""
    rng = np.random.default_rng(seed)
    T = rng.dirichlet(np.ones(M), M) * (rng.random((M, M)) < 0.6) + 0.1 * np.eye(M)[rng.permutation(M)]
    start = rng.dirichlet(np.ones(M)) * (np.arange(M) != rng.integers(2 * M) + (M == 1))
    weights = rng.dirichlet(np.ones(K), M)
    chain = SwitchChain(
        np.linspace(0.1, 0.9, M), np.ones(M), start / start.sum(), T / T.sum(axis=1, keepdims=True), weights
    )
    return SwitchingStateSpace(
        chain,
        F=0.6 * rng.normal(size=(K, m, m)),
        H=rng.normal(size=(K, q, m)),
        Q=definite(rng, K, m, m),
        R=definite(rng, K, q, q),
        b=far * rng.normal(size=(K, m)),
        d=far * rng.normal(size=(K, q)),
        x0=far * rng.normal(size=(K, m)),
        P0=definite(rng, K, m, m),
    )


def enumerated(model, n):
    """All paths of n nodes that can be, their probabilities, and the joint Gaussian of (X, Y) along each."""
    system = model.placed()
    chain, t, first = system.chain, system.tables, system.first
    m, q, M = system.dim_x, system.dim_z, len(system.chain)
    d = m + q
    found = SimpleNamespace(paths=[], p=[], mean=[], P=[], m=m, q=q)
    for path in product(range(M), repeat=n):
        p = chain.initial[path[0]] * np.prod([chain.transition[path[k], path[k + 1]] for k in range(n - 1)])
        if p == 0.0:
            continue
        L, D, b = np.eye(n * d), np.zeros((n * d, n * d)), np.zeros(n * d)
        for k, j in enumerate(path):
            x, y = slice(k * d, k * d + m), slice(k * d + m, (k + 1) * d)
            b[x] = t.b[j] if k else first.mean[j, :m]
            D[x, x] = t.Q[j] if k else first.covariance[j, :m, :m]
            b[y], D[y, y], L[y, x] = t.d[j], t.R[j], -t.H[j]
            if k:
                L[x, (k - 1) * d : (k - 1) * d + m] = -t.F[j]
        inverse = np.linalg.inv(L)
        for name, value in zip(
            ("paths", "p", "mean", "P"), (path, p, inverse @ b, inverse @ D @ inverse.T), strict=True
        ):
            getattr(found, name).append(value)
    for name in ("paths", "p", "mean", "P"):
        setattr(found, name, np.array(getattr(found, name)))
    return found


@settings(max_examples=10, deadline=None)
@given(
    seed=SEEDS,
    M=st.integers(1, 3),
    m=st.integers(1, 2),
    q=st.integers(1, 2),
    order=st.integers(1, 3),
    far=st.sampled_from([1.0, 100.0]),
)
def test_tables_are_regressions_in_the_given_model(seed, M, m, q, order, far):
    model = random_model(seed, M, m, q, far=far)
    system = exact(model, order).placed()
    for n in range(4):
        truth, d, pairs = enumerated(model, n + 2), m + q, system.pair_tables(n).pairs
        now = np.arange(n * d, n * d + m)
        window = np.concatenate([np.arange(k * d + m, (k + 1) * d) for k in range(n, max(-1, n - order), -1)])
        x, y = np.arange((n + 1) * d, (n + 1) * d + m), np.arange((n + 1) * d + m, (n + 2) * d)
        for i, j in product(range(M), repeat=2):
            mine = (truth.paths[:, -2] == i) & (truth.paths[:, -1] == j)
            if not mine.any():
                continue
            p = truth.p[mine] / truth.p[mine].sum()
            mean = p @ truth.mean[mine]
            off = truth.mean[mine] - mean
            S = np.einsum("p,pkl->kl", p, truth.P[mine] + off[:, :, None] * off[:, None, :])
            Axx, H, G, c, C, Ayy, Ny, Qyy = (part[i, j] for part in pairs)
            # Y' on the window
            E = np.linalg.solve(S[np.ix_(window, window)], S[np.ix_(window, y)]).T
            np.testing.assert_allclose(Ayy, E, **TOLERANCE)
            np.testing.assert_allclose(Ny, mean[y] - E @ mean[window], rtol=1e-9, atol=1e-9 * far)
            np.testing.assert_allclose(Qyy, S[np.ix_(y, y)] - E @ S[np.ix_(window, y)], **TOLERANCE)
            # X' on the window and Y', by way of X on the window
            J = np.linalg.solve(S[np.ix_(window, window)], S[np.ix_(window, now)]).T
            P = S[np.ix_(now, now)] - J @ S[np.ix_(window, now)]
            both = np.concatenate([window, y])
            gain = np.linalg.solve(S[np.ix_(both, both)], S[np.ix_(both, x)]).T
            np.testing.assert_allclose(np.hstack([Axx @ J + H, G]), gain, **TOLERANCE)
            constant = Axx @ (mean[now] - J @ mean[window]) + c
            np.testing.assert_allclose(constant, mean[x] - gain @ mean[both], rtol=1e-9, atol=1e-9 * far)
            rest = S[np.ix_(x, x)] - gain @ S[np.ix_(both, x)]
            np.testing.assert_allclose(Axx @ P @ Axx.T + C, rest, **TOLERANCE)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, M=st.integers(1, 3), m=st.integers(1, 2), q=st.integers(1, 2), order=st.integers(1, 3))
def test_filter_and_smoother_sum_over_all_paths(seed, M, m, q, order, enumerate_paths):
    model = random_model(seed, M, m, q)
    converted = exact(model, order)
    f, system = CGOMSMFilter(converted), converted.placed()
    ys = model.simulate(5, np.random.default_rng(seed)).y
    result, before = f.filter(ys), 0.0
    for n in range(5):
        truth = enumerate_paths(system, ys, n + 1)
        np.testing.assert_allclose(result.x[n], truth.mean[n], **TOLERANCE)
        np.testing.assert_allclose(result.P[n], truth.covariance[n], **TOLERANCE)
        np.testing.assert_allclose(result.mu[n], truth.probability[n], **TOLERANCE)
        np.testing.assert_allclose(result.log_likelihood[n], truth.log_likelihood - before, **TOLERANCE)
        before = truth.log_likelihood
    smoothed = f.smooth(ys)
    np.testing.assert_allclose(smoothed.x, truth.mean, **TOLERANCE)
    np.testing.assert_allclose(smoothed.P, truth.covariance, **TOLERANCE)
    np.testing.assert_allclose(smoothed.mu, truth.probability, **TOLERANCE)
    weights = system.chain.class_weights
    np.testing.assert_allclose(result.class_weights, result.mu @ weights, rtol=1e-12, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 3), q=st.integers(1, 2))
def test_one_node_and_a_full_window_is_the_kalman_filter(seed, m, q):
    model = random_model(seed, 1, m, q, K=1)
    ys = model.simulate(8, np.random.default_rng(seed)).y
    f, kf, system = CGOMSMFilter(exact(model, 8)), KalmanFilter(m, q), model.placed()
    t = system.tables
    kf.x, kf.P, kf.F, kf.Q, kf.H, kf.R = *model.form.state_at(np.ones(1)), t.F[0], t.Q[0], t.H[0], t.R[0]
    result = f.filter(ys)
    for n, y in enumerate(ys):
        if n:
            kf.predict()
            kf.x = kf.x + t.b[0].reshape(kf.x.shape)
        kf.update(y - t.d[0])
        np.testing.assert_allclose(result.x[n], np.ravel(kf.x), **TOLERANCE)
        np.testing.assert_allclose(result.P[n], kf.P, **TOLERANCE)
        np.testing.assert_allclose(result.log_likelihood[n], kf.log_likelihood, **TOLERANCE)


@pytest.mark.parametrize(
    "law",
    [[[0.9, 0.1], [0.3, 0.7]], FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), FadeLaw.between(20, 6, jump=0.01)],
    ids=["matrix", "fmc1", "fades"],
)
@pytest.mark.parametrize("order", [1, 3])
def test_a_stationary_start_has_the_tables_that_others_come_to(law, order):
    given = {
        "F": [[[0.5]], [[0.8]]],
        "H": [[[1.0]], [[0.3]]],
        "Q": 0.3,
        "R": 0.2,
        "b": [[1.0], [0.0]],
        "d": [5.0],
    }
    still, moving = SwitchingStateSpace(law, **given), SwitchingStateSpace(law, **given, x0=[9.0], P0=1.0)
    one, other = (exact(model, order, 3).placed() for model in (still, moving))
    assert (one.steady_from, other.steady_from) == (order - 1, None)
    # means that are stationary all along, and such as become so
    for n in (order - 1, 150):
        for a, b in zip(one.pair_tables(n).pairs, other.pair_tables(150).pairs, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-10)


def test_known_nodes_condition_one_gaussian(enumerate_paths):
    model = random_model(4, 3, 2, 1)
    converted = exact(model, 2)
    data = converted.simulate(6, np.random.default_rng(0))
    found = KnownSwitchFilter(converted).filter(data.y, data.r)
    # the filter of a chain that follows this path alone
    system, path = converted.placed(), data.r.astype(int)
    parts = [[part[i, j] for part in system.pair_tables(k).pairs] for k, (i, j) in enumerate(pairwise(path))]
    mean, P = system.initial().mean[path[0]], system.initial().covariance[path[0]]
    m = 2
    gain = P[:m, m:] / P[m:, m:]
    x, P = mean[:m] + gain @ (data.y[0] - mean[m:]), P[:m, :m] - gain @ P[m:, :m]
    for k, (Axx, H, G, c, C, *_) in enumerate(parts):
        window = data.y[max(0, k - 1) : k + 1][::-1].ravel()
        x, P = Axx @ x + H @ window + G @ data.y[k + 1] + c, Axx @ P @ Axx.T + C
        np.testing.assert_allclose(found.x[k + 1], x, **TOLERANCE)
        np.testing.assert_allclose(found.P[k + 1], P, **TOLERANCE)

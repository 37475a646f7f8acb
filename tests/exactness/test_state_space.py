"""IMM and GPB2 against the joint Gaussian of all times, path by path of the switch, without recursions."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import (
    FadeLaw,
    FuzzyMarkovLaw,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)

METHODS = ["imm", "gpb2"]
SEEDS = st.integers(0, 10**6)
NAMES = ("F", "H", "Q", "R", "b", "d", "B", "x0", "P0")


def definite(rng, *shape):
    root = 0.5 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def parameters(rng, K, m, q):
    """Parameters of K classes in the order of NAMES, with one control."""
    return dict(
        zip(
            NAMES,
            (
                0.6 * rng.normal(size=(K, m, m)), rng.normal(size=(K, q, m)), definite(rng, K, m, m),
                definite(rng, K, q, q), rng.normal(size=(K, m)), rng.normal(size=(K, q)),
                rng.normal(size=(K, m, 1)), rng.normal(size=(K, m)), definite(rng, K, m, m),
            ),
            strict=True,
        )
    )  # fmt: skip


def chain_of(rng, M, K):
    """Any chain of M nodes, some arrows of which are missing."""
    T = rng.dirichlet(np.ones(M), M) * (rng.random((M, M)) < 0.8) + 0.1 * np.eye(M)
    weights = rng.dirichlet(np.ones(K), M)
    values = np.linspace(0.1, 0.9, M)
    return SwitchChain(
        values, np.ones(M), rng.dirichlet(np.ones(M)), T / T.sum(axis=1, keepdims=True), weights
    )


def along(path, values, ys, us):
    """Log-density of what is there of y (n, q) on a path of nodes, and the law of the last state given it."""
    n, m = len(path), values["F"].shape[-1]
    F, Q, H, R, b, d, B = (values[name][list(path)] for name in ("F", "Q", "H", "R", "b", "d", "B"))
    # A x = c + noise, for the states of all times at once
    A, c, V = np.eye(n * m), np.empty(n * m), np.zeros((n * m, n * m))
    for k in range(n):
        here = slice(k * m, (k + 1) * m)
        c[here] = values["x0"][path[0]] if k == 0 else b[k] + B[k] @ us[k]
        V[here, here] = values["P0"][path[0]] if k == 0 else Q[k]
        if k:
            A[here, (k - 1) * m : k * m] = -F[k]
    inverse = np.linalg.inv(A)
    mean, P = inverse @ c, inverse @ V @ inverse.T
    q = H.shape[1]
    C, N = np.zeros((n * q, n * m)), np.zeros((n * q, n * q))
    for k in range(n):
        C[k * q : (k + 1) * q, k * m : (k + 1) * m] = H[k]
        N[k * q : (k + 1) * q, k * q : (k + 1) * q] = R[k]
    y, seen = ys.ravel(), ~np.isnan(ys.ravel())
    off = (y - C @ mean - d.ravel())[seen]
    S, across = (C @ P @ C.T + N)[np.ix_(seen, seen)], (P[-m:] @ C.T)[:, seen]
    value = (
        -0.5 * (off @ np.linalg.solve(S, off) + np.linalg.slogdet(2 * np.pi * S)[1]) if seen.any() else 0.0
    )
    gain = np.linalg.solve(S, across.T).T
    return value, mean[-m:] + gain @ off, P[-m:, -m:] - gain @ across.T


def enumerated(chain, values, ys, us):
    """Log-likelihood of all of y, probabilities of the last node, mean and covariance of the last state."""
    M, m = len(chain), values["F"].shape[-1]
    found = []
    for path in product(range(M), repeat=len(ys)):
        p = chain.initial[path[0]] * np.prod([chain.transition[a] for a in pairwise(path)])
        if p > 0.0:
            found.append((np.log(p), path[-1], *along(path, values, ys, us)))
    log_w = np.array([a + c for a, _, c, *_ in found])
    total = np.logaddexp.reduce(log_w)
    w = np.exp(log_w - total)
    x, P = np.array([one[3] for one in found]), np.array([one[4] for one in found])
    mean, off = w @ x, x - w @ x
    mu = np.array([w[[one[1] == j for one in found]].sum() for j in range(M)])
    return total, mu, mean, np.einsum("k,kab->ab", w, P + off[:, :, None] * off[:, None, :]).reshape(m, m)


def on_nodes(chain, each):
    return {name: np.tensordot(chain.class_weights, value, 1) for name, value in each.items()}


def holes(rng, n, q, share=0.4):
    ys = 2.0 * rng.normal(size=(n, q))
    ys[rng.random((n, q)) < share] = np.nan
    return ys


# --------------------------------------------------------------------------- exact where it should be


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, M=st.integers(1, 4), m=st.integers(1, 3), q=st.integers(1, 2))
def test_gpb2_is_exact_for_two_observations_whatever_is_missing(seed, M, m, q):
    rng = np.random.default_rng(seed)
    chain, each = chain_of(rng, M, 2), parameters(rng, 2, m, q)
    f = SwitchingKalmanFilter(SwitchingStateSpace(chain, **each), method="gpb2")
    ys, us = holes(rng, 2, q), rng.normal(size=(2, 1))
    total, mu, x, P = enumerated(chain, on_nodes(chain, each), ys, us)
    found = f.filter(ys, us)
    np.testing.assert_allclose(found.log_likelihood.sum(), total, rtol=1e-9, atol=1e-9)
    for got, expected in ((found.mu[-1], mu), (found.x[-1], x), (found.P[-1], P)):
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 3), q=st.integers(1, 3), method=st.sampled_from(METHODS))
def test_one_class_is_the_kalman_filter_whatever_is_missing(seed, m, q, method):
    rng = np.random.default_rng(seed)
    each = parameters(rng, 1, m, q)
    ys, us = holes(rng, 6, q), rng.normal(size=(6, 1))
    f = SwitchingKalmanFilter(SwitchingStateSpace([[1.0]], **each), method=method)
    found = f.filter(ys, us)
    for n in range(1, 7):
        value, x, P = along((0,) * n, each, ys[:n], us)
        np.testing.assert_allclose(found.log_likelihood[:n].sum(), value, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.x[n - 1], x, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(found.P[n - 1], P, rtol=1e-8, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, method=st.sampled_from(METHODS))
def test_classes_that_are_alike_are_one(seed, method):
    rng = np.random.default_rng(seed)
    chain, one = chain_of(rng, 4, 2), parameters(rng, 1, 2, 1)
    ys, us = holes(rng, 5, 1), rng.normal(size=(5, 1))
    alike = {name: np.repeat(value, 2, axis=0) for name, value in one.items()}
    found = SwitchingKalmanFilter(SwitchingStateSpace(chain, **alike), method=method).filter(ys, us)
    value, x, P = along((0,) * 5, one, ys, us)
    np.testing.assert_allclose(found.log_likelihood.sum(), value, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.x[-1], x, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.P[-1], P, rtol=1e-8, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 3), q=st.integers(1, 2), K=st.integers(2, 3))
def test_a_known_switch_is_the_kalman_filter_along_it_whatever_is_missing(seed, m, q, K):
    rng = np.random.default_rng(seed)
    each, ys, us = parameters(rng, K, m, q), holes(rng, 5, q), rng.normal(size=(5, 1))
    law = FadeLaw(K, {(a, (a + 1) % K): (0.1, 8.0) for a in range(K)})
    w = rng.dirichlet(np.ones(K), 5)  # any class weights, whatever the law has on its way
    there = {name: np.tensordot(w, value, 1) for name, value in each.items()}
    f = KnownSwitchFilter(SwitchingStateSpace(law, **each))
    found = f.filter(ys, w, us)
    for n in range(1, 6):
        value, x, P = along(range(n), there, ys[:n], us)
        np.testing.assert_allclose(found.log_likelihood[:n].sum(), value, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.x[n - 1], x, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(found.P[n - 1], P, rtol=1e-8, atol=1e-9)


def test_the_likelihood_of_gpb2_is_nearer_than_that_of_imm():
    # the gain and the offset differ between classes, where merging before a step costs most
    rng = np.random.default_rng(3)
    chain = SwitchChain.from_classes([[0.8, 0.2], [0.3, 0.7]])
    each = parameters(rng, 2, 1, 1) | {"H": np.array([[[1.0]], [[0.3]]]), "d": np.array([[0.0], [3.0]])}
    ys, us = rng.normal(size=(7, 1)), np.zeros((7, 1))
    total, *_ = enumerated(chain, each, ys, us)
    model = SwitchingStateSpace(chain, **each)
    off = {m: SwitchingKalmanFilter(model, method=m).filter(ys).log_likelihood.sum() - total for m in METHODS}
    assert abs(off["gpb2"]) < 0.3 * abs(off["imm"])


# --------------------------------------------------------------------------- what must not matter


HARD = [[0.9, 0.1], [0.2, 0.8]]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("law", "n_nodes"),
    [
        (FadeLaw(2, {(0, 1): (0.1, 7.0), (1, 0): (0.2, 9.0)}), 0),
        (FadeLaw(2, {}, jumps={(0, 1): 0.1, (1, 0): 0.2}), 5),
        (SwitchChain.from_classes(HARD), 3),
    ],
    ids=["no nodes", "jumps alone", "chain"],
)
def test_without_fuzziness_it_is_the_hard_filter(law, n_nodes, method):
    rng = np.random.default_rng(1)
    each, ys = parameters(rng, 2, 2, 1), holes(rng, 40, 1)
    expected = SwitchingKalmanFilter(SwitchingStateSpace(HARD, **each), method=method).filter(ys)
    found = SwitchingKalmanFilter(SwitchingStateSpace(law, **each), method=method, n_nodes=n_nodes).filter(ys)
    for name in ("x", "P", "mu", "class_weights", "log_likelihood"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_a_fuzzy_law_whose_density_vanishes_is_the_hard_filter(method):
    rng = np.random.default_rng(2)
    each, ys = parameters(rng, 2, 2, 1), holes(rng, 40, 1)
    law = FuzzyMarkovLaw.fmc1(0.35, 0.0, 0.0)
    hard = SwitchChain.from_classes(np.array(law.harden()) * 2)  # both classes have probability 1/2
    expected = SwitchingKalmanFilter(SwitchingStateSpace(hard, **each), method=method).filter(ys)
    found = SwitchingKalmanFilter(SwitchingStateSpace(law, **each), method=method).filter(ys)
    for name in ("x", "P", "class_weights", "log_likelihood"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-10)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, method=st.sampled_from(METHODS))
def test_the_order_of_nodes_and_classes_does_not_matter(seed, method):
    rng = np.random.default_rng(seed)
    M, K = 4, 3
    chain, each, ys = chain_of(rng, M, K), parameters(rng, K, 2, 2), holes(rng, 12, 2)
    nodes, classes = rng.permutation(M), rng.permutation(K)
    other = SwitchChain(
        chain.nodes[nodes], np.ones(M), chain.initial[nodes], chain.transition[np.ix_(nodes, nodes)],
        chain.class_weights[np.ix_(nodes, classes)],
    )  # fmt: skip
    moved = {name: value[classes] for name, value in each.items()}
    a = SwitchingKalmanFilter(SwitchingStateSpace(chain, **each), method=method).filter(ys)
    b = SwitchingKalmanFilter(SwitchingStateSpace(other, **moved), method=method).filter(ys)
    np.testing.assert_allclose(b.mu, a.mu[:, nodes], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(b.class_weights, a.class_weights[:, classes], rtol=1e-9, atol=1e-12)
    for name in ("x", "P", "log_likelihood"):
        np.testing.assert_allclose(getattr(b, name), getattr(a, name), rtol=1e-9, atol=1e-10)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, method=st.sampled_from(METHODS), power=st.sampled_from([-12, -3, 6, 12]))
def test_units_do_not_matter(seed, method, power):
    rng = np.random.default_rng(seed)
    each, ys = parameters(rng, 2, 2, 2), holes(rng, 12, 2, 0.2)
    u, v = np.array([10.0**power, 1.0]), np.array([1.0, 10.0**-power])  # units of x and of y
    other = {
        "F": each["F"] * u[:, None] / u, "H": each["H"] * v[:, None] / u, "Q": each["Q"] * u[:, None] * u,
        "R": each["R"] * v[:, None] * v, "b": each["b"] * u, "d": each["d"] * v, "x0": each["x0"] * u,
        "P0": each["P0"] * u[:, None] * u,
    }  # fmt: skip
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    del each["B"]
    a = SwitchingKalmanFilter(SwitchingStateSpace(law, **each), method=method).filter(ys)
    b = SwitchingKalmanFilter(SwitchingStateSpace(law, **other), method=method).filter(ys * v)
    np.testing.assert_allclose(b.mu, a.mu, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(b.x / u, a.x, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(b.P / u[:, None] / u, a.P, rtol=1e-7, atol=1e-8)
    shift = (~np.isnan(ys)) @ np.log(v)
    np.testing.assert_allclose(b.log_likelihood + shift, a.log_likelihood, rtol=1e-8, atol=1e-8)


# --------------------------------------------------------------------------- filters of the same thing


@pytest.mark.parametrize("method", METHODS)
def test_from_filters_goes_on_as_the_bank_does(method):
    rng = np.random.default_rng(4)
    each, ys = parameters(rng, 2, 2, 1), holes(rng, 50, 1, 0.1)
    filters = []
    for k in range(2):
        f = KalmanFilter(2, 1, F=each["F"][k], H=each["H"][k], Q=each["Q"][k], R=each["R"][k])
        f.x, f.P = each["x0"][0][:, None], each["P0"][0]  # before the first predict, the same for both
        filters.append(f)
    model = SwitchingStateSpace.from_filters(filters, HARD)
    bank = IMMEstimator(filters, [2 / 3, 1 / 3], HARD, method=method)
    found, expected = SwitchingKalmanFilter(model, method=method).filter(ys), bank.filter(ys)
    for name in ("x", "P", "mu", "log_likelihood", "x_prior", "P_prior"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-10)


# --------------------------------------------------------------------------- far off


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [1e3, 1e5])
def test_an_outlier_leaves_numbers_that_say_something(method, size):
    # the class of the larger noise explains it: .7 of its weight is that of the prior
    each = {"F": 0.9, "H": 1.0, "Q": 0.1, "R": [[[0.04]], [[4.0]]], "x0": [0.0], "P0": 1.0}
    model = SwitchingStateSpace(FadeLaw.between(30, 10), **each)
    f = SwitchingKalmanFilter(model, method=method)
    ys = np.zeros(40)
    ys[20] = size
    found = f.filter(ys)
    for name in ("x", "P", "mu", "class_weights", "log_likelihood"):
        assert np.isfinite(getattr(found, name)).all()
    assert found.class_weights[20, 1] > 0.99
    np.testing.assert_allclose(found.mu.sum(axis=1), 1.0, rtol=1e-14)
    assert found.log_likelihood[20] < -0.4 * size**2 / 10.0
    assert abs(found.x[39, 0]) < 0.2 * found.x[20, 0]  # and it comes back


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [1.0, 1e3, 1e6])
def test_a_tie_leaves_the_prior_however_far_it_is(method, size):
    # two classes see the state with opposite signs, and it lies at zero: both densities are equal
    each = {"F": 0.9, "H": [[[1.0]], [[-1.0]]], "Q": 0.1, "R": 1.0, "x0": [0.0], "P0": 1.0}
    f = SwitchingKalmanFilter(SwitchingStateSpace([[0.7, 0.3], [0.1, 0.9]], **each), method=method)
    f.step(size)
    np.testing.assert_allclose(f.mu, [0.25, 0.75], rtol=1e-15)

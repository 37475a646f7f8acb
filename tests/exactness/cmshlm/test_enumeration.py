"""Filters and smoothers of converted models are exact: all K^N sequences of regimes are summed over."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import CGOMSMFilter, CGOMSModel, KnownSwitchFilter
from fuzzykf.errors import NotPositiveDefiniteError

KINDS = [
    ("gain", "pair", 1),
    ("gain", "pair", 2),
    ("gain", "pair", 4),
    ("gain", "averaged", 1),
    ("gain", "averaged", 3),
    ("clip", "pair", 1),
    ("clip", "averaged", 1),
]


@given(
    K=st.integers(1, 3),
    m=st.integers(1, 3),
    q=st.integers(1, 2),
    kind=st.sampled_from(KINDS),
    zeros=st.booleans(),
    outlier=st.sampled_from([1.0, 1e3]),
    seed=st.integers(0, 10**6),
)
@settings(max_examples=25, deadline=None)
def test_filter_sums_over_all_sequences_of_regimes(
    K, m, q, kind, zeros, outlier, seed, make_oracle, convert, random_parameters
):
    # K^N sequences: 1, 128 or 243; unstable models, impossible regimes and outliers included
    N = {1: 8, 2: 7, 3: 5}[K]
    oracle = make_oracle(*random_parameters(K, m, q, seed, scale=1.1, zeros=zeros), *kind)
    ys = np.random.default_rng(seed + 1).normal(size=(N, q)) * 2.0
    ys[N // 2] *= outlier
    result = CGOMSMFilter(convert(oracle)).filter(ys)
    scale = max(1.0, np.abs(ys).max())
    for got, expected, size in zip(
        (result.x, result.P, result.mu, result.log_likelihood),
        oracle.filter(ys),
        (scale, scale**2, 1.0, scale**2),
        strict=True,
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-9 * size)


@given(K=st.integers(1, 2), m=st.integers(1, 2), seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_the_construction_of_the_paper_is_exact_or_refused(
    K, m, seed, make_oracle, convert, random_parameters
):
    # slow states (scale 1.6) make the noise indefinite, fast ones do not
    noise = ["pair", "averaged"][seed % 2]
    scale = [0.4, 1.6][seed // 2 % 2]
    N = 6
    oracle = make_oracle(*random_parameters(K, m, 1, seed, scale=scale), "markov_x", noise)
    least = min(np.linalg.eigvalsh(Q2)[0] for n in range(N) for _, Q2 in oracle.tables(n).values())
    refused = None
    try:
        model = convert(oracle)
    except NotPositiveDefiniteError as error:
        refused = int(re.search(r"construction='markov_x' at step (\d+)", str(error))[1])
    if least < -1e-9:
        assert refused is not None
        assert refused < N
        return
    if refused is not None:
        assert refused >= N
        return
    ys = np.random.default_rng(seed).normal(size=(N, 1)) * 2.0
    result = CGOMSMFilter(model).filter(ys)
    for got, expected in zip(
        (result.x, result.P, result.mu, result.log_likelihood), oracle.filter(ys), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("order", [1, 3])
def test_smoother_sums_over_all_sequences_of_regimes(order, make_oracle, convert, random_parameters):
    oracle = make_oracle(*random_parameters(2, 2, 1, seed=11), order=order)
    ys = np.random.default_rng(3).normal(size=(7, 1)) * 2.0
    result = CGOMSMFilter(convert(oracle)).smooth(ys)
    for n in range(len(ys)):
        mean, covariance, paths, weights, _ = oracle.posterior(ys, n)
        np.testing.assert_allclose(result.x[n], mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(result.P[n], covariance, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(result.mu[n], np.bincount(paths[:, n], weights), atol=1e-10)


@pytest.mark.parametrize(
    "kind", [("gain", "pair", 1), ("gain", "pair", 3), ("gain", "averaged", 2), ("clip", "pair", 1)]
)
def test_known_regimes_condition_one_gaussian(kind, make_oracle, convert, random_parameters):
    oracle = make_oracle(*random_parameters(3, 2, 2, seed=21), *kind)
    ys = np.random.default_rng(4).normal(size=(6, 2))
    path = np.array([2, 0, 0, 1, 2, 2])
    result = KnownSwitchFilter(convert(oracle)).filter(ys, path)
    S, d = oracle.joint_2(path), 4
    for n in range(6):
        seen = np.concatenate([np.arange(k * d + 2, (k + 1) * d) for k in range(n + 1)])
        hidden = np.arange(n * d, n * d + 2)
        gain = np.linalg.solve(S[np.ix_(seen, seen)], S[np.ix_(seen, hidden)]).T
        np.testing.assert_allclose(result.x[n], gain @ ys[: n + 1].reshape(-1), rtol=1e-9, atol=1e-10)
        P = S[np.ix_(hidden, hidden)] - gain @ S[np.ix_(seen, hidden)]
        np.testing.assert_allclose(result.P[n], P, rtol=1e-9, atol=1e-10)


@given(m=st.integers(1, 4), q=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_one_class_with_a_window_of_the_whole_series_is_the_kalman_filter(
    m, q, seed, make_oracle, convert, random_parameters
):
    N = 8
    oracle = make_oracle(*random_parameters(1, m, q, seed, scale=1.2), order=N)
    ys = np.random.default_rng(seed).normal(size=(N, q))
    result = CGOMSMFilter(convert(oracle)).filter(ys)
    for n in range(N):  # the exact posterior of Model 1, by conditioning
        mean, covariance, *_ = oracle.posterior(ys[: n + 1], n, joint=oracle.joint_1)
        np.testing.assert_allclose(result.x[n], mean, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(result.P[n], covariance, rtol=1e-8, atol=1e-10)


@given(K=st.integers(1, 3), seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_order_one_with_a_window_is_gain(K, seed, make_oracle, convert, random_parameters):
    # the table of order 1 is what order 3 uses at its first step, when the window has one entry
    parameters = random_parameters(K, 2, 1, seed)
    one = convert(make_oracle(*parameters, order=1)).on_nodes().pair_tables(0).pairs
    three = convert(make_oracle(*parameters, order=3)).on_nodes().pair_tables(0).pairs
    for a, b in zip(one, three, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("order", [1, 3])
def test_stationary_tables_are_those_of_a_stationary_start(order, random_parameters):
    # time-varying tables that start in the stationary law do not move, but for the growing window
    T, A, B, C, D, _, _ = random_parameters(2, 2, 1, seed=8, scale=0.6)
    p = np.linalg.solve(np.vstack([(T.T - np.eye(2))[0], np.ones(2)]), [0.0, 1.0])
    stationary = CGOMSModel.from_cglssm(T, A, B, C, D, order=order)
    moving = CGOMSModel.from_cglssm(T, A, B, C, D, initial_probability=p, order=order, mode="time_varying")
    assert stationary.on_nodes().steady_from == order - 1
    for n in (0, 1, 2, 7, 150):
        a, b = (model.on_nodes().pair_tables(n).pairs for model in (stationary, moving))
        for x, y in zip(a, b, strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-11)


def test_impossible_regimes_change_nothing(make_oracle, convert, random_parameters):
    # a regime that never occurs, with matrices for which no table exists, leaves the others alone
    T, A, B, C, D, p0, G0 = random_parameters(2, 2, 1, seed=41)
    ys = np.random.default_rng(5).normal(size=(30, 1))
    plain = CGOMSMFilter(convert(make_oracle(T, A, B, C, D, p0, G0, order=2))).filter(ys)
    T3 = np.zeros((3, 3))
    T3[:2, :2], T3[2] = T, [0.5, 0.25, 0.25]
    A, B, C, D, G0 = (np.concatenate([a, np.zeros_like(a[:1])]) for a in (A, B, C, D, G0))
    wide = CGOMSMFilter(convert(make_oracle(T3, A, B, C, D, np.append(p0, 0.0), G0, order=2))).filter(ys)
    np.testing.assert_allclose(wide.x, plain.x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(wide.P, plain.P, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(wide.log_likelihood, plain.log_likelihood, rtol=1e-10)
    np.testing.assert_array_equal(wide.mu[:, 2], 0.0)


def test_a_regime_left_for_good_keeps_its_tables_when_its_probability_underflows():
    # p(r_n = 0) = 2^-n is zero in floating point from n = 1075 on, but data may still speak for it
    rng = np.random.default_rng(6)
    model = CGOMSModel.from_cglssm(
        [[0.5, 0.5], [0.0, 1.0]],
        A=[[[0.5]], [[0.5]]],
        B=[[[1.0]], [[1.0]]],
        C=[[[1.0]], [[1.0]]],
        D=[[[0.1]], [[50.0]]],
        initial_probability=[1.0, 0.0],
        initial_covariance=[[[1.0]], [[1.0]]],
        mode="time_varying",
    )
    quiet = rng.normal(size=(1200, 1))
    result = CGOMSMFilter(model).filter(quiet)
    assert result.mu[-1, 0] > 0.8
    system = model.on_nodes()
    early, late = (system.pair_tables(n).pairs for n in (50, 1150))
    np.testing.assert_allclose(late.Qyy[0, 0], early.Qyy[0, 0], rtol=1e-9)


@pytest.mark.parametrize("kind", [("gain", "pair", 1), ("gain", "pair", 3), ("clip", "averaged", 1)])
def test_outliers_stay_finite(kind, make_oracle, convert, random_parameters):
    oracle = make_oracle(*random_parameters(3, 2, 2, seed=51), *kind)
    ys = np.random.default_rng(7).normal(size=(20, 2))
    ys[10] = 1e5, -1e5
    result = CGOMSMFilter(convert(oracle)).filter(ys)
    for values in (result.x, result.P, result.mu, result.log_likelihood):
        assert np.isfinite(values).all()
    assert np.linalg.eigvalsh(result.P).min() > 0.0
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0)

"""What the converted model keeps of the given one: Proposition 1 of the 2013 paper, true and false parts."""

from __future__ import annotations

import itertools

import numpy as np
import pytest


def blocks(n, m, q):
    """X_0.., Y_0.. as index lists of the joint covariance of n times."""
    starts = [k * (m + q) for k in range(n)]
    return [np.arange(k, k + m) for k in starts], [np.arange(k + m, k + m + q) for k in starts]


@pytest.fixture(scope="module")
def proposition(make_oracle, convert, random_parameters):
    """Joint covariances of both models with one class, and the places of X_n and of Y_n."""

    def compute(construction, seed=2, N=5):
        m, q = 2, 1
        oracle = make_oracle(*random_parameters(1, m, q, seed, scale=0.4), construction)
        system = convert(oracle).on_nodes()
        for n in range(N - 1):
            Axx, H, G, _, C, Ayy, _, V = (value[0, 0] for value in system.pair_tables(n).pairs)
            A2 = np.block([[Axx, H + G @ Ayy], [np.zeros((q, m)), Ayy]])
            oracle._tables[n] = {(0, 0): (A2, np.block([[C + G @ V @ G.T, G @ V], [V @ G.T, V]]))}
        path = np.zeros(N, dtype=int)
        S1, S2 = oracle.joint_1(path), oracle.joint_2(path)
        return S1, S2, *blocks(N, m, q)

    return compute


@pytest.mark.parametrize("construction", ["markov_x", "gain", "clip"])
def test_proposition_1_observations(construction, proposition):
    S1, S2, X, Y = proposition(construction)
    N = len(X)
    for n in range(N):  # P3: the covariance of Z_n
        z = np.concatenate([X[n], Y[n]])
        np.testing.assert_allclose(S2[np.ix_(z, z)], S1[np.ix_(z, z)], rtol=1e-10, atol=1e-12)
    for n in range(N - 1):  # P2: Cov(Y_n, Y_n+1)
        np.testing.assert_allclose(
            S2[np.ix_(Y[n], Y[n + 1])], S1[np.ix_(Y[n], Y[n + 1])], rtol=1e-10, atol=1e-12
        )
    # P1: Y is a Markov chain: Y_n+1 and Y_n-1 are independent given Y_n (in Model 1 they are not)
    for n in range(1, N - 1):
        a, b, c = (int(Y[k][0]) for k in (n - 1, n, n + 1))
        assert S2[a, c] == pytest.approx(S2[a, b] * S2[b, c] / S2[b, b], rel=1e-10)
        assert abs(S1[a, c] - S1[a, b] * S1[b, c] / S1[b, b]) > 1e-4 * np.sqrt(S1[a, a] * S1[c, c])


def test_proposition_1_state_of_the_construction_of_the_paper(proposition):
    # P4: X is a Markov chain with the same law; the gain construction gives that up
    S1, S2, X, _ = proposition("markov_x")
    x = np.concatenate(X)
    np.testing.assert_allclose(S2[np.ix_(x, x)], S1[np.ix_(x, x)], rtol=1e-10, atol=1e-12)
    S1, S2, X, _ = proposition("gain")
    x = np.concatenate(X)
    assert np.abs(S2[np.ix_(x, x)] - S1[np.ix_(x, x)]).max() > 1e-3


def test_proposition_1_pairs_that_agree_and_the_pair_that_does_not(proposition):
    # P5 claims equal laws of (X_n, Y_n+1) too: that is false
    S1, S2, X, Y = proposition("markov_x")
    for n in range(len(X) - 1):
        for a, b in ((X[n], Y[n]), (Y[n], Y[n + 1]), (X[n + 1], Y[n])):
            np.testing.assert_allclose(S2[np.ix_(a, b)], S1[np.ix_(a, b)], rtol=1e-10, atol=1e-12)
        for triple in ((X[n], Y[n], X[n + 1]), (X[n + 1], Y[n], Y[n + 1])):
            k = np.concatenate(triple)
            np.testing.assert_allclose(S2[np.ix_(k, k)], S1[np.ix_(k, k)], rtol=1e-10, atol=1e-12)
        a, b = X[n], Y[n + 1]
        assert np.abs(S2[np.ix_(a, b)] - S1[np.ix_(a, b)]).max() > 1e-3


@pytest.mark.parametrize(("construction", "order"), [("gain", 1), ("gain", 3), ("clip", 1)])
def test_switching_models_agree_in_what_they_promise(construction, order, make_oracle, random_parameters):
    # Cov(Z_n | r_n), Var(Z_n+1 | r_n, r_n+1) and the law of (X_n+1, w_n, Y_n+1) given the pair
    oracle = make_oracle(*random_parameters(2, 2, 1, seed=31), construction, order=order)
    N, d = 5, 3
    paths, p = oracle.paths(N)
    S1, S2 = oracle.joint_1(paths), oracle.joint_2(paths)
    here = np.arange((N - 1) * d, N * d)
    both = np.concatenate([here, oracle.window(N - 2)[2:]])
    for i, j in itertools.product(range(2), repeat=2):
        mine = (paths[:, -2] == i) & (paths[:, -1] == j)
        a, b = (np.einsum("p,pkl->kl", p[mine], S[mine]) / p[mine].sum() for S in (S1, S2))
        np.testing.assert_allclose(b[np.ix_(both, both)], a[np.ix_(both, both)], rtol=1e-9, atol=1e-11)

"""Means of windows and states, mixed over the pairs that lead to a regime."""

from __future__ import annotations

import numpy as np

from fuzzykf.switching.state_space.conversion import StateSpace
from fuzzykf.switching.state_space.offsets import Offsets, first_mean, mixed_means, pair_means

rng = np.random.default_rng(0)
K, M, Q, W = 3, 2, 1, 2
SPACE = StateSpace(
    rng.normal(size=(K, M, M)), rng.normal(size=(K, Q, M)), np.zeros((K, M, M)), np.zeros((K, Q, Q))
)
OFFSETS = Offsets(rng.normal(size=(K, M)), rng.normal(size=(K, Q)))


def test_means_of_a_pair_are_moved_by_the_regime_of_arrival():
    x = rng.normal(size=(K, M))
    first = first_mean(x, SPACE.B, OFFSETS.d)
    mean = np.concatenate([rng.normal(size=(K, W - Q)), first], axis=1)
    found = pair_means(mean, SPACE, OFFSETS)
    for i in range(K):
        np.testing.assert_allclose(first[i], [*(SPACE.B[i] @ x[i] + OFFSETS.d[i]), *x[i]])
        np.testing.assert_array_equal(found.omega[i], mean[i, :W])
        for j in range(K):
            xi = SPACE.A[j] @ x[i] + OFFSETS.b[j]
            np.testing.assert_allclose(found.xi[i, j], xi)
            np.testing.assert_allclose(found.eta[i, j], SPACE.B[j] @ xi + OFFSETS.d[j])


def test_means_far_from_zero_leave_their_differences_alone():
    kernel = rng.dirichlet(np.ones(K), K).T
    mean = rng.normal(size=(K, W + M))
    near = pair_means(mean, SPACE, OFFSETS)
    far = near._replace(eta=near.eta + 1e12, omega=near.omega + 1e12, xi=near.xi + 1e12)
    for length in (Q, W, W + Q):
        m, off = mixed_means(near, kernel, length)
        assert m.shape == (K, length + M)
        np.testing.assert_allclose(np.einsum("ij,ijk->jk", kernel, off), 0.0, atol=1e-14)
        each = [
            np.concatenate([near.eta[0, j], near.omega[0, : length - Q], near.xi[0, j]]) for j in range(K)
        ]
        np.testing.assert_allclose(m + off[0], each)
        shifted, again = mixed_means(far, kernel, length)
        np.testing.assert_allclose(shifted, m + 1e12, rtol=1e-15)
        np.testing.assert_allclose(again, off, atol=1e-3)

"""Covariances between regimes."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.switching.dynamics.interpolation import LogCovariance, compose, decompose


def random_covariances(n, d, seed=0):
    root = np.random.default_rng(seed).normal(size=(n, d, d))
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(d)


@pytest.mark.parametrize("d", [1, 2, 4])
def test_factors(d):
    # T is unit lower triangular with T V T' diagonal
    V = random_covariances(5, d)
    T, g = decompose(V)
    np.testing.assert_allclose(np.triu(T), np.broadcast_to(np.eye(d), V.shape), atol=1e-15)
    for k in range(5):
        np.testing.assert_allclose(T[k] @ V[k] @ T[k].T, np.diag(np.exp(g[k])), atol=1e-12)
    np.testing.assert_allclose(compose(T, g), V, atol=1e-12)


def test_factors_of_a_singular_matrix():
    b = np.array([[1.0, 2.0, -1.0], [0.0, 1.0, 1.0]]).T
    V = b @ b.T  # rank two
    T, g = decompose(V[None])
    np.testing.assert_array_equal(np.isneginf(g[0]), [False, False, True])
    np.testing.assert_allclose(compose(T, g)[0], V, atol=1e-13)
    # rank one, but for rounding: what is left of the other components counts as nothing
    c = np.random.default_rng(0).normal(size=(50, 4, 1))
    T, g = decompose(c @ np.swapaxes(c, 1, 2))
    assert np.isneginf(g[:, 1:]).all()
    assert np.isfinite(g[:, 0]).all()
    T, g = decompose(np.zeros((1, 2, 2)))
    assert np.isneginf(g).all()
    np.testing.assert_array_equal(compose(T, g), np.zeros((1, 2, 2)))


def test_geometric_mean_of_variances():
    between = LogCovariance("V", np.array([[[1.0]], [[4.0]], [[16.0]]]))
    shares = np.array([[0.5, 0.5, 0.0], [0.25, 0.5, 0.25], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(between(shares)[:, 0, 0], [2.0, 4.0, 16.0], rtol=1e-14)


@pytest.mark.parametrize("d", [1, 3])
def test_regimes_as_given_and_definite_between(d):
    V = random_covariances(2, d)
    between = LogCovariance("V", V)
    np.testing.assert_array_equal(between(np.eye(2)), V)
    r = np.linspace(0, 1, 41)
    path = between(np.stack([1 - r, r], axis=-1).reshape(41, 1, 2))
    assert path.shape == (41, 1, d, d)
    assert (np.linalg.eigvalsh(path) > 0).all()
    np.testing.assert_allclose(path, np.swapaxes(path, -1, -2), rtol=1e-14)
    # continuous at the regimes, and with the geometric mean as determinant
    np.testing.assert_allclose(between(np.array([1 - 1e-9, 1e-9])), V[0], rtol=1e-7, atol=1e-8)
    determinant = np.linalg.det(path[:, 0])
    np.testing.assert_allclose(
        determinant, np.linalg.det(V[0]) ** (1 - r) * np.linalg.det(V[1]) ** r, rtol=1e-10
    )


def test_units_do_not_matter():
    V, D = random_covariances(2, 2), np.diag([1e-6, 1e5])
    shares = np.array([0.3, 0.7])
    np.testing.assert_allclose(LogCovariance("V", D @ V @ D)(shares), D @ LogCovariance("V", V)(shares) @ D)


def test_singular_in_every_regime():
    # no residual anywhere: zero in between, the rest as before
    V = np.zeros((2, 2, 2))
    V[:, 1, 1] = [1.0, 4.0]
    np.testing.assert_allclose(LogCovariance("V", V)(np.array([0.5, 0.5])), [[0, 0], [0, 2]])
    np.testing.assert_array_equal(LogCovariance("V", 0 * V)(np.array([0.5, 0.5])), np.zeros((2, 2)))


def test_singular_in_one_regime_only():
    between = LogCovariance("C", np.array([[[1.0]], [[0.0]]]))
    np.testing.assert_array_equal(between(np.eye(2))[:, 0, 0], [1.0, 0.0])
    with pytest.raises(
        NotPositiveDefiniteError, match="C: the matrix number 1 is singular where others are not"
    ):
        between(np.array([0.5, 0.5]))

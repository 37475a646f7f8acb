"""The switching state-space model: what it refuses, its second moments, its simulator."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fuzzykf import CGLSSM
from fuzzykf.errors import NotPositiveDefiniteError, NotStableError, ParameterError, ShapeError

T = [[0.9, 0.1], [0.3, 0.7]]
MATRICES = {
    "A": [[[0.8, 0.3], [0.0, 0.5]], [[0.2, -0.4], [0.1, 0.9]]],
    "B": [[[1.0, 0.0]], [[1.0, 1.0]]],
    "C": [[[0.5], [1.0]], [[1.0], [0.0]]],
    "D": [[[0.5, 0.1]], [[1.0, 0.0]]],
}


def test_attributes_are_what_was_given_and_cannot_be_written_to():
    system = CGLSSM(T, **MATRICES, initial_probability=[0.4, 0.6], initial_covariance=[np.eye(2)] * 2)
    assert (system.n_classes, system.dim_x, system.dim_z) == (2, 2, 1)
    for name, value in MATRICES.items():
        np.testing.assert_array_equal(getattr(system, name), value)
        with pytest.raises(ValueError, match="read-only"):
            getattr(system, name)[0, 0, 0] = 1.0
    np.testing.assert_array_equal(system.transition, T)
    np.testing.assert_array_equal(system.initial_probability, [0.4, 0.6])
    np.testing.assert_array_equal(system.initial_covariance, [np.eye(2)] * 2)
    assert copy.deepcopy(system) is system
    assert copy.copy(system) is system
    assert repr(system) == "CGLSSM(n_classes=2, dim_x=2, dim_z=1)"


def test_by_default_regimes_and_state_are_stationary():
    system = CGLSSM(T, **MATRICES)
    np.testing.assert_allclose(system.initial_probability, [0.75, 0.25])
    assert system.starts_stationary
    # the covariances satisfy (18), with the backward kernel by Bayes' rule
    p, G = system.initial_probability, system.initial_covariance
    for j in range(2):
        before = sum(p[i] * T[i][j] / p[j] * G[i] for i in range(2))
        expected = system.A[j] @ before @ system.A[j].T + system.C[j] @ system.C[j].T
        np.testing.assert_allclose(G[j], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"A": [[[1.0]]]}, ShapeError, r"A: got shape \(1, 1, 1\)"),
        ({"B": [[[1.0]], [[1.0]]]}, ShapeError, r"B: got shape \(2, 1, 1\)"),
        ({"C": [[0.5, 1.0], [1.0, 0.0]]}, ShapeError, r"C: got shape \(2, 2\)"),
        ({"D": [[[1.0], [1.0]], [[1.0], [1.0]]]}, ShapeError, r"D: got shape \(2, 2, 1\)"),
        ({"A": [[[np.nan, 0], [0, 1]]] * 2}, ParameterError, r"A: entry \(0, 0, 0\) is nan"),
        ({"A": np.empty((2, 0, 0)), "B": np.empty((2, 1, 0))}, ShapeError, "A: got no components"),
        ({"B": np.empty((2, 0, 2))}, ShapeError, "B: got no components"),
        ({"initial_probability": [0.5, 0.6]}, ParameterError, "initial_probability: sums to 1.1"),
        ({"initial_probability": [1.5, -0.5]}, ParameterError, "initial_probability: got"),
        ({"initial_probability": [1.0]}, ShapeError, "initial_probability: got shape"),
        ({"initial_covariance": [np.eye(2)]}, ShapeError, "initial_covariance: got shape"),
        (
            {"initial_covariance": [np.eye(2), np.diag([1.0, -1.0])]},
            NotPositiveDefiniteError,
            r"initial_covariance\[1\]: .* eigenvalue -1",
        ),
    ],
)
def test_what_is_refused(change, error, message):
    with pytest.raises(error, match=message):
        CGLSSM(T, **(MATRICES | change))


@pytest.mark.parametrize(
    ("transition", "error", "message"),
    [
        ([[0.9, 0.2], [0.3, 0.7]], ParameterError, r"transition\[0\]: sums to 1.1"),
        ([[1.1, -0.1], [0.3, 0.7]], ParameterError, r"transition\[0\]: got"),
        ([[0.9, 0.1]], ShapeError, "transition: got shape"),
        (np.empty((0, 0)), ShapeError, "transition: got shape"),
        (np.eye(2), ParameterError, "initial_probability: has to be given"),
    ],
)
def test_transitions_that_are_refused(transition, error, message):
    with pytest.raises(error, match=message):
        CGLSSM(transition, **MATRICES)


# --------------------------------------------------------------------------- stability


def scalar(A, transition=T, **options):
    K = len(A)
    one = np.ones((K, 1, 1))
    return CGLSSM(transition, np.reshape(A, (K, 1, 1)), one, one, one, **options)


def test_the_spectral_radius_of_one_class_is_the_square_of_that_of_the_matrix():
    A = np.array([[[0.5, 1.0], [-0.3, 0.6]]])
    system = CGLSSM([[1.0]], A, [[[1.0, 0.0]]], [np.eye(2)], [[[1.0]]])
    assert system.spectral_radius == pytest.approx(np.abs(np.linalg.eigvals(A[0])).max() ** 2)


def test_stability_is_that_of_the_mixture_not_of_each_regime():
    # a regime may expand if it does not last: the matrix of two scalars is [[p(i | j) a_j^2]]
    p, a = np.array([0.75, 0.25]), np.array([0.6, 1.1])
    kernel = p[:, None] * np.array(T) / p
    expected = np.abs(np.linalg.eigvals((kernel * a**2).T)).max()
    system = scalar(a)
    assert 0.8 < expected < 1.0 < a[1] ** 2
    assert system.spectral_radius == pytest.approx(expected)


def test_an_unstable_model_needs_an_initial_covariance():
    with pytest.raises(
        NotStableError, match=r"initial_covariance: has to be given .*spectral radius .* is 1.21,"
    ):
        scalar([1.1, 1.1])
    system = scalar([1.1, 1.1], initial_covariance=np.ones((2, 1, 1)))
    with pytest.raises(NotStableError, match="expected less than 1"):
        system.stationary_covariance()


def test_the_default_covariance_of_a_start_that_is_not_stationary_is_that_of_the_long_run():
    plain, other = scalar([0.5, 0.9]), scalar([0.5, 0.9], initial_probability=[0.1, 0.9])
    assert not other.starts_stationary
    np.testing.assert_allclose(other.initial_covariance, plain.initial_covariance, rtol=1e-12)
    assert other.spectral_radius == pytest.approx(plain.spectral_radius)


def test_a_regime_that_does_not_last_has_no_default_covariance():
    passing = [[0.5, 0.5], [0.0, 1.0]]
    with pytest.raises(ParameterError, match="since the regime 0 does not occur in the long run"):
        scalar([0.5, 0.9], passing, initial_probability=[1.0, 0.0])
    system = scalar([0.5, 0.9], passing)  # it does not occur at first either
    np.testing.assert_allclose(system.initial_covariance[1], 1.0 / (1.0 - 0.81))


# --------------------------------------------------------------------------- simulation


def test_simulation_obeys_its_equations():
    # with the noise taken out, states and observations follow from the regimes
    quiet = {name: np.array(value) for name, value in MATRICES.items()}
    quiet["C"], quiet["D"] = quiet["C"] * 0.0, quiet["D"] * 0.0
    system = CGLSSM(T, **quiet, initial_covariance=[np.eye(2)] * 2)
    x, y, r = system.simulate(50, np.random.default_rng(1))
    j = r.astype(int)
    assert set(j) == {0, 1}
    assert np.abs(x[0]).min() > 0.0
    np.testing.assert_allclose(x[1:], np.einsum("nij,nj->ni", system.A[j[1:]], x[:-1]), atol=1e-15)
    np.testing.assert_allclose(y, np.einsum("nij,nj->ni", system.B[j], x), atol=1e-15)


def test_simulation_has_the_moments_of_the_model():
    system = CGLSSM(T, **MATRICES)
    n = 60_000
    x, y, r = system.simulate(n, np.random.default_rng(2))
    assert x.shape == (n, 2)
    assert y.shape == (n, 1)
    assert (r == 0).mean() == pytest.approx(0.75, abs=0.01)
    stays = (r[1:] == 0)[r[:-1] == 0].mean()
    assert stays == pytest.approx(0.9, abs=0.01)
    for j in range(2):
        X = x[r == j]
        np.testing.assert_allclose(X.T @ X / len(X), system.initial_covariance[j], rtol=0.1)
        noise = (y[r == j] - X @ system.B[j].T)[:, 0]
        assert noise.var() == pytest.approx((system.D[j] @ system.D[j].T)[0, 0], rel=0.05)


def test_simulation_starts_as_it_is_told_and_depends_on_the_generator_alone():
    system = CGLSSM(
        T, **MATRICES, initial_probability=[0.0, 1.0], initial_covariance=[np.eye(2), 1e6 * np.eye(2)]
    )
    firsts = [system.simulate(1, np.random.default_rng(seed)) for seed in range(300)]
    assert all(first.r[0] == 1.0 for first in firsts)
    x = np.concatenate([first.x for first in firsts])
    np.testing.assert_allclose(x.T @ x / 300, 1e6 * np.eye(2), atol=2e5)
    a, b = (system.simulate(20, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(a.y, b.y)
    assert system.simulate(0, np.random.default_rng(0)).x.shape == (0, 2)
    with pytest.raises(ParameterError, match="n: got -1"):
        system.simulate(-1, np.random.default_rng(0))

"""Standard errors from the observed information, and what has none."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.estimation.free import read_free
from fuzzykf.estimation.information import observed_information, uncertainty


def of_sample(n, S):
    """Log-likelihood of the covariance of n observations with mean zero and second moments S."""
    free = read_free({"R": "full"}, {"R": S}, covariances=["R"])

    def f(numbers):
        R = free.values(numbers)["R"]
        inverse = np.linalg.inv(R)
        value = -0.5 * n * (np.linalg.slogdet(R)[1] + np.trace(inverse @ S))
        return float(value), free.gradient(numbers, {"R": -0.5 * n * (inverse - inverse @ S @ inverse)})

    return free, f


def test_the_standard_errors_of_a_covariance_are_those_of_the_textbook() -> None:
    # at the maximum R = S: Var(R_ij) = (S_ii S_jj + S_ij^2) / n
    S = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, -0.6], [0.0, -0.6, 1e-6]])
    S[2, :2] *= 1e-3  # components of very different size
    S[:2, 2] *= 1e-3
    free, f = of_sample(150, S)
    found = uncertainty(f, free, free.start)
    i, j = np.tril_indices(3)
    expected = np.sqrt((S[i, i] * S[j, j] + S[i, j] ** 2) / 150)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance)), expected, rtol=1e-5)
    assert found.notes == []


def test_second_derivatives_are_told_where_a_gradient_is_exact() -> None:
    free, f = of_sample(20, np.array([[2.0]]))
    z = free.start + 0.3  # d^2/dz^2 of -10 (z + S exp(-z)) is -10 S exp(-z)
    np.testing.assert_allclose(observed_information(f, z, np.full(1, 1e-3)), [[10 * np.exp(-0.3)]], rtol=1e-6)


#: Curvatures by two log-variances, and the notes that come of it.
NOTES = [
    (np.array([[100.0, 0.0], [0.0, 50.0]]), []),
    (
        np.array([[100.0, 0.0], [0.0, 0.0]]),
        ["R[1, 1]: weakly identified, the log-likelihood does not change along it"],
    ),
    (
        np.array([[50.0, 50.0], [50.0, 50.0]]),
        [
            "R[0, 0], R[1, 1]: weakly identified, the log-likelihood does not change along them together",
        ],
    ),
    (
        np.array([[100.0, 0.0], [0.0, 0.04]]),
        ["R[1, 1]: weakly identified, a large change of it costs 0.045 in log-likelihood only"],
    ),
]


@pytest.mark.parametrize(("curvature", "notes"), NOTES)
def test_what_is_weakly_identified_is_named(curvature, notes) -> None:
    free = read_free({"R": "diagonal"}, {"R": np.eye(2)}, covariances=["R"])

    def f(z):
        return -0.5 * float(z @ curvature @ z), -curvature @ z

    found = uncertainty(f, free, free.start)
    assert found.notes == notes
    is_flat = np.linalg.eigvalsh(curvature)[0] < 1e-9
    known = ~np.isnan(np.diagonal(found.covariance))
    assert known.all() == (not is_flat)
    if not is_flat:
        np.testing.assert_allclose(found.covariance, np.linalg.inv(curvature), rtol=1e-6, atol=1e-9)


def test_a_variance_at_its_bound_has_no_standard_error_and_takes_none_from_others() -> None:
    free = read_free({"R": "diagonal"}, {"R": np.eye(2)}, covariances=["R"])

    def f(z):
        return -2.0 * float(z[1] ** 2), np.array([0.0, -4.0 * z[1]])

    found = uncertainty(f, free, np.array([-np.inf, 0.0]))
    np.testing.assert_allclose(found.covariance, [[np.nan, np.nan], [np.nan, 0.25]], rtol=1e-6)
    assert found.notes == []


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_beside_an_edge_differences_are_of_one_side(side) -> None:
    def f(z):
        inside = side * z[0] <= 0.0
        return (-0.5 * float(z @ z), -z) if inside else (np.nan, np.full(2, np.nan))

    np.testing.assert_allclose(observed_information(f, np.zeros(2), np.full(2, 1e-3)), np.eye(2), rtol=1e-9)


def test_without_a_log_likelihood_around_there_are_no_standard_errors() -> None:
    free = read_free({"R": "diagonal"}, {"R": np.eye(2)}, covariances=["R"])

    def f(z):
        return (0.0, np.zeros(2)) if not z.any() else (-np.inf, np.full(2, np.nan))

    found = uncertainty(f, free, free.start)
    assert np.isnan(found.covariance).all()
    assert found.notes == ["no standard errors: beside the maximum there is no log-likelihood"]


def test_beside_a_singular_covariance_errors_are_those_among_singular_ones() -> None:
    free = read_free({"R": "full"}, {"R": np.eye(2)}, covariances=["R"])

    def f(z):  # R = L L' with L_11 = exp(z0 / 2), L_21 = z1: known to 1/4 and 1/2
        return -8.0 * float(z[0] ** 2) - 2.0 * float((z[1] - 3.0) ** 2), np.array(
            [-16 * z[0], -4 * z[1] + 12, 0]
        )

    found = uncertainty(f, free, np.array([0.0, 3.0, -np.inf]))
    errors = np.sqrt(np.diagonal(found.covariance))
    np.testing.assert_allclose(errors, [0.25, np.hypot(0.5, 3.0 * 0.125), 3.0], rtol=1e-6)


def test_covariances_beside_a_variance_of_zero_have_no_standard_error() -> None:
    free = read_free({"R": "full"}, {"R": np.eye(2)}, covariances=["R"])

    def f(z):
        return -2.0 * float(z[1:] @ z[1:]), np.array([0.0, -4.0 * z[1], -4.0 * z[2]])

    found = uncertainty(f, free, np.array([-np.inf, 0.0, 0.0]))
    np.testing.assert_allclose(np.diagonal(found.covariance), [np.nan, np.nan, 0.25], rtol=1e-6)

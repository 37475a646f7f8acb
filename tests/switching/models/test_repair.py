"""The repair of indefinite noise: what it changes, and how little."""

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw
from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.switching import shrink_covariances

LAW = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
MEANS = np.zeros((2, 2))
TRANSITION = [[0.9, 0.1], [0.2, 0.8]]


def covariances(a):
    """One covariance for all pairs; the noise is indefinite if Cov(X2, X1) = a is too large."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.2 * z], [0.2 * z, z]])
    pair[0, 2] = pair[2, 0] = a
    return np.broadcast_to(pair, (2, 2, 4, 4)).copy()


@pytest.mark.parametrize("switch", [LAW, TRANSITION])
def test_valid_covariances_are_returned_as_they_are(switch):
    given = covariances(0.3)
    repair = shrink_covariances(switch, MEANS, given, 1)
    assert repair.factor == 1.0
    np.testing.assert_array_equal(repair.covariances, given)


@pytest.mark.parametrize("switch", [LAW, TRANSITION])
def test_the_factor_is_the_largest_admissible_one(switch):
    # one covariance for all pairs: the bound is |partial correlation| = 1, in closed form
    given = covariances(0.99)
    repair = shrink_covariances(switch, MEANS, given, 1)
    d = 0.2 * 0.5  # the projected Cov(Y2, X1)
    Syy = np.array([[1.0, 0.2], [0.2, 1.0]])
    to_x2, to_x1 = np.array([0.1, 0.5]), np.array([0.5, d])
    a0 = to_x2 @ np.linalg.solve(Syy, to_x1)
    left1 = 1.0 - to_x1 @ np.linalg.solve(Syy, to_x1)
    left2 = 1.0 - to_x2 @ np.linalg.solve(Syy, to_x2)
    largest = (np.sqrt(left1 * left2)) / (0.99 - a0)
    assert repair.factor == pytest.approx(largest, abs=1e-6)
    assert repair.covariances[0, 0, 2, 0] == pytest.approx(a0 + repair.factor * (0.99 - a0), rel=1e-12)


def test_the_repaired_covariances_make_a_model_and_differ_in_one_block_only():
    given = covariances(0.99)
    with pytest.raises(NotPositiveDefiniteError):
        CGOFMSModel(LAW, MEANS, given, 1)
    repair = shrink_covariances(LAW, MEANS, given, 1)
    CGOFMSModel(LAW, MEANS, repair.covariances, 1)
    CGOMSModel(TRANSITION, MEANS, repair.covariances, 1)
    changed = repair.covariances != given
    changed[..., [0, 2], [2, 0]] = False
    assert not changed.any()


def test_shrinking_to_zero_could_fail_where_this_repair_succeeds():
    # X1 and X2 strongly tied to Y: a = 0 contradicts the ties, a0 follows them
    z = np.array([[1.0, 0.95], [0.95, 1.0]])
    pair = np.block([[z, 0.9 * z], [0.9 * z, z]])
    given = np.broadcast_to(pair, (2, 2, 4, 4)).copy()
    given[..., [0, 2], [2, 0]] = 0.0
    with pytest.raises(NotPositiveDefiniteError):
        CGOMSModel(TRANSITION, MEANS, given, 1)
    repair = shrink_covariances(TRANSITION, MEANS, given, 1)
    assert 0.0 < repair.factor < 1.0
    CGOMSModel(TRANSITION, MEANS, repair.covariances, 1)


def test_what_no_shrinking_can_mend_is_refused():
    given = covariances(0.3)
    given[..., [1, 3], [3, 1]] = 1.2  # Cov(Y1, Y2) beyond the variances
    with pytest.raises(NotPositiveDefiniteError, match="eigenvalue"):
        shrink_covariances(LAW, MEANS, given, 1)


def test_observations_without_spread_are_named():
    pair = np.eye(4)
    pair[[1, 3, 1, 3], [1, 3, 3, 1]] = 1.0  # Y_2 is Y_1
    with pytest.raises(NotPositiveDefiniteError, match=r"covariances: Cov\(Y_1, Y_2\) of the pair \(0, 0\)"):
        shrink_covariances([[1.0]], np.zeros((1, 2)), pair[None, None], 1)

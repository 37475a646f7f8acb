"""Cut, joined and sampled memberships, and the pictures."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    GaussianMembership,
    IntervalMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.possibility.memberships import JointMembership, sampled
from fuzzykf.possibility.norms import HAMACHER, LUKASIEWICZ, MIN, PRODUCT


def test_cut_by_level_keeps_the_values_inside():
    # the noise of section 5 of the paper: a Cauchy membership cut at its scale
    cut = CauchyMembership(0.0, 15.0).cut(0.5)
    x = np.array([-15.0, -3.0, 0.0, 15.0, 15.01])
    np.testing.assert_allclose(cut(x), [0.5, 1 / 1.04, 1.0, 0.5, 0.0])
    np.testing.assert_allclose([cut.lower, cut.upper], [[-15.0], [15.0]])
    assert cut.is_bounded
    np.testing.assert_allclose(cut.support(0.8), CauchyMembership(0.0, 15.0).support(0.8))
    np.testing.assert_allclose(cut.reach(np.array([0.1, 0.8]))[1], [[15.0], [7.5]])


def test_cut_by_bounds():
    cut = GaussianMembership(0.0, 1.0).cut((-1.0, 2.0))
    np.testing.assert_allclose(cut([-1.5, -1.0, 2.0, 2.5]), [0.0, np.exp(-0.5), np.exp(-2.0), 0.0])
    plane = GaussianMembership([0.0, 0.0], np.eye(2)).cut([(-1.0, 1.0), (-2.0, 2.0)])
    np.testing.assert_allclose(plane.upper, [1.0, 2.0])
    assert plane([1.5, 0.0]) == 0.0
    # the plateau of an interval may be cut anywhere
    assert IntervalMembership(-3.0, 3.0).cut((1.0, 5.0)).upper[0] == 3.0


def test_cut_ellipse_is_not_its_box():
    cut = GaussianMembership([0.0, 0.0], np.eye(2)).cut(np.exp(-0.5))
    assert cut([0.9, 0.0]) > 0.0
    assert cut([0.9, 0.9]) == 0.0
    np.testing.assert_allclose(cut.project([1]).support(), [[-1.0], [1.0]])


def test_projection_of_a_box_cut_of_a_correlated_shape():
    # the likeliest x1 for x0 = 1 lies outside the box, so that the block of the matrix would be wrong
    base = GaussianMembership([0.0, 0.0], [[1.0, 0.9], [0.9, 1.0]])
    cut = base.cut([(-2.0, 2.0), (-0.5, 0.5)])
    expected = base([1.0, 0.5])
    assert cut.project([0])(1.0) == pytest.approx(expected, abs=2e-3)
    assert base.project([0])(1.0) > expected + 0.05


@pytest.mark.parametrize("norm", [PRODUCT, MIN, LUKASIEWICZ, HAMACHER], ids=lambda n: n.name)
def test_costs_of_a_cut(norm):
    cut = CauchyMembership(0.0, 1.0).cut(0.5)
    x = np.array([[0.0], [0.5], [2.0]])
    np.testing.assert_allclose(norm.membership(cut.cost(x, norm)), [1.0, 0.8, 0.0])
    np.testing.assert_allclose(cut.negative_log(x), [0.0, np.log(1.25), np.inf])


def test_bad_cuts():
    with pytest.raises(ParameterError, match=r"level: got 0.0, expected a number in \]0, 1\]"):
        CauchyMembership(0.0, 1.0).cut(0.0)
    with pytest.raises(ParameterError, match=r"level: got 1\.5"):
        CauchyMembership(0.0, 1.0).alpha_cut(1.5)
    with pytest.raises(ParameterError, match=r"cuts off the peak at \[0.0\]"):
        CauchyMembership(0.0, 1.0).cut((1.0, 2.0))
    with pytest.raises(ShapeError, match="one pair"):
        CauchyMembership([0.0, 0.0], 1.0).cut((-1.0, 1.0))


@pytest.mark.parametrize("norm", [PRODUCT, MIN, LUKASIEWICZ, HAMACHER], ids=lambda n: n.name)
def test_joint_membership(norm):
    parts = [GaussianMembership(0.0, 1.0), TriangularMembership(-1.0, 0.0, 1.0)]
    joint = JointMembership(parts, norm)
    points = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    expected = norm(parts[0](points[:, 0]), parts[1](points[:, 1]))
    np.testing.assert_allclose(joint(points), expected)
    for other in (PRODUCT, norm):
        value = other.membership(joint.cost(points, other))
        np.testing.assert_allclose(value, expected, atol=1e-14)
    assert joint.project([1])([0.3]) == pytest.approx(0.7)
    np.testing.assert_allclose(joint.support(0.5)[1][1], 0.5)
    np.testing.assert_allclose(joint.reach(np.array([0.5]))[1][0, 1], 0.5)


def test_joint_membership_of_vectors_is_refused():
    with pytest.raises(ShapeError, match="number 0 has 2 dimensions, expected 1"):
        JointMembership([SingletonMembership([0.0, 0.0])], PRODUCT)


def test_sampled():
    grid = sampled(TriangularMembership(-1.0, 0.0, 2.0))
    x = np.linspace(-1.5, 2.5, 101)
    np.testing.assert_allclose(grid(x), TriangularMembership(-1.0, 0.0, 2.0)(x), atol=1e-6)

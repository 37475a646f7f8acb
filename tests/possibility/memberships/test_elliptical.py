"""Gaussian, Cauchy and parabolic memberships in one and more dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CauchyMembership, GaussianMembership, ParabolicMembership
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.possibility.norms import HAMACHER, LUKASIEWICZ, MIN, PRODUCT

MATRIX = np.array([[2.0, 0.6], [0.6, 0.5]])
CENTER = np.array([1.0, -2.0])
SHAPES = {
    GaussianMembership: lambda q: np.exp(-q / 2),
    CauchyMembership: lambda q: 1 / (1 + q),
    ParabolicMembership: lambda q: np.maximum(0, 1 - q),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_definition(kind):
    # each is its function of the quadratic form, computed here with a plain inverse
    points = CENTER + np.random.default_rng(0).normal(size=(50, 2))
    r = points - CENTER
    q = np.einsum("ni,ij,nj->n", r, np.linalg.inv(MATRIX), r)
    np.testing.assert_allclose(kind(CENTER, MATRIX)(points), SHAPES[kind](q), rtol=1e-12, atol=1e-14)
    assert kind(CENTER, MATRIX)(CENTER) == 1.0


@pytest.mark.parametrize("kind", SHAPES)
def test_scalar_membership_takes_numbers_and_arrays(kind):
    membership = kind(0.0, 4.0)
    scale2 = 4.0 if kind is GaussianMembership else 16.0
    value = SHAPES[kind](1.0 / scale2)
    assert isinstance(membership(1.0), float)
    assert membership(1.0) == pytest.approx(value)
    assert membership([0.0, 1.0, 1.0]).shape == (3,)
    assert membership([[0.0], [1.0]]).shape == (2,)
    assert membership([[0.0, 1.0], [2.0, 3.0]]).shape == (2, 2)


def test_scale_as_number_vector_and_matrix():
    # a number and a vector are lengths, a matrix is in squared units
    by_number = CauchyMembership([0.0, 0.0], 2.0)
    by_vector = CauchyMembership([0.0, 0.0], [2.0, 2.0])
    by_matrix = CauchyMembership([0.0, 0.0], 4.0 * np.eye(2))
    point = [1.0, 3.0]
    assert by_number(point) == by_vector(point) == by_matrix(point) == pytest.approx(1 / 3.5)
    assert CauchyMembership(0.0, 15.0).scale == pytest.approx(15.0)


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("level", [0.9, 0.5, 0.01])
def test_support_is_where_the_level_is_reached(kind, level):
    membership = kind(CENTER, MATRIX)
    lower, upper = membership.support(level)
    angle = np.linspace(0, 2 * np.pi, 20001)
    root = np.linalg.cholesky(MATRIX)
    # walk along the level line: the bounding box is that of the ellipse
    q = {GaussianMembership: -2 * np.log(level), CauchyMembership: 1 / level - 1}.get(kind, 1 - level)
    line = CENTER + np.sqrt(q) * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ root.T
    np.testing.assert_allclose(membership(line), level, atol=1e-12)
    np.testing.assert_allclose(line.min(axis=0), lower, atol=1e-6)
    np.testing.assert_allclose(line.max(axis=0), upper, atol=1e-6)
    cut = membership.alpha_cut(level)
    np.testing.assert_allclose(np.stack([cut.lower, cut.upper]), [lower, upper])
    many = membership.reach(np.array([level, 1.0]))
    np.testing.assert_allclose(many[0], [lower, CENTER])
    np.testing.assert_allclose(many[1], [upper, CENTER])


def test_unbounded_supports():
    for kind in (GaussianMembership, CauchyMembership):
        assert not kind(0.0, 1.0).is_bounded
        np.testing.assert_array_equal(kind(0.0, 1.0).support(), [[-np.inf], [np.inf]])
    assert ParabolicMembership(0.0, 2.0).is_bounded
    np.testing.assert_allclose(ParabolicMembership(0.0, 2.0).support(), [[-2.0], [2.0]])


@pytest.mark.parametrize("kind", SHAPES)
def test_projection_is_the_supremum_over_the_other_component(kind):
    membership = kind(CENTER, MATRIX)
    x = np.linspace(-3, 5, 41)
    y = np.linspace(-8, 4, 4001)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    np.testing.assert_allclose(membership.project([0])(x), membership(points).max(axis=1), atol=1e-5)


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("norm", [PRODUCT, MIN, LUKASIEWICZ, HAMACHER], ids=lambda n: n.name)
def test_costs_are_the_memberships_in_another_scale(kind, norm):
    membership = kind(CENTER, MATRIX)
    points = CENTER + 2.0 * np.random.default_rng(1).normal(size=(50, 2))
    value = norm.membership(membership.cost(points, norm))
    np.testing.assert_allclose(value, membership(points), rtol=1e-10, atol=1e-15)


def test_costs_do_not_underflow():
    # 200 standard deviations away the membership is zero as a float, the cost is not infinite
    far = np.array([[200.0]])
    assert GaussianMembership(0.0, 1.0)(200.0) == 0.0
    assert GaussianMembership(0.0, 1.0).cost(far, PRODUCT)[0] == pytest.approx(20000.0)


def test_singular_matrix_means_known_directions():
    # no spread along (1, -1): off that line nothing is possible
    membership = GaussianMembership([0.0, 0.0], [[1.0, 1.0], [1.0, 1.0]])
    assert membership([1.0, 1.0]) == pytest.approx(np.exp(-0.5))
    assert membership([1.0, 0.9]) == 0.0
    np.testing.assert_allclose(membership.support(np.exp(-0.5)), [[-1.0, -1.0], [1.0, 1.0]])
    assert GaussianMembership(3.0, 0.0)(3.0) == 1.0
    assert GaussianMembership(3.0, 0.0)(3.1) == 0.0


def test_units_of_components_do_not_matter():
    # variances sixteen orders apart are not a singular matrix
    membership = GaussianMembership([0.0, 0.0], np.diag([1e-8, 1e8]))
    assert membership([1e-4, 0.0]) == pytest.approx(np.exp(-0.5))
    assert membership([0.0, 1e4]) == pytest.approx(np.exp(-0.5))


@pytest.mark.parametrize("kind", [CauchyMembership, ParabolicMembership])
def test_bad_scales(kind):
    with pytest.raises(ParameterError, match=r"scale: got -1.0, expected numbers from 0 to 1e\+154"):
        kind(0.0, -1.0)
    with pytest.raises(ParameterError, match="scale"):
        kind(0.0, np.nan)
    with pytest.raises(ShapeError, match=r"scale: got shape \(3,\), expected \(\), \(2,\) or \(2, 2\)"):
        kind([0.0, 0.0], [1.0, 1.0, 1.0])
    with pytest.raises(NotPositiveDefiniteError, match="scale"):
        kind([0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(ShapeError, match="scale: expected an array of numbers"):
        kind(0.0, "wide")


def test_bad_gaussians():
    with pytest.raises(NotPositiveDefiniteError, match="covariance"):
        GaussianMembership(0.0, -1.0)
    with pytest.raises(ParameterError, match=r"mean: entry .* is nan"):
        GaussianMembership(np.nan, 1.0)
    with pytest.raises(ShapeError, match=r"covariance: got shape \(1, 1\), expected \(2, 2\)"):
        GaussianMembership([0.0, 0.0], 1.0)
    with pytest.raises(ShapeError, match="mean: expected an array of numbers"):
        GaussianMembership("here", 1.0)
    with pytest.raises(ShapeError, match=r"x: got shape \(3,\), expected \(..., 2\)"):
        GaussianMembership([0.0, 0.0], np.eye(2))([1.0, 2.0, 3.0])


@pytest.mark.parametrize("center", [3.0, -3.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_rounding_off_the_range_counts_on_either_side_of_zero(center, side):
    # the matrix has no spread along the second axis: what is off by rounding is on it, the rest is not
    membership = GaussianMembership([1.0, center], np.diag([1.0, 0.0]))
    assert membership([1.0, center * (1.0 + side * 1e-15)]) == pytest.approx(1.0)
    assert membership([1.0, center + side * 1e-3]) == 0.0

"""The two constructions of a fuzzy dynamic model run, and agree."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import GaussianMembership, SingletonMembership, TriangularMembership
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.possibility.relations import (
    Rule,
    RuleBase,
    cartesian_product,
    compose,
    extend,
    fuzzify,
    intersection,
    union,
)

X = np.arange(-4.0, 5.0)
W = np.arange(-1.0, 2.0)
NEXT = np.arange(-9.0, 10.0)


def folded(x, w):
    """A dynamics that is not injective: |x| and a drift."""
    return np.abs(x) - 2.0 + w


@pytest.mark.parametrize("t_norm", ["product", "min", "lukasiewicz", "hamacher"])
def test_rule_base_and_extension_principle_agree(t_norm):
    # with singletons around all elements both are the same supremum (section 2.1 of the paper)
    state, noise = TriangularMembership(-3.5, 1.0, 4.5)(X), np.array([0.3, 1.0, 0.6])
    base = RuleBase.from_function(folded, X, W, t_norm=t_norm)
    by_rules = base.predict([state, noise], [X, W, NEXT])
    joint = cartesian_product(state, noise, t_norm=t_norm)
    by_extension = extend(joint, folded(X[:, None], W), NEXT)
    np.testing.assert_allclose(by_rules, by_extension, atol=1e-15)
    assert by_rules.max() == 1.0


def test_rule_base_with_an_input():
    # x' = x + u + w with a known input: a singleton set of u shifts the result
    u = np.array([0.0, 2.0])
    base = RuleBase.from_function(lambda x, u, w: x + u + w, X, u, W)
    state, noise = GaussianMembership(0.0, 1.0)(X), np.array([0.5, 1.0, 0.5])
    still = base.predict([state, [1.0, 0.0], noise], [X, u, W, NEXT])
    moved = base.predict([state, [0.0, 1.0], noise], [X, u, W, NEXT])
    np.testing.assert_allclose(moved[2:], still[:-2], atol=1e-15)


def test_gaussian_rules_blur_and_never_lose():
    # fuzzification of antecedents and consequents can only raise memberships
    state, noise = TriangularMembership(-3.0, 0.0, 3.0)(X), np.array([0.3, 1.0, 0.3])

    def blurred(point):
        return fuzzify(point, "gaussian", 0.25)

    crisp = RuleBase.from_function(folded, X, W).predict([state, noise], [X, W, NEXT])
    fuzzy = RuleBase.from_function(folded, X, W, antecedent=blurred, consequent=blurred)
    soft = fuzzy.predict([state, noise], [X, W, NEXT])
    assert (soft >= crisp - 1e-15).all()
    assert (soft > crisp + 1e-3).any()


def test_composition_by_hand():
    relation = np.array([[0.2, 0.9, 0.0], [1.0, 0.1, 0.5]])
    np.testing.assert_allclose(compose([1.0, 0.5], relation), [0.5, 0.9, 0.25])
    np.testing.assert_allclose(compose([1.0, 0.5], relation, t_norm="min"), [0.5, 0.9, 0.5])
    np.testing.assert_allclose(
        compose([1.0, 0.5], relation, t_conorm="probabilistic_sum"),
        [1 - 0.8 * 0.5, 1 - 0.1 * 0.95, 0.25],
    )


def test_composition_with_a_relation_on_two_universes():
    rng = np.random.default_rng(0)
    joint, relation = rng.random((3, 4)), rng.random((3, 4, 5))
    expected = (joint[:, :, None] * relation).max(axis=(0, 1))
    np.testing.assert_allclose(compose(joint, relation), expected)


def test_extension_joins_all_preimages():
    # x -> x^2 on {-2..2}: 1 and 4 have two pre-images each, 3 has none
    mu = np.array([0.1, 0.4, 1.0, 0.6, 0.2])
    images = np.arange(-2.0, 3.0) ** 2
    np.testing.assert_allclose(extend(mu, images, [0.0, 1.0, 3.0, 4.0]), [1.0, 0.6, 0.0, 0.2])
    summed = extend(mu, images, [0.0, 1.0, 3.0, 4.0], t_conorm="bounded_sum")
    np.testing.assert_allclose(summed, [1.0, 1.0, 0.0, 0.3])


def test_extension_into_a_plane():
    universe = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    images = [[1.0, 1.0], [0.0, 0.0], [1.0, 1.0]]
    np.testing.assert_allclose(extend([0.5, 0.7, 1.0], images, universe), [0.7, 0.0, 1.0])


def test_images_outside_the_universe_are_refused():
    with pytest.raises(ParameterError, match=r"\[2.5\] has membership 1 but is not in the universe"):
        extend([1.0, 0.5], [2.5, 0.0], [0.0, 1.0, 2.0])
    # an impossible element does not matter, and the nearest one can be asked for
    np.testing.assert_allclose(extend([0.0, 0.5], [2.5, 0.0], [0.0, 1.0, 2.0]), [0.5, 0.0, 0.0])
    np.testing.assert_allclose(extend([1.0, 0.5], [1.9, 0.0], [0.0, 1.0, 2.0], nearest=True), [0.5, 0.0, 1.0])


def test_nearest_cells_leave_holes():
    # why the estimator does not scatter cells: a stretched set misses every other cell
    x = np.arange(-10.0, 11.0)
    scattered = extend(np.ones(21), 1.5 * x, np.arange(-15.0, 16.0), nearest=True)
    assert (scattered == 0.0).mean() > 0.3


def test_union_and_intersection():
    np.testing.assert_allclose(union([0.2, 0.9], [0.5, 0.1], t_conorm="bounded_sum"), [0.7, 1.0])
    np.testing.assert_allclose(intersection([0.2, 0.9], [0.5, 0.1], t_norm="product"), [0.1, 0.09])


def test_fuzzify():
    assert isinstance(fuzzify([1.0, 2.0]), SingletonMembership)
    # (20) is printed with a positive exponent, which would grow without bound
    assert fuzzify(0.0, "gaussian", 4.0)(2.0) == pytest.approx(np.exp(-0.5))
    for kind, covariance in (("gaussian", None), ("singleton", 1.0), ("round", None)):
        with pytest.raises(ParameterError, match="expected 'singleton' without one or 'gaussian' with one"):
            fuzzify(0.0, kind, covariance)


def test_wrong_shapes_are_refused():
    with pytest.raises(ShapeError, match=r"relation: got shape \(3, 2\), expected \(2, ...\)"):
        compose([1.0, 0.5], np.ones((3, 2)))
    with pytest.raises(ShapeError, match="images: got shape"):
        extend([1.0, 0.5], [1.0], [0.0, 1.0])
    with pytest.raises(ShapeError, match="universes: got 1, expected 2"):
        Rule((fuzzify(0.0),), fuzzify(0.0)).relation([X])
    with pytest.raises(ParameterError, match="rules: got none"):
        RuleBase(()).relation([X, X])

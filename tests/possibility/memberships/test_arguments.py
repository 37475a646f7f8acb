"""Every membership refuses levels and components that make no sense, by name."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.possibility.memberships import (
    CauchyMembership,
    FunctionMembership,
    GaussianMembership,
    GridMembership,
    IntervalMembership,
    JointMembership,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.possibility.norms import PRODUCT

GAUSSIAN = GaussianMembership([0.0, 1.0, 2.0], np.eye(3))
MEMBERSHIPS = {
    "gaussian": GAUSSIAN,
    "cauchy": CauchyMembership([0.0, 0.0, 0.0], 1.0),
    "parabolic": ParabolicMembership([0.0, 0.0, 0.0], 1.0),
    "triangular": TriangularMembership([-1.0] * 3, [0.0] * 3, [1.0] * 3),
    "interval": IntervalMembership([-1.0] * 3, [1.0] * 3),
    "singleton": SingletonMembership([0.0, 1.0, 2.0]),
    "grid": GridMembership([[0.0, 1.0]] * 3, np.ones((2, 2, 2))),
    "joint": JointMembership([GaussianMembership(0.0, 1.0)] * 3, PRODUCT),
    "function": FunctionMembership(lambda x: np.exp(-(x**2).sum(axis=-1)), [(-1.0, 1.0)] * 3),
    "cut": GAUSSIAN.cut(0.5),
    "box": GAUSSIAN.cut([(-1.0, 3.0)] * 3),
}
each = pytest.mark.parametrize("name", MEMBERSHIPS)


@each
@pytest.mark.parametrize("level", [-0.1, 1.1, 2.0, np.nan, np.inf, "half", None, [0.1, 0.2]])
def test_levels_lie_between_zero_and_one(name, level):
    with pytest.raises(ParameterError, match=r"level: got .*, expected a number in \[0, 1\]"):
        MEMBERSHIPS[name].support(level)
    with pytest.raises(ParameterError, match=r"level: got .*, expected a number in \]0, 1\]"):
        MEMBERSHIPS[name].alpha_cut(level)


@each
def test_levels_at_the_bounds_are_good(name):
    membership = MEMBERSHIPS[name]
    wide, narrow = membership.support(0), membership.support(1.0)
    assert (wide[0] <= narrow[0]).all()
    assert (wide[1] >= narrow[1]).all()
    np.testing.assert_array_equal(membership.support(), wide)


@each
@pytest.mark.parametrize(
    "components", [[], [3], [-1], [0, 0], [1, 0], [0, 1, 2, 3], [0.5], [True], ["x"], 0, None, [10**30]]
)
def test_components_are_there_and_in_order(name, components):
    with pytest.raises(
        ParameterError, match=r"components: got .*, expected some of 0 to 2, in increasing order"
    ):
        MEMBERSHIPS[name].project(components)


@each
@pytest.mark.parametrize("components", [[1], (0, 2), range(3), np.array([1, 2])])
def test_components_may_be_any_sequence(name, components):
    membership = MEMBERSHIPS[name]
    projected = membership.project(components)
    assert projected.dim == len(components)
    np.testing.assert_allclose(projected.peak, membership.peak[list(components)], atol=1e-3)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: JointMembership([], PRODUCT), ShapeError, "components: got none"),
        (lambda: JointMembership([3.0], PRODUCT), ParameterError, "components: number 0 is 3.0"),
        (lambda: FunctionMembership(3, (0.0, 1.0)), ParameterError, "function: got int, expected a function"),
        (
            lambda: FunctionMembership(abs, "all"),
            ShapeError,
            "support: expected an array of numbers",
        ),
        (lambda: FunctionMembership(abs, [(0.0, 1.0), (2.0,)]), ShapeError, "support: expected an array"),
        (lambda: GAUSSIAN.cut("half"), ParameterError, "level: got 'half'"),
        (lambda: GAUSSIAN.cut([(0.0, 1.0), (2.0,)]), ShapeError, "bounds: expected an array of numbers"),
        (lambda: GridMembership([0.0, 1.0], ["a", "b"]), ShapeError, "values: expected an array of numbers"),
    ],
)
def test_what_makes_no_membership_is_named(make, error, message):
    with pytest.raises(error, match=message):
        make()

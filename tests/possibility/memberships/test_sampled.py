"""Memberships on a grid and from Python functions; those that never reach 1 are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from fuzzykf import FunctionMembership, GridMembership
from fuzzykf.errors import ParameterError, ShapeError


def test_grid_is_linear_between_nodes():
    # oracle: scipy's interpolator
    rng = np.random.default_rng(0)
    axes = (np.sort(rng.random(6)), np.sort(rng.random(5)), np.sort(rng.random(4)))
    values = rng.random((6, 5, 4))
    values /= values.max()
    points = rng.random((200, 3)) * 1.2 - 0.1
    expected = RegularGridInterpolator(axes, values, bounds_error=False, fill_value=0.0)(points)
    np.testing.assert_allclose(GridMembership(axes, values)(points), expected, atol=1e-14)


def test_one_axis_in_every_form():
    for axes in ([0.0, 1.0, 3.0], np.array([0.0, 1.0, 3.0]), ([0.0, 1.0, 3.0],), [[0.0, 1.0, 3.0]]):
        membership = GridMembership(axes, [0.0, 1.0, 0.0])
        np.testing.assert_allclose(membership([0.5, 2.0, 4.0]), [0.5, 0.5, 0.0])


def test_grid_with_a_known_component():
    membership = GridMembership([[0.0, 1.0], [5.0]], [[0.5], [1.0]])
    assert membership([1.0, 5.0]) == 1.0
    assert membership([1.0, 5.1]) == 0.0


def test_grid_support_cuts_the_edges():
    membership = GridMembership([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.5, 0.0])
    np.testing.assert_allclose(membership.support(0.25), [[0.25], [2.5]])
    np.testing.assert_allclose(membership.support(), [[0.0], [3.0]])
    np.testing.assert_allclose(membership.peak, [1.0])


def test_grid_projection():
    membership = GridMembership([[0.0, 1.0], [0.0, 1.0]], [[0.2, 0.7], [1.0, 0.1]])
    np.testing.assert_allclose(membership.project([1]).values, [1.0, 0.7])


def test_normalise_divides_by_the_peak():
    membership = GridMembership([0.0, 1.0], [2.0, 4.0], normalise=True)
    np.testing.assert_allclose(membership.values, [0.5, 1.0])
    halved = FunctionMembership(lambda x: 0.5 * np.exp(-(x**2)), (-3.0, 3.0), normalise=True)
    assert halved(0.0) == pytest.approx(1.0)
    assert halved(1.0) == pytest.approx(np.exp(-1.0))


def test_memberships_that_never_reach_one_are_refused():
    with pytest.raises(ParameterError, match=r"never reach 1, the largest is 0.9"):
        GridMembership([0.0, 1.0], [0.5, 0.9])
    with pytest.raises(
        ParameterError, match=r"never reaches 1 on its support, the largest value found is 0.5"
    ):
        FunctionMembership(lambda x: 0.5 + 0.0 * x, (0.0, 1.0))
    with pytest.raises(ParameterError, match="exceed 1, the largest is 2"):
        GridMembership([0.0, 1.0], [0.5, 2.0])
    with pytest.raises(ParameterError, match="expected at most 1"):
        FunctionMembership(lambda x: 2.0 + 0.0 * x, (0.0, 1.0))


def test_function_forms():
    elementwise = FunctionMembership(lambda x: np.exp(-abs(x)), (-5.0, 5.0))
    by_points = FunctionMembership(lambda x: np.exp(-abs(x[:, 0])), [(-5.0, 5.0)])
    x = np.linspace(-6, 6, 25)
    expected = np.where(abs(x) <= 5, np.exp(-abs(x)), 0.0)
    np.testing.assert_allclose(elementwise(x), expected)
    np.testing.assert_allclose(by_points(x), expected)


def test_function_peak_is_found_between_nodes():
    peak = np.array([0.123456, -1.234567])
    membership = FunctionMembership(
        lambda x: np.exp(-40 * ((x - peak) ** 2).sum(axis=1)), [(-2.0, 2.0), (-2.0, 2.0)]
    )
    np.testing.assert_allclose(membership.peak, peak, atol=1e-6)
    assert membership.project([1])(peak[1]) == pytest.approx(1.0, abs=1e-4)


def test_functions_of_a_single_number():
    # they know nothing of arrays
    for function in (lambda x: max(0.0, 1.0 - abs(x)), lambda x: 1.0 - x if x > 0.0 else 1.0 + x):
        membership = FunctionMembership(function, (-1.0, 1.0))
        np.testing.assert_allclose(membership([-2.0, -0.25, 0.0, 0.5]), [0.0, 0.75, 1.0, 0.5])
    decay = FunctionMembership(lambda x: math.exp(-abs(x)), (-5.0, 5.0))
    assert decay(2.0) == pytest.approx(math.exp(-2.0))


def test_level_sets_of_functions():
    membership = FunctionMembership(lambda x: np.exp(-abs(x - 1.0)), (-4.0, 6.0))
    cut = membership.alpha_cut(0.5)
    np.testing.assert_allclose([cut.lower, cut.upper], [[1.0 - np.log(2.0)], [1.0 + np.log(2.0)]], rtol=1e-12)
    np.testing.assert_allclose(membership.cut(0.5)([0.3, 0.31, 1.69, 1.7]) > 0.0, [False, True, True, False])
    np.testing.assert_allclose(membership.alpha_cut(1.0).peak, [1.0], atol=1e-5)
    assert membership.support(1e-9) == membership.support() == (membership.lower, membership.upper)
    # two humps: the box around both
    humps = FunctionMembership(lambda x: np.maximum(0.0, 1.0 - abs(abs(x) - 2.0)), (-4.0, 4.0))
    np.testing.assert_allclose(humps.support(0.75), [[-2.25], [2.25]], rtol=1e-12)
    # in the plane, the nodes just outside
    disc = FunctionMembership(lambda x: np.exp(-(x**2).sum(axis=1)), [(-3.0, 3.0), (-3.0, 3.0)])
    half = np.sqrt(np.log(2.0))
    for low, high in zip(*disc.support(0.5), strict=True):
        assert -half - 0.05 < low <= -half
        assert half <= high < half + 0.05


def test_bad_functions():
    with pytest.raises(ShapeError, match=r"function: returned shape \(1,\)"):
        FunctionMembership(lambda x: np.ones(1), (0.0, 1.0))
    with pytest.raises(ParameterError, match="function: returned nan at"):
        FunctionMembership(lambda x: np.where(x < 0.5, 1.0, np.nan), (0.0, 1.0))
    with pytest.raises(ParameterError, match="expected lo < hi"):
        FunctionMembership(lambda x: x, (1.0, 1.0))
    with pytest.raises(ParameterError, match="support: entry"):
        FunctionMembership(lambda x: x, (0.0, np.inf))
    with pytest.raises(ShapeError, match="support: got shape"):
        FunctionMembership(lambda x: x, (0.0, 1.0, 2.0))


def test_bad_grids():
    with pytest.raises(ParameterError, match=r"axes\[0\]: expected increasing coordinates"):
        GridMembership([1.0, 0.0], [0.5, 1.0])
    with pytest.raises(ShapeError, match=r"axes\[0\]"):
        GridMembership([1.0, 2.0, 3.0], [0.5, 1.0])
    with pytest.raises(ShapeError, match="axes: got 1, expected one per dimension"):
        GridMembership([[0.0, 1.0]], [[0.5, 1.0], [0.0, 0.0]])
    with pytest.raises(ParameterError, match=r"finite memberships in \[0, 1\]"):
        GridMembership([0.0, 1.0], [np.nan, 1.0])
    with pytest.raises(ParameterError, match=r"finite memberships in \[0, 1\]"):
        GridMembership([0.0, 1.0], [-0.5, 1.0])

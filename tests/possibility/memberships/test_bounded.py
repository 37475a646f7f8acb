"""Triangles, intervals and points."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import IntervalMembership, SingletonMembership, TriangularMembership
from fuzzykf.errors import ParameterError, ShapeError


def test_triangle():
    triangle = TriangularMembership(-1.0, 1.0, 2.0)
    np.testing.assert_allclose(triangle([-2.0, -1.0, 0.0, 1.0, 1.5, 2.0]), [0, 0, 0.5, 1, 0.5, 0])
    np.testing.assert_allclose(triangle.support(0.25), [[-0.5], [1.75]])
    np.testing.assert_allclose(triangle.reach(np.array([0.25, 1.0])), [[[-0.5], [1.0]], [[1.75], [1.0]]])


@pytest.mark.parametrize(("left", "peak", "right"), [(0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)])
def test_one_sided_triangle_jumps_at_its_peak(left, peak, right):
    triangle = TriangularMembership(left, peak, right)
    assert triangle(peak) == 1.0
    assert triangle(0.5 * (left + right)) == pytest.approx(0.5)
    assert triangle(left - 0.1) == triangle(right + 0.1) == 0.0


def test_triangle_in_the_plane_is_a_pyramid():
    pyramid = TriangularMembership([-1.0, -2.0], [0.0, 0.0], [1.0, 2.0])
    assert pyramid([0.5, 1.0]) == pytest.approx(0.5)
    assert pyramid([0.5, 1.5]) == pytest.approx(0.25)
    assert pyramid.project([1])(1.5) == pytest.approx(0.25)


def test_interval():
    interval = IntervalMembership([-1.0, 0.0], [1.0, 0.0])  # equal bounds are allowed
    assert interval([1.0, 0.0]) == 1.0
    assert interval([1.0, 0.1]) == 0.0
    np.testing.assert_allclose(interval.peak, [0.0, 0.0])
    np.testing.assert_allclose(interval.project([0]).upper, [1.0])
    np.testing.assert_allclose(interval.alpha_cut(0.3).lower, [-1.0, 0.0])


def test_singleton():
    point = SingletonMembership([1.0, 2.0])
    np.testing.assert_array_equal(point([[1.0, 2.0], [1.0, 2.5]]), [1.0, 0.0])
    np.testing.assert_array_equal(point.point, [1.0, 2.0])
    assert repr(SingletonMembership(1.0)) == "SingletonMembership([1.])"


def test_bad_arguments():
    with pytest.raises(ParameterError, match="expected left <= peak <= right and left < right"):
        TriangularMembership(0.0, 2.0, 1.0)
    with pytest.raises(ParameterError, match="use SingletonMembership"):
        TriangularMembership(1.0, 1.0, 1.0)
    with pytest.raises(ParameterError, match=r"component 1 is \[2, 1\], expected lower <= upper"):
        IntervalMembership([0.0, 2.0], [1.0, 1.0])
    with pytest.raises(ShapeError, match="upper"):
        IntervalMembership([0.0, 2.0], [1.0])
    with pytest.raises(ParameterError, match=r"upper: entry \(0,\) is inf"):
        IntervalMembership(0.0, np.inf)

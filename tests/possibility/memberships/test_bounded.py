"""Triangles, intervals and points."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import IntervalMembership, SingletonMembership, TriangularMembership
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.possibility.memberships import BoxMembership


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


# ------------------------------------------------------------------ boxes that are open


def test_an_open_box_is_one_up_to_its_bounds() -> None:
    box = BoxMembership([0.0, -np.inf, -np.inf], [np.inf, 2.0, np.inf])
    assert box([[0.0, 2.0, 1e300], [-1e-9, 0.0, 0.0], [1.0, 2.1, 0.0]]).tolist() == [1.0, 0.0, 0.0]
    assert box(box.peak) == 1.0
    assert not box.is_bounded
    assert repr(box.project([1])) == "BoxMembership(lower=[-inf], upper=[2.])"
    assert BoxMembership(-3.0, 5.0).peak.tolist() == [1.0]


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        (1.0, 0.0, r"component 0 is \[1, 0\]"),
        ([0.0, np.nan], [1.0, 1.0], r"component 1 is \[nan, 1\]"),
        (np.inf, np.inf, "component 0"),
        (-np.inf, -np.inf, "component 0"),
        ([0.0, 0.0], 1.0, r"got shapes \(2,\) and \(1,\)"),
        ([], [], "got shapes"),
    ],
)
def test_an_open_box_has_a_side_that_can_be_reached(lower, upper, message) -> None:
    with pytest.raises(ParameterError, match=message):
        BoxMembership(lower, upper)

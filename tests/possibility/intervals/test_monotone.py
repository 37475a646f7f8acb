"""Images and pre-images of intervals and boxes contain what they should, and little more."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.possibility.intervals import monotone as intervals


def vec(*values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda x: 2 * x + 1, (-1.0, 5.0)),
        (lambda x: -(x**3), (-8.0, 1.0)),
        (np.exp, (np.exp(-1), np.exp(2))),
        (lambda x: 0 * x + 3, (3.0, 3.0)),
    ],
)
def test_monotone_image(f, expected):
    np.testing.assert_allclose(
        intervals.monotone_image(f, vec(-1), vec(2), "fx"), np.reshape(expected, (2, 1))
    )


def test_functions_that_turn_are_refused():
    with pytest.raises(ParameterError, match=r"fx: is not monotone on \[-1, 2\]"):
        intervals.monotone_image(lambda x: x**2, vec(-1), vec(2), "fx")
    with pytest.raises(ParameterError, match="hx: returned nan at"):
        intervals.monotone_restriction(lambda x: np.where(x > 0, x, np.nan), vec(-1), vec(1), 0, 1, "hx")


@pytest.mark.parametrize(
    ("g", "inverse"),
    [
        (lambda x: x**3, np.cbrt),
        (lambda x: -2 * x, lambda z: -z / 2),
        (np.tanh, np.arctanh),
        (np.exp, np.log),
    ],
)
@pytest.mark.parametrize("seed", range(5))
def test_monotone_restriction(g, inverse, seed):
    # oracle: the inverse function; bounds are rounded outwards, by no more than rounding
    rng = np.random.default_rng(seed)
    a, b = np.sort(rng.uniform(-2, 2, 2))
    ends = np.sort(g(rng.uniform(-2, 2, 2)))
    found = intervals.monotone_restriction(g, vec(a), vec(b), ends[0], ends[1], "hx")
    low, high = np.sort(inverse(ends))
    low, high = max(a, low), min(b, high)
    if low > high:
        assert found is None
    else:
        np.testing.assert_allclose(np.ravel(found), [low, high], rtol=1e-12, atol=1e-12)


def test_restriction_is_rounded_outwards():
    # every number of the bound whose image is admissible is inside, to the last bit
    g, least, most = (lambda x: 0.0005 * x**3), 0.1, 0.7
    lower, upper = intervals.monotone_restriction(g, vec(-30), vec(30), least, most, "hx")
    assert g(lower)[0] < least <= g(np.nextafter(lower, 99))[0]
    assert g(upper)[0] > most >= g(np.nextafter(upper, -99))[0]


def test_flat_function_tells_nothing_or_excludes():
    flat = (lambda x: 0 * x + 1.0), vec(-1), vec(1)
    np.testing.assert_array_equal(np.ravel(intervals.monotone_restriction(*flat, 0.5, 1.5, "hx")), [-1, 1])
    assert intervals.monotone_restriction(*flat, 1.5, 2.5, "hx") is None


def test_range_and_preimage_on_the_real_line():
    assert intervals.monotone_range(np.tanh, vec(-1), vec(1)) == (-1.0, 1.0)
    low, high = intervals.monotone_range(lambda x: x**3, vec(-1), vec(1))
    assert low < -1e100
    assert high > 1e100
    both = intervals.monotone_preimage(lambda x: x**3, vec(100), vec(101), -8.0, 27.0)
    np.testing.assert_allclose(np.ravel(both), [-2.0, 3.0])
    falling = intervals.monotone_preimage(lambda x: -(x**3), vec(100), vec(101), -8.0, 27.0)
    np.testing.assert_allclose(np.ravel(falling), [-3.0, 2.0])
    # a side on which z - v leaves the range of tanh is unbounded
    np.testing.assert_allclose(
        np.ravel(intervals.monotone_preimage(np.tanh, vec(0), vec(1), 0.5, 1.2)), [np.arctanh(0.5), np.inf]
    )
    # log is a number on half the line only
    np.testing.assert_allclose(
        np.ravel(intervals.monotone_preimage(np.log, vec(1), vec(2), 0.0, 1.0)), [1.0, np.e]
    )


def square(lower, upper):
    """Interval extension of x^2."""
    low = np.where((lower <= 0) & (upper >= 0), 0.0, np.minimum(lower**2, upper**2))
    return low, np.maximum(lower**2, upper**2)


def test_shaving():
    found = intervals.shave(square, vec(-3), vec(3), vec(1), vec(4))
    np.testing.assert_allclose(np.ravel(found), [-2, 2], atol=1e-4)
    assert found[0] <= -2
    assert found[1] >= 2
    found = intervals.shave(square, vec(0.5), vec(3), vec(1), vec(4))
    np.testing.assert_allclose(np.ravel(found), [1, 2], atol=1e-4)
    assert intervals.shave(square, vec(-3), vec(3), vec(-2), vec(-1)) is None

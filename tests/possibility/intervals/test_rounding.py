"""Directed rounding: the nearest float on the right side of what exact arithmetic gives."""

from __future__ import annotations

from fractions import Fraction
from math import inf, nextafter

import numpy as np
import pytest

from fuzzykf.possibility.intervals.rounding import product_above, product_below, sum_above, sum_below


def pairs(n, size):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(n, 2)) * 2.0 ** rng.integers(-size, size + 1, size=(n, 2))
    values[::7, 1] = 2.0 ** rng.integers(-4, 5, size=values[::7, 1].shape)  # exact products
    values[::11] = np.round(values[::11])
    return values.tolist()


@pytest.mark.parametrize(
    ("down", "up", "exact"),
    [
        (sum_below, sum_above, lambda a, b: Fraction(a) + Fraction(b)),
        (product_below, product_above, lambda a, b: Fraction(a) * Fraction(b)),
    ],
)
@pytest.mark.parametrize("size", [3, 60])
def test_they_are_the_neighbours_of_the_exact_result(down, up, exact, size):
    for a, b in pairs(3000, size):
        low, high, value = down(a, b), up(a, b), exact(a, b)
        assert Fraction(low) <= value <= Fraction(high)
        assert high == (low if Fraction(low) == value else nextafter(low, inf))


@pytest.mark.parametrize(
    ("a", "b"), [(2.0**600, 3.0), (1e-200, 1e-150), (5e-324, 0.5), (-(2.0**1000), 2.0**-3)]
)
def test_products_of_extreme_factors_are_enclosed(a, b):
    assert Fraction(product_below(a, b)) <= Fraction(a) * Fraction(b) <= Fraction(product_above(a, b))


def test_an_overflow_is_enclosed():
    assert product_below(1e200, 1e200) < inf == product_above(1e200, 1e200)
    assert sum_below(1.5e308, 1.5e308) < inf == sum_above(1.5e308, 1.5e308)

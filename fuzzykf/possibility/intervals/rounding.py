"""Sums and products that are rounded to one side: downward for lower bounds, upward for upper ones.

The error of a sum or product of two floats is a float itself.  It is found without any loss (Knuth's sum,
Dekker's product), and its sign tells whether the rounded result has to move to its neighbour.  What is exact
stays exact.
"""

from __future__ import annotations

from math import inf, isfinite, nextafter

__all__ = ["product_above", "product_below", "sum_above", "sum_below"]

#: Factors beyond this overflow when they are split, and products below lose bits of their error.
LARGEST, SMALLEST = 2.0**500, 2.0**-900

#: Splits a float into two halves of 26 bits.
SPLITTER = 2.0**27 + 1.0


def sum_below(a: float, b: float) -> float:
    """Return the largest float that is no larger than a + b."""
    total = a + b
    return nextafter(total, -inf) if _rest_of_sum(a, b, total) < 0.0 else total


def sum_above(a: float, b: float) -> float:
    """Return the smallest float that is no smaller than a + b."""
    total = a + b
    return nextafter(total, inf) if _rest_of_sum(a, b, total) > 0.0 else total


def product_below(a: float, b: float) -> float:
    """Return a float that is no larger than a b: the largest one, but next to overflow and underflow."""
    product = a * b
    if _is_exact(a, b):
        return product
    if not _splits(a, b, product):
        return nextafter(product, -inf)
    return nextafter(product, -inf) if _rest_of_product(a, b, product) < 0.0 else product


def product_above(a: float, b: float) -> float:
    """Return a float that is no smaller than a b: the smallest one, but next to overflow and underflow."""
    return -product_below(-a, b)


def _rest_of_sum(a: float, b: float, total: float) -> float:
    """Return a + b - total; where that overflows, of the right sign."""
    if not isfinite(total):
        return -total
    part = total - a
    return (a - (total - part)) + (b - part)


def _is_exact(a: float, b: float) -> bool:
    """Whether a factor is 0, 1 or -1, so that nothing is rounded."""
    return a in (0.0, 1.0, -1.0) or b in (0.0, 1.0, -1.0)


def _splits(a: float, b: float, product: float) -> bool:
    """Whether the error of a product can be found."""
    return abs(a) < LARGEST and abs(b) < LARGEST and SMALLEST < abs(product) < inf


def _rest_of_product(a: float, b: float, product: float) -> float:
    """Return a b - product."""
    high_a = SPLITTER * a
    high_a -= high_a - a
    high_b = SPLITTER * b
    high_b -= high_b - b
    low_a, low_b = a - high_a, b - high_b
    return ((high_a * high_b - product) + high_a * low_b + low_a * high_b) + low_a * low_b

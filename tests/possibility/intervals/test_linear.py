"""Images and pre-images of boxes under linear maps: bounds that hold in exact arithmetic, and little more."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

from fuzzykf.possibility.intervals.linear import contract, linear_image


def vec(*values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize("seed", range(5))
def test_linear_image_is_the_smallest_box(seed):
    # a linear map takes its extremes in the corners
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    lower = rng.normal(size=3)
    upper = lower + rng.random(3)
    corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, -1)
    low, high = linear_image(A, lower, upper)
    np.testing.assert_allclose(low, (A @ corners).min(axis=1), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(high, (A @ corners).max(axis=1), rtol=1e-13, atol=1e-13)
    # guaranteed: not even rounding puts a point outside
    points = A @ (lower[:, None] + (upper - lower)[:, None] * rng.random((3, 10_000)))
    assert (points >= low[:, None]).all()
    assert (points <= high[:, None]).all()


def test_linear_image_is_exact_for_permutations():
    low, high = linear_image(np.array([[0.0, -1.0], [2.0, 0.0]]), vec(-1, 0), vec(3, 0.1))
    np.testing.assert_array_equal([low, high], [[-0.1, -2.0], [0.0, 6.0]])


def hull(A, lower, upper, least, most):
    """Smallest box around {x in box: least <= A x <= most}, by linear programming."""
    stacked, bound = np.vstack([A, -A]), np.concatenate([most, -least])
    box, ends = list(zip(lower, upper, strict=True)), []
    for k in range(lower.size):
        for sign in (1, -1):
            c = np.zeros(lower.size)
            c[k] = sign
            result = linprog(c, A_ub=stacked, b_ub=bound, bounds=box)
            if result.status == 2:
                return None
            ends.append(sign * result.fun)
    return np.array(ends).reshape(-1, 2).T


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_contraction_contains_the_solutions(seed, rows):
    # oracle: linear programming; for one row the box is the smallest one
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rows, 3))
    lower, upper = -rng.random(3) - 0.2, rng.random(3) + 0.2
    least = A @ rng.uniform(-1.2, 1.2, 3) - 0.1
    most = least + 0.3
    found, exact = (
        contract(A, lower, upper, least, most),
        hull(A, lower, upper, least, most),
    )
    if exact is None:
        assert rows > 1 or found is None
        return
    assert found is not None
    assert (found[0] <= exact[0] + 1e-8).all()
    assert (found[1] >= exact[1] - 1e-8).all()
    if rows == 1:
        np.testing.assert_allclose(found, exact, atol=1e-8)


def test_rows_together_bound_what_none_bounds_alone():
    # z = (x1 + x2, x1 - x2) tells x1 and x2; from either row alone nothing follows
    A = np.array([[1.0, 1.0], [1.0, -1.0]])
    lower, upper = contract(A, vec(-100, -100), vec(100, 100), vec(2.9, 0.9), vec(3.1, 1.1))
    np.testing.assert_allclose([lower, upper], [[1.9, 0.9], [2.1, 1.1]], atol=1e-9)


# --------------------------------------------------------------------------- exact arithmetic


def exact_image(A, x):
    """A x of floats without rounding errors."""
    return [sum(Fraction(a) * Fraction(b) for a, b in zip(row, x, strict=True)) for row in A.tolist()]


def below(value):
    """Return the largest float that is no larger than a fraction."""
    nearest = float(value)
    return nearest if Fraction(nearest) <= value else float(np.nextafter(nearest, -np.inf))


def above(value):
    return -below(-value)


def numbers(rng, *shape):
    """Floats of very different sizes, some of them zero or one."""
    values = rng.normal(size=shape) * 2.0 ** rng.integers(-30, 31, size=shape)
    return np.where(rng.random(shape) < 0.2, rng.choice([0.0, 1.0, -1.0], size=shape), values)


def random_case(rng):
    """A map, a box and a point in it, often on its sides; some maps are nearly singular, some boxes flat."""
    d, q = (int(n) for n in rng.integers(1, 4, 2))
    A, lower = numbers(rng, q, d), numbers(rng, d)
    if rng.random() < 0.25:
        A = A[:1] + 1e-9 * rng.normal(size=(q, d)) * np.abs(A[:1])
    upper = lower + np.abs(numbers(rng, d)) * (rng.random(d) < 0.9)
    x = np.clip(lower + (upper - lower) * rng.choice([0.0, rng.random(), 1.0], d), lower, upper)
    return A, lower, upper, x


def violations(rng):
    """Count what is wrong with the bounds of one random case."""
    A, lower, upper, x = random_case(rng)
    low, high = linear_image(A, lower, upper)
    wrong = 0
    for row, a, b in zip(A.tolist(), low.tolist(), high.tolist(), strict=True):
        terms = [
            (Fraction(v) * Fraction(s), Fraction(v) * Fraction(t))
            for v, s, t in zip(row, lower.tolist(), upper.tolist(), strict=True)
        ]
        wrong += Fraction(a) > sum(map(min, terms)) or Fraction(b) < sum(map(max, terms))
    # a box that x is in, together with bounds that A x is in, often exactly on them
    image = exact_image(A, x.tolist())
    gap = np.abs(numbers(rng, 2, len(image))) * rng.choice([0.0, 1e-9, 1.0], (2, len(image)))
    least = vec(*(below(v - Fraction(g)) for v, g in zip(image, gap[0].tolist(), strict=True)))
    most = vec(*(above(v + Fraction(g)) for v, g in zip(image, gap[1].tolist(), strict=True)))
    found = contract(A, lower, upper, least, most)
    return wrong + (found is None or bool(((x < found[0]) | (x > found[1])).any()))


def test_bounds_hold_in_exact_arithmetic():
    rng = np.random.default_rng(0)
    assert sum(violations(rng) for _ in range(1000)) == 0


@pytest.mark.study
@pytest.mark.parametrize("seed", range(1, 11))
def test_bounds_hold_in_exact_arithmetic_in_a_million_cases(seed):
    rng = np.random.default_rng(seed)
    assert sum(violations(rng) for _ in range(100_000)) == 0


def test_a_row_of_zeros_excludes_all_or_nothing():
    zeros = np.zeros((1, 2))
    assert contract(zeros, vec(0, 0), vec(1, 1), vec(0.5), vec(1.5)) is None
    lower, upper = contract(zeros, vec(0, 0), vec(1, 1), vec(-0.5), vec(1.5))
    np.testing.assert_array_equal([lower, upper], [[0, 0], [1, 1]])

"""Divide and conquer and block bounds find the minima of brute force to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.engine.numpy import kernels
from fuzzykf.engine.numpy.kernels import (
    convolve_bounded,
    convolve_convex,
    convolve_joint,
    convolve_table,
    is_convex,
    totals,
)

N = 150
X = np.linspace(-5.0, 5.0, N)
D = np.linspace(-6.0, 6.0, 170)[:, None] - X

with np.errstate(divide="ignore"):
    CONVEX = {
        "cauchy cut at its scale": np.where(abs(D) <= 0.6, np.log1p((D / 0.6) ** 2), np.inf),
        "interval": np.where(abs(D) <= 0.6, 0.0, np.inf),
        "triangle": -np.log(np.maximum(0.0, 1.0 - abs(D) / 0.7)),
        "one-sided": np.where((D >= 0) & (D < 2), D, np.inf),
        "gauss": 0.5 * (D / 0.3) ** 2,
    }
    OTHER = {
        "cauchy": np.log1p((D / 0.3) ** 2),
        "cauchy cut far out": np.where(abs(D) <= 3, np.log1p((D / 0.3) ** 2), np.inf),
        "gauss as complement": 1.0 - np.exp(-0.5 * (D / 0.3) ** 2),
        "two ways": np.minimum(abs(D - 1), abs(D + 1)),
    }


def costs(name):
    rng = np.random.default_rng(1)
    shift = np.linspace(-1, 1, 25)[:, None]
    with np.errstate(divide="ignore"):
        return {
            "gauss": 0.5 * (X - shift) ** 2,
            "cauchy": np.log1p((3 * (X - shift)) ** 2),
            "triangle": -np.log(np.maximum(0, 1 - abs(X - shift))),
            "random": rng.random((25, N)),
            "torn": np.where(rng.random((25, N)) < 0.9, np.inf, rng.random((25, N))),
            "flat": np.zeros((25, N)),
            "impossible": np.full((25, N), np.inf),
        }[name]


COSTS = ["gauss", "cauchy", "triangle", "random", "torn", "flat", "impossible"]


def total(cost, table, source, combine=np.add):
    return totals(cost, table, source, 0, combine)


@pytest.mark.parametrize("kernel", CONVEX)
@pytest.mark.parametrize("name", COSTS)
def test_divide_and_conquer(kernel, name):
    cost, table = costs(name), CONVEX[kernel]
    assert is_convex(table)
    expected = total(cost, table, convolve_table(cost, table))
    np.testing.assert_array_equal(total(cost, table, convolve_convex(cost, table)), expected)


@pytest.mark.parametrize("kernel", [*CONVEX, *OTHER])
@pytest.mark.parametrize("name", COSTS)
@pytest.mark.parametrize("combine", [np.add, np.maximum], ids=["add", "max"])
def test_block_bounds(kernel, name, combine):
    cost, table = costs(name), {**CONVEX, **OTHER}[kernel]
    expected = total(cost, table, convolve_table(cost, table, combine), combine)
    np.testing.assert_array_equal(
        total(cost, table, convolve_bounded(cost, table, combine), combine), expected
    )


@pytest.mark.parametrize("name", COSTS)
def test_envelope_in_reciprocals(name):
    # untruncated Cauchy noise: 1/mu' = min of 1/mu (1 + d^2/s^2), equal to the log scale to 1e-12
    cost = costs(name)
    table = 1.0 + (D / 0.3) ** 2
    source = convolve_bounded(np.exp(cost), table, np.multiply)
    value = np.log(total(np.exp(cost), table, source, np.multiply))
    expected = total(cost, np.log(table), convolve_table(cost, np.log(table)))
    np.testing.assert_array_equal(np.isfinite(value), np.isfinite(expected))
    finite = np.isfinite(expected)
    np.testing.assert_allclose(value[finite], expected[finite], atol=1e-12)


@given(st.integers(0, 10_000), st.integers(1, 60), st.integers(1, 60))
@settings(max_examples=50, deadline=None)
def test_any_sizes(seed, n, m):
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((3, n)) < rng.random(), np.inf, rng.random((3, n)))
    d = np.sort(rng.uniform(-2, 2, m))[:, None] - np.linspace(-2, 2, n)
    table = np.where(abs(d) < rng.uniform(0.1, 3), d**2, np.inf)
    expected = total(cost, table, convolve_table(cost, table))
    for found in (convolve_convex(cost, table), convolve_bounded(cost, table)):
        assert (found >= 0).all()
        assert (found < n).all()
        np.testing.assert_array_equal(total(cost, table, found), expected)


def test_block_bounds_give_up_where_they_discard_nothing(monkeypatch):
    # random costs under a wide kernel: the line is searched as a whole, with the same result
    monkeypatch.setattr(kernels, "BLOCK", 4)
    cost = np.random.default_rng(0).random((4, N))
    table = 1e-6 * D**2
    expected = total(cost, table, convolve_table(cost, table))
    np.testing.assert_array_equal(total(cost, table, convolve_bounded(cost, table)), expected)


@pytest.mark.parametrize("name", CONVEX)
def test_convex_kernels_are_recognised(name):
    assert is_convex(CONVEX[name])


@pytest.mark.parametrize("name", OTHER)
def test_other_kernels_are_not(name):
    assert not is_convex(OTHER[name])


def test_a_gap_is_not_convex():
    assert not is_convex(np.array([[0.0, np.inf, 0.0, 1.0]]))


def test_joint_kernel_in_the_plane():
    # oracle: a loop over all pairs of nodes
    rng = np.random.default_rng(0)
    cost, kernel = rng.random((6, 5)), rng.random((3, 5))
    kernel[0, 1] = np.inf
    out = convolve_joint(cost, kernel, (1, 2))
    expected = np.full((6, 5), np.inf)
    for i, j in np.ndindex(6, 5):
        for a, b in np.ndindex(6, 5):
            u, v = i - a + 1, j - b + 2
            if 0 <= u < 3 and 0 <= v < 5:
                expected[i, j] = min(expected[i, j], cost[a, b] + kernel[u, v])
    np.testing.assert_allclose(out, expected)

"""The parabola envelope gives the minima of brute force to 1e-12, whatever the costs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fuzzykf.engine.numpy.convolution import convolve_parabola, envelope_of_parabolas, refine
from fuzzykf.engine.numpy.kernels import convolve_table

N = 200
X = np.linspace(-5.0, 5.0, N)
STEP = X[1] - X[0]


def lines(name):
    """Costs of shapes that are smooth, dented, torn and random, 30 lines each."""
    rng = np.random.default_rng(0)
    shift = np.linspace(-1, 1, 30)[:, None]
    with np.errstate(divide="ignore"):
        return {
            "gauss": 0.5 * (X - shift) ** 2,
            "cauchy": np.log1p((3 * (X - shift)) ** 2),
            "two hills": np.minimum(0.5 * ((X - 1) / 0.3) ** 2, 0.5 * ((X + 2 + shift) / 0.2) ** 2 + 0.3),
            "plateau": np.where(abs(X - shift) < 1, 0.0, np.inf),
            "triangle": -np.log(np.maximum(0, 1 - abs(X - shift))),
            "random": rng.random((30, N)) * 10,
            "torn": np.where(rng.random((30, N)) < 0.7, np.inf, rng.random((30, N)) * 10),
            "impossible": np.full((30, N), np.inf),
        }[name]


def brute(cost, x0, dx, m, curvature):
    """Best sources by trying them all, and the total with its neighbours on either side."""
    x = x0 + dx * np.arange(m)
    table = curvature * (x[:, None] - X) ** 2
    source = convolve_table(cost, table)
    padded = np.pad(cost, ((0, 0), (2, 2)), constant_values=np.inf)
    near = [
        np.take_along_axis(padded, source + 2 + k, axis=1) + curvature * (x - (X[source] + k * STEP)) ** 2
        for k in range(-2, 3)
    ]
    return source, near


NAMES = ["gauss", "cauchy", "two hills", "plateau", "triangle", "random", "torn", "impossible"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("deviation", [0.01, 0.1, 2.0])
@pytest.mark.parametrize("target", [(X[0], STEP, N), (-7.3, 0.031, 450), (1.0, 0.5, 7)])
def test_equals_brute_force(name, deviation, target):
    cost, curvature = lines(name), 0.5 / deviation**2
    source, near = brute(cost, *target, curvature)
    chosen = envelope_of_parabolas(cost, X[0], STEP, *target, curvature)
    x = target[0] + target[1] * np.arange(target[2])
    # the chosen source is as good as the best, and so is the refined cost
    total = np.take_along_axis(cost, chosen, axis=1) + curvature * (x - X[chosen]) ** 2
    scale = 1 + np.where(np.isfinite(near[2]), near[2], 0)
    np.testing.assert_array_equal(np.isfinite(total), np.isfinite(near[2]))
    with np.errstate(invalid="ignore"):
        assert np.nanmax(np.abs(total - near[2]) / scale, initial=0.0) < 1e-12
        same = chosen == source
        refined = convolve_parabola(cost, X[0], STEP, *target, curvature)
        expected = refine(*near)
        assert np.nanmax((np.abs(refined - expected) / scale)[same], initial=0.0) < 1e-12


@given(
    hnp.arrays(float, st.tuples(st.integers(1, 3), st.integers(1, 40)), elements=st.floats(0, 1e6)),
    st.floats(0.05, 20.0),
)
@settings(max_examples=50, deadline=None)
def test_any_costs(cost, curvature):
    n = cost.shape[1]
    x = np.arange(n, dtype=float)
    best = (cost[:, None, :] + curvature * (x[:, None] - x) ** 2).min(axis=2)
    chosen = envelope_of_parabolas(cost, 0.0, 1.0, 0.0, 1.0, n, curvature)
    total = np.take_along_axis(cost, chosen, axis=1) + curvature * (x - x[chosen]) ** 2
    np.testing.assert_allclose(total, best, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("cells", [1.3, 2.5, 10.0])
@pytest.mark.parametrize("ratio", [0.05, 1.0, 20.0])
def test_gaussians_are_exact_at_any_resolution(cells, ratio):
    # variances add: no dependence on the lattice, down to 1.3 cells per sigma
    step = 1.0 / cells
    y = np.arange(-8.0, 8.0 + step, step) + 0.37 * step
    noise = ratio
    total = np.sqrt(1.0 + noise**2)
    x = np.linspace(-4 * total, 4 * total, 101)
    out = convolve_parabola(0.5 * y[None] ** 2, y[0], step, x[0], x[1] - x[0], 101, 0.5 / noise**2)
    np.testing.assert_allclose(out[0], 0.5 * (x / total) ** 2, atol=1e-12)


def test_large_costs_do_not_lose_the_small_ones():
    # an outlier of 200 standard deviations adds 20000 to all costs of a line
    cost = lines("gauss")
    low = convolve_parabola(cost, X[0], STEP, X[0], STEP, N, 5.0)
    high = convolve_parabola(cost + 20000.0, X[0], STEP, X[0], STEP, N, 5.0)
    np.testing.assert_allclose(high - 20000.0, low, atol=1e-9)


def test_refine_knows_edges_and_kinks():
    # a parabola is followed, a wall or a kink beside the minimum is not
    parabola = [0.5 * (k - 0.3) ** 2 + 1 for k in range(-2, 3)]
    assert refine(*map(np.array, parabola)) == pytest.approx(1.0)
    wall = [3.0, 0.5, 0.1, 36.0, np.inf]
    assert refine(*map(np.array, wall)) == 0.1
    edge = [np.inf, np.inf, 0.1, 0.3, 0.7]
    assert refine(*map(np.array, edge)) == 0.1
    nowhere = [np.inf] * 5
    assert refine(*map(np.array, nowhere)) == np.inf

"""Integrals of densities with kinks and jumps, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzyMarkovLaw
from fuzzykf.switching.laws.integration import Lines, cell_masses, gauss_nodes, integrate_line, invert_line

FMC1 = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
FMC2 = FuzzyMarkovLaw.fmc2(alpha=0.15, gamma=0.6, delta=0.2)


def test_gauss_nodes_integrate_polynomials():
    x, w = gauss_nodes(5)
    for power in range(10):
        assert w @ x**power == pytest.approx(1 / (power + 1), rel=1e-14)
    assert w @ x**10 != pytest.approx(1 / 11, rel=1e-9)


def test_line_integral_sees_kinks_and_bounds():
    lines = Lines(kinks=np.array([0.0]), breaks=np.array([0.0, 1.0]), order=4)
    r1 = np.array([0.0, 0.3, 0.9])
    low, high = np.array([0.0, 0.1, 0.2]), np.array([1.0, 0.6, 0.7])
    expected = []
    for r, a, b in zip(r1, low, high, strict=True):
        # antiderivative of |r - s| in s
        part = [0.5 * (t - r) * abs(t - r) for t in (a, b)]
        expected.append(part[1] - part[0])
    got = integrate_line(lambda a, b: np.abs(a - b), r1, low, high, lines)
    np.testing.assert_allclose(got, expected, rtol=1e-14)


def area_below(x0, x1, y0, y1, line):
    """Area of {y <= x + line} within a rectangle, by integrating the clipped height exactly."""
    cuts = np.unique(np.clip([x0, x1, y0 - line, y1 - line], x0, x1))
    height = np.clip(cuts + line, y0, y1) - y0
    return float((0.5 * (height[1:] + height[:-1]) * np.diff(cuts)).sum())


def test_cells_of_the_band_are_areas():
    # a jump through the cells: gamma times the area of the band within each pair of cells
    bounds = np.linspace(0, 1, 8)  # delta is no multiple of 1/7
    masses = cell_masses(FMC2, bounds)
    for i in range(7):
        for j in range(7):
            box = bounds[i], bounds[i + 1], bounds[j], bounds[j + 1]
            area = area_below(*box, 0.2) - area_below(*box, -0.2)
            assert masses[i + 1, j + 1] == pytest.approx(0.6 * area, abs=1e-15)
        overlap = max(0.0, min(bounds[i + 1], 0.2) - bounds[i])
        assert masses[0, i + 1] == pytest.approx(0.6 * overlap, abs=1e-16)
        assert masses[i + 1, 0] == masses[0, i + 1]
        assert masses[-1, 7 - i] == pytest.approx(0.6 * overlap, abs=1e-15)
    assert masses.sum() == pytest.approx(1.0, abs=1e-14)


def test_cells_of_a_kink_are_exact():
    # int int |x - y| over the cell pairs: h^3/3 on the diagonal, the product of distances off it
    F = 5
    masses = cell_masses(FMC1, np.linspace(0, 1, F + 1))
    middle = (np.arange(F) + 0.5) / F
    mean_distance = np.abs(middle[:, None] - middle)
    mean_distance[np.diag_indices(F)] = 1 / F / 3
    np.testing.assert_allclose(masses[1:-1, 1:-1], (0.16 - 0.11 * mean_distance) / F**2, rtol=1e-13)
    np.testing.assert_allclose(masses[0, 1:-1], (0.16 - 0.11 * middle) / F, rtol=1e-13)
    np.testing.assert_allclose(masses[-1, 1:-1], (0.16 - 0.11 * (1 - middle)) / F, rtol=1e-13)
    np.testing.assert_array_equal(masses[np.ix_([0, -1], [0, -1])], FMC1.corners)


def test_unequal_cells_and_none():
    masses = cell_masses(FMC2, np.array([0.0, 0.1, 0.75, 1.0]))
    assert masses.shape == (5, 5)
    assert masses.sum() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(cell_masses(FMC2, np.array([0.0])), FMC2.corners)


@pytest.mark.parametrize("u", [0.0, 1e-12, 0.1, 0.5, 0.77, 1.0 - 1e-12, 1.0])
def test_inverting_a_distribution_function(u):
    # density 2 r: the quantile is sqrt(u); with a break in the middle and one without width
    r = invert_line(lambda s: 2 * s, u, np.array([0.0, 0.4, 0.4, 1.0]))
    assert r == pytest.approx(np.sqrt(u), abs=1e-12)
    assert 0.0 < r < 1.0


def test_inverting_skips_panels_without_mass():
    def middle(s):
        return np.where((s > 0.25) & (s < 0.75), 1.0, 0.0)

    breaks = np.array([0.0, 0.25, 0.75, 1.0])
    for u in (0.0, 0.3, 1.0 - 1e-12):
        assert invert_line(middle, u, breaks) == pytest.approx(0.25 + 0.5 * u, abs=1e-10)

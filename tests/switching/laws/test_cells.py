"""The law that is free on cells, by its definition: masses of cells, a density that is flat in each."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf.switching.laws.cells import CellLaw
from fuzzykf.switching.laws.integration import cell_masses


def law_of(F, seed=0):
    """A law on F cells and the two hard values, without any symmetry."""
    return CellLaw(np.random.default_rng(seed).uniform(0.1, 1.0, (F + 2, F + 2)))


@pytest.mark.parametrize("F", [0, 1, 2, 3, 4])
def test_the_density_has_the_masses(F):
    masses = law_of(F).masses
    law = CellLaw(masses + masses.T)  # the integrals of a law take it to be symmetric
    bounds = np.linspace(0.0, 1.0, F + 1) if F else np.array([0.0])
    np.testing.assert_allclose(cell_masses(law, bounds), law.masses, rtol=1e-12)
    assert law.masses.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("F", [1, 2, 3, 4])
def test_a_density_is_mass_over_area(F):
    law = law_of(F)
    values = np.array([0.0, *((np.arange(F) + 0.3) / F), 1.0])
    widths = np.array([1.0, *([1.0 / F] * F), 1.0])
    for a, b in itertools.product(range(F + 2), repeat=2):
        density = law.joint_density(values[a], values[b])
        assert density == pytest.approx(law.masses[a, b] / (widths[a] * widths[b]))


@pytest.mark.parametrize("F", [0, 1, 2, 3, 4, 5])
def test_the_chain_is_on_the_cells(F):
    law = law_of(F)
    chain = law.discretize(F)
    np.testing.assert_allclose(chain.nodes, [0.0, *((np.arange(F) + 0.5) / max(F, 1)), 1.0])
    np.testing.assert_allclose(chain.weights, [1.0, *([1.0 / max(F, 1)] * F), 1.0])
    np.testing.assert_allclose(chain.initial, law.masses.sum(axis=1))
    np.testing.assert_allclose(chain.initial[:, None] * chain.transition, law.masses)


@pytest.mark.parametrize("F", [0, 1, 2, 3, 4, 5])
def test_hardening_goes_to_the_nearer_regime(F):
    # a cell in the very middle belongs to either regime by half
    law = law_of(F)
    centres = [0.0, *((np.arange(F) + 0.5) / max(F, 1)), 1.0]
    expected = np.zeros((2, 2))
    for (a, x), (b, y) in itertools.product(enumerate(centres), repeat=2):
        for i, j in itertools.product(range(2), repeat=2):
            share = [0.5 if z == 0.5 else float((z > 0.5) == k) for z, k in ((x, i), (y, j))]
            expected[i, j] += law.masses[a, b] * share[0] * share[1]
    np.testing.assert_allclose(law.harden(), expected)


def test_a_cell_that_is_never_left_gets_the_initial_law():
    masses = np.ones((4, 4))
    masses[2] = 0.0
    chain = CellLaw(masses).discretize(2)
    np.testing.assert_allclose(chain.transition[2], chain.initial)

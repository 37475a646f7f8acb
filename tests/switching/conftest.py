"""Fixtures of the tests of learning: data with and without a hidden switch."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw


@pytest.fixture(scope="module")
def paper(ofsrf_cases):
    """FMC1 (.07, .05, .16), 67 % hard, with the printed matrices."""
    case = ofsrf_cases["P1"]
    gamma = np.array([[case["Gamma"][f"{i}{j}"] for j in range(2)] for i in range(2)])
    return CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), [case["M0"], case["M1"]], gamma, 1)


@pytest.fixture(scope="module")
def sim(paper):
    return paper.simulate(400, np.random.default_rng(0))


@pytest.fixture(scope="module")
def vector_sim():
    """Two states, two observations, two regimes that differ in mean."""
    rng = np.random.default_rng(1)
    r = np.repeat(rng.integers(0, 2, 60), 6).astype(float)
    z = np.zeros((len(r), 4))
    for n in range(1, len(r)):
        z[n] = 0.5 * z[n - 1] + rng.normal(size=4) * 0.5 + np.array([1.0, -1.0, 2.0, 0.5]) * r[n]
    return z[:, :2], z[:, 2:], r

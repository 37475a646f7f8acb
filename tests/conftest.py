"""Fixtures shared by the tests: reference cases, models."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw

try:
    from fuzzykf.engine.compiled import processor
except ImportError:
    SETS = []
else:
    SETS = list(processor.available_instructions())

# the normal run draws the same examples every time, so that it cannot fail by chance
settings.register_profile("normal", derandomize=True)
settings.load_profile("normal")

DATA = Path(__file__).parent / "data"


@pytest.fixture(params=SETS)
def instructions(request):
    """Name of the instruction set in use: one after the other, all of this processor."""
    before = processor.instructions()
    processor.use_instructions(request.param)
    yield request.param
    processor.use_instructions(before)


@pytest.fixture(scope="session")
def ofsrf_cases():
    """The reference cases of the exact switching filters, by identifier."""
    cases = json.loads((DATA / "ofsrf.json").read_text())["cases"]
    return {case["id"]: case for case in cases}


@pytest.fixture(scope="session")
def fuzzy_model():
    """A scalar fuzzy model whose regimes differ in everything (the matrices of the 2020 paper)."""
    S = np.array([[[0.5, 0.3], [0.3, 1.0]], [[0.75, 0.3], [0.3, 0.5]]])
    cross = np.array([[[0.1, 0.35], [0.0, 0.4]], [[0.5, 0.33], [0.0, 0.6]]])  # by the regime arrived at
    gamma = np.empty((2, 2, 4, 4))
    for i, j in itertools.product(range(2), repeat=2):
        K = cross[j].copy()
        if (i, j) == (1, 1):
            K[1, 1] = 0.3
        K[1, 0] = K[1, 1] * S[i, 0, 1] / S[i, 1, 1]  # Y2 and X1 are independent given Y1
        gamma[i, j] = np.block([[S[i], K.T], [K, S[j]]])
    law = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
    return CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], gamma, dim_x=1)


@pytest.fixture(scope="session")
def hard_model():
    """Three hard regimes, two states, one observation, no symmetry anywhere."""
    return CGOMSModel.from_transitions(
        [[0.8, 0.15, 0.05], [0.1, 0.7, 0.2], [0.3, 0.1, 0.6]], *random_transitions(3, 2, 1, seed=5), dim_x=2
    )


def random_transitions(K, m, q, seed):
    """A, Q, means and covariances for `from_transitions`: random, stable, positive definite."""
    rng = np.random.default_rng(seed)
    d = m + q
    A = 0.6 * rng.uniform(-1, 1, (K, K, d, d)) / np.sqrt(d)
    A[..., range(d), range(d)] += 0.3
    A[..., m:, :m] = 0.0
    root = rng.normal(size=(K, K, d, d)) * 0.4 + 0.5 * np.eye(d)
    first = rng.normal(size=(K, d, d)) * 0.4 + np.eye(d)
    return A, root @ np.swapaxes(root, -1, -2), rng.normal(size=(K, d)), first @ np.swapaxes(first, -1, -2)


@pytest.fixture(scope="session")
def make_transitions():
    """Parameters of a random system of K regimes: (K, m, q, seed) -> A, Q, means, covariances."""
    return random_transitions

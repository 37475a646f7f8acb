"""Fixtures shared by the tests: reference cases, models."""

from __future__ import annotations

import gc
import itertools
import json
import os
from pathlib import Path

# Before numpy is imported, for this process and the workers that it starts.  The matrices are small: threads
# of BLAS wait for one another, and as many of them as there are workers made learning three times as slow.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import is_hypothesis_test, settings  # noqa: E402

from fuzzykf import (  # noqa: E402
    CGOFMSModel,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    SwitchingStateSpace,
)

try:
    from fuzzykf.engine.compiled import processor
except ImportError:
    SETS = []
else:
    SETS = list(processor.available_instructions())

# the normal run draws the same examples every time, so that it cannot fail by chance;
# `nox -s explore` runs the properties alone, on fresh ones and ten times as many
settings.register_profile("normal", derandomize=True)
settings.register_profile("explore", derandomize=False, print_blob=True)
settings.load_profile("normal")

#: How many times as many examples as in the normal run.
EXPLORED = 10

DATA = Path(__file__).parent / "data"


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect without looking for garbage, a tenth of the time: what is collected stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config, items):
    """Keep the properties alone under the profile "explore", each with more examples."""
    if config.getoption("--hypothesis-profile", None) != "explore":
        return
    properties = [item for item in items if is_hypothesis_test(getattr(item, "obj", None))]
    for test in {id(item.obj): item.obj for item in properties}.values():
        own = test._hypothesis_internal_use_settings
        test._hypothesis_internal_use_settings = settings(own, max_examples=EXPLORED * own.max_examples)
    config.hook.pytest_deselected(items=[item for item in items if item not in set(properties)])
    items[:] = properties


@pytest.fixture(params=SETS)
def instructions(request):
    """Name of the instruction set in use: one after the other, all of this processor."""
    before = processor.instructions()
    processor.use_instructions(request.param)
    yield request.param
    processor.use_instructions(before)


@pytest.fixture(scope="session")
def ssm_cases():
    """The reference cases of switching state-space models, with the model of each."""
    cases = json.loads((DATA / "ssm.json").read_text())["cases"]
    return [(case, SwitchingStateSpace(_law(case["law"]), **{k: case[k] for k in SPACE})) for case in cases]


#: Arguments of a switching state-space model that the reference cases have.
SPACE = ("F", "H", "Q", "R", "b", "d", "x0", "P0")


def _law(law):
    if law["type"] == "matrix":
        return law["T"]
    if law["type"] == "fmc1":
        return FuzzyMarkovLaw.fmc1(law["alpha"], law["delta"], law["eta"])
    fades = {tuple(pair): tuple(how) for pair, how in law["fades"]}
    jumps = {tuple(pair): p for pair, p in law["jumps"]}
    return FadeLaw(law["K"], fades, jumps=jumps, turn_back=law["turn_back"])


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

"""Fixtures of the fuzzy estimator: the reference cases, and a brute-force filter as oracle."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="session")
def fuzzy_cases():
    """The reference cases of the fuzzy estimator, by name."""
    cases = json.loads((DATA / "fuzzy.json").read_text())["cases"]
    return {case["name"]: case for case in cases}


T_NORMS = {
    "product": lambda a, b: a * b,
    "min": np.minimum,
    "lukasiewicz": lambda a, b: np.maximum(0.0, a + b - 1.0),
    "hamacher": lambda a, b: np.where(a + b > 0.0, a * b / np.maximum(a + b - a * b, 1e-300), 0.0),
}


@pytest.fixture(scope="session")
def brute_force():
    """The definition of a scalar fuzzy filter, on a dense universe, by trying all pairs.

    Takes functions and memberships of arrays; returns centre of gravity, spread and
    possibility of each measurement, rows of an array (steps, 3).
    """

    def run(f, h, state, process, measurement, t_norm, zs, low, high, n=4001):
        T = T_NORMS[t_norm]
        x = np.linspace(low, high, n)
        blocks = [process(part[:, None] - f(x)) for part in np.array_split(x, 8)]
        mu, rows = state(x), []
        for z in zs:
            some = np.flatnonzero(mu)  # T(0, b) is 0
            hull = slice(some[0], some[-1] + 1)
            predicted = np.concatenate([T(mu[hull], block[:, hull]).max(axis=1) for block in blocks])
            mu, possibility = predicted, 1.0
            if z is not None:
                mu = T(mu, measurement(z - h(x)))
                possibility = mu.max()
                mu = mu / possibility
            mean = (x * mu).sum() / mu.sum()
            rows.append((mean, ((x - mean) ** 2 * mu).sum() / mu.sum(), possibility))
        return np.array(rows)

    return run

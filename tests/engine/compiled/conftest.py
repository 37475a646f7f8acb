"""Every test of the compiled core runs on every instruction set of this processor."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def every_instruction_set(instructions):
    """Use one after the other."""


@pytest.fixture(scope="session", name="tables_of")
def fixture_tables_of():
    """Maker of random arguments of `pack`."""
    return tables_of


@pytest.fixture(scope="session", name="state_of")
def fixture_state_of():
    """Maker of random states of the nodes."""
    return state_of


def tables_of(shape, order=1, seed=0, signed=False, zeros=False):
    """Arguments of `pack` for a random system."""
    M1, M2, m, q = shape
    rng = np.random.default_rng(seed)
    w = order * q
    transition = rng.dirichlet(np.ones(M2), M1)
    if zeros and M2 > 1:
        transition[:, -1] = 0.0
        transition /= transition.sum(axis=1, keepdims=True)
    if signed and M2 > 1:
        transition[0, 0] = -0.001
        transition[0] /= transition[0].sum()
    root = np.tril(rng.normal(size=(M1, M2, q, q)) * 0.2)
    root[..., range(q), range(q)] = rng.uniform(0.5, 1.5, (M1, M2, q))
    C = rng.normal(size=(M1, M2, m, m))
    shapes = [(m, m), (m, w), (m, q), (m,)]
    Axx, H, G, c = (rng.normal(size=(M1, M2, *s)) * 0.5 for s in shapes)
    Axx *= 0.8 / np.linalg.norm(Axx, 2, axis=(2, 3), keepdims=True)  # a stable system
    Ayy, Ny = rng.normal(size=(M1, M2, q, w)) * 0.3, rng.normal(size=(M1, M2, q))
    return transition, root, Axx, H, G, c, C @ np.swapaxes(C, -1, -2), Ayy, Ny


def state_of(shape, seed=0):
    M1, _, m, _ = shape
    rng = np.random.default_rng(seed + 1)
    root = rng.normal(size=(M1, m, m))
    P = (root @ np.swapaxes(root, -1, -2)).reshape(M1, m * m).T
    return np.concatenate([np.log(rng.dirichlet(np.ones(M1)))[None], rng.normal(size=(m, M1)), P])

"""Pairwise models with all of Z for a state: tables of chains and of known paths."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fuzzykf import SwitchChain
from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.switching.dynamics.joint import JointPath, JointSystem, law_of_whole

rng = np.random.default_rng(0)
K, M, Q = 3, 2, 2
D = M + Q
ROOT = rng.normal(size=(2, K, D, D)) + np.eye(D)
NOISE, FIRST = ROOT @ np.swapaxes(ROOT, -1, -2)
GIVEN = (rng.normal(size=(K, D, D)), rng.normal(size=(K, D)), NOISE, rng.normal(size=(K, D)), FIRST, M)
CHAIN = SwitchChain.from_classes(np.full((K, K), 1 / 3))


def test_tables_see_a_part_of_the_state_without_error():
    system = JointSystem(CHAIN, *GIVEN)
    tables = system.pair_tables(7)
    np.testing.assert_array_equal(tables.F, GIVEN[0])
    np.testing.assert_array_equal(tables.H[1], [[0, 0, 1, 0], [0, 0, 0, 1]])
    assert not tables.R.any()
    assert not tables.d.any()
    assert (system.dim_x, system.dim_z, system.whole.dim_x, system.whole.dim_z) == (2, 2, 4, 2)
    law = system.whole.initial()
    np.testing.assert_allclose(law.mean[:, M:D], law.mean[:, D:])
    np.testing.assert_allclose(law.covariance[:, M:D, M:D], law.covariance[:, D:, D:])
    np.testing.assert_allclose(law.table[1 : 1 + D].T, GIVEN[3])
    for a, b in zip(system.steps(3, 5), tables.space, strict=True):
        np.testing.assert_array_equal(a, b)
    assert copy.deepcopy(system) is system


def test_a_path_has_the_tables_of_its_regimes():
    r = np.array([2.0, 0.0, 1.0, 1.0])
    path, system = JointPath(*GIVEN, r), JointSystem(CHAIN, *GIVEN)
    steps = path.whole.steps(1, 3)
    for n in range(3):
        tables, k = path.pair_tables(n), int(r[n + 1])
        for name, along in zip(("F", "b", "Q", "H", "d", "R"), steps, strict=True):
            wanted = getattr(system.tables, name)[k]
            np.testing.assert_array_equal(getattr(tables, name)[0], wanted)
            np.testing.assert_array_equal(along[0, n if along.shape[1] > 1 else 0, 0], wanted)
    np.testing.assert_array_equal(path.initial().mean, GIVEN[3][2:3])
    np.testing.assert_array_equal(law_of_whole(path.initial(), Q).mean[:, :D], GIVEN[3][2:3])


def test_the_noise_of_an_observation_is_asked_where_a_path_arrives():
    noise = NOISE.copy()
    noise[1, M:, M:] = np.ones((2, 2))
    noise[1, :M, M:] = noise[1, M:, :M] = 0.0
    never = SwitchChain.from_classes([[0.5, 0, 0.5], [0.5, 0, 0.5], [0.5, 0, 0.5]], [0.3, 0.4, 0.3])
    JointSystem(never, *GIVEN[:2], noise, *GIVEN[3:])
    with pytest.raises(NotPositiveDefiniteError, match=r"noise\[1\], its block of the observation"):
        JointSystem(CHAIN, *GIVEN[:2], noise, *GIVEN[3:])

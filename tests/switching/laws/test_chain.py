"""Chains of the switch: what they accept, and stationary distributions."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fuzzykf import SwitchChain
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.switching.laws.chain import balance, closed_classes, hardened, rank, stationary_distribution

P = [[0.9, 0.1], [0.3, 0.7]]


def test_attributes():
    chain = SwitchChain([0.0, 0.25, 1.0], [1.0, 0.5, 1.0], [0.2, 0.3, 0.5], np.full((3, 3), 1 / 3))
    assert len(chain) == 3
    np.testing.assert_allclose(chain.class_weights, [[1, 0], [0.75, 0.25], [0, 1]])
    np.testing.assert_array_equal(chain.atoms, [True, False, True])
    assert not chain.is_signed
    assert copy.deepcopy(chain) is chain
    assert copy.copy(chain) is chain
    for name in ("nodes", "weights", "initial", "transition", "class_weights"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(chain, name)[0] = 0.5
    with pytest.raises(AttributeError):
        chain.nodes = np.zeros(3)


def test_signed_transitions_are_admissible():
    chain = SwitchChain([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], [[1.01, -0.01], [0.5, 0.5]])
    assert chain.is_signed


def test_classes():
    chain = SwitchChain.from_classes(P)
    np.testing.assert_array_equal(chain.nodes, [0.0, 1.0])
    np.testing.assert_array_equal(chain.class_weights, np.eye(2))
    np.testing.assert_allclose(chain.initial, [0.75, 0.25])
    chain = SwitchChain.from_classes(np.full((4, 4), 0.25), [0.4, 0.3, 0.2, 0.1])
    np.testing.assert_array_equal(chain.nodes, [0, 1, 2, 3])
    np.testing.assert_allclose(chain.initial, [0.4, 0.3, 0.2, 0.1])


def test_values_may_be_class_weights():
    u = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.2, 0.8, 0.0]])
    chain = SwitchChain(u, np.ones(3), np.full(3, 1 / 3), np.full((3, 3), 1 / 3))
    np.testing.assert_array_equal(chain.nodes, u)
    np.testing.assert_array_equal(chain.class_weights, u)
    assert len(chain) == 3
    assert chain.describe(1) == "(0, 0.5, 0.5)"
    assert SwitchChain.from_classes(P).describe(1) == "1"
    np.testing.assert_array_equal(chain.atoms, [True, False, False])
    assert set(map(tuple, chain.sample(50, np.random.default_rng(0)))) <= set(map(tuple, u))
    with pytest.raises(ParameterError, match=r"class_weights\[0\]: sums to 1\.1"):
        SwitchChain([[0.5, 0.6], [0.5, 0.5]], np.ones(2), [0.5, 0.5], P)


@pytest.mark.parametrize(
    ("nodes", "between", "expected"),
    [
        # 0, two nodes between, 1: hard values last, and backwards
        ([0.0, 0.25, 0.75, 1.0], [[], [0, 1], [0, 1], []], [[1, 2, 3, 0], [1, 2, 1, 2]]),
        # two directions; the rounding of 1 - 0.9 makes no other value
        (
            [0.0, 1.0, 0.1, 0.9, 0.9, 1.0 - 0.9],
            [[], [], [0, 1], [0, 1], [0, 1], [0, 1]],
            [[2, 5, 3, 4, 1, 0], [0, 1, 0, 2, 1, 2]],
        ),
        # edges come in the order of their first nodes
        (
            [0, 1, 2, 0.5, 1.5, 0.25],
            [[], [], [], [1, 2], [0, 1], [1, 2]],
            [[3, 5, 4, 2, 1, 0], [1, 2, 2, 1, 1, 2]],
        ),
        # one regime on two nodes, and hard nodes alone
        ([1.0, 0.0, 1.0], [[], [], []], [[1, 0, 2], [1, 0, 2]]),
        ([0.3], [[0, 1]], [[0], [2]]),
    ],
)
def test_ranking(nodes, between, expected):
    table = np.array([[k in one for k in range(3)] for one in between])
    np.testing.assert_array_equal(rank(np.array(nodes), table), expected)


def test_masses_by_value():
    chain = SwitchChain([0.0, 1.0, 0.9, 0.1, 1.0 - 0.9], np.ones(5), np.full(5, 0.2), np.full((5, 5), 0.2))
    mu = np.array([[0.1, 0.2, 0.3, 0.25, 0.15], [1.0, 0.0, 0.0, 0.0, 0.0]])
    values, masses = chain.by_value(mu)
    np.testing.assert_array_equal(values, [0.0, 0.1, 0.9, 1.0])
    np.testing.assert_allclose(masses, [[0.1, 0.4, 0.3, 0.2], [1.0, 0.0, 0.0, 0.0]])
    u = np.array([[0.0, 1.0, 0.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0]])
    values, masses = SwitchChain(u, np.ones(3), np.full(3, 1 / 3), np.full((3, 3), 1 / 3)).by_value(
        [0.1, 0.6, 0.3]
    )
    np.testing.assert_array_equal(values, u[:2])
    np.testing.assert_allclose(masses, [0.4, 0.6])
    with pytest.raises(ShapeError, match=r"mu: got shape \(3,\), expected \(..., 5\)"):
        chain.by_value([0.1, 0.6, 0.3])


def test_hardening_shares_out_the_middle():
    chain = SwitchChain([0.0, 0.25, 0.5, 1.0], np.ones(4), np.full(4, 1 / 4), np.eye(4))
    np.testing.assert_allclose(hardened(chain), [[0.5625, 0.0625], [0.0625, 0.3125]])


@pytest.mark.parametrize(
    ("arrows", "expected"),
    [
        (np.zeros((3, 3)), [[0], [1], [2]]),
        (np.roll(np.eye(4), 1, axis=1), [[0, 1, 2, 3]]),
        (np.diag(np.ones(6), 1), [[6]]),  # a long way to the end
        ([[0, 1, 0, 1], [1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], [[2], [3]]),
        ([[0, 0, 1], [0, 0, 1], [1, 0, 0]], [[0, 2]]),
    ],
)
def test_closed_classes(arrows, expected):
    assert closed_classes(np.array(arrows, dtype=bool)) == expected


def test_reachable_nodes():
    # 0 -> 1 -> 2 -> 1; 3 leads elsewhere, but nothing leads to it
    P = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0.5, 0, 0.5, 0]]
    for initial, expected in (
        ([1, 0, 0, 0], [1, 1, 1, 0]),
        ([0, 0, 1, 0], [0, 1, 1, 0]),
        ([0, 0, 0, 1], [1] * 4),
    ):
        np.testing.assert_array_equal(SwitchChain.from_classes(P, initial).reachable, expected)


def test_stationary_distribution():
    np.testing.assert_allclose(stationary_distribution(np.array(P)), [0.75, 0.25], rtol=1e-14)
    rng = np.random.default_rng(0)
    for K in (1, 3, 6):
        T = rng.dirichlet(np.ones(K), K)
        pi = stationary_distribution(T)
        np.testing.assert_allclose(pi @ T, pi, atol=1e-14)
        assert pi.sum() == pytest.approx(1.0)
    # a periodic chain, and one with a transient regime
    np.testing.assert_allclose(stationary_distribution(np.array([[0.0, 1.0], [1.0, 0.0]])), [0.5, 0.5])
    transient = np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.2, 0.2, 0.6]])
    np.testing.assert_allclose(stationary_distribution(transient), [0.5, 0.5, 0.0], atol=1e-15)


def test_several_closed_classes_need_an_initial_law():
    with pytest.raises(ParameterError, match=r"initial: has to be given, .* several closed classes"):
        SwitchChain.from_classes(np.eye(2))
    np.testing.assert_allclose(SwitchChain.from_classes(np.eye(2), [0.3, 0.7]).initial, [0.3, 0.7])


@pytest.mark.parametrize(
    ("transition", "initial", "message"),
    [
        ([[0.9, 0.2], [0.3, 0.7]], None, r"transition\[0\]: sums to 1\.1, expected 1"),
        ([[0.9, 0.1], [-0.3, 1.3]], None, r"transition\[1\]: got .*, expected probabilities in \[0, 1\]"),
        ([[0.9, 0.1]], None, r"transition: got shape \(1, 2\), expected \(K, K\)"),
        (np.empty((0, 0)), None, r"transition: got shape \(0, 0\), expected \(K, K\) with K of at least 1"),
        ([[0.9, np.nan], [0.3, 0.7]], None, r"transition: entry \(0, 1\) is nan"),
        ("abc", None, "transition: expected an array of numbers"),
        (P, [0.5, 0.6], r"initial: sums to 1\.1, expected 1"),
        (P, [1.0], r"initial: got shape \(1,\), expected \(2,\)"),
        (P, [-0.1, 1.1], r"initial: got -?\d.*, expected probabilities in \[0, 1\]"),
    ],
)
def test_bad_classes(transition, initial, message):
    with pytest.raises(ParameterError, match=message):
        SwitchChain.from_classes(transition, initial)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], [], [], np.empty((0, 0))), "nodes: got none, expected at least one"),
        (([0.0, 1.0], [1.0, 0.0], [0.5, 0.5], P), r"weights: got 0, expected positive numbers"),
        (([0.0, 1.0], [1.0], [0.5, 0.5], P), r"weights: got shape \(1,\), expected \(2,\)"),
        (([0.0, 2.0], [1.0, 1.0], [0.5, 0.5], P), r"nodes: expected values in \[0, 1\]"),
        (([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], [[0.9, 0.2], [0, 1]]), r"transition: row 0 sums to 1\.1"),
        (([0.0, 1.0], [1.0, 1.0], [0.5, 0.6], P), r"initial: sums to 1\.1"),
        (
            ([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], P, [[1.0, 0.1], [0.0, 1.0]]),
            r"class_weights\[0\]: sums to 1\.1",
        ),
        (([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], P, [[1.0]]), r"class_weights: got shape \(1, 1\)"),
    ],
)
def test_bad_chains(arguments, message):
    with pytest.raises((ParameterError, ShapeError), match=message):
        SwitchChain(*arguments)


class Given(np.random.Generator):
    """A generator whose draws are given."""

    def __init__(self, uniforms):
        super().__init__(np.random.PCG64(0))
        self.uniforms = np.array(uniforms)

    def random(self, n):
        return self.uniforms[:n]


def test_sampling_inverts_the_distribution_functions():
    chain = SwitchChain(
        [0.0, 0.5, 1.0],
        [1.0, 1.0, 1.0],
        [0.2, 0.5, 0.3],
        [[0.1, 0.6, 0.3], [0.5, 0.0, 0.5], [0.25, 0.25, 0.5]],
    )
    edge = np.nextafter(1.0, 0.0)
    draws = [0.71, 0.51, 0.24, 0.1, 0.69, 0.5, 0.0, edge, 0.3]
    # 0.2 | 0.7 | 1 to begin with; then a draw on a bound belongs to the next node
    expected = [1.0, 1.0, 0.0, 0.5, 1.0, 1.0, 0.0, 1.0, 0.5]
    np.testing.assert_array_equal(chain.sample(9, Given(draws)), expected)
    assert chain.sample(0, Given([])).size == 0
    rng = np.random.default_rng(0)
    path = chain.sample(4000, rng)
    counts = np.array(
        [[((path[:-1] == a) & (path[1:] == b)).sum() for b in chain.nodes] for a in chain.nodes]
    )
    np.testing.assert_allclose(counts / counts.sum(axis=1, keepdims=True), chain.transition, atol=0.05)


def test_balance_of_moves():
    rng = np.random.default_rng(1)
    for K in (1, 2, 5):
        moves = rng.uniform(0.0, 1.0 / K, (K, K))
        np.fill_diagonal(moves, 0.0)
        P = moves + np.diag(1.0 - moves.sum(axis=1))
        np.testing.assert_allclose(balance(moves), stationary_distribution(P), rtol=1e-12)
    # rates far apart, where 1 - rate has lost its digits; and a regime that is left for ever
    moves = np.array([[0.0, 1e-13, 0.0], [3e-13, 0.0, 0.5], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(balance(moves), np.array([3.0, 1.0, 0.5]) / 4.5, rtol=1e-14)
    moves = np.array([[0.0, 0.1, 0.1], [0.0, 0.0, 0.2], [0.0, 0.1, 0.0]])
    np.testing.assert_allclose(balance(moves), [0.0, 1 / 3, 2 / 3], rtol=1e-14)

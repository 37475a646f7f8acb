"""Laws on the nodes: masses by definition, and maximisation that cannot be improved upon."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzyMarkovLaw
from fuzzykf.switching.laws.cells import CellLaw
from fuzzykf.switching.laws.learners import FreeChain, _objective
from fuzzykf.switching.laws.registry import LAWS

WEIGHTS = np.stack([1.0 - np.array([0.0, 0.25, 0.75, 1.0]), [0.0, 0.25, 0.75, 1.0]], axis=1)
FMC1 = [(0.07, 0.05, 0.16), (0.2, 0.1, 0.1), (0.001, 0.0, 0.37), (0.49, 0.001, 0.002)]
FMC2 = [(0.12, 0.5, 0.17), (0.1, 0.46, 0.3), (0.05, 0.2, 0.45), (0.15, 0.55, 0.06)]


def joint_of(law, n_nodes):
    chain = law.discretize(n_nodes, "cell")
    return chain.initial[:, None] * chain.transition


@pytest.mark.parametrize("n_nodes", [0, 1, 2, 5, 8])
@pytest.mark.parametrize("parameters", FMC1)
def test_fmc1_has_the_masses_of_its_law(n_nodes, parameters):
    law = FuzzyMarkovLaw.fmc1(*parameters)
    chain = law.learner(n_nodes)
    np.testing.assert_allclose(
        chain.joint, joint_of(law, n_nodes), rtol=1e-4, atol=2e-4
    )  # floor of the start
    np.testing.assert_allclose(chain.joint, joint_of(chain.law(), n_nodes), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(chain.transition, chain.law().discretize(n_nodes).transition, rtol=1e-9)


@pytest.mark.parametrize("n_nodes", [0, 1, 2, 5, 8])
@pytest.mark.parametrize("parameters", FMC2)
def test_fmc2_has_the_masses_of_its_law(n_nodes, parameters):
    law = FuzzyMarkovLaw.fmc2(*parameters)
    chain = law.learner(n_nodes)
    np.testing.assert_allclose(chain.joint, joint_of(law, n_nodes), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(chain.joint, joint_of(chain.law(), n_nodes), rtol=1e-10, atol=1e-13)
    assert chain.law().parameters["delta"] == pytest.approx(parameters[2], rel=1e-9)


def expected(joint, pairs, first):
    p = joint.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = pairs * np.log(joint / p[:, None])
        b = first * np.log(p)
    return np.where(pairs > 0, a, 0.0).sum() + np.where(first > 0, b, 0.0).sum()


@pytest.mark.parametrize(("kind", "law"), [("fmc1", FMC1[0]), ("fmc1", FMC1[2]), ("fmc2", FMC2[1])])
def test_maximisation_cannot_be_improved_upon(kind, law):
    # gradient-free: no small change of the free numbers raises the expected log-likelihood
    rng = np.random.default_rng(0)
    make = FuzzyMarkovLaw.fmc1 if kind == "fmc1" else FuzzyMarkovLaw.fmc2
    pairs = 2000.0 * joint_of(make(*law), 5) * rng.uniform(0.8, 1.2, (7, 7))
    first = np.full(7, 0.2)
    chain = make(*law).learner(5)
    for _ in range(10):
        chain.maximise(pairs, first)
    best = expected(chain.joint, pairs, first)
    for _ in range(200):
        moved = chain.logits + rng.normal(size=chain.logits.size) * 10.0 ** rng.uniform(-4, -1)
        assert expected(chain._joint(moved), pairs, first) < best + 1e-4


@pytest.mark.parametrize("kind", ["fmc1", "fmc2", "free"])
def test_maximisation_recovers_the_chain_that_was_counted(kind):
    law = FuzzyMarkovLaw.fmc2(*FMC2[1]) if kind == "fmc2" else FuzzyMarkovLaw.fmc1(*FMC1[0])
    joint = joint_of(law, 5)
    start = FuzzyMarkovLaw.fmc2(0.25, 0.3, 0.25) if kind == "fmc2" else None
    chain = (LAWS[kind].by_name(5) if start is None else start).learner(5)
    before = -np.inf
    for _ in range(40):
        chain.maximise(1e4 * joint, joint.sum(axis=1))
        now = expected(chain.joint, 1e4 * joint, joint.sum(axis=1))
        assert now >= before - 1e-9 * abs(before)  # never down
        before = now
    np.testing.assert_allclose(chain.joint, joint, atol=2e-5)
    np.testing.assert_allclose(joint_of(chain.law(), 5), joint, atol=2e-5)


def test_a_free_chain_takes_the_expected_frequencies():
    rng = np.random.default_rng(1)
    pairs, first = rng.uniform(1, 9, (4, 4)), rng.uniform(0, 1, 4)
    chain = FreeChain(WEIGHTS, np.full((4, 4), 1.0), CellLaw)
    chain.maximise(pairs, first)
    np.testing.assert_allclose(chain.transition, pairs / pairs.sum(axis=1, keepdims=True), rtol=1e-14)
    np.testing.assert_allclose(chain.initial, first / first.sum(), rtol=1e-14)
    # a state that was never left keeps its row
    pairs[2] = 0.0
    row = chain.transition[2].copy()
    chain.maximise(pairs, first)
    np.testing.assert_allclose(chain.transition[2], row, rtol=1e-14)


def test_the_law_of_a_free_chain_is_stationary():
    # where one series began says next to nothing of the law, and must not wipe out its transitions
    rng = np.random.default_rng(2)
    pairs = rng.uniform(1, 9, (4, 4))
    chain = FreeChain(WEIGHTS, np.full((4, 4), 1.0), CellLaw)
    chain.maximise(pairs, np.array([1.0, 0.0, 0.0, 0.0]))
    law = chain.law()
    assert isinstance(law, CellLaw)
    np.testing.assert_allclose(law.discretize(2).transition, chain.transition, rtol=1e-10)
    p = law.discretize(2).initial
    np.testing.assert_allclose(p @ chain.transition, p, rtol=1e-9)
    assert law.p_hard == pytest.approx(p[0] + p[-1], rel=1e-9)


def test_a_free_chain_in_two_parts():
    # no unique stationary law: what was seen decides
    pairs = np.kron(np.diag([3.0, 1.0]), np.full((2, 2), 1.0))
    chain = FreeChain(WEIGHTS, np.full((4, 4), 1.0), CellLaw)
    chain.maximise(pairs, np.array([1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(chain.law().discretize(2).initial, [0.375, 0.375, 0.125, 0.125])
    np.testing.assert_allclose(chain.law().discretize(2).transition, chain.transition)


def test_other_widths_of_a_band():
    # one for each interval between multiples of the width of a cell, but that of the chain itself
    chain = FuzzyMarkovLaw.fmc2(0.12, 0.3, 0.25).learner(5)
    widths = [variant.law().parameters["delta"] for variant in chain.variants()]
    np.testing.assert_allclose(widths, [0.1, 0.45], rtol=1e-9)
    for variant in chain.variants():
        np.testing.assert_allclose(variant.joint, joint_of(variant.law(), 5), rtol=1e-9, atol=1e-13)
        assert variant.law().p_hard == pytest.approx(chain.law().p_hard, abs=0.1)
    assert chain.law().parameters["delta"] == pytest.approx(0.25)
    assert LAWS["fmc1"].by_name(5).learner(5).variants() == []


def test_numbers_beyond_the_bounds_of_the_search_are_no_chain():
    chain = LAWS["fmc1"].by_name(3).learner(3)
    inside = np.full(chain.vector.size, 1.0)
    assert chain.at(inside) is not None
    for k in range(inside.size):
        for far in (1e3, -1e3):
            vector = inside.copy()
            vector[k] = far
            assert chain.at(vector) is None


def test_nodes_that_were_never_seen_add_nothing_to_the_objective():
    joint = np.array([[0.4, 0.1, 0.0], [0.1, 0.4, 0.0], [0.0, 0.0, 0.0]])
    pairs = np.array([[3.0, 1.0, 0.0], [1.0, 5.0, 0.0], [0.0, 0.0, 0.0]])
    first = np.array([2.0, 0.0, 0.0])
    rows = joint[:2, :2] / joint[:2].sum(axis=1, keepdims=True)
    value = (pairs[:2, :2] * np.log(rows)).sum() + 2.0 * np.log(0.5)
    assert _objective(joint, pairs, first) == pytest.approx(value, rel=1e-14)
    assert _objective(joint, pairs, np.zeros(3)) == pytest.approx(value - 2.0 * np.log(0.5), rel=1e-14)


def test_a_node_without_mass_goes_where_the_chain_begins():
    chain = LAWS["fmc1"].by_name(1).learner(1)
    chain.joint = np.array([[0.3, 0.0, 0.2], [0.0, 0.0, 0.0], [0.1, 0.0, 0.4]])
    np.testing.assert_allclose(chain.initial, [0.5, 0.0, 0.5])
    np.testing.assert_allclose(chain.transition, [[0.6, 0.0, 0.4], [0.5, 0.0, 0.5], [0.2, 0.0, 0.8]])

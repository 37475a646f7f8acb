"""Laws on a graph as free numbers: there and back, and each part by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import GraphLaw
from fuzzykf.switching.laws.graph_numbers import parts_of

EDGES = {(0, 1): 0.2, (2, 1): 0.15}
LAWS = {
    "linear": GraphLaw.from_masses([0.3, 0.2, 0.1], EDGES, jumps={(0, 2): 0.02}),
    "band": GraphLaw.from_masses([0.3, 0.2, 0.1], EDGES, jumps={(0, 2): 0.02}, family="band", shape=0.3),
    "crossing": GraphLaw.from_masses(
        [0.3, 0.2, 0.1], EDGES, family="band", crossings={((0, 1), (2, 1)): (0.01, 0.2)}
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_numbers_give_the_law_back(name):
    law = LAWS[name]
    again = law.from_logits(law.logits())
    np.testing.assert_allclose(
        again.corners, law.corners, atol=2e-4
    )  # no share is less than 1e-4 to begin with
    for n_nodes in (0, 1, 4):
        chain, other = (one.discretize(n_nodes) for one in (law, again))
        np.testing.assert_allclose(other.initial, chain.initial, atol=2e-3)
    assert again.edges == law.edges
    assert again.crossings.keys() == law.crossings.keys()


@pytest.mark.parametrize("name", LAWS)
def test_any_numbers_are_a_law_and_come_back(name):
    rng = np.random.default_rng(0)
    for _ in range(20):
        logits = rng.uniform(-3.0, 3.0, LAWS[name].logits().size)
        law = LAWS[name].from_logits(logits)
        np.testing.assert_allclose(law.logits(), logits, rtol=1e-9, atol=1e-9)
        assert (law.corners > 0.0).sum() == (LAWS[name].corners > 0.0).sum()  # jumps stay where they are


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("n_nodes", [0, 1, 4])
def test_the_quicker_way_to_the_cells(name, n_nodes):
    law = LAWS[name]
    logits = law.logits() + 0.1
    chain = law.from_logits(logits).discretize(n_nodes)
    plain = chain.initial[:, None] * chain.transition
    np.testing.assert_allclose(law.on_cells(n_nodes)(logits), plain, rtol=1e-9, atol=1e-14)


def test_parts_sum_to_one():
    for law in LAWS.values():
        ways = np.array([*law.crossings.values()]).reshape(-1, 2)
        parts = parts_of(law.corners, np.array(law.parameters["parameters"]), law.family, ways)
        assert parts.sum() == pytest.approx(1.0, abs=1e-12)
        assert (parts > 0.0).all()


def test_other_widths():
    found = [
        law.parameters["parameters"][0][1]
        for law in map(LAWS["band"].from_logits, LAWS["band"].elsewhere(LAWS["band"].logits(), 5))
    ]
    np.testing.assert_allclose(found, [0.1, 0.45])  # .3 is in the middle one
    assert LAWS["linear"].elsewhere(LAWS["linear"].logits(), 5) == []

"""Laws of a switch that is known: the likeliest of their structure."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzyMarkovLaw, GraphLaw
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.known_paths import count_nodes
from fuzzykf.switching.laws.learners import _objective
from fuzzykf.switching.laws.registry import LAWS


def weights(r):
    return np.stack([1.0 - r, r], axis=1)


def likeliest(kind, r, n_nodes=5):
    return LAWS[kind].by_name(n_nodes).likeliest([weights(r)], n_nodes)


def complete_likelihood(law, r):
    before, after = r[:-1], r[1:]
    return float(np.log(law.transition_density(before, after)).sum())


@pytest.mark.parametrize(
    "truth",
    [
        FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
        FuzzyMarkovLaw.fmc1(0.2, 0.01, 0.05),
        FuzzyMarkovLaw.fmc2(0.12, 0.5, 0.17),
    ],
)
def test_laws_of_a_known_switch(truth):
    r = truth.sample(4000, np.random.default_rng(3))
    found = likeliest(truth.kind, r)
    best = complete_likelihood(found, r)
    assert best >= complete_likelihood(truth, r) - 1e-6
    for name, value in truth.parameters.items():
        assert found.parameters[name] == pytest.approx(value, abs=0.03), name
    # gradient-free: no small change of the parameters raises the likelihood
    make = FuzzyMarkovLaw.fmc1 if truth.kind == "fmc1" else FuzzyMarkovLaw.fmc2
    rng = np.random.default_rng(4)
    for _ in range(60):
        moved = {
            k: v * (1 + 10.0 ** rng.uniform(-4, -2) * rng.choice([-1, 1]))
            for k, v in found.parameters.items()
        }
        with np.errstate(divide="ignore"):
            try:
                value = complete_likelihood(make(**moved), r)
            except ParameterError:
                continue
        assert not value > best + 1e-4, moved


def test_the_search_for_a_law_does_not_end_on_the_way():
    # transitions on which a simplex of Nelder and Mead collapses before the maximum, by .02
    rng = np.random.default_rng(478038)
    r = np.clip(np.repeat(rng.uniform(-0.7, 1.7, 51), 3)[:150], 0.0, 1.0)
    one, mirrored = (likeliest("fmc1", s) for s in (r, 1.0 - r))
    assert complete_likelihood(mirrored, r) == pytest.approx(complete_likelihood(one, r), abs=1e-6)
    for name, value in one.parameters.items():
        assert mirrored.parameters[name] == pytest.approx(value, rel=1e-4), name


def test_all_transitions_are_used():
    # the fuzzy ones tell of eta and delta: without them the hard frequencies are the same
    truth = FuzzyMarkovLaw.fmc1(0.07, 0.0, 0.25)
    r = truth.sample(3000, np.random.default_rng(5))
    hard = np.isin(r, (0.0, 1.0))
    shuffled = r.copy()
    shuffled[~hard] = np.random.default_rng(6).random((~hard).sum())  # distances mean nothing any more
    a, b = likeliest("fmc1", r), likeliest("fmc1", shuffled)
    assert a.parameters["delta"] < 0.02
    assert b.parameters["delta"] > 0.05


def test_a_switch_that_is_always_hard():
    r = np.random.default_rng(7).integers(0, 2, 500).astype(float)
    for kind in ("fmc1", "fmc2"):
        law = likeliest(kind, r)
        assert law.p_hard == pytest.approx(1.0, abs=1e-6)
        stay = np.mean(r[:-1] == r[1:])
        assert law.corners[0, 0] * 2 == pytest.approx(stay, abs=1e-4)


def test_steps_that_fmc2_does_not_allow():
    with pytest.raises(ParameterError, match=r"from 0.2 to 0.9 in one step"):
        likeliest("fmc2", np.array([0.0, 0.2, 0.9]))


def test_transitions_need_not_follow_one_another():
    # each counts by p(after | before): what is divided by is the density of where it began
    rng = np.random.default_rng(3)
    before = np.repeat([0.0, 0.35, 1.0], [120, 30, 50])
    after = np.concatenate([np.repeat([0.0, 1.0], [70, 20]), rng.uniform(0.1, 0.9, 30)])
    after = np.concatenate([after, rng.uniform(0.0, 1.0, 30), np.repeat([1.0, 0.0], [35, 15])])
    paths = [weights(np.array(pair)) for pair in zip(before, after, strict=True)]
    law = LAWS["fmc1"].by_name(5).likeliest(paths, 5)

    def total(parameters):
        trial = FuzzyMarkovLaw.fmc1(*parameters)
        return float(np.log(trial.transition_density(before, after)).sum())

    best = np.array([law.alpha, law.delta, law.eta])
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 2e-3:
        if (best + step >= 0.0).all():
            assert total(best + step) <= total(best) + 1e-9


# --------------------------------------------------------------------------- by cells


def test_laws_of_cells_take_the_frequencies():
    r = np.array([0.0, 0.1, 0.2, 0.7, 1.0, 1.0, 0.6, 0.1, 0.0])
    law = LAWS["free"].by_name(2).likeliest([weights(r)], 2)
    chain = law.discretize(2)
    # nodes 0, .25, .75, 1
    np.testing.assert_allclose(
        chain.transition, [[0, 1, 0, 0], [1 / 3, 1 / 3, 1 / 3, 0], [0, 1 / 2, 0, 1 / 2], [0, 0, 1 / 2, 1 / 2]]
    )


@pytest.mark.parametrize("family", ["linear", "band"])
def test_laws_on_a_graph_come_near_the_one_that_was_sampled(family):
    masses = {(0, 1): 0.25, (1, 2): 0.1}
    truth = GraphLaw.from_masses([0.3, 0.25, 0.1], masses, jumps={(0, 1): 0.03}, family=family)
    start = GraphLaw.from_masses([1, 1, 1], {(0, 1): 1, (1, 2): 1}, jumps={(0, 1): 0.1}, family=family)
    path = truth.sample(6000, np.random.default_rng(0))
    found = start.likeliest([path], 5)
    np.testing.assert_allclose(found.class_masses, truth.class_masses, atol=0.06)
    np.testing.assert_allclose(found.edge_masses, truth.edge_masses, atol=0.06)
    jumps = np.mean((path[:-1, 0] == 1.0) & (path[1:, 1] == 1.0))
    assert found.corners[0, 1] == pytest.approx(jumps, abs=0.005)
    pairs, first = count_nodes([path], start.discretize(5))
    likelihood = [
        _objective(np.maximum(law.learner(5).joint, 1e-300), pairs, first) for law in (found, truth, start)
    ]
    assert likelihood[0] > likelihood[1] > likelihood[2]


def test_steps_and_values_that_a_law_does_not_have():
    law = GraphLaw.from_masses([1, 1, 1], {(0, 1): 1, (1, 2): 1})
    with pytest.raises(
        ParameterError, match=r"r: got \(0.5, 0, 0.5\), a value between classes that do not fade"
    ):
        law.likeliest([np.array([[1.0, 0.0, 0.0], [0.5, 0.0, 0.5]])], 3)
    with pytest.raises(ParameterError, match=r"r: goes from about \(1, 0, 0\) to \(0, 0, 1\) in a step"):
        law.likeliest([np.eye(3)[[0, 2]]], 3)

"""A law that is a given chain: the same chain for whoever uses it, and learned with the same arrows."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FadeLaw, OFSRFilter, SwitchChain
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chains import ChainLaw, as_law

FADE = FadeLaw(3, {(0, 1): (0.05, 10), (1, 2): (0.07, 8), (2, 0): (0.04, 12)}, jumps={(0, 2): 0.01})


@pytest.mark.parametrize("n_nodes", [0, 3, 50])
def test_the_chain_is_the_one_that_was_given(n_nodes):
    chain = FADE.discretize(3)
    law = ChainLaw(chain)
    assert law.discretize(n_nodes) is chain
    assert law.size(n_nodes) == len(chain)
    np.testing.assert_allclose(law.harden().sum(), 1.0)
    assert law.p_hard == pytest.approx(FADE.p_hard)
    np.testing.assert_allclose(law.mean_dwell(), FADE.mean_dwell())
    assert law.mean_fade() == pytest.approx(FADE.mean_fade())


def test_filters_of_a_model_of_a_chain_are_those_of_the_law(fuzzy_model):
    fade = FadeLaw.between(20, 10)
    means, covariances = fuzzy_model.form.means, fuzzy_model.form.covariances
    by_law = CGOFMSModel(fade, means, covariances, 1)
    by_chain = CGOFMSModel(fade.discretize(4), means, covariances, 1)  # a chain is taken for a law
    y = by_law.simulate(60, np.random.default_rng(0), n_nodes=4).y
    np.testing.assert_array_equal(OFSRFilter(by_chain).filter(y).x, OFSRFilter(by_law, 4).filter(y).x)


def test_learned_chains_have_the_same_arrows():
    law = ChainLaw(FADE.discretize(3))
    learner = law.learner(5)
    assert learner.n_parameters == 4 + 9  # what leaves: four ways from classes, and each cell
    rng = np.random.default_rng(0)
    pairs = rng.uniform(1.0, 9.0, (12, 12)) * (law.chain.transition > 0.0)
    learner.maximise(pairs, np.full(12, 1.0))
    found = learner.law()
    np.testing.assert_allclose(found.chain.transition, pairs / pairs.sum(axis=1, keepdims=True), rtol=1e-12)
    np.testing.assert_allclose(found.chain.initial @ found.chain.transition, found.chain.initial, rtol=1e-9)
    np.testing.assert_array_equal(found.chain.class_weights, law.chain.class_weights)


def test_known_switches_do_not_tell_directions_apart():
    path = np.stack([1.0 - np.linspace(0, 1, 9), np.linspace(0, 1, 9)], axis=1)
    with pytest.raises(ParameterError, match="several nodes of one value"):
        ChainLaw(FadeLaw.between(20, 10).discretize(3)).likeliest([path], 3)


def test_what_is_no_law():
    with pytest.raises(ParameterError, match="law: got list, expected a FuzzyMarkovLaw"):
        as_law([[0.9, 0.1], [0.1, 0.9]])
    with pytest.raises(ParameterError, match="chain: got FadeLaw, expected a SwitchChain"):
        ChainLaw(FADE)
    signed = SwitchChain([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], [[1.1, -0.1], [0.0, 1.0]])
    with pytest.raises(ParameterError, match=r"chain: got -0\.1 in its transition matrix"):
        ChainLaw(signed)

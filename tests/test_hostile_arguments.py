"""Arguments that are no good are refused by name, before they cost time or memory."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, FuzzyMarkovLaw, OFSRFilter, compare_models
from fuzzykf.comparison.scores import bootstrap_rmse
from fuzzykf.errors import ParameterError
from fuzzykf.switching import CGLSSM


def cglssm():
    one = [[[0.5]], [[0.9]]]
    return CGLSSM([[0.9, 0.1], [0.2, 0.8]], A=one, B=one, C=one, D=one)


@pytest.mark.parametrize(
    "call",
    [
        lambda fuzzy, hard, rng: fuzzy.simulate(5, rng),
        lambda fuzzy, hard, rng: hard.simulate(5, rng),
        lambda fuzzy, hard, rng: cglssm().simulate(5, rng),
        lambda fuzzy, hard, rng: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).sample(5, rng),
        lambda fuzzy, hard, rng: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).sample(5, rng, 3),
        lambda fuzzy, hard, rng: fuzzy.law.discretize(3).sample(5, rng),
        lambda fuzzy, hard, rng: compare_models(np.zeros(500), np.zeros(500), rng),
        lambda fuzzy, hard, rng: bootstrap_rmse(np.ones((500, 2)), 100, rng),
    ],
)
@pytest.mark.parametrize("rng", [0, None, "seed", np.random])
def test_what_is_no_generator_is_named(call, rng, fuzzy_model, hard_model):
    with pytest.raises(ParameterError, match=r"rng: got \w+, expected a numpy.random.Generator") as raised:
        call(fuzzy_model, hard_model, rng)
    assert ("default_rng(0)" in str(raised.value)) == (rng == 0)


@pytest.mark.parametrize("n", [-1, 2.5, "3", None, True, np.nan, 10**15, 10**400])
def test_lengths_are_whole_and_not_too_large(n, fuzzy_model, hard_model):
    rng = np.random.default_rng(0)
    for draw in (fuzzy_model.simulate, hard_model.simulate, cglssm().simulate, fuzzy_model.law.sample):
        with pytest.raises(ParameterError, match=r"n: got .*, expected (a whole|at most)"):
            draw(n, rng)


@pytest.mark.parametrize("steps", [0, -1, 2.5, "3", None, True, np.nan, 10**15, 10**400])
def test_forecasts_are_of_a_length_that_can_be_kept(steps, fuzzy_model, hard_model):
    for f in (OFSRFilter(fuzzy_model, 3), CGOMSMFilter(hard_model)):
        with pytest.raises(ParameterError, match=r"steps: got .*, expected (a whole|at most)"):
            f.forecast(steps)


@pytest.mark.parametrize("threads", [0, -1, 2.5, "3", None, True, 10**8, 10**400])
def test_threads_are_no_more_than_a_machine_has(threads, fuzzy_model):
    with pytest.raises(ParameterError, match=r"threads: got .*, expected (a whole|at most 1,024)"):
        OFSRFilter(fuzzy_model, 3).filter_many(np.zeros((4, 5)), threads=threads)


@pytest.mark.parametrize("n_nodes", [-1, 2.5, "3", np.nan, True, 100_000, 10**400])
def test_nodes_are_no_more_than_memory_holds(n_nodes, fuzzy_model):
    message = "n_nodes: got .*, expected (a whole number of at least 0|at most 1000)"
    for call in (fuzzy_model.filter, fuzzy_model.law.discretize, lambda n: OFSRFilter(fuzzy_model, n)):
        with pytest.raises(ParameterError, match=message):
            call(n_nodes)

"""Which law a search begins with, and transitions that are counted."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw, FuzzyMarkovLaw
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chains import ChainLaw
from fuzzykf.switching.learning.law import count_transitions, law_to_learn


def test_a_name_a_law_or_a_chain():
    seen = []
    fade = FadeLaw.between(30, 20)
    assert law_to_learn(fade, 5, lambda size: seen.append(size(7))) is fade
    assert law_to_learn("fmc2", 5, lambda size: seen.append(size(7))).kind == "fmc2"
    found = law_to_learn(fade.discretize(3), 5, lambda size: seen.append(size(7)))
    assert isinstance(found, ChainLaw)
    assert seen == [16, 9, 8]  # nodes on 7 between two classes
    # by name, the fades have room for the nodes that are asked for
    assert law_to_learn("fade", 30, lambda size: None).discretize(30).n_classes == 2


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("fmc3", "law: got 'fmc3', expected 'fmc1', 'fmc2', 'free', 'fade' or 'graph', or a law"),
        (3.0, "law: got float, expected a FuzzyMarkovLaw or another law, or a SwitchChain"),
        (FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1), "which cannot be learned"),
        (FadeLaw.between(20, 3), "expected n_nodes=3 at most"),
    ],
)
def test_what_cannot_be_learned_says_so(law, message):
    with pytest.raises(ParameterError, match=message):
        law_to_learn(law, 5, lambda size: None)


def test_a_search_does_not_begin_where_a_class_is_left_for_ever():
    one_way = FadeLaw(3, {(0, 1): (0.1, 8), (1, 2): (0.1, 8)})
    with pytest.raises(ParameterError, match=r"law: leaves class 0 and 1 for ever, .* expected ways back"):
        law_to_learn(one_way, 5, lambda size: None)
    assert law_to_learn(one_way, 5, lambda size: None, is_hidden=False) is one_way  # r tells all


def test_without_a_number_of_nodes_there_are_as_many_as_fit():
    short = FadeLaw.between(20, 3)
    assert law_to_learn(short, None, lambda size: None) is short
    with pytest.raises(ParameterError, match="n_nodes: got 5, expected n_nodes=3 at most"):
        law_to_learn(short, 5, lambda size: None)


def test_fades_without_cells_have_no_length_to_learn():
    with pytest.raises(ParameterError, match="n_nodes: got 0, expected at least 1 to learn how long fades"):
        law_to_learn("fade", 0, lambda size: None)


def test_counting():
    counts = count_transitions(np.array([0.0, 0.0, 2.0, 0.0]), np.array([1.0, 1.0, 0.0, 2.0]), 3)
    np.testing.assert_array_equal(counts, [[0, 2, 1], [0, 0, 0], [1, 0, 0]])

"""Fades as learning moves them: expected numbers of events, over how often each could have happened."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw
from fuzzykf.errors import ParameterError

RING = {(0, 1): (0.05, 10.0), (1, 2): (0.04, 8.0), (2, 0): (0.1, 12.0)}
LAWS = {
    "ring": FadeLaw(3, RING, jumps={(0, 2): 0.01}),
    "both ways": FadeLaw.between(40, 10, jump=0.005, turn_back=0.05),
    "entered by turning": FadeLaw(
        2, {(0, 1): (0.1, 9.0), (1, 0): (0.0, 12.0)}, jumps={(1, 0): 0.02}, turn_back=0.1
    ),
}
OTHERS = {
    "ring": FadeLaw(3, dict.fromkeys(RING, (0.02, 20.0)), jumps={(0, 2): 0.02}),
    "both ways": FadeLaw.between(20, 20, jump=0.02, turn_back=0.2),
    "entered by turning": FadeLaw(
        2, {(0, 1): (0.3, 30.0), (1, 0): (0.0, 30.0)}, jumps={(1, 0): 0.1}, turn_back=0.3
    ),
}


def counts(chain, n=1e6):
    return n * chain.initial[:, None] * chain.transition, chain.initial


def expected(learner, pairs):
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(pairs > 0.0, pairs * np.log(learner.transition), 0.0)
        return float(terms.sum()) + learner.log_prior


@pytest.mark.parametrize("name", LAWS)
def test_the_chain_is_that_of_the_law(name):
    chain = LAWS[name].discretize(4)
    learner = LAWS[name].learner(4)
    np.testing.assert_array_equal(learner.class_weights, chain.class_weights)
    np.testing.assert_array_equal(learner.transition, chain.transition)
    assert repr(learner.law()) == repr(LAWS[name])


@pytest.mark.parametrize("name", LAWS)
def test_expected_numbers_give_the_law_that_was_counted(name):
    law, learner = LAWS[name], OTHERS[name].learner(4)
    learner.maximise(*counts(law.discretize(4)))
    found = learner.law()
    for pair, numbers in law.fades.items():
        np.testing.assert_allclose(found.fades[pair], numbers, rtol=1e-3)  # one step is seen before
    for pair, p in law.jumps.items():
        assert found.jumps[pair] == pytest.approx(p, rel=1e-3)
    assert found.turn_back == pytest.approx(law.turn_back, rel=1e-3)
    np.testing.assert_allclose(learner.transition, law.discretize(4).transition, rtol=1e-3, atol=1e-14)


@pytest.mark.parametrize("name", LAWS)
def test_no_small_change_raises_the_expected_log_likelihood(name):
    rng = np.random.default_rng(0)
    learner = OTHERS[name].learner(4)
    pairs, first = counts(LAWS[name].discretize(4), 1e4)
    pairs = pairs * rng.uniform(0.7, 1.3, pairs.shape)
    learner.maximise(pairs, first)
    best = expected(learner, pairs)
    for _ in range(100):
        moved = learner.at(learner.vector * np.exp(10.0 ** rng.uniform(-4, -1) * rng.normal()))
        moved = learner.at(
            np.abs(
                learner.vector
                + 10.0 ** rng.uniform(-5, -2) * rng.normal(size=learner.vector.size) * (learner.vector > 0.0)
            )
        )
        assert expected(moved, pairs) <= best + 1e-7


@pytest.mark.parametrize("name", LAWS)
def test_a_vector_is_a_chain(name):
    learner = LAWS[name].learner(3)
    again = learner.at(learner.vector)
    np.testing.assert_allclose(again.transition, learner.transition, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(again.initial, learner.initial, rtol=1e-12)
    assert learner.at(np.zeros_like(learner.vector)) is None


def test_what_was_never_visited_stays():
    law = LAWS["ring"]
    learner = law.learner(4)
    pairs = np.zeros((15, 15))
    pairs[0, 0], pairs[0, 3], pairs[3, 3], pairs[3, 4] = 30.0, 10.0, 5.0, 5.0
    learner.maximise(pairs, np.eye(15)[0])
    found = learner.law()
    # 10 of 40 steps at the class, 5 of 10 in the fade, and a step of each before the data
    assert found.fades[0, 1] == (pytest.approx(10.05 / 41), pytest.approx(4 * 11 / 5.4))
    assert found.fades[1, 2] == pytest.approx(law.fades[1, 2])
    assert found.fades[2, 0] == pytest.approx(law.fades[2, 0])
    assert found.jumps == {(0, 2): pytest.approx(0.01 / 41)}


def test_a_fade_that_never_goes_on_ends_all_the_same():
    learner = LAWS["ring"].learner(4)
    pairs = np.zeros((15, 15))
    pairs[0, 0], pairs[3, 3] = 1.0, 5.0
    learner.maximise(pairs, np.eye(15)[0])
    assert learner.law().fades[0, 1][1] == pytest.approx(4 * 6 / 0.4)


def test_a_fade_cannot_be_shorter_than_its_cells():
    learner = LAWS["ring"].learner(4)
    pairs = np.zeros((15, 15))
    pairs[3, 4] = pairs[4, 5] = pairs[5, 6] = pairs[6, 1] = 7.0
    learner.maximise(pairs, np.eye(15)[3])
    assert learner.law().fades[0, 1][1] == pytest.approx(4 * 29 / 28.4)


def test_one_start_turns_back_often():
    (often,) = LAWS["both ways"].learner(4).variants()
    assert often.law().turn_back == 0.3
    np.testing.assert_allclose(often.transition.sum(axis=1), 1.0, rtol=1e-12)
    assert OTHERS["both ways"].learner(4).variants() == []  # it does already
    assert LAWS["ring"].learner(4).variants() == []  # it cannot


def test_numbers_that_are_free():
    assert LAWS["ring"].learner(4).n_parameters == 7  # rates, lengths, a jump
    assert LAWS["both ways"].learner(4).n_parameters == 7
    assert LAWS["entered by turning"].learner(4).n_parameters == 5  # a rate of zero stays


def test_a_search_leaves_the_bounds_at_which_there_is_no_waiting():
    # as many steps as cells, and never a second step at a class: the first expected numbers move both
    truth = FadeLaw.between(10, 9).discretize(3)
    learner = FadeLaw.between(1, 3).learner(3)
    assert learner.law().fades[0, 1] == (pytest.approx(1 / 1.1), pytest.approx(3 / 0.9))
    learner.maximise(*counts(truth))
    np.testing.assert_allclose(learner.transition, truth.transition, rtol=1e-3, atol=1e-14)
    # what is no bound stays as it was given
    assert FadeLaw.between(10, 3.5).learner(3).law().fades[0, 1] == (0.1, pytest.approx(3.5))


def test_fades_without_cells():
    with pytest.raises(ParameterError, match="n_nodes: got 0, expected at least 1"):
        LAWS["ring"].learner(0)
    assert FadeLaw(2, {}, jumps={(0, 1): 0.1, (1, 0): 0.2}).learner(0).n_parameters == 2

"""The one state of a switching filter, and the rule that estimates the switch."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import SwitchChain
from fuzzykf.engine import selected as engine
from fuzzykf.switching.inference.mixture import Mixture, most_likely_switch


def chain(*inner, weights=None):
    M = len(inner) + 2
    w = np.full(len(inner), 1.0 / max(len(inner), 1)) if weights is None else np.array(weights)
    return SwitchChain([0.0, *inner, 1.0], np.r_[1.0, w, 1.0], np.full(M, 1 / M), np.full((M, M), 1 / M))


# --------------------------------------------------------------------------- MPM (section VI-B)


@pytest.mark.parametrize(
    ("mu", "expected"),
    [
        ([0.4, 0.3, 0.1, 0.2], 0.0),  # hard: 0.6 > 1/2, and 0 is likelier
        ([0.2, 0.3, 0.1, 0.4], 1.0),
        ([0.3, 0.3, 0.1, 0.3], 1.0),  # a tie of the hard values goes to 1
        ([0.3, 0.3, 0.2, 0.2], 0.25),  # exactly one half is not more than one half
        ([0.1, 0.2, 0.5, 0.2], 0.75),
        ([0.45, 0.28, 0.27, 0.0], 0.25),  # fuzzy, although 0 is the likeliest node
    ],
)
def test_most_likely_switch(mu, expected):
    assert most_likely_switch(chain(0.25, 0.75), np.array(mu)) == expected


def test_nodes_between_are_compared_by_density():
    # masses .3 and .25 on weights .8 and .2
    c, mu = chain(0.4, 0.9, weights=[0.8, 0.2]), np.array([0.2, 0.3, 0.25, 0.25])
    assert most_likely_switch(c, mu) == 0.9


def test_most_likely_switch_of_many():
    mu = np.array([[[0.6, 0.1, 0.1, 0.2], [0.1, 0.1, 0.6, 0.2]]])
    np.testing.assert_array_equal(most_likely_switch(chain(0.25, 0.75), mu), [[0.0, 0.75]])


def test_chains_of_one_kind_of_node():
    hard = SwitchChain.from_classes(np.full((3, 3), 1 / 3))
    assert most_likely_switch(hard, np.array([0.3, 0.45, 0.25])) == 1.0
    soft = SwitchChain([0.2, 0.8], [0.5, 0.5], [0.5, 0.5], np.full((2, 2), 0.5))
    assert most_likely_switch(soft, np.array([0.9, 0.1])) == 0.2


def graph_chain(n_classes, *cells, weights=None):
    """Classes, and cells of given class weights."""
    u = np.array([*np.eye(n_classes), *cells], dtype=float)
    M = len(u)
    w = np.r_[np.ones(n_classes), np.full(len(cells), 0.5) if weights is None else weights]
    return SwitchChain(u[:, 1] if n_classes == 2 else u, w, np.full(M, 1 / M), np.full((M, M), 1 / M), u)


#: Two directions of a fade with two cells each; a triangle whose edge 0-1 has two cells, the others one.
FADES = graph_chain(2, [0.75, 0.25], [0.25, 0.75], [0.25, 0.75], [0.75, 0.25])
TRIANGLE = graph_chain(
    3, [0.75, 0.25, 0], [0.25, 0.75, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], weights=[0.5, 0.5, 1, 1]
)


@pytest.mark.parametrize(
    ("chain", "mu", "expected"),
    [
        # cells of one value add up: .16 + .14 beats .2
        (FADES, [0.1875, 0.1875, 0.125, 0.1875, 0.125, 0.1875], 0.25),  # a tie: the earlier one
        (FADES, [0.2, 0.2, 0.16, 0.19, 0.1, 0.15], 0.25),
        (FADES, [0.2, 0.2, 0.14, 0.25, 0.1, 0.11], 0.75),
        (FADES, [0.3, 0.25, 0.45, 0.0, 0.0, 0.0], 0.0),  # hard: .55 together
        (FADES, [0.25, 0.25, 0.1, 0.2, 0.1, 0.1], 0.75),  # one half is not more than half
        # the stratum of largest mass first: hard .42 against .3 + .2, although a class is the likeliest node
        (TRIANGLE, [0.42, 0.0, 0.0, 0.3, 0.2, 0.04, 0.04], [0.75, 0.25, 0]),
        (TRIANGLE, [0.12, 0.2, 0.1, 0.2, 0.1, 0.18, 0.1], [0, 1, 0]),  # hard .42 against .3, .18 and .1
        # a tie of hard values and an edge: the edge
        (TRIANGLE, [0.125, 0.125, 0.125, 0.0625, 0.0625, 0.375, 0.125], [0, 0.5, 0.5]),
        # a tie of two edges: the earlier, whose cells are narrower
        (TRIANGLE, [0.125, 0.0, 0.0, 0.1875, 0.25, 0.4375, 0.0], [0.25, 0.75, 0]),
        (TRIANGLE, [0.3, 0.0, 0.3, 0.1, 0.1, 0.1, 0.1], [0, 0, 1]),  # of two classes: the later
        # regimes that several nodes stand for
        (
            SwitchChain([0, 1, 1], np.ones(3), [0.4, 0.3, 0.3], np.eye(3), np.eye(2)[[0, 1, 1]]),
            [0.4, 0.3, 0.3],
            1.0,
        ),
    ],
)
def test_the_most_likely_value_sums_over_its_nodes(chain, mu, expected):
    np.testing.assert_array_equal(most_likely_switch(chain, np.array(mu)), expected)
    many = most_likely_switch(chain, np.tile(mu, (3, 2, 1)))
    np.testing.assert_array_equal(many, np.broadcast_to(expected, (3, 2, *np.shape(expected))))


# --------------------------------------------------------------------------- summaries


def test_layout_of_a_state():
    # rows: log-probability, mean, covariance; one column per node
    table = np.array([np.log([0.25, 0.75]), [1.0, 2.0], [3.0, 4.0], [5, 6], [0.1, 0.2], [0.1, 0.2], [7, 8]])
    mixture = Mixture(table, np.array([0.5]))
    np.testing.assert_allclose(mixture.probabilities, [0.25, 0.75])
    mean, covariance = mixture.moments(2)
    np.testing.assert_allclose(mean, [1.75, 3.75])
    np.testing.assert_allclose(mixture.mean(2), mean)
    P = np.array([[[5, 0.1], [0.1, 7]], [[6, 0.2], [0.2, 8]]])
    np.testing.assert_allclose(covariance, 0.25 * P[0] + 0.75 * P[1] + 0.25 * 0.75 * np.ones((2, 2)))
    signed = Mixture(table, np.array([0.5]), np.array([-1.0, 1.0]))
    np.testing.assert_allclose(signed.probabilities, [-0.25, 0.75])


def test_a_gap_is_the_same_state_with_more_unknowns():
    # X, then the second of two numbers in the window; the first is known
    P = np.array([[[2.0, 0.5], [0.5, 3.0]], [[4.0, 0.1], [0.1, 5.0]]])
    window = np.array([7.0, np.nan])
    mean, covariance = np.array([[1.0, 7.0, 2.0], [3.0, 7.0, 4.0]]), np.zeros((2, 3, 3))
    covariance[np.ix_([0, 1], [0, 2], [0, 2])] = P
    table = engine.window_table(np.log([0.4, 0.6]), mean, covariance, window)
    mixture = Mixture(table, window, unknown=1)
    assert mixture.table.shape == (1 + 2 + 4, 2)
    for got, expected in zip(engine.window_moments(table, window), (mean, covariance), strict=True):
        np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(mixture.state_table(1), [np.log([0.4, 0.6]), [1.0, 3.0], [2.0, 4.0]])
    np.testing.assert_allclose(mixture.moments(1)[0], [2.2])
    again = Mixture.from_dict(mixture.to_dict())
    np.testing.assert_array_equal(again.table, mixture.table)
    np.testing.assert_array_equal(again.window, window)
    assert again.unknown == 1
    assert again.is_sound(1, 1, 2, 2)
    assert not again.is_sound(2, 1, 2, 2)
    assert not again.is_sound(1, 1, 2, 1)

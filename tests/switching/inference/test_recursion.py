"""The pieces of the recursion that the filters are made of."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import SwitchChain
from fuzzykf.switching.inference.recursion import (
    NodeState,
    most_likely_switch,
    node_moments,
    node_probabilities,
    posterior_moments,
)


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


# --------------------------------------------------------------------------- summaries


def test_layout_of_a_state():
    # rows: log-probability, mean, covariance; one column per node
    table = np.array([np.log([0.25, 0.75]), [1.0, 2.0], [3.0, 4.0], [5, 6], [0.1, 0.2], [0.1, 0.2], [7, 8]])
    state = NodeState(table)
    np.testing.assert_allclose(node_probabilities(state), [0.25, 0.75])
    x, P = node_moments(state, 2)
    np.testing.assert_array_equal(x, [[1, 3], [2, 4]])
    np.testing.assert_array_equal(P, [[[5, 0.1], [0.1, 7]], [[6, 0.2], [0.2, 8]]])
    mean, covariance = posterior_moments(state, 2)
    np.testing.assert_allclose(mean, [1.75, 3.75])
    between = 0.25 * 0.75 * np.ones((2, 2))
    np.testing.assert_allclose(covariance, 0.25 * P[0] + 0.75 * P[1] + between)
    signed = NodeState(table, np.array([-1.0, 1.0]))
    np.testing.assert_allclose(node_probabilities(signed), [-0.25, 0.75])

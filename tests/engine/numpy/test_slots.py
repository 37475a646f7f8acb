"""Slots hold the pairs of positive probability, each once, column by column."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.slots import lay_out, node_index


def random_chain(M1, M2, most, seed):
    """Transition probabilities with at most so many predecessors of a node, and a column of zeros."""
    rng = np.random.default_rng(seed)
    P = np.zeros((M1, M2))
    for j in range(1, M2):
        P[rng.choice(M1, rng.integers(1, most + 1), replace=False), j] = rng.uniform(0.1, 1.0)
    return P


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("shape", [(2, 1), (4, 4), (12, 9), (9, 30)])
def test_each_pair_has_one_slot(shape, seed) -> None:
    M1, M2 = shape
    P = random_chain(M1, M2, M1 // 2, seed)
    slots = lay_out(P)
    found = [(int(slots.source[s, j]), j) for s, j in np.argwhere(slots.there)]
    assert sorted(found) == [tuple(pair) for pair in np.argwhere(P > 0.0).tolist()]
    np.testing.assert_array_equal(slots.spread(slots.probabilities(P), M1, 0.0), P)
    # what is left over repeats the first pair of the column, with a probability of zero
    first = np.broadcast_to(slots.source[0], slots.source.shape)
    np.testing.assert_array_equal(slots.source[~slots.there], first[~slots.there])
    assert not slots.probabilities(P)[~slots.there].any()
    values = np.random.default_rng(1).normal(size=(M1, M2, 2))
    for s, j in np.ndindex(*slots.source.shape):
        np.testing.assert_array_equal(slots.take(values)[s, j], values[slots.source[s, j], j])


@pytest.mark.parametrize("seed", range(3))
def test_sums_over_rows_and_columns_are_those_of_all_pairs(seed) -> None:
    P = random_chain(10, 8, 4, seed)
    slots = lay_out(P)
    own = slots.probabilities(P)
    np.testing.assert_allclose(own.sum(axis=0), P.sum(axis=0), rtol=1e-14)
    np.testing.assert_allclose(slots.sums(own, 10), P.sum(axis=1), rtol=1e-14)
    at, there = slots.rows(10)
    np.testing.assert_array_equal(there.sum(axis=1), np.count_nonzero(P, axis=1))
    np.testing.assert_allclose(np.where(there, own.ravel()[at], 0.0).sum(axis=1), P.sum(axis=1), rtol=1e-14)


@pytest.mark.parametrize(
    "P",
    [
        np.eye(1),
        np.full((3, 3), 1 / 3),
        np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]]),  # most pairs of one column
        np.diag([1.001, -0.001, 1.0, 1.0]) + np.eye(4)[::-1] * 0.0,  # a negative weight
    ],
    ids=["one", "all", "most", "signed"],
)
def test_where_most_pairs_are_positive_all_have_slots(P) -> None:
    assert lay_out(P) is None


def test_the_index_gives_each_slot_what_its_node_holds() -> None:
    held, P = np.arange(6.0), np.roll(np.eye(6), 1, axis=1)
    np.testing.assert_array_equal(held[node_index(lay_out(P))], [np.roll(held, 1)])
    assert held[node_index(None)].shape == (6, 1)

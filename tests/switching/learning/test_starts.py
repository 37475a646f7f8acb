"""Guesses of a hidden switch between the classes of a law: names, and fades."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.starts import ALL_ORDERS, UNLIKELY, arrangements, faded, guesses


def ring(K, rng, *, reverse=False):
    """Joint probabilities of a ring 0 -> 1 -> ... -> 0 of other rates."""
    joint = np.diag(rng.uniform(0.5, 1.0, K))
    for a in range(K):
        joint[(a + 1) % K if reverse else a, a if reverse else (a + 1) % K] = rng.uniform(0.02, 0.1)
    return joint / joint.sum()


@pytest.mark.parametrize("K", [3, 4, 5])
def test_regimes_in_any_order_get_their_names_back(K):
    rng = np.random.default_rng(K)
    joint = ring(K, rng)
    order = rng.permutation(K)
    names = arrangements(1e4 * joint[np.ix_(order, order)], joint)[0]
    np.testing.assert_allclose(joint[np.ix_(names, names)], joint[np.ix_(order, order)], rtol=1e-12)


def test_no_exchange_of_two_of_many_classes_is_likelier():
    K = ALL_ORDERS + 1
    rng = np.random.default_rng(0)
    joint, pairs = ring(K, rng), rng.uniform(size=(K, K))
    log_p = np.log(np.maximum(joint / joint.sum(axis=1, keepdims=True), UNLIKELY))

    def score(names):
        return (pairs * log_p[np.ix_(names, names)]).sum()

    best = arrangements(pairs, joint)[0]
    assert sorted(best) == list(range(K))
    for i, j in combinations(range(K), 2):
        other = list(best)
        other[i], other[j] = other[j], other[i]
        assert score(other) <= score(best) + 1e-9


def test_names_that_the_law_does_not_tell_apart_stay():
    joint = np.full((4, 4), 1.0) + 10.0 * np.eye(4)
    assert arrangements(np.random.default_rng(0).uniform(size=(4, 4)), joint) == [(0, 1, 2, 3)]


def test_both_ways_round_a_ring_are_tried():
    joint = (10.0 * np.eye(3) + np.roll(np.eye(3), 1, axis=1)) / 33.0
    pairs = 100.0 * joint.T
    found = arrangements(pairs, joint)
    assert len(found) == 2  # of six orders
    np.testing.assert_allclose(joint[np.ix_(found[0], found[0])], joint.T)


def test_fades_are_as_long_as_they_are_to_be():
    shares = np.eye(2)[[0] * 10 + [1] * 10]
    guess = faded(shares, np.array([0]), 5)
    np.testing.assert_allclose(guess.sum(axis=1), 1.0)
    assert ((guess[:, 1] > 0.0) & (guess[:, 1] < 1.0)).sum() == 4
    assert guess[9, 1] == guess[10, 0] == pytest.approx(0.4)
    # stretches do not fade into one another
    apart = faded(shares, np.array([0, 10]), 5)
    np.testing.assert_array_equal(apart, shares)


def test_what_y_says_of_a_missing_state_stands_for_it():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(60, 2))
    x = y @ [[2.0], [-1.0]] + 0.1 * rng.normal(size=(60, 1))
    known = rng.random(60) < 0.7
    data = gather(np.where(known[:, None], x, np.nan), y, state_feedback=False)
    before = data.z.copy()
    ranks = guesses(data, 5, np.random.default_rng(1))
    for rank in ranks:
        np.testing.assert_allclose(np.sort(rank), (np.arange(60) + 0.5) / 60)
    # the third guess are the ranks of x: measured, or its regression on y
    fit = np.linalg.lstsq(np.c_[np.ones(known.sum()), y[known]], x[known, 0], rcond=None)[0]
    filled = np.where(known, x[:, 0], np.c_[np.ones(60), y] @ fit)
    order = np.argsort(ranks[2])
    assert order.tolist() in (np.argsort(filled).tolist(), np.argsort(filled)[::-1].tolist())
    np.testing.assert_array_equal(data.z, before)

"""Ranks, Gramians and linear programs: against matrix_rank, against least squares, against enumeration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from fuzzykf.errors import NumericalRangeError
from fuzzykf.possibility import gramians

WALK = np.array([[1.0, 1.0], [0.0, 1.0]])


def hidden(rng, m, rank):
    """A random model of which a random subspace is not shown, in units of any size."""
    F, H = 0.7 * rng.normal(size=(m, m)), rng.normal(size=(1, m))
    F[:rank, rank:] = 0.0
    H[:, rank:] = 0.0
    turn, units = rng.normal(size=(m, m)), 10.0 ** rng.uniform(-3.0, 3.0, m)
    turn = np.linalg.qr(turn)[0] * units[:, None]
    return turn @ F @ np.linalg.inv(turn), H @ np.linalg.inv(turn)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("m", "rank"), [(1, 1), (2, 1), (3, 3), (4, 2), (4, 0)])
def test_what_is_seen_and_what_is_not(seed, m, rank) -> None:
    F, H = hidden(np.random.default_rng(seed), m, rank)
    rows = gramians.observability_matrix(F, H, m + 3)
    assert len(rows) == m
    seen, unseen = gramians.row_space(rows)
    assert seen.shape == (m, rank)
    assert unseen.shape == (m - rank, m)
    size = np.abs(rows) @ np.abs(unseen.T)
    assert (np.abs(rows @ unseen.T) <= 1e-8 * size).all()
    np.testing.assert_allclose(unseen @ unseen.T, np.eye(m - rank), atol=1e-12)


def test_a_rank_grows_with_the_measurements_and_no_further() -> None:
    F = np.diag(np.ones(4), 1)  # a chain of five integrators, with H of the first
    H = np.eye(5)[:1]
    ranks = [gramians.row_space(gramians.observability_matrix(F, H, n))[0].shape[1] for n in range(1, 8)]
    assert ranks == [1, 2, 3, 4, 5, 5, 5]


@pytest.mark.parametrize("seed", range(4))
def test_information_is_that_of_all_measurements_at_once(seed) -> None:
    # z = shown d + noise, the noise of covariance S: W = shown' S^-1 shown, built up without the recursion
    rng, m, q, n = np.random.default_rng(seed), 3, 2, 5
    F, H, root, R = 0.8 * rng.normal(size=(m, m)), rng.normal(size=(q, m)), rng.normal(size=(m, 2)), np.eye(q)
    Q = root @ root.T  # singular
    powers = [np.linalg.matrix_power(F, k) for k in range(n)]
    shown = np.vstack([H @ power for power in powers])
    spread = np.zeros((n * q, (n - 1) * m))
    for k in range(n):
        for j in range(k):
            spread[k * q : (k + 1) * q, j * m : (j + 1) * m] = H @ powers[k - 1 - j]
    S = spread @ np.kron(np.eye(n - 1), Q) @ spread.T + np.kron(np.eye(n), R)
    W = gramians.information(F, H, Q, R, n)
    np.testing.assert_allclose(W[-1], shown.T @ np.linalg.solve(S, shown), rtol=1e-9)
    for before, after in pairwise(W):  # what is learned is never lost
        assert np.linalg.eigvalsh(after - before)[0] > -1e-9


def test_reachable_is_the_sum_of_all_noises() -> None:
    rng = np.random.default_rng(0)
    F, root = rng.normal(size=(3, 3)), rng.normal(size=(3, 1))
    powers = [np.linalg.matrix_power(F, k) @ root for k in range(4)]
    for n, P in enumerate(gramians.reachable(F, root @ root.T, 4), start=1):
        np.testing.assert_allclose(P, sum(p @ p.T for p in powers[:n]), rtol=1e-12)


def test_a_width_of_bounded_noise_is_that_of_all_vertices() -> None:
    # two measurements of a position: |d_1| <= 2 b_v and |d_1 + d_2 + e| <= 2 b_v, |e| <= 2 b_w
    w, v, H = np.array([0.2, 0.1]), np.array([1.0]), np.array([[1.0, 0.0]])
    open_, closed = np.array([[0.0, 1.0]]), np.zeros((0, 2))
    np.testing.assert_allclose(gramians.bounded_widths(WALK, H, w, v, 1, open_), [1.0, np.inf])
    np.testing.assert_allclose(gramians.bounded_widths(WALK, H, w, v, 2, closed), [1.0, 2.2])
    assert gramians.can_differ(WALK, H, w, v, 2, np.array([1.0, -2.2]))
    assert not gramians.can_differ(WALK, H, w, v, 2, np.array([0.9, -2.2]))


def test_ways_of_bounded_noise_are_those_between_its_vertices() -> None:
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 0.5])
    corners = [[a, b, c, d] for a in (-1, 1) for b in (0, 0.5) for c in (-1, 1) for d in (0, 0.5)]
    ends = np.array([WALK @ [a, b] + [c, d] for a, b, c, d in corners])
    for end in ends:
        assert gramians.can_reach(WALK, low, high, 2, end)
        center = ends.mean(axis=0)
        outmost = np.abs(end - center).sum() == np.abs(ends - center).sum(axis=1).max()
        assert not (outmost and gramians.can_reach(WALK, low, high, 2, center + 1.01 * (end - center)))


RUNAWAY = np.diag([1e6, 1.0])

CALLS = {
    "reachable": lambda: gramians.reachable(RUNAWAY, np.eye(2), 2000),
    "information": lambda: gramians.information(RUNAWAY, np.eye(2), np.zeros((2, 2)), np.eye(2), 2000),
}


@pytest.mark.parametrize("name", CALLS)
def test_numbers_that_run_away_are_told(name) -> None:
    with pytest.raises(NumericalRangeError, match="n: got 2000"):
        CALLS[name]()

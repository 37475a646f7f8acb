"""The condition of exact filtering: what it looks at, and that it depends on no units."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import SwitchChain
from fuzzykf.switching.dynamics.exactness import corrected, feedback, judged, mixed_regimes

rng = np.random.default_rng(0)
T = np.array([[0.7, 0.3], [0.4, 0.6]])


def noises(K, d):
    root = rng.normal(size=(K, d, d)) + np.eye(d)
    return root @ np.swapaxes(root, -1, -2)


def model(kind, m=2, q=2, K=2):
    """A and noise of a model of a kind, m >= 2."""
    A, noise = rng.normal(size=(K, m + q, m + q)), noises(K, m + q)
    if kind == "no feedback":
        A[:, m:, :m] = 0.0
    if kind in ("slaved", "constant gain"):  # X' = ... + M Y', and nothing of X beside it
        M, _ = corrected(A, noise, m)
        A[:, :m, :m] = M @ A[:, m:, :m]
    if kind == "constant gain":
        A[:, :m, m:] = M @ A[:, m:, m:]
    if kind == "part":  # only X_1 acts on what is seen, and nothing stays of it
        A[:, m:, 1:m] = 0.0
        M, Abar = corrected(A, noise, m)
        A[:, 0, :m] -= Abar[:, 0]
    return A, noise


@pytest.mark.parametrize("kind", ["no feedback", "slaved", "constant gain", "part"])
@pytest.mark.parametrize("units", [1.0, 1e8, 1e-8])
def test_the_families_of_exact_models_whatever_the_units(kind, units):
    A, noise = model(kind)
    s = np.array([1.0, units, 1.0, 1.0 / units])
    A, noise = A * s[:, None] / s, noise * s[:, None] * s
    assert feedback(A, noise, 2).max() < 1e-13
    found = judged(A, noise, 2, SwitchChain.from_classes(T))
    assert found.holds
    assert found.words.startswith("exact: ")


@pytest.mark.parametrize("units", [1.0, 1e8, 1e-8])
def test_what_is_missed_is_a_share_that_no_unit_changes(units):
    A, noise = np.zeros((2, 2, 2)), np.tile(np.eye(2), (2, 1, 1))
    A[0] = [[0.5, 0.1], [0.0, 0.3]]
    A[1] = [[0.0, 0.1], [2.0, 0.3]]
    s = np.array([units, 1.0])
    # the state passes regime 0 and is seen on the way to 1; what regime 1 is told of it stays there
    expected = [[0.0, 1.0], [0.0, 0.0]]
    A, noise = A * s[:, None] / s, noise * s[:, None] * s
    np.testing.assert_allclose(feedback(A, noise, 1), expected, atol=1e-14)
    found = judged(A, noise, 1, SwitchChain.from_classes(T))
    assert not found.holds
    assert found.words.endswith("is off by 1 of |A_yx| |Abar| for j = 0 and k = 1")


def test_a_small_miss_is_one():
    A, noise = model("slaved", m=2)
    A[1, 0, 0] += 1e-6
    found = judged(A, noise, 2, SwitchChain.from_classes(T))
    assert not found.holds
    assert "for j = 1 and k = " in found.words


@pytest.mark.parametrize(
    ("transition", "initial", "expected"),
    [
        ([[1.0]], None, [False]),
        (T, None, [True, True]),
        (np.eye(3), [0.2, 0.3, 0.5], [False] * 3),  # a bank of filters that never mix
        ([[0, 1], [1, 0]], [0.4, 0.6], [False] * 2),  # in turn
        ([[0.5, 0.5], [0, 1]], [1, 0], [False, True]),  # of 1 nobody knows how long it has been
        ([[1, 0], [0.5, 0.5]], [1, 0], [False] * 2),  # 1 is never there
        ([[0, 0.5, 0.5, 0], [0, 0, 0, 1], [0, 0, 0, 1], [1, 0, 0, 0]], [1, 0, 0, 0], [True] * 4),
    ],
)
def test_where_histories_meet(transition, initial, expected):
    np.testing.assert_array_equal(mixed_regimes(SwitchChain.from_classes(transition, initial)), expected)


def test_only_pairs_that_can_follow_one_another_are_asked():
    A, noise = np.zeros((3, 2, 2)), np.tile(np.eye(2), (3, 1, 1))
    A[0], A[1], A[2] = [[0.5, 0.0], [0.0, 0.0]], [[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]]
    # the only pair that misses is (0, 1)
    may, may_not = np.full((3, 3), 1 / 3), np.array([[0.5, 0.0, 0.5], [0.3, 0.3, 0.4], [0.3, 0.3, 0.4]])
    assert not judged(A, noise, 1, SwitchChain.from_classes(may)).holds
    assert judged(A, noise, 1, SwitchChain.from_classes(may_not)).holds


def test_one_regime_needs_no_condition():
    found = judged(*model("any", K=1), 2, SwitchChain.from_classes([[1.0]]))
    assert found == (True, "exact: a single regime, which the Kalman filter serves")

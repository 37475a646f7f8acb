"""Fade laws: their chains against the definition and reference numbers, their durations, samples, errors."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import FadeLaw, SwitchChain
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.registry import LAWS

RING = FadeLaw(
    4,
    {(0, 1): (1 / 20, 10), (1, 2): (1 / 30, 8), (2, 3): (1 / 15, 12), (3, 0): (1 / 25, 6)},
    jumps={(0, 2): 0.002},
)
TURNING = FadeLaw(
    3,
    {(0, 1): (0.04, 9), (1, 0): (0.0, 6.5), (1, 2): (0.1, 7), (2, 1): (0.03, 12)},
    jumps={(2, 0): 0.01, (1, 0): 0.02},
    turn_back=0.15,
)
LAWS_HERE = {
    "between": FadeLaw.between(40, 10),
    "jumps and turns": FadeLaw.between(30, 8, jump=0.01, turn_back=0.1),
    "uneven": FadeLaw(2, {(0, 1): (0.1, 7), (1, 0): (0.02, 20)}),
    "ring": RING,
    "turning": TURNING,
}


@pytest.fixture(params=LAWS_HERE)
def law(request):
    return LAWS_HERE[request.param]


def by_definition(law, F):
    """States (class, or pair and k) and the probabilities of each arrow, one by one."""
    states = [*range(law.n_classes), *((pair, k) for pair in law.fades for k in range(1, F + 1))]
    P = {(s, t): 0.0 for s in states for t in states}
    for (a, b), (rate, length) in law.fades.items():
        P[a, ((a, b), 1)] += rate
        for k in range(1, F + 1):
            P[((a, b), k), ((a, b), k + 1) if k < F else b] += F / length
            if law.turn_back:
                P[((a, b), k), ((b, a), F + 1 - k)] += law.turn_back
    for (a, b), p in law.jumps.items():
        P[a, b] += p
    for s in states:
        P[s, s] += 1.0 - sum(P[s, t] for t in states)
    return states, np.array([[P[s, t] for t in states] for s in states])


# --------------------------------------------------------------------------- the chain


@pytest.mark.parametrize("F", [1, 3, 5])
def test_the_chain_is_that_of_the_definition(law, F) -> None:
    chain = law.discretize(F)
    states, P = by_definition(law, F)
    K = law.n_classes
    assert isinstance(chain, SwitchChain)
    np.testing.assert_allclose(chain.transition, P, atol=1e-15)
    np.testing.assert_allclose(chain.initial @ P, chain.initial, atol=1e-15)
    np.testing.assert_allclose(chain.weights, [1.0 if isinstance(s, int) else 1.0 / F for s in states])
    for state, weights in zip(states, chain.class_weights, strict=True):
        expected = np.eye(K)[state] if isinstance(state, int) else np.zeros(K)
        if not isinstance(state, int):
            (a, b), k = state
            t = (k - 0.5) / F
            expected[a], expected[b] = 1 - t, t
        np.testing.assert_allclose(weights, expected, atol=1e-15)
    np.testing.assert_array_equal(chain.nodes, chain.class_weights[:, 1] if K == 2 else chain.class_weights)
    np.testing.assert_array_equal(chain.atoms, np.arange(len(chain)) < K)


def test_reference_numbers_of_a_ring() -> None:
    chain = RING.discretize(5)
    assert len(chain) == 24
    assert (chain.transition > 0.0).sum() == 49
    np.testing.assert_allclose(chain.initial[:4], [0.15586035, 0.23379052, 0.12157107, 0.20261845], atol=6e-9)
    fades = chain.initial[4:].reshape(4, 5)
    np.testing.assert_allclose(fades.sum(axis=1), [0.07793017, 0.06234414, 0.09725686, 0.04862843], atol=6e-9)
    np.testing.assert_allclose(fades, fades[:, :1].repeat(5, axis=1), rtol=1e-12)
    # pi(ab) = pi_a rate length
    shares = chain.initial[:4] * [10 / 20, 8 / 30, 12 / 15, 6 / 25]
    np.testing.assert_allclose(fades.sum(axis=1), shares, rtol=1e-12)


def test_reference_numbers_of_two_classes() -> None:
    law = FadeLaw.between(40, 10)
    chain = law.discretize(5)
    assert (chain.transition > 0.0).sum() == 24
    np.testing.assert_allclose(chain.initial, [0.4, 0.4, *[0.02] * 10], rtol=1e-12)
    assert law.fade_lengths(5)[0, 1] == pytest.approx((10.0, 3.1623), abs=5e-5)
    for turn_back in (0.0, 0.1, 0.5):
        turning = FadeLaw.between(40, 10, turn_back=turn_back)
        assert turning.p_hard == pytest.approx(0.8, rel=1e-12)
        np.testing.assert_allclose(turning.mean_dwell(), 40.0, rtol=1e-12)
        assert turning.mean_fade() == pytest.approx(10.0, rel=1e-12)
    np.testing.assert_allclose(law.harden(), [[0.49, 0.01], [0.01, 0.49]], rtol=1e-12)


@pytest.mark.parametrize("F", [2, 5, 8])
def test_durations_without_turning(F) -> None:
    law = FadeLaw(2, {(0, 1): (0.1, 8), (1, 0): (0.02, 20)}, jumps={(0, 1): 0.025})
    for pair, length in (((0, 1), 8), ((1, 0), 20)):
        expected = (length, np.sqrt(F * (1 - F / length)) * length / F)
        assert law.fade_lengths(F)[pair] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(law.mean_dwell(F), [8.0, 50.0], rtol=1e-12)
    # fades by how often they begin: as often to and fro, but for the jumps
    assert law.mean_fade(F) == pytest.approx((0.8 * 8 + 1.0 * 20) / 1.8, rel=1e-12)


def test_a_fade_as_long_as_it_has_cells_is_determined() -> None:
    law = FadeLaw.between(6, 4)
    assert law.fade_lengths(4) == {(0, 1): (4.0, 0.0), (1, 0): (4.0, 0.0)}
    r = law.sample(400, np.random.default_rng(1), n_nodes=4)
    cells = r.reshape(-1)
    for k in np.flatnonzero((cells[:-1] == 0.0) & (cells[1:] > 0.0)):
        np.testing.assert_array_equal(cells[k + 1 : k + 6], [*((np.arange(4) + 0.5) / 4), 1.0][: 399 - k])


def test_rate_zero_is_the_hard_chain() -> None:
    fades = {(a, b): (0.0, 6) for a in range(3) for b in range(3) if a != b}
    jumps = {(0, 1): 0.1, (1, 2): 0.2, (2, 0): 0.05, (2, 1): 0.1}
    for turn_back in (0.0, 0.1):
        law = FadeLaw(3, fades, jumps=jumps, turn_back=turn_back)
        chain = law.discretize(5)
        P = np.array([[0.9, 0.1, 0.0], [0.0, 0.8, 0.2], [0.05, 0.1, 0.85]])
        hard = SwitchChain.from_classes(P)
        np.testing.assert_allclose(chain.transition[:3, :3], P, rtol=1e-15)
        np.testing.assert_allclose(chain.initial, [*hard.initial, *[0.0] * 30], atol=1e-14)
        np.testing.assert_allclose(law.harden(), hard.initial[:, None] * P, atol=1e-14)
        assert law.p_hard == 1.0
        assert np.isnan(law.mean_fade())
    np.testing.assert_allclose(FadeLaw(3, {}, jumps=jumps).discretize(5).transition, P, rtol=1e-15)
    # and without cells fades are jumps
    np.testing.assert_allclose(FadeLaw.between(20, 5).discretize(0).transition, [[0.95, 0.05], [0.05, 0.95]])


def test_fades_that_are_seldom_keep_their_digits() -> None:
    law = FadeLaw(2, {(0, 1): (3e-13, 10), (1, 0): (1e-13, 20)})
    np.testing.assert_allclose(law.discretize(5).initial[:2], [0.25, 0.75], rtol=1e-11)
    np.testing.assert_allclose(law.mean_dwell(), [1 / 3e-13, 1 / 1e-13], rtol=1e-12)
    assert law.mean_fade() == pytest.approx(15.0, rel=1e-9)
    for turn_back in (0.0, 1e-13):
        long = FadeLaw.between(3e13, 1e13, turn_back=turn_back)
        assert long.p_hard == pytest.approx(0.75, rel=1e-12)
        assert long.fade_lengths()[0, 1].mean == pytest.approx(1e13, rel=1e-12)


def test_a_class_that_is_left_for_ever_has_no_mass() -> None:
    law = FadeLaw(3, {(0, 1): (0.1, 5), (1, 2): (0.2, 5), (2, 1): (0.2, 5)})
    chain = law.discretize(5)
    np.testing.assert_array_equal(chain.initial[[0, *range(3, 8)]], 0.0)
    dwell = law.mean_dwell()
    assert np.isnan(dwell[0])
    np.testing.assert_allclose(dwell[1:], 5.0, rtol=1e-12)


def test_the_middle_cell_is_of_the_class_that_is_left() -> None:
    # so no pair of regimes is invented: what goes from 0 to 1 is what begins a fade, or jumps
    for law in (FadeLaw.between(40, 10, jump=0.005), FadeLaw(2, {(0, 1): (0.1, 7), (1, 0): (0.02, 20)})):
        for F in (1, 2, 5, 6):
            chain, joint = law.discretize(F), law.harden(F)
            begun = chain.initial[:2] * [
                sum(law.fades[p][:1]) + law.jumps.get(p, 0.0) for p in ((0, 1), (1, 0))
            ]
            np.testing.assert_allclose([joint[0, 1], joint[1, 0]], begun, rtol=1e-12)
            assert joint.sum() == pytest.approx(1.0)


# --------------------------------------------------------------------------- samples against the chain


@pytest.mark.parametrize("F", [None, 2])
def test_samples_follow_the_chain(law, F) -> None:
    drawn = law.sample(60_000, np.random.default_rng(3), n_nodes=F)
    chain = law.discretize(5 if F is None else F)
    rows = drawn.reshape(len(drawn), -1)
    values, inverse = np.unique(chain.nodes.reshape(len(chain), -1), axis=0, return_inverse=True)
    number = (np.abs(rows[:, None] - values).max(axis=2) == 0.0).argmax(axis=1)
    np.testing.assert_array_equal(values[number], rows)
    # what follows each value, directions summed, and how long it is there
    to_value = np.eye(len(values))[inverse.reshape(-1)]
    joint = to_value.T @ (chain.initial[:, None] * chain.transition) @ to_value
    seen = np.zeros_like(joint)
    np.add.at(seen, (number[:-1], number[1:]), 1.0)
    visits = seen.sum(axis=1, keepdims=True)
    assert visits.min() > 300
    assert (seen[joint < 1e-14] == 0.0).all()
    np.testing.assert_allclose(seen / visits, joint / joint.sum(axis=1, keepdims=True), atol=0.06)
    np.testing.assert_allclose(visits[:, 0] / len(drawn), joint.sum(axis=1), atol=0.03)


def test_samples_have_the_durations() -> None:
    law = FadeLaw.between(12, 10)
    r = law.sample(60_000, np.random.default_rng(5))
    hard = np.isin(r, (0.0, 1.0))
    change = np.flatnonzero(np.diff(hard.astype(int)))
    lengths, kinds = np.diff(change), hard[change[:-1] + 1]
    assert lengths[kinds].mean() == pytest.approx(law.mean_dwell()[0], rel=0.05)
    assert lengths[~kinds].mean() == pytest.approx(law.mean_fade(), rel=0.05)
    assert lengths[~kinds].std() == pytest.approx(law.fade_lengths()[0, 1].std, rel=0.05)


@pytest.mark.parametrize(
    ("law", "cells"),
    [
        (FadeLaw.between(40, 10), 5),
        (FadeLaw.between(40, 5), 5),
        (FadeLaw.between(40, 3.7), 3),
        (FadeLaw(2, {(0, 1): (0.1, 20), (1, 0): (0.1, 4)}), 4),
        (FadeLaw.between(40, 1), 1),
        (FadeLaw.between(40, 10, turn_back=0.7), 3),
        (FadeLaw.between(40, 10, turn_back=0.9), 1),
    ],
)
def test_number_of_cells_by_default(law, cells) -> None:
    assert law.nodes_up_to(5) == cells
    seen = set(law.sample(3000, np.random.default_rng(0)))
    assert seen == set(law.discretize(cells).nodes)
    np.testing.assert_array_equal(law.harden(), law.harden(cells))
    with pytest.raises(ParameterError, match=f"n_nodes={max(cells, law.nodes_up_to(21))} at most"):
        law.discretize(21)


# --------------------------------------------------------------------------- symmetries


def relabelled(law, order):
    """The law in which class a has the name order[a]."""
    fades = {(order[a], order[b]): values for (a, b), values in law.fades.items()}
    jumps = {(order[a], order[b]): p for (a, b), p in law.jumps.items()}
    return FadeLaw(law.n_classes, fades, jumps=jumps, turn_back=law.turn_back)


@st.composite
def fade_laws(draw):
    K = draw(st.integers(2, 4))
    rates, lengths = st.floats(0.001, 0.15), st.floats(6.0, 50.0)
    chosen = draw(st.sets(st.sampled_from([(a, b) for a in range(K) for b in range(a)]), min_size=1))
    fades = {p: (draw(rates), draw(lengths)) for a, b in sorted(chosen) for p in ((a, b), (b, a))}
    jumps = {(a, (a + 1) % K): draw(rates) for a in range(K)}
    return FadeLaw(K, fades, jumps=jumps, turn_back=draw(st.sampled_from([0.0, 0.1])))


@settings(max_examples=20, deadline=None)
@given(law=fade_laws(), data=st.data())
def test_other_names_of_the_classes_mirror_everything(law, data) -> None:
    K, F = law.n_classes, data.draw(st.integers(0, 5))
    order = data.draw(st.permutations(range(K)))
    chain, other = law.discretize(F), relabelled(law, order).discretize(F)
    at = np.concatenate([order, np.arange(K, len(chain))])  # the fades stay in their order
    np.testing.assert_allclose(other.initial[at], chain.initial, atol=1e-13)
    np.testing.assert_allclose(other.transition[np.ix_(at, at)], chain.transition, atol=1e-15)
    np.testing.assert_array_equal(other.class_weights[np.ix_(at, order)], chain.class_weights)
    new = np.ix_(order, order)
    np.testing.assert_allclose(relabelled(law, order).harden()[new], law.harden(), atol=1e-13)
    np.testing.assert_allclose(relabelled(law, order).mean_dwell()[order], law.mean_dwell(), rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(law=fade_laws(), F=st.integers(1, 5))
def test_every_law_is_a_stationary_chain(law, F) -> None:
    chain = law.discretize(F)
    np.testing.assert_allclose(chain.initial @ chain.transition, chain.initial, atol=1e-13)
    assert (chain.initial >= 0.0).all()
    assert (chain.transition >= 0.0).all()
    if not law.turn_back:
        for length, (_, expected) in zip(law.fade_lengths(F).values(), law.fades.values(), strict=True):
            assert length.mean == pytest.approx(expected, rel=1e-9)


# --------------------------------------------------------------------------- values, files, errors


def test_files_copies_and_reprs(law) -> None:
    again = LAWS["fade"].from_dict(json.loads(json.dumps(law.to_dict())))
    for one in (again, pickle.loads(pickle.dumps(law))):
        assert one.parameters == law.parameters
        np.testing.assert_array_equal(one.discretize(3).transition, law.discretize(3).transition)
    with pytest.raises(AttributeError):
        law.turn_back = 0.5
    law.fades.clear()  # a copy
    assert law.fades == again.fades
    assert repr(law).startswith(f"FadeLaw({law.n_classes}, {{(0, 1): (")


def test_repr() -> None:
    assert repr(FadeLaw.between(40, 10)) == "FadeLaw(2, {(0, 1): (0.025, 10.0), (1, 0): (0.025, 10.0)})"
    law = FadeLaw.between(40, 10, jump=0.005, turn_back=0.1)
    assert repr(law).endswith(", jumps={(0, 1): 0.005, (1, 0): 0.005}, turn_back=0.1)")


BOTH = {(0, 1): (0.1, 5), (1, 0): (0.1, 5)}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FadeLaw(1, {}), "n_classes: got 1, expected a whole number of at least 2"),
        (
            lambda: FadeLaw(2, [(0, 1)]),
            r"fades: got \[\(0, 1\)\], expected a mapping \{\(a, b\): \(rate, mean_len",
        ),
        (lambda: FadeLaw(2, {(0, 2): (0.1, 5)}), r"fades: got \(0, 2\), expected a pair .* among 0 to 1"),
        (lambda: FadeLaw(2, {(1, 1): (0.1, 5)}), r"fades: got \(1, 1\), expected a pair"),
        (lambda: FadeLaw(2, {"01": (0.1, 5)}), r"fades: got '01', expected a pair"),
        (
            lambda: FadeLaw(2, {(0, 1): 0.1}),
            r"fades\[\(0, 1\)\]: got 0.1, expected a pair \(rate, mean_length\)",
        ),
        (
            lambda: FadeLaw(2, {(0, 1): (1.5, 5)}),
            r"fades\[\(0, 1\)\], rate: got 1.5, expected a probability in",
        ),
        (
            lambda: FadeLaw(2, {(0, 1): (np.nan, 5)}),
            r"fades\[\(0, 1\)\], rate: got nan, expected a probability in",
        ),
        (
            lambda: FadeLaw(2, {(0, 1): (0.1, 0.5)}),
            r"\(0, 1\)\], mean length: got 0.5, expected a finite number",
        ),
        (
            lambda: FadeLaw(2, {(0, 1): (0.1, np.inf)}),
            "mean length: got inf, expected a finite number of steps",
        ),
        (
            lambda: FadeLaw(2, BOTH, jumps={(0, 1): -0.1}),
            r"jumps\[\(0, 1\)\]: got -0.1, expected a probability in",
        ),
        (
            lambda: FadeLaw(2, BOTH, jumps=[1]),
            r"jumps: got \[1\], expected a mapping \{\(a, b\): probability\}",
        ),
        (
            lambda: FadeLaw(3, {(0, 1): (0.7, 5), (1, 0): (0.1, 5), (2, 0): (0.1, 4)}, jumps={(0, 2): 0.5}),
            "rates that sum to 0.7 and jumps that sum to 0.5 from class 0, together 1.2; expected at most 1",
        ),
        (
            lambda: FadeLaw(2, {(0, 1): (0.1, 5)}, jumps={(1, 0): 0.1}, turn_back=0.1),
            r"turn_back: got 0.1, but the fade \(0, 1\) has no fade \(1, 0\) to turn to; expected 0, or",
        ),
        (
            lambda: FadeLaw.between(40, 4, turn_back=0.8),
            r"turn_back: got 0.8, expected at most 0.75 for the fade",
        ),
        (lambda: FadeLaw.between(40, 4, turn_back=1.2), "turn_back: got 1.2, expected a probability"),
        (
            lambda: FadeLaw(2, {}),
            r"several parts that are never left, the classes \[0\] and \[1\]; expected ways",
        ),
        (
            lambda: FadeLaw(4, {**BOTH, (2, 3): (0.1, 5), (3, 2): (0.1, 5)}),
            r"fades, jumps: got several parts that are never left, the classes \[0, 1\] and \[2, 3\]",
        ),
        (lambda: FadeLaw.between(0.5, 4), "dwell: got 0.5, expected a finite number of steps, at least 1"),
        (lambda: FadeLaw.between(40, 0), "length: got 0, expected a finite number of steps, at least 1"),
        (lambda: FadeLaw.between(40, 4, jump=0.1), r"jump: got 0.1, expected at most 0.025, 1 / dwell"),
        (
            lambda: FadeLaw.between(20, 3).discretize(5),
            r"n_nodes: got 5, expected n_nodes=3 at most for fade \(0, 1\) of length 3$",
        ),
        (
            lambda: FadeLaw.between(20, 3, turn_back=0.5).sample(5, np.random.default_rng(0), n_nodes=2),
            r"n_nodes=1 at most for fade \(0, 1\) of length 3 that turns back with 0.5 a step",
        ),
        (
            lambda: FadeLaw.between(20, 3).discretize(-1),
            "n_nodes: got -1, expected a whole number of at least 0",
        ),
        (lambda: FadeLaw.between(20, 3).harden(1.5), "n_nodes: got 1.5, expected a whole number"),
        (
            lambda: FadeLaw.between(20, 3000).discretize(600),
            "n_nodes: got 600 for each of 2 edges or fades, expected at most 500",
        ),
        (lambda: FadeLaw.between(20, 3).discretize(3, "gauss"), "rule: got 'gauss', expected 'cell'"),
        (lambda: FadeLaw.between(20, 3).sample(3, 0), "rng: got int, expected a numpy.random.Generator"),
        (lambda: FadeLaw.between(20, 3).sample(-1, np.random.default_rng(0)), "n: got -1"),
    ],
)
def test_what_is_wrong_is_said(make, message) -> None:
    with pytest.raises(ParameterError, match=message):
        make()

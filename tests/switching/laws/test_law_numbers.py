"""Free numbers of laws: any vector is a law, and derivatives are those of the chain that it is put on."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw, FuzzyMarkovLaw, GraphLaw, SwitchChain
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.base import ParametricLaw
from fuzzykf.switching.laws.cells import CellLaw
from fuzzykf.switching.laws.chains import ChainLaw
from fuzzykf.switching.laws.fmc1 import FMC1
from fuzzykf.switching.laws.law_numbers import ByTables, ChainNumbers

NODES = 2

RING = [[0.9, 0.1, 0.0], [0.0, 0.8, 0.2], [0.3, 0.0, 0.7]]

LAWS = {
    "between": FadeLaw.between(20.0, 6.0),
    "fades": FadeLaw(
        3,
        {(0, 1): (0.1, 5.0), (1, 0): (0.05, 4.0), (1, 2): (0.1, 6.0), (2, 1): (0.2, 7.0)},
        jumps={(2, 0): 0.05, (0, 2): 0.1},
        turn_back=0.1,
    ),
    "a fade back without a rate": FadeLaw(2, {(0, 1): (0.1, 5.0), (1, 0): (0.0, 4.0)}, turn_back=0.1),
    "jumps": FadeLaw(2, {}, jumps={(0, 1): 0.1, (1, 0): 0.3}),
    "fmc1": FuzzyMarkovLaw.fmc1(0.25, 0.05, 0.08),
    "fmc2": FuzzyMarkovLaw.fmc2(0.15, 0.5, 0.23),
    "graph": GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.5, (1, 2): 0.5}, jumps={(0, 2): 0.1}),
    "bands": GraphLaw.from_masses(
        [3, 3, 2],
        {(0, 1): 1.5, (1, 2): 1.0},
        family="band",
        shape=0.22,
        crossings={((0, 1), (1, 2)): (0.01, 0.21)},
    ),
    "chain": ChainLaw(FadeLaw.between(20.0, 6.0).discretize(NODES)),
    "cells": CellLaw(FuzzyMarkovLaw.fmc1(0.25, 0.05, 0.08).discretize(NODES).transition),
    "ring": ChainLaw(SwitchChain.from_classes(RING)),
    "ring, begun anywhere": ChainLaw(SwitchChain.from_classes(RING, [0.2, 0.5, 0.3])),
    "never stays": ChainLaw(SwitchChain.from_classes([[0.0, 0.4, 0.6], [0.5, 0.0, 0.5], [1.0, 0.0, 0.0]])),
}

every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def somewhere(free):
    return free.start + 0.3 * np.random.default_rng(3).normal(size=len(free.names))


@every_law
def test_it_begins_at_the_law(law):
    free = law.free_numbers(NODES)
    begun, given = free.value(free.start).discretize(NODES), law.discretize(NODES)
    np.testing.assert_allclose(begun.transition, given.transition, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(begun.initial, given.initial, rtol=0.0, atol=1e-9)


@every_law
def test_derivatives_are_those_of_differences(law):
    free = law.free_numbers(NODES)
    numbers, rng = somewhere(free), np.random.default_rng(1)
    chain = free.value(numbers).discretize(NODES)
    by = ByTables(chain, rng.normal(size=len(chain)), rng.normal(size=(len(chain),) * 2))

    def value(at):
        chain = free.value(at).discretize(NODES)
        return chain.initial @ by.initial + (chain.transition * by.transition).sum()

    for k, exact in enumerate(free.gradient(numbers, by)):
        step = 1e-4 * np.eye(len(numbers))[k]
        slope = (value(numbers + step) - value(numbers - step)) / 2e-4
        assert exact == pytest.approx(slope, rel=1e-6, abs=1e-7), free.names[k]
        moved = (free.estimates(numbers + step) - free.estimates(numbers - step)) / 2e-4
        np.testing.assert_allclose(free.jacobian(numbers)[:, k], moved, rtol=1e-5, atol=1e-8)


@every_law
def test_as_many_estimates_as_numbers(law):
    free = law.free_numbers(NODES)
    shapes = [np.shape(getattr(free, name)) for name in ("start", "spread", "is_variance", "is_positive")]
    assert shapes == [(len(free.names),)] * 4
    assert free.estimates(free.start).shape == (len(free.names),)
    assert len(set(free.names)) == len(free.names)
    assert np.linalg.matrix_rank(free.jacobian(somewhere(free))) == len(free.names)


@pytest.mark.parametrize(
    ("law", "estimates"),
    [
        (
            LAWS["between"],
            {"rate 0 to 1": 0.05, "rate 1 to 0": 0.05, "length 0 to 1": 6.0, "length 1 to 0": 6.0},
        ),
        (LAWS["fmc1"], {"beta": LAWS["fmc1"].beta, "eta": 0.08, "delta": 0.05}),
        (LAWS["fmc2"], {"beta": LAWS["fmc2"].beta, "gamma": 0.5, "delta": 0.23}),
        (LAWS["ring"], {"p(0, 1)": 0.1, "p(1, 2)": 0.2, "p(2, 0)": 0.3}),
    ],
)
def test_estimates_are_on_the_scale_of_the_law(law, estimates):
    free = law.free_numbers(NODES)
    found = dict(zip(free.names, free.estimates(free.start).tolist(), strict=True))
    assert found == pytest.approx(estimates, rel=1e-12)


@every_law
def test_what_may_be_zero_is_at_minus_infinity(law):
    """Each such number may be sent there by itself; the law has nothing of it, and is a law or refused."""
    free = law.free_numbers(NODES)
    for k in np.flatnonzero(free.is_variance):
        if law is LAWS["a fade back without a rate"]:  # it would leave the classes for ever
            continue
        numbers = free.start.copy()
        numbers[k] = -np.inf
        assert free.estimates(numbers)[k] == 0.0
        assert np.isfinite(free.estimates(numbers)).all()
        chain = free.value(numbers).discretize(NODES)
        gradient = free.gradient(numbers, ByTables(chain, chain.initial, chain.transition))
        assert gradient[k] == 0.0
        assert np.isfinite(gradient).all()


def test_what_happens_at_no_rate_is_impossible():
    free = LAWS["fades"].free_numbers(NODES)
    numbers = np.where(np.array(free.names) == "jump 0 to 2", -np.inf, free.start)
    assert free.is_variance[free.names.index("jump 0 to 2")]
    law = free.value(numbers)
    assert law.jumps[0, 2] == 0.0
    assert law.jumps[2, 0] == pytest.approx(0.05)


def test_a_family_of_its_own_is_learned_by_its_logits():
    class Own(FMC1):
        n_shares = 0
        estimates_of = ParametricLaw.estimates_of

    free = Own(0.25, 0.05, 0.08).free_numbers(NODES)
    assert free.names == ("logit 0", "logit 1", "logit 2")
    np.testing.assert_allclose(free.estimates(free.start), free.start, rtol=1e-12)
    np.testing.assert_allclose(free.jacobian(free.start), np.eye(3), atol=1e-9)
    assert not free.is_variance.any()
    assert not free.is_positive.any()


def test_what_never_turns_back_has_no_turning():
    free = LAWS["fades"].free_numbers(NODES)
    law = free.value(np.where(np.array(free.names) == "turn_back", -np.inf, free.start))
    assert law.turn_back == 0.0
    assert law.fades[0, 1] == pytest.approx((0.1, 4.5))  # as often on as before, and never back


def test_a_search_begins_inside_of_the_bounds():
    free = FadeLaw.between(1.0, 2.0).free_numbers(2)  # no waiting anywhere
    assert np.isfinite(free.start).all()
    law = free.value(free.start)
    assert law.fades[0, 1] == pytest.approx((1.0 / 1.1, 2.0 / 0.9))


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda: LAWS["between"].free_numbers(0), "n_nodes: got 0, expected at least 1"),
        (lambda: LAWS["between"].free_numbers(7), "n_nodes: got 7, expected n_nodes=6 at most"),
        (lambda: ChainNumbers(SwitchChain.from_classes([[1.0]])), "nothing that could be free"),
        (
            lambda: FuzzyMarkovLaw.from_density(
                [[0.2, 0.05], [0.05, 0.2]], 0.1, lambda r1, r2: 0.1 + 0.0 * r1 * r2
            ).free_numbers(2),
            "kind 'from_density', which cannot be learned",
        ),
    ],
)
def test_what_cannot_be_learned_is_refused(ask, message):
    with pytest.raises(ParameterError, match=message):
        ask()

"""Forward-backward recursion against the enumeration of all paths."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf.engine.numpy import hidden_markov


def enumerate_all(first, transition, log_emission):
    """Posterior of states and pairs, and the log-likelihood, by summing over all paths."""
    T, M = len(log_emission), first.size
    paths = np.array(list(itertools.product(range(M), repeat=T + 1)))
    with np.errstate(divide="ignore"):
        log_w = np.log(first[paths[:, 0]])
        for n in range(T):
            i, j = paths[:, n], paths[:, n + 1]
            log_w = log_w + np.log(transition[i, j]) + log_emission[n, i, j]
    top = log_w.max()
    w = np.exp(log_w - top)
    gamma, xi = np.zeros((T + 1, M)), np.zeros((T, M, M))
    for n in range(T + 1):
        np.add.at(gamma[n], paths[:, n], w / w.sum())
    for n in range(T):
        np.add.at(xi[n], (paths[:, n], paths[:, n + 1]), w / w.sum())
    return gamma, xi, top + np.log(w.sum())


def check(first, transition, log_emission, rtol=1e-10, atol=1e-12):
    gamma, xi, total = enumerate_all(first, transition, log_emission)
    for found in (
        hidden_markov.forward_backward(first, transition, log_emission),
        hidden_markov._in_logarithms(first, transition, log_emission),
    ):
        np.testing.assert_allclose(found[0], gamma, rtol=rtol, atol=atol)
        np.testing.assert_allclose(found[1], xi, rtol=rtol, atol=atol)
        np.testing.assert_allclose(found[2].sum(), total, rtol=1e-12, atol=1e-12)


def chain(M, seed):
    rng = np.random.default_rng(seed)
    return rng.dirichlet(np.ones(M)), rng.dirichlet(np.ones(M), M), rng


@pytest.mark.parametrize("size", [1.0, 30.0, 300.0, 3000.0])
@pytest.mark.parametrize(("M", "T"), [(1, 4), (2, 8), (3, 6), (4, 1)])
def test_any_densities(M, T, size):
    # spreads of the log-densities up to thousands: far beyond what exp() can hold
    first, transition, rng = chain(M, 1)
    check(first, transition, size * rng.normal(size=(T, M, M)))


@pytest.mark.parametrize("size", [1.0, 500.0])
def test_impossible_states_and_steps(size):
    _, transition, rng = chain(3, 2)
    transition[0] = [0.5, 0.5, 0.0]
    transition[2] = [0.0, 0.0, 1.0]
    check(np.array([1.0, 0.0, 0.0]), transition, size * rng.normal(size=(6, 3, 3)))


def test_the_likeliest_pair_is_impossible():
    # scaled by the density of a pair that cannot occur, all others underflow
    first, transition, _ = chain(3, 3)
    transition[:, 2] = 0.0
    transition /= transition.sum(axis=1, keepdims=True)
    log_emission = np.zeros((5, 3, 3))
    log_emission[2, :, 2] = 900.0
    check(first, transition, log_emission)


def test_an_impossible_state_stays_impossible():
    # the second state cannot be reached, and would explain 1,000 steps better by one nat each
    first, transition = np.array([1.0, 0.0]), np.array([[1.0, 0.0], [0.5, 0.5]])
    log_emission = np.zeros((1000, 2, 2))
    log_emission[:, :, 1] = 1.0
    gamma, xi, log_likelihood = hidden_markov.forward_backward(first, transition, log_emission)
    np.testing.assert_array_equal(gamma, np.tile([1.0, 0.0], (1001, 1)))
    np.testing.assert_allclose(xi[:, 0, 0], 1.0, rtol=1e-12)
    np.testing.assert_allclose(log_likelihood, 0.0, atol=1e-12)


def test_a_state_that_seemed_lost_comes_back():
    # e^-800 against it, then e^900 for it
    first, transition = np.array([0.5, 0.5]), np.eye(2)
    log_emission = np.zeros((3, 2, 2))
    log_emission[0, 1, 1], log_emission[2, 1, 1] = -800.0, 900.0
    gamma = hidden_markov.forward_backward(first, transition, log_emission)[0]
    np.testing.assert_allclose(gamma[:, 1], 1.0, rtol=1e-12)


def test_no_steps():
    first, transition, _ = chain(3, 4)
    gamma, xi, log_likelihood = hidden_markov.forward_backward(first, transition, np.empty((0, 3, 3)))
    np.testing.assert_array_equal(gamma, [first])
    assert xi.shape == (0, 3, 3)
    assert log_likelihood.shape == (0,)


@pytest.mark.parametrize("scale", [1.0, 400.0])
def test_long_series(scale):
    # marginals agree with one another and sum to one; likelihoods with those of a plain recursion
    first, transition, rng = chain(4, 5)
    log_emission = scale * rng.normal(size=(3000, 4, 4))
    gamma, xi, log_likelihood = hidden_markov.forward_backward(first, transition, log_emission)
    np.testing.assert_allclose(gamma.sum(axis=1), 1.0, rtol=1e-9)
    np.testing.assert_allclose(xi.sum(axis=2), gamma[:-1], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(xi.sum(axis=1), gamma[1:], rtol=1e-7, atol=1e-12)
    now = np.log(first)
    for move in log_emission:
        now = np.logaddexp.reduce(now[:, None] + np.log(transition) + move, axis=0)
    total = np.logaddexp.reduce(now)
    np.testing.assert_allclose(log_likelihood.sum(), total, rtol=1e-9)


def test_arguments_stay_as_they_were():
    first, transition, rng = chain(3, 6)
    log_emission = 200.0 * rng.normal(size=(20, 3, 3))
    before = first.copy(), transition.copy(), log_emission.copy()
    hidden_markov.forward_backward(first, transition, log_emission)
    for now, then in zip((first, transition, log_emission), before, strict=True):
        np.testing.assert_array_equal(now, then)

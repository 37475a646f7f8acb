"""The likelihood of complete data: densities of transitions, sums over paths, stretches of any length."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from fuzzykf import CGOFMSModel, FadeLaw
from fuzzykf.engine import selected as engine
from fuzzykf.switching.learning import likelihood


def test_a_transition_has_the_density_of_the_pair(hard_model):
    system, m = hard_model.placed(), 2
    z = np.random.default_rng(0).normal(size=(4, 3))
    found = likelihood.emissions(system, z[:-1], z[1:])
    pairs = system.pair_tables(0).pairs
    for n, i, j in np.ndindex(found.shape):
        Axx, H, G, c, C, Ayy, Ny, Qyy = (table[i, j] for table in pairs)
        x, y, x1, y1 = z[n, :m], z[n, m:], z[n + 1, :m], z[n + 1, m:]
        expected = multivariate_normal(Ayy @ y + Ny, Qyy).logpdf(y1)
        expected += multivariate_normal(Axx @ x + H @ y + G @ y1 + c, C).logpdf(x1)
        assert found[n, i, j] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("scale", [1.0, 400.0])
def test_a_stretch_is_the_sum_over_all_paths(scale):
    rng = np.random.default_rng(1)
    M, n = 3, 4
    log_transition, log_first = np.log(rng.dirichlet(np.ones(M), M)), rng.normal(size=M)
    log_emission = scale * rng.normal(size=(n, M, M))
    steps = likelihood.forward(log_transition, log_first, log_emission)
    for upto in range(n + 1):
        total = logsumexp(
            [
                log_first[path[0]]
                + sum(
                    log_transition[i, j] + log_emission[k, i, j]
                    for k, (i, j) in enumerate(itertools.pairwise(path))
                )
                for path in itertools.product(range(M), repeat=upto + 1)
            ]
        )
        assert steps[: upto + 1].sum() == pytest.approx(total, rel=1e-10)


@pytest.mark.parametrize("law", [FadeLaw.between(5, 4), FadeLaw.between(4, 6, jump=0.1, turn_back=0.2)])
def test_known_fades(law, fuzzy_model):
    # most pairs of nodes are impossible: their logarithms leave no NaN, and no path goes through them
    model = CGOFMSModel(law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    truth = model.simulate(5, np.random.default_rng(1), n_nodes=2)
    system = model.placed(2)
    z, P, first = np.c_[truth.x, truth.y], system.chain.transition, system.initial()
    start = [multivariate_normal(first.mean[k], first.covariance[k]).logpdf(z[0]) for k in range(len(P))]
    densities = likelihood.emissions(system, z[:-1], z[1:])
    total, visits = [], []
    for path in itertools.product(range(len(P)), repeat=len(z)):
        p = first.probability[path[0]] * np.prod([P[i, j] for i, j in itertools.pairwise(path)])
        if p > 0.0:
            terms = [densities[k, i, j] for k, (i, j) in enumerate(itertools.pairwise(path))]
            total.append(np.log(p) + start[path[0]] + sum(terms))
            visits.append(path)
    data = SimpleNamespace(
        z=z,
        further=None,
        scale=SimpleNamespace(std=1.0, mean=0.0),
        starts=np.array([0]),
        known=np.ones(len(z), dtype=bool),
        has_state=np.ones(len(z) - 1, dtype=bool),
    )
    found = likelihood.log_likelihood(system, data)
    assert found == pytest.approx(logsumexp(total), rel=1e-10)
    # and what expectation-maximisation asks: which nodes were visited
    weights = np.exp(np.array(total) - logsumexp(total))
    expected = np.array(
        [[weights @ (np.array(visits)[:, n] == k) for k in range(len(P))] for n in range(len(z))]
    )
    prior = first.probability * np.exp(np.array(start) - max(start))
    gamma, xi, _ = engine.forward_backward(prior / prior.sum(), P, densities)
    np.testing.assert_allclose(gamma, expected, atol=1e-10)
    assert (xi[:, P == 0.0] == 0.0).all()


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 11])
def test_blocks_of_a_stretch_do_not_show(n, hard_model, monkeypatch):
    system = hard_model.placed()
    z = np.random.default_rng(2).normal(size=(n, 3))
    arguments = (
        system,
        np.log(system.chain.transition),
        np.log(system.chain.initial),
        z,
        np.ones(n - 1, dtype=bool),
    )
    whole = likelihood._stretch(*arguments)
    monkeypatch.setattr(likelihood, "_CHUNK", 5)
    assert likelihood._stretch(*arguments) == pytest.approx(whole, rel=1e-12)

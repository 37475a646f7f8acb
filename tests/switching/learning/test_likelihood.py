"""The likelihood of complete data: densities of transitions, sums over paths, stretches of any length."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

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


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 11])
def test_blocks_of_a_stretch_do_not_show(n, hard_model, monkeypatch):
    system = hard_model.placed()
    z = np.random.default_rng(2).normal(size=(n, 3))
    arguments = system, np.log(system.chain.transition), np.log(system.chain.initial), z
    whole = likelihood._stretch(*arguments)
    monkeypatch.setattr(likelihood, "_CHUNK", 5)
    assert likelihood._stretch(*arguments) == pytest.approx(whole, rel=1e-12)

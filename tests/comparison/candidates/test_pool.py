"""Pools as candidates: mixtures of the candidates that they are made of."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.stats import norm

from fuzzykf.comparison import LearningPart, candidate
from fuzzykf.comparison.candidates import boosting
from fuzzykf.comparison.candidates.pool import MEMBERS


def series():
    """Return state, observation, and a part to learn on that keeps what it is told of progress."""
    rng = np.random.default_rng(0)
    r = np.arange(300) // 25 % 2
    y = np.where(r, 2.0, -2.0) + rng.normal(size=300)
    x = np.where(r, y, -y) + 0.3 * rng.normal(size=300)
    told: list[str] = []
    effort = {"n_nodes": 1, "max_iter": 3, "tolerance": 1e-2, "progress": told.append}
    return x[:, None], y[:, None], LearningPart(x=x[:200, None], y=y[:200, None], **effort), told


def test_it_is_the_mixture_of_its_members() -> None:
    x, y, part, told = series()
    pool = candidate("pool")
    learned = pool.learn(part)
    assert len(told) == pool.pieces - 1
    got = learned.restore(part.y, y[200:])
    found = [candidate(name).learn(part).restore(part.y, y[200:]) for name in MEMBERS]
    mean = np.mean([one.mean for one in found], axis=0)
    second = np.mean([one.std**2 + one.mean**2 for one in found], axis=0)
    np.testing.assert_allclose(got.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(got.std, np.sqrt(second - mean**2), rtol=1e-7)
    likelihood = np.mean([np.exp(one.log_likelihood) for one in found], axis=0)
    np.testing.assert_allclose(got.log_likelihood, np.log(likelihood), rtol=1e-9)
    assert [one in learned.description for one in MEMBERS] == [True] * 3
    assert np.shape(learned.stepper()(y[0])) == (1, 1)
    density = np.mean([np.exp(one.density.log_density(x[200:])) for one in found], axis=0)
    np.testing.assert_allclose(got.density.log_density(x[200:]), np.log(density), rtol=1e-9)


def test_half_the_pool_and_half_boosting_are_mixed_as_densities(monkeypatch) -> None:
    trees, threads = boosting._library()
    monkeypatch.setattr(boosting, "_library", lambda: (partial(trees, max_iter=5), threads))
    x, y, part, told = series()
    both = candidate("pool-boosting")
    learned = both.learn(part)
    assert len(told) == both.pieces - 2  # without times there are no products
    assert learned.at(None).description.startswith("pool-inputs: the latest observation: kept the ")
    got = learned.restore(part.y, y[200:])
    pool, trees_alone = (
        candidate(name).learn(part).restore(part.y, y[200:]) for name in ("pool-inputs", "boosting")
    )
    mean = 0.5 * (pool.mean + trees_alone.mean)
    variance = 0.5 * (pool.std**2 + trees_alone.std**2) + 0.25 * (pool.mean - trees_alone.mean) ** 2
    np.testing.assert_allclose(got.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(got.std, np.sqrt(variance), rtol=1e-9)
    normal = norm.logpdf(x[200:, 0], trees_alone.mean[:, 0], trees_alone.std[:, 0])
    expected = np.logaddexp(pool.density.log_density(x[200:]), normal) - np.log(2.0)
    np.testing.assert_allclose(got.density.log_density(x[200:]), expected, rtol=1e-9)
    assert len(learned.stepper()(y[0])) == 2

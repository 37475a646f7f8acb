"""The pool as a candidate: the mixture of the candidates that it is made of."""

from __future__ import annotations

import numpy as np

from fuzzykf.comparison import LearningPart, candidate
from fuzzykf.comparison.candidates.pool import MEMBERS


def test_it_is_the_mixture_of_its_members() -> None:
    rng = np.random.default_rng(0)
    r = np.arange(300) // 25 % 2
    y = np.where(r, 2.0, -2.0) + rng.normal(size=300)
    x = np.where(r, y, -y) + 0.3 * rng.normal(size=300)
    told: list[str] = []
    part = LearningPart(
        x=x[:200, None], y=y[:200, None], n_nodes=1, max_iter=3, tolerance=1e-2, progress=told.append
    )
    pool = candidate("pool")
    learned = pool.learn(part)
    assert len(told) == pool.pieces - 1
    got = learned.restore(part.y, y[200:, None])
    found = [candidate(name).learn(part).restore(part.y, y[200:, None]) for name in MEMBERS]
    mean = np.mean([one.mean for one in found], axis=0)
    second = np.mean([one.std**2 + one.mean**2 for one in found], axis=0)
    np.testing.assert_allclose(got.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(got.std, np.sqrt(second - mean**2), rtol=1e-7)
    likelihood = np.mean([np.exp(one.log_likelihood) for one in found], axis=0)
    np.testing.assert_allclose(got.log_likelihood, np.log(likelihood), rtol=1e-9)
    assert [one in learned.description for one in MEMBERS] == [True] * 3
    assert np.shape(learned.stepper()(y[:1])) == (1, 1)

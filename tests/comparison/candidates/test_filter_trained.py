"""Candidates that are learned for their filter: the fit they stand for, whatever is known of the switch."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel
from fuzzykf.comparison import LearningPart, candidate


@pytest.fixture(scope="module")
def series():
    rng = np.random.default_rng(0)
    n = 300
    r = np.arange(n) // 25 % 2
    x, y, slow = np.zeros((3, n))
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (2.0 if r[k] else -2.0) + rng.normal()
        slow[k] = 0.95 * slow[k - 1] + 0.2 * rng.normal()
        x[k] = (1.0 if r[k] else -1.0) * y[k] + slow[k]
    return x[:, None], y[:, None], r.astype(float)


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("name", ["hard2-filter", "fmc1-filter"])
def test_it_is_the_fit_for_the_filter(name, told, series) -> None:
    x, y, r = series
    here = LearningPart(x=x, y=y, r=r if told else None, n_nodes=1, max_iter=3, tolerance=1e-2)
    learned = candidate(name).learn(here)
    options = {"form": "regression", "max_iter": 3, "tolerance": 1e-2, "objective": "filter"}
    if name.startswith("hard"):
        fit = CGOMSModel.fit(x, y, n_regimes=2, **options)
    else:
        fit = CGOFMSModel.fit(x, y, law="fmc1", n_nodes=1, **options)
    assert learned.fit.training == fit.training
    assert f"kept the {fit.training.kept} fit (log score on the last fifth" in learned.description
    np.testing.assert_array_equal(learned.restore(y[:0], y[:80]).mean, fit.model.filter(1).filter(y[:80]).x)


def test_it_is_kept_apart_from_the_joint_fit(series) -> None:
    x, y, _ = series
    here = LearningPart(x=x, y=y, n_nodes=1, max_iter=3, tolerance=1e-2)
    one, other = (candidate(name).learn(here) for name in ("hard2-filter", "hard2"))
    assert one.fit is not other.fit
    assert other.fit.training is None

"""What takes long to find can be sent between processes: results of learning and of comparisons pickle."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, compare_models


@pytest.fixture(scope="module")
def sample(fuzzy_model):
    return fuzzy_model.simulate(200, np.random.default_rng(0))


def through_pickle(value):
    return pickle.loads(pickle.dumps(value))


@pytest.fixture(
    scope="module", params=[(k, s) for k in (CGOFMSModel, CGOMSModel) for s in ("known", "hidden")]
)
def learned(request, sample):
    """What was learned, and a replicate of it."""
    kind, switch = request.param
    r = sample.r if switch == "known" else None
    if r is not None and kind is CGOMSModel:
        r = (r > 0.5).astype(float)
    found = kind.fit(sample.x, sample.y, r, n_starts=1, max_iter=2, form="covariance")
    return found, found.bootstrap(1, np.random.default_rng(1))[0]


@pytest.mark.parametrize("copied", [copy.deepcopy, through_pickle])
def test_what_was_learned_can_be_pickled_and_learned_again(sample, learned, copied) -> None:
    found, a = learned
    again = copied(found)
    assert again.log_likelihood == found.log_likelihood
    np.testing.assert_array_equal(again.trace, found.trace)
    np.testing.assert_array_equal(again.switch_mean, found.switch_mean)
    b = again.bootstrap(1, np.random.default_rng(1))[0]
    assert a.log_likelihood == b.log_likelihood
    np.testing.assert_array_equal(a.model.filter().filter(sample.y).x, b.model.filter().filter(sample.y).x)


def test_a_comparison_can_be_pickled(sample) -> None:
    found = compare_models(
        sample.x[:, 0],
        sample.y[:, 0],
        np.random.default_rng(0),
        candidates=["hard2", "regression"],
        n_folds=2,
    )
    again = through_pickle(found)
    assert again.best == found.best
    np.testing.assert_array_equal(again.fold_rmse, found.fold_rmse)
    assert again.verdict() == found.verdict()

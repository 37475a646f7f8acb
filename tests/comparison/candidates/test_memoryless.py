"""Candidates without memory of the state are learned with Axx = 0, and nobody else is for their sake."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, compare_models
from fuzzykf.comparison import LearningPart, candidate, compare, main_methods, prepare
from fuzzykf.comparison.candidates.switching import learn_hard
from fuzzykf.comparison.models import CANDIDATES

NAMES = ("hard2-memoryless", "fmc1-memoryless")


@pytest.fixture(scope="module")
def series():
    """A state of two lines, kept by a slow error: what a model with memory of the state learns."""
    rng = np.random.default_rng(0)
    n = 300
    r = np.arange(n) // 25 % 2
    x, y, slow = np.zeros((3, n))
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (2.0 if r[k] else -2.0) + rng.normal()
        slow[k] = 0.95 * slow[k - 1] + 0.2 * rng.normal()
        x[k] = (1.0 if r[k] else -1.0) * y[k] + slow[k]
    return x[:, None], y[:, None], r.astype(float)


def part(series, *, told):
    x, y, r = series
    return LearningPart(x=x, y=y, r=r if told else None, n_nodes=1, max_iter=3, tolerance=1e-2)


def memory(learned):
    return learned.fit.model.placed(1).pair_tables(0).pairs.Axx


@pytest.mark.parametrize(
    ("name", "told"),
    [(NAMES[0], False), (NAMES[0], True), (NAMES[1], True)],  # fmc1 with a hidden switch: below
)
def test_it_is_the_model_of_its_name_learned_without_state_feedback(name, told, series) -> None:
    here = part(series, told=told)
    learned, with_memory = (candidate(one).learn(here) for one in (name, name.removesuffix("-memoryless")))
    assert not memory(learned).any()
    assert np.abs(memory(with_memory)).max() > 0.1
    assert not any("no observation corrects it" in note for note in learned.notes)
    # Oracle: the fit that it stands for.
    options = {"form": "regression", "max_iter": 3, "tolerance": 1e-2, "state_feedback": False}
    if name.startswith("hard"):
        model = CGOMSModel.fit(here.x, here.y, here.r, n_regimes=2, **options).model
    else:
        model = CGOFMSModel.fit(here.x, here.y, here.r, law="fmc1", n_nodes=1, **options).model
    zs = series[1][:80]
    np.testing.assert_array_equal(learned.restore(zs[:0], zs).mean, model.filter(1).filter(zs).x)


def test_a_hard_model_with_and_one_without_memory_are_kept_apart(series) -> None:
    here = part(series, told=True)
    first, other = candidate(NAMES[0]).learn(here), learn_hard(here, 2)
    assert first.fit is here.hard(2, state_feedback=False)
    assert other.fit is here.hard(2) is not first.fit


def test_they_are_known_by_name_and_only_the_hard_one_is_compared_unless_it_is_named(series) -> None:
    assert set(NAMES) & {*CANDIDATES, *(one.name for one in main_methods())} == {NAMES[0]}
    x, y, _r = series
    rng = np.random.default_rng(0)
    options = {"n_nodes": 0, "max_iter": 3, "tolerance": 1e-2, "n_resamples": 100}
    found = compare_models(x, y, rng, candidates=["line", *NAMES], n_folds=1, **options)
    assert [score.name for score in found.scores] == ["line", *NAMES]
    assert not any(memory(found.learned[0][name]).any() for name in NAMES)
    task = prepare(x[:, 0], y[:, 0], switch="quantiles")
    table = compare(task, rng, methods=["line", *NAMES], n_folds=1, n_nodes=0, n_resamples=100)
    assert [score.title for score in table.scores[1:]] == [candidate(name).title for name in NAMES]

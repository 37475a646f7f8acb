"""Every candidate has one name, and whatever compares knows it by this name."""

from __future__ import annotations

import pickle
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import compare_models
from fuzzykf.cli.compare import Law
from fuzzykf.comparison import (
    Candidate,
    Estimates,
    Learned,
    LearningPart,
    candidate,
    candidate_names,
    compare,
    main_methods,
    prepare,
)
from fuzzykf.comparison.candidates import registry
from fuzzykf.comparison.candidates.switching import LAWS
from fuzzykf.comparison.clock import Clock
from fuzzykf.comparison.models import CANDIDATES
from fuzzykf.errors import ParameterError
from fuzzykf.times import read_times

#: Candidates that the page on comparing tells of beside those that are compared anyway.
TO_NAME = ("fmc1-memoryless", "fmc1-filter", "hard2-inputs", "pool", "pool-boosting")

HOWTO = Path(__file__).parents[3] / "docs" / "howto"


class Mean(Learned):
    """Answers the mean, whatever is observed."""

    def __init__(self, part) -> None:
        self.mean = part.x.mean(axis=0)

    def restore(self, before, zs):
        return Estimates(mean=np.tile(self.mean, (len(zs), 1)), std=np.ones((len(zs), 1)))

    def stepper(self):
        return lambda z: self.mean


@pytest.fixture
def family(monkeypatch):
    """A family of its own: one module, and one line in the list of them."""
    module = types.ModuleType("mean")
    module.CANDIDATES = (Candidate("mean", Mean, title="always the mean"),)
    monkeypatch.setitem(sys.modules, "fuzzykf.comparison.candidates.mean", module)
    monkeypatch.setattr(registry, "FAMILIES", (*registry.FAMILIES, "mean"))
    registry._registry.cache_clear()
    yield
    registry._registry.cache_clear()


@pytest.mark.usefixtures("family")
def test_a_module_and_a_line_make_a_candidate_that_everything_knows() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 300))
    found = compare_models(x, y, rng, candidates=["mean", "line"], n_resamples=100)
    assert found.scores[0].rmse == pytest.approx(found.baseline_rmse)
    table = compare(prepare(x, y), rng, methods=["mean", "line"], n_folds=2, n_resamples=100)
    assert [(s.name, s.title) for s in table.scores] == [
        ("mean", "always the mean"),
        ("line", "linear regression"),
    ]
    with pytest.raises(ParameterError, match=r"candidates: got 'men', expected names of .*, mean$"):
        candidate("men")


def test_names_and_titles_are_told_apart() -> None:
    found = [candidate(name) for name in candidate_names()]
    assert [one.name for one in found] == list(candidate_names())
    assert len({one.name for one in found}) == len({one.title for one in found}) == len(found)


def test_what_is_compared_by_default_is_registered() -> None:
    assert set(CANDIDATES) <= set(candidate_names())
    for law in ("auto", *LAWS):
        for one in main_methods(law):
            assert candidate(one.name).pieces == one.pieces
    assert [law.value for law in Law] == ["auto", *LAWS]


def test_any_number_of_hard_regimes_has_a_name() -> None:
    assert candidate("hard12").name == "hard12"
    assert candidate("hard12").learn.keywords == {"n_switches": 12}
    with pytest.raises(
        ParameterError, match="candidates: got 'hard0', expected names of hard1, hard2, hard3"
    ):
        candidate("hard0")


@pytest.mark.parametrize("name", ["hard2", "hard2-inputs", "imm", "kalman", "piecewise", "daily-profile"])
def test_what_any_candidate_learned_can_go_to_another_process(name) -> None:
    rng = np.random.default_rng(0)
    r = np.arange(240) // 30 % 2
    y = np.where(r, 2.0, -2.0) + rng.normal(size=240)
    x = np.where(r, y, -y) + 0.3 * rng.normal(size=240)
    time = np.datetime64("2014-01-06T00:00", "s") + np.arange(240) * np.timedelta64(3600, "s")
    clock = Clock.of(read_times(time))
    effort = {"n_nodes": 1, "max_iter": 2, "tolerance": 1e-2, "clock": clock[:200]}
    learned = candidate(name).learn(LearningPart(x=x[:200, None], y=y[:200, None], **effort))
    there = pickle.loads(pickle.dumps(learned))
    found, expected = (one.at(clock[200:]).restore(y[:200, None], y[200:, None]) for one in (there, learned))
    np.testing.assert_array_equal(found.mean, expected.mean)


def test_the_pages_tell_of_candidates_by_their_names_and_titles() -> None:
    fit = (HOWTO / "fit.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`[^|]*) \|", fit[fit.index("By default ten candidates") :], re.MULTILINE)
    told = set(re.findall(r"`([\w-]+)`", " ".join(cells)))
    assert set(CANDIDATES) <= told <= set(candidate_names())
    assert set(candidate_names()) - told == {"graph"}  # a law like fmc1 between two classes
    page = (HOWTO / "compare.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| `([\w-]+)` \|", page, re.MULTILINE)
    main = [(one.title, one.name) for one in main_methods()]
    assert rows[: len(main)] == main
    assert rows[len(main) :] == [(candidate(name).title, name) for name in TO_NAME]


def test_two_candidates_of_one_name_are_refused(monkeypatch) -> None:
    module = types.ModuleType("again")
    module.CANDIDATES = (registry.candidate("hard2"),)
    monkeypatch.setitem(sys.modules, "fuzzykf.comparison.candidates.again", module)
    monkeypatch.setattr(registry, "FAMILIES", (*registry.FAMILIES, "again"))
    registry._registry.cache_clear()
    try:
        with pytest.raises(ParameterError, match=r"CANDIDATES: got .*'hard2'.*, expected each name once"):
            registry.candidate_names()
    finally:
        registry._registry.cache_clear()

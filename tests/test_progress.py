"""A bar appears where somebody waits and can see it, and nowhere else."""

from __future__ import annotations

import builtins
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, SwitchingStateSpace, compare_models, progress
from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.progress import progress_bar


class Bar:
    """Stands for the bar of rich, and keeps what it is told."""

    made: ClassVar[list[Bar]] = []

    def __init__(self):
        self.told, self.running, self.total = [], False, None
        self.made.append(self)

    def start(self):
        self.running = True

    def stop(self):
        self.running = False

    def add_task(self, name, total):
        self.total = total
        return 0

    def update(self, task, description, completed):
        assert self.running
        self.told.append((description, completed))


@pytest.fixture
def bars(monkeypatch):
    """A terminal, outside of tests, with a clock that goes on by a second whenever it is asked."""
    monkeypatch.setattr(progress, "TESTED", "NO_SUCH_VARIABLE")
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=terminal, modules={}))
    monkeypatch.setattr(progress, "_new_bar", Bar)
    monkeypatch.setattr(Bar, "made", [])
    ticks = iter(range(10**6))
    monkeypatch.setattr(progress.time, "monotonic", lambda: float(next(ticks)))
    return Bar.made


def work(show, names="abcd"):
    with progress_bar(len(names), show) as tell:
        for name in names:
            tell(name)


def test_by_default_a_bar_comes_after_two_seconds(bars):
    work(None)
    (bar,) = bars
    assert bar.told == [("b", 1), ("c", 2), ("d", 3)]  # the first was told after one second
    assert bar.total == 4
    assert not bar.running


def test_short_work_has_no_bar(bars):
    work(None, "a")
    assert bars == []


def test_false_silences_and_true_does_not_wait(bars):
    work(False)
    assert bars == []
    work(True)
    assert bars[0].told[0] == ("a", 0)


@pytest.mark.parametrize("around", [True, False, None])
def test_parts_of_work_have_no_bar_of_their_own(bars, around):
    with progress_bar(None, around):
        work(None)
    assert len(bars) == (around is True)
    work(None)
    assert len(bars) == 1 + (around is True)


def test_a_bar_ends_with_an_error(bars):
    with pytest.raises(RuntimeError), progress_bar(None, True):
        raise RuntimeError
    assert not bars[0].running
    work(None)
    assert len(bars) == 2


@pytest.mark.parametrize("where", ["pipe", "tests", "no rich", "notebook without widgets"])
def test_nobody_is_bothered(bars, monkeypatch, where):
    found = {"rich", "ipywidgets"}
    if where == "pipe":
        monkeypatch.setattr(progress.sys, "stderr", SimpleNamespace(isatty=lambda: False))
    elif where == "tests":
        monkeypatch.setattr(progress, "TESTED", "PYTEST_CURRENT_TEST")  # which pytest has set
    elif where == "no rich":
        found.remove("rich")
    else:
        found.remove("ipywidgets")
        progress.sys.modules["ipykernel"] = progress
    monkeypatch.setattr(progress, "find_spec", lambda name: name if name in found else None)
    work(None)
    assert bars == []


def test_a_notebook_with_widgets_has_a_bar(bars, monkeypatch):
    monkeypatch.setattr(progress.sys, "stderr", None)
    progress.sys.modules["ipykernel"] = progress
    monkeypatch.setattr(progress, "find_spec", lambda name: name)
    work(None)
    assert len(bars) == 1


def test_a_bar_that_was_asked_for_needs_rich(monkeypatch):
    found = builtins.__import__

    def missing(name, *arguments, **more):
        if name.startswith("rich"):
            raise ImportError(name)
        return found(name, *arguments, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(MissingDependencyError, match="a progress bar needs rich"):
        work(True)


def learn(model, **more):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=40), rng.normal(size=40)
    options = {"form": "regression", "n_starts": 1, "max_iter": 4}
    options |= {"n_nodes": 0, "law": "free"} if model is CGOFMSModel else {}
    return model.fit(x, y, **options | more)


@pytest.mark.parametrize("model", [CGOFMSModel, CGOMSModel])
def test_learning_shows_its_iterations(bars, model):
    learn(model, progress=False)
    assert bars == []
    learn(model)
    assert bars[0].told[0] == ("learning, 2 iterations", 1)
    learn(model, progress=True)
    assert bars[1].told[0] == ("learning, 1 iterations", 0)


@pytest.mark.parametrize(
    ("asked", "first"), [(False, None), (None, "learning, 2 iterations"), (True, "learning, 1 iterations")]
)
def test_learning_from_observations_shows_its_iterations(bars, asked, first):
    model = SwitchingStateSpace([[1.0]], F=0.9, H=1.0, Q=1.0, R=1.0)
    model.fit(np.random.default_rng(0).normal(size=20), free={"R": "full"}, progress=asked)
    assert [bar.told[0][0] for bar in bars] == ([] if first is None else [first])


def test_a_comparison_has_one_bar(bars):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=200), rng.normal(size=200)
    common = {"candidates": ["hard1", "kalman"], "n_folds": 2, "n_resamples": 100, "max_iter": 5}
    compare_models(x, y, rng, **common)
    (bar,) = bars
    assert bar.told[-1][0] == "bootstrap"
    compare_models(x, y, rng, progress=False, **common)
    assert len(bars) == 1


@pytest.mark.parametrize("bad", ["yes", 2, 0.5])
def test_what_is_no_flag_is_refused(bad):
    with pytest.raises(ParameterError, match="progress: got"):
        learn(CGOMSModel, progress=bad)
    with pytest.raises(ParameterError, match="progress: got"):
        compare_models(np.zeros(200), np.zeros(200), np.random.default_rng(0), progress=bad)

"""Gradient boosting as a rival: scikit-learn's trees on the rows they should see, and on no others."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from fuzzykf import FuzzykfError, compare_models
from fuzzykf.comparison import Clock, LearningPart, candidate, compare, main_methods, prepare
from fuzzykf.comparison.candidates import boosting
from fuzzykf.comparison.candidates.boosting import LagBoosting, learn_boosting
from fuzzykf.comparison.models import CANDIDATES
from fuzzykf.errors import MissingDependencyError
from fuzzykf.times import read_times

ONE = np.ones(1)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    with threadpool_limits(1, user_api="openmp"):  # the oracles too are slow on a busy machine otherwise
        yield


def series(n=240, m=1, q=1, seed=0):
    """States with a bend in the latest observations and a step in the ones before."""
    rng = np.random.default_rng(seed)
    y = rng.normal(size=(n, q))
    x = np.abs(y[:, :1]) + 2.0 * (np.roll(y[:, :1], 1, axis=0) > 0.0) + 0.1 * rng.normal(size=(n, m))
    return x * np.arange(1, m + 1), y


def trees(design, target):
    used = np.isfinite(target)
    return HistGradientBoostingRegressor(random_state=0).fit(design[used], target[used])


@pytest.mark.parametrize(("m", "q", "lags"), [(1, 1, 0), (1, 2, 1), (2, 1, 2)])
@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
def test_each_component_has_trees_on_the_observations_written_out(m, q, lags, gaps) -> None:
    # Oracle: the rows written out one by one, missing values left to scikit-learn.
    x, y = series(m=m, q=q)
    if gaps:
        x[[20, 21], -1], y[[40, 41, 230], 0] = np.nan, np.nan
    rows = np.array([np.concatenate([y[k - lag] for lag in range(lags + 1)]) for k in range(lags, 240)])
    learned = LagBoosting(x[:200], y[:200], lags, np.arange(1.0, m + 1))
    found = learned.restore(y[:200], y[200:])
    expected = [trees(rows[: 200 - lags], x[lags:200, k]).predict(rows[200 - lags :]) for k in range(m)]
    np.testing.assert_array_equal(found.mean, np.column_stack(expected))
    np.testing.assert_array_equal(found.std, np.tile(np.arange(1.0, m + 1), (40, 1)))
    assert found.log_likelihood is None
    step = learned.stepper()
    np.testing.assert_array_equal([step(z) for z in y[200 - lags :]][lags:], found.mean)


def test_before_the_first_observation_the_lags_are_missing() -> None:
    x, y = series()
    learned = LagBoosting(x, y, 2, ONE)
    cold = learned.restore(y[:0], y[:5])
    expected = learned._trees[0].predict([[y[0, 0], np.nan, np.nan], [y[1, 0], y[0, 0], np.nan]])
    np.testing.assert_array_equal(cold.mean[:2, 0], expected)
    assert learned.restore(y, y[:0]).mean.shape == (0, 1)


def test_lags_and_std_come_from_rolling_blocks_and_the_trees_from_all_rows() -> None:
    x, y = series(400)
    learned = learn_boosting(LearningPart(x=x[:320], y=y[:320]), lags=(0, 1, 2))
    rmse = {}
    for k in (0, 1, 2):
        blocks = [
            LagBoosting(x[:split], y[:split], k, ONE).restore(y[:split], y[split:end]).mean
            for split, end in ((160, 213), (213, 267), (267, 320))
        ]
        rmse[k] = np.sqrt(np.mean((np.concatenate(blocks) - x[160:320]) ** 2))
    assert learned.lags == min(rmse, key=rmse.get) > 0
    assert learned.std == pytest.approx(rmse[learned.lags])
    assert learned.description.startswith(f"lags: {learned.lags} (chosen from 0-2 on 3 rolling blocks by")
    again = LagBoosting(x[:320], y[:320], learned.lags, ONE).restore(y[:320], y[320:])
    np.testing.assert_array_equal(learned.restore(y[:320], y[320:]).mean, again.mean)
    # Errors on the rows learned on would promise too much.
    within = learned.restore(y[:0], y[:320]).mean - x[:320]
    assert np.sqrt(np.mean(within**2)) < 0.9 * learned.std[0]


def test_where_times_are_known_the_trees_see_hour_day_and_kind_of_day() -> None:
    # Oracle: the columns written out.
    x, y = series()
    hours = np.datetime64("2014-01-08T00:00", "s") + np.arange(240) * np.timedelta64(3600, "s")  # a Wednesday
    clock = Clock.of(read_times(hours))
    k = np.arange(240)
    day = (k // 24 + 2) % 7
    design = np.column_stack([y[1:], y[:-1], k[1:] % 24, day[1:], day[1:] < 5])
    learned = LagBoosting(x[:200], y[:200], 1, ONE, clock[:200])
    there = learned.at(clock[200:])
    expected = trees(design[:199], x[1:200, 0]).predict(design[199:])
    found = there.restore(y[:200], y[200:])
    np.testing.assert_array_equal(found.mean[:, 0], expected)
    step = there.stepper()
    np.testing.assert_array_equal([step(z)[0] for z in y[200:]][1:], expected[1:])
    for wrong in (learned, learned.at(clock[:3])):
        with pytest.raises(
            FuzzykfError, match="learned with times or inputs, and needs those of the 40 rows"
        ):
            wrong.restore(y[:200], y[200:])


def test_it_is_known_by_its_name_and_a_default_of_compare() -> None:
    assert "boosting" not in CANDIDATES
    assert "boosting" in {one.name for one in main_methods()}
    x, y = series(300)
    options = {"n_resamples": 100, "rng": np.random.default_rng(0)}
    found = compare_models(x, y, candidates=["line", "boosting"], n_folds=1, **options)
    assert found.best == "boosting"  # a line sees neither the bend nor the step
    table = compare(prepare(x[:, 0], y[:, 0]), methods=["line", "boosting"], n_folds=1, **options)
    assert [score.title for score in table.scores] == ["linear regression", "gradient boosting with lags"]
    assert table.scores[1].log_likelihood is None


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            slice(0, 60),
            "component 1 of the state is missing in all of the last 60 rows, on which boosting is",
        ),
        (
            slice(30, 120),
            "boosting needs 40 rows at least in which component 1 of the state is known, and has 30",
        ),
    ],
)
def test_a_state_that_is_hardly_known_is_refused(known, message) -> None:
    x, y = series(120, m=2)
    hidden = x.copy()
    hidden[:, 1] = np.nan
    hidden[known] = x[known]
    with pytest.raises(FuzzykfError, match=message):
        learn_boosting(LearningPart(x=hidden, y=y), lags=(0,))


def test_without_scikit_learn_the_extra_is_named_and_nobody_goes_on_without(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    boosting._library.cache_clear()
    x, y = series(300)
    named = {"candidates": ["line", "boosting"]}
    rng, message = np.random.default_rng(0), r"needs scikit-learn: pip install 'fuzzykf\[compare\]'"
    for work in (
        lambda: candidate("boosting").learn(LearningPart(x=x, y=y)),
        lambda: compare_models(x, y, rng, **named),
        lambda: compare(prepare(x[:, 0], y[:, 0]), rng, methods=named["candidates"]),
    ):
        with pytest.raises(MissingDependencyError, match=message):
            work()

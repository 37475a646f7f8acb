"""Scores, the choice of the best two and the sentence about them are what they should be."""

from __future__ import annotations

import os
import re
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fuzzykf import DailyProfile, FuzzykfError, compare_models
from fuzzykf.comparison import (
    Candidate,
    Fold,
    LearningPart,
    Restoration,
    Task,
    candidate,
    compare,
    evaluation,
    main_methods,
    prepare,
    score,
)
from fuzzykf.comparison.candidates.boosting import learn_boosting
from fuzzykf.comparison.folds import THREADS, _one_thread_each
from fuzzykf.comparison.wording import about_choices, about_failures, about_intervals
from fuzzykf.errors import ParameterError

N_TRAIN, N_TEST = 150, 600
NAMES = [
    "fuzzy",
    "hard2",
    "hard2-memoryless",
    "hard2-filter",
    "pool-inputs",
    "imm",
    "kalman",
    "line",
    "regression",
    "piecewise",
    "boosting",
    "daily-profile",
]
TITLES = [
    "OFSRFilter",
    "CGOMSMFilter",
    "CGOMSMFilter, no memory of the state",
    "CGOMSMFilter, filter-trained",
    "FilterPool, clock and features",
    "IMMEstimator",
    "KalmanFilter (filterpy)",
    "linear regression",
    "regression with lags",
    "piecewise-linear with lags",
    "gradient boosting with lags",
    "mean of the time of day",
]


@pytest.fixture
def task() -> Task:
    rng = np.random.default_rng(0)
    n = N_TRAIN + N_TEST
    return Task(
        state=rng.normal(size=n) + 1.0,
        observation=rng.normal(size=n),
        n_train=N_TRAIN,
    )


def restoration(task: Task, name: str, errors: np.ndarray, **fields) -> Restoration:
    truth = task.state[task.n_train :]
    std = fields.pop("std", np.ones(N_TEST))
    return Restoration(name=name, mean=truth + errors, std=std, microseconds=1.0, **fields)


def test_rmse_coverage_and_likelihood_are_those_of_the_definitions(task) -> None:
    errors = np.linspace(-2.0, 2.0, N_TEST)
    likelihood = np.linspace(-3.0, 0.0, N_TEST)
    found = score(
        task,
        (
            restoration(task, "a", errors, log_likelihood=likelihood),
            restoration(task, "b", np.full(N_TEST, 5.0), std=np.full(N_TEST, 100.0)),
        ),
        np.random.default_rng(0),
    )
    a, b = found.scores
    assert a.rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert a.rmse_low < a.rmse < a.rmse_high
    assert a.coverage == np.mean(np.abs(errors) <= 1.6448536)
    assert a.log_likelihood == pytest.approx(-1.5)
    assert (b.coverage, b.log_likelihood) == (1.0, None)
    assert b.rmse_low == pytest.approx(5.0)
    assert b.rmse_high == pytest.approx(5.0)
    baseline = task.state[:N_TRAIN].mean()
    assert found.baseline_rmse == pytest.approx(np.sqrt(np.mean((task.state[N_TRAIN:] - baseline) ** 2)))


def test_it_is_a_comparison_of_models_with_one_fold(task) -> None:
    named = {"methods": ["line", "kalman"], "n_folds": 1, "n_resamples": 100}
    learned = compare(task, np.random.default_rng(0), **named)
    assert learned.folds == (Fold(begin=0, split=N_TRAIN, end=N_TRAIN + N_TEST),)
    assert list(learned.learned[0]) == ["line", "kalman"]
    table = learned.to_dataframe()
    assert list(table.index) == [learned.best, learned.second]
    assert table.loc[learned.second, "difference"] == learned.difference
    assert (table[["seconds", "microseconds"]] > 0.0).all(axis=None)
    np.testing.assert_allclose(learned.fold_rmse[0], [s.rmse for s in learned.scores])


def test_one_method_or_two_of_one_name_make_no_comparison(task) -> None:
    one = restoration(task, "a", np.ones(N_TEST))
    for pair in ((one,), (one, one)):
        with pytest.raises(ParameterError, match=r"restorations: got .*, expected two at least and each"):
            score(task, pair, np.random.default_rng(0))


@pytest.mark.parametrize("std", [-1.0, np.nan, np.inf])
def test_a_standard_deviation_that_is_none_is_refused(task, std) -> None:
    pair = (
        restoration(task, "a", np.ones(N_TEST), std=np.full(N_TEST, std)),
        restoration(task, "b", np.ones(N_TEST)),
    )
    with pytest.raises(ParameterError, match=r"restorations: got a std of .* from a, expected finite"):
        score(task, pair, np.random.default_rng(0))


def test_a_restoration_without_a_standard_deviation_or_of_another_length_is_refused_by_name(task) -> None:
    for wrong, message in (
        (restoration(task, "a", np.ones(N_TEST), std=None), "got a, its std is None, expected an array"),
        (restoration(task, "a", np.ones(N_TEST), std=np.ones(3)), r"got a, its std has shape \(3,\)"),
    ):
        pair = wrong, restoration(task, "b", np.ones(N_TEST))
        with pytest.raises(ParameterError, match=f"restorations: {message}"):
            score(task, pair, np.random.default_rng(0))


def test_the_winners_are_told_beside_a_chosen_rival(task) -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(size=N_TEST)
    found = score(
        task,
        (
            restoration(task, "near", noise, std=np.full(N_TEST, 9.0)),
            restoration(task, "far", 2 * noise, std=np.full(N_TEST, 2.0), title="THE FAR ONE"),
            restoration(task, "sure", 3 * noise, std=np.zeros(N_TEST)),
        ),
        rng,
        n_resamples=100,
    )
    far = found.scores[1]
    assert found.against("far", "GW") == (
        f"THE FAR ONE is {far.difference:.2g} GW behind near on RMSE (95 % interval "
        f"{far.difference_low:.2g} to {far.difference_high:.2g}): a significant difference; "
        "it has the highest log score."
    )
    near = found.scores[0]
    assert found.against("near") == (
        f"near has the lowest RMSE; on log score {near.log_score_behind:.2g} behind THE FAR ONE (95 % "
        f"interval {near.log_score_behind_low:.2g} to {near.log_score_behind_high:.2g}): a significant "
        "difference."
    )
    assert found.against("sure").endswith("a significant difference; its log score is -inf.")
    with pytest.raises(ParameterError, match=r"rival: got 'fr', expected one of near, far, sure$"):
        found.against("fr")
    failed = replace(found, failures={"lost": "fold 1: no way"})
    with pytest.raises(ParameterError, match=r"expected one of .*; it failed: fold 1: no way"):
        failed.against("lost")


def test_what_was_said_of_all_folds_scores_as_it_did_fold_by_fold(two_regimes) -> None:
    # The mixtures of the folds follow one another, though they need not be of one size.
    methods = ["hard2", "line"]
    found = compare(two_regimes, np.random.default_rng(0), methods=methods, n_folds=2, n_resamples=100)
    again = score(two_regimes, found.restorations, np.random.default_rng(0), n_resamples=100)
    for a, b in zip(found.scores, again.scores, strict=True):
        assert b.log_score == pytest.approx(a.log_score)
        assert (b.coverage, b.density) == (a.coverage, a.density)
    hard = found.scores[0]
    assert (hard.density, found.scores[1].density) == ("mixture", "normal")
    lower, upper = found.restorations[0].interval(0.9)
    assert hard.coverage == np.mean((lower <= found.truth) & (found.truth <= upper))
    assert "state under the mixture of normal distributions of the method (CGOMSMFilter); of the others" in (
        about_intervals(found)
    )


def test_a_clear_winner_is_called_certain_and_a_draw_is_not(task) -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(size=N_TEST)
    clear = score(
        task, (restoration(task, "far", 2 * noise), restoration(task, "near", noise)), rng, n_resamples=500
    )
    assert (clear.best, clear.second, clear.is_certain) == ("near", "far", True)
    assert clear.difference == pytest.approx(np.sqrt(np.mean(noise**2)))
    assert "near has the lowest RMSE" in clear.verdict("GW")
    assert re.search(
        r"Next is far, [\d.]+ GW behind \(95 % .*\): a significant difference", clear.verdict("GW")
    )
    assert clear.best_on_log_score == "near"
    assert clear.is_certain_on_log_score
    assert f"Baseline (training mean): RMSE {clear.baseline_rmse:.4g} GW." in clear.verdict("GW")
    draw = score(
        task,
        (restoration(task, "one", noise), restoration(task, "two", rng.permutation(noise) * 1.01)),
        rng,
        n_resamples=500,
    )
    assert draw.best == "one"
    assert not draw.is_certain
    assert draw.difference_low < 0.0 < draw.difference_high
    assert draw.verdict().count("): not a significant difference.") == 2  # of error and of log score
    assert not draw.is_certain_on_log_score


def test_the_difference_is_paired(task) -> None:
    # Two methods that share nearly all of their error: each RMSE is uncertain, their difference is not.
    rng = np.random.default_rng(2)
    shared = 5.0 * rng.normal(size=N_TEST)
    found = score(
        task, (restoration(task, "a", shared), restoration(task, "b", 1.02 * shared)), rng, n_resamples=500
    )
    a, b = found.scores
    assert a.rmse_high > b.rmse_low
    assert found.is_certain


def test_too_few_resamples_for_quantiles_are_refused(task) -> None:
    pair = (restoration(task, "a", np.ones(N_TEST)), restoration(task, "b", np.zeros(N_TEST)))
    with pytest.raises(ParameterError, match="n_resamples: got 99"):
        score(task, pair, np.random.default_rng(0), n_resamples=99)


# ------------------------------------------------------------------ the methods together


@pytest.fixture(scope="module")
def two_regimes() -> Task:
    """A series with two clearly different regimes, of long stay, that the observation shows."""
    rng = np.random.default_rng(7)
    n = 800
    r = (np.cumsum(rng.random(n) < 0.02) % 2).astype(float)
    x, y = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (4.0 if r[k] else -4.0) + rng.normal()
        x[k] = 0.3 * x[k - 1] + (1.5 if r[k] else -1.5) * y[k] + 0.5 * rng.normal()
    time = np.datetime64("2014-01-06T00:00", "s") + np.arange(n) * np.timedelta64(3600, "s")
    return replace(prepare(x, y, time=time, train=0.6), switch=r)


@pytest.fixture(scope="module")
def all_methods(two_regimes):
    """The comparison of all methods, and what was told of its progress."""
    told: list[str] = []
    found = compare(two_regimes, np.random.default_rng(0), n_folds=1, n_resamples=200, progress=told.append)
    return found, told


def test_the_methods_are_compared_in_order_and_progress_is_told(two_regimes, all_methods) -> None:
    found, told = all_methods
    assert [s.name for s in found.scores] == NAMES
    assert [s.title for s in found.scores] == TITLES
    assert [one for one in told if "a member of the pool" not in one] == [*TITLES, "bootstrap"]
    for s, r in zip(found.scores, found.restorations, strict=True):
        assert s.rmse == pytest.approx(np.sqrt(np.mean((r.mean - two_regimes.state[480:]) ** 2)))
        assert s.microseconds > 0.0


def test_on_switching_data_the_filters_with_switches_win_and_know_how_well_they_do(all_methods) -> None:
    found, _ = all_methods
    by_name = {s.name: s for s in found.scores}
    hard, kalman = by_name["hard2"], by_name["kalman"]
    assert found.best in ("fuzzy", "hard2", "hard2-memoryless", "imm")
    # The hard model is the one that the series was made from: its error is the noise it was given.
    assert hard.rmse < 0.6 < kalman.rmse
    assert 0.82 < hard.coverage < 0.97
    assert hard.log_likelihood > kalman.log_likelihood


def test_a_hidden_switch_is_learned_about_as_well_as_one_that_is_told(two_regimes) -> None:
    hard = ["hard2", "line"]
    hidden, told = (
        compare(task, np.random.default_rng(0), methods=hard, n_folds=1, n_resamples=200)
        for task in (replace(two_regimes, switch=None), two_regimes)
    )
    assert hidden.scores[0].rmse < 1.05 * told.scores[0].rmse
    assert hidden.scores[0].rmse != told.scores[0].rmse
    assert hidden.scores[1].rmse == told.scores[1].rmse


def test_the_same_seed_gives_the_same_comparison(two_regimes) -> None:
    quick = main_methods("fmc1")[4:6]
    one, two = (
        compare(two_regimes, np.random.default_rng(3), methods=quick, n_resamples=200) for _ in range(2)
    )
    for a, b in zip(one.scores, two.scores, strict=True):
        assert replace(a, microseconds=0.0) == replace(b, microseconds=0.0)
    assert one.verdict() == two.verdict()


@pytest.mark.parametrize("told", [True, False])
def test_the_methods_see_nothing_of_the_state_to_be_restored(two_regimes, told) -> None:
    n = 300  # rows to learn on, of 400
    state, observation = two_regimes.state[:400], two_regimes.observation[:400]
    hidden = state.copy()
    hidden[n:] += 1000.0
    switch = two_regimes.switch[:400] if told else None
    changed = None if switch is None else np.where(np.arange(400) < n, switch, 0.5)
    chosen = [
        m for m in main_methods("fmc1", times=False) if m.name not in ("boosting", "" if told else "fmc1")
    ]
    task = Task(state=state, observation=observation, switch=switch, n_train=n)
    other = Task(state=hidden, observation=observation, switch=changed, n_train=n)
    one, two = (
        compare(t, np.random.default_rng(0), methods=chosen, n_folds=1, n_resamples=100)
        for t in (task, other)
    )
    for a, b in zip(one.restorations, two.restorations, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.std, b.std)


def test_folds_are_learned_anew_and_their_rows_are_judged_together(two_regimes) -> None:
    # Oracle: the line of each fold, by numpy.
    x, y = two_regimes.state, two_regimes.observation
    named = {"methods": ["line", "regression"], "n_resamples": 100}
    found = compare(two_regimes, np.random.default_rng(0), **named)
    splits = [480, 544, 608, 672, 736]
    assert [fold.split for fold in found.folds] == splits
    assert {fold.begin for fold in found.folds} == {0}
    mean = [np.polyval(np.polyfit(y[:n], x[:n], 1), y[n : n + 64]) for n in splits]
    np.testing.assert_allclose(found.restorations[0].mean, np.concatenate(mean))
    np.testing.assert_array_equal(found.truth, x[480:])
    assert found.scores[0].rmse == pytest.approx(np.sqrt(np.mean((np.concatenate(mean) - x[480:]) ** 2)))
    assert len(found.restorations[1].choices) == 5
    (told,) = about_choices(found)
    assert told.startswith("regression with lags (last fold): lags: ")
    with pytest.raises(
        ParameterError, match="n_folds: got 321, expected at most 320, the rows that are held"
    ):
        compare(two_regimes, np.random.default_rng(0), n_folds=321, **named)


def test_folds_in_processes_of_their_own_give_the_same(two_regimes) -> None:
    told: list[str] = []
    named = {"methods": ["line", "kalman"], "n_folds": 2, "n_resamples": 100}
    one = compare(two_regimes, np.random.default_rng(0), **named)
    two = compare(two_regimes, np.random.default_rng(0), n_jobs=2, progress=told.append, **named)
    for a, b in zip(one.scores, two.scores, strict=True):
        assert a == b  # but for times
    titles = ("linear regression", "KalmanFilter")
    assert sorted(told) == sorted(["bootstrap", *(f"fold {k} of 2: {one}" for k in (1, 2) for one in titles)])
    local = Candidate("local", lambda part: None)
    with pytest.raises(ParameterError, match="n_jobs: got 2, expected 1: a candidate cannot be sent"):
        compare(two_regimes, np.random.default_rng(0), n_jobs=2, **{**named, "methods": ["line", local]})


def test_the_profile_is_learned_anew_before_each_fold() -> None:
    # Oracle: the profile of the raw rows before the fold.
    rng = np.random.default_rng(3)
    time = np.datetime64("2014-01-06T00:00", "s") + np.arange(960) * np.timedelta64(3600, "s")
    x, y = rng.normal(size=(2, 960)) + np.sin(np.arange(960) / 24 * 2 * np.pi)
    task = prepare(x, y, time=time, profile=True)
    for split, end in ((480, 600), (720, 960)):
        profile = DailyProfile().fit(x[:split], time[:split])
        np.testing.assert_allclose(
            task.target(split, end), profile.transform(x[:end], time[:end]), atol=1e-12
        )


def test_gaps_are_no_errors(two_regimes) -> None:
    # Rows without x do not count for learning nor for scores, those without y are crossed.
    n, holes = 500, np.random.default_rng(4)
    r, (x, y), time = np.arange(n) // 25 % 2, np.zeros((2, n)), two_regimes.time[:n]
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (4.0 if r[k] else -4.0) + holes.normal()
        x[k] = 0.3 * x[k - 1] + (1.5 if r[k] else -1.5) * y[k] + 0.5 * holes.normal()
    x[holes.random(n) < 0.03], y[holes.random(n) < 0.03] = np.nan, np.nan
    x[100:110], y[[*range(120, 126), *range(400, 420)]] = np.nan, np.nan
    boosting = Candidate("boosting", partial(learn_boosting, lags=(0,)))
    names = ["hard2", "imm", "kalman", "line", "regression", "piecewise", "daily-profile", boosting]
    common = {"n_folds": 2, "n_resamples": 100}
    found = compare(prepare(x, y, time=time), np.random.default_rng(0), methods=names, **common)
    models = compare_models(x, y, np.random.default_rng(0), candidates=names, time=time, **common)
    assert not found.failures
    assert not models.failures
    known = np.isfinite(x[250:])
    for one, other, judged in zip(found.restorations, models.scores, found.scores, strict=True):
        assert np.isfinite(one.mean).all()
        assert judged.rmse == pytest.approx(np.sqrt(np.mean((one.mean - x[250:])[known] ** 2)))
        assert other.rmse == judged.rmse  # learned in the same way
    assert found.scores[0].rmse < 0.5 * found.scores[2].rmse  # the regimes are found all the same
    with pytest.raises(ParameterError, match="switch: the observation is missing in row "):
        prepare(x, y, switch="quantiles")
    x[250:] = np.nan
    with pytest.raises(ParameterError, match="state: 0 held-out states are known of those after row 250"):
        compare(prepare(x, y), np.random.default_rng(0), methods=["line", "kalman"])


def broken(part: LearningPart):
    raise FuzzykfError("nothing can be learned from this")


def test_a_method_that_fails_is_named_and_the_others_are_compared(two_regimes) -> None:
    odd, rng = Candidate("odd", broken), np.random.default_rng(0)
    found = compare(two_regimes, rng, methods=["line", odd, "kalman"], n_folds=2, n_resamples=100)
    assert found.failures == {"odd": "fold 1: nothing can be learned from this"}
    assert (
        [one.name for one in found.scores] == [one.name for one in found.restorations] == ["line", "kalman"]
    )
    assert about_failures(found) == ("Not compared: odd, fold 1: nothing can be learned from this.",)
    with pytest.raises(FuzzykfError, match="odd, fold 1: nothing can be learned from this"):
        compare(two_regimes, rng, methods=[odd])
    with pytest.raises(FuzzykfError, match=r"nothing to compare line with: odd, fold 1: nothing can be"):
        compare(two_regimes, rng, methods=["line", odd])


def test_numbers_that_are_not_finite_are_a_failure_of_the_method(two_regimes) -> None:
    def learn(part: LearningPart):
        learned = linear.learn(part)
        learned.std = np.array([np.nan])
        return learned

    linear = candidate("line")
    with pytest.raises(FuzzykfError, match="odd, fold 1: its std at held-out step 0 is nan"):
        compare(two_regimes, np.random.default_rng(0), methods=[Candidate("odd", learn)])


def test_the_time_of_a_step_is_in_microseconds() -> None:
    assert 1000.0 <= evaluation.microseconds(lambda _: time.sleep(0.001), np.zeros((5, 1))) < 100_000.0


def test_the_law_has_to_be_one_that_there_is() -> None:
    assert [m.name for m in main_methods("free")] == ["free", *NAMES[1:]]
    assert [m.title for m in main_methods("free")] == TITLES
    assert [m.name for m in main_methods("free", times=False)] == ["free", *NAMES[1:-1]]
    with pytest.raises(ParameterError, match="law: got 'fmc3', expected 'auto', 'fmc1', 'fmc2', 'free'"):
        main_methods("fmc3")


def test_processes_that_share_folds_have_one_thread_each(monkeypatch) -> None:
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(THREADS[1], "3")
    with _one_thread_each():
        assert [os.environ[name] for name in THREADS] == ["1", "3", "1"]
    assert [os.environ.get(name) for name in THREADS] == [None, "3", None]

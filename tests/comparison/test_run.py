"""Scores, the choice of the best two and the sentence about them are what they should be."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from fuzzykf import FuzzykfError
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
from fuzzykf.errors import ParameterError

N_TRAIN, N_TEST = 150, 600
NAMES = ["fuzzy", "hard2", "imm", "kalman", "line", "regression", "piecewise"]
TITLES = [
    "OFSRFilter",
    "CGOMSMFilter",
    "IMMEstimator",
    "KalmanFilter (filterpy)",
    "linear regression",
    "regression with lags",
    "piecewise-linear with lags",
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
    learned = compare(task, np.random.default_rng(0), methods=["line", "kalman"], n_resamples=100)
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


def test_a_clear_winner_is_called_certain_and_a_draw_is_not(task) -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(size=N_TEST)
    clear = score(
        task, (restoration(task, "far", 2 * noise), restoration(task, "near", noise)), rng, n_resamples=500
    )
    assert (clear.best, clear.second, clear.is_certain) == ("near", "far", True)
    assert clear.difference == pytest.approx(np.sqrt(np.mean(noise**2)))
    assert "near has the lowest RMSE" in clear.verdict("GW")
    assert "GW below far, which is more than its uncertainty" in clear.verdict("GW")
    draw = score(
        task,
        (restoration(task, "one", noise), restoration(task, "two", rng.permutation(noise) * 1.01)),
        rng,
        n_resamples=500,
    )
    assert draw.best == "one"
    assert not draw.is_certain
    assert draw.difference_low < 0.0 < draw.difference_high
    assert "which is no more than its uncertainty" in draw.verdict()


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
    n = 2000
    r = (np.cumsum(rng.random(n) < 0.02) % 2).astype(float)
    x, y = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (4.0 if r[k] else -4.0) + rng.normal()
        x[k] = 0.3 * x[k - 1] + (1.5 if r[k] else -1.5) * y[k] + 0.5 * rng.normal()
    return replace(prepare(x, y), switch=r)


@pytest.fixture(scope="module")
def all_methods(two_regimes):
    """The comparison of all methods, and what was told of its progress."""
    told: list[str] = []
    return compare(two_regimes, np.random.default_rng(0), n_resamples=200, progress=told.append), told


def test_the_methods_are_compared_in_order_and_progress_is_told(two_regimes, all_methods) -> None:
    found, told = all_methods
    assert [s.name for s in found.scores] == NAMES
    assert [s.title for s in found.scores] == TITLES
    assert told == [*TITLES, "bootstrap"]
    for s, r in zip(found.scores, found.restorations, strict=True):
        assert s.rmse == pytest.approx(np.sqrt(np.mean((r.mean - two_regimes.state[1200:]) ** 2)))
        assert s.microseconds > 0.0


def test_on_switching_data_the_filters_with_switches_win_and_know_how_well_they_do(all_methods) -> None:
    found, _ = all_methods
    by_name = {s.name: s for s in found.scores}
    hard, kalman = by_name["hard2"], by_name["kalman"]
    assert found.best in ("fuzzy", "hard2")
    # The hard model is the one that the series was made from: its error is the noise it was given.
    assert hard.rmse < 0.6 < kalman.rmse
    assert 0.85 < hard.coverage < 0.95
    assert hard.log_likelihood > kalman.log_likelihood


def test_a_hidden_switch_is_learned_about_as_well_as_one_that_is_told(two_regimes) -> None:
    hard = ["hard2", "line"]
    hidden, told = (
        compare(task, np.random.default_rng(0), methods=hard, n_resamples=200)
        for task in (replace(two_regimes, switch=None), two_regimes)
    )
    assert hidden.scores[0].rmse < 1.05 * told.scores[0].rmse
    assert hidden.scores[0].rmse != told.scores[0].rmse
    assert hidden.scores[1].rmse == told.scores[1].rmse


def test_the_same_seed_gives_the_same_comparison(two_regimes) -> None:
    quick = main_methods("fmc1")[3:5]
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
    chosen = [m for m in main_methods("fmc1") if told or m.name != "fmc1"]
    task = Task(state=state, observation=observation, switch=switch, n_train=n)
    other = Task(state=hidden, observation=observation, switch=changed, n_train=n)
    one, two = (compare(t, np.random.default_rng(0), methods=chosen, n_resamples=100) for t in (task, other))
    for a, b in zip(one.restorations, two.restorations, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.std, b.std)


def broken(part: LearningPart):
    raise FuzzykfError("nothing can be learned from this")


def test_a_method_that_fails_is_named(two_regimes) -> None:
    with pytest.raises(FuzzykfError, match="odd: nothing can be learned from this"):
        compare(two_regimes, np.random.default_rng(0), methods=[Candidate("odd", broken)])


def test_numbers_that_are_not_finite_are_an_error_that_names_the_method(two_regimes) -> None:
    def learn(part: LearningPart):
        learned = linear.learn(part)
        learned.std = np.array([np.nan])
        return learned

    linear = candidate("line")
    with pytest.raises(FuzzykfError, match="linear regression: its std at step 0 is nan"):
        compare(two_regimes, np.random.default_rng(0), methods=[Candidate("linear regression", learn)])


def test_the_time_of_a_step_is_in_microseconds() -> None:
    assert 1000.0 <= evaluation.microseconds(lambda _: time.sleep(0.001), np.zeros((5, 1))) < 100_000.0


def test_the_law_has_to_be_one_that_there_is() -> None:
    assert [m.name for m in main_methods("free")] == ["free", *NAMES[1:]]
    assert [m.title for m in main_methods("free")] == TITLES
    with pytest.raises(ParameterError, match="law: got 'fmc3', expected 'auto', 'fmc1', 'fmc2', 'free'"):
        main_methods("fmc3")

"""Scores, the choice of the best two and the sentence about them are what they should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzzykf import FuzzykfError
from fuzzykf.comparison import Restoration, Task, compare, methods, prepare, score
from fuzzykf.errors import ParameterError

N_TRAIN, N_TEST = 150, 600


@pytest.fixture
def task() -> Task:
    rng = np.random.default_rng(0)
    n = N_TRAIN + N_TEST
    return Task(
        state=rng.normal(size=n) + 1.0,
        observation=rng.normal(size=n),
        switch=np.zeros(n),
        n_train=N_TRAIN,
        switch_source="",
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


def test_four_methods_are_compared_in_order_and_progress_is_told(two_regimes) -> None:
    told: list[str] = []
    found = compare(two_regimes, np.random.default_rng(0), n_resamples=200, progress=told.append)
    names = [s.name for s in found.scores]
    assert names == ["OFSRFilter", "CGOMSMFilter", "KalmanFilter (filterpy)", "linear regression"]
    assert told == ["fuzzy switches", "hard switches", "Kalman filter", "linear regression", "bootstrap"]
    for s, r in zip(found.scores, found.restorations, strict=True):
        assert s.rmse == pytest.approx(np.sqrt(np.mean((r.mean - two_regimes.state[1200:]) ** 2)))
        assert s.microseconds > 0.0


def test_on_switching_data_the_filters_with_switches_win_and_know_how_well_they_do(two_regimes) -> None:
    found = compare(two_regimes, np.random.default_rng(0), n_resamples=200)
    by_name = {s.name: s for s in found.scores}
    hard, kalman = by_name["CGOMSMFilter"], by_name["KalmanFilter (filterpy)"]
    assert found.best in ("OFSRFilter", "CGOMSMFilter")
    # The hard model is the one that the series was made from: its error is the noise it was given.
    assert hard.rmse < 0.6 < kalman.rmse
    assert 0.85 < hard.coverage < 0.95
    assert hard.log_likelihood > kalman.log_likelihood


def test_the_same_seed_gives_the_same_comparison(two_regimes) -> None:
    one, two = (compare(two_regimes, np.random.default_rng(3), n_resamples=200) for _ in range(2))
    for a, b in zip(one.scores, two.scores, strict=True):
        assert replace(a, microseconds=0.0) == replace(b, microseconds=0.0)
    assert one.verdict() == two.verdict()


def test_the_methods_see_nothing_of_the_state_to_be_restored(two_regimes) -> None:
    hidden = two_regimes.state.copy()
    hidden[1200:] += 1000.0
    switch = two_regimes.switch.copy()
    switch[1200:] = 0.5
    changed = replace(two_regimes, state=hidden, switch=switch)
    for method in (
        lambda task: methods.fuzzy_switches(task, 3),
        methods.hard_switches,
        methods.kalman_filter,
        methods.linear_regression,
    ):
        np.testing.assert_array_equal(method(two_regimes).mean, method(changed).mean)


def test_numbers_that_are_not_finite_are_an_error_that_names_the_method(two_regimes, monkeypatch) -> None:
    def broken(task: Task) -> Restoration:
        found = linear(task)
        return replace(found, std=np.where(np.arange(len(found.std)) == 4, np.nan, found.std))

    linear = methods.linear_regression
    monkeypatch.setattr(methods, "linear_regression", broken)
    with pytest.raises(FuzzykfError, match="linear regression: its std at step 4 is nan"):
        compare(two_regimes, np.random.default_rng(0))

"""Candidates are judged on what they have not seen, all on the same rows, and by the definitions."""

from __future__ import annotations

import copy
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from fuzzykf import DailyProfile, compare_models
from fuzzykf.comparison import Candidate, Estimates, Learned, LearningPart, NormalMixture, Score
from fuzzykf.comparison.models import CANDIDATES
from fuzzykf.comparison.verdict import about_feedback
from fuzzykf.datasets import load_victoria
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.io import model_to_dict

RNG = np.random.default_rng


class Remembering(Learned):
    """Answers a multiple of the observation, and remembers what it was given."""

    def __init__(self, part: LearningPart, factor: float, std: float, likelihood: bool) -> None:
        self.part, self.factor, self.std, self.likelihood = part, factor, std, likelihood
        self.notes = (f"learned on {len(part)} rows",)

    def restore(self, before, zs):
        self.before, self.zs = before, zs
        mean = self.factor * np.nan_to_num(zs[:, : self.part.x.shape[1]])
        return Estimates(
            mean=mean,
            std=np.full(mean.shape, self.std),
            log_likelihood=-np.abs(np.nan_to_num(zs[:, 0])) if self.likelihood else None,
        )

    def stepper(self):
        return lambda z: self.factor * z


def remembering(name, factor=1.0, std=1.0, likelihood=True):
    return Candidate(name, lambda part: Remembering(part, factor, std, likelihood))


def noise(n, seed=0, m=1):
    rng = RNG(seed)
    return rng.normal(size=(n, m)), rng.normal(size=(n, m))


# ------------------------------------------------------------------ folds


@pytest.mark.parametrize(("window", "begins"), [("expanding", [0, 0, 0]), ("sliding", [0, 50, 100])])
def test_every_row_after_the_first_part_is_judged_once_by_what_was_learned_before(window, begins) -> None:
    x, y = noise(300)
    found = compare_models(
        x, y, RNG(0), candidates=[remembering("a")], n_folds=3, window=window, n_resamples=100
    )
    assert [fold.begin for fold in found.folds] == begins
    assert [(fold.split, fold.end) for fold in found.folds] == [(150, 200), (200, 250), (250, 300)]
    for fold, learned in zip(found.folds, found.learned, strict=True):
        a = learned["a"]
        np.testing.assert_array_equal(a.part.x, x[fold.begin : fold.split])
        np.testing.assert_array_equal(a.part.y, y[fold.begin : fold.split])
        np.testing.assert_array_equal(a.before, y[fold.begin : fold.split])
        np.testing.assert_array_equal(a.zs, y[fold.split : fold.end])


def learned_parameters(learned):
    """What a candidate has learned, as plain values."""
    if hasattr(learned, "fit"):
        return model_to_dict(learned.fit.model)
    values = copy.deepcopy(vars(learned))
    return {name: repr(getattr(v, "__dict__", v)) for name, v in values.items()}


@pytest.fixture(scope="module")
def switching_series(fuzzy_model):
    data = fuzzy_model.simulate(500, RNG(5))
    return data.x[:, 0], data.y[:, 0]


def test_nothing_held_out_reaches_what_is_learned(switching_series) -> None:
    # All candidates learn the same whatever the held-out states, and the observations held out, are; and
    # what they say of a row does not depend on observations after it.
    x, y = switching_series
    common = {
        "candidates": ["hard1", "hard2", "fmc1", "imm", "kalman", "regression", "piecewise"],
        "n_folds": 1,
        "first": 0.5,
        "n_nodes": 0,
        "tolerance": 1e-3,
        "n_resamples": 100,
    }
    one = compare_models(x, y, RNG(0), **common)
    (fold,) = one.folds
    other_x, other_y = x.copy(), y.copy()
    other_x[fold.split :] = 1000.0 + np.arange(len(x) - fold.split)
    other_y[fold.split + 60 :] += 3.0
    two = compare_models(other_x, other_y, RNG(0), **common)
    assert not one.failures
    for name, learned in one.learned[0].items():
        assert learned_parameters(learned) == learned_parameters(two.learned[0][name]), name
        now, then = (
            result.learned[0][name].restore(v[: fold.split, None], v[fold.split :, None])
            for result, v in ((one, y), (two, other_y))
        )
        np.testing.assert_array_equal(now.mean[:60], then.mean[:60])
        assert np.abs(now.mean[60:] - then.mean[60:]).max() > 0.01
    assert all(b.rmse > 900.0 > a.rmse for a, b in zip(one.scores, two.scores, strict=True))


def test_the_profile_is_learned_anew_on_each_part_learned_on() -> None:
    # Oracle: the profile of those rows, taken by hand.
    n = 40 * 24
    x, y = (v[:, 0] for v in noise(n))
    time = np.datetime64("2014-01-06T00:00", "s") + np.arange(n) * np.timedelta64(3600, "s")
    found = compare_models(
        x, y, RNG(0), candidates=[remembering("a", 0.0)], n_folds=2, profile=True, time=time, n_resamples=100
    )
    squared = []
    for fold, learned in zip(found.folds, found.learned, strict=True):
        profile = DailyProfile().fit(x[: fold.split], time[: fold.split])
        np.testing.assert_allclose(
            learned["a"].part.x[:, 0], profile.transform(x[: fold.split], time[: fold.split])
        )
        held_out = slice(fold.split, fold.end)
        squared.append(profile.transform(x[held_out], time[held_out]) ** 2)  # it answers zero
    assert found.scores[0].rmse == pytest.approx(np.sqrt(np.concatenate(squared).mean()))
    # The times of a pandas object do as well, and working days may be given.
    series = pd.Series(x, index=pd.DatetimeIndex(time))
    workday = np.ones(n, dtype=bool)
    again = compare_models(
        series, y, RNG(0), candidates=[remembering("a", 0.0)], n_folds=2, profile=True, n_resamples=100
    )
    assert again.scores[0].rmse == pytest.approx(found.scores[0].rmse)
    other = compare_models(
        series,
        y,
        RNG(0),
        candidates=[remembering("a", 0.0)],
        n_folds=2,
        profile=True,
        workday=workday,
        n_resamples=100,
    )
    assert other.scores[0].rmse != pytest.approx(found.scores[0].rmse)


# ------------------------------------------------------------------ scores


def test_the_scores_are_those_of_the_definitions() -> None:
    x, y = noise(400)
    found = compare_models(
        x, y, RNG(0), candidates=[remembering("half", 0.5), remembering("zero", 0.0, likelihood=False)]
    )
    truth, zs = x[200:, 0], y[200:, 0]
    half, zero = found.scores
    assert half.rmse == pytest.approx(np.sqrt(np.mean((0.5 * zs - truth) ** 2)))
    assert half.coverage == np.mean(np.abs(0.5 * zs - truth) <= 1.6448536)
    assert half.log_likelihood == pytest.approx(-np.abs(zs).mean())
    assert np.isnan(zero.log_likelihood)
    assert half.rmse_low < half.rmse < half.rmse_high
    # Observations tell nothing here: to answer zero is best, and half is behind by as much as it is.
    assert found.best == "zero"
    assert (zero.difference, zero.difference_low, zero.difference_high) == (0.0, 0.0, 0.0)
    assert half.difference == pytest.approx(half.rmse - zero.rmse)
    assert half.difference_low < half.difference < half.difference_high
    folds = [np.sqrt(np.mean((0.5 * zs - truth)[k : k + 40] ** 2)) for k in range(0, 200, 40)]
    np.testing.assert_allclose(found.fold_rmse[:, 0], folds)
    baseline = [truth[k : k + 40] - x[: 200 + k].mean() for k in range(0, 200, 40)]
    assert found.baseline_rmse == pytest.approx(np.sqrt(np.mean(np.concatenate(baseline) ** 2)))


def test_rows_without_a_state_are_not_judged_and_rows_without_observation_have_no_likelihood() -> None:
    x, y = noise(400)
    x[[210, 390]], y[[220, 221]] = np.nan, np.nan
    (score,) = compare_models(x, y, RNG(0), candidates=[remembering("a")]).scores
    zs = np.nan_to_num(y[200:, 0])
    assert score.rmse == pytest.approx(np.sqrt(np.nanmean((zs - x[200:, 0]) ** 2)))
    assert score.log_likelihood == pytest.approx(-np.nanmean(np.abs(y[200:, 0])))


@pytest.mark.parametrize("m", [1, 2])
def test_the_log_score_is_that_of_the_claimed_normal_law_with_the_spread_of_its_mean(m) -> None:
    # Oracle: scipy's density in the units of the errors, summed over what is known of each row.
    x, y = noise(600, m=m)
    x, y = x * 10.0 ** np.arange(m), y * 10.0 ** np.arange(m)
    x[[310, 590], 0] = np.nan
    found = compare_models(
        x, y, RNG(0), candidates=[remembering("half", 0.5, std=2.0), remembering("zero", 0.0)], n_folds=2
    )
    scale = np.ones(1) if m == 1 else np.nanstd(x[:300], axis=0)
    truth, zs = x[300:], y[300:]
    for score, factor, std in zip(found.scores, (0.5, 0.0), (2.0, 1.0), strict=True):
        rows = np.nansum(norm.logpdf(truth / scale, factor * zs / scale, std / scale), axis=1)
        rows = rows[np.isfinite(truth).any(axis=1)]
        assert score.log_score == pytest.approx(rows.mean())
        # Rows are independent here, so that any blocks have the spread of a mean, but for chance.
        assert score.log_score_standard_error == pytest.approx(rows.std() / np.sqrt(len(rows)), rel=0.35)
    assert found.to_dataframe().loc["half", "log_score"] == found.scores[0].log_score
    assert " ± " in repr(found)
    assert max(map(len, repr(found).splitlines())) <= 100


def test_who_is_certain_and_wrong_has_the_worst_log_score_and_a_negative_std_is_a_failure() -> None:
    x, y = noise(300)
    x[:] = np.round(x)  # zero is right in some rows
    found = compare_models(
        x,
        y,
        RNG(0),
        candidates=[remembering("sure", 0.0, std=0.0), remembering("odd", std=-1.0), remembering("a")],
        n_resamples=100,
    )
    sure, a = found.scores
    assert sure.log_score == -np.inf
    assert np.isnan(sure.log_score_standard_error)
    assert np.isfinite([a.log_score, a.log_score_standard_error]).all()
    assert found.failures == {"odd": "fold 1: its std at held-out step 0 is -1.0"}


class Told(Learned):
    """Says what it is made with, of any observations."""

    def __init__(self, said):
        self.said = said

    def restore(self, before, zs):
        return self.said(len(zs)) if callable(self.said) else self.said

    def stepper(self):
        raise NotImplementedError


def telling(name, said):
    return Candidate(name, lambda part: Told(said))


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (lambda n: Estimates(mean=np.zeros((n, 1)), std=None), "its std is None, expected an array of shape"),
        (lambda n: Estimates(mean=None, std=np.ones((n, 1))), "its mean is None, expected an array of shape"),
        (lambda n: Estimates(mean=np.zeros((n, 1)), std=1.0), r"its std has shape \(\), expected \(150, 1\)"),
        (
            lambda n: Estimates(mean=np.zeros((n - 1, 1)), std=np.ones((n, 1))),
            r"its mean has shape \(149, 1\)",
        ),
        (
            lambda n: Estimates(mean=np.zeros((n, 1)), std=np.ones((n, 1)), log_likelihood=np.zeros(2)),
            r"its log_likelihood has shape \(2,\), expected \(150,\)",
        ),
        (
            lambda n: Estimates(
                mean=np.zeros((n, 1)),
                std=np.ones((n, 1)),
                density=NormalMixture.normal(np.zeros((2, 1)), np.ones((2, 1))),
            ),
            "its density is of 2 steps and 1 components, expected 150 and 1",
        ),
        (
            lambda n: Estimates(mean=np.zeros((n, 1)), std=np.ones((n, 1)), density=np.zeros(n)),
            "its density is .*, expected a NormalMixture or None",
        ),
        (None, "its restore returns None, expected Estimates"),
    ],
)
def test_estimates_that_are_incomplete_are_a_failure_of_the_candidate_by_name(said, why) -> None:
    x, y = noise(300)
    found = compare_models(x, y, RNG(0), candidates=[telling("odd", said), remembering("a")], n_folds=1)
    assert re.match(f"fold 1: {why}", found.failures["odd"])
    with pytest.raises(FuzzykfError, match=f"no candidate could be learned: odd, fold 1: {why}"):
        compare_models(x, y, RNG(0), candidates=[telling("odd", said)], n_folds=1)


def test_a_candidate_that_learns_nothing_is_a_failure_by_name() -> None:
    x, y = noise(300)
    odd = Candidate("odd", lambda part: None)
    found = compare_models(x, y, RNG(0), candidates=[odd, remembering("a")], n_folds=1)
    assert found.failures == {"odd": "fold 1: its learn returns None, expected something Learned"}


def test_the_log_score_of_a_mixture_is_that_of_its_density() -> None:
    # Oracle: two peaks at +-2, written out; the normal law of their moments is far behind.
    rng = RNG(4)
    x = 2.0 * rng.choice([-1.0, 1.0], size=400) + 0.5 * rng.normal(size=400)
    peaks = np.array([-2.0, 2.0])

    def said(n):
        density = NormalMixture(
            weights=np.full((n, 2), 0.5),
            means=np.tile(peaks[:, None], (n, 1, 1)),
            covariances=np.full((n, 2, 1, 1), 0.25),
        )
        mean, std = density.moments()
        return Estimates(mean=mean, std=std, density=density)

    found = compare_models(
        x, rng.normal(size=400), RNG(0), candidates=[telling("two", said), "line"], n_folds=2
    )
    two, line = found.scores
    truth = x[200:]
    assert two.log_score == pytest.approx(np.log(norm.pdf(truth[:, None], peaks, 0.5).mean(axis=1)).mean())
    assert two.normal_log_score == pytest.approx(norm.logpdf(truth, 0.0, np.sqrt(4.25)).mean())
    assert two.log_score > two.normal_log_score + 0.5
    low, high = said(1).density.interval(0.9)
    assert two.coverage == np.mean((low[0] <= truth) & (truth <= high[0]))
    assert (two.density, line.density) == ("mixture", "normal")
    assert line.normal_log_score == pytest.approx(line.log_score)
    assert "two has the highest log score" in found.verdict()
    assert "), for its mixture of normal distributions. Next is line" in found.verdict()


def test_several_components_count_in_their_standard_deviations() -> None:
    x, y = noise(400, m=2)
    units = np.array([1.0, 1e4])
    (score,) = compare_models(x * units, y * units, RNG(0), candidates=[remembering("a")]).scores
    expected = ((y - x)[200:] / x[:200].std(axis=0)) ** 2
    assert score.rmse == pytest.approx(np.sqrt(expected.mean()))
    partly = x * units
    partly[205, 1] = np.nan
    (score,) = compare_models(partly, y * units, RNG(0), candidates=[remembering("a")]).scores
    expected[5, 1] = np.nan
    assert score.rmse == pytest.approx(np.sqrt(np.nanmean(expected, axis=1).mean()))


@settings(max_examples=10, deadline=None)
@given(scale=st.floats(1e-3, 1e3), shift=st.floats(-1e3, 1e3), seed=st.integers(0, 100))
def test_units_of_state_and_observation_do_not_matter(scale, shift, seed) -> None:
    x, y = noise(220, seed)
    x = x + y
    common = {"candidates": ["kalman", "regression", "piecewise"], "n_folds": 2, "n_resamples": 100}
    one = compare_models(x, y, RNG(0), **common)
    two = compare_models(scale * x + shift, shift - scale * y, RNG(0), **common)
    for a, b in zip(one.scores, two.scores, strict=True):
        assert b.rmse == pytest.approx(scale * a.rmse, rel=1e-6)
        assert b.coverage == pytest.approx(a.coverage, abs=0.01)
        assert b.log_score == pytest.approx(a.log_score - np.log(scale), abs=1e-5)
    assert two.scores[0].log_likelihood == pytest.approx(
        one.scores[0].log_likelihood - np.log(scale), abs=1e-6
    )


def test_on_switching_data_switches_win_and_the_verdict_says_so() -> None:
    rng = RNG(7)
    n = 1000
    r = np.cumsum(rng.random(n) < 0.1) % 2
    y, x = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (4.0 if r[k] else -4.0) + rng.normal()
        x[k] = 0.3 * x[k - 1] + (1.5 if r[k] else -1.5) * y[k] + 0.5 * rng.normal()
    found = compare_models(
        x, y, RNG(0), candidates=["hard1", "hard2", "imm", "kalman", "regression"], n_folds=2, tolerance=1e-4
    )
    rmse = {score.name: score.rmse for score in found.scores}
    assert found.best in ("hard2", "imm")
    assert max(rmse["hard2"], rmse["imm"]) < 0.6  # the noise of the state is 0.5
    assert min(rmse["kalman"], rmse["hard1"], rmse["regression"]) > 2 * rmse["hard2"]
    assert found.verdict("MW").startswith(f"{found.best} has the lowest RMSE, 0.")
    likeliest = max(found.scores[:4], key=lambda score: score.log_likelihood).name
    told = f"The observations are likeliest under {likeliest}; regressions define no likelihood."
    assert found.verdict().endswith(told)


def test_the_verdict_names_feedback_where_it_wins_and_says_what_to_try() -> None:
    rng = RNG(0)
    x = np.zeros(1000)
    for k in range(1, len(x)):  # a slow state in noise: each observation tells of the states before it
        x[k] = 0.95 * x[k - 1] + 0.3 * rng.normal()
    y = x + rng.normal(size=len(x))
    options = {"n_folds": 2, "tolerance": 1e-4, "n_resamples": 100}
    found = compare_models(x, y, RNG(0), candidates=["hard1", "kalman"], **options)
    assert (
        "A likely reason is feedback: in kalman each observation corrects the state that went before it, in "
        "hard1 it does not. SwitchingStateSpace has regimes and feedback: try switching-ssm and "
        "switching-ssm-hard."
    ) in found.verdict()
    assert {name: one.feedback for name, one in found.learned[-1].items()} == {"hard1": False, "kalman": True}
    for others in (["kalman", "line"], ["hard1", "line"]):  # nothing to be ahead of; nothing that has it
        assert "feedback" not in compare_models(x, y, RNG(0), candidates=others, **options).verdict()


def test_where_switches_with_feedback_were_compared_the_verdict_does_not_ask_for_them() -> None:
    class Says(Learned):
        def __init__(self, feedback: bool) -> None:
            self.feedback = feedback

        restore = stepper = None

    figures = {"rmse_low": 0.9, "rmse_high": 3.0, "coverage": 0.9, "log_likelihood": None}
    ranked = [
        Score("kalman", rmse=1.0, difference=0.0, difference_low=0.0, difference_high=0.0, **figures),
        Score("hard2", rmse=2.0, difference=1.0, difference_low=0.5, difference_high=1.5, **figures),
    ]
    learned = {"kalman": Says(True), "hard2": Says(False)}
    assert about_feedback(ranked, learned, "name").endswith("try switching-ssm and switching-ssm-hard.")
    learned["switching-ssm-hard"] = Says(True)
    assert about_feedback(ranked, learned, "name").endswith("in hard2 it does not.")
    level = [ranked[0], replace(ranked[1], difference_low=-0.1)]
    assert about_feedback(level, learned, "name") == ""


def test_a_draw_is_no_victory_and_a_single_candidate_has_no_rival() -> None:
    x, y = noise(400)
    found = compare_models(x, y, RNG(1), candidates=[remembering("a", 0.01), remembering("b", -0.01)])
    assert not found.is_certain
    assert "): not a significant difference. " in found.verdict()
    clear = compare_models(x + 3 * y, y, RNG(1), candidates=[remembering("a", 3.0), remembering("b", -1.0)])
    assert clear.is_certain
    assert "): a significant difference. " in clear.verdict()
    alone = compare_models(x, y, RNG(1), candidates=[remembering("a")])
    assert not alone.is_certain
    assert alone.verdict("GW").startswith("a is the only candidate, with an RMSE of")


def test_the_table_has_the_best_first_and_notes_are_those_of_the_last_fold() -> None:
    x, y = noise(400)
    found = compare_models(x, y, RNG(0), candidates=[remembering("bad", 5.0), remembering("good", 0.0)])
    table = found.to_dataframe()
    assert list(table.index) == ["good", "bad"]
    assert table.loc["bad", "rmse"] == found.scores[0].rmse
    by_fold = found.to_dataframe(by_fold=True)
    assert list(by_fold.index) == [200, 240, 280, 320, 360]
    np.testing.assert_array_equal(by_fold["good"], found.fold_rmse[:, 1])
    assert found.notes() == {"bad": ("learned on 360 rows",), "good": ("learned on 360 rows",)}


def test_the_seed_decides_the_intervals_and_nothing_else() -> None:
    x, y = noise(300)
    a, b, c = (compare_models(x, y, RNG(s), candidates=[remembering("a")]).scores[0] for s in (1, 1, 2))
    assert (a.rmse_low, a.rmse_high) == (b.rmse_low, b.rmse_high) != (c.rmse_low, c.rmse_high)
    assert a.rmse == c.rmse


# ------------------------------------------------------------------ failures


def test_a_candidate_that_fails_is_left_out_and_the_reason_kept() -> None:
    def fragile(part):
        if len(part) > 200:
            raise FuzzykfError("too much for me")
        return Remembering(part, 1.0, 1.0, True)

    x, y = noise(300)
    found = compare_models(
        x, y, RNG(0), candidates=[Candidate("fragile", fragile), remembering("a")], n_folds=3, n_resamples=100
    )
    assert [score.name for score in found.scores] == ["a"]
    assert found.failures == {"fragile": "fold 3: too much for me"}
    with pytest.raises(FuzzykfError, match="no candidate could be learned: fragile, fold 3: too much"):
        compare_models(x, y, RNG(0), candidates=[Candidate("fragile", fragile)], n_folds=3)


def test_numbers_that_are_not_finite_are_a_failure() -> None:
    x, y = noise(300)
    found = compare_models(x, y, RNG(0), candidates=[remembering("nan", std=np.nan), remembering("a")])
    assert found.failures["nan"].startswith("fold 1: its std at held-out step 0 is")


def test_a_program_error_in_a_candidate_is_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        compare_models(*noise(300), RNG(0), candidates=[Candidate("odd", lambda part: 1 / 0)])


# ------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"candidates": []}, "candidates: got .*, expected one at least"),
        ({"candidates": ["kalman", "kalman"]}, "each name once"),
        (
            {"candidates": ["kalmann"]},
            "candidates: got 'kalmann', expected names of hard1, hard2, hard3, fmc1",
        ),
        ({"candidates": ["hard0"]}, "candidates: got 'hard0'"),
        ({"n_folds": 0}, "n_folds: got 0"),
        ({"first": 1.0}, "first: got 1, expected a share"),
        (
            {"first": 0.9},
            "first: 0.9 of 300 rows are 270 to learn on at first and 30 to hold out, expected at",
        ),
        ({"first": 0.3}, "are 90 to learn on at first"),
        ({"window": "fixed"}, "window: got 'fixed', expected 'expanding' or 'sliding'"),
        ({"n_resamples": 99}, "n_resamples: got 99"),
        ({"profile": True}, "time: missing"),
        ({"workday": [True]}, r"workday: got shape \(1,\), expected \(300,\)"),
    ],
)
def test_inadmissible_options_are_refused_before_anything_is_learned(options, message) -> None:
    def learn(part):
        raise AssertionError

    with pytest.raises(ParameterError, match=message):
        compare_models(*noise(300), RNG(0), **{"candidates": [Candidate("a", learn)], **options})


def test_inadmissible_data_are_refused() -> None:
    x, y = noise(300)
    with pytest.raises(ShapeError, match="y: got 299 rows, expected 300"):
        compare_models(x, y[1:], RNG(0))
    infinite = x.copy()
    infinite[7] = np.inf
    with pytest.raises(ParameterError, match="x: row 7 is infinite"):
        compare_models(infinite, y, RNG(0))
    for rows, message in (
        (slice(0, 150), "missing in all 150 rows"),
        (slice(160, 300), "10 held-out states"),
    ):
        gap = x.copy()
        gap[rows] = np.nan
        with pytest.raises(ParameterError, match=message):
            compare_models(gap, y, RNG(0), candidates=[remembering("a")])


def test_all_candidates_are_known_by_name_and_progress_is_told(capsys) -> None:
    assert CANDIDATES == (
        "hard1",
        "hard2",
        "hard3",
        "fmc1",
        "fmc2",
        "free",
        "imm",
        "kalman",
        "regression",
        "piecewise",
    )
    # A bar needs a terminal; without one, nothing is printed and the result is the same.
    x, y = noise(220)
    common = {"candidates": ["kalman"], "n_resamples": 100}
    loud = compare_models(x, y, RNG(0), progress=True, **common)
    assert loud.scores[0].rmse == compare_models(x, y, RNG(0), **common).scores[0].rmse
    assert capsys.readouterr() == ("", "")


# ------------------------------------------------------------------ real data


@pytest.mark.study
def test_the_page_tells_what_comes_out_on_the_packaged_data() -> None:
    v = load_victoria(hourly=True)
    found = compare_models(v.demand, v.temperature, RNG(0), profile=True, time=v.time, workday=v.workday)
    page = (Path(__file__).parents[2] / "docs" / "howto" / "fit.md").read_text(encoding="utf-8")
    row = r"^\| (\w+) \| ([\d.]+) \| (?:([\d.]+)–([\d.]+))? ?\| (\d+) % \| (none|-[\d.]+) \|$"
    told = {name: rest for name, *rest in re.findall(row, page, re.MULTILINE)}
    table = found.to_dataframe()
    assert list(told) == list(table.index)
    for name, (rmse, low, high, coverage, likelihood) in told.items():
        score = table.loc[name]
        assert score["rmse"] == pytest.approx(float(rmse), rel=0.005)
        if low:
            assert score["difference_low"] == pytest.approx(float(low), abs=0.002)
            assert score["difference_high"] == pytest.approx(float(high), abs=0.002)
        assert score["coverage"] == pytest.approx(float(coverage) / 100, abs=0.006)
        assert (likelihood == "none") == np.isnan(score["log_likelihood"])
        if likelihood != "none":
            assert score["log_likelihood"] == pytest.approx(float(likelihood), abs=0.002)
    assert found.is_certain

"""The switching filters as candidates: learned with and without the switch, and the choice of a law."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.stats import norm

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzykfError
from fuzzykf.comparison import LearningPart
from fuzzykf.comparison.candidates import WARM_UP
from fuzzykf.comparison.candidates import switching as candidates
from fuzzykf.comparison.candidates.switching import growth_notes, learn_chosen_law, learn_fuzzy, learn_hard


@pytest.fixture(scope="module")
def series(fuzzy_model):
    data = fuzzy_model.simulate(900, np.random.default_rng(3))
    return data.x, data.y, data.r


def part(series, n=600, r=None, **options):
    x, y, _ = series
    return LearningPart(x=x[:n], y=y[:n], r=r, n_nodes=2, tolerance=1e-3, **options)


def test_estimates_are_those_of_the_filter_run_from_a_little_earlier(series) -> None:
    y = series[1]
    learned = learn_hard(part(series), 2)
    found = learned.restore(y[:600], y[600:])
    whole = learned.filter.filter(y[500:])
    np.testing.assert_array_equal(found.mean, whole.x[100:])
    np.testing.assert_array_equal(found.std, np.sqrt(whole.P[100:, :, 0]))
    np.testing.assert_array_equal(found.log_likelihood, whole.log_likelihood[100:])
    np.testing.assert_array_equal(found.switch, whole.switch_mean[100:])


def test_the_switch_is_learned_if_it_is_not_given_and_used_if_it_is(series) -> None:
    hidden, told = (
        learn_fuzzy(part(series, 300), "fmc1"),
        learn_fuzzy(part(series, r=series[2][:600]), "fmc1"),
    )
    assert len(hidden.fit.trace) > 2
    assert len(told.fit.trace) == 1
    np.testing.assert_array_equal(told.fit.switch_mean, series[2][:600])
    # A hard model is told the switch rounded.
    np.testing.assert_array_equal(
        learn_hard(part(series, r=series[2][:600]), 2).fit.switch_mean, series[2][:600] >= 0.5
    )


def test_a_hard_model_is_learned_once_and_not_taken_over_by_another_part(series) -> None:
    whole = part(series)
    assert whole.hard(2) is whole.hard(2)
    assert whole.first(300).hard(2) is not whole.hard(2)
    assert len(whole.first(300)) == 300


@pytest.fixture(scope="module")
def guessed(series):
    """Fits to the first rows with a switch that is more or less wrong, each made once: (law, rows) -> fit."""
    x, y, r = series
    guesses = {"fmc1": np.roll(r, 1), "fmc2": r, "free": np.roll(r, 40), "fade": np.roll(r, 60)}

    @functools.cache
    def fit(law, n):
        return CGOFMSModel.fit(x[:n], y[:n], guesses[law][:n], form="regression")

    return fit


@pytest.fixture
def quick_laws(guessed, monkeypatch):
    """Laws that are learned in no time; and those that fail."""
    broken = set()

    def fit(self, law):
        if law in broken:
            raise FuzzykfError(f"no {law} today")
        return guessed(law, len(self))

    monkeypatch.setattr(LearningPart, "fuzzy", fit)
    return broken


def test_a_model_is_learned_once_on_the_same_rows(series) -> None:
    quick = part(series, 200, max_iter=2)
    for learn in (quick.fuzzy, lambda law, **told: quick.hard(2, **told)):
        fit = learn("fmc1")
        assert learn("fmc1") is fit
        assert learn("fmc1", state_feedback=False) is not fit
    again = quick.first(150)
    assert len(again.fuzzy("fmc1").class_weights) == 150


def density_of(learned, x, y, split):
    """Log-density of the states of the next 50 rows: normal laws, one a node, mixed by the filter's mu."""
    result = learned.filter.filter(y[split - WARM_UP : split + 50], keep_nodes=True)
    mean, std = result.node_x[WARM_UP:, :, 0], np.sqrt(result.node_P[WARM_UP:, :, 0, 0])
    return np.log((result.mu[WARM_UP:] * norm.pdf(x[split : split + 50], mean, std)).sum(axis=1))


def test_the_law_is_the_one_of_best_log_score_on_rolling_blocks(series, quick_laws) -> None:
    told: list[str] = []
    x, y, _ = series
    learned = learn_chosen_law(part(series, 300, progress=told.append))
    # Oracle: the filters, learned on the first 150, 200 and 250 rows and judged on the next 50.
    scores, errors = {}, {}
    for law in ("fmc1", "fmc2", "free", "fade"):
        blocks = [(split, learn_fuzzy(part(series, split), law)) for split in (150, 200, 250)]
        found = [one.restore(y[:split], y[split : split + 50]) for split, one in blocks]
        missed = x[150:300] - np.concatenate([one.mean for one in found])
        scores[law] = np.mean([density_of(one, x, y, split) for split, one in blocks])
        scores[law] += np.log(np.std(x[:300]))
        errors[law] = np.sqrt(np.mean(missed**2)) / np.std(x[:300])
    best, second = sorted(scores, key=lambda law: -scores[law])[:2]
    assert best == learned.choice == "fmc2"
    assert learned.description.startswith(
        f"law: fmc2 (chosen from fmc1, fmc2, free, fade on 3 rolling blocks by log score: {scores[best]:.3f} "
        f"against {scores[second]:.3f} with {second}, difference {scores[best] - scores[second]:.2g} ± "
    )
    assert f"; RMSE {errors[best]:.3g} against {errors[second]:.3g} std" in learned.description
    tried = [f"trying the law {law}" for law in ("fmc2", "free", "fade")]
    assert told == [*tried, "learning with the law fmc2"]
    # The winner has learned on the whole part.
    assert learned.fit.n_observations == 300


def test_a_law_that_cannot_be_learned_is_passed_over(series, quick_laws) -> None:
    quick_laws.update({"fmc2", "free", "fade"})
    told = learn_chosen_law(part(series, 300)).description
    assert told.startswith("law: fmc1 (chosen from fmc1 on 3 rolling blocks")
    assert "; free could not be learned: no free today" in told
    quick_laws.add("fmc1")
    refused = "; ".join(f"{law}: no {law} today" for law in ("fmc1", "fmc2", "free", "fade"))
    with pytest.raises(FuzzykfError, match=refused):
        learn_chosen_law(part(series, 300))


def test_with_a_given_switch_there_is_no_choice(series, monkeypatch) -> None:
    monkeypatch.setattr(candidates, "choose", None)
    assert learn_chosen_law(part(series, r=series[2][:600])).description == "law: fmc1"


def test_a_breakdown_of_linear_algebra_is_an_error_that_explains_itself(series, monkeypatch) -> None:
    def fit(*args, **kwargs):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(CGOMSModel, "fit", fit)
    monkeypatch.setattr(CGOFMSModel, "fit", fit)
    for learn in (lambda: part(series).hard(3), lambda: part(series).fuzzy("fmc1")):
        with pytest.raises(FuzzykfError, match=r"no maximum .* \(Singular matrix\).* try fewer regimes"):
            learn()


def test_warnings_of_the_fit_are_notes(series) -> None:
    r = np.zeros(600)
    r[10:13] = 1.0
    notes = learn_hard(part(series, r=r), 2).notes
    assert any("regime 1 is rarely visited" in note for note in notes)


@pytest.mark.parametrize(
    ("Axx", "expected"), [(0.99, None), (1.02, "stays at 1, the error of the state grows by 0.02 ")]
)
def test_a_state_that_drifts_while_the_switch_stays_is_noted(Axx, expected) -> None:
    pairs = np.ones((2, 2, 1, 1))
    model = CGOMSModel.from_regressions(
        [[0.9, 0.1], [0.1, 0.9]],
        Ayy=0.5 * pairs,
        Ny=0 * pairs[..., 0],
        Qyy=pairs,
        Axx=np.array([[[[0.5]], [[3.0]]], [[[3.0]], [[Axx]]]]),  # leaving a regime does not count
        H=0 * pairs,
        G=pairs,
        c=0 * pairs[..., 0],
        C=pairs,
        means=np.zeros((2, 2)),
        covariances=np.broadcast_to(np.eye(2), (2, 2, 2)),
    )
    notes = growth_notes(model.on_nodes())
    assert len(notes) == (expected is not None)
    for note in notes:
        assert expected in note

"""The estimator of scikit-learn: its contract, its parameters, its place in pipelines and validation."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, OFSRFilter, compat
from fuzzykf.compat import SwitchingRegressor
from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.switching.learning import data

TIME = "an estimate rests on the rows before its own"
EXACT = (
    "the check learns from states that are one of the observations, to the digit: there is no noise to learn"
)

#: What scikit-learn asks of all estimators, and a filter, or a model with noise, cannot keep.
EXPECTED = {
    "check_methods_sample_order_invariance": TIME,
    "check_methods_subset_invariance": TIME,
    "check_estimators_dtypes": EXACT,
    "check_regressors_no_decision_function": EXACT,
    "check_regressor_multioutput": "the check has fewer rows than the model has components at two times",
}

QUICK = {"form": "regression", "n_starts": 1, "max_iter": 1}


@parametrize_with_checks(
    [SwitchingRegressor("hard", **QUICK)], expected_failed_checks=lambda estimator: EXPECTED
)
def test_the_contract_of_scikit_learn(estimator, check, monkeypatch) -> None:
    # The checks learn from 10 to 20 rows, which the learner refuses as too few; see the next test.
    monkeypatch.setattr(data, "MIN_TRANSITIONS", 1)
    check(estimator)


def test_too_few_rows_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ParameterError, match=r"hold 9 steps .* expected at least 20"):
        SwitchingRegressor(**QUICK).fit(rng.normal(size=(10, 1)), rng.normal(size=10))


@pytest.fixture(scope="module")
def series():
    """Observations (n, 2) and states (n,) with a switch that jumps."""
    rng = np.random.default_rng(1)
    r = (np.arange(600) // 4) % 2  # often, so that all pairs of regimes are learned from many steps
    Y = rng.normal(size=(600, 2)) + 4.0 * r[:, None]
    return Y, np.where(r == 1, 8.0 - Y[:, 0], Y[:, 0]) + 0.3 * rng.normal(size=600)


FEW = {"form": "regression", "state_feedback": False, "n_starts": 1, "max_iter": 10}


def hard(x, y):
    return CGOMSMFilter(CGOMSModel.fit(x, y, n_switches=3, **FEW).model)


def fuzzy(x, y):
    return OFSRFilter(CGOFMSModel.fit(x, y, n_nodes=2, **FEW).model, 2)


def fade(x, y):
    return OFSRFilter(CGOFMSModel.fit(x, y, law=FadeLaw.between(30, 5), n_nodes=2, **FEW).model, 2)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"switch": "hard", "n_switches": 3}, hard),
        ({"n_nodes": 2}, fuzzy),
        ({"switch": FadeLaw.between(30, 5), "n_nodes": 2}, fade),
    ],
)
def test_it_learns_and_filters_as_the_model_does(series, options, expected) -> None:
    Y, x = series
    estimator = SwitchingRegressor(**options, **FEW).fit(Y[:400], x[:400])
    found = expected(x[:400], Y[:400]).filter(Y[400:])
    mean, std = estimator.predict(Y[400:], return_std=True)
    np.testing.assert_array_equal(mean, found.x[:, 0])
    np.testing.assert_array_equal(std, np.sqrt(found.P[:, 0, 0]))
    np.testing.assert_array_equal(estimator.predict(Y[400:]), mean)
    error = np.sum((mean - x[400:]) ** 2) / np.sum((x[400:] - x[400:].mean()) ** 2)
    assert estimator.score(Y[400:], x[400:]) == pytest.approx(1.0 - error, rel=1e-12)
    assert estimator.n_iter_ == len(estimator.fit_result_.trace)


def test_states_may_be_vectors_and_what_is_missing_may_be_missing(series) -> None:
    Y, x = series
    Y, states = Y.copy(), np.column_stack([x, np.cos(np.arange(600)) - x])
    Y[450:460], Y[470, 1], states[500:520, 1] = np.nan, np.nan, np.nan
    estimator = SwitchingRegressor("hard", **FEW).fit(Y[:400], states[:400])
    mean, std = estimator.predict(Y[400:], return_std=True)
    assert mean.shape == std.shape == (200, 2)
    assert np.isfinite(mean).all()
    assert (std > 0.0).all()
    known = np.isfinite(states[400:, 1])
    weights = np.ones(200)
    scores = [estimator.score(Y[400:], states[400:]), estimator.score(Y[400:], states[400:], weights)]
    errors = ((mean - states[400:])[known] ** 2).sum(0) / (200 - 20) / states[400:][known].var(0)
    np.testing.assert_allclose(scores, 1.0 - errors.mean(), rtol=1e-10)
    with pytest.raises(ParameterError, match="y: no row has a measured state"):
        estimator.score(Y[400:], np.full((200, 2), np.nan))


def test_it_stands_in_pipelines_and_in_validation(series) -> None:
    Y, x = series
    chain = make_pipeline(StandardScaler(), SwitchingRegressor("hard", **FEW))
    folds = TimeSeriesSplit(3)
    scores = cross_val_score(chain, Y, x, cv=folds)
    by_hand = [clone(chain).fit(Y[a], x[a]).score(Y[b], x[b]) for a, b in folds.split(Y)]
    np.testing.assert_array_equal(scores, by_hand)
    assert (scores > 0.9).all()  # a line has less than 0.4
    search = GridSearchCV(chain, {"switchingregressor__n_switches": [1, 2]}, cv=folds).fit(Y, x)
    assert search.best_params_ == {"switchingregressor__n_switches": 2}


def test_names_of_columns_are_kept_and_asked_for(series) -> None:
    Y, x = series
    index = pd.date_range("2024-01-01", periods=600, freq="h")
    frame, states = pd.DataFrame(Y, index, ["a", "b"]), pd.Series(x, index)
    estimator = SwitchingRegressor("hard", **FEW).fit(frame[:400], states[:400])
    assert list(estimator.feature_names_in_) == ["a", "b"]
    np.testing.assert_array_equal(
        estimator.predict(frame[400:]),
        SwitchingRegressor("hard", **FEW).fit(Y[:400], x[:400]).predict(Y[400:]),
    )
    with pytest.raises(ValueError, match="feature names"):
        estimator.predict(frame[["b", "a"]])
    for call in (lambda f: estimator.predict(f), lambda f: clone(estimator).fit(f, x)):
        with pytest.raises(ParameterError, match=r"X: row 1 is .* expected rows in the order of time"):
            call(frame[::-1])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"switch": "soft"}, "switch: got 'soft', expected 'hard', "),
        ({"switch": "chain"}, "switch: got 'chain', expected 'hard', "),
        ({"switch": 3}, "switch: got 3, expected 'hard', "),
        ({"switch": "hard", "n_nodes": 3}, "n_nodes: got 3 with switch='hard', expected None"),
        ({"n_switches": 3}, "n_switches: got 3, expected None, or 2"),
        ({"switch": "hard", "n_switches": 0}, "n_switches"),
        ({"random_state": "seed"}, "random_state: got 'seed', expected None"),
        ({"random_state": -1}, "random_state: got -1, expected None"),
        ({"n_starts": 5}, "random_state: got None, expected"),
    ],
)
def test_parameters_that_are_no_good_are_named(series, options, message) -> None:
    Y, x = series
    with pytest.raises(ParameterError, match=message):
        SwitchingRegressor(**{**QUICK, **options}).fit(Y, x)


def test_a_seed_draws_the_same_starts_again(series) -> None:
    Y, x = series
    one, two = (
        SwitchingRegressor("hard", form="regression", n_starts=5, max_iter=2, random_state=seed).fit(Y, x)
        for seed in (3, np.random.default_rng(3))
    )
    np.testing.assert_array_equal(one.predict(Y), two.predict(Y))


def test_nothing_is_estimated_before_it_was_learned() -> None:
    with pytest.raises(NotFittedError):
        SwitchingRegressor().predict([[1.0]])


def test_scikit_learn_is_imported_when_the_name_is_used(monkeypatch) -> None:
    code = "import sys, fuzzykf.compat; print('sklearn' in sys.modules, dir(fuzzykf.compat))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "False ['SwitchingRegressor']\n"
    monkeypatch.delitem(vars(compat), "SwitchingRegressor", raising=False)
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(MissingDependencyError, match=r"needs scikit-learn: pip install 'fuzzykf\[compare\]'"):
        _ = compat.SwitchingRegressor
    with pytest.raises(AttributeError, match="no attribute 'Regressor'"):
        _ = compat.Regressor


def test_a_model_is_learned_for_its_filter_inside_of_a_pipeline() -> None:
    rng = np.random.default_rng(0)
    regime = (np.arange(400) // 20) % 2
    Y = rng.normal(size=(400, 1)) + 4.0 * regime[:, None]
    x = np.where(regime == 1, 8.0 - Y[:, 0], Y[:, 0]) + 0.3 * rng.normal(size=400)
    options = {"form": "regression", "n_starts": 1, "max_iter": 10}
    estimator = SwitchingRegressor("hard", objective="filter", **options).fit(Y, x)
    expected = CGOMSModel.fit(x, Y, objective="filter", **options)
    assert estimator.fit_result_.training == expected.training
    assert estimator.get_params()["objective"] == "filter"

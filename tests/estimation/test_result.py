"""What a fit by maximum likelihood tells: numbers, intervals, warnings, and text."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.estimation.free import read_free
from fuzzykf.estimation.result import LikelihoodFit, maximum_likelihood
from fuzzykf.results import FitResult

FREE = read_free(
    {"R": "diagonal", "b": "full"},
    {"R": np.eye(2), "b": np.array([5.0])},
    covariances=["R"],
    vectors=["b"],
)


def f(z):
    """200 observations: variances 4 and 0 are best, and b = -1 with the standard error 1/2."""
    v = np.exp(z[:2])
    value = -100.0 * (z[0] + 4.0 / v[0]) - 3.0 * v[1] - 2.0 * (z[2] + 1.0) ** 2
    return float(value), np.array([-100.0 * (1.0 - 4.0 / v[0]), -3.0 * v[1], -4.0 * (z[2] + 1.0)])


def fitted(**options) -> LikelihoodFit:
    return maximum_likelihood(f, FREE, dict, 200, **options)


def test_estimates_standard_errors_and_intervals() -> None:
    fit = fitted()
    assert isinstance(fit, FitResult)
    assert list(fit.estimates) == list(fit.standard_errors) == ["R[0, 0]", "R[1, 1]", "b[0]"]
    np.testing.assert_allclose(list(fit.estimates.values()), [4.0, 0.0, -1.0], rtol=1e-5)
    np.testing.assert_allclose(list(fit.standard_errors.values()), [0.4, np.nan, 0.5], rtol=1e-5)
    half = 1.959963984540054
    ends = fit.intervals()
    np.testing.assert_allclose(ends["R[0, 0]"], 4.0 * np.exp([-0.1 * half, 0.1 * half]), rtol=1e-5)
    np.testing.assert_allclose(ends["b[0]"], [-1.0 - 0.5 * half, -1.0 + 0.5 * half], rtol=1e-5)
    assert np.isnan(ends["R[1, 1]"]).all()
    np.testing.assert_array_equal(fit.model["R"], np.diag([fit.estimates["R[0, 0]"], 0.0]))


def test_intervals_of_probabilities_stay_below_one() -> None:
    fit = replace(fitted(), shares=frozenset({"p", "q"}), estimates={"p": 0.8, "q": 0.0})
    fit = replace(fit, standard_errors={"p": 0.16, "q": np.nan})
    low, high = fit.intervals()["p"]
    logits = np.log([low / (1.0 - low), high / (1.0 - high)])
    np.testing.assert_allclose(logits, np.log(4.0) + np.array([-1.959963984540054, 1.959963984540054]))
    assert np.isnan(fit.intervals()["q"]).all()


def test_criteria_count_what_was_free() -> None:
    fit = fitted()
    top = f(np.array([np.log(4.0), -np.inf, -1.0]))[0]
    assert fit.log_likelihood == pytest.approx(top, rel=1e-10)
    assert (fit.n_parameters, fit.n_observations, fit.converged) == (3, 200, True)
    assert fit.aic == pytest.approx(6.0 - 2.0 * top)
    assert fit.bic == pytest.approx(3.0 * np.log(200) - 2.0 * top)


def test_the_summary_has_a_table_and_warnings_below() -> None:
    lines = str(fitted(warnings=("mind this",)).summary()).splitlines()
    assert lines[0] == "dict, by maximum likelihood"
    where = {word: k for k, line in enumerate(lines) for word in line.split("  ") if word}
    for word in (
        "log-likelihood",
        "AIC",
        "BIC",
        "observations",
        "parameters",
        "converged",
        "standard errors",
    ):
        assert word in where
    table = lines.index("parameters")
    assert lines[table + 1].split() == ["parameter", "estimate", "std", "err", "[2.5", "%", "97.5", "%]"]
    assert lines[table + 2].split() == ["R[0,", "0]", "4", "0.4", "3.2881", "4.8661"]
    assert lines[table + 3].split() == ["R[1,", "1]", "0", "-", "-", "-"]
    assert lines[table + 5 :] == [
        "warnings",
        "  - mind this",
        "  - R[1, 1]: at its bound; the estimate is 0, and there is no standard error",
    ]
    assert "[5 %" in str(fitted().summary(0.9))


def test_it_shows_itself_in_text_and_notebooks() -> None:
    fit = fitted()
    assert repr(fit) == str(fit.summary())
    html = fit._repr_html_()
    assert html.count("<table>") == 2
    assert html.index("std err") < html.index("warning: R[1, 1]: at its bound")
    many = {f"H[{k}, 0]": 1.0 for k in range(60)}
    long = replace(fit, estimates=many, standard_errors=many)
    assert len(repr(long).splitlines()) <= 30
    assert "at its bound" in repr(long)
    assert "50 more: see summary()" in repr(long)
    assert "H[59, 0]" in str(long.summary())


def test_maxima_that_are_about_as_good_are_told() -> None:
    free = read_free({"b": "full"}, {"b": np.array([-2.5])}, covariances=[], vectors=["b"])

    def hills(z):
        parts = np.array([-0.5 * (z[0] + 2.0) ** 2 / 0.09, 1.0 - 0.5 * (z[0] + 4.0) ** 2 / 0.09])
        share = np.exp(parts - np.logaddexp(*parts))
        slope = -(share[0] * (z[0] + 2.0) + share[1] * (z[0] + 4.0)) / 0.09
        return float(np.logaddexp(*parts)), np.array([slope])

    fit = maximum_likelihood(hills, free, dict, 10, n_starts=12, rng=np.random.default_rng(0))
    assert [round(one.estimates["b[0]"], 4) for one in fit.maxima] == [-4.0, -2.0]
    assert fit.warnings == (
        "another maximum has a log-likelihood that is less by 1 only: b[0] -2 instead of -4",
    )
    assert "12, 2 maxima" in str(fit.summary())


def test_a_search_that_is_cut_short_is_told() -> None:
    fit = fitted(max_iter=1)
    assert not fit.converged
    assert "not converged after 1 iteration (max_iter = 1)" in fit.warnings[0]


def test_it_can_be_pickled() -> None:
    fit = fitted()
    again = pickle.loads(pickle.dumps(fit))
    assert repr(again) == repr(fit)
    np.testing.assert_array_equal(again.covariance, fit.covariance)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: fitted(n_starts=0), "n_starts"),
        (lambda: fitted(n_starts=2), "rng"),
        (lambda: fitted(rng=3), "rng"),
        (lambda: fitted(max_iter=0), "max_iter"),
        (lambda: fitted(tolerance=0.0), "tolerance"),
        (lambda: fitted(tolerance="small"), "tolerance"),
        (lambda: fitted().intervals(1.0), "level"),
        (lambda: fitted().summary(0.0), "level"),
        (lambda: fitted().bootstrap(1, np.random.default_rng(0)), "bootstrap"),
        (lambda: fitted().bootstrap(0, np.random.default_rng(0)), "n_replicates"),
        (lambda: fitted().bootstrap(1, 0), "rng"),
    ],
)
def test_inadmissible_arguments_are_named(call, name) -> None:
    with pytest.raises(ParameterError, match=rf"^{name}"):
        call()

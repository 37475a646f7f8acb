"""What the summary of a fit says: every number of the fit, and no more than it knows."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw
from fuzzykf.results import FitResult

Z = np.array([[1.0, 0.5], [0.5, 1.0]])
PAIR = np.block([[Z, 0.8 * Z], [0.8 * Z, Z]])
TRUTH = CGOFMSModel(
    FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(PAIR, (2, 2, 4, 4)), 1
)
FAST = {"n_starts": 1, "max_iter": 3, "form": "regression"}


def known(data):
    return CGOFMSModel.fit(data.x, data.y, data.r)


def hidden(data):
    y = data.y.copy()
    y[10:13] = np.nan
    return CGOFMSModel.fit(data.x, y, law="free", **FAST)


def hard(data):
    return CGOMSModel.fit(data.x, data.y, n_switches=3, **FAST)


def several(data):
    return CGOMSModel.fit(
        np.hstack([data.x, data.y**2]), data.y, (data.r > 0.5) * 1.0, n_switches=2, form="regression"
    )


FITS = {"known": known, "hidden": hidden, "hard": hard, "several": several}


@pytest.fixture(scope="module")
def fits():
    data = TRUTH.simulate(300, np.random.default_rng(0))
    return {name: make(data) for name, make in FITS.items()}


@pytest.mark.parametrize("name", FITS)
def test_every_number_is_that_of_the_fit(name, fits):
    fit = fits[name]
    summary = fit.summary()
    facts = dict(summary.facts)
    assert facts["regimes"] == str(fit.model.n_classes)
    assert facts["components of the state"] == str(fit.model.dim_x)
    assert facts["form"].split()[0] == fit.model.form.kind
    left_out = {"hidden": 3}.get(name, 0)
    assert facts["rows used"] == str(300 - left_out)
    assert facts["rows left out"].split(",")[0] == str(left_out)
    for key, value in (("log-likelihood", fit.log_likelihood), ("AIC", fit.aic), ("BIC", fit.bic)):
        assert facts[key] == f"{value:.3f}"
    assert facts["parameters"] == str(fit.n_parameters)
    assert facts["converged"] == ("yes" if fit.converged else "no")
    iterations = len(fit.trace) - 1
    assert facts["iterations"] == (str(iterations) if iterations else "none, the switch was given")
    assert summary.warnings == fit.warnings
    law, regimes = summary.tables
    assert {k: float(v) for k, v in law.rows} == pytest.approx(fit.model.named_parameters(), rel=1e-4)
    table = np.array([[float(cell) for cell in row] for row in regimes.rows])
    np.testing.assert_allclose(table[:, 1], fit.occupancy, atol=6e-4)
    np.testing.assert_allclose(table[:, 2:], fit.model.regime_means(), rtol=1e-4)
    text = str(summary)
    assert text == repr(summary) == repr(fit)
    assert all(value in text for _, value in summary.facts)
    assert max(map(len, text.splitlines())) <= 100
    assert not re.search("std|standard error|z-value", text)  # nobody has computed them


def test_the_occupancy_is_that_of_the_switch(fits):
    data = TRUTH.simulate(300, np.random.default_rng(0))
    np.testing.assert_allclose(fits["known"].occupancy, [1.0 - data.r.mean(), data.r.mean()])
    np.testing.assert_allclose(
        fits["hidden"].occupancy[1], np.nanmean(fits["hidden"].switch_mean), rtol=1e-12
    )
    for fit in fits.values():
        assert fit.occupancy.sum() == pytest.approx(1.0)
        assert fit.occupancy.shape == (fit.model.n_classes,)
    np.testing.assert_allclose(
        fits["hard"].occupancy @ np.arange(3), fits["hard"].switch_mean.mean(), rtol=1e-12
    )


def test_transition_probabilities_have_names():
    law = CGOMSModel(
        [[0.9, 0.1], [0.3, 0.7]], [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(PAIR, (2, 2, 4, 4)), 1
    )
    assert law.named_parameters() == {"p(0, 0)": 0.9, "p(0, 1)": 0.1, "p(1, 0)": 0.3, "p(1, 1)": 0.7}
    assert TRUTH.named_parameters() == pytest.approx(
        {"alpha": 0.07, "delta": 0.05, "eta": 0.16, "p_hard": TRUTH.p_hard}
    )


def test_a_model_without_words_has_the_numbers_of_the_fit():
    text = str(FitResult(object(), -1.5, 2, 10, np.zeros(4), False, ("something is missing",)).summary())
    assert "object, learned" in text
    assert "iterations      3" in text
    assert "converged       no" in text
    assert "  - something is missing" in text


# ------------------------------------------------------------------ a state and an observation of one name

#: Names of x and y, which of these stand twice, and what the means are called.
CALLED = {
    "one name": ("Nord", ["Nord"], ["Nord"], ["mean of state Nord", "mean of observation Nord"]),
    "one of two": (
        "Nord",
        ["Nord", "Süd"],
        ["Nord"],
        ["mean of state Nord", "mean of observation Nord", "mean of Süd"],
    ),
    "a Series": ("Nord", "Nord", ["Nord"], ["mean of state Nord", "mean of observation Nord"]),
    "names of their own": ("Nord", ["Süd"], [], ["mean of Nord", "mean of Süd"]),
    "no names": (None, None, [], ["mean of x[0]", "mean of y[0]"]),
}


# names are looked at apart from what is learned: the quickest way meets them all
@pytest.mark.parametrize(
    ("case", "kind"), [*((case, "hard") for case in CALLED), ("one of two", "known"), ("a Series", "hidden")]
)
def test_a_state_and_an_observation_of_one_name_are_told_apart_and_warned_of(case, kind):
    x_name, y_names, both, means = CALLED[case]
    data = TRUTH.simulate(120, np.random.default_rng(0))
    x = pd.Series(data.x[:, 0], name=x_name)
    if isinstance(y_names, list):
        noise = np.random.default_rng(1).normal(size=(120, len(y_names)))
        y = pd.DataFrame(data.y + noise, columns=y_names)
    else:
        y = pd.Series(data.y[:, 0], name=y_names)
    make = CGOMSModel.fit if kind == "hard" else CGOFMSModel.fit
    fit = make(x, y, data.r if kind == "known" else None, **FAST)
    told = [one for one in fit.warnings if "are both called" in one]
    assert len(told) == bool(both)
    for name in both:
        assert f"a state and an observation are both called {name!r}: a filter cannot detect" in told[0]
    (table,) = (one for one in fit.summary().tables if one.title == "regimes")
    assert list(table.header[2:]) == means

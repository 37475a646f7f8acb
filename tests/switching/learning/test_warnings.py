"""What learning warns of and what it refuses, as users meet it."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning.em import Estimate
from fuzzykf.switching.learning.notes import stability_radius, too_gradual
from fuzzykf.switching.learning.vine import vine_moments


def said(fit, pattern):
    return [note for note in fit.warnings if re.search(pattern, note)]


def test_clean_data_give_no_warning(paper):
    data = paper.simulate(2000, np.random.default_rng(10))
    assert CGOFMSModel.fit(data.x, data.y, data.r, form="covariance").warnings == ()


@pytest.mark.parametrize("form", ["regression", "covariance"])
def test_a_regime_that_is_never_visited(form, sim):
    fit = CGOFMSModel.fit(sim.x, sim.y, np.zeros(400), form=form)
    assert said(fit, "regime 1 is rarely visited .* 0 observations")
    assert not said(fit, "regime 0")
    assert np.isfinite(OFSRFilter(fit.model).filter(sim.y).x).all()
    hard = CGOMSModel.fit(sim.x, sim.y, (sim.r > 0.5).astype(float), n_switches=3, form=form)
    assert said(hard, "regime 2 is rarely visited")
    assert said(hard, "regime 2 is followed by nothing")
    np.testing.assert_allclose(hard.model.transition[2], 1 / 3)


@pytest.mark.parametrize("form", ["regression", "covariance"])
def test_a_pair_of_regimes_that_hardly_occurs(form, sim):
    r = np.repeat([0.0, 1.0], 200)
    fit = CGOMSModel.fit(sim.x, sim.y, r, form=form)
    assert said(fit, r"pair of regimes \(0, 1\) rarely occurs \(total weight 1 steps")
    assert said(fit, r"pair of regimes \(1, 0\) rarely occurs \(total weight 0 steps")
    assert np.isfinite(fit.log_likelihood)
    assert np.isfinite(CGOMSMFilter(fit.model).filter(sim.y).x).all()


def test_hidden_pairs_are_counted_by_their_posterior():
    # two long stretches: the regimes are plain to see, and change once
    rng = np.random.default_rng(11)
    r = np.repeat([0.0, 1.0], 300)
    y = 5.0 * r + rng.normal(size=600)
    fit = CGOMSModel.fit(y + rng.normal(size=600), y, form="regression", n_starts=2, tolerance=1e-3)
    assert said(fit, r"pair of regimes \(. .\)|pair of regimes \(\d, \d\) rarely occurs")
    assert not said(fit, "rarely visited")


@pytest.mark.parametrize("hidden", [False, True])
def test_an_unstable_state_filter(hidden):
    # x grows by 2 % a step; it is seen through y only by what it was driven with
    rng = np.random.default_rng(12)
    y = rng.normal(size=200)
    x = np.zeros(200)
    x[0] = 5.0
    for n in range(1, 200):
        x[n] = 1.02 * x[n - 1] + 0.3 * y[n] + 0.1 * rng.normal()
    r = rng.integers(0, 2, 200).astype(float)
    fit = CGOMSModel.fit(x, y, None if hidden else r, form="regression", n_starts=1, max_iter=20)
    (note,) = said(fit, "the state filter is unstable: its error variance grows by the factor")
    factor = float(re.search(r"factor ([\d.]+)", note)[1])
    assert factor == pytest.approx(1.02**2, abs=0.01)
    fuzzy = CGOFMSModel.fit(x, y, None if hidden else r, form="regression", n_starts=1, max_iter=5)
    assert said(fuzzy, "the state filter is unstable")


def test_stability_by_definition():
    # E[prod Axx^2] along the chain grows by the spectral radius: compare with a long product
    model = CGOMSModel.from_regressions(
        [[0.9, 0.1], [0.3, 0.7]],
        **{
            "Ayy": np.zeros((2, 2, 1, 1)),
            "Ny": np.zeros((2, 2, 1)),
            "Qyy": np.ones((2, 2, 1, 1)),
            "Axx": np.array([[0.8, 1.3], [0.9, 1.1]])[..., None, None],
            "H": np.zeros((2, 2, 1, 1)),
            "G": np.zeros((2, 2, 1, 1)),
            "c": np.zeros((2, 2, 1)),
            "C": np.ones((2, 2, 1, 1)),
        },
        means=np.zeros((2, 2)),
        covariances=np.stack([np.eye(2)] * 2),
    )
    step = model.transition * np.array([[0.8, 1.3], [0.9, 1.1]]) ** 2
    total = np.linalg.matrix_power(step, 200).sum() / np.linalg.matrix_power(step, 199).sum()
    assert stability_radius(model.on_nodes()) == pytest.approx(total, rel=1e-9)


def test_a_switch_that_is_too_gradual_for_fmc1(sim):
    rng = np.random.default_rng(13)
    r = np.clip(0.5 + 0.3 * np.sin(np.arange(400) / 7) + 0.05 * rng.normal(size=400), 0.01, 0.99)
    fit = CGOFMSModel.fit(sim.x, sim.y, r)
    assert said(fit, "hard in 0 of the data, but at least in 3/8 under FMC1")
    assert not said(CGOFMSModel.fit(sim.x, sim.y, r, law="fmc2"), "3/8")


def test_a_hidden_switch_that_is_too_gradual_for_fmc1():
    # the switch drifts slowly between two levels and never rests at either
    rng = np.random.default_rng(14)
    r = 0.5 - 0.45 * np.cos(np.arange(500) / 20.0)
    y = 8.0 * r + 0.5 * rng.normal(size=500)
    x = 3.0 * (1.0 - r) + 0.5 * y + 0.3 * rng.normal(size=500)
    options = {"form": "regression", "tolerance": 1e-3}
    assert said(CGOFMSModel.fit(x, y, **options), "hard in 0.* of the data, but at least in 3/8 under FMC1")
    assert not said(CGOFMSModel.fit(x, y, law="fmc2", n_starts=1, max_iter=3, **options), "3/8")


def test_fmc1_at_its_bound():
    # what the notes say of an estimate whose law is at the bound; no data are needed
    chain = FuzzyMarkovLaw.fmc1(0.0005, 0.001, 0.996 * 3 / 8).learner(5)
    (note,) = too_gradual(Estimate(chain, None), None, None)
    assert note.startswith(f"p_hard is {chain.law().p_hard:.3g}, at the bound 3/8 of FMC1")


def test_a_switch_that_is_often_fuzzy_but_not_too_often(paper):
    # 48 % hard: near enough to the bound to be looked at
    truth = CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.275), paper.form.means, paper.form.covariances, 1)
    data = truth.simulate(1500, np.random.default_rng(0))
    fit = CGOFMSModel.fit(data.x, data.y, form="regression", tolerance=1e-3, n_starts=1)
    assert fit.model.law.p_hard < 0.6
    assert not said(fit, "3/8")


def test_not_converged(sim):
    one, many = (CGOFMSModel.fit(sim.x, sim.y, form="regression", n_starts=1, max_iter=n) for n in (1, 14))
    for fit in (one, many, CGOMSModel.fit(sim.x, sim.y, form="regression", n_starts=1, max_iter=1)):
        assert not fit.converged
        assert said(fit, "not converged after (1 iteration;|14 iterations;)")
    assert (len(one.trace), len(many.trace)) == (2, 15)
    done = CGOMSModel.fit(sim.x, sim.y, form="regression", n_starts=1, tolerance=1e-4)
    assert done.converged
    assert not said(done, "not converged")
    assert done.trace[-1] - done.trace[-2] < 1e-4 * 399


#: Correlations of two regimes and their pairs (see `vine_moments`) that are definite with room to
#: spare in each regime, and between them not: at (.47, 0) interpolation has no noise left.
BEYOND = [
    0.815,
    -0.767,
    -0.857,
    -0.115,
    0.805,
    -0.633,
    -0.352,
    -0.451,
    0.375,
    -0.146,
    -0.169,
    0.082,
    0.193,
    -0.317,
]


@pytest.fixture(scope="module")
def beyond():
    """Data of two hard regimes whose covariances cannot be interpolated."""
    theta = np.concatenate([np.zeros(8), np.arctanh(BEYOND)])
    means, covariances = vine_moments(theta, 2)
    hard = CGOMSModel(np.full((2, 2), 0.5), means, covariances, 1)
    with pytest.raises(ParameterError, match="positive"):
        CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), means, covariances, 1)
    return hard.simulate(1000, np.random.default_rng(1))


def test_an_active_constraint(beyond):
    x, y, r = beyond.x, beyond.y, beyond.r.astype(float)
    fit = CGOFMSModel.fit(x, y, r, form="covariance")
    (note,) = said(fit, "the constraint is active")
    share = float(re.search(r"is ([\d.e-]+) of that elsewhere", note)[1])
    assert share < 0.02
    # in the regression form there is no such bound, and for hard regimes nothing is interpolated
    assert not said(CGOFMSModel.fit(x, y, r, form="regression"), "constraint")
    hard = CGOMSModel.fit(x, y, r, form="covariance")
    assert not said(hard, "constraint")
    # the maximum along the bound was found: with all of the switch hard, next to nothing is lost
    plain = CGOFMSModel.fit(x, y, r, form="regression").log_likelihood
    assert fit.log_likelihood > plain - 10.0
    # BIC would take the form at its bound
    auto = CGOFMSModel.fit(x, y, r)
    assert auto.bic_of_forms["covariance"] < auto.bic_of_forms["regression"]
    assert auto.model.form.kind == "regression"


def test_an_active_constraint_with_a_hidden_switch(beyond):
    fit = CGOFMSModel.fit(beyond.x, beyond.y, form="covariance", tolerance=1e-5)
    assert said(fit, "the constraint is active")
    assert (np.diff(fit.trace) > -1e-8).all()


# --------------------------------------------------------------------------- refusals


def test_the_observations_alone_do_not_do(sim):
    for fit in (CGOFMSModel.fit, CGOMSModel.fit):
        with pytest.raises(
            ParameterError, match="x: missing; the parameters of the state are not identifiable"
        ):
            fit(None, sim.y)


BAD = [
    ({"law": "fmc3"}, "law: got 'fmc3', expected 'fmc1', 'fmc2', 'free', 'fade' or 'graph'"),
    ({"law": None}, "law: got None"),
    ({"form": "gamma"}, "form: got 'gamma', expected 'auto', 'regression' or 'covariance'"),
    ({"n_nodes": -1}, "n_nodes: got -1, expected a whole number of at least 0"),
    ({"n_nodes": 2.5}, "n_nodes: got 2.5"),
    ({"n_nodes": "5"}, "n_nodes: got '5'"),
    ({"n_starts": 0}, "n_starts: got 0, expected a whole number of at least 1"),
    ({"n_starts": 1.5}, "n_starts: got 1.5"),
    ({"n_starts": 5}, "rng: missing"),
    ({"n_starts": 5, "rng": 3}, "rng: got int, expected a numpy.random.Generator"),
    ({"max_iter": 0}, "max_iter: got 0"),
    ({"max_iter": None}, "max_iter: got None"),
    ({"tolerance": 0.0}, "tolerance: got 0.0, expected a positive number"),
    ({"tolerance": -1.0}, "tolerance: got -1.0"),
    ({"tolerance": np.nan}, "tolerance: got nan"),
    ({"tolerance": "small"}, "tolerance: got 'small'"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_options_that_are_refused(options, message, sim):
    x, y = sim.x.copy(), sim.y.copy()
    with pytest.raises(ParameterError, match=re.escape(message)):
        CGOFMSModel.fit(x, y, **options)
    np.testing.assert_array_equal(x, sim.x)
    np.testing.assert_array_equal(y, sim.y)
    hard = {k: v for k, v in options.items() if k not in ("law", "n_nodes")}
    if hard:
        with pytest.raises(ParameterError, match=re.escape(message)):
            CGOMSModel.fit(x, y, **hard)


@pytest.mark.parametrize("K", [0, -1, 2.5, "2"])
def test_numbers_of_regimes(K, sim):
    with pytest.raises(ParameterError, match="n_switches: got"):
        CGOMSModel.fit(sim.x, sim.y, n_switches=K)


def test_switches_that_are_refused(sim):
    with pytest.raises(ParameterError, match=r"r: got values from .* to 2.0, expected \[0, 1\]"):
        CGOFMSModel.fit(sim.x, sim.y, 2.0 * sim.r)
    with pytest.raises(ParameterError, match=r"r: expected regimes 0 to 1"):
        CGOMSModel.fit(sim.x, sim.y, sim.r)
    far = np.where(np.arange(400) % 2 == 0, 0.1, 0.9)
    with pytest.raises(ParameterError, match=r"FMC2 allows gradual steps of less than 0\.5"):
        CGOFMSModel.fit(sim.x, sim.y, far, law="fmc2")


def test_the_covariance_form_is_scalar(vector_sim):
    x, y, r = vector_sim
    for known in (None, r):
        with pytest.raises(ParameterError, match="one state and one observation only, got 2 and 2"):
            CGOFMSModel.fit(x, y, known, form="covariance")


def test_a_refusal_leaves_the_generator_as_it_was(sim):
    rng = np.random.default_rng(16)
    state = rng.bit_generator.state
    with pytest.raises(ParameterError):
        CGOFMSModel.fit(sim.x, sim.y[:10], n_starts=6, rng=rng)
    with pytest.raises(ParameterError):
        CGOFMSModel.fit(sim.x, sim.y, form="x", n_starts=6, rng=rng)
    fit = CGOMSModel.fit(sim.x, sim.y, max_iter=2)
    for bad in (0, 1.5, "2"):
        with pytest.raises(ParameterError, match="n_replicates"):
            fit.bootstrap(bad, rng)
    assert rng.bit_generator.state == state
    with pytest.raises(ParameterError, match="rng"):
        fit.bootstrap(1, 7)


def test_a_state_that_is_missing_everywhere_is_none(sim):
    with pytest.raises(ParameterError, match=r"hold 0 steps .* not identifiable from y alone"):
        CGOFMSModel.fit(np.full(400, np.nan), sim.y)


def test_a_result_is_shown_in_short(sim):
    text = repr(CGOFMSModel.fit(sim.x, sim.y, sim.r, form="regression"))
    assert "log-likelihood" in text
    assert "trace" not in text
    assert "switch_mean" not in text


# --------------------------------------------------------------------------- rows that are missing

N = 120
HOURS = pd.date_range("2026-01-01", periods=N + 3, freq="h", name="time")
LATER = HOURS.delete([5, 6, 100])
GIVE = "a model has a fixed time step: add rows of NaN"

#: Indexes, and what is said of their steps.
STEPS = {
    "hours": (HOURS[:N], ""),
    "hours, three missing": (
        LATER,
        r"3 rows are missing \(index of x, steps of 1:00:00\): 2 after 2026-01-01 04:00:00, 1 after "
        rf"2026-01-05 03:00:00; {GIVE}",
    ),
    "hours in a zone": (
        LATER.tz_localize("Europe/Berlin"),
        r"3 rows are missing .*2 after 2026-01-01 04:00:00\+01",
    ),
    "objects": (pd.Index(LATER.to_pydatetime(), dtype=object), "3 rows are missing"),
    "text": (pd.Index(LATER.strftime("%Y-%m-%dT%H:%M")), "3 rows are missing"),
    "months": (pd.period_range("2001-01", periods=N, freq="M"), ""),
    "months, one missing": (
        pd.period_range("2001-01", periods=N + 1, freq="M").delete(1),
        "1 row is missing .*1 month",
    ),
    "durations": (pd.to_timedelta(np.arange(N), unit="s"), ""),
    "durations, one missing": (
        pd.to_timedelta(np.delete(np.arange(N + 1), 3), unit="s"),
        r"1 row is missing \(index of x, steps of 0:00:01\): 1 after 0 days 00:00:02",
    ),
    "no steps": (
        pd.to_timedelta(np.cumsum(np.arange(N) % 7 + 1), unit="min"),
        "the steps between rows vary from 0:01:00 to 0:07:00",
    ),
    "numbers": (pd.RangeIndex(0, 2 * N, 2), ""),
}
QUICK = {"form": "regression", "max_iter": 1, "n_starts": 1}
LEARN = {
    "hard": lambda x, y: CGOMSModel.fit(x, y, n_regimes=1, **QUICK),
    "fuzzy": lambda x, y: CGOFMSModel.fit(x, y, law="fmc1", n_nodes=1, **QUICK),
}


#: Indexes are judged before anything is learned, whatever the model: the fuzzy one meets a whole one, one
#: with gaps, and one without steps.
MET = [("hard", kind) for kind in STEPS]
MET += [("fuzzy", kind) for kind in ("hours", "hours, three missing", "no steps")]


@pytest.mark.parametrize(("name", "kind"), MET)
def test_rows_that_an_index_lacks_are_a_warning(name, kind, paper) -> None:
    index, note = STEPS[kind]
    data = paper.simulate(N, np.random.default_rng(0))
    x, y = pd.Series(data.x[:, 0], index), pd.Series(data.y[:, 0], index)
    for fit in (LEARN[name](x, y), LEARN[name](x, data.y), LEARN[name](data.x, y)):
        found = said(fit, "a fixed time step")
        assert len(found) == bool(note)
        if note:
            assert re.search(note.replace("index of x", "index of [xy]"), found[0])


@pytest.mark.parametrize("name", LEARN)
def test_arrays_have_no_rows_that_are_missing(name, paper) -> None:
    data = paper.simulate(N, np.random.default_rng(0))
    assert not said(LEARN[name](data.x, data.y), "a fixed time step")


def test_rows_that_one_of_several_series_lacks_are_a_warning(paper) -> None:
    data = paper.simulate(N, np.random.default_rng(0))
    whole, gappy = pd.Series(data.x[:, 0], HOURS[:N]), pd.Series(data.x[:, 0], LATER)
    (note,) = said(LEARN["hard"]([whole, gappy], [data.y, data.y]), "a fixed time step")
    assert note.startswith("series 1: 3 rows are missing (index of x, ")


def test_a_fit_to_what_was_simulated_knows_of_no_rows_that_are_missing(paper) -> None:
    data = paper.simulate(N, np.random.default_rng(0))
    fit = LEARN["hard"](pd.Series(data.x[:, 0], LATER), data.y)
    assert not said(fit.refit(fit.model.simulate(N, np.random.default_rng(1))), "a fixed time step")

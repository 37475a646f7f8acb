"""Learning with inputs and features: gradient, likelihood, recovery, units, names, what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.results import FilterTraining
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.switching.laws.law_numbers import ChainNumbers
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.filter_objective import FilterObjective, stretches
from fuzzykf.switching.learning.memory import memory_of_hard
from fuzzykf.switching.learning.window import chosen

EVERYTHING = WindowFeatures(order=2, blocks=(2,), hinges=1, products=True)
BY = np.array([[[[-0.4, 0.5]], [[0.0, 0.2]]], [[[0.3, 0.0]], [[0.0, -0.3]]]])
BX = np.array([[[[0.6, 0.8]], [[0.2, -0.5]]], [[[-0.5, 0.6]], [[0.0, -0.9]]]])
TILT = 1.5
SHORT = {"n_starts": 1, "max_iter": 3}


def truth():
    """Two regimes that differ in mean; the first input pushes towards the second one."""

    def each(value):
        return np.full((2, 2, 1, 1), value)

    form = InputForm(
        By=BY,
        Bx=BX,
        features=WindowFeatures(),
        inputs=["day", "heat"],
        tilt=[[0.0, 0.0], [TILT, 0.0]],
        Ayy=each(0.3),
        Ny=[[[-1.0], [1.5]], [[-1.0], [1.5]]],
        Qyy=each(0.3),
        Axx=each(0.2),
        H=each(0.1),
        G=each(0.5),
        c=[[[1.0], [-1.0]], [[1.0], [-1.0]]],
        C=each(0.3),
        means=np.zeros((2, 2)),
        covariances=np.tile(np.eye(2), (2, 1, 1)),
    )
    return CGOMSModel._from_form([[0.9, 0.1], [0.1, 0.9]], form, [0.5, 0.5])


@pytest.fixture(scope="module")
def data():
    """x, y (n, 1) and inputs (n, 2)."""
    rng, n = np.random.default_rng(0), 1200
    us = np.stack([np.sin(np.arange(n) / 9.0), rng.normal(size=n)], axis=1)
    found = truth().simulate(n, rng, us=us)
    return found.x, found.y, us


@pytest.fixture(scope="module")
def joint(data):
    x, y, us = data
    return CGOMSModel.fit(x, y, inputs=us)


@pytest.fixture(scope="module")
def small(data):
    x, y, us = (part[:400] for part in data)
    table = pd.DataFrame(us, columns=["day", "heat"])
    return x, y, table, CGOMSModel.fit(x, y, inputs=table, n_starts=1, max_iter=20)


def means_of(form):
    """Order of the regimes by the mean of the observation."""
    return np.argsort(form.table.Ny[0, :, 0])


# ---------------------------------------------------------------- objective and likelihood


@pytest.mark.parametrize(("law", "feedback"), [(None, True), (None, False), ("fade", False)])
def test_the_gradient_is_that_of_differences(data, law, feedback):
    x, y, us = (part[:90].copy() for part in data)
    y[40] = np.nan
    x[10:20] = np.nan
    options = {"inputs": us, "features": EVERYTHING, "state_feedback": feedback, **SHORT}
    if law is None:
        fit, nodes = CGOMSModel.fit(x, y, **options), 0
        numbers, system = ChainNumbers(fit.model.placed().chain), fit.model.placed()
    else:
        fit, nodes = CGOFMSModel.fit(x, y, law=law, n_nodes=1, **options), 1
        numbers, system = fit.model.law.free_numbers(nodes), fit.model.placed(nodes)
    learned = gather(x, y, state_feedback=feedback, inputs=us, features=fit.model.form.features)
    estimate = fit.continuation.learned.gaussian
    objective = FilterObjective(estimate, numbers, system.chain, stretches(learned, system))
    rng = np.random.default_rng(1)
    at = objective.start + 0.05 * rng.normal(size=objective.start.size)
    _, slope = objective.value(at)
    assert np.abs(slope[-4:]).min() > 1e-6  # inputs act on the switch
    for direction in [*np.eye(at.size)[-4:], *rng.normal(size=(6, at.size))]:
        h = 1e-6 * direction / np.linalg.norm(direction)
        change = objective.value(at + h)[0] - objective.value(at - h)[0]
        assert change / 2.0 == pytest.approx(slope @ h, abs=1e-6 * np.linalg.norm(slope) * 1e-6 + 1e-13)


def log_likelihood_by_a_forward_pass(model, x, y, us):
    """Log p(x, y) of scalar series without gaps, by plain sums over the regimes."""
    form, P, initial = model.form, model.placed().chain.transition, model.placed().chain.initial
    t, features = form.table, form.features

    def log_normal(value, variance):
        return -0.5 * (value**2 / variance + np.log(2.0 * np.pi * variance))

    def own(value, u):
        hinges = [] if features.knots is None else [max(value - knot, 0.0) for knot in features.knots[0]]
        return [*hinges, *(u * value if features.products else [])]

    x, y, K = x[:, 0], y[:, 0], len(P)
    w, begin = np.empty(K), features.n_past - 1  # the first row of which all of the window is there
    for i in range(K):
        off, S = np.array([x[begin], y[begin]]) - form.means[i], form.covariances[i]
        w[i] = np.log(initial[i]) - 0.5 * off @ np.linalg.solve(S, off)
        w[i] -= 0.5 * np.linalg.slogdet(2.0 * np.pi * S)[1]
    for n in range(begin + 1, len(y)):
        lags = [y[n - 1 - k] for k in range(features.n_past)]
        common = [*us[n], *lags[1 : features.order]]
        k = features.order
        for length in features.blocks:
            common.append(np.mean(lags[k : k + length]))
            k += length
        push = np.exp(form.tilt @ (us[n] - form.centre))
        after = np.empty((K, K))
        for i in range(K):
            for j in range(K):
                mean_y = t.Ayy[i, j, 0, 0] * lags[0] + t.Ny[i, j, 0]
                mean_y += form.By[i, j, 0] @ [*common, *own(lags[0], us[n])]
                mean_x = t.Axx[i, j, 0, 0] * x[n - 1] + t.H[i, j, 0, 0] * lags[0] + t.G[i, j, 0, 0] * y[n]
                mean_x += t.c[i, j, 0] + form.Bx[i, j, 0] @ [*common, *own(y[n], us[n])]
                after[i, j] = w[i] + np.log(P[i, j] * push[j] / (P[i] @ push))
                after[i, j] += log_normal(y[n] - mean_y, t.Qyy[i, j, 0, 0])
                after[i, j] += log_normal(x[n] - mean_x, t.C[i, j, 0, 0])
        w = np.logaddexp.reduce(after, axis=0)
    return np.logaddexp.reduce(w)


@pytest.mark.parametrize(
    ("objective", "features"), [("joint", EVERYTHING), ("joint", None), ("filter", None)]
)
def test_the_likelihood_is_that_of_a_forward_pass(data, objective, features):
    x, y, us = (part[:200] for part in data)
    fit = CGOMSModel.fit(x, y, inputs=us, features=features, objective=objective, n_starts=1, max_iter=10)
    if objective == "filter":
        assert fit.training.kept == "filter"
    assert np.abs(fit.model.form.tilt).max() > 0.1
    expected = log_likelihood_by_a_forward_pass(fit.model, x, y, us)
    assert fit.log_likelihood == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("kind", ["hard", "fuzzy", "sparse", "memoryless", "features", "several"])
def test_a_search_never_falls(data, kind):
    x, y, us = (part[:200].copy() for part in data)
    options = {"inputs": us, "n_starts": 1, "max_iter": 15}
    if kind in {"sparse", "features"}:
        x[::3], y[50], y[100:103] = np.nan, np.nan, np.nan
    if kind == "memoryless":
        options["state_feedback"] = False
    if kind == "features":
        options["features"] = EVERYTHING
    if kind == "several":
        x, y, options["inputs"] = ([part[:80], part[80:]] for part in (x, y, us))
    fit = CGOFMSModel.fit(x, y, n_nodes=1, **options) if kind == "fuzzy" else CGOMSModel.fit(x, y, **options)
    assert len(fit.trace) > 3
    assert np.diff(fit.trace).min() > -1e-8 * abs(fit.trace[-1])
    assert fit.trace[-1] > fit.trace[0] + 1.0


# ---------------------------------------------------------------- what is found


def test_coefficients_and_the_push_on_the_switch_are_found(joint):
    form = joint.model.form
    order = means_of(form)
    for k, regime in enumerate(order):  # pairs in which the switch stays are seen most
        np.testing.assert_allclose(form.By[regime, regime], BY[k, k], atol=0.12)
        np.testing.assert_allclose(form.Bx[regime, regime], BX[k, k], atol=0.12)
    push = form.tilt[order[1]] - form.tilt[order[0]]
    assert push[0] == pytest.approx(TILT, abs=0.6)
    assert abs(push[1]) < 0.5
    assert joint.converged


def test_training_for_the_filter_finds_the_push_on_the_switch(data):
    x, y, us = data
    fit = CGOMSModel.fit(x, y, inputs=us, objective="filter", n_starts=1, max_iter=20)
    order = means_of(fit.model.form)
    push = fit.model.form.tilt[order[1]] - fit.model.form.tilt[order[0]]
    assert fit.training.kept == "filter"
    assert fit.training.score_filter > fit.training.score_joint + 0.1
    assert push[0] > 0.5
    assert abs(push[1]) < 0.5


def test_inputs_belong_to_the_row_that_they_stand_in(data, joint):
    x, y, us = data
    for shift in (-1, 1):
        other = CGOMSModel.fit(x, y, inputs=np.roll(us, shift, axis=0), n_starts=1, max_iter=10)
        assert joint.log_likelihood > other.log_likelihood + 50.0


@pytest.mark.parametrize("objective", ["joint", "filter"])
def test_units_do_not_matter(data, objective):
    x, y, us = (part[:150] for part in data)
    options = {"features": WindowFeatures(hinges=1, products=True), "objective": objective, **SHORT}
    one = CGOMSModel.fit(x, y, inputs=us, **options)
    scale, offset = np.array([1e5, 1e-3]), np.array([50.0, -3.0])
    two = CGOMSModel.fit(7.0 * x + 100.0, 0.1 * y - 4.0, inputs=us * scale + offset, **options)
    a = one.model.filter().filter(y, us=us)
    b = two.model.filter().filter(0.1 * y - 4.0, us=us * scale + offset)
    np.testing.assert_allclose(7.0 * a.x + 100.0, b.x, atol=1e-5)
    np.testing.assert_allclose(49.0 * a.P, b.P, rtol=1e-5)
    np.testing.assert_allclose(a.mu, b.mu, atol=1e-6)
    np.testing.assert_allclose(one.model.form.centre * scale + offset, two.model.form.centre)


def test_inputs_without_an_effect_change_next_to_nothing(data):
    x, y, _ = (part[:400] for part in data)
    noise = np.random.default_rng(5).normal(size=(400, 1))
    without = CGOMSModel.fit(x, y, form="regression", n_starts=1).model.filter().filter(y).x
    given = CGOMSModel.fit(x, y, inputs=noise, n_starts=1).model.filter().filter(y, us=noise).x
    assert (without - given).std() < 0.15 * x.std()


def test_one_regime_has_nothing_to_push(data):
    x, y, us = (part[:200] for part in data)
    fit = CGOMSModel.fit(x, y, inputs=us, n_switches=1)
    assert fit.model.form.tilt.tolist() == [[0.0, 0.0]]
    A = np.concatenate([np.ones((199, 1)), x[:-1], y[:-1], y[1:], us[1:]], axis=1)
    expected = np.linalg.lstsq(A, x[1:], rcond=None)[0][-2:, 0]
    np.testing.assert_allclose(fit.model.form.Bx[0, 0, 0], expected, atol=0.02)  # but for a ridge


def test_inputs_may_follow_from_one_another(data):
    x, y, us = (part[:150] for part in data)
    regime = (us[:, 1] > 0.0).astype(float)
    one_of_two = np.stack([regime, 1.0 - regime], axis=1)  # and with the intercept: dummies
    for objective in ("joint", "filter"):
        fit = CGOMSModel.fit(x, y, inputs=one_of_two, objective=objective, **SHORT)
        assert np.isfinite(fit.model.filter().filter(y, us=one_of_two).x).all()
    twice = CGOMSModel.fit(x, y, inputs=np.hstack([us, us]), **SHORT)
    np.testing.assert_allclose(twice.model.form.By[..., :2], twice.model.form.By[..., 2:], atol=1e-6)


# ---------------------------------------------------------------- features that are chosen


def test_the_map_that_scores_best_is_taken(data):
    x, y, us = (part[:150] for part in data)
    fit = CGOMSModel.fit(x, y, inputs=us, features="auto", objective="filter", **SHORT)
    scores = fit.score_of_features
    assert len(scores) == 5
    assert max(scores, key=scores.get) == repr(fit.model.form.features)
    training = fit.training
    assert max(scores.values()) == (
        training.score_filter if training.kept == "filter" else training.score_joint
    )


def test_of_maps_without_an_effect_the_first_is_taken():
    asked = []

    def fit(features):  # of a joint fit that stays scores differ by rounding
        asked.append(repr(features))
        score = -1.0 + 1e-14 * len(asked)
        training = FilterTraining("joint", score, -2.0, 0.1, 5, 1.0, 20)
        return SimpleNamespace(training=training, score_of_features={}, number=len(asked))

    assert chosen(1, True, fit).number == 1
    assert len(asked) == 5
    assert chosen(1, False, fit).number == 6
    assert asked[5] == "None"
    assert len(asked) == 9  # no products without inputs


def test_it_is_said_where_inputs_have_no_effect():
    rng = np.random.default_rng(3)
    y, noise = np.zeros((300, 1)), rng.normal(size=(300, 3))
    x = y.copy()
    for n in range(1, 300):
        y[n] = 0.5 * y[n - 1] + noise[n, 0]
        x[n] = 0.5 * x[n - 1] + y[n] + noise[n, 1]
    fit = CGOMSModel.fit(x, y, inputs=noise[:, 2], n_switches=1, objective="filter")
    assert fit.training.kept == "joint"
    assert not fit.model.form.Bx.any()
    assert any("inputs and features have no effect" in note for note in fit.warnings)


def test_order_is_short_for_features(data):
    x, y, _ = (part[:100] for part in data)
    one = CGOMSModel.fit(x, y, order=3, **SHORT)
    two = CGOMSModel.fit(x, y, features=WindowFeatures(order=3), **SHORT)
    assert one.model.form.to_dict() == two.model.form.to_dict()
    assert one.n_parameters == two.n_parameters
    assert CGOMSModel.fit(x, y, order=1, form="regression", **SHORT).model.form.kind == "regression"


def test_rows_whose_window_was_not_wholly_observed_are_left_out():
    y = np.random.default_rng(0).normal(size=(150, 1))
    y[[7, 30, 31, 60]] = np.nan
    x = np.random.default_rng(1).normal(size=(150, 1))
    data = gather(x, y, features=WindowFeatures(order=2, blocks=(2,)))
    whole = [n for n in range(3, 150) if np.isfinite(y[n - 3 : n + 1]).all()]
    np.testing.assert_array_equal(data.kept, whole)
    steps = [n for n in whole if n - 1 in whole]  # of which all four before are there
    common = data.further.common * data.further.std + data.further.mean
    expected = [[y[n - 2, 0], (y[n - 3, 0] + y[n - 4, 0]) / 2] for n in steps]
    np.testing.assert_allclose(common, expected, rtol=1e-12)


def test_gaps_in_the_observations_do_not_bias_what_lags_do():
    rng = np.random.default_rng(0)
    y = np.zeros(3000)
    for n in range(2, 3000):
        y[n] = 0.2 * y[n - 1] + 0.7 * y[n - 2] + rng.normal()
    x = y + 2.0 * np.roll(y, 2) + 0.1 * rng.normal(size=3000)
    y[rng.random(3000) < 0.1] = np.nan
    fit = CGOMSModel.fit(x, y, n_regimes=1, order=3, form="regression", state_feedback=False)
    assert fit.model.form.Bx[0, 0, 0, 0] == pytest.approx(
        2.0, abs=0.02
    )  # of the observation two steps before
    assert fit.model.form.table.C.item() == pytest.approx(0.01, rel=0.1)


def test_memory_counts_inputs_and_features(data):
    x, y, us = (part[:100] for part in data)
    sizes = [
        memory_of_hard(3, gather(x, y, **more), "regression")
        for more in ({}, {"inputs": us}, {"inputs": us, "features": EVERYTHING.learned(y)})
    ]
    assert sizes[0] < sizes[1] < sizes[2]


# ---------------------------------------------------------------- names, series, going on


def test_names_of_inputs_count_whatever_their_order(small):
    x, y, table, fit = small
    assert fit.model.form.inputs == ("day", "heat")
    halves = [part[:200] for part in (x, y)], [part[200:] for part in (x, y)]
    xs, ys = zip(*halves, strict=True)
    turned = table[["heat", "day"]]
    one = CGOMSModel.fit(list(xs), list(ys), inputs=[table[:200], table[200:]], **SHORT)
    two = CGOMSModel.fit(list(xs), list(ys), inputs=[table[:200], turned[200:]], **SHORT)
    assert two.model.form.to_dict() == one.model.form.to_dict()
    flat = CGOMSModel.fit(x, y, inputs=table["day"], **SHORT).model.form
    assert flat.inputs == ("day",)
    assert CGOMSModel.fit(x, y, inputs=table["day"].to_numpy(), **SHORT).model.form.inputs == ("u0",)


def test_a_list_of_one_series_is_that_series(small):
    x, y, table, fit = small
    again = CGOMSModel.fit([x], [y], inputs=[table], n_starts=1, max_iter=20)
    assert again.model.form.to_dict() == fit.model.form.to_dict()


def test_an_update_goes_by_the_names_of_the_fit(data, small):
    _, _, _, fit = small
    x, y, us = (part[400:500] for part in data)
    table = pd.DataFrame(us, columns=["day", "heat"])
    by_position = fit.update(x, y, inputs=us)
    assert by_position.model.form.inputs == ("day", "heat")
    by_name = fit.update(x, y, inputs=table[["heat", "day"]])
    assert by_name.model.form.to_dict() == by_position.model.form.to_dict()
    assert np.diff(by_name.trace).min() > -1e-8 * abs(by_name.trace[-1])
    assert by_name.update(x, y, inputs=table).model.form.inputs == ("day", "heat")
    for inputs, error, words in (
        (None, ParameterError, "inputs: missing; the first fit had day, heat"),
        (us[:, :1], ShapeError, "inputs: got 1 column, expected 2: day, heat"),
        (table[["heat"]], ParameterError, "inputs: got no column 'day'"),
        (us[:50], ShapeError, r"inputs: series 0 has shape \(50, 2\), expected \(100, k\)"),
    ):
        with pytest.raises(error, match=words):
            fit.update(x, y, inputs=inputs)


def test_an_update_moves_towards_a_fit_of_all_rows(data, small):
    x, y, us = (part[:800] for part in data)
    _, _, _, fit = small
    updated = fit.update(x[400:], y[400:], inputs=us[400:])
    both = CGOMSModel.fit([x[:400], x[400:]], [y[:400], y[400:]], inputs=[us[:400], us[400:]])

    def coefficients(found):
        order = means_of(found.model.form)
        return np.array([found.model.form.Bx[k, k, 0] for k in order])

    moved, goal, start = coefficients(updated), coefficients(both), coefficients(fit)
    assert np.abs(moved - goal).max() < 0.05
    assert np.abs(moved - goal).sum() < np.abs(start - goal).sum()


def test_replicates_of_a_bootstrap_have_the_inputs(small):
    _, _, _, fit = small
    (one,) = fit.bootstrap(1, np.random.default_rng(0))
    assert one.model.form.inputs == ("day", "heat")
    assert np.abs(one.model.form.Bx - fit.model.form.Bx).max() > 0.0
    k = means_of(fit.model.form)[0], means_of(one.model.form)[0]
    np.testing.assert_allclose(one.model.form.Bx[k[1], k[1]], fit.model.form.Bx[k[0], k[0]], atol=0.3)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("inputs", "error", "words"),
    [
        (np.zeros((5, 2)), ShapeError, r"inputs: series 0 has shape \(5, 2\), expected \(60, k\)"),
        (np.zeros((60, 0)), ShapeError, r"inputs: series 0 has shape \(60, 0\), expected"),
        (np.full((60, 1), 3.0), ParameterError, r"inputs: 'u0' is constant \(3\), .* expected it to vary"),
        (np.r_[np.nan, np.zeros(59)], ParameterError, r"inputs: series 0 has \[nan\] at 0, expected finite"),
        (
            1e200 * np.arange(60.0),
            ParameterError,
            "inputs: 'u0' has a standard deviation of 1.7e.201, expected",
        ),
        (
            1e-200 * np.arange(60.0),
            ParameterError,
            "inputs: 'u0' has a standard deviation of 1.7e-199, expected",
        ),
        ("abc", ShapeError, "inputs: expected an array of numbers"),
        (
            pd.DataFrame(np.eye(60)[:, :2], columns=["a", "a"]),
            ParameterError,
            "inputs: 2 columns are called 'a'",
        ),
    ],
)
def test_inputs_that_are_no_good_are_refused(data, inputs, error, words):
    x, y, _ = (part[:60] for part in data)
    with pytest.raises(error, match=words):
        CGOMSModel.fit(x, y, inputs=inputs)


@pytest.mark.parametrize("name", ["x", "y"])
def test_inputs_that_hold_what_is_to_be_found_are_refused(data, name):
    x, y, us = (part[:200] for part in data)
    inputs = np.hstack([us, 2.0 * {"x": x, "y": y}[name] + 1.0])
    with pytest.raises(ParameterError, match=f"inputs, features: from them {name} of the same row follows"):
        CGOMSModel.fit(x, y, inputs=inputs)


def test_numbers_of_series_have_to_agree(data):
    x, y, us = (part[:60] for part in data)
    with pytest.raises(ShapeError, match="inputs: got 1 series, expected 2, as many as of y"):
        CGOMSModel.fit([x, x], [y, y], inputs=us)
    with pytest.raises(ShapeError, match=r"inputs: got series of \[1, 2\] columns, expected as many in each"):
        CGOMSModel.fit([x, x], [y, y], inputs=[us, us[:, :1]])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"features": "lags"}, "features: got 'lags', expected WindowFeatures, 'auto' or None"),
        ({"features": "auto"}, "features: got 'auto' with objective='joint'.*expected objective='filter'"),
        ({"order": 0}, "order: got 0, expected"),
        ({"order": 2, "features": WindowFeatures(order=2)}, "order: got 2 beside features.*expected 1"),
        (
            {"features": WindowFeatures(products=True)},
            "features: got products without inputs; expected inputs",
        ),
        ({"order": 2, "form": "covariance"}, "form: got 'covariance' with inputs or features.*expected"),
        (
            {"features": WindowFeatures(hinges=[[0.0], [1.0]])},
            "hinges: got knots of 2 components, expected 1",
        ),
        ({"features": WindowFeatures(hinges=[[1e6]])}, r"features: .* > 1e\+06' is constant"),
    ],
)
def test_maps_that_do_not_fit_are_refused(data, options, words):
    x, y, _ = (part[:60] for part in data)
    with pytest.raises(ParameterError, match=words):
        CGOMSModel.fit(x, y, **options)

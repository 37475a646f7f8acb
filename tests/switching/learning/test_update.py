"""Going on with new rows: statistics of those before join them, and are forgotten."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FadeLaw, FuzzyMarkovLaw, KalmanFilter
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.switching.learning import em, filter_training
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.gaussians import transition_vectors
from fuzzykf.switching.learning.likelihood import log_likelihood

OPTIONS = {"form": "regression", "n_starts": 1, "tolerance": 1e-5}


def hard_truth(offset=0.0):
    """Two regimes that are told apart well; the offset is that of the state."""

    def by_arrival(a, b):
        return np.broadcast_to(np.reshape([a, b], (1, 2, 1, 1)), (2, 2, 1, 1))

    return CGOMSModel.from_regressions(
        [[0.95, 0.05], [0.1, 0.9]],
        Ayy=by_arrival(0.6, 0.2),
        Ny=by_arrival(0.0, 4.0)[..., 0],
        Qyy=by_arrival(0.4, 0.8),
        Axx=by_arrival(0.3, 0.2),
        H=by_arrival(0.5, -0.3),
        G=by_arrival(1.0, -1.0),
        c=by_arrival(offset, offset - 1.0)[..., 0],
        C=by_arrival(0.2, 0.1),
        means=((0.0, 0.0), (1.0, 5.0)),
        covariances=[[[1.0, 0.4], [0.4, 0.8]], [[0.7, -0.3], [-0.3, 1.0]]],
    )


def fuzzy_truth():
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    pairs = np.broadcast_to(pair, (2, 2, 4, 4))
    return CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), [[0.0, 0.0], [4.0, 3.0]], pairs, 1)


@pytest.fixture(scope="module")
def hard():
    """A fit on 300 rows, and 300 rows more."""
    data = hard_truth().simulate(600, np.random.default_rng(1))
    return CGOMSModel.fit(data.x[:300], data.y[:300], **OPTIONS), data.x, data.y


@pytest.fixture(scope="module")
def single():
    """A fit of one regime, in which nothing is hidden."""
    truth = CGOMSModel.from_pairwise(
        [[1.0]],
        [[[0.5, 0.2], [0.0, 0.7]]],
        noise=[[[1.0, 0.3], [0.3, 0.5]]],
        means=[[0.0, 0.0]],
        covariances=[np.eye(2)],
        dim_x=1,
    )
    data = truth.simulate(400, np.random.default_rng(2))
    x, y = 3.0 + 2.0 * data.x, 100.0 - data.y
    return CGOMSModel.fit(x[:250], y[:250], n_regimes=1, **OPTIONS), x, y


def forms(model):
    """All numbers of the Gaussian part."""
    return [*model.form.table, model.form.means, model.form.covariances]


def weighted_regression(target, regressors, weight):
    """Coefficients and variance of weighted least squares."""
    root = np.sqrt(weight)[:, None]
    beta = np.linalg.lstsq(root * regressors, root[:, 0] * target, rcond=None)[0]
    return beta, np.average((target - regressors @ beta) ** 2, weights=weight)


# --------------------------------------------------------------------------- against closed forms


@pytest.mark.parametrize("forget", [1.0, 0.99, 0.9])
def test_one_regime_is_weighted_least_squares(single, forget) -> None:
    fit, x, y = single
    found = fit.update(x[250:330], y[250:330], forget=forget).update(x[330:], y[330:], forget=forget).model
    # rows of one call count alike; what is before is discounted by the rows of the calls after it
    row = np.repeat([forget**150, forget**70, 1.0], [250, 80, 70])
    step = np.arange(399)
    step = step[(step != 249) & (step != 329)]  # each call begins a series
    w, one = row[step + 1], np.ones(len(step))
    x0, x1, y0, y1 = x[step, 0], x[step + 1, 0], y[step, 0], y[step + 1, 0]
    of_y, Qyy = weighted_regression(y1, np.stack([y0, one], axis=1), w)
    of_x, C = weighted_regression(x1, np.stack([x0, y0, y1, one], axis=1), w)
    table = found.form.table
    expected = (of_y[0], of_y[1], Qyy, of_x[0], of_x[1], of_x[2], of_x[3], C)
    names = ("Ayy", "Ny", "Qyy", "Axx", "H", "G", "c", "C")
    got = [getattr(table, name).item() for name in names]
    np.testing.assert_allclose(got, expected, rtol=2e-4, atol=2e-4)  # the prior is a ten-thousandth of a row
    z = np.concatenate([x, y], axis=1)
    np.testing.assert_allclose(found.form.means[0], np.average(z, axis=0, weights=row), rtol=1e-5)
    np.testing.assert_allclose(found.form.covariances[0], np.cov(z.T, aweights=row, ddof=0), rtol=1e-4)


def test_states_that_are_missing_leave_out_their_factor(single) -> None:
    fit, x, y = single
    seldom = x[250:].copy()
    seldom[::3] = np.nan
    found = fit.update(seldom, y[250:], forget=0.99).model.form.table
    known = np.concatenate([np.ones(250, bool), np.isfinite(seldom[:, 0])])
    row = np.repeat([0.99**150, 1.0], [250, 150])
    step = np.delete(np.arange(399), 249)
    of_y, _ = weighted_regression(y[step + 1, 0], np.stack([y[step, 0], step**0], axis=1), row[step + 1])
    step = step[known[step] & known[step + 1]]
    regressors = np.stack([x[step, 0], y[step, 0], y[step + 1, 0], step**0], axis=1)
    of_x, C = weighted_regression(x[step + 1, 0], regressors, row[step + 1])
    got = [found.Ayy, found.Ny, found.Axx, found.H, found.G, found.c, found.C]
    np.testing.assert_allclose([a.item() for a in got], [*of_y, *of_x, C], rtol=2e-4, atol=2e-4)


def test_new_rows_without_any_state_teach_the_observation_alone(hard) -> None:
    fit, _, y = hard
    found = fit.update(np.full((300, 1), np.nan), y[300:])
    before, after = fit.model.form.table, found.model.form.table
    assert np.abs(after.Ayy - before.Ayy).max() > 1e-3
    np.testing.assert_allclose(after.Axx, before.Axx, atol=2e-3)  # but for what one more round gains
    np.testing.assert_allclose(after.C, before.C, rtol=2e-3)
    assert np.isfinite(found.class_weights).all()


# --------------------------------------------------------------------------- against all rows


def test_two_halves_are_nearly_the_whole(hard) -> None:
    fit, x, y = hard
    halves = fit.update(x[300:], y[300:])
    whole = CGOMSModel.fit(x, y, **OPTIONS)
    rows = gather([x[:300], x[300:]], [y[:300], y[300:]])
    first, second = (log_likelihood(one.model.placed(), rows) for one in (halves, whole))
    assert -0.005 < (first - second) / 600 < 1e-4
    half = log_likelihood(fit.model.placed(), rows)
    assert first > half  # and the new rows were worth having
    np.testing.assert_allclose(halves.model.transition, whole.model.transition, atol=0.02)


@pytest.mark.parametrize("law", ["fmc1", "free", FadeLaw.between(20, 5)], ids=["fmc1", "free", "fade"])
def test_two_halves_of_a_fuzzy_switch(law) -> None:
    data = fuzzy_truth().simulate(300, np.random.default_rng(3))
    options = {**OPTIONS, "law": law, "n_nodes": 1, "max_iter": 20, "tolerance": 1e-3}
    fit = CGOFMSModel.fit(data.x[:180], data.y[:180], **options)
    found = fit.update(data.x[180:], data.y[180:])
    rows = gather(data.x, data.y)
    whole = CGOFMSModel.fit(data.x, data.y, **options)
    values = [log_likelihood(one.model.placed(1), rows) / 300 for one in (found, whole)]
    assert -0.02 < values[0] - values[1] < 0.005
    assert found.model.law.kind == fit.model.law.kind
    assert (np.diff(found.trace) > -1e-8 * np.abs(found.trace[:-1])).all()


def test_what_is_forgotten_altogether_leaves_the_new_rows_alone(hard) -> None:
    fit, x, y = hard
    found = fit.update(x[300:], y[300:], forget=1e-3)
    learned = fit.continuation.learned
    data = gather(x[300:], y[300:], earlier=fit.continuation.earlier)
    start = em.Estimate(learned.chain, learned.gaussian)
    alone, *_ = em.run_em(start, np.eye(2), data, max_iter=500, tolerance=1e-5)
    model = found.continuation.learned
    np.testing.assert_allclose(model.numbers, alone.chain.vector, atol=1e-12)
    np.testing.assert_allclose(model.gaussian.vector, alone.gaussian.vector, atol=1e-9)


def test_statistics_are_the_discounted_sum_and_so_is_what_is_raised(hard) -> None:
    fit, x, y = hard
    found = fit.update(x[300:], y[300:], forget=0.995)
    learned = found.continuation.learned
    data = gather(x[300:], y[300:], earlier=fit.continuation.earlier)
    now = em.Estimate(learned.chain, learned.gaussian)
    seen = em.expectation(now, np.eye(2), data, transition_vectors(data))
    before, after = (one.continuation.learned.statistics for one in (fit, found))
    factor = 0.995**300
    np.testing.assert_allclose(after.counts.pairs, factor * before.counts.pairs + seen.pairs, rtol=1e-9)
    np.testing.assert_allclose(after.counts.first, factor * before.counts.first + seen.first, rtol=1e-9)
    assert after.rows.observation.weight.sum() == pytest.approx(300 * (factor + 1.0))
    assert after.steps.state.weight.sum() == pytest.approx(299 * (factor + 1.0))
    P, first = now.chain.transition, now.chain.initial
    of_switch = (before.counts.pairs * np.log(P)).sum() + before.counts.first @ np.log(first)
    of_rows = now.gaussian.log_likelihood(before.steps)
    expected = seen.log_likelihood + factor * (of_switch + of_rows) + now.gaussian.log_prior
    assert found.trace[-1] == pytest.approx(expected, rel=1e-9)


# --------------------------------------------------------------------------- what changes


def test_a_change_is_followed_if_what_was_is_forgotten() -> None:
    rng = np.random.default_rng(5)
    before, after = hard_truth(0.0).simulate(600, rng), hard_truth(2.0).simulate(600, rng)
    fit = CGOMSModel.fit(before.x, before.y, **OPTIONS)
    follows = keeps = fit
    for k in range(0, 600, 150):
        rows = slice(k, k + 150)
        follows = follows.update(after.x[rows], after.y[rows], forget=0.5 ** (1 / 60))
        keeps = keeps.update(after.x[rows], after.y[rows])
    new = hard_truth(2.0).simulate(500, rng)

    def error(model):
        return float(np.sqrt(np.mean((model.filter().filter(new.y).x - new.x) ** 2)))

    best = error(hard_truth(2.0))
    assert error(follows.model) < 1.1 * best
    assert error(keeps.model) > 1.3 * best


# --------------------------------------------------------------------------- what comes out


def test_the_result_it_goes_on_from_is_left_alone(hard) -> None:
    fit, x, y = hard
    before = pickle.dumps(fit.continuation)
    numbers = [a.copy() for a in forms(fit.model)]
    first = fit.update(x[300:], y[300:], forget=0.99)
    again = fit.update(x[300:], y[300:], forget=0.99)
    assert pickle.dumps(fit.continuation) == before
    for a, b in zip(numbers, forms(fit.model), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(forms(first.model), forms(again.model), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("law", ["fmc2", "graph", None])
def test_it_goes_on_from_a_pickle(law, hard) -> None:
    fit, x, y = hard
    if law is not None:
        fit = CGOFMSModel.fit(x[:300], y[:300], law=law, n_nodes=2, max_iter=5, **OPTIONS)
    there = pickle.loads(pickle.dumps(fit))
    one, other = (f.update(x[300:400], y[300:400]) for f in (fit, there))
    for a, b in zip(forms(one.model), forms(other.model), strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.model.to_dict() == other.model.to_dict()


def test_it_tells_of_the_new_rows(hard) -> None:
    fit, x, y = hard
    y = y[300:].copy()
    y[10] = np.nan
    found = fit.update(x[300:], y, forget=0.995)
    assert found.n_observations == 299
    weight = found.continuation.learned.statistics.rows.observation.weight.sum()
    assert weight == pytest.approx(300 * 0.995**300 + 299)  # a row that misses something lets time pass
    assert found.class_weights.shape == (300, 2)
    assert np.isnan(found.class_weights[10]).all()
    rows = gather(x[300:], y, earlier=fit.continuation.earlier)
    assert found.log_likelihood == pytest.approx(log_likelihood(found.model.placed(), rows))
    assert found.bic_of_forms == {"regression": pytest.approx(found.bic)}
    with pytest.raises(ParameterError, match="bootstrap: "):
        found.bootstrap(1, np.random.default_rng(0))


def test_several_series_of_which_some_are_short(hard) -> None:
    fit, x, y = hard
    found = fit.update([x[300:400], x[400:401], x[401:]], [y[300:400], y[400:401], y[401:]], forget=0.99)
    assert found.class_weights.shape == (300, 2)
    weight = found.continuation.learned.statistics.steps.observation.weight.sum()
    assert weight == pytest.approx(299 * 0.99**300 + 99 + 198)


def test_names_are_kept_and_tables_go_by_them() -> None:
    truth = hard_truth()
    data = truth.simulate(400, np.random.default_rng(7))
    hours = pd.date_range("2026-01-01", periods=400, freq="h")
    table = pd.DataFrame({"load": data.x[:, 0], "t": data.y[:, 0]}, hours)
    table["noise"] = np.random.default_rng(8).normal(size=400)
    fit = CGOMSModel.fit(table[["load"]][:300], table[["t", "noise"]][:300], **OPTIONS)
    new = table[300:]
    found = fit.update(new[["load"]], new[["noise", "load", "t"]])
    assert found.model.labels == fit.model.labels
    pd.testing.assert_index_equal(found.class_weights.index, hours[300:])
    plain = fit.update(data.x[300:], new[["t", "noise"]].to_numpy())
    assert plain.model.labels == fit.model.labels
    for a, b in zip(forms(found.model), forms(plain.model), strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(ParameterError, match="y: got no column 'noise'"):
        fit.update(new[["load"]], new[["t"]])
    with pytest.raises(ParameterError, match="x: got no column 'load'"):
        fit.update(new[["t"]], new[["t", "noise"]])
    with pytest.raises(ParameterError, match="y: its rows are 2:00:00 apart"):
        fit.update(new["load"][::2].to_numpy(), new[["t", "noise"]][::2])


def test_a_state_without_feedback_and_a_fuzzy_ring_go_on() -> None:
    data = hard_truth().simulate(400, np.random.default_rng(9))
    seldom = data.x.copy()
    seldom[1::2] = np.nan
    fit = CGOMSModel.fit(seldom[:300], data.y[:300], state_feedback=False, **OPTIONS)
    found = fit.update(seldom[300:], data.y[300:])
    assert (found.model.form.table.Axx == 0.0).all()
    law = FadeLaw(3, {(0, 1): (0.05, 4), (1, 2): (0.05, 4), (2, 0): (0.05, 4)})
    ring = CGOFMSModel.fit(data.x[:300], data.y[:300], law=law, n_nodes=1, max_iter=3, **OPTIONS)
    found = ring.update(data.x[300:], data.y[300:])
    assert found.switch_mean is None
    assert found.class_weights.shape == (100, 3)
    assert list(found.model.law.fades) == list(law.fades)


def test_what_the_rows_that_count_cannot_support_is_said(hard) -> None:
    fit, x, y = hard
    assert not [note for note in fit.update(x[300:], y[300:]).warnings if "few for" in note]
    notes = fit.update(x[300:340], y[300:340], forget=0.9).warnings
    # 300 * .9**40 + 40 rows of two numbers, but for rounding
    assert any("count as 89 measured numbers, few for 44 parameters" in note for note in notes), notes


# --------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize("forget", [0.0, -0.5, 1.5, np.nan, np.inf, "half", None, [0.5]])
def test_forget_is_a_share(hard, forget) -> None:
    fit, x, y = hard
    with pytest.raises(ParameterError, match=r"forget: got .*\]0, 1\]"):
        fit.update(x[300:], y[300:], forget=forget)


def test_a_number_that_leaves_nothing_is_refused(hard) -> None:
    fit, x, y = hard
    with pytest.raises(ParameterError, match=r"forget: leaves .* the new ones have 9; expected at least 20"):
        fit.update(x[300:310], y[300:310], forget=0.5)
    with pytest.raises(ParameterError, match=r"forget: leaves .* the weight of 0 steps"):
        fit.update(np.full(300, np.nan), y[300:], forget=1e-9)


def test_columns_rows_and_units_are_those_of_the_fit(hard) -> None:
    fit, x, y = hard
    with pytest.raises(ShapeError, match="x: got 2 columns, expected 1"):
        fit.update(np.c_[x, x][300:], y[300:])
    with pytest.raises(ShapeError, match="y: got 2 columns, expected 1"):
        fit.update(x[300:], np.c_[y, y][300:])
    with pytest.raises(ShapeError, match="x, y, r: series 0 has 300 states, 299 observations"):
        fit.update(x[300:], y[301:])
    with pytest.raises(ParameterError, match=r"y: missing"):
        fit.update(x[300:], None)
    with pytest.raises(ParameterError, match=r"x, y: hold no step in which y is measured"):
        fit.update(x[300:301], y[300:301])
    with pytest.raises(ParameterError, match=r"x, y: hold no step in which y is measured"):
        fit.update(x[300:310], np.full(10, np.nan))
    far = x[300:].copy()
    far[3] = 1e200
    with pytest.raises(ParameterError, match=r"x\[0\]: got 1e\+200, .* standard deviations away"):
        fit.update(far, y[300:])


def test_an_outlier_leaves_all_finite(hard) -> None:
    fit, x, y = hard
    far = y[300:].copy()
    far[3] = 1e6
    found = fit.update(x[300:], far)
    assert all(np.isfinite(a).all() for a in forms(found.model))


def test_results_without_statistics_say_what_would_do(hard, monkeypatch) -> None:
    monkeypatch.setattr(filter_training, "MOST", 5)
    _, x, y = hard
    r = np.arange(300) // 150
    known = CGOMSModel.fit(x[:300], y[:300], r, **OPTIONS)
    with pytest.raises(ParameterError, match=r"update: .* with r; expected .* r=None"):
        known.update(x, y)
    vine = CGOMSModel.fit(x[:300], y[:300], form="covariance", n_starts=1, max_iter=2)
    with pytest.raises(ParameterError, match=r"update: .* 'covariance'; expected .* form='regression'"):
        vine.update(x, y)
    filtering = CGOMSModel.fit(x[:300], y[:300], objective="filter", n_starts=1, max_iter=2)
    with pytest.raises(ParameterError, match=r"update: .* objective='filter'; expected .*'joint'"):
        filtering.update(x, y)
    kalman = KalmanFilter(1, 1, H=[[1.0]], P=0.0, Q=0.0).fit([2.0, -2.0] * 20, free={"R": "full"})
    with pytest.raises(ParameterError, match=r"update: this result, of a KalmanFilter, holds no statistics"):
        kalman.update(x, y)

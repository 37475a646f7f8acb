"""Missing observations: all spellings agree, and nothing is learned from what is not there.

What weights of both signs may leave, and what not.

That the results are right is shown in tests/exactness/test_gaps.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel, KnownSwitchFilter, OFSRFilter
from fuzzykf.errors import (
    NotPositiveDefiniteError,
    ParameterError,
    QuadratureError,
    SequenceError,
    ShapeError,
)
from fuzzykf.switching import SwitchingFilter
from fuzzykf.switching.dynamics.pairs import PairCoefficients, PairTables
from fuzzykf.switching.inference.exact import check_signed

NONE = np.nan
RESULTS = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")


@pytest.fixture(params=["fuzzy", "hard", "pair", "order 3"])
def f(request, fuzzy_model, hard_model, make_transitions):
    if request.param == "fuzzy":
        return OFSRFilter(fuzzy_model, 3)
    if request.param == "hard":
        return CGOMSMFilter(hard_model)
    if request.param == "pair":  # two observations at a time
        A, Q, means, Sigma = make_transitions(2, 1, 2, seed=3)
        P = [[0.8, 0.2], [0.3, 0.7]]
        return CGOMSMFilter(CGOMSModel.from_transitions(P, A, Q, means, Sigma, 1))
    model = CGOMSModel.from_cglssm(
        [[0.9, 0.1], [0.2, 0.8]],
        [[[0.9]], [[0.5]]],
        [[[1.0]], [[0.7]]],
        [[[0.4]], [[1.0]]],
        [[[0.5]], [[0.8]]],
        order=3,
    )
    return CGOMSMFilter(model)


@pytest.fixture
def ys(f):
    """A series with holes at the start, in the middle (one and three long) and at the end."""
    y = f.model.simulate(25, np.random.default_rng(0)).y
    y[[0, 6, 11, 12, 13, 23, 24]] = NONE
    if y.shape[1] > 1:
        y[4, 0] = y[9, 1] = y[14, 1] = NONE
    return y


def new(f):
    return type(f)(f.model, **f._options())


def test_steps_are_the_series(f, ys):
    result, g = f.filter(ys), new(f)
    for n, z in enumerate(ys):
        g.predict()
        prior = g.x, g.P, g.mu
        g.update(z)
        np.testing.assert_allclose(prior[0][:, 0], result.x_prior[n], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(prior[1], result.P_prior[n], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(g.x[:, 0], result.x[n], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(g.P, result.P[n], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(g.mu, result.mu[n], rtol=1e-9, atol=1e-13)
        assert g.log_likelihood == pytest.approx(result.log_likelihood[n], rel=1e-10, abs=1e-12)
        np.testing.assert_allclose(g.x_prior[:, 0], result.x_prior[n], rtol=1e-10, atol=1e-12)


def test_none_nan_and_lists_are_one_thing(f, ys):
    gone = np.isnan(ys).all(axis=1)
    spelled = [None if missing else list(y) for y, missing in zip(ys, gone, strict=True)]
    a, b = f.filter(ys), new(f).filter(spelled)
    for name in RESULTS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_a_predict_after_a_predict_is_a_missing_observation(f, ys):
    # ... but at the start, where the first observation has to be refused by name
    g, h = new(f), new(f)
    for z in ys:
        h.step(z)
    g.update(None)
    for z in ys[1:]:
        g.predict()
        if not np.isnan(z).all():
            g.update(z)
    g.update(None)  # the last one was predicted only
    # steps of the engine round otherwise than the verbs
    np.testing.assert_allclose(g.x, h.x, rtol=1e-13)
    np.testing.assert_allclose(g.P, h.P, rtol=1e-13)
    np.testing.assert_allclose(g.mu, h.mu, rtol=1e-13)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_predicting_k_times_shows_k_steps_ahead(f, ys, k):
    f.filter(ys[:10])
    ahead = f.forecast(k)
    for _ in range(k):
        f.predict()
    np.testing.assert_allclose(f.x[:, 0], ahead.x[-1], rtol=1e-12)
    np.testing.assert_allclose(f.P, ahead.P[-1], rtol=1e-12)
    np.testing.assert_allclose(f.mu, ahead.mu[-1], rtol=1e-12)


def test_a_missing_observation_tells_nothing(f, ys):
    result = f.filter(ys)
    for n in np.flatnonzero(np.isnan(ys).all(axis=1)):
        assert result.log_likelihood[n] == 0.0
        np.testing.assert_allclose(result.x[n], result.x_prior[n], rtol=1e-12)
        np.testing.assert_allclose(result.P[n], result.P_prior[n], rtol=1e-11, atol=1e-14)
    assert (result.log_likelihood[~np.isnan(ys).any(axis=1)] != 0.0).all()
    # step by step: neither an innovation nor a distance
    g = new(f)
    g.step(ys[1])
    g.step(None)
    assert g.log_likelihood == 0.0
    assert g.nis == g.mahalanobis == 0.0
    np.testing.assert_array_equal(g.y, np.zeros((g.dim_z, 1)))
    assert np.isfinite(g.S).all()
    assert np.isnan(g.z).all()


def test_nothing_at_all_observed(f):
    # the law of the model itself, step after step
    n = 6
    result = f.filter(np.full((n, f.dim_z), NONE))
    assert (result.log_likelihood == 0.0).all()
    ahead = new(f).forecast(n)
    np.testing.assert_allclose(result.x, ahead.x, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(result.P, ahead.P, rtol=1e-10)
    np.testing.assert_allclose(result.mu, ahead.mu, rtol=1e-10)
    smoothed = new(f).smooth(np.full((n, f.dim_z), NONE))
    np.testing.assert_allclose(smoothed.x, result.x, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(smoothed.mu, result.mu, rtol=1e-14)


def test_update_with_none_comes_first(f, ys):
    g = new(f)
    g.update(None)
    law = f.model.on_nodes(3).initial() if hasattr(f, "n_nodes") else f.model.on_nodes().initial()
    m = f.dim_x
    np.testing.assert_allclose(g.x[:, 0], law.probability @ law.mean[:, :m], rtol=1e-12)
    np.testing.assert_allclose(g.mu, law.probability, rtol=1e-12)
    with pytest.raises(SequenceError):  # the verbs keep their order in a gap
        g.update(None)
    g.predict()
    g.update(ys[1])
    h = new(f)
    h.filter(ys[:2])
    np.testing.assert_allclose(g.x, h.x, rtol=1e-12)


def test_a_part_of_a_vector(make_transitions):
    # what is there is used: the likelihood is that of the part, and the estimate lies between
    A, Q, means, Sigma = make_transitions(2, 1, 2, seed=3)
    model = CGOMSModel.from_transitions([[0.8, 0.2], [0.3, 0.7]], A, Q, means, Sigma, 1)
    ys = model.simulate(6, np.random.default_rng(1)).y
    f = CGOMSMFilter(model)
    f.filter(ys[:5])
    g, h = f.copy(), f.copy()
    f.step(ys[5])
    g.step([ys[5, 0], NONE])
    h.step(None)
    assert f.P[0, 0] < g.P[0, 0] < h.P[0, 0]
    assert g.log_likelihood != 0.0
    assert g.y[1, 0] == 0.0
    assert g.nis == pytest.approx(g.y[0, 0] ** 2 / g.S[0, 0], rel=1e-10)


def test_copies_and_files_in_a_gap(f, ys, tmp_path):
    full = f.filter(ys)
    for n in (1, 7, 12, 13, 14, 15):
        g = new(f)
        g.filter(ys[:n])
        path = tmp_path / f"{n}.json"
        g.save(path)
        others = g.copy(), type(f).load(path)
        for z in ys[n:]:
            g.step(z)
        np.testing.assert_allclose(g.x[:, 0], full.x[-1], rtol=1e-10)
        for h in others:
            for z in ys[n:]:
                h.step(z)
            for name in ("x", "P", "mu"):
                np.testing.assert_array_equal(getattr(h, name), getattr(g, name))


def test_many_series_with_gaps(f, ys):
    other = f.model.simulate(25, np.random.default_rng(9)).y
    kept = ("x", "P", "mu", "log_likelihood")
    result = f.filter_many(np.stack([ys, other]), keep=kept)
    for k, series in enumerate((ys, other)):
        alone = new(f).filter(series)
        for name in kept:
            both = getattr(result, name)[k], getattr(alone, name)
            np.testing.assert_allclose(*both, rtol=1e-10, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("z", "error"),
    [(np.inf, ParameterError), ([1.0, 2.0, 3.0], ShapeError), ("a", ShapeError)],
)
def test_refusals_in_a_gap_leave_the_filter_as_it_was(fuzzy_model, z, error):
    f = OFSRFilter(fuzzy_model, 3)
    f.step(1.0)
    f.step(None)
    before = f._export_state()
    with pytest.raises(error):
        f.step(z)
    assert f._export_state() == before
    f.predict()
    before = f._export_state()
    with pytest.raises(error):
        f.update(z)
    assert f._export_state() == before


# --------------------------------------------------------------------------- a known switch


def test_known_switch_predicts_over_gaps(fuzzy_model):
    r = [0.2, 0.0, 1.0, 0.6, 0.6]
    ys = fuzzy_model.simulate(5, np.random.default_rng(2)).y
    gappy = ys.copy()
    gappy[[1, 2]] = NONE
    result = KnownSwitchFilter(fuzzy_model).filter(gappy, r)
    f = KnownSwitchFilter(fuzzy_model)
    f.step(ys[0], r[0])
    f.predict(r[1])
    f.predict(r[2])  # the observation at r[1] is missing
    f.predict(r[3])  # and so is that at r[2]
    np.testing.assert_allclose(f.x[:, 0], result.x_prior[3], rtol=1e-12)
    f.update(ys[3])
    np.testing.assert_allclose(f.x[:, 0], result.x[3], rtol=1e-12)
    f.step(ys[4], r[4])
    np.testing.assert_allclose(f.P, result.P[4], rtol=1e-12)
    assert result.log_likelihood[1] == result.log_likelihood[2] == 0.0


def test_known_switch_refuses_before_anything_changes(fuzzy_model):
    f = KnownSwitchFilter(fuzzy_model)
    f.step(1.0, 0.2)
    f.predict(0.4)
    x, P, n = f.x, f.P, f._n
    for wrong in (7.0, NONE, "a"):
        with pytest.raises(ParameterError, match="r: "):
            f.predict(wrong)
        np.testing.assert_array_equal(f.x, x)
        np.testing.assert_array_equal(f.P, P)
        assert f._n == n
    f.update(None)
    f.predict()
    with pytest.raises(ParameterError, match="r: "):
        f.predict()  # what is missing has to have a value of the switch all the same
    f.update(2.0, 0.5)
    assert np.isfinite(f.x).all()


def test_known_switches_of_missing_observations_are_needed(fuzzy_model):
    with pytest.raises(ParameterError, match="r: "):
        KnownSwitchFilter(fuzzy_model).filter([1.0, NONE, 2.0], [0.1, NONE, 0.3])


def test_known_switch_first_observation_missing(fuzzy_model):
    f = KnownSwitchFilter(fuzzy_model)
    f.update(None, 0.25)
    mean, covariance = fuzzy_model.form.marginal(np.array([[0.75, 0.25]]))
    np.testing.assert_allclose(f.x[:, 0], mean[0, :1], rtol=1e-12)
    np.testing.assert_allclose(f.P, covariance[0, :1, :1], rtol=1e-12)


@pytest.mark.parametrize(
    ("masses", "means", "message"),
    [
        # 1.005 (1 + .55^2) - .005 (1 + 110.55^2) = -59.8
        ([1.005, -0.005], [0.0, 110.0], r"a variance of -59\.8; use more nodes or the rule 'cell'"),
        ([1.02, -0.02], [0.0, 1.0], r"a negative mass of 0\.02 \(at most"),
        ([1.0, 0.0], [0.0, np.nan], "a variance of nan"),
        ([1.005, -0.005], [0.0, 10.0], None),
    ],
)
def test_weights_of_both_signs_must_leave_a_law(masses, means, message):
    masses = np.array(masses)
    with np.errstate(divide="ignore"):
        table = np.array([np.log(np.abs(masses)), means, [1.0, 1.0]])
    if message is None:
        check_signed(table, np.sign(masses))
    else:
        with pytest.raises(QuadratureError, match=message):
            check_signed(table, np.sign(masses))


def certain_observations(f, certain):
    """A system like that of a filter, in which some components of an observation have no noise."""
    system = f._system

    class Certain:
        dim_x, dim_z, order, steady_from, chain = f.dim_x, f.dim_z, 1, None, system.chain
        initial = staticmethod(system.initial)

        @staticmethod
        def pair_tables(n):
            tables = system.pair_tables(n)
            pairs = tables.pairs._asdict()
            Qyy = pairs["Qyy"].copy()
            Qyy[..., certain, :] = Qyy[..., :, certain] = 0.0
            return PairTables(tables.transition, PairCoefficients(**pairs | {"Qyy": Qyy}))

    return SwitchingFilter(Certain())


@pytest.mark.parametrize("y", [[0.5, -0.5], [0.5, np.nan], [np.nan, 0.5], [np.nan, np.nan]])
@pytest.mark.parametrize("certain", [0, 1])
def test_observations_need_noise_whatever_is_seen_of_them(certain, y, make_transitions):
    A, Q, means, Sigma = make_transitions(1, 1, 2, seed=3)
    model = CGOMSModel.from_transitions([[1.0]], A, Q, means, Sigma, 1)
    f = certain_observations(CGOMSMFilter(model), certain)
    f.step([0.3, -0.2])
    x = f.x
    message = (
        r"noise covariance of the observation for the pair \(0, 0\): expected a positive definite matrix"
    )
    with pytest.raises(NotPositiveDefiniteError, match=message):
        f.step(y)
    np.testing.assert_array_equal(f.x, x)

"""The filter of a switch that is known."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGLSSM,
    CGOMSMFilter,
    FadeLaw,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError


def test_it_takes_a_switching_model():
    with pytest.raises(ParameterError, match="model: got NoneType, expected a CGOFMSModel, CGOMSModel or"):
        KnownSwitchFilter(None)


@pytest.fixture
def known(fuzzy_model):
    return KnownSwitchFilter(fuzzy_model)


def test_switch_told_at_predict_or_at_update(known, fuzzy_model):
    data = fuzzy_model.simulate(8, np.random.default_rng(1))
    expected = known.filter(data.y, data.r)
    late = known.copy()
    late.reset()
    early = late.copy()
    for k in range(8):
        early.predict(data.r[k])
        assert early.nodes == [data.r[k]]
        assert early.switch == data.r[k]
        np.testing.assert_allclose(early.x[:, 0], expected.x_prior[k], rtol=1e-12)
        early.update(data.y[k])
        np.testing.assert_allclose(early.x_prior[:, 0], expected.x_prior[k], rtol=1e-12)
        late.predict()
        assert np.isnan(late.x).all()
        assert np.isnan(late.switch)
        late.update(data.y[k], data.r[k])
        for f in (early, late):
            np.testing.assert_allclose(f.x[:, 0], expected.x[k], rtol=1e-12)
            np.testing.assert_allclose(f.P, expected.P[k], rtol=1e-12)
            assert f.log_likelihood == pytest.approx(expected.log_likelihood[k], rel=1e-12)
            assert f.switch == data.r[k]
            assert f.switch_mean == data.r[k]
            np.testing.assert_array_equal(f.mu, [1.0])
        assert np.isnan(late.x_prior).all()
        assert np.isnan(late.P_prior).all()


def test_hard_model_with_known_regimes(hard_model):
    data = hard_model.simulate(10, np.random.default_rng(1))
    result = KnownSwitchFilter(hard_model).filter(data.y, data.r)
    assert result.x.shape == (10, 2)
    np.testing.assert_array_equal(result.switch, data.r)
    # knowing the regimes is worth something
    assert result.log_likelihood.sum() > CGOMSMFilter(hard_model).filter(data.y).log_likelihood.sum() - 5


def test_the_switch_is_given_once(known):
    with pytest.raises(
        ParameterError, match="r: missing; expected the value of the switch at this observation"
    ):
        known.step(1.0)
    with pytest.raises(
        ParameterError, match="r: missing; the value of the switch has to be given to predict"
    ):
        known.update(1.0)
    known.predict(0.3)
    with pytest.raises(ParameterError, match=r"r: got 0\.4 after 0\.3; the switch is given once"):
        known.update(1.0, 0.4)
    known.update(1.0)
    assert known.switch == 0.3


@pytest.mark.parametrize("r", [-0.1, 1.1, np.nan, [0.1, 0.2], "x"])
def test_values_that_are_no_switch(known, r):
    known.step(1.0, 0.5)
    x = known.x
    for call in (known.predict, lambda r: known.step(1.0, r)):
        with pytest.raises(ParameterError, match="r: "):
            call(r)
        np.testing.assert_array_equal(known.x, x)
        assert known.switch == 0.5
    known.predict()
    with pytest.raises(ParameterError, match="r: "):
        known.update(1.0, r)
    known.update(1.0, 0.5)


def test_refusals_between_predict_and_update(known):
    # a leading predict may be repeated with the same value, not with another
    known.predict(0.3)
    known.predict(0.3)
    known.predict()
    with pytest.raises(ParameterError, match=r"r: got 0\.4 after 0\.3; the switch is given once"):
        known.predict(0.4)
    known.update(1.0)
    # later a second predict says that the observation is missing, unless it is refused itself
    known.predict(0.6)
    before = known.x, known.P, known.switch
    with pytest.raises(ParameterError, match=r"r: got values from 7\.0"):
        known.predict(7.0)
    with pytest.raises(ParameterError, match=r"r: got values from 7\.0"):
        known.step(1.0, 7.0)
    for now, then in zip((known.x, known.P, known.switch), before, strict=True):
        np.testing.assert_array_equal(now, then)
    known.update(1.0)
    known.predict()
    with pytest.raises(
        ParameterError, match="r: the value of the switch at the missing observation was never"
    ):
        known.predict()
    known.update(1.0, 0.2)
    assert known.switch == 0.2


def test_two_predicts_say_that_an_observation_is_missing(known):
    r = [0.3, 0.9, 0.1, 1.0]
    expected = known.filter([1.0, None, 0.5, None], r)
    known.reset()
    known.step(1.0, r[0])
    known.predict(r[1])
    known.predict(r[2])
    np.testing.assert_allclose(known.x[:, 0], expected.x_prior[2], rtol=1e-12)
    np.testing.assert_allclose(known.P, expected.P_prior[2], rtol=1e-12)
    known.update(0.5)
    np.testing.assert_allclose(known.x[:, 0], expected.x[2], rtol=1e-12)
    known.predict(r[3])
    np.testing.assert_allclose(known.x[:, 0], expected.x_prior[3], rtol=1e-12)


def test_series_and_switches_have_to_match(known):
    with pytest.raises(ShapeError, match=r"r: got 3 values, expected 2, one per observation"):
        known.filter([1.0, 2.0], [0.0, 0.5, 1.0])
    with pytest.raises(ParameterError, match=r"r: got values from 0\.0 to 2\.0, expected \[0, 1\]"):
        known.filter([1.0, 2.0], [0.0, 2.0])
    assert known.x.shape == (1, 1)


def test_result_does_not_share_the_switches(known):
    r = np.array([0.0, 0.5, 1.0])
    result = known.filter([1.0, 2.0, 0.0], r)
    r[:] = 0.9
    np.testing.assert_array_equal(result.switch, [0.0, 0.5, 1.0])


def test_batch_filter_takes_the_switches(known):
    r, y = [0.0, 0.5, 1.0], [1.0, 2.0, 0.0]
    result = known.filter(y, r)
    means, covariances, means_p, covariances_p = known.batch_filter(y, r)
    np.testing.assert_array_equal(means[..., 0], result.x)
    np.testing.assert_array_equal(covariances, result.P)
    np.testing.assert_array_equal(means_p[..., 0], result.x_prior)
    np.testing.assert_array_equal(covariances_p, result.P_prior)


def test_indefinite_noise_at_a_known_pair(monkeypatch, fuzzy_model):
    # pairs that never occur under the law are not proved, but a known path may take them
    from fuzzykf import CGOFMSModel, FuzzyMarkovLaw

    gamma = fuzzy_model.form.covariances.copy()
    gamma[0, 1, 0, 2] = gamma[0, 1, 2, 0] = 0.7
    model = CGOFMSModel(FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0), fuzzy_model.form.means, gamma, 1)
    f = KnownSwitchFilter(model)
    f.step(1.0, 0.0)
    x = f.x
    with pytest.raises(NotPositiveDefiniteError, match=r"r_n = 0.*r_n\+1 = 1.* eigenvalue -"):
        f.step(1.0, 1.0)
    np.testing.assert_array_equal(f.x, x)
    f.step(1.0, 0.0)


@pytest.mark.parametrize("predicted", [False, True])
def test_an_absurd_observation_leaves_the_filter_as_it_was(known, predicted):
    for f in (known, twin := known.copy()):
        f.step(0.1, 0.0)
        f.step(0.3, 0.5)
        if predicted:
            f.predict(1.0)
    before = known.x, known.P, known.switch, known.log_likelihood
    with pytest.raises(NumericalRangeError):
        known.step(1e300, 0.5)
    for now, was in zip((known.x, known.P, known.switch, known.log_likelihood), before, strict=True):
        np.testing.assert_array_equal(now, was)
    np.testing.assert_array_equal(known.step(0.2, 1.0), twin.step(0.2, 1.0))


# --------------------------------------------------------------------------- state-space models

FADES = FadeLaw.between(30, 10)
RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})


def space(law, seed=0):
    rng = np.random.default_rng(seed)
    K = len(law) if isinstance(law, list | np.ndarray) else law.n_classes
    return SwitchingStateSpace(
        law, F=0.5 * rng.normal(size=(K, 2, 2)), H=rng.normal(size=(K, 1, 2)), Q=np.eye(2), R=0.5,
        d=3.0 * rng.normal(size=(K, 1)), B=rng.normal(size=(K, 2, 1)),
    )  # fmt: skip


HARD3 = np.full((3, 3), 0.1) + 0.7 * np.eye(3)
#: Chains whose nodes are called something else.
CHAIN = SwitchChain(
    [3.0, 5.0, 7.0], np.ones(3), np.ones(3) / 3, HARD3, np.full((3, 3), 0.2) + 0.4 * np.eye(3)
)
PAIR = SwitchChain([3.0, 7.0], np.ones(2), np.ones(2) / 2, np.full((2, 2), 0.5), [[0.9, 0.1], [0.3, 0.7]])
TOLD = {  # law: values of the switch, and the same as class weights
    "fades": (FADES, [0.0, 0.25, 0.5, 1.0, 1.0, 0.7], None),
    "hard": ([[0.9, 0.1], [0.2, 0.8]], [0, 1, 1, 0, 0, 1], None),
    "three": (HARD3, [0, 2, 1, 1, 0, 2], np.eye(3)[[0, 2, 1, 1, 0, 2]]),
    "chain": (CHAIN, [3.0, 5.0, 7.0, 7.0, 3.0, 5.0], CHAIN.class_weights[[0, 1, 2, 2, 0, 1]]),
    "chain of two": (PAIR, [3.0, 7.0, 7.0, 3.0, 3.0, 7.0], PAIR.class_weights[[0, 1, 1, 0, 0, 1]]),
    "ring": (RING, [0, 2, 1, 1, 0, 2], np.eye(3)[[0, 2, 1, 1, 0, 2]]),
}


@pytest.mark.parametrize("name", TOLD)
def test_a_state_space_model_by_verbs_by_series_and_by_many(name):
    law, r, weights = TOLD[name]
    weights = np.stack([1.0 - np.array(r), r], axis=1) if weights is None else weights
    f = KnownSwitchFilter(space(law))
    ys, us = np.array([0.3, 1.0, np.nan, -2.0, 0.4, 0.0]), np.array([np.nan, 1.0, -1.0, 0.5, 2.0, 0.0])
    found = f.filter(ys, r, us)
    np.testing.assert_allclose(found.class_weights, weights, atol=1e-15)
    for other in (f.filter(ys, weights, us), f.filter_many(ys[None], r=[r], us=us).one(0)):
        np.testing.assert_array_equal(other.x, found.x)
        np.testing.assert_array_equal(other.log_likelihood, found.log_likelihood)
    g, h = KnownSwitchFilter(space(law)), KnownSwitchFilter(space(law))
    for n, y in enumerate(ys):
        u = () if n == 0 else (us[n],)
        g.step(y, weights[n], *u)
        h.predict(None, *u)
        h.update(y, r[n])  # the switch is told late
        for one in (g, h):
            np.testing.assert_allclose(one.x[:, 0], found.x[n], rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(one.P, found.P[n], rtol=1e-12)
            assert one.log_likelihood == pytest.approx(found.log_likelihood[n], rel=1e-12)
    g.reset()
    g.filter(ys[:3], r[:3], us[:3])
    g.predict(r[3], us[3])  # a missing observation, to which a control led
    rest = g.filter(ys[4:], r[4:], us[4:], resume=True)
    gap = ys.copy()
    gap[3] = np.nan
    np.testing.assert_allclose(rest.x, f.filter(gap, r, us).x[4:], rtol=1e-12, atol=1e-13)


def test_changed_verbs_are_told_the_switch_and_the_controls():
    class Half(KnownSwitchFilter):
        def update(self, z, r=None):
            super().update(0.5 * z, r)

    law, r, _ = TOLD["fades"]
    ys, us = np.arange(6.0), np.arange(6.0)
    found = Half(space(law)).filter(ys, r, us)
    np.testing.assert_allclose(found.x, KnownSwitchFilter(space(law)).filter(0.5 * ys, r, us).x, rtol=1e-12)


def test_to_know_the_switch_is_worth_much_where_an_offset_fades():
    model = SwitchingStateSpace(FADES, F=0.98, H=1.0, Q=0.04, R=0.49, d=[[0.0], [5.0]], x0=[0.0], P0=1.0)
    truth = model.simulate(400, np.random.default_rng(0))
    known = KnownSwitchFilter(model).filter(truth.y, truth.r)
    hidden = SwitchingKalmanFilter(model).filter(truth.y)
    errors = [np.mean((one.x - truth.x) ** 2) for one in (known, hidden)]
    assert errors[0] < 0.8 * errors[1]
    assert known.log_likelihood.sum() > hidden.log_likelihood.sum()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: f.filter(np.zeros(3), [0.1, 0.2]), "r: got 2 values, expected 3"),
        (lambda f: f.filter(np.zeros(2), [[0.1, 0.2]] * 2), r"r: got the class weights 0.2, expected"),
        (lambda f: f.filter(np.zeros(2), [0.1, 1.2]), "r: got values from 0.1 to 1.2"),
        (lambda f: f.filter(np.zeros(2), [0.1, 0.2], [1.0]), r"us: got shape \(1, 1\), expected \(2, 1\)"),
        (lambda f: f.predict(0.5, [1.0, 2.0]), "u: got shape"),
        (lambda f: f.step(1.0, 0.5, np.nan), "u: entry"),
        (
            lambda f: KnownSwitchFilter(space(HARD3)).step(1.0, [0.5, 0.5, 0.0]),
            "r: got .* regimes 0 to",
        ),
        (lambda f: f.smooth(np.zeros(2), [0.1, 0.2], [1.0]), r"us: got shape \(1, 1\), expected \(2, 1\)"),
        (lambda f: f.forecast(2), "steps: got 2; the future of a known switch"),
    ],
)
def test_calls_on_a_state_space_model_that_are_refused(call, message):
    f = KnownSwitchFilter(space(FADES))
    f.filter([0.1, 0.2], [0.0, 0.5])
    x = f.x
    with pytest.raises(ParameterError, match=message):
        call(f)
    np.testing.assert_array_equal(f.x, x)


def test_models_of_pairs_have_no_controls(known):
    for call in (
        lambda: known.predict(0.5, 1.0),
        lambda: known.filter([0.1], [0.5], [1.0]),
        lambda: known.filter_many([[0.1]], r=[[0.5]], us=[1.0]),
    ):
        with pytest.raises(ParameterError, match=r"us?: got .* but the model has no B"):
            call()


# --------------------------------------------------------------------------- the papers' notation


def test_the_papers_model_is_the_hard_one():
    matrices = {"A": [[[0.9]], [[0.5]]], "B": [[[1.0]], [[2.0]]], "C": [[[0.3]], [[1.0]]], "D": [[[0.5]]] * 2}
    paper = CGLSSM([[0.9, 0.1], [0.2, 0.8]], **matrices)
    model = SwitchingStateSpace(paper.transition, paper.A, paper.B, [[[0.09]], [[1.0]]], [[0.25]], x0=[0.0])
    truth = paper.simulate(30, np.random.default_rng(0))
    for make in (SwitchingKalmanFilter, lambda m: SwitchingKalmanFilter(m, method="gpb2")):
        np.testing.assert_allclose(make(paper).filter(truth.y).x, make(model).filter(truth.y).x, rtol=1e-10)
    one, other = (KnownSwitchFilter(m).filter(truth.y, truth.r) for m in (paper, model))
    np.testing.assert_allclose(one.P, other.P, rtol=1e-10)
    assert isinstance(paper.filter(), SwitchingKalmanFilter)

"""The filter of a switch that is known."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, KnownSwitchFilter
from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError


def test_it_takes_a_switching_model():
    with pytest.raises(ParameterError, match="model: got NoneType, expected a CGOFMSModel or CGOMSModel"):
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

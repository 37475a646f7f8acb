"""Forecasts: the filter moved ahead, and left where it was.

That they are exact is shown in tests/exactness/test_gaps.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, KnownSwitchFilter, OFSRFilter
from fuzzykf.errors import ParameterError

FIELDS = ("x", "P", "z_prior", "S", "mu", "switch", "switch_mean")


@pytest.fixture(params=["fuzzy", "hard"])
def f(request, fuzzy_model, hard_model):
    return OFSRFilter(fuzzy_model, 3) if request.param == "fuzzy" else CGOMSMFilter(hard_model)


@pytest.fixture
def ys(f):
    return f.model.simulate(20, np.random.default_rng(0)).y


def assert_same(a, b):
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, atol=1e-14, err_msg=name)


def test_shapes(f, ys):
    f.filter(ys)
    m, q, M = f.dim_x, f.dim_z, f.nodes.size
    result = f.forecast(4)
    assert len(result) == 4
    shapes = [(4, m), (4, m, m), (4, q), (4, q, q), (4, M), (4,), (4,)]
    assert [getattr(result, name).shape for name in FIELDS] == shapes
    np.testing.assert_array_equal(result.nodes, f.nodes)


def test_the_filter_stays_where_it_is(f, ys):
    f.filter(ys)
    before = f._export_state()
    f.forecast(5)
    assert f._export_state() == before


def test_first_step_is_the_prediction_of_the_next_observation(f, ys):
    f.filter(ys[:10])
    one = f.forecast(1)
    f.step(ys[10])
    np.testing.assert_allclose(one.x[0], f.x_prior[:, 0], rtol=1e-12)
    np.testing.assert_allclose(one.P[0], f.P_prior, rtol=1e-12)
    np.testing.assert_allclose(ys[10] - one.z_prior[0], f.y[:, 0], rtol=1e-10)
    np.testing.assert_allclose(one.S[0], f.S, rtol=1e-12)


@pytest.mark.parametrize("n", [0, 1, 10])
def test_a_predict_before_it_makes_no_difference(f, ys, n):
    f.filter(ys[:n])
    plain = f.forecast(3)
    f.predict()
    assert_same(f.forecast(3), plain)


def test_before_any_observation_the_law_of_the_model_is_shown(f):
    result = f.forecast(2)
    law = f._system.initial()
    m = f.dim_x
    np.testing.assert_allclose(result.x[0], law.probability @ law.mean[:, :m], rtol=1e-12)
    np.testing.assert_allclose(result.z_prior[0], law.probability @ law.mean[:, m:], rtol=1e-12)
    np.testing.assert_allclose(result.mu[0], law.probability, rtol=1e-12)
    np.testing.assert_allclose(result.mu[1], law.probability @ f._system.chain.transition, rtol=1e-12)


def test_in_the_middle_of_a_gap(f, ys):
    # the missing observations are steps of the forecast that have passed already
    f.filter(ys[:10])
    whole = f.forecast(6)
    f.step(None)
    f.step(None)
    rest = f.forecast(4)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(rest, name), getattr(whole, name)[2:], rtol=1e-12, atol=1e-14)


def test_far_ahead_it_settles(fuzzy_model):
    f = OFSRFilter(fuzzy_model, 3)
    f.filter(fuzzy_model.simulate(20, np.random.default_rng(0)).y)
    far = f.forecast(200)
    np.testing.assert_allclose(far.mu[-1], f._system.chain.initial, atol=1e-10)
    np.testing.assert_allclose(far.x[-1], far.x[-2], atol=1e-10)
    # the interval of a forecast is that of one normal law
    lower, upper = far.interval(0.9)
    np.testing.assert_allclose((upper - lower)[:, 0], 2 * 1.6448536269514722 * np.sqrt(far.P[:, 0, 0]))


def test_simulated_futures_agree(fuzzy_model):
    # errors of forecasts from 200 places of a simulated series, in their standard deviations
    sim = fuzzy_model.simulate(3000, np.random.default_rng(1))
    f = OFSRFilter(fuzzy_model, 5)
    errors = []
    for n, z in enumerate(sim.y[:-3]):
        f.step(z)
        if n % 15 == 14:
            ahead = f.forecast(3)
            errors.append((sim.x[n + 1 : n + 4] - ahead.x)[:, 0] / np.sqrt(ahead.P[:, 0, 0]))
    errors = np.array(errors)
    assert (np.abs(errors.mean(axis=0)) < 4 / np.sqrt(len(errors))).all()
    np.testing.assert_allclose((errors**2).mean(axis=0), 1.0, atol=0.25)


@pytest.mark.parametrize("steps", [0, -1, 1.5, "2", None, True])
def test_steps_are_whole_and_positive(f, ys, steps):
    f.filter(ys)
    before = f._export_state()
    with pytest.raises(ParameterError, match="steps"):
        f.forecast(steps)
    assert f._export_state() == before


def test_known_switches_have_no_future(fuzzy_model):
    f = KnownSwitchFilter(fuzzy_model)
    f.step(1.0, 0.3)
    with pytest.raises(ParameterError, match="steps"):
        f.forecast(3)

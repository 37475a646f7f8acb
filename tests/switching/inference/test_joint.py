"""The methods of pairwise models: three functions do what a series does, and what they hand on is sound."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSModel
from fuzzykf.errors import NumericalRangeError
from fuzzykf.switching.inference.joint import JOINT_GPB2, JOINT_IMM
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.series import FOUND, SHOWN, Stand

YS = np.array([[0.5, 1.0], [np.nan, 0.2], [-1.0, 0.0], [np.nan, np.nan], [0.3, -2.0], [1.0, 1.0]])
METHODS = [JOINT_IMM, JOINT_GPB2]


@pytest.fixture(scope="module")
def system():
    rng = np.random.default_rng(0)
    root = 0.4 * rng.normal(size=(2, 3, 3)) + np.eye(3)
    noise = root @ np.swapaxes(root, -1, -2)
    return CGOMSModel.from_pairwise(
        [[0.8, 0.2], [0.3, 0.7]],
        0.5 * rng.normal(size=(2, 3, 3)),
        noise=noise,
        offset=rng.normal(size=(2, 3)),
        means=rng.normal(size=(2, 3)),
        covariances=noise,
        dim_x=1,
    ).jointly()


@pytest.mark.parametrize("method", METHODS)
def test_three_functions_do_what_a_series_does(system, method):
    found = method.run(system, YS, FOUND, states=True)
    mixture, value = method.first(system.initial(), YS[0])
    for n in range(6):
        if n:
            tables = system.pair_tables(n - 1)
            ahead = method.ahead(tables, mixture)
            np.testing.assert_allclose(found.fields["x_prior"][n], ahead.x, rtol=1e-12)
            np.testing.assert_allclose(found.fields["P_prior"][n], ahead.P, rtol=1e-12)
            assert (ahead.z.shape, ahead.S.shape) == ((2,), (2, 2))
            mixture, value = method.advance(tables, mixture, YS[n], 2)
        x, P = mixture.moments(1)
        np.testing.assert_allclose(found.fields["x"][n], x, rtol=1e-12)
        np.testing.assert_allclose(found.fields["P"][n], P, rtol=1e-12)
        np.testing.assert_allclose(found.fields["mu"][n], mixture.probabilities, rtol=1e-12)
        np.testing.assert_allclose(found.fields["log_likelihood"][n], value, rtol=1e-12, atol=1e-14)
        np.testing.assert_array_equal(found.fields["table"][n], mixture.state_table(1))
        np.testing.assert_array_equal(found.fields["joint"][n], mixture.table)
        assert mixture.is_sound(1, 2, 2, system.order)
        again = Mixture.from_dict(mixture.to_dict())
        np.testing.assert_array_equal(again.table, mixture.table)


@pytest.mark.parametrize("method", METHODS)
def test_what_was_seen_has_variance_zero(system, method):
    table = method.run(system, YS, FOUND, states=True).fields["joint"]
    for n, y in enumerate(YS):
        for node in range(2):
            mean, P = table[n, 1:4, node], table[n, 4:, node].reshape(3, 3)
            seen = ~np.isnan(y)
            np.testing.assert_allclose(mean[1:][seen], y[seen], atol=1e-14)
            assert (np.abs(np.diag(P)[1:][seen]) < 1e-12).all()
            assert (np.diag(P)[1:][~seen] > 0.1).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("skips", [False, True])
def test_a_series_goes_on_from_where_it_stands(system, method, skips):
    whole = method.run(system, np.insert(YS, 3, np.nan, axis=0) if skips else YS, FOUND)
    head = method.run(system, YS[:3], FOUND)
    stand = Stand(3, head.last, skips)
    tail, many = (
        method.run(system, YS[3:], FOUND, stand=stand),
        method.run_many(system, YS[None, 3:], SHOWN, stand=stand),
    )
    for name in FOUND:
        np.testing.assert_array_equal(tail.fields[name], whole.fields[name][-3:])
        np.testing.assert_array_equal(many[name][0], tail.fields[name])
    empty = method.run(system, YS[:0], FOUND)
    assert empty.last is None
    assert empty.fields["x"].shape == (0, 1)


@pytest.mark.parametrize("method", METHODS)
def test_the_smoother_learns_nothing_after_the_last_observation(system, method):
    ys = np.concatenate([YS, np.full((2, 2), np.nan)])
    found = method.run(system, ys, FOUND, states=True)
    smoothed = method.smooth(system, found, ys)
    np.testing.assert_allclose(smoothed.mu[5:], found.fields["mu"][5:], rtol=1e-12)
    x = (smoothed.mu[..., None] * smoothed.x).sum(axis=1)
    np.testing.assert_allclose(x[5:], found.fields["x"][5:], rtol=1e-12)
    short = method.smooth(system, method.run(system, YS, FOUND, states=True), YS)
    np.testing.assert_allclose(smoothed.mu[:6], short.mu, rtol=1e-12)
    np.testing.assert_array_equal(smoothed.path[:6], short.path)
    nothing = method.run(system, ys[:0], FOUND, states=True)
    assert method.smooth(system, nothing, ys[:0]).x.shape == (0, 2, 1)


@pytest.mark.parametrize("method", METHODS)
def test_what_no_number_can_hold_is_said(system, method):
    ys = YS.copy()
    ys[4] = 1e200
    with pytest.raises(NumericalRangeError, match="double precision cannot hold"):
        method.run(system, ys, FOUND)

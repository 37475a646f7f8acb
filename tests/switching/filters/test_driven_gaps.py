"""Gaps and forecasts of models with features: exact where these are linear, by moments where they bend."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate
from scipy.stats import norm

from fuzzykf import CGOMSModel
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.inputs import InputForm

FEATURES = WindowFeatures(order=2, blocks=(2,), products=True)


def model_of(features, By, Bx, inputs=("u",), a=0.5):
    one = np.ones((1, 1, 1, 1))
    form = InputForm(
        Ayy=a * one, Ny=0.2 * one[..., 0], Qyy=0.3 * one, Axx=0.6 * one, H=0.3 * one, G=0.7 * one,
        c=0.1 * one[..., 0], C=0.2 * one, means=[[0.3, -0.2]], covariances=[[[1.0, 0.4], [0.4, 0.8]]],
        By=np.reshape(By, (1, 1, 1, -1)), Bx=np.reshape(Bx, (1, 1, 1, -1)), features=features, inputs=inputs,
    )  # fmt: skip
    return CGOMSModel._from_form([[1.0]], form)


class Joint:
    """All observations and states of a model of one regime as one normal law."""

    def __init__(self, model, us, T) -> None:
        t, form = model.form.table, model.form
        By, Bx = form.By[0, 0, 0], form.Bx[0, 0, 0]
        self.mean, self.root = np.zeros((2, T)), np.zeros((2, T, 2 * T))
        mean, root = self.mean, self.root
        mean[:, 0], root[:, 0, :2] = form.means[0], np.linalg.cholesky(form.covariances[0])
        for n in range(1, T):
            lags = [max(n - lag, 0) for lag in range(1, 5)]
            weights = np.array([0.0, By[1], By[2] / 2, By[2] / 2])
            weights[0] = t.Ayy[0, 0, 0, 0] + By[3] * us[n]
            mean[1, n] = t.Ny[0, 0, 0] + By[0] * us[n] + weights @ mean[1, lags]
            root[1, n] = weights @ root[1, lags]
            root[1, n, 2 * n + 1] += np.sqrt(t.Qyy[0, 0, 0, 0])
            weights = np.array([t.H[0, 0, 0, 0], Bx[1], Bx[2] / 2, Bx[2] / 2])
            gain, A = t.G[0, 0, 0, 0] + Bx[3] * us[n], t.Axx[0, 0, 0, 0]
            mean[0, n] = t.c[0, 0, 0] + Bx[0] * us[n] + weights @ mean[1, lags]
            mean[0, n] += gain * mean[1, n] + A * mean[0, n - 1]
            root[0, n] = weights @ root[1, lags] + gain * root[1, n] + A * root[0, n - 1]
            root[0, n, 2 * n] += np.sqrt(t.C[0, 0, 0, 0])

    def given(self, which, n, ys, seen):
        """Mean and variance of a state (0) or an observation (1) given those that were seen."""
        here, others = self.root[which, n], self.root[1, seen]
        gain = np.linalg.solve(others @ others.T, others @ here)
        mean = self.mean[which, n] + gain @ (ys[seen] - self.mean[1, seen])
        return mean, here @ here - gain @ (others @ here)


def test_lags_blocks_and_products_are_exact_in_gaps_and_ahead() -> None:
    rng = np.random.default_rng(0)
    T = 14
    us, ys = rng.normal(size=T), rng.normal(size=T)
    ys[[4, 5, 6, 9, 12, 13]] = np.nan
    model = model_of(FEATURES, [0.3, -0.4, 0.2, 0.5], [0.2, 0.3, -0.2, 0.6])
    joint, f = Joint(model, us, T), model.filter()
    filtered, smoothed = f.filter(ys, us), f.smooth(ys, us)
    there = np.flatnonzero(np.isfinite(ys))
    for n in range(T):
        before = [k for k in there if k <= n]
        for found, seen, tolerance in ((filtered, before, 1e-11), (smoothed, there, 1e-9)):
            mean, variance = joint.given(0, n, ys, seen)
            assert found.x[n, 0] == pytest.approx(mean, abs=tolerance)
            assert found.P[n, 0, 0] == pytest.approx(variance, abs=tolerance)
        if n:
            mean, variance = joint.given(0, n, ys, [k for k in there if k < n])
            assert filtered.x_prior[n, 0] == pytest.approx(mean, abs=1e-11)
            assert filtered.P_prior[n, 0, 0] == pytest.approx(variance, abs=1e-11)
    f.filter(ys[:9], us[:9])
    ahead = f.forecast(5, us[9:])
    for h in range(5):
        seen = [k for k in there if k < 9]
        for which, mean_of, variance_of in ((0, ahead.x, ahead.P), (1, ahead.z_prior, ahead.S)):
            mean, variance = joint.given(which, 9 + h, ys, seen)
            assert mean_of[h, 0] == pytest.approx(mean, abs=1e-11)
            assert variance_of[h, 0, 0] == pytest.approx(variance, abs=1e-11)


def test_two_steps_ahead_of_an_autoregression_its_variance_is_that_of_the_autoregression() -> None:
    # with y' = .5 y + .4 y2 + e the variance two steps ahead is (1 + .5^2) q, three (1 + .5^2 + .65^2) q
    model = model_of(WindowFeatures(order=2), [0.4], [0.0], inputs=())
    f = model.filter()
    f.filter([0.4, 1.0, -0.3])
    np.testing.assert_allclose(f.forecast(3).S.ravel(), 0.3 * np.array([1.0, 1.25, 1.6725]), rtol=1e-12)


@pytest.mark.parametrize(("mean", "variance"), [(0.2, 0.5), (-1.0, 2.0), (3.0, 0.1), (0.4, 0.0)])
def test_bends_have_the_moments_of_a_normal_observation(mean, variance) -> None:
    knots = [-0.5, 0.3, 1.0]
    features = WindowFeatures(hinges=[knots])
    got = features.linearised(np.array([mean]), np.array([variance]), np.empty(0))
    if variance == 0.0:
        own = features.own(np.array([mean]), np.empty(0))
        np.testing.assert_allclose(got.slope[:, 0] * mean + got.level, own, atol=1e-15)
        np.testing.assert_array_equal(got.left, 0.0)
        return
    law = norm(mean, np.sqrt(variance))

    def moment(g):
        return integrate.quad(
            lambda y: g(y) * law.pdf(y), mean - 12, mean + 12, points=[*knots, mean], limit=200
        )[0]

    for i, one in enumerate(knots):
        value = moment(lambda y, one=one: max(y - one, 0.0))
        slope = moment(lambda y, one=one: max(y - one, 0.0) * (y - mean)) / variance
        assert got.slope[i, 0] == pytest.approx(slope, abs=1e-8)
        assert got.slope[i, 0] * mean + got.level[i] == pytest.approx(value, abs=1e-8)
        for j, other in enumerate(knots):
            both = moment(lambda y, a=one, b=other: max(y - a, 0.0) * max(y - b, 0.0))
            left = both - value * moment(lambda y, b=other: max(y - b, 0.0))
            left -= slope * got.slope[j, 0] * variance
            assert got.left[i, j] == pytest.approx(left, abs=1e-8)


def test_what_bends_in_a_gap_has_mean_and_variance_of_its_law() -> None:
    # x = .6 x1 + .7 y + 2 max(y, 0) + noise, one step ahead, by quadrature over y
    features = WindowFeatures(hinges=[[0.0]])
    model = model_of(features, [0.0], [2.0], inputs=())
    f = model.filter()
    f.filter([0.1])
    x, P = f.x.item(), f.P.item()
    z, S = 0.5 * 0.1 + 0.2, 0.3
    law = norm(z, np.sqrt(S))
    g = [lambda y: 0.7 * y + 2.0 * max(y, 0.0), lambda y: (0.7 * y + 2.0 * max(y, 0.0)) ** 2]
    first, second = (
        integrate.quad(lambda y, h=h: h(y) * law.pdf(y), -8, 8, points=[0.0], limit=200)[0] for h in g
    )
    ahead = f.forecast(1)
    assert ahead.x.item() == pytest.approx(0.6 * x + 0.3 * 0.1 + 0.1 + first, abs=1e-8)
    assert ahead.P.item() == pytest.approx(0.36 * P + 0.2 + second - first**2, abs=1e-8)
    f.predict()
    assert f.x_prior.item() == pytest.approx(ahead.x.item(), abs=1e-12)
    missing = model.filter().filter([0.1, np.nan])
    np.testing.assert_allclose([missing.x[1, 0], missing.P[1, 0, 0]], [ahead.x.item(), ahead.P.item()])


def test_intervals_in_gaps_hold_what_they_claim() -> None:
    rng = np.random.default_rng(1)
    features = WindowFeatures(hinges=[[0.0]], products=True)
    model = model_of(features, [0.1, 0.2, 0.3], [0.0, 2.0, 1.0])
    us = rng.normal(size=4000)
    truth = model.simulate(4000, rng, us=us)
    ys = truth.y[:, 0].copy()
    ys[5::7] = np.nan
    found = model.filter().filter(ys, us)
    error = (found.x - truth.x)[5::7, 0] / np.sqrt(found.P[5::7, 0, 0])
    assert np.mean(np.abs(error) < 1.96) == pytest.approx(0.95, abs=0.03)

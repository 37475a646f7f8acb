"""Properties of learning that hold for all data, found by hypothesis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fuzzykf import CGOFMSModel, CGOMSModel

# an example is learned from twice, for half a second; tests/switching/learning has the plain ones
few = settings(max_examples=4, deadline=None)
fewer = settings(max_examples=2, deadline=None)  # of the slow ones, beside those that are named
seeds = st.integers(0, 10**6)
forms = st.sampled_from(["regression", "covariance"])


def series(n, seed):
    """A state and an observation whose means follow a switch that jumps and slides: x, y, r."""
    rng = np.random.default_rng(seed)
    r = np.clip(np.repeat(rng.uniform(-0.7, 1.7, n // 3 + 1), 3)[:n], 0.0, 1.0)
    gap = rng.uniform(1.0, 4.0, 2) * rng.choice([-1.0, 1.0], 2)
    spread, stay = rng.uniform(0.4, 0.9, 2), rng.uniform(0.2, 0.6, 2)
    z = np.zeros((n, 2))
    for k in range(1, n):
        z[k] = stay * z[k - 1] + (0.6 + spread * r[k]) * rng.normal(size=2)
    z[:, 0] += 0.4 * z[:, 1]
    z += gap * r[:, None]
    return z[:, 0], z[:, 1], r


@st.composite
def fits(draw):
    """A way to learn with a hidden switch: a function of x and y."""
    options = {"form": draw(forms), "n_starts": draw(st.integers(1, 2)), "max_iter": 6}
    if draw(st.booleans()):
        K = draw(st.integers(1, 3))
        return lambda x, y, **more: CGOMSModel.fit(x, y, n_switches=K, **options | more)
    law, nodes = draw(st.sampled_from(["fmc1", "fmc2", "free", "fade"])), draw(st.integers(1, 3))
    return lambda x, y, **more: CGOFMSModel.fit(x, y, law=law, n_nodes=nodes, **options | more)


def parameters(fit):
    """Means and the pairs of moments or coefficients."""
    form = fit.model.form
    return [form.means, form.covariances if form.kind == "covariance" else form.table.Axx]


@few
@given(fits(), seeds)
def test_expectation_maximisation_never_lowers_the_likelihood(fit, seed):
    x, y, _ = series(120, seed)
    found = fit(x, y)
    assert (np.diff(found.trace) >= -1e-8 * (1.0 + np.abs(found.trace[1:]))).all()
    assert len(found.trace) > 1


@fewer
@given(forms, seeds)
@example("covariance", 1113)  # a ridge: after 200 steps with ten corrections, .16 apart
@example("regression", 478038)  # a simplex that collapses on the way to the law, .12 apart
def test_a_mirrored_switch_gives_the_mirrored_model(form, seed):
    x, y, r = series(150, seed)
    one, other = (CGOFMSModel.fit(x, y, s, form=form) for s in (r, 1.0 - r))
    # both are searches, which end where the likelihood is flat but for their tolerance
    assert other.log_likelihood == pytest.approx(one.log_likelihood, abs=1e-3)
    assert other.model.law.p_hard == pytest.approx(one.model.law.p_hard, abs=1e-3)
    for a, b in zip(parameters(one), parameters(other), strict=True):
        mirrored = b[::-1] if b.ndim == 2 else b[::-1, ::-1]
        assert np.abs(a - mirrored).max() < 0.05 * (1.0 + np.abs(a).max())


@few
@given(st.permutations([0, 1, 2]), seeds)
def test_permuted_labels_give_the_permuted_model(order, seed):
    x, y, r = series(200, seed)
    regimes = np.digitize(r, [0.01, 0.99])
    options = {"n_switches": 3, "form": "regression"}
    one = CGOMSModel.fit(x, y, regimes.astype(float), **options)
    other = CGOMSModel.fit(x, y, np.array(order, dtype=float)[regimes], **options)
    at = np.ix_(order, order)
    np.testing.assert_allclose(other.model.transition[at], one.model.transition, rtol=1e-12)
    assert other.log_likelihood == pytest.approx(one.log_likelihood, abs=1e-4)
    np.testing.assert_allclose(other.model.form.means[order], one.model.form.means, atol=1e-6)
    np.testing.assert_array_equal(other.switch_mean, np.array(order)[regimes])


def banded(x, y, **more):
    """Learn with a law that makes some pairs impossible."""
    return CGOFMSModel.fit(x, y, law="fmc2", n_nodes=1, form="covariance", **{"n_starts": 1} | more)


@fewer
@given(fits(), st.integers(-30, 30), st.integers(-30, 30), seeds)
@example(banded, 0, 28, 0)
def test_units_change_the_parameters_and_nothing_else(fit, size_x, size_y, seed):
    # factors of two make no rounding, so that even a search ends at the same place
    x, y, _ = series(100, seed)
    a, c = 2.0**size_x, 2.0**size_y
    one, other = fit(x, y, max_iter=2), fit(a * x, c * y, max_iter=2)
    np.testing.assert_array_equal(other.trace, one.trace)
    np.testing.assert_array_equal(other.switch_mean, one.switch_mean)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - len(x) * np.log(a * c), rel=1e-10)
    np.testing.assert_allclose(other.model.form.means, one.model.form.means * [a, c], rtol=1e-12)
    size = np.array([a, c, a, c])
    if one.model.form.kind == "covariance":
        expected = one.model.form.covariances * size[:, None] * size
        np.testing.assert_allclose(other.model.form.covariances, expected, rtol=1e-12)
    else:
        t, s = other.model.form.table, one.model.form.table
        np.testing.assert_allclose(t.Axx, s.Axx, rtol=1e-12)
        np.testing.assert_allclose(t.G, s.G * a / c, rtol=1e-12)
        np.testing.assert_allclose(t.C, s.C * a * a, rtol=1e-12)
        np.testing.assert_allclose(t.Qyy, s.Qyy * c * c, rtol=1e-12)


@fewer
@given(forms, st.floats(0.001, 1000), st.floats(0.001, 1000), st.floats(-100, 100), seeds)
def test_origin_and_units_with_a_known_switch(form, a, c, shift, seed):
    x, y, r = series(150, seed)
    one = CGOFMSModel.fit(x, y, r, form=form)
    other = CGOFMSModel.fit(a * (x + shift), c * (y - shift), r, form=form)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - len(x) * np.log(a * c), abs=1e-3)
    expected = one.model.form.means + np.array([shift, -shift])
    np.testing.assert_allclose(other.model.form.means / [a, c], expected, atol=0.02)


@few
@given(fits(), st.integers(15, 60), st.integers(1, 8), seeds)
def test_a_hole_cuts_a_series_in_two(fit, at, length, seed):
    x, y, _ = series(100, seed)
    holes = slice(at, at + length)
    with_hole = y.copy()  # a hole in x does not cut: y goes on
    with_hole[holes] = np.nan
    one = fit(x, with_hole, max_iter=3)
    parts = [slice(0, at), slice(at + length, None)]
    two = fit([x[p] for p in parts], [y[p] for p in parts], max_iter=3)
    assert two.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-9)
    for a, b in zip(parameters(one), parameters(two), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-9)
    assert np.isnan(one.switch_mean[holes]).all()
    np.testing.assert_allclose(np.delete(one.switch_mean, np.r_[holes]), two.switch_mean, atol=1e-9)

"""The smoother as users meet it; that it is right is shown in tests/exactness/test_smoother.py."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOMSMFilter, KnownSwitchFilter, OFSRFilter
from fuzzykf.errors import ParameterError, ShapeError


@pytest.fixture(params=["fuzzy", "hard"])
def f(request, fuzzy_model, hard_model):
    return OFSRFilter(fuzzy_model, 3) if request.param == "fuzzy" else CGOMSMFilter(hard_model)


@pytest.fixture
def ys(f):
    return f.model.simulate(30, np.random.default_rng(0)).y


def test_the_last_state_is_filtered(f, ys):
    filtered, smoothed = f.filter(ys), f.smooth(ys)
    for name in ("x", "P", "mu", "switch_mean"):
        last, expected = getattr(smoothed, name)[-1], getattr(filtered, name)[-1]
        np.testing.assert_allclose(last, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(smoothed.log_likelihood, filtered.log_likelihood, rtol=1e-12, atol=1e-14)
    assert np.abs(smoothed.x[:-1] - filtered.x[:-1]).max() > 1e-3


def test_estimates_of_the_switch(f, ys):
    result = f.smooth(ys)
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(result.nodes, f.nodes)
    np.testing.assert_allclose(result.switch_mean, result.mu @ f.nodes, rtol=1e-12)
    assert np.isin(result.switch, f.nodes).all()
    assert np.isin(result.switch_path, f.nodes).all()
    transition = f._system.chain.transition
    index = np.searchsorted(f.nodes, result.switch_path)
    assert (transition[index[:-1], index[1:]] > 0.0).all()


def test_the_filter_stays_at_the_last_observation(f, ys):
    f.smooth(ys[:20])
    g = type(f)(f.model, **f._options())
    g.filter(ys[:20])
    np.testing.assert_array_equal(f.step(ys[20]), g.step(ys[20]))


def test_moments_given_the_nodes_are_kept_on_request(f, ys):
    assert f.smooth(ys).node_x is None
    result = f.smooth(ys, keep_nodes=True)
    m, M = f.dim_x, f.nodes.size
    assert result.node_x.shape == (30, M, m)
    assert result.node_P.shape == (30, M, m, m)
    np.testing.assert_allclose(np.einsum("nk,nkx->nx", result.mu, result.node_x), result.x, rtol=1e-11)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_short_series(f, ys, n):
    result = f.smooth(ys[:n])
    assert result.x.shape == (n, f.dim_x)
    assert result.switch_path.shape == (n,)
    f.step(ys[n])


def test_pandas_keeps_its_index(fuzzy_model):
    y = fuzzy_model.simulate(20, np.random.default_rng(1)).y[:, 0]
    index = pd.date_range("2024-01-01", periods=20, freq="h")
    series = pd.Series(y, index=index)
    result = OFSRFilter(fuzzy_model, 2).smooth(series)
    pd.testing.assert_index_equal(result.to_dataframe().index, index)
    np.testing.assert_array_equal(result.x, OFSRFilter(fuzzy_model, 2).smooth(y).x)


def test_only_gaps_and_their_neighbours_depend_on_them(fuzzy_model):
    # far from a hole, the estimate is that without one
    y = fuzzy_model.simulate(120, np.random.default_rng(2)).y
    gappy = y.copy()
    gappy[60] = np.nan
    f = OFSRFilter(fuzzy_model, 3)
    a, b = f.smooth(y), f.smooth(gappy)
    difference = np.abs(a.x - b.x)[:, 0]
    assert difference[:45].max() < 1e-9
    assert difference[80:].max() < 1e-5
    assert difference[60] > 1e-4
    # neither does a hole at the end change the past
    c = f.smooth(np.concatenate([y, np.full((5, 1), np.nan)]))
    np.testing.assert_allclose(c.x[:120], a.x, rtol=1e-12)


@pytest.mark.parametrize(("zs", "error"), [([1.0, np.inf], ParameterError), (np.zeros((3, 2)), ShapeError)])
def test_refused_series_leave_the_filter_as_it_was(fuzzy_model, zs, error):
    f = OFSRFilter(fuzzy_model, 2)
    f.step(1.0)
    before = f._export_state()
    with pytest.raises(error):
        f.smooth(zs)
    assert f._export_state() == before


def test_known_switches_have_to_match(fuzzy_model):
    with pytest.raises(ShapeError, match="r: "):
        KnownSwitchFilter(fuzzy_model).smooth([1.0, 2.0], [0.5])


def test_it_beats_the_filter_on_the_setting_of_figure_5(fuzzy_model):
    # FMC1 (.07, .05, .16) and the matrices of the paper, N = 300, 50 runs; 30 such experiments
    # gave ratios of mean squared errors from .981 to .987, and at least 35 runs won
    f = OFSRFilter(fuzzy_model, 5)
    rng = np.random.default_rng(3)
    filtered = smoothed = 0.0
    wins = 0
    for _ in range(50):
        sim = fuzzy_model.simulate(300, rng)
        a = np.mean((f.filter(sim.y).x - sim.x) ** 2)
        b = np.mean((f.smooth(sim.y).x - sim.x) ** 2)
        filtered, smoothed, wins = filtered + a, smoothed + b, wins + (b < a)
    assert smoothed < 0.99 * filtered
    assert wins > 30


def test_beyond_the_filter_the_smoother_is_calibrated(fuzzy_model):
    # its own covariance tells its error: mean of the squared error by the variance is one
    sim = fuzzy_model.simulate(6000, np.random.default_rng(4))
    result = OFSRFilter(fuzzy_model, 5).smooth(sim.y)
    ratio = np.mean((result.x - sim.x)[:, 0] ** 2 / result.P[:, 0, 0])
    assert ratio == pytest.approx(1.0, abs=0.06)
    assert (result.P[:, 0, 0]).mean() < OFSRFilter(fuzzy_model, 5).filter(sim.y).P[:, 0, 0].mean()

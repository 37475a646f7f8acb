"""Intervals from the mixture of node moments, beside the true posterior by enumeration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FilterResult, KnownSwitchFilter, OFSRFilter
from fuzzykf.errors import ParameterError


def quantile(weights, means, stds, level):
    """Of a mixture of scalar normal laws, by root finding."""
    low, high = (means - 12 * stds).min(), (means + 12 * stds).max()
    return brentq(lambda v: weights @ ndtr((v - means) / stds) - level, low, high, xtol=1e-13)


@pytest.mark.parametrize("level", [0.1, 0.5, 0.9, 0.99])
def test_ends_are_quantiles_of_the_mixture(level, fuzzy_model):
    ys = fuzzy_model.simulate(40, np.random.default_rng(0)).y
    for result in (
        OFSRFilter(fuzzy_model, 3).filter(ys, keep_nodes=True),
        OFSRFilter(fuzzy_model, 3).smooth(ys, keep_nodes=True),
    ):
        lower, upper = result.interval(level)
        assert lower.shape == upper.shape == result.x.shape
        for n in range(40):
            args = result.mu[n], result.node_x[n, :, 0], np.sqrt(result.node_P[n, :, 0, 0])
            assert lower[n, 0] == pytest.approx(quantile(*args, 0.5 - level / 2), abs=1e-10)
            assert upper[n, 0] == pytest.approx(quantile(*args, 0.5 + level / 2), abs=1e-10)


def test_every_component_of_a_vector_has_its_own(hard_model):
    ys = hard_model.simulate(20, np.random.default_rng(1)).y
    result = CGOMSMFilter(hard_model).filter(ys, keep_nodes=True)
    lower, upper = result.interval(0.8)
    for k in range(2):
        args = result.mu[7], result.node_x[7, :, k], np.sqrt(result.node_P[7, :, k, k])
        assert lower[7, k] == pytest.approx(quantile(*args, 0.1), abs=1e-10)
        assert upper[7, k] == pytest.approx(quantile(*args, 0.9), abs=1e-10)


def test_without_nodes_one_normal_law_stands_for_all(fuzzy_model):
    ys = fuzzy_model.simulate(20, np.random.default_rng(2)).y
    f = OFSRFilter(fuzzy_model, 3)
    plain, kept = f.filter(ys), f.filter(ys, keep_nodes=True)
    half = ndtri(0.95) * np.sqrt(plain.P[:, 0])
    lower, upper = plain.interval(0.9)
    np.testing.assert_allclose(lower, plain.x - half, rtol=1e-12)
    np.testing.assert_allclose(upper, plain.x + half, rtol=1e-12)
    assert plain.node_x is None
    assert plain.node_P is None
    # the moments of the mixture are those of the result, and its interval is another
    mean = np.einsum("nk,nkx->nx", kept.mu, kept.node_x)
    np.testing.assert_allclose(mean, kept.x, rtol=1e-12)
    off = kept.node_x - kept.x[:, None]
    spread = kept.node_P[..., 0, 0] + off[..., 0] ** 2
    np.testing.assert_allclose((kept.mu * spread).sum(axis=1), kept.P[:, 0, 0], rtol=1e-12)
    assert np.abs(kept.interval(0.9)[0] - lower).max() > 1e-3


def test_one_class_has_one_normal_law(fuzzy_model):
    # a known switch, and a single regime: mixture and summary are the same
    sim = fuzzy_model.simulate(20, np.random.default_rng(3))
    known = KnownSwitchFilter(fuzzy_model)
    kept = known.filter(sim.y, sim.r, keep_nodes=True)
    np.testing.assert_allclose(kept.interval(0.9), known.filter(sim.y, sim.r).interval(0.9), rtol=1e-9)
    assert kept.node_x.shape == (20, 1, 1)


def test_wide_and_lopsided_mixtures():
    # an unlikely node far away moves no end that it cannot reach, and decides those that it can
    nodes_x = np.array([[[0.0], [1e6]]])
    result = FilterResult(
        x=np.array([[1e4]]),
        P=np.array([[[1e10]]]),
        mu=np.array([[0.99, 0.01]]),
        node_x=nodes_x,
        node_P=np.ones((1, 2, 1, 1)),
    )
    lower, upper = result.interval(0.9)
    assert lower[0, 0] == pytest.approx(ndtri(0.05 / 0.99), abs=1e-9)
    assert upper[0, 0] == pytest.approx(ndtri(0.95 / 0.99), abs=1e-9)
    lower, upper = result.interval(0.995)
    assert upper[0, 0] == pytest.approx(1e6 + ndtri(1 - 0.0025 / 0.01), abs=1e-6)


def test_a_state_that_is_known_has_no_width():
    result = FilterResult(
        x=np.zeros((1, 1)),
        P=np.zeros((1, 1, 1)),
        mu=np.ones((1, 1)),
        node_x=np.zeros((1, 1, 1)),
        node_P=np.zeros((1, 1, 1, 1)),
    )
    np.testing.assert_allclose(result.interval(0.9), 0.0, atol=1e-12)


def test_a_node_without_probability_does_not_count(fuzzy_model):
    ys = fuzzy_model.simulate(12, np.random.default_rng(4)).y
    ys[5] = 400.0  # most nodes become impossible
    result = OFSRFilter(fuzzy_model, 3).filter(ys, keep_nodes=True)
    lower, upper = result.interval(0.9)
    assert np.isfinite(lower).all()
    assert np.isfinite(upper).all()
    assert (upper > lower).all()
    args = result.mu[5], result.node_x[5, :, 0], np.sqrt(result.node_P[5, :, 0, 0])
    assert lower[5, 0] == pytest.approx(quantile(*args, 0.05), abs=1e-7)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, 90.0, np.nan])
def test_levels_have_to_lie_between_0_and_1(level, fuzzy_model):
    result = OFSRFilter(fuzzy_model, 1).filter([1.0])
    with pytest.raises(ParameterError, match="level"):
        result.interval(level)


def test_a_result_without_moments_has_no_interval():
    with pytest.raises(ParameterError, match="interval"):
        FilterResult(x=np.zeros((1, 1))).interval()


# --------------------------------------------------------------------------- the true posterior


def true_coverage(result, truth, level):
    """Probability that the true posterior gives to the interval of the last state."""
    lower, upper = result.interval(level)
    n = len(lower) - 1
    return truth.mass_below(n, upper[n, 0]) - truth.mass_below(n, lower[n, 0])


def paper_model(fuzzy_model):
    return fuzzy_model, OFSRFilter(fuzzy_model, 0), fuzzy_model.on_nodes(0)


def two_humped_model():
    """A state that remembers earlier regimes, of which the present one tells nothing, with little noise."""
    old = np.array([[[-1.0], [-1.0]], [[1.0], [1.0]]])
    new = np.array([[[-0.5], [0.5]], [[-0.5], [0.5]]])
    model = CGOMSModel.from_regressions(
        [[0.5, 0.5], [0.5, 0.5]],
        Ayy=np.full((2, 2, 1, 1), 0.3),
        Ny=new,
        Qyy=np.ones((2, 2, 1, 1)),
        Axx=np.full((2, 2, 1, 1), 0.5),
        H=np.zeros((2, 2, 1, 1)),
        G=np.full((2, 2, 1, 1), 0.2),
        c=old,
        C=np.full((2, 2, 1, 1), 0.1),
        means=np.zeros((2, 2)),
        covariances=np.stack([np.eye(2)] * 2),
    )
    return model, CGOMSMFilter(model), model.on_nodes()


#: What the true posterior gives to nominal 90 % intervals of the last state, over 20 series of 9.
@pytest.mark.parametrize(
    ("make", "low", "high"),
    [
        ("paper", 0.885, 0.915),  # measured: .892 to .908
        ("two humps", 0.885, 0.965),  # measured: .896 to .951, .918 on average
    ],
)
def test_coverage_under_the_true_posterior(make, low, high, fuzzy_model, enumerate_paths):
    model, f, system = paper_model(fuzzy_model) if make == "paper" else two_humped_model()
    found = []
    for seed in range(20):
        ys = model.simulate(9, np.random.default_rng(seed)).y
        result = f.filter(ys, keep_nodes=True)
        found.append(true_coverage(result, enumerate_paths(system, ys), 0.9))
    assert low < min(found), (min(found), max(found))
    assert max(found) < high, (min(found), max(found))
    assert np.ptp(found) > 1e-4  # an approximation, not rounding


def test_coverage_of_the_first_state_is_exact(fuzzy_model, enumerate_paths):
    # given the first node X_1 is normal, so that nothing is matched
    _, f, system = paper_model(fuzzy_model)
    for seed in range(5):
        ys = fuzzy_model.simulate(1, np.random.default_rng(seed)).y
        result = f.filter(ys, keep_nodes=True)
        assert true_coverage(result, enumerate_paths(system, ys), 0.9) == pytest.approx(0.9, abs=1e-9)


def test_coverage_on_simulated_data(fuzzy_model):
    # 4,000 states: binomial standard error .005
    sim = fuzzy_model.simulate(4000, np.random.default_rng(7))
    for result in (
        OFSRFilter(fuzzy_model, 5).filter(sim.y, keep_nodes=True),
        OFSRFilter(fuzzy_model, 5).smooth(sim.y, keep_nodes=True),
    ):
        lower, upper = result.interval(0.9)
        inside = ((lower <= sim.x) & (sim.x <= upper)).mean()
        assert inside == pytest.approx(0.9, abs=0.015)


def test_keeping_nodes_changes_nothing_else(fuzzy_model):
    model = CGOFMSModel(fuzzy_model.law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    ys = model.simulate(20, np.random.default_rng(8)).y
    for verb in ("filter", "smooth"):
        a = getattr(OFSRFilter(model, 2), verb)(ys)
        b = getattr(OFSRFilter(model, 2), verb)(ys, keep_nodes=True)
        for name in ("x", "P", "mu", "switch_mean", "log_likelihood"):
            # kept moments are summed in another order, hence the last digit
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, atol=1e-14)

"""Properties of the switching filters that hold for every model, found by hypothesis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter, SwitchChain
from fuzzykf.errors import ParameterError

pytestmark = pytest.mark.filterwarnings("error")

few = settings(max_examples=12, deadline=None)
RULES = ("cell", "midpoint", "gauss", "product")
RESULTS = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")


@st.composite
def laws(draw):
    """FMC1 and FMC2 with any admissible parameters, the bounds among them."""
    if draw(st.booleans()):
        # 2.5 (delta + eta) - (delta - eta)/6 = 7/3 delta + 8/3 eta <= 1
        mass, share = draw(st.floats(0, 1)), draw(st.floats(0, 1))
        delta, eta = mass * share * 3 / 7, mass * (1 - share) * 3 / 8
        alpha = draw(st.floats(0, 1)) * (1 - mass) / 2
        return FuzzyMarkovLaw.fmc1(alpha, delta, eta)
    delta, mass = draw(st.floats(0.05, 0.45)), draw(st.floats(0, 1))
    alpha = draw(st.floats(0, 1)) * (1 - mass) / 2
    return FuzzyMarkovLaw.fmc2(alpha, mass / (delta * (6 - delta)), delta)


def placeable(law, n_nodes, rule):
    """Return the rule, or the one for all laws where nodes would lie further apart than the band of this."""
    try:
        law.discretize(n_nodes, rule)
    except ParameterError as error:
        return "cell" if "the band of the law is only" in str(error) else rule
    return rule


sizes = st.tuples(st.integers(1, 2), st.integers(1, 2))
seeds = st.integers(0, 10**6)


def covariances_of(K, m, q, seed):
    """Means and covariances of (Z_1, Z_2) for K regimes, from weak random dynamics."""
    rng = np.random.default_rng(seed)
    d = m + q
    # singular values of the roots from .68 to 1.32 and of A below .41: the noise is definite
    root = rng.uniform(-0.08, 0.08, (K, d, d)) + np.eye(d)
    S = root @ np.swapaxes(root, -1, -2)
    A = rng.uniform(-0.04, 0.04, (K, K, d, d))
    A[..., range(d), range(d)] += 0.25 * rng.choice([-1.0, 1.0], (K, K, d))
    A[..., m:, :m] = 0.0
    gamma = np.empty((K, K, 2 * d, 2 * d))
    for i in range(K):
        for j in range(K):
            cross = A[i, j] @ S[i]
            gamma[i, j] = np.block([[S[i], cross.T], [cross, S[j]]])
    return rng.normal(size=(K, d)), gamma


def observations(q, n, seed):
    return np.random.default_rng(seed + 1).normal(scale=2.0, size=(n, q))


def assert_same(a, b, names=RESULTS, rtol=1e-9, atol=1e-10):
    for name in names:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=rtol, atol=atol, err_msg=name)


@few
@given(laws(), sizes, seeds, st.integers(1, 6), st.sampled_from(RULES[:3]))
def test_probabilities_and_covariances(law, size, seed, n_nodes, rule):
    m, q = size
    rule = placeable(law, n_nodes, rule)
    f = OFSRFilter(CGOFMSModel(law, *covariances_of(2, m, q, seed), m), n_nodes, rule)
    result = f.filter(observations(q, 12, seed))
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-12)
    assert (result.mu >= 0.0).all()
    for P in (result.P, result.P_prior):
        np.testing.assert_array_equal(P, np.swapaxes(P, 1, 2))
        assert (np.linalg.eigvalsh(P) > 0.0).all()
    assert (result.switch_mean >= 0.0).all()
    assert (result.switch_mean <= 1.0).all()
    assert np.isin(result.switch, f.nodes).all()


@few
@given(laws(), sizes, seeds, st.integers(0, 6), st.sampled_from(RULES[:3]))
def test_exchanging_the_regimes_mirrors_the_result(law, size, seed, n_nodes, rule):
    # the laws FMC1 and FMC2 depend on |r1 - r2|: with the regimes exchanged, r becomes 1 - r
    m, q = size
    means, gamma = covariances_of(2, m, q, seed)
    y = observations(q, 10, seed)
    rule = placeable(law, n_nodes, rule)
    one = OFSRFilter(CGOFMSModel(law, means, gamma, m), n_nodes, rule).filter(y)
    other = OFSRFilter(CGOFMSModel(law, means[::-1], gamma[::-1, ::-1], m), n_nodes, rule).filter(y)
    assert_same(one, other, ("x", "P", "x_prior", "P_prior", "log_likelihood"))
    np.testing.assert_allclose(one.mu, other.mu[:, ::-1], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(one.switch_mean, 1.0 - other.switch_mean, atol=1e-9)


@few
@given(sizes, seeds, st.permutations(range(3)))
def test_permuting_hard_regimes_permutes_the_result(size, seed, order):
    m, q = size
    means, gamma = covariances_of(3, m, q, seed)
    P = np.random.default_rng(seed).dirichlet(np.ones(3), 3)
    y, order = observations(q, 10, seed), np.array(order)
    one = CGOMSMFilter(CGOMSModel(P, means, gamma, m)).filter(y)
    pairs = np.ix_(order, order)
    other = CGOMSMFilter(CGOMSModel(P[pairs], means[order], gamma[pairs], m)).filter(y)
    assert_same(one, other, ("x", "P", "x_prior", "P_prior", "log_likelihood"))
    np.testing.assert_allclose(one.mu[:, order], other.mu, rtol=1e-8, atol=1e-12)


@few
@given(laws(), sizes, seeds, st.floats(-6, 6), st.floats(-6, 6), st.floats(-9, 9), st.sampled_from(RULES[:3]))
def test_units_scale_the_result(law, size, seed, log_x, log_y, shift, rule):
    # x in units of 10^log_x and shifted, y in units of 10^log_y
    m, q = size
    means, gamma = covariances_of(2, m, q, seed)
    y = observations(q, 10, seed)
    scale_x, scale_y = 10.0**log_x, 10.0**log_y
    D = np.r_[np.full(m, scale_x), np.full(q, scale_y)]
    D2 = np.tile(D, 2)
    offset = np.r_[np.full(m, shift * scale_x), np.full(q, 3.0 * scale_y)]
    a = OFSRFilter(CGOFMSModel(law, means, gamma, m), 3, placeable(law, 3, rule)).filter(y)
    scaled = CGOFMSModel(law, means * D + offset, gamma * D2[:, None] * D2, m)
    b = OFSRFilter(scaled, 3, placeable(law, 3, rule)).filter(y * scale_y + 3.0 * scale_y)
    np.testing.assert_allclose(b.mu, a.mu, rtol=1e-6, atol=1e-9)
    for x, P, name in ((b.x, b.P, ""), (b.x_prior, b.P_prior, "_prior")):
        back = x / scale_x - shift
        np.testing.assert_allclose(back, getattr(a, "x" + name), rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(P / scale_x**2, getattr(a, "P" + name), rtol=1e-7, atol=1e-8)
    jacobian = q * np.log(scale_y)
    np.testing.assert_allclose(b.log_likelihood + jacobian, a.log_likelihood, rtol=1e-7, atol=1e-7)


@few
@given(st.floats(0.0, 0.5), sizes, seeds, st.integers(0, 8), st.sampled_from(RULES))
def test_no_fuzziness_is_the_hard_filter(alpha, size, seed, n_nodes, rule):
    # eta = delta = 0: nodes in between have no mass, whatever the rule
    m, q = size
    model = CGOFMSModel(FuzzyMarkovLaw.fmc1(alpha, 0.0, 0.0), *covariances_of(2, m, q, seed), m)
    y = observations(q, 12, seed)
    fuzzy = OFSRFilter(model, n_nodes, rule).filter(y)
    hard = CGOMSMFilter(model.harden()).filter(y)
    assert_same(fuzzy, hard, ("x", "P", "x_prior", "P_prior", "switch", "switch_mean", "log_likelihood"))
    np.testing.assert_allclose(fuzzy.mu[:, [0, -1]], hard.mu, rtol=1e-9, atol=1e-12)
    assert (fuzzy.mu[:, 1:-1] == 0.0).all()


@few
@given(laws().filter(lambda law: law.corners.sum() > 1e-3), seeds, st.sampled_from(RULES))
@example(
    FuzzyMarkovLaw.fmc2(0.25, 8 / 23, 0.25), 0, "midpoint"
)  # no node is too far from one that is not there
def test_no_nodes_between_is_the_chain_of_the_corners(law, seed, rule):
    model = CGOFMSModel(law, *covariances_of(2, 1, 1, seed), 1)
    y = observations(1, 8, seed)
    joint = law.corners / law.corners.sum()
    chain = CGOMSModel._from_form(joint / joint.sum(axis=1)[:, None], model.form, joint.sum(axis=1))
    assert_same(OFSRFilter(model, 0, rule).filter(y), CGOMSMFilter(chain).filter(y))


@few
@given(laws(), sizes, seeds, st.integers(1, 16), st.sampled_from(RULES[:3]), st.integers(0, 9))
def test_step_is_predict_and_update_is_filter(law, size, seed, n_nodes, rule, start):
    m, q = size
    model = CGOFMSModel(law, *covariances_of(2, m, q, seed), m)
    y = observations(q, 10, seed)
    rule = placeable(law, n_nodes, rule)
    f, g, h = (OFSRFilter(model, n_nodes, rule) for _ in range(3))
    result = f.filter(y)
    for k, z in enumerate(y):
        estimate = g.step(z)
        h.predict()
        prior = h.x, h.P
        h.update(z)
        np.testing.assert_array_equal(estimate, g.x)
        np.testing.assert_allclose(prior[0][:, 0], result.x_prior[k], rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(prior[1], result.P_prior[k], rtol=1e-10, atol=1e-11)
        for one in (g, h):
            np.testing.assert_allclose(one.x[:, 0], result.x[k], rtol=1e-10, atol=1e-11)
            np.testing.assert_allclose(one.P, result.P[k], rtol=1e-10, atol=1e-11)
            np.testing.assert_allclose(one.mu, result.mu[k], rtol=1e-9, atol=1e-13)
            assert one.log_likelihood == pytest.approx(result.log_likelihood[k], rel=1e-10, abs=1e-11)
            assert one.switch_mean == pytest.approx(result.switch_mean[k], rel=1e-10, abs=1e-12)
    # filter, then step: it continues from the last observation
    f.filter(y[:start])
    for k in range(start, 10):
        np.testing.assert_allclose(f.step(y[k])[:, 0], result.x[k], rtol=1e-10, atol=1e-11)


@few
@given(laws(), sizes, seeds)
def test_batch_filter_is_filter(law, size, seed):
    m, q = size
    f = OFSRFilter(CGOFMSModel(law, *covariances_of(2, m, q, seed), m), 3)
    y = observations(q, 7, seed)
    result = f.filter(y)
    means, covariances, means_p, covariances_p = f.batch_filter(y)
    assert means.shape == means_p.shape == (7, m, 1)
    np.testing.assert_array_equal(means[..., 0], result.x)
    np.testing.assert_array_equal(covariances, result.P)
    np.testing.assert_array_equal(means_p[..., 0], result.x_prior)
    np.testing.assert_array_equal(covariances_p, result.P_prior)


@few
@given(laws(), sizes, seeds, st.floats(0, 6), st.integers(0, 9), st.sampled_from(RULES[:3]), st.booleans())
def test_outliers_stay_finite(law, size, seed, magnitude, where, rule, upwards):
    # an observation up to 1e6 standard deviations off, anywhere in the series
    m, q = size
    f = OFSRFilter(CGOFMSModel(law, *covariances_of(2, m, q, seed), m), 4, placeable(law, 4, rule))
    y = observations(q, 10, seed)
    y[where] = (1.0 if upwards else -1.0) * 10.0**magnitude
    result = f.filter(y)
    for name in RESULTS:
        assert np.isfinite(getattr(result, name)).all(), name
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-9)
    assert (np.linalg.eigvalsh(result.P) > 0.0).all()
    f.reset()
    for k, z in enumerate(y):
        f.step(z)
        np.testing.assert_allclose(f.x[:, 0], result.x[k], rtol=1e-8, atol=1e-8)
        assert f.log_likelihood == pytest.approx(result.log_likelihood[k], rel=1e-9, abs=1e-9)


@few
@given(laws(), st.integers(0, 7), st.sampled_from(RULES[:3]))
def test_chains_are_stationary_and_symmetric(law, n_nodes, rule):
    # J_ij = J_ji: the chain is reversible, as the law is
    if n_nodes == 0 and not law.corners.any():
        return
    chain = law.discretize(n_nodes, placeable(law, n_nodes, rule))
    assert isinstance(chain, SwitchChain)
    joint = chain.initial[:, None] * chain.transition
    np.testing.assert_allclose(joint, joint.T, atol=1e-14)
    np.testing.assert_allclose(joint.sum(), 1.0, rtol=1e-12)
    np.testing.assert_allclose(chain.initial @ chain.transition, chain.initial, atol=1e-13)
    np.testing.assert_allclose(chain.weights[1:-1].sum(), float(n_nodes > 0), rtol=1e-12)

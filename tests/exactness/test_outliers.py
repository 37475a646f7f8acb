"""Weights keep their digits, however far an observation is off: ties stay ties, probabilities sum to one.

The reference is the recursion in decimal numbers of 80 digits.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FuzzyMarkovLaw,
    IMMEstimator,
    KalmanFilter,
    OFSRFilter,
)
from fuzzykf.engine import info
from fuzzykf.engine import selected as engine
from fuzzykf.engine.numpy import tables
from fuzzykf.errors import NumericalRangeError

FAR = [1e3, 1e4, 1e6, 1e8, 1e10, 1e100, 1e150]


def equal_regimes(k: int, transition) -> CGOMSMFilter:
    """A filter of k regimes that do not differ."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    model = CGOMSModel(transition, np.zeros((k, 2)), np.broadcast_to(pair, (k, k, 4, 4)), 1)
    return CGOMSMFilter(model)


def assert_alike(one, two) -> None:
    for name in ("x", "P", "log_likelihood"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), rtol=1e-12, err_msg=name)


@pytest.mark.parametrize("far", FAR)
def test_two_equal_regimes_are_one_filter(far) -> None:
    one, two = equal_regimes(1, [[1.0]]), equal_regimes(2, [[0.5, 0.5], [0.5, 0.5]])
    zs = [0.1, 0.2, -far, 0.3, 0.1]
    a, b = one.filter(zs), two.filter(zs)
    assert_alike(a, b)
    np.testing.assert_allclose(b.mu, 0.5, rtol=1e-12)
    np.testing.assert_allclose(two.smooth(zs).mu, 0.5, rtol=1e-12)
    many = two.filter_many([zs, zs[::-1]], keep=("x", "P", "log_likelihood", "mu"))
    assert_alike(a, type(a)(x=many.x[0], P=many.P[0], log_likelihood=many.log_likelihood[0]))
    np.testing.assert_allclose(many.mu, 0.5, rtol=1e-12)
    one.reset()
    two.reset()
    for z in zs:
        one.step(z)
        two.step(z)
        if far <= 1e10 or info().name == "compiled":  # beyond, rows of one product differ by their rounding
            np.testing.assert_allclose(two.P, one.P, rtol=1e-12)
        np.testing.assert_allclose(two.mu, 0.5, rtol=1e-12)


@pytest.mark.parametrize("far", FAR)
def test_the_memory_of_the_switch_outlives_an_outlier(far) -> None:
    # observations say nothing about regimes that do not differ: the switch moves by its own law
    f = equal_regimes(2, [[0.99, 0.01], [0.3, 0.7]])
    result = f.filter([0.1, 0.2, far, 0.1])
    stationary = np.array([0.3, 0.01]) / 0.31
    np.testing.assert_allclose(result.mu, np.broadcast_to(stationary, (4, 2)), rtol=1e-12)


@pytest.mark.parametrize("far", FAR)
def test_a_bank_of_equal_filters_keeps_its_weights(far) -> None:
    def kalman():
        f = KalmanFilter(2, 1)
        f.F, f.H, f.Q, f.R = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]]), 0.1 * np.eye(2), 1.0
        return f

    transition = np.array([[0.9, 0.1], [0.4, 0.6]])
    for kind in ("imm", "gpb2"):
        f = IMMEstimator([kalman(), kalman()], [0.8, 0.2], transition, method=kind)
        result = f.filter([0.1, far, 0.3])
        np.testing.assert_allclose(result.mu, np.broadcast_to([0.8, 0.2], (3, 2)), rtol=1e-12, err_msg=kind)


# --------------------------------------------------------------------------- in decimal numbers


def exact_step(rows, small, u):
    """Log-weights (M1, M2) in decimal numbers: probabilities of j, o_ij, and the log of the total."""
    q, M1, M2, n = rows.shape
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = 400, -(10**9), 10**9
        U = [Decimal(float(a)) for a in u]
        log_w = {}
        for i in range(M1):
            for j in range(M2):
                if small[i, j] < tables.DEAD:
                    continue
                log_w[i, j] = Decimal(float(small[i, j]))
                for r in range(q):
                    z = sum(Decimal(float(rows[r, i, j, t])) * U[t] for t in range(n))
                    log_w[i, j] -= z * z
        top = max(log_w.values())
        context.prec = 60
        w = {
            key: (value - top).exp() if value - top > -100000 else Decimal(0) for key, value in log_w.items()
        }
        column = [sum(value for (_, b), value in w.items() if b == j) for j in range(M2)]
        total = sum(column)
        o = np.zeros((M1, M2))
        for j in range(M2):
            tops = max(value for (_, b), value in log_w.items() if b == j)
            shares = {
                a: (value - tops).exp() if value - tops > -100000 else Decimal(0)
                for (a, b), value in log_w.items()
                if b == j
            }
            for a, share in shares.items():
                o[a, j] = float(share / sum(shares.values()))
        return np.array([float(c / total) for c in column]), o, float(top + total.ln())


@pytest.mark.parametrize("kind", ["ties", "near means", "by column", "random", "impossible", "hidden"])
@pytest.mark.parametrize("deviations", [1.0, 1e2, 1e4, 1e6, 1e8, 1e12, 1e30, 1e75])
@pytest.mark.parametrize("q", [1, 2])
def test_weights_are_those_of_decimal_numbers(kind, deviations, q) -> None:
    rng = np.random.default_rng(5)
    M, n = 3, 1 + 2 * q
    rows = np.zeros((q, M, M, n))
    rows[:, :, :, 1 + q :] = np.eye(q)[:, None, None]  # z = y' - mean, of unit noise
    if kind == "near means":
        rows[..., 0] += 1e-3 * rng.normal(size=(q, M, M)) / deviations
    if kind == "by column":
        rows *= (1.0 + 0.1 * np.arange(M))[:, None]
        rows[..., 0] += 1e-3 * rng.normal(size=(q, M, M)) / deviations
    if kind == "random":
        rows += 0.3 * rng.normal(size=rows.shape)
    small = np.log(rng.dirichlet(np.ones(M), M) * rng.dirichlet(np.ones(M))[:, None])
    if kind == "impossible":  # the pair with the best density
        rows[:, 0, 1] *= 0.1
        small[0, 1] = tables.LOG_ZERO
    u = np.concatenate([[1.0], rng.normal(size=q), deviations * rng.normal(size=q)])
    if (
        kind == "hidden"
    ):  # the first column is further off by less than a square can show, two others are alike
        rows[..., 0] += 1e-3 * rng.normal(size=(q, M, M)) / deviations
        rows[:, :, 0, 0] = (1e-17 * u[1 + q :])[:, None]
    p, o, total = exact_step(rows, small, u)
    log_w, reference, best = engine.far_weights(rows, small, u)
    top = log_w.max(axis=0)
    column = np.exp(log_w - top).sum(axis=0)
    log_p = np.log(column) + top + reference
    found = np.exp(log_p - log_p.max())
    np.testing.assert_allclose(np.exp(log_w - top) / column, o, atol=2e-15)
    np.testing.assert_allclose(found / found.sum(), p, atol=2e-15)
    np.testing.assert_allclose(best + log_p.max() + np.log(found.sum()), total, rtol=1e-14, atol=1e-12)


# --------------------------------------------------------------------------- where numbers end


def shown(f):
    names = ("x", "P", "mu", "x_prior", "P_prior", "log_likelihood", "z", "y")
    return [np.array(getattr(f, name)) for name in names]


@pytest.mark.parametrize("absurd", [1e153, 1e160, 1e300])
@pytest.mark.parametrize("before", [0, 1, 5])
def test_an_observation_beyond_all_numbers_is_an_error_that_changes_nothing(absurd, before) -> None:
    f = equal_regimes(2, [[0.9, 0.1], [0.3, 0.7]])
    for z in np.linspace(-1.0, 1.0, before):
        f.step(z)
    then, twin, series = shown(f), f.copy(), [0.1, absurd, 0.2]
    for verb, zs in (("step", absurd), ("filter", series), ("smooth", series), ("filter_many", [series] * 2)):
        with pytest.raises(NumericalRangeError, match=r"observation: got \[.*\], and double precision"):
            getattr(f, verb)(zs)
        for now, was in zip(shown(f), then, strict=True):
            np.testing.assert_array_equal(now, was)
    with pytest.raises(NumericalRangeError):
        f.filter([0.1, np.nan, absurd, 0.2])
    np.testing.assert_array_equal(f.step(0.3), twin.step(0.3))
    np.testing.assert_array_equal(f.step(0.4), twin.step(0.4))


# --------------------------------------------------------------------------- regimes that differ


@pytest.mark.parametrize(("unit", "far"), [(1e5, 9e149), (1e12, 1e145), (6e29, 1e148)])
@pytest.mark.parametrize("law", [FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)])
def test_moments_beyond_all_numbers_are_refused_in_whatever_unit(law, unit, far) -> None:
    # so few standard deviations that the density is a number, but the square of the mean is none
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    means, pairs = np.array([[0.0, 3.0], [0.0, 0.0]]) * unit, np.broadcast_to(pair, (2, 2, 4, 4)) * unit**2
    f = OFSRFilter(CGOFMSModel(law, means, pairs, 1), 3)
    series = unit * np.array([0.1, 0.2, far, 0.3, -0.2])
    with pytest.raises(NumericalRangeError, match=r"means below 1e\+153"):
        f.filter(series)
    with pytest.raises(NumericalRangeError, match=r"means below 1e\+153"):
        f.filter_many([series, series])
    expected = f.copy().filter(np.delete(series, 2))
    for z in series:
        before = shown(f)
        if z != series[2]:
            f.step(z)
            continue
        with pytest.raises(NumericalRangeError, match=r"means below 1e\+153"):
            f.step(z)
        for one, other in zip(before, shown(f), strict=True):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(f.x.ravel(), expected.x[-1], rtol=1e-12)
    np.testing.assert_allclose(f.P, expected.P[-1], rtol=1e-12)


@pytest.fixture(scope="module")
def two_regimes() -> CGOMSMFilter:
    """Regimes of other means and other noise, so that an outlier prefers the wider one by far."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    pairs = np.array([[pair, pair], [pair, pair]])
    return CGOMSMFilter(CGOMSModel([[0.9, 0.1], [0.2, 0.8]], [[0.0, 0.0], [1e-6, 1e-6]], pairs, 1))


@pytest.mark.parametrize("far", [1e3, 1e4, 1e5, 1e6])
def test_a_first_observation_far_off_prefers_the_regime_it_is_closer_to(two_regimes, far) -> None:
    # log-odds of the regimes: prior odds, and the difference of half-squares, (1e-6) (far - .5e-6)
    f = two_regimes.copy()
    f.step(far)
    odds = np.log(f.mu[1] / f.mu[0])
    assert odds == pytest.approx(np.log(0.1 / 0.2) + 1e-6 * (far - 0.5e-6), rel=1e-9)


@pytest.mark.parametrize("far", [1e3, 1e5])
def test_the_smoother_weighs_an_outlier_as_the_filter_does(two_regimes, far) -> None:
    # at the last time there is no difference, and gaps and outliers change nothing about that
    f = two_regimes
    for zs in ([0.1, far, 0.2], [0.1, far, np.nan, 0.2], [0.1, np.nan, far, 0.2, -0.1]):
        filtered, smoothed = f.filter(zs), f.smooth(zs)
        np.testing.assert_allclose(smoothed.mu[-1], filtered.mu[-1], rtol=1e-12)
        np.testing.assert_allclose(smoothed.mu.sum(axis=1), 1.0, rtol=1e-12)
        # at this distance the regimes are hard to tell apart, by 1e-6 standard deviations
        assert np.abs(np.log(smoothed.mu / filtered.mu)).max() < 1.0


def test_of_many_series_only_the_one_beyond_all_numbers_is_named(two_regimes) -> None:
    series = np.tile([0.1, 0.2, 0.3], (4, 1))
    series[2, 1] = -1e200
    with pytest.raises(NumericalRangeError, match=r"got \[-1e\+200\]"):
        two_regimes.filter_many(series)


def pair_weights(f, mu, w, y):
    """p_i P_ij N(y'; Ayy w + Ny, Qyy) in decimal numbers, (K, K), for a scalar system; the largest is one."""
    tables = f._system.pair_tables(0)
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = 400, -(10**9), 10**9
        log_w = {}
        for i, j in np.ndindex(*tables.transition.shape):
            Ayy, Ny, Q = (Decimal(float(part[i, j].item())) for part in tables.pairs[5:])
            z = Decimal(y) - Ayy * Decimal(w) - Ny
            log_w[i, j] = Decimal(float(mu[i] * tables.transition[i, j])).ln() - (z * z / Q + Q.ln()) / 2
        top = max(log_w.values())
        return {at: (value - top).exp() for at, value in log_w.items()}


@pytest.mark.parametrize("far", [3e3, 1e4, 1e5, 1e6])
def test_the_smoother_goes_back_through_an_outlier_by_the_rule_of_bayes(two_regimes, far) -> None:
    # the outlier tells of the regime before it as well, by the means of the pairs
    f, zs = two_regimes, [0.1, far]
    smoothed = f.smooth(zs).mu
    weights = pair_weights(f, f.filter(zs).mu[0], zs[0], far)
    total = sum(weights.values())
    for i in range(2):
        assert smoothed[0, i] == pytest.approx(float((weights[i, 0] + weights[i, 1]) / total), rel=1e-9)


@pytest.mark.parametrize("zs", [[0.1, 1e5, 0.2], [0.1, np.nan, 1e5, 0.2], [0.1, 0.2, np.nan, np.nan, -1e6]])
def test_the_most_likely_path_lies_in_the_regime_in_which_an_outlier_is_less_of_one(zs) -> None:
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    size = np.array([1.0, 3.0])  # of the noise in the two regimes
    scale = [[np.repeat([size[i], size[j]], 2) for j in range(2)] for i in range(2)]
    pairs = np.array([[pair * np.outer(scale[i][j], scale[i][j]) for j in range(2)] for i in range(2)])
    f = CGOMSMFilter(CGOMSModel([[0.9, 0.1], [0.2, 0.8]], np.zeros((2, 2)), pairs, 1))
    path = f.smooth(zs).switch_path
    assert path[int(np.nanargmax(np.abs(zs)))] == 1


@pytest.mark.parametrize("far", [1e4, 1e8, 1e30, 1e50, 1e100, 1e140])
def test_probabilities_sum_to_one_when_what_comes_back_is_an_outlier_too(far) -> None:
    # after the outlier the way back is one; by then the nodes differ by as many powers of ten themselves
    rng = np.random.default_rng(6)
    r = 0.3 * rng.normal(size=(3, 3)) + 0.8 * np.eye(3)
    z = r @ r.T + 0.1 * np.eye(3)
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    model = CGOFMSModel(law, rng.normal(size=(2, 3)), np.broadcast_to(pair, (2, 2, 6, 6)), 1)
    f, zs = OFSRFilter(model), [[0.0, 0.0], [far, 0.7 * far], [0.0, 0.0], [0.0, -far], [0.0, 0.0]]
    many = f.filter_many([zs], keep=("mu",)).mu[0]
    for mu in (f.filter(zs).mu, many, f.smooth(zs).mu):
        np.testing.assert_allclose(mu.sum(axis=1), 1.0, rtol=1e-12)
    f.reset()
    for y, mu in zip(zs, many, strict=True):
        f.step(y)
        np.testing.assert_allclose(f.mu, mu, rtol=1e-9, atol=1e-14)
        assert f.mu.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("far", [1e4, 1e8, 1e30, 1e75, 1e100, 1e140])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_outlier_lies_in_the_class_whose_mean_is_on_its_side(far, sign) -> None:
    # with one covariance the log-odds of two nodes are linear in the observation, and decide all
    z = np.array([[0.9892193771354016, -0.4802364872223138], [-0.4802364872223138, 1.0878295947818732]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    law, means = (
        FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
        [[0.12, -0.6039222943470477], [-1.06, -1.2445053813092128]],
    )
    f = OFSRFilter(CGOFMSModel(law, means, np.broadcast_to(pair, (2, 2, 4, 4)), 1))
    expected = np.zeros(len(f.nodes))
    expected[0 if sign > 0.0 else -1] = 1.0
    np.testing.assert_allclose(f.filter([-0.1, sign * far]).mu[1], expected, atol=1e-12)
    f.reset()
    f.step(-0.1)
    f.step(sign * far)
    np.testing.assert_allclose(f.mu, expected, atol=1e-12)

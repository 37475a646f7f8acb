"""IMMEstimator: exact limits, enumeration of mode sequences, mixed banks, GPB2."""

import itertools
import pickle

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from fuzzykf import FuzzyRelationEstimator
from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter, bank_series

METHODS = ("imm", "gpb2")
M = np.array([[0.9, 0.08, 0.02], [0.2, 0.7, 0.1], [0.05, 0.15, 0.8]])


class OwnKalmanFilter(KalmanFilter):
    """A filter with a verb of its own is not computed with its bank at once, but by its verbs."""

    def predict(self, *arguments, **named):
        super().predict(*arguments, **named)


def members(kind=KalmanFilter, n=2, m=1, K=3):
    """Filters that differ in everything but their initial estimate."""
    rng = np.random.default_rng(4)
    filters = []
    for k in range(K):
        F = 0.4 * rng.normal(size=(n, n)) + 0.5 * np.eye(n)
        filters.append(
            kind(n, m, F=F, H=rng.normal(size=(m, n)), Q=(0.1 + k) * np.eye(n), R=(0.5 + 0.3 * k) * np.eye(m))
        )
    return filters


def make(method="imm", kind=KalmanFilter, **dims):
    filters = members(kind, **dims)
    K = len(filters)
    T = M if K == 3 else np.full((K, K), 1.0 / K)
    return IMMEstimator(filters, np.arange(1.0, K + 1.0), T, method=method)


def enumerate_modes(imm, zs):
    """Exact mean, covariance, mode probabilities and log-likelihoods, over all mode sequences."""
    K, T, totals = imm.N, np.asarray(imm.M), [0.0]
    first = imm.filters[0]
    ends = [
        (np.log(p), first.x.ravel(), first.P, j) for j, p in enumerate(imm.mu)
    ]  # of every sequence so far
    for z in zs:
        longer = []
        for (log_w, x, P, before), j in itertools.product(ends, range(K)):
            f = imm.filters[j]
            x, P = f.F @ x, f.F @ P @ f.F.T + f.Q
            S = f.H @ P @ f.H.T + f.R
            log_w = log_w + np.log(T[before, j]) + multivariate_normal(f.H @ x, S).logpdf(z)
            gain = P @ f.H.T @ np.linalg.inv(S)
            longer.append((log_w, x + gain @ (z - f.H @ x), P - gain @ S @ gain.T, j))
        ends = longer
        totals.append(logsumexp([log_w for log_w, *_ in ends]))
    weights, means, covariances, last = (np.array(part) for part in zip(*ends, strict=True))
    w = np.exp(weights - totals[-1])
    x = w @ means
    off = means - x
    P = np.einsum("p,pkl->kl", w, covariances) + np.einsum("p,pk,pl->kl", w, off, off)
    modes = np.array([w[last == j].sum() for j in range(K)])
    return x, P, modes, np.diff(totals)


def state(imm):
    parts = [imm.__dict__, *(f.__dict__ for f in imm.filters)]
    return [
        {name: pickle.dumps(v) for name, v in part.items() if name not in ("_origin", "filters")}
        for part in parts
    ]


def compare(a, b, rtol=1e-9):
    for name in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood", "likelihood"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=rtol, atol=1e-12, err_msg=name)


# ------------------------------------------------------------------ exact limits


@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
@pytest.mark.parametrize(("method", "steps"), [("imm", 1), ("gpb2", 2)])
def test_it_is_exact_for_as_many_steps_as_it_keeps_hypotheses(method, steps, kind):
    # all modes start from one estimate: IMM is exact for one step, GPB2 for two
    zs = np.array([[0.7], [-1.1]])[:steps]
    imm = make(method, kind)
    x, P, modes, log_likelihood = enumerate_modes(imm.copy(), zs)
    result = imm.filter(zs)
    np.testing.assert_allclose(imm.x.ravel(), x, rtol=1e-10)
    np.testing.assert_allclose(imm.P, P, rtol=1e-10)
    np.testing.assert_allclose(imm.mu, modes, rtol=1e-10)
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-10)


def test_further_on_gpb2_is_closer_to_enumeration_than_imm():
    # where modes switch often and differ much; both are approximations from here on
    rng = np.random.default_rng(0)
    errors = dict.fromkeys(METHODS, 0.0)
    for _ in range(10):
        zs = 2.0 * rng.normal(size=(4, 1))
        x, *_ = enumerate_modes(make(), zs)
        for method in METHODS:
            imm = make(method)
            imm.filter(zs)
            errors[method] += np.abs(imm.x.ravel() - x).sum()
    assert errors["gpb2"] < errors["imm"]
    assert errors["imm"] / 10 < 0.05


@pytest.mark.parametrize("method", METHODS)
def test_identical_modes_are_one_kalman_filter(method, system):
    matrices = {name: system[name] for name in ("x", "P", "F", "Q", "H", "R")}
    imm = IMMEstimator([KalmanFilter(3, 2, **matrices) for _ in range(3)], [0.2, 0.3, 0.5], M, method=method)
    f = KalmanFilter(3, 2, **matrices)
    got, expected = imm.filter(system["zs"]), f.filter(system["zs"])
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-9, atol=1e-11)
    mu = np.array([0.2, 0.3, 0.5])
    for row in got.mu:
        mu = mu @ M
        np.testing.assert_allclose(row, mu, rtol=1e-12)


def test_without_transitions_imm_is_a_bank_of_separate_filters():
    # M = 1: nothing mixes, and the weights are those of Bayes' rule over whole series
    imm, filters = make(), members()
    imm.M = np.eye(3)
    zs = np.random.default_rng(1).normal(size=(8, 1))
    imm.filter(zs)
    totals = np.array([f.filter(zs).log_likelihood.sum() for f in filters]) + np.log([1 / 6, 2 / 6, 3 / 6])
    np.testing.assert_allclose(imm.mu, np.exp(totals - logsumexp(totals)), rtol=1e-10)
    for f, member in zip(filters, imm.filters, strict=True):
        np.testing.assert_allclose(member.x, f.x, rtol=1e-12)


# ------------------------------------------------------------------ one bank, several ways


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 2, 3])
def test_a_bank_at_once_is_as_member_by_member(method, m, flat):
    fast, slow = make(method, n=3, m=m), make(method, OwnKalmanFilter, n=3, m=m)
    rng = np.random.default_rng(2)
    for imm in (fast, slow):
        for k, f in enumerate(imm.filters):
            f.B, f.alpha = np.full((3, 1), k + 1.0), 1.0 + 0.05 * k
            if flat:
                f.x = f.x.ravel()
        imm.__init__(imm.filters, imm.mu, M, method=method)
    for k in range(8):
        z = rng.normal(size=m)
        if m > 1 and k % 3 == 0:
            z[0] = np.nan
        u = np.array([0.1]) if flat else np.array([[0.1]])
        for imm in (fast, slow):
            imm.predict(u if k % 2 else None)
            imm.update(None if k == 4 else z)
        compare(fast, slow)
        for f, g in zip(fast.filters, slow.filters, strict=True):
            for name in (
                "x",
                "P",
                "y",
                "S",
                "SI",
                "K",
                "x_prior",
                "x_post",
                "P_post",
                "log_likelihood",
                "mahalanobis",
            ):
                np.testing.assert_allclose(
                    getattr(f, name), getattr(g, name), rtol=1e-8, atol=1e-11, err_msg=name
                )
                assert np.shape(getattr(f, name)) == np.shape(getattr(g, name))


def test_members_that_cannot_be_stacked_are_taken_one_by_one():
    # scalars, lists and an inverse of the user's are right, only slower
    fast, slow = make(), make()
    for f in slow.filters:
        f.Q, f.R, f.F, f.P = float(f.Q[0, 0]), float(f.R[0, 0]), f.F.tolist(), 1.0
    slow.filters[1].inv = np.linalg.pinv
    for z in (0.3, -0.2, [np.nan], 1.0):
        fast.step(z)
        slow.step(z)
        compare(fast, slow)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 2])
def test_many_series_are_as_one_after_another(method, m):
    imm = make(method, m=m)
    imm.step(np.ones(m))
    zs = np.random.default_rng(5).normal(size=(6, 9, m))
    zs[np.random.default_rng(6).random(zs.shape) < 0.2] = np.nan
    before = state(imm)
    keep = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")
    result = imm.filter_many(zs, keep=keep)
    assert state(imm) == before
    slow = make(method, OwnKalmanFilter, m=m)
    slow.step(np.ones(m))
    slow_result = slow.filter_many(zs, keep=keep)
    for k, series in enumerate(zs):
        single = imm.copy().filter(series)
        for name in keep:
            for many in (result, slow_result):
                np.testing.assert_allclose(
                    getattr(many, name)[k], getattr(single, name), rtol=1e-8, atol=1e-11, err_msg=name
                )


@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
def test_single_precision_is_the_double_rounded(kind, monkeypatch):
    monkeypatch.setattr(bank_series, "BLOCK", 100)  # some series at once
    imm = make("imm", kind, m=2)
    zs = np.random.default_rng(5).normal(size=(7, 5, 2))
    zs[np.random.default_rng(6).random(zs.shape) < 0.2] = np.nan
    keep = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")
    single, double = imm.filter_many(zs, keep, dtype="float32"), imm.filter_many(zs, keep)
    for name in keep:
        assert getattr(single, name).dtype == np.float32
        np.testing.assert_allclose(getattr(single, name), getattr(double, name), rtol=1e-7, atol=1e-40)
    found = imm.filter_many([zs[0], zs[1, :3]], dtype=np.float32)
    assert found.x.dtype == np.float32
    assert np.isnan(found.x[1, 3:]).all()
    with pytest.raises(ParameterError, match="dtype: got"):
        imm.filter_many(zs, dtype="int64")


@pytest.mark.parametrize("method", ["imm", "gpb2"])
def test_threads_share_series_to_the_bit(method):
    imm, rng = make(method, m=2), np.random.default_rng(7)
    zs = rng.normal(size=(7, 5, 2))
    zs[rng.random(zs.shape) < 0.2] = np.nan
    for dtype in (np.float64, np.float32):
        alone, shared = (imm.filter_many(zs, ("x", "mu"), threads=k, dtype=dtype) for k in (1, 3))
        np.testing.assert_array_equal(shared.x, alone.x)
        np.testing.assert_array_equal(shared.mu, alone.mu)
    with pytest.raises(ParameterError, match="threads: got 0"):
        imm.filter_many(zs, threads=0)


@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
def test_what_single_precision_cannot_hold_is_an_error(kind):
    imm = make("imm", kind)
    for f in imm.filters:
        f.P = 1e60 * np.eye(len(f.P))
    assert imm.filter_many([[0.1, 0.2]], ["P_prior"]).P_prior.max() > 1e59
    with pytest.raises(NumericalRangeError, match=r"P_prior: got numbers up to .*e\+.*float32"):
        imm.filter_many([[0.1, 0.2]], ["P_prior"], dtype=np.float32)


def test_many_series_from_between_predict_and_update():
    imm = make()
    imm.predict()
    zs = np.array([[[0.1], [0.2]]])
    np.testing.assert_allclose(imm.filter_many(zs).x[0], imm.copy().filter(zs[0]).x)


def test_filter_reports_the_modes():
    result = make().filter([0.1, 5.0, None])
    assert np.array_equal(result.nodes, [0.0, 1.0, 2.0])
    assert np.array_equal(result.switch, result.mu.argmax(axis=1))
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0)
    assert result.switch_mean is None


def test_batch_filter_has_the_form_of_x():
    for flat, shape in ((False, (4, 2, 1)), (True, (4, 2))):
        filters = members()
        for f in filters:
            f.x = f.x.ravel() if flat else f.x
        means, covariances, means_p, _ = IMMEstimator(filters, [1, 1, 1], M).batch_filter(np.zeros(4))
        assert means.shape == means_p.shape == shape
        assert covariances.shape == (4, 2, 2)


# ------------------------------------------------------------------ mixed banks


def h(x):
    return x[:1]


@pytest.mark.parametrize("method", METHODS)
def test_kalman_and_extended_filters_in_one_bank(method):
    linear, mixed = make(method), make(method)
    for k, f in enumerate(mixed.filters[:2]):
        g = ExtendedKalmanFilter(2, 1, F=f.F, Q=f.Q, R=f.R, hx=lambda x, H=f.H: H @ x)
        mixed.filters[k] = g
    for z in (0.3, -1.0, None, 0.4):
        linear.step(z)
        mixed.step(z)
        compare(linear, mixed, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_three_kinds_of_filters_in_one_bank(method):
    # with Gaussian memberships the fuzzy estimator is the Kalman filter too
    linear, mixed = make(method), make(method)
    fuzzy, f = FuzzyRelationEstimator(2, 1), mixed.filters[0]
    fuzzy.F, fuzzy.Q, fuzzy.H, fuzzy.R = f.F, f.Q, f.H, f.R
    f = mixed.filters[1]
    extended = ExtendedKalmanFilter(
        2, 1, F=f.F, Q=f.Q, R=f.R, hx=lambda x, H=f.H: H @ x, HJacobian=lambda x, H=f.H: H
    )
    mixed = IMMEstimator([fuzzy, extended, mixed.filters[2]], mixed.mu, M, method=method)
    for z in (0.3, -1.0, None, 0.4, np.nan, 2.0):
        linear.step(z)
        mixed.step(z)
        compare(linear, mixed)
    np.testing.assert_allclose(
        mixed.copy().filter([0.1, 0.2]).x, linear.copy().filter([0.1, 0.2]).x, rtol=1e-9
    )
    mixed.predict()
    linear.predict()
    with pytest.raises(ShapeError, match="z: got shape"):
        mixed.update([1.0, 2.0])
    mixed.update(0.3)
    linear.update(0.3)
    compare(linear, mixed)
    for imm in (linear, mixed):
        imm.reset()
        imm.step(0.5)
    compare(linear, mixed)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_filters_of_filterpy_in_the_bank(method, flat):
    # filterpy's own filters, among them its UKF, which is the Kalman filter in a linear model
    filterpy_kalman = pytest.importorskip("filterpy.kalman")
    ours, theirs = make(method), make(method)
    for imm in (ours, theirs):
        for f in imm.filters:
            f.x = np.array([0.2, 0.1]) if flat else np.array([[0.2], [0.1]])
    f = theirs.filters[0]
    g = filterpy_kalman.KalmanFilter(2, 1)
    g.x, g.P, g.F, g.Q, g.H, g.R = f.x, f.P, f.F, f.Q, f.H, f.R
    filters = [g, *theirs.filters[1:]]
    if flat:
        f = theirs.filters[1]
        points = filterpy_kalman.MerweScaledSigmaPoints(2, alpha=0.5, beta=2.0, kappa=1.0)
        g = filterpy_kalman.UnscentedKalmanFilter(
            2, 1, 1.0, hx=lambda x, H=f.H: H @ x, fx=lambda x, dt, F=f.F: F @ x, points=points
        )
        g.x, g.P, g.Q, g.R = f.x, f.P, f.Q, f.R
        filters[1] = g
    theirs = IMMEstimator(filters, theirs.mu, M, method=method)
    ours = IMMEstimator(ours.filters, ours.mu, M, method=method)
    for z in (0.3, -1.0, None, 0.4):
        ours.step(z)
        theirs.step(z)
        compare(ours, theirs, rtol=1e-8)
    np.testing.assert_allclose(
        theirs.copy().filter([0.1, 0.2]).x, ours.copy().filter([0.1, 0.2]).x, rtol=1e-8
    )


def test_a_foreign_filter_is_not_given_half_an_observation():
    filterpy_kalman = pytest.importorskip("filterpy.kalman")
    foreign = filterpy_kalman.KalmanFilter(2, 2)
    foreign.H = np.eye(2)
    imm = IMMEstimator([KalmanFilter(2, 2, H=np.eye(2)), foreign], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])
    imm.predict()
    before = state(imm)
    with pytest.raises(ParameterError, match=r"z: .*filter 1 \(filterpy.*does not know missing components"):
        imm.update([np.nan, 1.0])
    assert state(imm) == before
    imm.update([np.nan, np.nan])
    imm.step([1.0, 1.0])


def test_a_foreign_filter_may_offer_only_a_likelihood():
    class Foreign:
        dim_z = 1

        def __init__(self, f):
            self.f = f

        def __getattr__(self, name):
            if name == "log_likelihood" or name.startswith("__"):
                raise AttributeError(name)
            return getattr(self.__dict__["f"], name)

        def __setattr__(self, name, value):
            if name == "f":
                self.__dict__["f"] = value
            else:
                setattr(self.f, name, value)

    ours = make()
    theirs = IMMEstimator([Foreign(f) for f in members()], ours.mu, M)
    for z in (0.3, -1.0):
        ours.step(z)
        theirs.step(z)
        compare(ours, theirs)


@pytest.mark.parametrize("flat", [False, True])
def test_a_foreign_filter_gets_observations_in_the_form_of_its_state(flat):
    class Foreign:
        dim_z, log_likelihood = 2, 0.0

        def __init__(self):
            self.x, self.P, self.shapes = np.zeros(2 if flat else (2, 1)), np.eye(2), []

        def predict(self):
            pass

        def update(self, z):
            self.shapes.append(np.shape(z))

    filters = [Foreign(), Foreign()]
    IMMEstimator(filters, [1, 1], np.eye(2)).step([1.0, 2.0])
    assert filters[0].shapes == filters[1].shapes == [(2,) if flat else (2, 1)]


@pytest.mark.parametrize("method", METHODS)
def test_verbs_that_a_subclass_overrides_are_called(method):
    class Doubling(KalmanFilter):
        def predict(self, *args, **kwargs):
            super().predict(*args, **kwargs)
            self.P = 2.0 * self.P

    plain, own = make(method), make(method)
    own.filters[0] = Doubling(
        2, 1, F=own.filters[0].F, H=own.filters[0].H, Q=own.filters[0].Q, R=own.filters[0].R
    )
    own.predict()
    plain.predict()
    np.testing.assert_allclose(own.filters[0].P, 2.0 * plain.filters[0].P)


# ------------------------------------------------------------------ weights


def test_an_outlier_leaves_informative_probabilities():
    # 1e3 standard deviations: all likelihoods underflow, their ratio does not
    wide, narrow = KalmanFilter(1, 1, H=[[1.0]], R=1.0015), KalmanFilter(1, 1, H=[[1.0]], R=1.0)
    imm = IMMEstimator([wide, narrow], [0.5, 0.5], [[0.5, 0.5], [0.5, 0.5]])
    imm.predict()
    z = 1e3 * np.sqrt(3.0)
    imm.update(z)
    log_ratio = 0.5 * (z**2 / 3.0 - z**2 / 3.0015) + 0.5 * np.log(3.0 / 3.0015)
    assert not imm.likelihood.any()
    assert np.isfinite(imm.log_likelihood)
    assert imm.mu[1] == pytest.approx(np.exp(-log_ratio), rel=1e-6)
    assert 0.0 < imm.mu[1] < 1e-100


def test_a_mode_ruled_out_for_long_comes_back():
    # without transitions weights only come back if they do not underflow in between
    imm = IMMEstimator(
        [KalmanFilter(1, 1, H=[[1.0]], Q=0.0, P=0.0, x=[[value]]) for value in (0.0, 100.0)],
        [0.5, 0.5],
        np.eye(2),
    )
    imm.step(0.0)  # exp(-5000) for the second mode
    assert imm.mu[1] == 0.0
    imm.step(100.0)
    np.testing.assert_allclose(imm.mu, [0.5, 0.5])


def test_probabilities_that_were_assigned_count():
    imm, other = make(), make()
    imm.mu = [0.7, 0.2, 0.1]
    other.mu[:] = 0.7, 0.2, 0.1
    np.testing.assert_allclose(imm.cbar, np.array([0.7, 0.2, 0.1]) @ M)
    np.testing.assert_allclose(other.step(0.4), imm.step(0.4))
    imm.mu = np.array([0.7, 0.2, 0.2])
    with pytest.raises(ParameterError, match=r"mu: .*sum to 1"):
        imm.predict()


def test_transitions_that_were_assigned_count():
    imm, other = make(), make()
    imm.M = np.eye(3)
    other.M = M.copy()
    other.step(0.1)
    other.M[:] = np.eye(3)
    np.testing.assert_allclose(imm.omega, np.eye(3))
    np.testing.assert_allclose(other.cbar, other.mu)
    imm.M = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 0.9]]
    with pytest.raises(ParameterError, match=r"M: .*sum to 1"):
        imm.predict()


@pytest.mark.parametrize("method", METHODS)
def test_a_mode_that_cannot_be_reached_does_no_harm(method):
    T = np.array([[0.9, 0.1, 0.0], [0.3, 0.7, 0.0], [0.5, 0.5, 0.0]])
    imm, two = make(method), make(method)
    imm.M = T
    two = IMMEstimator(two.filters[:2], [1 / 6 + 0.25 / 2, 2 / 6 + 0.25 / 2], T[:2, :2], method=method)
    imm.mu = np.array([*two.mu, 0.0])
    zs = [0.4, -0.3, 0.2]
    np.testing.assert_allclose(imm.filter_many([zs]).x[0], two.copy().filter(zs).x, rtol=1e-10)
    for z in zs:
        imm.step(z)
        two.step(z)
        np.testing.assert_allclose(imm.mu[:2], two.mu, rtol=1e-10)
        assert imm.mu[2] == 0.0
        np.testing.assert_allclose(imm.x, two.x, rtol=1e-10)
        assert np.isfinite(imm.omega).all()


# ------------------------------------------------------------------ missing observations


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("nothing", [None, np.nan])
def test_a_missing_observation_is_the_prediction(method, nothing):
    imm = make(method)
    imm.step(0.4)
    mu = imm.mu @ M
    imm.predict()
    x, P = imm.x.copy(), imm.P.copy()
    imm.update(nothing)
    assert np.array_equal(imm.x, x)
    assert np.array_equal(imm.P, P)
    assert np.array_equal(imm.x_post, imm.x_prior)
    np.testing.assert_allclose(imm.mu, mu, rtol=1e-12)
    assert imm.log_likelihood == 0.0
    assert np.array_equal(imm.likelihood, np.ones(3))
    for f in imm.filters:
        assert f.log_likelihood == 0.0
        assert not f.y.any()


@pytest.mark.parametrize("method", METHODS)
def test_two_predictions_are_one_missing_observation(method):
    imm, other = make(method), make(method)
    for f in (imm, other):
        f.step(0.4)
    imm.predict()
    imm.predict()
    other.step(None)
    other.predict()
    for name in ("x", "P", "mu", "cbar"):
        np.testing.assert_allclose(getattr(imm, name), getattr(other, name), rtol=1e-12)
    imm.update(0.2)
    other.update(0.2)
    compare(imm, other)


@pytest.mark.parametrize("method", METHODS)
def test_the_prior_is_the_mixture_with_the_predicted_weights(method):
    # the mean of the predicted law: modes moved from their mixed starts, weighted by mu M
    imm = make(method)
    imm.step(0.4)
    xs, mu = np.array([f.x.ravel() for f in imm.filters]), imm.mu
    Fs = np.array([f.F for f in imm.filters])
    imm.predict()
    expected = sum(mu[i] * M[i, j] * Fs[j] @ xs[i] for i in range(3) for j in range(3))
    np.testing.assert_allclose(imm.x_prior.ravel(), expected, rtol=1e-12)


# ------------------------------------------------------------------ objects


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
def test_members_stay_readable_objects(method, kind):
    filters = members(kind)
    imm = IMMEstimator(filters, [1, 1, 1], M, method=method)
    imm.step(0.4)
    assert imm.filters is filters
    x = sum(mu * f.x for mu, f in zip(imm.mu, filters, strict=True))
    np.testing.assert_allclose(imm.x, x, rtol=1e-12)
    filters[1].x[:] = 5.0  # and they may be written into
    filters[1].Q = 2.0 * np.eye(2)
    other = imm.copy()
    imm.step(0.2)
    other.step(0.2)
    compare(imm, other)
    assert filters[0].x is not filters[0].x_post


@pytest.mark.parametrize("method", METHODS)
def test_members_and_mixture_keep_what_was_predicted(method):
    imm = make(method)
    imm.step(0.4)
    imm.predict()
    priors = [f.x.copy() for f in imm.filters]
    imm.update(1.0)
    for f, prior in zip(imm.filters, priors, strict=True):
        assert np.array_equal(f.x_prior, prior)
        assert np.array_equal(f.x_post, f.x)


@pytest.mark.parametrize("method", METHODS)
def test_likelihoods_of_the_modes_add_up_to_that_of_the_mixture(method):
    imm = make(method)
    for z in (0.4, -1.0, 2.0):
        imm.predict()
        cbar = imm.cbar
        imm.update(z)
        assert np.log(cbar @ imm.likelihood) == pytest.approx(imm.log_likelihood)
        np.testing.assert_allclose(np.exp(imm.mode_log_likelihood), imm.likelihood)
        np.testing.assert_allclose(imm.mu, cbar * imm.likelihood / (cbar @ imm.likelihood))


@pytest.mark.parametrize("method", METHODS)
def test_reset_returns_the_same_members_to_their_origin(method):
    filters = members()
    imm = IMMEstimator(filters, [1, 1, 1], M, method=method)
    first = imm.filter([0.3, 0.1, None])
    imm.predict()
    imm.reset()
    assert all(f is g for f, g in zip(imm.filters, filters, strict=True))
    assert not filters[0].x.any()
    again = imm.filter([0.3, 0.1, None])
    assert np.array_equal(first.x, again.x)


def test_a_copy_between_predict_and_update_is_independent():
    for method in METHODS:
        imm = make(method)
        imm.predict()
        for other in (imm.copy(), pickle.loads(pickle.dumps(imm))):
            g = imm.copy()
            other.update(5.0)
            g.update(0.3)
            imm_copy = imm.copy()
            imm_copy.update(0.3)
            compare(g, imm_copy)


def test_repr_shows_the_mixture():
    text = repr(make())
    assert text.startswith("IMMEstimator object")
    assert "\nmu = [" in text
    assert "\nomega = [" in text


def test_filterpys_defaults():
    filterpy_kalman = pytest.importorskip("filterpy.kalman")
    ours, theirs = make(), filterpy_kalman.IMMEstimator(members(), [1, 2, 3], M)
    for name in (
        "x",
        "P",
        "mu",
        "cbar",
        "omega",
        "likelihood",
        "N",
        "x_prior",
        "P_prior",
        "x_post",
        "P_post",
    ):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-14, err_msg=name)


# ------------------------------------------------------------------ inadmissible


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([], [], M), ParameterError, "filters: got 0, expected at least two"),
        ((members()[:1], [1.0], [[1.0]]), ParameterError, "filters: got 1"),
        (([KalmanFilter(2, 1), KalmanFilter(3, 1)], [1, 1], np.eye(2)), ShapeError, "filters: x has shapes"),
        (
            ([KalmanFilter(2, 1), KalmanFilter(2, 2)], [1, 1], np.eye(2)),
            ShapeError,
            r"observations have \[1, 2\]",
        ),
        (([members()[0]] * 2, [1, 1], np.eye(2)), ParameterError, "twice"),
        ((members(), [1, 1], M), ShapeError, r"mu: got shape \(2,\), expected \(3,\)"),
        ((members(), [1, 1, -1], M), ParameterError, "mu: .*at least 0"),
        ((members(), [0, 0, 0], M), ParameterError, "mu: .*not all 0"),
        ((members(), [1, 1, 1], M[:2]), ShapeError, r"M: got shape \(2, 3\), expected \(3, 3\)"),
        ((members(), [1, 1, 1], M.T), ParameterError, "M: .*sum to 1 in each row"),
        ((members(), [1, 1, 1], [[1.5, -0.5, 0], [0, 1, 0], [0, 0, 1]]), ParameterError, "M: "),
    ],
)
def test_the_constructor_names_what_is_wrong(arguments, error, message):
    with pytest.raises(error, match=message):
        IMMEstimator(*arguments)


def test_methods_are_two():
    with pytest.raises(ParameterError, match="method: got 'gpb3', expected 'imm' or 'gpb2'"):
        make("gpb3")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
def test_a_failed_update_leaves_all_filters_as_they_were(method, kind):
    imm = make(method, kind)
    imm.step(0.4)
    imm.predict()
    before = state(imm)
    with pytest.raises(ShapeError, match="z: got shape"):
        imm.update([1.0, 2.0])
    assert state(imm) == before
    R = [f.R for f in imm.filters]
    imm.update(0.1)
    imm.predict()
    imm.filters[2].R = -100.0 * R[2]
    before = state(imm)
    with pytest.raises(NotPositiveDefiniteError):
        imm.update(0.2)
    assert state(imm) == before
    with pytest.raises(NotPositiveDefiniteError):
        imm.filter([0.1, 0.2])
    assert state(imm) == before
    with pytest.raises(NotPositiveDefiniteError):
        imm.filter_many([[0.1, 0.2]])
    imm.filters[2].F = np.eye(5)
    before = state(imm)
    with pytest.raises(ShapeError):
        imm.predict()
    assert state(imm) == before


@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [KalmanFilter, OwnKalmanFilter])
def test_an_observation_that_no_mode_can_explain_is_an_error(method, kind):
    # its squared distance is beyond the largest number; anything less is weighed
    imm = make(method, kind)
    imm.step(0.1)
    imm.predict()
    before = state(imm)
    with pytest.raises(ParameterError, match=r"z: .*no mode gives a positive density"):
        imm.update(1e200)
    assert state(imm) == before
    with pytest.raises(ParameterError, match="no mode gives"):
        imm.filter_many([[0.1, 1e200]])
    with pytest.raises(ParameterError, match="no mode gives"):  # not what it leaves for the next one
        imm.filter_many([[0.1, 1e200, 0.3, 0.2]])
    with pytest.raises(
        ParameterError, match="series 1 .*no mode gives" if kind is KalmanFilter else "no mode gives"
    ):
        make(method, kind).filter_many([[0.1, 0.2], [0.1, 1e200]])
    imm.update(1e100)
    assert np.isfinite(imm.mu).all()
    assert np.isfinite(imm.log_likelihood)


def test_members_of_different_shape_by_now_are_named():
    imm = make()
    imm.filters[1].P = np.eye(3)
    with pytest.raises(ShapeError, match=r"filters\[1\].P: got shape \(3, 3\), expected \(2, 2\)"):
        imm.predict()
    imm = make()
    imm.filters[2].x = np.zeros(2)
    with pytest.raises(ShapeError, match=r"filters: x has shapes \[\(2, 1\), \(2, 1\), \(2,\)\]"):
        imm.predict()


# ------------------------------------------------------------------ whole series of a changed bank


@pytest.mark.parametrize("verb", ["predict", "update"])
@pytest.mark.parametrize("where", ["class", "object"])
def test_a_series_goes_through_verbs_that_were_changed(verb, where):
    calls = []
    f, zs = make(), [0.1, 0.4, -0.2]
    if where == "class":

        class Own(IMMEstimator):
            pass

        def counted(self, *arguments):
            calls.append(verb)
            getattr(IMMEstimator, verb)(self, *arguments)

        setattr(Own, verb, counted)
        f = Own(f.filters, f.mu, f.M)
    else:
        usual = getattr(f, verb)
        setattr(f, verb, lambda *arguments: (calls.append(verb), usual(*arguments))[1])
    result = f.filter(zs)
    assert calls == [verb] * 3
    np.testing.assert_allclose(result.x, make().filter(zs).x, rtol=1e-9)


@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
def test_a_series_with_an_observation_that_no_mode_explains_is_an_error():
    imm = make()
    before = state(imm)
    with pytest.raises(ParameterError, match="no mode gives a positive density"):
        imm.filter([0.1, 1e200, 0.3])
    assert state(imm) == before

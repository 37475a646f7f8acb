"""Filters with inputs and features, against the enumeration of all paths of the switch.

Given the path and the observations X has a Gaussian recursion, so a short series has an exact answer by sums
over all paths.  With inputs alone (X, Y) is jointly Gaussian given the path, and any part may be missing.
"""

from __future__ import annotations

import copy
import pickle
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FixedLag, FuzzyMarkovLaw
from fuzzykf.errors import ParameterError, SequenceError, ShapeError
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.testing import check_filter

NAN = np.nan
LAGS, PLAIN = WindowFeatures(order=2, blocks=(2,)), WindowFeatures()


def features_of(name, q):
    knots = np.arange(2.0 * q).reshape(q, 2) / q - 0.5
    return {
        "inputs": WindowFeatures(),
        "lags": WindowFeatures(order=3),
        "blocks": WindowFeatures(order=2, blocks=(2, 3)),
        "hinges": WindowFeatures(hinges=knots),
        "products": WindowFeatures(products=True),
        "all": WindowFeatures(order=2, blocks=(2,), hinges=knots, products=True),
    }[name]


def covariance(rng, *shape):
    a = 0.4 * rng.normal(size=(*shape, shape[-1]))
    return a @ np.swapaxes(a, -1, -2) + 0.3 * np.eye(shape[-1])


def form_of(features, m=1, q=1, k=1, K=2, *, tilt=True, names=None):
    rng = np.random.default_rng(K)
    width = sum(features.sizes(q, k))
    return InputForm(
        By=0.4 * rng.normal(size=(K, K, q, width)),
        Bx=0.5 * rng.normal(size=(K, K, m, width)),
        features=features,
        inputs=[f"in{j}" for j in range(k)] if names is None else names,
        tilt=rng.normal(size=(K, k)) if tilt else None,
        centre=rng.normal(size=k) if tilt else None,
        Ayy=0.4 * rng.normal(size=(K, K, q, q)),
        Ny=rng.normal(size=(K, K, q)),
        Qyy=covariance(rng, K, K, q),
        Axx=0.4 * rng.normal(size=(K, K, m, m)),
        H=rng.normal(size=(K, K, m, q)),
        G=rng.normal(size=(K, K, m, q)),
        c=rng.normal(size=(K, K, m)),
        C=covariance(rng, K, K, m),
        means=rng.normal(size=(K, m + q)),
        covariances=covariance(rng, K, m + q),
    )


def hard(features=PLAIN, **options):
    form = form_of(features, **options)
    transition = [[0.8, 0.2], [0.3, 0.7]] if form.n_classes == 2 else [[1.0]]
    return CGOMSModel._from_form(transition, form, [0.4, 0.6] if form.n_classes == 2 else [1.0])


def fuzzy(features=PLAIN, **options):
    return CGOFMSModel._from_form(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), form_of(features, **options))


def series_of(n, q=1, k=1):
    rng = np.random.default_rng(10)
    return rng.normal(size=(n, q)), rng.normal(size=(n, k))


def told(us):
    return {"us": us} if us.shape[1] else {}


# ---------------------------------------------------------------- oracles


def log_normal(y, mean, S):
    return -0.5 * ((y - mean) @ np.linalg.solve(S, y - mean) + np.linalg.slogdet(2.0 * np.pi * S)[1])


def log_sum(a):
    return np.log(np.exp(a - a.max()).sum()) + a.max()


def regressors(features, past, u, y):
    """(common, own), the past from the latest observation on."""
    found = [*u, *(value for lag in range(1, features.order) for value in past[lag])]
    lag = features.order
    for length in features.blocks:
        found += list(np.mean(past[lag : lag + length], axis=0))
        lag += length
    if features.n_hinges:
        found += [max(y[c] - knot, 0.0) for c in range(len(y)) for knot in features.knots[c]]
    if features.products:
        found += [a * b for a in u for b in y]
    return np.array(found)


class Nodes:
    """What a step at a pair of nodes is, from the parameters of the regimes."""

    def __init__(self, system, us):
        self.form, self.shares, self.us = system.form, system.chain.class_weights, us
        self.P, self.initial, self.law = system.chain.transition, system.chain.initial, system.initial()
        self.plain = system.tables.pairs
        self.n, self.q = len(self.shares), system.dim_z

    def mixed(self, table, i, j):
        return np.einsum("a,b,ab...->...", self.shares[i], self.shares[j], table)

    def log_move(self, i, j, n):
        push = [s @ self.form.tilt @ (self.us[n] - self.form.centre) for s in self.shares]
        with np.errstate(divide="ignore"):
            return np.log(self.P[i, j]) + push[j] - np.log(self.P[i] @ np.exp(push))

    def matrices(self, i, j):
        p = self.plain
        return p.Axx[i, j], p.H[i, j][:, : self.q], p.G[i, j], p.c[i, j], p.C[i, j]

    def of_y(self, i, j):
        return self.plain.Ayy[i, j][:, : self.q], self.plain.Ny[i, j], self.plain.Qyy[i, j]


def enumerated(nodes, ys):
    """Filtered and smoothed moments, log-likelihoods and priors of a complete series."""
    form, N, m = nodes.form, len(ys), nodes.form.dim_x
    features = form.features
    paths, weights, means, covariances = [], [], [], []
    for path in product(range(nodes.n), repeat=N):
        i = path[0]
        mean, S = nodes.law.mean[i], nodes.law.covariance[i]
        gain = S[:m, m:] @ np.linalg.inv(S[m:, m:])
        x, P = [mean[:m] + gain @ (ys[0] - mean[m:])], [S[:m, :m] - gain @ S[m:, :m]]
        w = [np.log(nodes.initial[i]) + log_normal(ys[0], mean[m:], S[m:, m:])]
        for n in range(1, N):
            i, j = path[n - 1 : n + 1]
            past = [ys[max(n - 1 - lag, 0)] for lag in range(features.n_past)]
            (A, H, G, c, C), (B, d, Q) = nodes.matrices(i, j), nodes.of_y(i, j)
            mean_y = B @ past[0] + d
            mean_y += nodes.mixed(form.By, i, j) @ regressors(features, past, nodes.us[n], past[0])
            w.append(w[-1] + nodes.log_move(i, j, n) + log_normal(ys[n], mean_y, Q))
            offset = H @ past[0] + G @ ys[n] + c
            offset += nodes.mixed(form.Bx, i, j) @ regressors(features, past, nodes.us[n], ys[n])
            x.append(A @ x[-1] + offset)
            P.append(A @ P[-1] @ A.T + C)
        paths.append(path), weights.append(w), means.append(x), covariances.append(P)
    paths, weights, means, covariances = (np.array(a) for a in (paths, weights, means, covariances))

    def moments(n, upto):
        p = np.exp(weights[:, upto] - log_sum(weights[:, upto]))
        x = p @ means[:, n]
        off = means[:, n] - x
        P = np.einsum("a,aij->ij", p, covariances[:, n] + off[:, :, None] * off[:, None, :])
        return x, P, np.bincount(paths[:, n], p, nodes.n)

    filtered = [np.array(a) for a in zip(*(moments(n, n) for n in range(N)), strict=True)]
    smoothed = [np.array(a) for a in zip(*(moments(n, N - 1) for n in range(N)), strict=True)]
    # a beginning of a path stands for all paths that go on from it
    total = [log_sum(weights[:, n]) - (N - 1 - n) * np.log(nodes.n) for n in range(N)]
    return filtered, smoothed, np.diff([0.0, *total])


def jointly(nodes, ys):
    """Moments of X and of the next Y given what is there of a series, inputs being all that is further.

    Returns x, P, mu of each time given the whole series, and the log-likelihood of that.
    """
    form, N, m, q = nodes.form, len(ys), nodes.form.dim_x, nodes.q
    d = m + q
    found = []
    for path in product(range(nodes.n), repeat=N):
        mean, S = np.zeros(N * d), np.zeros((N * d, N * d))
        mean[:d], S[:d, :d] = nodes.law.mean[path[0]], nodes.law.covariance[path[0]]
        w = np.log(nodes.initial[path[0]])
        for n in range(1, N):
            i, j = path[n - 1 : n + 1]
            (A, H, G, c, C), (B, e, Q) = nodes.matrices(i, j), nodes.of_y(i, j)
            u = nodes.us[n]
            offset_y = e + nodes.mixed(form.By, i, j) @ u
            offset_x = c + nodes.mixed(form.Bx, i, j) @ u + G @ offset_y
            F = np.block([[A, H + G @ B], [np.zeros((q, m)), B]])
            noise = np.block([[C + G @ Q @ G.T, G @ Q], [Q @ G.T, Q]])
            old, new = slice((n - 1) * d, n * d), slice(n * d, (n + 1) * d)
            mean[new] = F @ mean[old] + np.concatenate([offset_x, offset_y])
            S[new, : n * d] = F @ S[old, : n * d]
            S[: n * d, new] = S[new, : n * d].T
            S[new, new] = F @ S[old, old] @ F.T + noise
            w += nodes.log_move(i, j, n)
        there = np.flatnonzero(~np.isnan(np.concatenate([np.full((N, m), NAN), ys], axis=1).ravel()))
        values = ys.ravel()[~np.isnan(ys.ravel())]
        if there.size:
            inner = S[np.ix_(there, there)]
            w += log_normal(values, mean[there], inner)
            gain = np.linalg.solve(inner, S[there]).T
            mean, S = mean + gain @ (values - mean[there]), S - gain @ S[there]
        found.append((path, w, mean.reshape(N, d), S))
    paths, w = np.array([one[0] for one in found]), np.array([one[1] for one in found])
    p = np.exp(w - log_sum(w))
    z, P, mu = [], [], []
    for n in range(N):
        means = np.array([one[2][n] for one in found])
        off = means - p @ means
        own = np.array([one[3][n * d : (n + 1) * d, n * d : (n + 1) * d] for one in found])
        z.append(p @ means)
        P.append(np.einsum("a,aij->ij", p, own + off[:, :, None] * off[:, None, :]))
        mu.append(np.bincount(paths[:, n], p, nodes.n))
    return np.array(z), np.array(P), np.array(mu), log_sum(w)


# ---------------------------------------------------------------- exactness

CASES = [
    (make, name, m, q, k, tilt)
    for make, name in product((hard, fuzzy), ("inputs", "lags", "blocks", "hinges", "products", "all"))
    for m, q, k, tilt in ((1, 1, 1, True), (2, 2, 2, False))
    if make is hard or name in {"inputs", "all"}
] + [(hard, name, 1, 2, 0, False) for name in ("lags", "hinges")]


@pytest.mark.parametrize(("make", "name", "m", "q", "k", "tilt"), CASES)
def test_filter_and_smoother_are_the_sums_over_all_paths(make, name, m, q, k, tilt):
    model = make(features_of(name, q), m=m, q=q, k=k, tilt=tilt)
    n, nodes = (5, None) if make is hard else (4, 1)
    ys, us = series_of(n, q, k)
    filtered, smoothed, log_likelihood = enumerated(Nodes(model.placed(nodes), us), ys)
    f = model.filter(nodes)
    for found, expected in ((f.smooth(ys, **told(us)), smoothed), (f.filter(ys, **told(us)), filtered)):
        for name, values in zip(("x", "P", "mu"), expected, strict=True):
            np.testing.assert_allclose(getattr(found, name), values, rtol=1e-10, atol=1e-11, err_msg=name)
        np.testing.assert_allclose(found.log_likelihood, log_likelihood, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize(
    ("K", "m", "q", "missing"),
    [
        (1, 1, 1, [(0,), (2,), (3,), (5,)]),  # several in a row, and the first
        (1, 2, 2, [(1, 0), (2, 1), (3,), (4,), (5, 0)]),  # in part
        (2, 1, 1, [(2,)]),
        (2, 1, 1, [(0,), (3,)]),
        (2, 1, 1, [(4,)]),
    ],
)
@pytest.mark.parametrize("tilt", [True, False])
def test_gaps_are_exact_with_inputs_alone(K, m, q, missing, tilt):
    model = hard(K=K, m=m, q=q, k=2, tilt=tilt)
    ys, us = series_of(6, q, 2)
    for at in missing:
        ys[at] = NAN
    found, nodes = model.filter().filter(ys, us=us), Nodes(model.placed(), us)
    total = 0.0
    for n in range(6):
        z, P, mu, value = jointly(nodes, ys[: n + 1])
        np.testing.assert_allclose(found.x[n], z[n, :m], atol=1e-11)
        np.testing.assert_allclose(found.P[n], P[n][:m, :m], atol=1e-11)
        np.testing.assert_allclose(found.mu[n], mu[n], atol=1e-11)
        np.testing.assert_allclose(found.log_likelihood[n], value - total, atol=1e-11)
        total = value
    smoothed = model.filter().smooth(ys, us=us)
    z, P, mu, _ = jointly(nodes, ys)
    np.testing.assert_allclose(smoothed.x, z[:, :m], atol=1e-10)
    np.testing.assert_allclose(smoothed.P, P[:, :m, :m], atol=1e-10)
    np.testing.assert_allclose(smoothed.mu, mu, atol=1e-10)


@pytest.mark.parametrize(("K", "tilt"), [(1, False), (2, True)])
def test_a_forecast_and_what_is_known_before_an_observation_are_exact_with_inputs_alone(K, tilt):
    model, steps = hard(K=K, k=2, tilt=tilt), 3
    ys, us = series_of(6, 1, 2)
    nodes, f = Nodes(model.placed(), us), model.filter()
    f.filter(ys[:3], us=us[:3])
    found = f.forecast(steps, us=us[3:])
    ahead = ys.copy()
    ahead[3:] = NAN
    z, P, mu, _ = jointly(nodes, ahead)
    np.testing.assert_allclose(found.x, z[3:, :1], atol=1e-11)
    np.testing.assert_allclose(found.z_prior, z[3:, 1:], atol=1e-11)
    np.testing.assert_allclose(found.P, P[3:, :1, :1], atol=1e-11)
    np.testing.assert_allclose(found.S, P[3:, 1:, 1:], atol=1e-11)
    np.testing.assert_allclose(found.mu, mu[3:], atol=1e-11)
    whole = model.filter().filter(ys, us=us)
    for n in range(1, 6):
        ahead = ys[: n + 1].copy()
        ahead[n] = NAN
        z, P, _, _ = jointly(nodes, ahead)
        np.testing.assert_allclose(whole.x_prior[n], z[n, :1], atol=1e-11)
        np.testing.assert_allclose(whole.P_prior[n], P[n][:1, :1], atol=1e-11)
    f.step(ys[3], us[3])
    z, P, _, _ = jointly(nodes, np.concatenate([ys[:3], [[NAN]]]))
    np.testing.assert_allclose(f.y, ys[3] - z[3, 1:, None], atol=1e-11)
    np.testing.assert_allclose(f.S, P[3][1:, 1:], atol=1e-11)
    assert f.nis == pytest.approx((f.y.T @ np.linalg.inv(f.S) @ f.y).item())


# ---------------------------------------------------------------- one series, many ways

GAPPY = [0, 4, 5, 9]
N = 11


def state(f):
    names = ("x", "P", "x_prior", "P_prior", "mu", "y", "S", "log_likelihood")
    return {name: np.array(getattr(f, name)) for name in names}


def assert_same(a, b, atol=1e-12):
    for name, value in a.items():
        np.testing.assert_allclose(value, b[name], atol=atol, err_msg=name)


FILTERS = {
    "hard, inputs on the switch": hard(k=2).filter(),
    "hard, everything": hard(features_of("all", 1), k=2).filter(),
    "hard, constant switch": hard(features_of("all", 1), k=2, tilt=False).filter(),
    "fuzzy, blocks": fuzzy(LAGS, k=2, tilt=False).filter(1),
}


@pytest.fixture(params=list(FILTERS))
def f(request):
    """A filter with two inputs, before any observation."""
    return FILTERS[request.param].copy()


@pytest.fixture(params=["complete", "gaps"])
def data(request):
    ys, us = series_of(N, 1, 2)
    if request.param == "gaps":
        ys[GAPPY] = NAN
    return ys, us


def test_steps_parts_and_many_give_what_the_whole_series_gives(f, data):
    ys, us = data
    start, whole = f.copy(), f.filter(ys, us=us)
    names = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")
    by_steps = start.copy()
    for n in range(N):
        by_steps.step(ys[n], *([us[n]] if n else []))
        got = {name: np.squeeze(getattr(by_steps, name)) for name in names}
        assert_same(got, {name: np.squeeze(getattr(whole, name)[n]) for name in names})
    assert_same(state(by_steps), state(f))
    by_parts, parts = start.copy(), []
    for a, b in ((0, 1), (1, 5), (5, 6), (6, 6), (6, 10), (10, N)):
        parts.append(by_parts.filter(ys[a:b], us=us[a:b], resume=True))
    for name in names:
        together = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_allclose(together, getattr(whole, name), atol=1e-12, err_msg=name)
    assert_same(state(by_parts), state(f))
    many = start.filter_many([ys, ys[:6]], names, us=[us, -us[:6]])
    other = start.copy().filter(ys[:6], us=-us[:6])
    for name in names:
        np.testing.assert_allclose(getattr(many, name)[0], getattr(whole, name), atol=1e-12)
        np.testing.assert_allclose(getattr(many, name)[1][:6], getattr(other, name), atol=1e-12)
    shared = start.filter_many(np.stack([ys, ys]), us=us)
    np.testing.assert_array_equal(shared.x[1], whole.x)


def test_a_second_predict_is_a_missing_observation(f):
    ys, us = series_of(N, 1, 2)
    f.filter(ys[:3], us=us[:3])
    missing, resumed = f.copy(), f.copy()
    f.predict(us[3])
    f.predict(us[4])
    assert_same({"x": f.x}, {"x": f.x_prior})
    f.update(ys[4])
    missing.step(None, us[3])
    missing.step(ys[4], us[4])
    assert_same(state(f), state(missing))
    resumed.predict(us[3])
    found = resumed.filter(ys[4:], us=us[4:], resume=True)
    skipping = missing.filter(ys[5:], us=us[5:], resume=True)
    np.testing.assert_allclose(found.x[1:], skipping.x, atol=1e-12)
    np.testing.assert_allclose(found.P_prior[1:], skipping.P_prior, atol=1e-12)
    assert_same(state(resumed), state(missing))


def test_a_forecast_is_the_filter_of_nothing(f, data):
    ys, us = data
    f.filter(ys[:8], us=us[:8])
    before = state(f)
    found = f.forecast(3, us=us[8:])
    assert_same(state(f), before)
    f.predict(us[8])
    np.testing.assert_array_equal(f.forecast(3, us=us[8:]).x, found.x)
    assert_same({"x": f.x_prior[:, 0], "P": f.P_prior}, {"x": found.x[0], "P": found.P[0]})
    f.update(None)
    rest = f.filter(np.full((2, 1), NAN), us=us[9:], resume=True)
    np.testing.assert_allclose(rest.x_prior, found.x[1:], atol=1e-12)
    np.testing.assert_allclose(rest.P_prior, found.P[1:], atol=1e-12)
    f.reset()
    np.testing.assert_allclose(
        f.forecast(3, us=us[:3]).x, f.copy().filter(np.full((3, 1), NAN), us=us[:3]).x_prior, atol=1e-12
    )


def test_a_new_observation_does_not_tell_of_what_was_known_before_it(f, data):
    ys, us = data
    f.filter(ys[:7], us=us[:7])
    f.predict(us[7])
    known = {"x_prior": f.x_prior, "P_prior": f.P_prior}
    for z in (-3.0, 5.0, None):
        one, series = f.copy(), f.copy()
        one.update(z)
        assert_same({"x_prior": one.x_prior, "P_prior": one.P_prior}, known)
        series.reset()
        whole = series.filter(np.concatenate([ys[:7], [[NAN if z is None else z]]]), us=us[:8])
        assert_same({"x_prior": whole.x_prior[7][:, None], "P_prior": whole.P_prior[7]}, known)


@pytest.mark.parametrize("f", ["hard, everything", "fuzzy, blocks"], indirect=True)
def test_a_filter_comes_back_at_any_moment(f, tmp_path):
    ys, us = series_of(5, 1, 2)
    ys[[0, 2, 3]] = NAN
    for n in range(5):
        for predicted in (False, True):
            if predicted:
                f.predict(us[n])
            f.save(tmp_path / "f.json")
            copies = (
                type(f).load(tmp_path / "f.json"),
                pickle.loads(pickle.dumps(f)),
                copy.deepcopy(f),
                copy.copy(f),
            )
            for one in copies:
                assert_same(state(one), state(f), atol=0.0)
                for k in range(n, 5):
                    if not (predicted and k == n):
                        one.predict(us[k])
                    one.update(ys[k])
                if one is copies[0]:
                    end = state(one)
                assert_same(state(one), end, atol=0.0)
        f.update(ys[n])
    assert_same(state(f), end, atol=0.0)


@pytest.mark.parametrize("f", ["hard, everything", "fuzzy, blocks"], indirect=True)
def test_smoothers_agree(f, data):
    ys, us = data
    start = f.copy()
    smoothed, filtered = f.smooth(ys, us=us), start.copy().filter(ys, us=us)
    np.testing.assert_allclose(f.smooth_lag(ys, 0, us).x, filtered.x, atol=1e-12)
    late = f.smooth_lag(ys, N, us)
    np.testing.assert_allclose(late.x, smoothed.x, atol=1e-11)
    np.testing.assert_allclose(late.P, smoothed.P, atol=1e-11)
    assert_same(state(f), state(_after(start, ys, us)))
    lagged, expected = FixedLag(start.copy(), 3), f.smooth_lag(ys, 3, us=us)
    for n in range(N):
        x = lagged.step(ys[n], u=us[n])
        if n >= 3:
            np.testing.assert_allclose(x[:, 0], expected.x[n - 3], atol=1e-11)
            np.testing.assert_allclose(lagged.P, expected.P[n - 3], atol=1e-11)


def _after(f, ys, us):
    one = f.copy()
    one.filter(ys, us=us)
    return one


# ---------------------------------------------------------------- what is told


def test_names_of_inputs_count_whatever_their_order():
    f = hard(k=2, names=["day", "heat"]).filter()
    ys, us = series_of(6, 1, 2)
    expected = f.filter(ys, us=us)
    table = pd.DataFrame({"heat": us[:, 1], "other": 0.0, "day": us[:, 0]})
    np.testing.assert_array_equal(f.filter(ys, us=table).x, expected.x)
    np.testing.assert_array_equal(f.smooth(ys, us=table).x, f.smooth(ys, us=us).x)
    np.testing.assert_array_equal(f.filter_many([ys, ys], us=[table, us]).x, [expected.x, expected.x])
    for shared in (table, table.set_axis(pd.date_range("2024", periods=6, freq="h"))):
        np.testing.assert_array_equal(f.filter_many([ys, ys], us=shared).x, [expected.x, expected.x])
    rows = {
        "Series": [table.iloc[n] for n in range(6)],
        "mapping": [dict(table.iloc[n]) for n in range(6)],
        "named tuple": list(table.itertuples(index=False)),
        "array": us,
        "column": us[:, :, None],
        "list": us.tolist(),
    }
    for kind, us_of_steps in rows.items():
        f.reset()
        for y, u in zip(ys, us_of_steps, strict=True):
            f.step(y, u)
        np.testing.assert_allclose(f.x[:, 0], expected.x[-1], rtol=1e-12, err_msg=kind)
    with pytest.raises(ParameterError, match="us: got no column 'day'"):
        f.filter(ys, us=table[["heat"]])


def test_a_clock_input_that_is_missing_is_told_how_it_is_made():
    f = hard(k=2, names=["clock_sin1", "clock_workday"]).filter()
    ys, us = series_of(6, 1, 2)
    table = pd.DataFrame(us, columns=["clock_sin1", "clock_workday"])
    with pytest.raises(
        ParameterError, match=r"'clock_workday'; .*; clock_inputs\(index, workday=True, \.\.\.\)"
    ):
        f.filter(ys, us=table[["clock_sin1"]])


def test_inputs_called_by_number_go_by_name_where_there_are_such():
    f = hard(k=2, names=["u0", "u1"]).filter()
    ys, us = series_of(6, 1, 2)
    expected = f.filter(ys, us=us).x
    table = pd.DataFrame(us, columns=["u0", "u1"])
    np.testing.assert_array_equal(f.filter(ys, us=table[["u1", "u0"]]).x, expected)
    np.testing.assert_array_equal(f.filter(ys, us=table.set_axis(["a", "b"], axis=1)).x, expected)
    with pytest.raises(ParameterError, match="us: got no column 'u1'"):
        f.filter(ys, us=table.set_axis(["u0", "b"], axis=1))


def test_one_input_may_be_flat_or_a_number():
    f = hard().filter()
    ys, us = series_of(5)
    expected = f.filter(ys, us=us)
    np.testing.assert_array_equal(f.filter(ys[:, 0], us=us[:, 0]).x, expected.x)
    np.testing.assert_array_equal(f.filter_many(ys[None, :, 0], us=us[:, 0]).x[0], expected.x)
    f.reset()
    for y, u in zip(ys[:, 0].tolist(), us[:, 0].tolist(), strict=True):
        f.step(y, u)
    np.testing.assert_allclose(f.x[:, 0], expected.x[-1], rtol=1e-12)


def test_inputs_of_the_first_time_are_not_used():
    f = hard(k=2).filter()
    ys, us = series_of(5, 1, 2)
    expected, us[0] = f.filter(ys, us=us).x, NAN
    np.testing.assert_array_equal(f.filter(ys, us=us).x, expected)
    np.testing.assert_array_equal(f.filter_many(ys[None], us=us[None]).x[0], expected)
    np.testing.assert_allclose(f.filter(ys[:1]).x, expected[:1], rtol=1e-12)
    f.reset()
    f.step(ys[0])
    np.testing.assert_allclose(f.x[:, 0], expected[0], rtol=1e-12)
    assert f.filter(np.empty((0, 1)), us=np.empty((0, 2))).x.shape == (0, 1)


@pytest.mark.parametrize(
    ("u", "error", "words"),
    [
        (None, ParameterError, "u: missing; the model has the inputs in0, in1"),
        (1.0, ShapeError, r"u: got shape \(\), expected \(2,\)"),
        ([1.0, 2.0, 3.0], ShapeError, r"u: got shape \(3,\), expected \(2,\)"),
        ([[1.0, 2.0], [3.0, 4.0]], ShapeError, r"u: got shape \(2, 2\), expected \(2,\)"),
        ([NAN, 1.0], ParameterError, r"u: got \[nan, 1.0\], expected finite"),
        ("ab", ShapeError, "u: expected an array of numbers"),
        ({"in0": 1.0}, ParameterError, "u: got no column 'in1'"),
    ],
)
def test_inputs_of_a_step_that_are_no_good_leave_the_filter_as_it_was(u, error, words):
    f = hard(features_of("all", 1), k=2).filter()
    f.filter([0.3, NAN], us=np.ones((2, 2)))
    before = f.to_dict()
    for call in (partial(f.predict, u), partial(f.step, 0.5, u)):
        with pytest.raises(error, match=words):
            call()
        assert f.to_dict() == before
    f.predict([1.0, 2.0])
    before = f.to_dict()
    for call in (partial(f.predict, u), partial(f.step, 0.5, u)):
        with pytest.raises(error, match=words):
            call()
        assert f.to_dict() == before
    f.update(0.0)
    with pytest.raises(SequenceError):
        f.update(0.0)


@pytest.mark.parametrize(
    ("us", "error", "words"),
    [
        (None, ParameterError, "us: missing; the model has the inputs in0, in1"),
        (np.zeros((3, 2)), ShapeError, r"us: got shape \(3, 2\), expected \(2, 2\)"),
        (np.zeros((2, 3)), ShapeError, r"us: got shape \(2, 3\), expected \(2, 2\)"),
        ([[0.0, 0.0], [0.0, np.inf]], ParameterError, "us: row 1 is .* expected finite"),
    ],
)
def test_inputs_of_a_series_that_are_no_good_leave_the_filter_as_it_was(us, error, words):
    f = hard(k=2).filter()
    f.step(0.1)
    before = f.to_dict()
    calls = (f.filter, f.smooth, partial(f.smooth_lag, lag=1), partial(f.filter, resume=True))
    for call in calls:
        with pytest.raises(error, match=words):
            call([0.1, 0.2], us=us)
        assert f.to_dict() == before
    with pytest.raises(error, match=words):
        f.forecast(2, us=us)
    with pytest.raises(ParameterError, match="us"):
        f.filter_many([[0.1, 0.2]], us=us)
    assert f.to_dict() == before


def test_a_model_without_inputs_refuses_some():
    f = hard(LAGS, k=0, tilt=False).filter()
    for call in (
        partial(f.filter, [0.1, 0.2], us=[1.0, 2.0]),
        partial(f.smooth, [0.1, 0.2], us=[1.0, 2.0]),
        partial(f.forecast, 2, us=[1.0, 2.0]),
        partial(f.filter_many, [[0.1, 0.2]], us=[1.0, 2.0]),
        partial(f.predict, 1.0),
    ):
        with pytest.raises(ParameterError, match=r"got .*, but the model has no inputs; expected None"):
            call()


def test_a_filter_keeps_what_it_was_told_whatever_becomes_of_the_array():
    f = hard(LAGS, k=2).filter()
    ys, us = series_of(4, 1, 2)
    f.filter(ys, us=us)
    u = np.array([1.0, 2.0])
    f.predict(u)
    known = f.x_prior
    u[:], ys[:], us[:] = 9.0, 9.0, 9.0
    np.testing.assert_array_equal(f.x_prior, known)
    assert not np.shares_memory(f.copy()._onwards.u, u)


def test_inputs_that_are_far_off_move_the_switch_for_certain():
    # from regime 0 there is no way out: against the weight of regime 1 all else is zero in double precision
    given = form_of(PLAIN).to_dict()
    given.pop("kind", None)
    given.update(By=np.zeros((2, 2, 1, 1)), Bx=np.zeros((2, 2, 1, 1)), tilt=[[0.0], [1.0]])
    model = CGOMSModel._from_form([[1.0, 0.0], [0.3, 0.7]], InputForm(**given), [0.4, 0.6])
    ys, us = series_of(5)[0], np.full((5, 1), 1e6)
    filtered, smoothed, _ = enumerated(_Certain(model.placed(), us), ys)
    found = model.filter().filter(ys, us=us)
    np.testing.assert_allclose(found.x, filtered[0], atol=1e-11)
    np.testing.assert_allclose(found.mu, filtered[2], atol=1e-11)
    np.testing.assert_allclose(model.filter().smooth(ys, us=us).mu, smoothed[2], atol=1e-11)


class _Certain(Nodes):
    """Of a switch that stays where it is."""

    def log_move(self, i, j, n):
        return 0.0 if i == j else -np.inf


# ---------------------------------------------------------------- the contract


def test_filters_with_features_keep_the_contract():
    features, zs = features_of("hinges", 1), series_of(6)[0]
    assert len(check_filter(lambda: hard(features, k=0, tilt=False).filter(), zs).passed) > 25


def test_verbs_of_a_subclass_are_honoured():
    class Gated(type(hard().filter())):
        def update(self, z):
            super().update(None if abs(float(np.squeeze(z))) > 2.0 else z)

    model = hard(features_of("all", 1), k=1)
    ys, us = series_of(6)
    ys[2] = 50.0
    gone = ys.copy()
    gone[2] = NAN
    found, expected = Gated(model).filter(ys, us=us), model.filter().filter(gone, us=us)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-12)
    np.testing.assert_allclose(
        Gated(model).smooth(ys, us=us).x, model.filter().smooth(gone, us=us).x, atol=1e-11
    )

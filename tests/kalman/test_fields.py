"""Verbs, steps, series and many series of Kalman filters and banks agree in every field.

The oracle of one step is the textbook: gain, then covariance in the short form.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
from fuzzykf.kalman.series import BANK_FIELDS, FIELDS

#: Sizes of which the compiled engine has code of their own, and others.
SIZES = [(1, 1), (2, 1), (2, 2), (3, 1), (3, 3), (4, 1), (4, 2), (5, 4), (6, 2), (6, 3), (17, 2), (2, 17)]


def linear(n, m, seed=0, kind=KalmanFilter, **more):
    """A filter without a symmetric or diagonal matrix where none has to be."""
    rng = np.random.default_rng(seed + 100 * n + m)

    def positive(size):
        root = rng.normal(size=(size, size)) / np.sqrt(size)
        return root @ root.T + 0.3 * np.eye(size)

    F = 0.8 * rng.normal(size=(n, n)) / np.sqrt(n) + 0.2 * np.eye(n)
    f = kind(n, m, x=rng.normal(size=(n, 1)), P=positive(n), F=F, Q=positive(n), **more)
    f.H, f.R, f.alpha = rng.normal(size=(m, n)), positive(m), 1.1
    return f


def observe(n_steps, m, gaps, seed=1):
    z = np.random.default_rng(seed).normal(size=(n_steps, m)) * 2.0
    if gaps:
        z[2], z[5, 0], z[7, -1] = np.nan, np.nan, np.nan
    return z


def by_verbs(f, z, names):
    rows = []
    for one in z:
        f.predict()
        f.update(one)
        rows.append({name: np.array(getattr(f, name)) for name in names})
    return {name: np.array([row[name] for row in rows]) for name in names}


def assert_near(a, b, name):
    np.testing.assert_allclose(np.reshape(a, np.shape(b)), b, rtol=1e-8, atol=1e-10, err_msg=name)


def assert_four_ways_agree(make, z, names):
    verbs = by_verbs(make(), z, names)
    f = make()
    steps = []
    for one in z:
        np.testing.assert_array_equal(f.step(one), f.x)
        steps.append({name: np.array(getattr(f, name)) for name in names})
    whole = make().filter(z)
    many = make().filter_many(np.stack([z[::-1], z]), keep=names)
    for name in names:
        assert_near([step[name] for step in steps], verbs[name], name)
        assert_near(getattr(whole, name), verbs[name], name)
        assert_near(getattr(many, name)[1], verbs[name], name)
    return verbs, whole


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_four_ways_agree_in_every_field(n, m, gaps) -> None:
    assert_four_ways_agree(lambda: linear(n, m), observe(9, m, gaps), FIELDS)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_verbs_are_the_textbook(n, m, gaps) -> None:
    f, z = linear(n, m), observe(9, m, gaps)
    fields = by_verbs(f.copy(), z, FIELDS)
    x, P = f.x[:, 0], f.P
    for k, one in enumerate(z):
        x, P = f.F @ x, f.alpha**2 * f.F @ P @ f.F.T + f.Q
        assert_near(fields["x_prior"][k], x, "x_prior")
        assert_near(fields["P_prior"][k], P, "P_prior")
        seen = np.flatnonzero(~np.isnan(one))
        H, R = f.H[seen], f.R[np.ix_(seen, seen)]
        S = H @ P @ H.T + R
        expected = multivariate_normal(H @ x, S).logpdf(one[seen]) if seen.size else 0.0
        assert fields["log_likelihood"][k] == pytest.approx(expected, rel=1e-8)
        K = np.linalg.solve(S, H @ P).T
        x, P = x + K @ (one[seen] - H @ x), P - K @ H @ P
        assert_near(fields["x"][k], x, "x")
        assert_near(fields["P"][k], P, "P")


def test_the_innovation_is_written_in_every_part() -> None:
    f, z = linear(4, 2), observe(1, 2, False)[0]
    f.predict()
    x, P = f.x, f.P
    f.update(z)
    S = f.H @ P @ f.H.T + f.R
    K = P @ f.H.T @ np.linalg.inv(S)
    for name, value in {"y": z[:, None] - f.H @ x, "S": S, "SI": np.linalg.inv(S), "K": K}.items():
        np.testing.assert_allclose(getattr(f, name), value, rtol=1e-10, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("method", ["imm", "gpb2"])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (3, 2), (5, 3)])
def test_four_ways_of_a_bank_agree_in_every_field(method, n, m, gaps) -> None:
    def make():
        filters = [linear(n, m, seed) for seed in range(3)]
        M = [[0.9, 0.08, 0.02], [0.2, 0.7, 0.1], [0.05, 0.15, 0.8]]
        return IMMEstimator(filters, [0.5, 0.3, 0.2], M, method=method)

    verbs, whole = assert_four_ways_agree(make, observe(9, m, gaps), BANK_FIELDS)
    np.testing.assert_array_equal(whole.switch, verbs["mu"].argmax(axis=1))
    np.testing.assert_array_equal(whole.nodes, np.arange(3))


@pytest.mark.parametrize("gaps", [False, True])
def test_a_bank_is_left_as_its_steps_leave_it(gaps) -> None:
    # what is in the bank and in its members after a series, not only what the series returns
    def make():
        return IMMEstimator([linear(3, 2, seed) for seed in range(2)], [0.6, 0.4], [[0.9, 0.1], [0.3, 0.7]])

    z = observe(8, 2, gaps)
    f, g = make(), make()
    f.filter(z)
    for one in z:
        g.predict()
        g.update(one)
    for name in (*BANK_FIELDS, "x_post", "P_post", "likelihood", "mode_log_likelihood", "cbar", "omega"):
        assert_near(getattr(f, name), getattr(g, name), name)
    for a, b in zip(f.filters, g.filters, strict=True):
        for name in ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "y", "S", "SI", "K"):
            assert_near(getattr(a, name), getattr(b, name), name)


@pytest.mark.parametrize("gaps", [False, True])
def test_four_ways_of_an_extended_filter_agree_in_every_field(gaps) -> None:
    def make():
        return linear(2, 2, kind=ExtendedKalmanFilter, fx=bend, hx=look)

    def bend(x):
        return np.array([x[0] + 0.1 * np.sin(x[1]), 0.9 * x[1]])

    def look(x):
        return np.array([x[0] ** 2 / 5.0 + x[1], x[1]])

    z = observe(9, 2, gaps)
    f = make()
    verbs = by_verbs(make(), z, FIELDS)
    whole = f.filter(z)
    many = make().filter_many(np.stack([z[::-1], z]), keep=FIELDS)
    for name in FIELDS:
        assert_near(getattr(whole, name), verbs[name], name)
        assert_near(getattr(many, name)[1], verbs[name], name)

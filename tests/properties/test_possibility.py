"""Properties of the fuzzy estimator that hold for any model."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import (
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    TriangularMembership,
)
from fuzzykf.errors import SupportWarning
from fuzzykf.possibility import closed_form

number = st.floats(-2.0, 2.0)
positive = st.floats(0.05, 3.0)
seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(1, 4), st.integers(1, 3), st.sampled_from(["", "F", "Q", "P", "FQP"]))
@settings(max_examples=25, deadline=None)
def test_gaussian_case_is_the_kalman_filter(seed, n, q, singular):
    rng = np.random.default_rng(seed)
    F, H = 0.8 * rng.normal(size=(n, n)), rng.normal(size=(q, n))
    roots = [rng.normal(size=(k, k)) for k in (n, n, q)]
    P, Q, R = (r @ r.T + 0.1 * np.eye(len(r)) for r in roots)
    F[-1] *= "F" not in singular
    Q = Q * ("Q" not in singular)
    P = P * ("P" not in singular)
    est, kf = FuzzyRelationEstimator(n, q), KalmanFilter(dim_x=n, dim_z=q)
    for f in (est, kf):
        f.F, f.H, f.P, f.Q, f.R = F, H, P, Q, R
    for z in rng.normal(size=(5, q)):
        for f in (est, kf):
            f.predict()
            f.update(z)
        np.testing.assert_allclose(est.x, kf.x, atol=1e-10)
        np.testing.assert_allclose(est.P, kf.P, atol=1e-10)


@given(seeds, st.integers(1, 4), st.integers(1, 3), st.sampled_from(["", "F"]))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_gaussian_case_is_the_smoother_of_filterpy(seed, n, q, singular):
    rng = np.random.default_rng(seed)
    F, H = 0.8 * rng.normal(size=(n, n)), rng.normal(size=(q, n))
    roots = [rng.normal(size=(k, k)) for k in (n, n, q)]
    P, Q, R = (r @ r.T + 0.1 * np.eye(len(r)) for r in roots)
    F[-1] *= "F" not in singular
    est, kf = FuzzyRelationEstimator(n, q), KalmanFilter(dim_x=n, dim_z=q)
    for f in (est, kf):
        f.F, f.H, f.P, f.Q, f.R = F, H, P, Q, R
    zs = list(rng.normal(size=(6, q)))
    zs[2] = None
    means, covariances = np.empty((6, n, 1)), np.empty((6, n, n))
    for k, z in enumerate(zs):
        kf.predict()
        kf.update(z)
        means[k], covariances[k] = kf.x, kf.P
    x, P, _, _ = kf.rts_smoother(means, covariances)
    smoothed = est.smooth(zs)
    np.testing.assert_allclose(smoothed.x, x[..., 0], atol=1e-10)
    np.testing.assert_allclose(smoothed.P, P, atol=1e-10)


@given(seeds, st.sampled_from(["gaussian", "cauchy", "parabolic"]))
@settings(max_examples=25, deadline=None)
def test_updates_never_widen_but_for_surprise(seed, family):
    # P+ is at most P times the factor of the surprise, and the possibility is in [0, 1]
    rng = np.random.default_rng(seed)
    root, H = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    P = root @ root.T + 0.01 * np.eye(3)
    found = closed_form.condition(np.zeros(3), P, 0.3 * rng.normal(size=2), H, 0.5 * np.eye(2), family)
    assert 0.0 <= closed_form.possibility(found.surprise, family) <= 1.0
    if found.P is not None:
        factor = {"gaussian": 1.0, "cauchy": 1.0 + found.surprise, "parabolic": 1.0}[family]
        assert np.linalg.eigvalsh(factor * P - found.P)[0] > -1e-9
        assert np.linalg.eigvalsh(found.P)[0] > -1e-9


@given(seeds, number, positive, positive, st.sampled_from([0.5, 1.0, -1.3]))
@settings(max_examples=15, deadline=None)
def test_intervals_contain_the_truth(seed, start, w, v, slope):
    rng = np.random.default_rng(seed)
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: slope * x + 0.1 * np.tanh(slope * x),
        hx=lambda x: x + x**3,
        state=IntervalMembership(start - 0.5, start + 0.5),
        process_noise=IntervalMembership(-w, w),
        measurement_noise=IntervalMembership(-v, v),
    )
    truth = start + rng.uniform(-0.5, 0.5)
    for _ in range(8):
        truth = slope * truth + 0.1 * np.tanh(slope * truth) + rng.uniform(-w, w)
        est.step(truth + truth**3 + rng.uniform(-v, v))
        assert est.lower[0] <= truth <= est.upper[0]
        assert est.possibility == 1.0


@given(number, positive, positive, positive, st.floats(0.3, 2.0), st.lists(number, min_size=1, max_size=4))
@settings(max_examples=15, deadline=None)
def test_moving_grid_is_the_kalman_filter(start, p, q, r, slope, zs):
    # any linear scalar model, any ratio of the variances
    given_ = {
        "state": GaussianMembership(start, p),
        "process_noise": GaussianMembership(0.0, q),
        "measurement_noise": GaussianMembership(0.0, r),
    }
    est = FuzzyRelationEstimator(1, 1, fx=lambda x: slope * x, hx=lambda x: x, points=81, **given_)
    kf = FuzzyRelationEstimator(1, 1, **given_)
    kf.F, kf.H = np.array([[slope]]), np.eye(1)
    for z in zs:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SupportWarning)  # outliers may extend the grid
            est.step(z)
        kf.step(z)
        sigma = np.sqrt(kf.P.item())
        assert abs(est.x.item() - kf.x.item()) < 1e-4 * sigma
        assert abs(est.P.item() - kf.P.item()) < 1e-3 * kf.P.item()
        assert est.possibility == pytest.approx(kf.possibility, abs=1e-6)


@given(number, number, st.sampled_from(["product", "min", "lukasiewicz", "hamacher"]))
@settings(max_examples=15, deadline=None)
def test_shifting_the_problem_shifts_the_answer(center, z, t_norm):
    def run(offset):
        est = FuzzyRelationEstimator(
            1,
            1,
            fx=lambda x: offset + np.sin(x - offset),
            hx=lambda x: x,
            state=TriangularMembership(offset + center - 3.0, offset + center, offset + center + 2.0),
            process_noise=TriangularMembership(-1.0, 0.0, 1.0),
            measurement_noise=TriangularMembership(-4.0, 0.0, 4.0),
            t_norm=t_norm,
            on_empty="keep",
        )
        est.step(offset + z)
        return est.x.item() - offset, est.P.item(), est.possibility

    np.testing.assert_allclose(run(0.0), run(64.0), atol=1e-4)  # a hundredth of a cell

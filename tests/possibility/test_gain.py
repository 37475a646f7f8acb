"""Residual, gain and likelihood of an update in closed form are those of the Kalman filter."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from fuzzykf import FuzzyRelationEstimator, KalmanFilter

MODEL = {"F": [[1.0, 1.0], [0.0, 1.0]], "H": np.eye(2), "Q": 0.1 * np.eye(2), "R": [[0.5, 0.2], [0.2, 0.7]]}


def after(z, **options):
    est = FuzzyRelationEstimator(2, 2, **MODEL, **options)
    est.step(z)
    return est


@pytest.mark.parametrize("t_norm", ["product", "hamacher", "lukasiewicz"])
def test_an_update_shows_what_a_kalman_filter_shows(t_norm) -> None:
    est, kf = after([0.3, -0.2], t_norm=t_norm), KalmanFilter(2, 2, **MODEL)
    kf.step([0.3, -0.2])
    for name in ("y", "S", "SI", "K"):
        np.testing.assert_allclose(getattr(est, name), getattr(kf, name), rtol=1e-12, atol=1e-15)
    if t_norm == "product":
        assert est.log_likelihood == pytest.approx(kf.log_likelihood, rel=1e-12)
        assert est.likelihood == pytest.approx(np.exp(kf.log_likelihood), rel=1e-12)
        assert est.mahalanobis == pytest.approx(kf.mahalanobis, rel=1e-12)
    else:  # no density
        assert not hasattr(est, "log_likelihood")


def test_what_is_missing_has_neither_residual_nor_gain() -> None:
    est, one = after([0.3, None]), FuzzyRelationEstimator(2, 1, **MODEL | {"H": [[1.0, 0.0]], "R": 0.5})
    one.step(0.3)
    np.testing.assert_allclose(est.y.ravel(), [*one.y.ravel(), 0.0])
    np.testing.assert_allclose(est.K, np.column_stack([one.K, np.zeros(2)]), rtol=1e-12)
    assert est.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-12)
    est.update(None)
    assert not est.y.any()
    assert not est.K.any()
    assert not est.S.any()
    assert (est.log_likelihood, est.likelihood, est.mahalanobis) == (0.0, 1.0, 0.0)


def test_a_likelihood_that_no_float_can_hold_is_the_smallest_one() -> None:
    est = after([300.0, 0.0])
    assert est.log_likelihood < -1000.0
    assert est.likelihood == sys.float_info.min

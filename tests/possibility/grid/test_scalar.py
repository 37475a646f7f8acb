"""Scalar states on a grid: folds, edges and the minimum, against suprema over many more states."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    TriangularMembership,
)
from fuzzykf.errors import ParameterError, SupportLostError, SupportWarning

NOISES = {
    "gauss": GaussianMembership(0.0, 0.05),
    "cauchy": CauchyMembership(0.0, 0.22),
    "triangle": TriangularMembership(-0.4, 0.0, 0.6),
    "cut": CauchyMembership(0.0, 0.3).cut(0.5),
}


def fold(x):
    return x**2 / 4 - 1


def estimator(noise, t_norm="product", fx=fold, **options):
    options = {"points": 401, "domain": ((-8.0, 8.0),), **options}
    return FuzzyRelationEstimator(
        1,
        1,
        fx=fx,
        hx=lambda x: x,
        state=GaussianMembership(0.5, 1.0),
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 0.1),
        t_norm=t_norm,
        **options,
    )


@pytest.mark.parametrize("t_norm", ["product", "min", "lukasiewicz", "hamacher"])
@pytest.mark.parametrize("noise", NOISES)
def test_a_fold_is_a_point_like_any_other(noise, t_norm):
    est = estimator(NOISES[noise], t_norm)
    est.predict()
    x = np.linspace(-8.0, 8.0, 20_001)
    state, image = GaussianMembership(0.5, 1.0)(x), fold(x)
    places = est.membership.axes[0]
    exact = np.array([est.t_norm(state, NOISES[noise](place - image)).max() for place in places])
    off = np.abs(est.membership.values - exact / exact.max())
    # (a jump at the edge of the noise is known to a fraction of a cell)
    assert off.max() < (0.02 if noise == "cut" else 2e-3)


def test_a_fold_keeps_the_centroid_of_a_moving_grid():
    est = estimator(NOISES["gauss"], points=401, domain=None)
    est.predict()
    x, places = np.linspace(-6.0, 7.0, 20_001), np.linspace(-2.5, 12.0, 1001)
    state, image = GaussianMembership(0.5, 1.0)(x), fold(x)
    exact = np.array([(state * NOISES["gauss"](place - image)).max() for place in places])
    assert est.x.item() == pytest.approx((exact * places).sum() / exact.sum(), abs=1e-3)


def test_states_without_an_image_are_left_out_or_refused():
    def root(x):
        with np.errstate(invalid="ignore"):
            return np.sqrt(x)

    with pytest.raises(ParameterError, match=r"fx: returned \[nan\]"):
        estimator(NOISES["gauss"], fx=root).predict()
    # a universe of positive states: what the noise carries out of it is told
    est = estimator(NOISES["triangle"], fx=root, domain=((0.0, 8.0),))
    with pytest.warns(SupportWarning, match="domain: states of membership up to"):
        est.predict()
    x = np.linspace(0.0, 8.0, 20_001)
    state = GaussianMembership(0.5, 1.0)(x)
    exact = np.array([(state * NOISES["triangle"](p - np.sqrt(x))).max() for p in est.membership.axes[0]])
    np.testing.assert_allclose(est.membership.values, exact / exact.max(), atol=0.02)


def test_all_images_outside_the_domain_are_an_error():
    with pytest.raises(SupportLostError, match="domain: all possible states have left"):
        estimator(NOISES["gauss"], fx=lambda x: x + 30.0).predict()


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("points", [41, 161])
def test_level_sets_add_under_the_minimum(linear, points):
    # [m - s(a), m + s(a)] and the noise [-w(a), w(a)] of a level a give [m - s - w, m + s + w]
    est = estimator(
        TriangularMembership(-0.8, 0.0, 0.8),
        "min",
        fx=None if linear else lambda x: x,
        points=points,
        domain=((-5.5, 6.5),),
    )
    est.predict()

    def width(level):
        return np.sqrt(-2.0 * np.log(level)) + 0.8 * (1.0 - level)

    step = 12.0 / (points - 1)
    for place, value in zip(est.membership.axes[0], est.membership.values, strict=True):
        distance = abs(place - 0.5)
        if 0.0 < distance < width(1e-6):
            exact = brentq(lambda level, d: width(level) - d, 1e-9, 1.0, args=(distance,))
            # costs x^2/2 are taken as linear between the nodes
            assert value == pytest.approx(exact, abs=step**2 / 8.0)


@pytest.mark.parametrize("points", [41, 101])
def test_the_peak_under_the_minimum_lies_where_prior_and_measurement_meet(points):
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x,
        hx=lambda x: x,
        state=GaussianMembership(0.0, 1.0),
        measurement_noise=TriangularMembership(-1.5, 0.0, 1.5),
        t_norm="min",
        points=points,
    )
    est.update(1.0)
    meeting = brentq(lambda x: np.exp(-0.5 * x * x) - (1.0 - (1.0 - x) / 1.5), 0.0, 1.0)
    assert est.possibility == pytest.approx(np.exp(-0.5 * meeting**2), abs=2e-3)

"""The exact gradient of the likelihood of a linear filter, against differences of what the filter tells."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import KalmanFilter
from fuzzykf.kalman.learning.score import log_likelihood, score
from fuzzykf.kalman.linear_series import model_of

RNG = np.random.default_rng(3)
F = np.array([[0.9, 0.2], [-0.1, 0.8]])
H = np.array([[1.0, 0.3], [0.2, -0.5], [0.0, 1.0]])
Q = np.array([[0.5, 0.1], [0.1, 0.3]])
R = np.array([[0.7, 0.2, 0.0], [0.2, 0.9, -0.1], [0.0, -0.1, 0.4]])


def model(**arrays):
    given = {"x": [0.4, -0.3], "P": [[1.0, 0.2], [0.2, 0.8]], "F": F, "H": H, "Q": Q, "R": R, **arrays}
    m = len(np.asarray(given["H"]))
    return model_of(KalmanFilter(2, m, **given))


def series(shape, *gaps):
    """Return series (series, n, m) with gaps at these indexes."""
    zs = RNG.normal(size=shape)
    for gap in gaps:
        zs[gap] = np.nan
    return zs


ONE = (1, 25, 3)
CASES = {
    "complete": (model(), series(ONE), None),
    "several series": (model(), series((4, 12, 3)), None),
    "gaps": (model(), series(ONE, np.s_[0, 3:6], np.s_[0, 9]), None),
    "gaps at both ends": (model(), series(ONE, np.s_[0, :2], np.s_[0, -3:]), None),
    "parts of observations": (model(), series(ONE, np.s_[0, ::2, 1], np.s_[0, 4:8, 0], np.s_[0, 4, 2]), None),
    "unequal lengths": (model(), series((3, 12, 3), np.s_[0, 5:], np.s_[2, 1:]), None),
    "controls": (model(), series((2, 15, 3)), RNG.normal(size=(2, 15, 2))),
    "controls of all": (model(), series((2, 15, 3)), RNG.normal(size=(1, 15, 2))),
    "singular Q": (model(Q=[[0.25, 0.5], [0.5, 1.0]]), series(ONE, np.s_[0, 7:9]), None),
    "no Q": (model(Q=np.zeros((2, 2))), series(ONE), None),
    "P is zero": (model(P=np.zeros((2, 2))), series(ONE), None),
    "no noise in one component": (model(R=np.diag([0.0, 0.9, 0.4])), series(ONE, np.s_[0, 5, 0]), None),
    "one observed": (model(H=[[1.0, 0.0]], R=[[0.6]]), series((1, 30, 1), np.s_[0, 8:11]), None),
    "one step": (model(), series((1, 1, 3)), None),
    "two steps": (model(), series((1, 2, 3)), None),
    "three steps": (model(), series((2, 3, 3)), None),
    "ten steps": (model(), series((1, 10, 3)), None),
    "unstable": (model(F=[[1.05, 1.0], [0.0, 1.0]]), series(ONE), None),
    "nothing of one series": (model(), series((2, 6, 3), np.s_[0]), None),
}


@pytest.mark.parametrize("name", CASES)
def test_the_log_likelihood_is_that_of_the_filter(name) -> None:
    known, zs, terms = CASES[name]
    value, _ = log_likelihood(known, zs, terms)
    total = 0.0
    for k, one in enumerate(zs):
        kf = KalmanFilter(2, zs.shape[2], B=np.eye(2), **{key: getattr(known, key) for key in "xPFQHR"})
        us = None if terms is None else terms[k if len(terms) > 1 else 0]
        total += kf.filter(one, us).log_likelihood.sum()
    assert value == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_the_gradient_is_that_of_differences(name) -> None:
    known, zs, terms = CASES[name]
    _, stored = log_likelihood(known, zs, terms)
    found = score(known, zs, stored)
    for key in "xPFQHR":
        held = getattr(known, key).reshape(getattr(found, key).shape)
        expected = np.zeros(held.shape)
        for where in np.ndindex(held.shape):
            way = np.zeros(held.shape)
            way[where] = 1.0
            if key in "PQR":
                way = 0.5 * (way + way.T)

            def at(size, key=key, held=held, way=way):
                return log_likelihood(known._replace(**{key: held + size * way}), zs, terms)[0]

            h = 1e-3
            small, large = (at(h) - at(-h)) / (2 * h), (at(2 * h) - at(-2 * h)) / (4 * h)
            smaller = (at(h / 2) - at(-h / 2)) / h
            # Richardson's extrapolation: the error is of the sixth order
            expected[where] = (64 * smaller - 20 * small + large) / 45
        scale = max(np.abs(expected).max(), 1.0)
        np.testing.assert_allclose(getattr(found, key), expected, rtol=0.0, atol=1e-6 * scale, err_msg=key)


def test_the_gradient_by_the_terms_of_controls() -> None:
    known, zs, terms = CASES["controls"]
    found = score(known, zs, log_likelihood(known, zs, terms)[1]).terms
    for where in [(0, 0, 0), (1, 3, 1), (1, 14, 0)]:
        way = np.zeros(terms.shape)
        way[where] = 1e-4
        slope = (log_likelihood(known, zs, terms + way)[0] - log_likelihood(known, zs, terms - way)[0]) / 2e-4
        assert found[where] == pytest.approx(slope, rel=1e-6)

"""The way back in the scale of reciprocals: its definition on a dense universe, also where costs are huge."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    TriangularMembership,
)
from fuzzykf.errors import SupportWarning


def smoothed_centroids(universe, zs, f, state, noise, error):
    """Centroids by the definition, with all pairs of a dense universe."""

    def costs(membership, points):
        with np.errstate(divide="ignore", over="ignore"):
            return 1.0 / membership(points[..., None]) - 1.0

    step, known = costs(noise, universe - f(universe)[:, None]), costs(state, universe)
    filtered, predicted = [], []
    for z in zs:
        known = (known[:, None] + step).min(axis=0)
        predicted.append(known)
        if z is not None:
            known = known + costs(error, z - universe)
            known = (known - known.min()) / (1.0 + known.min())
        filtered.append(known)
    gamma, found = filtered[-1], []
    for n in range(len(zs) - 1, -1, -1):
        if n < len(zs) - 1:
            # gamma + (c + c_W - c'), which is not negative
            slack = filtered[n][:, None] + step - np.where(np.isfinite(gamma), predicted[n + 1], 0.0)
            gamma = (gamma + slack).min(axis=1)
        mass = 1.0 / (1.0 + np.maximum(gamma, 0.0))
        found.append(float(mass @ universe / mass.sum()))
    return np.array(found[::-1])


GAUSS, CAUCHY, TRIANGLE = (
    GaussianMembership(0.3, 1.0),
    CauchyMembership(0.3, 1.0),
    TriangularMembership(-0.6, 0.0, 0.4),
)
CASES = {
    "steep noise": (CAUCHY, TRIANGLE, GaussianMembership(0.0, 0.3), [0.8, None, 1.0]),
    "an outlier": (
        GAUSS,
        GaussianMembership(0.0, 0.114),
        CauchyMembership(0.0, 0.19),
        [-0.2, 1.2, 1.8, None, 1.0],
    ),
    "crisp noise": (
        GAUSS,
        IntervalMembership(-0.3, 0.3),
        GaussianMembership(0.0, 0.3),
        [0.8, None, 1.0, 0.5],
    ),
}


@pytest.mark.parametrize("domain", [None, [(-6.0, 6.0)]])
@pytest.mark.parametrize("name", CASES)
def test_it_is_the_definition_also_where_costs_are_huge(name, domain) -> None:
    state, noise, error, zs = CASES[name]
    if domain is None and state is CAUCHY:
        state = GAUSS  # has a floor
    edge = 6.0 if domain else 18.0
    universe = np.linspace(-edge, edge, 801 if domain else 1201)

    def bent(x):
        return x + 0.4 * np.sin(x)

    est = FuzzyRelationEstimator(
        1,
        1,
        fx=bent,
        H=1.0,
        state=state,
        process_noise=noise,
        measurement_noise=error,
        t_norm="hamacher",
        points=201,
        domain=domain,
    )
    expected = smoothed_centroids(universe, zs, bent, state, noise, error)
    np.testing.assert_allclose(est.smooth(zs).x[:, 0], expected, atol=0.015)


def test_without_noise_each_state_has_one_image() -> None:
    est = FuzzyRelationEstimator(
        1,
        1,
        F=0.9,
        H=1.0,
        state=GAUSS,
        measurement_noise=GaussianMembership(0.0, 0.3),
        t_norm="hamacher",
        points=201,
    )
    found = est.smooth([1.0, None, 0.2]).x[:, 0]
    np.testing.assert_allclose(found[1:], 0.9 * found[:-1], atol=1e-3)


def test_more_dimensions_tell_where_costs_have_lost_their_digits() -> None:
    est = FuzzyRelationEstimator(
        2,
        1,
        F=[[1.0, 1.0], [0.0, 1.0]],
        H=[[1.0, 0.0]],
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=[None, GaussianMembership(0.0, 0.05)],
        measurement_noise=CauchyMembership(0.0, 0.3),
        t_norm="hamacher",
        points=31,
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SupportWarning)
        est.smooth([0.1, 0.2, 4.0, 0.1])
    assert any("smooth: measurements that hardly agree" in str(one.message) for one in caught)

"""A constraint on a grid is the definition, evaluated on a dense universe; a truth in a box stays in it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    ParabolicMembership,
)
from tests.possibility.conftest import T_NORMS

STATE, PROCESS, MEASUREMENT = (0.3, 1.0), (0.0, 0.6), (0.0, 0.8)
ZS = [0.5, 0.8, None, 0.1, 0.9, 0.2]
SHAPES = {
    "product": GaussianMembership,
    "min": GaussianMembership,
    "hamacher": lambda center, square: CauchyMembership(center, np.sqrt(square)),
    "lukasiewicz": lambda center, square: ParabolicMembership(center, 3.0 * np.sqrt(square)),
}


def move(x):
    return 0.9 * x - 0.3


def crisp(lower, upper):
    return lambda x: ((x >= lower - 1e-9) & (x <= upper + 1e-9)).astype(float)


def moments(x, mu):
    """Centroid and spread by the trapezoidal rule over the nodes that are possible."""
    there = np.flatnonzero(mu > 0.0)
    x, mu = x[there], mu[there].copy()
    mu[[0, -1]] *= 0.5
    mean = (x * mu).sum() / mu.sum()
    return mean, ((x - mean) ** 2 * mu).sum() / mu.sum()


def by_definition(shape, t_norm, constraint, low=-9.0, high=9.0, n=901):
    """Rows of centroid, spread and possibility: conjunction after each prediction."""
    T, x = T_NORMS[t_norm], np.linspace(low, high, n)
    c, noise = constraint(x), shape(*PROCESS)(x[:, None] - move(x))
    mu = T(shape(*STATE)(x), c)
    mu, rows = mu / mu.max(), []
    for z in ZS:
        mu = T(T(noise, mu).max(axis=1), c)
        mu, possibility = mu / mu.max(), 1.0
        if z is not None:
            mu = T(mu, shape(*MEASUREMENT)(z - x))
            possibility = mu.max()
            mu = mu / possibility
        rows.append((*moments(x, mu), possibility))
    return np.array(rows)


def estimator(shape, t_norm, constraint, **options):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=move,
        hx=lambda x: x,
        state=shape(*STATE),
        process_noise=shape(*PROCESS),
        measurement_noise=shape(*MEASUREMENT),
        t_norm=t_norm,
        constraint=constraint,
        **options,
    )


@pytest.mark.parametrize("t_norm", SHAPES)
@pytest.mark.parametrize("bounds", [(0.0, np.inf), (0.0, 0.7)], ids=["half-open", "box"])
def test_a_box_is_the_definition(t_norm, bounds) -> None:
    domain = [(-9.0, 9.0)] if t_norm == "hamacher" else None  # spread of an uncut Cauchy depends on its end
    est = estimator(SHAPES[t_norm], t_norm, bounds, points=401 if domain is None else 901, domain=domain)
    found = est.filter(ZS)
    expected = by_definition(SHAPES[t_norm], t_norm, crisp(*bounds))
    # A domain ends the box at a node, and counts half a cell beyond; minima meet between the nodes of either.
    tolerance = {"min": 4e-3, "hamacher": 1.5e-2}.get(t_norm, 2e-3)
    np.testing.assert_allclose(found.x[:, 0], expected[:, 0], atol=tolerance)
    np.testing.assert_allclose(found.P[:, 0, 0], expected[:, 1], atol=tolerance)
    # Under the minimum memberships meet between the nodes of the universe.
    np.testing.assert_allclose(found.possibility, expected[:, 2], atol=1e-2 if t_norm == "min" else 4e-3)
    assert found.lower.min() >= bounds[0]
    assert found.upper.max() <= bounds[1]


def test_a_membership_is_the_definition() -> None:
    constraint = CauchyMembership(0.5, 0.4)
    found = estimator(GaussianMembership, "product", constraint, points=401).filter(ZS)
    expected = by_definition(GaussianMembership, "product", constraint)
    np.testing.assert_allclose(found.x[:, 0], expected[:, 0], atol=1e-4)
    np.testing.assert_allclose(found.P[:, 0, 0], expected[:, 1], atol=1e-4)
    np.testing.assert_allclose(found.possibility, expected[:, 2], atol=1e-3)


def smoothed_by_definition(constraint, low=-9.0, high=9.0, n=901):
    """Minima of the cost of whole trajectories that end at each state, of Gaussian memberships."""
    x = np.linspace(low, high, n)
    with np.errstate(divide="ignore"):
        c = -np.log(constraint(x))
    noise = GaussianMembership(*PROCESS).negative_log((x[:, None] - move(x))[..., None])
    seen = [
        c + (0.0 if z is None else GaussianMembership(*MEASUREMENT).negative_log(z - x[:, None])) for z in ZS
    ]
    before = [(noise + GaussianMembership(*STATE).negative_log(x[:, None]) + c).min(axis=1) + seen[0]]
    after = [np.zeros(n)]
    for k in range(1, len(ZS)):
        before.append((noise + before[-1]).min(axis=1) + seen[k])
        after.insert(0, (noise + (after[0] + seen[-k])[:, None]).min(axis=0))
    costs = [one + other for one, other in zip(before, after, strict=True)]
    return np.array([moments(x, np.exp(cost.min() - cost)) for cost in costs])


@pytest.mark.parametrize(
    ("constraint", "function"),
    [
        ((0.0, np.inf), crisp(0.0, np.inf)),
        ((0.0, 0.7), crisp(0.0, 0.7)),
        (GaussianMembership(0.5, 0.4), GaussianMembership(0.5, 0.4)),
    ],
    ids=["half-open", "box", "graded"],
)
def test_the_smoother_is_the_cheapest_trajectory(constraint, function) -> None:
    found = estimator(GaussianMembership, "product", constraint, points=401).smooth(ZS)
    expected = smoothed_by_definition(function)
    np.testing.assert_allclose(found.x[:, 0], expected[:, 0], atol=1e-4)
    np.testing.assert_allclose(found.P[:, 0, 0], expected[:, 1], atol=1e-4)


def test_a_tail_is_extended_to_the_constraint() -> None:
    # Six standard deviations are kept, of which the box leaves one: the mean of what is beyond five is known.
    est = FuzzyRelationEstimator(
        1,
        1,
        state=GaussianMembership(0.0, 1.0),
        process_noise=GaussianMembership(0.0, 1e-6),
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=401,
        H=1.0,
    )
    with pytest.warns(UserWarning, match="constraint: it lies beyond the states that the grid kept"):
        est.constraint = (5.0, np.inf)
    assert est.x.item() == pytest.approx(np.exp(-12.5) / np.sqrt(2.0 * np.pi) / ndtr(-5.0), abs=1e-4)
    assert est.lower.item() == 5.0


@pytest.mark.parametrize("crisp_noise", [False, True])
def test_two_components_of_which_one_has_a_bound(crisp_noise) -> None:
    # A tank that cannot be less than empty: the level is bounded, its rate is not; the truth stays inside.
    rng = np.random.default_rng(3)
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    if crisp_noise:
        state = IntervalMembership([0.5, -0.3], [1.5, 0.3])
        process, error = IntervalMembership([0.0, -0.05], [0.0, 0.05]), IntervalMembership(-0.2, 0.2)
        options = {}
    else:
        state = GaussianMembership([1.0, 0.0], np.diag([0.1, 0.05]))
        process = GaussianMembership([0.0, 0.0], np.diag([1e-4, 1e-3]))
        error, options = GaussianMembership(0.0, 0.01), {"points": 41}
    est = FuzzyRelationEstimator(
        2,
        1,
        F=F,
        H=[[1.0, 0.0]],
        state=state,
        process_noise=process,
        measurement_noise=error,
        constraint=([0.0, -np.inf], np.inf),
        **options,
    )
    x, truth, zs = np.array([1.0, -0.1]), [], []
    for _ in range(12):
        rate = max(x[1] + rng.uniform(-0.05, 0.05), -x[0])
        x = np.array([x[0] + x[1], rate])
        if x[0] + rate < 0.0:
            x[1] = -x[0]
        truth.append(x)
        zs.append(x[0] + rng.uniform(-0.2, 0.2))
    free = est.copy()
    free.constraint = None
    found, without = est.smooth(zs), free.smooth(zs)
    assert found.lower[:, 0].min() >= 0.0 > without.lower[:, 0].min()
    assert ((found.lower <= np.array(truth) + 1e-12) & (np.array(truth) <= found.upper + 1e-12)).all()
    assert np.isfinite(found.x).all()
    assert (found.x[:, 0] >= 0.0).all()

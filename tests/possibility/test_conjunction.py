"""A constraint on closed families and boxes, what it leaves, and what is done if that is nothing."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    KalmanFilter,
    ParabolicMembership,
    TriangularMembership,
)
from fuzzykf.errors import EmptyIntersectionError, ParameterError, ShapeError
from fuzzykf.possibility.memberships import BoxMembership

ZS = [0.5, -0.8, None, -1.0, 0.9, 0.1]


def kalman_with_pseudo_measurement(zs):
    """A Gaussian constraint is a measurement of x at each instant, so that it can be a second row of H."""
    kf = KalmanFilter(1, 2, F=[[0.9]], H=[[1.0], [1.0]], Q=0.6, R=np.diag([0.8, 0.4]), x=[0.3], P=1.0)
    kf.update([np.nan, 0.5])  # the start satisfies it, too
    return kf, [[np.nan if z is None else z, 0.5] for z in zs]


def gaussian(**options):
    return FuzzyRelationEstimator(
        1, 1, x=[0.3], P=1.0, F=0.9, H=1.0, Q=0.6, R=0.8, constraint=GaussianMembership(0.5, 0.4), **options
    )


@pytest.mark.parametrize("verb", ["filter", "smooth"])
def test_a_gaussian_constraint_is_a_measurement_at_each_instant(verb) -> None:
    kf, zs = kalman_with_pseudo_measurement(ZS)
    found, expected = getattr(gaussian(), verb)(ZS), getattr(kf, verb)(zs)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-12)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-12)


@pytest.mark.parametrize(
    ("t_norm", "shape"), [("hamacher", CauchyMembership), ("lukasiewicz", ParabolicMembership)]
)
@pytest.mark.parametrize("verb", ["filter", "smooth"])
def test_closed_families_keep_their_own_shape(t_norm, shape, verb) -> None:
    # A grid does the same by other means, up to where it ends.
    def made(**options):
        return FuzzyRelationEstimator(
            1,
            1,
            F=0.9,
            H=1.0,
            t_norm=t_norm,
            state=shape(0.3, 1.0),
            process_noise=shape(0.0, 0.8),
            measurement_noise=shape(0.0, 2.0),
            constraint=shape(0.5, 1.5),
            **options,
        )

    closed, grid = getattr(made(), verb)(ZS), getattr(made(points=801, floor=1e-3), verb)(ZS)
    assert made().representation == shape.family
    np.testing.assert_allclose(grid.possibility, closed.possibility, atol=1e-6)
    # The centroid of a Cauchy membership depends a little on where the grid ends.
    np.testing.assert_allclose(grid.x, closed.x, atol=5e-3 if t_norm == "hamacher" else 1e-3)


def test_boxes_stay_within_and_keep_every_trajectory() -> None:
    rng = np.random.default_rng(0)

    def made(constraint=None):
        return FuzzyRelationEstimator(
            1,
            1,
            F=1.1,
            H=1.0,
            state=IntervalMembership(0.0, 1.0),
            process_noise=IntervalMembership(-0.5, 0.3),
            measurement_noise=IntervalMembership(-0.6, 0.6),
            constraint=constraint,
        )

    zs = [0.2, 0.5, -0.3, 0.1]
    found = made((0.0, 0.8)).smooth(zs)
    # All trajectories of many points that satisfy everything: their extremes are the bounds, nearly.
    x = rng.uniform(0.0, 0.8, (400_000, 1))
    path, alive = [], np.ones(len(x), dtype=bool)
    for z in zs:
        x = 1.1 * x + rng.uniform(-0.5, 0.3, x.shape)
        path.append(x[:, 0])
        alive &= (x[:, 0] >= 0.0) & (x[:, 0] <= 0.8) & (np.abs(z - x[:, 0]) <= 0.6)
    kept = np.array(path)[:, alive]
    assert kept.shape[1] > 1000
    assert (found.lower[:, 0] <= kept.min(axis=1)).all()
    assert (found.upper[:, 0] >= kept.max(axis=1)).all()
    np.testing.assert_allclose(found.lower[:, 0], kept.min(axis=1), atol=0.03)
    np.testing.assert_allclose(found.upper[:, 0], kept.max(axis=1), atol=0.03)
    free = made().smooth(zs)
    assert (free.upper - free.lower).sum() > (found.upper - found.lower).sum()


# ------------------------------------------------------------------ nothing is left


def falling(on_empty, constraint, points):
    return FuzzyRelationEstimator(
        1,
        1,
        H=1.0,
        state=IntervalMembership(0.0, 1.0),
        process_noise=IntervalMembership(-1.2, -1.1),
        measurement_noise=IntervalMembership(-0.5, 0.5),
        constraint=constraint,
        on_empty=on_empty,
        points=points,
    )


@pytest.mark.parametrize("points", [None, 101])
def test_a_prediction_beyond_the_constraint_follows_on_empty(points) -> None:
    est = falling("raise", (0.0, 1.0), points)
    before = repr(est)
    with pytest.raises(
        EmptyIntersectionError, match=r"constraint: got IntervalMembership.*all that is predicted"
    ):
        est.predict()
    assert repr(est) == before

    est = falling("keep", (0.0, 1.0), points)
    est.predict()
    np.testing.assert_allclose([est.lower.item(), est.upper.item()], [-1.2, -0.1])

    est = falling("reset", (0.0, 1.0), points)
    est.predict()
    np.testing.assert_allclose([est.lower.item(), est.upper.item()], [0.0, 1.0])
    found = est.smooth([0.2, None, 0.4])  # each prediction leaves it again, and nothing is told of before
    np.testing.assert_allclose(found.lower[:, 0], [0.0, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(found.upper[:, 0], [0.7, 1.0, 0.9], atol=0.02)

    with pytest.raises(EmptyIntersectionError, match="nothing to restart from"):
        falling("reset", (0.0, np.inf), points).predict()


@pytest.mark.parametrize("points", [None, 101])
def test_a_measurement_beyond_the_constraint_is_not_restarted_from(points) -> None:
    est = FuzzyRelationEstimator(
        1,
        1,
        H=1.0,
        state=IntervalMembership(0.0, 1.0),
        measurement_noise=IntervalMembership(-0.5, 0.5),
        constraint=(0.0, 5.0),
        on_empty="reset",
        points=points,
    )
    with pytest.raises(EmptyIntersectionError, match="nor does any state within the constraint"):
        est.update(-3.0)
    est.update(5.4)
    assert est.lower.item() == pytest.approx(4.9, abs=0.02)
    assert est.upper.item() == 5.0


def test_the_start_and_an_assigned_membership_are_within() -> None:
    est = falling("raise", None, None)
    est.constraint = (0.5, 2.0)
    assert (est.lower.item(), est.upper.item()) == (0.5, 1.0)
    est.membership = IntervalMembership(0.0, 9.0)
    assert (est.lower.item(), est.upper.item()) == (0.5, 2.0)
    with pytest.raises(ParameterError, match="excludes all that is possible"):
        est.membership = IntervalMembership(3.0, 9.0)
    assert (est.lower.item(), est.upper.item()) == (0.5, 2.0)
    est.constraint = None
    est.membership = IntervalMembership(3.0, 9.0)


# ------------------------------------------------------------------ which representation does it

BOX, GAUSS = IntervalMembership(-1.0, 1.0), GaussianMembership(0.0, 1.0)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"constraint": (0.0, np.inf)},
            ParameterError,
            "does not keep its shape.*a grid does.*GaussianMembership",
        ),
        ({"constraint": CauchyMembership(0.0, 1.0)}, ParameterError, "a gaussian membership does not keep"),
        (
            {"constraint": GAUSS, "state": BOX, "measurement_noise": BOX},
            ParameterError,
            "leave an interval an interval; a grid does",
        ),
        ({"constraint": (5.0, 0.0)}, ParameterError, r"component 0 is \[5, 0\], expected lower <= upper"),
        ({"constraint": (np.nan, 0.0)}, ParameterError, "expected lower <= upper"),
        ({"constraint": 3.0}, ParameterError, "constraint: got 3.0, expected a membership, or bounds"),
        ({"constraint": ([0.0, 0.0], 1.0)}, ShapeError, r"got lower of shape \(2,\)"),
        ({"constraint": GaussianMembership([0, 0], np.eye(2))}, ParameterError, "2 dimensions, expected 1"),
        ({"state": BoxMembership(0.0, np.inf)}, ParameterError, "which a constraint may be"),
    ],
)
def test_what_does_not_do_is_named(options, error, message) -> None:
    with pytest.raises(error, match=message):
        FuzzyRelationEstimator(1, 1, **options)


def test_any_membership_on_a_grid_and_components_of_a_list() -> None:
    both = (GaussianMembership(0.0, 1.0), TriangularMembership(-1.0, 0.0, 1.0))
    est = FuzzyRelationEstimator(
        2, 1, state=[GAUSS, GAUSS], measurement_noise=GAUSS, constraint=both, points=21, H=[[1.0, 0.0]]
    )
    x = list(itertools.product((-0.5, 0.0, 0.5), repeat=2))
    expected = [np.exp(-0.5 * a**2) ** 2 * np.exp(-0.5 * b**2) * (1.0 - abs(b)) for a, b in x]
    np.testing.assert_allclose(est.membership(x), expected, atol=0.03)

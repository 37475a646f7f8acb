"""A moving grid keeps its resolution where the membership is large, however far the tails reach."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from fuzzykf import CauchyMembership, FuzzyRelationEstimator, GaussianMembership
from fuzzykf.errors import SupportWarning
from fuzzykf.possibility.grid.resolution import MOST, needed_nodes

LEVELS = (0.1, 0.5, 0.9)


def robust(**options):
    """A walk, all memberships of which have the tails of Cauchy's."""
    est = FuzzyRelationEstimator(
        1,
        1,
        state=CauchyMembership(0.0, 1.0),
        process_noise=CauchyMembership(0.0, 0.1),
        measurement_noise=CauchyMembership(0.0, 0.5),
        **options,
    )
    est.F = est.H = 1.0
    return est


def series(n):
    """Measurements with outliers that the domain of the reference holds."""
    rng = np.random.default_rng(5)
    return np.cumsum(0.05 * rng.standard_normal(n)) + np.clip(0.5 * rng.standard_cauchy(n), -3.0, 3.0)


def cuts(membership):
    """Ends of the level sets, linear between the nodes."""
    x, values = membership.axes[0], membership.values
    ends = []
    for level in LEVELS:
        first, last = np.flatnonzero(values >= level)[[0, -1]]
        ends.append(np.interp(level, values[first - 1 : first + 1], x[first - 1 : first + 1]))
        ends.append(np.interp(level, values[last : last + 2][::-1], x[last : last + 2][::-1]))
    return ends


def followed(est, zs):
    """Peak, centroid and level sets after each step, and the number of nodes."""
    found, sizes = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of outliers beyond the floor
        for z in zs:
            est.step(z)
            found.append([est.defuzzify("peak").item(), est.x.item(), *cuts(est.membership)])
            sizes.append(est.membership.axes[0].size)
    return np.array(found), np.array(sizes)


@pytest.mark.parametrize(
    ("steps", "points", "floor", "fine"),
    [(15, 101, 1e-4, 1001), pytest.param(200, 201, 1e-5, 2001, marks=pytest.mark.study)],
)
def test_cauchy_noise_is_as_on_a_grid_ten_times_finer(steps, points, floor, fine, monkeypatch):
    zs = series(steps)
    exact, _ = followed(robust(domain=((-5.0, 5.0),), points=fine), zs)
    found, sizes = followed(robust(points=points, floor=floor), zs)
    off = np.abs(found - exact).max(axis=0)
    assert off.max() < 0.05  # the noises are 0.1 and 0.5 wide
    assert points < sizes.max() <= MOST[1] * points
    monkeypatch.setitem(MOST, 1, 1)
    stretched, _ = followed(robust(points=points, floor=floor), zs)
    assert np.abs(stretched - exact).max() > 3.0 * off.max()


def squares(**options):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x**2 / 4 - 1,
        hx=lambda x: x,
        state=GaussianMembership(0.5, 1.0),
        process_noise=GaussianMembership(0.0, 0.05),
        measurement_noise=CauchyMembership(0.0, 0.3),
        **options,
    )


def test_squares_stretch_a_grid_until_it_says_so():
    # squares carry the tails out, in the end so far that no bounded number of nodes resolves what is likely
    est, fine = squares(points=201), squares(points=1601)
    for z in (None, 0.5, None):
        est.step(z)
        fine.step(z)
    assert 201 < est.membership.axes[0].size <= 8 * 201
    assert est.defuzzify("peak").item() == pytest.approx(fine.defuzzify("peak").item(), abs=0.02)
    np.testing.assert_allclose(cuts(est.membership), cuts(fine.membership), atol=0.05)
    est.predict()
    with pytest.warns(SupportWarning, match="points: the likeliest states lie between neighbouring nodes"):
        est.predict()


def test_a_plane_is_refined_along_the_axis_that_needs_it():
    def plane(points):
        est = FuzzyRelationEstimator(
            2,
            1,
            state=[CauchyMembership(0.0, 1.0), GaussianMembership(0.0, 1.0)],
            process_noise=[None, GaussianMembership(0.0, 0.1)],
            measurement_noise=GaussianMembership(0.0, 1.0),
            points=points,
            floor=1e-3,
        )
        est.H = [[1.0, 0.0]]
        return est

    est, fine = plane(41), plane(161)
    first, second = (axis.size for axis in est.membership.axes)
    assert 41 < first <= 4 * 41
    assert second == 41
    for each in (est, fine):
        each.step(0.5)
    # a measurement that tells where the state is leaves what can do with fewer nodes
    assert [axis.size for axis in est.membership.axes] == [41, 41]
    np.testing.assert_allclose(est.x, fine.x, atol=0.01)
    np.testing.assert_allclose(est.P, fine.P, atol=0.02)


def test_what_is_wide_enough_needs_no_more_nodes():
    t_norm = robust().t_norm
    for membership, points in ((GaussianMembership(0.0, 4.0), 401), (CauchyMembership(1.0, 2.0), 101)):
        est = FuzzyRelationEstimator(
            1, 1, state=membership, measurement_noise=GaussianMembership(0.0, 1.0), points=points
        )
        lattice = est._belief.lattice
        assert lattice.axes[0].size == points
        assert needed_nodes(lattice.axes, lattice.cost, t_norm, est._universe)[0] <= points + 1
    fixed = robust(domain=((-500.0, 500.0),), points=101)
    fixed.predict()
    assert fixed.membership.axes[0].size == 101


def test_the_way_back_follows_a_refined_grid():
    zs = series(8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = robust(points=201, floor=1e-5).smooth(zs)
        exact = robust(domain=((-5.0, 5.0),), points=501).smooth(zs)
    np.testing.assert_allclose(found.x, exact.x, atol=0.05)

"""Interpolation is exact for quadratic costs, and sane at edges and kinks."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.grid import (
    continue_tails,
    from_membership,
    interpolate,
    interpolate_lines,
    scaled,
    sharpness,
    subgrid_minimum,
    to_membership,
)


def random_quadratic(d, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(d, d))
    H, c = root @ root.T + np.eye(d), rng.uniform(2, 4, d)
    return lambda x: 0.5 * np.einsum("...i,ij,...j->...", x - c, H, x - c), c


def nodes(shape):
    return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij"), axis=-1)


@pytest.mark.parametrize("shape", [(7,), (6, 8), (5, 6, 7)])
@pytest.mark.parametrize("scale", ["log", "reciprocal", "complement"])
def test_quadratic_costs_are_exact(shape, scale):
    f, _ = random_quadratic(len(shape))
    position = np.random.default_rng(1).uniform(0, np.array(shape) - 1, (500, len(shape)))
    value = interpolate(f(nodes(shape)), position, scale)
    np.testing.assert_allclose(value, f(position), rtol=1e-11, atol=1e-12)


def test_nodes_are_hit():
    cost = np.random.default_rng(0).random((6, 7))
    cost[2, 3:5] = np.inf
    np.testing.assert_allclose(interpolate(cost, nodes((6, 7)).reshape(-1, 2), "log"), cost.ravel())


@pytest.mark.parametrize("outside", [-0.01, 5.01, np.nan])
def test_outside_nothing_is_possible(outside):
    value = interpolate(np.zeros(6), np.array([[outside], [2.5]]), "log")
    np.testing.assert_array_equal(value, [np.inf, 0.0])


def test_edge_of_a_support_is_linear_in_memberships():
    # half-way from membership 0.8 to impossible it is 0.4, not zero
    cost = -np.log([1.0, 0.9, 0.8, 1e-300, 1e-300])
    cost[3:] = np.inf
    value = interpolate(cost, np.array([[2.5], [2.75], [3.5]]), "log")
    np.testing.assert_allclose(np.exp(-value), [0.4, 0.2, 0.0])


def test_edge_far_below_one_does_not_underflow():
    # relative to its surroundings, also where memberships are too small for a float
    cost = np.array([2000.0, 2000.0, 2000.0, np.inf, np.inf])
    value = interpolate(cost, np.array([[2.5]]), "log")
    assert value[0] == pytest.approx(2000.0 + np.log(2.0))


def test_a_wall_does_not_make_its_surroundings_likelier():
    # the next-to-last node is nearly impossible; a parabola through it would dip below zero
    cost = np.array([3.5, 3.7, 3.9, 4.6, 36.0, np.inf])
    position = np.linspace(0, 4, 81)[:, None]
    value = interpolate(cost, position, "log")
    # somewhere between linear in memberships and linear in costs, as any monotone curve is
    nodes_ = np.arange(6)
    least = -np.log(np.interp(position[:, 0], nodes_, np.exp(-cost)))
    most = np.interp(position[:, 0], nodes_[:5], cost[:5])
    assert (value >= least - 1e-9).all()
    assert (value <= most + 1e-9).all()


def test_memberships_never_exceed_one():
    cost = np.array([9.0, 0.1, 0.1, 9.0, 9.0])
    assert interpolate(cost, np.array([[1.5]]), "log")[0] >= 0.0


def test_lines_agree_with_the_lattice():
    rng = np.random.default_rng(0)
    cost = 0.5 * (np.arange(9) - rng.uniform(2, 6, (4, 1))) ** 2
    cost[1, 6:] = np.inf
    position = np.array([-0.5, 0.0, 1.3, 5.5, 6.2, 8.0, 8.5])
    for scale in ("log", "reciprocal", "complement"):
        value = interpolate_lines(cost, position, scale)
        expected = [interpolate(line, position[:, None], scale) for line in cost]
        np.testing.assert_allclose(value, expected)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_minimum_between_nodes(d):
    f, c = random_quadratic(d)
    value, position = subgrid_minimum(f(nodes((7,) * d)) + 0.5)
    assert value == pytest.approx(0.5)
    np.testing.assert_allclose(position, c)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("bend", [1.0, 1e-300, 1e300])
def test_minimum_of_a_valley_is_not_beyond_it(d, bend):
    # the second differences of a function of one combination of the axes form a matrix of rank one
    along = (nodes((7,) * d) - 3) @ np.sqrt([1.0, 2.0, 3.0][:d])
    for off in (0.0, 0.01):
        cost = bend * (along - off) ** 2
        value, position = subgrid_minimum(cost)
        assert -1e-12 * bend <= value <= cost.min()
        assert np.abs(position - 3).max() <= 1.0
        assert sharpness(cost) == pytest.approx(bend * d * (d + 1))


@pytest.mark.parametrize("row", [[3.0, 1.0], [1.0, 3.0], [3.0, 2.0], [2.0, 3.0]])
def test_minimum_of_a_singular_bowl_is_a_node(row):
    # whole numbers: the determinant of the second differences is exactly zero, and no way leads to a minimum
    x = nodes((5, 5)) - 2.0
    cost = 0.5 * (x @ row) ** 2 + 0.05 * x[..., 0]
    value, position = subgrid_minimum(cost)
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    assert value == cost[best]
    np.testing.assert_array_equal(position, best)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_sharpness_is_the_largest_curvature(d):
    rng = np.random.default_rng(d)
    A = rng.normal(size=(d, d))
    x = nodes((7,) * d) - rng.uniform(2.6, 3.4, d)
    cost = 0.5 * ((x @ A.T) ** 2).sum(axis=-1)
    assert sharpness(cost) == pytest.approx(np.linalg.norm(A, 2) ** 2)


def test_minimum_at_an_edge_is_a_node():
    value, position = subgrid_minimum(np.arange(5.0))
    assert (value, position[0]) == (0.0, 0.0)


def test_minimum_beside_a_wall_is_a_node():
    # the parabola through 0.5, 0.1, 36 would go down to minus four
    value, position = subgrid_minimum(np.array([3.0, 0.5, 0.1, 36.0, np.inf]))
    assert (value, position[0]) == (0.1, 2.0)


def test_known_components_stay():
    value, position = subgrid_minimum(0.5 * (np.arange(7.0) - 2.3)[:, None] ** 2)
    assert value == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(position, [2.3, 0.0])


def test_tails_continue_parabolas_into_a_whole_box():
    # a quadratic known only within an ellipse, as after a map of a lattice: all corners come back exactly
    f, _ = random_quadratic(2)
    x = nodes((13, 13)) * 1.5 - 5.0
    exact = f(x)
    inner = np.where(exact < 20.0, exact, np.inf)
    np.testing.assert_allclose(continue_tails(inner, 18.0), exact, rtol=1e-9)
    assert np.isinf(inner).sum() > 50  # and the input is left alone


def test_tails_do_not_cross_real_edges():
    # a support that ends where memberships are high is an edge, whatever its last parabola
    cost = np.array([np.inf, np.inf, 0.5, 0.125, 0.0, 0.125, 0.5, np.inf])
    np.testing.assert_array_equal(continue_tails(cost, 18.0), cost)
    with np.errstate(divide="ignore"):
        triangle = -np.log(np.maximum(0.0, 1.0 - abs(np.linspace(-1.2, 1.2, 241))))
    np.testing.assert_array_equal(continue_tails(triangle, 6.0), triangle)


def test_heavy_tails_do_not_turn_down():
    # log(1 + x^2) bends down; a parabola would call far states likely again
    cost = np.full(200, np.inf)
    cost[:120] = np.log1p(np.linspace(0.0, 10.0, 120) ** 2)
    tail = continue_tails(cost, 4.6)
    assert (np.diff(tail) > 0).all()


def test_nothing_beyond_a_cut_is_likelier_than_the_cut():
    # a parabola that comes down again stops at the level of the cut
    cost = np.full(40, np.inf)
    cost[:8] = 20.0 + 0.5 * (np.arange(8.0) - 12.0) ** 2 - 12.0
    tail = continue_tails(cost, 18.0)
    assert tail[8:].min() == pytest.approx(0.7 * 18.0)


@pytest.mark.parametrize("scale", ["log", "reciprocal", "complement"])
def test_scales(scale):
    membership = np.array([1.0, 0.5, 0.0])
    cost = from_membership(membership, scale)
    np.testing.assert_allclose(to_membership(cost, scale), membership)
    half = scaled(cost, np.full(3, 0.5), scale)
    np.testing.assert_allclose(to_membership(half, scale), [0.5, 0.25, 0.0])

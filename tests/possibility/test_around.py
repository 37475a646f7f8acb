"""What measurements show around a state of a nonlinear model: pieces, widths, edges, the linear answer."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest

from fuzzykf import (
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    TriangularMembership,
)
from fuzzykf.errors import ParameterError, SupportWarning
from fuzzykf.possibility import LocalObservability, Observability, observability

mpl.use("Agg")

MOVE = np.array([[1.0, 1.0], [0.0, 1.0]])


def squared(drift=0.0, **options):
    """Of x^2 the sign is not seen, unless the state drifts."""
    return FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x + drift,
        hx=lambda x: x**2,
        state=GaussianMembership(0.5, 4.0),
        process_noise=GaussianMembership(0.0, 0.01),
        measurement_noise=GaussianMembership(0.0, 0.05),
        points=401,
        **options,
    )


@pytest.mark.parametrize(("drift", "pieces"), [(0.0, [2, 2, 2, 2]), (0.3, [2, 1, 1, 1])])
def test_a_square_leaves_two_pieces_unless_the_state_drifts(drift, pieces) -> None:
    found = observability(squared(drift), 4, x=1.0)
    assert isinstance(found, LocalObservability)
    assert found.components.tolist() == pieces
    assert found.is_observable == (pieces[-1] == 1)
    if drift:
        assert found.widths[0, 0] > 2.0
        assert found.widths[-1, 0] < 0.2
        assert found.verdict.startswith("observable: at level 0.5 states that 4 measurements of [1]")
    else:
        assert found.widths[-1, 0] == pytest.approx(2.1, abs=0.05)
        assert found.verdict.endswith("are 2 pieces")
    assert found.membership([1.0]) == pytest.approx(1.0, abs=0.05)  # linear between the nodes


def test_a_linear_model_has_the_widths_of_its_gramian() -> None:
    # around x itself: by 1/sqrt(2) less than between any two
    options = {
        "process_noise": GaussianMembership([0.0, 0.0], np.diag([0.1, 0.2])),
        "measurement_noise": GaussianMembership(0.0, 1.0),
        "state": GaussianMembership([0.0, 0.0], 4.0 * np.eye(2)),
    }
    on_grid = FuzzyRelationEstimator(2, 1, fx=lambda x: x @ MOVE.T, points=61, **options)
    closed = FuzzyRelationEstimator(2, 1, **options)
    closed.F = MOVE
    closed.H = on_grid.H = np.array([[1.0, 0.0]])
    local, everywhere = observability(on_grid, 4), observability(closed, 4)
    assert isinstance(everywhere, Observability)
    np.testing.assert_allclose(local.widths, everywhere.widths / np.sqrt(2.0), rtol=0.01)
    assert local.components.tolist() == [1, 1, 1, 1]
    assert np.isinf(local.widths[0, 1])  # of the speed one position says nothing


def test_bounded_noise_has_half_of_the_widths_between_any_two() -> None:
    options = {
        "state": IntervalMembership(-4.0, 4.0),
        "process_noise": IntervalMembership(-0.25, 0.25),
        "measurement_noise": IntervalMembership(-1.0, 1.0),
    }
    on_grid = FuzzyRelationEstimator(1, 1, fx=lambda x: x, points=401, **options)
    crisp = FuzzyRelationEstimator(1, 1, **options)
    crisp.H = on_grid.H = 1.0
    local, everywhere = observability(on_grid, 3), observability(crisp, 3)
    np.testing.assert_allclose(local.widths, 0.5 * everywhere.widths, atol=0.03)


def test_under_the_minimum_it_is_the_definition_on_a_dense_universe() -> None:
    noise, error = TriangularMembership(-0.5, 0.0, 0.8), TriangularMembership(-1.0, 0.0, 1.5)
    est = FuzzyRelationEstimator(
        1,
        1,
        t_norm="min",
        fx=lambda x: 1.2 * x,
        state=IntervalMembership(-2.0, 3.0),
        process_noise=noise,
        measurement_noise=error,
        points=501,
    )
    est.H, x, universe = 1.0, 0.4, np.linspace(-6.0, 6.0, 1201)
    step = noise((universe - 1.2 * universe[:, None])[..., None])
    later = error((1.44 * x - universe)[:, None])
    later = np.minimum(error((1.2 * x - universe)[:, None]), np.minimum(step, later).max(axis=1))
    possible = np.minimum(error((x - universe)[:, None]), np.minimum(step, later).max(axis=1))
    found = observability(est, 3, level=0.3, x=x)
    points = np.linspace(-1.0, 2.0, 31)
    expected = np.interp(points, universe, possible)
    np.testing.assert_allclose(found.membership(points[:, None]), expected, atol=0.02)
    cut = universe[possible >= 0.3]
    assert found.widths[-1, 0] == pytest.approx(max(cut[-1] - x, x - cut[0]), abs=0.02)


def test_a_component_that_is_not_seen_reaches_the_edge() -> None:
    est = FuzzyRelationEstimator(
        2,
        1,
        hx=lambda x: np.sin(x[..., :1]),
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        measurement_noise=TriangularMembership(-0.2, 0.0, 0.2),
        points=31,
    )
    found = observability(est, 2)
    assert np.isinf(found.widths[-1]).tolist() == [False, True]
    assert found.verdict.endswith("reach the edge of the states considered in x1")
    assert not found.is_observable


def test_the_estimator_stays_as_it_is_and_its_own_state_is_taken() -> None:
    est = squared(0.3)
    before = est.membership.values.copy()
    found = observability(est, 3)
    assert found.x[0] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_array_equal(est.membership.values, before)
    assert "LocalObservability(verdict='observable" in repr(found)


def test_a_state_that_is_not_considered_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"x: got \[99.0\], expected a state within"):
        observability(squared(), 3, x=99.0)


@pytest.mark.parametrize("x", [1.0, 1.0234])
def test_at_level_one_a_state_is_not_told_from_those_in_its_cell(x) -> None:
    found = observability(squared(0.3), 3, level=1.0, x=x)
    assert found.components.tolist() == [2, 1, 1]
    assert found.is_observable
    assert 0.0 < found.widths[-1, 0] < 0.03  # less than half a cell
    assert observability(squared(), 3, level=1.0, x=x).components[-1] == 2


@pytest.mark.parametrize(
    "error", [GaussianMembership(0.0, 1e-8), TriangularMembership(-1e-3, 0.0, 1e-3)], ids=["tails", "ends"]
)
def test_noise_that_no_node_shows_is_an_error_of_the_grid(error) -> None:
    est = FuzzyRelationEstimator(
        1, 1, fx=np.sin, H=1.0, state=IntervalMembership(-4.0, 4.0), measurement_noise=error, points=51
    )
    with pytest.raises(ParameterError, match=r"points: got \[51\] nodes .* too coarse"):
        observability(est, 2, x=0.1234)


def test_states_that_leave_the_domain_are_told() -> None:
    with pytest.warns(SupportWarning, match="observability: domain: states of membership up to"):
        observability(squared(1.0, domain=[(-14.0, 14.0)]), 3, x=1.0)


def test_the_picture_shows_the_membership_around_the_state() -> None:
    found = observability(squared(), 2, x=1.0)
    axes = found.plot(label="altitude")
    assert axes.get_xlabel() == "altitude"
    assert axes.get_legend() is not None

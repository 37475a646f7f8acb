"""What measurements show and where noise leads: against the definition, the rank condition, known numbers."""

from __future__ import annotations

from itertools import product

import matplotlib as mpl
import numpy as np
import pytest
from scipy.optimize import minimize

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.possibility import controllability, observability

mpl.use("Agg")

WALK = np.array([[1.0, 1.0], [0.0, 1.0]])

#: By t-norm: cost of a quadratic form of one, and membership of a cost.
FAMILIES = {
    "product": (0.5, lambda c: np.exp(-c)),
    "hamacher": (1.0, lambda c: 1.0 / (1.0 + c)),
    "lukasiewicz": (1.0, lambda c: max(0.0, 1.0 - c)),
}


def quadratic(t_norm="product", F=WALK, H=((1.0, 0.0),), Q=None, R=None):
    F, H = np.array(F), np.array(H)
    est = FuzzyRelationEstimator(len(F), len(H), t_norm=t_norm)
    est.F, est.H = F, H
    est.Q = np.diag([0.1, 0.2][: len(F)]) if Q is None else Q
    est.R = np.eye(len(H)) if R is None else R
    return est


def crisp(F=WALK, H=((1.0, 0.0),), w=None, v=1.0, t_norm="product"):
    F, H = np.array(F), np.array(H)
    m, q = len(F), len(H)
    w = np.full(m, 0.1) if w is None else np.array(w)
    est = FuzzyRelationEstimator(
        m,
        q,
        t_norm=t_norm,
        state=IntervalMembership(-np.ones(m), np.ones(m)),
        process_noise=IntervalMembership(-w, w),
        measurement_noise=IntervalMembership(np.full(q, -v), np.full(q, v)),
    )
    est.F, est.H = F, H
    return est


# --------------------------------------------------------------------------- observability


def test_a_static_state_shrinks_by_the_product_and_not_by_bounds() -> None:
    product_ = observability(quadratic(F=[[1.0]], H=[[1.0]], Q=0.0), 21)
    np.testing.assert_allclose(product_.widths[[0, -1], 0], [1.665, 0.363], atol=5e-4)
    bounded = observability(crisp(F=[[1.0]], H=[[1.0]], w=[0.0]), 21)
    np.testing.assert_allclose(bounded.widths[:, 0], 2.0, rtol=1e-9)


@pytest.mark.parametrize("t_norm", FAMILIES)
@pytest.mark.parametrize("seed", range(3))
def test_chi_is_its_definition(t_norm, seed) -> None:
    # sup over z and over the noises on both ways of T(all memberships), by an optimiser
    rng, n = np.random.default_rng(seed), 3
    est = quadratic(t_norm, F=0.8 * rng.normal(size=(2, 2)), H=rng.normal(size=(1, 2)))
    scale, membership = FAMILIES[t_norm]
    Q, R = np.linalg.inv(est.Q), est.R.item()
    a, b = 0.4 * rng.normal(size=(2, 2))

    def cost(free):
        z, noises = free[:n], free[n:].reshape(2, n - 1, 2)
        total = 0.0
        for x, ws in zip((a, b), noises, strict=True):
            for k in range(n):
                total += (z[k] - (est.H @ x).item()) ** 2 / R
                if k < n - 1:
                    total += ws[k] @ Q @ ws[k]
                    x = est.F @ x + ws[k]
        return scale * total

    least = minimize(cost, np.zeros(n + 4 * (n - 1)), method="BFGS", options={"gtol": 1e-9}).fun
    found = observability(est, n)
    assert found.chi(a, b) == pytest.approx(membership(least), abs=1e-7)
    assert found.chi(b, a) == found.chi(a, b)
    assert found.chi(a, a) == 1.0


@pytest.mark.parametrize("difference", range(8))
def test_chi_of_bounds_is_its_definition(difference) -> None:
    # a walk with steps of -1, 0, 1, read within 1: all pairs of paths of whole numbers
    est, n = crisp(F=[[1.0]], H=[[1.0]], w=[1.0]), 3
    steps = list(product((-1, 0, 1), repeat=n - 1))
    paths = np.array([np.cumsum([0, *step]) for step in steps])
    apart = np.abs(paths[:, None] - (difference + paths[None])).max(axis=2).min()
    found = observability(est, n)
    assert found.chi(0.0, float(difference)) == float(apart <= 2)
    assert found.widths[-1, 0] == pytest.approx(2.0)


def test_chi_under_the_minimum_is_its_definition() -> None:
    # two measurements of a drifting scalar with triangles, on a dense universe of states and measurements
    noise, error = TriangularMembership(-0.5, 0.0, 0.5), TriangularMembership(-1.0, 0.0, 1.0)
    est = FuzzyRelationEstimator(
        1, 1, t_norm="min", state=error, process_noise=noise, measurement_noise=error, points=11
    )
    est.F, est.H = 1.2, 1.0
    x, z = np.linspace(-2.0, 3.0, 501), np.linspace(-2.0, 3.0, 501)
    read = error((z - x[:, None])[..., None])
    found = observability(est, 2)
    for a, b in ((0.0, 0.4), (0.0, 1.1), (-0.2, 1.3)):
        first = np.minimum(error((z - a)[:, None]), error((z - b)[:, None])).max()
        second = [np.minimum(noise((x - 1.2 * s)[:, None])[:, None], read).max(axis=0) for s in (a, b)]
        expected = min(first, np.minimum(*second).max())
        assert found.chi(a, b) == pytest.approx(expected, abs=0.02)
    np.testing.assert_allclose(observability(est, 1, level=0.25).widths, [[1.5]])


@pytest.mark.parametrize("t_norm", FAMILIES)
@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_widths_are_the_largest_differences_of_that_level(t_norm, level) -> None:
    est = quadratic(t_norm)
    found = observability(est, 6, level)
    inverse = np.linalg.inv(found.gramian)
    for i in range(2):
        furthest = inverse[:, i] * found.widths[-1, i] / inverse[i, i]
        assert furthest[i] == pytest.approx(found.widths[-1, i])
        assert found.chi(furthest, np.zeros(2)) == pytest.approx(level)
        assert found.chi(1.001 * furthest, np.zeros(2)) < level
    assert (np.diff(found.widths[1:], axis=0) <= 1e-12).all()


def test_widths_of_bounds_are_the_largest_differences() -> None:
    found = observability(crisp(), 5)
    assert (np.diff(found.widths[1:], axis=0) <= 1e-9).all()
    for i, width in enumerate(found.widths[-1]):
        for factor, expected in ((0.999, True), (1.001, False)):
            points = np.repeat(np.linspace(-2.0, 2.0, 41)[:, None], 2, axis=1)
            points[:, i] = factor * width
            assert any(found.chi(point, [0.0, 0.0]) == 1.0 for point in points) is expected


HIDDEN = {
    "position and speed": (WALK, [[1.0, 0.0]], [], 2),
    "speed alone": (WALK, [[0.0, 1.0]], [[1.0, 0.0]], 1),
    "two alike": (np.eye(2), [[1.0, 1.0]], [[1.0, -1.0]], 1),
    "nothing": (WALK, [[0.0, 0.0]], np.eye(2), 0),
    "three, the sum of two": (np.diag([1.0, 0.5, 0.5]), [[1.0, 1.0, 1.0]], [[0.0, 1.0, -1.0]], 2),
    "a mode that dies at once": (np.diag([0.0, 1.0]), [[0.0, 1.0]], [[1.0, 0.0]], 1),
}


@pytest.mark.parametrize("name", HIDDEN)
@pytest.mark.parametrize("kind", [*FAMILIES, "interval"])
def test_bounded_if_and_only_if_the_rank_condition_holds(name, kind) -> None:
    F, H, unseen, rank = HIDDEN[name]
    m = len(F)
    est = crisp(F, H) if kind == "interval" else quadratic(kind, F, H, Q=0.1 * np.eye(m))
    found = observability(est, m + 2)
    classical = np.linalg.matrix_rank(
        np.vstack([np.array(H) @ np.linalg.matrix_power(F, k) for k in range(m)])
    )
    assert found.rank == classical == rank
    assert found.is_observable == (rank == m) == np.isfinite(found.widths[-1]).all()
    space = np.array(unseen, dtype=float).reshape(-1, m)
    projector = space.T @ np.linalg.pinv(space.T)
    np.testing.assert_allclose(found.unobservable.T @ found.unobservable, projector, atol=1e-9)
    np.testing.assert_array_equal(np.isinf(found.widths[-1]), (np.abs(space) > 0).any(axis=0))
    for direction in space:
        assert found.chi(1e3 * direction, np.zeros(m)) == pytest.approx(1.0)
    assert found.verdict.startswith("observable" if rank == m else "not observable")
    assert found.components == 1


def test_a_verdict_names_what_is_not_shown() -> None:
    found = observability(quadratic(H=[[0.0, 1.0]]), 3)
    assert found.verdict == "not observable: 3 measurements show 1 of 2 directions, and nothing of [1, 0]"
    assert "not observable" in repr(found)


def test_level_one_is_classical_observability() -> None:
    found = observability(quadratic(), 2, level=1.0)
    np.testing.assert_array_equal(found.widths, [[0.0, np.inf], [0.0, 0.0]])


def test_the_estimator_stays_as_it_is_and_its_state_does_not_matter() -> None:
    est = quadratic()
    before = observability(est, 4).widths
    est.step(0.3)
    x, P = est.x.copy(), est.P.copy()
    np.testing.assert_array_equal(observability(est, 4, x=[5.0, 1.0]).widths, before)
    np.testing.assert_array_equal(est.x, x)
    np.testing.assert_array_equal(est.P, P)


def test_a_grid_of_a_closed_family_is_judged_as_that_family() -> None:
    on_grid = FuzzyRelationEstimator(
        1,
        1,
        state=GaussianMembership(0.0, 1.0),
        process_noise=GaussianMembership(0.0, 0.1),
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=21,
    )
    on_grid.F = on_grid.H = 1.0
    closed = quadratic(F=[[1.0]], H=[[1.0]])
    np.testing.assert_allclose(observability(on_grid, 5).widths, observability(closed, 5).widths)


# --------------------------------------------------------------------------- controllability


@pytest.mark.parametrize("t_norm", FAMILIES)
def test_the_gramian_is_the_matrix_of_a_predicted_point(t_norm) -> None:
    est = quadratic(t_norm)
    found = controllability(est, 3, x=[1.0, 0.5])
    est.membership = SingletonMembership([1.0, 0.5])
    for _ in range(3):
        est.predict()
    np.testing.assert_allclose(found.gramian, est.P, rtol=1e-12)
    np.testing.assert_allclose(found.center, est.x.ravel(), rtol=1e-12)
    for b in ([2.5, 0.5], [3.0, 1.0], [0.0, 0.0]):
        assert found.possibility(b) == pytest.approx(est.membership(b), rel=1e-9)


REACHED = {
    "the speed is pushed": (WALK, np.diag([0.0, 1.0]), 2, []),
    "the position is pushed": (WALK, np.diag([1.0, 0.0]), 1, [[0.0, 1.0]]),
    "no noise": (WALK, np.zeros((2, 2)), 0, np.eye(2)),
    "one push for both": (np.eye(2), np.ones((2, 2)), 1, [[1.0, -1.0]]),
}


@pytest.mark.parametrize("name", REACHED)
def test_controllable_if_and_only_if_the_rank_condition_holds(name) -> None:
    F, Q, rank, unreached = REACHED[name]
    found = controllability(quadratic(F=F, Q=Q), 4)
    assert found.rank == rank
    assert found.is_controllable == (rank == 2)
    assert found.verdict.startswith("controllable" if rank == 2 else "not controllable")
    for direction in np.array(unreached, dtype=float).reshape(-1, 2):
        np.testing.assert_allclose(np.abs(found.uncontrollable @ direction).max(), np.linalg.norm(direction))
        assert found.possibility(0.1 * direction) == 0.0
    assert found.possibility([0.0, 0.0]) == 1.0
    box = controllability(crisp(F=F, w=np.sqrt(np.diag(Q))), 4)
    if name != "one push for both":  # of a box the components are pushed one by one
        assert box.rank == rank


def test_widths_reached_by_bounded_noise_are_exact() -> None:
    found = controllability(crisp(w=[0.1, 0.2]), 3, x=[1.0, 0.5])
    # positions: .1 thrice, .2 (1 + 2) by the speed; speeds: .2 thrice
    np.testing.assert_allclose(found.widths, [[0.1, 0.2], [0.4, 0.4], [0.9, 0.6]])
    np.testing.assert_allclose(found.center, [2.5, 0.5])
    assert found.possibility([3.4 - 1e-9, 1.1 - 1e-9]) == 1.0
    assert found.possibility([3.41, 0.5]) == 0.0
    assert found.possibility([1.7, 1.1]) == 0.0  # each component is within its bounds


def test_noise_off_zero_drifts() -> None:
    est = FuzzyRelationEstimator(
        1,
        1,
        t_norm="min",
        state=TriangularMembership(-1.0, 0.0, 1.0),
        process_noise=TriangularMembership(0.0, 0.5, 2.0),
        measurement_noise=TriangularMembership(-1.0, 0.0, 1.0),
        points=11,
    )
    est.F, est.H = 1.0, 1.0
    found = controllability(est, 2)
    assert found.center.item() == 1.0
    assert found.possibility(1.0) == 1.0
    assert found.possibility(2.5) == pytest.approx(0.5, abs=1e-6)  # twice .5 + .75
    assert found.possibility(4.1) == 0.0


# --------------------------------------------------------------------------- arguments and pictures

WRONG = {
    "n of nothing": (lambda: observability(quadratic(), 0), "n: got 0"),
    "n that is not whole": (lambda: observability(quadratic(), 1.5), "n: got 1.5"),
    "no estimator": (lambda: observability(3.0, 3), "est: got 3.0, expected a FuzzyRelationEstimator"),
    "no estimator either": (lambda: controllability(None, 3), "est: got None"),
    "a level of zero": (lambda: observability(quadratic(), 3, 0.0), "level: got 0.0"),
    "a level beyond one": (lambda: controllability(quadratic(), 3, 1.5), "level: got 1.5"),
    "a state of three": (lambda: observability(quadratic(), 3, x=[1.0, 2.0, 3.0]), r"x: got shape \(3,\)"),
    "a target of three": (
        lambda: controllability(quadratic(), 3).possibility([1.0, 2.0, 3.0]),
        r"b: got shape \(3,\)",
    ),
    "one of two states": (
        lambda: observability(quadratic(), 3).chi([1.0], [1.0, 2.0]),
        r"a: got shape \(1,\)",
    ),
    "exact measurements": (
        lambda: observability(quadratic(R=0.0), 3),
        "measurement_noise: expected a positive definite matrix",
    ),
    "a function": (
        lambda: observability(
            FuzzyRelationEstimator(
                1,
                1,
                fx=lambda x: x,
                state=IntervalMembership(0.0, 1.0),
                measurement_noise=IntervalMembership(-1.0, 1.0),
            ),
            3,
        ),
        "fx: got a function, expected a linear model",
    ),
    "a noise of another family": (
        lambda: controllability(
            FuzzyRelationEstimator(
                1,
                1,
                state=GaussianMembership(0.0, 1.0),
                process_noise=CauchyMembership(0.0, 1.0),
                measurement_noise=GaussianMembership(0.0, 1.0),
            ),
            3,
        ),
        "process_noise: got CauchyMembership.*expected noises all of the family 'gaussian'",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name) -> None:
    call, told = WRONG[name]
    with pytest.raises((ParameterError, ShapeError), match=told):
        call()


def test_pictures_show_the_widths_and_what_nothing_bounds() -> None:
    found = observability(quadratic(H=[[0.0, 1.0]]), 4)
    axes = found.plot(label=["position", "speed"], unit=["m", "m/s"])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "position (m): not bounded",
        "speed (m/s)",
    ]
    np.testing.assert_allclose(axes.get_lines()[1].get_ydata(), found.widths[:, 1])
    assert axes.get_xlabel() == "measurements"
    reached = controllability(quadratic(), 4)
    axes = reached.plot()
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), reached.widths[:, 0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("predictions", "reached at level 0.5")
    with pytest.raises(ShapeError, match="label: got 3, expected 2"):
        found.plot(label=["a", "b", "c"])

"""The interval estimator: reference case, formulas of the paper, and no violation in 100 000 runs."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzyRelationEstimator, IntervalMembership, SingletonMembership
from fuzzykf.errors import (
    EmptyIntersectionError,
    ParameterError,
    ShapeError,
    UnreachableMeasurementError,
)

RUNS = 100_000

FUNCTIONS = {
    "linear": lambda c: lambda x: c * x,
    "affine": lambda c, d: lambda x: c * x + d,
    "cubic": lambda c: lambda x: c * x**3,
    "tanh": lambda c: lambda x: c * np.tanh(x),
    "exp": lambda c: lambda x: np.exp(c * x),
}


def named(text):
    name, *values = text.split()
    return FUNCTIONS[name](*map(float, values))


def scalar(f, g, x0, w, v, **options):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=f,
        hx=g,
        state=IntervalMembership(*x0),
        process_noise=IntervalMembership(*w),
        measurement_noise=IntervalMembership(*v),
        **options,
    )


def bounds(est):
    return [est.membership.lower[0], est.membership.upper[0]]


def test_public_interval_case(fuzzy_cases):
    case = fuzzy_cases["interval paper 4.3 short"]
    est = scalar(named(case["f"]), named(case["g"]), case["x0"], case["w"], case["v"], on_empty="keep")
    tolerance = {"rtol": case["rtol"], "atol": case["atol"]}
    for step in case["steps"]:
        est.predict()
        np.testing.assert_allclose(bounds(est), step["pred"], **tolerance)
        est.update(step["z"])
        np.testing.assert_allclose(bounds(est), step["post"], **tolerance)
        np.testing.assert_allclose(est.x.item(), step["center"], **tolerance)
        assert (est.possibility == 0.0) == step.get("empty", False)


@pytest.mark.parametrize(
    ("f", "g", "predicted", "posterior"),
    [
        # increasing and decreasing f and g, by hand from the corrected formulas of section 4:
        # x in [-1, 2], w in [-.5, .2], v in [-.45, 9], z = 3, hence h(x) in [-6, 3.45]
        (lambda x: 2 * x, lambda x: 3 * x, (-2.5, 4.2), (-2.0, 1.15)),
        (lambda x: -2 * x, lambda x: 3 * x, (-4.5, 2.2), (-2.0, 1.15)),
        (lambda x: 2 * x, lambda x: -3 * x, (-2.5, 4.2), (-1.15, 2.0)),
    ],
)
def test_formulas(f, g, predicted, posterior):
    est = scalar(f, g, (-1.0, 2.0), (-0.5, 0.2), (-0.45, 9.0))
    est.predict()
    np.testing.assert_allclose(bounds(est), predicted)
    est.update(3.0)
    np.testing.assert_allclose(bounds(est), posterior)
    assert est.x.item() == pytest.approx(sum(posterior) / 2)
    assert est.P.item() == pytest.approx((posterior[1] - posterior[0]) ** 2 / 12)


@pytest.mark.parametrize("t_norm", ["min", "lukasiewicz", "hamacher"])
def test_intervals_are_the_same_for_every_norm(t_norm):
    zs = [0.3, None, 1.1, 0.2]
    arguments = (lambda x: 0.9 * x + 0.1), np.sinh, (-1.0, 1.0), (-0.5, 0.5), (-0.8, 0.8)
    one = scalar(*arguments).filter(zs)
    other = scalar(*arguments, t_norm=t_norm).filter(zs)
    np.testing.assert_array_equal(one.lower, other.lower)
    np.testing.assert_array_equal(one.upper, other.upper)


@pytest.mark.parametrize(
    ("f", "g"),
    [
        (lambda x: x, lambda x: 0.0005 * x**3),
        (lambda x: 0.01 * x**3, lambda x: x),
        (lambda x: -0.8 * x, lambda x: 0.01 * x**3),
        (lambda x: 2 * np.tanh(x), lambda x: -np.arctan(x)),
    ],
)
def test_true_states_are_contained(f, g):
    # 100 000 runs at once: state and noises anywhere in their intervals, also on the bounds.  The
    # measurements of one run are given; the runs that they do not contradict must be inside.
    rng = np.random.default_rng(0)
    w, v = 1.0, 0.4

    def noise(width, size):
        value = rng.uniform(-width, width, size)
        edge = rng.random(size)
        return np.where(edge < 0.1, -width, np.where(edge > 0.9, width, value))

    est = scalar(f, g, (-1.0, 1.0), (-w, w), (-v, v))
    x = noise(1.0, RUNS)
    truth = 0.3
    for _ in range(20):
        est.predict()
        x, truth = f(x) + noise(w, x.size), float(f(np.array(truth)) + rng.uniform(-w, w))
        assert est.lower[0] <= x.min()
        assert x.max() <= est.upper[0]
        z = float(g(np.array(truth)) + rng.uniform(-v, v))
        est.update(z)
        residual = z - g(x)
        x = x[(residual >= -v) & (residual <= v)]
        assert x.size > 100
        assert est.lower[0] <= x.min()
        assert x.max() <= est.upper[0]
        x = rng.choice(x, RUNS)


@pytest.mark.parametrize(
    ("f", "g"),
    [
        (lambda x: x, lambda x: 0.0005 * x**3),
        (lambda x: -0.9 * x, lambda x: -np.tanh(x) - 0.1 * x),
        (lambda x: x, np.tanh),
        (lambda x: 0.5 * x, np.exp),
    ],
)
def test_states_and_noises_on_their_bounds_are_contained(f, g):
    # every run has measurements of its own; rounding must not exclude what is just possible
    rng = np.random.default_rng(2)

    def extreme(width):
        return float(rng.choice([-width, rng.uniform(-width, width), width]))

    for _ in range(20):
        est = scalar(f, g, (-1.0, 1.0), (-1.0, 1.0), (-0.5, 0.5))
        x = extreme(1.0)
        for k in range(15):
            est.predict()
            x = float(f(np.array(x))) + extreme(1.0)
            assert est.lower[0] <= x <= est.upper[0]
            est.update(None if k % 3 == 0 else float(g(np.array(x))) + extreme(0.5))
            assert est.lower[0] <= x <= est.upper[0]


@pytest.mark.parametrize("rows", [1, 2])
def test_true_states_are_contained_in_boxes(rows):
    rng = np.random.default_rng(1)
    F = np.array([[0.9, 0.4], [-0.3, 0.8]])
    H = np.array([[1.0, 0.5], [0.3, -1.0]])[:rows]
    est = FuzzyRelationEstimator(
        2,
        rows,
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        process_noise=[IntervalMembership(-0.3, 0.2), None],
        measurement_noise=IntervalMembership([-0.4] * rows, [0.4] * rows),
    )
    est.F, est.H = F, H
    blind = est.copy()
    x, truth = rng.uniform(-1, 1, (RUNS, 2)), np.array([0.3, 0.2])
    for _ in range(20):
        est.predict()
        x = x @ F.T
        x[:, 0] += rng.uniform(-0.3, 0.2, RUNS)
        truth = F @ truth + [rng.uniform(-0.3, 0.2), 0.0]
        assert (est.lower <= x.min(axis=0)).all()
        assert (x.max(axis=0) <= est.upper).all()
        z = H @ truth + rng.uniform(-0.4, 0.4, rows)
        est.update(z)
        x = x[(np.abs(z - x @ H.T) <= 0.4).all(axis=1)]
        assert len(x) > 100
        assert (est.lower <= x.min(axis=0)).all()
        assert (x.max(axis=0) <= est.upper).all()
        x = rng.choice(x, RUNS)
        blind.step(None)
    assert (est.upper - est.lower < 0.7 * (blind.upper - blind.lower)).all()


def pendulum(x):
    return np.stack([x[..., 0] + 0.1 * x[..., 1], x[..., 1] - 0.1 * np.sin(x[..., 0])], axis=-1)


def pendulum_interval(lower, upper):
    """Interval extension of the pendulum: bounds of the sine over an interval."""
    inside = [k for k in (np.pi / 2 + np.pi * np.arange(-9, 9)) if lower[0] < k < upper[0]]
    values = np.sin(np.array([lower[0], upper[0], *inside]))
    low = [lower[0] + 0.1 * lower[1], lower[1] - 0.1 * values.max()]
    return low, [upper[0] + 0.1 * upper[1], upper[1] - 0.1 * values.min()]


def squares(x):
    return (x**2).sum(axis=-1, keepdims=True)


def squares_interval(lower, upper):
    low = np.where((lower <= 0) & (upper >= 0), 0.0, np.minimum(lower**2, upper**2))
    return [low.sum()], [np.maximum(lower**2, upper**2).sum()]


def test_functions_with_interval_extensions():
    rng = np.random.default_rng(2)
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=pendulum,
        fx_interval=pendulum_interval,
        hx=squares,
        hx_interval=squares_interval,
        state=IntervalMembership([0.5, -0.2], [1.0, 0.2]),
        process_noise=IntervalMembership([0.0, -0.01], [0.0, 0.01]),
        measurement_noise=IntervalMembership(-0.05, 0.05),
    )
    assert est.representation == "interval"
    x, truth = rng.uniform([0.5, -0.2], [1.0, 0.2], (RUNS, 2)), np.array([0.7, 0.1])
    for _ in range(10):
        est.predict()
        x, truth = pendulum(x), pendulum(truth)
        x[:, 1] += rng.uniform(-0.01, 0.01, RUNS)
        z = squares(truth)[0] + rng.uniform(-0.05, 0.05)
        before = est.upper - est.lower
        est.update(z)
        assert (est.upper - est.lower <= before).all()
        x = x[np.abs(z - squares(x)[:, 0]) <= 0.05]
        assert len(x) > 100
        assert (est.lower <= x.min(axis=0)).all()
        assert (x.max(axis=0) <= est.upper).all()
        x = rng.choice(x, RUNS)


# ------------------------------------------------------------------ empty intersections


def test_empty_intersection_is_an_explicit_policy():
    arguments = (lambda x: x), (lambda x: 2 * x), (-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)
    est = scalar(*arguments)
    est.predict()
    with pytest.raises(EmptyIntersectionError, match=r"z: got \[50.0\], which no possible state explains"):
        est.update(50.0)
    assert bounds(est) == [-2.0, 2.0]
    assert est.possibility == 1.0
    kept, restarted = scalar(*arguments, on_empty="keep"), scalar(*arguments, on_empty="reset")
    for f in (kept, restarted):
        f.step(50.0)
        assert f.possibility == 0.0
    assert bounds(kept) == [-2.0, 2.0]
    np.testing.assert_allclose(bounds(restarted), [24.5, 25.5])


def test_measurements_out_of_reach_have_their_own_error():
    # tanh, z = 1.5, v within 0.2: no state at all, not even an infinite one
    arguments = (lambda x: x), np.tanh, (-1.0, 1.0), (-1.0, 1.0), (-0.2, 0.2)
    with pytest.raises(UnreachableMeasurementError, match="hx does not reach from any state"):
        scalar(*arguments).step(1.5)
    with pytest.raises(UnreachableMeasurementError, match="nothing to restart from"):
        scalar(*arguments, on_empty="reset").step(1.5)
    kept = scalar(*arguments, on_empty="keep")
    kept.step(1.5)
    assert bounds(kept) == [-2.0, 2.0]


def test_one_side_out_of_reach_is_unbounded():
    # z - v reaches beyond the range of tanh on one side only: that side tells nothing
    est = scalar(lambda x: x, np.tanh, (-1.0, 1.0), (-1.0, 1.0), (-0.2, 0.2))
    est.step(0.9)
    np.testing.assert_allclose(bounds(est), [np.arctanh(0.7), 2.0])


def test_restart_of_a_box_keeps_what_is_not_observed():
    est = FuzzyRelationEstimator(
        2,
        1,
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        measurement_noise=IntervalMembership(-1.0, 1.0),
        on_empty="reset",
    )
    est.H = np.array([[2.0, 0.0]])
    est.step(50.0)
    np.testing.assert_allclose([est.lower, est.upper], [[24.5, -1.0], [25.5, 1.0]])
    est.H = np.array([[1.0, 1.0]])  # bounds neither component alone
    with pytest.raises(EmptyIntersectionError, match="nothing to restart from"):
        est.update(500.0)


# ------------------------------------------------------------------ odds and ends


def test_known_state_and_exact_measurement():
    est = FuzzyRelationEstimator(
        1, 1, fx=lambda x: x + 1, hx=lambda x: x, state=SingletonMembership(0.0), measurement_noise=[None]
    )
    est.step(1.0)
    assert bounds(est) == [1.0, 1.0]
    assert est.P.item() == 0.0


def test_several_measurements_of_a_scalar():
    est = FuzzyRelationEstimator(
        1,
        2,
        hx=lambda x: np.concatenate([x, x**3], axis=-1),
        state=IntervalMembership(-5.0, 5.0),
        measurement_noise=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
    )
    est.update([2.0, 9.0])
    np.testing.assert_allclose(bounds(est), [2.0, np.cbrt(10.0)])
    est.update([np.nan, 9.8])
    np.testing.assert_allclose(bounds(est), [np.cbrt(8.8), np.cbrt(10.0)])


def test_bad_functions_are_named():
    est = scalar(lambda x: x**2, lambda x: x, (-1.0, 1.0), (0.0, 0.0), (-1.0, 1.0))
    with pytest.raises(
        ParameterError, match=r"fx: is not monotone on \[-1, 1\]; .*points=... asks for a grid"
    ):
        est.predict()
    assert bounds(est) == [-1.0, 1.0]
    box = IntervalMembership([0.0, 0.0], [1.0, 1.0])
    for extension, error, message in (
        (lambda a, b: (b, a), ParameterError, "fx_interval: returned .*, expected lower <= upper"),
        (lambda a, b: (a[:1], b), ShapeError, "fx_interval: returned shapes"),
        (lambda a, b: 3.0, ShapeError, "fx_interval: returned 3.0, expected bounds"),
    ):
        est = FuzzyRelationEstimator(
            2,
            1,
            fx=pendulum,
            fx_interval=extension,
            state=box,
            measurement_noise=IntervalMembership(-1.0, 1.0),
        )
        with pytest.raises(error, match=message):
            est.predict()

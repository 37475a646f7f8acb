"""Boxes that go back and forth: the exact bounds of a scalar, and no trajectory that is lost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from fuzzykf import FuzzyRelationEstimator, IntervalMembership
from fuzzykf.errors import EmptyIntersectionError

WALK = np.array([[1.0, 1.0], [0.0, 1.0]])


def scalar(slope=1.0, fx=None, hx=None, **options):
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=fx,
        hx=hx,
        state=IntervalMembership(-1.0, 1.5),
        process_noise=IntervalMembership(-0.1, 0.3),
        measurement_noise=IntervalMembership(-0.4, 0.2),
        **options,
    )
    if fx is None:
        est.F = slope
    if hx is None:
        est.H = 1.2
    return est


def moving(**options):
    """A position, which is seen, and a speed."""
    est = FuzzyRelationEstimator(
        2,
        1,
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        process_noise=IntervalMembership([-0.01, -0.05], [0.01, 0.05]),
        measurement_noise=IntervalMembership(-0.5, 0.5),
        **options,
    )
    est.F, est.H = WALK, np.array([[1.0, 0.0]])
    return est


def inside(smoothed, x):
    return (smoothed.lower <= x).all() and (x <= smoothed.upper).all()


def random_series(rng, f, h, n):
    """States (n,) of a scalar and measurements, with noise in the bounds of `scalar`, often on them."""
    x, states, zs = rng.uniform(-1.0, 1.5), [], []
    for _ in range(n):
        x = float(f(np.array(x))) + float(rng.choice([-0.1, rng.uniform(-0.1, 0.3), 0.3]))
        states.append(x)
        zs.append(float(h(np.array(x))) + float(rng.choice([-0.4, rng.uniform(-0.4, 0.2), 0.2])))
    return np.array(states), zs


def random_walk(rng, n):
    """States (n, 2) and measurements of `moving`."""
    x, states, zs = rng.uniform(-1.0, 1.0, 2), [], []
    for _ in range(n):
        x = WALK @ x + rng.choice([-1.0, rng.uniform(-1.0, 1.0), 1.0], 2) * [0.01, 0.05]
        states.append(x)
        zs.append(x[0] + rng.choice([-0.5, rng.uniform(-0.5, 0.5), 0.5]))
    return np.array(states), zs


@pytest.mark.parametrize("slope", [1.0, 0.9, -0.8, -1.1])
def test_a_linear_scalar_has_the_exact_bounds(slope) -> None:
    # the bounds of each state over all trajectories: a linear program in (x_0, ..., x_n)
    rng = np.random.default_rng(1)
    _, zs = random_series(rng, lambda x: slope * x, lambda x: 1.2 * x, 6)
    zs[2] = None
    rows, most = [], []
    for k, z in enumerate(zs):
        step = np.zeros(7)
        step[k], step[k + 1] = -slope, 1.0
        seen = np.zeros(7)
        seen[k + 1] = 1.2
        bounds = [(step, -0.1, 0.3)] + ([] if z is None else [(seen, z - 0.2, z + 0.4)])
        for row, low, high in bounds:
            rows += [row, -row]
            most += [high, -low]
    smoothed = scalar(slope).smooth(zs)
    for k in range(6):
        for sign, got in ((1.0, smoothed.lower[k, 0]), (-1.0, smoothed.upper[k, 0])):
            limits = [(-1.0, 1.5)] + [(None, None)] * 6
            exact = sign * linprog(sign * np.eye(7)[k + 1], rows, most, bounds=limits).fun
            assert got == pytest.approx(exact, abs=1e-9)
            assert sign * got <= sign * exact + 1e-12  # outward, if at all


FUNCTIONS = {
    "increasing": (lambda x: x + 0.4 * np.tanh(x), lambda x: x + x**3),
    "decreasing": (lambda x: -0.7 * x - 0.2 * np.tanh(x), lambda x: np.exp(-x)),
    "bounded range": (np.tanh, lambda x: x),  # a side that leaves the range of f is unbounded
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_monotone_scalar_has_the_exact_bounds(name) -> None:
    # just outside of each bound nothing leads on, or nothing led there; just inside something does
    f, h = FUNCTIONS[name]
    rng = np.random.default_rng(2)
    _, zs = random_series(rng, f, h, 8)
    filtered, smoothed = scalar(fx=f, hx=h).filter(zs), scalar(fx=f, hx=h).smooth(zs)
    tighter = 0
    for n in range(7):
        low, high = smoothed.lower[n, 0], smoothed.upper[n, 0]
        x = np.concatenate([np.linspace(low, high, 101), [low - 1e-6, high + 1e-6]])
        image = f(x)
        slack = 1e-9
        leads = (image + 0.3 >= smoothed.lower[n + 1] - slack) & (
            image - 0.1 <= smoothed.upper[n + 1] + slack
        )
        possible = (filtered.lower[n] <= x) & (x <= filtered.upper[n])
        np.testing.assert_array_equal((leads & possible)[1:100], True)
        np.testing.assert_array_equal((leads & possible)[101:], False)
        tighter += low > filtered.lower[n, 0] or high < filtered.upper[n, 0]
    assert tighter > 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_states_of_a_scalar_are_contained(name) -> None:
    f, h = FUNCTIONS[name]
    rng = np.random.default_rng(3)
    for _ in range(6):
        x, zs = random_series(rng, f, h, 25)
        zs[5], zs[6] = None, None
        assert inside(scalar(fx=f, hx=h).smooth(zs), x[:, None])


def test_states_of_a_box_are_contained_and_its_speed_is_found() -> None:
    # a box keeps no correlation, so that the filter learns no speed from positions; the way back does
    rng = np.random.default_rng(4)
    for _ in range(5):
        states, zs = random_walk(rng, 40)
        filtered, smoothed = moving().filter(zs), moving().smooth(zs)
        assert inside(smoothed, states)
        assert (smoothed.lower >= filtered.lower).all()
        assert (smoothed.upper <= filtered.upper).all()
        speed = (smoothed.upper - smoothed.lower)[:, 1].mean()
        assert speed < 0.5 * (filtered.upper - filtered.lower)[:, 1].mean()


def test_states_of_functions_with_interval_extensions_are_contained() -> None:
    def turn(x):
        return np.stack([x[..., 0] + 0.1 * x[..., 1], x[..., 1] - 0.1 * x[..., 0] ** 3], axis=-1)

    def turn_interval(lower, upper):
        low = [lower[0] + 0.1 * lower[1], lower[1] - 0.1 * upper[0] ** 3]
        return low, [upper[0] + 0.1 * upper[1], upper[1] - 0.1 * lower[0] ** 3]

    rng = np.random.default_rng(5)
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=turn,
        fx_interval=turn_interval,
        state=IntervalMembership([0.5, -0.5], [1.0, 0.5]),
        process_noise=IntervalMembership([0.0, -0.01], [0.0, 0.01]),
        measurement_noise=IntervalMembership(-0.02, 0.02),
    )
    est.H = np.array([[1.0, 0.0]])
    x, states, zs = rng.uniform([0.5, -0.5], [1.0, 0.5]), [], []
    for _ in range(12):
        x = turn(x) + np.array([0.0, rng.uniform(-0.01, 0.01)])
        states.append(x)
        zs.append(x[0] + rng.uniform(-0.02, 0.02))
    filtered, smoothed = est.copy().filter(zs), est.smooth(zs)
    assert inside(smoothed, np.array(states))
    width = (smoothed.upper - smoothed.lower)[:, 1].sum()
    assert width < 0.8 * (filtered.upper - filtered.lower)[:, 1].sum()


@pytest.mark.study
@pytest.mark.parametrize("name", [*FUNCTIONS, "box"])
def test_no_state_is_lost_in_100_000_runs(name) -> None:
    # 25,000 of each; noises are often on their bounds
    rng = np.random.default_rng(6)
    for _ in range(25_000):
        if name == "box":
            states, zs = random_walk(rng, 4)
            assert inside(moving().smooth(zs), states)
        else:
            f, h = FUNCTIONS[name]
            x, zs = random_series(rng, f, h, 4)
            assert inside(scalar(fx=f, hx=h).smooth(zs), x[:, None])


# --------------------------------------------------------------------------- contradictions


def test_a_contradiction_that_only_the_way_back_sees() -> None:
    # positions 0, 2, 0 within a half: no speed that hardly changes leads there, but each box is not empty
    zs = [0.0, 2.0, 0.0]
    est = moving()
    assert (est.copy().filter(zs).possibility == 1.0).all()
    with pytest.raises(EmptyIntersectionError, match="later measurements exclude every state"):
        est.smooth(zs)
    filtered = moving().filter(zs)
    for policy in ("keep", "reset"):
        smoothed = moving(on_empty=policy).smooth(zs)
        assert (smoothed.lower >= filtered.lower).all()
        assert (smoothed.lower <= smoothed.upper).all()
        np.testing.assert_array_equal(smoothed.lower[-1], filtered.lower[-1])


def test_what_keep_skipped_is_skipped_and_what_reset_forgot_is_not_told() -> None:
    zs = [0.0, 0.1, 9.0, 0.3]
    with pytest.raises(EmptyIntersectionError):
        scalar().smooth(zs)
    skipped, missing = scalar(on_empty="keep").smooth(zs), scalar().smooth([0.0, 0.1, None, 0.3])
    np.testing.assert_array_equal(skipped.lower, missing.lower)
    np.testing.assert_array_equal(skipped.upper, missing.upper)
    zs[3] = 9.4
    reset, before = scalar(on_empty="reset").smooth(zs), scalar().smooth(zs[:2])
    np.testing.assert_array_equal(reset.lower[:2], before.lower)
    filtered = scalar(on_empty="reset").filter(zs)
    assert reset.lower[2] > filtered.lower[2]

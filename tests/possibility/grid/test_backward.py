"""The way back on grids: its definition tried out exhaustively, closed families, gaps, contradictions."""

from __future__ import annotations

import tracemalloc
import warnings
from itertools import product

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FunctionMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    KalmanFilter,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import EmptyIntersectionError, ParameterError, SupportWarning
from fuzzykf.possibility.grid.backward import Message, before_prediction, smoothed
from fuzzykf.possibility.grid.lattice import Lattice, Universe
from fuzzykf.possibility.grid.noise import decompose
from fuzzykf.possibility.mapping import Mapping
from fuzzykf.possibility.norms import as_t_norm
from fuzzykf.possibility.smoother import GridWayBack
from fuzzykf.possibility.trail import Trail

#: The scalar series of the closed families, and by t-norm the smoothed center and matrix at its first step.
ZS = [0.5, 0.9, -0.1, 0.4, 0.2]
REFERENCE = {
    "product": (GaussianMembership, 0.43950, 0.25916),
    "hamacher": (CauchyMembership, 0.43535, 0.26749),
    "lukasiewicz": (ParabolicMembership, 0.44417, 0.25096),
}
MOVE = np.array([[1.0, 1.0], [0.0, 1.0]])


def tracked_back(est, zs):
    """The lattices of the filter, before and after each update, and those of the way back."""
    trail = Trail(est, copies=False)
    est._filter_noting(zs, trail.note)
    way, nodes = GridWayBack(est.on_empty), trail.nodes()
    known, found = way.last(nodes[-1]), []
    for node in reversed(nodes):
        known, _ = way.estimate(node, known)
        lattice = node.belief.lattice
        found.append((node, smoothed(lattice, known.on(lattice.axes))[0]))
        known = way.back(node, known)
    return found[::-1]


# --------------------------------------------------------------------------- the definition

UNIVERSE = np.arange(9.0)

#: Maps of the nodes onto nodes: what they lead to needs no interpolation.
MAPS = {
    "resting": lambda x: x,
    "reflected": lambda x: 8.0 - x,
    "folded": lambda x: 2.0 * np.abs(x - 4.0),
}

#: Noises for which no source between the nodes is better than the best of them.
NOISES = {
    "triangle": TriangularMembership(-2.0, 0.0, 2.0),
    "skew": TriangularMembership(-1.0, 0.0, 2.0),
    "interval": IntervalMembership(-1.0, 1.0),
}


#: Under the minimum a noise with sides meets the state between the nodes; see the dense universes below.
COMBINATIONS = [(t, noise) for t in ("product", "hamacher", "lukasiewicz") for noise in NOISES]


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize(("t_norm", "noise"), [*COMBINATIONS, ("min", "interval")])
def test_it_is_the_definition_over_all_trajectories_of_nine_points(t_norm, noise, name) -> None:
    f, membership = MAPS[name], NOISES[noise]
    est = FuzzyRelationEstimator(
        1,
        1,
        t_norm=t_norm,
        fx=f,
        state=TriangularMembership(-3.0, 3.0, 11.0),
        process_noise=membership,
        measurement_noise=TriangularMembership(-6.0, 0.0, 6.5),
        points=9,
        domain=[(0.0, 8.0)],
    )
    est.H, norm, zs = 1.0, est.t_norm, [4.0, 5.0, None, 2.0, 4.5]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SupportWarning)  # some states leave the domain
        found = tracked_back(est, zs)
    ends = [k for k, (node, _) in enumerate(found) if node.verb == "update"]
    ends.insert(2, next(k for k, (n, _) in enumerate(found) if n.verb == "predict" and k - 1 in ends[1:2]))
    # Costs of the filter and of its predictions, and of every step from node to node.
    filtered = np.array([found[k][0].belief.lattice.cost for k in ends])
    predicted = np.array(
        [found[k if z is None else k - 1][0].belief.lattice.cost for k, z in zip(ends, zs, strict=True)]
    )
    impossible = norm.impossible
    filtered, predicted = (np.where(c < impossible, c, np.inf) for c in (filtered, predicted))
    step = membership.cost((UNIVERSE - f(UNIVERSE)[:, None])[..., None], norm)
    step = np.where(step < impossible, step, np.inf)
    seen = [
        np.zeros(9) if z is None else est.measurement_noise.cost((z - UNIVERSE)[:, None], norm) for z in zs
    ]
    for n in range(5):
        gamma = np.full(9, np.inf)
        for path in product(range(9), repeat=4 - n):
            total, last = filtered[n].copy(), np.arange(9)
            for k, here in enumerate(path, start=n + 1):
                if norm.additive:
                    known = (
                        filtered[k, here] - predicted[k, here] if np.isfinite(predicted[k, here]) else np.inf
                    )
                    total = total + step[last, here] + known
                else:
                    total = np.maximum(np.maximum(total, step[last, here]), seen[k][here])
                last = here
            gamma = np.minimum(gamma, total)
        got = found[ends[n]][1].cost
        possible = np.isfinite(gamma)
        np.testing.assert_array_equal(np.isfinite(got), possible)
        np.testing.assert_allclose((got - got.min())[possible], (gamma - gamma.min())[possible], atol=1e-12)


def test_under_the_minimum_it_is_the_definition_on_dense_universes() -> None:
    universe = np.linspace(-4.0, 4.0, 1601)
    state, noise = TriangularMembership(-2.0, 0.3, 2.0), TriangularMembership(-0.8, 0.0, 0.5)
    error, zs = TriangularMembership(-1.0, 0.0, 1.5), [0.5, 1.2, 0.1, 0.4]
    est = FuzzyRelationEstimator(
        1, 1, t_norm="min", state=state, process_noise=noise, measurement_noise=error, points=301
    )
    est.F, est.H = 0.8, 1.0
    result = est.smooth(zs)
    step = noise((universe - 0.8 * universe[:, None])[..., None])
    mu, filtered = state(universe[:, None]), []
    for z in zs:
        mu = np.minimum(mu[:, None], step).max(axis=0)
        mu = np.minimum(mu, error((z - universe)[:, None]))
        mu = mu / mu.max()
        filtered.append(mu)
    later = np.ones(universe.size)
    for n in range(3, -1, -1):
        gamma = np.minimum(filtered[n], later)
        gamma = gamma / gamma.max()
        mean = (universe * gamma).sum() / gamma.sum()
        assert result.x[n, 0] == pytest.approx(mean, abs=3e-3)
        spread = ((universe - mean) ** 2 * gamma).sum() / gamma.sum()
        assert result.P[n, 0, 0] == pytest.approx(spread, rel=1e-2)
        seen = np.minimum(error((zs[n] - universe)[:, None]), later)
        later = np.minimum(step, seen).max(axis=1)


def test_a_noise_without_axes_is_the_definition_on_the_nodes() -> None:
    # a pyramid under the product: no basis makes it a sum; every node to every node
    t_norm, rng = as_t_norm("product"), np.random.default_rng(0)
    axes, universe = (np.arange(6.0), np.arange(5.0)), Universe((6, 5), None, 18.0, True)
    pyramid = TriangularMembership([-1.2, -1.5], [0.0, 0.0], [1.5, 1.2])
    source = Lattice(axes, rng.uniform(0.0, 3.0, (6, 5)), t_norm)
    message = Message(axes, rng.uniform(-1.0, 3.0, (6, 5)))
    message.cost[2, 3] = np.inf
    move = Mapping("F", 2, 2, matrix=np.eye(2), shift=np.array([1.0, -2.0]))
    got = before_prediction(source, message, move, decompose(pyramid, t_norm), universe)
    nodes = source.points.reshape(-1, 2)
    noise = pyramid.cost(nodes[None] - nodes[:, None] - move.shift, t_norm)
    expected = (noise + message.cost.ravel()).min(axis=1).reshape(6, 5)
    np.testing.assert_allclose(got.cost, expected, atol=1e-12)
    assert np.isinf(expected).any()
    fine = Message((np.linspace(2.0, 2.2, 6), np.linspace(1.0, 1.3, 5)), message.cost)  # far narrower
    got = before_prediction(source, fine, move, decompose(pyramid, t_norm), universe)
    later = Lattice(fine.axes, fine.cost, t_norm).points.reshape(-1, 2)
    noise = pyramid.cost(later[None] - nodes[:, None] - move.shift, t_norm)
    np.testing.assert_allclose(got.cost, (noise + fine.cost.ravel()).min(axis=1).reshape(6, 5), atol=1e-12)
    known = Message((axes[0], axes[1][2:3]), message.cost[:, 2:3])  # one component is known exactly
    got = before_prediction(source, known, move, decompose(pyramid, t_norm), universe)
    later = np.stack([axes[0], np.full(6, axes[1][2])], axis=1)
    noise = pyramid.cost(later[None] - nodes[:, None] - move.shift, t_norm)
    np.testing.assert_allclose(got.cost, (noise + known.cost.ravel()).min(axis=1).reshape(6, 5), atol=1e-12)


# --------------------------------------------------------------------------- the closed families


def scalar(t_norm, **options):
    shape = REFERENCE[t_norm][0]

    def sized(center, variance):
        return shape(center, variance if t_norm == "product" else np.sqrt(variance))

    est = FuzzyRelationEstimator(
        1,
        1,
        t_norm=t_norm,
        state=sized(1 / 3, 1.1 / 0.81),
        process_noise=sized(0.0, 0.4),
        measurement_noise=sized(0.0, 0.7),
        **options,
    )
    est.F, est.H = 0.9, 1.2
    return est


@pytest.mark.parametrize("t_norm", REFERENCE)
@pytest.mark.parametrize("zs", [ZS, [0.5, None, None, 0.4, None]], ids=["all seen", "gaps"])
def test_it_is_the_closed_form(t_norm, zs) -> None:
    # costs around the center, as the centroid of an uncut Cauchy membership depends on where it ends
    closed = scalar(t_norm).smooth(zs)
    est = scalar(t_norm, points=801)
    found = tracked_back(est, zs)
    ends = [found[k] for k in range(len(found)) if k + 1 == len(found) or found[k + 1][0].verb == "predict"][
        1:
    ]
    half = 0.5 if t_norm == "product" else 1.0
    for n, (_, lattice) in enumerate(ends):
        center, P = closed.x[n, 0], closed.P[n, 0, 0]
        x = center + np.linspace(-0.9, 0.9, 19) * np.sqrt(P)
        x = x[(x > closed.lower[n, 0] + 0.02) & (x < closed.upper[n, 0] - 0.02)]
        np.testing.assert_allclose(lattice.at(x[:, None]), half * (x - center) ** 2 / P, atol=1e-3)
        np.testing.assert_allclose(lattice.peak(), center, atol=1e-4)
    if zs is ZS:
        _, x, P = REFERENCE[t_norm]
        assert ends[0][1].peak()[0] == pytest.approx(x, abs=1e-4)
        back = scalar(t_norm, points=801).smooth(zs)
        if t_norm == "product":
            assert back.P[0, 0, 0] == pytest.approx(P, abs=1e-4)
        if t_norm == "lukasiewicz":  # the second moment of a parabola is a fifth of its matrix
            assert 5.0 * back.P[0, 0, 0] == pytest.approx(P, abs=1e-4)


def inverse(x):
    return x @ np.linalg.inv(MOVE).T


GAUSSIAN = {
    "noise along the axes": {"Q": np.diag([0.1, 0.2])},
    "correlated noise": {"Q": np.array([[0.1, 0.05], [0.05, 0.2]])},
    "a component without noise": {"Q": np.diag([0.0, 0.2])},
    "a function": {"Q": np.diag([0.1, 0.2]), "fx": lambda x: x @ MOVE.T},
    "a function with an inverse": {
        "Q": np.diag([0.0, 0.2]),
        "fx": lambda x: x @ MOVE.T,
        "fx_inverse": inverse,
    },
    "a start that is known": {"Q": np.diag([0.0, 0.2]), "P0": np.zeros((2, 2))},
    "a fixed domain": {"Q": np.diag([0.1, 0.2]), "domain": [(-12.0, 12.0), (-6.0, 6.0)], "points": 81},
    "likeliest noise off zero": {"Q": np.diag([0.1, 0.2]), "drift": [0.3, -0.1]},
    "correlated and off zero": {"Q": np.array([[0.1, 0.05], [0.05, 0.2]]), "drift": [0.3, -0.1]},
}


@pytest.mark.parametrize("name", GAUSSIAN)
def test_two_gaussian_components_are_those_of_the_kalman_smoother(name) -> None:
    options = {"points": 31, **GAUSSIAN[name]}
    Q, P0, drift = options.pop("Q"), options.pop("P0", np.eye(2)), np.array(options.pop("drift", [0.0, 0.0]))
    kf = KalmanFilter(2, 1, F=MOVE, H=[[1.0, 0.0]], Q=Q, R=0.5, B=np.eye(2))
    kf.P = P0
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([0.0, 0.0], P0) if P0.any() else SingletonMembership([0.0, 0.0]),
        process_noise=GaussianMembership(drift, Q),
        measurement_noise=GaussianMembership(0.0, 0.5),
        **options,
    )
    if "fx" not in options:
        est.F = MOVE
    est.H = np.array([[1.0, 0.0]])
    zs = [0.3, 0.9, None, 1.4, 2.5, 2.2]
    back, expected = est.smooth(zs), kf.smooth(zs, us=np.tile(drift[:, None], (6, 1, 1)))
    tolerance = 5e-4 if "domain" in options else 1e-5  # cells of half a deviation
    np.testing.assert_allclose(back.x, expected.x, atol=tolerance)
    np.testing.assert_allclose(back.P, expected.P, atol=tolerance)


def test_three_gaussian_components_are_those_of_the_kalman_smoother() -> None:
    F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    Q, zs = np.diag([0.3, 0.3, 0.2]), [0.3, 0.9, 1.4]
    kf = KalmanFilter(3, 1, F=F, H=[[1.0, 0.0, 0.0]], Q=Q, R=0.5)
    est = FuzzyRelationEstimator(
        3,
        1,
        state=GaussianMembership(np.zeros(3), np.eye(3)),
        process_noise=GaussianMembership(np.zeros(3), Q),
        measurement_noise=GaussianMembership(0.0, 0.5),
        points=31,
    )
    est.F, est.H = F, np.array([[1.0, 0.0, 0.0]])
    back, expected = est.smooth(zs), kf.smooth(zs)
    np.testing.assert_allclose(back.x, expected.x, atol=5e-4)
    np.testing.assert_allclose(back.P, expected.P, atol=2e-3)


# --------------------------------------------------------------------------- what users see


def robust(points=101, **options):
    est = FuzzyRelationEstimator(
        1,
        1,
        state=GaussianMembership(0.0, 0.09),
        process_noise=GaussianMembership(0.0, 0.09),
        measurement_noise=CauchyMembership(0.0, 1.0),
        points=points,
        **options,
    )
    est.F = est.H = 1.0
    return est


def noisy(n=40, seed=1):
    rng = np.random.default_rng(seed)
    x = np.cumsum(0.3 * rng.standard_normal(n))
    return x, x + rng.standard_cauchy(n)


def test_outliers_are_seen_through_from_both_sides() -> None:
    errors = np.zeros(2)
    for seed in range(3):
        x, zs = noisy(seed=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SupportWarning)  # of outliers beyond what the grid keeps
            errors += [((r.x[:, 0] - x) ** 2).sum() for r in (robust().filter(zs), robust().smooth(zs))]
    assert errors[1] < 0.75 * errors[0]


def test_the_sign_of_a_square_is_told_by_what_comes_later() -> None:
    # x^2 leaves two states; a drift to the right, seen later, says which it was
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: x + 0.5,
        hx=lambda x: x**2,
        state=TriangularMembership(-3.0, 0.0, 3.0),
        process_noise=TriangularMembership(-0.2, 0.0, 0.2),
        measurement_noise=TriangularMembership(-0.5, 0.0, 0.5),
        points=201,
    )
    zs = [1.0, 2.25, 4.0]
    filtered, back = est.copy().filter(zs), est.smooth(zs)
    assert filtered.lower[0, 0] < -0.8
    assert back.lower[0, 0] > 0.6
    assert back.x[0, 0] == pytest.approx(1.0, abs=0.1)


def test_memory_is_bounded_and_changes_nothing() -> None:
    _, zs = noisy()
    zs[[5, 6, 30]] = np.nan
    peaks, results = [], []
    for lattices in (None, 60, 16, np.inf):
        options = {} if lattices is None else {"memory": lattices * 101 * 8}
        est = robust()
        used = []
        original = Trail._add

        def counting(trail, node, used=used, original=original):
            original(trail, node)
            used.append(trail._used)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Trail, "_add", counting)
            results.append(est.smooth(zs, **options))
        peaks.append(max(used) / (101 * 8))
    for other in results[1:]:
        for name in ("x", "P", "lower", "upper", "possibility"):
            np.testing.assert_array_equal(getattr(other, name), getattr(results[0], name))
    assert peaks[0] > 100  # 37 updates with two lattices each, and 40 predictions
    assert peaks[1] <= 60
    assert peaks[2] <= 18  # and those of the steps of now


def test_memory_that_is_let_go_is_free() -> None:
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=GaussianMembership([0.0, 0.0], np.diag([0.1, 0.2])),
        measurement_noise=GaussianMembership(0.0, 0.5),
        points=41,
    )
    est.F, est.H = MOVE, np.array([[1.0, 0.0]])
    zs, size = np.linspace(0.0, 3.0, 25), 41 * 41 * 8
    peaks = []
    for lattices in (1000, 20):
        tracemalloc.start()
        est.copy().smooth(zs, memory=lattices * size)
        peaks.append(tracemalloc.get_traced_memory()[1] / size)
        tracemalloc.stop()
    assert peaks[0] > 75  # 25 steps with three lattices each
    assert peaks[1] < peaks[0] - 40


@pytest.mark.parametrize("memory", [0, -1.0, 15 * 101 * 8, np.nan, "much"])
def test_too_little_memory_is_refused(memory) -> None:
    est = robust()
    before = est.membership
    with pytest.raises(ParameterError, match="memory: got"):
        est.smooth([0.1, 0.2], memory=memory)
    np.testing.assert_array_equal(est.membership.values, before.values)


@pytest.mark.parametrize("domain", [None, [(-12.0, 12.0)]])
def test_what_keep_skipped_is_skipped_and_what_reset_forgot_is_not_told(domain) -> None:
    def made(on_empty):
        est = FuzzyRelationEstimator(
            1,
            1,
            state=TriangularMembership(-1.0, 0.0, 1.0),
            process_noise=TriangularMembership(-0.3, 0.0, 0.3),
            measurement_noise=TriangularMembership(-0.5, 0.0, 0.5),
            points=401,
            domain=domain,
            on_empty=on_empty,
        )
        est.F = est.H = 1.0
        return est

    zs = [0.0, 0.1, 9.0, 0.3]
    with pytest.raises(EmptyIntersectionError):
        made("raise").smooth(zs)
    skipped, missing = made("keep").smooth(zs), made("raise").smooth([0.0, 0.1, None, 0.3])
    for name in ("x", "P", "lower", "upper"):
        np.testing.assert_array_equal(getattr(skipped, name), getattr(missing, name))
    zs[3] = 9.4
    reset, before = made("reset").smooth(zs), made("raise").smooth(zs[:2])
    np.testing.assert_allclose(reset.x[:2], before.x[:2], atol=1e-12)
    assert reset.x[2] > made("reset").filter(zs).x[2]


def test_nothing_left_on_the_way_back_follows_on_empty() -> None:
    # a fold between the nodes of a coarse grid: no node leads exactly where the later ones are
    way = GridWayBack("raise")
    est = robust(21)
    trail = Trail(est, copies=False)
    est._filter_noting([0.1, 0.2], trail.note)
    node = trail.ends[0]
    lost = Message(node.belief.lattice.axes, np.full(21, np.inf))
    with pytest.raises(EmptyIntersectionError, match="later measurements exclude every state"):
        way.estimate(node, lost)
    known, (x, _, _, _) = GridWayBack("keep").estimate(node, lost)
    np.testing.assert_allclose(x, node.belief.moments()[0].ravel(), atol=1e-6)
    assert np.isfinite(known.cost).all()


def test_a_state_drawn_to_what_the_filter_left_out_is_told() -> None:
    # ten measurements near 0 leave nothing beyond 6 deviations; what comes then says that they were wrong
    def made(**options):
        est = FuzzyRelationEstimator(
            1,
            1,
            state=GaussianMembership(0.0, 0.01),
            process_noise=GaussianMembership(0.0, 1e-4),
            measurement_noise=GaussianMembership(0.0, 1.0),
            points=201,
            **options,
        )
        est.F = est.H = 1.0
        return est

    zs = [0.0, 0.1, *[60.0] * 5]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made(floor=0.5).smooth(zs)
    told = [str(one.message) for one in caught if str(one.message).startswith("smooth: later measurements")]
    assert len(told) == 1
    assert "choose a smaller floor" in told[0]


def test_it_works_with_a_function_of_several_measurements() -> None:
    # membership of a user's own, a vector z, and a component of it missing
    bump = FunctionMembership(lambda x: np.clip(1.0 - np.abs(x[..., 0]) ** 3, 0.0, 1.0), (-1.0, 1.0))
    est = FuzzyRelationEstimator(
        1,
        2,
        hx=lambda x: np.concatenate([x, 2.0 * x], axis=-1),
        state=bump,
        process_noise=bump,
        measurement_noise=[bump, bump],
        points=101,
    )
    zs = [[0.1, 0.3], [0.2, np.nan], [0.4, 0.7]]
    filtered, back = est.copy().filter(zs), est.smooth(zs)
    np.testing.assert_allclose(back.x[-1], filtered.x[-1], atol=1e-9)
    assert (back.upper - back.lower <= filtered.upper - filtered.lower + 1e-9).all()


class Twice(FuzzyRelationEstimator):
    """Sees every measurement twice, the second time with another error."""

    def update(self, z, *args, **kwargs):
        super().update(z, *args, **kwargs)
        super().update(None if z is None else z + 0.3, *args, **kwargs)


def test_a_state_that_is_updated_twice_is_that_of_the_closed_form() -> None:
    # The message between the two updates is below zero where the second one makes states more possible.
    given = {"x": [0.3], "F": 0.9, "H": 1.0, "Q": 0.6, "R": 0.8}
    shapes = {
        "state": GaussianMembership(0.3, 1.0),
        "process_noise": GaussianMembership(0.0, 0.6),
        "measurement_noise": GaussianMembership(0.0, 0.8),
    }
    zs = [0.5, -0.8, None, -1.0, 0.9]
    closed = Twice(1, 1, **given).smooth(zs)
    on_grid = Twice(1, 1, F=0.9, H=1.0, points=201, **shapes).smooth(zs)
    np.testing.assert_allclose(on_grid.x, closed.x, atol=1e-6)
    np.testing.assert_allclose(on_grid.P, closed.P, atol=1e-6)

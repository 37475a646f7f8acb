"""The grid estimator against the Kalman filter, brute force and the reference case."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FunctionMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    GridMembership,
    IntervalMembership,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import (
    EmptyIntersectionError,
    NumericalRangeError,
    ParameterError,
    SupportLostError,
    SupportWarning,
    UnreachableMeasurementError,
)

A = np.array([[1.0, 0.5], [-0.3, 0.9]])
H = np.array([[1.0, 0.0]])
P0 = np.array([[0.25, 0.05], [0.05, 0.16]])
ZS = [0.35, None, 0.05, 0.6, -0.2, 0.1]
INVERSE = np.linalg.inv(A)

MODELS = {
    "matrices": {},
    "functions": {"fx": lambda x: x @ A.T, "hx": lambda x: x @ H.T},
    "inverse": {
        "fx": lambda x: x @ A.T,
        "hx": lambda x: x @ H.T,
        "fx_inverse": lambda x: x @ INVERSE.T,
    },
}


def kalman(F, C, Q, R, x, P):
    est = FuzzyRelationEstimator(len(F), len(C))
    est.F, est.H, est.Q, est.R, est.x, est.P = F, C, Q, R, np.reshape(x, (-1, 1)), P
    assert est.representation == "gaussian"
    return est


def grid(Q, model="matrices", F=A, C=H, R=0.09, x=(0.3, -0.2), P=P0, **options):
    state = SingletonMembership(x) if P is None else GaussianMembership(x, P)
    est = FuzzyRelationEstimator(
        len(F),
        len(C),
        state=state,
        process_noise=GaussianMembership(np.zeros(len(F)), Q),
        measurement_noise=GaussianMembership(0.0, R),
        **MODELS[model],
        **options,
    )
    if model == "matrices":
        est.F, est.H = F, C
    assert est.representation == "grid"
    return est


def largest_errors(est, kf, zs):
    """Largest error of centroid (in sigmas) and of P (relative to the sigmas) after any verb."""
    worst_x, worst_P = 0.0, 0.0
    for z in zs:
        for verb in ("predict", "update"):
            for f in (est, kf):
                f.predict() if verb == "predict" else f.update(z)
            sigma = np.sqrt(np.diag(kf.P))
            worst_x = max(worst_x, (np.abs(est.x - kf.x).ravel() / sigma).max())
            worst_P = max(worst_P, (np.abs(est.P - kf.P) / np.outer(sigma, sigma)).max())
            assert est.possibility == pytest.approx(kf.possibility, abs=1e-9)
    return worst_x, worst_P


# ------------------------------------------------------------------ accuracy asked for


def domain_with(cells, half=4.0):
    """A domain of 2 half, cut so that a standard deviation of 0.3 has that many cells."""
    return {"points": int(2 * half / 0.3 * cells) + 1, "domain": ((-half, half), (-half, half))}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("cells", "tol_x", "tol_P"), [(10, 1e-4, 1e-3), (2.5, 1e-2, 1e-2)])
def test_against_the_kalman_filter(model, cells, tol_x, tol_P):
    Q = np.diag([0.01, 0.04])
    kf = kalman(A, H, Q, 0.09, [0.3, -0.2], P0)
    errors = largest_errors(grid(Q, model, **domain_with(cells)), kf, ZS)
    assert errors[0] < tol_x
    assert errors[1] < tol_P


NOISES = {
    "correlated": np.array([[0.01, 0.015], [0.015, 0.04]]),
    "rank one": np.outer([0.1, 0.2], [0.1, 0.2]),
    "one axis": np.diag([0.0, 0.04]),
    "none": np.zeros((2, 2)),
}


@pytest.mark.parametrize("model", ["matrices", "functions"])
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("points", [31, 81])
def test_moving_grid_is_exact_for_gaussians(model, noise, points):
    # quadratic costs are interpolated and convolved without error: 1e-6 even at 2.5 cells per sigma
    Q = NOISES[noise]
    kf = kalman(A, H, Q, 0.09, [0.3, -0.2], P0)
    errors = largest_errors(grid(Q, model, points=points), kf, ZS)
    assert max(errors) < 1e-6


def test_public_grid_case(fuzzy_cases):
    case = fuzzy_cases["grid1 sin dynamics, quadratic measurement"]
    assert (case["tnorm"], case["dynamics"], case["measurement"]) == ("product", "x+0.5 sin(x)", "x^2/4")
    shapes = {
        name: GaussianMembership(case[name].get("center", 0.0), case[name]["scale"] ** 2)
        for name in ("prior", "w", "v")
    }
    for options in ({"domain": case["domain"]}, {}):
        est = FuzzyRelationEstimator(
            1,
            1,
            fx=lambda x: x + 0.5 * np.sin(x),
            hx=lambda x: x**2 / 4,
            state=shapes["prior"],
            process_noise=shapes["w"],
            measurement_noise=shapes["v"],
            points=case["suggested_grid"],
            **options,
        )
        for z, expected in zip(case["z"], case["expected"], strict=True):
            est.step(z)
            assert est.x.item() == pytest.approx(expected["cog"], abs=case["tol_cog"])
            # far better than asked for: the reference itself changed by 5e-8 at its last refinement
            assert est.x.item() == pytest.approx(expected["cog"], abs=2e-5)
            assert est.defuzzify("peak").item() == pytest.approx(expected["peak"], abs=1e-3)
            m = est.membership
            assert np.trapezoid(m.values, m.axes[0]) == pytest.approx(expected["area"], abs=3e-3)


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize(
    ("angle", "factor"), [(np.pi / 4, 1.0), (0.0, 1.5), (np.pi / 4, 1.5)], ids=["turn", "stretch", "both"]
)
@pytest.mark.parametrize("fixed", [False, True])
def test_rotation_and_expansion_leave_no_holes(invert, angle, factor, fixed):
    M = factor * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    back = np.linalg.inv(M)
    state = GaussianMembership([0.0, 0.0], [[1.0, 0.3], [0.3, 0.5]])
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: x @ M.T,
        fx_inverse=(lambda x: x @ back.T) if invert else None,
        state=state,
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=101,
        domain=((-9.0, 9.0), (-9.0, 9.0)) if fixed else None,
    )
    est.predict()
    nodes = np.stack(np.meshgrid(*est.membership.axes, indexing="ij"), axis=-1)
    exact = state(nodes @ back.T)
    inside = exact > 1e-6
    assert (est.membership.values[inside] > 0.0).all()
    np.testing.assert_allclose(est.membership.values, exact, atol=1e-7)
    np.testing.assert_allclose(est.P, M @ state.covariance @ M.T, rtol=1e-4)


# ------------------------------------------------------------------ other shapes and norms


SHAPES = {
    "gauss": lambda c, s: GaussianMembership(c, s * s),
    "cauchy": CauchyMembership,
    "cut cauchy": lambda c, s: CauchyMembership(c, s).cut(0.5),
    "triangle": lambda c, s: TriangularMembership(c - 2 * s, c, c + s),
    "parabola": lambda c, s: ParabolicMembership(c, 2 * s),
    "interval": lambda c, s: IntervalMembership(c - s, c + s),
}

#: Largest errors of centroid, of P relative to P, and of the possibility, at 401 nodes (0.02 apart;
#: a support with a jump at its edge is known to a node, hence P to 15 %).
TOLERANCES = {
    "gauss": (1e-3, 2e-2, 5e-3),
    "cauchy": (2e-3, 3e-2, 5e-3),
    "cut cauchy": (2e-2, 0.15, 1e-2),
    "triangle": (5e-3, 5e-2, 4e-2),
    "parabola": (2e-3, 1e-2, 4e-3),
    "interval": (2e-2, 0.15, 1e-9),
}


@pytest.mark.parametrize("t_norm", ["product", "min", "lukasiewicz", "hamacher"])
@pytest.mark.parametrize("shape", SHAPES)
def test_against_brute_force(t_norm, shape, brute_force):
    def f(x):
        return x + 0.5 * np.sin(x)

    def h(x):
        return x + 0.1 * x**3

    state, process, measurement = (SHAPES[shape](c, s) for c, s in ((0.5, 1.0), (0.0, 0.3), (0.0, 0.4)))
    # under Łukasiewicz sharp shapes soon exclude each other
    zs = [None, 0.5, 0.7, None, 0.2] if t_norm != "lukasiewicz" else [None, 0.5, 0.6, None, 0.7]
    n = 2001 if shape in ("interval", "cut cauchy") else 1001  # a jump is known to a node
    expected = brute_force(f, h, state, process, measurement, t_norm, zs, -4.0, 4.0, n)
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=f,
        hx=h,
        state=state,
        process_noise=process,
        measurement_noise=measurement,
        t_norm=t_norm,
        points=401,
        domain=((-4.0, 4.0),),
    )
    tol_x, tol_P, tol_possibility = TOLERANCES[shape]
    for z, (mean, spread, possibility) in zip(zs, expected, strict=True):
        est.step(z)
        assert est.x.item() == pytest.approx(mean, abs=tol_x)
        assert est.P.item() == pytest.approx(spread, rel=tol_P)
        assert est.possibility == pytest.approx(possibility, abs=tol_possibility)


def test_grid_of_intervals_is_the_interval_estimator():
    given = {
        "fx": lambda x: 0.9 * x + 0.3,
        "hx": lambda x: x + 0.1 * x**3,
        "state": IntervalMembership(-1.0, 1.0),
        "process_noise": IntervalMembership(-0.3, 0.5),
        "measurement_noise": IntervalMembership(-0.4, 0.4),
    }
    exact, on_grid = FuzzyRelationEstimator(1, 1, **given), FuzzyRelationEstimator(1, 1, points=801, **given)
    for z in (0.5, None, 0.9, 0.7):
        for f in (exact, on_grid):
            f.step(z)
        cell = on_grid.membership.axes[0][1] - on_grid.membership.axes[0][0]
        # nothing that is possible is lost, and little is added
        assert on_grid.lower[0] <= exact.lower[0] + 1e-12
        assert on_grid.upper[0] >= exact.upper[0] - 1e-12
        np.testing.assert_allclose(on_grid.lower, exact.lower, atol=4 * cell)
        np.testing.assert_allclose(on_grid.upper, exact.upper, atol=4 * cell)


def test_maps_that_fold():
    # y = x^2 with x ~ N(0.7, 1): both roots count, the better one wins
    state = GaussianMembership(0.7, 1.0)
    est = FuzzyRelationEstimator(
        1, 1, fx=lambda x: x**2, state=state, measurement_noise=GaussianMembership(0.0, 1.0), points=2001
    )
    est.predict()
    y = np.array([0.1, 0.5, 1.0, 3.0, 8.0])
    np.testing.assert_allclose(est.membership(y), state(np.sqrt(y)), atol=2e-3)
    assert est.membership(-0.3) == 0.0


def test_maps_that_are_flat_in_places():
    # max(x, 0) sends half of all states to zero: the supremum over them stays
    state = GaussianMembership(-0.5, 1.0)
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: np.maximum(x, 0.0),
        state=state,
        process_noise=GaussianMembership(0.0, 0.04),
        measurement_noise=GaussianMembership(0.0, 1.0),
    )
    est.predict()
    x = np.linspace(-0.6, 2.5, 32)
    y = np.linspace(0.0, 6.0, 60001)
    mu = np.where(y > 0, state(y), 1.0)
    exact = [(mu * np.exp(-0.5 * ((v - y) / 0.2) ** 2)).max() for v in x]
    np.testing.assert_allclose(est.membership(x), exact, atol=5e-3)


def test_a_constant_map_leaves_only_the_noise():
    noise = TriangularMembership(-1.0, 0.0, 2.0)
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: 0.0 * x + 5.0,
        state=GaussianMembership(0.0, 1.0),
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 1.0),
    )
    est.predict()
    x = np.linspace(3.5, 7.5, 101)
    np.testing.assert_allclose(est.membership(x), noise(x - 5.0), atol=0.02)


def test_singular_maps():
    # x' = (x1 + x2, 0): a line, and the second component known
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: np.stack([x.sum(axis=-1), 0.0 * x[..., 0]], axis=-1),
        state=GaussianMembership([1.0, 2.0], [[1.0, 0.3], [0.3, 0.5]]),
        process_noise=[None, GaussianMembership(0.0, 0.09)],
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=101,
    )
    est.predict()
    np.testing.assert_allclose(est.x.ravel(), [3.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(est.P, np.diag([2.1, 0.09]), atol=5e-3)


JOINT = {
    "ellipse": ("product", ParabolicMembership([0.2, 0.1], [[0.5, 0.2], [0.2, 0.3]])),
    "min": ("min", GaussianMembership([0.0, 0.0], [[0.3, 0.1], [0.1, 0.2]])),
    "function": (
        "hamacher",
        FunctionMembership(lambda x: np.exp(-2.0 * np.abs(x).sum(axis=1)), [(-1.0, 1.0), (-1.0, 1.0)]),
    ),
}


@pytest.mark.parametrize("name", JOINT)
def test_noise_without_axes(name):
    # oracle: all pairs of nodes of a lattice
    t_norm, noise = JOINT[name]
    state = ParabolicMembership([1.0, -1.0], [1.5, 1.0])
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: x @ A.T,
        state=state,
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 1.0),
        t_norm=t_norm,
        points=161,
        domain=((-4.0, 4.0), (-5.0, 3.0)),
    )
    est.predict()
    axes = np.linspace(-0.6, 2.6, 641), np.linspace(-2.1, 0.1, 441)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    mu, images = state(x), x @ A.T
    probes = np.array([[0.5, -1.2], [1.5, -2.0], [0.0, -1.0], [-0.5, -0.9], [2.2, -1.5]])
    combine = {"product": np.multiply, "min": np.minimum}.get(
        t_norm, lambda a, b: np.where(a * b > 0, a * b / np.maximum(a + b - a * b, 1e-300), 0.0)
    )
    exact = [combine(mu, noise(p - images)).max() for p in probes]
    np.testing.assert_allclose(est.membership(probes), exact, atol=0.02)


def test_joint_noise_of_a_known_state():
    noise = ParabolicMembership([0.2, 0.1], [[0.5, 0.2], [0.2, 0.3]])
    est = FuzzyRelationEstimator(
        2,
        1,
        state=SingletonMembership([1.0, -1.0]),
        process_noise=noise,
        measurement_noise=GaussianMembership(0.0, 1.0),
    )
    est.predict()
    np.testing.assert_allclose(est.x.ravel(), [1.2, -0.9], atol=1e-9)
    np.testing.assert_allclose(est.P, noise.matrix / 6, atol=1e-4)  # moments of a paraboloid


# ------------------------------------------------------------------ dimensions


T = 0.5
ACCELERATION = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
POSITION = np.array([[1.0, 0.0, 0.0]])


@pytest.mark.parametrize("noise", ["acceleration", "all", "rank one"])
def test_three_dimensions(noise):
    g = np.array([T * T / 2, T, 1.0])
    Q = {"acceleration": np.diag([0, 0, 0.04]), "all": np.diag([0.01, 0.02, 0.04])}.get(
        noise, 0.04 * np.outer(g, g)
    )
    start = np.zeros(3), np.diag([0.5, 0.3, 0.2])
    kf = kalman(ACCELERATION, POSITION, Q, 0.1, *start)
    est = grid(Q, F=ACCELERATION, C=POSITION, R=0.1, x=start[0], P=start[1], points=41)
    assert max(largest_errors(est, kf, [0.3, None, 0.8, 1.1])) < 1e-6


def test_a_known_state_spreads_axis_by_axis():
    # position and velocity known, noise on the velocity: a line first, then a parallelogram
    F = np.array([[1.0, T], [0.0, 1.0]])
    Q = np.diag([0.0, 0.04])
    kf = kalman(F, H, Q, 0.1, [0.0, 0.0], np.zeros((2, 2)))
    est = grid(Q, F=F, R=0.1, x=(0.0, 0.0), P=None, points=61)
    sizes = []
    for z in (0.1, 0.2, None, 0.3, 0.5):
        kf.step(z)
        est.step(z)
        sizes.append(est.membership.values.shape)
        np.testing.assert_allclose(est.x, kf.x, atol=1e-7)
        np.testing.assert_allclose(est.P, kf.P, atol=1e-7)
    assert sizes[:2] == [(1, 61), (61, 61)]


def test_a_known_state_in_three_dimensions():
    # after two steps the possible states are a sheet oblique to the axes, kept half a step thick
    Q = np.diag([0.0, 0.0, 0.04])
    kf = kalman(ACCELERATION, POSITION, Q, 0.1, np.zeros(3), np.zeros((3, 3)))
    est = grid(Q, F=ACCELERATION, C=POSITION, R=0.1, x=np.zeros(3), P=None, points=31)
    for z in (0.1, 0.2, None, 0.3):
        kf.step(z)
        est.step(z)
        sigma = np.sqrt(np.diag(kf.P))
        assert (np.abs(est.x - kf.x).ravel() <= 0.01 * sigma + 1e-9).all()
        assert (np.abs(np.sqrt(np.diag(est.P)) - sigma) <= 0.02 * sigma + 1e-9).all()


def test_sets_between_the_nodes_of_a_fixed_grid():
    # cells of 200 m: the first metres of a launch are lost by scattering, kept here
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: np.stack([x[..., 0] + 2.0 * x[..., 1], x[..., 1]], axis=-1),
        state=SingletonMembership([1000.0, 20.0]),
        process_noise=[None, TriangularMembership(-5.0, 0.0, 5.0)],
        measurement_noise=GaussianMembership(0.0, 1e4),
        points=101,
        domain=((0.0, 20000.0), (0.0, 100.0)),
    )
    est.H = H
    for _ in range(10):
        est.predict()
    assert est.x[0, 0] == pytest.approx(1000.0 + 10 * 40.0, abs=100.0)
    assert est.x[1, 0] == pytest.approx(20.0, abs=1.0)


# ------------------------------------------------------------------ the moving grid


def scalar(**options):
    return FuzzyRelationEstimator(
        1,
        1,
        **{
            "fx": lambda x: x,
            "hx": lambda x: x,
            "state": GaussianMembership(0.0, 1.0),
            "process_noise": GaussianMembership(0.0, 1.0),
            "measurement_noise": GaussianMembership(0.0, 1.0),
            **options,
        },
    )


def test_grid_follows_and_refines():
    # a drifting state with ever better measurements: no universe was given, nothing is lost
    est = scalar(fx=lambda x: x + 100.0, process_noise=GaussianMembership(0.0, 1e-4))
    widths = []
    for k in range(1, 30):
        est.step(100.0 * k)
        axis = est.membership.axes[0]
        widths.append(axis[-1] - axis[0])
        assert axis.size == 401
        assert axis[0] < 100.0 * k < axis[-1]
        assert est.x.item() == pytest.approx(100.0 * k, abs=1e-6)
    assert widths[-1] < 0.5 * widths[0]


@pytest.mark.parametrize("sigmas", [8.0, 20.0, 200.0])
def test_outliers_extend_the_grid_and_say_so(sigmas):
    est = scalar()
    est.predict()
    z = sigmas * np.sqrt(3.0)
    with pytest.warns(SupportWarning, match="beyond the states that the grid kept"):
        est.update(z)
    assert est.x.item() == pytest.approx(2 / 3 * z, rel=1e-6)
    assert est.P.item() == pytest.approx(2 / 3, rel=1e-6)


def test_outlier_in_the_plane():
    kf = kalman(A, H, 0.1 * np.eye(2), 0.1, [0.0, 0.0], np.eye(2))
    est = grid(0.1 * np.eye(2), "functions", R=0.1, x=(0.0, 0.0), P=np.eye(2), points=101)
    kf.step(50.0)
    est.predict()
    with pytest.warns(SupportWarning, match="extrapolated"):
        est.update(50.0)
    np.testing.assert_allclose(est.x, kf.x, rtol=1e-5)
    np.testing.assert_allclose(est.P, kf.P, rtol=1e-5)


@pytest.mark.parametrize("width", [1e-3, 1e-6])
def test_precise_measurements_refine_the_grid(width):
    # a million times narrower than the prediction
    est = scalar(measurement_noise=GaussianMembership(0.0, width**2))
    est.step(0.3)
    assert est.x.item() == pytest.approx(0.3, abs=width)
    assert est.P.item() == pytest.approx(width**2, rel=1e-3)
    narrow = scalar(measurement_noise=IntervalMembership(-width, width))
    narrow.step(0.3)
    assert narrow.x.item() == pytest.approx(0.3, abs=width)
    assert narrow.P.item() == pytest.approx(width**2 / 3, rel=0.02)


def ring(sigma, points):
    return FuzzyRelationEstimator(
        2,
        1,
        hx=lambda x: np.hypot(x[..., :1], x[..., 1:]),
        state=GaussianMembership([1.0, 0.0], np.eye(2)),
        measurement_noise=GaussianMembership(0.0, sigma**2),
        points=points,
    )


def test_a_measurement_finer_than_the_cells_is_told():
    fine = ring(0.03, 801)
    fine.update(2.0)
    coarse = ring(0.01, 101)
    with pytest.warns(SupportWarning, match="finer than the cells"):
        coarse.update(2.0)
    # judged by the best of each cell the ring stays whole, instead of a few lucky nodes
    np.testing.assert_allclose(coarse.x, fine.x, atol=0.02)
    np.testing.assert_allclose(coarse.P, fine.P, atol=0.06)


def test_too_thin_a_ridge_is_told():
    # two components that are almost the same: no grid along the axes can resolve that
    P = [[1.0, 0.99999], [0.99999, 1.0]]
    est = grid(np.zeros((2, 2)), F=np.eye(2), x=(0.0, 0.0), P=P, points=31)
    with pytest.warns(SupportWarning, match="narrower than a tenth of the cells"):
        est.predict()


# ------------------------------------------------------------------ fixed universe


def test_fixed_universe_keeps_its_axes():
    est = scalar(domain=((-8.0, 8.0),), points=161)
    for z in (0.3, None, 1.0):
        est.step(z)
        np.testing.assert_array_equal(est.membership.axes[0], np.linspace(-8.0, 8.0, 161))


def test_unbounded_memberships_are_limited_by_the_domain_alone():
    # a Cauchy membership reaches the edges of any domain: that is no loss to be reported
    est = scalar(
        state=CauchyMembership(0.0, 1.0), process_noise=CauchyMembership(0.0, 0.1), domain=((-20.0, 20.0),)
    )
    est.predict()
    assert est.membership(19.9) == pytest.approx(1 / (1 + 19.9**2), rel=0.1)


def test_loss_at_an_edge_is_told():
    est = scalar(fx=lambda x: x + 3.0, domain=((-8.0, 8.0),))
    est.predict()
    est.predict()
    with pytest.warns(SupportWarning, match=r"states of membership up to [\d.]+ leave it"):
        est.predict()  # now the mode is at 9
    assert est.upper[0] == 8.0


def test_loss_of_a_bounded_support_is_told_early():
    triangle = TriangularMembership(-1.0, 0.0, 1.0)
    est = scalar(
        fx=lambda x: x + 1.05, state=triangle, process_noise=triangle, domain=((-5.0, 4.0),), points=181
    )
    est.predict()
    with pytest.warns(SupportWarning, match="widen the domain"):
        est.predict()


@pytest.mark.parametrize(
    ("state", "level", "told"),
    [
        ("gaussian", 0.45, False),
        ("gaussian", 0.55, True),  # more than one half of what has tails without end
        ("triangle", 0.007, False),
        ("triangle", 0.015, True),  # more than one hundredth of what has none
    ],
)
def test_how_much_of_a_loss_is_told(state, level, told):
    # one step takes the peak to where the membership at the edge of the domain, 4, is the level
    if state == "gaussian":
        state, reach = GaussianMembership(0.0, 1.0), np.sqrt(-2.0 * np.log(level))
    else:
        state, reach = TriangularMembership(-1.0, 0.0, 1.0), 1.0 - level
    est = scalar(
        fx=lambda x: x + (4.0 - reach), state=state, process_noise=None, domain=((-4.0, 4.0),), points=3201
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        est.predict()
    notes = [str(w.message) for w in caught if "states of membership up to" in str(w.message)]
    assert bool(notes) == told
    if told:
        found = float(re.search(r"up to ([\d.]+) leave", notes[0])[1])
        assert found == pytest.approx(level, abs=0.005)


def test_loss_of_everything_is_an_error():
    est = scalar(fx=lambda x: x + 100.0, domain=((-8.0, 8.0),))
    before = est.membership.values
    with pytest.raises(SupportLostError, match=r"domain: all possible states have left \[\[-8.0, 8.0\]\]"):
        est.predict()
    np.testing.assert_array_equal(est.membership.values, before)
    known = scalar(
        fx=lambda x: x + 100.0, state=SingletonMembership(0.0), process_noise=None, domain=((-8, 8),)
    )
    with pytest.raises(SupportLostError, match="domain: all possible states have left"):
        known.predict()


def test_warnings_as_errors_leave_the_state():
    est = scalar(fx=lambda x: x + 6.0, domain=((-8.0, 8.0),))
    est.predict()
    before = est.x.copy()
    with pytest.raises(SupportWarning):  # pytest turns warnings into errors
        est.predict()
    np.testing.assert_array_equal(est.x, before)


def test_a_state_between_the_nodes_is_refused():
    with pytest.raises(ParameterError, match="state: no node of the grid is possible; ask for more points"):
        scalar(state=TriangularMembership(0.01, 0.02, 0.03), domain=((-8.0, 8.0),), points=17)


# ------------------------------------------------------------------ empty intersections


def bounded(**options):
    triangle = TriangularMembership(-1.0, 0.0, 1.0)
    return scalar(state=triangle, process_noise=triangle, measurement_noise=triangle, **options)


@pytest.mark.parametrize("fixed", [{}, {"domain": ((-60.0, 60.0),), "points": 1201}])
def test_empty_intersection_policies(fixed):
    est = bounded(**fixed)
    est.predict()
    before = est.membership.values
    with pytest.raises(EmptyIntersectionError, match=r"z: got \[50.0\], which no possible state explains"):
        est.update(50.0)
    np.testing.assert_array_equal(est.membership.values, before)
    kept, restarted = bounded(on_empty="keep", **fixed), bounded(on_empty="reset", **fixed)
    for f in (kept, restarted):
        f.step(50.0)
        assert f.possibility == 0.0
    assert kept.x.item() == pytest.approx(0.0, abs=1e-9)
    assert restarted.x.item() == pytest.approx(50.0, abs=0.02)
    np.testing.assert_allclose([restarted.lower, restarted.upper], [[49.0], [51.0]], atol=0.15)


def test_measurement_out_of_reach():
    # outside the universe nothing explains it; and cos never is 3
    with pytest.raises(UnreachableMeasurementError, match="hx does not reach from any state"):
        bounded(domain=((-100.0, 100.0),)).step(500.0)
    with pytest.raises(UnreachableMeasurementError):
        bounded(hx=np.cos).step(3.0)
    with pytest.raises(UnreachableMeasurementError, match="nothing to restart from"):
        bounded(hx=np.cos, on_empty="reset").step(3.0)
    # the prediction excludes what is reached elsewhere; a square is never negative
    with pytest.raises(EmptyIntersectionError) as error:
        bounded(hx=np.square).step(500.0)
    assert not isinstance(error.value, UnreachableMeasurementError)
    with pytest.raises(UnreachableMeasurementError):
        bounded(hx=np.square).step(-5.0)
    with pytest.raises(UnreachableMeasurementError):
        bounded(hx=np.square, domain=((-10.0, 10.0),)).step(-5.0)


def test_restart_keeps_the_bounds_of_what_is_not_observed():
    est = FuzzyRelationEstimator(
        2,
        1,
        state=ParabolicMembership([0.0, 0.0], 1.0),
        measurement_noise=TriangularMembership(-1.0, 0.0, 1.0),
        on_empty="reset",
    )
    est.H = H
    est.step(50.0)
    np.testing.assert_allclose(est.x.ravel(), [50.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(est.upper, [51.0, 1.0], atol=0.1)


# ------------------------------------------------------------------ partial measurements


def test_part_of_a_measurement():
    def pair(noise):
        est = FuzzyRelationEstimator(
            1,
            2,
            hx=lambda x: np.concatenate([x, 2 * x], axis=-1),
            state=GaussianMembership(0.0, 1.0),
            measurement_noise=noise,
        )
        est.update([np.nan, 1.0])
        return est

    one = scalar(hx=lambda x: 2 * x, measurement_noise=CauchyMembership(0.0, 0.7))
    one.update(1.0)
    joint = CauchyMembership([0.0, 0.0], [[0.2, 0.1], [0.1, 0.49]])
    per_component = [GaussianMembership(0.0, 1.0), CauchyMembership(0.0, 0.7)]
    for noise in (joint, per_component):
        est = pair(noise)
        np.testing.assert_allclose(est.x, one.x, atol=1e-9)
        np.testing.assert_allclose(est.P, one.P, atol=1e-9)


@pytest.mark.parametrize("row", [[3.0, 1.0], [1.0, 3.0], [1.0, 1.0]])
@pytest.mark.parametrize("z", [0.0, 0.5, 1.0])
def test_a_sum_that_is_all_that_is_known_leaves_a_valley(row, z):
    # all states on a line are equally good: the second differences at the best node are exactly singular
    est = FuzzyRelationEstimator(
        2,
        1,
        H=[row],
        state=IntervalMembership([-4.0, -4.0], [4.0, 4.0]),
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=17,
        domain=((-4.0, 4.0), (-4.0, 4.0)),
    )
    est.update(z)
    assert est.possibility == pytest.approx(1.0, abs=1e-9)
    x = np.stack(np.meshgrid(np.linspace(-4.0, 4.0, 17), np.linspace(-4.0, 4.0, 17), indexing="ij"), axis=-1)
    np.testing.assert_allclose(est.membership(x), np.exp(-0.5 * (x @ row - z) ** 2), atol=1e-9)


def test_sampled_memberships():
    # a Gaussian given on a grid: linear between its nodes
    x = np.linspace(-5.0, 5.0, 2001)
    est = scalar(state=GridMembership(x, np.exp(-0.5 * x**2)))
    exact = scalar()
    for f in (est, exact):
        f.step(0.7)
    np.testing.assert_allclose(est.x, exact.x, atol=1e-4)
    np.testing.assert_allclose(est.P, exact.P, atol=1e-3)


# --------------------------------------------------------------------------- beyond what a grid can hold


def narrow(kind, d):
    """A membership of width about one."""
    return {
        "gaussian": GaussianMembership(np.zeros(d), np.eye(d)),
        "cauchy": CauchyMembership(np.zeros(d), np.eye(d)),
        "parabolic": ParabolicMembership(np.zeros(d), np.eye(d)),
    }[kind]


@pytest.mark.filterwarnings("ignore::fuzzykf.errors.SupportWarning")
@pytest.mark.parametrize("size", [1e2, 1e3, 1e4, 1e6, 1e50, 1e308])
@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize("kind", ["gaussian", "cauchy", "parabolic"])
def test_an_outlier_is_followed_or_refused_and_leaves_nothing_behind(kind, d, size):
    def fx(x):
        return 0.9 * x + 0.1 * np.sin(x[..., ::-1])

    est = FuzzyRelationEstimator(
        d,
        1,
        fx=fx,
        hx=lambda x: x[..., :1],
        state=narrow(kind, d),
        process_noise=narrow(kind, d),
        measurement_noise=narrow(kind, 1),
        points=61,
    )
    refused, told = [], []
    for z in (0.1, 0.2, size, 0.3, -0.1, 0.2):
        before = [np.array(est.x), np.array(est.P)]
        try:
            est.step(z)
        except (NumericalRangeError, EmptyIntersectionError) as error:
            refused.append(z)
            told.append(str(error))
            for then, now in zip(before, (est.x, est.P), strict=True):
                np.testing.assert_array_equal(now, then)
        assert np.isfinite(est.x).all()
        assert np.isfinite(est.P).all()
        assert (np.diagonal(est.P) >= 0.0).all()
    assert [text.startswith(f"z: got [{z}]") for z, text in zip(refused, told, strict=True)] == [True] * len(
        told
    )
    assert size not in refused or refused == [size]
    if kind == "gaussian" and size != 1e4:  # where it begins depends on the cells
        assert refused == ([] if size < 1e4 else [size])


@pytest.mark.parametrize("linear", [True, False])
def test_what_is_impossible_stays_impossible_in_a_domain(linear) -> None:
    # Of the costs of impossible nodes, which Lukasiewicz's norm leaves finite, none may come below 1 again.
    model = {"F": 0.9, "H": 1.0} if linear else {"fx": lambda x: 0.9 * x, "hx": lambda x: x}
    options = {
        "state": ParabolicMembership(0.3, 4.0),
        "process_noise": ParabolicMembership(0.0, 0.1848549),
        "measurement_noise": TriangularMembership(-4.0, 0.0, 3.0),
        "t_norm": "lukasiewicz",
        "points": 201,
    }
    fixed = FuzzyRelationEstimator(1, 1, **model, **options, domain=[(-6.0, 6.0)])
    moving = FuzzyRelationEstimator(1, 1, **model, **options)
    zs = [None, None, -0.2, 0.4, 0.9, None]
    found, expected = fixed.filter(zs), moving.filter(zs)
    np.testing.assert_allclose(found.x, expected.x, atol=0.01)
    np.testing.assert_allclose(found.P, expected.P, atol=0.01)
    assert (fixed.lower >= moving.lower - 0.1).all()
    assert (fixed.upper <= moving.upper + 0.1).all()

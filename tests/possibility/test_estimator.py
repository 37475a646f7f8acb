"""The estimator as a filter: its representations, the Gaussian one as a Kalman filter, its contract."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from filterpy.common import Saver
from filterpy.kalman import IMMEstimator as FilterpyIMM
from filterpy.kalman import KalmanFilter as FilterpyKF

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    IntervalMembership,
    KalmanFilter,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import EmptyIntersectionError, NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.testing.check import check_filter

F = np.array([[1.0, 1.0], [0.0, 1.0]])
H = np.array([[1.0, 0.0]])


def gaussian(**matrices):
    est = FuzzyRelationEstimator(2, 1)
    est.F, est.H, est.Q, est.R = F, H, 0.1 * np.eye(2), 0.5
    for name, value in matrices.items():
        setattr(est, name, value)
    return est


# ------------------------------------------------------------------ the rule


GAUSS, CAUCHY, PARABOLA, BOX = (
    GaussianMembership(0.0, 1.0),
    CauchyMembership(0.0, 1.0),
    ParabolicMembership(0.0, 1.0),
    IntervalMembership(-1.0, 1.0),
)


def same(x):
    return x


@pytest.mark.parametrize(
    ("expected", "shapes", "options"),
    [
        ("gaussian", (None, None, None), {}),
        ("gaussian", (GAUSS, GAUSS, GAUSS), {}),
        ("gaussian", (SingletonMembership(0.0), [GAUSS], [GAUSS]), {}),
        ("gaussian", (GAUSS, [None], GAUSS), {}),
        ("cauchy", (CAUCHY, CAUCHY, CAUCHY), {"t_norm": "hamacher"}),
        ("cauchy", (None, None, None), {"t_norm": "hamacher"}),
        ("parabolic", (PARABOLA, None, PARABOLA), {"t_norm": "lukasiewicz"}),
        ("interval", (BOX, BOX, BOX), {}),
        ("interval", (BOX, None, BOX), {"t_norm": "min", "fx": same, "hx": same}),
        ("interval", (SingletonMembership(0.0), [BOX], BOX), {"fx": same}),
        ("grid", (GAUSS, GAUSS, GAUSS), {"points": 51}),
        ("grid", (BOX, BOX, BOX), {"domain": [(-9.0, 9.0)]}),
        ("grid", (GAUSS, GAUSS, GAUSS), {"fx": same}),
        ("grid", (GAUSS, GAUSS, GAUSS), {"t_norm": "min"}),
        ("grid", (CAUCHY, CAUCHY, CAUCHY), {}),
        ("grid", (GAUSS, BOX, GAUSS), {}),
        ("grid", (CAUCHY.cut(0.5), CAUCHY, CAUCHY), {"t_norm": "hamacher"}),
    ],
)
def test_representation_follows_the_memberships(expected, shapes, options):
    state, process, measurement = shapes
    est = FuzzyRelationEstimator(
        1, 1, state=state, process_noise=process, measurement_noise=measurement, **options
    )
    assert est.representation == expected


def test_boxes_need_linear_maps_or_extensions():
    box = IntervalMembership([0.0, 0.0], [1.0, 1.0])
    given = {"state": box, "measurement_noise": BOX}
    assert FuzzyRelationEstimator(2, 1, **given).representation == "interval"
    assert FuzzyRelationEstimator(2, 1, fx=same, **given).representation == "grid"
    extended = FuzzyRelationEstimator(2, 1, fx=same, fx_interval=lambda a, b: (a, b), **given)
    assert extended.representation == "interval"


def test_defaults_are_those_of_filterpy():
    est, kf = FuzzyRelationEstimator(3, 2), FilterpyKF(dim_x=3, dim_z=2)
    for name in ("x", "P", "F", "H", "Q", "R", "y", "S", "SI", "K", "x_prior", "P_prior", "x_post", "P_post"):
        np.testing.assert_array_equal(getattr(est, name), getattr(kf, name), err_msg=name)
    assert est.B is None
    assert est.possibility == 1.0
    assert (est.log_likelihood, est.mahalanobis) == (kf.log_likelihood, kf.mahalanobis)
    assert est.likelihood == pytest.approx(kf.likelihood, rel=1e-12)


# ------------------------------------------------------------------ the Gaussian case


def random_model(seed, singular):
    rng = np.random.default_rng(seed)
    n, q = rng.integers(1, 5), rng.integers(1, 4)
    A, C = 0.7 * rng.normal(size=(n, n)), rng.normal(size=(q, n))
    roots = [rng.normal(size=(k, k)) for k in (n, n, q)]
    P, Q, R = (root @ root.T + 0.05 * np.eye(len(root)) for root in roots)
    if singular:
        A[-1] = A[0]
        Q = np.outer(roots[1][0], roots[1][0])
    return A, C, P, Q, R, rng.normal(size=(15, q)), rng.normal(size=n)


@pytest.mark.parametrize("singular", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_gaussian_estimator_is_filterpys_kalman_filter(seed, singular):
    A, C, P, Q, R, zs, x = random_model(seed, singular)
    est, kf = FuzzyRelationEstimator(x.size, len(C)), FilterpyKF(dim_x=x.size, dim_z=len(C))
    for f in (est, kf):
        f.F, f.H, f.P, f.Q, f.R, f.x = A, C, P, Q, R, x[:, None]
    for z in zs:
        for f in (est, kf):
            f.predict()
            f.update(z)
        for name in ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "y", "S", "SI", "K", "z"):
            np.testing.assert_allclose(getattr(est, name), getattr(kf, name), atol=1e-10, err_msg=name)
        assert est.log_likelihood == pytest.approx(kf.log_likelihood, abs=1e-10)
        assert est.mahalanobis == pytest.approx(kf.mahalanobis, abs=1e-10)
        assert est.possibility == pytest.approx(np.exp(-0.5 * kf.mahalanobis**2))


def test_memberships_given_are_the_matrices():
    S, W, V = np.diag([1.0, 2.0]), np.array([[0.2, 0.1], [0.1, 0.3]]), 0.7
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([1.0, 2.0], S),
        process_noise=GaussianMembership([0.5, 0.0], W),
        measurement_noise=[GaussianMembership(0.1, V)],
    )
    est.F, est.H = F, H
    kf = FilterpyKF(dim_x=2, dim_z=1)
    kf.F, kf.H, kf.Q, kf.R, kf.P, kf.x = F, H, W, V, S, np.array([[1.0], [2.0]])
    # centers of the noises that are not zero act as a drift and as a bias of z
    for z in (3.0, 4.5):
        est.step(z)
        kf.predict(u=np.ones((1, 1)), B=np.array([[0.5], [0.0]]))
        kf.update(z - 0.1)
        np.testing.assert_allclose(est.x, kf.x, atol=1e-12)
        np.testing.assert_allclose(est.P, kf.P, atol=1e-12)
    np.testing.assert_allclose(est.membership.mean, kf.x.ravel(), atol=1e-12)
    np.testing.assert_allclose(est.process_noise.covariance, W)


def test_arguments_of_one_step():
    est, kf = gaussian(), FilterpyKF(dim_x=2, dim_z=1)
    kf.F, kf.H, kf.Q, kf.R = F, H, 0.1 * np.eye(2), np.array([[0.5]])
    B = np.array([[0.5], [1.0]])
    for f in (est, kf):
        f.predict(u=np.array([[2.0]]), B=B, F=0.9 * F, Q=np.diag([0.3, 0.4]))
        f.update(np.array([1.0]), R=np.array([[2.0]]), H=np.array([[0.5, 0.5]]))
        f.B = B
        f.predict(np.array([[1.0]]))
        f.update(np.array([2.0]))
    np.testing.assert_allclose(est.x, kf.x, atol=1e-12)
    np.testing.assert_allclose(est.P, kf.P, atol=1e-12)
    np.testing.assert_allclose(est.Q, 0.1 * np.eye(2))  # the filter's own matrices stay


def test_part_of_a_measurement_is_conditioned_on():
    # oracle: a filter with one row of H and of R
    R = np.array([[0.5, 0.2], [0.2, 0.4]])
    est = FuzzyRelationEstimator(2, 2)
    est.F, est.H, est.R = F, np.array([[1.0, 0.5], [0.2, 1.0]]), R
    part = FuzzyRelationEstimator(2, 1)
    part.F, part.H, part.R = F, est.H[1:], R[1:, 1:]
    est.step([np.nan, 2.0])
    part.step(2.0)
    np.testing.assert_allclose(est.x, part.x)
    np.testing.assert_allclose(est.P, part.P)
    assert est.log_likelihood == pytest.approx(part.log_likelihood)
    assert est.y[0, 0] == 0.0
    assert (est.K[:, 0] == 0.0).all()


def test_missing_measurements_change_nothing():
    est = gaussian()
    est.step(1.0)
    est.predict()
    before = est.x.copy(), est.P.copy()
    for missing in (None, np.nan, [np.nan]):
        est.update(missing)
        np.testing.assert_array_equal(est.x, before[0])
        np.testing.assert_array_equal(est.P, before[1])
        assert est.possibility == 1.0
        assert est.log_likelihood == 0.0
        assert (est.y == 0.0).all()
        assert est.z[0, 0] is None


def test_matrices_can_be_edited_in_place():
    est = gaussian()
    est.P *= 10.0
    est.P[0, 0] = 3.0
    est.Q[1, 1] = 0.7
    est.R[0, 0] = 2.0
    est.x[1] = 5.0
    other = gaussian(P=np.diag([3.0, 10.0]), Q=np.diag([0.1, 0.7]), R=2.0, x=np.array([[0.0], [5.0]]))
    for f in (est, other):
        f.step(1.0)
    np.testing.assert_array_equal(est.x, other.x)
    np.testing.assert_array_equal(est.P, other.P)
    assert est.process_noise([0.0, 0.7]) == pytest.approx(GaussianMembership(0.0, 0.7)(0.7))


def test_flat_x_makes_everything_flat():
    est = gaussian(x=np.zeros(2))
    est.step(1.0)
    for name in ("x", "x_prior", "x_post", "y"):
        assert getattr(est, name).ndim == 1
    column = gaussian()
    column.step(1.0)
    np.testing.assert_array_equal(est.x, column.x.ravel())
    assert est.filter([1.0, 2.0]).x.shape == (2, 2)


@pytest.mark.parametrize("bank", [FilterpyIMM, IMMEstimator])
def test_works_in_a_bank(bank):
    # the same bank with Kalman filters gives the same
    def filters(make):
        result = []
        for q in (0.01, 2.0):
            f = make(2, 1)
            f.F, f.H, f.Q, f.R, f.P = F, H, q * np.eye(2), np.array([[0.5]]), np.eye(2)
            result.append(f)
        return result

    M = np.array([[0.95, 0.05], [0.1, 0.9]])
    imm = bank(filters(FuzzyRelationEstimator), [0.5, 0.5], M)
    kalman = KalmanFilter if bank is IMMEstimator else (lambda n, m: FilterpyKF(dim_x=n, dim_z=m))
    reference = bank(filters(kalman), [0.5, 0.5], M)
    for z in (0.5, 1.2, 4.0, 9.0, 10.5):
        for f in (imm, reference):
            f.predict()
            f.update(np.array([z]))
        np.testing.assert_allclose(imm.x, reference.x, atol=1e-10)
        np.testing.assert_allclose(imm.P, reference.P, atol=1e-10)
        np.testing.assert_allclose(imm.mu, reference.mu, atol=1e-10)


def test_outlier_of_200_standard_deviations():
    est = gaussian()
    est.step(300.0)
    assert np.isfinite(est.x).all()
    assert np.isfinite(est.log_likelihood)
    assert est.possibility == 0.0
    assert est.likelihood > 0.0  # as in filterpy, so that a bank does not divide zero by zero


# ------------------------------------------------------------------ the other closed forms


def test_public_gaussian_case(fuzzy_cases):
    case = fuzzy_cases["gauss 2-D non symmetric A"]
    est = FuzzyRelationEstimator(2, 1)
    est.F, est.H, est.Q, est.R = (np.array(case[k]) for k in "AHQR")
    est.x, est.P = np.array(case["x0"]), np.array(case["P0"])
    for step in case["steps"]:
        est.predict()
        np.testing.assert_allclose(est.x, step["x_pred"], rtol=case["rtol"], atol=case["atol"])
        np.testing.assert_allclose(est.P, step["P_pred"], rtol=case["rtol"], atol=case["atol"])
        est.update(step["z"])
        np.testing.assert_allclose(est.x, step["x"], rtol=case["rtol"], atol=case["atol"])
        np.testing.assert_allclose(est.P, step["P"], rtol=case["rtol"], atol=case["atol"])


@pytest.mark.parametrize(
    ("t_norm", "shape"), [("hamacher", CauchyMembership), ("lukasiewicz", ParabolicMembership)]
)
def test_closed_forms_agree_with_a_grid(t_norm, shape):
    # the same model on a grid: memberships agree wherever both are defined
    given = {
        "state": shape(0.5, 1.0),
        "process_noise": shape(0.1, 0.5),
        "measurement_noise": shape(0.0, 0.8),
        "t_norm": t_norm,
    }
    closed = FuzzyRelationEstimator(1, 1, **given)
    grid = FuzzyRelationEstimator(1, 1, points=801, floor=1e-3, **given)
    for f in (closed, grid):
        f.F, f.H = np.array([[0.9]]), np.array([[1.3]])
    for z in (0.4, None, 0.9, 0.7):
        for f in (closed, grid):
            f.predict()
            f.update(z)
        x, values = grid.membership.axes[0], grid.membership.values
        exact = closed.membership(x)
        near = abs(x - closed.x.item()) < 2.0  # farther out the floor of the grid counts
        np.testing.assert_allclose(values[near], exact[near] / exact.max(), atol=1e-6)
        assert grid.defuzzify("peak").item() == pytest.approx(closed.x.item(), abs=1e-6)
        assert grid.possibility == pytest.approx(closed.possibility, abs=1e-6)


def test_parabola_policies():
    def make(policy):
        unit = ParabolicMembership(0.0, 1.0)
        est = FuzzyRelationEstimator(
            1,
            1,
            state=unit,
            process_noise=unit,
            measurement_noise=unit,
            t_norm="lukasiewicz",
            on_empty=policy,
        )
        est.H = np.eye(1)
        return est

    est = make("raise")
    est.predict()
    with pytest.raises(EmptyIntersectionError, match=r"no possible state explains; these are within \[-1.41"):
        est.update(5.0)
    assert est.P.item() == 2.0
    kept, restarted = make("keep"), make("reset")
    for f in (kept, restarted):
        f.step(5.0)
        assert f.possibility == 0.0
    assert (kept.x.item(), kept.P.item()) == (0.0, 2.0)
    assert (restarted.x.item(), restarted.P.item()) == (pytest.approx(5.0), pytest.approx(1.0))
    np.testing.assert_allclose(kept.upper, np.sqrt(2.0))


# ------------------------------------------------------------------ contract


def sine(x):
    return x + 0.5 * np.sin(x)


def slow(x):
    return 0.9 * x


def quarter(x):
    return x**2 / 4


def swing(x):
    return np.stack([x[..., 0] + 0.1 * x[..., 1], x[..., 1] - 0.1 * np.sin(x[..., 0])], axis=-1)


def mixed(x):
    return np.stack([x[..., 0] + x[..., 1], x[..., 0] - x[..., 1]], axis=-1)


def scalar_grid(**options):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=sine,
        hx=quarter,
        state=GaussianMembership(0.5, 1.0),
        process_noise=GaussianMembership(0.0, 0.05),
        measurement_noise=CauchyMembership(0.0, 0.3),
        **{"points": 101, **options},
    )


def plane_grid():
    return FuzzyRelationEstimator(
        2,
        2,
        fx=swing,
        hx=mixed,
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=[None, TriangularMembership(-0.5, 0.0, 0.5)],
        measurement_noise=[GaussianMembership(0.0, 0.3), CauchyMembership(0.0, 0.6)],
        points=31,
    )


def interval():
    return FuzzyRelationEstimator(
        1,
        1,
        fx=slow,
        hx=np.sinh,
        state=IntervalMembership(-2.0, 2.0),
        process_noise=IntervalMembership(-1.0, 1.0),
        measurement_noise=IntervalMembership(-1.0, 1.0),
        on_empty="keep",
    )


def box():
    est = FuzzyRelationEstimator(
        2,
        2,
        state=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        process_noise=IntervalMembership([-0.5, -0.5], [0.5, 0.5]),
        measurement_noise=IntervalMembership([-1.0, -1.0], [1.0, 1.0]),
        on_empty="reset",
    )
    est.F, est.H = F, np.array([[1.0, 1.0], [1.0, -1.0]])
    return est


def cauchy():
    est = FuzzyRelationEstimator(2, 2, t_norm="hamacher")
    est.F, est.H, est.R = F, np.eye(2), 0.5
    return est


def parabolic():
    est = FuzzyRelationEstimator(2, 1, t_norm="lukasiewicz", on_empty="reset")
    est.F, est.H, est.R = F, H, 4.0
    return est


def flat():
    return gaussian(x=np.zeros(2))


def fixed_grid(points=101):
    return scalar_grid(domain=((-10.0, 10.0),), points=points)


def min_grid(points=101):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=sine,
        hx=slow,
        state=TriangularMembership(-3.0, 0.0, 3.0),
        process_noise=TriangularMembership(-1.0, 0.0, 1.0),
        measurement_noise=CauchyMembership(0.0, 0.3),
        t_norm="min",
        points=points,
    )


MAKERS = [
    gaussian,
    flat,
    cauchy,
    parabolic,
    interval,
    box,
    scalar_grid,
    fixed_grid,
    plane_grid,
    min_grid,
]


@pytest.mark.parametrize("make", MAKERS, ids=lambda f: f.__name__)
def test_common_contract(make):
    # of six observations, the fewest that will do, on a coarse grid: what a step on it costs is its search
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None] + 0.7 * np.arange(make().dim_z))
    coarse = {scalar_grid: 31, fixed_grid: 31, min_grid: 31}
    report = check_filter((lambda: make(points=coarse[make])) if make in coarse else make, zs)
    assert {"possibility", "step", "filter", "copy", "pickle", "saver", "reset", "missing"} <= set(
        report.passed
    )


@pytest.mark.parametrize("make", MAKERS, ids=lambda f: f.__name__)
def test_series_carry_possibilities_and_bounds(make):
    est, again = make(), make()
    zs = np.full((4, est.dim_z), 0.3)
    zs[1] = np.nan
    result = est.filter(zs)
    for k, z in enumerate(zs):
        again.step(z)
        assert result.possibility[k] == again.possibility
        np.testing.assert_array_equal(result.lower[k], again.lower)
        np.testing.assert_array_equal(result.upper[k], again.upper)
    assert result.possibility[1] == 1.0
    assert (result.lower <= result.x).all()
    assert (result.x <= result.upper).all()
    bounded = make in {parabolic, interval, box, min_grid, scalar_grid, fixed_grid, plane_grid}
    assert np.isfinite(result.lower).all() == bounded


@pytest.mark.parametrize("make", MAKERS, ids=lambda f: f.__name__)
def test_copies_go_on_alike(make):
    est = make()
    z = np.full(est.dim_z, 0.3)
    est.step(z)
    copies = [est.copy(), copy.deepcopy(est), pickle.loads(pickle.dumps(est))]
    est.step(z)
    for other in copies:
        other.step(z)
        np.testing.assert_array_equal(other.x, est.x)
        np.testing.assert_array_equal(other.P, est.P)


def test_saver_keeps_the_history():
    est = scalar_grid()
    saver = Saver(est)
    for z in (0.3, None, 0.5):
        est.step(z)
        saver.save()
    assert len(saver.x) == 3
    assert saver.possibility[1] == 1.0
    assert saver.membership[2](est.defuzzify("peak").item()) == pytest.approx(1.0, abs=0.01)


# ------------------------------------------------------------------ arguments


def test_keyword_arguments_reach_their_function_only():
    seen = {}

    def fx(x, dt, gain=1.0):
        seen["fx"] = (dt, gain)
        return x + dt * gain

    def hx(x, offset=0.0):
        seen["hx"] = offset
        return x + offset

    est = FuzzyRelationEstimator(
        1, 1, fx=fx, hx=hx, state=GAUSS, process_noise=GAUSS, measurement_noise=GAUSS, points=51
    )
    est.predict(dt=0.5, gain=2.0)
    assert seen == {"fx": (0.5, 2.0)}
    assert est.x.item() == pytest.approx(1.0)
    est.update(3.0, offset=2.0)
    assert seen["hx"] == 2.0
    assert est.x.item() == pytest.approx(1.0)
    with pytest.raises(TypeError):
        est.predict()  # dt is missing
    with pytest.raises(TypeError):
        est.update(1.0, dt=0.5)
    assert est.x.item() == pytest.approx(1.0)


def test_measurements_at_irregular_times():
    # two steps of half the length are one step, when the noise enters at the end
    def drift(x, dt):
        return np.exp(-dt) * x

    def make():
        return FuzzyRelationEstimator(
            1, 1, fx=drift, state=GaussianMembership(2.0, 1.0), measurement_noise=GAUSS
        )

    one, two = make(), make()
    one.H = two.H = np.eye(1)
    one.predict(dt=0.7)
    two.predict(dt=0.3)
    two.predict(dt=0.4)
    for f in (one, two):
        f.update(0.8)
    np.testing.assert_allclose(one.x, two.x, atol=1e-9)
    np.testing.assert_allclose(one.P, two.P, atol=1e-9)


def test_control_reaches_fx_by_name():
    est = FuzzyRelationEstimator(1, 1, fx=lambda x, u: x + u, state=GAUSS, measurement_noise=GAUSS, points=51)
    est.predict(2.0)
    assert est.x.item() == pytest.approx(2.0)
    est.predict(u=1.0)
    assert est.x.item() == pytest.approx(3.0)


def test_noises_may_change_with_time():
    est = scalar_grid()
    est.process_noise = GaussianMembership(0.0, 4.0)
    est.measurement_noise = [GaussianMembership(0.0, 1.0)]
    est.predict()
    assert est.P.item() > 4.0
    before = est.x.item()
    est.process_noise = GaussianMembership(10.0, 4.0)  # after a prediction with another one
    est.predict()
    assert est.x.item() > before + 8.0
    closed = gaussian()
    closed.process_noise = None
    np.testing.assert_array_equal(closed.Q, np.zeros((2, 2)))
    with pytest.raises(ParameterError, match="process_noise: this estimator keeps gaussian memberships"):
        closed.process_noise = CauchyMembership([0.0, 0.0], 1.0)
    with pytest.raises(ParameterError, match="measurement_noise: this estimator keeps intervals"):
        interval().measurement_noise = GAUSS


def test_membership_can_be_assigned():
    for make, value in (
        (scalar_grid, TriangularMembership(0.0, 1.0, 3.0)),
        (interval, IntervalMembership(0.0, 3.0)),
        (lambda: FuzzyRelationEstimator(1, 1), GaussianMembership(1.0, 2.0)),
    ):
        est = make()
        est.membership = value
        assert est.membership(1.0) == pytest.approx(1.0, abs=0.02)
        assert est.membership(-1.0) == pytest.approx(value(-1.0), abs=1e-3)


def test_defuzzification_methods():
    est = FuzzyRelationEstimator(
        1, 1, state=TriangularMembership(0.0, 0.0, 3.0), measurement_noise=GAUSS, points=301
    )
    assert est.defuzzify() == pytest.approx(np.array([[1.0]]), abs=1e-4)
    assert est.defuzzify("mean_of_maximum").item() == 0.0
    for method in ("centroid", "mean_of_maximum", "peak"):
        assert est.defuzzify(method).shape == (1, 1)
        np.testing.assert_array_equal(gaussian().defuzzify(method), np.zeros((2, 1)))
        assert interval().defuzzify(method).item() == 0.0
    with pytest.raises(ParameterError, match="method: got 'middle'"):
        est.defuzzify("middle")


# ------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("message", "arguments"),
    [
        (r"dim_x: got 0", {"dim_x": 0}),
        (r"on_empty: got 'ignore', expected 'raise', 'keep' or 'reset'", {"on_empty": "ignore"}),
        (r"t_norm: got 'sum'", {"t_norm": "sum"}),
        (r"t_conorm: 'bounded_sum' has no limit on a continuum", {"t_conorm": "bounded_sum"}),
        (r"fx: got None, expected the function that belongs to fx_inverse", {"fx_inverse": same}),
        (r"state: got a membership of 2 dimensions, expected 1", {"state": CauchyMembership([0, 0], 1.0)}),
        (r"process_noise: got 2 components, expected 1", {"process_noise": [None, None]}),
        (r"process_noise\[0\]: got 3.0, expected a scalar membership or None", {"process_noise": [3.0]}),
        (r"process_noise: got 3.0, expected a membership, or a sequence", {"process_noise": 3.0}),
        (r"state: got None, expected a membership", {"fx": same}),
        (r"measurement_noise: got None, expected a membership", {"fx": same, "state": GAUSS}),
        (
            r"measurement_noise: component 0 is a single point; on a grid it needs some width",
            {"fx": same, "state": GAUSS, "measurement_noise": [None]},
        ),
        (r"points: got 3, expected a whole number of at least 5", {"points": 3, "state": GAUSS}),
        (r"points: got 10.5", {"points": 10.5, "state": GAUSS}),
        (r"domain: got \(\(1, 0\),\), expected one finite pair", {"domain": ((1, 0),), "state": GAUSS}),
        (r"state: its peak \[0.0\] lies outside the domain", {"domain": ((1, 2),), "state": GAUSS}),
        (r"floor: got 2.0", {"floor": 2.0, "state": GAUSS, "points": 9}),
    ],
)
def test_bad_arguments_are_named(message, arguments):
    options = {"dim_x": 1, "dim_z": 1, **arguments}
    if "points" in arguments or "domain" in arguments:
        options.setdefault("measurement_noise", GAUSS)
    with pytest.raises(ParameterError, match=message):
        FuzzyRelationEstimator(options.pop("dim_x"), options.pop("dim_z"), **options)


def test_four_states_have_no_grid():
    with pytest.raises(ParameterError, match="dim_x: got 4, expected at most 3 where a grid is needed"):
        FuzzyRelationEstimator(
            4, 1, points=9, state=GaussianMembership(np.zeros(4), np.eye(4)), measurement_noise=GAUSS
        )


def state_of(est):
    return est.x.copy(), est.P.copy(), est.x_prior.copy(), est.x_post.copy(), est.possibility


def unchanged(est, before):
    for new, old in zip(state_of(est), before, strict=True):
        np.testing.assert_array_equal(new, old)


@pytest.mark.parametrize("make", [gaussian, interval, scalar_grid], ids=lambda f: f.__name__)
def test_bad_measurements_leave_the_state(make):
    est = make()
    est.step(0.3)
    before = state_of(est)
    for bad in ([1.0, 2.0], "high", np.inf, np.zeros((2, 2))):
        with pytest.raises(ParameterError, match="z: "):
            est.update(bad)
        unchanged(est, before)


@pytest.mark.parametrize(
    ("name", "function", "message"),
    [
        ("fx", lambda x: x[..., 0], r"fx: returned shape \(101,\) for points of shape \(101, 1\), expected"),
        ("fx", lambda x: np.where(x > 0, np.nan, x), r"fx: returned \[nan\] at x = .*, which is possible"),
        ("fx", lambda x: "north", "fx: returned 'north'"),
        ("hx", lambda x: np.stack([x, x]), r"hx: returned shape \(2, 101, 1\)"),
        ("hx", lambda x: np.full(x.shape, np.inf), r"hx: returned \[inf\]"),
    ],
)
def test_bad_functions_leave_the_state(name, function, message):
    est = FuzzyRelationEstimator(
        1,
        1,
        fx=function if name == "fx" else same,
        hx=function if name == "hx" else same,
        state=GAUSS,
        process_noise=GAUSS,
        measurement_noise=GAUSS,
        points=101,
    )
    before = state_of(est)
    with pytest.raises(ParameterError, match=message):
        est.predict() if name == "fx" else est.update(0.0)
    unchanged(est, before)


def test_a_wrong_inverse_is_noticed():
    est = FuzzyRelationEstimator(
        1, 1, fx=lambda x: 2 * x, fx_inverse=lambda x: x / 3, state=GAUSS, measurement_noise=GAUSS
    )
    with pytest.raises(ParameterError, match=r"fx_inverse: leads from fx\(.*\) to .*, expected"):
        est.predict()


def test_matrices_are_checked():
    est = gaussian()
    with pytest.raises(ShapeError, match=r"P: got shape \(3, 3\), expected \(2, 2\)"):
        est.P = np.eye(3)
    with pytest.raises(NotPositiveDefiniteError, match="R"):
        est.R = -1.0
    with pytest.raises(ShapeError, match="x: got shape"):
        est.x = np.zeros(3)
    with pytest.raises(ParameterError, match="x: got"):
        est.x = [np.nan, 0.0]
    est.F = np.eye(3)
    with pytest.raises(ShapeError, match=r"F: got shape \(3, 3\), expected \(2, 2\)"):
        est.predict()
    est.F, est.H = F, np.eye(2)
    before = state_of(est)
    with pytest.raises(ShapeError, match="H: got shape"):
        est.update(1.0)
    unchanged(est, before)
    with pytest.raises(TypeError, match="unexpected keyword argument 'dt'; only fx could use it"):
        est.predict(dt=0.1)


def test_assigning_what_has_no_meaning():
    est = scalar_grid()
    for name, instead in (("x", "membership"), ("P", "membership"), ("Q", "process_noise"), ("R", "noise")):
        with pytest.raises(ParameterError, match=f"{name}: has no meaning of its own .*{instead}"):
            setattr(est, name, 1.0)
    assert (est.Q, est.R, est.F, est.H) == (None, None, None, None)
    assert not hasattr(est, "log_likelihood")


def test_a_control_without_a_matrix_is_refused():
    est = FuzzyRelationEstimator(1, 1, H=1.0)
    with pytest.raises(ParameterError, match=r"B: got no matrix, so u would do nothing"):
        est.filter([1.0, 2.0], us=[0.0, 1.0])
    est.predict(u=0.0)
    est.predict(u=2.0, B=[[1.5]])
    assert est.x[0, 0] == pytest.approx(3.0)

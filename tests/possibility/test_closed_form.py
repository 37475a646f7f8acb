"""The closed forms follow from the extension principle, and are the Kalman recursion."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.optimize import minimize

from fuzzykf.errors import ParameterError
from fuzzykf.possibility import closed_form

GENERATORS = {
    # membership of a quadratic form q, and the cost that adds
    "gaussian": (lambda q: np.exp(-q / 2), lambda m: -np.log(m)),
    "cauchy": (lambda q: 1 / (1 + q), lambda m: 1 / m - 1),
    "parabolic": (lambda q: np.maximum(0, 1 - q), lambda m: 1 - m),
}


def random_spd(rng, n, scale=1.0):
    root = rng.normal(size=(n, n))
    return scale * (root @ root.T / n + 0.1 * np.eye(n))


@pytest.mark.parametrize("seed", range(5))
def test_prediction_is_the_infimum_of_the_sum(seed):
    # min over x of |x - m|^2_P + |x' - F x|^2_Q, found by a numerical optimiser
    rng = np.random.default_rng(seed)
    F, P, Q, m = rng.normal(size=(2, 2)), random_spd(rng, 2), random_spd(rng, 2, 0.3), rng.normal(size=2)
    x, spread = closed_form.predict(m, P, F, Q, np.zeros(2))
    for target in rng.normal(size=(3, 2)):

        def total(s, target=target):
            a, b = s - m, target - F @ s
            return a @ np.linalg.solve(P, a) + b @ np.linalg.solve(Q, b)

        least = minimize(total, m, method="BFGS", options={"gtol": 1e-9}).fun
        r = target - x
        assert r @ np.linalg.solve(spread, r) == pytest.approx(least, rel=1e-7)


@pytest.mark.parametrize("family", GENERATORS)
@pytest.mark.parametrize("seed", range(4))
def test_update_is_the_combination_divided_by_its_peak(family, seed):
    # definition: mu+ = T(mu, mu_V(z - H x)) / peak, evaluated point by point
    shape, cost = GENERATORS[family]
    rng = np.random.default_rng(seed)
    H, P, R = rng.normal(size=(2, 3)), random_spd(rng, 3, 3.0), random_spd(rng, 2, 3.0)
    m = rng.normal(size=3)
    z = H @ m + 0.3 * rng.normal(size=2)
    found = closed_form.condition(m, P, z, H, R, family)
    points = found.x + 0.3 * rng.normal(size=(200, 3))
    q1 = np.einsum("ni,ij,nj->n", points - m, np.linalg.inv(P), points - m)
    r = z - points @ H.T
    q2 = np.einsum("ni,ij,nj->n", r, np.linalg.inv(R), r)
    with np.errstate(divide="ignore"):
        combined = cost(shape(q1)) + cost(shape(q2))
    raw = {"gaussian": np.exp(-combined), "cauchy": 1 / (1 + combined)}.get(
        family, np.maximum(0, 1 - combined)
    )
    s = points - found.x
    posterior = shape(np.einsum("ni,ij,nj->n", s, np.linalg.inv(found.P), s))
    peak = closed_form.possibility(found.surprise, family)
    both = (shape(q1) > 0) & (shape(q2) > 0)
    assert both.sum() > 50
    np.testing.assert_allclose(posterior[both], raw[both] / peak, atol=1e-12)


def test_spread_grows_or_shrinks_with_surprise():
    P, H, R = np.eye(1), np.eye(1), np.eye(1)
    calm = {f: closed_form.condition(np.zeros(1), P, np.zeros(1), H, R, f).P[0, 0] for f in GENERATORS}
    wild = {f: closed_form.condition(np.zeros(1), P, np.ones(1), H, R, f).P[0, 0] for f in GENERATORS}
    assert wild["gaussian"] == calm["gaussian"]
    assert wild["cauchy"] == pytest.approx(1.5 * calm["cauchy"])  # 1 + c with c = 1/2
    assert wild["parabolic"] == pytest.approx(0.5 * calm["parabolic"])  # 1 - c


def test_parabola_is_empty_at_surprise_one():
    arguments = np.zeros(1), np.eye(1)
    empty = closed_form.condition(*arguments, np.array([np.sqrt(2.0)]), np.eye(1), np.eye(1), "parabolic")
    assert empty.x is None
    assert closed_form.possibility(empty.surprise, "parabolic") == pytest.approx(0.0, abs=1e-12)
    nearly = closed_form.condition(*arguments, np.array([1.414]), np.eye(1), np.eye(1), "parabolic")
    assert nearly.x is not None
    assert 0.0 < nearly.P[0, 0] < 1e-3


def test_order_of_measurements_matters_but_for_the_product():
    # documented: for Hamacher and Łukasiewicz two measurements of one instant do not commute
    H, R1, R2 = np.eye(1), np.array([[0.5]]), np.array([[2.0]])
    spreads = {}
    for family in GENERATORS:
        result = []
        for (z1, S1), (z2, S2) in (((0.4, R1), (-0.5, R2)), ((-0.5, R2), (0.4, R1))):
            first = closed_form.condition(np.zeros(1), np.eye(1), np.array([z1]), H, S1, family)
            second = closed_form.condition(first.x, first.P, np.array([z2]), H, S2, family)
            result.append(second.P[0, 0])
        spreads[family] = result
    assert spreads["gaussian"][0] == pytest.approx(spreads["gaussian"][1], rel=1e-12)
    for family in ("cauchy", "parabolic"):
        assert abs(spreads[family][0] / spreads[family][1] - 1.0) > 1e-3


@pytest.mark.parametrize("singular", ["none", "F", "Q", "P", "all"])
@pytest.mark.parametrize("seed", range(4))
def test_equals_filterpy(seed, singular):
    rng = np.random.default_rng(seed)
    n, q = 4, 2
    F, H = rng.normal(size=(n, n)) * 0.6, rng.normal(size=(q, n))
    P, Q, R = random_spd(rng, n), random_spd(rng, n, 0.2), random_spd(rng, q, 0.5)
    if singular in {"F", "all"}:
        F[2] = F[1]
    if singular in {"Q", "all"}:
        Q = np.outer(np.arange(4.0), np.arange(4.0))
    if singular in {"P", "all"}:
        P = np.zeros((n, n))
    kf = KalmanFilter(dim_x=n, dim_z=q)
    kf.F, kf.H, kf.Q, kf.R, kf.P = F, H, Q, R, P
    x, spread = np.zeros(n), P
    for z in rng.normal(size=(12, q)):
        kf.predict()
        x, spread = closed_form.predict(x, spread, F, Q, np.zeros(n))
        kf.update(z)
        found = closed_form.condition(x, spread, z, H, R, "gaussian")
        x, spread = found.x, found.P
        np.testing.assert_allclose(x, kf.x.ravel(), atol=1e-10)
        np.testing.assert_allclose(spread, kf.P, atol=1e-10)
        np.testing.assert_allclose(found.K, kf.K, atol=1e-10)
        np.testing.assert_allclose(found.S, kf.S, atol=1e-10)
        np.testing.assert_allclose(found.SI, kf.SI, atol=1e-9)
        assert found.log_likelihood == pytest.approx(kf.log_likelihood, abs=1e-9)
        assert np.sqrt(found.surprise) == pytest.approx(kf.mahalanobis, abs=1e-9)


def test_printed_equation_37_is_not_the_recursion():
    # F'PF + Q, as printed, differs as soon as F is not symmetric
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    _, P = closed_form.predict(np.zeros(2), np.diag([1.0, 2.0]), F, np.zeros((2, 2)), np.zeros(2))
    np.testing.assert_allclose(P, [[3.0, 2.0], [2.0, 2.0]])
    assert np.abs(P - F.T @ np.diag([1.0, 2.0]) @ F).max() == 2.0


def test_known_state_meets_perfect_measurement():
    # no spread anywhere: agreement is possible, contradiction is not
    zero, one = np.zeros((1, 1)), np.eye(1)
    fine = closed_form.condition(np.array([2.0]), zero, np.array([2.0]), one, zero, "gaussian")
    assert fine.surprise == 0.0
    np.testing.assert_allclose(fine.x, [2.0])
    for family in GENERATORS:
        contradiction = closed_form.condition(np.array([2.0]), zero, np.array([2.1]), one, zero, family)
        assert contradiction.x is None
        assert closed_form.possibility(contradiction.surprise, family) == 0.0


def test_the_same_sensor_twice_without_noise():
    # S is singular, but z agrees with itself
    H = np.array([[1.0, 0.0], [1.0, 0.0]])
    found = closed_form.condition(
        np.zeros(2), np.eye(2), np.array([1.0, 1.0]), H, np.zeros((2, 2)), "gaussian"
    )
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.P, np.diag([0.0, 1.0]), atol=1e-12)


def test_units_do_not_make_a_matrix_singular():
    R = np.diag([1e-10, 1e10])
    found = closed_form.condition(np.zeros(2), 1e-12 * R, np.array([1e-5, 1e5]), np.eye(2), R, "gaussian")
    assert found.surprise == pytest.approx(2.0)


def test_outlier_stays_finite():
    found = closed_form.condition(np.zeros(1), np.eye(1), np.array([1e9]), np.eye(1), np.eye(1), "gaussian")
    assert found.x[0] == pytest.approx(5e8)
    assert np.isfinite(found.log_likelihood)
    assert closed_form.possibility(found.surprise, "gaussian") == 0.0


def test_restart_is_the_limit_of_a_vague_prediction():
    # oracle: the ordinary update with the spread of H x inflated beyond measure
    rng = np.random.default_rng(3)
    P, H, R = random_spd(rng, 3), rng.normal(size=(1, 3)), np.array([[0.4]])
    m, z = rng.normal(size=3), np.array([30.0])
    x, spread = closed_form.restart(m, P, z, H, R)
    G = P @ H.T / (H @ P @ H.T)
    vague = closed_form.condition(m, P + 1e9 * G @ G.T, z, H, R, "gaussian")
    np.testing.assert_allclose(x, vague.x, atol=1e-5)
    np.testing.assert_allclose(spread, vague.P, atol=1e-5)
    np.testing.assert_allclose(H @ x, z)
    np.testing.assert_allclose(H @ spread @ H.T, R)
    assert closed_form.restart(m, np.zeros((3, 3)), z, H, R) is None


def test_other_families_are_refused():
    with pytest.raises(
        ParameterError, match=r"family: got 'triangle', expected 'gaussian', 'cauchy' or 'parab"
    ):
        closed_form.possibility(1.0, "triangle")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("family", GENERATORS)
def test_a_contradiction_is_one_on_either_side(family, sign):
    # a state known for certain in its second component, and an exact measurement that is off it
    x, P = np.array([0.5, -2.0]), np.diag([1.0, 0.0])
    H, R = np.eye(2), np.zeros((2, 2))
    off = closed_form.condition(x, P, np.array([0.6, -2.0 + 0.1 * sign]), H, R, family)
    assert np.isinf(off.surprise)
    on = closed_form.condition(x, P, np.array([0.6, -2.0 + 1e-16 * sign]), H, R, family)
    assert on.surprise == pytest.approx(0.01)


def test_a_measurement_beyond_all_numbers_has_an_infinite_surprise(recwarn):
    one = np.eye(1)
    assert np.isinf(closed_form.condition(np.zeros(1), one, np.array([1e200]), one, one, "gaussian").surprise)
    assert not recwarn.list

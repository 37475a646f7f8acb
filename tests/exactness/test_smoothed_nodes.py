"""The smoothers of IMM and GPB2: with one class that of the Kalman filter, with several near the exact one.

The exact smoother goes along all paths of the nodes, three nodes and eight observations.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf import (
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)

METHODS = ("imm", "gpb2")
N = 8
PATHS = np.array(list(itertools.product(range(3), repeat=N)))
BASE = {"F": 0.95, "b": 0.0, "Q": 0.3**2, "H": 1.0, "d": 0.0, "R": 0.5**2, "x0": 0.0}

#: What switches.
SYSTEMS = {
    "process noise": {"Q": (0.1**2, 0.8**2)},
    "observation noise": {"R": (0.3**2, 3.0**2)},
    "offset of the motion": {"b": (0.0, 1.0)},
    "offset of the observation": {"d": (0.0, 3.0)},
    "gain": {"H": (1.0, 0.3), "x0": 3.0},
}

#: By what part the squared error may exceed that of the exact smoother.
MOST = {"imm": 0.03, "gpb2": 0.01}


def model_of(changes):
    a = {name: np.broadcast_to(np.asarray(value, dtype=float), 2) for name, value in (BASE | changes).items()}
    F, H, Q, R = (a[name].reshape(2, 1, 1) for name in ("F", "H", "Q", "R"))
    b, d = (a[name].reshape(2, 1) for name in ("b", "d"))
    law = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
    return SwitchingStateSpace(law, F, H, Q, R, b=b, d=d, x0=[a["x0"][0]], P0=1.0)


def parts(model):
    system = model.placed(1)
    F, b, Q, H, d, R = (getattr(system.tables, name).ravel() for name in ("F", "b", "Q", "H", "d", "R"))
    return system.chain, F, b, Q, H, d, R


def drawn_on_nodes(model, x0, rng):
    """A series whose switch keeps to the nodes, so that the enumeration is exact for it."""
    chain, F, b, Q, H, d, R = parts(model)
    k = [rng.choice(3, p=chain.initial)]
    for _ in range(N - 1):
        k.append(rng.choice(3, p=chain.transition[k[-1]]))
    x = x0 + rng.normal(size=N)
    for n in range(1, N):
        x[n] = F[k[n]] * x[n - 1] + b[k[n]] + np.sqrt(Q[k[n]]) * rng.normal()
    return x, H[k] * x + d[k] + np.sqrt(R[k]) * rng.normal(size=N)


def along_all_paths(model, x0, ys):
    """Mean and variance of every state, and the probabilities of the nodes, given all observations."""
    chain, F, b, Q, H, d, R = parts(model)
    x, P, log_w = np.full(len(PATHS), x0), np.ones(len(PATHS)), np.log(chain.initial)[PATHS[:, 0]]
    known = []
    for n, k in enumerate(PATHS.T):
        if n:
            log_w = log_w + np.log(chain.transition)[PATHS[:, n - 1], k]
            x, P = F[k] * x + b[k], F[k] ** 2 * P + Q[k]
        before = x, P
        if not np.isnan(ys[n]):
            S, off = H[k] ** 2 * P + R[k], ys[n] - H[k] * x - d[k]
            log_w = log_w - 0.5 * (off**2 / S + np.log(S))
            x, P = x + P * H[k] / S * off, P * R[k] / S
        known.append((x, P, *before))
    w = np.exp(log_w - log_w.max())
    w /= w.sum()
    xs, Ps = [x], [P]
    for n in range(N - 2, -1, -1):
        (x, P, *_), (*_, x_ahead, P_ahead) = known[n], known[n + 1]
        G = P * F[PATHS[:, n + 1]] / P_ahead
        xs.insert(0, x + G * (xs[0] - x_ahead))
        Ps.insert(0, P + G**2 * (Ps[0] - P_ahead))
    mean = np.array(xs) @ w
    variance = (np.array(Ps) + (np.array(xs) - mean[:, None]) ** 2) @ w
    return mean, variance, np.array([[w[column == j].sum() for j in range(3)] for column in PATHS.T])


@pytest.mark.parametrize("what", SYSTEMS)
def test_errors_are_near_those_of_the_exact_smoother(what) -> None:
    # that is a conditional mean: the squares of what another estimate is off it come on top of its own error
    changes = SYSTEMS[what]
    model, x0, rng = model_of(changes), changes.get("x0", 0.0), np.random.default_rng(0)
    filters = {method: SwitchingKalmanFilter(model, method=method, n_nodes=1) for method in MOST}
    exact, errors = 0.0, dict.fromkeys(MOST, 0.0)
    for _ in range(60):
        x, ys = drawn_on_nodes(model, x0, rng)
        mean = along_all_paths(model, x0, ys)[0]
        exact += ((mean - x) ** 2).sum()
        for method, f in filters.items():
            errors[method] += ((f.smooth(ys).x[:, 0] - mean) ** 2).sum()
    for method, limit in MOST.items():
        assert errors[method] <= limit * exact, method


def test_two_observations_are_smoothed_by_gpb2_nearly_exactly() -> None:
    # of the second one it is exact, and one step back merges once
    model = model_of({"Q": (0.1**2, 0.8**2), "R": (0.3**2, 1.0)})
    ys = np.array([0.4, -0.9] + [np.nan] * (N - 2))
    mean, variance, mu = along_all_paths(model, 0.0, ys)
    result = SwitchingKalmanFilter(model, method="gpb2", n_nodes=1).smooth(ys[:2])
    for got, wanted in ((result.x[:, 0], mean), (result.P[:, 0, 0], variance), (result.mu, mu)):
        np.testing.assert_allclose(got[1], wanted[1], rtol=1e-9)
        np.testing.assert_allclose(got[0], wanted[0], atol=0.02)


def one_regime(m=3, q=2):
    rng = np.random.default_rng(1)
    F = rng.normal(size=(m, m))
    F *= 0.9 / np.linalg.norm(F, 2)
    root = rng.normal(size=(m, m))
    Q, H, R = root @ root.T, rng.normal(size=(q, m)), 0.5 * np.eye(q)
    B, x0, P0 = rng.normal(size=(m, 1)), rng.normal(size=m), 2.0 * np.eye(m)
    model = SwitchingStateSpace(FadeLaw.between(20, 5), F, H, Q, R, B=B, x0=x0, P0=P0)
    zs, us = 2.0 * rng.normal(size=(30, q)), rng.normal(size=30)
    zs[4:7] = zs[11, 0] = np.nan
    return model, zs, us, (F, Q, H, R, B[:, 0], x0, P0)


def rauch_tung_striebel(zs, us, F, Q, H, R, B, x, P):
    known = []
    for n, (z, u) in enumerate(zip(zs, us, strict=True)):
        if n:
            x, P = F @ x + B * u, F @ P @ F.T + Q
        before, seen = (x, P), ~np.isnan(z)
        S = H[seen] @ P @ H[seen].T + R[np.ix_(seen, seen)]
        K = P @ H[seen].T @ np.linalg.inv(S) if seen.any() else np.zeros((len(x), 0))
        x, P = x + K @ (z[seen] - H[seen] @ x), P - K @ S @ K.T
        known.append((x, P, *before))
    out = [(x, P)]
    for (x, P, *_), (*_, x_ahead, P_ahead) in zip(known[-2::-1], known[:0:-1], strict=True):
        G = P @ F.T @ np.linalg.inv(P_ahead)
        out.append((x + G @ (out[-1][0] - x_ahead), P + G @ (out[-1][1] - P_ahead) @ G.T))
    return (np.array(one) for one in zip(*out[::-1], strict=True))


@pytest.mark.parametrize("weights", ["density", "kim"])
@pytest.mark.parametrize("method", METHODS)
def test_with_one_class_it_is_the_smoother_of_the_kalman_filter(method, weights) -> None:
    model, zs, us, arguments = one_regime()
    x, P = rauch_tung_striebel(zs, us, *arguments)
    result = SwitchingKalmanFilter(model, method=method).smooth(zs, us, weights=weights)
    np.testing.assert_allclose(result.x, x, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(result.P, P, rtol=1e-10, atol=1e-10)


def test_along_a_known_switch_it_is_exact() -> None:
    model, zs, us, arguments = one_regime()
    x, P = rauch_tung_striebel(zs, us, *arguments)
    result = KnownSwitchFilter(model).smooth(zs, np.linspace(0.0, 1.0, len(zs)), us)
    np.testing.assert_allclose(result.x, x, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(result.P, P, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_the_last_observation_is_filtered_and_what_is_told_counts(method) -> None:
    model = model_of({"Q": (0.1**2, 0.8**2)})
    f, ys = SwitchingKalmanFilter(model, method=method), np.sin(np.arange(12.0))
    Rs, Hs = [None, 0.1] * 6, [[[2.0]]] * 12
    filtered, smoothed = f.filter(ys, Rs=Rs, Hs=Hs), f.smooth(ys, Rs=Rs, Hs=Hs)
    for name in ("x", "P", "mu", "class_weights"):
        np.testing.assert_allclose(
            getattr(smoothed, name)[-1], getattr(filtered, name)[-1], rtol=1e-12, atol=1e-14
        )
    np.testing.assert_array_equal(smoothed.log_likelihood, filtered.log_likelihood)
    assert not np.allclose(smoothed.x, f.smooth(ys).x)
    f.smooth(ys, Rs=Rs, Hs=Hs)
    np.testing.assert_allclose(f.x[:, 0], filtered.x[-1], rtol=1e-12)  # where it stands


def test_a_path_of_the_switch_is_the_likeliest_one() -> None:
    model = model_of({"d": (0.0, 3.0)})
    f = SwitchingKalmanFilter(model, method="gpb2", n_nodes=1)
    ys = np.array([0.1, 0.2, 3.1, 3.0, 2.9, 0.1, 0.0, 0.1])
    result = f.smooth(ys)
    np.testing.assert_array_equal(result.switch_path, [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def test_no_observations_and_one_are_smoothed_as_well() -> None:
    f = SwitchingKalmanFilter(model_of({}))
    assert f.smooth(np.empty(0)).x.shape == (0, 1)
    np.testing.assert_allclose(f.smooth([0.3]).x, f.filter([0.3]).x, rtol=1e-14)


ZS = np.array([1.0, 0.5, 2.0, 1.0, 1.0, 0.5, 2.0, 1.0])
SWITCH = [[0.9, 0.1], [0.2, 0.8]]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("unit", [1e3, 1e-3, 1e8])
def test_units_count_for_nothing_where_predicted_covariances_differ_in_rank(method, unit) -> None:
    # a start that is known, constant velocity against an acceleration; and noise in one class alone
    def smoothed(s):
        still = np.zeros((2, 2))
        common = {"R": s * s, "x0": np.zeros(2), "P0": still}
        noise = [still, np.diag([0.0, s * s])]
        model = SwitchingStateSpace(SWITCH, [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], noise, **common)
        one = {"Q": [[[0.0]], [[s * s]]], "R": s * s, "x0": [0.0], "P0": [[[0.0]], [[s * s]]]}
        scalar = SwitchingStateSpace(SWITCH, F=0.9, H=1.0, **one)
        results = [SwitchingKalmanFilter(m, method=method).smooth(s * ZS) for m in (model, scalar)]
        return [(result.x / s, result.P / s**2, result.mu) for result in results]

    for found, expected in zip(smoothed(unit), smoothed(1.0), strict=True):
        for got, wanted in zip(found, expected, strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_a_diffuse_start_hides_no_component(method) -> None:
    def position(P0):
        Q = 0.01 * np.array([[0.25, 0.5], [0.5, 1.0]])
        noise = {"R": [[[1.0]], [[1e4]]], "x0": [0.0, 0.0], "P0": P0 * np.eye(2)}
        model = SwitchingStateSpace(SWITCH, [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], Q, **noise)
        return SwitchingKalmanFilter(model, method=method).smooth([0.0, 1.2, 1.9, 3.3, 4.1]).x[0]

    # beside R = 1e4 a start of 1e9 is diffuse; of 16 digits three are left of one of 1e13
    for P0, near in ((1e11, 1e-4), (1e13, 0.02)):
        np.testing.assert_allclose(position(P0), position(1e9), rtol=near)


#: Motions with next to no noise in some class: several histories meet in a wider law than any one has.
QUIET = {
    "decays": {"F": [[[0.5]], [[0.6]]], "H": 1.0, "Q": 1e-6},
    "offset": {"F": 0.9, "H": 1.0, "Q": 1e-6, "b": [[0.0], [1.0]]},
    "no noise at all": {"F": 0.9, "H": 1.0, "Q": 0.0, "b": [[0.0], [1.0]]},
    "gain": {"F": 0.9, "H": [[[1.0]], [[0.3]]], "Q": 1e-6, "b": [1.0]},
    "bias": {"F": 0.9, "H": 1.0, "Q": 1e-6, "d": [[0.0], [3.0]]},
    "one class without noise": {
        **{"F": [[0.735, -0.111], [-0.655, -0.102]], "b": [[1.18, -0.55], [0.52, -0.01]]},
        **{"H": [[[-0.07, -0.17], [1.47, -0.32]], [[-1.74, 0.11], [0.87, 0.64]]]},
        "Q": [[[0.12, -0.101], [-0.101, 0.217]], np.zeros((2, 2))],
    },
    "three gains, one of a lively state": {
        **{"F": 0.7, "H": [[[0.09]], [[0.67]], [[-2.83]]], "Q": [[[32.0]], [[0.002]], [[0.02]]]},
        **{"R": [[[0.01]], [[4.5]], [[0.04]]], "d": [[1.4], [0.75], [0.2]]},
        # a class that hardly ever comes: its history is wide, and nothing may carry it off
        "law": [[0.873, 0.002, 0.125], [0.045, 0.755, 0.2], [0.038, 0.262, 0.7]],
    },
    "one of two": {
        **{"F": [[0.8, 0.1], [0.0, 0.9]], "H": [[1.0, 1.0]], "Q": np.diag([0.0, 0.5])},
        "b": [[0.0, 0.0], [1.0, 0.0]],
    },
}


@pytest.mark.filterwarnings("ignore::fuzzykf.errors.HindsightWarning")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("what", QUIET)
def test_a_quiet_motion_is_not_lost_on_the_way_back(what, method) -> None:
    parts = {"law": SWITCH, "R": np.eye(np.shape(QUIET[what]["H"])[-2] if np.ndim(QUIET[what]["H"]) else 1)}
    parts |= QUIET[what]
    m = np.shape(parts["H"])[-1] if np.ndim(parts["H"]) else 1
    model = SwitchingStateSpace(**parts, x0=np.zeros(m), P0=np.eye(m))
    f, errors, trace = SwitchingKalmanFilter(model, method=method), np.zeros(2), np.zeros(2)
    for seed in range(6):
        truth = model.simulate(300, np.random.default_rng(seed))
        for k, found in enumerate((f.filter(truth.y), f.smooth(truth.y))):
            errors[k] += ((found.x - truth.x) ** 2).sum()
            trace[k] += np.trace(found.P, axis1=1, axis2=2).sum()
    assert errors[1] < 0.95 * errors[0]
    assert trace[1] < trace[0]


def test_a_quiet_mode_is_not_lost_on_the_way_back() -> None:
    # constant velocity in one class, whose noise nearly vanishes, and a target that moves freely in the other
    push, ratios = np.array([[0.25, 0.5], [0.5, 1.0]]), []
    noise = {"Q": [0.001 * push, push], "R": 1.0, "x0": [0.0, 0.0], "P0": 10.0 * np.eye(2)}
    model = SwitchingStateSpace([[0.97, 0.03], [0.1, 0.9]], [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], **noise)
    f = SwitchingKalmanFilter(model, method="gpb2")
    for seed in range(3):
        truth = model.simulate(150, np.random.default_rng(seed))
        filtered, smoothed = (((g(truth.y).x - truth.x)[:, 0] ** 2).mean() for g in (f.filter, f.smooth))
        ratios.append(smoothed / filtered)
    assert np.median(ratios) < 0.6


@pytest.mark.parametrize("method", METHODS)
def test_the_pairwise_form_of_a_state_space_model_is_smoothed_alike(method) -> None:
    T, p0, R = np.array(SWITCH), np.array([0.6, 0.4]), np.array([0.5, 2.0])
    F, b, Q = np.array([0.9, 0.6]), np.array([0.0, 1.0]), np.array([0.2, 0.01])
    H, d = np.array([1.0, 0.4]), np.array([0.0, 1.5])
    scalars = {name: value.reshape(2, 1, 1) for name, value in zip("FHQR", (F, H, Q, R), strict=True)}
    model = SwitchingStateSpace(T, **scalars, b=b[:, None], d=d[:, None], x0=[0.0], P0=1.0, initial=p0)
    A = [[[f, 0.0], [h * f, 0.0]] for f, h in zip(F, H, strict=True)]
    noise = [[[q, h * q], [h * q, h * h * q + r]] for q, h, r in zip(Q, H, R, strict=True)]
    first = [[[1.0, h], [h, h * h + r]] for h, r in zip(H, R, strict=True)]
    pairwise = CGOMSModel.from_pairwise(
        T, A, noise=noise, offset=np.stack([b, H * b + d], 1), means=np.stack([0.0 * d, d], 1),
        covariances=first, dim_x=1, initial=p0,
    )  # fmt: skip
    ys = model.simulate(60, np.random.default_rng(0)).y
    ys[[7, 20, 21, 59]] = np.nan
    one, other = (SwitchingKalmanFilter(given, method=method).smooth(ys) for given in (model, pairwise))
    for name in ("x", "P", "mu", "switch_path"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_an_outlier_is_smoothed_as_by_the_kalman_filter(far) -> None:
    model, zs, us, arguments = one_regime()
    zs[15] = far
    x, P = rauch_tung_striebel(zs, us, *arguments)
    for method in METHODS:
        result = SwitchingKalmanFilter(model, method=method).smooth(zs, us)
        np.testing.assert_allclose(result.x, x, rtol=1e-9, atol=1e-10 * far)
        np.testing.assert_allclose(result.P, P, rtol=1e-9, atol=1e-9)

"""Steady state, correlated noise and sequential updates, beside the usual update."""

import numpy as np
import pytest

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.kalman import KalmanFilter


def make(system, flat=False):
    matrices = {name: system[name] for name in ("P", "F", "Q", "H", "R")}
    return KalmanFilter(3, 2, x=system["x"] if flat else system["x"][:, None], **matrices)


# ------------------------------------------------------------------ steady state


@pytest.mark.parametrize("flat", [False, True])
def test_after_convergence_the_steady_state_is_the_filter(system, flat):
    f = make(system, flat)
    for _ in range(500):
        f.step([0.0, 0.0])
    g = f.copy()
    for z in ([1.0, -1.0], [0.5, 2.0]):
        f.step(z)
        g.predict_steadystate()
        g.update_steadystate(z)
        np.testing.assert_allclose(g.x, f.x, rtol=1e-10, atol=1e-12)
        assert g.log_likelihood == pytest.approx(f.log_likelihood, rel=1e-9)
        assert g.mahalanobis == pytest.approx(f.mahalanobis, rel=1e-9)
        assert np.array_equal(g.x_post, g.x)


def test_the_steady_state_keeps_gain_and_covariance_when_nothing_is_observed(system):
    f = make(system)
    f.step([1.0, 2.0])
    K, P, S = f.K.copy(), f.P.copy(), f.S.copy()
    f.predict_steadystate()
    x = f.x.copy()
    f.update_steadystate(None)
    assert all(map(np.array_equal, (f.K, f.P, f.S, f.x), (K, P, S, x)))
    assert f.log_likelihood == 0.0
    assert not f.y.any()


def test_a_missing_component_changes_nothing_in_the_steady_state(system):
    f = make(system)
    f.step([1.0, 2.0])
    f.predict_steadystate()
    x, predicted = f.x.copy(), f.H @ f.x
    f.update_steadystate([np.nan, 1.0])
    np.testing.assert_allclose(f.x, x + f.K[:, 1:] * (1.0 - predicted[1]), rtol=1e-14)
    y, s = 1.0 - predicted[1, 0], f.S[1, 1]
    assert f.log_likelihood == pytest.approx(-0.5 * (y * y / s + np.log(2 * np.pi * s)))


def test_controls_move_the_steady_state(system):
    f = make(system)
    f.predict_steadystate(u=2.0, B=np.ones((3, 1)))
    np.testing.assert_allclose(f.x, system["F"] @ system["x"][:, None] + 2.0)


# ------------------------------------------------------------------ correlated noise


@pytest.mark.parametrize("flat", [False, True])
def test_correlated_noise_is_conditioned_on_in_the_joint_law(system, flat):
    # oracle: the joint law of the prediction error e and the noise v, with z = H (x + e) + v
    f = make(system, flat)
    M = 0.1 * np.arange(6.0).reshape(3, 2)
    f.M = M
    x, P, H, R = system["x"], system["P"], system["H"], system["R"]
    joint = np.block([[P, M], [M.T, R]])
    assert np.linalg.eigvalsh(joint)[0] > 0
    observe, z = np.hstack([H, np.eye(2)]), np.array([1.0, -0.5])
    S = observe @ joint @ observe.T
    gain = joint @ observe.T @ np.linalg.inv(S)
    f.update_correlated(z)
    np.testing.assert_allclose(f.x.ravel(), x + gain[:3] @ (z - H @ x), rtol=1e-12)
    np.testing.assert_allclose(f.P, (joint - gain @ S @ gain.T)[:3, :3], rtol=1e-11)
    np.testing.assert_allclose(f.S, S, rtol=1e-13)


def test_correlated_noise_with_a_missing_component(system):
    f, g = make(system), make(system)
    f.M = 0.1 * np.arange(6.0).reshape(3, 2)
    g.M = f.M[:, 1:]
    f.update_correlated([np.nan, 0.7])
    g.update_correlated([0.7], R=system["R"][1:, 1:], H=system["H"][1:])
    np.testing.assert_allclose(f.x, g.x, rtol=1e-13)
    np.testing.assert_allclose(f.P, g.P, rtol=1e-12)
    f.update_correlated(None)
    np.testing.assert_allclose(f.x, g.x, rtol=1e-13)
    assert f.log_likelihood == 0.0


def test_without_correlation_the_update_is_the_usual_one(system):
    f, g = make(system), make(system)
    f.update([1.0, 2.0])
    g.update_correlated([1.0, 2.0])
    np.testing.assert_allclose(g.x, f.x, rtol=1e-13)
    np.testing.assert_allclose(g.P, f.P, rtol=1e-12)


# ------------------------------------------------------------------ sequential


@pytest.mark.parametrize("flat", [False, True])
def test_independent_components_can_be_taken_one_after_another(system, flat):
    f = make(system, flat)
    f.R = np.diag([0.5, 2.0])
    f.predict()
    g = f.copy()
    f.update([1.0, 2.0])
    g.update_sequential(0, 1.0)
    first = g.log_likelihood
    g.update_sequential(1, [2.0])
    np.testing.assert_allclose(g.x, f.x, rtol=1e-12)
    np.testing.assert_allclose(g.P, f.P, rtol=1e-12)
    assert np.array_equal(g.z.astype(float), f.z)
    # the density of z is that of its first component times that of the second given the first
    assert first + g.log_likelihood == pytest.approx(f.log_likelihood, rel=1e-12)
    assert np.array_equal(g.x, g.x_post)


def test_a_block_may_bring_its_own_matrices_and_gaps(system):
    f, g = make(system), make(system)
    f.update_sequential(0, [[3.0], [np.nan]], R_i=2.0, H_i=2.0 * system["H"])
    g.update([3.0], R=2.0, H=2.0 * system["H"][:1])
    np.testing.assert_allclose(f.x, g.x, rtol=1e-13)
    np.testing.assert_allclose(f.P, g.P, rtol=1e-13)
    assert f.log_likelihood == pytest.approx(g.log_likelihood)
    assert f.mahalanobis == pytest.approx(g.mahalanobis)
    x = f.x.copy()
    f.update_sequential(1, np.nan)
    assert np.array_equal(f.x, x)
    assert (f.log_likelihood, f.mahalanobis) == (0.0, 0.0)


def test_a_block_after_an_observation_of_another_size_starts_anew(system):
    f = make(system)
    f.update([1.0], R=1.0, H=system["H"][:1])
    f.update_sequential(1, 2.0)
    assert f.z.shape == (2, 1)
    assert f.z[0, 0] is None
    assert f.K.shape == (3, 2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: f.update_sequential(1, [1.0, 2.0]), "start, z_i: got components 1 to 2"),
        (lambda f: f.update_sequential(-1, 1.0), "start, z_i"),
        (lambda f: f.update_sequential(0, 1.0, R_i=-1.0), "R_i"),
        (lambda f: f.update_sequential(0, 1.0, H_i=[1.0, 2.0]), "H_i: got shape"),
        (lambda f: f.update_correlated([1.0, 2.0, 3.0]), "z: got shape"),
        (lambda f: f.update_steadystate([1.0]), "z: got shape"),
        (lambda f: f.predict_steadystate(u=[1.0], B=np.ones((3, 1))), "u: .*give B u"),
    ],
)
def test_a_failed_call_names_the_argument_and_changes_nothing(system, call, message):
    f = make(system)
    f.step([1.0, 2.0])
    before = {name: np.copy(value) for name, value in f.__dict__.items() if name != "_origin"}
    with pytest.raises((ShapeError, ParameterError), match=message):
        call(f)
    for name, value in before.items():
        assert np.array_equal(value, getattr(f, name)), name


def test_a_wrong_m_is_named(system):
    f = make(system)
    f.M = np.zeros((2, 2))
    with pytest.raises(ShapeError, match=r"M: got shape \(2, 2\), expected \(3, 2\)"):
        f.update_correlated([1.0, 2.0])


def test_a_block_that_is_not_the_first_brings_a_matrix_of_its_own(system):
    f, g = make(system), make(system)
    f.H[1] *= 2.0
    f.predict()
    g.predict()
    f.update_sequential(1, [0.7])
    g.update_sequential(1, [0.7], H_i=2.0 * system["H"][1:])
    np.testing.assert_allclose(g.x, f.x, rtol=1e-14)
    np.testing.assert_allclose(g.P, f.P, rtol=1e-14)

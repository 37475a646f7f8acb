"""ExtendedKalmanFilter: equations (69) to (75), filterpy's calls, and whole series."""

import pickle

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, KalmanFilter


def fx(x, u=0.0, dt=0.5):
    """A pendulum."""
    return np.array([x[0] + dt * x[1], x[1] - dt * np.sin(x[0]) + u])


def F_of(x, u=0.0, dt=0.5):
    return np.array([[1.0, dt], [-dt * np.cos(x[0]), 1.0]])


def hx(x, scale=1.0):
    return np.array([scale * np.sin(x[0]), x[0] * x[1]])


def H_of(x, scale=1.0):
    return np.array([[scale * np.cos(x[0]), 0.0], [x[1], x[0]]])


def make(jacobians=True, **more):
    functions = {"FJacobian": F_of, "HJacobian": H_of} if jacobians else {}
    f = ExtendedKalmanFilter(2, 2, fx=fx, hx=hx, **functions, Q=0.1, R=0.2, **more)
    f.x = np.array([[0.3], [0.2]])
    return f


ZS = np.array([[0.4, 0.1], [np.nan, np.nan], [0.5, np.nan], [0.2, -0.1], [0.1, 0.0]])


def state(f):
    return {name: pickle.dumps(value) for name, value in f.__dict__.items() if name != "_origin"}


# ------------------------------------------------------------------ the equations


def test_one_step_is_the_printed_recursion():
    f, z = make(), np.array([0.4, 0.1])
    x, P = np.array([0.3, 0.2]), np.eye(2)
    F = F_of(x)
    x, P = fx(x), F @ P @ F.T + 0.1 * np.eye(2)  # (69), (70)
    f.predict()
    np.testing.assert_allclose(f.x_prior.ravel(), x, rtol=1e-14)
    np.testing.assert_allclose(f.P_prior, P, rtol=1e-14)
    np.testing.assert_allclose(f.F, F)
    G = H_of(x)
    K = P @ G.T @ np.linalg.inv(G @ P @ G.T + 0.2 * np.eye(2))  # (72)
    f.update(z)
    np.testing.assert_allclose(f.x.ravel(), x + K @ (z - hx(x)), rtol=1e-12)  # (73)
    np.testing.assert_allclose(f.P, P - K @ G @ P, rtol=1e-12)  # (74)
    S = G @ P @ G.T + 0.2 * np.eye(2)
    y = z - hx(x)
    assert f.log_likelihood == pytest.approx(
        -0.5 * (y @ np.linalg.inv(S) @ y + np.log(np.linalg.det(2 * np.pi * S)))
    )


def test_central_differences_stand_in_for_missing_jacobians():
    f, g = make(), make(jacobians=False)
    for z in ZS:
        f.step(z)
        g.step(z)
    np.testing.assert_allclose(g.x, f.x, rtol=1e-7)
    np.testing.assert_allclose(g.P, f.P, rtol=1e-7)


def test_a_linear_model_gives_the_kalman_filter(system):
    F, H = system["F"], system["H"]
    matrices = {name: system[name] for name in ("P", "Q", "R")}
    f = KalmanFilter(3, 2, x=system["x"], F=F, H=H, **matrices)
    g = ExtendedKalmanFilter(3, 2, x=system["x"], fx=lambda x: F @ x, hx=lambda x: H @ x, **matrices)
    h = ExtendedKalmanFilter(3, 2, x=system["x"], F=F, hx=lambda x: H @ x, **matrices)
    for method in ("filter", "smooth"):
        expected = getattr(f.copy(), method)(system["zs"])
        for other in (g, h):
            result = getattr(other.copy(), method)(system["zs"])
            for name in ("x", "P", "log_likelihood"):
                np.testing.assert_allclose(
                    getattr(result, name), getattr(expected, name), rtol=1e-6, atol=1e-8, err_msg=name
                )


def test_a_residual_function_wraps_angles():
    def bearing(x):
        return np.arctan2(x[1:], x[:1])

    def wrapped(a, b):
        return (a - b + np.pi) % (2 * np.pi) - np.pi

    f = ExtendedKalmanFilter(2, 1, hx=bearing, residual=wrapped, R=0.01, x=[-2.0, -0.1])
    g = f.copy()
    f.update(np.pi - 0.05)  # just across the cut: a small residual
    assert abs(f.y[0]) < 0.11
    assert f.x[1] > -0.1
    g.update(np.pi - 0.05, residual=np.subtract)
    assert abs(g.y[0]) > 6.0
    f.update([np.nan])
    assert f.log_likelihood == 0.0


# ------------------------------------------------------------------ filterpy's calls


@pytest.mark.parametrize("flat", [False, True])
def test_functions_of_a_call_get_x_as_the_filter_holds_it(flat):
    seen = []

    def Hx(x, offset):
        seen.append(x.shape)
        return np.array([x.ravel()[0] + offset])

    def HJacobian(x, slope):
        seen.append(x.shape)
        return np.array([[slope, 0.0]])

    f = ExtendedKalmanFilter(2, 1)
    f.x = np.zeros(2) if flat else np.zeros((2, 1))
    f.update(1.0, HJacobian, Hx, R=3.0, args=1.0, hx_args=(0.5,))
    assert set(seen) == {f.x.shape}
    assert f.x.ravel()[0] == pytest.approx(0.5 / 4.0)
    assert f.y.shape == ((1,) if flat else (1, 1))


def test_functions_given_at_construction_get_a_flat_x():
    shapes = []

    def note(result):
        def function(x):
            shapes.append(x.shape)
            return result

        return function

    functions = {"fx": [1.0, 2.0], "FJacobian": np.eye(2), "hx": [0.0], "HJacobian": np.ones((1, 2))}
    f = ExtendedKalmanFilter(2, 1, **{name: note(result) for name, result in functions.items()})
    f.x = np.zeros((2, 1))
    f.step(1.0)
    assert shapes == [(2,)] * 4
    assert f.x.shape == (2, 1)


def test_calls_and_construction_give_the_same():
    f, g = make(), ExtendedKalmanFilter(2, 2, Q=0.1, R=0.2)
    g.x = np.array([0.3, 0.2])
    f.predict()
    f.update([0.4, 0.1], scale=2.0)
    g.F, g.x = F_of(g.x), fx(g.x)
    g.P = g.F @ g.P @ g.F.T + 0.1 * np.eye(2)
    g.update([0.4, 0.1], H_of, hx, args=(2.0,), hx_args=2.0)
    np.testing.assert_allclose(g.x, f.x.ravel(), rtol=1e-14)
    np.testing.assert_allclose(g.P, f.P, rtol=1e-14)


def test_a_scalar_from_hx_is_an_observation_of_one_component():
    f = ExtendedKalmanFilter(2, 1)
    f.x = np.array([3.0, 4.0])
    f.update([6.0], lambda x: np.array([x / np.hypot(*x)]), lambda x: np.hypot(*x))
    assert f.y[0] == pytest.approx(1.0)


def test_predict_update_is_predict_then_update():
    # filterpy linearises the observation at the estimate before the prediction
    f, g = make(), make()
    f.predict_update([0.4, 0.1])
    g.predict()
    g.update([0.4, 0.1])
    assert np.array_equal(f.x, g.x)
    assert np.array_equal(f.x_prior, g.x_prior)
    f.predict_update(None, u=0.0)
    g.step(None)
    assert np.array_equal(f.x, g.x)
    before = state(f)
    with pytest.raises(ShapeError, match=r"z: got shape \(3,\)"):
        f.predict_update([1.0, 2.0, 3.0])
    assert state(f) == before


def test_predict_x_can_be_overridden():
    class Own(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = self.x * 2.0 + u
            self.F = 2.0 * np.eye(1)

    f = Own(1, 1)
    f.x = np.array([3.0])
    f.predict()
    assert (f.x[0], f.x_prior[0], f.P[0, 0]) == (6.0, 6.0, 5.0)
    f.predict(None)
    assert f.x[0] == 12.0


def test_without_fx_the_state_moves_linearly_with_control():
    f = ExtendedKalmanFilter(2, 1)
    f.F, f.B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
    f.x = np.array([[1.0], [2.0]])
    f.predict(2.0)
    np.testing.assert_allclose(f.x, [[4.0], [4.0]])


def test_a_missing_observation_leaves_the_prediction():
    for z in (None, [np.nan, np.nan]):
        f = make()
        f.step([0.4, 0.1])
        f.predict()
        x = f.x.copy()
        f.update(z)
        assert np.array_equal(f.x, x)
        assert np.array_equal(f.x_post, x)
        assert not f.y.any()
        assert (f.log_likelihood, f.mahalanobis) == (0.0, 0.0)


def test_a_missing_component_is_as_if_it_had_no_row():
    f, g = make(), make()
    f.predict()
    g.predict()
    f.update([0.4, np.nan])
    g.update([0.4], lambda x: H_of(x.ravel())[:1], lambda x: hx(x.ravel())[:1], R=0.2)
    np.testing.assert_allclose(f.x, g.x, rtol=1e-13)
    np.testing.assert_allclose(f.P, g.P, rtol=1e-13)
    assert f.log_likelihood == pytest.approx(g.log_likelihood)


def test_defaults_are_those_of_filterpy():
    filterpy_kalman = pytest.importorskip("filterpy.kalman")
    f, g = ExtendedKalmanFilter(3, 2), filterpy_kalman.ExtendedKalmanFilter(3, 2)
    for name in g.__dict__.keys() - {"_log_likelihood", "_likelihood", "_mahalanobis", "K"}:
        assert np.array_equal(getattr(f, name), getattr(g, name)), name
    assert f.K.shape == (3, 2)
    assert not hasattr(f, "H")


# ------------------------------------------------------------------ arguments and series


def test_controls_and_keywords_reach_the_functions():
    f = make()
    f.predict(0.7, dt=0.1)
    np.testing.assert_allclose(f.x.ravel(), fx(np.array([0.3, 0.2]), 0.7, 0.1))
    np.testing.assert_allclose(f.F, F_of(np.array([0.3, 0.2]), dt=0.1))
    g = make(jacobians=False)
    g.predict(0.7, dt=0.1)
    np.testing.assert_allclose(g.F, f.F, rtol=1e-7)


def test_a_series_is_as_step_by_step_with_its_own_arguments():
    f, g = make(), make()
    us, before = [0.1, None, 0.0, 0.2, 0.1], [{"dt": 0.1 * k} for k in range(1, 6)]
    after = [None, {"scale": 2.0}, {"scale": 3.0}, None, {}]
    result = f.filter(ZS, us=us, fx_args=before, hx_args=after)
    for k, z in enumerate(ZS):
        g.predict(us[k], **before[k])
        g.update(z, **(after[k] or {}))
        assert np.array_equal(result.x[k], g.x.ravel())
        assert result.log_likelihood[k] == g.log_likelihood
    assert np.array_equal(f.x, g.x)
    means, _, means_p, covariances_p = make().batch_filter(ZS, us, before, after)
    assert means.shape == (5, 2, 1)
    assert np.array_equal(means[..., 0], result.x)
    assert np.array_equal(means_p[..., 0], result.x_prior)
    assert np.array_equal(covariances_p, result.P_prior)
    many = make().filter_many(
        np.stack([ZS, ZS[::-1]]), keep=("x", "P_prior"), us=us, fx_args=before, hx_args=after
    )
    assert np.array_equal(many.x[0], result.x)
    assert many.P is None
    flat = make()
    flat.x = flat.x.ravel()
    assert flat.batch_filter(ZS)[0].shape == (5, 2)


def test_smooth_uses_the_jacobians_of_the_forward_pass():
    f, g = make(), make()
    result, d = f.smooth(ZS), 2
    x, P, x_prior, P_prior, F = [], [], [], [], []
    for z in ZS:
        g.step(z)
        x.append(g.x.ravel())
        P.append(g.P)
        x_prior.append(g.x_prior.ravel())
        P_prior.append(g.P_prior)
        F.append(g.F)
    x_s, P_s = [x[-1]], [P[-1]]
    for k in range(len(ZS) - 2, -1, -1):  # the textbook form of the recursion
        C = P[k] @ F[k + 1].T @ np.linalg.inv(P_prior[k + 1])
        x_s.insert(0, x[k] + C @ (x_s[0] - x_prior[k + 1]))
        P_s.insert(0, P[k] + C @ (P_s[0] - P_prior[k + 1]) @ C.T)
    np.testing.assert_allclose(result.x, x_s, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(result.P, P_s, rtol=1e-9, atol=1e-12)
    assert result.x.shape == (5, d)


# ------------------------------------------------------------------ inadmissible


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda f: f.update([1.0, 2.0, 3.0]), ShapeError, r"z: got shape \(3,\)"),
        (lambda f: f.update([1.0, np.inf]), ParameterError, "z: .*finite"),
        (
            lambda f: f.update([1.0, 2.0], HJacobian=lambda x: np.eye(3)),
            ShapeError,
            r"HJacobian: got shape \(3, 3\), expected \(2, 2\)",
        ),
        (lambda f: f.update([1.0, 2.0], Hx=lambda x: [np.nan, 0.0]), ParameterError, "Hx: .*finite"),
        (
            lambda f: f.update([1.0, 2.0], Hx=lambda x: np.zeros((2, 2))),
            ShapeError,
            r"Hx: got shape \(2, 2\)",
        ),
        (lambda f: f.update([1.0, 2.0], R=-1.0), NotPositiveDefiniteError, "R"),
        (lambda f: f.update([1.0, 2.0], residual=lambda a, b: [0.0]), ShapeError, "residual: got shape"),
        (lambda f: f.predict(dt=np.nan), ParameterError, "fx: .*finite|FJacobian: .*finite"),
        (lambda f: f.predict(unknown=1.0), TypeError, "unknown"),
        (lambda f: setattr(f, "fx", lambda x: x[:1]) or f.predict(), ShapeError, "fx: got shape"),
        (
            lambda f: setattr(f, "FJacobian", lambda x: np.eye(3)) or f.predict(),
            ShapeError,
            "FJacobian: got shape",
        ),
        (lambda f: setattr(f, "hx", None) or f.update([1.0, 2.0]), ParameterError, "Hx: got None"),
    ],
)
def test_a_failed_call_names_the_argument_and_leaves_the_estimate(call, error, message):
    f = make()
    f.step([0.4, 0.1])
    before = {
        name: np.copy(getattr(f, name))
        for name in ("x", "P", "F", "x_prior", "P_prior", "x_post", "y", "K", "z")
    }
    with pytest.raises(error, match=message):
        call(f)
    for name, value in before.items():
        assert np.array_equal(value, getattr(f, name)), name


@pytest.mark.parametrize("name", ["fx", "FJacobian", "hx", "HJacobian", "residual"])
def test_functions_have_to_be_callable(name):
    with pytest.raises(ParameterError, match=f"{name}: got 3, expected a function"):
        ExtendedKalmanFilter(1, 1, **{name: 3})


def test_a_failing_predict_x_leaves_the_filter():
    class Own(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = np.full(1, 7.0)
            raise ZeroDivisionError

    f = Own(1, 1, x=[1.0])
    with pytest.raises(ZeroDivisionError):
        f.predict()
    assert f.x[0] == 1.0


def test_arguments_for_a_function_that_is_not_there_are_an_error():
    f = ExtendedKalmanFilter(1, 1)
    with pytest.raises(ParameterError, match="fx: got the arguments dt, but the filter has no fx"):
        f.predict(dt=1.0)

"""KalmanFilter: the recursion against joint conditioning, and what filterpy's users rely on."""

import copy
import pickle
import sys

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
from fuzzykf.kalman.arguments import SingularInnovationError


def make(system, flat=False):
    matrices = {name: system[name] for name in ("P", "F", "Q", "H", "R")}
    return KalmanFilter(3, 2, x=system["x"] if flat else system["x"][:, None], **matrices)


def snapshot(f):
    """Everything a filter holds, as a list of comparable bytes."""
    return {name: pickle.dumps(value) for name, value in f.__dict__.items() if name != "_origin"}


# ------------------------------------------------------------------ the recursion


@pytest.mark.parametrize("flat", [False, True])
def test_steps_are_the_conditional_law_given_what_was_seen(system, joint_gaussian, flat):
    # an independent oracle: conditioning in the joint law, with whole and partial gaps
    f, zs = make(system, flat), system["zs"]
    joint = joint_gaussian(*(system[name] for name in ("x", "P", "F", "Q", "H", "R")), len(zs))
    x, P, log_likelihood = joint.filtered(zs)
    for k, z in enumerate(zs):
        f.predict()
        np.testing.assert_allclose(f.x_prior.ravel(), joint.state(k, zs, k)[0], rtol=1e-9, atol=1e-12)
        f.update(z)
        np.testing.assert_allclose(f.x.ravel(), x[k], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(f.P, P[k], rtol=1e-9, atol=1e-12)
        assert f.log_likelihood == pytest.approx(log_likelihood[k], rel=1e-9, abs=1e-12)


def test_a_missing_component_is_as_if_it_had_no_row(system):
    # y, K and S^-1 of a partial update are those of a filter with that row of H and R left out
    f, g = make(system), make(system)
    f.predict()
    g.predict()
    f.update([np.nan, 1.5])
    g.update([1.5], R=system["R"][1:, 1:], H=system["H"][1:])
    np.testing.assert_allclose(f.x, g.x, rtol=1e-13)
    np.testing.assert_allclose(f.P, g.P, rtol=1e-13)
    np.testing.assert_allclose(f.K, np.hstack([np.zeros((3, 1)), g.K]), rtol=1e-13)
    np.testing.assert_allclose(f.SI, [[0.0, 0.0], [0.0, g.SI[0, 0]]], rtol=1e-13)
    np.testing.assert_allclose(f.y, [[0.0], [g.y[0, 0]]], rtol=1e-13)
    assert f.log_likelihood == pytest.approx(g.log_likelihood, rel=1e-13)
    assert f.mahalanobis == pytest.approx(g.mahalanobis, rel=1e-13)


def test_a_missing_observation_leaves_the_prediction(system):
    for flat, nothing in ((False, None), (True, None), (False, [np.nan, np.nan])):
        f = make(system, flat)
        f.step(system["zs"][0])
        f.predict()
        x, P = f.x.copy(), f.P.copy()
        f.update(nothing)
        for name, value in {"x": x, "P": P, "x_post": x, "P_post": P, "x_prior": x, "P_prior": P}.items():
            assert np.array_equal(getattr(f, name), value), name
        assert f.y.shape == ((2,) if flat else (2, 1))
        assert not f.y.any()
        assert (f.log_likelihood, f.likelihood, f.mahalanobis) == (0.0, 1.0, 0.0)
        assert (f.z == None).all()  # noqa: E711 - an array of None, as in filterpy


def test_the_covariance_stays_definite_where_the_short_form_does_not():
    # Joseph's form: a nearly exact observation of a nearly known state
    f = KalmanFilter(2, 1, H=[[1.0, 1.0]], R=1e-14, P=[[1e8, 0.0], [0.0, 1e8]], Q=0.0)
    for z in np.linspace(0.0, 1.0, 50):
        f.step(z)
        assert np.linalg.eigvalsh(f.P)[0] >= 0.0
        assert np.array_equal(f.P, f.P.T)


def test_alpha_inflates_the_moved_covariance():
    f = KalmanFilter(1, 1, H=[[1.0]], F=[[2.0]], P=3.0, Q=0.5)
    f.alpha = 1.1
    f.predict()
    assert f.P[0, 0] == pytest.approx(1.1**2 * 2.0 * 3.0 * 2.0 + 0.5)
    assert f.alpha == pytest.approx(1.1)


def test_three_and_more_components_are_inverted_as_one_and_two(system):
    # the inverse has its own branch from three components on; independent components must factor
    H = np.eye(4)
    f = KalmanFilter(4, 4, H=H, R=np.diag([1.0, 2.0, 3.0, 4.0]))
    f.step([1.0, 2.0, 3.0, 4.0])
    for i in range(4):
        g = KalmanFilter(1, 1, H=[[1.0]], R=i + 1.0)
        g.step(i + 1.0)
        assert f.x[i, 0] == pytest.approx(g.x[0, 0], rel=1e-14)
        assert f.P[i, i] == pytest.approx(g.P[0, 0], rel=1e-14)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_an_outlier_stays_finite(m):
    f = KalmanFilter(3, m, H=np.eye(3)[:m])
    f.step(np.full(m, 1e12))
    assert np.isfinite(f.x).all()
    assert np.isfinite(f.log_likelihood)
    assert f.likelihood == sys.float_info.min


# ------------------------------------------------------------------ arguments of the verbs


def test_arguments_of_a_call_replace_the_attributes_once(system):
    f, g = make(system), make(system)
    F, Q, H, R = 0.5 * system["F"], 2.0 * system["Q"], 3.0 * system["H"], 4.0 * system["R"]
    B, u = np.ones((3, 2)), np.array([[1.0], [2.0]])
    f.predict(u, B, F, Q)
    f.update(system["zs"][0], R, H)
    g.F, g.Q, g.H, g.R, g.B = F, Q, H, R, B
    g.predict(u)
    g.update(system["zs"][0])
    assert np.array_equal(f.x, g.x)
    assert np.array_equal(f.P, g.P)
    assert f.F is not F
    assert f.B is None


def test_scalars_are_multiples_of_the_identity(system):
    # filterpy adds a scalar Q to all entries of P when it is an attribute, and to the
    # diagonal when it is an argument; here it is always the diagonal
    f, g, h = make(system), make(system), make(system)
    f.Q, f.R, f.P = 0.3, 0.7, 2.0
    g.Q, g.R, g.P = 0.3 * np.eye(3), 0.7 * np.eye(2), 2.0 * np.eye(3)
    h.P = 2.0 * np.eye(3)
    f.step([1.0, 2.0])
    g.step([1.0, 2.0])
    h.predict(Q=0.3)
    h.update([1.0, 2.0], R=0.7)
    for other in (g, h):
        np.testing.assert_allclose(f.x, other.x, rtol=1e-14)
        np.testing.assert_allclose(f.P, other.P, rtol=1e-14)


def test_integers_and_lists_are_matrices_too():
    f, g = KalmanFilter(2, 1), KalmanFilter(2, 1)
    f.F, f.H, f.P, f.R = [[1, 1], [0, 1]], np.array([[1, 0]]), [[2, 0], [0, 2]], 1
    f.x = np.array([[0], [1]])
    g.F, g.H, g.P = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]]), 2.0 * np.eye(2)
    g.x = np.array([[0.0], [1.0]])
    assert np.array_equal(f.step(3), g.step(3.0))


def test_an_observation_may_have_its_own_number_of_components(system):
    # sensors that come and go: H, and with it z and R, may have another number of rows
    f = make(system)
    f.update([[1.0], [2.0], [3.0]], R=1.0, H=np.eye(3))
    assert (f.y.shape, f.S.shape, f.K.shape) == ((3, 1), (3, 3), (3, 3))
    f.update([1.0, 2.0])
    assert f.y.shape == (2, 1)


def test_controls(system):
    f = make(system)
    f.B = np.array([[1.0], [2.0], [3.0]])
    x = f.F @ f.x
    for u in (2.0, [[2.0]]):
        g = f.copy()
        g.predict(u)
        np.testing.assert_allclose(g.x, x + 2.0 * f.B, rtol=1e-14)
    for u in (None, 0):
        g = f.copy()
        g.predict(u)
        np.testing.assert_allclose(g.x, x, rtol=1e-14)


# ------------------------------------------------------------------ the form of vectors


def test_a_flat_state_makes_all_vectors_flat():
    f = KalmanFilter(2, 1, H=[[1.0, 0.0]])
    f.x = np.array([1.0, 2.0])
    vectors = ("x_prior", "x_post", "y", "z")
    assert [getattr(f, name).ndim for name in vectors] == [1] * 4
    f.step(3.0)
    assert [getattr(f, name).shape for name in vectors] == [(2,), (2,), (1,), (1,)]
    f.x = np.array([[1.0], [2.0]])
    assert [getattr(f, name).ndim for name in vectors] == [2] * 4
    f.step(3.0)
    assert [getattr(f, name).shape for name in vectors] == [(2, 1), (2, 1), (1, 1), (1, 1)]


def test_results_are_copies(system):
    f, z = make(system), np.array([1.0, 2.0])
    f.step(z)
    z[0] = 9.0
    assert f.z[0, 0] == 1.0
    for one, other in (("x", "x_post"), ("P", "P_post")):
        getattr(f, one)[:] = 0.0
        assert getattr(f, other).any()
    f.x, f.P = np.ones((3, 1)), np.eye(3)
    f.predict()
    for one, other in (("x", "x_prior"), ("P", "P_prior")):
        getattr(f, one)[:] = 0.0
        assert getattr(f, other).any()


# ------------------------------------------------------------------ defaults


def test_defaults_are_those_of_filterpy():
    filterpy_kalman = pytest.importorskip("filterpy.kalman")
    for dims in ((2, 1), (4, 2, 3)):
        f, g = KalmanFilter(*dims), filterpy_kalman.KalmanFilter(*dims)
        for name in g.__dict__.keys() - {"_log_likelihood", "_likelihood", "_mahalanobis"}:
            ours, theirs = getattr(f, name), getattr(g, name)
            assert np.shape(ours) == np.shape(theirs), name
            assert np.array_equal(ours, theirs), name
        for name in ("log_likelihood", "likelihood", "mahalanobis", "alpha"):
            assert getattr(f, name) == getattr(g, name), name


def test_every_attribute_can_be_assigned():
    f = KalmanFilter(2, 1)
    for name in list(f.__dict__):
        value = object()
        setattr(f, name, value)
        assert getattr(f, name) is value


# ------------------------------------------------------------------ without a change of state


def test_queries_do_not_change_the_filter(system):
    f = make(system)
    f.step(system["zs"][0])
    before, z = snapshot(f), np.array([1.0, np.nan])
    x, P = f.get_prediction()
    x_z, P_z = f.get_update(z)
    residual, measurement = f.residual_of(z), f.measurement_of_state(f.x)
    assert f.log_likelihood_of(None) == np.log(sys.float_info.min)
    assert snapshot(f) == before
    np.testing.assert_allclose(residual, z[:, None] - f.H @ f.x_prior)
    np.testing.assert_allclose(measurement, f.H @ f.x)
    assert all(map(np.array_equal, f.get_update(None), (f.x, f.P)))
    updated = f.copy()
    updated.update(z)
    np.testing.assert_allclose(x_z, updated.x)
    np.testing.assert_allclose(P_z, updated.P)
    f.predict()
    assert np.array_equal(f.x, x)
    assert np.array_equal(f.P, P)


def test_log_likelihood_of_is_the_density_under_the_latest_s(system):
    f = make(system)
    f.step(system["zs"][0])
    z, mean = np.array([0.3, -0.2]), (f.H @ f.x).ravel()
    expected = -0.5 * ((z - mean) @ np.linalg.solve(f.S, z - mean) + np.log(np.linalg.det(2 * np.pi * f.S)))
    assert f.log_likelihood_of(z) == pytest.approx(expected)


def test_repr_shows_the_attributes(system):
    text = repr(make(system))
    assert text.startswith("KalmanFilter object")
    assert "\nx = [[" in text
    assert "\nlog_likelihood = " in text


def test_copies_and_pickles_go_on_alike(system):
    f = make(system)
    for z in system["zs"][:3]:
        f.step(z)
    others = [f.copy(), copy.deepcopy(f), pickle.loads(pickle.dumps(f))]
    f.step(system["zs"][4])
    for other in others:
        assert np.array_equal(other.step(system["zs"][4]), f.x)


def test_reset_returns_to_what_was_assigned_before_the_first_verb(system):
    f = KalmanFilter(3, 2)
    f.x, f.H, f.P = np.ones(3), system["H"], 5.0
    f.step([1.0, 2.0])
    f.Q = 100.0
    f.step([1.0, 2.0])
    f.reset()
    assert np.array_equal(f.x, np.ones(3))
    assert f.P == 5.0
    assert np.array_equal(f.Q, np.eye(3))


# ------------------------------------------------------------------ singular and inadmissible


def test_a_singular_innovation_is_an_error_and_a_pseudo_inverse_may_take_it(system):
    f = KalmanFilter(1, 2, H=[[1.0], [1.0]])
    f.R = np.zeros((2, 2))
    before = snapshot(f)
    with pytest.raises(NotPositiveDefiniteError, match="S = H P H' \\+ R") as error:
        f.update([1.0, 1.0])
    assert isinstance(error.value, np.linalg.LinAlgError)  # what filterpy raises
    assert snapshot(f) == before
    f.inv = np.linalg.pinv
    f.update([1.0, 1.0])
    assert f.x[0, 0] == pytest.approx(1.0)
    # density of (1, 1) on the line y1 = y2, where the law is N(0, 2) along the unit vector
    assert f.log_likelihood == pytest.approx(-0.5 * (2.0 / 2.0 + np.log(2 * np.pi * 2.0)))
    f.P = np.eye(1)
    f.x = np.zeros((1, 1))
    f.update([1.0, 2.0])
    assert f.log_likelihood == -np.inf


@pytest.mark.parametrize("m", [2, 3, 4])
def test_sensors_without_noise_that_say_the_same_are_singular_to_rounding(m):
    # the exact S has rank one; rounding may leave tiny positive pivots, which are no information
    rng = np.random.default_rng(m)
    for _ in range(20):
        row, root = rng.normal(size=3), rng.normal(size=(3, 3))
        f = KalmanFilter(3, m, H=np.outer(rng.uniform(0.5, 2.0, m), row), P=root @ root.T, R=0.0)
        with pytest.raises(NotPositiveDefiniteError):
            f.update(np.zeros(m))
        f.Q = 0.0
        with pytest.raises(NotPositiveDefiniteError):
            f.filter_many(np.zeros((2, 3, m)))
    f.inv = np.linalg.pinv
    f.update(f.H @ np.ones(3))
    np.testing.assert_allclose(f.H @ f.x, (f.H @ np.ones(3))[:, None], rtol=1e-10)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_an_indefinite_innovation_is_an_error(m):
    f = KalmanFilter(3, m, H=np.eye(3)[:m])
    f.R = -5.0 * np.eye(m)
    with pytest.raises(NotPositiveDefiniteError):
        f.update(np.zeros(m))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.zeros((1, 3))}, r"x: got shape \(1, 3\), expected \(3, 1\) or \(3,\)"),
        ({"x": np.zeros(4)}, r"x: got shape \(4,\)"),
        ({"P": np.eye(2)}, r"P: got shape \(2, 2\), expected \(3, 3\)"),
        ({"F": np.eye(4)}, r"F: got shape \(4, 4\), expected \(3, 3\)"),
        ({"Q": np.ones(3)}, r"Q: got shape \(3,\), expected \(3, 3\)"),
        ({"H": np.eye(3)}, r"H: got shape \(3, 3\), expected \(2, 3\)"),
        ({"R": np.ones(2)}, r"R: got shape \(2,\), expected \(2, 2\)"),
        ({"F": "no matrix"}, "F: expected an array of numbers"),
    ],
)
def test_a_wrong_attribute_is_named_when_it_is_used(system, change, message):
    f = make(system)
    f.step(system["zs"][0])
    for name, value in change.items():
        setattr(f, name, value)
    before = snapshot(f)
    with pytest.raises(ShapeError, match=message):  # noqa: PT012 - either verb may be the first to use it
        f.predict()
        f.update(system["zs"][1])
    if "H" not in change and "R" not in change:
        assert snapshot(f) == before


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda f: f.predict(Q=[[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]),
            NotPositiveDefiniteError,
            "Q: .*eigenvalue -1",
        ),
        (lambda f: f.predict(Q=-1.0), NotPositiveDefiniteError, "Q"),
        (lambda f: f.predict(Q=np.triu(np.ones((3, 3)))), ParameterError, "Q: expected symmetric"),
        (lambda f: f.predict(Q=np.full((3, 3), np.nan)), ParameterError, "Q: .*finite"),
        (lambda f: f.predict(F=np.eye(2)), ShapeError, r"F: got shape \(2, 2\), expected \(3, 3\)"),
        (lambda f: f.predict(u=[1.0], B=np.ones((3, 1))), ShapeError, "u: .*give B u of shape"),
        (lambda f: f.predict(u=[[1.0]], B=np.ones((2, 1))), ShapeError, r"u: B of shape \(2, 1\)"),
        (lambda f: f.predict(u=[[1.0], [2.0]], B=np.ones((3, 1))), ShapeError, r"u: got shape \(2, 1\)"),
        (lambda f: f.predict(u=np.nan, B=np.ones((3, 1))), ParameterError, "u: .*finite"),
        (lambda f: f.update([1.0, 2.0, 3.0]), ShapeError, r"z: got shape \(3,\), expected"),
        (lambda f: f.update(1.0), ShapeError, r"z: got shape \(\)"),
        (lambda f: f.update([[[1.0], [2.0]]]), ShapeError, "z: got shape"),
        (lambda f: f.update([1.0, np.inf]), ParameterError, "z: .*finite"),
        (lambda f: f.update([1.0, 2.0, 3.0], H=np.eye(3)[:2]), ShapeError, "z: got shape"),
        (
            lambda f: f.update([1.0, 2.0], R=[[1.0, 2.0], [2.0, 1.0]]),
            NotPositiveDefiniteError,
            "R: .*eigenvalue -1",
        ),
        (
            lambda f: f.update([1.0, 2.0], R=np.eye(3)),
            ShapeError,
            r"R: got shape \(3, 3\), expected \(2, 2\)",
        ),
        (
            lambda f: f.update([1.0, 2.0], H=np.eye(2)),
            ShapeError,
            r"H: got shape \(2, 2\), expected \(n, 3\)",
        ),
        (lambda f: f.update([], H=np.empty((0, 3))), ShapeError, "H: .*at least one row"),
        (lambda f: setattr(f, "alpha", 0.9), ParameterError, "alpha: got 0.9"),
        (lambda f: setattr(f, "alpha", [1.0]), ParameterError, "alpha"),
    ],
)
def test_a_failed_call_names_the_argument_and_changes_nothing(system, call, error, message):
    f = make(system)
    f.step(system["zs"][0])
    before = snapshot(f)
    with pytest.raises(error, match=message):
        call(f)
    assert snapshot(f) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dim_x": 0}, "dim_x: got 0, expected an integer of at least 1"),
        ({"dim_z": 1.5}, "dim_z: got 1.5"),
        ({"dim_u": -1}, "dim_u: got -1"),
        ({"P": [[1.0, 2.0], [2.0, 1.0]]}, "P: .*eigenvalue -1"),
        ({"Q": [[1.0, 2.0], [0.0, 1.0]]}, "Q: expected symmetric"),
        ({"R": [[1.0]]}, r"R: got shape \(1, 1\), expected \(2, 2\)"),
        ({"x": [1.0, 2.0, 3.0]}, "x: got shape"),
        ({"H": [1.0, 2.0]}, "H: got shape"),
        ({"B": [1.0, 2.0]}, "B: got shape"),
    ],
)
def test_the_constructor_checks_what_it_is_given(arguments, message):
    with pytest.raises(ParameterError, match=message):
        KalmanFilter(**({"dim_x": 2, "dim_z": 2} | arguments))


# --------------------------------------------------------------------------- numbers for matrices


def scalar_model(numbers: bool) -> KalmanFilter:
    """A model of one state, written with numbers or with matrices."""
    f = KalmanFilter(1, 1)
    for name, value in {"x": 0.5, "F": 0.9, "H": 2.0, "P": 2.0, "Q": 0.1, "R": 0.5}.items():
        setattr(f, name, value if numbers else np.array([[value]]))
    return f


def test_a_scalar_model_may_be_written_with_numbers():
    zs = [1.0, np.nan, 0.3, np.nan, -0.2]
    f, g = scalar_model(True), scalar_model(False)
    for z in zs:
        np.testing.assert_allclose(f.step(z), g.step(z), rtol=1e-14)
        assert f.x.shape == (1, 1)
    for verb, given in (("filter", zs), ("smooth", zs), ("filter_many", [zs, zs])):
        given = (
            [[np.nan if z is None else z for z in row] for row in given] if verb == "filter_many" else given
        )
        f, g = scalar_model(True), scalar_model(False)
        np.testing.assert_allclose(getattr(f, verb)(given).x, getattr(g, verb)(given).x, rtol=1e-14)
    f, g = scalar_model(True), scalar_model(False)
    assert f.log_likelihood_of(0.3) == pytest.approx(g.log_likelihood_of(0.3))
    np.testing.assert_allclose(f.residual_of(0.3), g.residual_of(0.3))
    bank = IMMEstimator([scalar_model(True), scalar_model(True)], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])
    same = IMMEstimator([scalar_model(False), scalar_model(False)], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])
    for z in zs:
        np.testing.assert_allclose(bank.step(z), same.step(z), rtol=1e-13)


#: Where a matrix of one row and column may be written as a number: what is done with it, in all forms.
ZS, US = [1.0, np.nan, 0.3], [1.0, -1.0, 2.0]
MEANS, COVARIANCES = [[1.0], [0.5], [3.0]], [[[1.0]], [[2.0]], [[0.5]]]


def scalar(**matrices):
    return KalmanFilter(1, 1, 1, **{"F": [[0.9]], "H": [[2.0]], "B": [[3.0]], "Q": 0.1, "R": 0.5, **matrices})


def assigned(name, value):
    f = scalar()
    setattr(f, name, value)
    return f


def extended(**functions):
    return ExtendedKalmanFilter(1, 1, fx=lambda x: 0.9 * x, hx=lambda x: 2.0 * x, **functions)


def after(f, verb, *arguments, **named):
    """What a verb returns, and the estimate and the innovation that it leaves."""
    found = getattr(f, verb)(*arguments, **named)
    result = [found.x, found.P] if hasattr(found, "P") else [] if found is None else list(found)
    return [*result, f.x, f.P, *(getattr(f, name) for name in ("y", "S", "K"))]


NUMBERS = {
    **{
        f"{name}= of the constructor": lambda v, name=name: after(scalar(**{name: v}), "filter", ZS, us=US)
        for name in "xPFHQRB"
    },
    **{
        f"{name} assigned, {verb}": (
            lambda v, name=name, verb=verb, a=a: after(assigned(name, v), verb, *a[:-1], **a[-1])
        )
        for name in "xPFHQRB"
        for verb, a in {
            "step": (1.0, {}),
            "filter": (ZS, {"us": US}),
            "smooth": (ZS, {"us": US}),
            "batch_filter": (ZS, {"us": US}),
            "filter_many": ([ZS, ZS], {"us": [[u] for u in US]}),
            "forecast": (2, {"us": US}),
            "test_matrix_dimensions": (1.0, {}),
            "get_update": (1.0, {}),
            "residual_of": (1.0, {}),
            "measurement_of_state": (1.0, {}),
            "predict_steadystate": (1.0, {}),
            "update_steadystate": (1.0, {}),
            "update_correlated": (1.0, {}),
            "update_sequential": (0, 1.0, {}),
            "rts_smoother": (MEANS, COVARIANCES, {}),
        }.items()
    },
    "M assigned": lambda v: after(assigned("M", v), "update_correlated", 1.0),
    "K assigned": lambda v: after(assigned("K", v), "update_steadystate", 1.0),
    "S assigned": lambda v: [assigned("S", v).log_likelihood_of(0.3)],
    **{
        f"{verb}({name}=)": lambda v, verb=verb, name=name, z=z: after(scalar(), verb, z, **{name: v})
        for verb, names, z in [
            ("predict", "FBQ", 2.0),
            ("get_prediction", "FBQ", 2.0),
            ("predict_steadystate", "B", 2.0),
            ("update", "HR", 1.0),
            ("update_correlated", "HR", 1.0),
            ("test_matrix_dimensions", "HRFQ", 1.0),
        ]
        for name in names
    },
    **{
        f"batch_filter({name}=)": lambda v, name=name: after(
            scalar(), "batch_filter", ZS, us=US, **{name: [v] * 3}
        )
        for name in ("Fs", "Qs", "Hs", "Rs", "Bs")
    },
    **{
        f"rts_smoother({name}=)": lambda v, name=name: after(
            scalar(), "rts_smoother", MEANS, COVARIANCES, **{name: [v] * 3}
        )
        for name in ("Fs", "Qs")
    },
    "F= of ExtendedKalmanFilter": lambda v: after(ExtendedKalmanFilter(1, 1, F=v), "predict"),
    "FJacobian": lambda v: after(extended(FJacobian=lambda x: v), "filter", ZS),
    "HJacobian": lambda v: after(extended(HJacobian=lambda x: v), "filter", ZS),
    "HJacobian, forecast": lambda v: after(extended(HJacobian=lambda x: v), "forecast", 2),
    "HJacobian of a call": lambda v: after(extended(), "update", 1.0, HJacobian=lambda x: v),
    "members of a bank": lambda v: after(
        IMMEstimator([scalar(F=v), scalar(H=v)], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]]).filters[0],
        "filter",
        ZS,
    ),
}


@pytest.mark.parametrize("place", NUMBERS)
def test_a_number_is_a_matrix_of_one_row_and_column(place):
    expected = NUMBERS[place](np.array([[0.7]]))
    for one in (0.7, np.float64(0.7), np.array(0.7), [0.7], np.array([0.7])):
        for got, value in zip(NUMBERS[place](one), expected, strict=True):
            np.testing.assert_allclose(np.ravel(got), np.ravel(value), rtol=1e-13)


@pytest.mark.parametrize("one", [0.7, [0.7]])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("F", lambda v: KalmanFilter(2, 1, F=v)),
        ("H", lambda v: KalmanFilter(2, 1, H=v)),
        ("H", lambda v: KalmanFilter(1, 2, H=v)),
        ("B", lambda v: KalmanFilter(2, 1, B=v)),
        ("B", lambda v: KalmanFilter(1, 1, 2, B=v)),
        ("F", lambda v: ExtendedKalmanFilter(2, 1, F=v)),
        ("F", lambda v: KalmanFilter(2, 1).predict(F=v)),
        ("H", lambda v: KalmanFilter(2, 1).update(1.0, H=v)),
        ("H", lambda v: KalmanFilter(1, 2).update([1.0, 2.0], H=v)),
        ("F", lambda v: KalmanFilter(2, 1).batch_filter([1.0], Fs=[v])),
        ("FJacobian", lambda v: ExtendedKalmanFilter(2, 1, fx=np.sin, FJacobian=lambda x: v).predict()),
        ("HJacobian", lambda v: ExtendedKalmanFilter(2, 1).update(1.0, lambda x: v, lambda x: x[:1])),
        ("F", lambda v: KalmanFilter(2, 1).test_matrix_dimensions(F=v)),
    ],
)
def test_a_number_is_no_larger_matrix(name, call, one):
    with pytest.raises(ShapeError, match=rf"^{name}: got shape \((1,)?\), expected \("):
        call(one)


@pytest.mark.parametrize("value", [np.nan, np.inf, "0.7", 1j, [[0.7], [0.1, 0.2]]])
@pytest.mark.parametrize("name", ["F", "H", "B"])
def test_a_number_for_a_matrix_is_finite_and_real(name, value):
    with pytest.raises(ParameterError, match=f"^{name}: "):
        scalar(**{name: value})


def test_a_covariance_that_overflows_is_refused_and_leaves_the_filter_as_it_was():
    f = KalmanFilter(2, 1)
    f.P, f.F, f.Q = np.array([[1.0, -1e155], [-1e155, 1.0]]), np.eye(2), np.zeros((2, 2))  # no covariance
    f.H, f.R = np.array([[1.0, 0.0]]), np.eye(1)
    before = snapshot(f)
    for verb, given in (("step", 0.1), ("filter", [0.1, 0.2]), ("filter_many", [[0.1, 0.2]])):
        with np.errstate(over="ignore", invalid="ignore"), pytest.raises(SingularInnovationError):
            getattr(f, verb)(given)
        assert snapshot(f) == before

"""The compiled step reads and writes plain attributes, as if predict and update had been called."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.engine.numpy import kalman
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import IMMEstimator, KalmanFilter

core = pytest.importorskip("fuzzykf.kalman.compiled_stepper", reason="the compiled core has not been built")
pytestmark = pytest.mark.usefixtures("instructions")

NAMES = ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "z", "y", "S", "SI", "K")

if issubclass(KalmanFilter, core.LinearStepper):
    Compiled = KalmanFilter
else:

    class Compiled(core.LinearStepper, KalmanFilter):
        """A filter on the compiled engine, whatever is selected."""


class OnlyCompiled(Compiled):
    """One that may not fall back."""

    def _step_any(self, z):
        raise AssertionError("not done at once")


def make(cls=Compiled, n=3, m=2, flat=False, begun=True):
    rng = np.random.default_rng(10 * n + m)
    F = rng.normal(size=(n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    root = rng.normal(size=(n, n))
    x = rng.normal(size=n if flat else (n, 1))
    f = cls(n, m, x=x, P=root @ root.T + np.eye(n), F=F, H=rng.normal(size=(m, n)), Q=0.3, R=0.7)
    if begun:
        f.remember_origin()
    return f


def full(value, n):
    """Return a covariance as a matrix; a number is a multiple of the identity."""
    return float(value) * np.eye(n) if np.ndim(value) == 0 else np.asarray(value, dtype=np.float64)


def expected_step(f, z):
    """All attributes after a step, from the NumPy kernels and the attributes before it."""
    n, m = f.dim_x, f.dim_z
    x, F, H = (np.asarray(value, dtype=np.float64) for value in (f.x, f.F, f.H))
    z = np.reshape(np.asarray(z, dtype=np.float64), (m, 1) if x.ndim == 2 else m)
    prior = kalman.predict_linear(x, full(f.P, n), F, full(f.Q, n), f.alpha**2)
    x, P, y, S, SI, K = kalman.update_linear(*prior, z, H, full(f.R, m))
    names = dict(zip(NAMES, (x, P, *prior, x, P, z, y, S, SI, K), strict=True))
    flat = y.ravel()
    distance = flat @ np.linalg.solve(S, flat)
    log_likelihood = -0.5 * (distance + np.linalg.slogdet(2.0 * np.pi * S)[1])
    return names | {
        "log_likelihood": log_likelihood,
        "likelihood": np.exp(log_likelihood),
        "mahalanobis": np.sqrt(distance),
    }


def assert_state(f, expected):
    for name, value in expected.items():
        got = np.asarray(getattr(f, name), dtype=np.float64)
        assert got.shape == np.shape(value), name
        scale = np.abs(value).max()
        np.testing.assert_allclose(got, value, rtol=1e-11, atol=1e-12 * max(scale, 1.0), err_msg=name)


def snapshot(f):
    return copy.deepcopy({name: value for name, value in f.__dict__.items() if name != "_origin"})


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (2, 2), (4, 2), (5, 3), (6, 3), (16, 16)])
def test_a_step_writes_all_attributes(n, m, flat) -> None:
    f = make(OnlyCompiled, n, m, flat)
    for z in np.random.default_rng(0).normal(size=(6, m)):
        expected = expected_step(f, z)
        assert f.step(z) is f.x
        assert_state(f, expected)


def test_the_first_step_keeps_the_state_that_reset_returns_to() -> None:
    f = make(begun=False)
    x = f.x.copy()
    f.step([1.0, 2.0])
    f.step([1.0, 2.0])
    f.reset()
    np.testing.assert_array_equal(f.x, x)


@pytest.mark.parametrize("flat", [False, True])
def test_the_verbs_are_the_step_to_the_last_bit(flat) -> None:
    f, g, h = (make(flat=flat) for _ in range(3))
    for z in np.random.default_rng(1).normal(size=(5, 2)):
        f.step(z)
        g.predict()
        np.testing.assert_array_equal(g.x, g.x_prior)
        np.testing.assert_array_equal(g.P, g.P_prior)
        g.update(z)
        h.predict(F=h.F)  # with arguments
        h.update(z, H=h.H)
        for name in NAMES:
            np.testing.assert_array_equal(getattr(f, name), getattr(g, name), err_msg=name)
            if Compiled is KalmanFilter:  # so that arguments go through the compiled engine, too
                np.testing.assert_array_equal(getattr(f, name), getattr(h, name), err_msg=name)


@pytest.mark.parametrize(
    "z",
    [
        *(0.5, 1, np.float64(0.5), [0.5], [1], np.array([0.5]), np.array([[0.5]]), np.array([1])),
        *(np.arange(4.0)[1::2][:1], np.array([0.5, 9.0])[::-1][1:]),
    ],
)
def test_usual_observations_are_done_at_once(z) -> None:
    f = make(OnlyCompiled, 2, 1)
    expected = expected_step(f, z)
    f.step(z)
    assert_state(f, expected)


@pytest.mark.parametrize("z", [(0.5,), np.array(0.5), np.float32(0.5), np.array([0.5], dtype=object), True])
def test_unusual_observations_are_the_same_observations(z) -> None:
    f = make(n=2, m=1)
    expected = expected_step(f, z)
    f.step(z)
    assert_state(f, expected)


def test_missing_observations_and_components() -> None:
    f, g = make(), make()
    for z in (None, [1.0, np.nan], [np.nan, np.nan], np.array([np.nan, 2.0])):
        f.step(z)
        g.predict()
        g.update(z)
        for name in NAMES:
            np.testing.assert_array_equal(getattr(f, name), getattr(g, name), err_msg=name)
        assert f.log_likelihood == g.log_likelihood
    expected = expected_step(f, [1.0, 2.0])
    f.step([1.0, 2.0])
    assert_state(f, expected)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 2)])
def test_steps_without_an_observation_are_done_at_once(n, m, flat) -> None:
    none = [
        None,
        np.full(m, np.nan),
        np.full((m, 1), np.nan),
        *([np.nan, np.float64(np.nan)] if m == 1 else []),
    ]
    f, verbs = make(OnlyCompiled, n, m, flat), make(OnlyCompiled, n, m, flat)
    for z in none:
        assert f.step(z) is f.x
        g = make(n=n, m=m, flat=flat)  # what the attributes become without the engine
        g.__dict__.update(snapshot(verbs))
        g._set_prior(*g.get_prediction())
        g._skip(g.x, g.P, m)
        verbs.predict()
        assert verbs._update_at_once(z)
        for one in (f, verbs):
            for name in (*NAMES, "log_likelihood", "likelihood", "mahalanobis"):
                np.testing.assert_allclose(*(np.array(getattr(k, name), float) for k in (one, g)), rtol=1e-13)
            assert one.z.dtype == object
            assert one.z.shape == one.y.shape == g.y.shape
            assert one.x is not one.x_post
    expected = expected_step(f, np.ones(m))
    f.step(np.ones(m))
    assert_state(f, expected)
    with pytest.raises(AssertionError):
        f.step(np.full(m + 1, np.nan))  # for the verbs to refuse


# ------------------------------------------------------------------ what the user does to attributes


def assign(name, value):
    return lambda f: setattr(f, name, value)


def write(name, index, value):
    return lambda f: getattr(f, name).__setitem__(index, value)


WIDE = np.arange(1.0, 25.0).reshape(4, 6)
CHANGES = {
    "F in place": write("F", (0, 1), 0.1),
    "x in place": write("x", 0, 3.0),
    "P in place": lambda f: f.P.__imul__(10.0),
    "R in place": write("R", (0, 0), 5.0),
    "H in place": write("H", (1, 2), -1.0),
    "a number as Q": assign("Q", 0.05),
    "a number as R": assign("R", 2.0),
    "a number as P": assign("P", 4.0),
    "an integer as R": assign("R", 3),
    "integers as H": assign("H", np.array([[1, 0, 0], [0, 1, 0]])),
    "small integers as F": assign("F", np.eye(3, dtype=np.int8)),
    "lists as F": assign("F", [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.5]]),
    "a turned F": assign("F", np.arange(9.0).reshape(3, 3).T / 9.0),
    "a part of H": assign("H", WIDE[::2, ::2]),
    "float32 as R": assign("R", np.eye(2, dtype=np.float32)),
    "a flat x": assign("x", np.array([1.0, 2.0, 3.0])),
    "a column x": assign("x", np.array([[1.0], [2.0], [3.0]])),
    "integers as x": assign("x", np.array([[1], [2], [3]])),
    "a list as x": assign("x", [1.0, 2.0, 3.0]),
    "alpha": assign("alpha", 1.1),
    "one array twice": lambda f: [setattr(f, name, f.Q) for name in ("P", "P_prior", "P_post")],
    "K of another shape": assign("K", np.zeros(7)),
    "no S": lambda f: delattr(f, "S"),
    "an attribute of the user": assign("comment", "mine"),
}


@given(st.lists(st.sampled_from(sorted(CHANGES)), min_size=1, max_size=4), st.booleans())
@settings(max_examples=60, deadline=None)
def test_the_next_step_sees_every_change(names, flat) -> None:
    f = make(flat=flat)
    f.step([0.1, 0.2])
    for k, name in enumerate(names):
        try:
            CHANGES[name](f)
        except (TypeError, AttributeError, IndexError):  # in place of a number, a list, an integer
            continue
        z = [0.3 * k, -0.2]
        expected = expected_step(f, z)
        f.step(z)
        assert_state(f, expected)


def test_arrays_that_others_hold_do_not_change() -> None:
    f = make()
    f.step([1.0, 2.0])
    held = {name: getattr(f, name) for name in NAMES}
    views = {name: getattr(f, name)[:1] for name in NAMES}
    f.step([0.5, 0.1])
    views |= {f"later {name}": getattr(f, name).T for name in NAMES}
    memory = memoryview(f.P)
    before = copy.deepcopy((held, views)), memory.tolist()
    for z in np.random.default_rng(2).normal(size=(4, 2)):
        f.step(z)
        f.predict()
        f.update(z)
    for old, new in zip(before[0], (held, views), strict=True):
        for name, value in old.items():
            np.testing.assert_array_equal(new[name], value, err_msg=name)
    assert memory.tolist() == before[1]


def test_arrays_of_the_user_are_not_written_into() -> None:
    stack = np.stack([np.eye(3)] * 2)
    fixed = np.eye(3)
    fixed.flags.writeable = False
    for P in (stack[0], fixed, np.frombuffer(np.eye(3).tobytes()).reshape(3, 3)):
        f = make()
        f.P = f.P_prior = f.P_post = P
        before = P.copy()
        for _ in range(3):
            f.step([1.0, 2.0])
        np.testing.assert_array_equal(P, before)
    np.testing.assert_array_equal(stack, np.stack([np.eye(3)] * 2))


def test_copies_are_independent() -> None:
    f = make()
    f.step([1.0, 2.0])
    before = snapshot(f)
    for other in (
        copy.copy(f),
        copy.deepcopy(f),
        f.copy(),
        pickle.loads(pickle.dumps(f)) if Compiled is KalmanFilter else f.copy(),
    ):
        other.step([3.0, 4.0])
        other.predict()
        for name, value in before.items():
            np.testing.assert_equal(f.__dict__[name], value, err_msg=name)


# ------------------------------------------------------------------ nothing is bypassed


def test_subclasses_are_not_bypassed() -> None:
    calls = []

    class Predicts(Compiled):
        def predict(self, *args, **kwargs):
            calls.append("predict")
            super().predict(*args, **kwargs)

    class Updates(Compiled):
        def update(self, *args, **kwargs):
            calls.append("update")
            super().update(*args, **kwargs)

    class Moves(Compiled):
        def get_prediction(self, *args, **kwargs):
            calls.append("get_prediction")
            return super().get_prediction(*args, **kwargs)

    class Computes(Compiled):
        @property
        def F(self):
            calls.append("F")
            return self.__dict__["F"]

        @F.setter
        def F(self, value):
            self.__dict__["F"] = value

    class Listens(Compiled):
        def __setattr__(self, name, value):
            if name == "y":
                calls.append("y")
            super().__setattr__(name, value)

    class Inherits(Updates):
        pass

    for cls, name in (
        *((Predicts, "predict"), (Updates, "update"), (Moves, "get_prediction")),
        *((Computes, "F"), (Listens, "y"), (Inherits, "update")),
    ):
        f = make(cls)
        for verbs in (lambda f=f: f.step([1.0, 2.0]), lambda f=f: (f.predict(), f.update([1.0, 2.0]))):
            calls.clear()
            verbs()
            assert name in calls
        calls.clear()
        f.filter(np.ones((3, 2)))
        assert calls.count(name) >= 3


def test_a_method_changed_later_is_not_bypassed(monkeypatch) -> None:
    calls = []

    class Mine(Compiled):
        pass

    f = make(Mine)
    f.step([1.0, 2.0])
    own = Mine.update

    def update(self, *args):
        calls.append("class")
        own(self, *args)

    monkeypatch.setattr(KalmanFilter, "update", update)
    f.step([1.0, 2.0])
    f.filter(np.ones((1, 2)))
    monkeypatch.undo()
    f.step([1.0, 2.0])
    assert calls == ["class"] * 2
    f.predict = lambda: calls.append("instance")
    f.step([1.0, 2.0])
    f.filter(np.ones((1, 2)))
    assert calls == ["class"] * 2 + ["instance"] * 2
    f = make(Mine)
    f.get_prediction = lambda *_: calls.append("moved") or (f.x + 1.0, f.P)
    x = f.x
    f.predict()
    np.testing.assert_array_equal(f.x, x + 1.0)
    f.step([1.0, 2.0])
    f.filter(np.ones((1, 2)))
    assert calls[4:] == ["moved"] * 3


def test_an_inverse_of_the_user_is_used() -> None:
    f = make(n=2, m=2)
    f.H, f.R, f.P, f.Q = np.ones((2, 2)), 0.0, np.eye(2), 0.0
    with pytest.raises(NotPositiveDefiniteError):
        f.step([1.0, 1.0])
    f.inv = np.linalg.pinv
    f.F = np.eye(2)
    f.x[:] = 0.0
    f.step([1.0, 1.0])  # the sum of the states is 1, by symmetry each is a half
    np.testing.assert_allclose(f.x.ravel(), 0.5)


# ------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("change", "z", "error"),
    [
        (assign("R", -1e3), [1.0, 2.0], NotPositiveDefiniteError),
        (assign("P", np.full((3, 3), np.nan)), [1.0, 2.0], ParameterError),
        (assign("F", np.eye(2)), [1.0, 2.0], ShapeError),
        (assign("H", np.eye(3)), [1.0, 2.0], ShapeError),
        (assign("x", np.zeros(4)), [1.0, 2.0], ShapeError),
        (assign("x", None), [1.0, 2.0], ShapeError),
        (assign("Q", "noise"), [1.0, 2.0], ShapeError),
        (assign("dim_x", 2), [1.0, 2.0], ShapeError),
        (lambda f: None, [1.0, np.inf], ParameterError),
        (lambda f: None, [1.0, 2.0, 3.0], ShapeError),
        (lambda f: None, 1.0, ShapeError),
        (lambda f: None, "nothing", ShapeError),
        (lambda f: None, np.array([[1.0, 2.0], [1.0, 2.0]]), ShapeError),
    ],
)
def test_a_failed_step_leaves_the_filter_as_it_was(change, z, error) -> None:
    f = make()
    f.step([1.0, 2.0])
    change(f)
    before = snapshot(f)
    with pytest.raises(error):
        f.step(z)
    after = snapshot(f)
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_equal(after[name], value, err_msg=name)


def test_larger_systems_go_through_numpy() -> None:
    n = 17
    f = make(n=n, m=1)
    expected = expected_step(f, 0.5)
    f.step(0.5)
    assert_state(f, expected)
    assert f.filter(np.ones(3)).x.shape == (3, n)


@pytest.mark.parametrize("z", [10**400, [10**400]], ids=["number", "list"])
def test_a_whole_number_too_large_for_a_float_is_named(z):
    f = KalmanFilter(1, 1)
    bank = IMMEstimator([KalmanFilter(1, 1), KalmanFilter(1, 1)], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])
    for one in (f, bank):
        one.step(0.1)
        before = np.array(one.x)
        with pytest.raises(ShapeError, match="z: expected 1 number"):
            one.step(z)
        np.testing.assert_array_equal(one.x, before)

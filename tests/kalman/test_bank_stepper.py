"""The compiled step of a bank reads and writes the attributes of all members, as its verbs do."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fuzzykf.engine.numpy import imm
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError
from fuzzykf.kalman import IMMEstimator, KalmanFilter

core = pytest.importorskip("fuzzykf.kalman.compiled_stepper", reason="the compiled core has not been built")
pytestmark = pytest.mark.usefixtures("instructions")

OWN = ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "mu", "likelihood", "mode_log_likelihood")
METHODS = pytest.mark.parametrize("method", ["imm", "gpb2"])
OF_MEMBERS = ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "y", "S", "SI", "K")


if issubclass(IMMEstimator, core.BankStepper):
    Compiled = IMMEstimator
else:

    class Compiled(core.BankStepper, IMMEstimator):
        """An estimator on the compiled engine, whatever is selected."""


class OnlyCompiled(Compiled):
    """One that may not fall back."""

    def _step_any(self, z):
        raise AssertionError("not done at once")


def bank(cls, n=2, m=1, K=3, flat=False, method="imm"):
    rng = np.random.default_rng(0)
    filters = []
    for _ in range(K):
        F = rng.normal(size=(n, n))
        x = rng.normal(size=n if flat else (n, 1))
        P, Q, R = (
            root @ root.T + 0.2 * np.eye(len(root)) for root in (rng.normal(size=(k, k)) for k in (n, n, m))
        )
        F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
        filters.append(KalmanFilter(n, m, x=x, P=P, F=F, Q=Q, H=rng.normal(size=(m, n)), R=R))
    M = np.full((K, K), 0.1 / (K - 1))
    np.fill_diagonal(M, 0.9)
    return cls(filters, np.arange(1.0, K + 1), M, method=method)


def observations(n_steps, m):
    return 2.0 * np.random.default_rng(2).normal(size=(n_steps, m))


def assert_close(got, expected, name=""):
    got, expected = (np.asarray(value, dtype=np.float64) for value in (got, expected))
    assert got.shape == expected.shape, name
    scale = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * scale, err_msg=name)


def reference_step(f, z):
    """What a step leads to, from the NumPy kernels and the attributes of a bank."""
    K, n, m = f.N, f.dim_x, f.dim_z
    members = f.filters
    model = {name: np.array([getattr(one, name) for one in members]) for name in "FQHR"}
    model["alpha_sq"] = np.array(1.0)
    xs, Ps = np.array([one.x for one in members]).reshape(K, n), np.array([one.P for one in members])
    shapes = {"x": (n,), "P": (n, n), "x_prior": (n,), "P_prior": (n, n), "mu": (K,), "log_likelihood": ()}
    out = {name: np.empty((1, *shape)) for name, shape in shapes.items()}
    with np.errstate(divide="ignore"):
        state = imm.filter_bank(
            xs, Ps, np.log(f.mu), np.log(f.M), np.reshape(z, (1, m)), model, f.method == "gpb2", out
        )
    return state, {name: value[0] for name, value in out.items()}


def assert_state(f, state, out):
    form = f.filters[0].x.shape
    for name in ("x", "P", "x_prior", "P_prior"):
        expected = out[name].reshape(form) if name[0] == "x" else out[name]
        assert_close(getattr(f, name), expected, name)
    assert_close(f.x_post, f.x)
    assert_close(f.P_post, f.P)
    assert_close(f.mu, out["mu"], "mu")
    assert_close(f.log_likelihood, out["log_likelihood"], "log_likelihood")
    assert_close(f.mode_log_likelihood, state["modes"], "modes")
    assert_close(f.likelihood, np.exp(state["modes"]), "likelihood")
    for k, one in enumerate(f.filters):
        for name, value in (("x", "xs"), ("P", "Ps"), ("x_prior", "xs_prior"), ("P_prior", "Ps_prior")):
            expected = state[value][k]
            assert_close(getattr(one, name), expected.reshape(form) if name[0] == "x" else expected, name)
        for name in ("y", "S", "SI", "K"):
            assert_close(np.ravel(getattr(one, name)), state[name][k].ravel(), name)
        assert_close(one.log_likelihood, state["own"][k])
        assert one.mahalanobis == pytest.approx(np.sqrt(one.y.ravel() @ one.SI @ one.y.ravel()))


@METHODS
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize(("n", "m", "K"), [(1, 1, 2), (2, 1, 3), (4, 2, 7), (16, 3, 2)])
def test_a_step_writes_all_attributes(n, m, K, flat, method) -> None:
    f = bank(OnlyCompiled, n, m, K, flat, method)
    f.remember_origin()
    for z in observations(8, m):
        expected = reference_step(f, z)
        assert f.step(z) is f.x
        assert_state(f, *expected)


@METHODS
@pytest.mark.parametrize("flat", [False, True])
def test_the_verbs_are_the_step(flat, method) -> None:
    f, g = bank(Compiled, 3, 2, flat=flat, method=method), bank(Compiled, 3, 2, flat=flat, method=method)
    f.remember_origin()
    g.remember_origin()
    for z in observations(5, 2):
        f.step(z)
        assert g._predict_at_once()
        np.testing.assert_array_equal(g.x, g.x_prior)
        assert g._update_at_once(z)
        for name in OWN:
            np.testing.assert_array_equal(getattr(f, name), getattr(g, name), err_msg=name)
        for a, b in zip(f.filters, g.filters, strict=True):
            for name in OF_MEMBERS:
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@METHODS
@pytest.mark.parametrize(
    "change",
    [
        lambda f: setattr(f, "mu", np.array([0.1, 0.2, 0.7])),
        lambda f: f.mu.__setitem__(slice(None), [0.2, 0.5, 0.3]),
        lambda f: f.M.__setitem__(slice(None), 1.0 / 3.0),
        lambda f: setattr(f, "M", np.eye(3)),
        lambda f: f.filters[1].F.__imul__(0.5),
        lambda f: f.filters[2].x.__setitem__(0, 3.0),
        lambda f: setattr(f.filters[0], "R", np.array([[7.0]])),
    ],
)
def test_what_is_assigned_or_written_into_is_seen_by_the_next_step(change, method) -> None:
    f = bank(Compiled, method=method)
    f.step(0.5)
    change(f)
    expected = reference_step(f, 0.7)
    f.step(0.7)
    assert_state(f, *expected)


@METHODS
def test_arrays_that_others_hold_do_not_change(method) -> None:
    f = bank(Compiled, method=method)
    f.step(0.5)
    held = [getattr(f, name) for name in OWN] + [
        getattr(one, name) for one in f.filters for name in OF_MEMBERS
    ]
    before = copy.deepcopy(held)
    for z in observations(4, 1):
        f.step(z)
    for a, b in zip(held, before, strict=True):
        np.testing.assert_array_equal(a, b)


def test_subclasses_and_other_filters_are_not_bypassed() -> None:
    calls = []

    class Watched(Compiled):
        def update(self, z):
            calls.append("bank")
            super().update(z)

    class WatchedFilter(KalmanFilter):
        def predict(self, *args):
            calls.append("member")
            super().predict(*args)

    f = bank(Watched)
    f.step(0.1)
    f.step(0.2)
    assert calls == ["bank"] * 2
    f = bank(Compiled)
    f.filters[1] = WatchedFilter(2, 1, H=[[1.0, 0.0]])
    f.step(0.1)
    f.step(0.2)
    assert calls == ["bank"] * 2 + ["member"] * 2


@METHODS
@pytest.mark.parametrize(
    ("change", "z", "error"),
    [
        (lambda f: setattr(f.filters[2], "R", -1e3), 0.5, NotPositiveDefiniteError),
        (lambda f: None, 1e200, ParameterError),
        (lambda f: None, np.inf, ParameterError),
        (lambda f: None, [1.0, 2.0], ValueError),
        (lambda f: setattr(f, "M", np.ones((3, 3))), 0.5, ParameterError),
    ],
)
def test_a_failed_step_leaves_everything_as_it_was(change, z, error, method) -> None:
    f = bank(Compiled, method=method)
    f.step(0.5)
    change(f)
    before = copy.deepcopy([f.__dict__, *(one.__dict__ for one in f.filters)])
    with pytest.raises(error), np.errstate(over="ignore"):
        f.step(z)
    for state, old in zip([f.__dict__, *(one.__dict__ for one in f.filters)], before, strict=True):
        assert state.keys() == old.keys()
        for name in set(state) - {"filters", "_origin"}:
            np.testing.assert_equal(state[name], old[name], err_msg=name)

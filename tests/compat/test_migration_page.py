"""The page on migrating from filterpy says what is: its code runs, and its rows are true."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import kalman as ours
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError

theirs = pytest.importorskip("filterpy.kalman")
common = pytest.importorskip("filterpy.common")
if tuple(map(int, pytest.importorskip("filterpy").__version__.split(".")[:2])) < (2, 0):
    pytest.skip("the page compares with filterpy 2.0.0", allow_module_level=True)

PAGE = Path(__file__).parents[2] / "docs" / "migrating_from_filterpy.md"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ROW = re.compile(r"^\| `(.*?)` \| `(.*?)` \| (.*) \|$", re.MULTILINE)


def kf(module, m=1):
    f = module.KalmanFilter(2, m)
    f.F, f.H, f.Q = np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)[:m], 0.1 * np.eye(2)
    return f


def imm(module):
    calm, lively = kf(module), kf(module)
    lively.Q = 5.0 * np.eye(2)
    f = module.IMMEstimator([calm, lively], [0.5, 0.5], np.array([[0.9, 0.1], [0.1, 0.9]]))
    f.predict()
    f.update(5.0)
    return f


def HJacobian(x):
    return np.array([[2.0 * np.ravel(x)[0], 0.0]])


def Hx(x):
    return x[:1] ** 2


def ekf(module):
    f = module.ExtendedKalmanFilter(2, 1)
    f.x, f.F = np.array([1.0, 1.0]), np.array([[1.0, 1.0], [0.0, 1.0]])
    return f


# ------------------------------------------------------------------ the page


def test_the_code_on_the_page_prints_what_follows_it():
    namespace, printed = {}, ""
    for language, code in FENCE.findall(PAGE.read_text(encoding="utf-8")):
        if language == "python":
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(code, PAGE.name, "exec"), namespace)
            printed = output.getvalue()
        elif language == "text":
            assert code == printed


@pytest.mark.parametrize("line", [row[1] for row in ROW.findall(PAGE.read_text(encoding="utf-8"))])
def test_every_line_of_fuzzykf_in_the_tables_runs(line):
    f = kf(ours, 2) if "H=H" in line or "update_sequential" in line or "in zs" in line else kf(ours)
    saver = common.Saver(f)
    saver.save()
    zs = np.zeros((3, f.dim_z))
    Xs, Ps, *_ = kf(ours).batch_filter(np.zeros(3))
    two_controls = [[[0.0]]] * 3
    f.B = np.ones((2, 1))
    namespace = {
        "np": np, "kf": f, "ekf": ours.ExtendedKalmanFilter(2, 1, hx=Hx), "imm": imm(ours), "saver": saver,
        "z": np.ones(f.dim_z), "z_0": 1.0, "H": np.eye(2), "zs": zs, "us": two_controls,
        "HJacobian": HJacobian, "Hx": Hx, "M": np.eye(2), "Xs": Xs, "Ps": Ps,
        "Fs": [np.eye(2)] * 3, "Qs": [np.eye(2)] * 3,
        "rts_smoother": ours.rts_smoother, "ExtendedKalmanFilter": ours.ExtendedKalmanFilter,
    }  # fmt: skip
    exec(line, namespace)


def test_the_page_names_every_class_of_filterpy_that_is_not_provided():
    text = PAGE.read_text(encoding="utf-8")
    for name, value in vars(theirs).items():
        if isinstance(value, type) and value.__module__.startswith("filterpy"):
            assert f"`{name}`" in text or hasattr(ours, name), name


# ------------------------------------------------------------------ missing observations


def test_update_none_of_the_kalman_filter():
    results = []
    for module in (theirs, ours):
        f = kf(module)
        f.predict()
        f.update(None)
        results.append(f.log_likelihood)
    assert results[0] != 0.0
    assert results[1] == 0.0


def test_update_none_of_the_extended_filter():
    stale, fresh = ekf(theirs), ekf(ours)
    for f in (stale, fresh):
        f.update(np.array([3.0]), HJacobian, Hx)
        f.update(None, HJacobian, Hx)
    assert stale.y[0] == 2.0
    assert stale.log_likelihood != 0.0
    assert fresh.y[0] == fresh.log_likelihood == 0.0


def test_update_none_of_the_imm():
    for module in (theirs, ours):
        f = imm(module)
        cbar = f.cbar.copy()
        f.predict()
        f.update(None)
        assert np.allclose(f.mu, cbar) == (module is ours)


def test_nan_and_saver_and_predict_update():
    for module in (theirs, ours):
        f = kf(module)
        f.update(np.nan)
        assert np.isnan(f.x).all() == (module is theirs)
    f = kf(theirs)
    f.x = np.zeros(2)
    saver = common.Saver(f)
    for z in (1.0, None):
        f.update(z)
        saver.save()
    with pytest.raises(ValueError, match="could not convert"):
        saver.to_array()
    with pytest.raises(TypeError):
        ekf(theirs).predict_update(None, HJacobian, Hx)
    with pytest.raises(TypeError):
        ekf(theirs).predict(u=None)
    ekf(ours).predict_update(None, HJacobian, Hx)
    ekf(ours).predict(u=None)


# ------------------------------------------------------------------ mixtures


def test_an_outlier_in_the_imm():
    undecided, decided = imm(theirs), imm(ours)
    for f in (undecided, decided):
        f.predict()
        f.update(1e3)
    np.testing.assert_allclose(undecided.likelihood, 2.2e-308, rtol=0.02)
    np.testing.assert_allclose(undecided.mu, undecided.cbar / undecided.cbar.sum(), atol=0.2)
    np.testing.assert_allclose(decided.mu, [0.0, 1.0], atol=1e-10)
    assert np.isfinite(decided.mode_log_likelihood).all()


def test_the_prediction_of_the_imm():
    old, new = imm(theirs), imm(ours)
    for f in (old, new):
        f.predict()
    for f, weights in ((old, old.mu), (new, new.cbar)):
        np.testing.assert_allclose(f.x, sum(w * m.x for w, m in zip(weights, f.filters, strict=True)))
    assert not np.allclose(old.x, new.x)
    for f in (old, new):
        f.update(4.0)
    np.testing.assert_allclose(old.x, new.x)


def test_two_predictions_and_an_assigned_m():
    twice, explicit, old = imm(ours), imm(ours), imm(theirs)
    for f in (twice, old):
        f.predict()
        f.predict()
    explicit.predict()
    explicit.update(None)
    explicit.predict()
    np.testing.assert_allclose(twice.x, explicit.x)
    assert not np.allclose(old.mu, twice.mu)
    for module in (theirs, ours):
        f = imm(module)
        f.M = np.eye(2)
        assert np.allclose(f.omega, np.eye(2)) == (module is ours)


# ------------------------------------------------------------------ shapes and scalars


def test_a_scalar_q():
    for module in (theirs, ours):
        f = kf(module)
        f.Q = 0.1
        before = f.F @ f.P @ f.F.T
        f.predict()
        added = np.full((2, 2), 0.1) if module is theirs else 0.1 * np.eye(2)
        np.testing.assert_allclose(f.P, before + added)
        _, P = module.predict(np.zeros(2), np.eye(2), Q=0.1)
        np.testing.assert_allclose(P, np.eye(2) + added)
        f.predict(Q=0.1)
        np.testing.assert_allclose(f.P, f.F @ (before + added) @ f.F.T + 0.1 * np.eye(2))


def test_forms_of_z_and_u():
    for module, shape in ((theirs, (2, 2)), (ours, (2, 1))):
        f = kf(module, 2)
        f.update(np.array([1.0, 2.0]), H=np.eye(2))
        assert f.x.shape == shape
    with pytest.raises(ValueError, match="could not broadcast"):
        kf(theirs, 2).batch_filter(np.zeros((3, 2)))
    assert kf(ours, 2).batch_filter(np.zeros((3, 2)))[0].shape == (3, 2, 1)
    silent, loud = kf(theirs), kf(ours)
    silent.B = loud.B = np.ones((2, 1))
    silent.predict(u=np.array([1.0]))
    assert silent.x.shape == (2, 2)
    with pytest.raises(ShapeError, match="u: "):
        loud.predict(u=np.array([1.0]))


def test_flat_states_lists_and_k():
    for module in (theirs, ours):
        f = kf(module)
        f.x = np.zeros(2)
        assert (f.y.ndim == 1) == (module is ours)
        assert module.ExtendedKalmanFilter(3, 2).K.shape == ((3, 1) if module is theirs else (3, 2))
    f = kf(theirs)
    f.F = [[1.0, 1.0], [0.0, 1.0]]
    with pytest.raises(AttributeError):
        f.predict()


# ------------------------------------------------------------------ errors


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_inadmissible_values():
    f = kf(theirs)
    f.update(1.0, R=-3.0)  # taken
    with pytest.raises(NotPositiveDefiniteError, match="R: "):
        kf(ours).update(1.0, R=-3.0)
    f = kf(theirs)
    f.update(np.inf)
    assert np.isnan(f.x).any()
    with pytest.raises(ParameterError, match="z: "):
        kf(ours).update(np.inf)
    for module in (theirs, ours):
        f = kf(module)
        f.P, f.R = np.zeros((2, 2)), np.zeros((1, 1))
        with pytest.raises(np.linalg.LinAlgError):
            f.update(1.0)
    assert not kf(theirs).batch_filter([1.0, 2.0], Fs=[np.eye(2)])[0][1].any()
    with pytest.raises(ShapeError, match="Fs: "):
        kf(ours).batch_filter([1.0, 2.0], Fs=[np.eye(2)])
    for module in (theirs, ours):
        with pytest.raises(AssertionError):
            kf(module).test_matrix_dimensions(F=np.eye(3))


# ------------------------------------------------------------------ the other methods


def test_predict_update():
    for module in (theirs, ours):
        f, g = ekf(module), ekf(module)
        f.predict_update(np.array([3.0]), HJacobian, Hx)
        g.predict()
        assert np.allclose(f.x_prior, g.x) == (module is ours)
        g.update(np.array([3.0]), HJacobian, Hx)
        assert np.allclose(f.x, g.x) == (module is ours)


def test_the_function_rts_smoother():
    Fs, Qs = [k * np.eye(1) for k in (1.0, 2.0, 3.0)], [k * np.eye(1) for k in (1.0, 0.5, 2.0)]
    Xs, Ps = np.array([[1.0], [2.0], [4.0]]), np.ones((3, 1, 1))
    expected = theirs.KalmanFilter(1, 1).rts_smoother(Xs, Ps, Fs, Qs)[0]
    np.testing.assert_allclose(ours.rts_smoother(Xs, Ps, Fs, Qs)[0], expected)
    np.testing.assert_allclose(theirs.rts_smoother(Xs, Ps, Fs[1:] + Fs[:1], Qs[1:] + Qs[:1])[0], expected)
    assert not np.allclose(theirs.rts_smoother(Xs, Ps, Fs, Qs)[0], expected)


def test_update_sequential():
    for module in (theirs, ours):
        f = kf(module, 2)
        f.update(np.array([[9.0], [9.0]]))
        before = f.log_likelihood
        f.update_sequential(0, 1.0)
        assert (f.log_likelihood == before) == (module is theirs)
    flat = kf(theirs, 2)
    flat.x = np.zeros(2)
    with pytest.raises(ValueError, match="broadcast"):
        flat.update_sequential(0, 1.0)

"""One place chooses the engine; it says which one it chose, and why."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from fuzzykf import IMMEstimator, KalmanFilter, engine
from fuzzykf.engine import selected
from fuzzykf.engine.numpy import kalman

NUMPY_HOMES = {
    "pack": "fuzzykf.engine.numpy.switching",
    "first_step": "fuzzykf.engine.numpy.switching",
    "step": "fuzzykf.engine.numpy.switching",
    "run": "fuzzykf.engine.numpy.switching",
    "log_pairs": "fuzzykf.engine.numpy.switching",
    "node_mean": "fuzzykf.engine.numpy.switching",
    "step_many": "fuzzykf.engine.numpy.switching_many",
    "forward_backward": "fuzzykf.engine.numpy.hmm",
    "smooth_back": "fuzzykf.engine.numpy.backward",
    "best_path": "fuzzykf.engine.numpy.backward",
    "Kernel": "fuzzykf.engine.numpy.switching",
    "Stepper": "fuzzykf.engine.numpy.stepper",
    "convolve_parabola": "fuzzykf.engine.numpy.convolution",
    "refine": "fuzzykf.engine.numpy.convolution",
    "continue_tails": "fuzzykf.engine.numpy.grid",
    "interpolate": "fuzzykf.engine.numpy.grid",
    "interpolate_lines": "fuzzykf.engine.numpy.grid",
    "least_outside": "fuzzykf.engine.numpy.grid",
    "pull_back": "fuzzykf.engine.numpy.grid",
    "convolve_bounded": "fuzzykf.engine.numpy.kernels",
    "convolve_convex": "fuzzykf.engine.numpy.kernels",
    "convolve_joint": "fuzzykf.engine.numpy.kernels",
    "convolve_table": "fuzzykf.engine.numpy.kernels",
    "is_convex": "fuzzykf.engine.numpy.kernels",
    "totals": "fuzzykf.engine.numpy.kernels",
    "moments_about": "fuzzykf.engine.numpy.moments",
    "corrected": "fuzzykf.engine.numpy.raster",
    "cover": "fuzzykf.engine.numpy.raster",
    "flat_cells": "fuzzykf.engine.numpy.raster",
    "live_cells": "fuzzykf.engine.numpy.raster",
    "span": "fuzzykf.engine.numpy.raster",
    "stranded": "fuzzykf.engine.numpy.raster",
    "LinearStepper": "fuzzykf.engine.numpy.stepper",
    "BankStepper": "fuzzykf.engine.numpy.stepper",
    "predict_linear": "fuzzykf.engine.numpy.kalman",
    "update_linear": "fuzzykf.engine.numpy.kalman",
    "filter_linear": "fuzzykf.engine.numpy.kalman_series",
    "filter_bank": "fuzzykf.engine.numpy.imm",
}


def in_a_new_process(code: str, wanted: str | None) -> subprocess.CompletedProcess[str]:
    """Run code under a setting of FUZZYKF_ENGINE."""
    environment = {name: value for name, value in os.environ.items() if name != "FUZZYKF_ENGINE"}
    if wanted is not None:
        environment["FUZZYKF_ENGINE"] = wanted
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)


def built() -> bool:
    """Whether the compiled core is there, whatever is selected."""
    return in_a_new_process("import fuzzykf.engine.compiled", None).returncode == 0


def test_what_is_selected_is_what_info_says() -> None:
    # each function comes from the module of the engine that `info` names: none is handed on
    name = engine.info().name
    for function, home in NUMPY_HOMES.items():
        module = getattr(selected, function).__module__
        assert module.startswith("fuzzykf.engine.compiled.") if name == "compiled" else module == home


@pytest.mark.parametrize(("n", "m"), [(2, 1), (17, 1), (1, 17)])
def test_systems_of_any_size_have_a_kernel(n, m) -> None:
    # the compiled kernels cover up to 16 states and components: of more, selected asks NumPy
    x, P, F, Q = np.ones(n), np.eye(n), 0.9 * np.eye(n), np.eye(n)
    H, R, zs = np.ones((m, n)), np.eye(m), np.ones((3, m))
    moved = selected.predict_linear(x, P, F, Q, 1.0)
    for got, expected in zip(moved, kalman.predict_linear(x, P, F, Q, 1.0), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12)
    updated = selected.update_linear(*moved, zs[0], H, R)
    for got, expected in zip(updated, kalman.update_linear(*moved, zs[0], H, R), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-12)
    stored, modes = {"x": np.empty((3, n))}, {"x": np.empty((3, n))}
    selected.filter_linear(x, P, zs, F, Q, H, R, 1.0, None, stored)
    np.testing.assert_allclose(stored["x"][0], updated[0], rtol=1e-10)
    model = {name: np.array([value] * 2) for name, value in (("F", F), ("Q", Q), ("H", H), ("R", R))}
    half = np.log(np.full((2, 2), 0.5))
    state = selected.filter_bank(
        np.array([x, x]), np.array([P, P]), half[0], half, zs, model | {"alpha_sq": np.asarray(1.0)}, modes
    )
    assert state is not None
    np.testing.assert_allclose(modes["x"], stored["x"], rtol=1e-10)  # both modes are the one system


@pytest.mark.parametrize("lines", [3, 300])  # NumPy tries every source of a few lines
@pytest.mark.parametrize("combine", [np.add, np.maximum])
@pytest.mark.parametrize("kernel", [np.square, lambda x: np.log1p(x * x)], ids=["convex", "bell"])
def test_the_best_sources_are_the_best_however_they_are_found(lines, combine, kernel) -> None:
    rng = np.random.default_rng(1)
    cost, table = (
        rng.uniform(0.0, 9.0, (lines, 120)),
        kernel(0.1 * (np.arange(130)[:, None] - np.arange(120))),
    )
    source = selected.best_sources(cost, table, combine)
    least = combine(np.take_along_axis(cost, source, axis=1), table[np.arange(130), source])
    np.testing.assert_array_equal(least, [combine(table, line).min(axis=1) for line in cost])


def test_filters_inherit_the_selected_steppers() -> None:
    for cls, stepper in ((KalmanFilter, selected.LinearStepper), (IMMEstimator, selected.BankStepper)):
        assert cls.step is stepper.step


def test_the_tests_run_on_the_engine_that_was_asked_for() -> None:
    wanted = os.environ.get("FUZZYKF_ENGINE")
    assert engine.info().name == (wanted or ("compiled" if built() else "numpy"))


@pytest.mark.parametrize("wanted", ["numpy", "compiled"])
def test_the_variable_decides(wanted) -> None:
    code = "from fuzzykf import engine; print(*engine.info()[:2], sep='|')"
    run = in_a_new_process(code, wanted)
    if wanted == "compiled" and not built():
        assert "FUZZYKF_ENGINE is set to 'compiled', but the compiled core" in run.stderr
    else:
        assert run.stdout.strip() == f"{wanted}|FUZZYKF_ENGINE is set to '{wanted}'"


def test_numpy_does_not_load_the_compiled_core() -> None:
    code = "import sys, fuzzykf.switching; print('fuzzykf.engine.compiled' in sys.modules)"
    assert in_a_new_process(code, "numpy").stdout.strip() == "False"


def test_a_missing_core_is_reported_not_hidden() -> None:
    # without the variable: NumPy, and the reason; with it: an error
    hide = "import sys; sys.modules['fuzzykf.engine.compiled'] = None; from fuzzykf import engine; "
    run = in_a_new_process(hide + "print(*engine.info()[:2])", None)
    assert run.stdout.startswith("numpy the compiled core cannot be imported")
    run = in_a_new_process(hide + "engine.info()", "compiled")
    assert "MissingDependencyError" in run.stderr


def test_an_unknown_engine_is_an_error() -> None:
    run = in_a_new_process("from fuzzykf import engine; engine.info()", "fortran")
    assert "FUZZYKF_ENGINE: got 'fortran', expected 'numpy' or 'compiled'" in run.stderr


def test_importing_the_engine_loads_numpy_and_nothing_heavier() -> None:
    code = "import numpy, sys; before = set(sys.modules); from fuzzykf.engine import selected\n"
    code += "print(*{m.partition('.')[0] for m in set(sys.modules) - before})"
    loaded = set(in_a_new_process(code, None).stdout.split())
    # Cython registers its own run-time types in modules without files
    assert {name for name in loaded if not name.startswith(("_cython", "cython"))} <= {
        "fuzzykf",
        "numpy",
        *sys.stdlib_module_names,
    }

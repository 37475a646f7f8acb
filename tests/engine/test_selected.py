"""One place chooses the engine; it says which one it chose, and why."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import engine
from fuzzykf.engine import selected
from fuzzykf.engine.numpy import kalman, nodes, nodes_gradient


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
    # each name comes from the module of the engine that `info` names: none is handed on
    folder, compiled = Path(engine.__file__).parent, {}
    if engine.info().name == "compiled":
        compiled = import_module("fuzzykf.engine.compiled").MODULES
    found = []
    for path in (folder / "numpy").glob("[a-z]*.py"):
        home = import_module(f"fuzzykf.engine.numpy.{path.stem}")
        taken = getattr(compiled.get(path.stem), "__all__", ())
        for name in home.__all__:
            if name in taken:
                assert getattr(selected, name).__module__ == compiled[path.stem].__name__
            else:
                assert getattr(selected, name) is getattr(home, name)
        found += home.__all__
    assert len(found) == len(set(found))  # so that no name hides another


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
    model["alpha_sq"], half = np.asarray(1.0), np.log(np.full((2, 2), 0.5))
    start = np.array([x, x]), np.array([P, P]), half[0], half
    for every_pair in (False, True):
        assert selected.filter_bank(*start, zs, model, every_pair, modes) is not None
        np.testing.assert_allclose(modes["x"], stored["x"], rtol=1e-10)  # both modes are the one system
        many = {"x": np.empty((1, 3, n))}
        assert not selected.filter_bank_many(*start, zs[None], model, every_pair, many).any()
        np.testing.assert_allclose(many["x"][0], stored["x"], rtol=1e-10)


@pytest.mark.parametrize("lines", [1, 3, 300])  # every source of one line is tried, by NumPy of a few
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


HIDE = "import sys; sys.modules['fuzzykf.engine.compiled'] = None; "

#: What the variable says that cannot be had, and what the error says of it.
REFUSED = [
    ("", "got '', expected 'numpy' or 'compiled', or no such variable"),
    ("fortran", "got 'fortran', expected 'numpy' or 'compiled', or no such variable"),
    ("Compiled", "got 'Compiled', expected 'numpy' or 'compiled', or no such variable"),
    ("compiled", "but the compiled core cannot be imported ("),
]


@pytest.mark.parametrize(("wanted", "message"), REFUSED)
def test_an_engine_that_cannot_be_had_is_an_error_in_python(wanted, message) -> None:
    error = "MissingDependencyError" if wanted == "compiled" else "ParameterError"
    for code in ("from fuzzykf import engine; engine.info()", "from fuzzykf import KalmanFilter"):
        run = in_a_new_process(HIDE + code, wanted)
        assert run.returncode == 1
        last = run.stderr.strip().splitlines()[-1]
        assert last.startswith(f"fuzzykf.errors.{error}: FUZZYKF_ENGINE")
        assert message in last
        assert last.endswith("or no such variable")


@pytest.mark.parametrize(("wanted", "message"), REFUSED)
def test_an_engine_that_cannot_be_had_is_one_line_on_the_command_line(wanted, message) -> None:
    code = HIDE + "from fuzzykf.__main__ import main; sys.argv = ['fuzzykf', '--version']; main()"
    run = in_a_new_process(code, wanted)
    assert (run.returncode, run.stdout) == (2, "")
    (line,) = run.stderr.splitlines()
    assert line.startswith("Error: FUZZYKF_ENGINE")
    assert message in line


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


@pytest.mark.parametrize(("m", "q"), [(2, 1), (17, 1), (1, 17)])
def test_state_space_models_of_any_size_have_kernels(m, q) -> None:
    space = nodes.NodeSpace(
        *(np.full((1, 1, 2, *shape), 0.5) for shape in ((m, m), (m,))),
        *(np.ones((1, 1, 2, 1, 1)) * np.eye(m), np.full((1, 1, 2, q, m), 0.1), np.zeros((1, 1, 2, q))),
        np.ones((1, 1, 2, 1, 1)) * np.eye(q),
    )
    log_T = np.log([[0.9, 0.1], [0.2, 0.8]])
    start = np.concatenate(
        [np.log([[0.5, 0.5]]), np.ones((m, 2)), np.repeat(np.eye(m).reshape(-1, 1), 2, axis=1)]
    )
    for every_pair in (False, True):
        found, expected = (
            e.node_step(e.pack_nodes(space, log_T), every_pair, start[None], np.ones((1, q)))
            for e in (selected, nodes)
        )
        for got, wanted in zip(found, expected, strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-10, atol=1e-12)
    by, expected_by = (
        gradient(pack(space, log_T), start, np.ones((3, q)))
        for gradient, pack in (
            (selected.node_gradient, selected.pack_nodes),
            (nodes_gradient.node_gradient, nodes.pack_nodes),
        )
    )
    np.testing.assert_allclose(by.space.F, expected_by.space.F, rtol=1e-10, atol=1e-12)

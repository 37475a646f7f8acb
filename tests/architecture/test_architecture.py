"""The house keeps its shape: no circles, façades only where they belong, no module too long, old paths."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from fuzzykf import moved

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def script(name):
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


circles, lines = script("import_circles"), script("lines_of_code")

#: Modules that users could import from before the tree was made, and their public names.
PUBLIC_BEFORE = json.loads((ROOT / "tests" / "data" / "public_names.json").read_text(encoding="utf-8"))

#: Methods through which an object leads to what is built upon it.
FACADES = {"fit", "filter", "plot", "smooth"}

MOST_LINES = 350

#: Calls that somebody may want to read along: how many files they visit, and how often the file changes.
#: What is missing has kernels of its own, which hand roots of covariances to `fuzzykf.gaussian`; whose the
#: verbs are is asked in `fuzzykf.overrides`.
LONGEST_WALKS = {"third step": (5, 10), "filter with a gap": (13, 58), "grid predict": (10, 80)}


def test_no_circle_of_imports_crosses_a_package(capsys) -> None:
    assert circles.main() == 0, capsys.readouterr().out


def test_circles_are_found_in_functions_and_for_types(tmp_path) -> None:
    package = tmp_path / "package"
    (package / "lower").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "lower" / "__init__.py").write_text("")
    (package / "a.py").write_text("from package.lower import b\n")
    (package / "lower" / "b.py").write_text("def f():\n    from package.c import x\n")
    (package / "c.py").write_text("if TYPE_CHECKING:\n    from package.a import y\nx = 1\n")
    found = circles.circles(circles.graph(package, set()))
    assert found == [["package.a", "package.c", "package.lower.b"]]
    assert circles.circles(circles.graph(package, {("package.c", "package.a")})) == []


@pytest.mark.parametrize(("importer", "imported"), sorted(circles.facades()))
def test_a_facade_is_an_import_inside_a_method_of_its_name(importer: str, imported: str) -> None:
    known = circles.modules(ROOT / "fuzzykf")
    tree = ast.parse(known[importer].read_text(encoding="utf-8"))
    inside = {
        node
        for method in ast.walk(tree)
        if isinstance(method, ast.FunctionDef) and method.name in FACADES
        for node in ast.walk(method)
    }
    places = circles.imports(importer, known[importer], known)[imported]
    lines_inside = {node.lineno for node in inside if isinstance(node, ast.Import | ast.ImportFrom)}
    assert {place.lineno for place in places} <= lines_inside


def test_no_module_is_too_long() -> None:
    paths = (ROOT / "fuzzykf").rglob("*.py")
    long = [path for path in paths if len(path.read_text(encoding="utf-8").splitlines()) > MOST_LINES]
    counts = {str(path): lines.lines_of_code(path) for path in long}  # no file has more code than lines
    assert {path: count for path, count in counts.items() if count > MOST_LINES} == {}


def test_lines_of_docstrings_and_comments_do_not_count(tmp_path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        '"""Say\n\nmuch."""\n\n# why\nx = [\n    1,\n]\n\n\ndef f():\n    """Say."""\n    return x\n'
    )
    assert lines.lines_of_code(path) == 5


def test_a_reader_of_a_call_walks_through_few_files() -> None:
    # The kernels of NumPy are a part of the walk, whatever engine these tests run on.
    run = subprocess.run(
        [sys.executable, str(HERE / "walks.py")],
        env={**os.environ, "FUZZYKF_ENGINE": "numpy"},
        capture_output=True,
        text=True,
        check=True,
    )
    told = re.findall(r"^(.+): (\d+) files, (\d+) changes of file$", run.stdout, re.MULTILINE)
    found = {name: (int(files), int(changes)) for name, files, changes in told}
    for name, (files, changes) in LONGEST_WALKS.items():
        assert found[name][0] <= files, run.stdout
        assert found[name][1] <= changes, run.stdout


# --------------------------------------------------------------------------- old paths


@pytest.mark.parametrize("module", sorted(PUBLIC_BEFORE))
def test_every_name_that_was_public_is_still_where_it_was(module: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        there = importlib.import_module(module)
        missing = [name for name in PUBLIC_BEFORE[module] if not hasattr(there, name)]
    assert missing == []


@pytest.mark.parametrize(("old", "new"), moved.MODULES.items())
def test_an_old_module_path_gives_the_module_of_today(old: str, new: str) -> None:
    sys.modules.pop(old, None)
    told = rf"^{old} has moved to {new}(; [\w, ]+ can be imported from fuzzykf[.\w]*)?$"
    with pytest.warns(DeprecationWarning, match=told) as seen:
        module = importlib.import_module(old)
    assert len([one for one in seen if str(one.message).startswith(old)]) == 1
    today = importlib.import_module(new)
    for name in getattr(today, "__all__", ()):
        assert getattr(module, name) is getattr(today, name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert importlib.import_module(old) is module  # a second import says nothing


def test_an_old_path_warns_the_line_that_names_it_and_once(tmp_path) -> None:
    code = (
        "from fuzzykf.switching.tables import PairTables\n"
        "import fuzzykf.switching.tables\n"
        "from fuzzykf.switching import tables\n"
        "from fuzzykf.plotting import plot_comparison\n"
        "from fuzzykf.plotting import plot_comparison\n"
        "assert PairTables is tables.PairTables\n"
        "from fuzzykf.comparison import plot_comparison as there\n"
        "assert plot_comparison is there\n"
        "import fuzzykf.possibility\n"
        "fuzzykf.possibility.boxes\n"
    )
    file = tmp_path / "code.py"
    file.write_text(code)
    run = subprocess.run(
        [sys.executable, "-W", "always", str(file)], capture_output=True, text=True, check=True
    )
    told = [line for line in run.stderr.splitlines() if "DeprecationWarning" in line]
    assert [line.split(" DeprecationWarning")[0] for line in told] == [f"{file}:{k}:" for k in (1, 4, 10)]


def test_what_never_was_there_is_not_there() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"fuzzykf\.switching\.nonsense"):
        importlib.import_module("fuzzykf.switching.nonsense")
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = importlib.import_module("fuzzykf.plotting").nonsense

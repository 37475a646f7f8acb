"""Both engines have the same modules, names and parameters, and the compiled one knows nothing but arrays."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

from fuzzykf import engine

FOLDER = Path(engine.__file__).parent
HELPERS = {"arrays", "processor"}
MEMORY = {"Bank", "Firsts", "GapRoom", "NodeSpan", "Workspace"}  # of the compiled code
MODULES = sorted({path.stem for path in (FOLDER / "compiled").glob("*.pyx")} - HELPERS)


@pytest.fixture(scope="module")
def core():
    """The compiled modules by name."""
    package = pytest.importorskip("fuzzykf.engine.compiled", reason="the compiled core has not been built")
    return package.MODULES


def parameters(function):
    """Names and defaults of parameters."""
    return [(one.name, one.default) for one in inspect.signature(function).parameters.values()]


def test_all_modules_are_loaded(core) -> None:
    assert set(core) == {*MODULES, *HELPERS}


@pytest.mark.parametrize("name", MODULES)
def test_a_compiled_module_has_the_names_and_parameters_of_its_twin(core, name) -> None:
    compiled, twin = core[name], import_module(f"fuzzykf.engine.numpy.{name}")
    public = {
        key
        for key, value in vars(compiled).items()
        if getattr(value, "__module__", None) == compiled.__name__ and not key.startswith("_")
    }
    assert set(compiled.__all__) == public - MEMORY
    assert public - MEMORY <= set(twin.__all__)
    for key in compiled.__all__:
        if not isinstance(getattr(compiled, key), type):
            assert parameters(getattr(compiled, key)) == parameters(getattr(twin, key)), key


def test_the_compiled_engine_knows_no_attribute_of_a_filter() -> None:
    sources = [path for pattern in ("*.pyx", "*.pxd") for path in (FOLDER / "compiled").glob(pattern)]
    private = re.compile(r"""\bself\._|["']_[a-z]\w*["']""")
    assert sources
    for path in sources:
        found = [line for line in path.read_text(encoding="utf-8").splitlines() if private.search(line)]
        assert found == [], path.name

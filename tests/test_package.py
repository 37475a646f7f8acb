"""Importing the package is light, its names are where they are announced, its metadata agree."""

from __future__ import annotations

import importlib
import json
import pickle
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import fuzzykf

ROOT = Path(__file__).parents[1]


def modules_after(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_the_package_loads_numpy_and_nothing_heavier() -> None:
    third_party = modules_after("import fuzzykf, fuzzykf.base, fuzzykf.gaussian") - modules_after(
        "import numpy"
    )
    assert third_party <= {"fuzzykf", *sys.stdlib_module_names}


def test_importing_the_package_does_not_import_its_parts() -> None:
    # The names are lazy: the weight of a part is paid by those who use it.
    run = subprocess.run(
        [sys.executable, "-c", "import fuzzykf, sys; print(*[m for m in sys.modules if 'fuzzykf.' in m])"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split() == ["fuzzykf.moved"]  # a table of names


@pytest.mark.parametrize("name", sorted(set(fuzzykf.__all__) - {"__version__"}))
def test_every_public_name_is_found_documented_and_listed(name) -> None:
    value = getattr(fuzzykf, name)
    assert getattr(importlib.import_module(value.__module__), name) is value
    assert value.__doc__
    assert name in dir(fuzzykf)


def test_type_checkers_and_the_running_package_see_the_same_names() -> None:
    source = (ROOT / "fuzzykf" / "__init__.py").read_text(encoding="utf-8")
    block = source.partition("if TYPE_CHECKING:")[2].partition("__version__")[0]
    seen = set(re.findall(r"\b[A-Z]\w+|(?<=import )[a-z]\w+|\w+(?=,\n)|(?<=, )[a-z]\w+(?=\n)", block))
    assert seen == set(fuzzykf.__all__) - {"__version__"} == set(fuzzykf._HOMES)


@pytest.mark.parametrize(
    ("plain", "name"), [("FuzzySwitchFilter", "OFSRFilter"), ("HardSwitchFilter", "CGOMSMFilter")]
)
def test_a_plain_name_is_the_same_class_and_files_keep_one_name(
    plain, name, fuzzy_model, hard_model, tmp_path
) -> None:
    cls = getattr(fuzzykf, plain)
    assert cls is getattr(fuzzykf, name) is getattr(fuzzykf.switching, plain)
    assert cls.__name__ == cls.__qualname__ == name
    assert plain in cls.__doc__
    f = cls(fuzzy_model if name == "OFSRFilter" else hard_model)
    f.step(0.5)
    assert repr(f).startswith(f"{name}(")
    stored = pickle.dumps(f)
    assert plain.encode() not in stored
    f.save(tmp_path / "filter.json")
    assert plain not in (tmp_path / "filter.json").read_text(encoding="utf-8")
    for again in (pickle.loads(stored), cls.load(tmp_path / "filter.json")):
        assert type(again) is cls
        np.testing.assert_array_equal(again.x, f.x)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'ParticleFilter'"):
        _ = fuzzykf.ParticleFilter


def test_the_version_is_the_same_everywhere() -> None:
    metadata = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert fuzzykf.__version__ == metadata["version"] == version("fuzzykf")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {fuzzykf.__version__}\n" in citation
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8")
    assert f'\n  version: "{fuzzykf.__version__}"\n' in recipe


def test_the_page_on_versions_names_what_is_needed() -> None:
    metadata = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (ROOT / "docs" / "versioning.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"(Python|NumPy|SciPy)\s(\d+\.\d+)", page))
    needed = [f"python{metadata['requires-python']}", *metadata["dependencies"]]
    assert [f"{name.lower()}>={version}" for name, version in told.items()] == needed


def test_the_recipe_asks_for_what_the_package_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8").partition("\nrequirements:")[2]
    blocks = (re.search(rf"^  {part}:\n((?:    - .+\n)+)", recipe, re.MULTILINE) for part in ("host", "run"))
    host, run = (set(block[1].replace(" ", "").strip("-\n").split("\n-")) for block in blocks)
    python = f"python{project['project']['requires-python']}"
    needed = {python, *project["project"]["dependencies"]}
    assert run == needed
    assert host == {python, "pip", *project["build-system"]["requires"]}


def test_wheels_are_built_for_every_python_that_is_promised() -> None:
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    names = (one.partition("Python :: 3.")[2] for one in tool["project"]["classifiers"])
    assert tool["tool"]["cibuildwheel"]["build"] == [f"cp3{minor}-*" for minor in names if minor]


def test_whoever_cites_and_archives_the_package_is_told_the_same() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    deposit = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    metadata = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f'\ntitle: "{deposit["title"]}"\n' in citation
    assert f"\nlicense: {deposit['license']}\n" in citation
    assert deposit["license"] == metadata["license"]
    names = [one["name"] for one in deposit["creators"]]
    assert names == [one["name"] for one in metadata["authors"]]
    own = citation.partition("\nreferences:")[0]
    assert re.findall(r"^  - name: (.+)$", own, re.MULTILINE) == names
    assert re.findall(r"^  - (.+)$", own.partition("\nkeywords:")[2], re.MULTILINE) == deposit["keywords"]
    for one in deposit["related_identifiers"]:
        assert f"doi: {one['identifier']}\n" in citation
    assert "version" not in deposit  # the archive takes it from the tag of the release


def test_the_installed_package_carries_its_types_and_its_data() -> None:
    folder = Path(fuzzykf.__file__).parent
    assert (folder / "py.typed").is_file()
    for name in ("victoria_2014", "weather_jfk_2013"):
        assert (folder / "datasets" / f"{name}.csv.gz").is_file()

"""The code in README and on the pages runs, and prints what the pages say it prints."""

from __future__ import annotations

import contextlib
import doctest
import importlib
import io
import os
import pkgutil
import re
import sys
import types
import warnings
from pathlib import Path

import pytest

import fuzzykf

os.environ.setdefault("MPLBACKEND", "Agg")  # pages that draw open no window

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
    *sorted((ROOT / "docs" / "theory").glob("*.md")),
    ROOT / "docs" / "index.md",
    ROOT / "docs" / "architecture.md",
    ROOT / "docs" / "glossary.md",
    ROOT / "docs" / "performance.md",
    ROOT / "docs" / "reproduction.md",
    ROOT / "docs" / "versioning.md",
    ROOT / "docs" / "paper" / "paper.md",
]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def names(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_the_python_on_a_page_runs_and_prints_what_follows_it(page, monkeypatch) -> None:
    module = types.ModuleType("a_page")  # so that what the page defines can be pickled
    monkeypatch.setitem(sys.modules, "a_page", module)
    namespace: dict[str, object] = vars(module)
    printed = ""
    for language, code in FENCE.findall(page.read_text(encoding="utf-8")):
        if language == "python":
            assert printed == "", f"the page does not show what was printed: {printed}"
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(code, names(page), "exec"), namespace)
            printed = output.getvalue()
        elif language == "text" and printed:
            assert code == printed
            printed = ""
        elif language == "pycon":
            test = doctest.DocTestParser().get_doctest(code, namespace, names(page), str(page), 0)
            report = io.StringIO()
            results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(
                test, out=report.write, clear_globs=False
            )
            assert results.failed == 0, report.getvalue()
            namespace.update(test.globs)
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_the_links_between_pages_lead_somewhere(page) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if not target.startswith(("http://", "https://")):
            assert (page.parent / target).exists(), f"{names(page)} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_numbered_equations_have_no_line_break(page) -> None:
    # Sphinx puts an equation with a line break into "split", in which MathJax refuses a number.
    for equation in re.findall(
        r"^\$\$$(.*?)^\$\$$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        assert not (r"\tag" in equation and r"\\" in equation), equation


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "docs" / "index.md"], ids=names)
def test_a_page_that_is_seen_first_shows_its_code_whole(page) -> None:
    listings = FENCE.findall(page.read_text(encoding="utf-8"))
    assert {kind for kind, _ in listings} >= {"python", "text"}
    assert max(len(line) for _, code in listings for line in code.splitlines()) <= 88


def test_the_tests_that_pages_name_exist() -> None:
    page = (ROOT / "docs" / "theory" / "corrections.md").read_text(encoding="utf-8")
    named = re.findall(r"`([\w/]+\.py)::(\w+)`", page)
    assert len(named) > 20
    for file, function in named:
        source = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert re.search(rf"^def {function}\(", source, re.MULTILINE), f"there is no {file}::{function}"


def test_the_paper_cites_what_its_bibliography_has() -> None:
    folder = ROOT / "docs" / "paper"
    cited = set(re.findall(r"\[@(\w+)\]", (folder / "paper.md").read_text(encoding="utf-8")))
    listed = re.findall(r"^@\w+\{(\w+),$", (folder / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(cited) == sorted(listed)


def test_the_figures_of_the_paper_are_those_of_the_study() -> None:
    table = (ROOT / "docs" / "_tables" / "fading_sensor.inc").read_text(encoding="utf-8").splitlines()
    head, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    cells = {(row[0], row[1]): dict(zip(head[2:], row[2:], strict=True)) for row in rows}
    slow, fast = (
        {name: cell.split()[0] for name, cell in cells[n, "fuzzy to it"].items()} for n in ("20", "1")
    )
    assert cells["20", "best rival"]["gain"] == "IMM, seven modes"
    told = re.findall(r"(\d\.\d+) times", (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8"))
    assert told == [slow["gain"], slow["noise"], max(fast.values(), key=float)]


#: Modules of one file that users import from; of the folders, all but those of the command line.
PUBLIC = ["fuzzykf.errors", "fuzzykf.io", "fuzzykf.preprocessing", "fuzzykf.results"]


def listed_names() -> set[tuple[str, str]]:
    """Module and name of every entry of the reference."""
    found = set()
    module = ""
    for line in (ROOT / "docs" / "reference" / "index.md").read_text(encoding="utf-8").splitlines():
        if match := re.fullmatch(r"\.\. currentmodule:: (\S+)", line):
            module = match[1]
        elif match := re.fullmatch(r"   (\w+)", line):
            found.add((module, match[1]))
    return found


def test_the_reference_lists_every_public_name() -> None:
    names = {name for _, name in listed_names()}
    folders = [
        found.name
        for found in pkgutil.walk_packages(fuzzykf.__path__, "fuzzykf.")
        if found.ispkg and not re.search(r"\._|\.cli|\.engine\.", found.name)
    ]
    assert {"fuzzykf.switching", "fuzzykf.possibility.memberships"} <= set(folders)
    for module in ["fuzzykf", *folders, *PUBLIC]:
        there = importlib.import_module(module)
        exported = getattr(there, "__all__", ())  # a folder of the inside offers nothing of its own
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of names that have moved up
            public = {name for name in exported if callable(getattr(there, name))}  # not constants
        assert public <= names, f"{module}: {sorted(public - names)} are not in docs/reference/index.md"


def test_the_reference_lists_nothing_that_is_not_there() -> None:
    for module, name in listed_names():
        assert name in importlib.import_module(module).__all__, f"{module} has no public name {name}"


def test_readme_has_the_two_set_up_commands_each_in_one_line() -> None:
    blocks = [
        code
        for language, code in FENCE.findall((ROOT / "README.md").read_text(encoding="utf-8"))
        if language == "sh"
    ]
    assert len(blocks) == 2
    for block, end in zip(blocks, ("fuzzykf compare", "pytest"), strict=True):
        assert re.fullmatch(rf"pip install [^\n]* {end}\n", block)

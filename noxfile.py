#!/usr/bin/env -S uv run --script

# /// script
# dependencies = ["nox>=2025.10.14"]
# ///

"""Tasks of the developers: ``nox`` runs the default ones, ``nox -s NAME`` one of them."""

from __future__ import annotations

from pathlib import Path

import nox

nox.needs_version = ">=2025.10.14"
nox.options.default_venv_backend = "uv|virtualenv"

PROJECT = nox.project.load_toml("pyproject.toml")
PYTHON_VERSIONS = nox.project.python_versions(PROJECT)


@nox.session(python=PYTHON_VERSIONS)
def tests(session: nox.Session) -> None:
    """Run the tests and the examples in the docstrings."""
    session.install("-e", ".[test]")
    session.run("pytest", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and format of the source, the form of the repository, and its floors."""
    session.install("--group", "lint")
    session.run("ruff", "check", *session.posargs)
    session.run("ruff", "format", "--check")
    session.run("repo-review", ".")
    session.run("lint-imports", "--no-cache")
    session.run("python", "tests/architecture/import_circles.py")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types, strictly."""
    session.install("-e", ".[cli,compare]", "--group", "types")
    session.run("mypy", *session.posargs)
    session.run("python", "tests/typing")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation, a warning is an error, and run the notebooks that it made of the tutorials."""
    session.install("-e", ".", "--group", "docs")
    session.run(
        "sphinx-build", "-W", "--keep-going", "-b", "html", "docs", "docs/_build/html", *session.posargs
    )
    session.run("jupyter", "execute", *map(str, Path("docs/_build/html/tutorials").glob("*.ipynb")))


@nox.session(default=False)
def explore(session: nox.Session) -> None:
    """Run every property on fresh random examples, ten times as many as in the normal run."""
    session.install("-e", ".[test]")
    session.run("pytest", "tests", "--hypothesis-profile=explore", *session.posargs)


@nox.session(default=False)
def studies(session: nox.Session) -> None:
    """Run the simulation studies that are too long for the test suite."""
    session.install("-e", ".[test]")
    session.run("pytest", "-m", "study", *session.posargs)


@nox.session(default=False)
def mutants(session: nox.Session) -> None:
    """Make equations wrong, one at a time, and see whether the tests notice; half an hour."""
    session.install("-e", ".[test]", "cython>=3.1", "setuptools>=77")
    session.run("python", "tests/mutants", *session.posargs)


@nox.session(default=False)
def torture(session: nox.Session) -> None:
    """Ill-treat everything that is public and count what happens; an hour (``-- --short``: three minutes)."""
    session.install("-e", ".[test]")
    session.run("python", "tests/torture", *session.posargs)


@nox.session(default=False)
def benchmarks(session: nox.Session) -> None:
    """Measure speed as ratios within one run."""
    session.install("-e", ".[test]", "--group", "benchmarks")
    options = (
        "addopts=-ra --strict-config --strict-markers --import-mode=importlib"  # without --benchmark-skip
    )
    session.run("pytest", "tests/benchmarks", "--benchmark-only", "--override-ini", options, *session.posargs)


if __name__ == "__main__":
    nox.main()

"""The recipes of CONTRIBUTING.md work to the letter, in a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (fuzzykf/\S+\.py)\n")


def recipes() -> list[tuple[str, str]]:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    return FENCE.findall(text.partition("\n## Recipes\n")[2])


def add_lines(folder: Path, change: str) -> None:
    """Put the lines with a plus after the one without, which the file has once."""
    head, after, *added = change.splitlines()
    file = folder / head.removeprefix("--- ")
    text, line = file.read_text(encoding="utf-8"), after[1:] + "\n"
    assert text.count(line) == 1, f"{file.name} has the line {line!r} {text.count(line)} times"
    assert all(one.startswith("+") for one in added)
    file.write_text(text.replace(line, line + "".join(f"{one[1:]}\n" for one in added)), encoding="utf-8")


def test_each_recipe_makes_what_it_says(tmp_path) -> None:
    ignored = shutil.ignore_patterns("__pycache__", "*.so", "*.pyd", "*.c", "*.pyx")
    shutil.copytree(ROOT / "fuzzykf", tmp_path / "fuzzykf", ignore=ignored)
    tried, expected, files, lines = "", "", 0, 0
    for language, code in recipes():
        if language == "diff":
            add_lines(tmp_path, code)
            lines += 1
        elif language == "text":
            expected += code
        elif found := FILE.match(code):
            file = tmp_path / found[1]
            assert not file.exists(), f"{found[1]} is there already"
            file.write_text(code[found.end() :], encoding="utf-8")
            files += 1
        else:
            tried += code
    assert (files, lines) == (4, 3)
    (tmp_path / "tried.py").write_text(tried, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "FUZZYKF_ENGINE": "numpy"}
    run = subprocess.run(
        [sys.executable, "-W", "error", "-P", str(tmp_path / "tried.py")],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.stdout, run.stderr) == (expected, "")

"""What the studies share: the models of the paper, and tables for the documentation.

Run them by ``nox -s studies``; each writes its tables to docs/_tables, which pages include.
"""

from __future__ import annotations

import json
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def paper_model():
    """FMC1 (.07, .05, eta) with the printed matrices: eta -> model."""
    cases = json.loads((ROOT / "tests" / "data" / "ofsrf.json").read_text())["cases"]
    case = next(c for c in cases if c["id"] == "P1")
    gamma = np.array([[case["Gamma"][f"{i}{j}"] for j in range(2)] for i in range(2)])

    def make(eta):
        return CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, eta), [case["M0"], case["M1"]], gamma, 1)

    return make


@pytest.fixture
def write_table(request):
    """Write a table in Markdown: (name, header, rows of strings); print it as well.

    With ``by_first`` it is a table for each value of the first column, which stands above it.
    """

    def table(header, rows):
        lines = ["| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows]]
        return "\n".join(lines) + "\n"

    def write(name, header, rows, *, by_first=False):
        if by_first:
            parts = [(first, [row[1:] for row in group]) for first, group in groupby(rows, itemgetter(0))]
            text = "\n".join(f"**{first}**\n\n{table(header[1:], part)}" for first, part in parts)
        else:
            text = table(header, rows)
        folder = ROOT / "docs" / "_tables"
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.inc").write_text(text)
        with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
            print(f"\n{name}\n{text}")

    return write

"""``fuzzykf simulate`` writes a series of the model, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from fuzzykf import CGLSSM
from fuzzykf.cli.app import app
from fuzzykf.datasets import read_table


def run(*arguments: object):
    return CliRunner().invoke(app, ["simulate", *map(str, arguments)], env={"COLUMNS": "200"})


def test_it_writes_what_the_library_draws(fuzzy_model, tmp_path) -> None:
    fuzzy_model.save(tmp_path / "model.json")
    result = run(tmp_path / "model.json", "-n", 30, "--seed", 4, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    table = read_table(tmp_path / "out.csv")
    assert list(table.columns) == ["row", "switch", "x", "y"]
    expected = fuzzy_model.simulate(30, np.random.default_rng(4))
    np.testing.assert_array_equal(table.numbers("switch"), expected.r)
    np.testing.assert_array_equal(table.numbers("x"), expected.x[:, 0])
    np.testing.assert_array_equal(table.numbers("y"), expected.y[:, 0])
    assert "Drew 30 rows from CGOFMSModel(" in result.output


def test_the_seed_decides(hard_model, tmp_path) -> None:
    hard_model.save(tmp_path / "model.json")
    texts = []
    for seed in (1, 1, 2):
        run(tmp_path / "model.json", "-n", 5, "--seed", seed, "-o", tmp_path / "out.csv")
        texts.append((tmp_path / "out.csv").read_text())
    assert texts[0] == texts[1] != texts[2]
    assert texts[0].startswith("row,switch,x0,x1,y\n0,")


def test_what_cannot_be_drawn_is_refused(fuzzy_model, tmp_path) -> None:
    fuzzy_model.save(tmp_path / "model.json")
    for option in ("-n", "--seed"):
        result = run(tmp_path / "model.json", option, 0 if option == "-n" else -1)
        assert result.exit_code == 2
        assert f"Invalid value for '{option}'" in " ".join(result.output.split())
    result = run(tmp_path / "none.json", "-o", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert "none.json: No such file" in result.output
    result = run(tmp_path / "model.json", "-o", tmp_path / "none" / "out.csv")
    assert result.exit_code == 1
    assert "there is no such folder" in result.output


#: Names of the state and of the observation, and the columns that are written.
NAMES = {
    "both": ("load", "t", "row,switch,load,t"),
    "the observation alone": (None, "t", "row,switch,x,t"),
    "the state alone": ("load", None, "row,switch,load,y"),
    "one name for both": ("Nord", "Nord", "row,switch,state Nord,Nord"),
    "an observation that is called x": (None, "x", "row,switch,state x,x"),
    "names that the command has itself": ("switch", "row", "drawn row,drawn switch,switch,row"),
    "the switch and the state of one name": (
        "state switch",
        "switch",
        "row,drawn switch,state switch,switch",
    ),
    "a comma and a quote": ('the "load"', "t, h", 'row,switch,"the ""load""","t, h"'),
}


@pytest.mark.parametrize("case", NAMES)
def test_columns_are_called_as_the_model_knows_them_and_can_be_filtered(case, fuzzy_model, tmp_path) -> None:
    state, observation, header = NAMES[case]
    model = fuzzy_model.labelled(
        states=None if state is None else [state], observations=None if observation is None else [observation]
    )
    model.save(tmp_path / "m.json")
    assert run(tmp_path / "m.json", "-n", 9, "-o", tmp_path / "sim.csv").exit_code == 0
    assert (tmp_path / "sim.csv").read_text().splitlines()[0] == header
    # Oracle: the series that the library draws, filtered by the library.
    series = model.simulate(9, np.random.default_rng(0))
    obs = [] if observation else ["--obs", "y"]
    words = ["filter", tmp_path / "m.json", tmp_path / "sim.csv", *obs, "-o", tmp_path / "out.csv"]
    result = CliRunner().invoke(app, [*map(str, words)])
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(
        read_table(tmp_path / "out.csv").numbers("x"), model.filter().filter(series.y).x[:, 0]
    )


def test_names_that_a_spreadsheet_would_compute_get_an_apostrophe_unless_told(fuzzy_model, tmp_path) -> None:
    fuzzy_model.labelled(states=["@load"], observations=["=1+1"]).save(tmp_path / "m.json")
    for options, header in (
        ([], "row,switch,'@load,'=1+1"),
        (["--formulas"], "row,switch,@load,=1+1"),
    ):
        assert run(tmp_path / "m.json", "-n", 2, "-o", tmp_path / "sim.csv", *options).exit_code == 0
        assert (tmp_path / "sim.csv").read_text().splitlines()[0] == header


def test_a_model_that_remembers_no_names_writes_x_and_y(tmp_path) -> None:
    CGLSSM([[1.0]], [[[0.5]]], [[[1.0]]], [[[1.0]]], [[[1.0]]]).save(tmp_path / "m.json")
    assert run(tmp_path / "m.json", "-n", 2, "-o", tmp_path / "sim.csv").exit_code == 0
    assert (tmp_path / "sim.csv").read_text().splitlines()[0] == "row,switch,x,y"

"""``fuzzykf simulate`` writes a series of the model, the same for the same seed."""

from __future__ import annotations

import numpy as np
from typer.testing import CliRunner

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

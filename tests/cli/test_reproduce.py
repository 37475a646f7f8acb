"""``fuzzykf reproduce``: lists, runs, writes, goes on, and refuses."""

from __future__ import annotations

import csv
import json

import pytest
from typer.testing import CliRunner

from fuzzykf.cli.app import app
from fuzzykf.experiments import EXPERIMENTS


def run(*arguments):
    return CliRunner(env={"COLUMNS": "160"}).invoke(app, ["reproduce", *map(str, arguments)])


def test_the_list_names_every_experiment() -> None:
    result = run("--list")
    assert result.exit_code == 0
    for name in EXPERIMENTS:
        assert name in result.output


def test_two_experiments_leave_three_files_each_and_a_summary(tmp_path) -> None:
    result = run("densities", "trajectories", "--runs", 3, "--seed", 7, "--out", tmp_path / "new")
    assert result.exit_code == 0, result.output
    for name in ("densities", "trajectories"):
        record = json.loads((tmp_path / "new" / f"{name}.json").read_text("utf-8"))
        assert (record["seed"], record["runs"]) == (7, 3)
        assert (tmp_path / "new" / f"{name}.csv").exists()
        assert (tmp_path / "new" / f"{name}.png").exists()
    with (tmp_path / "new" / "summary.csv").open(encoding="utf-8") as stream:
        summary = list(csv.DictReader(stream))
    assert [row["experiment"] for row in summary] == ["densities", "trajectories"]
    assert summary[0]["reproduced"] == "2"
    assert "share of hard values" in result.output


def test_the_same_seed_writes_the_same_tables(tmp_path) -> None:
    tables = []
    for folder in ("one", "two"):
        assert run("trajectories", "--runs", 2, "--out", tmp_path / folder).exit_code == 0
        tables.append((tmp_path / folder / "trajectories.csv").read_bytes())
    assert tables[0] == tables[1]


def test_quick_takes_the_runs_for_a_quick_look_unless_told_otherwise(tmp_path) -> None:
    assert run("densities", "--quick", "--out", tmp_path).exit_code == 0
    record = json.loads((tmp_path / "densities.json").read_text("utf-8"))
    assert record["runs"] == EXPERIMENTS["densities"].quick_runs
    assert run("densities", "--quick", "--runs", 5, "--out", tmp_path).exit_code == 0
    assert json.loads((tmp_path / "densities.json").read_text("utf-8"))["runs"] == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["table-9"], "NAME: got 'table-9', expected all, or some of densities"),
        ([], "NAME: missing; expected all"),
    ],
)
def test_names_that_are_not_there_are_refused(tmp_path, arguments, message) -> None:
    result = run(*arguments, "--out", tmp_path / "new")
    assert result.exit_code == 1
    assert message in result.output
    assert not (tmp_path / "new").exists()


def test_without_its_data_an_experiment_is_left_out_of_all_and_said_so(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("FUZZYKF_DATA", raising=False)
    for name in EXPERIMENTS.keys() - {"densities", "building"}:
        monkeypatch.delitem(EXPERIMENTS, name)
    result = run("all", "--quick", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "Skipped: building: openei_building1_june2010.csv is not part of the package" in result.output
    assert (tmp_path / "densities.csv").exists()
    assert not (tmp_path / "building.csv").exists()


def test_an_experiment_asked_for_by_name_needs_its_data(tmp_path) -> None:
    result = run("densities", "building", "--data", tmp_path, "--out", tmp_path / "new")
    assert result.exit_code == 1
    assert "there is no openei_building1_june2010.csv in it" in result.output
    assert not (tmp_path / "new").exists()


def test_a_file_in_the_place_of_the_folder_is_refused_before_any_work(tmp_path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    result = run("densities", "--out", tmp_path / "file")
    assert result.exit_code == 1
    assert "expected a folder" in result.output
    assert (tmp_path / "file").read_text("utf-8") == ""

"""Commands take the columns that a model was learned on, and refuse what it was not learned on."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fuzzykf import CGOFMSModel
from fuzzykf.cli.app import app
from fuzzykf.datasets import read_table
from fuzzykf.io import load_model
from fuzzykf.labels import Labels

DATA = Path(__file__).parents[1] / "data"
TABLES = DATA / "tables"

#: A fuzzy and a hard model of "load" from "t" and "h", hour by hour, as they were saved.
MODELS = [DATA / "files" / "labels" / f"{name}.json" for name in ("fuzzy_learned", "hard_learned")]


#: The two commands, each with one of the models; they read a file before they know of either.
VERBS = [("filter", MODELS[0]), ("smooth", MODELS[1])]


def ids(value):
    return value.stem if isinstance(value, Path) else None


def run(*arguments: object):
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "200"})


def estimates(path):
    with path.open(encoding="utf-8", newline="") as file:
        return np.array([[float(row["x"]), float(row["x_std"])] for row in csv.DictReader(file)])


#: File, options, the columns that are filtered, and a note.
TAKEN = [
    ("learned", "", "t h", ""),
    ("learned_swapped", "", "t h", ""),
    ("learned_among_others", "", "t h", ""),
    ("learned_among_others", "--index note", "t h", ""),
    ("learned", "--obs t --obs h", "t h", ""),
    ("learned", "--obs h --obs t", "t h", ""),  # named in another order, and known by name
    (
        "learned_renamed",
        "--obs air --obs humidity",
        "air humidity",
        "air replaces t, which the model was learned on. Note: humidity replaces h, which",
    ),
    ("learned_by_day", "--time none", "t h", ""),
]


@pytest.mark.parametrize(("verb", "model"), VERBS, ids=ids)
@pytest.mark.parametrize(("name", "options", "columns", "note"), TAKEN, ids=[f"{c[0]} {c[1]}" for c in TAKEN])
def test_the_columns_are_those_of_the_model(name, options, columns, note, verb, model, tmp_path) -> None:
    out = tmp_path / "out.csv"
    result = run(verb, model, TABLES / f"{name}.csv", "-o", out, *options.split())
    assert result.exit_code == 0, result.output
    table = read_table(TABLES / f"{name}.csv")
    zs = np.column_stack([table.numbers(column, gaps=True) for column in columns.split()])
    f = load_model(model).filter()
    expected = (f.filter if verb == "filter" else f.smooth)(zs, keep_nodes=True)
    np.testing.assert_array_equal(
        estimates(out), np.column_stack([expected.x[:, 0], expected.P[:, 0, 0] ** 0.5])
    )
    printed = " ".join(result.output.split())
    assert ("Note: " in printed) == bool(note)
    assert note in printed


#: File, options, exit code and message.
REFUSED = [
    (
        "learned",
        "--obs load --obs h",
        2,
        "--obs: 'load' is a state of the model of {}, which was learned on t, h",
    ),
    ("learned", "--obs load", 2, "--obs: 'load' is a state of the model of {}"),
    (
        "learned_renamed",
        "--obs air --obs t",
        2,
        "--obs: 't' is named in place 2, where the model of {} has 'h'",
    ),
    (
        "learned_one_missing",
        "",
        1,
        "learned_one_missing.csv has no column 'h', which the model of {} observes (--obs names another); "
        "its columns are time, load, t",
    ),
    ("learned_renamed", "", 1, "has no column 't', which the model of {} observes"),
    (
        "learned_renamed",
        "--obs air",
        2,
        "--obs: got 1 column, but the model of {} has 2 observed components",
    ),
    (
        "learned_renamed",
        "--obs wind --obs h",
        1,
        "learned_renamed.csv has no column 'wind'; its columns are time",
    ),
    (
        "learned_by_day",
        "",
        2,
        "learned_by_day.csv: its rows are 1 day, 0:00:00 apart, but the model was learned on rows 1:00:00 "
        "apart; resample it, or --time none takes the rows as they come",
    ),
]


@pytest.mark.parametrize(("verb", "model"), VERBS, ids=ids)
@pytest.mark.parametrize(
    ("name", "options", "code", "message"), REFUSED, ids=[f"{c[0]} {c[1]}" for c in REFUSED]
)
def test_what_the_model_was_not_learned_on_is_refused(
    name, options, code, message, verb, model, tmp_path
) -> None:
    result = run(verb, model, TABLES / f"{name}.csv", "-o", tmp_path / "out.csv", *options.split())
    assert result.exit_code == code, result.output
    assert message.format(model.name) in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_files_with_labels_come_back_bit_for_bit(tmp_path) -> None:
    for path in MODELS:
        model = load_model(path)
        labels = Labels(["load"], ["t", "h"], {"load": "GW", "h": "%"}, np.timedelta64(1, "h"))
        assert model.labels == labels
        model.save(tmp_path / path.name)
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


# --------------------------------------------------------------------------- fit


@pytest.fixture
def training(tmp_path, fuzzy_model):
    series = fuzzy_model.simulate(120, np.random.default_rng(1))
    path = tmp_path / "meters.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        times = np.datetime64("2024-01-01", "m") + 30 * np.arange(120)
        rows = zip(times, series.x[:, 0].tolist(), series.y[:, 0].tolist(), strict=True)
        csv.writer(file).writerows([("time", "demand", "temperature"), *rows])
    return path


QUICK = ["--nodes", 0, "--max-iter", 2, "--starts", 1, "--form", "regression"]
COLUMNS = ["--state", "demand", "--obs", "temperature"]


@pytest.mark.parametrize("kind", [[], ["--regimes", 1]])
@pytest.mark.parametrize(
    ("options", "units", "step"),
    [
        ([], {}, np.timedelta64(30, "m")),
        (["--time", "none"], {}, None),
        (
            ["--unit", "demand=GW", "--unit", "temperature=°C"],
            {"demand": "GW", "temperature": "°C"},
            np.timedelta64(30, "m"),
        ),
    ],
)
def test_fit_remembers_columns_units_and_step(options, units, step, kind, training, tmp_path) -> None:
    out = tmp_path / "model.json"
    result = run("fit", training, *COLUMNS, *QUICK, *kind, "-o", out, *options)
    assert result.exit_code == 0, result.output
    labels = load_model(out).labels
    assert labels == Labels(["demand"], ["temperature"], units, step)
    printed = " ".join(result.output.split())
    assert f"Learned {labels.with_unit('demand')} from {labels.with_unit('temperature')}, on 120" in printed
    # and filter asks for nothing more
    result = run("filter", out, training, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    zs = read_table(training).numbers("temperature")
    np.testing.assert_allclose(
        estimates(tmp_path / "out.csv")[:, 0], load_model(out).filter().filter(zs).x[:, 0]
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("GW", "--unit: got 'GW', expected COL=UNIT, such as demand=GW"),
        ("demand=", "--unit: got 'demand=', expected COL=UNIT"),
        ("wind=m/s", "--unit: got one of 'wind', expected a column of --state or --obs: demand, temperature"),
        ("demand=MW", "--unit: got 'GW' and 'MW' for 'demand', expected one"),
    ],
)
def test_units_of_nothing_are_refused_before_anything_is_learned(
    word, message, training, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(CGOFMSModel, "fit", None)
    result = run("fit", training, *COLUMNS, "--unit", "demand=GW", "--unit", word, "-o", tmp_path / "m.json")
    assert result.exit_code == 1
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "m.json").exists()

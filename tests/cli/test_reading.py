"""Files as they come in real life: what the commands make of their rows, their times and their separators."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from fuzzykf import OFSRFilter
from fuzzykf.cli.app import app
from fuzzykf.cli.compare_source import from_file
from fuzzykf.cli.output import say
from fuzzykf.cli.reading import Reading
from fuzzykf.errors import FileFormatError

TABLES = Path(__file__).parents[1] / "data" / "tables"
NAN = np.nan
Y = [0.5, -0.25, 1.5, 0.75, -1.0]
GAPS = [0.5, -0.25, NAN, 0.75, -1.0]


def run(*arguments: object):
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def model(fuzzy_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.json"
    fuzzy_model.save(path)
    return path


#: File, options, the observations that are in it, name and ends of the index, and what is noted.
READ = [
    ("plain", "", Y, ("time", "2014-01-06T00:00", "2014-01-06T04:00"), ""),
    ("plain", "--time none", Y, ("row", "0", "4"), ""),
    ("windows", "", Y, ("time", "2014-01-06T00:00", "2014-01-06T04:00"), ""),
    ("tabs", "", Y, ("time", "2014-01-06T00:00", "2014-01-06T04:00"), "cells are separated by tabs"),
    ("tabs", "--sep tab", Y, ("time", "2014-01-06T00:00", "2014-01-06T04:00"), ""),
    (
        "semicolons",
        "",
        Y,
        ("time", "2014-01-06T00:00", "2014-01-06T04:00"),
        "cells are separated by ';', decimals by ','",
    ),
    ("semicolons", "--sep ; --decimal ,", Y, ("time", "2014-01-06T00:00", "2014-01-06T04:00"), ""),
    ("index_times", "", Y, ("index", "2014-01-06 00:00:00+01:00", "2014-01-06 04:00:00+01:00"), ""),
    ("index_numbers", "", Y, ("index", "0", "4"), ""),
    # Rows without anything ask for a forecast, at the end or between others.
    ("empty_rows", "", [*GAPS, NAN, NAN], ("time", "2014-01-06T00:00", ""), ""),
    ("empty_rows_one_column", "", [*GAPS, NAN, NAN], ("row", "0", "6"), ""),
    ("blank_lines", "--index who", GAPS, ("who", "a", "e"), "line 4 is blank: it is taken for a row"),
    # Times in another form, with and without the format.
    ("us_dates", "--time-format %m/%d/%Y", Y, ("date", "03/27/2024", "03/31/2024"), ""),
    ("us_dates", "--time none", Y, ("row", "0", "4"), ""),
    (
        "us_dates",
        "--index date",
        Y,
        ("date", "03/27/2024", "03/31/2024"),
        "the times are not used: us_dates.csv, line 2",
    ),
    ("weekdays", "--index date", Y, ("date", "monday", "friday"), "the times are not used"),
    ("unix", "--time-format unix", Y, ("timestamp", "1396051200", "1396051204"), ""),
    (
        "unix_ms",
        "--time timestamp --time-format unix_ms",
        Y,
        ("timestamp", "1396051200000", "1396051200400"),
        "",
    ),
    # Steps that are equal are no reason for a note.
    ("tenths", "", Y, ("time", "2014-01-06T00:00:00.000", "2014-01-06T00:00:00.400"), ""),
    ("autumn_offsets", "", Y, ("time", "2014-10-26 01:00+01:00", "2014-10-26 02:00+00:00"), ""),
    ("spring_offsets", "", Y, ("time", "2014-03-30T00:00+01:00", "2014-03-30T05:00+02:00"), ""),
    ("months", "", Y, ("date", "2014-01-01", "2014-05-01"), ""),
    (
        "rows_missing",
        "",
        Y,
        ("time", "2014-01-06T00:00", "2014-01-06T06:00"),
        "2 rows are missing (column time, steps of 1:00:00): 2 after 2014-01-06T02:00; a model",
    ),
    ("reversed", "--time none --index time", Y, ("time", "2014-01-06T04:00", "2014-01-06T00:00"), ""),
]


@pytest.mark.parametrize(
    ("name", "options", "zs", "index", "note"), READ, ids=[f"{c[0]} {c[1]}" for c in READ]
)
def test_what_is_filtered_is_what_is_in_the_file(
    name, options, zs, index, note, model, fuzzy_model, tmp_path
) -> None:
    out = tmp_path / "out.csv"
    result = run("filter", model, TABLES / f"{name}.csv", "--obs", "y", "-o", out, *options.split())
    assert result.exit_code == 0, result.output
    with out.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[0] == index[0]
    assert (rows[0][0], rows[-1][0]) == index[1:]
    expected = OFSRFilter(fuzzy_model).filter(zs, keep_nodes=True)
    np.testing.assert_array_equal([float(row[1]) for row in rows], expected.x[:, 0])
    printed = " ".join(result.output.split())
    assert printed.count("Note: ") == (1 if note else 0), printed
    if note:
        assert f"Note: {note}" in printed


#: File, options, and why every command that reads rows refuses it (parts of what it says).
REFUSED = [
    (
        "us_dates",
        "",
        "us_dates.csv, line 2: date is '03/27/2024', expected a time as in 2014-01-31T16:30; say format="
        " ... --time none does not look at the times: rows are taken in the order in which they stand",
    ),
    ("us_dates", "--time date", "line 2: date is '03/27/2024', expected a time as in"),
    (
        "us_dates",
        "--time-format %d/%m/%Y",
        "line 2: date is '03/27/2024', expected a time in the format '%d/%m/%Y'",
    ),
    ("unix", "", "line 2: timestamp is '1396051200', expected a time as in"),
    ("weekdays", "", "line 2: date is 'monday', expected a time as in"),
    (
        "reversed",
        "",
        "line 3: time is '2014-01-06T03:00', not later than '2014-01-06T04:00' in the row before; --time",
    ),
    ("twice", "", "line 5: time is '2014-01-06T02:00', not later than '2014-01-06T02:00' in the row before"),
    (
        "autumn",
        "",
        "line 4: time is '2014-10-26 01:00', not later than '2014-10-26 01:30' in the row before; if clocks"
        " ... give one in every row",
    ),
    ("plain", "--time hour", "plain.csv has no column 'hour'; its columns are time, y"),
    (
        "plain",
        "--time none --time-format unix",
        "--time-format: got 'unix', but --time none leaves out all times",
    ),
    (
        "index_numbers",
        "--time-format unix",
        "index_numbers.csv has no column time, timestamp, datetime, date; name one",
    ),
    (
        "plain",
        "--time-format iso",
        "plain.csv, column time: got the format 'iso', expected 'unix', 'unix_ms', or",
    ),
    ("plain", "--sep 12", "sep: got '12', expected one character"),
    ("plain", "--decimal ;", "decimal: got ';', expected '.' or ','"),
    ("plain", "--sep ;", "has no column 'y'; its columns are time,y"),
    (
        "semicolons",
        "--decimal .",
        "line 2: y is '0,5', expected decimals after '.'; say decimal=',' (--decimal)",
    ),
    ("two_ways", "", "two_ways.csv: ',' and ';' cut all rows into as many cells ... (--sep and --decimal)"),
    (
        "point_and_comma",
        "",
        "numbers with decimals after a comma and such with decimals after a point; say which",
    ),
    ("underscores", "", "underscores.csv, line 3: y is '1_5', expected a number"),
    ("line_breaks", "", "line_breaks.csv, line 7: y is 'low', expected a number"),
]

#: The commands that read rows, without the file.
COMMANDS = {
    "filter": lambda model: ["filter", model, "--obs", "y"],
    "smooth": lambda model: ["smooth", model, "--obs", "y"],
    "forecast": lambda model: ["forecast", model, "--obs", "y", "--steps", "1"],
    "fit": lambda _: ["fit", "--state", "y", "--obs", "y2"],
    "compare": lambda _: ["compare", "--state", "y", "--obs", "y", "--switch", "clock"],
}


@pytest.mark.parametrize(("name", "options", "message"), REFUSED, ids=[f"{c[0]} {c[1]}" for c in REFUSED])
def test_what_cannot_be_read_is_refused_by_all_commands_alike(
    name, options, message, model, tmp_path
) -> None:
    for command in ("filter", "compare") if options else COMMANDS.keys() - {"fit"}:
        words = [*COMMANDS[command](model), TABLES / f"{name}.csv", *options.split()]
        result = run(*words, "--out" if command == "compare" else "-o", tmp_path / "out")
        assert result.exit_code == 1, (command, result.output)
        printed = " ".join(result.output.split())
        assert all(part in printed for part in message.split(" ... ")), (command, printed)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["us_dates", "reversed", "twice", "autumn"])
def test_fit_refuses_times_as_the_others_do(name, tmp_path) -> None:
    text = (TABLES / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    path = tmp_path / "two.csv"
    path.write_text("\n".join([text[0] + ",x", *(f"{line},1" for line in text[1:])]), encoding="utf-8")
    result = run("fit", path, "--state", "x", "--obs", "y", "-o", tmp_path / "model.json")
    assert result.exit_code == 1
    assert "expected a time as in" in result.output or "in the row before" in " ".join(result.output.split())
    # Without the times it is the rows that are too few.
    result = run("fit", path, "--state", "x", "--obs", "y", "-o", tmp_path / "model.json", "--time", "none")
    assert "hold 4 steps in which x and y are both measured" in " ".join(result.output.split())


def test_a_time_that_is_not_needed_stops_no_comparison() -> None:
    path = TABLES / "us_dates.csv"
    source = from_file(path, "y", "y", Reading(), needs_time=False)
    assert source.time is None
    assert source.notes[0].startswith("the times are not used: us_dates.csv, line 2: date is '03/27/2024'")
    assert from_file(path, "y", "y", Reading(time="none"), needs_time=False).notes == ()
    # Rows that are not in order are no matter of what is needed.
    with pytest.raises(FileFormatError, match="not later than"):
        from_file(TABLES / "reversed.csv", "y", "y", Reading(), needs_time=False)
    times = from_file(TABLES / "autumn_offsets.csv", "y", "y", Reading(), needs_time=True).time
    assert times.has_offsets


def test_the_packaged_data_are_read_as_they_are(tmp_path) -> None:
    for option in (["--time", "none"], ["--time-format", "unix"], ["--sep", ";"], ["--decimal", ","]):
        result = run("compare", *option, "--out", tmp_path / "out")
        assert result.exit_code == 1
        assert "the packaged data" in result.output


@pytest.mark.parametrize("command", COMMANDS)
def test_all_commands_that_read_rows_have_the_options(command) -> None:
    printed = run(command, "--help").output
    for option in ("--time", "--time-format", "--sep", "--decimal"):
        assert option in printed


NOT_FOUND = "no times were found, so steps were not compared; --time names the column"
ISO = [f"2014-01-06T{hour:02}:00" for hour in range(5)]

#: Name and cells of a first column, options, the note of a model that knows its step, and that of another.
UNFOUND = {
    "dates in a column of another name": ("when", ISO, "", f"{NOT_FOUND} (when holds times)", "same"),
    "some of them missing": ("Zeit", ["#N/A", *ISO[1:4], ""], "", f"{NOT_FOUND} (Zeit holds times)", "same"),
    "dates of another form": ("Zeit", [f"{k}.01.2014" for k in range(1, 6)], "", NOT_FOUND, None),
    "numbers": ("id", [f"2014010{k}" for k in range(1, 6)], "", NOT_FOUND, None),
    "all of them missing": ("when", [""] * 5, "", NOT_FOUND, None),
    "dates, which are named": ("when", ISO, "--time when", None, None),
    "dates, which are kept": ("when", ISO, "--index when", None, None),
    "dates, which are left alone": ("when", ISO, "--time none", None, None),
    "times where they are found": ("time", ISO, "", None, None),
}


@pytest.mark.parametrize("verb", ["filter", "smooth"])
@pytest.mark.parametrize("case", UNFOUND)
def test_times_that_were_not_found_are_noted_where_they_count(case, verb, fuzzy_model, tmp_path) -> None:
    name, cells, options, with_step, without = UNFOUND[case]
    rows = [f"{cell},{y}" for cell, y in zip(cells, Y, strict=True)]
    (tmp_path / "new.csv").write_text("\n".join([f"{name},y", *rows]))
    step = np.timedelta64(1, "h")
    for model, note in ((fuzzy_model.labelled(step=step), with_step), (fuzzy_model, without)):
        model.save(tmp_path / "m.json")
        words = [verb, tmp_path / "m.json", tmp_path / "new.csv", "--obs", "y", *options.split()]
        result = run(*words, "-o", tmp_path / "out.csv")
        assert result.exit_code == 0, result.output
        note = with_step if note == "same" else note
        notes = [line for line in result.output.splitlines() if line.startswith("Note: no times")]
        assert notes == ([] if note is None else [f"Note: {note}."])


def test_fit_and_compare_note_times_that_were_not_found(tmp_path) -> None:
    path = tmp_path / "data.csv"
    rng = np.random.default_rng(0)
    hours = np.datetime64("2014-01-01T00", "m") + np.arange(60) * np.timedelta64(60, "m")
    rows = [f"{hour},{x},{x + y}" for hour, (x, y) in zip(hours, rng.normal(size=(60, 2)), strict=True)]
    path.write_text("\n".join(["when,x,y", *rows]))
    note = f"{NOT_FOUND} (when holds times)"
    words = [
        "fit",
        path,
        "--state",
        "x",
        "--obs",
        "y",
        "--max-iter",
        1,
        "--starts",
        1,
        "--form",
        "regression",
    ]
    assert f"Note: {note}.\n" in run(*words, "-o", tmp_path / "m.json").output
    assert from_file(path, "x", "y", Reading(), needs_time=False).notes == (note,)
    for reading in (Reading(time="none"), Reading(time="when")):
        assert from_file(path, "x", "y", reading, needs_time=False).notes == ()


def test_notes_are_wrapped_on_terminals_alone() -> None:
    sentence = " ".join(["a note of many words"] * 9) + "."
    for terminal in (False, True):
        text = io.StringIO()
        say(Console(file=text, width=80, force_terminal=terminal, color_system=None), sentence)
        lines = text.getvalue().splitlines()
        assert (len(lines) > 1) == terminal
        assert " ".join(" ".join(lines).split()) == sentence

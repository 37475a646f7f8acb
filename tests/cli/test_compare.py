"""``fuzzykf compare`` writes what it prints, and refuses bad input with the reason and no file."""

from __future__ import annotations

import csv
import io
import re
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from fuzzykf import datasets
from fuzzykf.__main__ import main
from fuzzykf.cli.app import app
from fuzzykf.comparison import run as comparison_run
from fuzzykf.comparison.candidates import boosting, switching
from fuzzykf.comparison.run import RIVALS
from fuzzykf.datasets import Weather, load_weather
from fuzzykf.switching.learning import filter_training
from fuzzykf.switching.learning.filter_training import MOST

ALL_METHODS = [
    "OFSRFilter",
    "CGOMSMFilter",
    "CGOMSMFilter, no memory of the state",
    "CGOMSMFilter, filter-trained",
    "FilterPool, clock and features",
    "IMMEstimator",
    "KalmanFilter (filterpy)",
    "linear regression",
    "regression with lags",
    "piecewise-linear with lags",
    "gradient boosting with lags",
    "mean of the time of day",
]
REGRESSIONS = ALL_METHODS[7:]

#: Three that take as long as all others together; they run where all are compared.
LONG = {
    "hard2-filter": "CGOMSMFilter, filter-trained",
    "pool-inputs": "FilterPool, clock and features",
    "boosting": "gradient boosting with lags",
}
METHODS = [title for title in ALL_METHODS if title not in LONG.values()]


@pytest.fixture(autouse=True, scope="module")
def _without_the_long_ones():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison_run, "RIVALS", tuple(name for name in RIVALS if name not in LONG))
        yield


def only(monkeypatch, *rivals: str) -> None:
    """Compare the fuzzy filter with filterpy's and these alone."""
    monkeypatch.setattr(comparison_run, "RIVALS", ("kalman", *rivals))


def run(*arguments: object):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)], env={"COLUMNS": "100"})


def quick(path, *arguments: object):
    """Compare on a file, with the switch from the clock: nothing hidden has to be learned."""
    return run(path, "--state", "load", "--obs", "temperature", "--switch", "clock", "--folds", 2, *arguments)


HOURS = 240


@pytest.fixture(scope="module")
def rows() -> list[list[str]]:
    """Ten days of hours: a load that follows the temperature, differently by day and by night."""
    rng = np.random.default_rng(0)
    hour = np.arange(HOURS)
    day = np.clip(1.5 * np.sin(2 * np.pi * (hour - 9) / 24), -1, 1)
    temperature = np.convolve(rng.normal(size=HOURS + 4), np.ones(5), "valid") + 15 + 3 * day
    load = (1.0 + 0.5 * day) * (temperature - 15) + 10 + 2 * day + 0.3 * rng.normal(size=HOURS)
    time = np.datetime64("2014-01-06T00:00", "m") + hour * np.timedelta64(60, "m")
    return [[str(t), f"{x:.5f}", f"{y:.5f}", "ok"] for t, x, y in zip(time, load, temperature, strict=True)]


HEADER = ("time", "load", "temperature", "remark")


def written(path, rows, header=HEADER):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])
    return path


@pytest.fixture
def plain(monkeypatch):
    """Draw an empty picture, where nobody looks at it: those of `compared` are drawn."""
    draw = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *more, **named: draw(Figure(), *more, **named))


@pytest.fixture
def write(tmp_path, rows, plain):
    """Write a file of one's own, without its picture."""

    def write(rows=rows, header=HEADER, name="data.csv"):
        return written(tmp_path / name, rows, header)

    return write


@pytest.fixture(scope="module")
def compared(rows, tmp_path_factory):
    """What the plain comparison says, and its folder, in which there were results before."""
    out = tmp_path_factory.mktemp("compared")
    (out / "comparison.csv").write_text("old")
    return quick(written(tmp_path_factory.mktemp("data") / "data.csv", rows), "--out", out), out


def table_of(path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# ------------------------------------------------------------------ what it does


def test_it_prints_the_table_it_writes_with_a_picture_and_a_verdict(write, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(comparison_run, "RIVALS", RIVALS)
    trees, threads = boosting._library()
    monkeypatch.setattr(boosting, "_library", lambda: (partial(trees, max_iter=5), threads))
    out = tmp_path / "out"
    result = quick(write(), "--out", out)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == ["comparison.csv", "comparison.png"]
    table = table_of(out / "comparison.csv")
    assert [row["method"] for row in table] == ALL_METHODS
    for row in table:
        rmse, low, high = (float(row[name]) for name in ("rmse", "rmse_low", "rmse_high"))
        assert 0 < low <= rmse <= high
        assert 0 <= float(row["coverage_90"]) <= 1
        assert float(row["microseconds_per_step"]) > 0
        assert np.isfinite([float(row["log_score"]), float(row["normal_log_score"])]).all()
        mixes = row["method"] not in [*REGRESSIONS, "KalmanFilter (filterpy)"]
        assert row["density"] == ("mixture" if mixes else "normal")
        assert (float(row["log_score"]) == pytest.approx(float(row["normal_log_score"]))) == (not mixes)
        assert float(row["log_score_standard_error"]) > 0
        assert float(row["log_score_low"]) < float(row["log_score"]) < float(row["log_score_high"])
        assert f"{float(row['log_score']):.3f}" in result.output
        assert (row["log_likelihood_per_step"] == "") == (row["method"] in REGRESSIONS)
        assert f"{rmse:.4g}" in result.output
    assert "…" not in result.output  # no name is cut at the 80 columns of a plain terminal
    best = min(table, key=lambda row: float(row["rmse"]))["method"]
    printed = " ".join(result.output.split())
    assert f"{best} has the lowest RMSE" in printed
    assert re.search(r"has the lowest RMSE, .* behind \(95 % .*\): (not )?a significant difference", printed)
    assert re.search(r"has the highest log score, .* behind \(95 % .*\): (not )?a significant dif", printed)
    assert re.search(r"Baseline \(training mean\): RMSE [\d.]+\.", printed)
    assert re.search(r"lags: \d+ \(chosen from 0-\d+ on 3 rolling blocks", printed)
    assert "regressions define no likelihood" in printed
    assert "Trained on at least 120 rows, tested on 120 in 2 folds, from 2014-01-11T00:00; trained" in printed
    assert "Switch: the clock, 0 from" in printed
    assert (out / "comparison.png").read_bytes().startswith(b"\x89PNG\r\n")


def test_the_errors_in_the_table_are_those_of_the_rows_that_were_held_back(
    write, rows, tmp_path, monkeypatch
) -> None:
    # Oracle: the regression row of the table, computed here from the file.
    only(monkeypatch, "line")
    result = quick(write(), "--out", tmp_path / "out", "--folds", 1, "--train", 0.7)
    assert result.exit_code == 0, result.output
    x, y = np.array([[float(r[1]), float(r[2])] for r in rows]).T
    line = np.polyfit(y[:168], x[:168], 1)
    expected = np.sqrt(np.mean((np.polyval(line, y[168:]) - x[168:]) ** 2))
    (found,) = (
        r for r in table_of(tmp_path / "out" / "comparison.csv") if r["method"] == "linear regression"
    )
    assert float(found["rmse"]) == pytest.approx(expected)


def test_the_seed_decides_the_intervals_and_nothing_else_whatever_processes_share_it(
    compared, write, tmp_path
) -> None:
    path, folders = write(), [compared[1]]
    for name, seed, jobs in (("b", 0, 2), ("c", 2, 1)):
        folders.append(tmp_path / name)
        quick(path, "--out", folders[-1], "--seed", seed, "--jobs", jobs)
    tables = [table_of(folder / "comparison.csv") for folder in folders]
    a, b, c = ([{**row, "microseconds_per_step": ""} for row in table] for table in tables)
    assert a == b
    assert [row["rmse"] for row in a] == [row["rmse"] for row in c]
    assert [row["rmse_low"] for row in a] != [row["rmse_low"] for row in c]


def test_the_switch_is_learned_and_its_law_chosen_unless_it_is_said_how(
    write, rows, tmp_path, monkeypatch
) -> None:
    only(monkeypatch, "hard2", "line")
    common = [write(rows[:168]), "--state", "load", "--obs", "temperature", "--nodes", 0]
    common += ["--folds", 1, "--train", 0.65]
    result = run(*common, "--out", tmp_path / "auto")
    assert result.exit_code == 0, result.output
    printed = " ".join(result.output.split())
    assert "Switch: hidden, learned with each model." in printed
    law = re.search(r"OFSRFilter: law: (fmc1|fmc2|free|fade) \(chosen from [\w, ]+ on 3 rolling", printed)
    assert law
    # The law that was chosen gives the same by name.
    run(*common, "--law", law[1], "--out", tmp_path / "named")
    tables = [table_of(tmp_path / name / "comparison.csv") for name in ("auto", "named")]
    assert [row["rmse"] for row in tables[0]] == [row["rmse"] for row in tables[1]]


def test_without_a_column_of_times_the_observation_can_make_the_switch(write, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "daily-profile")
    path = write(header=("row", "load", "temperature", "remark"))
    result = quick(path, "--switch", "quantiles", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "Switch: the observation, 0 below" in " ".join(result.output.split())
    assert [row["method"] for row in table_of(tmp_path / "out" / "comparison.csv")] == [
        "OFSRFilter",
        "KalmanFilter (filterpy)",
    ]


def test_a_column_of_times_can_be_named_and_the_profile_taken_away(write, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "daily-profile")
    path = write(header=("When", "load", "temperature", "remark"))
    common = [path, "--time", "When", "--profile", "--train", 0.6]
    result = quick(*common, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "load, less its daily profile" in result.output


def test_a_column_of_working_days_counts_more_than_the_calendar(write, rows, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "daily-profile")
    tables = []
    for name, workday in (("a", lambda k: "1"), ("b", lambda k: str(k // 24 % 2))):
        path = write(
            [[*cells, workday(k)] for k, cells in enumerate(rows)],
            ("time", "load", "temperature", "remark", "workday"),
        )
        quick(path, "--profile", "--out", tmp_path / name)
        tables.append([row["rmse"] for row in table_of(tmp_path / name / "comparison.csv")])
    assert tables[0] != tables[1]


def test_the_number_of_nodes_concerns_the_fuzzy_filter_alone(compared, write, tmp_path) -> None:
    quick(write(), "--nodes", 0, "--out", tmp_path / "out")
    folders = (compared[1], tmp_path / "out")
    usual, few = ([row["rmse"] for row in table_of(folder / "comparison.csv")] for folder in folders)
    assert usual[0] != few[0]
    assert usual[1:] == few[1:]


def test_notes_are_printed_with_the_name_of_the_method(write, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "hard2", "line")
    monkeypatch.setattr(switching, "growth_notes", lambda system: [f"it has {len(system.chain.nodes)} nodes"])
    result = quick(write(), "--out", tmp_path / "out")
    assert "Note on OFSRFilter (last fold): it has 7 nodes." in result.output
    assert "Note on CGOMSMFilter (last fold): it has 2 nodes." in result.output


def test_further_candidates_are_compared_by_their_names(write, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "regression")
    path = write()
    result = quick(path, "--also", "hard1", "--also", "regression", "--out", tmp_path / "twice")
    assert result.exit_code == 1
    assert "each name once" in " ".join(result.output.split())
    result = quick(path, "--also", "hard4x", "--out", tmp_path / "unknown")
    assert "candidates: got 'hard4x', expected names of hard1, hard2" in " ".join(result.output.split())
    assert list(tmp_path.iterdir()) == [path]
    result = quick(path, "--law", "fmc1", "--also", "hard1", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    methods = [row["method"] for row in table_of(tmp_path / "out" / "comparison.csv")]
    assert methods == ["OFSRFilter", "KalmanFilter (filterpy)", "regression with lags", "CGOMSMFilter, K = 1"]
    result = quick(path, "--also", "no-such", "--jobs", 0, "--out", tmp_path / "none")
    assert result.exit_code == 2


def test_a_terminal_that_knows_ascii_only_gets_its_table(write, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "line")
    common = ["--state", "load", "--obs", "temperature", "--switch", "clock", "--folds", "2"]
    monkeypatch.setattr(
        sys, "argv", ["fuzzykf", "compare", str(write()), *common, "--out", str(tmp_path / "o")]
    )
    said = {name: io.TextIOWrapper(io.BytesIO(), encoding="ascii") for name in ("stdout", "stderr")}
    for name, stream in said.items():
        monkeypatch.setattr(sys, name, stream)
    with pytest.raises(SystemExit) as end:
        main()
    for stream in said.values():
        stream.flush()
    assert not end.value.code, said["stderr"].buffer.getvalue()
    assert b"has the lowest RMSE" in said["stdout"].buffer.getvalue()


def test_earlier_results_are_replaced(compared) -> None:
    result, out = compared
    assert result.exit_code == 0
    assert table_of(out / "comparison.csv")[0]["method"] == "OFSRFilter"
    assert len(list(out.iterdir())) == 2


# ------------------------------------------------------------------ the packaged data


def test_without_a_file_it_runs_on_the_packaged_data(plain, tmp_path, monkeypatch) -> None:
    # With a switch by a rule nothing hidden has to be learned.
    only(monkeypatch, "line")
    result = run("--switch", "quantiles", "--folds", 2, "--jobs", 1, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    printed = " ".join(result.output.split())
    assert "Victoria, 2014, hourly means: demand, less its daily profile" in printed
    assert "Trained on at least 4,380 rows, tested on 4,380 in 2 folds, from 2014-07-02T12:00" in printed
    assert " GW" in printed
    table = table_of(tmp_path / "out" / "comparison.csv")
    assert [row["method"] for row in table] == ["OFSRFilter", "KalmanFilter (filterpy)", "linear regression"]


#: Of the weather: a gap in the part to learn on, and one in the other.
HOURS_OF_WEATHER = slice(1180, 1540)


def test_a_lost_humidity_sensor_is_restored_from_the_temperature_across_gaps(
    plain, tmp_path, monkeypatch
) -> None:
    w = load_weather()
    short = Weather(**{name: values[HOURS_OF_WEATHER] for name, values in vars(w).items()})
    monkeypatch.setattr(datasets, "load_weather", lambda: short)
    only(monkeypatch, "line", "daily-profile")
    options = ["--folds", 1, "--nodes", 0, "--law", "fmc1", "--against", "line", "--against", "hard1"]
    result = run("--data", "weather", *options, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    printed = " ".join(result.output.split())
    assert "New York (JFK), 2013, hourly weather: relative humidity" in printed
    assert "less its daily profile" not in printed
    assert "tested on 180, from 2013-02-26T17:00" in printed  # standard time of New York
    table = table_of(tmp_path / "out" / "comparison.csv")
    titles = ["OFSRFilter", "KalmanFilter (filterpy)", "linear regression", "mean of the time of day"]
    assert [row["method"] for row in table] == [*titles, "CGOMSMFilter, K = 1"]
    # Oracle: the line through the rows of which something is known, judged on such rows.
    x, y = short.humidity, short.temperature
    assert [np.isnan(part).sum() for part in (x[:180], y[:180], x[180:], y[180:])] == [1, 1, 1, 1]
    known = np.isfinite(x)
    line = np.polyfit(y[:180][known[:180]], x[:180][known[:180]], 1)
    missed = (np.polyval(line, y) - x)[180:][known[180:]]
    assert float(table[2]["rmse"]) == pytest.approx(np.sqrt(np.mean(missed**2)))
    # The winner beside each rival that was chosen.
    best = min(table, key=lambda row: float(row["rmse"]))
    for row in (table[2], table[4]):
        behind = float(row["rmse"]) - float(best["rmse"])
        told = f"is {behind:.2g} % behind {best['method']} on RMSE" if behind else "has the lowest RMSE"
        assert f"{row['method']} {told}" in printed
    assert re.search(
        r"on log score [\d.]+ behind .* \(95 % interval .* to .*\): (not )?a significant", printed
    )


def test_a_file_and_packaged_data_are_one_too_many(write, tmp_path) -> None:
    refused(tmp_path, write(), "--data", "weather", message="--data: got weather beside the file")
    assert run("--data", "climate", "--out", tmp_path / "out").exit_code == 2


@pytest.mark.study
def test_the_page_tells_what_comes_out_on_the_packaged_data(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(comparison_run, "RIVALS", RIVALS)
    monkeypatch.setattr(filter_training, "MOST", MOST)
    result = run("--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    table = table_of(tmp_path / "out" / "comparison.csv")
    page = (Path(__file__).parents[2] / "docs" / "howto" / "compare.md").read_text(encoding="utf-8")
    told = re.findall(
        r"^\| ([^|]+) \| ([\d.]+) \| ([\d.]+)–([\d.]+) \| (\d+) % \| (-?[\d.]+) \| [^|]+ \|$",
        page,
        re.MULTILINE,
    )
    assert [row[0] for row in told] == ALL_METHODS
    for row, (_, *numbers, coverage, log_score) in zip(table, told, strict=True):
        assert float(row["log_score"]) == pytest.approx(float(log_score), abs=0.006)
        found = [float(row[name]) for name in ("rmse", "rmse_low", "rmse_high")]
        np.testing.assert_allclose(found, np.array(numbers, dtype=float), rtol=0.005)
        assert float(row["coverage_90"]) == pytest.approx(float(coverage) / 100, abs=0.006)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--state", "wind"],
            "--state: the packaged data have no column 'wind'; their columns are demand_gw",
        ),
        (["--obs", "wind"], "--obs: the packaged data have no column 'wind'"),
        (["--time", "time"], "--time: the packaged data bring their own times"),
    ],
)
def test_what_the_packaged_data_do_not_have_is_refused(arguments, message, tmp_path) -> None:
    result = run(*arguments, "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert message in result.output
    assert not (tmp_path / "out").exists()


# ------------------------------------------------------------------ bad input


def refused(tmp_path, path, *arguments, message: str) -> None:
    common = [] if "--state" in arguments else ["--state", "load", "--obs", "temperature"]
    result = run(path, *common, *arguments, "--out", tmp_path / "out")
    assert result.exit_code == 1, result.output
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not (tmp_path / "out").exists()


def changed(rows, row, column, text):
    copy = [list(cells) for cells in rows]
    copy[row][column] = text
    return copy


def test_a_missing_file_is_named(tmp_path) -> None:
    refused(tmp_path, tmp_path / "none.csv", message="none.csv: No such file or directory")


def test_a_folder_in_the_place_of_the_file_is_named(tmp_path) -> None:
    result = run(tmp_path, "--state", "a", "--obs", "b", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert str(tmp_path) in result.output.replace("\n", "")


def test_a_column_that_is_not_there_is_answered_with_those_that_are(write, tmp_path) -> None:
    refused(
        tmp_path,
        write(),
        "--state",
        "power",
        "--obs",
        "load",
        message="data.csv has no column 'power'; its columns are time, load, temperature, remark",
    )
    refused(tmp_path, write(), "--time", "hour", message="data.csv has no column 'hour'")


def test_columns_that_are_not_named_are_asked_for(write, tmp_path) -> None:
    for arguments, missing in (([], "--state"), (["--state", "load"], "--obs")):
        result = run(write(), *arguments, "--out", tmp_path / "out")
        assert result.exit_code == 1
        assert f"{missing}: name a column of data.csv; its columns are time, load" in result.output


def test_text_in_a_column_is_named_with_its_line(write, rows, tmp_path) -> None:
    refused(
        tmp_path,
        write(changed(rows, 40, 1, "high")),
        message="data.csv, line 42: load is 'high', expected a number",
    )
    refused(
        tmp_path,
        write(),
        "--state",
        "remark",
        "--obs",
        "load",
        message="line 2: remark is 'ok', expected a number",
    )


def test_empty_cells_are_gaps(write, rows, tmp_path) -> None:
    gaps = changed(changed(rows, 40, 2, ""), 150, 1, "")
    result = quick(write(gaps), "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    table = table_of(tmp_path / "out" / "comparison.csv")
    assert [row["method"] for row in table] == METHODS
    assert all(float(row["rmse"]) > 0.0 for row in table)


def test_times_that_cannot_be_read_or_go_back_are_named(write, rows, tmp_path) -> None:
    noon = write(changed(rows, 3, 0, "noon"))
    for needs in (["--switch", "clock"], ["--profile"], ["--time", "time"]):  # else a note says it
        refused(tmp_path, noon, *needs, message="line 5: time is 'noon', expected a time as in")
    refused(
        tmp_path, write(changed(rows, 3, 0, "2013-12-31")), message="line 5: time is '2013-12-31', not later"
    )


def test_too_few_rows_are_refused_with_their_numbers(write, rows, tmp_path) -> None:
    refused(
        tmp_path, write(rows[:30]), message="train: 0.5 of 30 rows are 15 to learn on and 15 to compare on"
    )


@pytest.mark.parametrize("fraction", ["0", "1", "1.5", "-0.2", "nan"])
def test_a_fraction_outside_0_to_1_is_refused(fraction, write, tmp_path) -> None:
    refused(tmp_path, write(), f"--train={fraction}", message="expected a share between 0 and 1")


def test_a_fraction_that_is_no_number_is_a_mistake_of_usage(write) -> None:
    result = run(write(), "--state", "load", "--obs", "temperature", "--train", "half")
    assert result.exit_code == 2
    assert "--train" in result.output
    assert "as a number" in " ".join(result.output.split())


def test_a_constant_column_is_refused(write, rows, tmp_path) -> None:
    constant = [[t, "3", y, remark] for t, _, y, remark in rows]
    refused(tmp_path, write(constant), message="--state load: it is 3 in all 120 rows to learn on")


def test_a_state_that_ends_early_is_refused_with_the_way_out(write, rows, tmp_path) -> None:
    half = len(rows) // 2
    early = [[t, x if k < half + 9 else "", *more] for k, (t, x, *more) in enumerate(rows)]
    refused(
        tmp_path,
        write(early),
        message=f"--state load: 9 held-out states are known of those after row {half}, expected at least 50; "
        f"the last known one is in row {half + 9} of {len(rows)}: leave out the rows behind it, or learn",
    )


def test_a_file_in_the_place_of_the_folder_is_refused_and_kept(write, tmp_path) -> None:
    (tmp_path / "out").write_text("mine")
    result = run(write(), "--state", "load", "--obs", "temperature", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert "expected a folder, found a file" in result.output
    assert (tmp_path / "out").read_text() == "mine"


def test_without_filterpy_it_names_the_extra_and_writes_nothing(write, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "filterpy.kalman", None)
    refused(tmp_path, write(), message="the comparison needs filterpy: pip install 'fuzzykf[compare]'")

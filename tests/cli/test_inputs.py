"""Inputs on the command line: found by their names, made of the times, told of the steps ahead."""

from __future__ import annotations

import csv
from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fuzzykf import CGOFMSModel, CGOMSModel, InputColumns, WindowFeatures, clock_inputs, engine
from fuzzykf.cli.app import app
from fuzzykf.io import load_model, model_to_dict

N, AHEAD = 200, 6
START = datetime(2014, 1, 6)
QUICK = ["--regimes", "1", "--starts", "1", "--max-iter", "3"]


def run(*arguments: object):
    result = CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "300"})
    return result, " ".join(result.output.split())


@pytest.fixture(scope="module")
def table():
    """Hours of more than a week, with what drives them; the last rows are the steps ahead."""
    rng = np.random.default_rng(5)
    n = N + AHEAD
    time = pd.Series([START + timedelta(hours=k) for k in range(n)])
    clock, wind = clock_inputs(time, harmonics=1), rng.normal(size=n)
    t = np.cumsum(rng.normal(size=n)) * 0.2 + 3.0 * clock["clock_sin1"].to_numpy()
    load = 0.5 * t + clock["clock_cos1"].to_numpy() + wind + 0.2 * rng.normal(size=n)
    stamps = [one.isoformat(timespec="minutes") for one in time]
    return pd.DataFrame({"time": stamps, "load": load, "t": t, "wind": wind})


@pytest.fixture
def write(table, tmp_path):
    def write(name="data.csv", rows=slice(0, N), columns=("time", "load", "t", "wind"), **cells):
        frame = table.iloc[rows][list(columns)].assign(**cells)
        frame.to_csv(tmp_path / name, index=False)
        return tmp_path / name

    return write


@pytest.fixture(scope="module")
def models(table):
    """A fuzzy model with a clock and the wind, hard ones with the clock alone and with nothing, of hours."""
    learned = table[:N]
    clock = clock_inputs(learned["time"], harmonics=1, workday=True)
    x, y = learned["load"], learned["t"]
    options = {"n_starts": 1, "max_iter": 3}
    inputs = {"clock": clock, "both": clock.assign(wind=learned["wind"])}
    found = {
        "clock": CGOMSModel.fit(x, y, n_regimes=2, inputs=inputs["clock"], **options).model,
        "both": CGOFMSModel.fit(x, y, n_nodes=1, inputs=inputs["both"], **options).model,
        "plain": CGOMSModel.fit(x, y, n_regimes=2, **options).model,
    }
    return {name: model.labelled(step=np.timedelta64(1, "h")) for name, model in found.items()}


@pytest.fixture
def saved(models, tmp_path):
    for name, model in models.items():
        model.save(tmp_path / f"{name}.json")
    return {name: tmp_path / f"{name}.json" for name in models}


def told(table, rows, model):
    """Inputs of rows, made without the command line."""
    clock = clock_inputs(table["time"], harmonics=1, workday=True).assign(wind=table["wind"])
    return clock[list(model.form.inputs)].to_numpy()[rows] if hasattr(model.form, "inputs") else None


def cells(path):
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(found, *names):
    return np.array([[float(cell) if cell else np.nan for cell in found[name]] for name in names]).T


# --------------------------------------------------------------------------- fit


def test_fit_learns_what_the_library_learns_with_inputs_and_features(write, table, tmp_path) -> None:
    out = tmp_path / "model.json"
    words = "--state load --obs t --inputs wind --clock --harmonics 1 --order 2 --blocks 3,4 --hinges 2"
    result, printed = run("fit", write(), *words.split(), "--products", "--train", 0.8, *QUICK, "-o", out)
    assert result.exit_code == 0, printed
    n = round(0.8 * N)
    clock = clock_inputs(table["time"], harmonics=1, workday=True)
    names = ["wind", *clock.columns]
    fit = CGOMSModel.fit(
        table["load"][:n],
        table["t"][:n],
        n_regimes=1,
        n_starts=1,
        max_iter=3,
        inputs=clock.assign(wind=table["wind"])[names][:n],
        features=WindowFeatures(order=2, blocks=(3, 4), hinges=2, products=True),
    )
    model = load_model(out)
    assert model_to_dict(model) == model_to_dict(fit.model.labelled(step=np.timedelta64(1, "h")))
    assert f"Inputs: {', '.join(names)}." in printed
    assert "Features: order=2, blocks=(3, 4), hinges=2, products=True." in printed
    # Oracle: the filter on the rows after these, begun 100 rows earlier.
    us = clock.assign(wind=table["wind"])[names].to_numpy()
    x = model.filter().filter(table["t"].to_numpy()[n - 100 : N], us=us[n - 100 : N]).x[100:, 0]
    rmse = np.sqrt(np.mean((x - table["load"][n:N]) ** 2))
    assert f"RMSE {rmse:.4g};" in printed


def test_fit_takes_the_column_workday_for_working_days(write, tmp_path) -> None:
    path = write(workday=(np.arange(N) // 24 % 3 == 0).astype(int))
    words = ["--state", "load", "--obs", "t", "--clock", "--harmonics", 0]
    result, printed = run("fit", path, *words, *QUICK, "-o", tmp_path / "model.json")
    assert result.exit_code == 0, printed
    assert "Inputs: workday." in printed


@pytest.mark.skipif(engine.info().name == "numpy", reason="five fits for the filter take long on NumPy")
def test_fit_prints_how_features_score_and_takes_the_best(write, tmp_path) -> None:
    words = "--state load --obs t --inputs wind --features auto --objective filter"
    result, printed = run("fit", write(), *words.split(), *QUICK, "-o", tmp_path / "model.json")
    assert result.exit_code == 0, printed
    told = printed.partition("Log score on validation states, by features: ")[2].partition(". Law")[0]
    scores = {one.rpartition(" ")[0]: float(one.rpartition(" ")[2]) for one in told.split("; ")}
    assert "none" in scores
    assert len(scores) == 5
    best = max(scores, key=lambda name: scores[name])
    features = load_model(tmp_path / "model.json").form.features
    assert repr(features) == f"WindowFeatures({'' if best == 'none' else best})"


# --------------------------------------------------------------------------- filter, smooth


@pytest.mark.parametrize("name", ["clock", "both"])
@pytest.mark.parametrize("verb", ["filter", "smooth"])
def test_columns_are_found_by_name_and_those_of_a_clock_made(
    verb, name, write, models, saved, table, tmp_path
) -> None:
    rows = slice(N - 30, N)
    data = write("new.csv", rows, ("wind", "t", "time"))
    result, printed = run(verb, saved[name], data, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, printed
    f = models[name].filter()
    zs = table["t"].to_numpy()[rows]
    expected = getattr(f, verb)(zs, us=told(table, rows, models[name]))
    found = numbers(cells(tmp_path / "out.csv"), "x", "x_std")
    np.testing.assert_allclose(found[:, 0], expected.x[:, 0], rtol=1e-11)
    np.testing.assert_allclose(found[:, 1], np.sqrt(expected.P[:, 0, 0]), rtol=1e-9)


def test_a_column_that_is_there_is_not_made_again(write, models, saved, table, tmp_path) -> None:
    zeros = dict.fromkeys(models["clock"].form.inputs, 0.0)
    data = write("new.csv", slice(0, 20), ("t",), **zeros)  # and there are no times
    result, printed = run("filter", saved["clock"], data, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, printed
    expected = models["clock"].filter().filter(table["t"].to_numpy()[:20], us=np.zeros((20, len(zeros))))
    np.testing.assert_allclose(numbers(cells(tmp_path / "out.csv"), "x"), expected.x, rtol=1e-11)


# --------------------------------------------------------------------------- forecast


@pytest.mark.parametrize("name", ["plain", "clock", "both"])
def test_forecast_goes_on_after_the_last_row(name, write, models, saved, table, tmp_path) -> None:
    rows, ahead = slice(N - 30, N), slice(N, N + AHEAD)
    words = ["--steps", AHEAD] if name != "both" else ["--inputs-ahead", write("a.csv", ahead, ("wind",))]
    result, printed = run("forecast", saved[name], write("d.csv", rows), *words, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, printed
    assert f"Forecast {AHEAD} steps after 30 rows of d.csv." in printed
    found = cells(tmp_path / "out.csv")
    assert found["time"] == table["time"].tolist()[ahead]
    f, zs = models[name].filter(), table["t"].to_numpy()
    us = [told(table, part, models[name]) for part in (rows, ahead)]
    f.filter(zs[rows], **({} if us[0] is None else {"us": us[0]}))
    expected = f.forecast(AHEAD, **({} if us[1] is None else {"us": us[1]}))
    names = ["x", "x_std", "z_prior", "z_prior_std"]
    oracle = [
        expected.x[:, 0],
        expected.P[:, 0, 0] ** 0.5,
        expected.z_prior[:, 0],
        expected.S[:, 0, 0] ** 0.5,
    ]
    np.testing.assert_allclose(numbers(found, *names), np.array(oracle).T, rtol=1e-9)
    # Rows of empty cells at the end ask for the same: of intervals and the switch, too.
    both = write("both.csv", slice(N - 30, N + AHEAD), t=[*zs[rows], *[np.nan] * AHEAD])
    assert run("filter", saved[name], both, "-o", tmp_path / "filtered.csv")[0].exit_code == 0
    filtered = cells(tmp_path / "filtered.csv")
    del filtered["log_likelihood"]
    assert list(found) == [*filtered, "z_prior", "z_prior_std"]
    same = [one for one in filtered if one != "time"]
    np.testing.assert_allclose(numbers(found, *same), numbers(filtered, *same)[30:], rtol=1e-9)


def test_times_ahead_keep_their_offset_and_rows_without_times_are_numbered(write, saved, tmp_path) -> None:
    stamps = [(START + timedelta(hours=k)).isoformat(timespec="minutes") + "+11:00" for k in range(30)]
    data = write("d.csv", slice(0, 30), ("t",), time=stamps)
    run("forecast", saved["plain"], data, "-n", 2, "-o", tmp_path / "out.csv")
    assert cells(tmp_path / "out.csv")["time"] == ["2014-01-07T06:00+11:00", "2014-01-07T07:00+11:00"]
    run("forecast", saved["plain"], data, "-n", 2, "--time", "none", "-o", tmp_path / "out.csv")
    assert cells(tmp_path / "out.csv")["step"] == ["1", "2"]
    one = write("one.csv", slice(0, 1), ("time", "t"))  # the model knows how far rows are apart
    run("forecast", saved["clock"], one, "-n", 1, "-o", tmp_path / "out.csv")
    assert cells(tmp_path / "out.csv")["time"] == ["2014-01-06T01:00"]


def test_the_file_of_the_inputs_ahead_knows_when_clocks_are_changed(
    write, models, saved, table, tmp_path
) -> None:
    stamps = [
        f"2014-10-26T0{hour}:00+0{offset}:00" for hour, offset in ((0, 2), (1, 2), (2, 2), (2, 1), (3, 1))
    ]
    data = write("d.csv", slice(0, 3), ("t", "wind"), time=stamps[:3])
    ahead = write("a.csv", slice(3, 5), ("wind",), time=stamps[3:])
    result, printed = run(
        "forecast", saved["both"], data, "--inputs-ahead", ahead, "-o", tmp_path / "out.csv"
    )
    assert result.exit_code == 0, printed
    found = cells(tmp_path / "out.csv")
    assert found["time"] == stamps[3:]
    names, model, zs = models["both"].form.inputs, models["both"], table["t"].to_numpy()
    us = clock_inputs(stamps, harmonics=1, workday=True).to_numpy()  # of a Sunday: hours 0, 1, 2, 2, 3
    us = InputColumns(names, np.c_[us, table["wind"][:5]])
    f = model.filter()
    f.filter(zs[:3], us=us[:3])
    np.testing.assert_allclose(numbers(found, "x"), f.forecast(2, us=us[3:]).x, rtol=1e-9)


# --------------------------------------------------------------------------- simulate


def test_simulate_draws_with_the_inputs_of_a_file(write, models, saved, table, tmp_path) -> None:
    data, out = write("d.csv", slice(0, 30), ("time", "wind")), tmp_path / "out.csv"
    result, printed = run("simulate", saved["both"], "--inputs-from", data, "--seed", 3, "-n", 20, "-o", out)
    assert result.exit_code == 0, printed
    rows, model = slice(0, 20), models["both"]
    expected = model.simulate(20, np.random.default_rng(3), us=told(table, rows, model))
    found = cells(out)
    assert list(found) == ["time", "switch", "load", "t", "wind"]
    np.testing.assert_allclose(numbers(found, "load", "t"), np.c_[expected.x, expected.y], rtol=1e-12)
    result, printed = run("filter", saved["both"], out, "-o", tmp_path / "filtered.csv")
    assert result.exit_code == 0, printed  # it has all that a filter needs


def test_simulate_makes_a_clock_from_a_time_on(models, saved, table, tmp_path) -> None:
    out = tmp_path / "out.csv"
    words = ["--start", START.isoformat(), "-n", 20, "--seed", 3, "-o", out]
    result, printed = run("simulate", saved["clock"], *words)
    assert result.exit_code == 0, printed
    model = models["clock"]
    expected = model.simulate(20, np.random.default_rng(3), us=told(table, slice(0, 20), model))
    found = cells(out)
    assert found["time"] == table["time"].tolist()[:20]
    np.testing.assert_allclose(numbers(found, "t"), expected.y, rtol=1e-12)


# --------------------------------------------------------------------------- what is refused

FIT = "fit data.csv --state load --obs t"

#: Words, and what is said of them.
REFUSED = [
    (f"{FIT} --inputs sun", "--inputs: data.csv has no column 'sun'; its columns are time, load, t, wind"),
    (f"{FIT} --inputs wind,wind", "--inputs: the column 'wind' is named twice"),
    (f"{FIT} --inputs t", "--obs: the column 't' is an input as well"),
    ("fit gap.csv --state load --obs t --inputs wind", "gap.csv, line 4: wind is missing"),
    (f"{FIT} --harmonics 2", "--harmonics: got 2 without --clock"),
    (f"{FIT} --clock --time none", "no times were read, and the input 'clock_sin1' is made of them"),
    ("fit days.csv --state load --obs t --clock", "days.csv: workday is 2 in row 1 below the names"),
    ("fit taken.csv --state load --obs t --clock", "--clock: taken.csv has a column 'clock_cos2' already"),
    (f"{FIT} --blocks 3,x", "--blocks: got 'x', expected whole numbers above 0, such as 3,6,12"),
    (f"{FIT} --products", "--products: given without inputs; expected --inputs or --clock with it"),
    (f"{FIT} --features auto", "--features: got auto with --objective joint"),
    (f"{FIT} --features auto --hinges 2 --objective filter", "--features: got auto beside --hinges"),
    (f"{FIT} --model ssm --clock", "--features: given, but they go with --model pairwise alone"),
    ("filter both.json calm.csv", "calm.csv has no column 'wind', an input of the model of both.json"),
    ("filter both.json gap.csv", "gap.csv, line 4: wind is missing"),
    ("smooth clock.json timeless.csv", "no times were read, and the input 'clock_sin1' is made of them"),
    ("filter clock.json late.csv", "late.csv: row 2 below the names has no time"),
    (
        "forecast both.json data.csv -n 2",
        "--inputs-ahead: missing; the model of both.json has the inputs wind,",
    ),
    ("forecast clock.json data.csv", "--steps: missing"),
    ("forecast plain.json data.csv --inputs-ahead gap.csv", "--inputs-ahead: got gap.csv, but the model of"),
    (
        "forecast both.json data.csv --inputs-ahead data.csv",
        "--inputs-ahead: row 1 of data.csv is of 2014-01-06",
    ),
    ("forecast both.json calm.csv --inputs-ahead data.csv", "calm.csv has no column 'wind'"),
    (
        "forecast both.json data.csv -n 9 --inputs-ahead ahead.csv",
        "ahead.csv has 6 rows, expected one for each",
    ),
    ("simulate both.json", "--inputs-from: missing; the model of both.json has the inputs wind,"),
    ("simulate clock.json", "--start: missing; the inputs of the model of clock.json are those of a clock"),
    ("simulate clock.json --start soon", "--start: row 0 is 'soon', expected a time"),
    ("simulate plain.json --start 2014-01-01", "--start: got 2014-01-01, but the model of plain.json has no"),
    ("simulate both.json --start 2014-01-01 --inputs-from data.csv", "--inputs-from, --start: got both"),
    (
        "simulate both.json -n 300 --inputs-from data.csv",
        "data.csv has 200 rows, expected one for each of the 300",
    ),
]

#: What is said of what does not go with the model: exit code 2.
MISUSED = (
    "--inputs-ahead: missing",
    "--steps: missing",
    "--inputs-ahead: got",
    "--inputs-from: missing",
    "--start: missing",
    "--start: got",
    "--inputs-from, --start: got both",
)


@pytest.mark.parametrize(("words", "message"), REFUSED, ids=[case[0] for case in REFUSED])
def test_what_does_not_go_together_is_refused(words, message, write, saved, tmp_path, monkeypatch) -> None:
    write()
    few = slice(0, 40)
    write("gap.csv", few, wind=[np.nan if k == 2 else 1.0 for k in range(40)])
    write("calm.csv", few, ("time", "load", "t"))
    write("timeless.csv", few, ("t",))
    write(
        "late.csv",
        few,
        time=[None if k == 1 else f"2014-01-0{1 + k // 24}T{k % 24:02}:00" for k in range(40)],
    )
    write("days.csv", few, workday=2)
    write("taken.csv", few, clock_cos2=1.0)
    write("ahead.csv", slice(N, N + AHEAD))
    monkeypatch.chdir(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    result, printed = run(*words.split(), "-o", "out")
    assert result.exit_code == (2 if message.startswith(MISUSED) else 1), printed
    assert message in printed
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_name_with_a_comma_is_one_column() -> None:
    from fuzzykf.cli.inputs import words_of

    assert words_of(["a,b", "c , d"], ["a,b", "c", "d"]) == ["a,b", "c", "d"]
    assert isinstance(clock_inputs([START]), InputColumns)

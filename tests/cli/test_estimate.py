"""``fuzzykf filter`` and ``fuzzykf smooth`` write what the library finds, gaps and all."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fuzzykf import CGLSSM, CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, OFSRFilter, SwitchingStateSpace
from fuzzykf.cli.app import app
from fuzzykf.comparison import run as comparison_run
from fuzzykf.switching.laws.cells import CellLaw


def run(*arguments: object):
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "200"})


@pytest.fixture
def observations(fuzzy_model):
    zs = fuzzy_model.simulate(40, np.random.default_rng(2)).y
    zs[[0, 7, 8]] = np.nan
    return zs


@pytest.fixture
def data(tmp_path, observations):
    path = tmp_path / "new.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = [
            [f"2014-01-{1 + k}" if k < 9 else f"2014-02-{k}", "" if np.isnan(z) else repr(z)]
            for k, (z,) in enumerate(observations.tolist())
        ]
        csv.writer(file).writerows([("when", "temperature"), *rows])
    return path


@pytest.fixture
def model(tmp_path, fuzzy_model):
    fuzzy_model.save(tmp_path / "model.json")
    return tmp_path / "model.json"


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(cells):
    return np.array([float(c) if c else np.nan for c in cells])


def test_filter_writes_what_the_filter_finds(model, data, observations, fuzzy_model, tmp_path) -> None:
    out = tmp_path / "out.csv"
    result = run("filter", model, data, "--obs", "temperature", "--index", "when", "-o", out)
    assert result.exit_code == 0, result.output
    assert "Filtered 40 rows of new.csv, of which 3 lack something of the observation." in result.output
    found = table(out)
    names = ["x", "x_std", "x_lower", "x_upper", "switch", "switch_mean", "log_likelihood"]
    assert list(found) == ["when", *names]
    assert found["when"][0] == "2014-01-1"
    expected = OFSRFilter(fuzzy_model).filter(observations, keep_nodes=True)
    lower, upper = expected.interval(0.9)
    likelihood = np.where(np.isnan(observations[:, 0]), np.nan, expected.log_likelihood)
    for name, values in zip(
        names,
        (
            expected.x[:, 0],
            np.sqrt(expected.P[:, 0, 0]),
            lower[:, 0],
            upper[:, 0],
            expected.switch,
            expected.switch_mean,
            likelihood,
        ),
        strict=True,
    ):
        np.testing.assert_array_equal(numbers(found[name]), values)
    frame = expected.to_dataframe(level=0.9)  # the same columns, under the same names
    estimates = [name for name in names if name.startswith("x")]
    assert [name for name in frame if name in estimates] == estimates
    for name in estimates:
        np.testing.assert_array_equal(numbers(found[name]), frame[name])
    # An observation that is missing has an estimate all the same, and no likelihood: its cell is empty.
    assert [k for k, cell in enumerate(found["log_likelihood"]) if not cell] == [0, 7, 8]


def test_smooth_writes_what_the_smoother_finds(model, data, observations, fuzzy_model, tmp_path) -> None:
    out = tmp_path / "out.csv"
    result = run("smooth", model, data, "--obs", "temperature", "-o", out, "--nodes", 3, "--level", 0.5)
    assert result.exit_code == 0, result.output
    assert "Smoothed 40 rows" in result.output
    found = table(out)
    expected = OFSRFilter(fuzzy_model, n_nodes=3).smooth(observations, keep_nodes=True)
    assert found["row"] == [str(k) for k in range(40)]  # no column is called as a time is
    np.testing.assert_array_equal(numbers(found["x"]), expected.x[:, 0])
    np.testing.assert_array_equal(numbers(found["switch_path"]), expected.switch_path)
    np.testing.assert_array_equal(numbers(found["x_upper"]), expected.interval(0.5)[1][:, 0])


def test_a_hard_model_has_a_probability_for_each_regime_and_several_components(hard_model, tmp_path) -> None:
    hard_model.save(tmp_path / "model.json")
    zs = hard_model.simulate(20, np.random.default_rng(0)).y
    (tmp_path / "new.csv").write_text("y\n" + "\n".join(map(repr, zs[:, 0].tolist())) + "\n")
    out = tmp_path / "out.csv"
    result = run("filter", tmp_path / "model.json", tmp_path / "new.csv", "--obs", "y", "-o", out)
    assert result.exit_code == 0, result.output
    found = table(out)
    expected = CGOMSMFilter(hard_model).filter(zs)
    assert list(found)[1:5] == ["x0", "x1", "x0_std", "x1_std"]
    # the command keeps the moments of the nodes, which are summed in another order then
    np.testing.assert_allclose(numbers(found["x1"]), expected.x[:, 1], rtol=1e-12, atol=1e-14)
    for k in range(3):
        np.testing.assert_allclose(numbers(found[f"regime_{k}"]), expected.mu[:, k], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("verb", ["filter", "smooth"])
def test_a_fuzzy_switch_between_classes_has_a_share_for_each(verb, tmp_path) -> None:
    law = FadeLaw(3, {(0, 1): (0.1, 6), (1, 2): (0.1, 5), (2, 0): (0.2, 5)})
    pair = np.kron([[1.0, 0.8], [0.8, 1.0]], [[1.0, 0.9], [0.9, 1.0]])
    shape = (3, 3, 4, 4)
    model = CGOFMSModel(law, np.outer([0.0, 9.0, -9.0], [1.0, 1.0]), np.broadcast_to(pair, shape), 1)
    model.save(tmp_path / "model.json")
    zs = model.simulate(60, np.random.default_rng(0)).y
    (tmp_path / "new.csv").write_text("y\n" + "\n".join(map(repr, zs[:, 0].tolist())) + "\n")
    out = tmp_path / "out.csv"
    result = run(verb, tmp_path / "model.json", tmp_path / "new.csv", "--obs", "y", "-o", out)
    assert result.exit_code == 0, result.output
    found, expected = table(out), getattr(OFSRFilter(model), verb)(zs, keep_nodes=True)
    path = ["switch_path"] if verb == "smooth" else []
    names = ["switch", "class_0", "class_1", "class_2", *path, "log_likelihood"]
    assert list(found)[5:] == names
    for k in range(3):
        np.testing.assert_array_equal(numbers(found[f"class_{k}"]), expected.class_weights[:, k])
    for name in ("switch", *path):
        value = getattr(expected, name)
        classes = numbers(found[name])
        hard = (value == 1.0).any(axis=1)
        assert hard.any()
        assert not hard.all()
        assert [cell == "" for cell in found[name]] == (~hard).tolist()
        np.testing.assert_array_equal(np.eye(3)[classes[hard].astype(int)], value[hard])
    drawn = run("simulate", tmp_path / "model.json", "-n", 50, "--seed", 3, "-o", out)
    assert drawn.exit_code == 0, drawn.output
    found, expected = table(out), model.simulate(50, np.random.default_rng(3))
    assert list(found) == ["row", "switch", "class_0", "class_1", "class_2", "x", "y"]
    np.testing.assert_array_equal(np.stack([numbers(found[f"class_{k}"]) for k in range(3)], 1), expected.r)
    assert ["" if np.isnan(k) else k for k in numbers(found["switch"])] == [
        u.argmax() if u.max() == 1.0 else "" for u in expected.r
    ]


def test_a_free_law_is_filtered_on_the_nodes_that_it_was_learned_on(
    fuzzy_model, data, observations, tmp_path
) -> None:
    masses = np.random.default_rng(0).random((5, 5)) + np.eye(5)
    free = CGOFMSModel._from_form(CellLaw(masses + masses.T), fuzzy_model.form)
    free.save(tmp_path / "model.json")
    out = tmp_path / "out.csv"
    run("filter", tmp_path / "model.json", data, "--obs", "temperature", "-o", out)
    expected = OFSRFilter(free, n_nodes=3).filter(observations)
    np.testing.assert_allclose(numbers(table(out)["x"]), expected.x[:, 0], atol=1e-12)
    result = run("filter", tmp_path / "model.json", data, "--obs", "temperature", "--nodes", 5, "-o", out)
    assert result.exit_code == 2
    assert "expected 3 and 'cell'" in result.output


@pytest.mark.parametrize("verb", ["filter", "smooth", "forecast"])
def test_a_fade_that_is_long_for_its_cells_is_noted(verb, data, tmp_path) -> None:
    law = FadeLaw.between(60, 20)
    model = SwitchingStateSpace(law, F=0.9, H=1.0, Q=0.2, R=[[[0.1]], [[4.0]]], x0=[0.0], P0=1.0)
    model.labelled(observations=["temperature"]).save(tmp_path / "model.json")
    given = verb, tmp_path / "model.json", data, "-o", tmp_path / "out.csv"
    given = (*given, "--steps", 2) if verb == "forecast" else given
    result = run(*given)
    assert "Note: a fade takes 20 steps on average and has 5 cells" in result.output
    assert "a fade takes" not in run(*given, "--nodes", 12).output


# ------------------------------------------------------------------ bad input


def test_a_state_space_model_is_filtered_and_smoothed(data, tmp_path) -> None:
    matrices = {"A": [[[0.9]]], "B": [[[1.0]]], "C": [[[0.3]]], "D": [[[0.5]]]}
    CGLSSM([[1.0]], **matrices).save(tmp_path / "model.json")
    given = tmp_path / "model.json", data, "--obs", "temperature", "-o"
    assert run("filter", *given, tmp_path / "out.csv").exit_code == 0
    assert (tmp_path / "out.csv").read_text().splitlines()[0].split(",")[-3:] == [
        "switch",
        "regime_0",
        "log_likelihood",
    ]
    assert run("smooth", *given, tmp_path / "smooth.csv").exit_code == 0
    rows = (tmp_path / "smooth.csv").read_text().splitlines()
    assert len(rows) == len((tmp_path / "out.csv").read_text().splitlines())
    assert "regime_0" in rows[0].split(",")


@pytest.mark.parametrize("verb", ["filter", "smooth"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--obs: name a column of new.csv, for the model of model.json remembers no names; its col"),
        (["--obs", "wind"], "new.csv has no column 'wind'"),
        (["--obs", "when"], "new.csv, line 2: when is '2014-01-1', expected a number"),
        (["--obs", "temperature", "--index", "hour"], "new.csv has no column 'hour'"),
        (["--obs", "temperature", "--level", "1"], "--level: got 1, expected a number between 0 and 1"),
    ],
)
def test_bad_arguments_are_refused_and_nothing_written(
    verb, arguments, message, model, data, tmp_path
) -> None:
    result = run(verb, model, data, *arguments, "-o", tmp_path / "out.csv")
    misused = not arguments or "--level" in arguments
    assert result.exit_code == (2 if misused else 1)
    assert message in " ".join(result.output.split())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.json", "new.csv"]


def test_as_many_columns_as_the_model_observes_are_needed(model, data, tmp_path) -> None:
    data.write_text("a,b\n1,2\n")
    result = run("filter", model, data, "--obs", "a", "--obs", "b", "-o", tmp_path / "out.csv")
    assert result.exit_code == 2
    assert "--obs: got 2 columns, but the model of model.json has 1 observed component\n" in result.output


def test_nodes_are_not_for_hard_regimes(hard_model, data, tmp_path) -> None:
    hard_model.save(tmp_path / "model.json")
    result = run("filter", tmp_path / "model.json", data, "--obs", "temperature", "--nodes", 3)
    assert result.exit_code == 2
    assert "--nodes: got 3, but the model has 3 hard regimes" in result.output


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text[:-30], "damaged, or not a JSON file"),
        (lambda text: "load,temperature\n1,2\n", "damaged, or not a JSON file"),
        (lambda text: "{}", "not a file written by fuzzykf"),
        (lambda text: text.replace('"version": 1', '"version": 99'), "has schema version 99"),
        (lambda text: text.replace('"Axx"', '"Bxx"').replace('"means"', '"mean"'), "damaged: "),
    ],
)
@pytest.mark.parametrize("verb", ["filter", "smooth", "simulate"])
def test_a_damaged_or_foreign_model_is_refused_with_the_reason(
    verb, damage, message, model, data, tmp_path
) -> None:
    model.write_text(damage(model.read_text()))
    arguments = [] if verb == "simulate" else [data, "--obs", "temperature"]
    result = run(verb, model, *arguments, "-o", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert "model.json: " + message in " ".join(result.output.split())
    assert not (tmp_path / "out.csv").exists()


def test_the_model_and_the_data_are_never_written_over(model, data, tmp_path) -> None:
    before = json.loads(model.read_text())
    for output in (model, data):
        result = run("filter", model, data, "--obs", "temperature", "-o", output)
        assert result.exit_code == 1
        assert f"{output.name} is also read from" in " ".join(result.output.split())
    assert json.loads(model.read_text()) == before


def fuzzykf(*arguments: object):
    return subprocess.run(
        [sys.executable, "-m", "fuzzykf", *map(str, arguments)], capture_output=True, text=True, check=False
    )


def test_a_dash_is_standard_output(model, data, tmp_path) -> None:
    run("filter", model, data, "--obs", "temperature", "-o", tmp_path / "out.csv")
    before = sorted(tmp_path.iterdir())
    done = fuzzykf("filter", model, data, "--obs", "temperature", "-o", "-")
    assert done.returncode == 0
    assert done.stdout == (tmp_path / "out.csv").read_text("utf-8")
    assert "Filtered 40 rows" in done.stderr
    assert "Wrote to standard output" in done.stderr
    drawn = run("simulate", model, "-n", 3, "-o", "-")
    assert drawn.stdout.splitlines()[0] == "row,switch,x,y"
    assert len(drawn.stdout.splitlines()) == 4
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_reported_and_devices_stay(model, data) -> None:
    done = fuzzykf("filter", model, data, "--obs", "temperature", "-o", "/dev/full")
    assert done.returncode == 1
    assert done.stderr == "Error: /dev/full: No space left on device\n"
    assert Path("/dev/full").is_char_device()


def test_kept_cells_are_no_formulas_unless_they_are_wanted(model, tmp_path) -> None:
    path, out = tmp_path / "new.csv", tmp_path / "out.csv"
    path.write_text("=who,y\n=cmd(),1\n-5,2\n@x,3\nmonday,4\n", encoding="utf-8")
    for options, expected in (
        ([], ["'=who", "'=cmd()", "-5", "'@x", "monday"]),
        (["--formulas"], ["=who", "=cmd()", "-5", "@x", "monday"]),
    ):
        result = run("filter", model, path, "--obs", "y", "--index", "=who", "-o", out, *options)
        assert result.exit_code == 0, result.output
        assert [line.partition(",")[0] for line in out.read_text("utf-8").splitlines()] == expected


def test_names_of_columns_are_drawn_and_printed_as_they_are(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(comparison_run, "RIVALS", ("kalman", "line"))
    rng = np.random.default_rng(0)
    y = rng.normal(size=200)
    x = np.abs(y) + 0.1 * rng.normal(size=200)
    path = tmp_path / "a.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("$\\bad{$", "\x1b[2Jy"), *zip(x, y, strict=True)])
    arguments = ["compare", path, "--state", "$\\bad{$", "--obs", "\x1b[2Jy", "--nodes", 0, "--folds", 1]
    result = run(*arguments, "--switch", "quantiles", "--out", tmp_path / "result")
    assert result.exit_code == 0, result.output
    assert "\x1b" not in result.output
    assert "$\\bad{$" in result.output


def test_tables_of_very_many_columns_are_checked_once(model, tmp_path) -> None:
    path = tmp_path / "wide.csv"
    names = [f"c{k}" for k in range(100_000)]
    path.write_text(f"{','.join(names)}\n{','.join('1' for _ in names)}\n", encoding="utf-8")
    start = time.perf_counter()
    result = run("filter", model, path, "--obs", "d", "-o", tmp_path / "out.csv")
    assert time.perf_counter() - start < 5.0  # it was 40
    assert result.exit_code == 1
    assert len(result.output) < 1000
    assert "and 99,980 more" in result.output


def test_one_row_is_spoken_of_in_the_singular(model, tmp_path) -> None:
    (tmp_path / "one.csv").write_text('temperature\n""\n')
    result = run("filter", model, tmp_path / "one.csv", "--obs", "temperature", "-o", tmp_path / "out.csv")
    assert "Filtered 1 row of one.csv, of which 1 lacks something of the observation." in result.output
    result = run("simulate", model, "-n", 1, "-o", tmp_path / "out.csv")
    assert "Drew 1 row from" in result.output


def test_a_model_of_one_regime_is_spoken_of_in_the_singular(data, tmp_path) -> None:
    one = CGOMSModel([[1.0]], np.zeros((1, 2)), np.eye(4)[None, None], dim_x=1)
    one.save(tmp_path / "one.json")
    result = run("filter", tmp_path / "one.json", data, "--obs", "temperature", "--nodes", 3)
    assert "--nodes: got 3, but the model has 1 hard regime\n" in result.output

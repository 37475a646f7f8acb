"""``fuzzykf fit`` writes the model that the library learns, says what it found, and refuses bad input."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, SwitchingStateSpace, engine
from fuzzykf.cli.app import app
from fuzzykf.io import load_model, model_to_dict

QUICK = ["--nodes", 0, "--max-iter", 3, "--starts", 1]

#: Commands know nothing of engines; one fit of a state-space model shows that they get on with NumPy.
compiled = pytest.mark.skipif(engine.info().name == "numpy", reason="a fit takes long on NumPy")


def run(*arguments: object):
    return CliRunner().invoke(app, ["fit", *map(str, arguments)], env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def data(fuzzy_model):
    series = fuzzy_model.simulate(240, np.random.default_rng(1))
    return np.column_stack([series.x, series.y])


@pytest.fixture
def write(tmp_path, data):
    def write(rows=data, header=("load", "temperature"), name="data.csv"):
        path = tmp_path / name
        with path.open("w", newline="", encoding="utf-8") as file:
            cells = [["" if np.isnan(v) else repr(v) for v in row] for row in np.asarray(rows).tolist()]
            csv.writer(file).writerows([header, *cells])
        return path

    return write


def test_a_stuck_meter_is_noted(write, data, tmp_path) -> None:
    stuck = data.copy()
    stuck[50:90, 0] = 0.5
    result = run(write(stuck), "--state", "load", "--obs", "temperature", "-o", tmp_path / "m.json", *QUICK)
    assert result.exit_code == 0, result.output
    assert "Note: load has the same value in rows 51 to 90: if the meter was stuck" in result.output


def test_the_file_holds_the_model_that_the_library_learns(write, data, tmp_path) -> None:
    out = tmp_path / "model.json"
    result = run(write(), "--state", "load", "--obs", "temperature", "-o", out, "--law", "fmc2", *QUICK)
    assert result.exit_code == 0, result.output
    fit = CGOFMSModel.fit(data[:, 0], data[:, 1], law="fmc2", n_nodes=0, n_starts=1, max_iter=3)
    named = fit.model.labelled(states=["load"], observations=["temperature"])
    assert model_to_dict(load_model(out)) == model_to_dict(named)
    printed = " ".join(result.output.split())
    assert "Learned load from temperature, on 240 rows of data.csv." in printed
    assert f"law fmc2; {fit.model.form.kind} form, {fit.n_parameters} parameters" in printed
    assert f"log-likelihood {fit.log_likelihood:.2f}" in printed
    assert f"AIC {fit.aic:.1f}, BIC {fit.bic:.1f}, p_hard {fit.model.law.p_hard:.4g}" in printed
    assert f"Stopped after {len(fit.trace) - 1} iterations." in printed
    assert "Note: not converged after 3 iterations" in printed
    assert f"Wrote {out}" in printed


def test_hard_regimes_can_be_learned_and_the_other_rows_test_the_filter(write, data, tmp_path) -> None:
    out = tmp_path / "model.json"
    result = run(
        write(),
        "--state",
        "load",
        "--obs",
        "temperature",
        "-o",
        out,
        "--regimes",
        2,
        "--train",
        0.75,
        "--starts",
        1,
    )
    assert result.exit_code == 0, result.output
    model = load_model(out)
    assert isinstance(model, CGOMSModel)
    fit = CGOMSModel.fit(data[:180, 0], data[:180, 1], n_switches=2, n_starts=1)
    named = fit.model.labelled(states=["load"], observations=["temperature"])
    assert model_to_dict(model) == model_to_dict(named)
    # Oracle: the filter on the last quarter, begun 100 rows earlier.
    found = CGOMSMFilter(model).filter(data[80:, 1])
    rmse = np.sqrt(np.mean((found.x[100:, 0] - data[180:, 0]) ** 2))
    printed = " ".join(result.output.split())
    assert f"Test on the 60 rows that follow: RMSE {rmse:.4g};" in printed
    # Oracle: normal laws, one a regime, mixed by the probabilities of the filter.
    by_node = CGOMSMFilter(model).filter(data[80:, 1], keep_nodes=True)
    mean, std = by_node.node_x[100:, :, 0], np.sqrt(by_node.node_P[100:, :, 0, 0])
    density = (by_node.mu[100:] * norm.pdf(data[180:, :1], mean, std)).sum(axis=1)
    assert f"log score {np.log(density).mean():.4g} per row." in printed
    stays = ", ".join(f"{p:.3g}" for p in model.transition.diagonal())
    assert f"2 hard regimes, which stay with probability {stays}" in printed
    assert re.search(r"Converged after \d+ iterations", printed)


def test_fades_between_three_classes(write, data, tmp_path) -> None:
    out = tmp_path / "model.json"
    columns = ["--state", "load", "--obs", "temperature"]
    options = ["--nodes", 2, "--max-iter", 2, "--starts", 1, "--fades", "0-1,1-2,2-0", "--stay", 20]
    result = run(write(), *columns, "-o", out, *options, "--train", 0.9)
    assert result.exit_code == 0, result.output
    law = FadeLaw(3, {(0, 1): (0.05, 10), (1, 2): (0.05, 10), (2, 0): (0.05, 10)})
    options = {"law": law, "n_nodes": 2, "n_starts": 1, "max_iter": 2}
    fit = CGOFMSModel.fit(data[:216, 0], data[:216, 1], **options)
    named = fit.model.labelled(states=["load"], observations=["temperature"])
    assert model_to_dict(load_model(out)) == model_to_dict(named)
    printed = " ".join(result.output.split())
    assert f", rate 0 to 1 {fit.model.law.fades[0, 1][0]:.4g}, length 0 to 1 " in printed
    assert "Test on the 24 rows that follow" in printed


def test_several_columns_gaps_and_random_starts(write, data, tmp_path) -> None:
    rng = np.random.default_rng(0)
    rows = np.column_stack([data, data @ rng.normal(size=(2, 2)) + rng.normal(size=(240, 2))])
    rows[10:20, 3] = np.nan
    path = write(rows, ("a", "b", "c", "d"))
    common = [
        path,
        "--state",
        "a",
        "--state",
        "c",
        "--obs",
        "d",
        "--obs",
        "b",
        "--switches",
        2,
        "--max-iter",
        2,
    ]
    files = []
    for seed in (1, 1, 2):
        files.append(tmp_path / f"model{len(files)}.json")
        result = run(*common, "--starts", 6, "--seed", seed, "-o", files[-1])
        assert result.exit_code == 0, result.output
    told = "Learned a, c from d, b, on 240 rows of data.csv, 230 of them used: d missing in 10."
    assert told in result.output
    model = load_model(files[0])
    assert (model.dim_x, model.dim_z) == (2, 2)
    assert files[0].read_text() == files[1].read_text()
    # Components are in the order in which they were named.
    np.testing.assert_allclose(
        model.initial @ model.form.means, np.nanmean(rows[:, [0, 2, 3, 1]], axis=0), atol=1.0
    )


def test_the_covariance_form_of_the_paper_can_be_asked_for(write, tmp_path) -> None:
    result = run(
        write(),
        "--state",
        "load",
        "--obs",
        "temperature",
        "-o",
        tmp_path / "m.json",
        "--form",
        "covariance",
        *QUICK,
    )
    assert result.exit_code == 0, result.output
    assert load_model(tmp_path / "m.json").form.kind == "covariance"


def test_rows_unequally_far_apart_are_noted(write, data, tmp_path) -> None:
    path = write(header=("load", "temperature"))
    lines = path.read_text().splitlines()
    days = [f"2014-{1 + k // 28:02d}-{1 + k % 28:02d}" for k in range(240)]
    path.write_text(
        "\n".join([f"date,{lines[0]}", *(f"{d},{x}" for d, x in zip(days, lines[1:], strict=True))])
    )
    result = run(path, "--state", "load", "--obs", "temperature", "-o", tmp_path / "m.json", *QUICK)
    said = "Note: 19 rows are missing (column date, steps of 1 day, 0:00:00): 3 after 2014-01-28, 3 after"
    assert said in " ".join(result.output.split())


# ------------------------------------------------------------------ bad input


def refused(tmp_path, path, *arguments, message, output="model.json") -> None:
    result = run(path, *arguments, "-o", tmp_path / output)
    assert result.exit_code == (2 if "name a column" in message else 1), result.output
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--state: name a column of data.csv; its columns are load, temperature"),
        (["--state", "load"], "--obs: name a column of data.csv"),
        (["--state", "load", "--obs", "load"], "--obs: the column 'load' is named a second time"),
        (["--state", "load", "--obs", "wind"], "data.csv has no column 'wind'"),
        (
            ["--state", "load", "--obs", "temperature", "--law", "fmc1", "--switches", "2"],
            "--law fmc1 is a law of a fuzzy switch, --switches 2 asks for hard regimes; give one of them",
        ),
        (
            ["--state", "load", "--obs", "temperature", "--law", "fmc1", "--regimes", "2"],
            "--law fmc1 is a law of a fuzzy switch, --regimes 2 asks for hard regimes; give one of them",
        ),
        (
            ["--state", "load", "--obs", "temperature", "--regimes", "3", "--switches", "2"],
            "--regimes, --switches: got 3 and 2, two names of the number of regimes; give one of them",
        ),
        (["--state", "load", "--obs", "temperature", "--train", "0"], "--train: got 0, expected a share"),
        (["--state", "load", "--obs", "temperature", "--train", "1.1"], "--train: got 1.1, expected a share"),
        (["--state", "load", "--obs", "temperature", "--train", "0.01"], "hold 1 step in which x and y"),
        (
            ["--state", "load", "--obs", "temperature", "--tolerance", "0"],
            "tolerance: got 0.0, expected a pos",
        ),
    ],
)
def test_what_cannot_be_learned_is_refused_with_the_reason(write, tmp_path, arguments, message) -> None:
    refused(tmp_path, write(), *arguments, message=message)


def test_a_constant_column_and_text_are_refused(write, data, tmp_path) -> None:
    common = ["--state", "load", "--obs", "temperature"]
    refused(tmp_path, write(data * [1.0, 0.0]), *common, message="y[0]: is constant (0)")
    path = write()
    path.write_text(path.read_text().replace(path.read_text().splitlines()[4], "warm,3"))
    refused(tmp_path, path, *common, message="data.csv, line 5: load is 'warm', expected a number")
    refused(tmp_path, tmp_path / "none.csv", *common, message="none.csv: No such file")


def test_where_nothing_can_be_written_nothing_is_learned(write, tmp_path, monkeypatch) -> None:
    def fit(*args, **kwargs):
        raise AssertionError

    monkeypatch.setattr(CGOFMSModel, "fit", fit)
    common = ["--state", "load", "--obs", "temperature"]
    path = write()
    for output, message in (
        ("none/model.json", "none: there is no such folder"),
        (".", "expected a file, found a folder"),
        ("data.csv", "data.csv is also read from; name another file"),
    ):
        refused(tmp_path, path, *common, message=message, output=output)
    assert path.read_text().startswith("load,temperature")


def test_a_failure_leaves_an_earlier_model_as_it_was(write, data, tmp_path) -> None:
    (tmp_path / "model.txt").write_text("precious")
    result = run(write(data[:5]), "--state", "load", "--obs", "temperature", "-o", tmp_path / "model.txt")
    assert result.exit_code == 1
    assert (tmp_path / "model.txt").read_text() == "precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data.csv", "model.txt"]


# --------------------------------------------------------------------------- state-space models


@pytest.fixture(scope="module")
def sensor():
    """Two sensors of one level, of which the worse one is biased; the level is measured at most times."""
    R = np.array([0.2, 0.6])[:, None, None] ** 2
    model = SwitchingStateSpace(
        [[0.95, 0.05], [0.05, 0.95]], F=0.9, H=1.0, Q=0.09, R=R, d=[[0.0], [2.0]], mix="log"
    )
    drawn = model.simulate(200, np.random.default_rng(1))
    x = np.where(np.arange(200)[:, None] % 7 == 3, np.nan, drawn.x)
    return np.concatenate([x, drawn.y], axis=1)


@compiled
def test_a_state_space_model_is_learned_and_filters_the_next_file(write, sensor, tmp_path) -> None:
    out, estimates = tmp_path / "model.json", tmp_path / "estimates.csv"
    data = write(sensor, ("level", "gauge"))
    columns = ("--state", "level", "--obs", "gauge")
    options = ("--model", "ssm", "--regimes", 2, "--starts", 2, "--max-iter", 30, "--train", 0.75)
    result = run(data, *columns, "-o", out, *options)
    assert result.exit_code == 0, result.output
    model = load_model(out)
    assert isinstance(model, SwitchingStateSpace)
    assert model.labels.states == ("level",)
    assert model.labels.observations == ("gauge",)
    printed = " ".join(result.output.split())
    assert "Model: fuzzy" not in printed
    assert "hard switch, a chain on 2 nodes; state_space form, 11 parameters" in printed
    (d,) = re.findall(r"d\[\d\]\[0\] ([12]\.\d+) \(0\.\d+\)", printed)
    assert abs(float(d) - 2.0) < 0.4
    gaps = [np.arange(first, last) % 7 == 3 for first, last in ((0, 150), (150, 200))]
    assert f"on 150 rows of data.csv: level missing in {gaps[0].sum()}." in printed
    known = 50 - gaps[1].sum()
    assert f"Test on the 50 rows that follow, of which {known} have a state: RMSE" in printed
    done = CliRunner().invoke(app, ["filter", str(out), str(data), "-o", str(estimates)])
    assert done.exit_code == 0, done.output
    assert len(estimates.read_text().splitlines()) == 201


def test_it_is_said_how_many_rows_lack_each_column(write, data, tmp_path) -> None:
    rows = data.copy()
    rows[100:, 0] = rows[:2, 0] = rows[1:5, 1] = np.nan
    out = tmp_path / "model.json"
    columns = ["--state", "load", "--obs", "temperature"]
    result = run(write(rows), *columns, "-o", out, *QUICK, "--train", 0.75)
    printed = " ".join(result.output.split())
    assert "on 180 rows of data.csv, 176 of them used: load missing in 82, temperature in 4." in printed
    assert "None of the 60 rows that follow has a state, so that the filter cannot be tested." in printed


@pytest.mark.parametrize(
    ("law", "says"),
    [
        ((), "fuzzy switch, law fade"),
        pytest.param(("--law", "fmc1"), "fuzzy switch, law fmc1", marks=compiled),
        pytest.param(("--fades", "0-1,1-0", "--stay", 30), "fuzzy switch, law fade", marks=compiled),
    ],
)
def test_the_law_of_a_state_space_model_is_chosen_as_of_others(write, sensor, tmp_path, law, says) -> None:
    data, out = write(sensor[:80], ("level", "gauge")), tmp_path / "model.json"
    result = run(
        data, "--state", "level", "--obs", "gauge", "-o", out, "--model", "ssm", *law, *SHORT, "--nodes", 1
    )
    assert result.exit_code == 0, result.output
    assert says in " ".join(result.output.split())
    assert load_model(out).law.kind == says.split()[-1]


SHORT = ("--starts", 1, "--max-iter", 2)


def test_a_form_goes_with_pairwise_models_alone(write, tmp_path) -> None:
    out = tmp_path / "model.json"
    result = run(
        write(),
        "--state",
        "load",
        "--obs",
        "temperature",
        "-o",
        out,
        "--model",
        "ssm",
        "--form",
        "regression",
    )
    assert result.exit_code != 0
    assert "--form: got regression, which goes with --model pairwise alone" in " ".join(result.output.split())
    assert not out.exists()


def test_a_model_is_learned_for_its_filter(write, data, tmp_path) -> None:
    out = tmp_path / "model.json"
    columns = ["--state", "load", "--obs", "temperature", "-o", out, "--regimes", 2, "--starts", 1]
    result = run(write(), *columns, "--objective", "filter", "--no-state-feedback")
    assert result.exit_code == 0, result.output
    options = {"n_regimes": 2, "n_starts": 1, "objective": "filter", "state_feedback": False}
    fit = CGOMSModel.fit(data[:, 0], data[:, 1], **options)
    named = fit.model.labelled(states=["load"], observations=["temperature"])
    assert model_to_dict(load_model(out)) == model_to_dict(named)
    told = f"Kept the {fit.training.kept} fit: log score"
    assert f"{told} {fit.training.score_filter:.4g} for the filter fit" in " ".join(result.output.split())


def test_sparse_states_are_refused_in_words_of_the_command_line(write, data, tmp_path) -> None:
    sparse = data.copy()
    sparse[1::2, 0] = np.nan
    columns = ["--state", "load", "--obs", "temperature", "-o", tmp_path / "model.json", "--regimes", 2]
    result = run(write(sparse), *columns)
    assert result.exit_code == 1
    assert "from which --no-state-feedback learns a state that does not" in " ".join(result.output.split())
    result = run(write(sparse), *columns, "--model", "ssm", "--objective", "filter")
    assert "--objective: got filter, which goes with --model pairwise alone" in " ".join(
        result.output.split()
    )

"""Experiments: reproducible by their seed, continued after an interruption, written whole."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.experiments import core
from fuzzykf.experiments.core import Experiment, new_figure, perform, write
from fuzzykf.experiments.verdicts import exact, printed_mean


class Coins:
    """An experiment of two pieces that counts its calls, and can be interrupted."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.interrupt = False

    def run(self, rng, runs, *, name):
        if self.interrupt and name == "b":
            raise KeyboardInterrupt
        self.calls.append(name)
        return {"heads": rng.random(runs)}

    def experiment(self, pieces="ab"):
        return Experiment(
            name="coins",
            paper="0000",
            reproduces="Table 0",
            runs=50,
            quick_runs=5,
            pieces={name: {"name": name} for name in pieces},
            run=self.run,
            assess=lambda samples: [
                *(printed_mean(k, v["heads"], printed="0.50", printed_runs=9) for k, v in samples.items()),
                exact("wrong, and with a comma", printed="1.0", ours=2.0, reason="it is two"),
            ],
            draw=lambda samples: new_figure(2.0, 2.0),
        )


@pytest.fixture
def coins():
    return Coins()


def test_the_same_seed_gives_the_same_numbers_and_another_one_others(coins) -> None:
    one, two, other = (perform(coins.experiment(), seed=seed).samples for seed in (3, 3, 4))
    assert np.array_equal(one["a"]["heads"], two["a"]["heads"])
    assert not np.array_equal(one["a"]["heads"], other["a"]["heads"])
    assert not np.array_equal(one["a"]["heads"], one["b"]["heads"])


def test_a_piece_does_not_depend_on_what_else_is_run(coins) -> None:
    both, alone = (perform(coins.experiment(pieces)).samples for pieces in ("ab", "b"))
    assert np.array_equal(both["b"]["heads"], alone["b"]["heads"])


def test_an_interrupted_run_goes_on_where_it_was(coins, tmp_path) -> None:
    whole = perform(coins.experiment()).samples
    coins.calls.clear()
    coins.interrupt = True
    with pytest.raises(KeyboardInterrupt):
        perform(coins.experiment(), folder=tmp_path)
    coins.interrupt = False
    continued = perform(coins.experiment(), folder=tmp_path).samples
    assert coins.calls == ["a", "b"]  # "a" was not run again
    for name in "ab":
        assert np.array_equal(continued[name]["heads"], whole[name]["heads"])


@pytest.mark.parametrize("change", [{"seed": 1}, {"runs": 51}])
def test_what_is_kept_is_not_taken_for_something_else(coins, tmp_path, change) -> None:
    perform(coins.experiment(), folder=tmp_path)
    coins.calls.clear()
    perform(coins.experiment(), folder=tmp_path, **change)
    assert coins.calls == ["a", "b"]


def test_what_other_code_has_computed_is_not_used(coins, tmp_path, monkeypatch) -> None:
    perform(coins.experiment(), folder=tmp_path)
    coins.calls.clear()
    monkeypatch.setattr(core, "_source", lambda: "another version")
    perform(coins.experiment(), folder=tmp_path)
    assert coins.calls == ["a", "b"]


def test_what_was_made_of_other_data_is_not_used(coins, tmp_path) -> None:
    given = {"x": np.arange(3.0)}

    def run(rng, runs, *, name, data):
        coins.calls.append(name)
        return {"heads": data["x"].sum() + rng.random(runs)}

    experiment = replace(coins.experiment("a"), run=run, load=lambda folder: dict(given))
    first = perform(experiment, folder=tmp_path).samples["a"]["heads"]
    assert first.min() >= 3.0
    perform(experiment, folder=tmp_path)
    assert coins.calls == ["a"]
    given["x"] = np.arange(4.0)
    assert perform(experiment, folder=tmp_path).samples["a"]["heads"].min() >= 6.0
    assert coins.calls == ["a", "a"]


def test_progress_is_told_of_every_piece(coins) -> None:
    told: list[str] = []
    perform(coins.experiment(), progress=told.append)
    assert told == ["coins: a", "coins: b"]


def test_files_hold_the_rows_the_parameters_and_a_picture(coins, tmp_path) -> None:
    outcome = perform(coins.experiment(), seed=5, runs=40)
    table, record, picture = write(outcome, tmp_path / "new")
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert [row["quantity"] for row in rows] == ["a", "b", "wrong, and with a comma"]
    assert rows[2] == {
        "quantity": "wrong, and with a comma",
        "printed": "1",
        "ours": "2",
        "standard_error": "",
        "lower": "",
        "upper": "",
        "p_value": "0",
        "test": "equal to the last printed digit",
        "verdict": "not reproduced",
        "note": "it is two",
    }
    heads = outcome.samples["a"]["heads"]
    assert float(rows[0]["ours"]) == pytest.approx(heads.mean(), rel=1e-5)
    assert float(rows[0]["standard_error"]) == pytest.approx(heads.std(ddof=1) / np.sqrt(40), rel=1e-5)
    document = json.loads(record.read_text("utf-8"))
    assert (document["seed"], document["runs"], document["paper"]) == (5, 40, "0000")
    assert document["parameters"] == {"a": {"name": "a"}, "b": {"name": "b"}}
    assert document["verdicts"] == {"reproduced": 2, "not reproduced": 1}
    assert document["rows"][0]["ours"] == heads.mean()
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("name", "value"), [("runs", 1), ("seed", -1)])
def test_numbers_that_make_no_sense_are_refused(coins, name, value) -> None:
    with pytest.raises(ParameterError, match=f"{name}: got {value}"):
        perform(coins.experiment(), **{name: value})
    assert coins.calls == []

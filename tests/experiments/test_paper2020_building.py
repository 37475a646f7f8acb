"""The experiment on measured data: what it takes for its numbers, and what it does without data."""

from __future__ import annotations

import os

import numpy as np
import pytest

from fuzzykf.datasets import load_building
from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2020_building import BUILDING

NAME = "openei_building1_june2010.csv"


def switch_by_the_clock(hour):
    """0 from 1 to 5 o'clock, 1 from 13 to 17 o'clock, linear in between: written out by cases."""
    if 1 <= hour <= 5:
        return 0.0
    if 5 < hour < 13:
        return (hour - 5) / 8
    if 13 <= hour <= 17:
        return 1.0
    return 1.0 - ((hour - 17) % 24) / 8


def write_week(folder, seed=0):
    """Write a week whose temperature and power both follow the clock, with noise."""
    rng = np.random.default_rng(seed)
    time = np.datetime64("2010-06-01T00:00", "s") + np.arange(672) * np.timedelta64(15, "m")
    r = np.array([switch_by_the_clock(k % 96 / 4) for k in range(672)])
    temperature = 60 + 12 * r + rng.normal(size=672)
    power = 200 + 150 * r + 8 * rng.normal(size=672)
    rows = [
        f"{str(t).replace('T', ' ')},{a:.3f},{b:.3f}"
        for t, a, b in zip(time, temperature, power, strict=True)
    ]
    (folder / NAME).write_text("Timestamp,OAT (F),Power (kW)\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return r


@pytest.fixture(scope="module")
def week(tmp_path_factory):
    """A folder with the file, the switch, and what the experiment makes of it."""
    folder = tmp_path_factory.mktemp("data")
    r = write_week(folder)
    return folder, r, perform(BUILDING, data=folder)


def test_errors_are_those_of_the_restorations_that_are_drawn(week) -> None:
    folder, r, outcome = week
    data = load_building(folder)
    for name, values in outcome.samples.items():
        state = data.temperature if "temperature" in name else data.power
        other = data.power if "temperature" in name else data.temperature
        assert values["r"] == pytest.approx(r)
        for filter_ in ("fuzzy", "hard"):
            # seven days of 96 values: the mean of the days is the mean of all
            errors = (values[f"{filter_}_x"] - state) ** 2
            assert values[f"{filter_}_state"] == pytest.approx(errors.reshape(7, 96).mean(axis=1))
            errors = (values[f"{filter_}_r"] - r) ** 2
            assert values[f"{filter_}_switch"].mean() == pytest.approx(errors.mean())
        explained = np.corrcoef(state, other)[0, 1] ** 2
        assert values["regression"].mean() == pytest.approx(state.var() * (1.0 - explained))


def test_the_clock_has_the_share_of_hard_values_of_the_theory_pages_and_no_jump(week) -> None:
    rows = {row.quantity: row for row in week[2].rows}
    assert rows["share of hard values of the clock"].ours == pytest.approx(2 * 17 / 96)
    assert rows["pairs from 0 to 1, of which the paper estimates Γ01"].ours == 0.0


def test_on_data_that_slide_the_fuzzy_filter_finds_state_and_switch(week) -> None:
    values = week[2].samples["temperature, regression"]
    assert values["fuzzy_state"].mean() < 3.0  # the noise alone is 1; the variance of the state is 20
    assert values["fuzzy_switch"].mean() < values["hard_switch"].mean()


def test_numbers_of_another_building_are_not_called_reproduced_without_saying_so(week) -> None:
    for row in week[2].rows:
        assert row.verdict != "reproduced"
        if row.verdict == "reproduced with a correction":
            assert "building 1 for building 5" in row.note


def test_the_picture_is_drawn(week, tmp_path) -> None:
    assert write(week[2], tmp_path)[2].stat().st_size > 30_000


def test_without_data_it_says_where_they_are_looked_for(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("FUZZYKF_DATA", raising=False)
    with pytest.raises(FileNotFoundError, match="set the environment variable FUZZYKF_DATA"):
        perform(BUILDING)
    with pytest.raises(FileNotFoundError, match=rf"folder is .*, but there is no {NAME} in it"):
        perform(BUILDING, data=tmp_path)


@pytest.mark.skipif(
    "FUZZYKF_DATA" not in os.environ, reason="FUZZYKF_DATA does not name the folder of the data"
)
def test_on_the_measured_week_no_filter_is_much_better_than_a_straight_line() -> None:
    # What the page of results says of it.
    rng = np.random.default_rng(0)
    values = BUILDING.run(rng, 2, data=BUILDING.load(None), **BUILDING.pieces["power, regression"])
    assert values["fuzzy_state"].mean() < values["hard_state"].mean()
    assert values["fuzzy_state"].mean() > 0.9 * values["regression"].mean()

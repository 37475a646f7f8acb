"""Switching filters beside their rivals on five real series, by the protocol of the page on comparing.

Five expanding folds over the second half, everything learned anew before each of them; what a candidate
chooses, it chooses on rolling blocks inside of the rows to learn on.  Only the list of candidates below
changes.  `FUZZYKF_DATA` names the folder with the data of the road and of the weather in Newark.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.comparison import compare, prepare, worthwhile_jobs
from fuzzykf.datasets import load_traffic, load_victoria, load_weather

pytestmark = pytest.mark.study

#: By their names, in the order of the table.
CANDIDATES = (
    "fuzzy",
    "hard2",
    "hard2-memoryless",
    "hard2-filter",
    "fmc1",
    "fmc1-memoryless",
    "fmc1-filter",
    "pool",
    "hard2-inputs",
    "pool-inputs",
    "imm",
    "kalman",
    "line",
    "regression",
    "piecewise",
    "boosting",
    "pool-boosting",
    "daily-profile",
)

SEED, FOLDS = 0, 5


def victoria(state, observation, *, profile):
    v = load_victoria(hourly=True)
    columns = {"demand": v.demand, "temperature": v.temperature}
    return prepare(columns[state], columns[observation], time=v.time, workday=v.workday, profile=profile)


def traffic():
    t = load_traffic()
    return prepare(t.speed, np.log1p(t.occupancy), time=t.time)


def weather(station, state):
    """Return what a lost sensor of the air would have shown, given the temperature; standard time."""
    w = load_weather(station)
    return prepare(getattr(w, state), w.temperature, time=w.time - np.timedelta64(5 * 3600, "s"))


SERIES = {
    "demand given temperature (GW)": lambda: victoria("demand", "temperature", profile=True),
    "temperature given demand (°C)": lambda: victoria("temperature", "demand", profile=False),
    "speed given occupancy (mph)": traffic,
    "humidity given temperature, JFK (%)": lambda: weather("JFK", "humidity"),
    "dew point given temperature, EWR (°C)": lambda: weather("EWR", "dew_point"),
}

HEADER = [
    "series",
    "candidate",
    "RMSE",
    "95 %",
    "behind the best by",
    "90 % covers",
    "log score",
    "95 %",
    "behind the best by",
]


def behind(value, low, high, digits):
    """By how much, and the interval of 95 %; a star where it does not hold zero."""
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f}){'*' if low > 0.0 else ''}"


def rows_of(title, found):
    """Rows of the table, in the order of the candidates, and the baseline."""
    rows = []
    for s in found.scores:
        rows.append(
            [
                title,
                s.name,
                f"{s.rmse:.3f}",
                f"{s.rmse_low:.3f} to {s.rmse_high:.3f}",
                behind(s.difference, s.difference_low, s.difference_high, 3) if s.name != found.best else "",
                f"{100 * s.coverage:.0f} %",
                f"{s.log_score:.2f}",
                f"{s.log_score_low:.2f} to {s.log_score_high:.2f}",
                behind(s.log_score_behind, s.log_score_behind_low, s.log_score_behind_high, 2)
                if s.name != found.best_on_log_score
                else "",
            ]
        )
    rows.append([title, "training mean", f"{found.baseline_rmse:.3f}", *[""] * 6])
    return rows


def test_rivals(write_table, capsys) -> None:
    rows = []
    for title, task in SERIES.items():
        given = task()
        found = compare(
            given,
            np.random.default_rng(SEED),
            methods=CANDIDATES,
            n_folds=FOLDS,
            n_jobs=worthwhile_jobs(given, FOLDS),
        )
        with capsys.disabled():
            print(f"\n{title}: {found.verdict()}")
            for one in found.restorations:
                if one.description:
                    print(f"  {one.name}: {one.description}; in the folds {', '.join(one.choices) or '-'}")
        assert not found.failures
        assert [score.name for score in found.scores] == list(CANDIDATES)
        for score in found.scores:
            assert np.isfinite([score.rmse, score.log_score]).all(), score.name
        rows += rows_of(title, found)
    write_table("rivals", HEADER, rows, by_first=True)

"""What it is worth to go on learning: the demand for electricity given the temperature, month by month.

Models learn from January to March and restore April from its temperatures.  Then the demand of April
becomes known, they learn from it or not, restore May, and so on.  The daily profile is that of the first
three months.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, DailyProfile
from fuzzykf.datasets import load_victoria

pytestmark = pytest.mark.study

#: Months that are learned from first.
FIRST = 3

#: After so many hours a row counts half.
HALF_LIFE = 6 * 7 * 24

OPTIONS = {"form": "regression", "tolerance": 1e-5, "n_starts": 2}

MODELS = {
    "two hard regimes": lambda x, y: CGOMSModel.fit(x, y, **OPTIONS),
    "the same, no feedback": lambda x, y: CGOMSModel.fit(x, y, state_feedback=False, **OPTIONS),
    "FMC1": lambda x, y: CGOFMSModel.fit(x, y, law="fmc1", **OPTIONS),
}

WAYS = ("never", "forget=1", "half-life 6 weeks", "anew, all rows", "profile alone")

#: Hours of a block of the bootstrap.
WEEK = 7 * 24


def errors_of(fit, x, y, month):
    """Errors of the filters in the months that follow the first ones, (ways, n)."""
    never = forgets_nothing = forgets = anew = fit(x[month < FIRST], y[month < FIRST])
    forget = 0.5 ** (1.0 / HALF_LIFE)
    errors = []
    for k in range(FIRST, 12):
        now = month == k
        fits = (never, forgets_nothing, forgets, anew)
        found = [one.model.filter().filter(y[now]).x[:, 0] - x[now] for one in fits]
        errors.append([*found, x[now]])
        forgets_nothing = forgets_nothing.update(x[now], y[now])
        forgets = forgets.update(x[now], y[now], forget=forget)
        anew = fit(x[month <= k], y[month <= k])
    return np.concatenate(errors, axis=1)


def behind(errors, rng):
    """Ends of 95 % intervals of how far each way is behind the best one, (ways, 2), by weeks."""
    blocks = errors.shape[1] // WEEK
    squares = (errors[:, : blocks * WEEK] ** 2).reshape(len(errors), blocks, WEEK).mean(axis=2)
    drawn = squares[:, rng.integers(blocks, size=(2000, blocks))].mean(axis=2) ** 0.5
    best = int(np.argmin((errors**2).mean(axis=1)))
    return np.quantile(drawn - drawn[best], (0.025, 0.975), axis=1).T


def test_what_going_on_is_worth(write_table):
    v = load_victoria(hourly=True)
    month = v.time.astype("datetime64[M]").astype(int) % 12
    first = month < FIRST
    profile = DailyProfile().fit(v.demand[first], v.time[first], v.workday[first])
    x = profile.transform(v.demand, v.time, v.workday)
    rng = np.random.default_rng(0)
    later = month[~first]
    rows = []
    for name, fit in MODELS.items():
        errors = errors_of(fit, x, v.temperature, month)
        rmse = (errors**2).mean(axis=1) ** 0.5
        if not rows:
            for season, months in (
                ("April to June", (3, 6)),
                ("July to Sept.", (6, 9)),
                ("Oct. to Dec.", (9, 12)),
            ):
                inside = (months[0] <= later) & (later < months[1])
                some = (errors[:, inside] ** 2).mean(axis=1) ** 0.5
                rows.append([name, season, *(f"{one:.3f}" for one in some)])
        intervals = behind(errors, rng)
        cells = [
            f"{one:.3f}" if one == rmse.min() else f"{one:.3f} ({low:.2f} to {high:.2f})"
            for one, (low, high) in zip(rmse, intervals, strict=True)
        ]
        rows.append([name, "all nine months", *cells])
        assert rmse[2] < rmse[1] < rmse[0], name  # what is forgotten pays, and so does what is learned
    write_table("seasons", ["model", "months", *WAYS], rows)

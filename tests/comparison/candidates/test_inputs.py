"""Filters with the clock as inputs restore what the learned models say of rows whose times are told."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf import CGOMSModel, pool_models
from fuzzykf.comparison import LearningPart, candidate
from fuzzykf.comparison.candidates import WARM_UP, inputs
from fuzzykf.comparison.clock import Clock
from fuzzykf.errors import FuzzykfError
from fuzzykf.times import read_times

N, N_TRAIN = 640, 520


def series(n_days_from=4):
    """State and observation of a daily course and two regimes, with their clock and a part to learn on."""
    rng = np.random.default_rng(n_days_from)
    time = np.datetime64("2014-01-06T00:00", "s") + np.arange(N) * np.timedelta64(3600, "s")
    clock = Clock.of(read_times(time))
    r = np.arange(N) // 30 % 2
    y = np.sin(2 * np.pi * clock.hour / 24) + 3.0 * r + 0.3 * rng.normal(size=N)
    x = 0.7 * y + np.cos(2 * np.pi * clock.hour / 24) + 0.2 * rng.normal(size=N)
    effort = {"max_iter": 10, "tolerance": 1e-3}
    return x[:, None], y[:, None], clock, effort


def part_of(x, y, clock, effort, rows=slice(0, N_TRAIN)):
    told: list[str] = []
    return LearningPart(x=x[rows], y=y[rows], clock=clock, progress=told.append, **effort), told


def test_the_pool_is_that_of_the_models_with_their_inputs(monkeypatch) -> None:
    maps = {name: inputs.MAPS[name] for name in ("lags", "lags, hinges and products")}
    monkeypatch.setattr(inputs, "MAPS", maps)
    x, y, clock, effort = series()
    part, told = part_of(x, y, clock[:N_TRAIN], effort)
    learned = pickle.loads(pickle.dumps(candidate("pool-inputs").learn(part)))  # folds are other processes
    assert told == ["learning with lags, hinges and products, a member of the pool"]
    got = learned.at(clock[N_TRAIN:]).restore(part.y, y[N_TRAIN:])
    us = inputs.clock_columns(clock)
    fits = [
        CGOMSModel.fit(
            part.x,
            part.y,
            inputs=us[:N_TRAIN],
            features=one,
            objective="filter",
            form="regression",
            progress=False,
            **effort,
        )
        for one in maps.values()
    ]
    begin = N_TRAIN - WARM_UP
    expected = pool_models(fits).filter(y[begin:], us=us[begin:])
    np.testing.assert_allclose(got.mean, expected.x[WARM_UP:], rtol=1e-12)
    np.testing.assert_allclose(got.std[:, 0] ** 2, expected.P[WARM_UP:, 0, 0], rtol=1e-10)
    assert got.density.log_density(x[N_TRAIN:]).shape == (N - N_TRAIN,)
    plain = candidate("hard2-filter").learn(part).restore(part.y, y[N_TRAIN:])
    errors = [((one.mean - x[N_TRAIN:]) ** 2).mean() for one in (got, plain)]
    assert errors[0] < 0.7 * errors[1]
    assert learned.at(clock[N_TRAIN:]).stepper()(y[0]).shape == (1, 1)


@pytest.mark.parametrize("clock_told", [None, "short"])
def test_times_that_are_not_told_are_an_error(monkeypatch, clock_told) -> None:
    monkeypatch.setattr(inputs, "MAPS", {"lags": inputs.MAPS["lags"]})
    x, y, clock, effort = series()
    part, _ = part_of(x, y, clock[:N_TRAIN], effort)
    learned = candidate("pool-inputs").learn(part)
    told = None if clock_told is None else clock[N_TRAIN : N_TRAIN + 3]
    with pytest.raises(FuzzykfError, match=f"needs those of the {N - N_TRAIN} rows to restore"):
        learned.at(told).restore(part.y, y[N_TRAIN:])


def test_without_times_there_are_features_alone(monkeypatch) -> None:
    monkeypatch.setattr(
        inputs, "MAPS", {name: inputs.MAPS[name] for name in ("lags", "lags, hinges and products")}
    )
    x, y, _, effort = series()
    part, told = part_of(x, y, None, effort)
    learned = candidate("pool-inputs").learn(part)
    assert list(learned.fits) == ["lags"]
    assert told == []
    assert learned.restore(part.y, y[N_TRAIN:]).mean.shape == (N - N_TRAIN, 1)


def test_few_rows_are_not_asked_for_long_windows() -> None:
    assert [one.n_past for one in inputs._maps_for(480).values()] == [24, 24, 24]
    short = inputs._maps_for(479)
    assert list(short) == ["the latest observation", "hinges", "hinges, products"]
    assert [one.n_past for one in short.values()] == [1, 1, 1]


def test_columns_that_do_not_vary_are_left_out() -> None:
    x, y, clock, effort = series()
    weekend = Clock(clock.times[:N_TRAIN], np.zeros(N_TRAIN, dtype=bool))
    part, _ = part_of(x, y, weekend, effort)
    columns = inputs._Columns(part).of(inputs._Known(clock, None))
    assert columns.shape == (N, 2 * inputs.HARMONICS)

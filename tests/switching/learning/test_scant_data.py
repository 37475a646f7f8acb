"""Fits say where there are too few rows, and where a regime has collapsed onto a stuck sensor."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.notes import NUMBERS, STRETCH, scant_data

FAST = {"form": "regression", "n_starts": 1, "max_iter": 30, "tolerance": 1e-4}


def said(fit, pattern):
    return [note for note in fit.warnings if re.search(pattern, note)]


def hard(K):
    return lambda x, y, r=None, **more: CGOMSModel.fit(x, y, r, n_switches=K, **FAST | more)


def fuzzy(law):
    options = FAST | {"law": law, "n_nodes": 1, "max_iter": 5}
    return lambda x, y, r=None, **more: CGOFMSModel.fit(x, y, r, **options | more)


FITS = {"hard1": hard(1), "hard2": hard(2), "hard3": hard(3), "fmc1": fuzzy("fmc1"), "free": fuzzy("free")}

#: Kinds of fits, and the rows from which on they have `NUMBERS` numbers a parameter.
ENOUGH = {"hard1": 39, "hard2": 132, "hard3": 279, "fmc1": 135, "free": 144}


def noise(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n), rng.normal(size=n)


@pytest.mark.parametrize("name", FITS)
@pytest.mark.parametrize("short_of", [1, 0])
def test_few_rows_are_named_with_the_numbers(name, short_of):
    n = ENOUGH[name] - short_of
    fit = FITS[name](*noise(n), max_iter=1)
    notes = said(fit, "rows of 2 numbers are few")
    assert len(notes) == short_of
    assert ENOUGH[name] == np.ceil(NUMBERS * fit.n_parameters / 2)
    for note in notes:
        assert f"{n} rows of 2 numbers are few for {fit.n_parameters} parameters" in note
        assert f"expected at least {ENOUGH[name]} rows" in note


def test_30_rows_of_noise_with_a_known_switch_are_few():
    x, y = noise(30)
    for fit in (hard(2)(x, y, np.arange(30) % 2.0), fuzzy("fmc1")(x, y, np.tile([0.0, 0.5, 1.0], 10))):
        assert said(fit, f"30 rows of 2 numbers are few for {fit.n_parameters} parameters")


def test_rows_count_by_their_components():
    rng = np.random.default_rng(1)
    data = gather(rng.normal(size=(100, 3)), rng.normal(size=(100, 2)))
    assert scant_data(83, data) == []
    (note,) = scant_data(84, data)
    assert "100 rows of 5 numbers are few for 84 parameters" in note
    assert "at least 101 rows" in note


# --------------------------------------------------------------------------- stuck sensors


def series(n=300, seed=2):
    """One regime: y, and x that follows it."""
    rng = np.random.default_rng(seed)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + rng.normal()
    return 2.0 * y + rng.normal(size=n), y


def held(values, first, last):
    values = values.copy()
    values[first : last + 1] = values[first]
    return values


#: Which sensors stick, and what a regime that has collapsed onto them is said to hold.
STUCK = {"x": [r"x\[0\]"], "y": [r"y\[0\]"], "x and y": [r"x\[0\]", r"y\[0\]"]}


def stuck_data(which):
    x, y = series()
    return (held(x, 100, 159) if "x" in which else x), (held(y, 100, 159) if "y" in which else y)


@pytest.mark.parametrize("which", STUCK)
@pytest.mark.parametrize("name", ["hard2", "fmc1"])
def test_a_regime_on_a_known_stuck_stretch_is_named(name, which):
    x, y = stuck_data(which)
    r = np.zeros(300)
    r[100:160] = 1.0
    (note,) = said(FITS[name](x, y, r), "collapsed")
    assert "regime 1 has collapsed onto the rows 100 to 159, in which" in note
    for component in STUCK[which]:
        assert re.search(f"{component} is constant", note)
    value = float(re.search(r"is constant \((.*?)\)", note)[1])
    assert value == pytest.approx((x if "x" in which else y)[100], rel=1e-5)
    assert len(re.findall("is constant", note)) == len(STUCK[which])


@pytest.mark.parametrize("name", ["hard2", "hard3", "fmc1"])
def test_a_hidden_regime_on_a_stuck_stretch_is_named(name):
    x, y = stuck_data("x and y")
    fit = FITS[name](x, y)
    notes = said(fit, "has collapsed onto the rows 100 to 159")
    assert len(notes) >= 1
    regime = int(re.search(r"regime (\d)", notes[0])[1])
    assert fit.occupancy[regime] < 0.35


#: Offset, unit and noise of a sensor, and whether it is stuck but for rounding.
ROUNDED = [
    (20.0, 1.0, 1e-12, True),
    (0.0, 1e-9, 1e-12, True),
    (0.0, 1e9, 1e-15, True),
    (-1e4, 1.0, 1e-12, True),
    (1e7, 1.0, 1e-14, True),
    # What is more is a sensor that moves.
    (20.0, 1.0, 1e-9, False),
    (1e7, 1e-3, 1e-12, False),
]


# the data are looked at, whatever the fit: the quicker one meets them all
@pytest.mark.parametrize(
    ("name", "offset", "unit", "noise", "named"),
    [*(("hard2", *one) for one in ROUNDED), ("fmc1", *ROUNDED[0]), ("fmc1", *ROUNDED[-1])],
)
def test_a_sensor_stuck_but_for_rounding_is_named(name, offset, unit, noise, named) -> None:
    x, y = series()
    x = offset + unit * x
    rng = np.random.default_rng(3)
    size = abs(x[100]) if offset else unit
    x[100:160] = x[100] + noise * size * rng.standard_normal(60)
    r = np.zeros(300)
    r[100:160] = 1.0
    notes = said(FITS[name](x, y, r), "collapsed")
    assert bool(notes) == named
    if named:
        assert "rows 100 to 159, in which x[0] is constant (" in notes[0]


def test_healthy_data_far_from_zero_are_not_stuck() -> None:
    x, y = series()
    r = (np.arange(300) // 60) % 2.0
    for offset, unit in ((1e7, 5e-4), (1e7, 3e-8), (1e3, 1e-9)):
        assert not said(FITS["hard2"](offset + unit * x, y, r), "collapsed")


def test_rows_are_those_of_the_data_as_given():
    x, y = stuck_data("x and y")
    x[20:30] = np.nan
    (note,) = said(hard(2)(x, y), "collapsed")
    assert "rows 100 to 159" in note


def test_other_stretches_are_counted():
    x, y = series()
    r = np.zeros(300)
    for first, last in ((50, 59), (100, 129), (200, 209)):
        y = held(y, first, last)
        r[first : last + 1] = 1.0
    # a constant of its own each time would be noise of the regime: the sensor sticks at one value
    y[r == 1.0] = 7.0
    (note,) = said(hard(2)(x, y, r), "collapsed")
    assert "rows 100 to 129 and 2 other stretches, in which y[0] is constant (7)" in note


#: Data that are well: nothing collapses, whatever they look like.
HEALTHY = {
    "noise": lambda x, y: (x, y),
    "rounded": lambda x, y: (np.round(x, 1), np.round(y, 1)),
    "a few equal values": lambda x, y: (x, held(y, 100, 98 + STRETCH)),
    "far from zero": lambda x, y: (x + 1e6, y - 1e6),
    "in other units": lambda x, y: (x * 1e-9, y * 1e9),
}


@pytest.mark.parametrize("name", ["hard2", "fmc1"])
@pytest.mark.parametrize("data", HEALTHY)
def test_healthy_data_are_not_named(name, data):
    fit = FITS[name](*HEALTHY[data](*series()))
    assert not said(fit, "collapsed|are few")

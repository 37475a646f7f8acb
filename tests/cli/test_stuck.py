"""A value that stands for long is noted, but not where values often repeat."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.cli.stuck import LONG, notes_of_stuck

MEASURED = np.random.default_rng(0).normal(size=400)


def test_a_stuck_meter_is_noted_by_its_rows() -> None:
    values = MEASURED.copy()
    values[100:140] = 0.5
    values[200 : 200 + LONG] = 0.25
    (note,) = notes_of_stuck("load", values)
    assert note.startswith("load has the same value in rows 101 to 140, the longest of 2 such stretches: ")


@pytest.mark.parametrize(
    "values",
    [
        MEASURED,
        np.where(np.arange(400) == 100, np.nan, MEASURED),
        np.full(400, np.nan),
        np.empty(0),
        np.where(np.arange(400) % 40 < 30, 0.0, MEASURED),  # long, and often
        np.append(MEASURED[: -LONG + 1], np.zeros(LONG - 1)),
    ],
)
def test_others_are_not(values) -> None:
    assert not notes_of_stuck("rain", values)


def test_a_value_that_often_repeats_is_not() -> None:
    values = np.repeat(MEASURED, 2)
    values[100:140] = 0.0
    assert not notes_of_stuck("rain", values)

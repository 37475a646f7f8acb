"""Columns in which one value stands for long, as that of a meter that is stuck."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.cli.columns import named_columns

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.cli.columns import Rows
    from fuzzykf.labels import Labels

__all__ = ["notes_of_rows", "notes_of_stuck"]

#: Equal values in a row that are noted; stretches of one value that are usual; and the share of rows that may
#: equal the one before without being noted.
LONG, OFTEN, USUAL = 24, 3, 0.01


def notes_of_stuck(name: str, values: FloatArray) -> list[str]:
    """Say where a column repeats one value for long, unless it often does, as rain or a night's sun.

    Parameters
    ----------
    name : str
        Of the column.
    values : ndarray, shape (n,)
        NaN where missing.

    Examples
    --------
    >>> values = np.sin(np.arange(300.0))
    >>> values[100:130] = 0.5
    >>> notes_of_stuck("load", values)
    ['load has the same value in rows 101 to 130: if the meter was stuck, leave these cells empty']
    """
    repeats = np.append(np.diff(values) == 0.0, False)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], repeats, [False]])))
    runs = [(int(a), int(b) + 1) for a, b in edges.reshape(-1, 2)]  # rows a, ..., b - 1 are equal
    stuck = [(a, b) for a, b in runs if b - a >= LONG]
    often = Counter(values[a] for a, _ in stuck)
    stuck = [(a, b) for a, b in stuck if often[values[a]] < OFTEN]
    elsewhere = repeats.sum() - sum(b - a - 1 for a, b in stuck)
    if not stuck or elsewhere > USUAL * len(values):
        return []
    a, b = max(stuck, key=lambda run: run[1] - run[0])
    more = "" if len(stuck) == 1 else f", the longest of {len(stuck)} such stretches"
    return [
        f"{name} has the same value in rows {a + 1:,} to {b:,}{more}: if the meter was stuck, leave these "
        "cells empty"
    ]


def notes_of_rows(rows: Rows, labels: Labels) -> list[str]:
    """Return the notes of all columns that a model with these names was learned on."""
    return [note for name, values in named_columns(rows, labels) for note in notes_of_stuck(name, values)]

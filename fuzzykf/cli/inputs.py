"""Inputs of a model: where a command finds their columns, or makes them of the times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.clock import WORKDAY, InputColumns, factors_of, is_of_clock, made_inputs, names_of_clock
from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.cli.reading import RowTimes
    from fuzzykf.datasets import Table
    from fuzzykf.times import Times

__all__ = ["AskedInputs", "ModelInputs", "columns_needed", "inputs_of", "words_of"]

#: Harmonics of the day unless another number is asked for.
HARMONICS = 3


def inputs_of(model: Any) -> tuple[str, ...]:
    """Return the names of the inputs of a model; none if it has none."""
    return tuple(getattr(getattr(model, "form", None), "inputs", ()))


def columns_needed(names: Iterable[str]) -> list[str]:
    """Return the columns that inputs of these names are made of, and that no clock tells.

    Examples
    --------
    >>> columns_needed(["clock_sin1", "workday", "workday * clock_sin1", "wind"])
    ['workday', 'wind']
    """
    parts = [part for name in names for part in factors_of(name) or [name]]
    return [part for part in dict.fromkeys(parts) if not is_of_clock(part)]


def words_of(given: Sequence[str], columns: Iterable[str] = ()) -> list[str]:
    """Return what stands between commas; one of the columns whose name has a comma stays whole.

    Examples
    --------
    >>> words_of(["sun, wind", "a,b"], ["a,b"])
    ['sun', 'wind', 'a,b']
    """
    whole = set(columns)
    found: list[str] = []
    for words in given:
        found += [words] if words in whole else [word.strip() for word in words.split(",")]
    return found


@dataclass(frozen=True)
class ModelInputs:
    """The inputs of a model, in the rows of a table.

    Attributes
    ----------
    names : tuple of str
    model : str
        Name of the file of the model, for messages.
    """

    names: tuple[str, ...]
    model: str

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self.names)

    def of(self, table: Table, found: RowTimes) -> InputColumns | None:
        """Return the inputs of all rows; None if there are none.

        A column of the table is taken as it is; what is not there is made of the times, if its name says how.

        Raises
        ------
        ParameterError, FileFormatError
            If a column is not there, or there are no times to make it of; if a cell is empty.
        """
        if not self.names:
            return None
        return _read(self.names, table, found, f", an input of the model of {self.model}")

    def made(self, times: Times) -> InputColumns:
        """Return inputs of a clock alone."""
        return InputColumns(self.names, made_inputs(self.names, times, {}))


@dataclass(frozen=True)
class AskedInputs:
    """The inputs that ``fuzzykf fit`` is asked for.

    Attributes
    ----------
    columns : sequence of str
        What was given as ``--inputs``.
    clock : bool
        Whether there are to be inputs of a clock.
    harmonics : int or None
        How many harmonics of the day; None if nothing is said.
    """

    columns: Sequence[str] = ()
    clock: bool = False
    harmonics: int | None = None

    def check(self) -> None:
        """Raise if harmonics of no clock are asked for."""
        if self.harmonics is not None and not self.clock:
            raise ParameterError(f"--harmonics: got {self.harmonics} without --clock, which they belong to")

    def __bool__(self) -> bool:
        """Whether anything is asked for."""
        return bool(self.columns) or self.clock

    def of(self, table: Table, found: RowTimes) -> InputColumns | None:
        """Return the inputs of all rows; None if none are asked for.

        Raises
        ------
        ParameterError, FileFormatError
            If a column is not there, is named twice or has empty cells; if a clock has no times.
        """
        names = words_of(self.columns, table.columns)
        for name in names:
            if name not in table.columns:
                raise ParameterError(
                    f"--inputs: {table.source} has no column {name!r}; its columns are "
                    f"{listed(table.columns)}"
                )
            if names.count(name) > 1:
                raise ParameterError(f"--inputs: the column {name!r} is named twice, expected once")
        if self.clock:
            day = "workday" if "workday" in table.columns else WORKDAY
            made = names_of_clock(HARMONICS if self.harmonics is None else self.harmonics, day)
            taken = [name for name in made if name in table.columns and name != day]
            if taken:
                raise ParameterError(
                    f"--clock: {table.source} has a column {taken[0]!r} already, which the clock makes; "
                    "rename it, or name the columns by --inputs"
                )
            names += [name for name in made if name not in names]
            _check_workday(day, table)
        return _read(names, table, found, "") if names else None


def _read(names: Sequence[str], table: Table, found: RowTimes, whose: str) -> InputColumns:
    told: dict[str, FloatArray] = {}
    for name in names:
        for one in [name] if name in table.columns else factors_of(name) or [name]:
            if one in table.columns:
                told[one] = table.numbers(one)
            elif is_of_clock(one):
                _check_times(one, table, found)
            else:
                raise ParameterError(
                    f"{table.source} has no column {one!r}{whose}; its columns are {listed(table.columns)}"
                )
    return InputColumns(names, made_inputs(names, found.times, told))


def _check_times(name: str, table: Table, found: RowTimes) -> None:
    if found.times is None:
        raise ParameterError(
            f"{table.source}: no times were read, and the input {name!r} is made of them; --time names their "
            "column"
        )
    missing = np.isnat(found.times.clock)
    if missing.any():
        raise FileFormatError(
            f"{table.source}: row {int(missing.argmax()) + 1} below the names has no time, and the input "
            f"{name!r} is made of it; expected a time in every row"
        )


def _check_workday(day: str, table: Table) -> None:
    """Refuse working days that are neither 0 nor 1."""
    if day not in table.columns:
        return
    days = table.numbers(day)
    wrong = ~np.isin(days, (0.0, 1.0))
    if wrong.any():
        row = int(wrong.argmax())
        raise FileFormatError(
            f"{table.source}: {day} is {days[row]:g} in row {row + 1} below the names, expected 0 or 1"
        )

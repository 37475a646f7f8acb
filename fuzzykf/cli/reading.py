"""How a command reads the file that it is given: the options, and the times of the rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from fuzzykf.datasets.delimited import MISSING
from fuzzykf.datasets.table import INDEX, read_table
from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.steps import step_note
from fuzzykf.times import is_time

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from fuzzykf.datasets import Table
    from fuzzykf.times import Times

__all__ = ["NONE", "TIME_COLUMNS", "Decimal", "Reading", "RowTimes", "Sep", "Time", "TimeFormat", "row_times"]

#: Columns that are taken for the time of a row, in this order, unless another is named.
TIME_COLUMNS = ("time", "timestamp", "datetime", "date")

#: What --time says if there are no times.
NONE = "none"

#: Words for separators that are hard to write.
_WORDS = {"tab": "\t", "\\t": "\t"}

Time = Annotated[
    str | None,
    typer.Option(
        "--time",
        metavar="COL",
        help="Column with the time of each row. Default: the first of "
        f"{', '.join(TIME_COLUMNS)} in the file, or an unnamed first column of times. "
        f"{NONE}: ignore times.",
        show_default=False,
    ),
]
TimeFormat = Annotated[
    str | None,
    typer.Option(
        "--time-format",
        metavar="FORMAT",
        help="Format of times, if it is not ISO 8601 (2014-01-31T16:30): a pattern such as %d.%m.%Y "
        "%H:%M, unix (seconds since 1970) or unix_ms.",
        show_default=False,
    ),
]
Sep = Annotated[
    str | None,
    typer.Option(
        "--sep",
        metavar="CHAR",
        help="Separator of cells: , ; | or tab. Default: found from the file.",
        show_default=False,
    ),
]
Decimal = Annotated[
    str | None,
    typer.Option(
        "--decimal",
        metavar="CHAR",
        help="Decimal separator: point or comma. Default: found from the numbers.",
        show_default=False,
    ),
]


@dataclass(frozen=True)
class Reading:
    """What the options say of a file: `Time`, `TimeFormat`, `Sep` and `Decimal`."""

    time: str | None = None
    time_format: str | None = None
    sep: str | None = None
    decimal: str | None = None

    def table(self, path: Path) -> Table:
        """Read the file."""
        sep = self.sep if self.sep is None else _WORDS.get(self.sep, self.sep)
        return read_table(path, sep=sep, decimal=self.decimal)

    def words(self) -> list[str]:
        """Return the options as they are given."""
        options = {
            "--time": self.time,
            "--time-format": self.time_format,
            "--sep": self.sep,
            "--decimal": self.decimal,
        }
        return [f"{option}={value}" for option, value in options.items() if value is not None]


@dataclass(frozen=True, eq=False)
class RowTimes:
    """The times of the rows of a table.

    Attributes
    ----------
    column : str or None
        Where they stand.
    times : Times or None
        None if there are none, or they cannot be read and are not needed.
    notes : tuple of str
        What the times show, or that none were found where there may be some.
    """

    column: str | None = None
    times: Times | None = None
    notes: tuple[str, ...] = ()


def row_times(
    table: Table,
    reading: Reading,
    index: str | None = None,
    *,
    needed: bool = True,
    gaps: bool = False,
    compares: bool = False,
) -> RowTimes:
    """Read the times of the rows, if there are any.

    A column that is called as times usually are, and that nobody has named, stops nothing unless its
    times are needed, or show that the rows are not in order.

    Parameters
    ----------
    table : Table
    reading : Reading
    index : str, optional
        A column that is kept beside the results; if no other is called as times are and it holds
        times, it is taken for these.
    needed : bool
        Whether the command does something with them.
    gaps : bool
        Whether rows may have no time.
    compares : bool
        Whether steps will be compared with those of a model.

    Raises
    ------
    ParameterError
        If there is no column of that name, or a format and nothing to read.
    FileFormatError
        If a cell is no time, or not later than the one before it.
    """
    if reading.time is not None and reading.time.lower() == NONE:
        if reading.time_format is not None:
            raise ParameterError(
                f"--time-format: got {reading.time_format!r}, but --time none leaves out all times"
            )
        return RowTimes()
    column = _time_column(table, index) if reading.time is None else reading.time
    if column is None:
        if reading.time_format is not None:
            raise ParameterError(
                f"--time-format: got {reading.time_format!r}, but {table.source} has no column "
                f"{', '.join(TIME_COLUMNS)}; name one by --time"
            )
        written = next((name for name in table.columns if _holds_times(table.text(name))), None)
        if written is None and not compares:
            return RowTimes()
        told = "no times were found, so steps were not compared; --time names the column"
        return RowTimes(notes=(told if written is None else f"{told} ({written} holds times)",))
    guessed = reading.time is None and reading.time_format is None
    try:
        if guessed and not needed:
            try:
                table.read_times(column, gaps=gaps, ordered=False)
            except FileFormatError as error:
                return RowTimes(column, None, (f"the times are not used: {error}",))
        times = table.read_times(column, format=reading.time_format, gaps=gaps)
    except FileFormatError as error:
        if not guessed:
            raise
        raise FileFormatError(
            f"{error}; --time none does not look at the times: rows are taken in the order in which they "
            "stand, and as equally far apart"
        ) from error
    note = step_note(times, column, table.text(column))
    return RowTimes(column, times, () if note is None else (note,))


def _holds_times(cells: Sequence[str]) -> bool:
    """Whether a column holds times of ISO 8601 and nothing else; digits alone may be numbers of anything."""
    there = [cell for cell in cells if cell.lower() not in MISSING]
    return bool(there) and all(is_time(cell) and not cell.isdigit() for cell in there)


def _time_column(table: Table, index: str | None) -> str | None:
    """Return the first column that is called as a time usually is, or an index of times, or None."""
    lower = {name.lower(): name for name in table.columns}
    named = next((lower[name] for name in TIME_COLUMNS if name in lower), None)
    kept = INDEX if index is None and table.has_index else index
    if named is None and kept is not None:
        first = next((cell for cell in table.text(kept) if cell.lower() not in MISSING), "")
        if is_time(first) and not first.isdigit():  # numbers may be those of anything
            return kept
    return named

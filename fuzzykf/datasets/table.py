"""Tables of comma-separated values, read without any package beside NumPy.

A table keeps its columns as text until one of them is asked for as numbers or
as times, so that an error can name the row and the text that stand in the way.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.files import as_path, read_bytes
from fuzzykf.texts import listed

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray

__all__ = ["Table", "read_table"]

#: Spellings of a missing value, in lower case.
_MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})

#: How many bytes a table may have unless told otherwise; in memory it takes some ten times as much.
MAX_BYTES = 1 << 28


@dataclass(frozen=True)
class Table:
    """The columns of a file of comma-separated values.

    Attributes
    ----------
    source : str
        Where the table comes from, for messages.
    columns : mapping of str to tuple of str
        The text of each column, by its name in the first line.

    Examples
    --------
    >>> table = Table("example.csv", {"time": ("2014-01-01T00:00",), "load": ("3.9",)})
    >>> table.numbers("load")
    array([3.9])
    >>> table.numbers("power")
    Traceback (most recent call last):
        ...
    fuzzykf.errors.ParameterError: example.csv has no column 'power'; its columns are time, load
    """

    source: str
    columns: Mapping[str, tuple[str, ...]]

    def __len__(self) -> int:
        """Return the number of rows below the line of names."""
        return len(next(iter(self.columns.values())))

    def text(self, name: str) -> tuple[str, ...]:
        """Return one column as it is written in the file.

        Parameters
        ----------
        name : str

        Raises
        ------
        ParameterError
            If there is no such column; the message lists those that there are.
        """
        if name not in self.columns:
            raise ParameterError(
                f"{self.source} has no column {name!r}; its columns are {listed(self.columns)}"
            )
        return self.columns[name]

    def numbers(self, name: str, *, gaps: bool = False) -> FloatArray:
        """Return one column as finite numbers.

        Parameters
        ----------
        name : str
        gaps : bool
            Let cells be empty, or a spelling of "missing", and return NaN for them.

        Returns
        -------
        ndarray of shape (n,)

        Raises
        ------
        ParameterError
            If there is no such column.
        FileFormatError
            If a cell is empty (unless there may be gaps), is not a number, or is infinite;
            the message names the line of the file.
        """
        values = np.empty(len(self))
        for row, cell in enumerate(self.text(name)):
            if cell.lower() in _MISSING:
                if gaps:
                    values[row] = np.nan
                    continue
                raise FileFormatError(
                    f"{self._place(name, row)} is missing ({cell!r}); expected a number in every row"
                )
            try:
                values[row] = float(cell)
            except ValueError:
                raise FileFormatError(f"{self._place(name, row)} is {cell!r}, expected a number") from None
            if not np.isfinite(values[row]):
                raise FileFormatError(f"{self._place(name, row)} is {cell!r}, expected a finite number")
        return values

    def times(self, name: str) -> NDArray[np.datetime64]:
        """Return one column as increasing times, as a clock on the spot shows them.

        An offset from Greenwich (``+10:00``) counts for the order of the rows and is
        then dropped, so that the hour of the day is the local one.

        Parameters
        ----------
        name : str

        Returns
        -------
        ndarray of datetime64[s], shape (n,)

        Raises
        ------
        ParameterError
            If there is no such column.
        FileFormatError
            If a cell is not a time of ISO 8601, only some cells have an offset, or a
            row is not later than the one before it.
        """
        moments: list[datetime] = []
        for row, cell in enumerate(self.text(name)):
            try:
                moment = datetime.fromisoformat(cell)
            except ValueError:
                raise FileFormatError(
                    f"{self._place(name, row)} is {cell!r}, expected a time as in 2014-01-31T16:30"
                ) from None
            if moments and (moment.tzinfo is None) != (moments[-1].tzinfo is None):
                raise FileFormatError(
                    f"{self._place(name, row)} is {cell!r}, expected an offset in every row or in none"
                )
            if moments and moment <= moments[-1]:
                raise FileFormatError(
                    f"{self._place(name, row)} is {cell!r}, not later than {self.columns[name][row - 1]!r} "
                    "in the row before"
                )
            moments.append(moment)
        return np.array([moment.replace(tzinfo=None) for moment in moments], dtype="datetime64[s]")

    def _place(self, name: str, row: int) -> str:
        return f"{self.source}, line {row + 2}: {name}"


def read_table(path: str | os.PathLike[str], *, max_bytes: int | None = None) -> Table:
    """Read a file of comma-separated values whose first line names the columns.

    Parameters
    ----------
    path : path-like
        The file, in UTF-8; compressed by gzip if its name ends in ``.gz``.
    max_bytes : int, optional
        How much it may hold, unpacked; by default 256 MiB, or what the environment variable
        FUZZYKF_MAX_BYTES says.

    Returns
    -------
    Table

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    FileFormatError
        If it is no such table: no text, no rows, a column without a name or with the
        name of another, or a row with more or fewer cells than names.  Or if it is too large.
    """
    path = Path(as_path(path))
    try:
        content = read_bytes(path, max_bytes, MAX_BYTES, unpack=path.suffix == ".gz")
        text = content.decode("utf-8-sig")
        lines = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except (gzip.BadGzipFile, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(
            f"{path.name}: expected comma-separated values in UTF-8, got something else ({error})"
        ) from error
    if not lines or not any(lines[0]):
        raise FileFormatError(f"{path.name}: expected the names of the columns in line 1, got nothing")
    names = [name.strip() for name in lines[0]]
    if len(names) == 1 and any(separator in names[0] for separator in ";\t|"):
        raise FileFormatError(f"{path.name}: expected cells separated by commas, got the line {names[0]!r}")
    seen: set[str] = set()
    for column, name in enumerate(names):
        if not name or name in seen:
            fault = f"has the name {name!r} a second time" if name else "has no name"
            raise FileFormatError(f"{path.name}: column {column + 1} {fault}")
        seen.add(name)
    rows = lines[1:]
    while rows and not any(rows[-1]):  # blank lines at the end say nothing
        rows.pop()
    if not rows:
        raise FileFormatError(f"{path.name}: expected rows below the names of the columns, got none")
    for row, cells in enumerate(rows):
        if len(cells) != len(names):
            raise FileFormatError(
                f"{path.name}, line {row + 2}: expected {len(names)} cells, got {len(cells)}"
            )
    columns = zip(*rows, strict=True)
    return Table(
        path.name, {n: tuple(c.strip() for c in cells) for n, cells in zip(names, columns, strict=True)}
    )

"""Tables of delimited text, read without any package beside NumPy.

A table keeps its columns as text until one of them is asked for as numbers or
as times, so that an error can name the line and the text that stand in the way.
"""

from __future__ import annotations

import codecs
import gzip
import re
import zlib
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.datasets.delimited import MISSING, Dialect, find_dialect, read_lines, take_preamble
from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.files import as_path, read_bytes
from fuzzykf.reprs import cut, shown
from fuzzykf.texts import listed
from fuzzykf.times import Times, read_times

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray

__all__ = ["INDEX", "Table", "read_table"]

#: What numbers look like, by the sign of their decimals; float() would take 1_5 and digits of other scripts.
_NUMBERS = {
    sign: re.compile(rf"[+-]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][+-]?\d+)?", re.ASCII)
    for sign in (".", ",")
}

_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)

#: The name of a first column that has none, as an index has that pandas writes.
INDEX = "index"

#: How many bytes a table may have unless told otherwise; in memory it takes some ten times as much.
MAX_BYTES = 1 << 28


@dataclass(frozen=True, repr=False)
class Table:
    """The columns of a file of delimited text.

    Attributes
    ----------
    source : str
        Where the table comes from, for messages.
    columns : mapping of str to tuple of str
        The text of each column, by its name in the first line.
    decimal : str
        What separates the decimals of numbers, "." or ",".
    lines : sequence of int, optional
        The line of the file in which each row begins, for messages; by default the rows follow
        one line of names.
    has_index : bool
        Whether the first column had no name, and is called "index" here.
    notes : tuple of str
        What was found out and not told: separators, comments, lines without cells, columns left out.

    Examples
    --------
    >>> table = Table("example.csv", {"time": ("2014-01-01T00:00",), "load": ("3.9",)})
    >>> table
    Table of 1 row from 'example.csv': time, load
    >>> table.numbers("load")
    array([3.9])
    >>> table.numbers("power")
    Traceback (most recent call last):
        ...
    fuzzykf.errors.ParameterError: example.csv has no column 'power'; its columns are time, load
    """

    source: str
    columns: Mapping[str, tuple[str, ...]]
    decimal: str = "."
    lines: Sequence[int] | None = None
    has_index: bool = False
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of rows below the line of names."""
        return len(next(iter(self.columns.values())))

    @shown
    def __repr__(self) -> str:
        """Say where the table comes from, and what its columns are called."""
        rows = "1 row" if len(self) == 1 else f"{len(self):,} rows"
        names = listed([cut(name, 30) for name in islice(self.columns, 8)])
        more = f" and {len(self.columns) - 8:,} more" if len(self.columns) > 8 else ""
        return f"{type(self).__name__} of {rows} from {cut(self.source, 60)!r}: {names}{more}"

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
        number = _NUMBERS[self.decimal]
        for row, cell in enumerate(self.text(name)):
            if cell.lower() in MISSING:
                if gaps:
                    values[row] = np.nan
                    continue
                raise FileFormatError(
                    f"{self._place(name, row)} is missing ({cell!r}); expected a number in every row"
                )
            if not number.fullmatch(cell):
                raise FileFormatError(f"{self._place(name, row)} is {cell!r}, {self._expected(cell)}")
            values[row] = float(cell.replace(self.decimal, "."))
            if not np.isfinite(values[row]):
                raise FileFormatError(f"{self._place(name, row)} is {cell!r}, expected a finite number")
        return values

    def _expected(self, cell: str) -> str:
        if _INFINITE.fullmatch(cell):
            return "expected a finite number"
        other = "," if self.decimal == "." else "."
        if _NUMBERS[other].fullmatch(cell):
            return f"expected decimals after {self.decimal!r}; say decimal={other!r} (--decimal)"
        return "expected a number"

    def times(self, name: str, *, format: str | None = None) -> NDArray[np.datetime64]:
        """Return one column as increasing times, as a clock on the spot shows them.

        An offset from Greenwich (``+10:00``) counts for the order of the rows and is
        then dropped, so that the hour of the day is the local one.

        Parameters
        ----------
        name : str
        format : str, optional
            How times are written that are not those of ISO 8601: as `datetime.strptime` has it, or
            "unix" and "unix_ms" for seconds and milliseconds since 1970, whose clock is that of UTC.

        Returns
        -------
        ndarray of datetime64[s], shape (n,)
            Or of a finer unit, where there are parts of seconds.

        Raises
        ------
        ParameterError
            If there is no such column, or the format is none.
        FileFormatError
            If a cell is no such time, only some cells have an offset, or a row is not later
            than the one before it.
        """
        return self.read_times(name, format=format).clock

    def read_times(
        self, name: str, *, format: str | None = None, gaps: bool = False, ordered: bool = True
    ) -> Times:
        """Return one column as times, with what the clock shows and when that was in UTC.

        Parameters
        ----------
        name, format
            As in `times`.
        gaps : bool
            Let cells be empty, or a spelling of "missing", and return NaT for them.
        ordered : bool
            Whether each has to be later than the one before it.

        Raises
        ------
        ParameterError, FileFormatError
            As from `times`.
        """
        remedy = (
            "; say format='%d.%m.%Y %H:%M', or the like, or 'unix' (for milliseconds 'unix_ms') since 1970 "
            "(--time-format)"
        )
        cells = self.text(name)
        return read_times(
            [None if cell.lower() in MISSING else cell for cell in cells] if gaps else cells,
            name=f"{self.source}, column {name}",
            format=format,
            gaps=gaps,
            ordered=ordered,
            where=lambda row: self._place(name, row),
            error=FileFormatError,
            remedy="" if format else remedy,
        )

    def _place(self, name: str, row: int) -> str:
        line = row + 2 if self.lines is None else self.lines[row]
        return f"{self.source}, line {line}: {name}"


def read_table(
    path: str | os.PathLike[str],
    *,
    sep: str | None = None,
    decimal: str | None = None,
    max_bytes: int | None = None,
) -> Table:
    """Read a file of delimited text whose first line names the columns.

    There is a row for each row of the file: one whose cells are all empty is a row as well, at the end
    too.  A line with nothing in it at all between two rows is a row in which everything is missing
    (the table notes it); at the end of the file it is none.  A first column without a name, as pandas
    writes an index, is called "index", unless another is; all other columns without a name are left out
    (and noted).

    Before the names there may be a line ``sep=;``, as Excel has it, and lines of comments that begin with
    ``#``; both are noted.  Missing is written as nothing, NA, N/A, <NA>, #N/A, nan, null or none.
    Nothing separates thousands: where a number shows that something does (``1.234,5``) the file is refused,
    and where it may be so (``1.234`` and the like throughout, between semicolons) a note says how it was
    read.

    Parameters
    ----------
    path : path-like
        The file, in UTF-8; compressed by gzip if its name ends in ``.gz``.
    sep : str, optional
        What separates cells, one character; by default that of comma, semicolon, tab and bar which
        cuts all rows into as many cells as there are names.
    decimal : {".", ","}, optional
        What separates decimals; by default found in the cells if these are not separated by commas.
    max_bytes : int, optional
        How much it may hold, unpacked; by default 256 MiB, or what the environment variable
        FUZZYKF_MAX_BYTES says.

    Returns
    -------
    Table
        Its ``notes`` say what was found out, if it is not commas between cells and points in numbers.

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    FileFormatError
        If it is no such table: no text, no rows, a column with the name of another, or a row with more
        or fewer cells than names; if it is too large, or can be read in two ways.
    ParameterError
        If ``sep`` or ``decimal`` is none, or they are the same.
    """
    path = Path(as_path(path))
    asked = Dialect(sep, decimal).checked()
    try:
        content = read_bytes(path, max_bytes, MAX_BYTES, unpack=path.suffix == ".gz")
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FileFormatError(
            f"{path.name}: expected delimited text in UTF-8, got something else ({error})"
        ) from error
    text = _decoded(path.name, content)
    preamble, text = take_preamble(text, asked)
    dialect = find_dialect(path.name, text, asked, preamble)
    names, rows, lines, blank = read_lines(path.name, text, dialect, preamble.lines)
    has_index = not names[0] and INDEX not in names
    if has_index:
        names = [INDEX, *names[1:]]
    seen: set[str] = set()
    for column, name in enumerate(names):
        if name and name in seen:
            raise FileFormatError(f"{path.name}: column {column + 1} has the name {name!r} a second time")
        seen.add(name)
    columns = zip(names, zip(*rows, strict=True), strict=True)
    found = (
        dialect.found(asked) if preamble.sep is None else dialect.found(Dialect(dialect.sep, asked.decimal))
    )
    return Table(
        path.name,
        {name: tuple(c.strip() for c in cells) for name, cells in columns if name},
        decimal=dialect.decimal or ".",
        lines=lines,
        has_index=has_index,
        notes=(*preamble.notes, *found, *_nameless_notes(names), *_blank_notes(blank)),
    )


def _decoded(source: str, content: bytes) -> str:
    """Return text in UTF-8.

    Raises
    ------
    FileFormatError
        Says where it is none, and how it is made UTF-8.
    """
    convert = "convert it (iconv -f {} -t utf-8 OLD.csv > NEW.csv), or save it in Excel as 'CSV UTF-8'"
    wide = _wide_encoding(content)
    if wide is not None:
        raise FileFormatError(
            f"{source}: expected delimited text in UTF-8, got {wide.upper()}; {convert.format(wide)}"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise FileFormatError(
            f"{source}, line {line}: expected delimited text in UTF-8, got the byte "
            f"0x{content[error.start]:02x}, which is none there; if it is text of another encoding, such as "
            f"latin1, {convert.format('latin1')}"
        ) from error


def _wide_encoding(content: bytes) -> str | None:
    """Return the UTF-16 that a file is in, as its mark says, or zeros in every second place do."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    first = content[:4]
    if len(first) < 4 or not any(first):
        return None
    return "utf-16le" if not any(first[1::2]) else "utf-16be" if not any(first[::2]) else None


def _nameless_notes(names: Sequence[str]) -> list[str]:
    columns = [str(column + 1) for column, name in enumerate(names) if not name]
    if not columns:
        return []
    if len(columns) == 1:
        return [f"column {columns[0]} has no name: it is left out"]
    return [f"columns {listed(columns, 5)} have no name: they are left out"]


def _blank_notes(lines: Sequence[int]) -> list[str]:
    if not lines:
        return []
    if len(lines) == 1:
        return [f"line {lines[0]} is blank: it is taken for a row in which everything is missing"]
    first = listed([str(line) for line in lines], 5)
    return [f"lines {first} are blank: each is taken for a row in which everything is missing"]

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
    """Columns of a CSV file, from `read_table`.

    Attributes
    ----------
    source : str
        Name of the source, for messages.
    columns : mapping of str to tuple of str
        Text of the cells of each column, by name.
    decimal : str
        Decimal separator, "." or ",".
    lines : sequence of int, optional
        Line of the file in which each row starts, for messages; by default rows follow a single header line.
    has_index : bool
        Whether the first column has no name in the file, and is called "index" here.
    notes : tuple of str
        What was inferred: separators, comments, blank lines, omitted columns.

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
        """Return one column as text.

        Parameters
        ----------
        name : str

        Returns
        -------
        tuple of str

        Raises
        ------
        ParameterError
            If there is no such column; the message lists the columns.
        """
        if name not in self.columns:
            raise ParameterError(
                f"{self.source} has no column {name!r}; its columns are {listed(self.columns)}"
            )
        return self.columns[name]

    def numbers(self, name: str, *, gaps: bool = False) -> FloatArray:
        """Return one column as numbers.

        Parameters
        ----------
        name : str
        gaps : bool
            Whether empty cells and spellings of "missing" are allowed; they become NaN.

        Returns
        -------
        ndarray, shape (n,)

        Raises
        ------
        ParameterError
            If there is no such column.
        FileFormatError
            If a cell is empty (without ``gaps``), is not a number, or is infinite; the message names the
            line.
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
        """Return one column as increasing local times.

        UTC offsets (``+10:00``) are used to check the order and then dropped, so that the hour of the day is
        the local one.

        Parameters
        ----------
        name : str
        format : str, optional
            Format of times, if it is not ISO 8601: a pattern of `datetime.strptime`, or "unix" or "unix_ms"
            for seconds or milliseconds since 1970 in UTC.

        Returns
        -------
        ndarray of datetime64[s], shape (n,)
            Of a finer unit if there are fractions of seconds.

        Raises
        ------
        ParameterError
            If there is no such column, or the format is invalid.
        FileFormatError
            If a cell is not a time in this format, only some cells have an offset, or times do not increase.
        """
        return self.read_times(name, format=format).clock

    def read_times(
        self, name: str, *, format: str | None = None, gaps: bool = False, ordered: bool = True
    ) -> Times:
        """Return one column as times, both local and in UTC.

        Parameters
        ----------
        name, format
            As in `times`.
        gaps : bool
            Whether empty cells and spellings of "missing" are allowed; they become NaT.
        ordered : bool
            Whether times must increase.

        Returns
        -------
        Times

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
    r"""Read a CSV file with column names in the first line.

    Rows with empty cells only are kept, also at the end.  A blank line between rows is a row of missing
    values; blank lines at the end are ignored.  A first column without a name, as pandas writes an index, is
    called "index" if no other is; other columns without a name are omitted.

    The names may be preceded by a line ``sep=;``, as from Excel, and by comment lines that start with ``#``.
    Missing values are empty, NA, N/A, <NA>, #N/A, nan, null or none.  Thousands separators are not supported:
    numbers such as ``1.234,5`` are an error, and a note tells how ambiguous numbers such as ``1.234`` were
    read.

    Parameters
    ----------
    path : path-like
        File in UTF-8; compressed by gzip if its name ends in ``.gz``.
    sep : str, optional
        Separator of cells, one character; by default comma, semicolon, tab or bar, whichever splits all rows
        into as many cells as there are names.
    decimal : {".", ","}, optional
        Decimal separator; by default inferred if cells are not separated by commas.
    max_bytes : int, optional
        Largest admissible size, uncompressed; by default the environment variable FUZZYKF_MAX_BYTES, or else
        256 MiB.

    Returns
    -------
    Table
        Its ``notes`` tell what was inferred, such as separators.

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    FileFormatError
        If it is not such a table: not text, no rows, duplicate column names, or a row with more or fewer
        cells than names; if it is too large or ambiguous.
    ParameterError
        If ``sep`` or ``decimal`` is inadmissible, or they are equal.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from fuzzykf.datasets import read_table
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "meters.csv"
    ...     _ = file.write_text("time,load\n2014-01-01T00:00,3.9\n2014-01-01T01:00,4.1\n")
    ...     table = read_table(file)
    >>> table.numbers("load")
    array([3.9, 4.1])
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

"""Text that is cut into rows and cells, and what it is cut by."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.gaussian import brief

if TYPE_CHECKING:
    from _csv import Reader
    from collections.abc import Sequence

__all__ = ["Dialect", "find_dialect", "read_lines"]

#: What may separate cells, unless it is told; in messages by its name.
SEPARATORS = {",": "','", ";": "';'", "\t": "tabs", "|": "'|'"}

#: What is a part of numbers, of quotes, or of the ends of lines.
_NEVER = "+-_.\"'\r\n\0"

#: So many rows are looked at to find out what separates cells.
_LOOKED_AT = 200

#: Numbers that have their decimals after a comma, or after a point.
_COMMA, _POINT = (
    re.compile(rf"[+-]?(\d+{sign}\d*|{sign}\d+)([eE][+-]?\d+)?", re.ASCII) for sign in (",", r"\.")
)

#: A number whose comma may as well separate thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)

_REMEDY = "say which: sep=... and decimal=... (--sep and --decimal)"


@dataclass(frozen=True)
class Dialect:
    """What separates cells, and decimals; None where it is not known."""

    sep: str | None
    decimal: str | None

    def checked(self) -> Dialect:
        """Return it, unless it is none, and raise `ParameterError` if it is none."""
        sep: Any = self.sep
        if sep is not None and (not isinstance(sep, str) or len(sep) != 1 or sep.isalnum() or sep in _NEVER):
            raise ParameterError(f"sep: got {sep!r}, expected one character between cells, such as ';'")
        decimal: Any = self.decimal
        if decimal is not None and (not isinstance(decimal, str) or decimal not in (".", ",")):
            raise ParameterError(f"decimal: got {brief(decimal)}, expected '.' or ','")
        return self

    def found(self, asked: Dialect) -> list[str]:
        """Say what was found out, if it is not what one would expect without looking."""
        parts = []
        if asked.sep is None and self.sep not in (None, ","):
            parts.append(f"cells are separated by {SEPARATORS[str(self.sep)]}")
        if asked.decimal is None and self.decimal == ",":
            parts.append("decimals by ','" if parts else "decimals are separated by ','")
        return [", ".join(parts)] if parts else []


def find_dialect(source: str, text: str, asked: Dialect) -> Dialect:
    """Find out what separates cells and decimals, as far as it is not told.

    Raises
    ------
    FileFormatError
        If there is more than one way to read the text.
    """
    sep = _find_separator(source, text, asked.decimal) if asked.sep is None else asked.sep
    return Dialect(sep, _find_decimal(source, text, sep) if asked.decimal is None else asked.decimal)


def _find_separator(source: str, text: str, decimal: str | None) -> str:
    first = text.split("\n", 1)[0]
    there = [sep for sep in SEPARATORS if sep in first]
    if not there:  # a single name: what separates nothing may be anything
        rows = text.split("\n", _LOOKED_AT)[1:_LOOKED_AT]
        if decimal is None and any("," in row and '"' not in row for row in rows):
            raise FileFormatError(
                f"{source}: line 1 has one name, and there are commas below it, which separate cells or "
                f"decimals; {_REMEDY}"
            )
        return "," if decimal != "," else ";"
    shares = {sep: _share_cut(text, sep) for sep in there}
    fit = [sep for sep in there if shares[sep] == 1.0]
    if len(fit) > 1:
        told = " and ".join(SEPARATORS[sep] for sep in fit)
        raise FileFormatError(
            f"{source}: {told} cut all rows into as many cells as there are names; {_REMEDY}"
        )
    return max(there, key=lambda sep: shares[sep])  # if none fits, the error tells of the most likely one


def _share_cut(text: str, sep: str) -> float:
    """Share of the first rows that a separator cuts into as many cells as there are names."""
    try:
        rows = [row for row in islice(_reader(text, sep), _LOOKED_AT) if any(row)]
    except csv.Error:
        return 0.0
    if not rows or len(rows[0]) < 2:
        return 0.0
    return sum(len(row) == len(rows[0]) for row in rows) / len(rows)


def _find_decimal(source: str, text: str, sep: str) -> str:
    if sep == "," or "," not in text:
        return "."
    commas, points, thousands = 0, 0, 0
    try:
        for row in islice(_reader(text, sep), 1, None):
            for cell in map(str.strip, row):
                if "," in cell and _COMMA.fullmatch(cell):
                    commas += 1
                    thousands += bool(_THOUSANDS.fullmatch(cell))
                elif "." in cell and _POINT.fullmatch(cell):
                    points += 1
    except csv.Error:  # told where the rows are read
        return "."
    if commas and (points or (thousands == commas and sep != ";")):
        what = (
            "numbers with decimals after a comma and such with decimals after a point"
            if points
            else "commas that separate thousands or decimals"
        )
        raise FileFormatError(f"{source}: there are {what}; {_REMEDY}")
    return "," if commas else "."


def read_lines(
    source: str, text: str, dialect: Dialect
) -> tuple[list[str], list[list[str]], Sequence[int], list[int]]:
    """Cut text into rows of as many cells as there are names.

    Returns
    -------
    names : list of str
    rows : list of list of str
    lines : sequence of int
        Where each row begins in the file, counted from 1.
    blank : list of int
        Lines without any cell between the rows: rows in which all cells are empty.

    Raises
    ------
    FileFormatError
        If there are no names or no rows, or a row has more or fewer cells than names.
    """
    sep = dialect.sep or ","
    rows: list[list[str]] = []
    lines: list[int] = []
    blank: list[int] = []
    reader = _reader(text, sep)
    begin = 1
    try:
        names = [name.strip() for name in next(reader, [])]
        if not any(names):
            raise FileFormatError(f"{source}: expected the names of the columns in line 1, got nothing")
        empty = [""] * len(names)
        begin = reader.line_num + 1
        for cells in reader:
            if not cells or (len(names) > 1 and len(cells) == 1 and not cells[0].strip()):
                blank.append(begin)
                cells = empty
            elif len(cells) != len(names):
                raise FileFormatError(
                    f"{source}, line {begin}: expected {len(names)} cells, got {len(cells)}"
                    + (f" (cells are separated by {SEPARATORS.get(sep, repr(sep))})" if sep != "," else "")
                )
            rows.append(cells)
            lines.append(begin)
            begin = reader.line_num + 1
    except csv.Error as error:
        raise FileFormatError(
            f"{source}, line {begin}: expected delimited text, got something else ({error})"
        ) from error
    while blank and lines and blank[-1] == lines[-1]:  # the end of the file, no row
        blank.pop(), lines.pop(), rows.pop()
    if not rows:
        raise FileFormatError(f"{source}: expected rows below the names of the columns, got none")
    if lines[-1] - lines[0] == len(lines) - 1:
        return names, rows, range(lines[0], lines[-1] + 1), blank
    return names, rows, lines, blank


def _reader(text: str, sep: str) -> Reader:
    return csv.reader(io.StringIO(text, newline=""), delimiter=sep, strict=True)

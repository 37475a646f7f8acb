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
from fuzzykf.times import is_time

if TYPE_CHECKING:
    from _csv import Reader
    from collections.abc import Iterator, Sequence

__all__ = ["MISSING", "Dialect", "find_dialect", "read_lines", "take_preamble"]

#: Spellings of a missing value, in lower case; the last two are those of Excel.
MISSING = frozenset({"", "na", "n/a", "<na>", "nan", "null", "none", "#n/a", "#n/a n/a"})

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

_WHOLE = re.compile(r"[+-]?\d+([eE][+-]?\d+)?", re.ASCII)

#: A number whose comma, or point, may as well separate thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[,.]\d{3}", re.ASCII)

#: Numbers in which one sign can only separate thousands: 1.234,5 and 1.234.567, whatever the sign.
_MIXED = re.compile(r"[+-]?\d{1,3}((\.\d{3})+,\d*|(,\d{3})+\.\d*)", re.ASCII)
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}((\.\d{3}){2,}|(,\d{3}){2,})", re.ASCII)

#: The beginning of a row whose first cell is missing, in the words of Excel: no comment.
_MISSING_FIRST = re.compile(r"\"?#N/A(?: N/A)?\"?[ \t]*(?![\w/ ])", re.ASCII | re.IGNORECASE)

#: The first line by which Excel is told what separates cells.
_EXCEL = re.compile(r"\"?sep=([^\w+\-.\"'\r\n\0])\"?[ \t]*", re.ASCII | re.IGNORECASE)

_REMEDY = "say which: sep=... and decimal=... (--sep and --decimal)"


@dataclass(frozen=True)
class Dialect:
    """What separates cells, and decimals; None where it is not known, or there is nothing to separate."""

    sep: str | None
    decimal: str | None
    notes: tuple[str, ...] = ()

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
            parts.append(f"cells are separated by {_named(str(self.sep))}")
        if asked.decimal is None and self.decimal == ",":
            parts.append("decimals by ','" if parts else "decimals are separated by ','")
        return [*([", ".join(parts)] if parts else []), *self.notes]


@dataclass(frozen=True)
class Preamble:
    """Lines before the names of the columns.

    Attributes
    ----------
    lines : int
        How many there are.
    sep : str or None
        What they say that separates cells.
    notes : tuple of str
    """

    lines: int = 0
    sep: str | None = None
    notes: tuple[str, ...] = ()


def take_preamble(text: str, asked: Dialect) -> tuple[Preamble, str]:
    """Take away what stands before the names: Excel's ``sep=;``, and comments, which begin with ``#``.

    A line that begins with ``#`` is a comment if a line of names follows it, after blank lines or none.
    It is the line of names itself if a row of data follows it, which is cut into as many cells.
    """
    lines = _physical(text)
    first = next(lines, "")
    said = _EXCEL.fullmatch(first.rstrip("\r\n"))
    sep, notes, n = asked.sep, [], 0
    if said:
        n, told = 1, f"line 1 says that cells are separated by {_named(said[1])}"
        notes.append(
            told if sep in (None, said[1]) else f"{told}, and they are read by {_named(sep)} as told"
        )
        sep = sep or said[1]
        first = next(lines, "")
    comments, blank = [], 0
    while first.startswith("#") and not _MISSING_FIRST.match(first):
        comments.append(first)
        first = next(lines, "")
    while comments and first and not first.strip():
        blank += 1
        first = next(lines, "")
    if comments and _are_names(comments[-1], first, sep):
        comments.pop()
        blank = 0
    if comments:
        a, b = n + 1, n + len(comments)
        notes.append(
            f"line {a} begins with '#': it is left out as a comment"
            if a == b
            else f"lines {a} to {b} begin with '#': they are left out as comments"
        )
    n += len(comments) + blank
    rest = text if n == 0 else "".join(islice(_physical(text), n, None))
    return Preamble(n, said[1] if said and asked.sep is None else None, tuple(notes)), rest


def _physical(text: str) -> Iterator[str]:
    return iter(io.StringIO(text, newline=""))


def _are_names(line: str, row: str, sep: str | None) -> bool:
    """Whether a line that begins with # names the columns of the row below it."""
    if not row.strip():
        return False
    cells = [cell.strip(' \t"\r\n') for cell in re.split(f"[{re.escape(sep or ''.join(SEPARATORS))}]", row)]
    if not any(cell.lower() in MISSING or _is_number(cell) or is_time(cell) for cell in cells):
        return False  # names, or the end of the file
    there = [one for one in ([sep] if sep else SEPARATORS) if one in line or one in row]
    return not there or any(line.count(one) == row.count(one) > 0 for one in there)


def _is_number(cell: str) -> bool:
    return bool(_WHOLE.fullmatch(cell) or _COMMA.fullmatch(cell) or _POINT.fullmatch(cell))


def _named(sep: str) -> str:
    return SEPARATORS.get(sep, repr(sep))


def find_dialect(source: str, text: str, asked: Dialect, preamble: Preamble | None = None) -> Dialect:
    """Find out what separates cells and decimals, as far as it is not told.

    Raises
    ------
    FileFormatError
        If there is more than one way to read the text.
    """
    preamble = preamble or Preamble()
    first = preamble.lines + 1
    sep = preamble.sep if asked.sep is None else asked.sep
    if sep is None:
        sep = _find_separator(source, text, asked.decimal, first)
    if asked.decimal is not None:
        return Dialect(sep, asked.decimal)
    decimal, notes = _find_decimal(source, text, sep or ",", first)
    return Dialect(sep, decimal, notes)


def _find_separator(source: str, text: str, decimal: str | None, first: int) -> str | None:
    heads = {sep: _head(text, sep) for sep in SEPARATORS}
    there = [sep for sep, (cells, _) in heads.items() if cells != 1]
    if not there:  # a single name: what separates nothing may be anything
        end = heads[","][1]
        rows = islice(_physical(text), end, end + _LOOKED_AT)
        if decimal is None and any("," in row and '"' not in row for row in rows):
            raise FileFormatError(
                f"{source}: line {first} has one name, and there are commas below it, which separate cells "
                f"or decimals; {_REMEDY}"
            )
        return None
    shares = {sep: _share_cut(text, sep) for sep in there}
    fit = [sep for sep in there if shares[sep] == 1.0]
    if len(fit) > 1:
        told = " and ".join(SEPARATORS[sep] for sep in fit)
        raise FileFormatError(
            f"{source}: {told} cut all rows into as many cells as there are names; {_REMEDY}"
        )
    return max(there, key=lambda sep: shares[sep])  # if none fits, the error tells of the most likely one


def _head(text: str, sep: str) -> tuple[int, int]:
    """How many names a separator cuts, 0 if it cannot cut them, and how many lines they take."""
    reader = _reader(text, sep)
    try:
        return max(len(next(reader, [])), 1), reader.line_num
    except csv.Error:
        return 0, reader.line_num


def _share_cut(text: str, sep: str) -> float:
    """Share of the first rows that a separator cuts into as many cells as there are names."""
    try:
        rows = [row for row in islice(_reader(text, sep), _LOOKED_AT) if any(row)]
    except csv.Error:
        return 0.0
    if not rows or len(rows[0]) < 2:
        return 0.0
    return sum(len(row) == len(rows[0]) for row in rows) / len(rows)


def _find_decimal(source: str, text: str, sep: str, first: int) -> tuple[str, tuple[str, ...]]:
    """Return what separates decimals, and what should be said of it."""
    if sep == "," or ("," not in text and "." not in text):
        return ".", ()
    found = dict.fromkeys(",.", 0)
    thousands = dict.fromkeys(",.", 0)
    groups: dict[str, tuple[str, str]] = {}
    example = ""
    try:
        reader = _reader(text, sep)
        next(reader, None)
        begin = reader.line_num
        for row in reader:
            for cell in map(str.strip, row):
                sign = "," if "," in cell else "."
                if sign not in cell:
                    continue
                if (_COMMA if sign == "," else _POINT).fullmatch(cell):
                    found[sign] += 1
                    if _THOUSANDS.fullmatch(cell):
                        thousands[sign] += 1
                        example = example or cell
                elif _MIXED.fullmatch(cell):
                    raise _thousands_error(f"{source}, line {first + begin}", cell, "points and commas")
                elif sign not in groups and _GROUPS.fullmatch(cell):
                    groups[sign] = f"{source}, line {first + begin}", cell
            begin = reader.line_num
    except csv.Error:  # told where the rows are read
        return ".", ()
    for sign, (place, cell) in groups.items():
        if 0 < found[sign] == thousands[sign]:  # nothing shows that the sign separates decimals elsewhere
            raise _thousands_error(place, cell, "points" if sign == "." else "commas")
    commas, points = found[","], found["."]
    if commas and (points or (thousands[","] == commas and sep != ";")):
        what = (
            "numbers with decimals after a comma and such with decimals after a point"
            if points
            else "commas that separate thousands or decimals"
        )
        raise FileFormatError(f"{source}: there are {what}; {_REMEDY}")
    if points and thousands["."] == points:
        digits = example.replace(".", "")
        note = (
            "all numbers with a point have three digits after it, as thousands have: the point is taken for "
            f"that of decimals, in {example} as well; write {digits} if thousands are meant"
        )
        return ".", (note,)
    return ("," if commas else "."), ()


def _thousands_error(place: str, cell: str, what: str) -> FileFormatError:
    return FileFormatError(
        f"{place}: there is the number {cell!r} with {what}, some of which separate thousands; expected none "
        "between thousands (decimal='.' or ',' (--decimal) leaves such cells to the columns that they are in)"
    )


def read_lines(
    source: str, text: str, dialect: Dialect, skipped: int = 0
) -> tuple[list[str], list[list[str]], Sequence[int], list[int]]:
    """Cut text into rows of as many cells as there are names.

    Parameters
    ----------
    source : str
    text : str
        From the line of names on.
    dialect : Dialect
    skipped : int
        How many lines of the file stand before the text.

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
    sep = dialect.sep or (";" if dialect.decimal == "," else ",")
    rows: list[list[str]] = []
    lines: list[int] = []
    blank: list[int] = []
    reader = _reader(text, sep)
    begin = skipped + 1
    try:
        names = [name.strip() for name in next(reader, [])]
        if not any(names):
            raise FileFormatError(f"{source}: expected the names of the columns in line {begin}, got nothing")
        empty = [""] * len(names)
        begin = skipped + reader.line_num + 1
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
            begin = skipped + reader.line_num + 1
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

"""Names that others have chosen, in sentences, on terminals, in pictures and in spreadsheets."""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

__all__ = ["counted", "listed", "literal", "printable", "uncomputed"]

#: Unicode categories of what moves the cursor, changes the direction, or stands for nothing.
_CONTROLS = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")


def counted(n: int, noun: str) -> str:
    """Return how many there are of something, one or several.

    Examples
    --------
    >>> counted(1, "row"), counted(1000, "row")
    ('1 row', '1,000 rows')
    """
    return f"{n:,} {noun}" + ("" if n == 1 else "s")


def listed(names: Collection[str], most: int = 20) -> str:
    """Return names as a sentence lists them; no more than a few of many.

    Examples
    --------
    >>> listed(["a", "b", "c"])
    'a, b, c'
    >>> listed([f"c{k}" for k in range(1000)], 2)
    'c0, c1 and 998 more'
    """
    first = [name for name, _ in zip(names, range(most), strict=False)]
    more = len(names) - len(first)
    return ", ".join(first) + (f" and {more:,} more" if more else "")


def printable(text: str) -> str:
    r"""Return text with control characters as escapes, so that it says nothing to a terminal.

    Examples
    --------
    >>> print(printable("load\x1b[2J"))
    load\x1b[2J
    """
    if text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode("ascii") if unicodedata.category(c) in _CONTROLS else c
        for c in text
    )


def literal(text: str) -> str:
    r"""Return text that matplotlib draws as it is written: what stands between dollars is no formula.

    Examples
    --------
    >>> print(literal("$price$"))
    \$price\$
    """
    return printable(text).replace("$", r"\$")


def uncomputed(cell: str) -> str:
    """Return a cell that a spreadsheet shows and does not compute: a formula gets an apostrophe.

    Examples
    --------
    >>> [uncomputed(cell) for cell in ("=1+1", "@SUM(A1)", "-5", "monday")]
    ["'=1+1", "'@SUM(A1)", '-5', 'monday']
    """
    begins = cell.lstrip()[:1]
    if cell[:1] in ("\t", "\r") or (begins and begins in "=+-@\uff1d\uff0b\uff0d\uff20"):
        return cell if _NUMBER.fullmatch(cell) else f"'{cell}"
    return cell

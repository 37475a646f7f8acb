"""Tables that go together row by row have to have the same rows."""

from __future__ import annotations

from typing import Any

from fuzzykf.errors import ParameterError
from fuzzykf.times import has_times, read_times

__all__ = ["check_aligned"]


def check_aligned(**tables: Any) -> None:
    """Raise unless the tables of pandas among these have one index, in one order; times in theirs.

    Arrays and lists have no index: they go by position, with anything.  An index of times has to
    increase, for a series that stands in another order is another one.

    Parameters
    ----------
    **tables
        What goes together, by the names of the arguments; None where an argument was not given.

    Raises
    ------
    ParameterError
        Names two that differ, with both ends of their indexes; or the row whose time is not later
        than that of the row before.

    Examples
    --------
    >>> import pandas as pd
    >>> check_aligned(x=pd.Series([1.0, 2.0]), y=[3.0, 4.0])
    """
    indexed = {
        name: table.index
        for name, table in tables.items()
        if hasattr(table, "to_numpy") and hasattr(getattr(table, "index", None), "equals")
    }
    names = list(indexed)
    if names and has_times(indexed[names[0]]):
        read_times(indexed[names[0]], where=lambda row: f"{names[0]}: the index of row {row}")
    for other in names[1:]:
        one = names[0]
        if not indexed[one].equals(indexed[other]):
            raise ParameterError(
                f"{one}, {other}: rows of different indexes; {one} has {_ends(indexed[one])} and {other} has "
                f"{_ends(indexed[other])}; expected the same in the same order (join them first, or pass "
                "arrays, which go together by position)"
            )


def _ends(index: Any) -> str:
    if len(index) == 0:
        return "no row"
    return f"{len(index)} from {index[0]} to {index[-1]}"

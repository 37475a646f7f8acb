"""Controls, and whatever else goes with observations, of many series and of a forecast."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.observations import check_aligned, index_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.many import ManySeries

__all__ = ["check_ahead", "check_rows"]


def check_rows(many: ManySeries, **tables: Any) -> None:
    """Raise unless the tables that all series share, row by row, have the index of each, up to its end.

    Raises
    ------
    ParameterError
        As from `fuzzykf.observations.check_aligned`.
    """
    own = many.index if isinstance(many.index, list) else [many.index]
    known = [one for one in own if hasattr(one, "equals")]
    for name, table in tables.items():
        index = index_of(table)
        if not known or not hasattr(index, "equals"):
            check_aligned(**{name: table})
            continue
        for one in known:
            part = index[: len(one)] if len(index) == many.values.shape[1] else index
            check_aligned(zs=one.to_series(), **{name: part.to_series()})


def check_ahead(ahead: Any, steps: int, tables: Mapping[str, Any]) -> None:
    """Raise unless the tables for a forecast have the index of its rows, where that is known.

    Rows that are numbered from 0 go by position if those ahead are numbered: so are those of a table that
    was made for the forecast alone.

    Parameters
    ----------
    ahead : object
        Index of the rows ahead; None if nobody knows it.
    steps : int
    tables : mapping of str to object
        By the names of the arguments.

    Raises
    ------
    ParameterError
        As from `fuzzykf.observations.check_aligned`.
    """
    for name, table in tables.items():
        index = index_of(table)
        if ahead is None or not hasattr(index, "equals"):
            check_aligned(**{name: table})
        elif not (ahead.dtype.kind in "iu" and list(index) == list(range(steps))):
            check_aligned(forecast=ahead.to_series(), **{name: index[:steps].to_series()})

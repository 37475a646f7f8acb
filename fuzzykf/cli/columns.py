"""Columns in and out: what the commands read from a file, and how they write one."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.cli.output import UsageError
from fuzzykf.cli.reading import Reading, row_times
from fuzzykf.datasets.table import INDEX
from fuzzykf.errors import ParameterError
from fuzzykf.texts import listed, uncomputed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from fuzzykf.arrays import FloatArray
    from fuzzykf.cli.inputs import AskedInputs, ModelInputs
    from fuzzykf.clock import InputColumns
    from fuzzykf.labels import Labels
    from fuzzykf.times import Times

__all__ = ["Rows", "as_csv", "components", "named_columns", "read_rows", "switch_columns"]


@dataclass(frozen=True, eq=False)
class Rows:
    """The columns of a file that a command works on.

    Attributes
    ----------
    source : str
        Name of the file.
    values : mapping of str to ndarray, shape (n, columns)
        By option; NaN where a cell is empty.
    index_name : str
    index : sequence
        The text of the column that was named, or of that of the times, or of a first column without
        a name; else 0, 1, ...
    notes : list of str
        What a reader should know about the rows.
    times : Times or None
        When they were, if that is known.
    inputs : InputColumns or None
        What is known at all times, if that was asked for.
    """

    source: str
    values: Mapping[str, FloatArray]
    index_name: str
    index: Sequence[Any]
    notes: list[str]
    times: Times | None = None
    inputs: InputColumns | None = None

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.index)


def named_columns(rows: Rows, labels: Labels) -> Iterator[tuple[str, FloatArray]]:
    """Go through the columns (n,) that a model with these names was learned on."""
    for names, option in ((labels.states, "--state"), (labels.observations, "--obs")):
        yield from zip(names or (), rows.values[option].T, strict=True)


def read_rows(
    path: Path,
    columns: Mapping[str, Sequence[str]],
    index: str | None,
    reading: Reading | None = None,
    *,
    hint: str = "",
    compares: bool = False,
    inputs: AskedInputs | ModelInputs | None = None,
) -> Rows:
    """Read columns of numbers that may have gaps.

    Parameters
    ----------
    path : path-like
    columns : mapping of str to sequence of str
        Names of columns, by the option that named them.
    index : str, optional
        Column to be kept as it is; by default the column of times, if there is one.
    reading : Reading, optional
        How the file is to be read.
    hint : str
        What to say if a column is not there that nobody has named, or none is named.
    compares : bool
        Whether the steps between rows will be compared with those of a model.
    inputs : AskedInputs or ModelInputs, optional
        Which columns are inputs, and which are made of the times.

    Raises
    ------
    ParameterError
        If a column is not there, is named twice, or none is named.
    FileFormatError
        If a cell is neither empty nor a finite number, the file is no table, or times are needed
        and cannot be read, or are not in order.
    """
    reading = reading or Reading()
    table = reading.table(path)
    seen: dict[str, str] = {}
    for option, names in columns.items():
        if not names:
            because = f", {hint}" if hint else ""
            raise UsageError(
                f"{option}: name a column of {path.name}{because}; its columns are {listed(table.columns)}"
            )
        for name in names:
            if name in seen:
                raise ParameterError(
                    f"{option}: the column {name!r} is named a second time, after {seen[name]}"
                )
            seen[name] = option
            if hint and name not in table.columns:
                raise ParameterError(
                    f"{path.name} has no column {name!r}, {hint}; its columns are {listed(table.columns)}"
                )
    values = {
        option: np.column_stack([table.numbers(name, gaps=True) for name in names])
        for option, names in columns.items()
    }
    needed = index is None or bool(inputs)
    found = row_times(table, reading, index, needed=needed, gaps=True, compares=compares)
    told = None if inputs is None else inputs.of(table, found)
    for name in () if told is None else told.columns:
        if name in seen:
            raise ParameterError(
                f"{seen[name]}: the column {name!r} is an input as well, expected it to be one of both"
            )
    notes = [*table.notes, *found.notes]
    kept = found.column if index is None else index
    if kept is None and table.has_index:
        kept = INDEX
    if kept is None:
        return Rows(path.name, values, "row", range(len(table)), notes, found.times, told)
    return Rows(path.name, values, kept, table.text(kept), notes, found.times, told)


def components(name: str, values: FloatArray, suffix: str = "") -> dict[str, FloatArray]:
    """Name the columns of an array (n, k): ``x``, or ``x0``, ``x1``, ..."""
    k = values.shape[1]
    return {f"{name}{'' if k == 1 else j}{suffix}": values[:, j] for j in range(k)}


def switch_columns(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Name the column of values of the switch: numbers (n,), or of class weights (n, K) the class.

    Between classes it is empty.
    """
    if values.ndim == 1:
        return {name: values}
    return {name: np.where(values.max(axis=1) == 1.0, values.argmax(axis=1), np.nan)}


def as_csv(
    index_name: str, index: Sequence[Any], columns: Mapping[str, FloatArray], *, formulas: bool = False
) -> str:
    """Write columns as comma-separated values; NaN becomes an empty cell.

    Numbers are written so that they are read back bit for bit.  Names, and text of the index, that a
    spreadsheet would compute get an apostrophe, unless ``formulas`` are wanted.
    """
    names = list(columns)
    if not formulas:
        names = [uncomputed(name) for name in names]
        index_name = uncomputed(index_name)
        index = [uncomputed(cell) if isinstance(cell, str) else cell for cell in index]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([index_name, *names])
    cells = [["" if np.isnan(v) else repr(v) for v in column.tolist()] for column in columns.values()]
    writer.writerows(zip(index, *cells, strict=True))
    return text.getvalue()

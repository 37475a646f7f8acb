"""``fuzzykf simulate``: draw a series from a model."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer

from fuzzykf.cli.columns import as_csv, components, switch_columns
from fuzzykf.cli.inputs import ModelInputs, columns_needed, inputs_of
from fuzzykf.cli.output import (
    UsageError,
    check_file,
    console_beside,
    progress_bar,
    report_errors,
    say,
    say_written,
    whole_option,
)
from fuzzykf.cli.reading import Decimal, Reading, Sep, Time, TimeFormat, row_times
from fuzzykf.cli.stamps import index_from, written_stamps
from fuzzykf.errors import ParameterError
from fuzzykf.files import write_text
from fuzzykf.labels import NO_LABELS
from fuzzykf.texts import counted, listed
from fuzzykf.times import read_times

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.clock import InputColumns
    from fuzzykf.labels import Labels
    from fuzzykf.results import Simulation

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf simulate model.json -n 1000 --seed 1 -o simulated.csv"

#: Rows that are drawn unless another number is asked for.
ROWS = 1000


def command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model from fuzzykf fit or save().")],
    n: Annotated[
        int | None,
        whole_option(
            1,
            "-n",
            metavar="ROWS",
            help="Number of rows. Default: 1000, or the number of rows of --inputs-from.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, whole_option(0, help="Seed of the random numbers.")] = 0,
    inputs_from: Annotated[
        Path | None,
        typer.Option(
            "--inputs-from",
            metavar="DATA.csv",
            help="CSV file with the inputs of the model, one row per row to simulate; clock inputs "
            "are computed from its times.",
            show_default=False,
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            metavar="TIME",
            help="Time of the first row, such as 2014-01-31T16:30, for a model with clock inputs "
            "only. The time step is that of the training data.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File for the series (CSV); - is standard output."
        ),
    ] = Path("simulated.csv"),
    formulas: Annotated[
        bool,
        typer.Option(
            "--formulas",
            help="Write column names unchanged. Otherwise, a name that a spreadsheet would compute "
            "(starting with =, +, - or @) is preceded by an apostrophe.",
        ),
    ] = False,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
) -> None:
    """Draw switch, state and observation from a model, and write them to a file.

    Columns are called as in the data that the model was learned on, so that filter and smooth can read
    them, else x and y. The same seed gives the same series.
    """
    with report_errors():
        from fuzzykf.io import load_model

        found: Any = load_model(model)
        check_file(output, model, *([] if inputs_from is None else [inputs_from]))
        labels = getattr(found, "labels", NO_LABELS)
        needed = ModelInputs(inputs_of(found), model.name)
        n, told = _told(needed, labels, n, inputs_from, start, Reading(time, time_format, sep, decimal))
        with progress_bar(2) as progress:
            progress("drawing")
            us = {} if told.inputs is None else {"us": told.inputs}
            series = found.simulate(n, np.random.default_rng(seed), **us)
            progress("writing")
            index, columns = _columns(series, labels, told)
            rows = range(n) if told.stamps is None else told.stamps
            write_text(output, as_csv(index, rows, columns, formulas=formulas))
    console = console_beside(output)
    say(console, f"Drew {counted(n, 'row')} from {found!r}.")
    say_written(console, output)


class _Told(NamedTuple):
    """What a series is drawn with."""

    inputs: InputColumns | None = None
    stamps: Sequence[str] | None = None  # times of the rows, as text
    row_name: str = "row"  # what the column is called that tells the rows apart
    beside: Mapping[str, FloatArray] = MappingProxyType({})  # inputs that no clock tells


def _told(
    needed: ModelInputs, labels: Labels, n: int | None, file: Path | None, start: str | None, reading: Reading
) -> tuple[int, _Told]:
    """Return how many rows are to be drawn, and what with.

    Raises
    ------
    ParameterError
        Names the option that is missing, or given to a model that has no use for it.
    """
    given = {"--inputs-from": file, "--start": start}
    asked = [option for option, value in given.items() if value is not None]
    if len(asked) == 2:
        raise UsageError("--inputs-from, --start: got both, expected one of them: a file has times")
    if asked and not needed:
        raise UsageError(
            f"{asked[0]}: got {given[asked[0]]}, but the model of {needed.model} has no inputs; expected none"
        )
    if file is not None:
        return _from_file(needed, n, file, reading)
    n = ROWS if n is None else n
    if not needed:
        return n, _Told()
    others = columns_needed(needed.names)
    if others:
        raise UsageError(
            f"--inputs-from: missing; the model of {needed.model} has the inputs {listed(others)}, which no "
            "clock tells: expected a file with a row for each row to draw"
        )
    if start is None:
        raise UsageError(
            f"--start: missing; the inputs of the model of {needed.model} are those of a clock, expected the "
            "time of the first row (or a file with times, by --inputs-from)"
        )
    if labels.step is None:
        raise UsageError(
            f"--start: got {start}, but the model of {needed.model} does not know how far rows are apart; "
            "expected --inputs-from"
        )
    index = index_from(read_times([start], name="--start"), n, labels.step)
    inputs = needed.made(read_times(index, ordered=False))
    return n, _Told(inputs, written_stamps(index), "time")


def _from_file(needed: ModelInputs, n: int | None, file: Path, reading: Reading) -> tuple[int, _Told]:
    table = reading.table(file)
    times = row_times(table, reading, gaps=True)
    inputs = needed.of(table, times)
    n = len(table) if n is None else n
    if n > len(table):
        raise ParameterError(
            f"--inputs-from: {file.name} has {counted(len(table), 'row')}, expected one for each of the "
            f"{n:,} to draw"
        )
    read = [[name] if name in table.columns else columns_needed([name]) for name in needed.names]
    beside = {name: table.numbers(name)[:n] for names in read for name in names}
    told = None if inputs is None else inputs[:n]
    if times.column is None:
        return n, _Told(told, beside=beside)
    return n, _Told(told, table.text(times.column)[:n], times.column, beside)


def _columns(series: Simulation, labels: Labels, told: _Told) -> tuple[str, dict[str, FloatArray]]:
    """Return the name of the column that counts the rows, and the others by name, each of them once.

    Observations and inputs keep their names, by which a filter takes them, and so does a column of times;
    what else is called so gets a word in front.
    """
    observations = _named("y", series.y, labels.observations) | dict(told.beside)
    taken = set(observations) | (set() if told.stamps is None else {told.row_name})

    def free(name: str, word: str) -> str:
        while name in taken:
            name = f"{word} {name}"
        taken.add(name)
        return name

    states = {free(name, "state"): x for name, x in _named("x", series.x, labels.states).items()}
    switch = free("switch", "drawn")
    index = free("row", "drawn") if told.stamps is None else told.row_name
    drawn = switch_columns(switch, series.r)
    if series.r.ndim == 2:
        drawn |= {free(f"class_{k}", "drawn"): weights for k, weights in enumerate(series.r.T)}
    return index, {**drawn, **states, **observations}


def _named(letter: str, values: FloatArray, names: tuple[str, ...] | None) -> dict[str, FloatArray]:
    return components(letter, values) if names is None else dict(zip(names, values.T, strict=True))

"""``fuzzykf forecast``: what a learned model expects after the last row of a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from fuzzykf.cli.columns import as_csv, components
from fuzzykf.cli.estimate import (
    Data,
    Formulas,
    Level,
    Model,
    Nodes,
    Obs,
    check_level,
    estimated_columns,
    filter_of,
    read_observed,
    told,
)
from fuzzykf.cli.inputs import ModelInputs, columns_needed, inputs_of
from fuzzykf.cli.law import notes_of_fades
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
from fuzzykf.cli.reading import (
    NONE,
    TIME_COLUMNS,
    Decimal,
    Reading,
    RowTimes,
    Sep,
    Time,
    TimeFormat,
    row_times,
)
from fuzzykf.cli.stamps import index_ahead, written_stamps
from fuzzykf.errors import ParameterError
from fuzzykf.files import write_text
from fuzzykf.texts import counted, listed
from fuzzykf.times import read_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.cli.columns import Rows
    from fuzzykf.clock import InputColumns
    from fuzzykf.datasets import Table
    from fuzzykf.times import Times

__all__ = ["EXAMPLE", "command"]

#: Standard deviations ahead, by that of the rows and by that of the first step, beyond which a note says so.
MOST_GROWTH = 3.0

EXAMPLE = "Example: fuzzykf forecast model.json new.csv --steps 24 -o forecast.csv"


def command(
    model: Model,
    data: Data,
    steps: Annotated[
        int | None,
        whole_option(
            1,
            "--steps",
            "-n",
            help="Number of steps after the last row. Default: the number of rows of --inputs-ahead.",
            show_default=False,
        ),
    ] = None,
    inputs_ahead: Annotated[
        Path | None,
        typer.Option(
            "--inputs-ahead",
            metavar="FILE",
            help="CSV file with the inputs of the steps ahead, one row per step. Clock inputs are "
            "computed without it.",
            show_default=False,
        ),
    ] = None,
    obs: Obs = None,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File for the results (CSV); - is standard output."
        ),
    ] = Path("forecast.csv"),
    nodes: Nodes = None,
    level: Level = 0.9,
    formulas: Formulas = False,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
) -> None:
    """Expect state and observation of the steps after the last row, from all observations.

    Writes a row for each step: estimate, standard deviation and interval of the state, switch, and mean and
    standard deviation of the observation. The times go on as those of the rows do.
    """
    with report_errors():
        from fuzzykf.io import load_model

        reading = Reading(time, time_format, sep, decimal)
        found: Any = load_model(model)
        f = filter_of(found, nodes)
        rows = read_observed(model, found, data, obs or [], None, reading)
        check_level(level)
        sources = [model, data] if inputs_ahead is None else [model, data, inputs_ahead]
        check_file(output, *sources)
        needed = ModelInputs(inputs_of(found), model.name)
        n, stamps, us = _ahead(rows, steps, inputs_ahead, needed, found.labels.step, reading)
        with progress_bar(2) as progress:
            progress("forecasting")
            f.filter(rows.values["--obs"], **told(rows.inputs))
            ahead = f.forecast(n, **told(us))
            # the same as to filter where nothing is seen, which tells what each node says of the state
            nothing = np.full((n, found.dim_z), np.nan)
            result = f.filter(nothing, **told(us), resume=True, keep_nodes=True)
            progress("writing")
            columns = estimated_columns(result, nothing, level, found.is_fuzzy)
            del columns["log_likelihood"]
            std = np.sqrt(np.diagonal(ahead.S, axis1=-2, axis2=-1))
            columns |= components("z", ahead.z_prior, "_prior") | components("z", std, "_prior_std")
            name, index = ("step", range(1, n + 1)) if stamps is None else (rows.index_name, stamps)
            write_text(output, as_csv(name, index, columns, formulas=formulas))
    console = console_beside(output)
    say(console, f"Forecast {counted(n, 'step')} after {counted(len(rows), 'row')} of {rows.source}.")
    fades = notes_of_fades(found.law, f.n_nodes) if found.is_fuzzy else ()
    growth = _notes_of_growth(found.labels.observations, std, rows.values["--obs"])
    for note in (*rows.notes, *fades, *growth):
        say(console, f"Note: {note}.")
    say_written(console, output)


def _notes_of_growth(names: Sequence[str] | None, std: FloatArray, seen: FloatArray) -> list[str]:
    """Say if standard deviations (n, q) of observations ahead grow beyond all that rows (k, q) have shown."""
    known = np.isfinite(seen).any(axis=0).all()
    spread = np.nanstd(seen, axis=0) if known else np.full(seen.shape[1], np.inf)
    worst = int((std[-1] / np.maximum(spread, np.finfo(float).tiny)).argmax())
    if not std[-1, worst] > MOST_GROWTH * max(spread[worst], std[0, worst]):
        return []
    name = names[worst] if names else f"z{worst}"
    return [
        f"the standard deviation of {name} grows from {std[0, worst]:.3g} to {std[-1, worst]:.3g} in "
        f"{counted(len(std), 'step')}, that of the rows is {spread[worst]:.3g}: this model explodes ahead; "
        "one without --objective filter, --products or --hinges may forecast better"
    ]


def _ahead(
    rows: Rows,
    steps: int | None,
    file: Path | None,
    needed: ModelInputs,
    step: np.timedelta64 | None,
    reading: Reading,
) -> tuple[int, list[str] | None, InputColumns | None]:
    """Return how many steps there are, their times as text, None if they are not known, and their inputs."""
    if file is None:
        if steps is None:
            raise UsageError("--steps: missing; expected how many steps ahead of the last row")
        others = columns_needed(needed.names)
        if others:
            raise UsageError(
                f"--inputs-ahead: missing; the model of {needed.model} has the inputs {listed(others)}, "
                "which no clock tells: expected a file with a row for each step ahead"
            )
        index = _index(rows, steps, step)
        if index is None and needed:
            raise ParameterError(
                f"{rows.source}: no times were read that say how they go on, and the inputs "
                f"{listed(needed.names)} are made of those of the steps ahead; --time names their column"
            )
        us = needed.made(read_times(index, ordered=False)) if needed else None
        return steps, _stamps(rows, index, reading), us
    if not needed:
        raise UsageError(
            f"--inputs-ahead: got {file.name}, but the model of {needed.model} has no inputs; expected none"
        )
    table = reading.table(file)
    n = len(table) if steps is None else steps
    if n > len(table):
        raise ParameterError(
            f"--inputs-ahead: {file.name} has {counted(len(table), 'row')}, expected one for each of "
            f"{n:,} steps ahead"
        )
    own = _times_of(table, reading)
    index = _index(rows, len(table), step)
    times = None if index is None else read_times(index, ordered=False)
    if own.times is None:
        us = needed.of(table, RowTimes(None, times))
        stamps = _stamps(rows, index, reading)
    else:  # they know when clocks are changed
        _check_follows(table.source, own.times, rows, times)
        us = needed.of(table, own)
        stamps = list(table.text(str(own.column)))
    return n, None if stamps is None else stamps[:n], None if us is None else us[:n]


def _index(rows: Rows, steps: int, step: np.timedelta64 | None) -> Any:
    return None if rows.times is None else index_ahead(rows.times, steps, step)


def _stamps(rows: Rows, index: Any, reading: Reading) -> list[str] | None:
    """Return times as text, as those of the rows are written; None if they are not known."""
    return None if index is None else written_stamps(index, [*map(str, rows.index)], reading.time_format)


def _times_of(table: Table, reading: Reading) -> RowTimes:
    """Return the times of the rows ahead, if the file has any: it need not have those of the other file."""
    named = reading.time is not None and reading.time.lower() != NONE
    if named and reading.time not in table.columns:
        return RowTimes()
    has_any = any(name.lower() in TIME_COLUMNS for name in table.columns)
    if reading.time is None and reading.time_format is not None and not has_any:
        return RowTimes()
    return row_times(table, reading)


def _check_follows(file: str, own: Times, rows: Rows, times: Times | None) -> None:
    """Raise unless the rows of a file have the times of the steps ahead, as far as these are known."""
    if times is not None:
        wrong = own.instant != times.instant
        if wrong.any():
            row = int(wrong.argmax())
            raise ParameterError(
                f"--inputs-ahead: row {row + 1} of {file} is of {own.clock[row]}, but step {row + 1} after "
                f"{rows.source} is {times.clock[row]}; expected the steps ahead, from the first one on"
            )
    elif rows.times is not None and not own.instant[0] > rows.times.instant[-1]:
        raise ParameterError(
            f"--inputs-ahead: {file} begins at {own.clock[0]}, not later than the last row of {rows.source}, "
            f"{rows.times.clock[-1]}; expected the steps ahead, from the first one on"
        )

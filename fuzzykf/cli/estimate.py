"""``fuzzykf filter`` and ``fuzzykf smooth``: a learned model on new observations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from fuzzykf.cli.columns import Rows, as_csv, components, read_rows, switch_columns
from fuzzykf.cli.inputs import ModelInputs, inputs_of
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
from fuzzykf.cli.reading import Decimal, Reading, Sep, Time, TimeFormat
from fuzzykf.errors import ParameterError
from fuzzykf.files import write_text
from fuzzykf.labels import check_step
from fuzzykf.texts import counted, listed

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.base import FilterResult
    from fuzzykf.clock import InputColumns
    from fuzzykf.labels import Labels

__all__ = [
    "FILTER_EXAMPLE",
    "SMOOTH_EXAMPLE",
    "check_level",
    "estimated_columns",
    "filter_command",
    "filter_of",
    "read_observed",
    "smooth_command",
    "told",
]

FILTER_EXAMPLE = "Example: fuzzykf filter model.json new.csv -o filtered.csv"
SMOOTH_EXAMPLE = "Example: fuzzykf smooth model.json new.csv -o smoothed.csv"

Model = Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model from fuzzykf fit or save().")]
Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA.csv",
        help="CSV file with column names in the first line, with the time step of the training data; "
        "empty cells are missing values. Inputs are found by name; clock inputs are computed from "
        "the times.",
    ),
]
Obs = Annotated[
    list[str] | None,
    typer.Option(
        "--obs",
        metavar="COL",
        help="Column of the observation, if its name differs from the training data; repeat it in "
        "the order of the training columns.",
        show_default=False,
    ),
]
Index = Annotated[
    str | None,
    typer.Option(
        "--index",
        metavar="COL",
        help="Column to copy to the results. Default: the time, if there is one.",
        show_default=False,
    ),
]
Nodes = Annotated[
    int | None,
    whole_option(
        0,
        help="Number of nodes between two classes. Default: that of the training if the law depends "
        "on it, else 5, or as many as fades have room for.",
        show_default=False,
    ),
]
Level = Annotated[float, typer.Option(help="Nominal coverage of the intervals.")]
Output = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FILE", help="File for the results (CSV); - is standard output."),
]
Formulas = Annotated[
    bool,
    typer.Option(
        "--formulas",
        help="Copy text unchanged. Otherwise, text that a spreadsheet would compute (starting with "
        "=, +, - or @) is preceded by an apostrophe.",
    ),
]


def filter_command(
    model: Model,
    data: Data,
    obs: Obs = None,
    output: Output = Path("filtered.csv"),
    index: Index = None,
    nodes: Nodes = None,
    level: Level = 0.9,
    formulas: Formulas = False,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
) -> None:
    """Estimate the state of each row from its observation and the earlier ones.

    Writes one row per row of the data: estimate, standard deviation, interval, switch, and log-density of the
    observation given the earlier ones (empty if the observation is missing).
    """
    reading = Reading(time, time_format, sep, decimal)
    _run("filter", model, data, obs or [], output, index, nodes, level, formulas, reading)


def smooth_command(
    model: Model,
    data: Data,
    obs: Obs = None,
    output: Output = Path("smoothed.csv"),
    index: Index = None,
    nodes: Nodes = None,
    level: Level = 0.9,
    formulas: Formulas = False,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
) -> None:
    """Estimate the state of each row from all earlier and later observations.

    Writes the columns of filter, and the most likely path of the switch.
    """
    reading = Reading(time, time_format, sep, decimal)
    _run("smooth", model, data, obs or [], output, index, nodes, level, formulas, reading)


def _run(
    verb: str,
    model_file: Path,
    data: Path,
    obs: list[str],
    output: Path,
    index: str | None,
    nodes: int | None,
    level: float,
    formulas: bool,
    reading: Reading,
) -> None:
    with report_errors():
        from fuzzykf.io import load_model

        model: Any = load_model(model_file)
        f = filter_of(model, nodes)
        rows = read_observed(model_file, model, data, obs, index, reading)
        zs = rows.values["--obs"]
        check_level(level)
        check_file(output, model_file, data)
        with progress_bar(2) as progress:
            progress(f"{verb}ing")
            result = (f.filter if verb == "filter" else f.smooth)(zs, **told(rows.inputs), keep_nodes=True)
            progress("writing")
            columns = estimated_columns(result, zs, level, model.is_fuzzy)
            write_text(output, as_csv(rows.index_name, rows.index, columns, formulas=formulas))
    if model.is_fuzzy:
        rows = replace(rows, notes=[*rows.notes, *notes_of_fades(model.law, f.n_nodes)])
    _print(verb, rows, zs, output)


def read_observed(
    model_file: Path, model: Any, data: Path, obs: list[str], index: str | None, reading: Reading
) -> Rows:
    """Read what a model observes, and its inputs, from a file; notes say what was replaced.

    Raises
    ------
    ParameterError, FileFormatError
        As from `read_rows`; if there are other components, or rows are as far apart as no model learned.
    """
    names, notes = _observed(model_file.name, model.labels, obs)
    hint = ""
    if not names:
        hint = f"for the model of {model_file.name} remembers no names"
    elif not obs:
        hint = f"which the model of {model_file.name} observes (--obs names another)"
    rows = read_rows(
        data,
        {"--obs": names},
        index,
        reading,
        hint=hint,
        compares=model.labels.step is not None,
        inputs=ModelInputs(inputs_of(model), model_file.name),
    )
    if len(names) != model.dim_z:
        raise UsageError(
            f"--obs: got {counted(len(names), 'column')}, but the model of {model_file.name} has "
            f"{counted(model.dim_z, 'observed component')}"
        )
    _check_step(rows, model.labels)
    return replace(rows, notes=[*notes, *rows.notes])


def told(inputs: InputColumns | None) -> dict[str, Any]:
    """Return what a filter is told of inputs, as an argument; nothing if there are none."""
    return {} if inputs is None else {"us": inputs}


def check_level(level: float) -> None:
    """Raise unless it is the coverage of an interval."""
    if not 0.0 < level < 1.0:
        raise UsageError(f"--level: got {level:g}, expected a number between 0 and 1")


def _observed(model: str, labels: Labels, obs: list[str]) -> tuple[list[str], list[str]]:
    """Return the columns to read, in the order of the model, and what to know about them."""
    learned = labels.observations or ()
    for name in obs:
        if name in (labels.states or ()) and name not in learned:
            seen = f", which was learned on {listed(learned)}" if learned else ""
            raise UsageError(
                f"--obs: {name!r} is a state of the model of {model}{seen}; name what is observed"
            )
    if not obs or set(obs) == set(learned):
        return list(learned), []
    if len(obs) != len(learned):
        return obs, []
    for k, (name, before) in enumerate(zip(obs, learned, strict=True)):
        if name in learned and name != before:
            raise UsageError(
                f"--obs: {name!r} is named in place {k + 1}, where the model of {model} has {before!r}; "
                f"expected the order in which they were learned: {listed(learned)}"
            )
    pairs = zip(obs, learned, strict=True)
    return obs, [f"{new} replaces {old}, which the model was learned on" for new, old in pairs if new != old]


def _check_step(rows: Rows, labels: Labels) -> None:
    """Refuse rows that are farther apart, or nearer, than those that were learned on."""
    try:
        check_step(rows.times, labels, rows.source, "--time none takes the rows as they come")
    except ParameterError as error:
        raise UsageError(str(error)) from error


def filter_of(model: Any, nodes: int | None) -> Any:
    """Return the filter of a model."""
    from fuzzykf.switching.models.base import SwitchingModel

    if not isinstance(model, SwitchingModel):
        raise ParameterError(f"model: got {type(model).__name__}, expected a CGOFMSModel or CGOMSModel")
    if nodes is not None and not model.is_fuzzy:
        raise UsageError(f"--nodes: got {nodes}, but the model has {counted(model.n_classes, 'hard regime')}")
    try:
        return model.filter(nodes)
    except ParameterError as error:
        raise error if nodes is None else UsageError(str(error)) from error


def estimated_columns(
    result: FilterResult, zs: FloatArray, level: float, fuzzy: bool
) -> dict[str, FloatArray]:
    """Return what is written of a result that has kept its nodes, by the names of the columns."""
    assert result.x is not None
    assert result.P is not None
    assert result.mu is not None
    assert result.log_likelihood is not None
    lower, upper = result.bounds(level)
    result = replace(result, node_x=None, node_P=None)
    std = np.sqrt(np.diagonal(result.P, axis1=-2, axis2=-1))
    columns = components("x", result.x) | components("x", std, "_std")
    columns |= components("x", lower, "_lower") | components("x", upper, "_upper")
    columns |= switch_columns("switch", np.asarray(result.switch))
    if fuzzy and result.switch_mean is None:  # between more than two classes
        columns |= {f"class_{k}": u for k, u in enumerate(result.class_weights.T)}
    elif fuzzy:
        columns["switch_mean"] = np.asarray(result.switch_mean)
    else:
        columns |= {f"regime_{k}": p for k, p in enumerate(result.mu.T)}
    if result.switch_path is not None:
        columns |= switch_columns("switch_path", np.asarray(result.switch_path))
    nothing = np.isnan(zs).all(axis=1)
    columns["log_likelihood"] = np.where(nothing, np.nan, result.log_likelihood)
    return columns


def _print(verb: str, rows: Rows, zs: FloatArray, output: Path) -> None:
    console = console_beside(output)
    gaps = int(np.isnan(zs).any(axis=1).sum())
    lack = "lacks" if gaps == 1 else "lack"
    told = f", of which {gaps:,} {lack} something of the observation" if gaps else ""
    done = "Filtered" if verb == "filter" else "Smoothed"
    say(console, f"{done} {counted(len(rows), 'row')} of {rows.source}{told}.")
    for note in rows.notes:
        say(console, f"Note: {note}.")
    say_written(console, output)

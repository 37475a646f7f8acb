"""``fuzzykf reproduce``: the tables and figures of the papers, beside what was printed."""

from __future__ import annotations

import csv
import io
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table as Grid

from fuzzykf.cli.output import check_folder, progress_bar, report_errors, whole_option
from fuzzykf.errors import ParameterError
from fuzzykf.files import write_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.experiments import Experiment, Outcome

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf reproduce nodes hard-fraction --quick --out papers"

#: Verdicts, in the order of the summary.
VERDICTS = ("reproduced", "reproduced with a correction", "not reproduced", "not printed")


def command(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME... | all]", help="Experiments to run; see --list.", show_default=False),
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="List the experiments and exit.")] = False,
    runs: Annotated[
        int | None,
        whole_option(
            2,
            help="Number of independent runs, also with --quick. Default: that of each experiment.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, whole_option(0, help="Seed of all random numbers.")] = 0,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Directory for a table (CSV), a record (JSON) and a figure (PNG) of each "
            "experiment. An interrupted run continues from there.",
        ),
    ] = Path("fuzzykf-reproduce"),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer runs, for a quick look.")] = False,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            envvar="FUZZYKF_DATA",
            help="Directory of measured data that are not part of the package. Without it, 'all' "
            "skips the experiments that need them.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Reproduce the tables and figures of the papers, and compare them with the printed values.

    The verdict on each number is a statistical test, at 5 % for each experiment as a whole:
    reproduced, reproduced with a correction, or not reproduced.
    """
    with report_errors():
        from fuzzykf.experiments import EXPERIMENTS, perform, write

        if list_:
            _print_list(list(EXPERIMENTS.values()))
            return
        chosen = _choose(names or [], EXPERIMENTS)
        check_folder(out)
        outcomes, seconds = [], []
        chosen, left_out = _with_data(chosen, data, required=names or [])
        with progress_bar(sum(len(experiment.pieces) for experiment in chosen)) as progress:
            for experiment in chosen:
                start = time.perf_counter()
                outcome = perform(
                    experiment,
                    runs=experiment.quick_runs if quick and runs is None else runs,
                    seed=seed,
                    folder=out,
                    data=data,
                    progress=progress,
                )
                write(outcome, out)
                outcomes.append(outcome)
                seconds.append(time.perf_counter() - start)
        write_text(out / "summary.csv", _summary(outcomes))
    console = Console()
    if "all" not in (names or []):
        for outcome in outcomes:
            console.print(_rows(outcome))
    console.print(_overview(outcomes, seconds))
    for reason in left_out:
        console.print(f"Skipped: {reason}", soft_wrap=True, highlight=False)
    console.print(f"Tables, records and pictures are in {out}", soft_wrap=True, highlight=False)


def _choose(names: Sequence[str], there: dict[str, Experiment]) -> list[Experiment]:
    if not names:
        raise ParameterError(f"NAME: missing; expected all, or some of {', '.join(there)}")
    unknown = [name for name in names if name != "all" and name not in there]
    if unknown:
        raise ParameterError(f"NAME: got {unknown[0]!r}, expected all, or some of {', '.join(there)}")
    return [experiment for name, experiment in there.items() if "all" in names or name in names]


def _with_data(
    chosen: Sequence[Experiment], data: Path | None, *, required: Sequence[str]
) -> tuple[list[Experiment], list[str]]:
    """Return the experiments whose data are there, and why others are left out.

    What was asked for by its name is not left out.
    """
    there, left_out = [], []
    for experiment in chosen:
        try:
            if experiment.load is not None:
                experiment.load(data)
        except FileNotFoundError as error:
            if experiment.name in required:
                raise
            left_out.append(f"{experiment.name}: {error}")
        else:
            there.append(experiment)
    return there, left_out


def _print_list(experiments: Sequence[Experiment]) -> None:
    grid = Grid("name", "paper", "what it reproduces", "runs", "quick")
    for e in experiments:
        grid.add_row(e.name, e.paper, e.reproduces, str(e.runs), str(e.quick_runs))
    Console().print(grid)


def _rows(outcome: Outcome) -> Grid:
    grid = Grid("quantity", "printed", "ours", "± s.e.", "verdict", title=outcome.experiment.reproduces)
    for row in outcome.rows:
        printed = "" if row.printed is None else f"{row.printed:.4g}"
        error = "" if row.standard_error is None else f"{row.standard_error:.2g}"
        grid.add_row(row.quantity, printed, f"{row.ours:.4g}", error, row.verdict)
    return grid


def _overview(outcomes: Sequence[Outcome], seconds: Sequence[float]) -> Grid:
    title = f"Rows by verdict: {', '.join(VERDICTS)}"
    grid = Grid(title=title)
    for header in ("experiment", "paper", "runs", "as printed", "corrected", "not", "–", "seconds"):
        grid.add_column(header, no_wrap=True, justify="left" if header == "experiment" else "right")
    for outcome, spent in zip(outcomes, seconds, strict=True):
        e = outcome.experiment
        counts = [str(outcome.counts.get(verdict, 0)) for verdict in VERDICTS]
        grid.add_row(e.name, e.paper, str(outcome.runs), *counts, f"{spent:.0f}")
    return grid


def _summary(outcomes: Sequence[Outcome]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["experiment", "paper", "reproduces", "runs", "seed", *VERDICTS])
    for outcome in outcomes:
        e = outcome.experiment
        counts = [outcome.counts.get(verdict, 0) for verdict in VERDICTS]
        writer.writerow([e.name, e.paper, e.reproduces, outcome.runs, outcome.seed, *counts])
    return stream.getvalue()

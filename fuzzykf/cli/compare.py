"""``fuzzykf compare``: fuzzy and hard switches, IMM, Kalman filter, regressions, side by side."""

from __future__ import annotations

import csv
import io
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from fuzzykf.cli.compare_source import SourceName, from_file, from_package, naming_columns
from fuzzykf.cli.output import (
    check_file,
    check_folder,
    progress_bar,
    report_errors,
    say,
    say_written,
    whole_option,
)
from fuzzykf.cli.reading import Decimal, Reading, Sep, Time, TimeFormat
from fuzzykf.comparison.candidates.switching import LAWS
from fuzzykf.errors import ParameterError
from fuzzykf.files import write_bytes, write_text
from fuzzykf.texts import literal

if TYPE_CHECKING:
    from fuzzykf.cli.compare_source import Source
    from fuzzykf.comparison import Comparison

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf compare meters.csv --state demand --obs temperature --folds 5 --out result"

#: Width of a terminal on which an interval stands on one line of the table.
WIDE = 100

CSV_HEADER = (
    "method,rmse,rmse_low,rmse_high,coverage_90,log_likelihood_per_step,microseconds_per_step,"
    "log_score,log_score_standard_error,log_score_low,log_score_high,density,normal_log_score\n"
)


class SwitchSource(StrEnum):
    """Where the switch of the learning part comes from."""

    LEARNED = "learned"
    CLOCK = "clock"
    QUANTILES = "quantiles"


if TYPE_CHECKING:

    class Law(StrEnum):
        """Family of the law of the fuzzy switch."""

        AUTO = "auto"
else:
    Law = StrEnum("Law", {name.upper(): name for name in ("auto", *LAWS)})


def command(
    data: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DATA.csv]",
            help="CSV file with column names in the first line. Omit it to use packaged data (see --data).",
            show_default=False,
        ),
    ] = None,
    packaged: Annotated[
        SourceName | None,
        typer.Option(
            "--data",
            help="Packaged data, instead of a file. victoria (default): electricity demand from "
            "temperature, hourly, Victoria, 2014. weather: relative humidity from temperature, "
            "hourly, an airport of New York, 2013, with gaps.",
            show_default=False,
        ),
    ] = None,
    state: Annotated[
        str | None,
        typer.Option("--state", metavar="COL", help="Column to estimate.", show_default=False),
    ] = None,
    obs: Annotated[
        str | None,
        typer.Option("--obs", metavar="COL", help="Column to estimate it from.", show_default=False),
    ] = None,
    train: Annotated[
        float,
        typer.Option(metavar="FRACTION", help="Share of the rows used for training before the first fold."),
    ] = 0.5,
    folds: Annotated[
        int,
        whole_option(
            1,
            help="Number of folds of the other rows. All methods are trained again before each fold, "
            "on all earlier rows.",
        ),
    ] = 5,
    jobs: Annotated[
        int | None,
        whole_option(
            1,
            help="Number of processes for the folds; results do not depend on it. Default: the "
            "number of processors, if worthwhile.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Directory for comparison.csv and comparison.png.")
    ] = Path("fuzzykf-compare"),
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="Also write an HTML page with table, interactive plot and settings; it works "
            "offline (5 MB).",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, whole_option(0, help="Seed of the bootstrap.")] = 0,
    time: Time = None,
    time_format: TimeFormat = None,
    sep: Sep = None,
    decimal: Decimal = None,
    profile: Annotated[
        bool | None,
        typer.Option(
            "--profile/--no-profile",
            help="Subtract the daily profile: the mean state at each time of day, on working days "
            "and on other days (column workday, else Monday to Friday), from the training rows. "
            "Default: only for victoria.",
            show_default=False,
        ),
    ] = None,
    switch: Annotated[
        SwitchSource,
        typer.Option(
            help="Switch of the training rows. learned: hidden, learned with each model. clock: 0 in "
            "the hours in which the state is lowest, 1 where it is highest. quantiles: 0 below the "
            "20 % quantile of the observation, 1 above the 80 % quantile."
        ),
    ] = SwitchSource.LEARNED,
    law: Annotated[
        Law,
        typer.Option(
            help="Law of the fuzzy switch. auto: the one with the best log score on validation rows "
            "(fmc1 if the switch is not learned)."
        ),
    ] = Law.AUTO,
    nodes: Annotated[
        int,
        whole_option(
            0,
            help="Number of nodes between 0 and 1; the time per step is proportional to (nodes + 2)^2.",
        ),
    ] = 5,
    also: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Additional candidate, such as hard3 or fmc1 (an unknown name lists all); may be repeated.",
            show_default=False,
        ),
    ] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Report how far this candidate is behind the winners, with intervals; it is added "
            "if necessary. May be repeated.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compare filters with fuzzy and hard switches, IMM, Kalman filter and regressions on one series.

    The methods are trained on the first rows, with state and observation, and tested on later rows, from
    the observation alone, fold by fold. Prints a table and writes it with a plot.
    """
    from fuzzykf import comparison
    from fuzzykf.comparison.report import check_installed, report_page

    with report_errors():
        reading = Reading(time, time_format, sep, decimal)
        if data is not None and packaged is not None:
            raise ParameterError(f"--data: got {packaged.value} beside the file {data}, expected one of them")
        if data is None:
            name = (packaged or SourceName.VICTORIA).value
            source = from_package(name, state, obs, reading)
        else:
            name, needed = None, bool(profile) or switch is SwitchSource.CLOCK
            source = from_file(data, state, obs, reading, needs_time=needed)
        profile = source.profile if profile is None else profile
        with naming_columns(source):
            task = comparison.prepare(
                source.state,
                source.observation,
                train=train,
                time=source.time,
                workday=source.workday,
                profile=profile,
                switch=switch.value,
            )
        main = comparison.main_methods(law.value, times=task.clock is not None)
        methods = [*main, *map(comparison.candidate, also or [])]
        rivals = dict.fromkeys(against or [])
        methods += [comparison.candidate(one) for one in rivals if one not in {m.name for m in methods}]
        check_folder(out)
        if report is not None:
            _check_report(report, data)
            check_installed()
        pieces = folds * sum(method.pieces for method in methods) + (2 if report is None else 3)
        with progress_bar(pieces) as progress, naming_columns(source):
            result = comparison.compare(
                task,
                np.random.default_rng(seed),
                methods=methods,
                n_folds=folds,
                n_nodes=nodes,
                n_jobs=comparison.worthwhile_jobs(task, folds) if jobs is None else jobs,
                progress=progress,
            )
            progress("picture")
            label = source.state_label + (", less its daily profile" if task.profile else "")
            figure = comparison.plot_comparison(result, state_label=literal(label), unit=source.unit)
            picture = io.BytesIO()
            figure.savefig(picture, format="png", dpi=150)
            if report is not None:
                progress("report")
                repeat = {
                    "--train": train,
                    "--folds": folds,
                    "--switch": switch,
                    "--law": law,
                    "--nodes": nodes,
                    "--seed": seed,
                }
                begin = [str(data)] if name is None else ["--data", name]
                named = [f"--also={one}" for one in also or []] + [f"--against={one}" for one in rivals]
                settings = _settings(result, source, begin, reading, repeat, named)
                page = report_page(
                    result, title=source.title, state_label=label, unit=source.unit, settings=settings
                )
        out.mkdir(parents=True, exist_ok=True)
        files = [out / "comparison.csv", out / "comparison.png"]
        write_text(files[0], _as_csv(result))
        write_bytes(files[1], picture.getvalue())
        if report is not None:
            report.parent.mkdir(parents=True, exist_ok=True)
            write_text(report, page)
            files.append(report)
    _print(result, source, label, files, list(rivals))


# --------------------------------------------------------------------------- output


def _check_report(report: Path, data: Path | None) -> None:
    """Refuse, before any work is done, a page that cannot be written; its folder may be yet to come."""
    check_folder(report.parent)
    if report.parent.is_dir():
        check_file(report, *([] if data is None else [data]), option="--report")


def _settings(
    result: Comparison,
    source: Source,
    begin: list[str],
    reading: Reading,
    options: dict[str, object],
    named: list[str],
) -> dict[str, str]:
    """Say what a reader needs to repeat the comparison."""
    import platform
    import shlex

    from fuzzykf import __version__

    task = result.task
    words = ["fuzzykf", "compare", *begin]
    words += ["--state", source.state_column, "--obs", source.observation_column]
    words += reading.words()
    words += [str(word) for pair in options.items() for word in pair]
    words += named
    words += ["--profile" if task.profile else "--no-profile"]
    return {
        "data": source.title,
        "state": source.state_column,
        "observation": source.observation_column,
        "rows": f"{len(task.state):,}: {task.n_train:,} for training, {task.n_test:,} for testing",
        "folds": f"{len(result.folds)}, trained again before each fold, on all earlier rows",
        "daily profile of the state": "subtracted" if task.profile else "not subtracted",
        "switch": task.switch_source,
        "law of the fuzzy switch": str(options["--law"]),
        "nodes of the fuzzy switch": f"{options['--nodes']} between 0 and 1",
        "bootstrap": f"blocks of {result.block_length} steps, seed {options['--seed']}",
        "made with": f"fuzzykf {__version__}, NumPy {np.__version__}, Python {platform.python_version()}",
        "command": shlex.join(words),
    }


def _as_csv(result: Comparison) -> str:
    text = io.StringIO()
    text.write(CSV_HEADER)
    writer = csv.writer(text, lineterminator="\n")
    for s in result.scores:
        likelihood = "" if s.log_likelihood is None else repr(s.log_likelihood)
        row = [s.rmse, s.rmse_low, s.rmse_high, s.coverage]
        state = map(repr, (s.log_score, s.log_score_standard_error, s.log_score_low, s.log_score_high))
        law = [s.density, repr(s.normal_log_score)]
        writer.writerow([s.title, *map(repr, row), likelihood, f"{s.microseconds:.3g}", *state, *law])
    return text.getvalue()


def _print(result: Comparison, source: Source, label: str, files: list[Path], rivals: list[str]) -> None:
    from fuzzykf.comparison.wording import (
        about_choices,
        about_failures,
        about_intervals,
        about_task,
        cells,
        labels,
    )

    console = Console()
    say(console, f"{source.title}: {label}", "bold")
    say(console, about_task(result, source.unit))
    grid = Grid()
    grid.add_column("method")
    for title in labels(source.unit):
        grid.add_column(title, justify="right")
    for s in result.scores:
        row: tuple[str, ...] = cells(s)
        if console.width < WIDE:  # else names of methods would be cut
            row = tuple(cell.replace(" to ", "\nto ").replace("–", "–\n") for cell in row)
        grid.add_row(Text(s.title, "bold" if s.name == result.best else ""), *row)
    console.print(grid)
    say(console, about_intervals(result), "dim")
    for sentence in (*about_failures(result), *about_choices(result)):
        say(console, sentence)
    for note in source.notes:
        say(console, f"Note: {note}.")
    say(console, result.verdict(source.unit), "bold")
    for rival in rivals:
        if rival not in result.failures:  # of which was told above
            say(console, result.against(rival, source.unit), "bold")
    for file in files:
        say_written(console, file)

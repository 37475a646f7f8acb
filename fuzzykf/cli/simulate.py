"""``fuzzykf simulate``: draw a series from a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from fuzzykf.cli.columns import as_csv, components
from fuzzykf.cli.output import check_file, console_beside, progress_bar, report_errors, say, say_written
from fuzzykf.files import write_text

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf simulate model.json -n 1000 --seed 1 -o simulated.csv"


def command(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.json", help="A model that fuzzykf fit, or save(), has written.")
    ],
    n: Annotated[int, typer.Option("-n", min=1, metavar="ROWS", help="Number of rows.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File for the series (CSV); - is standard output."
        ),
    ] = Path("simulated.csv"),
) -> None:
    """Draw switch, state and observation from a model, and write them to a file.

    The same seed gives the same series.
    """
    with report_errors():
        from fuzzykf.io import load_model

        found: Any = load_model(model)
        check_file(output, model)
        with progress_bar(2) as progress:
            progress("drawing")
            series = found.simulate(n, np.random.default_rng(seed))
            progress("writing")
            columns = {"switch": series.r} | components("x", series.x) | components("y", series.y)
            write_text(output, as_csv("row", range(n), columns))
    console = console_beside(output)
    say(console, f"Drew {n:,} rows from {found!r}.")
    say_written(console, output)

"""``fuzzykf simulate``: draw a series from a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from fuzzykf.cli.columns import as_csv, components, switch_columns
from fuzzykf.cli.output import (
    check_file,
    console_beside,
    progress_bar,
    report_errors,
    say,
    say_written,
    whole_option,
)
from fuzzykf.files import write_text
from fuzzykf.labels import NO_LABELS
from fuzzykf.texts import counted

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.labels import Labels
    from fuzzykf.results import Simulation

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf simulate model.json -n 1000 --seed 1 -o simulated.csv"


def command(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.json", help="A model that fuzzykf fit, or save(), has written.")
    ],
    n: Annotated[int, whole_option(1, "-n", metavar="ROWS", help="Number of rows.")] = 1000,
    seed: Annotated[int, whole_option(0, help="Seed of the random numbers.")] = 0,
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
            help="Write names of columns as they are. Without it, one that a spreadsheet would compute (it "
            "begins with =, +, - or @, and is no number) gets an apostrophe in front.",
        ),
    ] = False,
) -> None:
    """Draw switch, state and observation from a model, and write them to a file.

    Columns are called as in the data that the model was learned on, so that filter and smooth can read
    them, else x and y. The same seed gives the same series.
    """
    with report_errors():
        from fuzzykf.io import load_model

        found: Any = load_model(model)
        check_file(output, model)
        with progress_bar(2) as progress:
            progress("drawing")
            series = found.simulate(n, np.random.default_rng(seed))
            progress("writing")
            index, columns = _columns(series, getattr(found, "labels", NO_LABELS))
            write_text(output, as_csv(index, range(n), columns, formulas=formulas))
    console = console_beside(output)
    say(console, f"Drew {counted(n, 'row')} from {found!r}.")
    say_written(console, output)


def _columns(series: Simulation, labels: Labels) -> tuple[str, dict[str, FloatArray]]:
    """Return the name of the column that counts the rows, and the others by name, each of them once.

    Observations keep their names, by which a filter takes them; what else is called so gets a word in front.
    """
    observations = _named("y", series.y, labels.observations)
    taken = set(observations)

    def free(name: str, word: str) -> str:
        while name in taken:
            name = f"{word} {name}"
        taken.add(name)
        return name

    states = {free(name, "state"): x for name, x in _named("x", series.x, labels.states).items()}
    switch, index = free("switch", "drawn"), free("row", "drawn")
    told = switch_columns(switch, series.r)
    if series.r.ndim == 2:
        told |= {free(f"class_{k}", "drawn"): weights for k, weights in enumerate(series.r.T)}
    return index, {**told, **states, **observations}


def _named(letter: str, values: FloatArray, names: tuple[str, ...] | None) -> dict[str, FloatArray]:
    return components(letter, values) if names is None else dict(zip(names, values.T, strict=True))

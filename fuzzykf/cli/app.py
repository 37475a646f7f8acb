"""The commands, put together."""

from __future__ import annotations

from typing import Annotated

import typer

import fuzzykf
from fuzzykf.cli import compare, estimate, fit, forecast, play, reproduce, simulate

__all__ = ["app"]

app = typer.Typer(
    name="fuzzykf",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"fuzzykf {fuzzykf.__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    """Filter systems whose regime switches abruptly or gradually."""


app.command("compare", epilog=compare.EXAMPLE)(compare.command)
app.command("fit", epilog=fit.EXAMPLE)(fit.command)
app.command("filter", epilog=estimate.FILTER_EXAMPLE)(estimate.filter_command)
app.command("smooth", epilog=estimate.SMOOTH_EXAMPLE)(estimate.smooth_command)
app.command("forecast", epilog=forecast.EXAMPLE)(forecast.command)
app.command("simulate", epilog=simulate.EXAMPLE)(simulate.command)
app.command("reproduce", epilog=reproduce.EXAMPLE)(reproduce.command)
app.command("play", epilog=play.EXAMPLE)(play.command)

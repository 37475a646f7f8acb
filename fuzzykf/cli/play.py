"""``fuzzykf play``: a page with sliders, on this machine."""

from __future__ import annotations

import webbrowser
from typing import Annotated

import typer
from rich.console import Console

from fuzzykf.cli.output import report_errors, say

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: fuzzykf play --port 8765 --no-browser"


def command(
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, metavar="PORT", help="Port on 127.0.0.1; 0 means any free port."),
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Whether to open the page in a browser.")
    ] = True,
) -> None:
    """Explore a fading switch: move sliders and see the estimates of three filters.

    Sliders set dwell time, fade length, contrast and noise. The page is served on this machine only,
    until Ctrl-C. Needs plotly: pip install 'fuzzykf[cli,report]'.
    """
    with report_errors():
        from fuzzykf.play.server import HOST, make_server

        with make_server(port) as server:
            address = f"http://{HOST}:{server.server_address[1]}/"
            say(Console(), f"Serving {address} until Ctrl-C.")
            if browser:
                webbrowser.open(address)
            try:
                server.serve_forever()
            except KeyboardInterrupt:
                say(Console(), "Stopped.")

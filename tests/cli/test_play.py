"""``fuzzykf play`` serves, opens a browser if it should, and stops quietly."""

from __future__ import annotations

import sys
import webbrowser
from http.server import ThreadingHTTPServer
from urllib.request import urlopen

import pytest
from typer.testing import CliRunner

from fuzzykf.cli.app import app


@pytest.mark.parametrize("browser", [True, False])
def test_it_serves_until_it_is_stopped(monkeypatch, browser) -> None:
    opened, pages = [], []

    def stopped(self):
        self.timeout = 10
        pages.append(self.server_port)
        raise KeyboardInterrupt

    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(ThreadingHTTPServer, "serve_forever", stopped)
    result = CliRunner().invoke(app, ["play"] + ([] if browser else ["--no-browser"]))
    assert result.exit_code == 0, result.output
    address = f"http://127.0.0.1:{pages[0]}/"
    assert result.output == f"Serving {address} until Ctrl-C.\nStopped.\n"
    assert opened == [address] * browser
    with pytest.raises(OSError, match="refused"):  # the port is free again
        urlopen(address, timeout=5)


def test_a_port_that_is_none_is_refused() -> None:
    assert CliRunner().invoke(app, ["play", "--port", "70000"]).exit_code == 2


def test_without_plotly_the_extra_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    monkeypatch.setattr("fuzzykf.play.server._script", lambda: _uncached())
    result = CliRunner().invoke(app, ["play", "--no-browser"])
    assert result.exit_code == 1
    assert "needs plotly: pip install 'fuzzykf[report]'" in result.output


def _uncached():
    from fuzzykf.comparison.report_picture import plotly_script

    return plotly_script()

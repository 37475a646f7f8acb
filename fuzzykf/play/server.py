"""Serves the page to this machine alone."""

from __future__ import annotations

import json
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlsplit

from fuzzykf.comparison.report_picture import plotly_script
from fuzzykf.errors import ParameterError
from fuzzykf.play.scene import BOUNDS, Settings, scene

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["HOST", "make_server"]

#: Nobody but this machine.
HOST = "127.0.0.1"

JAVASCRIPT, HTML = "text/javascript; charset=utf-8", "text/html; charset=utf-8"
JSON, PLAIN = "application/json", "text/plain"


def make_server(port: int = 0) -> ThreadingHTTPServer:
    """Return a server of the page, which `serve_forever` starts.

    Parameters
    ----------
    port : int
        Where it listens on 127.0.0.1; 0 takes any that is free.

    Returns
    -------
    http.server.ThreadingHTTPServer
        ``server_address`` has the port.

    Raises
    ------
    MissingDependencyError
        If plotly, which holds the script that draws, is not installed.
    OSError
        If the port is taken.
    """
    _script()
    server = ThreadingHTTPServer((HOST, port), Handler)
    server.daemon_threads = True
    return server


class Handler(BaseHTTPRequestHandler):
    """Answers with the page, the script that draws, and scenes."""

    server: ThreadingHTTPServer

    def do_GET(self) -> None:
        """Answer a request; what is no good is told in words."""
        port = self.server.server_port
        if self.headers.get("Host") not in {f"{HOST}:{port}", f"localhost:{port}"}:
            # a page of another site, whose name was made to lead here, must not read this one
            self._answer(HTTPStatus.FORBIDDEN, PLAIN, b"only for this machine")
            return
        path, query = urlsplit(self.path)[2:4]
        if path == "/scene":
            try:
                found = scene(Settings.from_text(dict(parse_qsl(query, keep_blank_values=True))))
            except ParameterError as error:
                self._answer(HTTPStatus.BAD_REQUEST, JSON, _json({"error": str(error)}))
                return
            self._answer(HTTPStatus.OK, JSON, _json(found))
        elif path in PAGES:
            kind, make = PAGES[path]
            self._answer(HTTPStatus.OK, kind, make())
        else:
            self._answer(HTTPStatus.NOT_FOUND, PLAIN, b"no such page")

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Keep the terminal quiet: a slider asks many times."""


def _json(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode()


@cache
def _script() -> bytes:
    return plotly_script().encode()


@cache
def _page() -> bytes:
    text = resources.files("fuzzykf.play").joinpath("page.html").read_text(encoding="utf-8")
    start = Settings()
    sliders = {name: [*bounds, getattr(start, name)] for name, bounds in BOUNDS.items()}
    return text.replace("SLIDERS", json.dumps(sliders)).encode()


#: What stands where.
PAGES: dict[str, tuple[str, Callable[[], bytes]]] = {
    "/": (HTML, _page),
    "/plotly.js": (JAVASCRIPT, _script),
}

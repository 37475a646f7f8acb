"""``python -m fuzzykf`` and the command ``fuzzykf``."""

from __future__ import annotations

import io
import sys

from fuzzykf import engine
from fuzzykf.errors import MissingDependencyError, ParameterError

__all__ = ["main"]


def main() -> None:
    """Run the command line, or say which extra it needs, or which engine there is not."""
    try:
        engine.info()
    except (MissingDependencyError, ParameterError) as error:  # the commands import kernels before they run
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)
    try:
        from fuzzykf.cli.app import app
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in {"typer", "rich"}:
            raise
        sys.exit(f"The command line needs {missing}: pip install 'fuzzykf[cli]'")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without µ shows ?, and gets its table
    app()


if __name__ == "__main__":
    main()

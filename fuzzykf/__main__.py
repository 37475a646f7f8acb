"""``python -m fuzzykf`` and the command ``fuzzykf``."""

from __future__ import annotations

import io
import os
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
    if "_FUZZYKF_COMPLETE" in os.environ:  # a shell asks what may follow, and takes each line for an answer,
        os.environ["COLUMNS"] = "1000"  # so no help of an option may go on in a second one
    app(prog_name="fuzzykf")  # however it was started: the shell asks by this name


if __name__ == "__main__":
    main()

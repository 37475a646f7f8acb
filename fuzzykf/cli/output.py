"""What the commands share: the report of errors, the progress bar, the check of where to write."""

from __future__ import annotations

import os
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.text import Text

from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.files import check_writable, is_stdout
from fuzzykf.progress import progress_bar
from fuzzykf.texts import printable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any, TextIO

__all__ = [
    "UsageError",
    "check_file",
    "check_folder",
    "console_beside",
    "progress_bar",
    "report_errors",
    "say",
    "say_written",
    "whole_option",
]

#: Where the sources of fuzzykf are.
_PACKAGE = Path(__file__).parents[1]


class UsageError(ParameterError):
    """What is asked for does not go with the model that it is asked of: exit code 2, as for any misuse."""


def whole_option(least: int, *names: str, metavar: str = "N", **options: Any) -> Any:
    """Return an option that takes a whole number of at least ``least``, and says what came instead."""

    def checked(value: int | None) -> int | None:
        if value is not None and value < least:
            raise typer.BadParameter(f"got {value}, expected a whole number of at least {least}")
        return value

    return typer.Option(*names, metavar=f"{metavar} [x>={least}]", callback=checked, **options)


@contextmanager
def report_errors() -> Iterator[None]:
    """Turn an error that the user can mend into a message and exit code 1, or 2 if it is a `UsageError`.

    Warnings of fuzzykf become notes on standard error, on one line and once each.
    """
    try:
        with _warnings_as_notes():
            yield
    except BrokenPipeError:  # nobody reads on: typer ends without a word
        raise
    except (FuzzykfError, OSError) as error:
        told = Text.assemble(("Error: ", "bold red"), printable(_message(error)))
        Console(stderr=True, soft_wrap=True).print(told)
        raise typer.Exit(2 if isinstance(error, UsageError) else 1) from error


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    notes: dict[str, None] = {}
    with warnings.catch_warnings():
        show = warnings.showwarning

        def keep(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            own = category.__module__.partition(".")[0] == "fuzzykf"
            if own or Path(filename).is_relative_to(_PACKAGE):
                notes[" ".join(str(message).split())] = None
            else:
                show(message, category, filename, lineno, file, line)

        warnings.showwarning = keep
        try:
            yield
        finally:
            for note in notes:
                say(Console(stderr=True), f"Note: {note}.")


def _message(error: FuzzykfError | OSError) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def say(console: Console, sentence: str, style: str = "") -> None:
    """Print a sentence, in which names of columns and files are text and nothing else.

    It is wrapped on a terminal, and stays on a line where a program or a file takes it.
    """
    console.print(Text(printable(sentence), style), soft_wrap=not console.is_terminal)


def say_written(console: Console, file: Path) -> None:
    """Say where the results are, on one line."""
    place = "to standard output" if is_stdout(file) else str(file)
    console.print(Text(printable(f"Wrote {place}")), soft_wrap=True)


def console_beside(file: Path) -> Console:
    """Return where to print what is said beside the results: not among them."""
    return Console(stderr=is_stdout(file))


def check_folder(folder: Path) -> None:
    """Refuse, before any work is done, a folder into which nothing can be written.

    Raises
    ------
    OSError
        If the path, or the part of it that exists, is no folder or is not writable.
    """
    existing = folder
    while not existing.exists():
        existing = existing.parent
    if not existing.is_dir():
        raise NotADirectoryError(20, "expected a folder, found a file", str(existing))
    if not os.access(existing, os.W_OK):
        raise PermissionError(13, "the folder is not writable", str(existing))


def check_file(file: Path, *sources: Path, option: str = "--output") -> None:
    """Refuse, before any work is done, a file that cannot be written, or is read from.

    Raises
    ------
    OSError
        If it cannot be written, see `fuzzykf.files.check_writable`.
    ParameterError
        If it is one of the ``sources``.
    """
    check_writable(file)
    if is_stdout(file):
        return
    for source in sources:
        if file.exists() and source.exists() and file.samefile(source):
            raise ParameterError(f"{option}: {file} is also read from; name another file")

"""What the commands share: the report of errors, the progress bar, the check of where to write."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.text import Text

from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["check_file", "check_folder", "progress_bar", "report_errors"]


@contextmanager
def report_errors() -> Iterator[None]:
    """Turn an error that the user can mend into a message and exit code 1."""
    try:
        yield
    except (FuzzykfError, OSError) as error:
        Console(stderr=True, soft_wrap=True).print(Text.assemble(("Error: ", "bold red"), _message(error)))
        raise typer.Exit(1) from error


def _message(error: FuzzykfError | OSError) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error)


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
        If the folder of the file does not exist or is not writable, or ``file`` is a folder.
    ParameterError
        If it is one of the ``sources``.
    """
    if not file.parent.is_dir():
        raise FileNotFoundError(2, "there is no such folder", str(file.parent))
    check_folder(file.parent)
    if file.is_dir():
        raise IsADirectoryError(21, "expected a file, found a folder", str(file))
    for source in sources:
        if file.exists() and source.exists() and file.samefile(source):
            raise ParameterError(f"{option}: {file} is also read from; name another file")

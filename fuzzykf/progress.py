"""A progress bar for work of several named pieces."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["progress_bar"]


@contextmanager
def progress_bar(pieces: int | None) -> Iterator[Callable[[str], None]]:
    """Show a bar on the terminal, on standard error, while work goes on.

    Parameters
    ----------
    pieces : int or None
        Number of pieces of work; None if it is not known how much there is.

    Yields
    ------
    callable
        To be told the name of each piece of work before it begins.

    Raises
    ------
    MissingDependencyError
        If rich is not installed.
    """
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    except ImportError as error:
        raise MissingDependencyError("a progress bar needs rich: pip install 'fuzzykf[cli]'") from error
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=pieces)
        begun = 0

        def begin(name: str) -> None:
            nonlocal begun
            progress.update(task, description=name, completed=begun)
            begun += 1

        yield begin

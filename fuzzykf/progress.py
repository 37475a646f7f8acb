"""A progress bar for work of several named pieces."""

from __future__ import annotations

import os
import sys
import time
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["PATIENCE", "progress_bar"]

#: Seconds after which work that was not asked for a bar shows one.
PATIENCE = 2.0

#: Environment variable that says that a test is running.
TESTED = "PYTEST_CURRENT_TEST"

#: Whether work around this one has a bar, or is to have none: then parts of it have none of their own.
_AROUND: ContextVar[bool] = ContextVar("fuzzykf_progress", default=False)


@contextmanager
def progress_bar(pieces: int | None, show: bool | None = True) -> Iterator[Callable[[str], None]]:
    """Show a bar on the terminal, on standard error, or in a notebook, while work goes on.

    Parameters
    ----------
    pieces : int or None
        Number of pieces of work; None if it is not known how much there is.
    show : bool or None
        Whether to show it.  None: after two seconds, if somebody is there to see it, standard error
        being a terminal or this a notebook; not in tests, not where rich is missing, and not inside
        of work that has a bar.

    Yields
    ------
    callable
        To be told the name of each piece of work before it begins.

    Raises
    ------
    MissingDependencyError
        If ``show`` is True and rich is not installed.
    """
    if show is None and (_AROUND.get() or not _is_watched() or find_spec("rich") is None):
        show = False
    bar = None
    if show:
        bar = _new_bar()
        bar.start()
    begun, start = 0, time.monotonic()
    task = None

    def begin(name: str) -> None:
        nonlocal bar, begun, task
        if show is None and bar is None and time.monotonic() - start >= PATIENCE:
            bar = _new_bar()
            bar.start()
        if bar is not None:
            if task is None:
                task = bar.add_task("", total=pieces)
            bar.update(task, description=name, completed=begun)
        begun += 1

    around = _AROUND.set(True)
    try:
        yield begin
    finally:
        _AROUND.reset(around)
        if bar is not None:
            bar.stop()


def _is_watched() -> bool:
    """Whether somebody can see a bar that nobody has asked for."""
    if TESTED in os.environ:
        return False
    if "ipykernel" in sys.modules:  # without widgets a notebook shows a warning in place of a bar
        return find_spec("ipywidgets") is not None
    return bool(getattr(sys.stderr, "isatty", lambda: False)())


def _new_bar() -> Any:
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    except ImportError as error:
        raise MissingDependencyError("a progress bar needs rich: pip install 'fuzzykf[cli]'") from error
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    seen = console.is_terminal or console.is_jupyter
    return Progress(*columns, console=console, transient=True, disable=not seen)

"""Lists of classes by name, read lazily: the owner of a list imports nothing that stands in it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from importlib import import_module
from threading import Condition, get_ident
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from types import ModuleType

__all__ = ["Registry", "either", "imported"]


#: How many modules each thread is about to import.  A process that is forked at that moment by another
#: thread would find them half done for ever, so a fork waits for them; `_CHANGED` goes with it.
_IMPORTING: Counter[int] = Counter()
_CHANGED = Condition()

#: Seconds that a fork waits: the import may in turn wait for what the forking thread has begun.
_PATIENCE = 10.0


def imported(module: str) -> ModuleType:
    """Import a module when it is needed, so that no fork comes in between."""
    thread = get_ident()
    with _CHANGED:
        _IMPORTING[thread] += 1
    try:
        return import_module(module)
    finally:
        with _CHANGED:
            _IMPORTING[thread] -= 1
            _CHANGED.notify_all()


def _wait_for_imports() -> None:
    _CHANGED.acquire()
    thread = get_ident()
    _CHANGED.wait_for(lambda: not any(n for k, n in _IMPORTING.items() if k != thread), _PATIENCE)


def _forget_imports() -> None:
    global _CHANGED
    thread, _CHANGED = get_ident(), Condition()  # threads that waited for the old one are not here
    for other in [k for k in _IMPORTING if k != thread]:
        del _IMPORTING[other]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_wait_for_imports,
        after_in_parent=lambda: _CHANGED.release(),
        after_in_child=_forget_imports,
    )


class Registry(Mapping[str, Any]):
    """Classes by name; one is imported when it is asked for.

    Parameters
    ----------
    places : mapping of str to str
        Where each stands, as ``"module:Class"``.

    Examples
    --------
    >>> laws = Registry({"free": "fuzzykf.switching.laws.cells:CellLaw"})
    >>> laws["free"].__name__
    'CellLaw'
    """

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = dict(places)
        self._found: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._found:
            module, _, attribute = self._places[name].partition(":")
            self._found[name] = getattr(imported(module), attribute)
        return self._found[name]

    def __contains__(self, name: object) -> bool:  # importing nothing
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def either(names: Iterable[str]) -> str:
    """Return names as an error text gives a choice.

    Examples
    --------
    >>> either(["fmc1", "fmc2", "free"])
    "'fmc1', 'fmc2' or 'free'"
    """
    *others, last = map(repr, names)
    return f"{', '.join(others)} or {last}" if others else last

"""Lists of classes by name, read lazily: the owner of a list imports nothing that stands in it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

__all__ = ["Registry", "either"]


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

    def __getitem__(self, name: str) -> Any:
        module, _, attribute = self._places[name].partition(":")
        return getattr(import_module(module), attribute)

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

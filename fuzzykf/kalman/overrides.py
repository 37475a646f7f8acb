"""Whether a subclass has changed what a class does.

A filter whose verbs are done all at once, in the engine, may only be treated so as long as
these verbs, what they call, and the attributes they read and write are its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["lookups", "overrides"]

_ABSENT = object()


def lookups(cls: type, names: Iterable[str]) -> dict[str, Any]:
    """Return what each of the names stands for in a class."""
    return {name: getattr(cls, name, _ABSENT) for name in names}


def overrides(cls: type, own: dict[str, Any]) -> bool:
    """Whether one of the names stands for something else in ``cls``."""
    return any(getattr(cls, name, _ABSENT) is not value for name, value in own.items())

"""Whether the verbs of a filter are those of its class, or of somebody else.

A filter whose verbs are done all at once, in the engine, may only be treated so as long as
these verbs, what they call, and the attributes they read and write are its own: neither a subclass, nor
anybody who patched the class or one object, has put others in their place.
"""

from __future__ import annotations

from types import MethodType
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["ACCESS", "VERBS", "attributes_of", "follows_copies", "is_patched", "lookups", "overrides"]

#: What a filter does with time and with an observation.
VERBS = ("predict", "update")

#: How any attribute is read and written: whoever replaces these may change every verb.
ACCESS = ("__getattribute__", "__setattr__")

_ABSENT = object()


def lookups(cls: type, names: Iterable[str]) -> dict[str, Any]:
    """Return what each of the names stands for in a class."""
    return {name: getattr(cls, name, _ABSENT) for name in names}


def overrides(cls: type, own: dict[str, Any]) -> bool:
    """Whether one of the names stands for something else in ``cls``."""
    return any(getattr(cls, name, _ABSENT) is not value for name, value in own.items())


def is_patched(filter_: Any, names: Iterable[str] = VERBS) -> bool:
    """Whether one object has a verb of its own, in place of that of its class."""
    return not vars(filter_).keys().isdisjoint(names)


def follows_copies(filter_: Any) -> bool:
    """Whether a copy of a filter has verbs that act on the copy.

    Methods bound to the filter are bound to its copy when it is copied.  Any other function that was put in
    place of a verb may hold on to the filter itself, so that nobody knows what it does for a copy.
    """
    there = (getattr(filter_, "__dict__", {}).get(name) for name in (*VERBS, "get_prediction"))
    return all(verb is None or (isinstance(verb, MethodType) and verb.__self__ is filter_) for verb in there)


def attributes_of(filter_: Any) -> dict[str, Any]:
    """Return the attributes of a filter, to be put back after an error.

    The verbs of this package write into no array that anybody else holds; those of others may
    (`self.x *= ...`), so that the arrays of a filter with such verbs are copied.
    """
    attributes: dict[str, Any] = vars(filter_)
    if type(filter_).__module__.startswith("fuzzykf.") and not is_patched(filter_):
        return attributes.copy()
    return {
        name: value.copy() if isinstance(value, np.ndarray) else value for name, value in attributes.items()
    }

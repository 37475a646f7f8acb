"""How what can be called is described: verbs of objects, functions and constructors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import specimens
from calls_arguments import Kind, fixed

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["TIME", "Verb", "assign", "function", "made", "verb"]


@dataclass(frozen=True)
class Verb:
    """Something that can be called.

    Attributes
    ----------
    name : str
    arguments : dict of str to Kind
        In order; those whose name begins with "arg" have no name in the call.
    of : callable
        Of the object: what is called.
    infinite : bool
        Whether infinity may be among what is returned.
    gaps : bool
        Whether NaN may, too.
    """

    name: str
    arguments: dict[str, Kind]
    of: Callable[[Any], Any]
    infinite: bool = False
    gaps: bool = False


def verb(name: str, *, infinite: bool = False, gaps: bool = False, **arguments: Kind) -> Verb:
    """Describe a method."""
    return Verb(name, arguments, lambda target: getattr(target, name), infinite, gaps)


def function(
    call: Any, *, infinite: bool = False, gaps: bool = False, **arguments: Kind
) -> tuple[str, None, list[Verb]]:
    """Describe a function or a constructor."""
    return "", None, [Verb(call.__qualname__, arguments, lambda _: call, infinite, gaps)]


def assign(attribute: str, kind: Kind) -> Verb:
    """Describe what happens when an attribute is assigned."""
    return Verb(
        f"set {attribute}", {"arg": kind}, lambda target: lambda value: setattr(target, attribute, value)
    )


#: Hours of two days.
TIME = fixed(specimens.times())


def made(*names: str) -> Kind:
    """One of some specimens."""
    return Kind(lambda rng: specimens.specimen(names[rng.integers(len(names))]))

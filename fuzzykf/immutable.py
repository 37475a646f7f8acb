"""Immutable values: laws, forms and models; and what they compute when it is first asked for."""

from __future__ import annotations

import functools
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

_Class = TypeVar("_Class")

__all__ = ["Immutable", "Unassignable", "cached_property", "keeps"]

if TYPE_CHECKING:
    from collections.abc import Callable
    from functools import cached_property
else:

    class cached_property(functools.cached_property):
        """A property that is computed once, without a lock.

        That of Python 3.11 holds a lock, one for all objects of the class, while it computes; a
        process that is forked from another thread at that moment inherits it locked, and waits for
        ever.  Two threads may compute the same value here, which does no harm to a value.
        """

        def __init__(self, func: Callable[[Any], Any]) -> None:
            super().__init__(func)
            self.lock = nullcontext()


class Unassignable:
    """An attribute that is not there, and that nobody may add: whoever assigns it means something else.

    Parameters
    ----------
    advice : str
        What to do instead.
    """

    def __init__(self, advice: str) -> None:
        self._advice = advice

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        raise AttributeError(f"{type(instance).__name__!r} object has no attribute {self._name!r}")

    def __set__(self, instance: Any, value: Any) -> None:
        """Refuse."""
        raise AttributeError(
            f"{self._name}: cannot be assigned to a {type(instance).__name__}; {self._advice}"
        )


class _Kept:
    """An attribute that is set once."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        try:
            return instance.__dict__[self._name]
        except KeyError:
            raise AttributeError(
                f"{type(instance).__name__!r} object has no attribute {self._name!r}"
            ) from None

    def __set__(self, instance: Any, value: Any) -> None:
        """Set it for the first time."""
        if self._name in instance.__dict__:
            raise AttributeError(
                f"{self._name}: a {type(instance).__name__} keeps what it was made with; make another one"
            )
        instance.__dict__[self._name] = value


def keeps(*names: str) -> Callable[[type[_Class]], type[_Class]]:
    """Let objects of a class keep attributes that they were made with, which others would not be read for."""

    def decorated(cls: type[_Class]) -> type[_Class]:
        for name in names:
            setattr(cls, name, _Kept(name))
        return cls

    return decorated


class Immutable:
    """An object whose attributes are set once, and whose arrays are read-only.

    Copies share it, so that a filter can be copied at no cost.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute for the first time."""
        if name in self.__dict__:
            raise AttributeError(f"{name}: a {type(self).__name__} never changes; make another one")
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Refuse."""
        raise AttributeError(f"{name}: a {type(self).__name__} never changes; make another one")

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled object; the arrays of a pickle are writeable."""
        for name, value in state.items():
            setattr(self, name, value)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

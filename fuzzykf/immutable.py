"""Immutable values: laws, forms and models."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

__all__ = ["Immutable"]


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

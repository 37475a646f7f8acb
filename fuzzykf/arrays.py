"""Types of arrays, for annotations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoolArray", "FloatArray", "IntArray", "ManyNumbers", "ManySeriesLike", "Number", "Numbers"]

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.intp]
BoolArray: TypeAlias = NDArray[np.bool_]

_Held = TypeVar("_Held", covariant=True)


class _HoldsNumbers(Protocol):
    """An array, masked or not, or an object of pandas or xarray; not of texts, times or complex numbers."""

    def __array__(
        self,
    ) -> np.ndarray[Any, np.dtype[np.floating[Any] | np.integer[Any] | np.bool_ | np.object_]]: ...


class _Listed(Protocol[_Held]):
    """A list or a tuple: arrays are not reversed, and texts and bytes cannot be asked for any object."""

    def __contains__(self, value: object, /) -> bool: ...

    def __iter__(self) -> Iterator[_Held]: ...

    def __reversed__(self) -> Iterator[_Held]: ...

    def __getitem__(self, k: int, /) -> _Held: ...


class _NA(Protocol):
    """pandas' NA, known by how it is pickled, as pandas need not be there."""

    def __reduce__(self) -> Literal["NA"]: ...


#: One real number, or one that is missing.
Number: TypeAlias = float | np.floating[Any] | np.integer[Any] | np.bool_ | _NA | None

#: What is read as an array of numbers: like numpy's ``ArrayLike``, but None may stand for what is missing,
#: and a text, of which numpy's type takes any, is none.
Numbers: TypeAlias = Number | _HoldsNumbers | _Listed["Numbers"]

#: What is read as a series of observations: an array of them, or one after another.
ManyNumbers: TypeAlias = Numbers | Iterable[Numbers]

#: What is read as many series: an array or a table of them, or a list or a mapping of series.
ManySeriesLike: TypeAlias = Numbers | _Listed[ManyNumbers] | Mapping[Any, ManyNumbers]

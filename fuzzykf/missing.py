"""Numbers as they come in, some of them missing: masked, None, NaN, or pandas' NA."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["as_floats", "is_bytes"]

#: Kinds of NumPy types that are numbers: truth values, whole numbers, floats.
_NUMBERS = "biuf"


def as_floats(value: Any) -> FloatArray:
    """Return an array of floats, NaN where something is missing; it shares memory where it can.

    What stands under the mask of a masked array is not there.  None, NaN and pandas' NA are missing too,
    in lists, arrays of objects, Series and DataFrames.

    Parameters
    ----------
    value : array_like
        Of any shape.

    Raises
    ------
    TypeError
        If it holds something that is no real number: times, texts, bytes, complex numbers.
    ValueError, OverflowError
        If it is ragged, or a whole number is too large.

    Examples
    --------
    >>> as_floats(np.ma.array([1.0, -999.0, 3.0], mask=[0, 1, 0]))
    array([ 1., nan,  3.])
    >>> as_floats([1, None, 3])
    array([ 1., nan,  3.])
    """
    if is_bytes(value):
        raise TypeError(f"{type(value).__name__} of bytes holds no real numbers")
    if isinstance(value, np.ma.MaskedArray):
        if value.dtype == object:
            there = value.data.copy()
            there[np.ma.getmaskarray(value)] = None
            return as_floats(there)
        _check(value.dtype)
        floats: FloatArray = np.ma.filled(value.astype(np.float64), np.nan)
        return floats
    if isinstance(value, list | tuple) and any(map(_hides, value)):
        value = [as_floats(one) for one in value]  # np.asarray would take what is under the mask
    given = np.asarray(value)
    if given.dtype == object:
        flat = [_number(one) for one in given.ravel()]
        return np.array(flat, dtype=np.float64).reshape(given.shape)
    _check(given.dtype)
    return given.astype(np.float64, copy=False)


def is_bytes(value: Any) -> bool:
    """Whether a value is bytes, of which NumPy makes numbers if they can be changed, or are looked at."""
    if isinstance(value, memoryview):
        return value.format.lstrip("@=<>!") in ("B", "c")
    return isinstance(value, bytes | bytearray | np.void)


def _check(dtype: np.dtype[Any]) -> None:
    if dtype.kind not in _NUMBERS:
        raise TypeError(f"an array of {dtype} holds no real numbers")


def _hides(value: Any) -> bool:
    """Whether `np.asarray` of a list with this in it would lose what is missing, or take bytes."""
    if isinstance(value, list | tuple):
        return any(map(_hides, value))
    return (
        isinstance(value, np.ma.MaskedArray)
        or is_bytes(value)
        or (hasattr(value, "to_numpy") and np.ndim(value) > 0)
    )


def _number(value: Any) -> float:
    """One number of an array of objects; NaN if it is missing."""
    if value is None or value is np.ma.masked or type(value).__name__ == "NAType":
        return np.nan
    if isinstance(value, np.generic):
        _check(value.dtype)
    if not hasattr(value, "__float__"):
        raise TypeError(f"{value!r} is no number")
    if getattr(value, "ndim", 0):
        raise ValueError("the lists are of unequal length")
    return float(value)

"""Boxes and linear maps: images and pre-images with guaranteed bounds, as boxes around the exact sets.

Rows are short, and there are thousands of boxes on the way back over a series: all is done on plain floats,
for which an array of two or three entries would be a burden.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.possibility.intervals.rounding import product_above, product_below

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import TypeAlias

    from fuzzykf.arrays import FloatArray

    Bounds: TypeAlias = tuple[FloatArray, FloatArray]

__all__ = ["contract", "has_single_entries", "linear_image"]

#: Largest number of sweeps of the contractor, and the part of a box by which one has to move it.
SWEEPS, STILL = 100, 1e-12

#: Matrices that are kept as rows: a series mostly has one or two.
MATRICES = 64

EPS = float(np.finfo(np.float64).eps)


class Row(NamedTuple):
    """The entries of a row that are not zero.

    Attributes
    ----------
    entries : tuple of (int, float)
        Columns and values.
    sizes : tuple of (int, float)
        Columns, and how large the terms are that an entry has been summed from: its absolute value, unless
        it is that of a product of matrices.
    """

    entries: tuple[tuple[int, float], ...]
    sizes: tuple[tuple[int, float], ...]


def linear_image(A: FloatArray, lower: FloatArray, upper: FloatArray) -> Bounds:
    """Smallest box around the image of a box under x -> A x.

    Bounds are rounded outwards, so that they hold in exact arithmetic as well: by one unit in the last place,
    where a row has a single entry and its product is not exact, else by the error of the sum.

    Parameters
    ----------
    A : ndarray, shape (q, d)
    lower, upper : ndarray, shape (d,)

    Returns
    -------
    lower, upper : ndarray, shape (q,)
    """
    rows, _, _ = _rows_of(A.tobytes(), A.shape)
    low, high = _image(rows, lower.tolist(), upper.tolist())
    return np.array(low), np.array(high)


def contract(
    A: FloatArray, lower: FloatArray, upper: FloatArray, least: FloatArray, most: FloatArray
) -> Bounds | None:
    """Box around the points of a box with least <= A x <= most.

    Each row bounds each component, given the bounds of the others; this is repeated
    until nothing moves.  For a single row the box is the smallest one.  Several rows
    are joined by those of the pseudo-inverse times A, which also bound what no single
    row does.

    Parameters
    ----------
    A : ndarray, shape (q, d)
    lower, upper : ndarray, shape (d,)
    least, most : ndarray, shape (q,)

    Returns
    -------
    lower, upper : ndarray, or None
        Rounded outwards; None if there is certainly no such point.
    """
    rows, inverse, joined = _rows_of(A.tobytes(), A.shape)
    asked = list(zip(least.tolist(), most.tolist(), strict=True))
    if inverse:
        rows = rows + joined
        asked += zip(*_image(inverse, least.tolist(), most.tolist()), strict=True)
    low, high = lower.tolist(), upper.tolist()
    slack = 4.0 * EPS * A.shape[1]
    sweeps = 1 if len(rows) == 1 else SWEEPS
    for _ in range(sweeps):
        before_low, before_high = low.copy(), high.copy()
        for row, (a, b) in zip(rows, asked, strict=True):
            if not _narrow(row, low, high, a, b, slack):
                return None
        if _is_still(low, high, before_low, before_high):
            break
    return np.array(low), np.array(high)


def has_single_entries(A: FloatArray) -> bool:
    """Whether no row of a matrix has more than one entry besides zeros."""
    return all(len(row.entries) <= 1 for row in _rows_of(A.tobytes(), A.shape)[0])


def _narrow(row: Row, low: list[float], high: list[float], a: float, b: float, slack: float) -> bool:
    """Bound, in place, each component by a <= row x <= b; whether anything is left."""
    error = max(abs(a), abs(b))
    for k, size in row.sizes:
        error += size * max(abs(low[k]), abs(high[k]))
    a, b = a - slack * error, b + slack * error
    if not row.entries:
        return a <= 0.0 <= b
    for k, value in row.entries:
        least, most = a, b
        for m, other in row.entries:
            if m != k:
                one, two = other * low[m], other * high[m]
                if one > two:
                    one, two = two, one
                most -= one
                least -= two
        one, two = least / value, most / value
        if one > two:
            one, two = two, one
        low[k], high[k] = max(low[k], one), min(high[k], two)
        if low[k] > high[k]:
            return False
    return True


def _is_still(low: list[float], high: list[float], before_low: list[float], before_high: list[float]) -> bool:
    """Whether a sweep has moved no side of a box."""
    moved, size = 0.0, 1e-300
    for a, b, c, d in zip(low, high, before_low, before_high, strict=True):
        moved, size = max(moved, a - c, d - b), max(size, abs(a), abs(b))
    return moved <= STILL * size


def _image(rows: Sequence[Row], low: list[float], high: list[float]) -> tuple[list[float], list[float]]:
    """Return the bounds of the image of a box, rounded outwards."""
    lower, upper = [], []
    for entries, _ in rows:
        if len(entries) == 1:
            ((k, value),) = entries
            one, two = (low[k], high[k]) if value > 0.0 else (high[k], low[k])
            lower.append(product_below(value, one))
            upper.append(product_above(value, two))
            continue
        least = most = size = 0.0
        for k, value in entries:
            one, two = value * low[k], value * high[k]
            least += min(one, two)
            most += max(one, two)
            size += max(abs(one), abs(two))
        rounding = EPS * (len(entries) + 2) * size
        lower.append(least - rounding)
        upper.append(most + rounding)
    return lower, upper


@lru_cache(MATRICES)
def _rows_of(data: bytes, shape: tuple[int, int]) -> tuple[tuple[Row, ...], tuple[Row, ...], tuple[Row, ...]]:
    """Return the rows of a matrix and, if it has several, of its pseudo-inverse and of their product."""
    A = np.frombuffer(data).reshape(shape)
    rows = _rows(A, np.abs(A))
    if shape[0] <= 1:
        return rows, (), ()
    inverse = np.asarray(np.linalg.pinv(A))
    size = np.abs(inverse)
    # The product is that of the exact matrices only up to what its terms, which may cancel, are rounded by.
    return rows, _rows(inverse, size), _rows(inverse @ A, size @ np.abs(A))


def _rows(A: FloatArray, sizes: FloatArray) -> tuple[Row, ...]:
    return tuple(
        Row(
            tuple((int(k), float(row[k])) for k in np.flatnonzero(row)),
            tuple((int(k), float(size[k])) for k in np.flatnonzero(size)),
        )
        for row, size in zip(A, sizes, strict=True)
    )

"""Inputs of a clock and a calendar: what is known at all times, as columns with names.

With h the hour of the day on the spot, the columns of harmonic k are sin(2 pi k h / 24) and
cos(2 pi k h / 24).  A name says all that its column is made of, so that a model that remembers names can have
its inputs made again:

    clock_sin1, clock_cos1, ...         harmonics of the day
    clock_workday                       1 from Monday to Friday, else 0
    workday                             the same, where the caller has said which days are working days
    clock_workday * clock_sin1, ...     products
    clock_year_sin, clock_year_cos      first harmonic of the year
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_count, as_flag
from fuzzykf.immutable import Immutable
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.preprocessing import as_workdays, hour_of_day
from fuzzykf.reprs import shown
from fuzzykf.texts import counted, listed
from fuzzykf.times import has_times, read_times, written_times

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike, NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.times import Times

__all__ = ["InputColumns", "clock_inputs", "factors_of", "is_of_clock", "made_inputs", "names_of_clock"]

#: The twelfth harmonic of hours alternates, the twenty-fourth of half hours; nobody needs a finer one.
MOST_HARMONICS = 24

#: What a working day of the calendar, and one that the caller knows, is called.
WORKDAY, TOLD_WORKDAY = "clock_workday", "workday"

_DAY = re.compile(r"clock_(sin|cos)([1-9]\d?)")
_YEAR = re.compile(r"clock_year_(sin|cos)")

#: What stands between the names of a product.
TIMES = " * "


class InputColumns(Immutable):
    """Named columns of numbers, if pandas is not used.

    It can be passed as ``fit(inputs=)``, ``filter(us=)``, ``forecast(us=)`` and ``simulate(us=)``.

    Parameters
    ----------
    columns : iterable of str
        Distinct names.
    values : array_like, shape (n, k)
        One column per name.

    Raises
    ------
    ParameterError, ShapeError
        If a name repeats, or the number of names is not that of columns.

    Examples
    --------
    >>> table = InputColumns(["sun", "wind"], [[0.0, 3.0], [0.5, 4.0], [0.9, 2.0]])
    >>> len(table), table[1:].to_numpy().shape, table["wind"]
    (3, (2, 2), array([3., 4., 2.]))
    """

    def __init__(self, columns: Iterable[str], values: ArrayLike) -> None:
        self.columns = tuple(str(name) for name in columns)
        twice = sorted({name for name in self.columns if self.columns.count(name) > 1})
        if twice:
            raise ParameterError(f"columns: got {listed(twice)} twice, expected each name once")
        self._values = as_array("values", values, (None, len(self.columns)))

    def to_numpy(self) -> FloatArray:
        """Return the numbers as a read-only array.

        Returns
        -------
        ndarray, shape (n, k)
        """
        return self._values

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the numbers, for NumPy."""
        return np.array(self._values, dtype=dtype, copy=copy)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._values)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return len(self._values), len(self.columns)

    @property
    def ndim(self) -> int:
        """Number of axes, which is 2."""
        return 2

    def __getitem__(self, key: Any) -> Any:
        """Return the column of a name, (n,), or some rows as columns with names."""
        if isinstance(key, str):
            if key not in self.columns:
                raise ParameterError(f"column: got {key!r}, expected one of {listed(self.columns)}")
            return self._values[:, self.columns.index(key)]
        return type(self)(self.columns, self._values[key])

    @shown
    def __repr__(self) -> str:
        """Say how many rows there are, and what the columns are called."""
        return f"InputColumns({counted(len(self), 'row')} of {listed(self.columns)})"


def clock_inputs(
    time: Any,
    *,
    harmonics: int = 3,
    workday: ArrayLike | bool | None = None,
    day_of_year: bool = False,
) -> Any:
    """Return clock inputs: harmonics of the day and, optionally, working days and the season.

    Parameters
    ----------
    time : array_like of times, shape (n,), or table
        Times in any form of `hour_of_day`, in any order, or a table with an index of times.  For times with a
        zone or an offset, the local hour counts.
    harmonics : int
        Number of daily harmonics, at most 24; two columns each.
    workday : bool, or array_like of bool, shape (n,), optional
        True for Mondays to Fridays, or a mask of the rows on working days, to include public holidays.  Adds
        a column of 0 and 1, and its products with the first harmonic.
    day_of_year : bool
        Whether to add the first harmonic of the year.  Use it only with several years of data: within half a
        year it is hardly more than a trend.

    Returns
    -------
    DataFrame or InputColumns
        A DataFrame with the index of ``time`` if it has or is an index, else `InputColumns`.

    Raises
    ------
    ParameterError, ShapeError
        If ``time`` is not a sequence of times, ``workday`` has another length, or there would be no column.

    See Also
    --------
    fuzzykf.preprocessing.hour_of_day, WindowFeatures

    Notes
    -----
    Column names define the columns, and a model stores the names, so the command line can compute them from
    the times.  ``clock_workday`` is computed from the calendar; a given mask is called ``workday``.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.datetime64("2014-01-03T18:00", "s") + np.arange(3) * np.timedelta64(
    ...     6, "h"
    ... )
    >>> inputs = clock_inputs(time, harmonics=1, workday=True)
    >>> inputs.columns[:3]
    ('clock_sin1', 'clock_cos1', 'clock_workday')
    >>> inputs.to_numpy()[:, :3]
    array([[-1.,  0.,  1.],
           [ 0.,  1.,  0.],
           [ 1.,  0.,  0.]])
    """
    index, times = _rows_of(time)
    harmonics = as_count("harmonics", harmonics, 0, MOST_HARMONICS)
    is_asked = isinstance(workday, bool | np.bool_)
    told: dict[str, FloatArray] = {}
    if workday is not None and not is_asked:
        if index is not None and index_of(workday) is not None:
            check_aligned(time=index.to_series(), workday=workday)
        told[TOLD_WORKDAY] = as_workdays(workday, times.clock).astype(np.float64)
    day = TOLD_WORKDAY if told else WORKDAY if workday is not None and bool(workday) else None
    names = names_of_clock(harmonics, day, as_flag("day_of_year", day_of_year))
    if not names:
        raise ParameterError("harmonics: got 0 without workday and day_of_year, expected at least one column")
    values = made_inputs(names, times, told)
    if index is None:
        return InputColumns(names, values)
    import pandas as pd

    return pd.DataFrame(values, index=index, columns=names)


def _rows_of(time: Any) -> tuple[Any, Times]:
    """Return the index of the rows, None if there is none, and their times."""
    index = index_of(time)
    if index is None:  # an index of pandas is its own
        index = time if hasattr(time, "to_series") and hasattr(time, "nlevels") else None
    elif np.ndim(time) > 1 or getattr(getattr(time, "dtype", None), "kind", "") in tuple("biuf"):
        found = index if has_times(index) else written_times(index)
        if found is None:
            raise ParameterError(
                f"time: got a {type(time).__name__} whose index has no times ({index.dtype}), expected "
                "times, or a table with an index of times"
            )
        return index, read_times(found, ordered=False)
    return index, read_times(time, ordered=False)


# --------------------------------------------------------------------------- names, and what they say


def names_of_clock(harmonics: int, workday: str | None = None, day_of_year: bool = False) -> list[str]:
    """Return the names of the columns.

    Parameters
    ----------
    harmonics : int
    workday : str, optional
        What the column of working days is called, if there is to be one.
    day_of_year : bool

    Examples
    --------
    >>> names_of_clock(1, "workday")
    ['clock_sin1', 'clock_cos1', 'workday', 'workday * clock_sin1', 'workday * clock_cos1']
    """
    waves = [f"clock_{wave}{k}" for k in range(1, harmonics + 1) for wave in ("sin", "cos")]
    days = [] if workday is None else [workday, *(f"{workday}{TIMES}{wave}" for wave in waves[:2])]
    return [*waves, *days, *(["clock_year_sin", "clock_year_cos"] if day_of_year else [])]


def is_of_clock(name: str) -> bool:
    """Whether a column of this name can be made of times alone.

    Examples
    --------
    >>> (
    ...     is_of_clock("clock_cos2"),
    ...     is_of_clock("clock_workday * clock_sin1"),
    ...     is_of_clock("wind"),
    ... )
    (True, True, False)
    """
    return all(
        one == WORKDAY or _DAY.fullmatch(one) is not None or _YEAR.fullmatch(one) is not None
        for one in name.split(TIMES)
    )


def factors_of(name: str) -> list[str] | None:
    """Return what a product with a wave of the clock is made of; None if a name is none.

    Examples
    --------
    >>> (
    ...     factors_of("workday * clock_sin1"),
    ...     factors_of("wind * sun"),
    ...     factors_of("clock_sin1"),
    ... )
    (['workday', 'clock_sin1'], None, None)
    """
    factors = name.split(TIMES)
    return factors if len(factors) == 2 and _DAY.fullmatch(factors[1]) else None


def made_inputs(names: Iterable[str], times: Times | None, told: Mapping[str, FloatArray]) -> FloatArray:
    """Return the columns of these names, (n, k).

    Parameters
    ----------
    names : iterable of str
        Of a clock, of what is told, or of products of a column with a wave of the clock.
    times : Times, or None
        Needed by the clock alone.
    told : mapping of str to ndarray, shape (n,)
        Columns that go by their own names.
    """

    def column(name: str) -> FloatArray:
        if name in told:
            return told[name]
        factors = factors_of(name)
        if factors is not None:
            return column(factors[0]) * column(factors[1])
        assert times is not None  # whoever asks has looked
        return _of_clock(name, times)

    return np.column_stack([column(name) for name in names])


def _of_clock(name: str, times: Times) -> FloatArray:
    if name == WORKDAY:
        return as_workdays(None, times.clock).astype(np.float64)
    day = _DAY.fullmatch(name)
    if day is not None:
        return _wave(day[1], int(day[2]) * hour_of_day(times) / 24.0)
    year = _YEAR.fullmatch(name)
    if year is None:
        raise ParameterError(f"name: got {name!r}, expected one that clock_inputs gives")
    begin = times.clock.astype("datetime64[Y]")
    first, last = (one.astype("datetime64[s]") for one in (begin, begin + 1))
    return _wave(year[1], (times.clock - first) / (last - first))


def _wave(name: str, turns: FloatArray) -> FloatArray:
    """Return sine or cosine of a number of turns, which are exactly 0 where they cross it.

    So a harmonic that the rows are too far apart to show is constant, as it should, and no rounding error.
    """
    turns = turns + (0.25 if name == "cos" else 0.0)
    turns = turns - np.round(turns)  # in [-1/2, 1/2]
    folded = np.where(np.abs(turns) > 0.25, np.copysign(0.5, turns) - turns, turns)
    return np.asarray(np.sin(2.0 * np.pi * folded) + 0.0)  # no -0

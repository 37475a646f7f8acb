"""Preparing series: each step learns on the training part, and is then applied to any other.

`Standardizer` and `DailyProfile` have `fit`, `transform` and `inverse_transform`, as users
of scikit-learn expect; what `fit` learns is kept in attributes that end in an underscore.
Names of columns are learned too: a table is then taken by its names, an array by position.
Fit them on the training part alone: a mean that has seen the part to be judged flatters
every method.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError, SequenceError, ShapeError
from fuzzykf.gaussian import as_numbers, as_real, brief
from fuzzykf.labels import match_columns, names_of
from fuzzykf.missing import as_floats
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.reprs import call_text, shown
from fuzzykf.steps import find_steps
from fuzzykf.times import Times, has_times, read_times, written_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray, Numbers

__all__ = ["DailyProfile", "Standardizer", "hour_of_day"]

#: So many units of its last digit a number may be off by rounding alone.
ROUNDING = 4.0


def hour_of_day(time: Any) -> FloatArray:
    """Return the hours since local midnight, with fractions.

    Parameters
    ----------
    time : array_like of times, shape (n,)
        In any form of `DailyProfile.fit`; for times with a zone or an offset, the local hour counts.

    Returns
    -------
    ndarray of shape (n,)
        Between 0 and 24.

    Raises
    ------
    ParameterError, ShapeError
        If it is not a sequence of times.

    Examples
    --------
    >>> hour_of_day(["2014-01-31T16:30+11:00", "2014-01-31T16:45+11:00"])
    array([16.5 , 16.75])
    """
    clock = read_times(time, ordered=False).clock
    seconds = (clock - clock.astype("datetime64[D]")) / np.timedelta64(1, "s")
    return np.asarray(seconds / 3600.0, dtype=np.float64)


class Standardizer:
    """Standardise columns to mean zero and standard deviation one.

    Attributes
    ----------
    mean_, scale_ : ndarray, shape (k,)
        Mean and standard deviation of the columns of the training data; (1,) for one-dimensional data.
    names_ : tuple of str, or None
        Names of the columns, or of the Series, of the training data; None for an array.

    Notes
    -----
    Models standardise data internally, so this is not needed before ``fit``.  Multiply a covariance in
    standard units by ``np.outer(scale_, scale_)`` to convert it to the units of the data.

    Examples
    --------
    >>> import numpy as np
    >>> train, rest = np.array([1.0, 2.0, 3.0, np.nan]), np.array([4.0, 5.0])
    >>> standardizer = Standardizer().fit(train)
    >>> standardizer.transform(rest).round(2)
    array([2.45, 3.67])
    >>> standardizer.inverse_transform([0.0])
    array([2.])
    """

    mean_: FloatArray
    scale_: FloatArray
    names_: tuple[str, ...] | None = None

    def fit(self, values: Numbers) -> Self:
        """Learn mean and standard deviation of each column.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, k)
            Training data; NaN where missing.

        Returns
        -------
        Standardizer
            The object itself.

        Raises
        ------
        ShapeError, ParameterError
            If ``values`` has the wrong shape or is infinite, two columns have the same name, or a column is
            empty or constant up to rounding.
        """
        names = _learned_names(values)
        self.mean_, self.scale_ = mean_and_scale("values", as_columns("values", values))
        self.names_ = names
        return self

    def transform(self, values: Numbers) -> Any:
        """Return the values in standard units.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, k)
            Columns of a table are matched by name and returned in the order of the training data; arrays,
            Series and columns 0, 1, 2, ... go by position.

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.

        Raises
        ------
        SequenceError
            If `fit` was not called.
        ShapeError, ParameterError
            If ``values`` lacks a column of the training data, has the wrong number of columns, or is
            infinite.

        Examples
        --------
        >>> import pandas as pd
        >>> frame = pd.DataFrame({"t": [1.0, 3.0], "h": [20.0, 40.0]})
        >>> Standardizer().fit(frame).transform(frame[["h", "t"]])
             t    h
        0 -1.0 -1.0
        1  1.0  1.0
        """
        positions, columns = self._columns(values)
        return _like(values, (columns - self.mean_) / self.scale_, positions)

    def inverse_transform(self, values: Numbers) -> Any:
        """Return values in standard units, converted to the units of the training data.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, k)
            As in `transform`.

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.
        """
        positions, columns = self._columns(values)
        return _like(values, columns * self.scale_ + self.mean_, positions)

    def fit_transform(self, values: Numbers) -> Any:
        """Fit and transform the same values.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, k)

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.
        """
        return self.fit(values).transform(values)

    def _columns(self, values: Numbers) -> tuple[list[int] | None, FloatArray]:
        _check_fitted(self, "mean_")
        return _learned_columns(values, self.names_, len(self.mean_))

    @shown
    def __repr__(self) -> str:
        if "mean_" not in vars(self):
            return f"{type(self).__name__}()"
        return call_text(self, "mean_", "scale_", *(() if self.names_ is None else ("names_",)))


class DailyProfile:
    """Subtract the mean at each time of day, on working days and on other days.

    The remainder, the deviation from the usual day, is harder to estimate and often what matters.

    Parameters
    ----------
    slot : float, optional
        Length of a time slot with one mean, in hours; it must divide the day.  By default
        the step between rows, if it divides the day and is at least a second, else one hour.

    Attributes
    ----------
    slot_ : float
        Length of a time slot, in hours.
    means_ : ndarray, shape (2, slots) or (2, slots, k)
        Means on other days (first row) and on working days, in the unit of the series;
        NaN where the training data have no row.
    names_ : tuple of str, or None
        Names of the columns, or of the Series, of the training data; None for an array.
    has_offsets_ : bool
        Whether the training times have a zone or a UTC offset.

    Notes
    -----
    Hour and day are local.  A profile learned in Melbourne therefore applies its value for eight in the
    morning to eight in the morning in Berlin.  Times with and without a zone cannot be mixed.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.datetime64("2014-01-06T00:00", "s") + np.arange(48) * np.timedelta64(
    ...     3600, "s"
    ... )
    >>> load = 10.0 + np.arange(48) % 24 + np.repeat([-1.0, 1.0], 24)
    >>> profile = DailyProfile().fit(load, time)
    >>> profile.transform(load, time)[[0, 24]]
    array([-1.,  1.])
    >>> profile.at(time[:2])
    array([10., 11.])
    """

    slot_: float
    means_: FloatArray
    names_: tuple[str, ...] | None = None
    has_offsets_: bool | None = None

    def __init__(self, slot: float | None = None) -> None:
        if slot is not None:
            slot = as_real("slot", slot, "a number of hours that divides 24")
        if slot is not None and not (0.0 < slot <= 24.0 and abs(24.0 / slot - round(24.0 / slot)) < 1e-9):
            raise ParameterError(f"slot: got {slot} hours, expected a number of hours that divides 24")
        self.slot = slot

    def fit(self, values: Numbers, time: Any = None, workday: Numbers | None = None) -> Self:
        """Average the values at each time of day, for working days and other days.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, k)
            Training data; NaN where missing.
        time : array_like of times, shape (n,), optional
            datetime64, datetime objects, ISO 8601 text, or a pandas Series or index, in increasing order; by
            default the index of ``values``, or the coordinate of a DataArray.  For times with a zone or an
            offset, hour and day are local.
        workday : array_like of bool, shape (n,), optional
            Working days; by default Mondays to Fridays.

        Returns
        -------
        DailyProfile
            The object itself.

        Raises
        ------
        ShapeError, ParameterError
            If lengths differ, a value is infinite, two columns have the same name, or times are missing or do
            not increase.
        """
        check_aligned(values=values, time=time, workday=workday)
        names = _learned_names(values)
        columns = as_columns("values", values)
        n, k = columns.shape
        times = as_times(time, values, n)
        days = as_workdays(workday, times.clock)
        slot = _step(times) if self.slot is None else self.slot
        slots = round(24.0 / slot)
        cell = self._cell(times.clock, days, slot)
        means = np.full((2 * slots, k), np.nan)
        for j, column in enumerate(columns.T):
            there = ~np.isnan(column)
            count = np.bincount(cell[there], minlength=2 * slots)
            total = np.bincount(cell[there], weights=column[there], minlength=2 * slots)
            np.divide(total, count, out=means[:, j], where=count > 0)
        self.slot_, self.names_, self.has_offsets_ = slot, names, times.has_offsets
        given: Any = values
        self.means_ = means.reshape(2, slots, k) if np.ndim(given) == 2 else means.reshape(2, slots)
        return self

    def at(self, time: Any, workday: Numbers | None = None) -> FloatArray:
        """Return the profile at the given times, shape (n,) or (n, k).

        Parameters
        ----------
        time, workday
            As in `fit`; times may be in any order.

        Returns
        -------
        ndarray, shape (n,) or (n, k)

        Raises
        ------
        SequenceError
            If `fit` was not called.
        ParameterError
            If the training data have no row at that time and kind of day, or only one of both has times with
            a zone or an offset.
        """
        _check_fitted(self, "means_")
        check_aligned(time=time, workday=workday)
        times = read_times(time, ordered=False)
        self._check_clock(times)
        moments = times.clock
        days = as_workdays(workday, moments)
        table = self.means_.reshape(-1, *self.means_.shape[2:])
        found: FloatArray = table[self._cell(moments, days, self.slot_)]
        unknown = np.isnan(found).reshape(len(found), -1).any(axis=1)
        if unknown.any():
            row = int(np.flatnonzero(unknown)[0])
            kind = "a working day" if days[row] else "a day off"
            raise ParameterError(
                f"profile: {moments[row]} is {kind}, and the learning part has no row at that time of such a "
                "day; learn on a longer part, or without the profile"
            )
        return found

    def transform(self, values: Numbers, time: Any = None, workday: Numbers | None = None) -> Any:
        """Return the values minus the profile.

        Parameters
        ----------
        values, time, workday
            As in `fit`.  Columns of a table are matched by name and returned in the order of the training
            data; arrays, Series and columns 0, 1, 2, ... go by position.

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.

        Raises
        ------
        SequenceError, ShapeError, ParameterError
            As from `fit` and `at`; if a column of the training data is missing.
        """
        return self._shift(values, time, workday, -1.0)

    def inverse_transform(self, values: Numbers, time: Any = None, workday: Numbers | None = None) -> Any:
        """Add the profile to values, such as filtered states of the transformed series.

        Parameters
        ----------
        values, time, workday
            As in `transform`.

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.
        """
        return self._shift(values, time, workday, 1.0)

    def fit_transform(self, values: Numbers, time: Any = None, workday: Numbers | None = None) -> Any:
        """Fit and transform the same values.

        Parameters
        ----------
        values, time, workday
            As in `fit`.

        Returns
        -------
        ndarray, Series or DataFrame
            Of the type and shape of ``values``.
        """
        return self.fit(values, time, workday).transform(values, time, workday)

    def _shift(self, values: Numbers, time: Any, workday: Numbers | None, sign: float) -> Any:
        _check_fitted(self, "means_")
        check_aligned(values=values, time=time, workday=workday)
        size = self.means_.shape[2] if self.means_.ndim == 3 else 1
        positions, columns = _learned_columns(values, self.names_, size)
        times = as_times(time, values, len(columns))
        profile = self.at(times, workday).reshape(len(columns), -1)
        return _like(values, columns + sign * profile, positions)

    def _check_clock(self, times: Times) -> None:
        if self.has_offsets_ is None or times.has_offsets == self.has_offsets_:
            return
        told = ("times without a zone", "times with a zone or an offset")
        raise ParameterError(
            f"time: got {told[times.has_offsets]}, but the profile was learned on {told[self.has_offsets_]}; "
            "expected the same, or nobody knows which clock is meant (tz_localize gives times a zone, and "
            "tz_localize(None) leaves what its clock shows)"
        )

    @staticmethod
    def _cell(time: NDArray[np.datetime64], workday: NDArray[np.bool_], slot: float) -> NDArray[np.int_]:
        slots = round(24.0 / slot)
        place: NDArray[np.int_] = workday * slots + (hour_of_day(time) / slot + 1e-9).astype(int)
        return place

    @shown
    def __repr__(self) -> str:
        learned = ("slot_", "means_") if "means_" in vars(self) else ()
        return call_text(self, "slot", *learned, *(() if self.names_ is None else ("names_",)))


# --------------------------------------------------------------------------- arrays in and out


def as_columns(name: str, values: Any) -> FloatArray:
    """Return values as columns (n, k)."""
    array = as_numbers(name, values)
    if array.ndim not in (1, 2):
        raise ShapeError(f"{name}: got shape {array.shape}, expected (n,) or (n, k)")
    if np.isinf(array).any():
        row = int(np.argwhere(np.isinf(array))[0, 0])
        raise ParameterError(f"{name}: row {row} is infinite, expected finite numbers (NaN where missing)")
    return array if array.ndim == 2 else array[:, None]


def _columns_of(values: Any) -> list[Any] | None:
    """Return the names of the columns of a table; None if there are none but 0, 1, 2, ..."""
    if not hasattr(values, "to_numpy") or np.ndim(values) != 2:
        return None
    if hasattr(values, "dims") and hasattr(values, "indexes"):
        columns = values.indexes.get(values.dims[-1])
    else:
        columns = getattr(values, "columns", None)
    return None if columns is None else names_of(list(columns))


def _learned_names(values: Any) -> tuple[str, ...] | None:
    """Return the names of the columns of a table, or that of a Series, each of which stands once."""
    columns = _columns_of(values)
    if columns is None and hasattr(values, "to_numpy") and np.ndim(values) == 1:
        name = getattr(values, "name", None)
        columns = None if name is None or str(name) == "" else [name]
    if columns is None:
        return None
    names = tuple(map(str, columns))
    match_columns(columns, names, "values")
    return names


def _learned_columns(
    values: Any, names: Sequence[str] | None, size: int
) -> tuple[list[int] | None, FloatArray]:
    """Return the columns that were learned: where they stand, None if all as they come, and what they hold.

    Raises
    ------
    ShapeError, ParameterError
        If one is missing, or there are more or fewer than ``size`` that go by position.
    """
    columns = as_columns("values", values)
    there = None if names is None else _columns_of(values)
    if there is None or names is None:
        if columns.shape[1] != size:
            raise ShapeError(
                f"values: got {columns.shape[1]} columns, expected {size}, as in the training part"
            )
        return None, columns
    remedy = ", or pass values.to_numpy(), whose columns go by position"
    positions = match_columns(there, names, "values", remedy)
    return positions, columns[:, positions]


def is_constant(values: FloatArray) -> bool:
    """Whether all numbers are one, but for rounding: what double precision cannot tell apart.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Without anything missing.

    Examples
    --------
    >>> import numpy as np
    >>> is_constant(np.array([0.3, 0.1 + 0.2])), is_constant(1e7 + np.array([0.0, 5e-4]))
    (True, False)
    """
    return bool(np.ptp(values) <= ROUNDING * np.spacing(np.abs(values).max()))


def mean_and_scale(name: str, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the columns of an array (n, k), NaN where missing.

    They are right wherever the numbers lie: deviations are taken from the mean, and squared in
    a unit of their own size, so that neither level nor unit takes their digits.

    Raises
    ------
    ParameterError
        If a column holds no number, or one and the same in all rows.
    """
    mean, scale = np.empty((2, columns.shape[1]))
    for k, column in enumerate(columns.T):
        there = column[~np.isnan(column)]
        if there.size == 0:
            raise ParameterError(f"{name}: column {k} holds no number, so it has no scale")
        if is_constant(there):
            but = "" if np.ptp(there) == 0.0 else ", but for rounding"
            raise ParameterError(f"{name}: column {k} is {there[0]:g} in every row{but}, so it has no scale")
        unit = np.ldexp(1.0, np.frexp(np.abs(there).max())[1] - 1)  # a power of two: nothing is rounded
        there = there / unit
        centre = there.mean()
        deviation = there - centre
        rest = deviation.mean()  # what the rounding of the mean has left
        centre, deviation = centre + rest, deviation - rest
        largest = np.abs(deviation).max()
        mean[k] = centre * unit
        scale[k] = np.sqrt(((deviation / largest) ** 2).mean()) * largest * unit
    return mean, scale


def _like(values: Any, columns: FloatArray, positions: list[int] | None) -> Any:
    """Return columns in the shape of ``values``, with its index if it has one, and the names at positions."""
    result = columns if np.ndim(values) == 2 else columns[:, 0]
    if hasattr(values, "to_numpy") and hasattr(values, "index"):
        import pandas as pd

        if isinstance(values, pd.DataFrame):
            names = values.columns if positions is None else values.columns[positions]
            return pd.DataFrame(result, index=values.index, columns=names)
        return pd.Series(result, index=values.index, name=values.name)
    return result


def as_times(time: Any, values: Any, n: int) -> Times:
    """Return ``n`` times in their order, from the index of ``values`` if none are given."""
    if time is None:
        time = index_of(values)
        if not has_times(time):
            time = written_times(time)
        if time is None:
            raise ParameterError("time: missing; the time of day needs a time for each row")
    times = read_times(time)
    if len(times) != n:
        raise ShapeError(f"time: got shape ({len(times)},), expected ({n},)")
    return times


def as_workdays(workday: Any, time: NDArray[np.datetime64]) -> NDArray[np.bool_]:
    """Return whether each row is of a working day: Mondays to Fridays, unless they are given."""
    return np.is_busday(time.astype("datetime64[D]")) if workday is None else as_days(workday, len(time))


def as_days(workday: Any, n: int) -> NDArray[np.bool_]:
    """Return whether each of ``n`` rows is of a working day; none of them may be missing.

    Raises
    ------
    ShapeError, ParameterError
        If there are more or fewer, or one is neither True nor False.
    """
    try:
        days = as_floats(workday)
    except (TypeError, ValueError) as error:  # texts, or ragged
        raise ParameterError(f"workday: got {brief(workday)}, expected True or False in every row") from error
    if days.shape != (n,):
        raise ShapeError(f"workday: got shape {days.shape}, expected ({n},)")
    wrong = ~np.isin(days, (0.0, 1.0))
    if wrong.any():
        row = int(wrong.argmax())
        told = "is missing" if np.isnan(days[row]) else f"is {days[row]:g}"
        raise ParameterError(f"workday: row {row} {told}, expected True or False in every row")
    return days.astype(bool)


def _step(times: Times) -> float:
    """Hours between rows where they divide the day, else one hour."""
    if len(times) < 2:
        return 1.0
    step = find_steps(times).step
    if step is None:
        step = np.median(np.diff(times.instant))
    if np.datetime_data(step.dtype)[0] == "M":  # months are longer than a day
        return 1.0
    hours = float(step / np.timedelta64(1, "h"))
    return hours if 3600.0 * hours >= 1.0 and (24.0 / hours).is_integer() else 1.0


def _check_fitted(step: Any, attribute: str) -> None:
    if not hasattr(step, attribute):
        raise SequenceError(f"{type(step).__name__}: nothing has been learned yet; call fit first")

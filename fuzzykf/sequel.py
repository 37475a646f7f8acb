"""What follows the index of a series: the rows of a forecast."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, StepsWarning
from fuzzykf.steps import find_steps, step_note
from fuzzykf.times import as_spans, has_durations, has_times, read_times

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Sequel", "is_of_working_days", "is_timed", "sequel_of", "warn_of_steps"]

#: Digits that the steps of an index of floats may be off by, in units of the last place of its largest.
_ROUNDING = 4


@dataclass(frozen=True, eq=False)
class Sequel:
    """How an index goes on.

    Attributes
    ----------
    end : pandas.Index
        Its last entry, in its type and under its name.
    step : object
        What is between its entries: an offset of pandas, or a number; None if it does not say.
    """

    end: Any
    step: Any

    def ahead(self, steps: int, skip: int = 0) -> pd.Index | None:
        """Return the entries that follow; None if the index does not say how it goes on.

        Parameters
        ----------
        steps : int
        skip : int
            Entries that were passed since.
        """
        if self.step is None:
            return None
        import pandas as pd

        end, count = self.end[0], skip + steps + 1
        found: Any
        if isinstance(self.end, pd.PeriodIndex):
            found = pd.period_range(end, periods=count, freq=self.step)
        elif isinstance(self.end, pd.TimedeltaIndex):
            found = pd.timedelta_range(end, periods=count, freq=self.step)
        elif isinstance(self.end, pd.DatetimeIndex):
            found = pd.date_range(end, periods=count, freq=self.step, unit=self.end.unit)
        elif isinstance(self.step, int):
            found = pd.RangeIndex(end, end + self.step * count, self.step)
        else:
            found = pd.Index(end + self.step * np.arange(count))
        ahead: pd.Index = found[skip + 1 :].rename(self.end.name)
        return ahead

    def check_next(self, index: Any, skip: int = 0) -> None:
        """Raise unless an index of times goes on where this one ends.

        Parameters
        ----------
        index : object
            Of the series that is to follow; numbers and names are passed over: parts are numbered anew.
        skip : int
            Entries that were passed since.

        Raises
        ------
        ParameterError
            Names both stamps.
        """
        if not (is_timed(index) and is_timed(self.end)) or not len(index):
            return
        first, expected = index[0], self.ahead(1, skip)
        try:
            later = first > self.end[0]
        except TypeError as error:  # with a zone, and without
            raise ParameterError(
                f"zs: begins at {first}, but the filter stands at {self.end[0]}: {error}"
            ) from error
        if not later or (expected is not None and first != expected[0]):
            follows = "a later time" if expected is None else f"{expected[0]}"
            raise ParameterError(
                f"zs: begins at {first}, but the filter stands at {self.end[0]}, so that resume expects "
                f"{follows} next; give what is missing a row of NaN, or pass an array, which has no times"
            )


def is_timed(index: Any) -> bool:
    """Whether an index is made of times, or of durations."""
    return has_times(index) or has_durations(index)


def sequel_of(index: Any) -> Sequel | None:
    """Return how an index of pandas goes on; None where there is none.

    Times go on by their frequency, or by the step that they have where some rows are missing; numbers,
    if their steps are equal.

    Parameters
    ----------
    index : object
        Of a series, None if it has none.

    Examples
    --------
    >>> import pandas as pd
    >>> sequel_of(pd.date_range("2026-01-31", periods=3, freq="ME")).ahead(2).strftime(
    ...     "%m-%d"
    ... ).tolist()
    ['04-30', '05-31']
    """
    if not hasattr(index, "nlevels") or index.nlevels > 1 or not len(index):
        return None
    return Sequel(index[-1:].copy(deep=True), _step(index))


def _step(index: Any) -> Any:
    """Return what is between the entries of an index; None if they are not apart by one step."""
    import pandas as pd

    if isinstance(index, pd.RangeIndex):
        return int(index.step)
    if isinstance(index, pd.PeriodIndex):
        return index.freq
    if isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex):
        return index.freq or (_step_of_times(index) if has_times(index) else _step_of_durations(index))
    if index.dtype.kind not in "iuf" or len(index) < 2:
        return None
    values = index.to_numpy(dtype=np.float64)
    step = (values[-1] - values[0]) / (len(values) - 1)
    off = np.abs(np.diff(values) - step).max()
    if not step or not off <= _ROUNDING * np.spacing(np.abs(values).max()):
        return None
    return int(step) if index.dtype.kind in "iu" else step


def warn_of_steps(index: Any, argument: str = "zs") -> None:
    """Warn if rows are missing in an index of times, or their steps are unequal; working days are equal.

    Parameters
    ----------
    index : object
        Of a series, None if it has none.
    argument : str
        What it is called, for the message.
    """
    if not is_timed(index) or len(index) < 3:
        _warn_of_numbers(index, argument)
        return
    if getattr(index, "freq", None) is not None and index.dtype.kind in "mM":  # periods may have holes
        return
    numbers = getattr(index, "asi8", None)
    if numbers is not None and (np.diff(numbers) == numbers[1] - numbers[0]).all():
        return
    spans = as_spans(index)
    note = None if spans is None else step_note(spans, argument, index, is_index=True)
    if note is not None and not (has_times(index) and hasattr(index, "tz") and is_of_working_days(index)):
        warnings.warn(note, StepsWarning, stacklevel=4)


def _warn_of_numbers(index: Any, argument: str) -> None:
    """Warn if whole numbers that count the rows, or seconds, leave some out."""
    if getattr(getattr(index, "dtype", None), "kind", "") not in "iu" or not hasattr(index, "nlevels"):
        return
    steps = np.diff(index.to_numpy())
    if steps.size and steps.min() > 0 and (steps == steps.min()).mean() > 0.5 and steps.max() > steps.min():
        n = int((steps > steps.min()).sum())
        message = (
            f"{argument}: the index leaves out numbers in {n:,} of {steps.size:,} steps, and rows are taken "
            "as equally far apart; frame.reindex(range(first, last + 1, step)) gives the missing ones NaN"
        )
        warnings.warn(message, StepsWarning, stacklevel=5)


def is_of_working_days(index: Any) -> bool:
    """Whether times are those of working days, of which some may be missing: over a week, and no weekend."""
    clock = index.tz_localize(None)
    return (
        len(index) > 1
        and int(clock.day_of_week.max()) < 5
        and bool((clock - clock.normalize()).nunique() == 1)
        and (clock[-1] - clock[0]).days >= 7
        and int(np.diff(clock.normalize().to_numpy().astype("datetime64[D]")).astype(int).min()) == 1
    )


def _step_of_durations(index: Any) -> Any:
    """Return the step of durations if it is one."""
    import pandas as pd

    steps = np.diff(index.to_numpy())
    return pd.Timedelta(steps[0]) if steps.size and (steps == steps[0]).all() else None


def _step_of_times(index: Any) -> Any:
    """Return the step of times of which some may be missing, as an offset of pandas."""
    import pandas as pd

    clock = index.tz_localize(None)
    at_one_time = (clock - clock.normalize()).nunique() == 1
    if at_one_time and len(index) > 1:
        months = np.diff(12 * clock.year + clock.month)
        ends, begins = bool(clock.is_month_end.all()), bool(clock.is_month_start.all())
        if (ends or begins) and months.min() > 0:  # a quarter of them may be 31 days apart
            step = int(months.min())
            return pd.offsets.MonthEnd(step) if ends else pd.offsets.MonthBegin(step)
    found = find_steps(read_times(index))
    if found.step is None:
        return None
    if is_of_working_days(index):
        return pd.offsets.BDay()
    if np.datetime_data(found.step.dtype)[0] == "M":
        return pd.DateOffset(months=int(found.step.astype(np.int64)))
    days, rest = divmod(found.step, np.timedelta64(1, "D"))
    if at_one_time and not rest.astype(np.int64):
        return pd.DateOffset(days=int(days))  # by the clock, which has days of 23 hours
    return pd.Timedelta(found.step)

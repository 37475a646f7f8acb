"""What follows the index of a series: the rows of a forecast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.steps import find_steps
from fuzzykf.times import has_times, read_times

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Sequel", "sequel_of"]

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
        What is between its entries: an offset of pandas, or a number.
    """

    end: Any
    step: Any

    def ahead(self, steps: int, skip: int = 0) -> pd.Index:
        """Return the entries that follow.

        Parameters
        ----------
        steps : int
        skip : int
            Entries that were passed since.
        """
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


def sequel_of(index: Any) -> Sequel | None:
    """Return how an index of pandas goes on; None where it does not say so.

    Times go on by their frequency, or by the step that they have where some rows are missing; numbers,
    if their steps are equal.

    Parameters
    ----------
    index : object
        Of a series, None if it has none.

    Examples
    --------
    >>> import pandas as pd
    >>> sequel_of(pd.date_range("2026-01-31", periods=3, freq="ME")).ahead(2).strftime("%m-%d").tolist()
    ['04-30', '05-31']
    """
    if not hasattr(index, "nlevels") or index.nlevels > 1 or not len(index):
        return None
    step = _step(index)
    return None if step is None else Sequel(index[-1:].copy(deep=True), step)


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
    if not found.is_regular and pd.bdate_range(index[0], periods=len(index)).equals(index):
        return pd.offsets.BDay()
    if np.datetime_data(found.step.dtype)[0] == "M":
        return pd.DateOffset(months=int(found.step.astype(np.int64)))
    days, rest = divmod(found.step, np.timedelta64(1, "D"))
    if at_one_time and not rest.astype(np.int64):
        return pd.DateOffset(days=int(days))  # by the clock, which has days of 23 hours
    return pd.Timedelta(found.step)

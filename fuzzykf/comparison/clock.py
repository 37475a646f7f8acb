"""The hour and the day of each row, for those candidates that know the time of day."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.preprocessing import as_workdays, hour_of_day
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from typing import Self

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.times import Times

__all__ = ["Clock"]


@reprs()
@dataclass(frozen=True, eq=False)
class Clock:
    """Local time and working days of each row.

    Attributes
    ----------
    times : Times
        Times of the rows.
    workday : ndarray of bool, shape (n,)
        Whether it is a working day.

    Examples
    --------
    >>> from fuzzykf.times import read_times
    >>> clock = Clock.of(read_times(["2014-01-03T23:30", "2014-01-04T00:30"]))
    >>> clock.hour, clock.weekday, clock.workday
    (array([23.5,  0.5]), array([4., 5.]), array([ True, False]))
    """

    times: Times
    workday: BoolArray

    @classmethod
    def of(cls, times: Times, workday: BoolArray | None = None) -> Self:
        """Create a clock; by default Mondays to Fridays are working days.

        Parameters
        ----------
        times : Times
        workday : ndarray of bool, shape (n,), optional

        Returns
        -------
        Clock
        """
        return cls(times, as_workdays(workday, times.clock))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.workday)

    def __getitem__(self, rows: slice) -> Clock:
        """Return the clock of some rows."""
        return Clock(self.times[rows], self.workday[rows])

    @property
    def hour(self) -> FloatArray:
        """Hours since midnight, shape (n,)."""
        return hour_of_day(self.times)

    @property
    def weekday(self) -> FloatArray:
        """Days since Monday, shape (n,)."""
        days = self.times.clock.astype("datetime64[D]").astype(np.int64)
        return ((days + 3) % 7).astype(np.float64)  # the first day of 1970 was a Thursday

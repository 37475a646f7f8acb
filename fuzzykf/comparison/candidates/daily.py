"""The usual day: mean and spread of the state at each time of day, whatever is observed."""

from __future__ import annotations

from copy import copy
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned
from fuzzykf.errors import FuzzykfError
from fuzzykf.preprocessing import DailyProfile

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Self

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.comparison.candidates import LearningPart
    from fuzzykf.comparison.clock import Clock

__all__ = ["CANDIDATES", "LEAST_ROWS", "LearnedDay"]

#: Fewest rows of a cell, a time of day or one of a kind of day, from which a spread is taken.
LEAST_ROWS = 5


class LearnedDay(Learned):
    """Mean and standard deviation at each time of day.

    A time of day is as long as the step between rows where that divides the day, else an hour.  Working
    days and others are told apart if each time of day of either kind has rows enough; where the steps are
    too fine for that, an hour shares one mean.

    Parameters
    ----------
    part : LearningPart
        With times.

    Raises
    ------
    FuzzykfError
        If there are no times, or too few rows at a time of day.

    Notes
    -----
    It has no law of the observation, and so no likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import LearningPart
    >>> from fuzzykf.comparison.clock import Clock
    >>> from fuzzykf.times import read_times
    >>> hours = np.datetime64("2014-01-06T00", "s") + np.arange(840) * np.timedelta64(
    ...     3600, "s"
    ... )
    >>> clock, x = Clock.of(read_times(hours)), np.arange(840.0)[:, None] % 24
    >>> learned = LearnedDay(LearningPart(x=x, y=x, clock=clock)).at(clock[:3])
    >>> learned.restore(x[:0], x[:3]).mean.ravel()
    array([0., 1., 2.])
    """

    def __init__(self, part: LearningPart) -> None:
        if part.clock is None:
            raise FuzzykfError("the mean of a time of day needs times, and the rows have none")
        clock, x = part.clock, part.x
        step = float(DailyProfile().fit(x, clock.times).slot_)
        for self.slot, self.by_kind in ((step, True), (1.0, True), (step, False), (1.0, False)):
            cells, n = self._cells(clock), 2 * self._slots
            count = np.stack([_sums(cells, np.isfinite(column), n) for column in x.T], axis=1)
            by_kind = count.reshape(2, self._slots, -1)[: 1 + self.by_kind]
            occupied = np.unique(cells % self._slots)
            least = int(by_kind[:, occupied].min())
            if least >= LEAST_ROWS:
                break
        else:
            raise FuzzykfError(
                f"the spread at a time of day needs {LEAST_ROWS} rows of it at least, and there are times of "
                f"day with {least}"
            )
        with np.errstate(invalid="ignore", divide="ignore"):  # cells without a row
            self.mean = np.stack([_sums(cells, np.nan_to_num(v), n) for v in x.T], axis=1) / count
            squared = np.nan_to_num(x - self.mean[cells]) ** 2
            variance = np.stack([_sums(cells, v, n) for v in squared.T], axis=1) / (count - 1)
            self.std = np.sqrt(variance)
        kinds = " of working days and of others" if self.by_kind else ""
        length = f"{60 * self.slot:g} minutes" if self.slot < 1.0 else f"{self.slot:g} h"
        self.description = f"means of each {length}{kinds}"
        self._clock: Clock | None = None

    def at(self, clock: Clock | None) -> Self:
        """Return the same means for rows of a clock."""
        other = copy(self)
        other._clock = clock
        return other

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Look up the time of each row.

        Raises
        ------
        FuzzykfError
            If the rows have no times (`at`), or the rows learned on had none at that time of day.
        """
        clock = self._clock
        if clock is None or len(clock) != len(zs):
            raise FuzzykfError(f"the mean of a time of day needs the times of the {len(zs)} rows to restore")
        cells = self._cells(clock)
        unknown = np.isnan(self.mean[cells]).any(axis=1)
        if unknown.any():
            row = int(np.argmax(unknown))
            raise FuzzykfError(f"no row to learn on has the time of day of {clock.times.clock[row]}")
        return Estimates(mean=self.mean[cells], std=self.std[cells])

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that answers for the rows of the clock one after the other, and then anew."""
        rows = cycle(self.mean[[] if self._clock is None else self._cells(self._clock)])
        return lambda z: next(rows)

    @property
    def _slots(self) -> int:
        return round(24.0 / self.slot)

    def _cells(self, clock: Clock) -> IntArray:
        place = (clock.hour / self.slot + 1e-9).astype(np.int64)
        return place + self._slots * clock.workday if self.by_kind else place


def _sums(cells: IntArray, values: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.bincount(cells, weights=values, minlength=n), dtype=np.float64)


CANDIDATES = (Candidate("daily-profile", LearnedDay, title="mean of the time of day"),)

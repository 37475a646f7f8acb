"""How far rows are apart: equal steps, in whatever unit they are equal, and rows that are missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.times import NIGHT, Times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["Steps", "find_steps", "other_step", "spoken", "step_note"]

#: A step of so many units that the stamps are written in is told from its rounding.
_COARSE = 10

#: From so many equal steps on they are no roundings of another length.
_EXACT = 4

#: Units of steps that are equally long, in nanoseconds.
_NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


@dataclass(frozen=True, eq=False)
class Steps:
    """How far rows are apart.

    Attributes
    ----------
    step : timedelta64 or None
        What is between a row and the next, a number of months if these are equally long; None if
        there is no such step, or fewer than two rows.
    missing : ndarray of int, shape (n - 1,)
        Rows that are missing after each row but the last; empty without a step.
    """

    step: np.timedelta64 | None
    missing: NDArray[np.int64]

    @property
    def is_regular(self) -> bool:
        """Whether no row is missing."""
        return self.step is not None and not self.missing.any()


def find_steps(times: Times) -> Steps:
    """Find how far rows are apart, and how many are missing.

    Steps are equal if they are so by the instants, by the clock (days in which clocks are changed),
    in whole months from one day of the month, or from one last day of a month to another, or but
    for the rounding of the stamps (30 a second, written in milliseconds).  Where they are not, rows
    are missing if most steps are of one length and all others a whole number of it.

    Examples
    --------
    >>> from fuzzykf.times import read_times
    >>> steps = find_steps(read_times(["2014-01", "2014-02", "2014-03", "2014-05"]))
    >>> steps.step, steps.missing
    (np.timedelta64(1,'M'), array([0, 0, 1]))
    """
    none = Steps(None, np.zeros(0, dtype=np.int64))
    known = np.flatnonzero(~np.isnat(times.instant))
    apart = np.diff(known)  # rows, which are more than one where a time is missing
    if not (apart == 1).any():
        return none
    found = times if len(known) == len(times) else Times(times.clock[known], times.instant[known], False)
    scales = [np.diff(found.instant)]
    if times.has_offsets:
        scales.append(np.diff(found.clock))
    months = _months(found.clock)
    if months is not None:
        scales.append(np.diff(months))
    nothing = np.zeros(len(times) - 1, dtype=np.int64)
    for steps in scales:
        usual = steps[apart == 1][0]
        if usual > np.timedelta64(0) and bool((steps == apart * usual).all()):
            return Steps(usual, nothing)
    if len(known) == len(times) and _is_rounded(found.instant):
        usual = np.median(scales[0].astype(np.int64)).astype(scales[0].dtype)
        return Steps(usual, nothing)
    for steps in scales:
        lengths, counts = np.unique(steps[apart == 1], return_counts=True)
        usual = lengths[np.argmax(counts)]
        if usual <= np.timedelta64(0) or 2 * counts.max() < counts.sum():
            continue
        rows, rest = np.divmod(steps, usual)
        if not rest.astype(np.int64).any() and bool((rows >= apart).all()):
            nothing[known[:-1]] = rows - apart
            return Steps(usual, nothing)
    return none


def other_step(times: Times, step: np.timedelta64) -> np.timedelta64 | None:
    """Return how far rows are apart, if that is another length than ``step``.

    Parameters
    ----------
    times : Times
    step : timedelta64
        A number of months, seconds, or parts of seconds.

    Returns
    -------
    timedelta64 or None
        None if it is the same, but for the rounding of the stamps, or cannot be told.

    Examples
    --------
    >>> from fuzzykf.times import read_times
    >>> days = read_times(["2014-01-01", "2014-01-02", "2014-01-03"])
    >>> (
    ...     other_step(days, np.timedelta64(86400, "s")),
    ...     other_step(days, np.timedelta64(3600, "s")),
    ... )
    (None, np.timedelta64(86400,'s'))
    """
    if np.datetime_data(step.dtype)[0] == "M":
        times = _by_month(times)
    found = find_steps(times).step
    if found is None or _is_same(times, found, step):
        return None
    return found


def _by_month(times: Times) -> Times:
    """Return the months of times that stand at one place of theirs: two of these are no number of days."""
    known = ~np.isnat(times.clock)
    months = _months(times.clock[known]) if known.any() else None
    if months is None:
        return times
    clock = np.full(len(times), np.datetime64("NaT"), dtype="datetime64[M]")
    clock[known] = months
    return Times(clock, clock, False)


def _is_same(times: Times, found: np.timedelta64, step: np.timedelta64) -> bool:
    (unit, _), (of_step, _) = np.datetime_data(found.dtype), np.datetime_data(step.dtype)
    one, other = int(found.astype(np.int64)), int(step.astype(np.int64))
    if "M" in (unit, of_step):
        return unit == of_step and one == other
    one, other = one * _NANOSECONDS[unit], other * _NANOSECONDS[of_step]  # whole numbers of any size
    apart, tick = abs(one - other), max(_NANOSECONDS[unit], _NANOSECONDS[of_step])
    if apart == 0:
        return True
    if apart > tick or min(one, other) < _COARSE * tick:
        return False
    steps = np.diff(times.instant)
    return bool(len(steps) < _EXACT or (steps != found).any())


def step_note(
    times: Times, column: str, shown: Sequence[Any] | None = None, *, is_index: bool = False
) -> str | None:
    """Say what a model of equal steps should know of the steps of these rows; None if they are equal.

    Parameters
    ----------
    times : Times
    column : str
        Where they stand.
    shown : sequence, optional
        The stamps as they were written.
    is_index : bool
        Whether they are an index of pandas, and ``column`` is the argument whose index it is.

    Examples
    --------
    >>> from fuzzykf.times import read_times
    >>> note = step_note(
    ...     read_times(["2014-01-01", "2014-01-02", "2014-01-03", "2014-01-06"]), "day"
    ... )
    >>> note[:78]
    '2 rows are missing (column day, steps of 1 day, 0:00:00): 2 after 2014-01-03T0'
    """
    steps = find_steps(times)
    apart = np.diff(times.instant[~np.isnat(times.instant)])
    if not apart.size or steps.is_regular:
        return None
    place = f"index of {column}" if is_index else f"column {column}"
    empty = "of NaN (asfreq, reindex)" if is_index else "with empty cells"
    remedy = f"a model has a fixed time step: add rows {empty} for missing times"
    if steps.step is None and apart.min() == apart.max():
        return (
            f"rows without a time occur where no step is missing ({place}), and a model counts each as a "
            f"step: "
            "remove them, or fill in their times"
        )
    if steps.step is None:
        return (
            f"the steps between rows vary from {spoken(apart.min())} to {spoken(apart.max())} ({place}); "
            f"{remedy}"
        )
    names = times.clock if shown is None else shown
    after = np.flatnonzero(steps.missing)
    places = [f"{steps.missing[row]:,} after {names[row]}" for row in after[:3]]
    more = f" and {len(after) - 3:,} places more" if len(after) > 3 else ""
    count = int(steps.missing.sum())
    rows = "1 row is" if count == 1 else f"{count:,} rows are"
    told = f"{rows} missing ({place}, steps of {spoken(steps.step)}): {', '.join(places)}{more}"
    told += f"; {remedy}"
    if not times.has_offsets and any(_may_be_spring(times, row, steps.step) for row in after.tolist()):
        told += " (if clocks were put forward there, no row is missing; use times with UTC offsets)"
    return told


def _may_be_spring(times: Times, row: int, step: np.timedelta64) -> bool:
    """Whether an hour is missing in the night, as on the day on which clocks are put forward."""
    hour = np.timedelta64(1, "h")
    if np.datetime_data(step.dtype)[0] == "M" or step > hour:
        return False
    before, after = times.clock[row], times.clock[row + 1]
    midnight = after.astype("datetime64[D]")
    return bool(after - before == hour + step and after - midnight <= NIGHT * hour)


def _months(clock: NDArray[np.datetime64]) -> NDArray[np.datetime64] | None:
    """Return the months of times that stand at one place of theirs; None if they do not."""
    months = clock.astype("datetime64[M]")
    inside = clock - months
    if bool((inside == inside[0]).all()):
        return months
    from_end = clock - (months + 1)
    last_day = from_end >= -np.timedelta64(1, "D")
    return months if bool((last_day & (from_end == from_end[0])).all()) else None


def _is_rounded(instant: NDArray[np.datetime64]) -> bool:
    """Whether times are those of equal steps, but for the last digit that they are written with."""
    units = instant.astype(np.int64) - instant.astype(np.int64)[0]
    length = units[-1] / (len(units) - 1)
    return bool(length >= _COARSE and np.all(np.abs(units - length * np.arange(len(units))) <= 1.0))


def spoken(step: np.timedelta64) -> str:
    """Return the length of a step in words and digits.

    Examples
    --------
    >>> spoken(np.timedelta64(1, "M")), spoken(np.timedelta64(90, "m"))
    ('1 month', '1:30:00')
    """
    if np.datetime_data(step.dtype)[0] == "M":
        count = int(step.astype(np.int64))
        return "1 month" if count == 1 else f"{count} months"
    whole = step.astype("timedelta64[us]")
    return str(whole.item()) if whole == step else str(step)

"""Times of rows: how they are read, in which zone, and that they are in order.

Two clocks tell the time of a row.  The *clock* on the spot gives the hour of the day, and working
days; the *instant*, which is the same everywhere, gives order and steps.  Stamps with an offset from
Greenwich have both.  Of stamps without one the two are the same, so the hour that a clock shows twice
in autumn cannot be told apart, and is refused.

Objects of pandas are known by what they can do: nothing here imports it.  `fuzzykf.steps` tells
how far rows are apart.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

__all__ = [
    "NIGHT",
    "Times",
    "as_spans",
    "check_increasing",
    "has_durations",
    "has_times",
    "is_time",
    "read_times",
    "written_times",
]

_ISO = re.compile(
    r"(\d{4}-\d\d-\d\d|\d{8}|\d{4}-?W\d\d-?\d)"
    r"(?:[T ](\d\d(?::?\d\d(?::?\d\d(?:[.,](\d+))?)?)?)(Z|[+-]\d\d(?::?\d\d)?)?)?",
    re.ASCII,
)
_MONTH = re.compile(r"\d{4}-\d\d", re.ASCII)
_NUMBER = re.compile(r"([+-]?)(\d+)(?:\.(\d*))?", re.ASCII)

#: Directives of strptime that hold the year, without which there is no date.
_YEARS = ("%Y", "%y", "%G", "%c", "%x")

#: Digits of a second in a number of seconds, and of milliseconds.
_UNIX = {"unix": 9, "unix_ms": 6}

_1970, _MICROSECOND = datetime(1970, 1, 1), timedelta(microseconds=1)

#: What NumPy takes for no time.
_NOT_A_TIME = int(np.iinfo(np.int64).min)

#: What is said of two rows that have the same time.
_TWICE = (
    "it stands twice, expected one row for each time (of pandas, frame.groupby(level=0).mean() has the mean)"
)

#: Until this hour of the night clocks are put back or forward, in whatever country.
NIGHT = 4

#: Months in which clocks are put back somewhere: autumn in the north and, in spring there, in the south.
_PUT_BACK = (2, 3, 4, 5, 9, 10, 11)


@dataclass(frozen=True, eq=False)
class Times:
    """The times of rows.

    Attributes
    ----------
    clock : ndarray of datetime64, shape (n,)
        What a clock on the spot shows, in seconds, or finer where the stamps are.
    instant : ndarray of datetime64, shape (n,)
        The same in UTC if the stamps have offsets, else what the clock shows.
    has_offsets : bool
    """

    clock: NDArray[np.datetime64]
    instant: NDArray[np.datetime64]
    has_offsets: bool

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.clock)

    def __getitem__(self, rows: slice) -> Times:
        """Return the times of some rows."""
        return Times(self.clock[rows], self.instant[rows], self.has_offsets)


class _NoTimeError(Exception):
    """What a stamp is instead of a time; says what was expected."""


# --------------------------------------------------------------------------- reading


def read_times(
    stamps: Any,
    *,
    name: str = "time",
    format: str | None = None,
    gaps: bool = False,
    ordered: bool = True,
    where: Callable[[int], str] | None = None,
    error: type[FuzzykfError] = ParameterError,
    remedy: str = "",
) -> Times:
    """Read the times of rows.

    Parameters
    ----------
    stamps : array_like of shape (n,), or Times
        Text of ISO 8601, datetime objects, stamps and periods of pandas, datetime64, or a Series or an
        index of pandas; all of them with an offset from Greenwich (or a zone), or none.
    name : str
        Of the argument, for messages.
    format : str, optional
        How text is written, as `datetime.strptime` has it; "unix" or "unix_ms": the stamps are numbers
        of seconds, or of milliseconds, since 1970 in UTC.
    gaps : bool
        Whether some may be missing; they become NaT.
    ordered : bool
        Whether each has to be later than the one before it.
    where : callable, optional
        Names a row in messages; by default "time: row 3".
    error : type
        Of the error if a stamp is no time, or they are not in order.
    remedy : str
        What to do about times that are written in another way.

    Raises
    ------
    ParameterError
        If the format is none, or ``stamps`` are numbers and it does not say so.
    ShapeError
        If they are not in one row.

    Examples
    --------
    >>> times = read_times(["2014-04-06T02:30+11:00", "2014-04-06T02:00+10:00"])
    >>> [str(one) for one in times.clock]
    ['2014-04-06T02:30:00', '2014-04-06T02:00:00']
    >>> str(times.instant[1] - times.instant[0])
    '1800 seconds'
    """
    if isinstance(stamps, Times):
        return stamps
    _check_format(name, format)
    place = where or (lambda row: f"{name}: row {row}")
    clock, instant = _zoned(stamps) if _is_zoned(stamps) else (_array(name, stamps), None)
    shown: Any = stamps
    if clock.ndim != 1:
        raise ShapeError(f"{name}: got shape {clock.shape}, expected (n,)")
    if clock.dtype.kind in "biuf":
        if format not in _UNIX or clock.dtype.kind == "b":
            raise ParameterError(
                f"{name}: got numbers of type {clock.dtype}, expected times; numbers of seconds since 1970 "
                "are times as numpy.asarray(..., 'datetime64[s]'), in a file with the format 'unix'"
            )
        shown = clock
        clock = instant = _since_1970(clock, _UNIX[format], place, error)
    elif clock.dtype.kind != "M":
        shown = clock
        clock, instant = _each(clock, format, gaps, place, error, remedy)
    elif format is not None:
        raise ParameterError(f"{name}: got times, expected text or numbers beside the format {format!r}")
    missing = np.isnat(clock)
    if missing.any() and not gaps:
        raise error(f"{place(int(np.argmax(missing)))} is not a time: expected one in every row")
    found = Times(
        _coarsest(name, clock), _coarsest(name, clock if instant is None else instant), instant is not None
    )
    if ordered:
        _check_order(found, shown, place, error)
    return found


def has_times(index: Any) -> bool:
    """Whether an index of pandas, or an array, is made of times; text is none, see `written_times`."""
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    if kind == "O" and not _is_periods(index):  # such as times of several offsets
        first = _first(index)
        return isinstance(first, date | np.datetime64) or _is_period(first)
    return kind == "M" or _is_zoned(index) or _is_periods(index)


def written_times(index: Any, where: Callable[[int], str] | None = None) -> Times | None:
    """Return the times of an index of text, as one is whose dates nobody has parsed; None if it is none.

    It is one if every entry is a time of ISO 8601.  Digits alone may be the numbers of anything.

    Parameters
    ----------
    index : index of pandas, or array
    where : callable, optional
        Names a row in messages.

    Raises
    ------
    ParameterError
        If some of the times have an offset from Greenwich, and others have none.

    Examples
    --------
    >>> written_times(np.array(["2014-01-02", "2014-01-01"], dtype=object)).clock.astype(
    ...     str
    ... ).tolist()
    ['2014-01-02T00:00:00', '2014-01-01T00:00:00']
    >>> written_times(np.array(["2014-01-02", "later"], dtype=object)) is None
    True
    """
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    entries: Any = np.asarray(index, dtype=object) if kind in tuple("OUT") else np.zeros(0)
    if entries.ndim != 1 or not entries.size or not all(map(_is_written, (entries[0], entries[-1]))):
        return None
    try:
        return read_times(entries, ordered=False, where=where)
    except ParameterError:
        if all(map(_is_written, entries)):
            raise
        return None


def _is_written(entry: Any) -> bool:
    return isinstance(entry, str) and not entry.strip().isdigit() and is_time(entry.strip())


def check_increasing(index: Any, where: Callable[[int], str]) -> None:
    """Raise unless the times, or the durations, of an index increase; any other index may be in any order.

    An index of text whose entries are all times of ISO 8601 is one of times, see `written_times`.

    Parameters
    ----------
    index : index of pandas, or array
    where : callable
        Names a row in messages.

    Raises
    ------
    ParameterError
        Names the first row that is not later than the one before it, or missing.

    Examples
    --------
    >>> check_increasing(np.array([2, 1], dtype="timedelta64[h]"), lambda row: f"row {row}")
    Traceback (most recent call last):
        ...
    fuzzykf.errors.ParameterError: row 1 is 1 hours, not later than 2 hours in the row before
    """
    if has_times(index):
        read_times(index, where=where)
    elif has_durations(index):
        _check_durations(index, where)
    else:
        times = written_times(index, where)
        if times is not None:
            _check_order(times, index, where, ParameterError)


def _check_durations(index: Any, where: Callable[[int], str]) -> None:
    if index.dtype.kind == "m":  # all at once, and one by one only to name what is wrong
        spans = np.asarray(index)
        if not np.isnat(spans).any() and bool((spans[1:] > spans[:-1]).all()):
            return
    before: Any = None
    for row, span in enumerate(index):
        if not isinstance(span, timedelta | np.timedelta64) or _is_missing(span):
            raise ParameterError(f"{where(row)} is {_shown(span)}, expected a duration in every row")
        if before is not None and not span > before:
            twice = f": {_TWICE}" if span == before else ""
            raise ParameterError(f"{where(row)} is {span}, not later than {before} in the row before{twice}")
        before = span


def as_spans(index: Any) -> Times | None:
    """Return the times of an index that `check_increasing` has let in, durations as times since 1970.

    Text whose entries are all times of ISO 8601 is read; None if it holds neither.

    Examples
    --------
    >>> as_spans(np.array([1, 2], dtype="timedelta64[h]")).instant.tolist()
    [datetime.datetime(1970, 1, 1, 1, 0), datetime.datetime(1970, 1, 1, 2, 0)]
    """
    if has_times(index):
        return read_times(index)
    if not has_durations(index):
        return written_times(index)
    since = np.datetime64(0, "s") + np.asarray(index).astype("timedelta64[ns]")
    moments = _coarsest("index", since)
    return Times(moments, moments, False)


def has_durations(index: Any) -> bool:
    """Whether an index of pandas, or an array, is made of durations."""
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    return kind == "m" or (kind == "O" and isinstance(_first(index), timedelta | np.timedelta64))


def _first(index: Any) -> Any:
    """Return the first entry that is not missing; None if there is none."""
    return next((one for one in index if not _is_missing(one)), None)


def _is_missing(stamp: Any) -> bool:
    if stamp is None or type(stamp).__name__ in ("NAType", "NaTType"):
        return True
    if isinstance(stamp, np.datetime64 | np.timedelta64):
        return bool(np.isnat(stamp))
    return isinstance(stamp, float) and bool(np.isnan(stamp))


def is_time(text: str) -> bool:
    """Whether a text is a time of ISO 8601.

    Examples
    --------
    >>> [is_time(text) for text in ("2014-03-29", "03/29/2024", "1396051200")]
    [True, False, False]
    """
    try:
        moment, _ = _from_text(text, None)
    except _NoTimeError:
        return False
    return moment is not None


def _check_format(name: str, format: Any) -> None:
    if format is None or format in _UNIX:
        return
    if not isinstance(format, str) or not any(year in format for year in _YEARS):
        raise ParameterError(
            f"{name}: got the format {format!r}, expected 'unix', 'unix_ms', or a date with its year in the "
            "manner of strptime, such as '%d.%m.%Y %H:%M'"
        )
    try:
        datetime.strptime("", format)
    except (ValueError, re.error) as fault:
        if "does not match" not in str(fault):
            raise ParameterError(f"{name}: the format {format!r} cannot be read: {fault}") from None


def _is_zoned(stamps: Any) -> bool:
    return getattr(getattr(stamps, "dtype", None), "tz", None) is not None


def _is_periods(stamps: Any) -> bool:
    return str(getattr(stamps, "dtype", "")).startswith("period[")


def _is_period(stamp: Any) -> bool:
    """Whether it is one period of pandas."""
    return hasattr(stamp, "to_timestamp") and hasattr(stamp, "ordinal")


def _zoned(stamps: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Take apart what pandas keeps with a zone."""
    of = getattr(stamps, "dt", stamps)  # a Series has its methods of times there
    return np.asarray(of.tz_localize(None)), np.asarray(of.tz_convert(None))


def _array(name: str, stamps: Any) -> NDArray[Any]:
    if _is_periods(stamps):
        stamps = getattr(stamps, "dt", stamps).to_timestamp()
    if isinstance(stamps, np.ma.MaskedArray):
        values = stamps.data.copy() if stamps.dtype.kind == "M" else stamps.data.astype(object)
        values[np.ma.getmaskarray(stamps)] = None  # NaT, where the array is one of times
        stamps = values
    if isinstance(stamps, list | tuple):  # NumPy warns of what is masked in them
        stamps = [None if one is np.ma.masked else one for one in stamps]
    try:
        given = np.asarray(stamps)
    except ValueError as error:
        raise ParameterError(f"{name}: got lists of unequal length, expected times") from error
    if given.dtype.kind in "SUO":
        # NumPy would turn aware datetimes into UTC, and cut texts of several lengths to one.
        return np.asarray(stamps, dtype=object)
    if given.dtype.kind not in "Mbiuf":
        raise ParameterError(f"{name}: got numbers of type {given.dtype}, expected times")
    return given


def _each(
    stamps: NDArray[Any],
    format: str | None,
    gaps: bool,
    place: Callable[[int], str],
    error: type[FuzzykfError],
    remedy: str,
) -> tuple[NDArray[np.datetime64], NDArray[np.datetime64] | None]:
    """Read one after the other; return clocks and, of stamps with offsets, instants."""
    n = len(stamps)
    clocks, offsets = (
        [_NOT_A_TIME] * n,
        [0] * n,
    )  # microseconds, which NumPy takes ten times as fast as objects
    rest: dict[int, int] = {}  # nanoseconds that a datetime cannot hold
    zoned: bool | None = None
    for row, stamp in enumerate(stamps.tolist()):
        try:
            moment, nanoseconds = _moment(stamp, format)
        except _NoTimeError as fault:
            raise error(f"{place(row)} is {_shown(stamp)}, {fault}{remedy}") from None
        if moment is None:
            if gaps:
                continue
            raise error(f"{place(row)} is not a time ({_shown(stamp)}): expected one in every row")
        offset = moment.utcoffset()
        if (offset is not None) != zoned:
            if zoned is not None:
                raise error(f"{place(row)} is {_shown(stamp)}, expected an offset in every row or in none")
            zoned = offset is not None
        if offset is not None:
            moment, offsets[row] = moment.replace(tzinfo=None), offset // _MICROSECOND
        clocks[row] = (moment - _1970) // _MICROSECOND
        if nanoseconds:
            rest[row] = nanoseconds
    clock = np.array(clocks, dtype=np.int64).view("datetime64[us]")
    if rest:
        clock = clock.astype("datetime64[ns]")
        clock[list(rest)] += np.array(list(rest.values()), dtype="timedelta64[ns]")
    return clock, (clock - np.array(offsets, dtype=np.int64).view("timedelta64[us]") if zoned else None)


def _moment(stamp: Any, format: str | None) -> tuple[datetime | None, int]:
    """Return one time and its nanoseconds below a microsecond; None if there is none."""
    if isinstance(stamp, bytes):
        stamp = stamp.decode("ascii", "replace")
    if isinstance(stamp, str):
        return _from_text(stamp.strip(), format)
    if _is_missing(stamp):
        return None, 0
    if _is_period(stamp):
        stamp = stamp.to_timestamp()
    if isinstance(stamp, np.datetime64):
        whole = stamp.astype("datetime64[us]")
        return whole.item(), int((stamp.astype("datetime64[ns]") - whole) / np.timedelta64(1, "ns"))
    if isinstance(stamp, datetime):
        return stamp, int(getattr(stamp, "nanosecond", 0))
    if isinstance(stamp, date):
        return datetime(stamp.year, stamp.month, stamp.day), 0
    if format in _UNIX and isinstance(stamp, int | float) and not isinstance(stamp, bool):
        return _from_text(repr(stamp), format)
    raise _NoTimeError(f"expected a time, got {type(stamp).__name__}")


def _from_text(text: str, format: str | None) -> tuple[datetime | None, int]:
    if not text:
        return None, 0
    if format in _UNIX:
        return _from_digits(text, _UNIX[format])
    if format is not None:
        try:
            return datetime.strptime(text, format), 0
        except (ValueError, OverflowError):
            raise _NoTimeError(f"expected a time in the format {format!r}") from None
    if len(text) == 7 and _MONTH.fullmatch(text):
        text += "-01"
    found = _ISO.fullmatch(text)
    expected = "expected a time as in 2014-01-31T16:30"
    if not found:
        raise _NoTimeError(expected)
    day, clock, digits, offset = found.groups()
    if digits is None:
        plain, nanoseconds = text, 0
    else:
        digits = digits.ljust(9, "0")
        if digits[9:].strip("0"):
            raise _NoTimeError("expected no digits beyond those of a nanosecond")
        whole = clock.replace(",", ".").split(".")[0]
        plain, nanoseconds = f"{day}T{whole}.{digits[:6]}{offset or ''}", int(digits[6:9])
    try:
        return datetime.fromisoformat(plain), nanoseconds
    except ValueError as error:
        raise _NoTimeError(f"{expected} ({error})") from None


def _from_digits(text: str, places: int) -> tuple[datetime, int]:
    """Read a decimal number of units since 1970, of which a nanosecond is the last of some places."""
    found = _NUMBER.fullmatch(text)
    if not found or (found[3] or "")[places:].strip("0"):
        raise _NoTimeError("expected a number of seconds (or milliseconds) since 1970")
    units, digits = found[2], (found[3] or "")[:places].ljust(places, "0")
    nanoseconds = int(found[1] + units + digits)
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=nanoseconds // 1000)
    except OverflowError:
        raise _NoTimeError("expected a number of seconds (or milliseconds) since 1970") from None
    return moment, nanoseconds % 1000


def _since_1970(
    numbers: NDArray[Any], places: int, place: Callable[[int], str], error: type[FuzzykfError]
) -> NDArray[np.datetime64]:
    """Return numbers of seconds or milliseconds as times, to the microsecond if they are floats."""
    bad = ~(np.abs(numbers.astype(np.float64)) < 10.0 ** (20 - places))  # some 3,000 years
    if bad.any():
        row = int(np.argmax(bad))
        raise error(f"{place(row)} is {numbers[row]}, expected a number of seconds (or ms) since 1970")
    if numbers.dtype.kind == "f":
        return np.asarray(np.round(numbers * 10.0 ** (places - 3)).astype("datetime64[us]"))
    return numbers.astype(np.int64).astype(f"datetime64[{'s' if places == 9 else 'ms'}]")


def _coarsest(name: str, times: NDArray[np.datetime64]) -> NDArray[np.datetime64]:
    """Return times in the first unit that holds them all: seconds, unless they have parts of these."""
    if np.datetime_data(times.dtype)[0] in ("ps", "fs", "as"):
        fine, times = times, times.astype("datetime64[ns]")
        if not bool((times.astype(fine.dtype) == fine).all()):
            raise ParameterError(f"{name}: got times in {fine.dtype}, expected none finer than a nanosecond")
    for unit in ("s", "ms", "us"):
        found = times.astype(f"datetime64[{unit}]")
        if bool(((found == times) | np.isnat(times)).all()):
            return found
    return times.astype("datetime64[ns]")


def _shown(stamp: Any) -> str:
    return repr(str(stamp)) if isinstance(stamp, str) else str(stamp)


def _check_order(times: Times, stamps: Any, place: Callable[[int], str], error: type[FuzzykfError]) -> None:
    known = np.flatnonzero(~np.isnat(times.instant))
    steps = np.diff(times.instant[known])
    back = steps <= np.timedelta64(0, "s")
    if not back.any():
        return
    first = int(np.argmax(back))
    before, row = known[first : first + 2].tolist()
    shown = list(stamps)
    where = "in the row before" if before == row - 1 else "in the last row before it that has a time"
    told = f"{place(row)} is {_shown(shown[row])}, not later than {_shown(shown[before])} {where}"
    half_years = abs(times.clock[known[-1]] - times.clock[known[0]]) // np.timedelta64(180, "D")
    may_be_autumn = back.sum() <= 1 + half_years and _shows_an_hour_twice(times.clock[row], steps, first)
    if may_be_autumn and not times.has_offsets:
        told += (
            "; if clocks were put back there, the hour that they showed twice can be told apart by offsets "
            "from Greenwich alone, as in 2014-10-26T01:30+01:00: give one in every row"
            + (f"; else {_TWICE}" if steps[first] == np.timedelta64(0, "s") else "")
        )
    elif steps[first] == np.timedelta64(0, "s"):
        told += f": {_TWICE}"
    raise error(told)


def _shows_an_hour_twice(clock: np.datetime64, steps: NDArray[np.timedelta64], back: int) -> bool:
    """Whether rows may go back because clocks were put back: at night, in a month in which that is.

    Then the step back is an hour less than usual, and the hour that follows has the usual steps.  A row that
    stands twice among half hours is none of these.  Two rows alone show no step, and may be anything.
    """
    hour = np.timedelta64(1, "h")
    month = int(clock.astype("datetime64[M]").astype(int)) % 12 + 1
    if clock - clock.astype("datetime64[D]") >= NIGHT * hour or month not in _PUT_BACK:
        return False
    forward = steps[steps > np.timedelta64(0)]
    if not len(forward):
        return bool(steps[back] >= -hour)
    usual = np.sort(forward)[len(forward) // 2]
    rows = max(1, int(hour // usual))
    after = steps[back + 1 : back + 1 + rows]
    return bool(steps[back] + hour == usual and (after == usual).all())

"""Times that are in no file: of the steps ahead of one, and of a series that is drawn."""

from __future__ import annotations

import re
from datetime import timedelta, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.sequel import Sequel, sequel_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.times import Times

__all__ = ["index_ahead", "index_from", "written_stamps"]

#: A date with a clock or without, as files write it.
_FORM = re.compile(
    r"\d{4}-\d\d-\d\d(?:(?P<between>[T ])(?P<clock>\d\d(?::?(?P<minute>\d\d)"
    r"(?::?(?P<second>\d\d)(?:(?P<point>[.,])(?P<digits>\d+))?)?)?)(?P<offset>Z|[+-]\d\d(?::?\d\d)?)?)?",
    re.ASCII,
)
_MONTH = re.compile(r"\d{4}-\d\d", re.ASCII)

#: Of how many nanoseconds the units since 1970 are, as a power of ten.
_UNIX = {"unix": 9, "unix_ms": 6}


def index_ahead(times: Times, steps: int, step: np.timedelta64 | None) -> Any:
    """Return the times that follow, as an index of pandas; None if nobody knows how far they are apart.

    Parameters
    ----------
    times : Times
        Of the rows; NaT where a row has none.  With offsets from Greenwich that of the last one stays: no
        file says when clocks will be changed.
    steps : int
    step : timedelta64 or None
        How far the rows were apart from which the model learned.  It counts where a single row does not say.

    Raises
    ------
    ParameterError
        If the last row has no time, from which the steps ahead count.
    """
    if np.isnat(times.instant[-1]):
        raise ParameterError("time: the last row has none, expected one, from which the steps ahead count")
    index = _index_of(times)
    index = index[~index.isna()]
    sequel = sequel_of(index)
    if len(index) == 1 and step is not None:
        sequel = Sequel(index, _offset(step))
    return None if sequel is None else sequel.ahead(steps)


def index_from(start: Times, steps: int, step: np.timedelta64) -> Any:
    """Return times from a first one on, as an index of pandas."""
    import pandas as pd

    first = _index_of(start)
    return pd.date_range(first[0], periods=steps, freq=_offset(step))


def written_stamps(index: Any, like: Sequence[str] = (), format: str | None = None) -> list[str]:
    """Return times as text, in the form of others.

    Parameters
    ----------
    index : DatetimeIndex
    like : sequence of str
        Times in ISO 8601, of which the last one that has a clock decides how it is written: with T or a
        space, with seconds or without, how the offset.  Where that would lose something more is written.
        Without them dates alone, or to the minute, where that is all.
    format : str, optional
        The format of the others, if it is not that: one of strptime, "unix" or "unix_ms".

    Examples
    --------
    >>> import pandas as pd
    >>> hours = pd.date_range("2014-01-31T16:30", periods=2, freq="h")
    >>> written_stamps(hours), written_stamps(hours, ["2014-01-31 15:30:00"])
    (['2014-01-31T16:30', '2014-01-31T17:30'], ['2014-01-31 16:30:00', '2014-01-31 17:30:00'])
    """
    if format in _UNIX:
        return [_decimal(int(stamp.as_unit("ns").value), _UNIX[format]) for stamp in index]
    if format is not None:
        return [stamp.strftime(format) for stamp in index]
    forms = [found for found in map(_FORM.fullmatch, like) if found]
    if like and all(map(_MONTH.fullmatch, like)) and index.tz is None and (index.day == 1).all():
        return [stamp.strftime("%Y-%m") for stamp in index]
    clocked = [form for form in forms if form["clock"]]
    is_dated = index.tz is None and (index == index.normalize()).all()
    if is_dated and not clocked:
        return [stamp.date().isoformat() for stamp in index]
    form = clocked[-1] if clocked else None
    return [_written(stamp, form, _parts_needed(index, form)) for stamp in index]


def _parts_needed(index: Any, form: re.Match[str] | None) -> int:
    """Return how many of hour, minute, second and digits of a second are written: 1, 2, 3, 3 + digits."""
    needed = next((k for k, unit in enumerate(("h", "min", "s"), 1) if (index == index.floor(unit)).all()), 0)
    if not needed:
        needed = 3 + max(len(_fraction(stamp).rstrip("0")) for stamp in index)
    if form is None:
        return max(needed, 2)
    digits = len(form["digits"] or "")
    return max(
        needed, 3 + digits if digits else 1 + (form["minute"] is not None) + (form["second"] is not None)
    )


def _fraction(stamp: Any) -> str:
    return f"{stamp.microsecond * 1000 + stamp.nanosecond:09}"


def _written(stamp: Any, form: re.Match[str] | None, parts: int) -> str:
    colon, between, point = ":", "T", "."
    if form is not None:
        between, point = form["between"], form["point"] or "."
        colon = "" if form["minute"] and ":" not in form["clock"] else ":"
    clock = colon.join([f"{stamp.hour:02}", f"{stamp.minute:02}", f"{stamp.second:02}"][:parts])
    if parts > 3:
        clock += point + _fraction(stamp)[: parts - 3]
    offset = "" if stamp.tzinfo is None else stamp.isoformat(timespec="minutes")[16:]
    style = "" if form is None else form["offset"] or ""
    if style == "Z" and offset == "+00:00":
        offset = "Z"
    elif style and style != "Z" and ":" not in style:
        offset = offset.replace(":", "")
        offset = offset[:3] if len(style) == 3 and offset.endswith("00") else offset
    return f"{stamp.date().isoformat()}{between}{clock}{offset}"


def _decimal(nanoseconds: int, places: int) -> str:
    """Write a number of nanoseconds in units of ten to the power of some places of them."""
    sign = "-" if nanoseconds < 0 else ""
    whole, rest = divmod(abs(nanoseconds), 10**places)
    return f"{sign}{whole}" + (f".{rest:0{places}}".rstrip("0") if rest else "")


def _index_of(times: Times) -> Any:
    import pandas as pd

    if not times.has_offsets:
        return pd.DatetimeIndex(times.clock)
    offset = timedelta(seconds=int((times.clock[-1] - times.instant[-1]) / np.timedelta64(1, "s")))
    return pd.DatetimeIndex(times.instant).tz_localize("UTC").tz_convert(timezone(offset))


def _offset(step: np.timedelta64) -> Any:
    import pandas as pd

    if np.datetime_data(step.dtype)[0] == "M":
        return pd.DateOffset(months=int(step.astype(np.int64)))
    return pd.Timedelta(step)

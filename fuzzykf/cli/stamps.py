"""Times that are in no file: of the steps ahead of one, and of a series that is drawn."""

from __future__ import annotations

from datetime import timedelta, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.sequel import Sequel, sequel_of

if TYPE_CHECKING:
    from fuzzykf.times import Times

__all__ = ["index_ahead", "index_from", "written_stamps"]


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


def written_stamps(index: Any) -> list[str]:
    """Return times as text of ISO 8601: dates alone, or to the minute, where that is all.

    Examples
    --------
    >>> import pandas as pd
    >>> written_stamps(pd.date_range("2014-01-31T16:30", periods=2, freq="h"))
    ['2014-01-31T16:30', '2014-01-31T17:30']
    """
    if index.tz is None and (index == index.normalize()).all():
        return [stamp.date().isoformat() for stamp in index]
    is_whole = (index == index.floor("min")).all()
    return [stamp.isoformat(timespec="minutes" if is_whole else "auto") for stamp in index]


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

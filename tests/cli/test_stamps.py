"""Times of the steps ahead are written as those of the file are."""

from __future__ import annotations

import pandas as pd
import pytest

from fuzzykf.cli.stamps import index_ahead, written_stamps
from fuzzykf.times import read_times

#: Times of a file, and those that follow.
WRITTEN = {
    "space and seconds": (["2026-03-15 22:00:00", "2026-03-15 23:00:00"], "2026-03-16 00:00:00"),
    "T and minutes": (["2026-03-15T22:00", "2026-03-15T23:00"], "2026-03-16T00:00"),
    "hours alone": (["2026-03-15T22", "2026-03-15T23"], "2026-03-16T00"),
    "no colons": (["2026-03-15T2200", "2026-03-15T2230"], "2026-03-15T2300"),
    "dates": (["2026-03-14", "2026-03-15"], "2026-03-16"),
    "months": (["2026-03", "2026-04"], "2026-05"),
    "midnights": (["2026-03-14 00:00", "2026-03-15 00:00"], "2026-03-16 00:00"),
    "a bare midnight": (["2026-03-14 12:00", "2026-03-15"], "2026-03-15 12:00"),
    "parts of seconds": (["2026-03-15 22:00:00,25", "2026-03-15 22:00:00,50"], "2026-03-15 22:00:00,75"),
    "more digits than before": (["2026-03-15T22:00:00", "2026-03-15T22:00:00.5"], "2026-03-15T22:00:01.0"),
    "Greenwich": (["2026-03-15T22:00Z", "2026-03-15T23:00Z"], "2026-03-16T00:00Z"),
    "offset": (["2026-03-15 22:00:00+01:00", "2026-03-15 23:00:00+01:00"], "2026-03-16 00:00:00+01:00"),
    "offset without a colon": (["2026-03-15 22:00-0330", "2026-03-15 23:00-0330"], "2026-03-16 00:00-0330"),
    "offset of hours": (["2026-03-15 22:00+01", "2026-03-15 23:00+01"], "2026-03-16 00:00+01"),
    "of the week": (["20260315T2200", "20260315T2300"], "2026-03-16T00:00"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITTEN)
def test_times_are_written_as_those_before(kind) -> None:
    before, after = WRITTEN[kind]
    times = read_times(before)
    written = written_stamps(index_ahead(times, 3, None), before)
    assert written[0] == after
    # Oracle: what is read back goes on as the rows do.
    both = read_times([*before, *written]).instant
    if kind != "months":
        assert len(set((both[1:] - both[:-1]).tolist())) == 1


@pytest.mark.parametrize(
    ("format", "before", "after"),
    [
        ("%d.%m.%Y %H:%M", ["15.03.2026 22:00", "15.03.2026 23:00"], "16.03.2026 00:00"),
        ("unix", ["1773612000", "1773615600"], "1773619200"),
        ("unix", ["1.5", "2"], "2.5"),
        ("unix_ms", ["1500", "2000.25"], "2500.5"),
    ],
)
def test_times_are_written_in_their_format(format, before, after) -> None:
    ahead = index_ahead(read_times(before, format=format), 1, None)
    assert written_stamps(ahead, before, format) == [after]


def test_more_is_written_where_the_form_would_lose_something() -> None:
    half_hours = pd.date_range("2026-03-15T00:30", periods=1)
    assert written_stamps(half_hours, ["2026-03-15"]) == ["2026-03-15T00:30"]
    assert written_stamps(half_hours, ["2026-03-15 00"]) == ["2026-03-15 00:30"]

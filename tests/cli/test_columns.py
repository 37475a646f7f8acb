"""Columns come in with gaps and leave as they would be read back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.cli.columns import as_csv, components, read_rows
from fuzzykf.datasets import read_table
from fuzzykf.errors import FileFormatError, ParameterError


@pytest.fixture
def write(tmp_path):
    def write(*lines):
        path = tmp_path / "data.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return write


def test_empty_cells_are_gaps_and_the_time_is_kept_as_it_is_written(write) -> None:
    rows = read_rows(
        write("Time,a,b", "2014-01-01T00:00+10:00,1,2", "2014-01-01T01:00+10:00,,NA"),
        {"--obs": ["b", "a"]},
        None,
    )
    np.testing.assert_array_equal(rows.values["--obs"], [[2.0, 1.0], [np.nan, np.nan]])
    assert (rows.index_name, list(rows.index)) == (
        "Time",
        ["2014-01-01T00:00+10:00", "2014-01-01T01:00+10:00"],
    )
    assert rows.notes == []


def test_without_a_time_the_rows_are_numbered_and_another_column_can_be_kept(write) -> None:
    path = write("a,who", "1,x", "2,y")
    rows = read_rows(path, {"--obs": ["a"]}, None)
    assert (rows.index_name, list(rows.index), len(rows)) == ("row", [0, 1], 2)
    assert list(read_rows(path, {"--obs": ["a"]}, "who").index) == ["x", "y"]


def test_unequal_steps_are_noted(write) -> None:
    lines = ["time,a", "2014-01-01T00:00,1", "2014-01-01T01:00,2", "2014-01-01T04:00,3"]
    (note,) = read_rows(write(*lines), {"--obs": ["a"]}, None).notes
    assert "2 rows are missing (column time, steps of 1:00:00): 2 after 2014-01-01T01:00;" in note
    lines[1] = "2014-01-01T00:13,1"
    (note,) = read_rows(write(*lines), {"--obs": ["a"]}, None).notes
    assert "vary from 0:47:00 to 3:00:00 (column time)" in note
    # What is no time of ISO 8601 may be kept all the same.
    rows = read_rows(write("who,a", "monday,1", "monday,2"), {"--obs": ["a"]}, "who")
    assert (list(rows.index), rows.notes) == (["monday", "monday"], [])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"--state": ["a"], "--obs": []}, "--obs: name a column of data.csv; its columns are time, a, b"),
        ({"--state": ["a"], "--obs": ["a"]}, "--obs: the column 'a' is named a second time, after --state"),
        ({"--obs": ["b", "b"]}, "--obs: the column 'b' is named a second time"),
        ({"--obs": ["c"]}, "data.csv has no column 'c'"),
    ],
)
def test_columns_that_are_not_there_or_not_clear_are_refused(write, columns, message) -> None:
    with pytest.raises(ParameterError, match=message):
        read_rows(write("time,a,b", "2014,1,2"), columns, None)


@pytest.mark.parametrize("cell", ["high", "inf", "1e999"])
def test_what_is_neither_a_number_nor_a_gap_is_refused_with_its_line(write, cell) -> None:
    with pytest.raises(FileFormatError, match="line 3: a is"):
        read_rows(write("a", "1", cell), {"--obs": ["a"]}, None)


def test_several_components_are_numbered() -> None:
    assert list(components("x", np.zeros((3, 1)), "_std")) == ["x_std"]
    assert list(components("x", np.zeros((3, 2)), "_std")) == ["x0_std", "x1_std"]


@settings(max_examples=50, deadline=None)
@given(values=st.lists(st.floats(allow_infinity=False), min_size=1, max_size=20))
def test_what_is_written_is_read_back_bit_for_bit(values, tmp_path_factory) -> None:
    path = tmp_path_factory.mktemp("csv") / "data.csv"
    path.write_text(as_csv('odd, "name"', range(len(values)), {"v": np.array(values)}), encoding="utf-8")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("v", gaps=True), values)
    assert list(table.columns) == ['odd, "name"', "v"]

"""Files as they come: for each row a row, whatever separates cells, and nothing guessed in silence."""

from __future__ import annotations

import gzip
import io

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.datasets import read_table
from fuzzykf.errors import FileFormatError, ParameterError

NAN = np.nan


@pytest.fixture
def read(tmp_path):
    def read(text, name="a.csv", **options):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_table(path, **options)

    return read


# ------------------------------------------------------------------ what separates cells and decimals

SEMICOLONS = "cells are separated by ';'"
BOTH = "cells are separated by ';', decimals by ','"
EXCEL = "line 1 says that cells are separated by ';'"
COMMENT = "line 1 begins with '#': it is left out as a comment"

#: Texts with the columns a = 1.5, 2 and b = -30, 4 in many dresses; options; and what is said of them.
DRESSES = {
    "commas": ("a,b\n1.5,-30\n2,4\n", {}, ()),
    "no end of the last line": ("a,b\n1.5,-30\n2,4", {}, ()),
    "windows": (b"\xef\xbb\xbfa,b\r\n1.5,-30\r\n2,4\r\n", {}, ()),
    "old mac": ("a,b\r1.5,-30\r2,4\r", {}, ()),
    "blank end": ("a,b\n1.5,-30\n2,4\n\n \n\n", {}, ()),
    "quotes": ('"a","b"\n"1.5","-30"\n" 2 ","4."\n', {}, ()),
    "semicolons": ("a;b\n1.5;-30\n2;4\n", {}, (SEMICOLONS,)),
    "semicolons, decimal commas": ("a;b\n1,5;-30,\n+2;4,0e0\n", {}, (BOTH,)),
    "semicolons, said": ("a;b\n1.5;-30\n2;4\n", {"sep": ";"}, ()),
    "decimal commas, said": ("a;b\n1,5;-30\n2;4\n", {"sep": ";", "decimal": ","}, ()),
    "decimal commas, half said": ("a;b\n1,5;-30\n2;4\n", {"sep": ";"}, ("decimals are separated by ','",)),
    "tabs": ("a\tb\n1.5\t-30\n2\t4\n", {}, ("cells are separated by tabs",)),
    "tabs, decimal commas": ("a\tb\n1,5\t-30\n2\t4\n", {}, ("cells are separated by tabs, decimals by ','",)),
    "bars": ("a|b\n1.5|-30\n2|4\n", {}, ("cells are separated by '|'",)),
    "blanks, said": ("a b\n1.5 -30\n2 4\n", {"sep": " "}, ()),
    "commas for both, said": ('a,b\n"1,5",-30\n2,"4,0"\n', {"decimal": ","}, ()),
    "commas in quoted names": ('"a";"b"\n1,5;-30\n2;4\n', {}, (BOTH,)),
    "an index without a name": (",a,b\n0,1.5,-30\n1,2,4\n", {}, ()),
    "an index and semicolons": (";a;b\n0;1,5;-30\n1;2,0;4\n", {}, (BOTH,)),
    # Columns without a name that nobody asks for.
    "two without names": (",,a,b\n0,x,1.5,-30\n1,y,2,4\n", {}, ("column 2 has no name: it is left out",)),
    "commas at the ends": (
        "a,b,,\n1.5,-30,,\n2,4,,\n",
        {},
        ("columns 3, 4 have no name: they are left out",),
    ),
    "without a name within": (
        "a;;b\n1.5;;-30\n2;;4\n",
        {},
        (SEMICOLONS, "column 2 has no name: it is left out"),
    ),
    # A name with a line break, which is no end of the line of names.
    "line breaks in names": ('"a\n";"\nb"\n1.5;-30\n2;4\n', {}, (SEMICOLONS,)),
    # What stands before the names.
    "excel": ("sep=;\r\na;b\r\n1,5;-30\r\n2;4\r\n", {}, (EXCEL, "decimals are separated by ','")),
    "excel, commas": ('"sep=,"\na,b\n1.5,-30\n2,4\n', {}, ("line 1 says that cells are separated by ','",)),
    "excel, said": ("sep=;\na;b\n1.5;-30\n2;4\n", {"sep": ";"}, (EXCEL,)),
    "excel, said otherwise": (
        "sep=;\na|b\n1.5|-30\n2|4\n",
        {"sep": "|"},
        (f"{EXCEL}, and they are read by '|' as told",),
    ),
    "a comment": ("# made in May, by us\na,b\n1.5,-30\n2,4\n", {}, (COMMENT,)),
    "a comment of as many cells": ("# May, June\na,b\n1.5,-30\n2,4\n", {}, (COMMENT,)),
    "comments": (
        '#\n# 5" pipe; no. 3\n#x\na;b\n1.5;-30\n2;4\n',
        {},
        ("lines 1 to 3 begin with '#': they are left out as comments", SEMICOLONS),
    ),
    "excel and a comment": (
        "sep=|\n# May\na|b\n1.5|-30\n2|4\n",
        {},
        (
            "line 1 says that cells are separated by '|'",
            "line 2 begins with '#': it is left out as a comment",
        ),
    ),
}


@pytest.mark.parametrize("dress", DRESSES)
@pytest.mark.parametrize("packed", [False, True])
def test_one_table_is_read_in_all_its_dresses(read, dress, packed) -> None:
    text, options, notes = DRESSES[dress]
    content = text if isinstance(text, bytes) else text.encode()
    table = read(gzip.compress(content) if packed else content, "a.csv.gz" if packed else "a.csv", **options)
    np.testing.assert_array_equal(table.numbers("a"), [1.5, 2.0])
    np.testing.assert_array_equal(table.numbers("b"), [-30.0, 4.0])
    assert table.notes == notes
    assert table.has_index == ("index" in table.columns) == (text[:1] in (",", ";"))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sep": ";"},
        {"sep": ";", "decimal": ","},
        {"sep": "\t", "decimal": ","},
        {"lineterminator": "\r\n"},
    ],
)
@pytest.mark.parametrize("index", ["times", "numbers", "none"])
def test_what_pandas_writes_is_read_back(read, options, index) -> None:
    frame = pd.DataFrame({"load": [1.25, NAN, -3.5e-9], "name": ["a", "b", "c"]})
    if index == "times":
        frame.index = pd.date_range("2014-03-29", periods=3, freq="h")
    table = read(frame.to_csv(index=index != "none", **options))
    np.testing.assert_array_equal(table.numbers("load", gaps=True), frame["load"])
    assert table.text("name") == ("a", "b", "c")
    assert table.has_index == (index != "none")
    if index == "times":
        np.testing.assert_array_equal(table.times("index"), frame.index)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (
            "t;a,b\n1;2,3\n",
            {},
            r"a\.csv: ',' and ';' cut all rows .*say which: sep=\.\.\. and decimal=\.\.\. \(--sep",
        ),
        ("a;b\n1,5;2.5\n", {}, r"decimals after a comma and such with decimals after a point; say which"),
        ("a\tb\n1,500\t2,250\n", {}, r"commas that separate thousands or decimals; say which"),
        ("y\n1,5\n2,5\n", {}, r"line 1 has one name, and there are commas below it.*; say which"),
        ("a;b\n1;2\n3\n", {}, r"line 3: expected 2 cells, got 1 \(cells are separated by ';'\)"),
        ("a,b;c\n1,2\n3,4\n5\n", {}, "line 4: expected 2 cells, got 1$"),
        ("a,b,a\n1,2,3\n", {}, "column 3 has the name 'a' a second time"),
        (",,\n1,2,3\n", {}, "expected the names of the columns in line 1, got nothing"),
        ("# May\n\n", {}, "expected the names of the columns in line 3, got nothing"),
        ("# May\n\na,b\n1,2\n3\n", {}, "line 5: expected 2 cells, got 1"),
        ("# May\na,b\n1,2\n3\n", {}, "line 4: expected 2 cells, got 1"),
        ('sep=;\n"y\n(MW)"\n1,5\nx;y\n', {}, "line 5: expected 1 cells, got 2"),
        ("# May\ny\n1,5\n", {}, "line 2 has one name, and there are commas below it"),
        # Thousands.
        (
            "a;b\n1.234;x\n5.678;1.234,5\n",
            {},
            r"line 3: there is the number '1\.234,5' with points and commas",
        ),
        (
            "a;b\n1,234;x\n5,678;-1,234.5\n",
            {},
            r"line 3: there is the number '-1,234\.5' with points and comm",
        ),
        (
            "# May\na\tb\n1.234\t1.234.567\n",
            {},
            r"line 3: there is the number '1\.234\.567' with points, some",
        ),
        ("a;b\n1,234;1,234,567\n", {}, "line 2: there is the number '1,234,567' with commas, some of which"),
        (b"a\x00b", {}, "expected rows below the names"),
    ],
)
def test_what_can_be_read_in_two_ways_or_in_none_is_refused(read, text, options, message) -> None:
    with pytest.raises(FileFormatError, match=message):
        read(text, **options)


def test_a_first_column_without_a_name_beside_one_called_index_is_left_out(read) -> None:
    frame = pd.DataFrame({"a": [1.5, 2.0]}, index=pd.Index([7, 8], name="index"))
    table = read(frame.reset_index().to_csv())
    assert list(table.columns) == ["index", "a"]
    assert table.text("index") == ("7", "8")
    assert not table.has_index
    assert table.notes == ("column 1 has no name: it is left out",)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("#a,b\n1,2\n", "#a"),
        ("#a;b\n1,5;\n", "#a"),
        ("# t\n2014-01-01\n", "# t"),
        ("# May\n#a|b\nNA|-1\n", "#a"),
        ("# y\n\n1\n2\n", "# y"),
        ("sep=a\n1\n", "sep=a"),
    ],
)
def test_names_are_taken_for_names_whatever_they_begin_with(read, text, name) -> None:
    assert next(iter(read(text).columns)) == name


THOUSANDS = (
    "all numbers with a point have three digits after it, as thousands have: the point is taken for that of "
    "decimals, in {} as well; write {} if thousands are meant"
)


@pytest.mark.parametrize(
    ("text", "options", "values", "note"),
    [
        ("a;b\n1.234;x\n5.678;y\n", {}, [1.234, 5.678], THOUSANDS.format("1.234", "1234")),
        ("a\tb\n-12.345\t1.000\n", {}, [-12.345], THOUSANDS.format("-12.345", "-12345")),
        # Said, or shown by one number, or separated by commas, as they are where points are decimal.
        ("a;b\n1.234;x\n5.678;y\n", {"decimal": "."}, [1.234, 5.678], ""),
        ("a;b\n1.234;0.123\n5.678;y\n", {}, [1.234, 5.678], ""),
        ("a;b\n1.234;1234.567\n", {}, [1.234], ""),
        ("a;b\n1.5;1.234.567\n", {}, [1.5], ""),
        ("a;b\n15;555.123.456\n", {}, [15.0], ""),
        ("a,b\n1.234,5.678\n", {}, [1.234], ""),
        ("a;b\n0.5;1.234,5\n", {"decimal": "."}, [0.5], ""),
    ],
)
def test_points_that_may_separate_thousands_are_decimal_points_with_a_note(
    read, text, options, values, note
) -> None:
    table = read(text, **options)
    np.testing.assert_array_equal(table.numbers("a"), values)
    assert [n for n in table.notes if "separated" not in n] == [note] * bool(note)


def test_a_single_column_has_nothing_to_separate_or_to_note(read) -> None:
    for text in ("y\n1,5\n2,5\n", '"y\n(MW, net)"\n1,5\n2,5\n', '"a\ny, z\n"\n1,5\n2,5\n'):
        table = read(text, decimal=",")
        (name,) = table.columns
        np.testing.assert_array_equal(table.numbers(name), [1.5, 2.5])
        assert table.notes == ()
    assert list(read('"a\nb, c\nd"\n1\n').columns) == ["a\nb, c\nd"]


@pytest.mark.parametrize(
    "cell", ["", "NA", "n/a", "<NA>", "<na>", "NaN", "null", "None", "#N/A", "#n/a", "#N/A N/A"]
)
def test_words_for_missing_are_missing(read, cell) -> None:
    for head in ("a,b", "# a,b"):  # a line of names that begins like a comment
        table = read(f"{head}\n{cell},1\n2,3\n")
        a, _ = table.columns
        np.testing.assert_array_equal(table.numbers(a, gaps=True), [NAN, 2.0])
        with pytest.raises(FileFormatError, match=r"line 2: (# )?a is missing"):
            table.numbers(a)
    table = read(f"a,b\n2014-01-01,1\n{cell},3\n")
    times = table.read_times("a", gaps=True).clock
    np.testing.assert_array_equal(times, np.array(["2014-01-01", "NaT"], dtype="datetime64[s]"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sep": ""}, "sep: got '', expected one character"),
        ({"sep": ";;"}, "sep: got ';;'"),
        ({"sep": "1"}, "sep: got '1'"),
        ({"sep": "."}, r"sep: got '\.'"),
        ({"sep": "\n"}, "sep: got"),
        ({"sep": 5}, "sep: got 5"),
        ({"decimal": ";"}, "decimal: got ';', expected '.' or ','"),
        ({"decimal": 1}, "decimal: got 1"),
    ],
)
def test_what_separates_nothing_is_refused(read, options, message) -> None:
    with pytest.raises(ParameterError, match=message):
        read("a,b\n1,2\n", **options)


def test_what_is_said_decides_where_two_ways_are_open(read) -> None:
    assert read("t;a,b\n1;2,3\n", sep=";").text("a,b") == ("2,3",)
    assert read("t;a,b\n1;2,3\n", sep=",").text("t;a") == ("1;2",)
    np.testing.assert_array_equal(read("a\tb\n1,500\t2,250\n", decimal=",").numbers("a"), [1.5])
    np.testing.assert_array_equal(read("a;b\n1,5;2.5\n", decimal=".").numbers("b"), [2.5])
    with pytest.raises(FileFormatError, match=r"line 2: b is '2\.5', expected decimals after ','"):
        read("a;b\n1,5;2.5\n", decimal=",").numbers("b")
    np.testing.assert_array_equal(read("y\n1,5\n2,5\n", decimal=",").numbers("y"), [1.5, 2.5])


# ------------------------------------------------------------------ for each row a row


@pytest.mark.parametrize(
    ("text", "rows", "notes"),
    [
        ("a,b\n1,2\n,\n3,4\n,\n,\n", [1, NAN, 3, NAN, NAN], 0),
        ("a,b\n1,2\n , \n", [1, NAN], 0),
        ('a\n1\n""\n3\n""\n', [1, NAN, 3, NAN], 0),
        ("a;b\n1;2\n;\n", [1, NAN], 1),
        # A blank line is a row between rows, and none at the end.
        ("a,b\n1,2\n\n3,4\n\n\n", [1, NAN, 3], 1),
        ("a\n1\n\n3\n\n", [1, NAN, 3], 1),
        ("a,b\n\n3,4\n,\n\n", [NAN, 3, NAN], 1),
        ("a,b\r\n1,2\r\n\r\n \r\n3,4\r\n", [1, NAN, NAN, 3], 1),
    ],
)
def test_for_each_row_there_is_a_row(read, text, rows, notes) -> None:
    table = read(text)
    np.testing.assert_array_equal(table.numbers("a", gaps=True), rows)
    assert len(table) == len(rows)
    assert len(table.notes) == notes


def test_blank_lines_are_noted_by_their_numbers(read) -> None:
    assert read("a,b\n1,2\n\n3,4\n").notes == (
        "line 3 is blank: it is taken for a row in which everything is missing",
    )
    (note,) = read("a,b\n" + "\n\n1,2\n" * 5).notes
    assert note.startswith("lines 2, 3, 5, 6, 8 and 5 more are blank")


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_errors_name_the_line_of_the_file(read, end) -> None:
    lines = ["a,b", '1,"x', 'y"', "", '2,"x', "", 'y"', "oh,z"]
    table = read(end.join(lines))
    with pytest.raises(FileFormatError, match=r"a\.csv, line 8: a is 'oh'"):
        table.numbers("a", gaps=True)
    with pytest.raises(FileFormatError, match=r"a\.csv, line 4: a is missing"):
        table.numbers("a")
    with pytest.raises(FileFormatError, match=r"a\.csv, line 9: expected 2 cells, got 1"):
        read(end.join([*lines, "3"]))
    with pytest.raises(FileFormatError, match=r"a\.csv, line 2: b is 'x\\n"):
        read(end.join(lines).replace("\r\n", "\n")).numbers("b")


@settings(max_examples=30, deadline=None)
@given(
    values=st.lists(
        st.one_of(st.none(), st.floats(allow_nan=False, allow_infinity=False)), min_size=1, max_size=8
    ),
    sep=st.sampled_from(";\t|"),
    decimal=st.sampled_from(".,"),
)
def test_numbers_are_read_back_bit_for_bit_if_it_is_said_how(values, sep, decimal, tmp_path_factory) -> None:
    text = io.StringIO()
    frame = pd.DataFrame({"a": np.array(values, dtype=float), "b": 1.0})
    frame.to_csv(text, sep=sep, decimal=decimal, index=False)
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    path.write_text(text.getvalue(), encoding="utf-8")
    table = read_table(path, sep=sep, decimal=decimal)
    np.testing.assert_array_equal(table.numbers("a", gaps=True), frame["a"])

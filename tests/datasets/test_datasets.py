"""The packaged series is what it claims to be, and a damaged table is refused with the reason."""

from __future__ import annotations

import gzip
import os
import re
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fuzzykf.datasets import load_building, load_traffic, load_victoria, load_weather, read_table
from fuzzykf.errors import FileFormatError, ParameterError

if TYPE_CHECKING:
    from pathlib import Path


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


# ------------------------------------------------------------------ the packaged series


def test_victoria_covers_2014_every_half_hour_in_plausible_units() -> None:
    data = load_victoria()
    assert data.time.shape == data.demand.shape == data.temperature.shape == data.workday.shape == (17520,)
    assert data.time[0] == np.datetime64("2014-01-01T00:00")
    assert set(np.diff(data.time)) == {np.timedelta64(1800, "s")}
    # Gigawatts and degrees Celsius: the record of that January was above 9 GW and 43 degrees.
    assert 2.0 < data.demand.min() < 3.5
    assert 9.0 < data.demand.max() < 10.5
    assert 0.0 < data.temperature.min() < 5.0
    assert 43.0 <= data.temperature.max() < 46.0


def test_victoria_workdays_exclude_weekends_and_a_known_holiday() -> None:
    data = load_victoria()
    day = data.time.astype("datetime64[D]")
    assert not data.workday[~np.is_busday(day)].any()
    assert not data.workday[day == np.datetime64("2014-12-25")].any()
    assert data.workday[day == np.datetime64("2014-08-13")].all()


def test_hourly_values_are_the_means_of_two_half_hours() -> None:
    half, full = load_victoria(), load_victoria(hourly=True)
    assert full.time.shape == full.workday.shape == (8760,)
    assert full.demand[5] == pytest.approx((half.demand[10] + half.demand[11]) / 2)
    assert full.temperature[-1] == pytest.approx((half.temperature[-2] + half.temperature[-1]) / 2)
    assert full.time[5] == half.time[10]


def test_weather_is_a_year_of_hours_with_gaps_in_plausible_units() -> None:
    data = load_weather()
    assert set(np.diff(data.time)) == {np.timedelta64(3600, "s")}
    assert (str(data.time[0]), str(data.time[-1])) == ("2013-01-01T06:00:00", "2013-12-30T23:00:00")
    series = (data.temperature, data.dew_point, data.humidity, data.wind_speed, data.pressure)
    assert [int(np.isnan(one).sum()) for one in series] == [24, 24, 24, 27, 855]
    assert np.isnan(series)[:, 11].all()  # nothing was reported in that hour
    # New York: frost in winter, some days above 35 degrees; the pressure is that at sea level
    assert -15.0 < np.nanmin(data.temperature) < -8.0
    assert 35.0 < np.nanmax(data.temperature) < 40.0
    assert 970.0 < np.nanmin(data.pressure) < np.nanmax(data.pressure) < 1050.0


def test_weather_has_a_humidity_that_follows_from_temperature_and_dew_point() -> None:
    data = load_weather()

    def vapour(t):  # Magnus' formula
        return np.exp(17.625 * t / (243.04 + t))

    off = 100.0 * vapour(data.dew_point) / vapour(data.temperature) - data.humidity
    assert np.nanmedian(np.abs(off)) < 0.05
    assert np.nanquantile(np.abs(off), 0.9) < 0.1
    assert np.nanargmax(
        np.bincount((data.time.astype(int) // 3600) % 24, np.nan_to_num(data.temperature))
    ) in (
        range(17, 21)  # the afternoon of New York in UTC
    )


# ------------------------------------------------------------------ series outside the package


@pytest.mark.parametrize("load", [load_building, load_traffic, partial(load_weather, "EWR")])
def test_series_outside_the_package_say_where_they_are_looked_for(load, monkeypatch, tmp_path) -> None:
    monkeypatch.delenv("FUZZYKF_DATA", raising=False)
    with pytest.raises(FileNotFoundError, match="set the environment variable FUZZYKF_DATA"):
        load()
    monkeypatch.setenv("FUZZYKF_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"there is no .*csv(.gz)? in it"):
        load()


def test_a_station_that_there_is_not_and_a_folder_without_need_are_refused() -> None:
    with pytest.raises(ParameterError, match="station: got 'LGA', expected 'JFK' or 'EWR'"):
        load_weather("LGA")
    with pytest.raises(ParameterError, match="folder: got 'here', but the data of JFK are in the package"):
        load_weather(folder="here")


needs_data = pytest.mark.skipif(
    "FUZZYKF_DATA" not in os.environ, reason="FUZZYKF_DATA does not name the folder of the external series"
)


@needs_data
def test_weather_of_another_station_is_of_the_same_hours() -> None:
    here, there = load_weather("JFK"), load_weather("EWR")
    assert set(np.diff(there.time)) <= {np.timedelta64(k * 3600, "s") for k in (1, 2)}
    shared, a, b = np.intersect1d(here.time, there.time, return_indices=True)
    both = np.isfinite(here.dew_point[a]) & np.isfinite(there.dew_point[b])
    # The airports are 33 km apart.
    assert np.corrcoef(here.dew_point[a][both], there.dew_point[b][both])[0, 1] > 0.95
    assert len(shared) > 8000


@needs_data
def test_building_is_one_week_of_quarter_hours() -> None:
    data = load_building()
    assert data.time.shape == data.temperature.shape == data.power.shape == (672,)
    assert set(np.diff(data.time)) == {np.timedelta64(900, "s")}


@needs_data
def test_traffic_has_increasing_times_and_percentages() -> None:
    data = load_traffic()
    assert (np.diff(data.time) > np.timedelta64(0, "s")).all()
    assert data.occupancy.min() >= 0.0
    assert data.occupancy.max() <= 100.0


# ------------------------------------------------------------------ tables


def test_a_table_is_read_plain_compressed_and_with_a_byte_order_mark(tmp_path) -> None:
    text = 'time, load ,"a, b"\n2014-01-01 00:00,1.5,-2e3\n2014-01-01 01:00, 2 ,3\n\n'
    (tmp_path / "bom.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    (tmp_path / "packed.csv.gz").write_bytes(gzip.compress(text.encode()))
    for path in (write(tmp_path / "plain.csv", text), tmp_path / "bom.csv", tmp_path / "packed.csv.gz"):
        table = read_table(path)
        assert list(table.columns) == ["time", "load", "a, b"]
        assert len(table) == 2
        np.testing.assert_array_equal(table.numbers("load"), [1.5, 2.0])
        np.testing.assert_array_equal(table.numbers("a, b"), [-2000.0, 3.0])
        assert table.times("time")[1] == np.datetime64("2014-01-01T01:00")


def test_the_offset_orders_the_rows_and_the_local_clock_stays(tmp_path) -> None:
    # The hour in which summer time ends appears twice on the clock, but is later in fact.
    text = "t\n2014-04-06T02:30+11:00\n2014-04-06T02:00+10:00\n"
    times = read_table(write(tmp_path / "a.csv", text)).times("t")
    assert list(times) == [np.datetime64("2014-04-06T02:30"), np.datetime64("2014-04-06T02:00")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "names of the columns in line 1"),
        ("a,b\n", "rows below the names"),
        ("a,a\n1,2\n", "column 2 has the name 'a' a second time"),
        ("a,b\n1,2\n1\n", "line 3: expected 2 cells, got 1"),
        ('a,b\n1,"2\n', "line 2: expected delimited text, got something else"),
    ],
)
def test_what_is_no_table_is_refused_with_the_reason(text, message, tmp_path) -> None:
    with pytest.raises(FileFormatError, match=message):
        read_table(write(tmp_path / "a.csv", text))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a,b\n\xff\xfe,1\n", "a.csv, line 2: .* got the byte 0xff"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "a.csv, line 1: .* got the byte 0x89"),
        ("t,Wärme\n1,2\n".encode("latin1"), "line 1: .* byte 0xe4, .* as latin1, convert it"),
        ("t,u\n1,°\n".encode("latin1"), "line 2: .* byte 0xb0, .*save it in Excel as 'CSV UTF-8'"),
        ("t,u\n1,2\n".encode("utf-16"), "a.csv: expected .* in UTF-8, got UTF-16; convert it"),
        ("t,u\n1,2\n".encode("utf-16le"), "got UTF-16LE; convert it"),
        ("t,u\n1,2\n".encode("utf-16be"), "got UTF-16BE; convert it"),
    ],
)
def test_what_is_no_text_in_utf_8_is_refused_and_how_it_is_converted(content, message, tmp_path) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_table(tmp_path / "a.csv")
    encoding = re.search(r"iconv -f (\S+) -t utf-8", str(caught.value))
    assert encoding is not None
    if b"," in content and b"\xff\xfe," not in content:  # what was text becomes a table
        (tmp_path / "a.csv").write_bytes(content.decode(encoding[1]).encode("utf-8"))
        assert len(read_table(tmp_path / "a.csv")) == 1


PACKED = gzip.compress(b"a,b\n1,2\n" * 99, mtime=0)  # the same in every process


@pytest.mark.parametrize(
    "damage",
    [b"no gzip at all", PACKED[:-12], PACKED[:12] + b"\xff" * 8 + PACKED[20:]],
    ids=["no gzip", "cut", "overwritten"],
)
def test_a_damaged_compressed_file_is_refused(damage, tmp_path) -> None:
    (tmp_path / "a.csv.gz").write_bytes(damage)
    with pytest.raises(FileFormatError, match="got something else"):
        read_table(tmp_path / "a.csv.gz")


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("high", "line 3: a is 'high', expected a number"),
        ("", "line 3: a is missing"),
        ("NaN", "line 3: a is missing"),
        ("inf", "line 3: a is 'inf', expected a finite number"),
        ("1,5", r"line 3: a is '1,5', expected decimals after '\.'; say decimal=','"),
        ("1_5", "line 3: a is '1_5', expected a number"),
        ("١٢", "line 3: a is '١٢', expected a number"),
        ("１２", "line 3: a is '１２', expected a number"),
        ("-Infinity", "line 3: a is '-Infinity', expected a finite number"),
        ("1e999", "line 3: a is '1e999', expected a finite number"),
        ("0x10", "line 3: a is '0x10', expected a number"),
        ("1 000", "line 3: a is '1 000', expected a number"),
    ],
)
def test_a_cell_that_is_no_number_is_named_with_its_line(cell, message, tmp_path) -> None:
    table = read_table(write(tmp_path / "a.csv", f'a,b\n1,2\n"{cell}",2\n'))
    with pytest.raises(FileFormatError, match=message):
        table.numbers("a")
    np.testing.assert_array_equal(table.numbers("b"), [2.0, 2.0])


def test_a_column_that_is_not_there_is_answered_with_those_that_are(tmp_path) -> None:
    table = read_table(write(tmp_path / "a.csv", "a,b\n1,2\n"))
    with pytest.raises(ParameterError, match=r"no column 'c'; its columns are a, b"):
        table.numbers("c")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["31/01/2014 16:30"], "line 2: t is '31/01/2014 16:30', expected a time as in"),
        (["2014-01-01", "2014-01-01"], "line 3: t is '2014-01-01', not later than"),
        (["2014-01-01T00:00", "2014-01-02T00:00+10:00"], "expected an offset in every row or in none"),
        (["03/29/2024"], r"line 2: t is '03/29/2024', .*; say format='%d.%m.%Y %H:%M'"),
        (
            ["1396051200"],
            r"line 2: t is '1396051200', .* or 'unix' \(for milliseconds 'unix_ms'\) since 1970",
        ),
        (["2014-01-01", "", "2014-01-03"], "line 3: t is not a time"),
        (["2014-10-26 01:30", "2014-10-26 01:00"], "line 3: t is .*if clocks were put back there"),
    ],
)
def test_times_that_are_unreadable_or_do_not_increase_are_named(rows, message, tmp_path) -> None:
    table = read_table(write(tmp_path / "a.csv", "\n".join(["t", *rows])))
    with pytest.raises(FileFormatError, match=message):
        table.times("t")


def test_times_that_are_written_in_another_way_need_a_format(tmp_path) -> None:
    table = read_table(write(tmp_path / "a.csv", "t,u\n03/29/2024,1711670400\n03/30/2024,1711756800\n"))
    days = np.array(["2024-03-29", "2024-03-30"], dtype="datetime64[s]")
    np.testing.assert_array_equal(table.times("t", format="%m/%d/%Y"), days)
    np.testing.assert_array_equal(table.times("u", format="unix"), days)
    with pytest.raises(FileFormatError, match="line 2: t is '03/29/2024', expected a time in the format '%d"):
        table.times("t", format="%d/%m/%Y")
    with pytest.raises(ParameterError, match=r"a\.csv, column t: got the format 'us'"):
        table.times("t", format="us")


def test_tables_are_read_up_to_a_limit(tmp_path):
    path = write(tmp_path / "a.csv", "a\n" + "1\n" * 1000)
    assert len(read_table(path, max_bytes=3000)) == 1000
    with pytest.raises(FileFormatError, match=r"a\.csv: holds more than 2,000 bytes"):
        read_table(path, max_bytes=2000)
    packed = tmp_path / "a.csv.gz"
    packed.write_bytes(gzip.compress(b"a\n" + b"1\n" * (1 << 20), 9))
    with pytest.raises(FileFormatError, match="holds more than"):
        read_table(packed, max_bytes=1 << 20)

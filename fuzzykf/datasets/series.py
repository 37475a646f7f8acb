"""Loaders of the series, each a small record of arrays with units."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fuzzykf.datasets.table import Table, read_table
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray

__all__ = [
    "Building",
    "Traffic",
    "Victoria",
    "Weather",
    "load_building",
    "load_traffic",
    "load_victoria",
    "load_weather",
]

#: The environment variable that names the folder of files outside the package.
DATA_VARIABLE = "FUZZYKF_DATA"


@reprs()
@dataclass(frozen=True, eq=False)
class Victoria:
    """Electricity demand and temperature in Victoria, Australia, in 2014.

    Attributes
    ----------
    time : ndarray of datetime64[s], shape (n,)
        Start of each interval, in Australian Eastern Standard Time (UTC+10) all
        year; local time in summer is one hour later.
    demand : ndarray, shape (n,)
        Mean demand during the interval, in gigawatts.
    temperature : ndarray, shape (n,)
        Temperature in Melbourne, in degrees Celsius.
    workday : ndarray of bool, shape (n,)
        False on Saturdays, Sundays and public holidays.

    See Also
    --------
    load_victoria : Load the data; with an example.
    """

    time: NDArray[np.datetime64]
    demand: FloatArray
    temperature: FloatArray
    workday: NDArray[np.bool_]


@reprs()
@dataclass(frozen=True, eq=False)
class Building:
    """Outdoor temperature and power of one commercial building, first week of June 2010.

    Attributes
    ----------
    time : ndarray of datetime64[s], shape (n,)
        Every 15 minutes.
    temperature : ndarray, shape (n,)
        Outdoor air temperature, in degrees Fahrenheit.
    power : ndarray, shape (n,)
        Power drawn by the building, in kilowatts.

    See Also
    --------
    load_building : Load the data.
    """

    time: NDArray[np.datetime64]
    temperature: FloatArray
    power: FloatArray


@reprs()
@dataclass(frozen=True, eq=False)
class Traffic:
    """Speed and occupancy at one road sensor, two weeks of September 2015.

    Attributes
    ----------
    time : ndarray of datetime64[s], shape (n,)
        Irregular, about every 5 to 25 minutes.
    speed : ndarray, shape (n,)
        Mean speed of the vehicles, in miles per hour.
    occupancy : ndarray, shape (n,)
        Share of time in which a vehicle was over the sensor, in per cent.

    See Also
    --------
    load_traffic : Load the data.
    """

    time: NDArray[np.datetime64]
    speed: FloatArray
    occupancy: FloatArray


@reprs()
@dataclass(frozen=True, eq=False)
class Weather:
    """Hourly weather at an airport of New York in 2013; NaN where missing.

    Attributes
    ----------
    time : ndarray of datetime64[s], shape (n,)
        Hours in UTC: five hours ahead of local time in winter, four in summer.
    temperature, dew_point : ndarray, shape (n,)
        In degrees Celsius, rounded to about half a degree.
    humidity : ndarray, shape (n,)
        Relative humidity, in per cent.
    wind_speed : ndarray, shape (n,)
        In miles per hour.
    pressure : ndarray, shape (n,)
        At sea level, in hectopascals; missing ten times as often as the rest.

    See Also
    --------
    load_weather : Load the data; with an example.
    """

    time: NDArray[np.datetime64]
    temperature: FloatArray
    dew_point: FloatArray
    humidity: FloatArray
    wind_speed: FloatArray
    pressure: FloatArray


def load_victoria(*, hourly: bool = False) -> Victoria:
    """Load electricity demand and temperature in Victoria, 2014.

    Parameters
    ----------
    hourly : bool
        Return hourly means (8,760 rows) instead of half-hourly values (17,520 rows).

    Returns
    -------
    Victoria

    Notes
    -----
    Sources: Australian Energy Market Operator (demand) and Australian Bureau of
    Meteorology (temperature at Melbourne).

    Examples
    --------
    >>> data = load_victoria(hourly=True)
    >>> data.demand.shape, str(data.time[0])
    ((8760,), '2014-01-01T00:00:00')
    >>> round(float(data.demand.max()), 2), round(float(data.temperature.max()), 1)
    (9.31, 43.1)
    """
    table = read_table(Path(__file__).with_name("victoria_2014.csv.gz"))
    time = table.times("time")
    demand, temperature = table.numbers("demand_gw"), table.numbers("temperature_c")
    workday = table.numbers("workday") == 1.0
    if hourly:
        time, workday = time[::2], workday[::2]
        demand, temperature = (values.reshape(-1, 2).mean(axis=1) for values in (demand, temperature))
    return Victoria(time, demand, temperature, workday)


def load_weather(
    station: Literal["JFK", "EWR"] = "JFK", folder: str | os.PathLike[str] | None = None
) -> Weather:
    """Load a year of hourly weather at an airport, to estimate humidity from other sensors.

    The hours are complete from 1 January, 6:00, to 30 December 2013, 23:00 (8,730 rows).  All values are
    missing in 24 rows, wind speed in 27, pressure in 855.  Humidity follows from temperature and dew point,
    so omit the dew point to estimate it.

    Parameters
    ----------
    station : {"JFK", "EWR"}
        Airport: John F. Kennedy (the numbers above) or Newark.  The file of Newark,
        ``weather_ewr_2013.csv.gz``, is not part of the package.
    folder : path-like, optional
        Directory of the file of Newark; by default the environment variable ``FUZZYKF_DATA``.

    Returns
    -------
    Weather

    Raises
    ------
    ParameterError
        If the station is unknown, or ``folder`` is given for JFK.
    FileNotFoundError
        If the directory of Newark is not given or does not contain the file.

    Notes
    -----
    Source: hourly observations of the US National Weather Service (Automated Surface Observing System), in
    the public domain.

    Examples
    --------
    >>> import numpy as np
    >>> data = load_weather()
    >>> data.humidity.shape, int(np.isnan(data.humidity).sum())
    ((8730,), 24)
    >>> str(data.time[0]), float(data.temperature[0]), float(data.humidity[0])
    ('2013-01-01T06:00:00', 3.9, 59.37)
    """
    if as_choice("station", station, ("JFK", "EWR")) == "EWR":
        table = _external_table("weather_ewr_2013.csv.gz", folder)
    elif folder is not None:
        raise ParameterError(f"folder: got {os.fspath(folder)!r}, but the data of JFK are in the package")
    else:
        table = read_table(Path(__file__).with_name("weather_jfk_2013.csv.gz"))
    columns = ("temperature_c", "dew_point_c", "humidity_percent", "wind_speed_mph", "pressure_hpa")
    return Weather(table.times("time"), *(table.numbers(name, gaps=True) for name in columns))


def load_building(folder: str | os.PathLike[str] | None = None) -> Building:
    """Load a week of temperature and power of a commercial building.

    The file ``openei_building1_june2010.csv`` is not part of the package.

    Parameters
    ----------
    folder : path-like, optional
        Directory of the file; by default the environment variable ``FUZZYKF_DATA``.

    Returns
    -------
    Building

    Raises
    ------
    FileNotFoundError
        If the directory is not given or does not contain the file.

    Notes
    -----
    Source: US Department of Energy, OpenEI, "Consumption & Outdoor Air Temperature
    for 11 Commercial Buildings".
    """
    table = _external_table("openei_building1_june2010.csv", folder)
    return Building(table.times("Timestamp"), table.numbers("OAT (F)"), table.numbers("Power (kW)"))


def load_traffic(folder: str | os.PathLike[str] | None = None) -> Traffic:
    """Load two weeks of speed and occupancy at a road sensor.

    The file ``traffic_t4013.csv`` is not part of the package.

    Parameters
    ----------
    folder : path-like, optional
        Directory of the file; by default the environment variable ``FUZZYKF_DATA``.

    Returns
    -------
    Traffic

    Raises
    ------
    FileNotFoundError
        If the directory is not given or does not contain the file.

    Notes
    -----
    Source: Minnesota Department of Transportation, through the Numenta Anomaly
    Benchmark (MIT licence).
    """
    table = _external_table("traffic_t4013.csv", folder)
    return Traffic(table.times("time"), table.numbers("speed_mph"), table.numbers("occupancy_percent"))


def _external_table(name: str, folder: str | os.PathLike[str] | None) -> Table:
    given = folder if folder is not None else os.environ.get(DATA_VARIABLE)
    if not given:
        raise FileNotFoundError(
            f"{name} is not part of the package: set the environment variable {DATA_VARIABLE} "
            "to the folder that holds it"
        )
    path = Path(given) / name
    if not path.is_file():
        source = DATA_VARIABLE if folder is None else "folder"
        raise FileNotFoundError(f"{source} is {os.fspath(given)!r}, but there is no {name} in it")
    return read_table(path)

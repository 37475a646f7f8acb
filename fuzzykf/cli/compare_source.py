"""What ``fuzzykf compare`` works on: columns of a file, or of a series that comes with the package."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.cli.reading import row_times
from fuzzykf.cli.stuck import notes_of_stuck
from fuzzykf.errors import ParameterError
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.cli.reading import Reading
    from fuzzykf.times import Times

__all__ = ["PACKAGED", "Packaged", "Source", "SourceName", "from_file", "from_package", "naming_columns"]


@dataclass(frozen=True, eq=False)
class Source:
    """The columns to work on, and what to call them."""

    title: str
    state_column: str
    observation_column: str
    state: FloatArray
    observation: FloatArray
    state_label: str
    unit: str
    time: NDArray[np.datetime64] | Times | None
    workday: NDArray[np.bool_] | None
    notes: tuple[str, ...] = ()
    profile: bool = False


@dataclass(frozen=True, eq=False)
class Packaged:
    """A series that comes with the package.

    Attributes
    ----------
    title : str
    state, observation : str
        The columns that are compared unless others are named.
    columns : dict
        By name: values, what to call them, and their unit.
    time : ndarray of datetime64
        Standard time on the spot, all year.
    workday : ndarray of bool, or None
        None: Mondays to Fridays.
    profile : bool
        Whether the daily profile of the state is taken away unless told otherwise.
    """

    title: str
    state: str
    observation: str
    columns: dict[str, tuple[FloatArray, str, str]]
    time: NDArray[np.datetime64]
    workday: NDArray[np.bool_] | None = None
    profile: bool = False


def _victoria() -> Packaged:
    from fuzzykf.datasets import load_victoria

    v = load_victoria(hourly=True)
    return Packaged(
        title="Victoria, 2014, hourly means",
        state="demand_gw",
        observation="temperature_c",
        columns={
            "demand_gw": (v.demand, "demand", "GW"),
            "temperature_c": (v.temperature, "temperature", "°C"),
        },
        time=v.time,
        workday=v.workday,
        profile=True,
    )


#: Standard time in New York, less that of Greenwich.
NEW_YORK = np.timedelta64(-5 * 3600, "s")


def _weather() -> Packaged:
    from fuzzykf.datasets import load_weather

    w = load_weather()
    return Packaged(
        title="New York (JFK), 2013, hourly weather",
        state="humidity_percent",
        observation="temperature_c",
        columns={
            "humidity_percent": (w.humidity, "relative humidity", "%"),
            "temperature_c": (w.temperature, "temperature", "°C"),
            "dew_point_c": (w.dew_point, "dew point", "°C"),
            "wind_speed_mph": (w.wind_speed, "wind speed", "mph"),
            "pressure_hpa": (w.pressure, "pressure", "hPa"),
        },
        time=w.time + NEW_YORK,
    )


#: By the names that ``--data`` knows; the first one is compared where nothing is said.
PACKAGED: dict[str, Callable[[], Packaged]] = {"victoria": _victoria, "weather": _weather}

if TYPE_CHECKING:

    class SourceName(StrEnum):
        """Name of a series that comes with the package."""

        VICTORIA = "victoria"
else:
    SourceName = StrEnum("SourceName", {name.upper(): name for name in PACKAGED})


@contextmanager
def naming_columns(source: Source) -> Iterator[None]:
    """Name the columns in errors of what is compared."""
    try:
        yield
    except ParameterError as error:
        told = str(error)
        for argument, option, column in (
            ("state: ", "--state", source.state_column),
            ("observation: ", "--obs", source.observation_column),
        ):
            if told.startswith(argument):
                raise ParameterError(f"{option} {column}: {told.removeprefix(argument)}") from error
        raise


def from_package(name: str, state: str | None, obs: str | None, reading: Reading) -> Source:
    """Return columns of a series that comes with the package.

    Raises
    ------
    ParameterError
        If it has no such column, or how to read a file is said.
    """
    if reading.time is not None:
        raise ParameterError("--time: the packaged data bring their own times; give a file to name a column")
    for word in reading.words():
        raise ParameterError(
            f"{word}: the packaged data are no file of yours; give one to say how to read it"
        )
    found = PACKAGED[name]()
    state, obs = state or found.state, obs or found.observation
    for option, column in (("--state", state), ("--obs", obs)):
        if column not in found.columns:
            raise ParameterError(
                f"{option}: the packaged data have no column {column!r}; their columns are "
                f"{', '.join(found.columns)}"
            )
    values, label, unit = found.columns[state]
    observation = found.columns[obs][0]
    return Source(
        found.title,
        state,
        obs,
        values,
        observation,
        label,
        unit,
        found.time,
        found.workday,
        profile=found.profile,
    )


def from_file(
    path: Path, state: str | None, obs: str | None, reading: Reading, *, needs_time: bool
) -> Source:
    """Return columns of a file.

    Raises
    ------
    ParameterError
        If a column is not named or not there, or times are needed and there are none.
    """
    table = reading.table(path)
    if state is None or obs is None:
        missing = "--state" if state is None else "--obs"
        raise ParameterError(
            f"{missing}: name a column of {path.name}; its columns are {listed(table.columns)}"
        )
    values, observation = (table.numbers(name, gaps=True) for name in (state, obs))
    found = row_times(table, reading, needed=needs_time)
    workday = table.numbers("workday") == 1.0 if "workday" in table.columns else None
    return Source(
        path.name,
        state,
        obs,
        values,
        observation,
        state,
        "",
        found.times,
        workday,
        (*table.notes, *found.notes, *notes_of_stuck(state, values), *notes_of_stuck(obs, observation)),
    )

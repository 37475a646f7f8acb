"""What a model was learned on: the names of its states and observations, their units, the length of a step.

A table of pandas says by name what stands in its columns; an array can only be taken by position.  Here
is decided how tables are matched with what a model remembers.  Objects of pandas and xarray are known by
what they can do: nothing here imports them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count, brief
from fuzzykf.immutable import Immutable
from fuzzykf.observations import index_of
from fuzzykf.reprs import call_text, shown
from fuzzykf.steps import find_steps, other_step, spoken
from fuzzykf.texts import listed
from fuzzykf.times import Times, has_times, read_times

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "NO_LABELS",
    "Labels",
    "check_many",
    "check_no_state",
    "check_step",
    "columns_of",
    "labels_of",
    "match_columns",
    "match_row",
    "match_series",
    "names_of",
    "ordered",
    "read_labels",
]

#: Units that a step may be given in: of months, and of nanoseconds.
_MONTHS = {"Y": 12, "M": 1}
_NANOSECONDS = {
    "W": 604_800 * 10**9,
    "D": 86_400 * 10**9,
    "h": 3_600 * 10**9,
    "m": 60 * 10**9,
    "s": 10**9,
    "ms": 10**6,
    "us": 10**3,
    "ns": 1,
}

#: Units in which steps are kept, and written to files.
_KEPT = ("M", "s", "ms", "us", "ns")

#: What NumPy can count.
_MOST = 1 << 63

#: Parts of a document.
_PARTS = ("states", "observations", "units", "step")


class Labels(Immutable):
    """Names, units and time step of the data on which a model was learned.

    Parameters
    ----------
    states, observations : sequence of str, optional
        Names of the components; None if unknown.
    units : mapping of str to str, optional
        Units by name; optional for each name.
    step : timedelta64 or timedelta, optional
        Time between rows; may be a number of months.

    Attributes
    ----------
    states, observations : tuple of str, or None
    step : timedelta64 or None
        In months, seconds or the coarsest exact fraction of a second.

    Raises
    ------
    ParameterError
        If a name is empty or repeats among states or observations, a unit belongs to no name, or the step is
        inadmissible.

    Examples
    --------
    >>> labels = Labels(
    ...     ["load"], ["t", "h"], units={"load": "GW"}, step=np.timedelta64(1, "h")
    ... )
    >>> labels.observations, labels.units, labels.step
    (('t', 'h'), {'load': 'GW'}, np.timedelta64(3600,'s'))
    >>> bool(labels), bool(Labels())
    (True, False)
    """

    def __init__(
        self,
        states: Iterable[str] | None = None,
        observations: Iterable[str] | None = None,
        units: Mapping[str, str] | None = None,
        step: np.timedelta64 | timedelta | None = None,
    ) -> None:
        self.states = _as_names("states", states)
        self.observations = _as_names("observations", observations)
        names = dict.fromkeys((*(self.states or ()), *(self.observations or ())))
        given = _as_units(units, names)
        self._units = tuple((name, given[name]) for name in names if name in given)
        self.step = None if step is None else _as_step(step)

    @property
    def units(self) -> dict[str, str]:
        """Units by name."""
        return dict(self._units)

    def units_as(self, other: Labels) -> dict[str, str]:
        """Return the units of the components under the names of other labels.

        Parameters
        ----------
        other : Labels

        Returns
        -------
        dict of str to str
        """
        pairs = ((self.states, other.states), (self.observations, other.observations))
        found = {}
        for here, there in pairs:
            found.update(dict(zip(there or (), here or (), strict=False)))
        return {name: self.units[old] for name, old in found.items() if old in self.units}

    def with_unit(self, name: str) -> str:
        """Return a name with its unit, for a column title.

        Parameters
        ----------
        name : str

        Returns
        -------
        str

        Examples
        --------
        >>> Labels(["load"], units={"load": "GW"}).with_unit("load")
        'load (GW)'
        """
        unit = self.units.get(name)
        return name if unit is None else f"{name} ({unit})"

    def facts(self, dim_x: int, dim_z: int) -> list[tuple[str, str]]:
        """Return numbers and names of components and the step, as pairs of text for tables.

        Parameters
        ----------
        dim_x, dim_z : int
            Numbers of components of state and observation.

        Returns
        -------
        list of (str, str)

        Examples
        --------
        >>> Labels(observations=["t", "h"]).facts(1, 2)
        [('components of the state', '1'), ('components of an observation', '2: t, h')]
        """

        def told(names: Sequence[str] | None, size: int) -> str:
            return str(size) if names is None else f"{size}: {listed([self.with_unit(n) for n in names])}"

        facts = [
            ("components of the state", told(self.states, dim_x)),
            ("components of an observation", told(self.observations, dim_z)),
        ]
        return facts if self.step is None else [*facts, ("rows apart", spoken(self.step))]

    def to_dict(self) -> dict[str, Any]:
        """Return the labels as plain values.

        Returns
        -------
        dict
        """
        step = None
        if self.step is not None:
            step = {"count": int(self.step.astype(np.int64)), "unit": np.datetime_data(self.step.dtype)[0]}
        names = {"states": self.states, "observations": self.observations}
        return {
            **{key: None if value is None else list(value) for key, value in names.items()},
            "units": self.units,
            "step": step,
        }

    @classmethod
    def from_dict(cls, values: Any) -> Labels:
        """Create labels from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        Labels

        Raises
        ------
        ParameterError
            If a key is missing, unknown or has an inadmissible value.
        """
        if not isinstance(values, Mapping) or set(values) != set(_PARTS):
            raise ParameterError(f"labels: got {brief(values)}, expected {', '.join(_PARTS)}")
        step = values["step"]
        if step is not None:
            if not isinstance(step, Mapping) or set(step) != {"count", "unit"} or step["unit"] not in _KEPT:
                raise ParameterError(f"step: got {brief(step)}, expected a count and a unit of {_KEPT}")
            step = _timedelta(as_count("step", step["count"], 1, _MOST - 1), step["unit"])
        return cls(**{**values, "step": step})

    def __bool__(self) -> bool:
        """Whether anything is known."""
        return any(part is not None for part in (self.states, self.observations, self.step))

    def _known(self) -> tuple[Any, ...]:
        return self.states, self.observations, self._units, str(self.step)

    def __eq__(self, other: object) -> bool:
        """Whether the other knows the same."""
        return self._known() == other._known() if isinstance(other, Labels) else NotImplemented

    def __hash__(self) -> int:
        """Return a number that is the same for equals."""
        return hash(self._known())

    @shown
    def __repr__(self) -> str:
        step = {} if self.step is None else {"step": spoken(self.step)}
        return call_text(self, "states", "observations", "units", **step)


# --------------------------------------------------------------------------- arguments


def _as_names(argument: str, names: Any) -> tuple[str, ...] | None:
    if names is None:
        return None
    if isinstance(names, str | bytes | Mapping) or not isinstance(names, Iterable):
        raise ParameterError(f"{argument}: got {brief(names)}, expected a list of names")
    found = tuple(names)
    for name in found:
        if not isinstance(name, str) or not name:
            raise ParameterError(f"{argument}: got {brief(name)} among the names, expected text")
    _check_once(argument, found)
    return tuple(str(name) for name in found)


def _check_once(argument: str, names: Sequence[str]) -> None:
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise ParameterError(f"{argument}: the name {twice!r} stands twice, expected each once")


def _as_units(units: Any, names: Iterable[str]) -> dict[str, str]:
    if units is None:
        return {}
    if not isinstance(units, Mapping):
        raise ParameterError(f"units: got {brief(units)}, expected units by name")
    names = list(names)
    for name, unit in units.items():
        if name not in names:
            known = f"names among {listed(names)}" if names else "none, as no name is known"
            raise ParameterError(f"units: got one of {brief(name)}, expected {known}")
        if not isinstance(unit, str) or not unit:
            raise ParameterError(f"units: got {brief(unit)} for {name!r}, expected text")
    return dict(units)


def _as_step(step: Any) -> np.timedelta64:
    """Return a step in months, or in the coarsest unit of seconds and their parts."""
    refusal = ParameterError(
        f"step: got {brief(step)}, expected a numpy.timedelta64 (or a timedelta) above zero, of no unit "
        "finer than a nanosecond"
    )
    value: Any = step.to_timedelta64() if hasattr(step, "to_timedelta64") else step
    if isinstance(value, timedelta):
        value = np.timedelta64(value)
    if not isinstance(value, np.timedelta64) or np.isnat(value):
        raise refusal
    unit, multiple = np.datetime_data(value.dtype)
    count, kept = int(value.astype(np.int64)) * multiple, "M"
    if unit in _MONTHS:
        count *= _MONTHS[unit]
    elif unit in _NANOSECONDS:
        count *= _NANOSECONDS[unit]  # a whole number of any size
        kept = next(one for one in _KEPT[1:] if count % _NANOSECONDS[one] == 0)
        count //= _NANOSECONDS[kept]
    else:
        raise refusal
    if not 0 < count < _MOST:
        raise refusal
    return _timedelta(count, kept)


def _timedelta(count: int, unit: Any) -> np.timedelta64:
    return np.timedelta64(count, unit)


#: Of a model that remembers nothing.
NO_LABELS = Labels()


# --------------------------------------------------------------------------- what tables are called


def columns_of(table: Any) -> list[Any] | None:
    """Return the names of the columns of a table; None if there are none but 0, 1, 2, ..."""
    if not hasattr(table, "to_numpy"):
        return None
    if hasattr(table, "dims") and hasattr(table, "indexes"):
        index = table.indexes.get(table.dims[-1]) if table.ndim == 2 else None
    else:
        index = getattr(table, "columns", None)
    return None if index is None else names_of(list(index))


def names_of(columns: list[Any]) -> list[Any] | None:
    """Return the names of columns; None if they are 0, 1, 2, ..., which are no names."""
    by_position = all(
        isinstance(one, int | np.integer) and not isinstance(one, bool) and one == k
        for k, one in enumerate(columns)
    )
    return None if by_position else columns


def _name_of(table: Any) -> str | None:
    """Return the name of a series; None if it has none, or is none."""
    if not hasattr(table, "to_numpy") or hasattr(table, "columns"):
        return None
    name = getattr(table, "name", None)
    return None if name is None or str(name) == "" else str(name)


def _take(table: Any, columns: Sequence[Any], positions: Sequence[int]) -> Any:
    """Return some columns of a table, in this order."""
    if list(positions) == list(range(len(columns))):
        return table
    if hasattr(table, "isel"):
        return table.isel({table.dims[-1]: list(positions)})
    if hasattr(table, "iloc"):
        return table.iloc[:, list(positions)]
    return table[[columns[k] for k in positions]]


# --------------------------------------------------------------------------- learning


def read_labels(
    x: Sequence[Any],
    y: Sequence[Any],
    known: Labels = NO_LABELS,
    arguments: tuple[str, str] = ("x", "y"),
) -> Labels:
    """Read from the data what a model will remember of them.

    Parameters
    ----------
    x, y : sequence
        The states and the observations of each series.
    known : Labels
        What is known already, and stays.
    arguments : tuple of str
        What the states and the observations are called, for messages.

    Returns
    -------
    Labels
        Names are those of columns, or of a Series; all series have to agree in those of columns, in whatever
        order (see `ordered`), and those that are called differently have no name.  The step is that of an
        index of times.

    Raises
    ------
    ParameterError
        If tables are called differently, a name stands twice, or series have steps of different lengths.

    Examples
    --------
    >>> import pandas as pd
    >>> days = pd.date_range("2014", periods=2, freq="D")
    >>> frame = pd.DataFrame({"load": [1.0, 2.0], "t": [3.0, 4.0]}, days)
    >>> read_labels([frame["load"]], [frame[["t"]]])
    Labels(states=('load',), observations=('t',), units={}, step='1 day, 0:00:00')
    """
    of_x, of_y = arguments
    states = _common_names(of_x, x) if known.states is None else known.states
    observations = _common_names(of_y, y) if known.observations is None else known.observations
    units = known.units
    for one in (*x, *y):
        unit, name = _unit_of(one), _name_of(one)
        if unit is not None and name in (*(states or ()), *(observations or ())):
            units.setdefault(name, unit)
    step = _common_step(x, y, ", ".join(arguments)) if known.step is None else known.step
    return Labels(states, observations, units, step)


def ordered(tables: Sequence[Any], names: Sequence[str] | None, argument: str) -> list[Any]:
    """Return tables with their columns in one order.

    Parameters
    ----------
    tables : sequence
    names : sequence of str or None
        As `read_labels` found them.
    argument : str
        Of what they are, for messages.
    """
    found = []
    for table in tables:
        columns = None if names is None else columns_of(table)
        if columns is None or names is None:
            found.append(table)
        else:
            found.append(_take(table, columns, match_columns(columns, names, argument)))
    return found


def _common_names(argument: str, tables: Sequence[Any]) -> tuple[str, ...] | None:
    frames = [columns for columns in map(columns_of, tables) if columns is not None]
    if frames:
        names = tuple(map(str, frames[0]))
        _check_once(f"{argument}: columns", names)
        for other in frames[1:]:
            if sorted(map(str, other)) != sorted(names):
                raise ParameterError(
                    f"{argument}: the columns of one series are {listed(names)}, those of another "
                    f"{listed(list(map(str, other)))}; expected the same (rename them, or pass arrays, which "
                    "go by position)"
                )
        return names
    found = {_name_of(table) for table in tables}
    name = found.pop() if len(found) == 1 else None
    return None if name is None else (name,)


def _unit_of(table: Any) -> str | None:
    """Return the unit that a series says it has, where netCDF files have it."""
    attributes = getattr(table, "attrs", None)
    unit = attributes.get("units") if isinstance(attributes, Mapping) else None
    return unit if isinstance(unit, str) and unit else None


def _common_step(x: Sequence[Any], y: Sequence[Any], argument: str) -> np.timedelta64 | None:
    found = []
    for tables in zip(x, y, strict=False):  # as many of each, which who learns makes sure of
        found += [_times(index, argument) for index in map(index_of, tables) if has_times(index)][:1]
    longest = max(found, key=len, default=None)  # two months look like so many days
    step = None if longest is None else find_steps(longest).step
    if step is None:
        return None
    common = _as_step(step)
    for times in found:
        other = other_step(times, common)
        if other is not None:
            raise ParameterError(
                f"{argument}: the rows of one series are {spoken(other)} apart, those of another "
                f"{spoken(common)}; expected steps of one length (resample, or pass arrays, whose rows are "
                "taken as they come)"
            )
    return common


def _times(index: Any, argument: str) -> Times:
    return read_times(index, gaps=True, where=lambda row: f"{argument}: the index of row {row}")


# --------------------------------------------------------------------------- a model meets data


def labels_of(f: Any) -> Labels:
    """Return the labels of the model of a filter; none if it has no model, or that none."""
    labels = getattr(getattr(f, "model", None), "labels", None)
    return labels if isinstance(labels, Labels) else NO_LABELS


def match_series(zs: Any, labels: Labels, dim_z: int, argument: str = "zs") -> Any:
    """Return the observations of a model from a series, by their names where it has any.

    An array goes by position, and so do a Series and a table whose columns are 0, 1, 2, ...  Of a table
    with names, and of the rows of a list, those of the model are taken, in its order.

    Parameters
    ----------
    zs : array_like
        A series, as filters take it.
    labels : Labels
        Of the model.
    dim_z : int
    argument : str
        What it is called, for messages.

    Returns
    -------
    array_like
        What was given, or the columns of it that the model observes.

    Raises
    ------
    ParameterError
        If a column is missing, what is given is a state of the model, or its rows are not as far apart as
        those that were learned on.

    Examples
    --------
    >>> import pandas as pd
    >>> frame = pd.DataFrame({"h": [1.0], "load": [2.0], "t": [3.0]})
    >>> list(match_series(frame, Labels(["load"], ["t", "h"]), 2).columns)
    ['t', 'h']
    """
    if labels and isinstance(zs, list):
        return [match_row(z, labels, f"{argument}: observation {k}") for k, z in enumerate(zs)]
    if not labels or not hasattr(zs, "to_numpy"):
        return zs
    check_step(index_of(zs), labels, argument)
    columns = columns_of(zs)
    if columns is None:
        check_no_state([_name_of(zs)], labels, argument)
        return zs
    if labels.observations is None:
        check_no_state(map(str, columns), labels, argument)
        return zs
    known = {*labels.observations, *(labels.states or ())}
    strange = len(columns) == dim_z and known.isdisjoint(map(str, columns))
    remedy = f", or pass {argument}.to_numpy(), whose columns go by position" if strange else ""
    return _take(zs, columns, match_columns(columns, labels.observations, argument, remedy))


def match_row(z: Any, labels: Labels, argument: str = "z") -> Any:
    """Return one observation of a model from a row of a table, by the names that it has.

    An array or a list goes by position, and so does a Series that is numbered 0, 1, 2, ...

    Parameters
    ----------
    z : array_like, Series, DataFrame of one row, mapping or named tuple
    labels : Labels
        Of the model.
    argument : str
        What it is called, for messages.

    Raises
    ------
    ParameterError
        If a name is missing.

    Examples
    --------
    >>> match_row({"h": 1.0, "load": 2.0, "t": 3.0}, Labels(["load"], ["t", "h"]))
    [3.0, 1.0]
    """
    if z is None or isinstance(z, float | np.ndarray) or not labels.observations:
        return z
    if hasattr(z, "to_numpy"):
        names = columns_of(z) if hasattr(z, "columns") else names_of(list(getattr(z, "index", ())))
        values = np.asarray(z.to_numpy(), dtype=object).ravel()
    elif isinstance(z, Mapping):
        names, values = list(z), np.array([*z.values(), None], dtype=object)[:-1]
    elif isinstance(z, tuple) and hasattr(z, "_fields"):
        names, values = list(z._fields), np.array([*z, None], dtype=object)[:-1]
    else:
        return z
    if names is None or len(values) != len(names) or (len(names) == 1 and _is_cut_out(z, labels)):
        return z
    return [values[k] for k in match_columns(names, labels.observations, argument)]


def _is_cut_out(z: Any, labels: Labels) -> bool:
    """Whether a Series of one number is a piece of a column: its label says where it stood, not what."""
    if hasattr(z, "columns") or not hasattr(z, "index") or isinstance(z, tuple):
        return False
    return _name_of(z) in (labels.observations or ()) or not isinstance(z.index[0], str)


def check_many(zs: Any, labels: Labels, argument: str = "zs") -> None:
    """Raise if a table whose columns are many series has a state of the model among them, or another step.

    Parameters
    ----------
    zs : object
        A DataFrame; anything else is looked at series by series.
    labels : Labels
        Of the model.
    argument : str
        What it is called, for messages.

    Raises
    ------
    ParameterError
    """
    columns = columns_of(zs) if labels and hasattr(zs, "to_numpy") and not hasattr(zs, "dims") else None
    if columns is not None:
        check_step(index_of(zs), labels, argument)
        check_no_state(map(str, columns), labels, argument)


def match_columns(columns: Iterable[Any], names: Sequence[str], argument: str, remedy: str = "") -> list[int]:
    """Return where the names stand among columns.

    Parameters
    ----------
    columns : iterable
        Names of any type, which count by their text.
    names : sequence of str
    argument : str
        What has the columns, for messages.
    remedy : str
        What else can be done if one is missing, for the end of the message.

    Raises
    ------
    ParameterError
        If one is missing, or stands twice.

    Examples
    --------
    >>> match_columns(["h", "load", "t"], ["t", "h"], "zs")
    [2, 0]
    """
    there = [str(one) for one in columns]
    missing = [name for name in names if name not in there]
    if missing:
        raise ParameterError(
            f"{argument}: got no column {listed([repr(name) for name in missing])}; the model was learned on "
            f"{listed(names)}, and the columns are {listed(there) or 'none'}: rename what is called otherwise"
            f"{remedy}"
        )
    for name in names:
        if there.count(name) > 1:
            raise ParameterError(f"{argument}: {there.count(name)} columns are called {name!r}, expected one")
    return [there.index(name) for name in names]


def check_step(index: Any, labels: Labels, argument: str, remedy: str | None = None) -> None:
    """Raise if rows are known to be farther apart, or nearer, than those that a model was learned on.

    Parameters
    ----------
    index : object
        Of the rows; anything but times is passed over.
    labels : Labels
    argument : str
        What has the rows, for messages.
    remedy : str, optional
        What can be done, beside resampling them.

    Raises
    ------
    ParameterError
        Names both lengths.
    """
    if labels.step is None:
        return
    if getattr(getattr(index, "dtype", None), "kind", "") == "m":
        other = _other_duration(index, labels.step)
    elif isinstance(index, Times) or has_times(index):
        other = other_step(_times(index, argument), labels.step)
    else:
        return
    if other is not None:
        remedy = remedy or f"pass {argument}.to_numpy(), whose rows are taken as they come"
        raise ParameterError(
            f"{argument}: its rows are {spoken(other)} apart, but the model was learned on rows "
            f"{spoken(labels.step)} apart; resample it, or {remedy}"
        )


def _other_duration(index: Any, step: np.timedelta64) -> np.timedelta64 | None:
    """Return the step of an index of durations, if it is one, and another than ``step``."""
    steps = np.diff(np.asarray(index))
    months = np.datetime_data(step.dtype)[0] == "M"
    if not steps.size or not (steps == steps[0]).all() or (not months and steps[0] == step):
        return None
    found: np.timedelta64 = steps[0]
    return found


def check_no_state(names: Iterable[str | None], labels: Labels, argument: str) -> None:
    """Raise if one of the names is that of a state of a model, and of no observation."""
    observed = labels.observations or ()
    for name in names:
        if name is not None and name in (labels.states or ()) and name not in observed:
            seen = f"which observes {listed(observed)}" if observed else "and no observation"
            raise ParameterError(
                f"{argument}: got {name!r}, a state of the model, {seen}; pass what is observed (if that is "
                f"called so, {argument}.to_numpy())"
            )

"""Series to learn from: observations, measured states, controls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import brief
from fuzzykf.labels import Labels, match_series, ordered, read_labels
from fuzzykf.many import ManySeries, read_many
from fuzzykf.observations import as_observations, check_aligned, index_of
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.state_space.controls import read_controls

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.state_space.model import SwitchingStateSpace

__all__ = ["SpaceData", "SpaceSeries", "labels_read", "read_data"]


class SpaceSeries(NamedTuple):
    """One series.

    Attributes
    ----------
    ys : ndarray, shape (n, c + q)
        Of the state what is measured, then the observations; NaN where missing.
    us : ndarray, shape (n, k), or None
        The controls that lead to each of them.
    """

    ys: FloatArray
    us: FloatArray | None


@dataclass(frozen=True, eq=False)
class SpaceData:
    """All that a model is learned from.

    Attributes
    ----------
    series : tuple of SpaceSeries
    measured : ndarray of int, shape (c,)
        Components of the state that are measured at some time.
    """

    series: tuple[SpaceSeries, ...]
    measured: IntArray

    @property
    def n_observations(self) -> int:
        """Times at which something was observed or measured."""
        return sum(int((~np.isnan(ys)).any(axis=1).sum()) for ys, _ in self.series)


def read_data(model: SwitchingStateSpace, zs: Any, xs: Any, us: Any) -> SpaceData:
    """Read series as `SwitchingStateSpace.fit` takes them.

    Raises
    ------
    ShapeError, ParameterError
        If a shape is another one, a series has no rows, rows or names of series do not agree, or nothing is
        observed.
    """
    many, is_one = _read(model, zs)
    s, n, _ = many.values.shape
    lengths = np.full(s, n) if many.lengths is None else many.lengths
    if (lengths == 0).any():
        which = "" if is_one else f"series {int(lengths.argmin())}, "
        raise ShapeError(f"zs: {which}got no rows, expected at least one")
    states = np.full((s, n, model.dim_x), np.nan)
    if xs is not None:
        states = _measured(many, is_one, zs, _by_names(model, xs), model.dim_x)
    measured = np.flatnonzero((~np.isnan(states)).any(axis=(0, 1)))
    both = np.concatenate([states[..., measured], many.values], axis=-1)
    if np.isnan(both).all():
        raise ParameterError(f"zs: got {n} rows without an observation, expected some")
    controls = _controls(model, us, many, lengths, is_one)
    if is_one:
        check_aligned(zs=zs, us=us)
    series = (SpaceSeries(ys[:m], u) for ys, m, u in zip(both, lengths, controls, strict=True))
    return SpaceData(tuple(series), measured)


def labels_read(model: SwitchingStateSpace, zs: Any, xs: Any) -> Labels:
    """Return what a model remembers, and of what it does not know what the series say.

    Parameters
    ----------
    model, zs, xs
        As in `read_data`.

    Raises
    ------
    ParameterError
        If tables are called differently, or have steps of different lengths.
    """
    observed, measured = _tables(zs, model.dim_z), _tables(xs, model.dim_x)
    n = max(len(observed), len(measured))
    observed, measured = ([*tables, *[None] * (n - len(tables))] for tables in (observed, measured))
    return read_labels(measured, observed, model.labels, ("xs", "zs"))


def _tables(series: Any, size: int) -> list[Any]:
    """Return what may have names and times: one table, or those of several series, None for any other."""
    if isinstance(series, Mapping):
        members = list(series.values())
    else:
        members = list(series) if isinstance(series, list | tuple) else [series]

    def has_components(one: Any) -> bool:
        if not hasattr(one, "to_numpy") or np.ndim(one) not in (1, 2):
            return False
        return bool(np.shape(one)[1] == size if np.ndim(one) == 2 else size == 1 and len(one) > 1)

    return [one if has_components(one) else None for one in members]


def _read(model: SwitchingStateSpace, zs: Any) -> tuple[ManySeries, bool]:
    """Return one series, or several side by side, and whether it is one."""
    if hasattr(zs, "__iter__") and not hasattr(zs, "__len__") and not hasattr(zs, "to_numpy"):
        zs = list(zs)
    q, labels = model.dim_z, model.labels

    def named(one: Any) -> Any:
        return one if isinstance(one, np.ndarray) else match_series(one, labels, q)

    try:
        values = as_observations(named(zs), q)
    except (ShapeError, ParameterError) as error:
        if isinstance(zs, np.ndarray) and zs.ndim < 3:  # too many columns, no series of one component
            raise
        try:
            return read_many(zs, q, None, named if labels else None), False
        except (ShapeError, ParameterError) as other:
            raise (other if _looks_like_many(zs, q) else error) from None
    warn_of_steps(index_of(zs))
    return ManySeries(values[None], index=index_of(zs)), True


def _looks_like_many(zs: Any, q: int) -> bool:
    """Whether an error should speak of several series: of what is in them."""
    if isinstance(zs, Mapping) or getattr(zs, "ndim", 0) == 3:
        return True
    if not (isinstance(zs, list | tuple) and zs):
        return False
    try:
        return index_of(zs[0]) is not None or np.ndim(zs[0]) > (0 if q == 1 else 1)
    except ValueError:  # lists of unequal lengths
        return True


def _by_names(model: SwitchingStateSpace, xs: Any) -> Any:
    """Return measured states with their columns in the order of the model, as far as it knows names."""
    names = model.labels.states
    if isinstance(xs, Mapping):
        return dict(zip(xs, ordered(list(xs.values()), names, "xs"), strict=True))
    if isinstance(xs, list | tuple):
        return ordered(xs, names, "xs")
    return ordered([xs], names, "xs")[0]


def _filled(xs: Any, many: ManySeries, m: int) -> Any:
    """Return several series of measured states, rows of NaN where there are none of one."""
    n = many.values.shape[1]
    lengths = [n] * len(many.values) if many.lengths is None else many.lengths.tolist()
    if isinstance(xs, Mapping) and many.names is not None and set(xs) <= set(many.names):
        xs = [xs.get(name) for name in many.names]
    if not isinstance(xs, list | tuple) or len(xs) != len(lengths) or not any(one is None for one in xs):
        return xs
    return [np.full((k, m), np.nan) if one is None else one for one, k in zip(xs, lengths, strict=True)]


def _measured(many: ManySeries, is_one: bool, zs: Any, xs: Any, m: int) -> FloatArray:
    """Return measured states (series, n, m), NaN where they are not."""
    if not is_one:
        return many.beside("xs", _filled(xs, many, m), m)
    check_aligned(zs=zs, xs=xs)
    try:
        states = as_observations(xs, m)
    except (ShapeError, ParameterError) as error:
        raise type(error)(str(error).replace("zs:", "xs:", 1)) from None
    n = many.values.shape[1]
    if len(states) != n:
        raise ShapeError(f"xs: got {len(states)} rows, expected {n}, one for each observation")
    return states[None]


def _controls(
    model: SwitchingStateSpace, us: Any, many: ManySeries, lengths: IntArray, is_one: bool
) -> list[FloatArray | None]:
    """Return the controls of each series."""
    if us is None:
        return [None] * len(lengths)
    if is_one:
        found = read_controls(us, int(lengths[0]), model, begins=True)
        return [None if found is None else found[0]]
    if isinstance(us, Mapping):
        names = [*range(len(lengths))] if many.names is None else list(many.names)
        if set(us) != set(names):
            raise ParameterError(
                f"us: got the series {brief(list(us))}, expected those of zs, {brief(names)}"
            )
        us = [us[name] for name in names]
    if not hasattr(us, "__len__") or len(us) != len(lengths):
        raise ShapeError(f"us: got {brief(us)}, expected the controls of {len(lengths)} series, one for each")
    parts = []
    for k, (one, n) in enumerate(zip(us, lengths.tolist(), strict=True)):
        try:
            found = read_controls(one, n, model, begins=True)
        except (ShapeError, ParameterError) as error:
            raise type(error)(str(error).replace("us:", f"us: series {k},", 1)) from None
        parts.append(None if found is None else found[0])
    return parts

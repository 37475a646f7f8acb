"""What a filter of a state-space model is told at a step, or at each step of a series: u, R and H."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief, check_covariance
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.reprs import reprs
from fuzzykf.switching.state_space.parameters import Parameter
from fuzzykf.switching.state_space.space_system import DrivenSystem

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries
    from fuzzykf.switching.state_space.space_system import SpaceSystem

__all__ = [
    "NOTHING",
    "Inputs",
    "Told",
    "read_control",
    "read_controls",
    "read_controls_of_many",
    "read_each",
    "read_seen",
]


class _Controlled(Protocol):
    """A system that may have controls: so many, or None."""

    @property
    def dim_u(self) -> int | None: ...


# no arrays that may be None: filterpy's Saver makes an array of what a filter holds at all times
@reprs()
@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What a filter is told of one step; None where it is not.

    Attributes
    ----------
    u : ndarray, shape (k,), or None
        The control that leads to the observation.
    H, R : ndarray, shapes (M, q, m) and (M, q, q), or None
        How it is seen.
    """

    u: FloatArray | None = None
    H: FloatArray | None = None
    R: FloatArray | None = None


#: Nothing that is told of a step.
NOTHING = Told()


class Inputs(NamedTuple):
    """What filters are told along series of n observations; None where it is not told."""

    us: FloatArray | None = None  # (s, n, k): s is 1 where all series share them
    Hs: FloatArray | None = None  # (s, n, M, q, m)
    Rs: FloatArray | None = None  # (s, n, M, q, q)

    def after(self, u: FloatArray | None, system: SpaceSystem, n: int) -> Inputs:
        """Return them after the step to an observation that was skipped, to which a control (k,) led."""
        us, k = self.us, system.dim_u or 0
        if us is None and u is not None:
            us = np.zeros((1, n, k))
        first = np.zeros(k) if u is None else u, system.tables.H, system.tables.R
        given = zip((us, self.Hs, self.Rs), first, strict=True)
        return Inputs(*(None if one is None else _led(one, before) for one, before in given))

    def rows(self, rows: Any, n: int) -> Inputs:
        """Return those of some series, up to observation ``n``."""
        return Inputs(*(None if a is None else (a if len(a) == 1 else a[rows])[:, :n] for a in self))

    def arguments(self, s: int) -> list[dict[str, FloatArray]]:
        """Return the controls of each of s series as arguments of `filter`."""
        us = self.us
        return [{} if us is None else {"us": us[min(k, len(us) - 1)]} for k in range(s)]

    def told(self, n: int) -> Told:
        """Return what is told of step ``n`` of the first series."""
        return Told(*(None if one is None else one[0, n] for one in self))

    def drive(self, system: SpaceSystem, origin: int) -> SpaceSystem | DrivenSystem:
        """Return a system that is told them from observation ``origin`` on."""
        told = any(one is not None for one in self)
        return DrivenSystem(system, origin, *self) if told else system


def _led(values: FloatArray, first: FloatArray) -> FloatArray:
    """Return values (s, n, ...) of steps after that of a step before."""
    return np.concatenate([np.broadcast_to(first, (len(values), 1, *first.shape)), values], axis=1)


# --------------------------------------------------------------------------- of one step


def read_control(u: Any, system: _Controlled, name: str = "u") -> FloatArray | None:
    """Return a control (k,), None where there is none.

    Raises
    ------
    ShapeError, ParameterError
        If the model has no controls, or others.
    """
    if u is None:
        return None
    k = system.dim_u
    if k is None:
        raise ParameterError(f"{name}: got {brief(u)}, but the model has no B; expected None")
    array = as_numbers(name, u)
    if array.shape not in {(k,), (k, 1)} and not (k == 1 and array.shape == ()):
        raise ShapeError(f"{name}: got shape {array.shape}, expected ({k},) or ({k}, 1), the controls of B")
    return as_array(name, array.reshape(k), (k,))


def read_seen(name: str, given: Any, system: SpaceSystem, mix: str) -> FloatArray | None:
    """Return R (M, q, q) or H (M, q, m) at the nodes, None where nothing is given.

    Parameters
    ----------
    name : str
        "R" or "H", and a number in brackets where it is that of a step of a series.
    given : array_like or callable
        As in `SwitchingStateSpace`; a number in place of R is that multiple of the identity.
    system : SpaceSystem
    mix : {"linear", "log"}
    """
    if given is None:
        return None
    q, chain = system.dim_z, system.chain
    is_noise = name.startswith("R")
    if is_noise and not callable(given):
        given = as_numbers(name, given)
        given = given * np.eye(q) if given.ndim == 0 else given
    shape = (q, q) if is_noise else (q, system.dim_x)
    parameter = Parameter(name, given, chain.n_classes, shape, mix if is_noise else None)
    return parameter.at(chain.class_weights)


# --------------------------------------------------------------------------- of each step


def read_controls(us: Any, n: int, system: _Controlled, begins: bool) -> FloatArray | None:
    """Return controls (1, n, k) of a series; that of its first observation is not used if it ``begins``."""
    if us is None:
        return None
    k = system.dim_u
    if k is None:
        raise ParameterError(f"us: got {brief(us)}, but the model has no B; expected None")
    if index_of(us) is not None:
        us = us.to_numpy()
    if isinstance(us, list | tuple):
        us = [np.zeros(k) if u is None else np.ravel(as_numbers(f"us[{row}]", u)) for row, u in enumerate(us)]
    array = as_numbers("us", us)
    if array.shape not in {(n, k), (n, k, 1)} and not (k == 1 and array.shape == (n,)):
        also = f" or ({n},)" if k == 1 else ""
        raise ShapeError(f"us: got shape {array.shape}, expected ({n}, {k}){also}, one for each observation")
    return _checked(array.reshape(1, n, k), begins)


def read_controls_of_many(us: Any, many: ManySeries, system: _Controlled, begins: bool) -> FloatArray | None:
    """Return controls of many series, (series, n, k), or (1, n, k) where these share them."""
    if us is None:
        return None
    k, n = system.dim_u, many.values.shape[1]
    if k is None:
        raise ParameterError(f"us: got {brief(us)}, but the model has no B; expected None")
    if index_of(us) is not None and not hasattr(us, "columns"):
        own = many.index.to_series() if hasattr(many.index, "to_series") else None
        check_aligned(zs=own, us=us)
        return read_controls(us, n, system, begins)
    if isinstance(us, np.ndarray) or (isinstance(us, list | tuple) and len({np.shape(u) for u in us}) == 1):
        shape = np.shape(us)
        if shape in {(n, k), (n, k, 1)} or (k == 1 and shape == (n,)):
            return read_controls(us, n, system, begins)
    found = many.beside("us", us, k)
    for row, one in enumerate(found):
        _checked(one[None, : n if many.lengths is None else many.lengths[row]], begins)
    return np.nan_to_num(found)  # beyond the end of a series, and where it is not used


def _checked(us: FloatArray, begins: bool) -> FloatArray:
    """Return controls (1, n, k) after proving those that are used; the first is set to zero if it is not."""
    us = us.copy()
    if begins:
        us[:, :1] = 0.0
    if not np.isfinite(us).all():
        row = int(np.argwhere(~np.isfinite(us))[0][1])
        raise ParameterError(f"us: row {row} is {us[0, row].tolist()}, expected finite numbers")
    return us


def read_each(name: str, given: Any, n: int, system: SpaceSystem, mix: str) -> FloatArray | None:
    """Return R or H of each step of a series at the nodes, (1, n, M, q, ...); None where nothing is given.

    Parameters
    ----------
    name : str
        "Rs" or "Hs".
    given : sequence of n, or ndarray
        Each as `read_seen` takes it, or None for that of the model.
    """
    if given is None:
        return None
    listed = isinstance(given, Sequence) or (hasattr(given, "__len__") and hasattr(given, "__array__"))
    listed = listed and not isinstance(given, str | bytes) and getattr(given, "ndim", 1) > 0
    if not listed or len(given) != n:
        got = brief(given) if not listed else f"{len(given)} values"
        raise ShapeError(f"{name}: got {got}, expected one for each of the {n} observations")
    M, one = len(system.chain), name[0]
    own = system.tables.R if one == "R" else system.tables.H
    if isinstance(given, np.ndarray) and given.shape == (n, *own.shape[1:]):  # the usual case, all at once
        check = check_covariance if one == "R" else as_array
        values = check(name, given, given.shape)
        return np.broadcast_to(values[:, None], (n, M, *own.shape[1:]))[None]
    rows = [read_seen(f"{one}s[{k}]", value, system, mix) for k, value in enumerate(given)]
    found = np.array([own if row is None else row for row in rows])
    return found.reshape(1, n, *own.shape)

"""What a filter of a state-space model is told at a step, or at each step of a series: u, R and H."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief, check_covariance
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.reprs import reprs
from fuzzykf.switching.state_space.controls import check_controls, read_control, read_controls
from fuzzykf.switching.state_space.parameters import Parameter
from fuzzykf.switching.state_space.space_system import DrivenSystem

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries
    from fuzzykf.switching.state_space.controls import Controlled
    from fuzzykf.switching.state_space.space_system import SpaceSystem

__all__ = [
    "NOTHING",
    "Inputs",
    "Told",
    "check_each",
    "read_control",
    "read_controls",
    "read_controls_of_many",
    "read_each",
    "read_seen",
    "seen_at",
    "shared_by_all",
]


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


def read_seen(name: str, given: Any, system: SpaceSystem, mix: str | None) -> FloatArray | None:
    """Return R (M, q, q) or H (M, q, m) at the nodes, None where nothing is given.

    Parameters
    ----------
    name : str
        "R" or "H", and a number in brackets where it is that of a step of a series.
    given : array_like or callable
        As in `SwitchingStateSpace`; a number in place of R is that multiple of the identity.
    system : SpaceSystem
    mix : {"linear", "log"} or None
        None where a model states the noise of state and observation as one.
    """
    if given is None:
        return None
    if mix is None:
        raise _untold(name, given)
    sizes = system.dim_x, system.dim_z
    return seen_at(name, given, system.chain.class_weights, sizes, mix)


def seen_at(name: str, given: Any, shares: FloatArray, sizes: tuple[int, int], mix: str) -> FloatArray:
    """Return R (..., q, q) or H (..., q, m) at values of the switch with these shares (..., K).

    Parameters
    ----------
    name, given, mix
        As in `read_seen`.
    shares : ndarray, shape (..., K)
    sizes : tuple of int
        The numbers m and q of components of the state and of an observation.
    """
    m, q = sizes
    is_noise = name.startswith("R")
    if is_noise and not callable(given):
        given = as_numbers(name, given)
        given = given * np.eye(q) if given.ndim == 0 else given
    shape = (q, q) if is_noise else (q, m)
    return Parameter(name, given, shares.shape[-1], shape, mix if is_noise else None).at(shares)


def _untold(name: str, given: Any) -> ParameterError:
    return ParameterError(
        f"{name}: got {brief(given)}, but a pairwise model has no {name[0]} of its own; expected None"
    )


# --------------------------------------------------------------------------- of each step


def read_controls_of_many(us: Any, many: ManySeries, system: Controlled, begins: bool) -> FloatArray | None:
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
        check_controls(one[None, : n if many.lengths is None else many.lengths[row]], begins)
    return np.nan_to_num(found)  # beyond the end of a series, and where it is not used


def read_each(name: str, given: Any, n: int, system: SpaceSystem, mix: str | None) -> FloatArray | None:
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
    if mix is None:
        raise _untold(name, given)
    check_each(name, given, n)
    M, one = len(system.chain), name[0]
    own = system.tables.R if one == "R" else system.tables.H
    shared = shared_by_all(name, given, (n, *own.shape[1:]))
    if shared is not None:
        return np.broadcast_to(shared[:, None], (n, M, *own.shape[1:]))[None]
    rows = [read_seen(f"{one}s[{k}]", value, system, mix) for k, value in enumerate(given)]
    found = np.array([own if row is None else row for row in rows])
    return found.reshape(1, n, *own.shape)


def check_each(name: str, given: Any, n: int) -> None:
    """Raise unless something, whatever it is, was given for each of ``n`` observations."""
    listed = isinstance(given, Sequence) or (hasattr(given, "__len__") and hasattr(given, "__array__"))
    listed = listed and not isinstance(given, str | bytes) and getattr(given, "ndim", 1) > 0
    if not listed or len(given) != n:
        got = brief(given) if not listed else f"{len(given)} values"
        raise ShapeError(f"{name}: got {got}, expected one for each of the {n} observations")


def shared_by_all(name: str, given: Any, shape: tuple[int, ...]) -> FloatArray | None:
    """Return matrices (n, ...) that all values of the switch share, all at once; None if they are not so.

    That is the usual case.
    """
    if not isinstance(given, np.ndarray) or given.shape != shape:
        return None
    check = check_covariance if name[0] == "R" else as_array
    return check(name, given, given.shape)

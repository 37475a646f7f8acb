"""What the filter of a known switch is told beside it, of a state-space model: u, R and H.

As in `fuzzykf.switching.filters.inputs`, but at the values of the switch instead of nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import brief
from fuzzykf.switching.filters.inputs import Inputs, Told, check_each, seen_at, shared_by_all

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.placed import KnownPath

__all__ = ["led", "read_each_along", "read_looks", "read_seen_along"]


def read_seen_along(name: str, given: Any, shares: FloatArray, path: KnownPath) -> FloatArray | None:
    """Return R (..., q, q) or H (..., q, m) at values of the switch, None where nothing is given.

    Parameters
    ----------
    name : str
        "R" or "H", and a number in brackets where it is that of a step of a series.
    given : array_like or callable
        As in `SwitchingStateSpace`; a number in place of R is that multiple of the identity.
    shares : ndarray, shape (..., K)
        Of the classes in the values of the switch.
    path : KnownPath
        Of the model.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If it has a wrong shape or is no covariance, or the model has no R and H.
    """
    if given is None:
        return None
    return seen_at(name, given, shares, (path.dim_x, path.dim_z), _mix(name, given, path))


def read_looks(n: int, **given: Any) -> dict[str, Any]:
    """Return what was given of Rs and Hs, by name, after proving that it is something for each of n steps."""
    looks = {name: one for name, one in given.items() if one is not None}
    for name, one in looks.items():
        check_each(name, one, n)
    return looks


def read_each_along(
    name: str, given: Any, shares: FloatArray, path: KnownPath, form: Any
) -> FloatArray | None:
    """Return R or H of each step of series, (s, n, 1, q, ...); None where nothing is given.

    Parameters
    ----------
    name : str
        "Rs" or "Hs".
    given : sequence of n, or ndarray
        Each as `read_seen_along` takes it, or None for that of the model.
    shares : ndarray, shape (s, n, K)
        Of the classes; s of the result is 1 where all series share what is given.
    path, form
        Of the model.
    """
    if given is None:
        return None
    _mix(name, given, path)
    one, n = name[0], shares.shape[1]
    check_each(name, given, n)
    shape = (path.dim_z, path.dim_z if one == "R" else path.dim_x)
    shared = shared_by_all(name, given, (n, *shape))
    if shared is not None:
        return shared[None, :, None]
    found = np.empty((*shares.shape[:2], 1, *shape))
    for k, value in enumerate(given):
        seen = read_seen_along(f"{one}s[{k}]", value, shares[:, k], path)
        found[:, k, 0] = form.at(one, shares[:, k]) if seen is None else seen
    return found


def led(told: Inputs, begin: FloatArray, form: Any, latest: Told, n: int) -> Inputs:
    """Return what is told along ``n`` observations after that of the values of the switch before them.

    Parameters
    ----------
    told : Inputs
    begin : ndarray, shape (l, K)
        Shares in the latest value of the switch, and in that of an observation that was skipped.
    form : StateSpaceForm
    latest : Told
        Of the step to what was skipped.
    n : int
    """
    us, u = told.us, latest.u
    if us is None and u is not None:
        us = np.zeros((1, n, len(u)))
    if us is not None:
        moved = np.zeros((len(begin), us.shape[-1]))
        moved[-1] = 0.0 if u is None else u
        us = _before(moved, us)
    seen = (
        None if one is None else _before(form.at(name, begin)[:, None], one)
        for name, one in (("H", told.Hs), ("R", told.Rs))
    )
    return Inputs(us, *seen)


def _before(first: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (s, n, ...) of steps after those (l, ...) of steps before."""
    return np.concatenate([np.broadcast_to(first, (len(values), *first.shape)), values], axis=1)


def _mix(name: str, given: Any, path: KnownPath) -> str:
    """Return how covariances are mixed, if the model has R and H."""
    if path.mix is None:
        raise ParameterError(f"{name}: got {brief(given)}, but the model has no {name[0]}; expected None")
    return path.mix

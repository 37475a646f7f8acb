"""Controls of state-space models, as they are given: of one step, or of each step of a series."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief
from fuzzykf.observations import index_of

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["Controlled", "check_controls", "read_control", "read_controls"]


class Controlled(Protocol):
    """What may have controls."""

    @property
    def dim_u(self) -> int | None:
        """How many there are; None without any."""


def read_control(u: Any, system: Controlled, name: str = "u") -> FloatArray | None:
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


def read_controls(us: Any, n: int, system: Controlled, begins: bool) -> FloatArray | None:
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
    return check_controls(array.reshape(1, n, k), begins)


def check_controls(us: FloatArray, begins: bool) -> FloatArray:
    """Return controls (1, n, k) after proving those that are used; the first is set to zero if it is not."""
    us = us.copy()
    if begins:
        us[:, :1] = 0.0
    if not np.isfinite(us).all():
        row = int(np.argwhere(~np.isfinite(us))[0][1])
        raise ParameterError(f"us: row {row} is {us[0, row].tolist()}, expected finite numbers")
    return us

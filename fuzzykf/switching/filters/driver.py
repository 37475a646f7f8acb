"""What a filter does beside its verbs where steps depend on inputs, or on earlier observations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import brief
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.inputs import InputSystem
from fuzzykf.switching.dynamics.told_inputs import told_step
from fuzzykf.switching.inference.driven import expected, first_expected, starting_past
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.inference.method import Method
    from fuzzykf.switching.inference.mixture import Mixture

__all__ = ["NOWHERE", "Driver", "Onwards", "driver_of", "read_step", "refuse"]


# no arrays that may be None: filterpy's Saver makes an array of what a filter holds at all times
@reprs()
@dataclass(frozen=True, slots=True, eq=False)
class Onwards:
    """What a filter goes on from beside its state.

    Attributes
    ----------
    past : ndarray, shape (n_past, q), or None
        The latest observations, the latest first, with what was expected where they are missing; None before
        any.
    u : ndarray, shape (k,), or None
        Inputs that were told of the step to the next observation.
    spread : ndarray, shape (q,), or None
        Variance that was expected of the latest observation, zero where it is there.
    """

    past: FloatArray | None = None
    u: FloatArray | None = None
    spread: FloatArray | None = None


#: Before any observation.
NOWHERE = Onwards()


def driver_of(owner: type, system: Any, method: Method) -> Driver | None:
    """Return the driver of a system; None if its steps depend on the latest observation alone.

    Raises
    ------
    ParameterError
        If they depend on more, and filters of the class ``owner`` are not driven.
    """
    if not isinstance(system, InputSystem):
        return None
    if not hasattr(owner, "_driven"):
        raise ParameterError(
            "system: got one with inputs or features of the window, which a plain SwitchingFilter does not "
            "take; expected a system without, or the filter that `filter` of its model makes"
        )
    return Driver(system, method)


def refuse(name: str, u: Any) -> None:
    """Raise where inputs are given to a model that has none."""
    if u is not None:
        raise ParameterError(f"{name}: got {brief(u)}, but the model has no inputs; expected None")


def read_step(driver: Driver | None, u: Any, n: int) -> FloatArray | None:
    """Return the inputs (k,) of the step after ``n`` observations; None where there are none, or none needed.

    Raises
    ------
    ShapeError, ParameterError
        If they are missing, or others; if the model has none.
    """
    if driver is None:
        refuse("u", u)
        return None
    return driver.read(u, n)


class Driver:
    """Keeps account of inputs and earlier observations for a filter.

    Parameters
    ----------
    system : InputSystem
    method : Method
    """

    def __init__(self, system: InputSystem, method: Method) -> None:
        self.system, self._method = system, method

    def read(self, u: Any, n: int) -> FloatArray | None:
        """Return the inputs (k,) of the step after ``n`` observations; None where none are needed.

        Raises
        ------
        ShapeError, ParameterError
            If they are missing, or others; see `told_step`.
        """
        k = self.system.dim_u
        if k is None:
            refuse("u", u)
            return None
        if u is None:
            if n == 0:
                return None  # nothing leads to the first observation
            names = listed(self.system.form.inputs)
            raise ParameterError(f"u: missing; the model has the inputs {names}, known at all times")
        return told_step("u", u, self.system)

    def tables(self, onwards: Onwards) -> Any:
        """Return the tables of the step to the next observation."""
        assert onwards.past is not None  # something was observed
        u = np.empty(0) if onwards.u is None else onwards.u
        if u.size != (self.system.dim_u or 0):
            self.read(None, 1)
        assert onwards.spread is not None
        return self.system.driven_tables(onwards.past, onwards.spread, u)

    def after(self, onwards: Onwards, mixture: Mixture | None, y: FloatArray) -> Onwards:
        """Return what a filter goes on from after an observation (q,), NaN where missing.

        Parameters
        ----------
        onwards : Onwards
        mixture : Mixture or None
            What was known before.
        y : ndarray, shape (q,)
        """
        system = self.system
        if mixture is None or onwards.past is None:
            first, spread = first_expected(system, y)
            return Onwards(starting_past(first, system.features.n_past), None, spread)
        full, spread = expected(self._method, self.tables(onwards), mixture, y)
        return Onwards(np.concatenate([full[None], onwards.past[:-1]]), None, spread)

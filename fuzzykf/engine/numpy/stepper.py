"""What filters inherit ``step`` from: the NumPy twins of the compiled steppers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["BankStepper", "LinearStepper", "Stepper"]


class Stepper:
    """Owner of ``step`` and of the state of a switching filter.

    A subclass implements ``_step_any``, which takes any observation, and may call `_arm` to let
    a compiled stepper take over while observations are complete and tables constant.
    """

    _n: int  # observations taken, missing ones included
    _predicted: bool
    _belief: Any
    _before: Any  # belief and tables from which the latest observation was predicted
    _z: FloatArray | None
    _log_likelihood: float

    def step(self, z: ArrayLike | None) -> Any:
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray, shape (dim_x, 1)
            The new estimate ``x``.
        """
        return self._step_any(z)

    def _step_any(self, z: ArrayLike | None) -> Any:
        raise NotImplementedError

    def _arm(self, tables: Any, table: FloatArray, window: FloatArray, mass: FloatArray | None) -> bool:
        """Hand over state, window and the constant tables of all steps to come.

        Returns whether `step` will take complete observations by itself: never in NumPy.
        """
        return False


class LinearStepper:
    """Owner of ``step`` of a linear Kalman filter whose state is in plain attributes.

    A subclass implements ``_step_any``, which takes any observation, and ``_overrides``; its
    verbs offer their work to the engine first.
    """

    def step(self, z: ArrayLike | None) -> Any:
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray
            The new estimate ``x``, shape (dim_x, 1) or (dim_x,).
        """
        return self._step_any(z)

    def _step_any(self, z: ArrayLike | None) -> Any:
        raise NotImplementedError

    def _predict_at_once(self) -> bool:
        """Predict if all attributes are usual, and say whether that was done: never in NumPy."""
        return False

    def _update_at_once(self, z: ArrayLike | None) -> bool:
        """Update if ``z`` is complete and all attributes are usual, and say whether that was done."""
        return False

    @classmethod
    def _overrides(cls) -> int:
        """Say what a subclass has changed: bit 0 what the verbs call or read, bit 1 the verbs."""
        raise NotImplementedError


class BankStepper(LinearStepper):
    """Owner of ``step`` of a bank of filters, whose state is in plain attributes of all of them."""

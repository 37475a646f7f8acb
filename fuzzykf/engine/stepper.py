"""The state of a switching filter, as plain attributes: the NumPy twin of the compiled stepper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray

__all__ = ["Stepper"]


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

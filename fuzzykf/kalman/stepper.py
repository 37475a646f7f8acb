"""What Kalman filters inherit ``step`` from, where the core is compiled in a version of its own.

As in `fuzzykf.switching.filters.stepper`, a step is so short that a wrapper around it would cost
as much, so the classes that own it come in two versions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import engine

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, Numbers

__all__ = ["BankStepper", "LinearStepper"]

if TYPE_CHECKING or engine.info().name == "numpy":

    class LinearStepper:
        """Owner of ``step`` of a linear Kalman filter whose state is in plain attributes.

        A subclass implements ``_step_any``, which takes any observation, and ``_overrides``; its
        verbs offer their work to the stepper first.
        """

        def step(self, z: Numbers) -> FloatArray:
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

        def _step_any(self, z: Numbers) -> FloatArray:
            raise NotImplementedError

        def _predict_at_once(self) -> bool:
            """Predict if all attributes are usual, and say whether that was done: never in NumPy."""
            return False

        def _update_at_once(self, z: Numbers) -> bool:
            """Update if ``z`` is complete and all attributes are usual, and say whether that was done."""
            return False

        @classmethod
        def _overrides(cls) -> int:
            """Say what a subclass has changed: bit 0 what the verbs call or read, bit 1 the verbs."""
            raise NotImplementedError

    class BankStepper(LinearStepper):
        """Owner of ``step`` of a bank of filters, whose state is in plain attributes of all of them."""

else:
    from fuzzykf.kalman.compiled_stepper import BankStepper, LinearStepper

"""The state of a switching filter and, where the core is compiled, its streaming step.

The one place beside the engine that asks which engine is in use: a step is so short that a
wrapper around it would cost as much, so the class that owns it comes in two versions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import engine

__all__ = ["STREAMS", "Stepper"]

#: Whether `Stepper` has a ``step`` of its own, which takes observations in the engine.
STREAMS = engine.info().name == "compiled"

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.inference.mixture import Mixture, Source

if TYPE_CHECKING or not STREAMS:

    class Stepper:
        """Owner of the state of a switching filter.

        A subclass implements ``_step_any``, which takes any observation, and may call `_arm` to
        let a compiled stepper take over while tables are constant: it then has a ``step`` that goes
        through the compiled core alone, in gaps as well.
        """

        _n: int  # observations taken, missing ones included
        _predicted: bool
        _mixture: Mixture | None
        _before: Source | None  # from which the latest observation was predicted
        _z: FloatArray
        _log_likelihood: float

        def _arm(self, tables: PairTables, known: Mixture, every_pair: bool) -> bool:
            """Hand over the state and the constant tables of all steps to come.

            On nodes, whose tables are of another kind, ``every_pair`` says that it is GPB2.

            Returns whether `step` will take observations by itself: never in NumPy.
            """
            return False

else:
    from fuzzykf.switching.filters.compiled_stepper import Stepper

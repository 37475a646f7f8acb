"""The kernels and steppers that are in use, compiled or in NumPy.

This is the one place that binds them; `fuzzykf.engine.info` says which they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import engine

#: Whether the engine summarises whole series by itself (`Summary`, `filter_series`).  NumPy
#: summarises a series after it has been filtered, in `fuzzykf.switching.series`.
SUMMARISES = engine.info().name == "compiled"

if TYPE_CHECKING or SUMMARISES:  # the signatures are the same
    from fuzzykf.engine.compiled.kalman import LinearStepper
    from fuzzykf.engine.compiled.series import filter_series
    from fuzzykf.engine.compiled.stepper import Stepper
    from fuzzykf.engine.compiled.switching import (
        first_step,
        forward_backward,
        log_pairs,
        node_mean,
        run,
        step,
        step_many,
    )
    from fuzzykf.engine.compiled.tables import Kernel, Summary, pack
else:
    from fuzzykf.engine.hmm import forward_backward
    from fuzzykf.engine.stepper import LinearStepper, Stepper
    from fuzzykf.engine.switching import Kernel, first_step, log_pairs, node_mean, pack, run, step
    from fuzzykf.engine.switching_many import step_many

__all__ = [
    "SUMMARISES",
    "Kernel",
    "LinearStepper",
    "Stepper",
    "first_step",
    "forward_backward",
    "log_pairs",
    "node_mean",
    "pack",
    "run",
    "step",
    "step_many",
]

if SUMMARISES:
    __all__ += ["Summary", "filter_series"]

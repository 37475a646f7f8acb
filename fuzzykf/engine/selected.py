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
    from fuzzykf.engine.compiled.imm import BankStepper, filter_bank
    from fuzzykf.engine.compiled.kalman import LARGEST as LARGEST_LINEAR
    from fuzzykf.engine.compiled.kalman import LinearStepper, filter_linear, predict_linear, update_linear
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
    from fuzzykf.engine.imm import filter_bank
    from fuzzykf.engine.kalman import predict_linear, update_linear
    from fuzzykf.engine.kalman_series import filter_linear
    from fuzzykf.engine.stepper import BankStepper, LinearStepper, Stepper
    from fuzzykf.engine.switching import Kernel, first_step, log_pairs, node_mean, pack, run, step
    from fuzzykf.engine.switching_many import step_many

    LARGEST_LINEAR = 0  # NumPy has no bound

__all__ = [
    "LARGEST_LINEAR",
    "SUMMARISES",
    "BankStepper",
    "Kernel",
    "LinearStepper",
    "Stepper",
    "filter_bank",
    "filter_linear",
    "first_step",
    "forward_backward",
    "log_pairs",
    "node_mean",
    "pack",
    "predict_linear",
    "run",
    "step",
    "step_many",
    "update_linear",
]

if SUMMARISES:
    __all__ += ["Summary", "filter_series"]

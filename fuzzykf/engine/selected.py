"""The kernels of the switching recursion that are in use, compiled or in NumPy.

This is the one place that binds them; `fuzzykf.engine.info` says which they are.
"""

from __future__ import annotations

from fuzzykf import engine

if engine.info().name == "compiled":
    from fuzzykf.engine._core import (
        Kernel,
        Stepper,
        Summary,
        filter_series,
        first_step,
        forward_backward,
        log_pairs,
        node_mean,
        pack,
        run,
        step,
        step_many,
    )
else:
    from fuzzykf.engine.hmm import forward_backward
    from fuzzykf.engine.stepper import Stepper
    from fuzzykf.engine.switching import Kernel, first_step, log_pairs, node_mean, pack, run, step
    from fuzzykf.engine.switching_many import step_many

    #: NumPy summarises a series after it has been filtered, in `fuzzykf.switching.series`.
    Summary = filter_series = None

__all__ = [
    "Kernel",
    "Stepper",
    "Summary",
    "filter_series",
    "first_step",
    "forward_backward",
    "log_pairs",
    "node_mean",
    "pack",
    "run",
    "step",
    "step_many",
]

"""The kernels and steppers that are in use, compiled or in NumPy.

This is the one place that binds them; `fuzzykf.engine.info` says which they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import engine

#: Whether the engine summarises whole series by itself (`Summary`, `filter_series`).  NumPy
#: summarises a series after it has been filtered, in `fuzzykf.switching.inference.series`.
SUMMARISES = engine.info().name == "compiled"

#: Convolutions of up to so many sums in all try every source: NumPy does that faster than anything else.
BRUTE_FORCE = 0 if SUMMARISES else 4_000_000

if TYPE_CHECKING or SUMMARISES:  # the signatures are the same
    from fuzzykf.engine.compiled.backward import best_path, smooth_back
    from fuzzykf.engine.compiled.convolution import convolve_parabola, refine
    from fuzzykf.engine.compiled.grid import (
        continue_tails,
        interpolate,
        interpolate_lines,
        least_outside,
        pull_back,
    )
    from fuzzykf.engine.compiled.imm import BankStepper, filter_bank
    from fuzzykf.engine.compiled.kalman import LARGEST as LARGEST_LINEAR
    from fuzzykf.engine.compiled.kalman import LinearStepper, filter_linear, predict_linear, update_linear
    from fuzzykf.engine.compiled.kernels import (
        convolve_bounded,
        convolve_convex,
        convolve_joint,
        convolve_table,
        is_convex,
        totals,
    )
    from fuzzykf.engine.compiled.moments import moments_about
    from fuzzykf.engine.compiled.raster import corrected, cover, flat_cells, live_cells, span, stranded
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
    from fuzzykf.engine.numpy.backward import best_path, smooth_back
    from fuzzykf.engine.numpy.convolution import convolve_parabola, refine
    from fuzzykf.engine.numpy.grid import (
        continue_tails,
        interpolate,
        interpolate_lines,
        least_outside,
        pull_back,
    )
    from fuzzykf.engine.numpy.hmm import forward_backward
    from fuzzykf.engine.numpy.imm import filter_bank
    from fuzzykf.engine.numpy.kalman import predict_linear, update_linear
    from fuzzykf.engine.numpy.kalman_series import filter_linear
    from fuzzykf.engine.numpy.kernels import (
        convolve_bounded,
        convolve_convex,
        convolve_joint,
        convolve_table,
        is_convex,
        totals,
    )
    from fuzzykf.engine.numpy.moments import moments_about
    from fuzzykf.engine.numpy.raster import corrected, cover, flat_cells, live_cells, span, stranded
    from fuzzykf.engine.numpy.stepper import BankStepper, LinearStepper, Stepper
    from fuzzykf.engine.numpy.switching import Kernel, first_step, log_pairs, node_mean, pack, run, step
    from fuzzykf.engine.numpy.switching_many import step_many

    LARGEST_LINEAR = 0  # NumPy has no bound

__all__ = [
    "BRUTE_FORCE",
    "LARGEST_LINEAR",
    "SUMMARISES",
    "BankStepper",
    "Kernel",
    "LinearStepper",
    "Stepper",
    "best_path",
    "continue_tails",
    "convolve_bounded",
    "convolve_convex",
    "convolve_joint",
    "convolve_parabola",
    "convolve_table",
    "corrected",
    "cover",
    "filter_bank",
    "filter_linear",
    "first_step",
    "flat_cells",
    "forward_backward",
    "interpolate",
    "interpolate_lines",
    "is_convex",
    "least_outside",
    "live_cells",
    "log_pairs",
    "moments_about",
    "node_mean",
    "pack",
    "predict_linear",
    "pull_back",
    "refine",
    "run",
    "smooth_back",
    "span",
    "step",
    "step_many",
    "stranded",
    "totals",
    "update_linear",
]

if SUMMARISES:
    __all__ += ["Summary", "filter_series"]

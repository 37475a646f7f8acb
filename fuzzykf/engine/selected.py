"""The kernels and steppers that are in use, compiled or in NumPy.

This is the one place that binds them; `fuzzykf.engine.info` says which they are.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

import numpy as np

from fuzzykf import engine

# what exists in NumPy only
from fuzzykf.engine.numpy.grid import CUT, sharpness, subgrid_minimum
from fuzzykf.engine.numpy.imm import correct_bank, log_mixing, move_bank
from fuzzykf.engine.numpy.imm import filter_many as filter_bank_many
from fuzzykf.engine.numpy.imm import merge as merge_modes
from fuzzykf.engine.numpy.imm import mix as mix_modes
from fuzzykf.engine.numpy.imm import weigh as weigh_modes
from fuzzykf.engine.numpy.kalman import (
    inverse,
    inverse_seen,
    log_normal,
    predict_stack,
    seen_components,
    update_correlated,
)
from fuzzykf.engine.numpy.kalman import update as update_residual
from fuzzykf.engine.numpy.kalman_series import filter_many as filter_linear_many
from fuzzykf.engine.numpy.kalman_series import rts_gains
from fuzzykf.engine.numpy.kalman_series import smooth as smooth_linear
from fuzzykf.engine.numpy.raster import samples, tangents
from fuzzykf.engine.numpy.scales import Scale, from_membership, scaled, to_membership

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, IntArray

_P = ParamSpec("_P")
_T = TypeVar("_T")

#: Whether the engine summarises whole series by itself (`Summary`, `filter_series`).  NumPy
#: summarises a series after it has been filtered, in `fuzzykf.switching.inference.series`.
SUMMARISES = engine.info().name == "compiled"

#: Convolutions of up to so many sums in all try every source: NumPy does that faster than anything else.
BRUTE_FORCE = 0 if SUMMARISES else 4_000_000


def _up_to(
    largest: int, compiled: Callable[_P, _T], any_size: Callable[..., _T], first: int, second: int
) -> Callable[_P, _T]:
    """Return a compiled kernel that hands larger systems to its NumPy twin.

    Its arguments are given by position; ``first`` and ``second`` are those of matrices that have
    a row for each state, and for each component of an observation.
    """
    fast: Callable[..., _T] = compiled

    @wraps(compiled)
    def kernel(*arguments: Any) -> _T:
        if len(arguments[first]) <= largest >= len(arguments[second]):
            return fast(*arguments)
        return any_size(*arguments)

    return cast("Callable[_P, _T]", kernel)


if TYPE_CHECKING or SUMMARISES:  # the signatures are the same
    from fuzzykf.engine.compiled import imm as compiled_imm
    from fuzzykf.engine.compiled import kalman as compiled_kalman
    from fuzzykf.engine.compiled.backward import best_path, smooth_back
    from fuzzykf.engine.compiled.convolution import convolve_parabola, refine
    from fuzzykf.engine.compiled.grid import (
        continue_tails,
        interpolate,
        interpolate_lines,
        least_outside,
        pull_back,
    )
    from fuzzykf.engine.compiled.imm import BankStepper
    from fuzzykf.engine.compiled.kalman import LinearStepper
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
    from fuzzykf.engine.numpy import imm, kalman, kalman_series

    largest = compiled_kalman.LARGEST
    predict_linear = _up_to(largest, compiled_kalman.predict_linear, kalman.predict_linear, 1, 1)
    update_linear = _up_to(largest, compiled_kalman.update_linear, kalman.update_linear, 1, 4)
    filter_linear = _up_to(largest, compiled_kalman.filter_linear, kalman_series.filter_linear, 1, 6)

    @wraps(compiled_imm.filter_bank)
    def filter_bank(xs: Any, Ps: Any, log_mu: Any, log_M: Any, zs: Any, *more: Any) -> Any:
        """See `fuzzykf.engine.numpy.imm.filter_bank`."""
        twin: Any = compiled_imm if max(xs.shape[1], zs.shape[1]) <= largest else imm
        return twin.filter_bank(xs, Ps, log_mu, log_M, zs, *more)

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


def best_sources(cost: FloatArray, table: FloatArray, combine: np.ufunc) -> IntArray:
    """Best source of each target, found in the way that is fastest for this engine, size and kernel.

    Parameters and result are those of `convolve_table`.
    """
    if cost.shape[0] * table.size <= BRUTE_FORCE:
        return convolve_table(cost, table, combine)
    if combine is np.add and is_convex(table):
        return convolve_convex(cost, table)
    return convolve_bounded(cost, table, combine)


__all__ = [
    "CUT",
    "SUMMARISES",
    "BankStepper",
    "Kernel",
    "LinearStepper",
    "Scale",
    "Stepper",
    "best_path",
    "best_sources",
    "continue_tails",
    "convolve_bounded",
    "convolve_convex",
    "convolve_joint",
    "convolve_parabola",
    "convolve_table",
    "correct_bank",
    "corrected",
    "cover",
    "filter_bank",
    "filter_bank_many",
    "filter_linear",
    "filter_linear_many",
    "first_step",
    "flat_cells",
    "forward_backward",
    "from_membership",
    "interpolate",
    "interpolate_lines",
    "inverse",
    "inverse_seen",
    "is_convex",
    "least_outside",
    "live_cells",
    "log_mixing",
    "log_normal",
    "log_pairs",
    "merge_modes",
    "mix_modes",
    "moments_about",
    "move_bank",
    "node_mean",
    "pack",
    "predict_linear",
    "predict_stack",
    "pull_back",
    "refine",
    "rts_gains",
    "run",
    "samples",
    "scaled",
    "seen_components",
    "sharpness",
    "smooth_back",
    "smooth_linear",
    "span",
    "step",
    "step_many",
    "stranded",
    "subgrid_minimum",
    "tangents",
    "to_membership",
    "totals",
    "update_correlated",
    "update_linear",
    "update_residual",
    "weigh_modes",
]

if SUMMARISES:
    __all__ += ["Summary", "filter_series"]

"""The kernels that are in use, compiled or in NumPy.

This is the one place that binds them; `fuzzykf.engine.info` says which they are.  Names are
those of the NumPy kernels; what the compiled core has as well takes their place.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf import engine
from fuzzykf.engine.numpy.backward import *
from fuzzykf.engine.numpy.convolution import *
from fuzzykf.engine.numpy.gap_backward import *
from fuzzykf.engine.numpy.gap_series import *
from fuzzykf.engine.numpy.gaps import *
from fuzzykf.engine.numpy.grid import *
from fuzzykf.engine.numpy.hidden_markov import *
from fuzzykf.engine.numpy.imm import *
from fuzzykf.engine.numpy.kalman import *
from fuzzykf.engine.numpy.kalman_series import *
from fuzzykf.engine.numpy.kernels import *
from fuzzykf.engine.numpy.known_paths import *
from fuzzykf.engine.numpy.nodes import *
from fuzzykf.engine.numpy.nodes_backward import *
from fuzzykf.engine.numpy.nodes_gradient import *
from fuzzykf.engine.numpy.outliers import *
from fuzzykf.engine.numpy.raster import *
from fuzzykf.engine.numpy.series import *
from fuzzykf.engine.numpy.slots import *
from fuzzykf.engine.numpy.state_score import *
from fuzzykf.engine.numpy.switching import *
from fuzzykf.engine.numpy.tables import *

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

#: Kernels that are compiled for systems up to a size: which arguments have a column for each
#: state, and for each component of an observation.
_SIZED = {
    "predict_linear": (1, 1),
    "update_linear": (1, 4),
    "filter_linear": (1, 6),
    "filter_linear_many": (1, 6),
    "filter_bank": (1, 4),
    "filter_bank_many": (1, 4),
}

#: Kernels that are given what `pack_nodes` returns, which of a system of any size is not compiled.
_PACKED = (
    *("before_node_step", "filter_nodes", "first_node_step"),
    *("node_gradient", "node_step", "smooth_nodes"),
)


#: Kernels that are given what `pack_gaps` returns: not compiled for negative weights and large systems.
_GAPS = ("back_into_gap", "filter_gappy", "step_in_part")


def _up_to(largest: int, compiled: Any, any_size: Any, first: int, second: int) -> Any:
    """Return a compiled kernel that hands larger systems to its NumPy twin; arguments go by position."""

    @wraps(compiled)
    def kernel(*arguments: Any) -> Any:
        if arguments[first].shape[-1] <= largest >= arguments[second].shape[-1]:
            return compiled(*arguments)
        return any_size(*arguments)

    return kernel


def _of_own(own: type, compiled: Any, any_size: Any) -> Any:
    """Return a kernel that is the compiled one where its first argument is."""

    @wraps(compiled)
    def kernel(*arguments: Any) -> Any:
        return (compiled if type(arguments[0]) is own else any_size)(*arguments)

    return kernel


def _pack_up_to(largest: int, compiled: Any, any_size: Any) -> Any:
    """Return `pack_nodes` for systems of any size."""

    @wraps(compiled)
    def pack(space: NodeSpace, log_transition: FloatArray) -> Any:
        chosen = compiled if space.H.shape[-1] <= largest >= space.H.shape[-2] else any_size
        return chosen(space, log_transition)

    return pack


def _pack_gaps_up_to(largest: int, compiled: Any, any_size: Any) -> Any:
    """Return `pack_gaps` for systems of any size, and for negative weights."""

    @wraps(compiled)
    def pack(step: SlotPairs, noise: FloatArray, M1: int) -> Any:
        m, w = step.pairs[1].shape[-2:]
        fits = m + w + step.pairs[6].shape[-1] <= largest and not (step.transition < 0.0).any()
        return (compiled if fits else any_size)(step, noise, M1)

    return pack


def _take_over(names: dict[str, Any]) -> None:
    """Put the compiled kernels in the place of their twins."""
    from fuzzykf.engine.compiled import MODULES

    for module in MODULES.values():
        for name in getattr(module, "__all__", ()):
            kernel = getattr(module, name)
            if name in _SIZED:
                kernel = _up_to(MODULES["kalman"].LARGEST, kernel, names[name], *_SIZED[name])
            elif name in _PACKED:
                kernel = _of_own(MODULES["nodes"].NodeKernel, kernel, names[name])
            elif name in _GAPS:
                kernel = _of_own(MODULES["gaps"].GapTables, kernel, names[name])
            elif name == "pack_gaps":
                kernel = _pack_gaps_up_to(module.LARGEST, kernel, names[name])
            elif name == "pack_nodes":
                kernel = _pack_up_to(module.LARGEST, kernel, names[name])
            names[name] = kernel


#: Convolutions of up to so many sums in all try every source: NumPy does that faster than anything else.
BRUTE_FORCE = 4_000_000

#: So do those of so few lines: to look through the table first, for what helps every line, takes as long.
FEW_LINES = 0

if engine.info().name == "compiled":
    BRUTE_FORCE, FEW_LINES = 0, 2
    _take_over(globals())


def best_sources(cost: FloatArray, table: FloatArray, combine: np.ufunc) -> IntArray:
    """Best source of each target, found in the way that is fastest for this engine, size and kernel.

    Parameters and result are those of `convolve_table`.
    """
    if cost.shape[0] <= FEW_LINES or cost.shape[0] * table.size <= BRUTE_FORCE:
        return convolve_table(cost, table, combine)
    if combine is np.add and is_convex(table):
        return convolve_convex(cost, table)
    return convolve_bounded(cost, table, combine)

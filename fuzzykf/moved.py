"""Where things stood before, so that code which names an old place goes on working.

An import of an old module path gives the module of today, and one DeprecationWarning a
process.  Nothing inside fuzzykf uses an old path.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

__all__ = ["MODULES", "NAMES", "install", "lookup"]

#: Old module path: the module that holds its names today.
MODULES = {
    "fuzzykf._progress": "fuzzykf.progress",
    "fuzzykf.comparison.linear": "fuzzykf.comparison.candidates.linear",
    "fuzzykf.comparison.methods": "fuzzykf.comparison.run",
    "fuzzykf.comparison.regression": "fuzzykf.comparison.candidates.regression",
    "fuzzykf.comparison.rolling": "fuzzykf.comparison.evaluation",
    "fuzzykf.comparison.switching": "fuzzykf.comparison.candidates.switching",
    "fuzzykf.engine.backward": "fuzzykf.engine.numpy.backward",
    "fuzzykf.engine.convolution": "fuzzykf.engine.numpy.convolution",
    "fuzzykf.engine.grid": "fuzzykf.engine.numpy.grid",
    "fuzzykf.engine.hmm": "fuzzykf.engine.numpy.hmm",
    "fuzzykf.engine.imm": "fuzzykf.engine.numpy.imm",
    "fuzzykf.engine.kalman": "fuzzykf.engine.numpy.kalman",
    "fuzzykf.engine.kalman_series": "fuzzykf.engine.numpy.kalman_series",
    "fuzzykf.engine.kernels": "fuzzykf.engine.numpy.kernels",
    "fuzzykf.engine.moments": "fuzzykf.engine.numpy.moments",
    "fuzzykf.engine.raster": "fuzzykf.engine.numpy.raster",
    "fuzzykf.engine.scales": "fuzzykf.engine.numpy.scales",
    "fuzzykf.engine.stepper": "fuzzykf.engine.numpy.stepper",
    "fuzzykf.engine.switching": "fuzzykf.engine.numpy.switching",
    "fuzzykf.engine.switching_many": "fuzzykf.engine.numpy.switching_many",
    "fuzzykf.model_choice": "fuzzykf.comparison.models",
    "fuzzykf.plotting.comparison": "fuzzykf.comparison.picture",
    "fuzzykf.possibility.attributes": "fuzzykf.possibility.estimator",
    "fuzzykf.possibility.boxes": "fuzzykf.possibility.intervals.boxes",
    "fuzzykf.possibility.choice": "fuzzykf.possibility.representation",
    "fuzzykf.possibility.conditioning": "fuzzykf.possibility.grid.conditioning",
    "fuzzykf.possibility.landing": "fuzzykf.possibility.grid.warp",
    "fuzzykf.possibility.lattice": "fuzzykf.possibility.grid.lattice",
    "fuzzykf.possibility.meeting": "fuzzykf.possibility.grid.meeting",
    "fuzzykf.possibility.noise": "fuzzykf.possibility.grid.noise",
    "fuzzykf.possibility.propagation": "fuzzykf.possibility.grid.propagation",
    "fuzzykf.possibility.scalar": "fuzzykf.possibility.grid.scalar",
    "fuzzykf.possibility.warp": "fuzzykf.possibility.grid.warp",
    "fuzzykf.switching.belief": "fuzzykf.switching.inference.belief",
    "fuzzykf.switching.cglssm": "fuzzykf.switching.state_space.cglssm",
    "fuzzykf.switching.chain": "fuzzykf.switching.laws.chain",
    "fuzzykf.switching.closeness": "fuzzykf.switching.state_space.closeness",
    "fuzzykf.switching.conversion": "fuzzykf.switching.state_space.conversion",
    "fuzzykf.switching.converted": "fuzzykf.switching.state_space.converted",
    "fuzzykf.switching.filter_base": "fuzzykf.switching.filters.switching_filter",
    "fuzzykf.switching.forecast": "fuzzykf.switching.inference.forecast",
    "fuzzykf.switching.form_checks": "fuzzykf.switching.dynamics.form_checks",
    "fuzzykf.switching.forms": "fuzzykf.switching.dynamics.forms",
    "fuzzykf.switching.fuzzy_model": "fuzzykf.switching.models.fuzzy",
    "fuzzykf.switching.gap_smoother": "fuzzykf.switching.inference.gap_smoother",
    "fuzzykf.switching.hard_model": "fuzzykf.switching.models.hard",
    "fuzzykf.switching.integration": "fuzzykf.switching.laws.integration",
    "fuzzykf.switching.interpolation": "fuzzykf.switching.dynamics.interpolation",
    "fuzzykf.switching.known_switch": "fuzzykf.switching.filters.known_switch",
    "fuzzykf.switching.law_cells": "fuzzykf.switching.laws.cells",
    "fuzzykf.switching.law_families": "fuzzykf.switching.laws",
    "fuzzykf.switching.learning.result": "fuzzykf.results",
    "fuzzykf.switching.many": "fuzzykf.switching.inference.many",
    "fuzzykf.switching.missing": "fuzzykf.switching.inference.missing",
    "fuzzykf.switching.model_base": "fuzzykf.switching.models.base",
    "fuzzykf.switching.quadrature": "fuzzykf.switching.laws.quadrature",
    "fuzzykf.switching.readings": "fuzzykf.switching.filters.switching_filter",
    "fuzzykf.switching.recursion": "fuzzykf.switching.inference.recursion",
    "fuzzykf.switching.repair": "fuzzykf.switching.models.repair",
    "fuzzykf.switching.series": "fuzzykf.switching.inference.series",
    "fuzzykf.switching.simulation": "fuzzykf.switching.dynamics.simulation",
    "fuzzykf.switching.smoother": "fuzzykf.switching.inference.smoother",
    "fuzzykf.switching.steady": "fuzzykf.switching.inference.steady",
    "fuzzykf.switching.systems": "fuzzykf.switching.dynamics.placed",
    "fuzzykf.switching.tables": "fuzzykf.switching.dynamics.pairs",
    "fuzzykf.switching.values": "fuzzykf.immutable",
}

#: Module: its names that stand in a higher module today.
NAMES = {
    "fuzzykf.plotting": {"plot_comparison": "fuzzykf.comparison.picture"},
}


class _OldPaths(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds old module paths; asked last, so that it costs nothing where none is used."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Know the old paths, and nothing else."""
        return importlib.machinery.ModuleSpec(fullname, self) if fullname in MODULES else None

    def exec_module(self, module: ModuleType) -> None:
        """Let a module of the old name answer with what stands in that of today."""
        new = MODULES[module.__name__]
        _warn(module.__name__, new, 2)
        today = importlib.import_module(new)
        vars(module).update(__doc__=today.__doc__, __getattr__=lambda name: getattr(today, name))


def install() -> None:
    """Let old module paths be imported."""
    if not any(isinstance(finder, _OldPaths) for finder in sys.meta_path):
        sys.meta_path.append(_OldPaths())


def lookup(module: str, name: str) -> object:
    """Return a name that has moved up from ``module``; for a module's ``__getattr__``."""
    new = NAMES.get(module, {}).get(name)
    if new is None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    _warn(f"{module}.{name}", f"{new}.{name}", 3)  # who asked the module for the name
    value: object = getattr(importlib.import_module(new), name)
    setattr(sys.modules[module], name, value)  # so that it warns once
    return value


def _warn(old: str, new: str, level: int) -> None:
    warnings.warn(f"{old} has moved to {new}", DeprecationWarning, stacklevel=level + 1)

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

#: Folders of today, and the modules in them that stood one folder above.
_FOLDERS = {
    "fuzzykf.comparison.candidates": "linear regression switching",
    "fuzzykf.engine.numpy": "backward convolution grid imm kalman kalman_series kernels raster switching",
    "fuzzykf.possibility.grid": "conditioning lattice meeting noise scalar warp",
    "fuzzykf.possibility.intervals": "boxes",
    "fuzzykf.switching.dynamics": "form_checks forms interpolation simulation",
    "fuzzykf.switching.filters": "known_switch",
    "fuzzykf.switching.inference": "forecast series smoother",
    "fuzzykf.switching.laws": "chain integration quadrature",
    "fuzzykf.switching.models": "repair",
    "fuzzykf.switching.state_space": "cglssm closeness conversion converted",
}

#: Old module path: the module that holds its names today.
MODULES = {
    **{
        f"{folder.rpartition('.')[0]}.{name}": f"{folder}.{name}"
        for folder, names in _FOLDERS.items()
        for name in names.split()
    },
    "fuzzykf._progress": "fuzzykf.progress",
    "fuzzykf.comparison.methods": "fuzzykf.comparison.run",
    "fuzzykf.comparison.rolling": "fuzzykf.comparison.evaluation",
    "fuzzykf.engine.hmm": "fuzzykf.engine.numpy.hidden_markov",
    "fuzzykf.engine.moments": "fuzzykf.engine.numpy.grid",
    "fuzzykf.engine.scales": "fuzzykf.engine.numpy.grid",
    "fuzzykf.engine.stepper": "fuzzykf.kalman.stepper",
    "fuzzykf.engine.switching_many": "fuzzykf.engine.numpy.series",
    "fuzzykf.kalman.overrides": "fuzzykf.overrides",
    "fuzzykf.switching.gap_smoother": "fuzzykf.engine.numpy.gap_backward",
    "fuzzykf.switching.inference.gap_smoother": "fuzzykf.engine.numpy.gap_backward",
    "fuzzykf.model_choice": "fuzzykf.comparison.models",
    "fuzzykf.plotting.comparison": "fuzzykf.comparison.picture",
    "fuzzykf.possibility.attributes": "fuzzykf.possibility.estimator",
    "fuzzykf.possibility.choice": "fuzzykf.possibility.representation",
    "fuzzykf.possibility.landing": "fuzzykf.possibility.grid.warp",
    "fuzzykf.possibility.propagation": "fuzzykf.possibility.grid.belief",
    "fuzzykf.switching.belief": "fuzzykf.switching.inference.mixture",
    "fuzzykf.switching.filter_base": "fuzzykf.switching.filters.switching_filter",
    "fuzzykf.switching.fuzzy_model": "fuzzykf.switching.models.fuzzy",
    "fuzzykf.switching.hard_model": "fuzzykf.switching.models.hard",
    "fuzzykf.switching.law_cells": "fuzzykf.switching.laws.cells",
    "fuzzykf.switching.law_families": "fuzzykf.switching.laws",
    "fuzzykf.switching.learning.chains": "fuzzykf.switching.laws.learners",
    "fuzzykf.switching.learning.result": "fuzzykf.results",
    "fuzzykf.switching.many": "fuzzykf.switching.inference.series",
    "fuzzykf.switching.missing": "fuzzykf.switching.inference.exact",
    "fuzzykf.switching.model_base": "fuzzykf.switching.models.base",
    "fuzzykf.switching.readings": "fuzzykf.switching.filters.switching_filter",
    "fuzzykf.switching.recursion": "fuzzykf.switching.inference.exact",
    "fuzzykf.switching.steady": "fuzzykf.switching.inference.series",
    "fuzzykf.switching.systems": "fuzzykf.switching.dynamics.placed",
    "fuzzykf.switching.tables": "fuzzykf.switching.dynamics.pairs",
    "fuzzykf.switching.values": "fuzzykf.immutable",
}

#: Module: its names that stand in a higher module today.
NAMES = {
    "fuzzykf.plotting": {"plot_comparison": "fuzzykf.comparison"},
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
        today = importlib.import_module(new)
        package = module.__name__.rpartition(".")[0]
        shared = set(getattr(today, "__all__", ())) & set(getattr(sys.modules[package], "__all__", ()))
        hint = f"; {', '.join(sorted(shared))} can be imported from {package}" if shared else ""
        _warn(module.__name__, new + hint, 2)
        sys.modules[module.__name__] = today  # which the import statement then returns


def install() -> None:
    """Let old module paths be imported."""
    if not any(isinstance(finder, _OldPaths) for finder in sys.meta_path):
        sys.meta_path.append(_OldPaths())


def lookup(module: str, name: str) -> object:
    """Return what has moved away from ``module``, a name or a module below it; for its ``__getattr__``."""
    old = f"{module}.{name}"
    if old in MODULES:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # that would name this line
            found = importlib.import_module(old)
        _warn(old, MODULES[old], 3)
        return found
    new = NAMES.get(module, {}).get(name)
    if new is None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    _warn(old, f"{new}.{name}", 3)  # who asked the module for the name
    value: object = getattr(importlib.import_module(new), name)
    setattr(sys.modules[module], name, value)  # so that it warns once
    return value


def _warn(old: str, new: str, level: int) -> None:
    warnings.warn(f"{old} has moved to {new}", DeprecationWarning, stacklevel=level + 1)

"""How much do switches help?  Filters side by side on a series whose state was measured.

A method is a `Candidate`: from a `LearningPart` it makes something `Learned`, which gives
`Estimates` of any later stretch.  `candidate` knows those of fuzzykf by name.

`compare_models` and `compare` judge candidates fold by fold; the second one those of the command line, on
a `Task`, into which `prepare` turns columns.  The command ``fuzzykf compare`` only reads, prints and writes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import moved
from fuzzykf.comparison.candidates import Candidate, Estimates, Learned, LearningPart, Restoration
from fuzzykf.comparison.candidates.registry import candidate, candidate_names
from fuzzykf.comparison.clock import Clock
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.comparison.evaluation import Fold, ModelComparison, ModelScore
from fuzzykf.comparison.models import compare_models
from fuzzykf.comparison.picture import plot_comparison
from fuzzykf.comparison.prepare import ClockSwitch, Task, prepare, quantile_switch
from fuzzykf.comparison.report import report_page
from fuzzykf.comparison.run import Comparison, compare, main_methods, score, worthwhile_jobs
from fuzzykf.comparison.scores import (
    Bootstrap,
    Score,
    block_length,
    bootstrap_rmse,
    circular_block_means,
)

__all__ = [
    "Bootstrap",
    "Candidate",
    "Clock",
    "ClockSwitch",
    "Comparison",
    "Estimates",
    "Fold",
    "Learned",
    "LearningPart",
    "ModelComparison",
    "ModelScore",
    "NormalMixture",
    "Restoration",
    "Score",
    "Task",
    "block_length",
    "bootstrap_rmse",
    "candidate",
    "candidate_names",
    "circular_block_means",
    "compare",
    "compare_models",
    "main_methods",
    "plot_comparison",
    "prepare",
    "quantile_switch",
    "report_page",
    "score",
    "worthwhile_jobs",
]

if not TYPE_CHECKING:  # to type checkers only what is listed is there

    def __getattr__(name: str) -> object:
        """Find what has moved."""
        return moved.lookup(__name__, name)

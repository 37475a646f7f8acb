"""How much do switches help?  Filters side by side on a series whose state was measured.

`prepare` turns columns into a `Task`: a part to learn on and a part in which
the methods see the observation alone.  `compare` runs the methods and scores
them.  The command ``fuzzykf compare`` only reads, prints and writes.

A method is a `Candidate`: from a `LearningPart` it makes something `Learned`, which gives
`Estimates` of any later stretch.  `fuzzykf.compare_models` takes the same candidates
to several held-out parts.
"""

from __future__ import annotations

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned, LearningPart
from fuzzykf.comparison.methods import Restoration, main_methods
from fuzzykf.comparison.models import compare_models
from fuzzykf.comparison.picture import plot_comparison
from fuzzykf.comparison.prepare import ClockSwitch, Task, prepare, quantile_switch
from fuzzykf.comparison.report import report_page
from fuzzykf.comparison.rolling import Fold, ModelComparison, ModelScore
from fuzzykf.comparison.run import Comparison, compare, score
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
    "ClockSwitch",
    "Comparison",
    "Estimates",
    "Fold",
    "Learned",
    "LearningPart",
    "ModelComparison",
    "ModelScore",
    "Restoration",
    "Score",
    "Task",
    "block_length",
    "bootstrap_rmse",
    "circular_block_means",
    "compare",
    "compare_models",
    "main_methods",
    "plot_comparison",
    "prepare",
    "quantile_switch",
    "report_page",
    "score",
]

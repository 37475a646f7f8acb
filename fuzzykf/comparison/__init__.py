"""How much do switches help?  Filters side by side on a series whose state was measured.

`prepare` turns columns into a `Task`: a part to learn on and a part in which
the methods see the observation alone.  `compare` runs the methods and scores
them.  The command ``fuzzykf compare`` only reads, prints and writes.
"""

from __future__ import annotations

from fuzzykf.comparison.methods import Restoration
from fuzzykf.comparison.prepare import ClockSwitch, DailyProfile, Task, prepare, quantile_switch
from fuzzykf.comparison.run import Comparison, compare, score
from fuzzykf.comparison.scores import Score, block_length, circular_block_means

__all__ = [
    "ClockSwitch",
    "Comparison",
    "DailyProfile",
    "Restoration",
    "Score",
    "Task",
    "block_length",
    "circular_block_means",
    "compare",
    "prepare",
    "quantile_switch",
    "score",
]

"""Switching models whose state does not depend on the one before: their filters cannot drift."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from fuzzykf.comparison.candidates import Candidate
from fuzzykf.comparison.candidates.switching import LearnedSwitching

if TYPE_CHECKING:
    from fuzzykf.comparison.candidates import Learned, LearningPart

__all__ = ["CANDIDATES", "learn_fuzzy_memoryless", "learn_hard_memoryless"]


def learn_hard_memoryless(part: LearningPart, n_regimes: int) -> Learned:
    """Learn a model of so many hard regimes, its Axx zero."""
    return LearnedSwitching(part.hard(n_regimes=n_regimes, state_feedback=False), part.n_nodes)


def learn_fuzzy_memoryless(part: LearningPart, law: str) -> Learned:
    """Learn a fuzzy model with a law of this family, its Axx zero."""
    return LearnedSwitching(part.fuzzy(law, state_feedback=False), part.n_nodes, f"law: {law}")


CANDIDATES = (
    Candidate(
        "hard2-memoryless",
        partial(learn_hard_memoryless, n_regimes=2),
        title="CGOMSMFilter, no memory of the state",
    ),
    Candidate(
        "fmc1-memoryless",
        partial(learn_fuzzy_memoryless, law="fmc1"),
        title="OFSRFilter, fmc1, no memory of the state",
    ),
)

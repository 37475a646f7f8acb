"""Switching models that are learned for what their filter says of the state."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from fuzzykf.comparison.candidates import Candidate
from fuzzykf.comparison.candidates.switching import LearnedSwitching

if TYPE_CHECKING:
    from fuzzykf.comparison.candidates import Learned, LearningPart
    from fuzzykf.results import FitResult

__all__ = ["CANDIDATES", "learn_fuzzy_for_filter", "learn_hard_for_filter", "training_told"]


def learn_hard_for_filter(part: LearningPart, n_regimes: int) -> Learned:
    """Learn a model of so many hard regimes for its filter."""
    fit = part.hard(n_regimes=n_regimes, objective="filter")
    return LearnedSwitching(fit, part.n_nodes, training_told(fit))


def learn_fuzzy_for_filter(part: LearningPart, law: str) -> Learned:
    """Learn a fuzzy model with a law of this family for its filter."""
    fit = part.fuzzy(law, objective="filter")
    return LearnedSwitching(fit, part.n_nodes, f"law {law}; {training_told(fit)}")


def training_told(fit: FitResult[Any]) -> str:
    """Say which fit was kept, and why."""
    training = fit.training
    assert training is not None  # it was asked for
    lead = training.score_filter - training.score_joint
    return (
        f"kept the {training.kept} fit (log score on the last fifth of the training rows: filter fit "
        f"{training.score_filter:.3g}, joint fit {training.score_joint:.3g}, difference {lead:.2g} ± "
        f"{training.standard_error:.2g})"
    )


CANDIDATES = (
    Candidate(
        "hard2-filter", partial(learn_hard_for_filter, n_regimes=2), title="CGOMSMFilter, filter-trained"
    ),
    Candidate("fmc1-filter", partial(learn_fuzzy_for_filter, law="fmc1"), title="OFSRFilter, filter-trained"),
)

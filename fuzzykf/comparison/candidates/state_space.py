"""Switching state-space models as candidates: one motion, and a sensor of several qualities."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import Candidate
from fuzzykf.comparison.candidates.switching import LearnedSwitching
from fuzzykf.switching.laws.fades import FadeLaw

if TYPE_CHECKING:
    from fuzzykf.comparison.candidates import Learned, LearningPart
    from fuzzykf.estimation.result import LikelihoodFit
    from fuzzykf.switching import SwitchingStateSpace

__all__ = ["CANDIDATES", "LearnedStateSpace", "fading_law", "hard_law", "learn_state_space"]

#: Steps at a class, and probability of a jump, from which a search begins.
STAY, JUMP = 40.0, 0.005


class LearnedStateSpace(LearnedSwitching):
    """A learned state-space model and its filter, IMM on the nodes.

    Unlike that of an exact filter, its error of the state is corrected by every observation.

    Parameters
    ----------
    fit : LikelihoodFit
    n_nodes : int, optional
        Nodes of a fuzzy switch; by default those of the model.
    notes : tuple of str
        Beside those of the fit.
    """

    feedback = True

    def __init__(
        self, fit: LikelihoodFit[SwitchingStateSpace], n_nodes: int | None, notes: tuple[str, ...] = ()
    ) -> None:
        self.fit, self.filter = fit, fit.model.filter(n_nodes)
        self.notes, self.description = (*notes, *fit.warnings), fit.model.describe_switch()


def fading_law(n_nodes: int) -> FadeLaw:
    """Return the law at which the search for fades begins, with room for so many nodes."""
    return FadeLaw.between(STAY, max(10.0, 2.0 * n_nodes), jump=JUMP)


def hard_law(n_regimes: int) -> list[list[float]]:
    """Return the transition probabilities at which the search for so many hard regimes begins."""
    leave = 1.0 / STAY if n_regimes > 1 else 0.0
    off = leave / max(n_regimes - 1, 1)
    table: list[list[float]] = (off + (1.0 - leave - off) * np.eye(n_regimes)).tolist()
    return table


def learn_state_space(part: LearningPart, n_regimes: int | None = None) -> Learned:
    """Learn a state-space model, with fades between two classes, or so many hard regimes.

    Raises
    ------
    FuzzykfError
        If there is none that could be learned.
    """
    from fuzzykf.switching.learning.state_space.start import learn_from_states

    law = fading_law(part.n_nodes) if n_regimes is None else hard_law(n_regimes)
    n_nodes = part.n_nodes if n_regimes is None else None
    fit = learn_from_states(part.x, part.y, law, n_nodes=n_nodes, max_iter=part.max_iter, progress=False)
    notes = () if part.r is None else ("the given switch was ignored; it was learned as hidden",)
    return LearnedStateSpace(fit, n_nodes, notes)


CANDIDATES = (
    Candidate("switching-ssm", learn_state_space, title="SwitchingKalmanFilter"),
    Candidate(
        "switching-ssm-hard",
        partial(learn_state_space, n_regimes=2),
        title="SwitchingKalmanFilter, K = 2",
    ),
)

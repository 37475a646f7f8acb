"""A pool of switching models that are learned in different ways, none of which has to be chosen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.candidates import WARM_UP, Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.filter_trained import learn_fuzzy_for_filter, learn_hard_for_filter
from fuzzykf.comparison.candidates.memoryless import learn_hard_memoryless
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.switching import FilterPool

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart

__all__ = ["CANDIDATES", "MEMBERS", "LearnedPool", "learn_pool"]

#: How the members learn, by the names of the candidates that they are.
MEMBERS: Mapping[str, Callable[[LearningPart], Any]] = {
    "hard2-filter": lambda part: learn_hard_for_filter(part, 2),
    "fmc1-filter": lambda part: learn_fuzzy_for_filter(part, "fmc1"),
    "hard2-memoryless": lambda part: learn_hard_memoryless(part, 2),
}


class LearnedPool(Learned):
    """Learned switching models and the pool of their filters, all of one weight.

    Densities are averaged, not parameters: the mean of two learned models is a model that nobody has learned,
    while the mean of their densities is what somebody believes who does not know which of the two is right.
    Its mean, standard deviation and density are those of the mixture.

    Parameters
    ----------
    members : mapping of str to LearnedSwitching

    Attributes
    ----------
    members : mapping of str to LearnedSwitching
    filter : FilterPool
    """

    def __init__(self, members: Mapping[str, Any]) -> None:
        self.members = members
        self.filter = FilterPool([one.filter for one in members.values()])
        self.notes = tuple(f"{name}: {note}" for name, one in members.items() for note in one.notes)
        self.description = "; ".join(
            f"{name}: {one.description}" if one.description else name for name, one in members.items()
        )

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Filter, beginning a little earlier; the density is the mixture of the nodes of all members."""
        warm = before[-WARM_UP:]
        result = self.filter.filter(np.concatenate([warm, zs]), keep_nodes=True)
        part = slice(len(warm), None)
        return Estimates(
            mean=result.x[part],
            std=np.sqrt(np.diagonal(result.P[part], axis1=-2, axis2=-1)),
            log_likelihood=result.log_likelihood[part],
            density=NormalMixture.of(result, part),
        )

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return the pool's ``step``."""
        step: Callable[[FloatArray], object] = self.filter.step
        return step


def learn_pool(part: LearningPart) -> Learned:
    """Learn the members one after another."""
    learned: dict[str, Any] = {}
    for name, learn in MEMBERS.items():
        if learned:
            part.progress(f"learning {name}, a member of the pool")
        learned[name] = learn(part)
    return LearnedPool(learned)


CANDIDATES = (Candidate("pool", learn_pool, pieces=len(MEMBERS), title="FilterPool"),)

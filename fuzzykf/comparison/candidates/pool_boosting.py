"""Half a pool of switching filters, half gradient boosting, mixed as densities."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.boosting import learn_boosting
from fuzzykf.comparison.candidates.inputs import MAPS, learn_pool_of_maps
from fuzzykf.comparison.density import NormalMixture

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Self

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart
    from fuzzykf.comparison.clock import Clock

__all__ = ["CANDIDATES", "LearnedMixture", "learn_pool_boosting"]


class LearnedMixture(Learned):
    """The mixture, with fixed weights, of what several methods say of the state.

    p(x_n) = sum over j of w_j p_j(x_n)

    Densities are averaged, and not parameters, of which filters and trees have none in common; nor means and
    standard deviations alone: where the methods disagree the mixture has two peaks, and says so.  The log
    score of the mixture is never below the weighted mean of those of its members (the logarithm is concave),
    and at most log 1/w_j below that of the best of them, so that nothing has to be chosen.

    Parameters
    ----------
    members : mapping of str to Learned
        By name.
    weights : sequence of float
        One for each member, positive and with the sum 1.

    Notes
    -----
    It has no law of the observation, for some members may have none.
    """

    def __init__(self, members: Mapping[str, Learned], weights: Sequence[float]) -> None:
        self.members, self.weights = dict(members), tuple(weights)
        self.notes = tuple(f"{name}: {note}" for name, one in members.items() for note in one.notes)
        self.description = "; ".join(
            f"{name}: {one.description or 'as it is'}" for name, one in members.items()
        )

    def at(self, clock: Clock | None) -> Self:
        """Return the same for rows of a clock, which each member is told."""
        other = copy(self)
        other.members = {name: one.at(clock) for name, one in self.members.items()}
        return other

    def told(self, inputs: FloatArray | None) -> Self:
        """Return the same for rows with inputs, which each member is told."""
        other = copy(self)
        other.members = {name: one.told(inputs) for name, one in self.members.items()}
        return other

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Mix what the members say."""
        parts = [one.restore(before, zs).as_mixture() for one in self.members.values()]
        density = NormalMixture.pooled(parts, self.weights)
        mean, std = density.moments()
        return Estimates(mean=mean, std=std, density=density)

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that takes a step of each member."""
        steps = [one.stepper() for one in self.members.values()]
        return lambda z: [step(z) for step in steps]


def learn_pool_boosting(part: LearningPart) -> Learned:
    """Learn the pool with inputs and boosting, as the candidates of their names, and mix them half and half.

    The filters know the dynamics and the regimes, the trees what is not linear; neither wins everywhere.

    Raises
    ------
    MissingDependencyError
        If scikit-learn is not installed.
    FuzzykfError
        If one of the two cannot be learned.
    """
    pool = learn_pool_of_maps(part)
    part.progress("learning boosting, half of the mixture")
    return LearnedMixture({"pool-inputs": pool, "boosting": learn_boosting(part)}, (0.5, 0.5))


CANDIDATES = (
    Candidate(
        "pool-boosting",
        learn_pool_boosting,
        pieces=len(MAPS) + 1,
        title="FilterPool and gradient boosting",
    ),
)

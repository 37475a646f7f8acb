"""What an estimator did along a series, kept for the way back.

While it is tracked, an estimator holds a `Tracked` belief: it does what the belief does, and each
prediction, update or restart of it becomes a `Node`, which knows the one before it.  So the way back
follows what the verbs did, whoever wrote them: two predictions between observations, noise that changes,
measurements that were left out.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.protocol import Belief, Outcome

__all__ = ["Node", "Tracked", "Trail"]


@dataclass(eq=False)
class Node:
    """A belief and how it came from the one before.

    Attributes
    ----------
    verb : {"start", "predict", "update", "restart"}
    belief : Belief
    before : Node or None
        None at the start.
    mapping, noise, z
        What the verb was given.
    """

    verb: Literal["start", "predict", "update", "restart"]
    belief: Any
    before: Node | None = None
    mapping: Any = None
    noise: Any = None
    z: Any = None


@dataclass(frozen=True, eq=False)
class Tracked:
    """A belief that knows its node, and makes the next ones.

    Attributes
    ----------
    belief : Belief
    node : Node
    copies : bool
        Whether noises are to be copied, since users may edit their matrices in place.
    """

    belief: Belief
    node: Node
    copies: bool

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """See `Belief`, as for all that follows."""
        return self.belief.moments()

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds (d,) of the possible states."""
        return self.belief.bounds()

    def as_membership(self) -> Membership:
        """Membership of the state."""
        return self.belief.as_membership()

    def mean_of_maximum(self) -> FloatArray:
        """Mean (d,) of the likeliest states."""
        return self.belief.mean_of_maximum()

    def peak(self) -> FloatArray:
        """Likeliest state (d,)."""
        return self.belief.peak()

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Image under the map, spread by the noise."""
        outcome = self.belief.predict(move, noise)
        return self._next(outcome, Node("predict", outcome.belief, self.node, move, self._kept(noise)))

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Combine with a measurement; where they exclude each other nothing is added to the trail."""
        outcome = self.belief.update(measure, noise, z)
        return self._next(outcome, Node("update", outcome.belief, self.node, measure, self._kept(noise), z))

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> Tracked | None:
        """Return what the measurement alone says; None if that is not enough."""
        belief = self.belief.restart(measure, noise, z)
        if belief is None:
            return None
        node = Node("restart", belief, self.node, measure, self._kept(noise), z)
        return Tracked(belief, node, self.copies)

    def _kept(self, noise: Membership) -> Membership:
        return deepcopy(noise) if self.copies else noise

    def _next(self, outcome: Outcome, node: Node) -> Outcome:
        if outcome.belief is None:
            return outcome
        return replace(outcome, belief=Tracked(outcome.belief, node, self.copies))


class Trail:
    """The nodes at which the steps of a series ended.

    Parameters
    ----------
    est : FuzzyRelationEstimator
        It is tracked from now on.
    copies : bool
        See `Tracked`.
    """

    def __init__(self, est: Any, *, copies: bool) -> None:
        self.est = est
        self.ends: list[Node] = []
        belief = est._belief
        est._belief = Tracked(belief, Node("start", belief), copies)

    def note(self) -> None:
        """Keep where the estimator stands, after a step.

        Raises
        ------
        ParameterError
            If a verb of somebody else assigned the membership, so that nothing leads back from it.
        """
        tracked = self.est._belief
        if not isinstance(tracked, Tracked):
            raise self.broken(len(self.ends))
        self.ends.append(tracked.node)

    def nodes(self) -> list[Node]:
        """All nodes that lead to the last step, in the order of time."""
        found = self.ends[-1:]
        while found and found[-1].before is not None:
            found.append(found[-1].before)
        return found[::-1]

    def stop(self) -> None:
        """Give the estimator back its belief."""
        self.est._belief = self.est._belief.belief

    def broken(self, step: int) -> ParameterError:
        """Return the error for a step that does not lead back to the one before."""
        return ParameterError(
            f"smooth: a verb of this {type(self.est).__name__} assigned the membership in step {step}; "
            "expected predictions and updates alone, as the way back knows of nothing else: override smooth "
            "as well"
        )

"""What an estimator did along a series, kept for the way back.

While it is tracked, an estimator holds a `Tracked` belief: it does what the belief does, and each
prediction, update or restart of it becomes a `Node`, which knows the one before it.  So the way back
follows what the verbs did, whoever wrote them: two predictions between observations, noise that changes,
measurements that were left out.

Beliefs that take much memory are kept at every second, fourth, ... node only, and what lies between is
done again on the way back, stretch by stretch.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

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
    verb : {"start", "predict", "update", "constrain", "restart"}
    belief : Belief or None
        None where it is to be made again.
    before : Node or None
        None at the start.
    mapping, noise, z
        What the verb was given; the constraint is the noise of its verb.
    prior, possibility
        What an update found, see `Outcome`.
    """

    verb: Literal["start", "predict", "update", "constrain", "restart"]
    belief: Any
    before: Node | None = None
    mapping: Any = None
    noise: Any = None
    z: Any = None
    prior: Any = None
    possibility: float = 1.0

    def redo(self) -> None:
        """Make the belief again from the one before."""
        assert self.before is not None
        past: Belief = self.before.belief
        if self.verb == "predict":
            self.belief = past.predict(self.mapping, self.noise).belief
        elif self.verb in ("update", "constrain"):
            given = (self.noise,) if self.verb == "constrain" else (self.mapping, self.noise, self.z)
            outcome = getattr(past, self.verb)(*given)
            self.belief, self.prior = outcome.belief, outcome.prior
        else:
            self.belief = past.restart(self.mapping, self.noise, self.z)

    def forget(self) -> None:
        """Let the belief go."""
        self.belief = self.prior = None


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
        node = Node("update", outcome.belief, self.node, measure, self._kept(noise), z)
        node.prior, node.possibility = outcome.prior, outcome.possibility
        return self._next(outcome, node)

    def constrain(self, constraint: Membership) -> Outcome:
        """Combine with a constraint; one that says nothing new leaves no trace."""
        outcome = self.belief.constrain(constraint)
        if outcome.belief is self.belief:
            return replace(outcome, belief=self)
        node = Node("constrain", outcome.belief, self.node, noise=constraint)
        node.prior, node.possibility = outcome.prior, outcome.possibility
        return self._next(outcome, node)

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
    room : float
        How much the beliefs that are kept may take.
    size : callable, optional
        Of a node: how much its belief takes; by default nothing.
    """

    def __init__(
        self, est: Any, *, copies: bool, room: float = np.inf, size: Callable[[Node], float] = lambda _: 0.0
    ) -> None:
        self.est = est
        self.ends: list[Node] = []
        self._room, self._size = room, size
        self._kept: list[tuple[int, Node]] = []  # with their places; the start is kept in any case
        self._count, self._stride, self._used, self._largest = 0, 1, 0.0, 0.0
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
        fresh, node = [], tracked.node
        while node.before is not None and node not in self.ends[-1:]:
            fresh.append(node)
            node = node.before
        for node in reversed(fresh):
            self._count += 1
            self._kept.append((self._count, node))
            self._add(node)
        # Half of the room is for what is done again.
        while self._used > 0.5 * self._room and self._kept:
            self._stride *= 2
            self._thin()
        if self._stride > 1:
            self._thin()
        self.ends.append(tracked.node)

    def _thin(self) -> None:
        """Keep the beliefs of every so many nodes."""
        for place, node in self._kept:
            if place % self._stride:
                self.release(node)
        self._kept = [(place, node) for place, node in self._kept if place % self._stride == 0]

    def _add(self, node: Node) -> None:
        size = self._size(node)
        self._used += size
        self._largest = max(self._largest, size)

    def release(self, node: Node) -> None:
        """Let the belief of a node go, if that is worth anything."""
        if np.isfinite(self._room) and node.before is not None and node.belief is not None:
            self._used -= self._size(node)
            node.forget()

    def recall(self, node: Node) -> None:
        """Make sure that the belief of a node is there, and as many of those before it as there is room for.

        The stretch since the last belief that was kept is done again.  If there is no room for all of
        it, a few are kept on the way, and the rest of the way is done once more.
        """
        while node.belief is None:
            stretch = [node]
            while (before := stretch[-1].before) is not None and before.belief is None:
                stretch.append(before)
            free = max(2, int((self._room - self._used) // self._largest))
            stride = 1 if len(stretch) <= free else -(-len(stretch) // (free // 2))
            last = None
            for k, one in enumerate(reversed(stretch), start=1):
                one.redo()
                self._add(one)
                if last is not None:
                    self.release(last)
                last = one if k % stride and one is not node else None

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

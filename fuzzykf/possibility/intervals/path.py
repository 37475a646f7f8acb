"""The boxes of a whole series, contracted forward and backward.

Back:     S_n <- S_n with f(S_n) + W meeting S_(n+1);    forward:  S_(n+1) <- S_(n+1) within f(S_n) + W.

Each contraction keeps every trajectory that explains all measurements, so that the bounds hold after any
number of them.  For a scalar one way back gives the exact bounds.  In several dimensions what is learned of a
component on the way back (a velocity from two positions) narrows others on the way forward again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf.possibility.intervals import boxes
from fuzzykf.possibility.intervals.box import Box

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from fuzzykf.possibility.trail import Node

__all__ = ["Broken", "contract_path"]

#: Going back and forth ends once no side shrinks by this part of it, and at the latest after so many rounds.
GAIN, ROUNDS = 0.01, 10


class Broken(Exception):
    """Nothing leads over one node: raised by `contract_path`, and never seen by users.

    Attributes
    ----------
    place : int
        Of the node to which nothing leads.
    """

    def __init__(self, place: int) -> None:
        super().__init__(place)
        self.place = place


def contract_path(nodes: Sequence[Node], cuts: Collection[int]) -> list[Box]:
    """Contract the boxes of a series.

    Parameters
    ----------
    nodes : sequence of Node
        In the order of time; their beliefs are boxes.
    cuts : collection of int
        Places of nodes that say nothing of the node before, and of which that says nothing.

    Returns
    -------
    list of Box
        One for each node, within that of the filter.

    Raises
    ------
    Broken
        If no trajectory is left.
    """
    path = _Path(nodes, cuts)
    path.back()
    if nodes[0].belief.box.dim > 1:
        for _ in range(ROUNDS):
            # One after the other: what the way forward gains is carried back at once.
            if not path.forth() + path.back():
                break
    return path.found


class _Path:
    """Boxes that are contracted link by link; a link whose boxes have not moved since is left out.

    Parameters
    ----------
    nodes, cuts
        See `contract_path`.

    Attributes
    ----------
    found : list of Box
    """

    def __init__(self, nodes: Sequence[Node], cuts: Collection[int]) -> None:
        self.nodes, self.links = nodes, [k for k in range(1, len(nodes)) if k not in cuts]
        self.found: list[Box] = [Box(node.belief.box.lower, node.belief.box.upper) for node in nodes]
        self._time = 0
        self._moved = [1] * len(nodes)
        self._done = {"back": [0] * len(nodes), "forth": [0] * len(nodes)}

    def back(self) -> int:
        """Contract each box by the one after it, and return how many of them moved."""
        return sum(self._contract(k, "back", k - 1) for k in reversed(self.links))

    def forth(self) -> int:
        """Contract each box by the one before it and by its measurement, and return how many moved."""
        return sum(self._contract(k, "forth", k) for k in self.links)

    def _contract(self, k: int, way: str, target: int) -> bool:
        """Contract over the link to node k, if anything has moved; whether the target did."""
        done = self._done[way]
        if max(self._moved[k - 1], self._moved[k]) <= done[k]:
            return False
        box = self._back(k) if way == "back" else self._forth(k)
        if box is None:
            raise Broken(k)
        before, self.found[target] = self.found[target], box
        self._time += 1
        done[k] = self._time + 1
        shrunk = _shrinks(before, box)
        if shrunk:
            self._moved[target] = done[k]
        return shrunk

    def _back(self, k: int) -> Box | None:
        node = self.nodes[k]
        if node.verb != "predict":  # the same state
            return self.found[k]
        return boxes.retrace(self.found[k - 1], node.mapping, node.noise, self.found[k])

    def _forth(self, k: int) -> Box | None:
        node, past = self.nodes[k], self.found[k - 1]
        if node.verb != "predict":
            both = boxes.intersect(past, self.found[k])
            if both is None or node.verb == "constrain" or boxes.tells_no_more(node.mapping):
                return both
            return boxes.update(both, node.mapping, node.noise, node.z)
        return boxes.intersect(boxes.predict(past, node.mapping, node.noise), self.found[k])


def _shrinks(before: Box, after: Box) -> bool:
    """Whether some side of a box is shorter than it was, by more than a small part of it."""
    sides = zip(*(bound.tolist() for bound in (*before, *after)), strict=True)
    return any(d - c < (1.0 - GAIN) * (b - a) for a, b, c, d in sides)

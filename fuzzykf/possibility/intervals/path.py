"""The boxes of a whole series, contracted forward and backward.

Back:     S_n <- S_n with f(S_n) + W meeting S_(n+1);    forward:  S_(n+1) <- S_(n+1) within f(S_n) + W.

Each contraction keeps every trajectory that explains all measurements, so that the bounds hold after any
number of them.  For a scalar one way back gives the exact bounds.  In several dimensions what is learned of a
component on the way back (a velocity from two positions) narrows others on the way forward again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.possibility.intervals import boxes

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from fuzzykf.possibility.memberships import IntervalMembership
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


def contract_path(nodes: Sequence[Node], cuts: Collection[int]) -> list[IntervalMembership]:
    """Contract the boxes of a series.

    Parameters
    ----------
    nodes : sequence of Node
        In the order of time; their beliefs are boxes.
    cuts : collection of int
        Places of nodes that say nothing of the node before, and of which that says nothing.

    Returns
    -------
    list of IntervalMembership
        One for each node, within that of the filter.

    Raises
    ------
    Broken
        If no trajectory is left.
    """
    found = [node.belief.box for node in nodes]
    _backward(nodes, cuts, found)
    if found[0].dim > 1:
        for _ in range(ROUNDS):
            before = _widths(found)
            _forward(nodes, cuts, found)
            _backward(nodes, cuts, found)
            if not (_widths(found) < (1.0 - GAIN) * before).any():
                break
    return found


def _widths(found: list[IntervalMembership]) -> np.ndarray:
    return np.array([box.upper - box.lower for box in found])


def _backward(nodes: Sequence[Node], cuts: Collection[int], found: list[IntervalMembership]) -> None:
    """Contract, in place, each box by the one after it."""
    for k in range(len(nodes) - 1, 0, -1):
        if k in cuts:
            continue
        node = nodes[k]
        if node.verb == "update":  # the same state
            found[k - 1] = found[k]
            continue
        found[k - 1] = _left(boxes.retrace(found[k - 1], node.mapping, node.noise, found[k]), k)


def _forward(nodes: Sequence[Node], cuts: Collection[int], found: list[IntervalMembership]) -> None:
    """Contract, in place, each box by the one before it and by its measurement."""
    for k, node in enumerate(nodes):
        if k == 0 or k in cuts:
            continue
        if node.verb == "update":
            both = _left(boxes.intersect(found[k - 1], found[k]), k)
            found[k] = _left(boxes.update(both, node.mapping, node.noise, node.z), k)
        else:
            image = boxes.predict(found[k - 1], node.mapping, node.noise)
            found[k] = _left(boxes.intersect(image, found[k]), k)


def _left(box: IntervalMembership | None, place: int) -> IntervalMembership:
    if box is None:
        raise Broken(place)
    return box

"""Where the pairs of nodes stand: those that lead to a node j, one below the other in the slots of column j.

Slot i is the pair (i, j) of all columns, unless few pairs are of positive probability: then those alone have
slots, by i, as many in every column as the one with the most of them needs.  What is left over repeats the
first pair of the column with a probability of zero; sums over the slots of a column are those over i.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Slots", "lay_out", "node_index"]

#: Up to this share of all pairs slots of their own pay: each reads the state of its own node by an index,
#: and at half of the pairs a step of many nodes still takes 0.6 to 0.9 of the time.
SPARSE = 0.5


class Slots(NamedTuple):
    """The pairs of positive probability that lead to each column."""

    source: IntArray  # (depth, M2): the node i of each
    there: BoolArray  # (depth, M2): False where a slot is left over

    def take(self, values: Any) -> Any:
        """Values (depth, M2, ...) of the slots, from those of all pairs (M1, M2, ...)."""
        return values[self.source, np.arange(self.source.shape[1])]

    def probabilities(self, transition: FloatArray) -> FloatArray:
        """Transition probabilities (depth, M2) of the slots, zero where they are left over."""
        return np.where(self.there, self.take(transition), 0.0)

    def sums(self, values: FloatArray, M1: int) -> FloatArray:
        """Return sums (M1,) of values (depth, M2) over the pairs of each node i."""
        totals = np.bincount(self.source.ravel(), values.ravel(), minlength=M1)
        return totals.astype(np.float64, copy=False)

    def spread(self, values: FloatArray, M1: int, rest: float) -> FloatArray:
        """Return values (M1, M2) of all pairs, from those of the slots; ``rest`` for pairs without one."""
        whole = np.full((M1, self.source.shape[1]), rest)
        whole[self.source[self.there], np.nonzero(self.there)[1]] = values[self.there]
        return whole

    def rows(self, M1: int) -> tuple[IntArray, BoolArray]:
        """Return, for each node i, where its pairs are among all slots, and which are there: (M1, width)."""
        flat = np.flatnonzero(self.there)
        sources = self.source.ravel()[flat]
        order = np.argsort(sources, kind="stable")
        count = np.bincount(sources, minlength=M1)
        place = np.arange(flat.size) - np.repeat(np.cumsum(count) - count, count)
        at, there = np.zeros((M1, count.max()), dtype=np.intp), np.zeros((M1, count.max()), dtype=bool)
        at[sources[order], place], there[sources[order], place] = flat[order], True
        return at, there


def node_index(slots: Slots | None) -> tuple[Any, ...]:
    """Return the index that gives each slot what its node i holds: of (M1, ...)."""
    return (slice(None), None) if slots is None else (slots.source,)


def lay_out(transition: FloatArray) -> Slots | None:
    """Return the slots of the pairs of positive probability, (M1, M2); None if all pairs have one.

    Negative weights are those of all pairs.
    """
    positive = transition != 0.0
    depth = max(1, int(np.count_nonzero(positive, axis=0).max()))
    if depth > SPARSE * len(transition) or (transition < 0.0).any():
        return None
    source = np.argsort(~positive, axis=0, kind="stable")[:depth]
    there = np.take_along_axis(positive, source, axis=0)
    return Slots(np.where(there, source, source[0]), there)

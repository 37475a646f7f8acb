"""The chain of fades as learning moves it: by the expected numbers of its events.

A step at a class leaves it, by a fade or a jump, or stays.  A step in a fade turns back with rho, else it
goes on with q, or stays: F / length = (1 - rho) q.  Each of these is how often it happened, over how often
it could have.

What the law has, but the data do not, would leave it in parts, or with fades that never end.  So each class,
each fade and the turning back is taken to have seen one step before the data, in which everything was as
likely as in the law at which the search began.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.learners import ChainFamily

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.fades import FadeLaw

__all__ = ["FadeChain"]

#: The least probability, at the start of a search, to stay at a class or in a cell.
WAITING = 0.1

#: The rate of turning back from which a search begins as well, if it began with less.
OFTEN = 0.3


class Probabilities(NamedTuple):
    """What may happen at each class, in each fade, and turning back."""

    leave: FloatArray
    stay: FloatArray
    advance: FloatArray
    turn_back: float


class FadeChain(ChainFamily):
    """The chain of a law of fades.

    Where it begins is free, see `FreeChain`: one series says little of it.

    Parameters
    ----------
    law : FadeLaw
        Structure, and where to begin: what is impossible in it stays so.  A search begins with some waiting
        at all classes and in all fades, or it could not leave the bounds at which there is none.
    n_nodes : int
        Cells of each fade.
    """

    def __init__(self, law: FadeLaw, n_nodes: int) -> None:
        if not n_nodes and law.fades:
            raise ParameterError("n_nodes: got 0, expected at least 1 to learn how long fades last")
        chain = law.discretize(n_nodes)
        self._law, self._F = law, n_nodes
        self.class_weights, self._first = chain.class_weights, chain.initial
        fades, jumps = law.fades, law.jumps
        self._arrows = np.array([*fades, *jumps], dtype=np.intp).reshape(-1, 2)
        self.leave = np.array([*(rate for rate, _ in fades.values()), *jumps.values()])
        left = np.bincount(self._arrows[:, 0], self.leave, minlength=law.n_classes)
        self.stay = np.maximum(1.0 - left.astype(np.float64), WAITING)
        self.turn_back = law.turn_back
        lengths = np.array([length for _, length in fades.values()])
        self.advance = np.minimum(n_nodes / lengths / (1.0 - self.turn_back), 1.0 - WAITING)
        E = len(fades)
        begins = law.n_classes + n_nodes * np.arange(E)
        self._cells = begins[:, None] + np.arange(n_nodes)
        self._next = np.concatenate([self._cells[:, 1:], self._arrows[:E, 1:]], axis=1)
        self._there = np.concatenate([begins, self._arrows[E:, 1]])  # where an arrow leads at first
        self._back = np.array([[*fades].index((b, a)) for a, b in fades] if self.turn_back else [], dtype=int)
        self.n_parameters = int((self.leave > 0.0).sum()) + E + bool(self.turn_back)
        self._transition = chain.transition
        if (self.stay == WAITING).any() or (self.advance == 1.0 - WAITING).any():
            self._settle()
        self._seen = Probabilities(self.leave, self.stay, self.advance, self.turn_back)

    @property
    def initial(self) -> FloatArray:
        """Probabilities of the first node."""
        return self._first

    @property
    def transition(self) -> FloatArray:
        """Transition matrix."""
        return self._transition

    @property
    def log_prior(self) -> float:
        """Log-density of the step that each part has seen before the data."""
        seen, E = self._seen, len(self._cells)
        terms = [(seen.leave, self.leave), (seen.stay, self.stay)]
        if E:
            terms += [(seen.advance, self.advance), (1.0 - seen.advance, 1.0 - self.advance)]
        if seen.turn_back:
            rho = np.array([self.turn_back, 1.0 - self.turn_back])
            terms.append((np.array([seen.turn_back, 1.0 - seen.turn_back]), rho))
        with np.errstate(divide="ignore"):
            return float(sum(before[before > 0.0] @ np.log(now[before > 0.0]) for before, now in terms))

    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Take each event as often as it is expected, the step before the data included."""
        K, E, seen = self._law.n_classes, len(self._cells), self._seen
        visits = pairs.sum(axis=1)
        at = visits[:K] + 1.0
        begin = self._arrows[:, 0]
        self.leave = (pairs[begin, self._there] + seen.leave) / at[begin]
        self.stay = (np.diagonal(pairs)[:K] + seen.stay) / at
        if E:
            steps = visits[self._cells].sum(axis=1)
            turned = np.zeros(E)
            if self.turn_back:
                turned = pairs[self._cells, self._cells[self._back, ::-1]].sum(axis=1)
                self.turn_back = float((turned.sum() + seen.turn_back) / (steps.sum() + 1.0))
            went = pairs[self._cells, self._next].sum(axis=1)
            self.advance = (went + seen.advance) / (steps - turned + 1.0)
        self._first = first / first.sum()
        self._settle()

    def _settle(self) -> None:
        """Bring groups of probabilities to the sum one, and the transition matrix up to date."""
        K = self._law.n_classes
        begin = self._arrows[:, 0]
        total = self.stay + np.bincount(begin, self.leave, minlength=K)
        self.leave, self.stay = self.leave / total[begin], self.stay / total
        self.advance = np.minimum(self.advance, 1.0)  # rounding may leave more
        P = np.zeros_like(self._transition)
        P[np.arange(K), np.arange(K)] = self.stay
        np.add.at(P, (begin, self._there), self.leave)
        if len(self._cells):
            P[self._cells, self._next] = ((1.0 - self.turn_back) * self.advance)[:, None]
            P[self._cells, self._cells] = ((1.0 - self.turn_back) * (1.0 - self.advance))[:, None]
            if self.turn_back:
                P[self._cells, self._cells[self._back, ::-1]] = self.turn_back
        self._transition = P

    @property
    def vector(self) -> FloatArray:
        """Square roots of the probabilities, which stay finite where one vanishes."""
        parts = (
            self.leave,
            self.stay,
            self.advance,
            1.0 - self.advance,
            [self.turn_back, 1.0 - self.turn_back],
            self._first,
        )
        roots: FloatArray = np.sqrt(np.concatenate(parts))
        return roots

    def at(self, vector: FloatArray) -> Self | None:
        """Return the chain with these square roots, groups brought to the sum one."""
        L, K, E = len(self.leave), len(self.stay), len(self.advance)
        parts = np.split(np.square(vector), np.cumsum([L, K, E, E, 2]))
        leave, stay, on, wait, turn, first = parts
        total = stay + np.bincount(self._arrows[:, 0], leave, minlength=K)
        if not ((total > 0.0).all() and (on + wait > 0.0).all() and turn.sum() > 0.0 and first.sum() > 0.0):
            return None
        return self._moved(leave, stay, on / (on + wait), float(turn[0] / turn.sum()), first / first.sum())

    def _moved(
        self, leave: FloatArray, stay: FloatArray, advance: FloatArray, turn_back: float, first: FloatArray
    ) -> Self:
        moved = copy(self)
        moved.leave, moved.stay, moved.advance, moved.turn_back = leave, stay, advance, turn_back
        moved._first = first
        moved._settle()
        return moved

    def variants(self) -> list[Self]:
        """Return the chain that turns back often, if it can turn back and seldom does."""
        if not 0.0 < self.turn_back < 0.5 * OFTEN:
            return []
        return [self._moved(self.leave, self.stay, self.advance, OFTEN, self._first)]

    def law(self) -> Any:
        """Return the law of these probabilities."""
        E = len(self._cells)
        lengths = self._F / (self.advance * (1.0 - self.turn_back))
        return self._law.with_numbers(self.leave[:E], lengths, self.leave[E:], self.turn_back)

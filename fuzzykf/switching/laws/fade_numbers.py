"""Free numbers of a law of fades, for an ascent.

They are the logarithms of the probabilities of leaving a class, less that of staying, and logits of going on
in a fade, q = F / (length (1 - rho)), and of turning back, rho.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.switching.laws.chain import stationary_back
from fuzzykf.switching.laws.law_numbers import ChainTables, LawNumbers

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.fades import FadeLaw
    from fuzzykf.switching.laws.law_numbers import ByTables

__all__ = ["FadeNumbers"]


class _Odds(NamedTuple):
    """Probabilities of what may happen."""

    leave: FloatArray  # (A,): by each arrow, fades first
    stay: FloatArray  # (K,)
    advance: FloatArray  # (E,)
    turn_back: float


class FadeNumbers(LawNumbers):
    """Those of a law of fades with so many cells in each; what is impossible in it stays so.

    A search begins with some waiting at all classes and in all fades, as `FadeChain` does.

    Parameters
    ----------
    law : FadeLaw
    n_nodes : int

    Raises
    ------
    ParameterError
        If there are too many cells for the fades, or none.
    """

    def __init__(self, law: FadeLaw, n_nodes: int) -> None:
        self._law, self._F = law, n_nodes
        begun = law.learner(n_nodes)  # which says where a search can begin
        fades, jumps, K = [*law.fades], [*law.jumps], law.n_classes
        arrows = np.array([*fades, *jumps], dtype=np.intp).reshape(-1, 2)
        E = self._n_fades = len(fades)
        self._begin = arrows[:, 0]
        cells = K + n_nodes * np.arange(E)[:, None] + np.arange(n_nodes)
        self._cells, self._next = cells, np.concatenate([cells[:, 1:], arrows[:E, 1:]], axis=1)
        self._there = np.concatenate([cells[:, :1].ravel(), arrows[E:, 1]])
        self._turns = law.turn_back > 0.0
        back = [fades.index((b, a)) for a, b in fades] if self._turns else []
        self._back = cells[back, ::-1]
        self._free = np.flatnonzero(begun.leave > 0.0)
        ways = [f"rate {a} to {b}" for a, b in fades] + [f"jump {a} to {b}" for a, b in jumps]
        names = [ways[k] for k in self._free] + [f"length {a} to {b}" for a, b in fades]
        leave = np.log(begun.leave[self._free] / begun.stay[self._begin[self._free]])
        start = np.concatenate([leave, _logit(begun.advance)])
        if self._turns:
            names, start = [*names, "turn_back"], np.append(start, _logit(begun.turn_back))
        is_turning = np.array(names) == "turn_back"
        is_share = (np.arange(len(names)) < len(self._free)) | is_turning
        self._name(names, start, is_share, is_share=is_share)

    def _odds(self, numbers: FloatArray) -> _Odds:
        n, K = len(self._free), self._law.n_classes
        logits = np.full(len(self._begin), -np.inf)
        logits[self._free] = numbers[:n]
        top = np.zeros(K)  # the logit of staying
        np.maximum.at(top, self._begin, logits)
        weights, stay = np.exp(logits - top[self._begin]), np.exp(-top)
        total = stay + np.bincount(self._begin, weights, minlength=K)
        with np.errstate(over="ignore"):  # then it is nothing
            likely = 1.0 / (1.0 + np.exp(-numbers[n:]))
        advance = likely[: self._n_fades]
        turn_back = float(likely[-1]) if self._turns else 0.0
        return _Odds(weights / total[self._begin], stay / total, advance, turn_back)

    def _lengths(self, odds: _Odds) -> FloatArray:
        return self._F / (odds.advance * (1.0 - odds.turn_back))

    def value(self, numbers: FloatArray) -> FadeLaw:
        """Return the law."""
        odds, E = self._odds(numbers), self._n_fades
        return self._law.with_numbers(odds.leave[:E], self._lengths(odds), odds.leave[E:], odds.turn_back)

    def tables(self, numbers: FloatArray) -> ChainTables:
        """See `LawNumbers`."""
        chain = self.value(numbers).discretize(self._F)
        return ChainTables(chain.initial, chain.transition)

    def gradient(self, numbers: FloatArray, by_value: ByTables) -> FloatArray:
        """See `LawNumbers`; the law begins in its stationary law, whose derivative counts."""
        leave, stay, q, rho = self._odds(numbers)
        chain, by_initial, by_transition = by_value
        G = by_transition + stationary_back(chain.initial, chain.transition, by_initial)
        by_leave, by_stay = G[self._begin, self._there], np.diagonal(G)[: len(stay)]
        mean = stay * by_stay + np.bincount(self._begin, leave * by_leave, minlength=len(stay))
        by_logits = leave * (by_leave - mean[self._begin])
        on, wait = G[self._cells, self._next], G[self._cells, self._cells]
        by_q = (1.0 - rho) * (on - wait).sum(axis=1)
        parts = [by_logits[self._free], by_q * q * (1.0 - q)]
        if self._turns:
            turned = G[self._cells, self._back].sum(axis=1)
            by_rho = (turned - q * on.sum(axis=1) - (1.0 - q) * wait.sum(axis=1)).sum()
            parts.append(np.array([by_rho * rho * (1.0 - rho)]))
        return np.concatenate(parts)

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the probabilities of leaving, the mean lengths, and the probability of turning back."""
        odds = self._odds(numbers)
        turn_back = [odds.turn_back] if self._turns else []
        return np.concatenate([odds.leave[self._free], self._lengths(odds), turn_back])


def _logit(p: FloatArray | float) -> FloatArray:
    logit: FloatArray = np.log(p) - np.log1p(-np.asarray(p))
    return logit

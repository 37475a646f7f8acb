"""Free numbers of laws for an ascent: any vector of them is a law, and its tables can be differentiated.

A law that can be learned from observations alone hands them out (`Law.free_numbers`), beside the estimates
that they stand for, on the scale of the law: there are as many of these.  Both are what
`fuzzykf.estimation.blocks.Block` asks for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chain import (
    SwitchChain,
    starts_stationary,
    stationary_back,
    stationary_distribution,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray

__all__ = ["ByTables", "ChainNumbers", "ChainTables", "LawNumbers", "LogitNumbers"]

#: A large change of a logit: how far starts are drawn from one another.
FAR = 1.0

#: Step of differences of tables, whose derivatives of third order are below one.
STEP = 1e-5


class ChainTables(NamedTuple):
    """The probabilities of a chain on nodes."""

    initial: FloatArray  # (M,)
    transition: FloatArray  # (M, M)


class ByTables(NamedTuple):
    """Derivatives by the tables of a chain, that of the law at these numbers."""

    chain: SwitchChain | ChainTables
    initial: FloatArray  # (M,)
    transition: FloatArray  # (M, M)


class LawNumbers(ABC):
    """The free numbers of a law that is put on nodes, see `fuzzykf.estimation.blocks.Block`.

    Attributes
    ----------
    names : tuple of str
        Of the estimates, (p,).
    start, spread : ndarray, shape (p,)
    is_variance : ndarray of bool, shape (p,)
        Numbers that are logarithms of what may be zero, at minus infinity.
    is_positive : ndarray of bool, shape (p,)
        Estimates that cannot be negative, whose intervals are those of their logarithms.
    is_share : ndarray of bool, shape (p,)
        Those that cannot be above one either: of these they are those of their logits.
    """

    names: tuple[str, ...]
    start: FloatArray
    spread: FloatArray
    is_variance: BoolArray
    is_positive: BoolArray
    is_share: BoolArray

    def _name(
        self, names: list[str], start: Any, is_variance: Any, is_positive: Any = True, is_share: Any = False
    ) -> None:
        """Take what there is of each number; of a flag one for all will do."""
        if not names:
            raise ParameterError("free['law']: got True, but the law has nothing that could be free")
        self.names, self.start = tuple(names), np.asarray(start, dtype=np.float64)
        self.spread = np.full(len(names), FAR)
        self.is_variance = np.broadcast_to(np.asarray(is_variance, dtype=np.bool_), self.start.shape)
        self.is_positive = np.broadcast_to(np.asarray(is_positive, dtype=np.bool_), self.start.shape)
        self.is_share = np.broadcast_to(np.asarray(is_share, dtype=np.bool_), self.start.shape)

    @abstractmethod
    def value(self, numbers: FloatArray) -> Any:
        """Return the law.

        Raises
        ------
        ParameterError
            If there is none with these numbers.
        """

    @abstractmethod
    def tables(self, numbers: FloatArray) -> ChainTables:
        """Return the tables of the chain of the law.

        Raises
        ------
        ParameterError
            If there is no law with these numbers.
        """

    @abstractmethod
    def gradient(self, numbers: FloatArray, by_value: ByTables) -> FloatArray:
        """Return the gradient by the numbers (p,) of what has one by the tables of the chain."""

    @abstractmethod
    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the estimates (p,)."""

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """Return the derivatives of the estimates by the numbers, (p, p), a row for each estimate."""
        return _differences(self.estimates, numbers).T


class LogitNumbers(LawNumbers):
    """Those of a law with logits, see `fuzzykf.switching.laws.base.ParametricLaw`.

    Its tables are differentiated by differences.  At the widths of cells the masses of a band have kinks, at
    which an ascent may stop.

    Parameters
    ----------
    law : Law
        With ``logits``, ``from_logits``, ``on_cells``, ``estimates_of`` and ``n_shares``.
    n_nodes : int
    """

    def __init__(self, law: Any, n_nodes: int) -> None:
        self._law, self._joint = law, law.on_cells(n_nodes)
        names = [*law.estimates_of(law)]
        # masses, densities and widths are positive; logits, where a family has nothing better, need not be
        self._name(names, law.logits(), np.arange(len(names)) < law.n_shares, law.n_shares > 0)

    def value(self, numbers: FloatArray) -> Any:
        """Return the law of these logits."""
        return self._law.from_logits(numbers)

    def tables(self, numbers: FloatArray) -> ChainTables:
        """See `LawNumbers`; what follows a node without mass is nothing."""
        masses = self._joint(numbers)
        p: FloatArray = masses.sum(axis=1)
        return ChainTables(
            p, np.divide(masses, p[:, None], out=np.zeros_like(masses), where=p[:, None] > 0.0)
        )

    def gradient(self, numbers: FloatArray, by_value: ByTables) -> FloatArray:
        """See `LawNumbers`."""
        by = np.concatenate([by_value.initial[:, None], by_value.transition], axis=1)
        slopes = _differences(lambda logits: np.column_stack(self.tables(logits)), numbers)
        slope: FloatArray = (slopes * by).sum(axis=(1, 2))
        return slope

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return masses, densities and widths; of a family that has no names for them, the logits."""
        found = np.array(list(self._law.estimates_of(self.value(numbers)).values()))
        return np.where(np.isneginf(numbers), 0.0, found)  # a difference may leave rounding there


class ChainNumbers(LawNumbers):
    """Those of any chain on the nodes: what is impossible in it stays so.

    The numbers are logarithms of the probabilities of each row, less that of staying (where the chain cannot
    stay, of what is likeliest).  A chain that begins in its stationary law goes on to do so; of another one
    the probabilities of its first nodes are free as well.

    Parameters
    ----------
    chain : SwitchChain
    make : callable, optional
        From the chain to the law that it stands for.
    """

    def __init__(self, chain: SwitchChain, make: Callable[[SwitchChain], Any] | None = None) -> None:
        self._chain, self._make, self._is_stationary = chain, make, starts_stationary(chain)
        T, M = chain.transition, len(chain)
        stays = np.diagonal(T) > 0.0
        held = np.where(stays, np.arange(M), T.argmax(axis=1))
        free = T > 0.0
        free[np.arange(M), held] = False
        self._from, self._to, self._held = *np.nonzero(free), held
        start = [*np.log(T[free] / T[self._from, held[self._from]])]
        names = [f"p({i}, {j})" for i, j in zip(self._from.tolist(), self._to.tolist(), strict=True)]
        p, first = chain.initial, int(chain.initial.argmax())
        begins = np.flatnonzero(p > 0.0)
        self._first = np.empty(0, dtype=np.intp) if self._is_stationary else begins[begins != first]
        self._first_held = first
        start += [*np.log(p[self._first] / p[first])]
        names += [f"initial({k})" for k in self._first.tolist()]
        self._name(names, start, True, is_share=True)

    def tables(self, numbers: FloatArray) -> ChainTables:
        """See `LawNumbers`."""
        n, M = len(self._from), len(self._chain)
        logits = np.full((M, M), -np.inf)
        logits[self._from, self._to] = numbers[:n]
        logits[np.arange(M), self._held] = 0.0
        T = _softmax(logits)
        if self._is_stationary:
            return ChainTables(stationary_distribution(T), T)
        first = np.full(M, -np.inf)
        first[self._first] = numbers[n:]
        first[self._first_held] = 0.0
        return ChainTables(_softmax(first), T)

    def value(self, numbers: FloatArray) -> Any:
        """Return the chain, or the law that it stands for."""
        given, (initial, T) = self._chain, self.tables(numbers)
        chain = SwitchChain(given.nodes, given.weights, initial, T, given.class_weights)
        return chain if self._make is None else self._make(chain)

    def gradient(self, numbers: FloatArray, by_value: ByTables) -> FloatArray:
        """See `LawNumbers`."""
        chain, by_p, by_T = by_value
        p, T = chain.initial, chain.transition
        if self._is_stationary:
            by_T = by_T + stationary_back(p, T, by_p)
        rows = T * (by_T - (T * by_T).sum(axis=1, keepdims=True))
        first = p * (by_p - p @ by_p)
        return np.concatenate([rows[self._from, self._to], first[self._first]])

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the probabilities but those of staying."""
        p, T = self.tables(numbers)
        return np.concatenate([T[self._from, self._to], p[self._first]])


def _softmax(logits: FloatArray) -> FloatArray:
    """Return the probabilities along the last axis; minus infinity is impossible."""
    weights = np.exp(logits - logits.max(axis=-1, keepdims=True))
    shares: FloatArray = weights / weights.sum(axis=-1, keepdims=True)
    return shares


def _differences(f: Callable[[FloatArray], FloatArray], numbers: FloatArray) -> FloatArray:
    """Return the derivatives of an array (p, ...) by central differences; by minus infinity they are zero."""
    found = []
    for k in range(len(numbers)):
        ahead, behind = numbers.copy(), numbers.copy()
        ahead[k] += STEP
        behind[k] -= STEP
        found.append((f(ahead) - f(behind)) / (2.0 * STEP))
    return np.array(found)

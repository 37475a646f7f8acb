"""Chains on nodes with free parameters: what the maximisation step of a law moves.

A law that can be learned hands out such a chain (`Law.learner`), and the chain the law that it stands for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chain import stationary_distribution

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["ChainFamily", "FreeChain", "LawChain", "SearchedLaw"]


#: Where a search may go, in logits.
_LOGIT = 15.0


class SearchedLaw(Protocol):
    """A law that a search moves by free numbers, see `fuzzykf.switching.laws.base.ParametricLaw`."""

    def logits(self) -> FloatArray:
        """Return the free numbers of the law."""

    def from_logits(self, logits: FloatArray) -> Any:
        """Return the law of the same structure with these."""

    def on_cells(self, n_nodes: int) -> Callable[[FloatArray], FloatArray]:
        """Return the map from free numbers to joint probabilities of two consecutive nodes."""

    def elsewhere(self, logits: FloatArray, n_nodes: int) -> list[FloatArray]:
        """Return free numbers that a search cannot reach from these."""

    def discretize(self, n_nodes: int) -> SwitchChain:
        """Return the chain on so many nodes."""


class ChainFamily(ABC):
    """A chain on nodes whose probabilities depend on a few free numbers.

    Attributes
    ----------
    class_weights : ndarray, shape (M, K)
        Shares of the regimes in the nodes.
    n_parameters : int
    """

    class_weights: FloatArray
    n_parameters: int

    @property
    @abstractmethod
    def initial(self) -> FloatArray:
        """Probabilities of the first node, (M,)."""

    @property
    @abstractmethod
    def transition(self) -> FloatArray:
        """Transition matrix, (M, M)."""

    @property
    def log_prior(self) -> float:
        """Log-density of what the parameters are taken to have seen before the data, but for a constant."""
        return 0.0

    @abstractmethod
    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Raise sum pairs log P + sum first log pi, and the prior.

        Parameters
        ----------
        pairs : ndarray, shape (M, M)
            Expected numbers of transitions.
        first : ndarray, shape (M,)
            Expected numbers of stretches that begin in each node.
        """

    def settle(self, pairs: FloatArray, first: FloatArray) -> None:
        """Find the maximum of the same, where one `maximise` may end on the way."""
        self.maximise(pairs, first)

    @property
    @abstractmethod
    def vector(self) -> FloatArray:
        """All parameters, as one vector in which straight lines make sense."""

    @abstractmethod
    def at(self, vector: FloatArray) -> Self | None:
        """Return the chain with these parameters, or None where there is none."""

    def variants(self) -> list[Self]:
        """Return chains that the maximisation cannot reach from this one, but may be better."""
        return []

    @abstractmethod
    def law(self) -> Any:
        """Return the law (or the chain) that the parameters stand for."""


def _objective(joint: FloatArray, pairs: FloatArray, first: FloatArray) -> float:
    p = joint.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = pairs * (np.log(joint) - np.log(p)[:, None])
        starts = first * np.log(p)
    return float(np.where(pairs > 0.0, terms, 0.0).sum() + np.where(first > 0.0, starts, 0.0).sum())


class LawChain(ChainFamily):
    """The chain that stands for a law with free numbers, moved by a few quasi-Newton steps.

    Parameters
    ----------
    law : SearchedLaw
        Where to begin.
    n_nodes : int
    n_steps : int
        At most so many steps each time.
    """

    def __init__(self, law: SearchedLaw, n_nodes: int, n_steps: int = 25) -> None:
        self._law, self._n_nodes, self._joint = law, n_nodes, law.on_cells(n_nodes)
        self._n_steps = n_steps
        self.class_weights = law.discretize(n_nodes).class_weights
        self.logits = np.clip(law.logits(), -_LOGIT, _LOGIT)
        self.n_parameters = self.logits.size
        self.joint = self._joint(self.logits)

    @property
    def initial(self) -> FloatArray:
        """Probabilities of the first node."""
        p: FloatArray = self.joint.sum(axis=1)
        return p

    @property
    def transition(self) -> FloatArray:
        """Transition matrix; a node without mass goes where the chain begins."""
        p = self.initial
        rows = np.where(p[:, None] > 0.0, self.joint, p)
        stochastic: FloatArray = rows / rows.sum(axis=1, keepdims=True)
        return stochastic

    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Raise the expected log-likelihood; see `ChainFamily.maximise`."""
        self._minimise(pairs, first, "L-BFGS-B", {"maxiter": self._n_steps})

    def settle(self, pairs: FloatArray, first: FloatArray) -> None:
        """Find the maximum without derivatives: at the widths of cells the masses of a band have kinks."""
        self._minimise(pairs, first, "Powell", {"xtol": 1e-7, "ftol": 1e-12})

    def _minimise(self, pairs: FloatArray, first: FloatArray, method: str, options: dict[str, float]) -> None:
        from scipy.optimize import minimize

        scale = 1.0 / max(float(pairs.sum()), 1.0)

        def loss(logits: FloatArray) -> float:
            value = _objective(np.maximum(self._joint(logits), 1e-300), pairs, first)
            return -value * scale

        bounds = [(-_LOGIT, _LOGIT)] * self.logits.size
        found = minimize(loss, self.logits, method=method, bounds=bounds, options=options)
        if found.fun < loss(self.logits):
            self.logits = found.x
            self.joint = self._joint(found.x)

    @property
    def vector(self) -> FloatArray:
        """The free numbers."""
        return self.logits

    def at(self, vector: FloatArray) -> Self | None:
        """Return the chain with these free numbers, or None beyond the bounds of the search."""
        if (np.abs(vector) > _LOGIT).any():
            return None
        moved = copy(self)
        moved.logits = vector
        moved.joint = moved._joint(vector)
        return moved

    def variants(self) -> list[Self]:
        """Return chains that the maximisation cannot reach from this one, but may be better."""
        others = map(self.at, self._law.elsewhere(self.logits, self._n_nodes))
        return [other for other in others if other is not None]

    def law(self) -> Any:
        """Return the law of the current numbers."""
        return self._law.from_logits(self.logits)


class FreeChain(ChainFamily):
    """Any chain on the nodes: expected frequencies are the maximum.

    What is impossible to begin with stays so.

    Parameters
    ----------
    class_weights : ndarray, shape (M, K)
    joint : ndarray, shape (M, M)
        Of two consecutive nodes, where to begin.
    make : callable, optional
        From joint probabilities to a law.
    """

    def __init__(
        self, class_weights: FloatArray, joint: FloatArray, make: Callable[[FloatArray], Any] | None = None
    ) -> None:
        self.class_weights, self.joint, self._make = class_weights, joint / joint.sum(), make
        self.n_parameters = int(np.count_nonzero(joint)) - len(joint)
        self._rows = self.joint / np.maximum(self.joint.sum(axis=1, keepdims=True), 1e-300)
        self._first = self.joint.sum(axis=1)

    @property
    def initial(self) -> FloatArray:
        """Probabilities of the first node."""
        first: FloatArray = self._first
        return first

    @property
    def transition(self) -> FloatArray:
        """Transition matrix."""
        rows: FloatArray = self._rows
        return rows

    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Take the expected frequencies."""
        left = pairs.sum(axis=1, keepdims=True)
        self._rows = np.where(left > 0.0, pairs / np.where(left > 0.0, left, 1.0), self._rows)
        self._rows = self._rows / self._rows.sum(axis=1, keepdims=True)
        self._first = first / first.sum()
        self.joint = pairs / pairs.sum()

    @property
    def vector(self) -> FloatArray:
        """Square roots of the probabilities, which stay finite where one vanishes."""
        roots: FloatArray = np.sqrt(np.append(self._rows.ravel(), self._first))
        return roots

    def at(self, vector: FloatArray) -> Self | None:
        """Return the chain with these square roots, rows brought to the sum one."""
        squares = vector * vector
        M = len(self.class_weights)
        rows, first = squares[: M * M].reshape(M, M), squares[M * M :]
        if not (rows.sum(axis=1) > 0.0).all() or not first.sum() > 0.0:
            return None
        moved = copy(self)
        moved._rows = rows / rows.sum(axis=1, keepdims=True)
        moved._first = first / first.sum()
        moved.joint = self.joint.sum(axis=1)[:, None] * moved._rows
        return moved

    def law(self) -> Any:
        """Return the law that stands for the chain.

        A law stands for a stationary chain; where this one began says little about it.
        """
        if self._make is None:
            raise ParameterError("law: a chain of hard regimes has no law of its own")
        try:
            stationary = stationary_distribution(self.transition)
        except ParameterError:  # parts that are never left: how often they were seen is all there is to say
            stationary = self.joint.sum(axis=1)
        return self._make(stationary[:, None] * self.transition)

"""Chains on nodes with free parameters: what the maximisation step of a law moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.registry import either
from fuzzykf.switching.laws.base import ParametricLaw
from fuzzykf.switching.laws.cells import CellLaw
from fuzzykf.switching.laws.chain import stationary_distribution
from fuzzykf.switching.laws.registry import LAWS, learned_laws

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["ChainFamily", "FreeChain", "LawChain", "family_of"]


#: Where a search may go, in logits.
_LOGIT = 15.0


class ChainFamily(ABC):
    """A chain on nodes whose joint masses depend on a few free numbers.

    Attributes
    ----------
    nodes : ndarray, shape (M,)
    joint : ndarray, shape (M, M)
        Current joint probabilities of two consecutive nodes.
    n_parameters : int
    """

    nodes: FloatArray
    joint: FloatArray
    n_parameters: int

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

    @abstractmethod
    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Raise sum pairs log P + sum first log pi.

        Parameters
        ----------
        pairs : ndarray, shape (M, M)
            Expected numbers of transitions.
        first : ndarray, shape (M,)
            Expected numbers of stretches that begin in each node.
        """

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
    family : type of ParametricLaw
    n_nodes : int
    start : ParametricLaw, optional
        Where to begin; by default where the family does.
    """

    def __init__(self, family: type[ParametricLaw], n_nodes: int, start: ParametricLaw | None = None) -> None:
        law = family.start() if start is None else start
        self.family, self.n_parameters = family, family.n_free
        self.nodes = law.discretize(n_nodes).nodes
        self._n_nodes, self._joint = n_nodes, family.on_cells(n_nodes)
        self.logits = np.clip(law.logits(), -_LOGIT, _LOGIT)
        self.joint = self._joint(self.logits)

    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
        """Raise the expected log-likelihood; see `ChainFamily.maximise`."""
        from scipy.optimize import minimize

        scale = 1.0 / max(float(pairs.sum()), 1.0)

        def loss(logits: FloatArray) -> float:
            value = _objective(np.maximum(self._joint(logits), 1e-300), pairs, first)
            return -value * scale

        bounds = [(-_LOGIT, _LOGIT)] * self.logits.size
        found = minimize(loss, self.logits, method="L-BFGS-B", bounds=bounds, options={"maxiter": 25})
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
        others = map(self.at, self.family.elsewhere(self.logits, self._n_nodes))
        return [other for other in others if other is not None]

    def law(self) -> ParametricLaw:
        """Return the law of the current numbers."""
        return self.family.from_logits(self.logits)


class FreeChain(ChainFamily):
    """Any chain on the nodes: expected frequencies are the maximum."""

    def __init__(self, nodes: FloatArray, joint: FloatArray) -> None:
        self.nodes, self.joint = nodes, joint / joint.sum()
        M = nodes.size
        self.n_parameters = M * (M - 1)
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
        M = self.nodes.size
        rows, first = squares[: M * M].reshape(M, M), squares[M * M :]
        if not (rows.sum(axis=1) > 0.0).all() or not first.sum() > 0.0:
            return None
        moved = copy(self)
        moved._rows = rows / rows.sum(axis=1, keepdims=True)
        moved._first = first / first.sum()
        moved.joint = self.joint.sum(axis=1)[:, None] * moved._rows
        return moved

    def law(self) -> CellLaw:
        """Return the law that is constant on the cells of the nodes.

        A law stands for a stationary chain; where this one began says little about it.
        """
        try:
            stationary = stationary_distribution(self.transition)
        except ParameterError:  # parts that are never left: how often they were seen is all there is to say
            stationary = self.joint.sum(axis=1)
        return CellLaw(stationary[:, None] * self.transition)


def family_of(kind: str, n_nodes: int, start: ParametricLaw | None = None) -> ChainFamily:
    """Return the chain of a law by name, at a starting law; a free chain begins at FMC1."""
    if kind not in learned_laws():
        raise ParameterError(f"law: got {kind!r}, expected {either(learned_laws())}")
    if issubclass(LAWS[kind], ParametricLaw):
        return LawChain(LAWS[kind], n_nodes, start)
    if LAWS[kind] is not CellLaw:
        raise ParameterError(f"law: the family {kind!r} says that it can be learned, but is no ParametricLaw")
    base = LawChain(LAWS["fmc1"], n_nodes, start)
    return FreeChain(base.nodes, base.joint)

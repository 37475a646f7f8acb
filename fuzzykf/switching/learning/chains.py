"""Chains on nodes with free parameters: what the maximisation step of a law moves.

With the rule "cell" the joint masses of FMC1 are linear in its parameters, and those
of FMC2 too once the width of the band is fixed, so a chain costs a few products.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chain import stationary_distribution
from fuzzykf.switching.laws.integration import cell_masses
from fuzzykf.switching.laws.law import FuzzyMarkovLaw
from fuzzykf.switching.learning.law import fmc1_from_logits, fmc2_from_logits, softmax

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["ChainFamily", "FMC1Chain", "FMC2Chain", "FreeChain", "family_of"]


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


class _LogitChain(ChainFamily):
    """A family with unconstrained parameters, moved by a few quasi-Newton steps."""

    logits: FloatArray

    @abstractmethod
    def _joint(self, logits: FloatArray) -> FloatArray: ...

    def maximise(self, pairs: FloatArray, first: FloatArray) -> None:
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
        """The unconstrained parameters."""
        return self.logits

    def at(self, vector: FloatArray) -> Self | None:
        """Return the chain with these parameters, or None beyond the bounds of the search."""
        if (np.abs(vector) > _LOGIT).any():
            return None
        moved = copy(self)
        moved.logits = vector
        moved.joint = moved._joint(vector)
        return moved


class FMC1Chain(_LogitChain):
    """FMC1 on the cells of F nodes."""

    n_parameters = 3

    def __init__(self, n_nodes: int, start: FuzzyMarkovLaw | None = None) -> None:
        self.nodes = np.concatenate([[0.0], (np.arange(n_nodes) + 0.5) / max(n_nodes, 1), [1.0]])
        bounds = np.linspace(0.0, 1.0, n_nodes + 1) if n_nodes else np.array([0.0])
        self._delta = _without_corners(cell_masses(FuzzyMarkovLaw.fmc1(0.0, 0.1, 0.0), bounds)) / 0.1
        self._eta = _without_corners(cell_masses(FuzzyMarkovLaw.fmc1(0.0, 0.0, 0.1), bounds)) / 0.1
        law = FuzzyMarkovLaw.fmc1(0.25, 0.03, 0.08) if start is None else start
        p = law.parameters
        shares = np.array([2 * p["alpha"], 2 * law.beta, 8 * p["eta"] / 3, 7 * p["delta"] / 3])
        shares = np.maximum(shares, 1e-4)
        self.logits = np.clip(np.log(shares[1:] / shares[0]), -_LOGIT, _LOGIT)
        self.joint = self._joint(self.logits)

    def _joint(self, logits: FloatArray) -> FloatArray:
        a, b, e, d = softmax(logits)
        joint = (3.0 * e / 8.0) * self._eta + (3.0 * d / 7.0) * self._delta
        joint[[0, -1], [0, -1]] = a / 2.0
        joint[[0, -1], [-1, 0]] = b / 2.0
        normalised: FloatArray = joint / joint.sum()
        return normalised

    def law(self) -> FuzzyMarkovLaw:
        """Return the law of the current parameters."""
        return fmc1_from_logits(self.logits)


class FMC2Chain(_LogitChain):
    """FMC2 on the cells of F nodes; the half width of the band is free too."""

    n_parameters = 3

    def __init__(self, n_nodes: int, start: FuzzyMarkovLaw | None = None) -> None:
        self.nodes = np.concatenate([[0.0], (np.arange(n_nodes) + 0.5) / max(n_nodes, 1), [1.0]])
        law = FuzzyMarkovLaw.fmc2(0.25, 0.3, 0.2) if start is None else start
        p = law.parameters
        shares = np.maximum(np.array([2 * p["alpha"], 2 * law.beta, 1 - 2 * p["alpha"] - 2 * law.beta]), 1e-4)
        width = np.clip(2.0 * p["delta"], 1e-3, 1.0 - 1e-3)
        self.logits = np.append(np.log(shares[1:] / shares[0]), np.log(width / (1.0 - width)))
        self.joint = self._joint(self.logits)

    def _delta(self, logits: FloatArray) -> float:
        return 0.5 / (1.0 + float(np.exp(-logits[2])))

    def _joint(self, logits: FloatArray) -> FloatArray:
        delta = self._delta(logits)
        a, b, band = softmax(logits[:2])
        joint = band / (delta * (6.0 - delta)) * _band_areas(self.nodes.size - 2, delta)
        joint[[0, -1], [0, -1]] = a / 2.0
        joint[[0, -1], [-1, 0]] = b / 2.0
        normalised: FloatArray = joint / joint.sum()
        return normalised

    def variants(self) -> list[Self]:
        """Return chains with other widths.

        A pair of nodes off the band has probability zero, and keeps it; one on its
        edge would have to lose all of it.  So the width hardly leaves the multiples of
        the width of a cell that it lies between.
        """
        F = self.nodes.size - 2
        edges = np.append(np.arange(0.0, 0.5, 1.0 / F), 0.5) if F else np.empty(0)
        chains = []
        for low, high in pairwise(edges.tolist()):
            if not low < self._delta(self.logits) <= high:
                width = low + high  # of the whole band, in the middle of the interval
                other = self.at(np.append(self.logits[:2], np.log(width / (1.0 - width))))
                if other is not None:
                    chains.append(other)
        return chains

    def law(self) -> FuzzyMarkovLaw:
        """Return the law of the current parameters."""
        return fmc2_from_logits(self.logits[:2], self._delta(self.logits))


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

    def law(self) -> FuzzyMarkovLaw:
        """Return the law that is constant on the cells of the nodes.

        A law stands for a stationary chain; where this one began says little about it.
        """
        from fuzzykf.switching.laws.cells import CellLaw

        try:
            stationary = stationary_distribution(self.transition)
        except ParameterError:  # parts that are never left: how often they were seen is all there is to say
            stationary = self.joint.sum(axis=1)
        return CellLaw(stationary[:, None] * self.transition)


def _without_corners(masses: FloatArray) -> FloatArray:
    masses = masses.copy()
    masses[np.ix_([0, -1], [0, -1])] = 0.0
    return masses


def _band_areas(F: int, delta: float) -> FloatArray:
    """Measure of the band |r1 - r2| <= delta in each pair of cells, (F + 2, F + 2), without the corners.

    In the square it depends on the distance of the cells alone: a second difference of
    the function whose second derivative is the indicator of the band.
    """
    areas = np.zeros((F + 2, F + 2))
    if F == 0:
        return areas
    cells = np.arange(F)
    edge = np.clip(delta - cells / F, 0.0, 1.0 / F)
    areas[0, 1:-1] = areas[1:-1, 0] = edge
    areas[-1, 1:-1] = areas[1:-1, -1] = edge[::-1]
    t = np.abs(np.arange(-1, F + 1) / F)
    second = np.where(t <= delta, 0.5 * t * t, delta * t - 0.5 * delta * delta)
    areas[1:-1, 1:-1] = np.maximum(np.diff(second, 2), 0.0)[np.abs(cells[:, None] - cells)]
    return areas


def family_of(kind: str, n_nodes: int, start: FuzzyMarkovLaw | None) -> ChainFamily:
    """Return the family of a law by name, at a starting law."""
    if kind == "fmc1":
        return FMC1Chain(n_nodes, start)
    if kind == "fmc2":
        return FMC2Chain(n_nodes, start)
    if kind == "free":
        base = FMC1Chain(n_nodes, start)
        return FreeChain(base.nodes, base.joint)
    raise ParameterError(f"law: got {kind!r}, expected 'fmc1', 'fmc2' or 'free'")

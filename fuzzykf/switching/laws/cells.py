"""A law that is constant on cells: what a free chain on the nodes stands for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, brief, is_whole
from fuzzykf.reprs import shown
from fuzzykf.switching.laws.chain import SwitchChain, hardened
from fuzzykf.switching.laws.fmc1 import FMC1
from fuzzykf.switching.laws.integration import Lines
from fuzzykf.switching.laws.law import FuzzyMarkovLaw, checked_pair
from fuzzykf.switching.laws.law_numbers import ChainNumbers
from fuzzykf.switching.laws.learners import FreeChain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["CellLaw"]


class CellLaw(FuzzyMarkovLaw):
    """Joint masses of F + 2 cells: 0, F equal cells of ]0, 1[, and 1.

    Unlike the laws of the paper it need not be symmetric: row and column sums are the
    probabilities before and after a step.

    Parameters
    ----------
    joint : array_like, shape (F + 2, F + 2)
        Masses, not negative; normalised to one.

    Examples
    --------
    >>> import numpy as np
    >>> law = CellLaw(np.full((3, 3), 1.0))
    >>> round(law.p_hard, 6)
    0.666667
    """

    kind = "free"
    learned = True

    def __init__(self, joint: ArrayLike) -> None:
        masses = as_array("joint", joint, (None, None))
        if masses.shape[0] != masses.shape[1] or len(masses) < 2:
            raise ParameterError(f"joint: got shape {masses.shape}, expected (F + 2, F + 2)")
        if (masses < 0.0).any() or not masses.sum() > 0.0:
            raise ParameterError(f"joint: expected masses that are not negative, got {masses.min():.6g}")
        self.masses = masses / masses.sum()
        self.masses.flags.writeable = False
        self.corners = self.masses[np.ix_([0, -1], [0, -1])]
        self._n_cells = self.own_nodes = len(masses) - 2

    @property
    def parameters(self) -> dict[str, float]:
        """No named parameters; see `masses`."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return the masses as plain lists."""
        return {"joint": self.masses.tolist()}

    @property
    def lines(self) -> Lines:
        """Where the density is not smooth: at the bounds of the cells."""
        return Lines(kinks=np.empty(0), breaks=np.linspace(0.0, 1.0, max(self._n_cells, 1) + 1), order=2)

    @classmethod
    def by_name(cls, n_nodes: int) -> Self:
        """Return the law of two classes from which a search begins: that of FMC1."""
        return cls(FMC1.on_cells(n_nodes)(FMC1.start().logits()))

    def learner(self, n_nodes: int) -> FreeChain:
        """Return a chain whose probabilities are all free."""
        return FreeChain(self.discretize(n_nodes).class_weights, self.masses, CellLaw)

    def free_numbers(self, n_nodes: int) -> ChainNumbers:
        """Return the probabilities of the chain on the cells, for an ascent."""
        return ChainNumbers(self.discretize(n_nodes), _of_chain)

    def _cell(self, r: FloatArray) -> np.ndarray:
        inner = np.minimum((r * self._n_cells).astype(int), max(self._n_cells - 1, 0)) + 1
        return np.where(r == 0.0, 0, np.where(r == 1.0, self._n_cells + 1, inner))

    def _width(self, r: FloatArray) -> FloatArray:
        return np.where((r == 0.0) | (r == 1.0), 1.0, 1.0 / max(self._n_cells, 1))

    def joint_density(self, r1: ArrayLike, r2: ArrayLike) -> FloatArray:
        """Return p(r1, r2), in this order."""
        a, b = checked_pair(r1, r2)
        if self._n_cells == 0:
            hard = ((a == 0.0) | (a == 1.0)) & ((b == 0.0) | (b == 1.0))
            return np.where(hard, self.masses[self._cell(a), self._cell(b)], 0.0)
        density: FloatArray = self.masses[self._cell(a), self._cell(b)] / (self._width(a) * self._width(b))
        return density

    def _edge(self, corner: FloatArray, r: FloatArray) -> FloatArray:
        return self.joint_density(corner, r)

    def _interior(self, r1: FloatArray, r2: FloatArray) -> FloatArray:
        return self.joint_density(r1, r2)

    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of the two hard regimes, (2, 2); ``n_nodes`` as in `discretize`."""
        return hardened(self.discretize(self._n_cells if n_nodes is None else n_nodes))

    def discretize(self, n_nodes: int, rule: str = "cell") -> SwitchChain:
        """Return the chain on the cells themselves.

        Raises
        ------
        ParameterError
            If another number of nodes or another rule is asked for.
        """
        given: Any = rule
        if not (is_whole(n_nodes) and n_nodes == self._n_cells and isinstance(given, str) and rule == "cell"):
            raise ParameterError(
                f"n_nodes, rule: got {brief(n_nodes)} and {brief(rule)}, expected {self._n_cells} and "
                "'cell', the cells on which this law was learned"
            )
        F = self._n_cells
        nodes = np.concatenate([[0.0], (np.arange(F) + 0.5) / max(F, 1), [1.0]])
        weights = np.concatenate([[1.0], np.full(F, 1.0 / max(F, 1)), [1.0]])
        initial = self.masses.sum(axis=1)
        rows = np.where(initial[:, None] > 0.0, self.masses, initial)
        return SwitchChain(nodes, weights, initial / initial.sum(), rows / rows.sum(axis=1, keepdims=True))

    @shown
    def __repr__(self) -> str:
        return f"CellLaw(n_nodes={self._n_cells})"


def _of_chain(chain: SwitchChain) -> CellLaw:
    return CellLaw(chain.initial[:, None] * chain.transition)

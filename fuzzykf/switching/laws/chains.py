"""A law that is given as a chain on nodes: any chain, such as that of another law with its numbers freed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count
from fuzzykf.reprs import shown
from fuzzykf.switching.laws.base import Law
from fuzzykf.switching.laws.chain import SwitchChain, hardened
from fuzzykf.switching.laws.edges import GraphicLaw, Link
from fuzzykf.switching.laws.law_numbers import ChainNumbers
from fuzzykf.switching.laws.learners import FreeChain

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["ChainLaw", "as_law"]


def as_law(law: Any) -> Law:
    """Return a law of the switch; a chain is made one.

    Raises
    ------
    ParameterError
        If it is neither.
    """
    if isinstance(law, SwitchChain):
        return ChainLaw(law)
    if not isinstance(law, Law):
        raise ParameterError(
            f"law: got {type(law).__name__}, expected a FuzzyMarkovLaw or another law, or a SwitchChain"
        )
    return law


class ChainLaw(GraphicLaw):
    """Law of a switch that moves on the nodes of a given chain.

    Learned, it is any chain on the same nodes in which no more is possible: the robust variant of a law
    of fades, whose cells need not be alike.

    Parameters
    ----------
    chain : SwitchChain
        On values with class weights of K classes.

    Notes
    -----
    The law has its nodes, so that ``n_nodes`` and ``rule`` of whoever puts it on nodes play no part.

    Examples
    --------
    >>> from fuzzykf import FadeLaw
    >>> law = ChainLaw(FadeLaw.between(40, 10).discretize(5))
    >>> law
    ChainLaw(n_classes=2, n_nodes=12)
    >>> round(law.p_hard, 6)
    0.8
    """

    kind = "chain"

    def __init__(self, chain: SwitchChain) -> None:
        if not isinstance(chain, SwitchChain):
            raise ParameterError(f"chain: got {type(chain).__name__}, expected a SwitchChain")
        if (chain.transition < 0.0).any():
            raise ParameterError(
                f"chain: got {chain.transition.min():.3g} in its transition matrix, expected probabilities, "
                "which are not negative"
            )
        self.chain = chain
        self.n_classes = chain.n_classes

    @property
    def parameters(self) -> dict[str, Any]:
        """Numbers of classes and of nodes; see `chain`."""
        return {"n_classes": self.n_classes, "n_nodes": len(self.chain)}

    def to_dict(self) -> dict[str, Any]:
        """Return the chain as plain lists."""
        names = ("nodes", "weights", "initial", "transition", "class_weights")
        return {name: getattr(self.chain, name).tolist() for name in names}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Make a law from what `to_dict` returned."""
        return cls(SwitchChain(**values))

    def discretize(self, n_nodes: int = 0, rule: str = "cell") -> SwitchChain:
        """Return the chain, whatever number of nodes is asked for."""
        as_count("n_nodes", n_nodes, 0)
        return self.chain

    def size(self, n_nodes: int) -> int:
        """Return the number of nodes, whatever number is asked for."""
        return len(self.chain)

    @property
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime."""
        return float(self.chain.initial[self.chain.atoms].sum())

    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of the classes that two consecutive nodes are nearest to, (K, K)."""
        return hardened(self.chain)

    def sample(self, n: int, rng: np.random.Generator, n_nodes: int | None = None) -> FloatArray:
        """Draw ``n`` consecutive values of the chain, (n,) or (n, K)."""
        return self.chain.sample(n, rng)

    def learner(self, n_nodes: int) -> FreeChain:
        """Return a chain with the same arrows, whose probabilities are all free."""
        start = self.chain.initial
        # what begins nowhere is possible all the same
        joint = np.where(start > 0.0, start, 1e-12)[:, None] * self.chain.transition
        return FreeChain(self.chain.class_weights, joint, self._of_joint)

    def free_numbers(self, n_nodes: int) -> ChainNumbers:
        """Return the probabilities of the same arrows, for an ascent."""
        return ChainNumbers(self.chain, ChainLaw)

    def _of_joint(self, joint: FloatArray) -> ChainLaw:
        initial = joint.sum(axis=1)
        rows = np.where(initial[:, None] > 0.0, joint, self.chain.transition)
        transition = rows / rows.sum(axis=1, keepdims=True)
        given = self.chain
        return ChainLaw(
            SwitchChain(given.nodes, given.weights, initial / initial.sum(), transition, given.class_weights)
        )

    def links(self) -> list[Link]:
        """Return how likely the switch, hardened, goes from class to class in a step."""
        joint = self.harden()
        mass = joint.sum(axis=1)
        gradual = bool((~self.chain.atoms).any())
        return [
            Link((a, b), f"{joint[a, b] / mass[a]:.3g}", gradual=gradual)
            for a, b in np.argwhere(joint > 0.0).tolist()
            if a != b
        ]

    @shown
    def __repr__(self) -> str:
        return f"ChainLaw(n_classes={self.n_classes}, n_nodes={len(self.chain)})"

"""What a law of the switch is to those who use it, whatever its family."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.immutable import Immutable
from fuzzykf.switching.laws.law_numbers import LogitNumbers
from fuzzykf.switching.laws.learners import LawChain

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain
    from fuzzykf.switching.laws.law_numbers import LawNumbers
    from fuzzykf.switching.laws.learners import ChainFamily

__all__ = ["NODES", "Law", "ParametricLaw", "Reach"]

#: Number of nodes that a law is put on where any will do and none is asked for.
NODES = 5


class Reach(NamedTuple):
    """Values of the switch, and which of them may follow one another."""

    class_weights: FloatArray  # (P, K)
    pairs: BoolArray  # (P, P): from the row to the column
    values: BoolArray  # (P,): which have mass or density


class Law(Immutable, ABC):
    """Law of the switch, a stationary Markov chain.

    Laws are immutable.  To add one, add a file to this folder and a line to
    `fuzzykf.switching.laws.registry`.
    """

    #: Name of the family: in `LAWS`, in files, and where a law to be learned is named.
    kind: ClassVar[str]
    #: Whether a search for a law of two classes can begin that is told the family alone.
    learned: ClassVar[bool] = False
    #: Number of nodes on which alone the law can be discretised; None where any will do.
    own_nodes: int | None = None
    #: Number K of hard regimes.
    n_classes: int = 2

    @abstractmethod
    def discretize(self, n_nodes: int, rule: str = "cell") -> SwitchChain:
        """Approximate the law by a Markov chain on finitely many nodes."""

    @abstractmethod
    def sample(self, n: int, rng: np.random.Generator, n_nodes: int | None = None) -> FloatArray:
        """Draw ``n`` consecutive values of the switch, on nodes or exactly."""

    @abstractmethod
    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of two consecutive hard regimes, (K, K)."""

    @property
    @abstractmethod
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime."""

    def size(self, n_nodes: int) -> int:
        """Return the total number of nodes of the discretised law.

        Parameters
        ----------
        n_nodes : int
            Number of nodes between two classes.

        Returns
        -------
        int
        """
        return self.n_classes + n_nodes

    def nodes_up_to(self, most: int) -> int:
        """Return the largest admissible number of nodes, at most ``most``.

        Parameters
        ----------
        most : int

        Returns
        -------
        int
        """
        return most if self.own_nodes is None else self.own_nodes

    def mean_dwell(self, n_nodes: int | None = None) -> FloatArray:
        """Return the mean number of steps that the switch stays in each regime.

        Parameters
        ----------
        n_nodes : int, optional
            Number of nodes of the chain, for laws that depend on it.

        Returns
        -------
        ndarray, shape (K,)
            NaN for a regime of probability zero; infinite for one that is never left.
        """
        joint, hard = self._joint(n_nodes)
        mass = joint.sum(axis=1)[hard]
        joint[np.diag_indices(len(joint))] = 0.0  # what leaves is summed, not a difference
        with np.errstate(divide="ignore", invalid="ignore"):
            dwell: FloatArray = np.where(mass > 0.0, mass / joint.sum(axis=1)[hard], np.nan)
        return dwell

    def mean_fade(self, n_nodes: int | None = None) -> float:
        """Return the mean number of steps of a gradual transition between regimes.

        Parameters
        ----------
        n_nodes : int, optional
            As in `mean_dwell`.

        Returns
        -------
        float
            NaN if the switch is always hard; infinite if it never is.
        """
        joint, hard = self._joint(n_nodes)
        between, left = float(joint[~hard].sum()), float(joint[np.ix_(hard, ~hard)].sum())
        if between == 0.0:
            return float("nan")
        return between / left if left > 0.0 else float("inf")

    def _joint(self, n_nodes: int | None) -> tuple[FloatArray, BoolArray]:
        """Joint probabilities of two consecutive nodes (M, M), and which of them are regimes (M,)."""
        chain = self.discretize(self.nodes_up_to(NODES) if n_nodes is None else n_nodes)
        joint: FloatArray = chain.initial[:, None] * chain.transition
        return joint, chain.atoms

    def reach(self, n: int) -> Reach:
        """Return a grid of values of the switch, and which may follow which.

        Models check their noise covariances on this grid.

        Parameters
        ----------
        n : int
            Largest number of values between two regimes.

        Returns
        -------
        Reach
        """
        chain = self.discretize(self.nodes_up_to(n))
        there = chain.initial > 0.0
        return Reach(chain.class_weights, there[:, None] & (chain.transition != 0.0), there)

    # ------------------------------------------------------------------ learning

    @classmethod
    def by_name(cls, n_nodes: int) -> Self:
        """Return the initial law of a search over the family, for two classes.

        Parameters
        ----------
        n_nodes : int
            Number of nodes between two classes.

        Returns
        -------
        Law

        Raises
        ------
        ParameterError
            If the family cannot be searched by name.
        """
        raise ParameterError(
            f"law: got {cls.kind!r}, a family that is not learned by name; expected a law of it, from which "
            "the search begins"
        )

    def learner(self, n_nodes: int) -> ChainFamily:
        """Return the discretised law as expectation-maximisation updates it.

        Parameters
        ----------
        n_nodes : int
            Number of nodes between two classes.

        Returns
        -------
        ChainFamily

        Raises
        ------
        ParameterError
            If the family cannot be learned.
        """
        raise ParameterError(f"law: got one of the kind {self.kind!r}, which cannot be learned")

    def free_numbers(self, n_nodes: int) -> LawNumbers:
        """Return the free parameters of the law for gradient ascent.

        Parameters
        ----------
        n_nodes : int
            Number of nodes between two classes.

        Returns
        -------
        LawNumbers

        Raises
        ------
        ParameterError
            If the family cannot be learned.
        """
        raise ParameterError(f"law: got one of the kind {self.kind!r}, which cannot be learned")

    def likeliest(self, paths: Sequence[FloatArray], n_nodes: int) -> Self:
        """Return the maximum-likelihood law of the same structure for known paths of the switch.

        By default, the likelihood is that of the chain on ``n_nodes`` nodes, with each value of the switch
        in its cell.

        Parameters
        ----------
        paths : sequence of ndarray, shape (n, K)
            Class weights.
        n_nodes : int

        Returns
        -------
        Law

        Raises
        ------
        ParameterError
            If the paths cannot come from the law.
        """
        from fuzzykf.switching.laws.known_paths import count_nodes

        learner = self.learner(n_nodes)
        pairs, first = count_nodes(paths, self.discretize(n_nodes))
        learner.settle(pairs, first)
        found: Self = learner.law()
        return found

    @abstractmethod
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the law."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, Any]:
        """The parameters of the law by name."""

    def numbers(self) -> dict[str, float]:
        """Return the parameters of the law by name, for tables.

        Returns
        -------
        dict of str to float
        """
        return {name: value for name, value in self.parameters.items() if isinstance(value, float)}

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments of the constructor as plain values, for a file.

        Returns
        -------
        dict
        """
        return self.parameters

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Create a law from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        Law
        """
        return cls(**values)


class ParametricLaw(Law):
    """A law given by a few numbers, which can be learned.

    For the search these become free numbers, the logits: any vector of them is a law.
    """

    learned = True
    #: How many logits there are.
    n_free: ClassVar[int]
    #: How many of them, the first ones, are those of shares of the mass, which are zero at minus infinity.
    n_shares: int = 0

    @classmethod
    @abstractmethod
    def start(cls) -> Self:
        """Return the law from which a search begins."""

    @classmethod
    def by_name(cls, n_nodes: int) -> Self:
        """Return the law from which a search begins."""
        return cls.start()

    @abstractmethod
    def logits(self) -> FloatArray:
        """Return the logits of the law; finite, so on the bounds of the family those of a close law."""

    @classmethod
    @abstractmethod
    def from_logits(cls, logits: FloatArray) -> Self:
        """Make the law of these logits, (n_free,)."""

    @classmethod
    def on_cells(cls, n_nodes: int) -> Callable[[FloatArray], FloatArray]:
        """Return the map from logits to joint probabilities of two consecutive nodes, (M, M).

        It is called at each step of a search; a family that knows a quicker way overrides it.
        """

        def joint(logits: FloatArray) -> FloatArray:
            chain = cls.from_logits(logits).discretize(n_nodes)
            masses: FloatArray = chain.initial[:, None] * chain.transition
            return masses

        return joint

    @classmethod
    def elsewhere(cls, logits: FloatArray, n_nodes: int) -> list[FloatArray]:
        """Return logits that a search on the nodes cannot reach from these, but may be better."""
        return []

    @classmethod
    def given(
        cls,
        before: FloatArray,
        after: FloatArray,
    ) -> tuple[Callable[[FloatArray], Self], int]:
        """Return what transitions of a known switch leave to be searched for.

        Parameters
        ----------
        before, after : ndarray, shape (n,)
            The switch before and after each transition.

        Returns
        -------
        callable, int
            A map to laws, and from how many free numbers; none, if the law is known.

        Raises
        ------
        ParameterError
            If the transitions cannot come from the family.
        """
        return cls.from_logits, cls.n_free

    def learner(self, n_nodes: int) -> ChainFamily:
        """Return the discretised law as expectation-maximisation updates it."""
        return LawChain(self, n_nodes)

    def estimates_of(self, law: Self) -> dict[str, float]:
        """Return what each logit of a law of this structure stands for, by names that a table can show.

        Unless a family knows better: the logits themselves.
        """
        return {f"logit {k}": float(value) for k, value in enumerate(law.logits())}

    def free_numbers(self, n_nodes: int) -> LawNumbers:
        """Return the logits, as free parameters for gradient ascent."""
        return LogitNumbers(self, n_nodes)

    def likeliest(self, paths: Sequence[FloatArray], n_nodes: int) -> Self:
        """Return the law of largest likelihood, whatever the number of nodes: the density is known."""
        from fuzzykf.switching.laws.known_paths import maximise_density

        before = np.concatenate([path[:-1, 1] for path in paths])
        after = np.concatenate([path[1:, 1] for path in paths])
        make, n_free = self.given(before, after)
        return maximise_density(make, n_free, before, after) if n_free else make(np.empty(0))

"""What dynamics are to those who use them, whatever their kind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, Self

from fuzzykf.errors import ParameterError
from fuzzykf.immutable import Immutable
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.exactness import Exactness

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.dynamics.placed import KnownPath
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["Dynamics"]


@reprs("n_classes", "dim_x", "dim_z")
class Dynamics(Immutable, ABC):
    """What Z = (X, Y) does, given the switch: the part of a model that can be placed on a chain.

    Dynamics never change.  New ones are a file, and a line in
    `fuzzykf.switching.dynamics.registry`.

    Attributes
    ----------
    n_classes, dim_x, dim_z : int
    order : int
        How many past observations a step conditions on, at most.
    """

    #: Name under which they are written to a file.
    kind: ClassVar[str]
    #: Name of the method that is exact along a known path of the switch.
    known_method: str = "exact"
    #: Name of the method that is exact on a chain, where one is: see `exactness`.
    exact_method: str = "exact"
    n_classes: int
    dim_x: int
    dim_z: int
    order: int = 1

    @property
    def cglssm(self) -> Any:
        """The state-space model that they were converted from, or None."""
        return None

    def exactness(self, chain: SwitchChain) -> Exactness:
        """Say whether filtering is exact on a chain."""
        return Exactness(True, "exact: Y alone is Markov given the switch")

    def facts(self) -> list[tuple[str, str]]:
        """Return what a table of the model says of them beside their kind."""
        return []

    @abstractmethod
    def placed(self, chain: SwitchChain) -> SwitchingSystem:
        """Return the dynamics on the nodes of a chain, as the recursion takes them.

        Raises
        ------
        NotPositiveDefiniteError
            If the noise is indefinite at a pair of nodes that can occur.
        """

    @abstractmethod
    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> KnownPath:
        """Return the dynamics along a known path of the switch.

        Parameters
        ----------
        shares : ndarray, shape (n, K)
            Shares of the regimes at each observation.
        r : ndarray, shape (n,)
            Values of the switch.
        start : int
            Index of the observation to which the first of them belongs.
        """

    def along_many(self, shares: FloatArray, r: FloatArray) -> Any:
        """Return the dynamics along known paths of the switch, side by side, from their first observations.

        Parameters
        ----------
        shares : ndarray, shape (s, n, K)
        r : ndarray, shape (s, n) or (s, n, K)
            As in `along`, of s paths.

        Returns
        -------
        object or None
            What `fuzzykf.switching.inference.known_paths` takes for the `known_method`; None where each path
            has to go alone, as by default.
        """
        return None

    @abstractmethod
    def simulate(self, shares: FloatArray, r: FloatArray, rng: np.random.Generator) -> Simulation:
        """Draw states and observations along a path of the switch, given as in `along`."""

    @abstractmethod
    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (..., d) and covariance (..., d, d) of Z_1 given the shares u (..., K) of r_1."""

    def closeness(self, weights: ArrayLike) -> float:
        """Compare the filter with the optimal one of `cglssm`; see `CGOMSModel.closeness`."""
        raise ParameterError(
            "closeness: got a model that stands for itself, expected one made by CGOMSModel.from_cglssm or "
            "SwitchingStateSpace.to_exact"
        )

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists, for a file."""

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Make them from what `to_dict` returned."""
        return cls(**values)

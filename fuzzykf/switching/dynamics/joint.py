"""Pairwise models on the nodes of a chain: the state of their filters is all of Z = (X, Y).

With j the node of arrival, Z' = A_j Z + offset_j + N(0, noise_j), and of Z the part Y is observed without
error: a state-space model with F = A, b = offset, Q = noise, H = [0 I], d = 0 and R = 0.  So what is observed
of Y has variance zero in it, what is missing has not, in any pattern and at any time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.gaussian import check_definite
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.nodes import NodeLaw, NodeTables
from fuzzykf.switching.dynamics.pairs import InitialLaw
from fuzzykf.switching.dynamics.placed import KnownPath

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["JointPath", "JointSystem", "WholeState", "law_of_whole"]


def law_of_whole(law: InitialLaw, q: int) -> NodeLaw:
    """Return the law of the first Z as that of a state, of which the last ``q`` components are seen."""
    M, d = law.mean.shape
    return NodeLaw.of_state(law.probability, law.mean, law.covariance, *_seen(M, d, q))


def _seen(M: int, d: int, q: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """H, d and R of M nodes: the last ``q`` components of the state, without error."""
    H = np.broadcast_to(np.eye(d)[d - q :], (M, q, d))
    return H, np.zeros((M, q)), np.zeros((M, q, q))


class WholeState:
    """A pairwise system as the recursions on nodes take it, Z being the state.

    Parameters
    ----------
    system : JointSystem or JointPath
    """

    order: int = 0

    def __init__(self, system: JointSystem | JointPath) -> None:
        self._system, self.chain, self.steady_from = system, system.chain, system.steady_from
        self.dim_x, self.dim_z = system.dim_x + system.dim_z, system.dim_z

    def initial(self) -> NodeLaw:
        """Return the law of (r_1, Z_1)."""
        return law_of_whole(self._system.initial(), self.dim_z)

    def pair_tables(self, n: int) -> NodeTables:
        """Return the tables of the step from observation ``n``."""
        tables: NodeTables = self._system.pair_tables(n)
        return tables

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of steps, (1, n, M, ...)."""
        return self._system.steps(start, n)


@reprs("chain", "dim_x", "dim_z")
class JointSystem:
    """A pairwise model on the nodes of a chain, with tables that do not depend on time.

    Parameters
    ----------
    chain : SwitchChain
        On the regimes.
    A, offset, noise : ndarray, shapes (K, d, d), (K, d), (K, d, d)
        Of each regime of arrival.
    means, covariances : ndarray, shapes (K, d) and (K, d, d)
        Of the first Z.
    dim_x : int

    Attributes
    ----------
    tables : NodeTables
        Of every step, Z being the state.

    Raises
    ------
    NotPositiveDefiniteError
        If the noise of the observation is singular in a regime that can be arrived at.
    """

    #: The window is the latest observation, which stands in the state.
    order: int = 1
    steady_from: int | None = 0
    dim_u: None = None

    def __init__(
        self,
        chain: SwitchChain,
        A: FloatArray,
        offset: FloatArray,
        noise: FloatArray,
        means: FloatArray,
        covariances: FloatArray,
        dim_x: int,
    ) -> None:
        K, d = means.shape
        self.chain, self.dim_x, self.dim_z = chain, dim_x, d - dim_x
        arrived = (chain.transition[chain.reachable] != 0.0).any(axis=0)
        check_definite(
            noise[:, dim_x:, dim_x:],
            lambda k: f"noise[{k[0]}], its block of the observation",
            strict=True,
            where=arrived,
        )
        noise = np.where(arrived[:, None, None], noise, np.eye(d))  # where no path leads nothing is asked
        self.tables = NodeTables(chain.transition, A, offset, noise, *_seen(K, d, self.dim_z))
        self.first = InitialLaw(chain.initial, means, covariances)
        self.whole = WholeState(self)

    def initial(self) -> InitialLaw:
        """Return the law of (r_1, Z_1)."""
        return self.first

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``, the same for all."""
        return self.tables

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of any steps, (1, 1, M, ...)."""
        return self.tables.space

    def law_to_dict(self, n: int) -> None:
        """Return what a file has to keep of the law at observation ``n``: nothing."""

    def restore_law(self, n: int, values: Mapping[str, Any] | None) -> None:
        """Take the law at observation ``n`` from a file: there is nothing to take."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class JointPath(KnownPath):
    """A pairwise model along known regimes.

    Parameters
    ----------
    A, offset, noise, means, covariances, dim_x
        As in `JointSystem`.
    r : ndarray, shape (n,)
        Regimes.
    """

    def __init__(
        self,
        A: FloatArray,
        offset: FloatArray,
        noise: FloatArray,
        means: FloatArray,
        covariances: FloatArray,
        dim_x: int,
        r: FloatArray,
    ) -> None:
        super().__init__(dim_x, means.shape[1] - dim_x, r)
        self._moves, self._first = (A, offset, noise), (means, covariances)
        self.whole = WholeState(self)

    def initial(self) -> InitialLaw:
        """Return the law of Z_1 in the first regime."""
        k = int(self.r[0])
        return InitialLaw(np.ones(1), *(one[k, None] for one in self._first))

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from the ``n``-th regime of the path to the next."""
        A, offset, noise = (one[int(self.r[n + 1]), None] for one in self._moves)
        seen = _seen(1, self.dim_x + self.dim_z, self.dim_z)
        return NodeTables(np.ones((1, 1)), A, offset, noise, *seen)

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of the steps to regimes start, ..., start + n - 1, (1, n, 1, ...)."""
        k = self.r[start : start + n].astype(np.intp)
        seen = _seen(1, self.dim_x + self.dim_z, self.dim_z)
        return tuple(one[k][None, :, None] for one in self._moves) + tuple(one[None, None] for one in seen)

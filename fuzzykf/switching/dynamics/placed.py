"""Systems: a Gaussian form placed on a chain, or on a known path of the switch."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables
from fuzzykf.switching.laws.chain import SwitchChain

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.forms import GaussianForm

__all__ = ["KnownPath", "StationarySystem"]


class StationarySystem:
    """A form on the nodes of a chain, with tables that do not depend on time.

    Parameters
    ----------
    chain : SwitchChain
    form : GaussianForm

    Raises
    ------
    NotPositiveDefiniteError
        If the noise is indefinite at a pair of nodes of positive probability; the
        message names the pair and the eigenvalue.  Nodes that no path visits are not asked.
    """

    order: int = 1
    steady_from: int | None = 0

    def __init__(self, chain: SwitchChain, form: GaussianForm) -> None:
        self.chain, self.form = chain, form
        self.dim_x, self.dim_z = form.dim_x, form.dim_z
        self.tables, self.first  # noqa: B018  (a system that exists is valid: both are proved now)

    @cached_property
    def tables(self) -> PairTables:
        """The tables of every step."""
        u, nodes = self.chain.class_weights, self.chain.nodes

        def describe(index: tuple[int, ...]) -> str:
            i, j = index
            return f"pair of nodes ({i}, {j}), r_n = {nodes[i]:.6g} and r_n+1 = {nodes[j]:.6g}"

        reached = (self.chain.transition != 0.0) & self.chain.reachable[:, None]
        pairs = self.form.pairs(u[:, None, :], u[None, :, :], describe, reached)
        return PairTables(self.chain.transition, pairs)

    @cached_property
    def first(self) -> InitialLaw:
        """The law of (r_1, Z_1)."""
        M, d, there = len(self.chain), self.dim_x + self.dim_z, self.chain.initial > 0.0
        mean, covariance = np.zeros((M, d)), np.broadcast_to(np.eye(d), (M, d, d)).copy()
        mean[there], covariance[there] = self.form.marginal(self.chain.class_weights[there])
        return InitialLaw(self.chain.initial, mean, covariance)

    def initial(self) -> InitialLaw:
        """Return the law of (r_1, Z_1)."""
        return self.first

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n``, the same for all."""
        return self.tables

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class KnownPath:
    """A form along a known path of the switch: one node, one pair of values per step.

    Parameters
    ----------
    form : GaussianForm
    shares : ndarray, shape (n, K)
        Shares of the regimes at each observation.
    r : ndarray, shape (n,)
        Values of the switch, for messages.
    """

    order: int = 1
    steady_from: int | None = None

    def __init__(self, form: GaussianForm, shares: FloatArray, r: FloatArray) -> None:
        self.form, self.shares, self.r = form, shares, r
        self.dim_x, self.dim_z = form.dim_x, form.dim_z
        self.chain = SwitchChain([0.0], [1.0], [1.0], [[1.0]])

    def initial(self) -> InitialLaw:
        """Return the law of Z_1 at the first value of the switch."""
        return InitialLaw(np.ones(1), *self.form.marginal(self.shares[:1]))

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n`` to ``n + 1``."""
        label = f"known pair r_n = {self.r[n]:.6g}, r_n+1 = {self.r[n + 1]:.6g} (n = {n})"
        u1, u2 = self.shares[n, None, None], self.shares[n + 1, None, None]
        return PairTables(np.ones((1, 1)), self.form.pairs(u1, u2, lambda _: label))

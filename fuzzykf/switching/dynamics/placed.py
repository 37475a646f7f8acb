"""Systems: dynamics placed on a chain, or on a known path of the switch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables
from fuzzykf.switching.laws.chain import SwitchChain, value_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import Describe, PairCoefficients

__all__ = ["GaussianPath", "GaussianPaths", "KnownPath", "Pairwise", "StationarySystem"]


class Pairwise(Protocol):
    """What depends on the latest two values of the switch alone: a `GaussianForm`, for instance."""

    @property
    def dim_x(self) -> int:
        """Number m of components of the state."""

    @property
    def dim_z(self) -> int:
        """Number q of components of an observation."""

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the shares of r_1."""

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step given the shares of r_n and r_{n+1}."""


@reprs("chain", "form")
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

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FadeLaw
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.broadcast_to(np.block([[z, 0.8 * z], [0.8 * z, z]]), (2, 2, 4, 4))
    >>> model = CGOFMSModel(FadeLaw.between(40, 10), np.zeros((2, 2)), pair, dim_x=1)
    >>> system = model.placed(n_nodes=5)
    >>> type(system).__name__, len(system.chain)
    ('StationarySystem', 12)
    """

    order: int = 1
    steady_from: int | None = 0

    def __init__(self, chain: SwitchChain, form: Pairwise) -> None:
        self.chain, self.form = chain, form
        self.dim_x, self.dim_z = form.dim_x, form.dim_z
        self.tables, self.first  # noqa: B018  (a system that exists is valid: both are proved now)

    @cached_property
    def tables(self) -> PairTables:
        """The tables of every step."""
        u, value = self.chain.class_weights, self.chain.describe

        def describe(index: tuple[int, ...]) -> str:
            i, j = index
            return f"pair of nodes ({i}, {j}), r_n = {value(i)} and r_n+1 = {value(j)}"

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
        """Return the law of (r_1, Z_1).

        Returns
        -------
        InitialLaw
        """
        return self.first

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n``, the same for all.

        Parameters
        ----------
        n : int
            Index of the observation before the step.

        Returns
        -------
        PairTables
        """
        return self.tables

    def law_to_dict(self, n: int) -> None:
        """Return what a file has to keep of the law at observation ``n``: nothing."""

    def restore_law(self, n: int, values: Mapping[str, Any] | None) -> None:
        """Take the law at observation ``n`` from a file: there is nothing to take."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class KnownPath(ABC):
    """A system along a known path of the switch: one node, one pair of values per step.

    Parameters
    ----------
    dim_x, dim_z : int
    r : ndarray, shape (n,) or (n, K)
        Values of the switch.
    order : int
    """

    steady_from: int | None = None
    #: Number of controls; None where there are none.
    dim_u: int | None = None
    #: How covariances are mixed in a model that has H and R, which may be told otherwise; None in others.
    mix: str | None = None

    def __init__(self, dim_x: int, dim_z: int, r: FloatArray, order: int = 1) -> None:
        self.dim_x, self.dim_z, self.order, self.r = dim_x, dim_z, order, r
        self.chain = _ONE_NODE

    @abstractmethod
    def initial(self) -> InitialLaw:
        """Return the law of Z_1 at the first value of the switch."""

    @abstractmethod
    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from the ``n``-th value of the path to the next."""


_ONE_NODE = SwitchChain([0.0], [1.0], [1.0], [[1.0]])


class GaussianPath(KnownPath):
    """A form along one known path of the switch.

    Parameters
    ----------
    form : GaussianForm
    shares : ndarray, shape (n, K)
        Shares of the regimes at each observation.
    r : ndarray, shape (n,) or (n, K)
        Values of the switch.
    """

    def __init__(self, form: Pairwise, shares: FloatArray, r: FloatArray) -> None:
        super().__init__(form.dim_x, form.dim_z, r)
        self.form, self.shares = form, shares

    def initial(self) -> InitialLaw:
        """Return the law of Z_1 at the first value of the switch."""
        return InitialLaw(np.ones(1), *self.form.marginal(self.shares[:1]))

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n`` to ``n + 1``."""
        label = _label(self.r, n)
        u1, u2 = self.shares[n, None, None], self.shares[n + 1, None, None]
        return PairTables(np.ones((1, 1)), self.form.pairs(u1, u2, lambda _: label))


class GaussianPaths:
    """A form along known paths of the switch, side by side.

    Parameters
    ----------
    form : GaussianForm
    shares : ndarray, shape (s, n, K)
        Shares of the regimes at each observation of each series.
    r : ndarray, shape (s, n) or (s, n, K)
        Values of the switch.
    """

    def __init__(self, form: Pairwise, shares: FloatArray, r: FloatArray) -> None:
        self.form, self.shares, self._r = form, shares, r
        self.dim_x, self.dim_z = form.dim_x, form.dim_z

    def first(self) -> tuple[FloatArray, FloatArray]:
        """Return means (s, d) and covariances (s, d, d) of Z_1 at the first values of the switch."""
        return self.form.marginal(self.shares[:, 0])

    def steps(self, start: int, n: int) -> PairCoefficients:
        """Return the regressions of the steps to values start, ..., start + n - 1, start and n at least 1."""
        u1, u2 = self.shares[:, start - 1 : start + n - 1], self.shares[:, start : start + n]
        return self.form.pairs(u1, u2, lambda k: _label(self._r[k[0]], start + k[1] - 1))


def _label(r: FloatArray, n: int) -> str:
    """Name the step from the ``n``-th value of a path (n,) or (n, K) to the next."""
    before, after = (value_of(r[k]) if r.ndim == 2 else f"{r[k]:.6g}" for k in (n, n + 1))
    return f"known pair r_n = {before}, r_n+1 = {after} (n = {n})"

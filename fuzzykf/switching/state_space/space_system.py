"""A switching state-space model placed on the nodes of a chain, or on a known path of the switch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.nodes import NodeLaw, NodeTables
from fuzzykf.switching.dynamics.placed import KnownPath

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["DrivenSystem", "SpacePath", "SpacePaths", "SpaceSystem"]

#: The parameters of a step.
NAMES = ("F", "b", "Q", "H", "d", "R")


class _Form(Protocol):
    """What a `StateSpaceForm` says of values of the switch."""

    dim_x: int
    dim_z: int
    dim_u: int | None
    mix: str

    def at(self, name: str, shares: FloatArray) -> FloatArray: ...

    def first_moments(self, chain: SwitchChain) -> tuple[FloatArray, FloatArray]: ...

    def state_at(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]: ...


@reprs("chain", "form")
class SpaceSystem:
    """A form on the nodes of a chain; without controls its tables do not depend on time.

    Parameters
    ----------
    chain : SwitchChain
    form : StateSpaceForm

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If a function of the class weights is not sound at a node that can occur.
    """

    order: int = 0
    steady_from: int | None = 0

    def __init__(self, chain: SwitchChain, form: _Form) -> None:
        self.chain, self.form = chain, form
        self.dim_x, self.dim_z, self.dim_u = form.dim_x, form.dim_z, form.dim_u
        there = chain.reachable
        names = NAMES if form.dim_u is None else (*NAMES, "B")
        parameters = {name: self._on_nodes(name, there) for name in names}
        #: How controls move the state at each node, (M, m, k); None without controls.
        self.B = parameters.pop("B", None)
        self.tables = NodeTables(chain.transition, **parameters)
        self.first = NodeLaw.of_state(
            chain.initial, *form.first_moments(chain), *(parameters[name] for name in ("H", "d", "R"))
        )

    def _on_nodes(self, name: str, there: Any) -> FloatArray:
        """Return a parameter at every node; something harmless where no path leads."""
        found = self.form.at(name, self.chain.class_weights[there])
        values = np.zeros((len(there), *found.shape[1:]))
        if name in ("Q", "R"):
            values[:] = np.eye(found.shape[-1])
        values[there] = found
        return values

    def initial(self) -> NodeLaw:
        """Return the law of (r_1, Z_1)."""
        return self.first

    def pair_tables(self, n: int) -> NodeTables:
        """Return the tables of the step from observation ``n``, without controls the same for all."""
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


@reprs("chain")
class DrivenSystem:
    """A system along a series of which it is told what moves and what sees the state.

    Parameters
    ----------
    system : SpaceSystem
    origin : int
        Number of the observation that what is given begins with.
    us : ndarray, shape (s, n, k), or None
        The controls that lead to each observation, s being 1 where all series share them.
    Hs, Rs : ndarray, shapes (s, n, M, q, m) and (s, n, M, q, q), or None
        In place of those of the model.
    """

    order: int = 0
    steady_from: int | None = None

    def __init__(
        self,
        system: SpaceSystem,
        origin: int,
        us: FloatArray | None = None,
        Hs: FloatArray | None = None,
        Rs: FloatArray | None = None,
    ) -> None:
        self.chain, self.dim_x, self.dim_z = system.chain, system.dim_x, system.dim_z
        self._system, self._origin, self._us, self._Hs, self._Rs = system, origin, us, Hs, Rs

    def initial(self) -> NodeLaw:
        """Return the law of (r_1, Z_1); of several series, the first one's."""
        if self._origin or (self._Hs is None and self._Rs is None):
            return self._system.initial()
        H, R = (None if one is None else one[0, 0] for one in (self._Hs, self._Rs))
        return self._system.initial().seen_by(H, R)

    def pair_tables(self, n: int) -> NodeTables:
        """Return the tables of the step from observation ``n``; of several series, the first one's."""
        parts = (one[0, 0] for one in self.steps(n + 1, 1))
        return NodeTables(self.chain.transition, *parts)

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of steps, (s, n, M, ...)."""
        F, b, Q, H, d, R = self._system.steps(start, n)
        part = slice(start - self._origin, start - self._origin + n)
        if self._us is not None:
            assert self._system.B is not None
            b = b + np.einsum("mak,snk->snma", self._system.B, self._us[:, part])
        H = H if self._Hs is None else self._Hs[:, part]
        R = R if self._Rs is None else self._Rs[:, part]
        return F, b, Q, H, d, R


class SpacePaths:
    """A form along known paths of the switch, side by side.

    Parameters
    ----------
    form : StateSpaceForm
    shares : ndarray, shape (s, n, K)
        Shares of the classes at each observation of each series.
    us : ndarray, shape (s, n, k), optional
        The control that leads to each; here and below s may be 1, where all series share them.
    Hs, Rs : ndarray, shapes (s, n, 1, q, m) and (s, n, 1, q, q), optional
        In place of those of the model.
    """

    def __init__(
        self,
        form: _Form,
        shares: FloatArray,
        us: FloatArray | None = None,
        Hs: FloatArray | None = None,
        Rs: FloatArray | None = None,
    ) -> None:
        self.form, self.shares, self._us, self._Hs, self._Rs = form, shares, us, Hs, Rs
        self.dim_x, self.dim_z = form.dim_x, form.dim_z

    def driven(
        self, us: FloatArray | None = None, Hs: FloatArray | None = None, Rs: FloatArray | None = None
    ) -> SpacePaths:
        """Return the same paths with what was told of their steps."""
        return SpacePaths(self.form, self.shares, us, Hs, Rs)

    def first(self) -> FloatArray:
        """Return the laws of the first states as engines take them, (s, 1 + m + m*m, 1)."""
        mean, covariance = self.form.state_at(self.shares[:, 0])
        rows = np.zeros((len(mean), 1)), mean, covariance.reshape(len(mean), -1)
        return np.concatenate(rows, axis=1)[..., None]

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of the steps to values start, ..., start + n - 1, (s, n, 1, ...)."""
        part = slice(start, start + n)
        u = self.shares[:, part]
        told = {name: one for name, one in (("H", self._Hs), ("R", self._Rs)) if one is not None}
        parts = {
            name: told[name][:, part] if name in told else self.form.at(name, u)[:, :, None] for name in NAMES
        }
        if self._us is not None:
            moved = self.form.at("B", u) @ self._us[:, part, :, None]
            parts["b"] = parts["b"] + np.swapaxes(moved, -1, -2)
        return tuple(parts.values())


class SpacePath(KnownPath):
    """A form along one known path of the switch.

    Parameters
    ----------
    form : StateSpaceForm
    shares : ndarray, shape (n, K)
        Shares of the classes at each observation.
    r : ndarray, shape (n,) or (n, K)
        Values of the switch.
    *told : ndarray
        As ``us``, ``Hs`` and ``Rs`` of `SpacePaths`, of one series.
    """

    def __init__(self, form: _Form, shares: FloatArray, r: FloatArray, *told: FloatArray | None) -> None:
        super().__init__(form.dim_x, form.dim_z, r, order=0)
        self.form, self.shares, self.dim_u, self.mix = form, shares, form.dim_u, form.mix
        self._paths = SpacePaths(form, shares[None], *told)

    def driven(
        self, us: FloatArray | None = None, Hs: FloatArray | None = None, Rs: FloatArray | None = None
    ) -> SpacePath:
        """Return the same path with what was told of its steps."""
        return SpacePath(self.form, self.shares, self.r, us, Hs, Rs)

    def initial(self) -> NodeLaw:
        """Return the law of Z_1 at the first value of the switch."""
        H, d, R = (one[0, 0] for one in self._paths.steps(0, 1)[3:])
        return NodeLaw.of_state(np.ones(1), *self.form.state_at(self.shares[:1]), H, d, R)

    def pair_tables(self, n: int) -> NodeTables:  # type: ignore[override]
        """Return the tables of the step from the ``n``-th value of the path to the next."""
        return NodeTables(np.ones((1, 1)), *(one[0, 0] for one in self.steps(n + 1, 1)))

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of the steps to values start, ..., start + n - 1, (1, n, 1, ...)."""
        return self._paths.steps(start, n)

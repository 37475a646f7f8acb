"""IMM and GPB2 in pairwise form: filters whose state is all of Z = (X, Y), of which X is shown.

Per pair of nodes (i, j) the joint moments of Z' = (X', Y') are

    zhat = A_j z_i + offset_j,    Phat = A_j P_i A_j' + noise_j,

and are conditioned on what is there of Y'.  That is the recursion of `fuzzykf.switching.inference.on_nodes`
with Z for a state that is seen in part without error; what is observed has variance zero in it afterwards.

GPB2 is exact where `fuzzykf.switching.dynamics.exactness` says so, as long as nothing is missing that several
histories tell of differently: C_j z of a node has one law, whatever came before the node.  IMM, which
merges before it moves, is exact where the state does not act on the next observation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, final

import numpy as np

from fuzzykf.switching.dynamics.joint import law_of_whole
from fuzzykf.switching.inference.method import Known, Method, tables_to
from fuzzykf.switching.inference.mixture import Mixture, Source
from fuzzykf.switching.inference.on_nodes import GPB2, IMM
from fuzzykf.switching.inference.series import Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.fixed_lag import Nodes
    from fuzzykf.switching.dynamics.pairs import Ahead, InitialLaw, PairTables
    from fuzzykf.switching.inference.method import Smoothed
    from fuzzykf.switching.inference.on_nodes import OnNodes
    from fuzzykf.switching.inference.series import Stand

__all__ = ["JOINT_GPB2", "JOINT_IMM", "OnJointNodes"]


@final
class OnJointNodes(Method):
    """Filtering of pairwise models on the nodes of a switch; see `Method`.

    A `Mixture` of it has the latest observation for its window, all of which stands in the table: the
    components that were seen with variance zero.

    Parameters
    ----------
    name : str
        Under which this module holds it.
    nodes : OnNodes
        The recursion.
    """

    def __init__(self, name: str, nodes: OnNodes) -> None:
        self.name, self._nodes = name, nodes

    def __repr__(self) -> str:
        return self.name

    def __reduce__(self) -> str | tuple[Any, ...]:
        return self.name  # there is one alone, whoever copies or pickles it

    def first(self, law: InitialLaw, y: FloatArray) -> tuple[Mixture, float]:
        """Condition the law of (r_1, Z_1) on y_1, (q,), NaN where missing."""
        mixture, value = self._nodes.first(law_of_whole(law, y.size), y)
        return _windowed(mixture, y.size), value

    def advance(
        self, tables: PairTables, mixture: Mixture, y: FloatArray, width: int
    ) -> tuple[Mixture, float]:
        """Take the next observation, (q,), NaN where missing, into account; see `OnNodes.advance`."""
        nodes: Any = tables
        found, value = self._nodes.advance(nodes, mixture, y, width)
        return _windowed(found, y.size), value

    def ahead(self, tables: PairTables, mixture: Mixture) -> Ahead:
        """Moments of (X', Y') and the probabilities of the nodes before Y' is seen."""
        nodes: Any = tables
        found = self._nodes.ahead(nodes, mixture)
        m = found.x.size - found.z.size
        return found._replace(x=found.x[:m], P=found.P[:m, :m])

    def run(
        self,
        system: Any,
        ys: FloatArray,
        names: tuple[str, ...],
        *,
        states: bool | Literal["nodes"] = False,
        stand: Stand | None = None,
    ) -> Trajectory:
        """Filter a series (n, q); with ``states`` the field ``joint`` is the table of all of Z."""
        m, q = system.dim_x, system.dim_z
        found = self._nodes.run(system.whole, ys, names, states=states, stand=stand)
        fields = _of_state(found.fields, m)
        if states:
            fields["joint"] = found.fields["table"]
        last, before = found.last, found.before
        return Trajectory(
            fields,
            {},
            None if last is None else _windowed(last, q),
            None if before is None else Source(_windowed(before.mixture, q), before.tables),
        )

    def run_many(
        self,
        system: Any,
        series: FloatArray,
        names: tuple[str, ...],
        threads: int = 1,
        stand: Stand | None = None,
    ) -> dict[str, FloatArray]:
        """Filter series (s, n, q) side by side."""
        return _of_state(self._nodes.run_many(system.whole, series, names, threads, stand), system.dim_x)

    def smooth(self, system: Any, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
        """Estimate every state of a filtered series from all of it, see `OnNodes.smooth`."""
        m, whole = system.dim_x, replace(trajectory, fields={"table": trajectory.fields["joint"]})
        found = self._nodes.smooth(system.whole, whole, ys)
        return found._replace(x=found.x[..., :m], P=found.P[..., :m, :m])

    def known_along(self, system: Any, trajectory: Trajectory, ys: FloatArray) -> list[Known]:
        """Return what was known after each observation of a series (n, q)."""
        table, steps = trajectory.fields["joint"], tables_to(system, len(ys))
        states = zip(table, steps, ys, strict=True)
        return [Known(_windowed(Mixture(one, y), y.size), step, y) for one, step, y in states]

    def look_back(self, system: Any, states: Sequence[Known]) -> Nodes:
        """Estimate what was known after some observations in a row from all of them."""
        m, found = system.dim_x, self._nodes.look_back(system.whole, states)
        return found._replace(x=found.x[..., :m], P=found.P[..., :m, :m])


def _windowed(mixture: Mixture, q: int) -> Mixture:
    """Return what is known of (X, Y) with Y for the window."""
    return Mixture(mixture.table, np.full(q, np.nan), None, None, q)


def _of_state(fields: dict[str, FloatArray], m: int) -> dict[str, FloatArray]:
    """Return fields (..., d) and (..., d, d) of Z as those of X."""
    shown = dict(fields)
    for name in ("x", "x_prior"):
        if name in shown:
            shown[name] = shown[name][..., :m].copy()
    for name in ("P", "P_prior"):
        if name in shown:
            shown[name] = shown[name][..., :m, :m].copy()
    if "table" in shown:
        table = shown["table"]
        d = int(np.sqrt(table.shape[-2]))  # of 1 + d + d*d rows
        at = 1 + d + np.arange(d * d).reshape(d, d)[:m, :m].ravel()
        shown["table"] = table[..., np.concatenate([np.arange(1 + m), at]), :]
    return shown


#: Merged before each step.
JOINT_IMM = OnJointNodes("JOINT_IMM", IMM)

#: Merged after each pair was conditioned: exact under the condition of exactness.
JOINT_GPB2 = OnJointNodes("JOINT_GPB2", GPB2)

"""What a method of filtering is: a few functions on mixtures."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.dynamics.pairs import Ahead, InitialLaw, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.mixture import Mixture
    from fuzzykf.switching.inference.series import Trajectory

__all__ = ["Method", "Smoothed"]


class Smoothed(NamedTuple):
    """What a whole series says of every time."""

    mu: FloatArray  # (n, M)
    x: FloatArray  # (n, M, m): given each node
    P: FloatArray  # (n, M, m, m)
    path: IntArray  # (n,): numbers of the nodes of the most likely path


class Method(Protocol):
    """How a placed system is filtered; the one state is a `Mixture`.

    A method holds no state of its own: filters, series and smoothers call it with what they know.
    """

    def first(self, law: InitialLaw, y: FloatArray) -> tuple[Mixture, float]:
        """Condition the initial law on the first observation (q,), NaN where missing."""

    def advance(
        self, tables: PairTables, mixture: Mixture, y: FloatArray, width: int
    ) -> tuple[Mixture, float]:
        """Take the next observation into account, and keep a window of ``width`` numbers."""

    def ahead(self, tables: PairTables, mixture: Mixture) -> Ahead:
        """Say what is known of the next time before its observation is seen."""

    def series(
        self,
        system: SwitchingSystem,
        tables: PairTables,
        begin: tuple[FloatArray | None, ...],
        ys: FloatArray,
        start: int,
        stop: int,
        out: dict[str, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Filter complete observations start, ..., stop - 1 of series (s, n, q) under constant tables.

        As `fuzzykf.engine.numpy.series.filter_series`, which see.
        """

    def smooth(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
        """Estimate every state of a filtered series (n, q) from all of it."""

"""What a method of filtering is: a few functions on mixtures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import NumericalRangeError, ParameterError
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.series import filter_many, filter_one

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.selected import GapState
    from fuzzykf.fixed_lag import Nodes
    from fuzzykf.switching.dynamics.pairs import Ahead, InitialLaw, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.series import Stand, Trajectory

__all__ = ["Known", "Method", "Smoothed", "out_of_range", "tables_to"]


class Smoothed(NamedTuple):
    """What a whole series says of every time."""

    mu: FloatArray  # (n, M)
    x: FloatArray  # (n, M, m): given each node
    P: FloatArray  # (n, M, m, m)
    path: IntArray | None  # (n,): numbers of the nodes of the most likely path; None if it is not looked for


class Known(NamedTuple):
    """What a filter knows after an observation, and how it came there."""

    mixture: Mixture
    tables: PairTables | None  # of the step to it; None at the first observation of all
    y: FloatArray  # (q,): the observation, NaN where missing


class Method(Protocol):
    """Filtering method of a switching system; the state of the filter is a `Mixture`.

    A method has no state of its own.  A subclass implements `first`, `advance` and `ahead`; whole series are
    then filtered step by step, without a smoother.
    """

    #: Whether it is GPB2: a step is taken for every pair of nodes.
    every_pair: bool = False

    @property
    def streams(self) -> bool:
        """Whether the engine may take steps by itself, those of the method being its own."""
        return False

    def first(self, law: InitialLaw, y: FloatArray) -> tuple[Mixture, float]:
        """Condition the initial law on the first observation (q,), NaN where missing.

        Parameters
        ----------
        law : InitialLaw
        y : ndarray, shape (q,)

        Returns
        -------
        mixture, log_likelihood
            The log-likelihood is that of the parts that are there; 0 if none is.
        """

    def advance(
        self, tables: PairTables, mixture: Mixture, y: FloatArray, width: int
    ) -> tuple[Mixture, float]:
        """Take the next observation (q,) into account, and keep a window of ``width`` numbers.

        Parameters, and what is returned, are those of `Exact.advance`.
        """

    def ahead(self, tables: PairTables, mixture: Mixture) -> Ahead:
        """Predict state, observation and switch at the next step.

        Parameters
        ----------
        tables : PairTables
        mixture : Mixture
            State after the latest observation.

        Returns
        -------
        Ahead
            Prediction for the next step.
        """

    def series(
        self,
        system: SwitchingSystem,
        tables: PairTables,
        begin: tuple[FloatArray | None, ...],
        ys: FloatArray,
        start: int,
        stop: int,
        out: dict[str, FloatArray],
        mass: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Filter complete observations start, ..., stop - 1 of series (s, n, q) under constant tables.

        Parameters, and what is returned, are those of `fuzzykf.engine.numpy.series.filter_series`.
        """
        states: list[tuple[FloatArray, FloatArray]] = []
        if mass is not None:
            mass[:] = np.nan
        for k in range(len(ys)):
            mixture = None
            if start:
                table, sign = begin
                assert table is not None
                window = ys[k, max(0, start - system.order) : start][::-1].ravel()
                mixture = Mixture(table[k], window, None if sign is None else sign[k])
            part = {name: values[k : k + 1] for name, values in out.items()}
            states.append(self._series(system, tables, mixture, ys[k], start, stop, part))
        before, last = zip(*states, strict=True)
        return np.array(before), np.array(last)

    @property
    def takes_gaps(self) -> bool:
        """Whether it has a `gappy_series`, as `Exact` has, for whole series with gaps."""
        return False

    def gappy_series(
        self,
        system: SwitchingSystem,
        tables: PairTables,
        begin: tuple[FloatArray, ...] | GapState,
        ys: FloatArray,
        start: int,
        stop: int,
        out: dict[str, FloatArray],
        mass: FloatArray,
        kept: dict[int, GapState] | None = None,
    ) -> tuple[FloatArray, IntArray, tuple[GapState, GapState]]:
        """Filter observations start, ..., stop - 1 of series, any of which may be missing.

        Parameters, and what is returned, are those of `Exact.gappy_series`.

        Raises
        ------
        ParameterError
            If the method has none.
        """
        name = getattr(self, "name", type(self).__name__)
        raise ParameterError(f"filter: the method {name} takes series with gaps step by step")

    def _series(
        self,
        system: SwitchingSystem,
        tables: PairTables,
        mixture: Mixture | None,
        ys: FloatArray,
        start: int,
        stop: int,
        out: dict[str, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Do a series of `series` step by step."""
        chain, before = system.chain, mixture
        for k in range(start, stop):
            before = mixture
            if mixture is None:
                mixture, value = self.first(system.initial(), ys[k])
            else:
                if "x_prior" in out or "P_prior" in out:
                    prior = self.ahead(tables, mixture)
                    for name, moment in (("x_prior", prior.x), ("P_prior", prior.P)):
                        if name in out:
                            out[name][:, k] = moment
                mixture, value = self.advance(tables, mixture, ys[k], min(k + 1, system.order) * ys.shape[1])
            sign = mixture.sign
            if sign is None and chain.is_signed:
                sign = np.ones(len(chain.nodes))
            engine.summarise(
                out,
                slice(k, k + 1),
                mixture.table[None, None],
                None if sign is None else sign[None, None],
                np.array([[value]]),
                (chain.keys, chain.weights, chain.atoms, chain.ranking),
            )
        assert mixture is not None
        return (mixture if before is None else before).table, mixture.table

    if TYPE_CHECKING:

        def run(
            self,
            system: SwitchingSystem,
            ys: FloatArray,
            names: tuple[str, ...],
            *,
            states: bool | Literal["nodes"] = False,
            stand: Stand | None = None,
        ) -> Trajectory:
            """Filter a series (n, q), as `fuzzykf.switching.inference.series.filter_one` says."""
            return filter_one(self, system, ys, names, states=states, stand=stand)

        def run_many(
            self,
            system: SwitchingSystem,
            series: FloatArray,
            names: tuple[str, ...],
            threads: int = 1,
            stand: Stand | None = None,
        ) -> dict[str, FloatArray]:
            """Filter series (s, n, q), as `fuzzykf.switching.inference.series.filter_many` says."""
            return filter_many(self, system, series, names, threads, stand)

    else:  # no calls that do no more than call another
        run, run_many = filter_one, filter_many

    def smooth(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
        """Estimate every state of a filtered series (n, q) from all of it.

        Parameters
        ----------
        system : SwitchingSystem
        trajectory : Trajectory
            Result of the filter.
        ys : ndarray, shape (n, q)
            Observations; NaN where missing.

        Returns
        -------
        Smoothed

        Raises
        ------
        ParameterError
            If the method has no smoother.
        """
        name = getattr(self, "name", type(self).__name__)
        raise ParameterError(f"smooth: the method {name} has no smoother")

    def known_along(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> list[Known]:
        """Return what was known after each observation of a filtered series (n, q), for `look_back`.

        Parameters
        ----------
        system : SwitchingSystem
        trajectory : Trajectory
            Result of the filter.
        ys : ndarray, shape (n, q)
            Observations; NaN where missing.

        Returns
        -------
        list of Known

        Raises
        ------
        ParameterError
            If the method cannot look back.
        """
        name = getattr(self, "name", type(self).__name__)
        raise ParameterError(f"smooth_lag: the method {name} cannot look back")

    def look_back(self, system: SwitchingSystem, states: Sequence[Known]) -> Nodes:
        """Estimate what was known after some observations in a row from all of them.

        Parameters
        ----------
        system : SwitchingSystem
            Its tables are not asked: those of each step stand in ``states``.
        states : sequence of Known
            One at least.

        Returns
        -------
        Nodes

        Raises
        ------
        ParameterError
            If the method cannot look back.
        """
        name = getattr(self, "name", type(self).__name__)
        raise ParameterError(f"smooth_lag: the method {name} cannot look back")


def tables_to(system: SwitchingSystem, n: int) -> Iterator[PairTables | None]:
    """Return the tables of the steps to each of n observations; None to the first."""
    steady, tables = system.steady_from, None
    for k in range(n):
        if k and (tables is None or steady is None or k <= steady + 1):
            tables = system.pair_tables(k - 1)
        yield tables


def out_of_range(y: FloatArray, limit: float = 1e150) -> NumericalRangeError:
    """Return what is said of an observation (q,) from which what follows leaves the range of numbers."""
    return NumericalRangeError(
        f"observation: got {y.tolist()}, and double precision cannot hold what follows from it; expected a "
        f"value within {limit:g} standard deviations and means below {engine.LARGEST_MEAN:g}, or NaN if it "
        "is missing"
    )

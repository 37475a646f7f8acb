"""The exact recursion of every switching filter (2020 paper, section IV), and what it does in gaps.

With the tables of a step (`fuzzykf.switching.dynamics.pairs`), the window w of the latest
observations and the new observation y':

    log w_ij = log p_i + log P_ij + log N(y'; Ayy w + Ny, Qyy)                  (10)
    log p(y' | y_1..n) = logsumexp of all log w_ij                              (11)
    p'_j = sum_i w_ij / sum of all w                                            (13)
    o_ij = w_ij / sum_k w_kj                                                    (14)
    x_ij = Axx x_i + H w + G y' + c,    P_ij = Axx P_i Axx' + C            (15)-(18)
    x'_j = sum_i o_ij x_ij                                                      (19)
    P'_j = sum_i o_ij (P_ij + (x_ij - x'_j)(x_ij - x'_j)')                      (20)

Second moments are central, unlike in the paper, where they cancel.  The arithmetic is that of
`fuzzykf.engine.numpy.switching`.

The next observation is predicted from the latest ones, so a gap leaves not only X but also a
part of the window unknown, which is then estimated with X; and the components of a node, one for each
node before it, stay apart until the next complete observation.  The result is exact for gaps of one
observation (in whole or in part, in models of order one), for a single class, for gaps at the end of a series
(hence for forecasts of means and covariances), and where the missing parts say nothing of later
observations.  With several classes an observation after a longer gap makes it an approximation, in which mean
and covariance stand for what came before the latest two nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.switching.dynamics.inputs import DrivenSystem
from fuzzykf.switching.dynamics.pairs import Ahead
from fuzzykf.switching.inference.driven import filter_stretch
from fuzzykf.switching.inference.method import Known, Method, out_of_range, tables_to
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.signed import check_signed, too_coarse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.selected import GapState
    from fuzzykf.fixed_lag import Nodes
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.method import Smoothed
    from fuzzykf.switching.inference.series import Trajectory

__all__ = ["EXACT", "Exact"]


class Exact(Method):
    """Exact filtering of systems in which Y alone is Markov given the switch; see `Method`."""

    def __repr__(self) -> str:
        return "EXACT"

    def first(self, law: InitialLaw, y: FloatArray) -> tuple[Mixture, float]:
        """Condition the law of (r_1, Z_1) on y_1, (q,), NaN where missing; no dynamics come before it."""
        start = law.start(y.size)
        if is_complete(y):
            table, log_likelihood = engine.first_step(*start, y[None])
            if not (log_likelihood[0] > engine.FARTHEST and engine.is_in_range(table[0])):
                raise out_of_range(y)
            return Mixture(table[0], y), float(log_likelihood[0])
        table, root, value = engine.first_step_in_part(*start[:3], y)
        if not (value > engine.FARTHEST and engine.is_in_range(table)):
            raise out_of_range(y)
        return Mixture(table, y, unknown=int(np.isnan(y).sum()), root=root), value

    def advance(self, tables: Any, mixture: Mixture, y: FloatArray, width: int) -> tuple[Mixture, float]:
        """Take the next observation, (q,), NaN where missing, into account.

        Parameters
        ----------
        tables : PairTables or DrivenTables
        mixture : Mixture
        y : ndarray, shape (q,)
        width : int
            Length of the window after it.

        Returns
        -------
        mixture, log_likelihood
            The log-likelihood is that of the parts that are there; 0 if none is.
        """
        window = y if width == y.size else np.concatenate([y, mixture.window])[:width]
        if not mixture.unknown and is_complete(y):
            seen = tables.window(mixture.window, y) if tables.is_driven else mixture.window
            table, sign, log_likelihood = engine.step(tables.kernel, mixture.table, mixture.sign, seen, y)
            if sign is not None:
                check_signed(table, sign)
            if not (log_likelihood > engine.FARTHEST and engine.is_in_range(table)):
                raise out_of_range(y)
            return Mixture(table, window, sign), log_likelihood
        before = mixture.window
        if tables.is_driven:
            before = tables.without_features(before)
            tables = self._in_gap(tables, mixture, y)
        known = mixture.table, mixture.sign, before, mixture.root
        try:
            table, sign, root, branches, log_likelihood = engine.step_in_part(
                tables.gaps, *known, y, window, mixture.branches
            )
        except np.linalg.LinAlgError as error:
            if mixture.sign is None and not (tables.transition < 0.0).any():
                raise
            raise too_coarse("a pair of nodes that gives the observation no density") from error
        if sign is not None:
            check_signed(table, sign)
        if not (log_likelihood > engine.FARTHEST and engine.is_in_range(table)):
            raise out_of_range(y)
        unknown = int(np.isnan(window).sum())
        left = root if unknown else None
        return Mixture(table, window, sign, None, unknown, left, branches), log_likelihood

    def _in_gap(self, tables: Any, mixture: Mixture, y: FloatArray) -> PairTables:
        """Return the tables of a step in which something of y' or of the window is missing."""
        if tables.next_law is None:
            missing = np.isnan(y)
            law = self.ahead(tables, mixture) if tables.reads_next and missing.any() else None
            mean = y if law is None else np.where(missing, law.z, y)
            variance = 0.0 * y if law is None else np.where(missing, np.diagonal(law.S), 0.0)
            tables = tables.with_next(mean, variance)
        found: PairTables = tables.in_gap(*tables.next_law)
        return found

    def ahead(self, tables: Any, mixture: Mixture) -> Ahead:
        """Moments of (X', Y') and the probabilities of the nodes before Y' is seen."""
        m = tables.pairs.Axx.shape[-1]

        def moments(tables: Any, window: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            return engine.before_step(tables.in_slots, mixture.table, mixture.sign, window, mixture.mass)

        if not tables.is_driven:
            mu, mean, covariance = moments(tables, mixture.window)
        else:
            window = tables.without_features(mixture.window)
            mu, mean, covariance = moments(tables.in_gap(), window)
            if tables.reads_next:  # features of Y' have the normal law of its mean and covariance
                law = mean[m:], np.diagonal(covariance)[m:]
                mu, mean, covariance = moments(tables.in_gap(*law), window)
        return Ahead(mu, mean[:m], covariance[:m, :m], mean[m:], covariance[m:, m:])

    @property
    def streams(self) -> bool:
        """Whether the engine may take steps by itself: not where a subclass may have changed them."""
        return type(self) is Exact

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
        """Filter complete observations start, ..., stop - 1 of series (s, n, q) under constant tables."""
        own = type(self)
        if own.first is not Exact.first or own.advance is not Exact.advance or own.ahead is not Exact.ahead:
            return super().series(system, tables, begin, ys, start, stop, out, mass)
        if isinstance(system, DrivenSystem):
            assert begin[0] is not None
            found = filter_stretch(system, tables, begin[0], ys, start, stop, out)
            _check_range(found[1], out, ys, start, stop)
            return found
        summary = tables.summary(system.chain)
        found = engine.filter_series(tables.kernel, summary, begin, ys, start, stop, out, mass)
        if "sign" in out:
            part = slice(start, stop)
            check_signed(out["table"][:, part], out["sign"][:, part])
        _check_range(found[1], out, ys, start, stop)
        return found

    @property
    def takes_gaps(self) -> bool:
        """Whether `gappy_series` may take a series with gaps: where `series` is that of the engine."""
        own = type(self)
        return own.series is Exact.series and own.advance is Exact.advance and own.ahead is Exact.ahead

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
        """Filter observations start, ..., stop - 1 of series (s, n, q) under constant tables, gaps and all.

        Returns the states (s, 1 + m + m*m, M) after the last one, how far each series came, and the last two
        states of the last series; see `fuzzykf.engine.numpy.gap_series.filter_gappy`.
        """
        summary = tables.summary(system.chain)
        _, last, reached, states = engine.filter_gappy(
            tables.gaps, tables.kernel, summary, begin, ys, start, stop, out, mass, kept
        )
        if (reached == stop).all():
            _check_range(last, out, ys, start, stop)
            return last, reached, states
        for k, end in enumerate(reached):
            part = {name: values[k : k + 1] for name, values in out.items()}
            _check_range(last[k : k + 1], part, ys[k : k + 1], start, int(end))
        return last, reached, states

    def smooth(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
        """Estimate every state of a filtered series from all of it, see `smooth_back`."""
        from fuzzykf.switching.inference.smoother import smooth_back

        return smooth_back(system, trajectory, ys)

    def known_along(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> list[Known]:
        """Return what was known after each observation of a filtered series."""
        from fuzzykf.switching.inference.smoother import mixtures_of

        steps = tables_to(system, len(ys))
        return [*map(Known, mixtures_of(system, trajectory, ys), steps, ys)]

    def look_back(self, system: SwitchingSystem, states: Sequence[Known]) -> Nodes:
        """Estimate what was known after some observations in a row from all of them, see `smooth_back`."""
        from fuzzykf.switching.inference.smoother import look_back

        return look_back(system, states)

    def __reduce__(self) -> str | tuple[Any, ...]:
        if type(self) is Exact:
            return "EXACT"  # there is one alone, whoever copies or pickles it
        return type(self).__new__, (type(self),), self.__dict__


#: The method of `OFSRFilter`, `CGOMSMFilter` and `KnownSwitchFilter`.
EXACT = Exact()


def _check_range(last: FloatArray, out: dict[str, FloatArray], ys: FloatArray, start: int, stop: int) -> None:
    """Refuse what has left the range of numbers: the last states of series, or their moments."""
    moments = [last[:, 1:], *(out[name][:, start:stop] for name in ("x", "P") if name in out)]
    limit = engine.LARGEST_MEAN
    small = all(v.max(initial=0.0) <= limit and v.min(initial=0.0) >= -limit for v in moments)
    if small and not np.isnan(last[:, 0]).any():
        return  # so it is nearly always, and takes no memory
    fits = engine.is_in_range(last)
    for name, most in {"x": engine.LARGEST_MEAN, "P": np.finfo(np.float64).max}.items():
        if name in out:
            fits &= (np.abs(out[name][:, start:stop]) <= most).reshape(len(fits), -1).all(axis=1)
    if not fits.all():
        seen = ys[int(fits.argmin()), start:stop]
        size = np.abs(np.where(np.isnan(seen), 0.0, seen))
        raise out_of_range(seen[size.max(axis=1).argmax()])


def is_complete(y: FloatArray) -> bool:
    """Whether nothing of an observation is missing."""
    if y.size == 1:  # asked at every step of a scalar filter, so asked quickly
        value = y.item()
        return bool(value == value)
    return not np.isnan(y).any()

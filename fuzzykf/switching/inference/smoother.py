"""The exact smoother, and the most likely path of the switch.

(R, Y) is a Markov chain, and given (r_n, y_1..n) the state X_n is independent of
later observations.  So only the probabilities of the nodes change:

    p(r_n = i | y_1..N) = sum_j o_ij p(r_{n+1} = j | y_1..N),
    o_ij = p(r_n = i | r_{n+1} = j, y_1..n+1),

with the moments of X_n given the node as the filter left them, and no backward pass
over X.  Where a part of the window was missing, X_n and r_n do depend on what came later
through that part; `fuzzykf.engine.numpy.gap_backward` goes back through such steps.  That is
exact for a single class, and for gaps of one observation in models of order one; else it is an approximation.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.fixed_lag import Nodes
from fuzzykf.switching.inference.method import Smoothed, out_of_range
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.series import Trajectory
from fuzzykf.switching.inference.signed import check_signed_moments

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.selected import Moments, SmoothedGap
    from fuzzykf.switching.dynamics.pairs import PairTables, SwitchingSystem
    from fuzzykf.switching.inference.method import Known

__all__ = ["look_back", "mixtures_of", "smooth_back"]


@engine.QUIET
def smooth_back(system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
    """Smooth a series that has been filtered.

    Parameters
    ----------
    system : SwitchingSystem
    trajectory : Trajectory
        What the filter knew, its states included.
    ys : ndarray, shape (n, q)
        NaN where missing.

    Raises
    ------
    NumericalRangeError, QuadratureError
        If double precision cannot hold what follows; if negative weights have made no law of it.
    """
    backward = _Backward(system, trajectory, ys)
    return Smoothed(*_back_to(backward, 0), backward.most_likely_path())


@engine.QUIET
def look_back(system: SwitchingSystem, states: Sequence[Known]) -> Nodes:
    """Smooth what was known after some observations in a row.

    What came before is in the windows of the first state.

    Parameters
    ----------
    system : SwitchingSystem
    states : sequence of Known

    Raises
    ------
    NumericalRangeError, QuadratureError
        As from `smooth_back`.
    """
    mixtures = [one.mixture for one in states]
    before = mixtures[0].window.reshape(-1, system.dim_z)[::-1]  # the first observation is its last row
    ys, first = np.concatenate([before, *(one.y[None] for one in states[1:])]), len(before) - 1
    table = np.array([one.state_table(system.dim_x) for one in mixtures])
    fields = {"table": np.concatenate([np.repeat(table[:1], first, axis=0), table])}
    if system.chain.is_signed:
        signs = np.array([np.ones(table.shape[-1]) if one.sign is None else one.sign for one in mixtures])
        fields["sign"] = np.concatenate([np.repeat(signs[:1], first, axis=0), signs])
    gaps = {k: one for k, one in enumerate(mixtures, first) if one.unknown}
    window: Any = _Window(system, [one.tables for one in states], first)
    backward = _Backward(window, Trajectory(fields, gaps, None, None), ys)
    return Nodes(*(one[first:] for one in _back_to(backward, first)))


def mixtures_of(system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> list[Mixture]:
    """Return what a filter knew after each observation of a series (n, q)."""
    backward = _Backward(system, trajectory, ys)
    return [backward.mixture(k) for k in range(len(ys))]


def _back_to(backward: _Backward, first: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Smooth the observations from ``first`` on; rows before it are not touched."""
    system, trajectory, ys = backward.system, backward.trajectory, backward.ys
    m, table = system.dim_x, trajectory.fields["table"]
    gamma = engine.probabilities(table, trajectory.fields.get("sign"))
    means, covariances = (np.array(a) for a in engine.node_moments(table, m))
    gaps, missing = trajectory.gaps, np.asarray(np.isnan(ys).any(axis=1))
    seen = np.flatnonzero(~np.isnan(ys).all(axis=1))
    stop = max(int(seen[-1]), first) if seen.size else first  # nothing is learned after the last observation
    # of the branches after the step, if something is unknown then: probabilities, and moments of the window
    p, told = backward.branches(stop) if stop in gaps else (None, None)
    while stop > first:
        k = stop - 1
        start = backward.plain_since(k)
        if start < stop:
            gamma[start:stop] = backward.smooth(start, stop, gamma[stop])
            stop = start
            continue
        stop = k
        if k in gaps:
            found = backward.into_gap(k, gamma[k + 1] if p is None else p, told)
            p, told = found.p, found.told
            gamma[k], means[k], covariances[k] = found.mu, found.x, found.P
            continue
        if missing[k + 1]:
            assert p is not None
            gamma[k] = backward.into_known(k, p)
        else:
            gamma[k] = backward.weights(k) @ gamma[k + 1]
        p = told = None
    if not all(np.isfinite(part).all() for part in (gamma, means, covariances)):
        raise out_of_range(ys[np.nanargmax(np.abs(ys).max(axis=1, where=~np.isnan(ys), initial=0.0))], 1e100)
    if system.chain.is_signed:
        check_signed_moments(gamma, means, covariances)
    return gamma, means, covariances


def _windows_of(ys: FloatArray, order: int) -> FloatArray:
    """Return the windows (y_n, y_{n-1}, ...) of full length, one row per n; NaN before the start."""
    if order == 1:
        return ys
    n, q = ys.shape
    windows = np.full((n, order, q), np.nan)
    for lag in range(min(order, n)):
        windows[lag:, lag] = ys[: n - lag]
    return windows.reshape(n, order * q)


class _Window:
    """A system over a few steps, of which the tables are known.

    Parameters
    ----------
    system : SwitchingSystem
    tables : sequence
        Of the steps to each observation from ``first`` on.
    first : int
        How many observations come before these.
    """

    def __init__(self, system: SwitchingSystem, tables: Sequence[Any], first: int) -> None:
        self.chain, self.dim_x, self.dim_z, self.order = (
            system.chain,
            system.dim_x,
            system.dim_z,
            system.order,
        )
        self._tables, self._first = tables, first
        whole = first + 1 >= system.order  # windows at the start of a series are shorter
        steady = system.steady_from is not None and all(one is tables[-1] for one in tables[1:])
        self.steady_from = first if whole and steady else None

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``."""
        return self._tables[n + 1 - self._first]


class _Backward:
    """The steps of a filtered series, from its end.

    A step is plain if its observations are complete, its tables those of all later steps, and
    no weight negative; stretches of plain steps go through the engine at once.
    """

    def __init__(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> None:
        self.system, self.trajectory, self.ys = system, trajectory, ys
        self._windows = _windows_of(ys, system.order)
        self._found: dict[int, FloatArray] = {}  # of the slots of steps that end a gap, once they are known
        steps = np.arange(max(0, len(ys) - 1))
        whole = np.isnan(ys[1:]).sum(axis=1) == 0
        whole[[k for k in trajectory.gaps if k < whole.size]] = False
        steady = np.ones(whole.shape, dtype=bool)
        # with tables that differ in what is known alone
        kernels: Any = getattr(system, "kernels", None)
        through = kernels is not None and kernels(0, 0) is None
        if (system.steady_from is None and not through) or system.chain.is_signed:
            steady[:] = False
        else:
            steady[: system.order - 1 if through else system.steady_from] = False  # windows are shorter there
        self._plain = whole & steady
        #: where the stretch of plain steps up to k begins; k + 1 if k itself is not plain
        self._since = np.maximum.accumulate(np.where(self._plain, 0, steps + 1)) if steps.size else steps
        #: where stretches of the most likely path end that are for the engine: gaps and all, but for inputs
        self._ends = np.append(np.flatnonzero(~(self._plain if through else steady)), steps.size)

    def plain_since(self, k: int) -> int:
        """Where the stretch of plain steps up to ``k`` begins; k + 1 if k itself is not plain."""
        return int(self._since[k])

    @cached_property
    def _all_rows(self) -> FloatArray:
        """Rows (1, w, y') of all steps."""
        return np.concatenate([np.ones((len(self.ys) - 1, 1)), self._windows[:-1], self.ys[1:]], axis=1)

    def _rows(self, start: int, stop: int) -> FloatArray:
        """Rows (1, w, y') of the steps start, ..., stop - 1."""
        windows = getattr(self.system, "windows", None)
        if windows is None:
            return self._all_rows[start:stop]
        seen = windows(start + 1, stop + 1)  # with inputs and features
        return np.concatenate([np.ones((stop - start, 1)), *seen, self.ys[start + 1 : stop + 1]], axis=1)

    def smooth(self, start: int, stop: int, after: FloatArray) -> FloatArray:
        """Smoothed probabilities at the plain steps start, ..., stop - 1, given those at ``stop``."""
        kernel = self.system.pair_tables(start).kernel
        log_p = self.trajectory.fields["table"][start:stop, 0]
        return engine.smooth_back(kernel, log_p, self._rows(start, stop), after)

    def mixture(self, k: int) -> Mixture:
        """Return what the filter knew at k."""
        gap = self.trajectory.gaps.get(k)
        if gap is not None:
            return gap
        fields, width = self.trajectory.fields, min(k + 1, self.system.order) * self.system.dim_z
        sign = fields["sign"][k] if "sign" in fields else None
        return Mixture(fields["table"][k], self._windows[k, :width], sign)

    def branches(self, k: int) -> tuple[FloatArray, Moments]:
        """Return what the filter knew of the branches in a gap: probabilities, and moments of the window."""
        gap = self.trajectory.gaps[k]
        table, sign, root = gap.branches or (gap.table, gap.sign, gap.root)
        return engine.probabilities(table, sign), engine.window_known(table, root, gap.window)

    def into_gap(self, k: int, p: FloatArray, told: Moments | None) -> SmoothedGap:
        """Go back into the gap at k, given what is known of the branches, or nodes, after it."""
        tables, gap, y = self.system.pair_tables(k), self.trajectory.gaps[k], self.ys[k + 1]
        at, window = _gap_tables(tables, gap.window)
        size = gap.window.size
        found = engine.back_into_gap(
            at.gaps, gap.table, gap.sign, window, gap.root, y, p, told, gap.branches, size
        )
        if found.log_pairs is not None:
            self._found[k] = found.log_pairs
        return found

    def into_known(self, k: int, p: FloatArray) -> FloatArray:
        """Return smoothed probabilities (M1,) of the nodes before a gap, from those of its branches."""
        tables = self.system.pair_tables(k)
        joint = p.reshape(-1, tables.transition.shape[1])
        slots = tables.in_slots.slots
        return joint.sum(axis=1) if slots is None else slots.sums(joint, len(tables.transition))

    def _log_pairs(self, k: int) -> FloatArray:
        """Log |P_ij| + log p(y_{k+1} | i, j, y_1..k) slot by slot, (depth, M2); up to a constant."""
        if k in self._found:
            return self._found[k]
        tables, following = self.system.pair_tables(k), self.trajectory.gaps.get(k + 1)
        step = tables.in_slots
        if following is not None and following.branches is not None:  # it knows, up to a common term
            log_w: FloatArray = following.branches.table[0].reshape(step.transition.shape)
            log_pairs: FloatArray = log_w - self.trajectory.fields["table"][k, 0][step.nodes]
            return log_pairs
        mixture = self.mixture(k)
        at, window = _gap_tables(tables, mixture.window)
        known = mixture.table, mixture.sign, window, mixture.root
        found: FloatArray = engine.gap_log_pairs(at.gaps, *known, self.ys[k + 1], mixture.branches)
        return found

    def _log_all_pairs(self, k: int) -> FloatArray:
        """Log |P_ij| + log N(y_{k+1}; ...) of all pairs, (M, M); up to a constant."""
        tables = self.system.pair_tables(k)
        if k not in self.trajectory.gaps and not np.isnan(self.ys[k + 1]).any():
            known = self._windows[k, : min(k + 1, self.system.order) * self.system.dim_z]
            window = _window_of(tables, known, self.ys[k + 1])
            u = np.concatenate([np.ones(1), window, self.ys[k + 1]])
            return engine.log_pairs(tables.kernel, u[None]).reshape(tables.transition.shape)
        log_pairs, slots = self._log_pairs(k), tables.in_slots.slots
        if slots is not None:
            log_pairs = slots.spread(log_pairs, len(tables.transition), engine.LOG_ZERO)
        return log_pairs

    def _given(self, start: int, stop: int) -> tuple[IntArray, FloatArray, IntArray] | None:
        """Return the steps start, ..., stop - 1 with gaps, what `_log_pairs` says, and the nodes of slots."""
        gaps = np.flatnonzero(~self._plain[start:stop])
        if not gaps.size:
            return None
        transition, _, slots, _ = self.system.pair_tables(start).in_slots
        source = np.indices(transition.shape)[0] if slots is None else slots.source
        return gaps, np.array([self._log_pairs(start + int(t)) for t in gaps]), source

    def weights(self, k: int) -> FloatArray:
        """o_ij of the step k, shape (M, M)."""
        fields = self.trajectory.fields
        log_w = self._log_all_pairs(k) + fields["table"][k, 0, :, None]
        sign = np.ones_like(log_w)
        if "sign" in fields:
            sign = fields["sign"][k, :, None] * np.sign(self.system.pair_tables(k).transition)
        o: FloatArray = engine.collapse_weights(log_w, sign)[2]
        return o

    def most_likely_path(self) -> NDArray[np.int64]:
        """Viterbi's algorithm on (R, Y): the nodes of the most probable path."""
        n = len(self.ys)
        if n == 0:
            return np.empty(0, dtype=np.int64)
        score = self.trajectory.fields["table"][0, 0]
        pointers = np.empty((n - 1, score.size), dtype=np.int64)
        k = 0
        while k < n - 1:
            stop = int(self._ends[np.searchsorted(self._ends, k)])
            if stop > k:
                kernel, rows = self.system.pair_tables(k).kernel, self._rows(k, stop)
                score, pointers[k:stop] = engine.best_path(kernel, score, rows, self._given(k, stop))
                k = stop
                continue
            total = score[:, None] + self._log_all_pairs(k)
            pointers[k] = total.argmax(axis=0)
            score = total.max(axis=0)
            score = score - score.max()
            k += 1
        node = int(score.argmax())
        M, backwards = score.size, [node]
        before = pointers.reshape(-1).data  # single numbers are read from a buffer quickly
        for at in range((n - 2) * M, -1, -M):
            node = before[at + node]
            backwards.append(node)
        return np.array(backwards[::-1], dtype=np.int64)


def _window_of(tables: Any, known: FloatArray, y: FloatArray) -> FloatArray:
    """Return the window of a step to y, with inputs and features where there are some."""
    window: FloatArray = tables.window(known, y) if tables.is_driven else known
    return window


def _gap_tables(tables: Any, known: FloatArray) -> tuple[PairTables, FloatArray]:
    """Return tables and window of a step in which something is missing."""
    if not tables.is_driven:
        return tables, known
    assert tables.next_law is not None  # whoever looks back knows what stood for what is missing
    return tables.in_gap(*tables.next_law), tables.without_features(known)

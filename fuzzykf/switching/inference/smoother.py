"""The exact smoother, and the most likely path of the switch.

(R, Y) is a Markov chain, and given (r_n, y_1..n) the state X_n is independent of
later observations.  So only the probabilities of the nodes change:

    p(r_n = i | y_1..N) = sum_j o_ij p(r_{n+1} = j | y_1..N),
    o_ij = p(r_n = i | r_{n+1} = j, y_1..n+1),

with the moments of X_n given the node as the filter left them, and no backward pass
over X.  Where a part of the window was missing, X_n and r_n do depend on what came later
through that part; `fuzzykf.switching.inference.gap_smoother` goes back through such steps.  That is
exact for a single class, and for gaps of one observation in models of order one; else it is an approximation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.fixed_lag import Nodes
from fuzzykf.switching.inference.gap_smoother import (
    branches_of,
    pairs_ahead,
    smooth_state,
    step_back,
    window_before,
    window_known,
)
from fuzzykf.switching.inference.method import Smoothed, out_of_range
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.series import Trajectory
from fuzzykf.switching.inference.signed import check_signed_moments

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables, SwitchingSystem
    from fuzzykf.switching.inference.gap_smoother import Moments
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
    n, m, table = len(ys), system.dim_x, trajectory.fields["table"]
    gamma = engine.probabilities(table, trajectory.fields.get("sign"))
    means, covariances = (np.array(a) for a in engine.node_moments(table, m))
    seen = np.flatnonzero(~np.isnan(ys).all(axis=1))
    last = max(int(seen[-1]), first) if seen.size else first  # nothing is learned after the last observation
    window = backward.window(last) if n else None  # smoothed moments of the window, per branch
    shares = backward.shares(last) if n else None  # and their smoothed probabilities
    stop = last  # the steps from k = stop on are done
    while stop > first:
        k = stop - 1
        start = backward.plain_since(k)
        if start < stop:
            gamma[start:stop] = backward.smooth(start, stop, gamma[stop])
            window, shares, stop = None, None, start
            continue
        stop = k
        if k not in trajectory.gaps and not np.isnan(ys[k + 1]).any():
            gamma[k] = backward.weights(k) @ gamma[k + 1]
            window = shares = None
            continue
        if window is None or shares is None:
            window, shares = backward.window(k + 1), gamma[k + 1]
        state, following = backward.mixture(k), backward.mixture(k + 1)
        shares, window = step_back(system.pair_tables(k), state, following, ys[k + 1], window, shares)
        gap = trajectory.gaps.get(k)
        if gap is None:
            gamma[k] = shares
        else:
            moments = smooth_state(gap, window, m)
            gamma[k], means[k], covariances[k] = engine.merge_branches(shares, *moments, gamma.shape[1])
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
        steps = np.arange(max(0, len(ys) - 1))
        plain = np.isnan(ys[1:]).sum(axis=1) == 0
        plain[[k for k in trajectory.gaps if k < plain.size]] = False
        # with tables that differ in what is known alone
        kernels: Any = getattr(system, "kernels", None)
        through = kernels is not None and kernels(0, 0) is None
        if (system.steady_from is None and not through) or system.chain.is_signed:
            plain[:] = False
        else:
            plain[: system.order - 1 if through else system.steady_from] = False  # windows are shorter there
        #: where the stretch of plain steps up to k begins; k + 1 if k itself is not plain
        self._since = np.maximum.accumulate(np.where(plain, 0, steps + 1)) if plain.size else steps
        self._ends = np.append(np.flatnonzero(~plain), plain.size)

    def plain_since(self, k: int) -> int:
        """Where the stretch of plain steps up to ``k`` begins; k + 1 if k itself is not plain."""
        return int(self._since[k])

    def _rows(self, start: int, stop: int) -> FloatArray:
        """Rows (1, w, y') of the plain steps start, ..., stop - 1."""
        windows = getattr(self.system, "windows", None)  # with inputs and features
        seen = (self._windows[start:stop],) if windows is None else windows(start + 1, stop + 1)
        ones, ys = np.ones((stop - start, 1)), self.ys[start + 1 : stop + 1]
        return np.concatenate([ones, *seen, ys], axis=1)

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

    def window(self, k: int) -> Moments:
        """Return the filtered moments of the window at k, given each branch."""
        return window_known(self.mixture(k), self.system.dim_x)

    def shares(self, k: int) -> FloatArray:
        """Return the filtered probabilities of the branches at k."""
        table, sign, _ = branches_of(self.mixture(k))
        return engine.probabilities(table, sign)

    def _log_pairs(self, k: int) -> FloatArray:
        """Log |P_ij| + log N(y_{k+1}; ...), (M, M), given y_1..k if a part is missing; up to a constant."""
        tables = self.system.pair_tables(k)
        if k not in self.trajectory.gaps and not np.isnan(self.ys[k + 1]).any():
            width = min(k + 1, self.system.order) * self.system.dim_z
            window = window_before(tables, self._windows[k, :width], self.ys[k + 1])
            u = np.concatenate([np.ones(1), window, self.ys[k + 1]])
            return engine.log_pairs(tables.kernel, u[None]).reshape(tables.transition.shape)
        mixture, following, step = self.mixture(k), self.trajectory.gaps.get(k + 1), tables.in_slots
        if following is not None and following.branches is not None:  # it knows, up to a common term
            return self._of_slots(tables, following.branches.table[0], mixture)
        _, after = pairs_ahead(tables, mixture, self.ys[k + 1])
        branches = (-1, *step.transition.shape)
        sign = None if after.sign is None else after.sign.reshape(branches)
        log_w, _, _ = engine.collapse_weights(after.log_w.reshape(branches), sign)
        return self._of_slots(tables, log_w + after.reference, mixture)

    @staticmethod
    def _of_slots(tables: PairTables, log_w: FloatArray, mixture: Mixture) -> FloatArray:
        """Bring log-weights of the slots to all pairs (M, M), less what was known of the nodes before."""
        step = tables.in_slots
        log_pairs: FloatArray = log_w.reshape(step.transition.shape) - mixture.table[0][step.nodes]
        if step.slots is None:
            return log_pairs
        return step.slots.spread(log_pairs, len(tables.transition), engine.LOG_ZERO)

    def weights(self, k: int) -> FloatArray:
        """o_ij of the step k, shape (M, M)."""
        fields = self.trajectory.fields
        log_w = self._log_pairs(k) + fields["table"][k, 0, :, None]
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
                kernel = self.system.pair_tables(k).kernel
                score, pointers[k:stop] = engine.best_path(kernel, score, self._rows(k, stop))
                k = stop
                continue
            total = score[:, None] + self._log_pairs(k)
            pointers[k] = total.argmax(axis=0)
            score = total.max(axis=0)
            score = score - score.max()
            k += 1
        path = np.empty(n, dtype=np.int64)
        path[-1] = int(score.argmax())
        for k in range(n - 2, -1, -1):
            path[k] = pointers[k, path[k + 1]]
        return path

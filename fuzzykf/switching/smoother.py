"""The exact smoother, and the most likely path of the switch.

(R, Y) is a Markov chain, and given (r_n, y_1..n) the state X_n is independent of
later observations.  So only the probabilities of the nodes change:

    p(r_n = i | y_1..N) = sum_j o_ij p(r_{n+1} = j | y_1..N),
    o_ij = p(r_n = i | r_{n+1} = j, y_1..n+1),

with the moments of X_n given the node as the filter left them, and no backward pass
over X.  Where a part of the window was missing, X_n and r_n do depend on what came later
through that part; `fuzzykf.switching.gap_smoother` goes back through such steps.  That is
exact for a single class and an approximation for several.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.gaussian import mixture_moments
from fuzzykf.switching import recursion
from fuzzykf.switching.gap_smoother import Moments, smooth_state, step_back
from fuzzykf.switching.missing import (
    GapState,
    collapse_weights,
    observed_log_density,
    open_gap,
    pair_prediction,
)
from fuzzykf.switching.series import summarise, windows_of

if TYPE_CHECKING:
    from fuzzykf.base import FilterResult, FloatArray
    from fuzzykf.switching.recursion import NodeState
    from fuzzykf.switching.series import Trajectory
    from fuzzykf.switching.tables import SwitchingSystem

__all__ = ["smooth_series"]

#: Steps whose pair weights are held at once.
_CHUNK = 512


def smooth_series(
    system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray, *, keep_nodes: bool, index: Any
) -> FilterResult:
    """Smooth a series that has been filtered.

    Parameters
    ----------
    system : SwitchingSystem
    trajectory : Trajectory
        What the filter knew, see `fuzzykf.switching.series.run_series`.
    ys : ndarray, shape (n, q)
        NaN where missing.
    """
    n, m = len(ys), system.dim_x
    gamma = recursion.node_probabilities(trajectory.states)
    means, covariances = (np.array(a) for a in recursion.node_moments(trajectory.states, m))
    backward = _Backward(system, trajectory, ys)
    seen = np.flatnonzero(~np.isnan(ys).all(axis=1))
    last = int(seen[-1]) if seen.size else 0  # nothing can be learned after the last observation
    window = backward.window(last) if n else None  # smoothed moments of the window, per node
    for k in range(last - 1, -1, -1):
        if k not in trajectory.gaps and not np.isnan(ys[k + 1]).any():
            gamma[k] = backward.weights(k) @ gamma[k + 1]
            window = None
            continue
        filtered_window = backward.window(k + 1)
        gamma[k], window = step_back(
            system.pair_tables(k),
            backward.state(k),
            ys[k + 1],
            filtered_window,
            filtered_window if window is None else window,
            gamma[k + 1],
        )
        gap = trajectory.gaps.get(k)
        if gap is not None:
            means[k], covariances[k] = smooth_state(gap, window, m)
    chain = system.chain
    filtered = summarise(chain, trajectory, m, keep_nodes=False, index=index)
    x, P = mixture_moments(gamma, means, covariances)
    return replace(
        filtered,
        x=x,
        P=P,
        x_prior=None,
        P_prior=None,
        mu=gamma,
        switch=recursion.most_likely_switch(chain, gamma),
        switch_mean=gamma @ chain.nodes,
        switch_path=chain.nodes[backward.most_likely_path()],
        node_x=means if keep_nodes else None,
        node_P=covariances if keep_nodes else None,
    )


class _Backward:
    """The pair weights of a filtered series, computed in chunks from its end."""

    def __init__(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> None:
        self.system, self.trajectory, self.ys = system, trajectory, ys
        self._windows = windows_of(ys, system.order)
        self._start = len(ys)
        self._block: FloatArray = np.empty(0)

    def log_pairs(self, start: int, stop: int) -> FloatArray:
        """Log |P_ij| + log N(y_{k+1}; ...) of the steps k = start, ..., stop - 1, (k, M, M)."""
        steady = self.system.steady_from
        pieces = []
        k = start
        while k < stop:
            gap = self.trajectory.gaps.get(k)
            if gap is not None or np.isnan(self.ys[k + 1]).any():
                pieces.append(self._log_pair_at_gap(k)[None])
                k += 1
                continue
            end = k + 1
            if steady is not None and k >= steady:
                while end < stop and end not in self.trajectory.gaps and not np.isnan(self.ys[end + 1]).any():
                    end += 1
            width = min(k + 1, self.system.order) * self.system.dim_z
            windows = self._windows[k:end, :width]
            pieces.append(
                recursion.log_pair_weights(self.system.pair_tables(k), windows, self.ys[k + 1 : end + 1])
            )
            k = end
        return np.concatenate(pieces)

    def state(self, k: int) -> GapState:
        """Return the filtered state at k with the window as a part of it."""
        state: NodeState | GapState = self.trajectory.gaps.get(k, self.trajectory.at(k))
        width = min(k + 1, self.system.order) * self.system.dim_z
        return open_gap(state, self._windows[k, :width], self.system.dim_x)

    def window(self, k: int) -> Moments:
        """Return the filtered moments of the window at k, given each node."""
        m, gap = self.system.dim_x, self.state(k)
        return Moments(gap.mean[:, m:], gap.covariance[:, m:, m:])

    def _log_pair_at_gap(self, k: int) -> FloatArray:
        """Return the same where a part of the window or of y_{k+1} is missing, given y_1..k."""
        m, gap = self.system.dim_x, self.state(k)
        prediction = pair_prediction(self.system.pair_tables(k), gap)
        log_w = prediction.log_w + observed_log_density(prediction, self.ys[k + 1], m)
        return log_w - gap.log_p[:, None]

    def weights(self, k: int) -> FloatArray:
        """o_ij of the step k, shape (M, M)."""
        if k < self._start:
            stop, self._start = k + 1, max(0, k + 1 - _CHUNK)
            log_p = self.trajectory.states.table[self._start : stop, 0]
            log_w = self.log_pairs(self._start, stop) + log_p[:, :, None]
            sign = self._signs(self._start, stop)
            if sign is None:
                w = np.exp(log_w - log_w.max(axis=1, keepdims=True))
                self._block = w / w.sum(axis=1, keepdims=True)
            else:
                self._block = np.stack([collapse_weights(a, b)[2] for a, b in zip(log_w, sign, strict=True)])
        block: FloatArray = self._block[k - self._start]
        return block

    def _signs(self, start: int, stop: int) -> FloatArray | None:
        signs = self.trajectory.states.sign
        if signs is None:
            return None
        of_pairs = [np.sign(self.system.pair_tables(k).transition) for k in range(start, stop)]
        both: FloatArray = signs[start:stop, :, None] * np.stack(of_pairs)
        return both

    def most_likely_path(self) -> np.ndarray:
        """Viterbi's algorithm on (R, Y): the nodes of the most probable path."""
        n = len(self.ys)
        if n == 0:
            return np.empty(0, dtype=np.intp)
        score = self.trajectory.states.table[0, 0]
        pointers = np.empty((n, score.size), dtype=np.intp)
        columns = np.arange(score.size)
        for start in range(0, n - 1, _CHUNK):
            stop = min(start + _CHUNK, n - 1)
            for k, log_pair in enumerate(self.log_pairs(start, stop), start + 1):
                total = score[:, None] + log_pair
                pointers[k] = total.argmax(axis=0)
                score = total[pointers[k], columns]
                score = score - score.max()
        path = np.empty(n, dtype=np.intp)
        path[-1] = int(score.argmax())
        for k in range(n - 1, 0, -1):
            path[k - 1] = pointers[k, path[k]]
        return path

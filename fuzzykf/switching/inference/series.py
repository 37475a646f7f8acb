"""Whole series through a switching system, and what is kept of them.

Stretches of complete observations under constant tables go through the engine at
once; the rest goes step by step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import FilterResult
from fuzzykf.gaussian import mixture_moments
from fuzzykf.switching.inference import recursion
from fuzzykf.switching.inference.belief import Belief, Source, begin, node_state, predict_state, proceed
from fuzzykf.switching.inference.missing import GapState
from fuzzykf.switching.inference.recursion import NodeState

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["SHOWN", "Trajectory", "run_series", "summarise", "windows_of"]

#: What a switching filter shows of every observation of a series.
SHOWN = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")

#: Observations whose prior moments are computed at once, and how many numbers they may take.
_CHUNK, _NUMBERS = 512, 1 << 20

#: Shorter stretches go step by step.
_SHORT = 3


@dataclass(frozen=True)
class Trajectory:
    """What a filter knew after each observation of a series.

    Attributes
    ----------
    states : NodeState
        Leading shape (n,).
    gaps : dict of int to GapState
        The states after which a part of the window was unknown.
    log_likelihood : ndarray, shape (n,)
    x_prior, P_prior : ndarray, shapes (n, m) and (n, m, m)
    last : Belief
        After the last observation.
    before : Source or None
        From which the last observation was predicted.
    """

    states: NodeState
    gaps: dict[int, GapState]
    log_likelihood: FloatArray
    x_prior: FloatArray
    P_prior: FloatArray
    last: Belief | None
    before: Source | None

    def at(self, k: int) -> NodeState:
        """Return the state of the nodes after observation ``k``."""
        return _at(self.states, k)


def run_series(system: SwitchingSystem, ys: FloatArray, *, priors: bool = True) -> Trajectory:
    """Filter a series from the initial law on.

    Parameters
    ----------
    system : SwitchingSystem
    ys : ndarray, shape (n, q)
        NaN where missing.
    priors : bool
        Whether the moments before each observation are wanted; else they are NaN.
    """
    n, m, q, M = len(ys), system.dim_x, system.dim_z, len(system.chain)
    table = np.empty((n, 1 + m + m * m, M))
    signs = np.ones((n, M)) if system.chain.is_signed else None
    states = NodeState(table, signs)
    log_likelihood, x_prior, P_prior = np.empty(n), np.full((n, m), np.nan), np.full((n, m, m), np.nan)
    gaps: dict[int, GapState] = {}
    holes = np.append(np.flatnonzero(np.isnan(ys).any(axis=1)), n)
    windows = windows_of(ys, system.order)
    belief: Belief | None = None
    before: Source | None = None
    k = 0
    while k < n:
        stop = int(holes[np.searchsorted(holes, k)])
        steady = system.steady_from is not None and k > system.steady_from
        if belief is not None and steady and stop - k >= _SHORT and isinstance(belief.state, NodeState):
            tables = system.pair_tables(k - 1)
            part = slice(k, stop)
            rest, log_likelihood[part] = recursion.advance_all(
                tables, belief.state, windows[k - 1 : stop - 1], ys[part]
            )
            table[part] = rest.table
            if signs is not None and rest.sign is not None:
                signs[part] = rest.sign
            chunk = max(1, min(_CHUNK, _NUMBERS // (M * M * m)))
            for a in range(k, stop, chunk) if priors else ():
                b = min(a + chunk, stop)
                x_prior[a:b], P_prior[a:b] = recursion.predict_state(
                    tables, _at(states, slice(a - 1, b - 1)), windows[a - 1 : b - 1]
                )
            k = stop
            before = Source(_belief_at(states, windows, k - 2), tables)
            belief = _belief_at(states, windows, k - 1)
            continue
        if belief is None:
            law = system.initial()
            if priors:
                x_prior[k], P_prior[k] = mixture_moments(
                    law.probability, law.mean[:, :m], law.covariance[:, :m, :m]
                )
            belief, log_likelihood[k] = begin(law, ys[k])
        else:
            tables = system.pair_tables(k - 1)
            if priors:
                x_prior[k], P_prior[k] = predict_state(tables, belief)
            before = Source(belief, tables)
            belief, log_likelihood[k] = proceed(tables, belief, ys[k], min(k + 1, system.order) * q)
        state = node_state(belief, m)
        table[k] = state.table
        if signs is not None and state.sign is not None:
            signs[k] = state.sign
        if isinstance(belief.state, GapState):
            gaps[k] = belief.state
        k += 1
    return Trajectory(states, gaps, log_likelihood, x_prior, P_prior, belief, before)


def _at(states: NodeState, where: Any) -> NodeState:
    sign = None if states.sign is None else states.sign[where]
    return NodeState(states.table[where], sign)


def _belief_at(states: NodeState, windows: FloatArray, k: int) -> Belief:
    """Copy what a filter keeps, which would otherwise hold on to the whole series."""
    sign = None if states.sign is None else states.sign[k].copy()
    return Belief(NodeState(states.table[k].copy(), sign), windows[k].copy())


def windows_of(ys: FloatArray, order: int) -> FloatArray:
    """Return the windows (y_n, y_{n-1}, ...) of full length, one row per n; NaN before the start."""
    if order == 1:
        return ys
    n, q = ys.shape
    windows = np.full((n, order, q), np.nan)
    for lag in range(min(order, n)):
        windows[lag:, lag] = ys[: n - lag]
    return windows.reshape(n, order * q)


def summarise(
    chain: SwitchChain, trajectory: Trajectory, m: int, *, keep_nodes: bool, index: Any
) -> FilterResult:
    """Collect what users read from the states along a series."""
    mu = recursion.node_probabilities(trajectory.states)
    means, covariances = recursion.node_moments(trajectory.states, m)
    x, P = mixture_moments(mu, means, covariances)
    return FilterResult(
        x=x,
        P=P,
        x_prior=trajectory.x_prior,
        P_prior=trajectory.P_prior,
        mu=mu,
        nodes=chain.nodes,
        switch=recursion.most_likely_switch(chain, mu),
        switch_mean=mu @ chain.nodes,
        log_likelihood=trajectory.log_likelihood,
        node_x=means if keep_nodes else None,
        node_P=covariances if keep_nodes else None,
        index=index,
    )

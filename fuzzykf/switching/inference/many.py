"""Many complete series at once: the recursion with one more leading axis.

Series go through a step side by side, in blocks that stay in the cache.  The
equations are those of `fuzzykf.switching.inference.recursion`.
"""

from __future__ import annotations

from itertools import accumulate
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import first_step, step_many
from fuzzykf.gaussian import cholesky, mixture_moments
from fuzzykf.results import field_shapes
from fuzzykf.switching.dynamics.pairs import log_probability
from fuzzykf.switching.inference import recursion
from fuzzykf.switching.inference.recursion import NodeState
from fuzzykf.switching.inference.series import windows_of
from fuzzykf.switching.inference.steady import filter_steady, is_steady

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.base import FilterResult
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem

__all__ = ["allocate", "filter_block", "filter_series"]

#: Numbers that the pairs of a block of series may hold.
BLOCK = 1 << 16


def allocate(lead: tuple[int, int], shapes: dict[str, tuple[int, ...]]) -> dict[str, FloatArray]:
    """Return arrays (*lead, *shape) in one block: new pages of memory cost more than what fills them."""
    sizes = [lead[0] * lead[1] * prod(shape) for shape in shapes.values()]
    block, stops = np.empty(sum(sizes)), accumulate(sizes)
    return {
        name: block[stop - size : stop].reshape(*lead, *shape)
        for (name, shape), size, stop in zip(shapes.items(), sizes, stops, strict=True)
    }


def filter_series(
    system: SwitchingSystem,
    series: FloatArray,
    names: tuple[str, ...],
    alone: Callable[[FloatArray], FilterResult],
    threads: int = 1,
) -> dict[str, FloatArray]:
    """Filter series (s, n, q): complete ones side by side, the others by ``alone``."""
    shapes = field_shapes(names, state=system.dim_x, node=len(system.chain))
    out = {name: np.empty((*series.shape[:2], *shape)) for name, shape in shapes.items()}
    single = np.full(len(series), system.chain.is_signed) | np.isnan(series).any(axis=(1, 2))
    if is_steady(system, series):
        filter_complete(system, series, ~single, out, threads)
        together = np.empty(0, dtype=np.intp)
    else:
        together = np.flatnonzero(~single)
    size = max(1, BLOCK // len(system.chain) ** 2)
    for start in range(0, together.size, size):
        block = together[start : start + size]
        part = {name: np.empty((block.size, *values.shape[1:])) for name, values in out.items()}
        filter_block(system, series[block], part)
        for name, values in part.items():
            out[name][block] = values
    for k in np.flatnonzero(single):
        result = alone(series[k])
        for name, values in out.items():
            values[k] = getattr(result, name)
    return out


def filter_complete(
    system: SwitchingSystem,
    series: FloatArray,
    complete: NDArray[np.bool_],
    out: dict[str, FloatArray],
    threads: int,
) -> None:
    """Let the engine filter the complete series at once."""
    if complete.all():
        filter_steady(system, series, out, threads)
    elif complete.any():
        part = {name: np.empty((int(complete.sum()), *values.shape[1:])) for name, values in out.items()}
        filter_steady(system, series[complete], part, threads)
        for name, values in part.items():
            out[name][complete] = values


def filter_block(system: SwitchingSystem, ys: FloatArray, out: dict[str, FloatArray]) -> None:
    """Filter complete series side by side.

    Parameters
    ----------
    system : SwitchingSystem
        Its chain has no negative weights.
    ys : ndarray, shape (s, n, q)
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in: fields of `FilterResult` that `SwitchingFilter` shows.
    """
    s, n, q = ys.shape
    m, order = system.dim_x, system.order
    if n == 0:
        return
    windows = np.stack([windows_of(one, order) for one in ys]) if order > 1 else ys
    law = system.initial()
    if "x_prior" in out or "P_prior" in out:
        x, P = mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m])
        _store(out, 0, x_prior=np.broadcast_to(x, (s, m)), P_prior=np.broadcast_to(P, (s, m, m)))
    factor = cholesky(
        law.covariance[:, m:, m:], lambda k: f"covariance of the first observation, node {k[0]}"
    )
    log_initial = log_probability(law.probability)
    started = [first_step(log_initial, law.mean, law.covariance, factor, one[0]) for one in ys]
    table = np.stack([t for t, _ in started])
    log_likelihood = np.array([value for _, value in started])
    for k in range(n):
        if k:
            tables = system.pair_tables(k - 1)
            window = windows[:, k - 1, : min(k, order) * q]
            if "x_prior" in out or "P_prior" in out:
                x, P = recursion.predict_state(tables, NodeState(table), window)
                _store(out, k, x_prior=x, P_prior=P)
            U = np.concatenate([np.ones((s, 1)), window, ys[:, k]], axis=1)
            table, log_likelihood = step_many(tables.kernel, table, U)
        state = NodeState(table)
        mu = recursion.node_probabilities(state)
        _store(out, k, mu=mu, log_likelihood=log_likelihood)
        if "x" in out or "P" in out:
            x, P = mixture_moments(mu, *recursion.node_moments(state, m))
            _store(out, k, x=x, P=P)
        if "switch" in out:
            out["switch"][:, k] = recursion.most_likely_switch(system.chain, mu)
        if "switch_mean" in out:
            out["switch_mean"][:, k] = mu @ system.chain.nodes


def _store(out: dict[str, FloatArray], k: int, **values: FloatArray) -> None:
    for name, value in values.items():
        if name in out:
            out[name][:, k] = value

"""Whole series through a switching system, one or many.

Stretches of complete observations under constant tables go through the method at once, all
complete series side by side; the rest goes step by step.
"""

from __future__ import annotations

from bisect import bisect_left
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import mixture_moments
from fuzzykf.results import FilterResult, field_shapes
from fuzzykf.switching.inference.mixture import Mixture, Source, most_likely_switch

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import Ahead, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.method import Method, Smoothed
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = [
    "SHOWN",
    "Trajectory",
    "allocate",
    "check_explained",
    "filter_many",
    "filter_one",
    "result_of",
    "smoothed_result",
    "windows_of",
]

#: What a switching filter shows of every observation of a series.
SHOWN = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")

#: How far, in parts of the largest number, verbs and whole series may be apart.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Trajectory:
    """What a filter knew along one series.

    Attributes
    ----------
    fields : dict of str to ndarray, shape (n, ...)
        Fields of a result; if states were asked for ``table`` (n, 1 + m + m*m, M), of X alone, and
        with negative weights ``sign`` (n, M).
    gaps : dict of int to Mixture
        The states after which a part of the window was unknown.
    last : Mixture or None
        After the last observation.
    before : Source or None
        From which the last observation was predicted.
    """

    fields: dict[str, FloatArray]
    gaps: dict[int, Mixture]
    last: Mixture | None
    before: Source | None


def filter_one(
    method: Method, system: SwitchingSystem, ys: FloatArray, names: tuple[str, ...], *, states: bool = False
) -> Trajectory:
    """Filter a series (n, q), NaN where missing, from the initial law on.

    Parameters
    ----------
    method : Method
    system : SwitchingSystem
    ys : ndarray, shape (n, q)
    names : tuple of str
        The fields that are wanted.
    states : bool
        Whether the states are wanted as well.
    """
    out = allocate(system, (1, len(ys)), names, states)
    trajectory = _filter_block(method, system, ys[None], out)
    return Trajectory(
        {name: values[0] for name, values in out.items()}, trajectory.gaps, trajectory.last, trajectory.before
    )


def filter_many(
    method: Method, system: SwitchingSystem, series: FloatArray, names: tuple[str, ...], threads: int = 1
) -> dict[str, FloatArray]:
    """Filter many series (s, n, q), each from the initial law on.

    Complete ones go side by side, those with gaps alone; ``threads`` share the complete ones.
    """
    out = allocate(system, series.shape[:2], names, False)
    alone = np.isnan(series).any(axis=(1, 2)) | system.chain.is_signed
    if not alone.any():
        cuts = [len(series) * k // threads for k in range(threads + 1)]
        blocks = [slice(a, b) for a, b in pairwise(cuts) if b > a]
        if len(blocks) <= 1:
            _filter_block(method, system, series, out)
            return out
        parts = [{name: values[block] for name, values in out.items()} for block in blocks]
        with ThreadPoolExecutor(len(blocks)) as pool:
            list(pool.map(lambda b, part: _filter_block(method, system, series[b], part), blocks, parts))
        return out
    if not alone.all():
        together = filter_many(method, system, series[~alone], names, threads)
        for name, values in together.items():
            out[name][~alone] = values
    for k in np.flatnonzero(alone):
        part = allocate(system, (1, series.shape[1]), names, False)
        _filter_block(method, system, series[k : k + 1], part)
        for name in names:
            out[name][k] = part[name][0]
    return {name: out[name] for name in names}  # without the states, which signed weights need


def allocate(
    system: SwitchingSystem, lead: tuple[int, int], names: tuple[str, ...], states: bool
) -> dict[str, FloatArray]:
    """Return arrays (*lead, ...) in one block: new pages of memory cost more than what fills them."""
    is_signed, steps = system.chain.is_signed, lead[0] * lead[1]
    layout, size = _layout(names, system.dim_x, len(system.chain.nodes), states or is_signed, is_signed)
    block = np.empty(steps * size)
    return {
        name: block[steps * start : steps * stop].reshape(*lead, *shape)
        for name, shape, start, stop in layout
    }


@lru_cache(maxsize=64)
def _layout(
    names: tuple[str, ...], m: int, M: int, states: bool, is_signed: bool
) -> tuple[tuple[tuple[str, tuple[int, ...], int, int], ...], int]:
    """Where each field of one step begins and ends in a block, and how many numbers they are."""
    shapes = field_shapes(names, state=m, node=M)
    if states:
        shapes["table"] = (1 + m + m * m, M)
    if is_signed:
        shapes["sign"] = (M,)
    bounds = [0, *accumulate(map(prod, shapes.values()))]
    return tuple(zip(shapes, shapes.values(), bounds, bounds[1:], strict=False)), bounds[-1]


def _filter_block(
    method: Method, system: SwitchingSystem, ys: FloatArray, out: dict[str, FloatArray]
) -> Trajectory:
    """Filter series (s, n, q) side by side: complete ones, or a single one with gaps.

    Returns what is known after the last observation of the last series; the fields go to ``out``.
    """
    s, n, q = ys.shape
    m, order, chain = system.dim_x, system.order, system.chain
    gaps: dict[int, Mixture] = {}
    if n == 0 or s == 0:
        return Trajectory(out, gaps, None, None)
    missing = np.isnan(ys)
    holes = [*np.flatnonzero(missing.any(axis=(0, 2))).tolist(), n] if missing.any() else [n]
    steady_from = n if system.steady_from is None else system.steady_from
    switch = chain.nodes, chain.weights, chain.atoms
    law = system.initial()
    priors: list[tuple[int, Ahead]] = []  # what was known before observations taken alone
    wants_prior = "x_prior" in out or "P_prior" in out
    # known of the latest observation: tables and signs of all series, or of one whatever is known
    table = sign = None
    mixture: Mixture | None = None
    before: Source | None = None
    tables: PairTables | None = None
    single: list[tuple[int, Mixture, float]] = []  # observations taken alone
    k = 0
    while k < n:
        stop = holes[bisect_left(holes, k)]
        if tables is None or k <= steady_from + 1:
            tables = system.pair_tables(max(k - 1, 0)) if k or (stop and not steady_from) else None
        if k == 0 and wants_prior:
            priors.append((0, law.ahead(m)))
        steady = k > steady_from or (k == 0 and order == 1 and not chain.is_signed)
        known = stop > k and not (mixture is not None and mixture.unknown)
        if tables is not None and known and (steady or k > 0):
            end = stop if steady else k + 1
            begin = law.start(q) if k == 0 else (table, sign)
            old, table = method.series(system, tables, begin, ys, k, end, out)
            old_sign, sign = _sign(out, end - 2) if end - 2 >= k else sign, _sign(out, end - 1)
            before = None if end == 1 else Source(_mixture(ys, old, old_sign, end - 2, order), tables)
            mixture = _mixture(ys, table, sign, end - 1, order)
            k = end
            continue
        if k == 0 and s > 1:
            firsts = [method.first(law, one[0]) for one in ys]
            table, values = np.array([one.table for one, _ in firsts]), np.array([[v] for _, v in firsts])
            engine.summarise(out, slice(0, 1), table[:, None], None, values, switch)
            mixture = _mixture(ys, table, None, 0, order)
            k = 1
            continue
        if mixture is None:
            mixture, value = method.first(law, ys[0, 0])
        else:
            tables = system.pair_tables(k - 1) if tables is None else tables
            if wants_prior:
                priors.append((k, method.ahead(tables, mixture)))
            before = Source(mixture, tables)
            mixture, value = method.advance(tables, mixture, ys[0, k], min(k + 1, order) * q)
        if mixture.unknown:
            gaps[k] = mixture
        table, sign = mixture.table[None], None if mixture.sign is None else mixture.sign[None]
        single.append((k, mixture, value))
        k += 1
    for at, ahead in priors:
        for name, moment in (("x_prior", ahead.x), ("P_prior", ahead.P)):
            if name in out:
                out[name][:, at] = moment
    if single:
        _put_states(out, single, m, chain)
    return Trajectory(out, gaps, mixture, before)


def _put_states(
    out: dict[str, FloatArray], single: list[tuple[int, Mixture, float]], m: int, chain: SwitchChain
) -> None:
    """Fill in what was known after observations that were taken alone."""
    at, mixtures, values = zip(*single, strict=True)
    states = np.array([[engine.state_table(one.table, m) for one in mixtures]])
    signs, ones = None, np.ones(len(chain.nodes))
    if chain.is_signed:
        signs = np.array([[ones if one.sign is None else one.sign for one in mixtures]])
    switch = chain.nodes, chain.weights, chain.atoms
    engine.summarise(out, np.array(at), states, signs, np.array([values], dtype=np.float64), switch)


def _sign(out: dict[str, FloatArray], at: int) -> FloatArray | None:
    return out["sign"][:, at] if "sign" in out else None


def _mixture(ys: FloatArray, table: FloatArray, sign: FloatArray | None, k: int, order: int) -> Mixture:
    """Return what is known of the last series after observation ``k``, its window being complete."""
    window = ys[-1, max(0, k + 1 - order) : k + 1][::-1].reshape(-1).copy()
    return Mixture(table[-1].copy(), window, None if sign is None else sign[-1].copy())


def check_explained(name: str, walked: Trajectory, explained: Trajectory) -> None:
    """Refuse to smooth what a filter found whose verbs somebody has changed, unless its system explains it.

    Parameters
    ----------
    name : str
        Of its class.
    walked : Trajectory
        What it found by its verbs.
    explained : Trajectory
        What its system says of the observations that it took.

    Raises
    ------
    ParameterError
        If they differ by more than rounding.
    """
    for field in ("x", "P", "mu"):
        got, expected = walked.fields[field], explained.fields[field]
        off = np.abs(got - expected).reshape(len(got), -1).max(axis=1, initial=0.0)
        size = np.abs(expected).max(initial=0.0)
        wrong = np.flatnonzero(~(off <= _ROUNDING * size))
        if wrong.size:
            raise ParameterError(
                f"smooth: after observation {wrong[0]}, {field} of this {name} is {got[wrong[0]].tolist()}, "
                f"but its system leads to {expected[wrong[0]].tolist()}; the way back knows the system alone: "
                "let predict and update do no more than pass on other observations, or override smooth as well"
            )


def windows_of(ys: FloatArray, order: int) -> FloatArray:
    """Return the windows (y_n, y_{n-1}, ...) of full length, one row per n; NaN before the start."""
    if order == 1:
        return ys
    n, q = ys.shape
    windows = np.full((n, order, q), np.nan)
    for lag in range(min(order, n)):
        windows[lag:, lag] = ys[: n - lag]
    return windows.reshape(n, order * q)


# --------------------------------------------------------------------------- results


def result_of(
    chain: SwitchChain, trajectory: Trajectory, m: int, keep_nodes: bool, index: Any
) -> FilterResult:
    """Return what users read of a filtered series."""
    fields = {name: trajectory.fields[name] for name in SHOWN}
    if keep_nodes:
        fields["node_x"], fields["node_P"] = engine.node_moments(trajectory.fields["table"], m)
    return FilterResult(**fields, nodes=chain.nodes, index=index)


def smoothed_result(
    chain: SwitchChain, trajectory: Trajectory, smoothed: Smoothed, keep_nodes: bool, index: Any
) -> FilterResult:
    """Return what users read of a smoothed series."""
    x, P = mixture_moments(smoothed.mu, smoothed.x, smoothed.P)
    return FilterResult(
        x=x,
        P=P,
        mu=smoothed.mu,
        nodes=chain.nodes,
        switch=most_likely_switch(chain, smoothed.mu),
        switch_mean=smoothed.mu @ chain.nodes,
        switch_path=chain.nodes[smoothed.path],
        log_likelihood=trajectory.fields["log_likelihood"],
        node_x=smoothed.x if keep_nodes else None,
        node_P=smoothed.P if keep_nodes else None,
        index=index,
    )

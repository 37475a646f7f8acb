"""Whole series through a switching system, one or many.

Stretches of complete observations under constant tables go through the method at once, all
complete series side by side; the rest goes step by step.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from math import prod
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import mixture_moments
from fuzzykf.many import over_threads
from fuzzykf.results import FilterResult, field_shapes
from fuzzykf.switching.inference.mixture import Mixture, Source, most_likely_switch

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.selected import GapState
    from fuzzykf.switching.dynamics.pairs import Ahead, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.method import Method, Smoothed
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = [
    "FOUND",
    "SHOWN",
    "Stand",
    "Trajectory",
    "allocate",
    "check_explained",
    "class_weights_of",
    "filter_many",
    "filter_one",
    "result_of",
    "shown",
    "smoothed_result",
]

#: What engines find for every observation of a series.
FOUND = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")

#: What a switching filter shows of it.
SHOWN = (*FOUND, "class_weights")

_NONE = np.empty(0)

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
        The states after which a part of the window was unknown, if all of the states were asked for.
    last : Mixture or None
        After the last observation.
    before : Source or None
        From which the last observation was predicted.
    """

    fields: dict[str, FloatArray]
    gaps: dict[int, Mixture]
    last: Mixture | None
    before: Source | None


@dataclass(frozen=True)
class Stand:
    """Where a filter stands, so that a series can go on from there.

    Attributes
    ----------
    n : int
        Number of observations taken, missing ones included; at least one.
    mixture : Mixture
        What is known after them.
    skips : bool
        Whether the filter has predicted since: there is no observation of that time, then.
    origin : int
        Number of the observation from which the first tables of the system lead.
    """

    n: int
    mixture: Mixture
    skips: bool = False
    origin: int = 0

    def lead(self, q: int) -> FloatArray:
        """Return the observations (k, q) that the steps to come look at, and NaN for one that was skipped."""
        window = self.mixture.window.reshape(-1, q)[::-1]
        return np.concatenate([window, np.full((1, q), np.nan)]) if self.skips else window


def filter_one(
    method: Method,
    system: SwitchingSystem,
    ys: FloatArray,
    names: tuple[str, ...],
    *,
    states: bool | Literal["nodes"] = False,
    stand: Stand | None = None,
) -> Trajectory:
    """Filter a series (n, q), NaN where missing, from the initial law on or from where a filter stands.

    Parameters
    ----------
    method : Method
    system : SwitchingSystem
    ys : ndarray, shape (n, q)
    names : tuple of str
        The fields that are wanted.
    states : bool or "nodes"
        Whether the states are wanted as well; "nodes" if those of X alone are.
    stand : Stand, optional
    """
    lead = np.empty((0, ys.shape[1])) if stand is None else stand.lead(ys.shape[1])
    out = allocate(system, (1, len(lead) + len(ys)), names, bool(states))
    whole = np.concatenate([lead, ys])[None]
    trajectory = _filter_block(method, system, whole, out, stand, keeps_gaps=states is True)
    fields = {name: values[0, len(lead) :] for name, values in out.items()}
    return Trajectory(fields, trajectory.gaps, trajectory.last, trajectory.before)


def filter_many(
    method: Method,
    system: SwitchingSystem,
    series: FloatArray,
    names: tuple[str, ...],
    threads: int = 1,
    stand: Stand | None = None,
) -> dict[str, FloatArray]:
    """Filter many series (s, n, q), each from the initial law on or from where a filter stands.

    They go side by side, and ``threads`` share them; but those with gaps alone if the method does not take
    gaps, or if something is missing before the tables are constant.
    """
    source = _source_of_weights(system.chain)
    wanted = tuple(dict.fromkeys(source if name == "class_weights" else name for name in names))
    return shown(system.chain, _filter_led(method, system, series, wanted, threads, stand), names)


def _filter_led(
    method: Method,
    system: SwitchingSystem,
    series: FloatArray,
    names: tuple[str, ...],
    threads: int,
    stand: Stand | None,
) -> dict[str, FloatArray]:
    """Filter series with what has to stand before them."""
    if stand is not None:
        lead = stand.lead(series.shape[2])
        led = np.concatenate([np.broadcast_to(lead, (len(series), *lead.shape)), series], axis=1)
        whole = _filter_many(method, system, led, names, threads, stand)
        return {name: values[:, len(lead) :] for name, values in whole.items()}
    return _filter_many(method, system, series, names, threads, None)


def _filter_many(
    method: Method,
    system: SwitchingSystem,
    series: FloatArray,
    names: tuple[str, ...],
    threads: int,
    stand: Stand | None,
) -> dict[str, FloatArray]:
    """Filter series that begin with what `Stand.lead` gives."""
    out = allocate(system, series.shape[:2], names, False)
    missing, first = np.asarray(np.isnan(series).any(axis=2)), slice(None)
    if missing.any() and _takes_gaps(method, system):  # gaps later on are for the method
        steady_from = system.steady_from or 0
        if stand is None:
            first = slice(steady_from + 1 if steady_from or system.order > 1 else 0)
        elif not stand.mixture.unknown and stand.n - stand.origin > steady_from:
            first = slice(stand.mixture.window.size // series.shape[2])
    alone = missing[:, first].any(axis=1) | system.chain.is_signed
    if not alone.any():

        def block(rows: slice) -> None:
            part = {name: values[rows] for name, values in out.items()}
            _filter_block(method, system, series[rows], part, stand)

        over_threads(block, len(series), threads)
        return out
    if not alone.all():
        together = _filter_many(method, system, series[~alone], names, threads, stand)
        for name, values in together.items():
            out[name][~alone] = values
    for k in np.flatnonzero(alone):
        part = allocate(system, (1, series.shape[1]), names, False)
        _filter_block(method, system, series[k : k + 1], part, stand)
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
    method: Method,
    system: SwitchingSystem,
    ys: FloatArray,
    out: dict[str, FloatArray],
    stand: Stand | None = None,
    keeps_gaps: bool = False,
) -> Trajectory:
    """Filter series (s, n, q) side by side: complete, a single one with gaps, or several that begin complete.

    They begin with the window of ``stand`` if there is one, whose fields are not filled in.  Returns what is
    known after the last observation of the last series; the fields go to ``out``.
    """
    s, n, q = ys.shape
    m, order, chain = system.dim_x, system.order, system.chain
    gaps: dict[int, Mixture] = {}
    if n == 0 or s == 0:
        return Trajectory(out, gaps, None, None)
    missing = np.isnan(ys)
    holes = [*np.flatnonzero(missing.any(axis=(0, 2))).tolist(), n] if missing.any() else [n]
    switch = chain.keys, chain.weights, chain.atoms, chain.ranking
    law = system.initial() if stand is None else None
    priors: list[tuple[int, Ahead]] = []  # what was known before observations taken alone
    wants_prior = "x_prior" in out or "P_prior" in out
    # known of the latest observation: tables and signs of all series, or of one whatever is known
    table = sign = None
    mixture: Mixture | None = None
    before: Source | None = None
    tables: PairTables | None = None
    single: list[tuple[int, FloatArray, FloatArray | None, float]] = []  # observations taken alone
    # probabilities that an engine has beside their logarithms, before the latest observation and after
    mass = np.full((2, s, len(chain.nodes)), np.nan)
    takes_gaps = len(holes) > 1 and _takes_gaps(method, system)
    by_hand = -1  # the observation that is too far off for a series
    k = shift = 0
    if stand is not None:
        mixture = stand.mixture
        k = mixture.window.size // q
        shift = stand.n - k - stand.origin  # observation k of ys is number k + shift of the system
        table = np.repeat(mixture.table[None], s, axis=0)
        sign = None if mixture.sign is None else np.repeat(mixture.sign[None], s, axis=0)
        mass[1] = np.nan if mixture.mass is None else mixture.mass
    steady_from = n if system.steady_from is None else system.steady_from - shift
    through = getattr(system, "goes_through", False)  # with tables that differ in what is known alone
    starts = not steady_from and bool(holes[0] or takes_gaps)  # whether tables are needed from the first on
    while k < n:
        stop = holes[bisect_left(holes, k)]
        if tables is None or k <= steady_from + 1:
            tables = system.pair_tables(max(k + shift - 1, 0)) if k or starts else None
        if law is not None and k == 0 and wants_prior:
            priors.append((0, law.ahead(m)))
        steady = k > steady_from or (k == 0 and order == 1 and not chain.is_signed) or through
        known = stop > k and not (mixture is not None and mixture.unknown)
        begun = mixture is None or not mixture.unknown or mixture.root is not None
        if takes_gaps and tables is not None and steady and begun and k != by_hand:
            state: Any = law.start(q) if law is not None and k == 0 else (table,)
            if mixture is not None and mixture.unknown:
                state = engine.GapState(mixture.table, mixture.root, mixture.branches)
            kept: dict[int, GapState] | None = {} if keeps_gaps else None
            table, reached, states = method.gappy_series(system, tables, state, ys, k, n, out, mass, kept)
            for at, one in (kept or {}).items():
                gaps[at] = _mixture_of(ys, one, at, order, m, mass[1])
            for stuck in np.flatnonzero(reached < n) if s > 1 else ():
                part = {name: values[stuck : stuck + 1] for name, values in out.items()}
                _filter_block(method, system, ys[stuck : stuck + 1], part, stand)
            end = int(reached[-1]) if s == 1 else n
            if end > k:
                if end > 1:
                    old_mixture = _mixture_of(ys, states[0], end - 2, order, m, mass[0])
                    before = Source(mixture if end == k + 1 and mixture is not None else old_mixture, tables)
                mixture = _mixture_of(ys, states[1], end - 1, order, m, mass[1])
            k = by_hand = end
            continue
        if tables is not None and known and (steady or k > 0):
            end = stop if steady else k + 1
            begin = law.start(q) if law is not None and k == 0 else (table, sign)
            old, table = method.series(system, tables, begin, ys, k, end, out, mass)
            old_sign, sign = _sign(out, end - 2) if end - 2 >= k else sign, _sign(out, end - 1)
            first = end == 1  # nothing was known before it
            tables = system.pair_tables(end + shift - 2) if through else tables
            before = None if first else Source(_mixture(ys, old, old_sign, end - 2, order, mass[0]), tables)
            mixture = _mixture(ys, table, sign, end - 1, order, mass[1])
            k = end
            continue
        if law is not None and k == 0 and s > 1:
            firsts = [method.first(law, one[0]) for one in ys]
            table, values = np.array([one.table for one, _ in firsts]), np.array([[v] for _, v in firsts])
            engine.summarise(out, slice(0, 1), table[:, None], None, values, switch)
            mixture = _mixture(ys, table, None, 0, order, mass[1])
            k = 1
            continue
        if law is not None and mixture is None:
            mixture, value = method.first(law, ys[0, 0])
        else:
            assert mixture is not None
            tables = system.pair_tables(k + shift - 1) if tables is None else tables
            if wants_prior:
                priors.append((k, method.ahead(tables, mixture)))
            before = Source(mixture, tables)
            mixture, value = method.advance(tables, mixture, ys[0, k], min(k + 1, order) * q)
        if mixture.unknown and keeps_gaps:
            gaps[k] = mixture
        table, sign = mixture.table[None], None if mixture.sign is None else mixture.sign[None]
        mass[1] = np.nan if mixture.mass is None else mixture.mass
        single.append((k, engine.state_table(mixture.table, m), mixture.sign, value))
        k += 1
    for at, ahead in priors:
        for name, moment in (("x_prior", ahead.x), ("P_prior", ahead.P)):
            if name in out:
                out[name][:, at] = moment
    if single:
        _put_states(out, single, chain)
    return Trajectory(out, gaps, mixture, before)


def _takes_gaps(method: Method, system: SwitchingSystem) -> bool:
    """Whether series with gaps go through the method at once, as soon as its tables are constant."""
    bases = reversed(list(enumerate(type(method).__mro__)))
    owner = {name: k for k, one in bases for name in vars(one)}  # of each attribute, by its place
    if owner.get("first", 0) < owner.get("gappy_series", 0):  # a subclass has changed what series do not ask
        return False
    if not method.takes_gaps or system.chain.is_signed or system.steady_from is None:
        return False
    tables = system.pair_tables(system.steady_from)
    return bool(engine.fit_together(tables.gaps, tables.kernel))


def _put_states(
    out: dict[str, FloatArray],
    single: list[tuple[int, FloatArray, FloatArray | None, float]],
    chain: SwitchChain,
) -> None:
    """Fill in what was known after observations that were taken alone."""
    at, states, all_signs, values = zip(*single, strict=True)
    signs, ones = None, np.ones(len(chain.nodes))
    if chain.is_signed:
        signs = np.array([[ones if one is None else one for one in all_signs]])
    switch = chain.keys, chain.weights, chain.atoms, chain.ranking
    engine.summarise(
        out, np.array(at), np.array([states]), signs, np.array([values], dtype=np.float64), switch
    )


def _sign(out: dict[str, FloatArray], at: int) -> FloatArray | None:
    return out["sign"][:, at] if "sign" in out else None


def _mixture(
    ys: FloatArray, table: FloatArray, sign: FloatArray | None, k: int, order: int, mass: FloatArray
) -> Mixture:
    """Return what is known of the last series after observation ``k``, its window being complete."""
    window = ys[-1, max(0, k + 1 - order) : k + 1][::-1].reshape(-1).copy()
    p = None if np.isnan(mass[-1]).any() else mass[-1].copy()
    return Mixture(table[-1].copy(), window, None if sign is None else sign[-1].copy(), p)


def _mixture_of(ys: FloatArray, state: GapState, k: int, order: int, m: int, mass: FloatArray) -> Mixture:
    """Return what is known of the last series after observation ``k``."""
    if state.root is None:
        return _mixture(ys, state.table[None], None, k, order, mass)
    window = ys[-1, max(0, k + 1 - order) : k + 1][::-1].reshape(-1).copy()
    unknown = len(state.root[0]) - m
    return Mixture(state.table, window, None, None, unknown, state.root, state.branches)


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
        off = np.abs(got - expected).max(axis=tuple(range(1, got.ndim)), initial=0.0)
        wrong = np.flatnonzero(~(off <= _ROUNDING * np.abs(expected).max(initial=0.0)))
        if wrong.size:
            k = int(wrong[0])
            raise ParameterError(
                f"smooth: after observation {k}, {field} of this {name} is {got[k].tolist()}, but its system "
                f"leads to {expected[k].tolist()}; the way back knows the system alone: let predict and "
                "update do no more than pass on other observations, or override smooth as well"
            )


# --------------------------------------------------------------------------- results


def shown(chain: SwitchChain, found: dict[str, FloatArray], names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return the fields named of what an engine found: where it has keys of the switch, the values.

    A switch between more than two classes has no mean.
    """
    fields = {}
    for name in names:
        if name == "class_weights":
            fields[name] = class_weights_of(chain, found.get("mu", _NONE), found.get("switch_mean"))
        elif name == "switch":
            fields[name] = found[name] if chain.nodes.ndim == 1 else chain.values(found[name])
        elif name != "switch_mean" or chain.nodes.ndim == 1:
            fields[name] = found[name]
    return fields


def _source_of_weights(chain: SwitchChain) -> str:
    """Return the field from which the weights of the classes follow: the mean tells all of two classes."""
    two = chain.nodes.ndim == 1 and np.array_equal(chain.class_weights[:, -1], chain.nodes)
    return "switch_mean" if two and chain.class_weights.shape[1] == 2 else "mu"


def class_weights_of(chain: SwitchChain, mu: FloatArray, mean: FloatArray | None = None) -> FloatArray:
    """Return the expected shares of the classes (..., K), to the bit the same however many rows there are.

    Parameters
    ----------
    chain : SwitchChain
    mu : ndarray, shape (..., M)
    mean : ndarray, shape (...), optional
        Of the switch, if it is known already.
    """
    if _source_of_weights(chain) == "switch_mean":
        mean = np.asarray(mu @ chain.keys) if mean is None else mean
        shares = np.empty((*mean.shape, 2))
        np.subtract(1.0, mean, out=shares[..., 0])
        shares[..., 1] = mean
        return shares
    shares = np.zeros((*mu.shape[:-1], chain.class_weights.shape[1]))
    for k, weights in enumerate(chain.class_weights):
        shares += mu[..., k, None] * weights
    return shares


def result_of(
    chain: SwitchChain, trajectory: Trajectory, m: int, keep_nodes: bool, index: Any
) -> FilterResult:
    """Return what users read of a filtered series."""
    fields = shown(chain, trajectory.fields, SHOWN)
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
        switch_mean=smoothed.mu @ chain.nodes if chain.nodes.ndim == 1 else None,
        class_weights=class_weights_of(chain, smoothed.mu),
        switch_path=None if smoothed.path is None else chain.nodes[smoothed.path],
        log_likelihood=trajectory.fields["log_likelihood"],
        node_x=smoothed.x if keep_nodes else None,
        node_P=smoothed.P if keep_nodes else None,
        index=index,
    )

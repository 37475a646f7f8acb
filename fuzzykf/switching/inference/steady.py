"""Whole series of complete observations, filtered and summarised by the engine at once.

Only where the engine offers it, tables are constant from the start and no weight is
negative; everything else goes through `fuzzykf.switching.inference.series`.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import cholesky, mixture_moments
from fuzzykf.switching.dynamics.pairs import log_probability

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["filter_steady", "is_steady"]


def is_steady(system: SwitchingSystem, ys: FloatArray) -> bool:
    """Whether `filter_steady` can filter the series ``ys`` (s, n, q), as far as the system is concerned."""
    return (
        engine.SUMMARISES
        and ys.size > 0
        and system.order == 1
        and system.steady_from == 0
        and not system.chain.is_signed
    )


class _Plan(NamedTuple):
    """What the engine needs to filter with the tables of a system, made once."""

    chain: SwitchChain
    law: InitialLaw
    kernel: Any
    summary: Any
    start: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    first_prior: tuple[FloatArray, FloatArray]  # moments before the first observation


_PLANS: WeakKeyDictionary[PairTables, _Plan] = WeakKeyDictionary()


def _plan_of(system: SwitchingSystem) -> _Plan:
    tables, chain, law = system.pair_tables(0), system.chain, system.initial()
    plan = _PLANS.get(tables)
    if plan is None or plan.chain is not chain or plan.law is not law:
        plan = _PLANS[tables] = _make_plan(tables, chain, law)
    return plan


def _make_plan(tables: PairTables, chain: SwitchChain, law: InitialLaw) -> _Plan:
    kernel, prior, m = tables.kernel, tables.prior, tables.pairs.dim_x
    factor = cholesky(
        law.covariance[:, m:, m:], lambda k: f"covariance of the first observation, node {k[0]}"
    )
    return _Plan(
        chain,
        law,
        kernel,
        engine.Summary(
            kernel,
            tables.transition,
            prior.offset,
            prior.twice,
            prior.noise,
            chain.nodes,
            chain.weights,
            chain.atoms,
        ),
        (log_probability(law.probability), law.mean, law.covariance, factor),
        mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m]),
    )


def filter_steady(
    system: SwitchingSystem, ys: FloatArray, out: dict[str, FloatArray], threads: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Filter complete series, each from the initial law on.

    Parameters
    ----------
    system : SwitchingSystem
    ys : ndarray, shape (s, n, q)
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in: fields of `FilterResult` that `SwitchingFilter` shows.
    threads : int
        How many threads to share the series among; results do not depend on it.

    Returns
    -------
    before, last : ndarray, shape (1 + m + m*m, M)
        The states of the last series after its last two observations.
    """
    plan = _plan_of(system)
    for name, value in zip(("x_prior", "P_prior"), plan.first_prior, strict=True):
        if name in out:
            out[name][:, 0] = value

    def work(ys: FloatArray, out: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
        return engine.filter_series(plan.kernel, plan.summary, plan.start, ys, out)

    cuts = [len(ys) * k // threads for k in range(threads + 1)]
    blocks = [slice(a, b) for a, b in pairwise(cuts) if b > a]
    if len(blocks) == 1:
        return work(ys, out)
    parts = [{name: values[block] for name, values in out.items()} for block in blocks]
    with ThreadPoolExecutor(len(blocks)) as pool:
        return list(pool.map(work, [ys[block] for block in blocks], parts))[-1]

"""Whole series of complete observations, filtered and summarised by the engine at once.

Only where the engine offers it, tables are constant from the start and no weight is
negative; everything else goes through `fuzzykf.switching.series`.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TYPE_CHECKING

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import cholesky, mixture_moments
from fuzzykf.switching.tables import log_probability

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.switching.tables import SwitchingSystem

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


def filter_steady(
    system: SwitchingSystem, ys: FloatArray, out: dict[str, FloatArray], threads: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Filter complete series, each from the initial law on.

    Parameters
    ----------
    system : SwitchingSystem
    ys : ndarray, shape (s, n, q)
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in; see `fuzzykf.switching.many.FIELDS`.
    threads : int
        How many threads to share the series among; results do not depend on it.

    Returns
    -------
    before, last : ndarray, shape (1 + m + m*m, M)
        The states of the last series after its last two observations.
    """
    m, chain, tables, law = system.dim_x, system.chain, system.pair_tables(0), system.initial()
    kernel, prior, atoms = tables.kernel, tables.prior, chain.atoms
    summary = engine.Summary(
        kernel, tables.transition, prior.offset, prior.twice, prior.noise, chain.nodes, chain.weights, atoms
    )
    factor = cholesky(
        law.covariance[:, m:, m:], lambda k: f"covariance of the first observation, node {k[0]}"
    )
    start = log_probability(law.probability), law.mean, law.covariance, factor
    if "x_prior" in out or "P_prior" in out:
        moments = mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m])
        for name, value in zip(("x_prior", "P_prior"), moments, strict=True):
            if name in out:
                out[name][:, 0] = value
    cuts = [len(ys) * k // threads for k in range(threads + 1)]
    blocks = [slice(a, b) for a, b in pairwise(cuts) if b > a]

    def work(block: slice) -> tuple[FloatArray, FloatArray]:
        part = {name: values[block] for name, values in out.items()}
        return engine.filter_series(kernel, summary, start, ys[block], part)

    if len(blocks) == 1:
        return work(blocks[0])
    with ThreadPoolExecutor(len(blocks)) as pool:
        return list(pool.map(work, blocks))[-1]

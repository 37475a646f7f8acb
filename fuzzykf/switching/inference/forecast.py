"""Forecasts: a filter moved ahead without observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.gaussian import as_count
from fuzzykf.results import FilterResult
from fuzzykf.switching.inference.mixture import most_likely_switch
from fuzzykf.switching.inference.series import class_weights_of

if TYPE_CHECKING:
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.inference.method import Method
    from fuzzykf.switching.inference.mixture import Mixture

__all__ = ["forecast"]

#: Longest forecast: all of its steps are kept.
MOST_STEPS = 1_000_000


def forecast(
    method: Method, system: SwitchingSystem, mixture: Mixture | None, n: int, steps: int
) -> FilterResult:
    """Predict states and observations ahead; see `SwitchingFilter.forecast`.

    Parameters
    ----------
    method : Method
    system : SwitchingSystem
    mixture : Mixture or None
        What is known after ``n`` observations; None if that is none.
    n : int
    steps : int
    """
    steps = as_count("steps", steps, 1, MOST_STEPS)
    expects = getattr(system, "expects", None)  # where features take what is expected
    nothing = np.full(system.dim_z, np.nan)
    rows = []
    for k in range(n, n + steps):
        if mixture is None:
            law = system.initial()
            rows.append(law.ahead(system.dim_x))
            if expects is not None:
                expects(rows[-1])
            mixture, _ = method.first(law, nothing)
        else:
            tables = system.pair_tables(k - 1)
            rows.append(method.ahead(tables, mixture))
            if expects is not None:
                expects(rows[-1])
            mixture, _ = method.advance(tables, mixture, nothing, min(k + 1, system.order) * system.dim_z)
    mu, x, P, z_prior, S = (np.array(column) for column in zip(*rows, strict=True))
    chain = system.chain
    return FilterResult(
        x=x,
        P=P,
        z_prior=z_prior,
        S=S,
        mu=mu,
        nodes=chain.nodes,
        switch=most_likely_switch(chain, mu),
        switch_mean=mu @ chain.nodes if chain.nodes.ndim == 1 else None,
        class_weights=class_weights_of(chain, mu),
    )

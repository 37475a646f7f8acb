"""Forecasts: a filter moved ahead without observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.results import FilterResult
from fuzzykf.switching.recursion import most_likely_switch

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.switching.filter_base import SwitchingFilter

__all__ = ["forecast"]


def forecast(filter_: SwitchingFilter, steps: int) -> FilterResult:
    """Predict states and observations ahead; see `SwitchingFilter.forecast`."""
    if steps < 1:
        raise ParameterError(f"steps: got {steps}, expected at least 1")
    ahead = filter_.copy()
    ahead.predict()
    rows: list[tuple[FloatArray, ...]] = []
    for _ in range(steps):
        z_prior, S = ahead._predicted_observation()
        rows.append((ahead.x[:, 0], ahead.P, z_prior, S, ahead.mu))
        if ahead._n == 0:  # a leading predict only shows the first step; let that observation be missing
            ahead.update(None)
        ahead.predict()
    x, P, z_prior, S, mu = (np.array(column) for column in zip(*rows, strict=True))
    chain = ahead._system.chain
    return FilterResult(
        x=x,
        P=P,
        z_prior=z_prior,
        S=S,
        mu=mu,
        nodes=chain.nodes,
        switch=most_likely_switch(chain, mu),
        switch_mean=mu @ chain.nodes,
    )

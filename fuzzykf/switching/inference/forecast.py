"""Forecasts: a filter moved ahead without observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import is_whole
from fuzzykf.results import FilterResult
from fuzzykf.switching.inference.recursion import most_likely_switch

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.filters.switching_filter import SwitchingFilter

__all__ = ["forecast"]


def forecast(filter_: SwitchingFilter, steps: int) -> FilterResult:
    """Predict states and observations ahead; see `SwitchingFilter.forecast`."""
    if not is_whole(steps) or steps < 1:
        raise ParameterError(f"steps: got {steps!r}, expected a whole number of at least 1")
    ahead = filter_.copy()
    rows: list[tuple[FloatArray, ...]] = []
    for _ in range(int(steps)):
        if rows:  # what was predicted is not observed
            ahead.update(None)
        if not ahead._predicted:
            ahead.predict()
        z_prior, S = ahead._predicted_observation()
        rows.append((ahead.x[:, 0], ahead.P, z_prior, S, ahead.mu))
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

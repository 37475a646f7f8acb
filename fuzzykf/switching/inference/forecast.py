"""Forecasts: a filter moved ahead without observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import is_whole, mixture_moments
from fuzzykf.results import FilterResult
from fuzzykf.switching.inference import recursion
from fuzzykf.switching.inference.belief import (
    Belief,
    Source,
    begin,
    node_state,
    predict_observation,
    predict_state,
    proceed,
)

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem

__all__ = ["forecast"]


def forecast(system: SwitchingSystem, belief: Belief | None, n: int, steps: int) -> FilterResult:
    """Predict states and observations ahead; see `SwitchingFilter.forecast`.

    Parameters
    ----------
    system : SwitchingSystem
    belief : Belief or None
        What is known after ``n`` observations; None if that is none.
    n : int
    steps : int
    """
    if not is_whole(steps) or steps < 1:
        raise ParameterError(f"steps: got {steps!r}, expected a whole number of at least 1")
    m, q, chain = system.dim_x, system.dim_z, system.chain
    nothing = np.full(q, np.nan)
    rows: list[tuple[FloatArray, ...]] = []
    for k in range(n, n + int(steps)):
        if belief is None:
            law = system.initial()
            x, P = mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m])
            rows.append((x, P, *predict_observation(None, law, m), law.probability))
            belief, _ = begin(law, nothing)
        else:
            tables = system.pair_tables(k - 1)
            mu = recursion.predict_probabilities(tables, node_state(belief, m))
            z_prior, S = predict_observation(Source(belief, tables), None, m)
            rows.append((*predict_state(tables, belief), z_prior, S, mu))
            belief, _ = proceed(tables, belief, nothing, min(k + 1, system.order) * q)
    x, P, z_prior, S, mu = (np.array(column) for column in zip(*rows, strict=True))
    return FilterResult(
        x=x,
        P=P,
        z_prior=z_prior,
        S=S,
        mu=mu,
        nodes=chain.nodes,
        switch=recursion.most_likely_switch(chain, mu),
        switch_mean=mu @ chain.nodes,
    )

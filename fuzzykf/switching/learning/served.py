"""From a joint fit to one that serves the filter, if that was asked for and is better."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fuzzykf.results import FilterTraining
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.law_numbers import ChainNumbers
from fuzzykf.switching.learning.em import Estimate, Posterior, Settled, expectation
from fuzzykf.switching.learning.filter_training import Start, train_for_filter
from fuzzykf.switching.learning.gaussians import RegressionEstimate, transition_vectors
from fuzzykf.switching.models.fuzzy import CGOFMSModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.law_numbers import LawNumbers
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.fit import Found, Options
    from fuzzykf.switching.models.hard import CGOMSModel

__all__ = ["searched", "served"]


def searched(joint: Callable[[TrainingData], Found], data: TrainingData, options: Options) -> Found:
    """Search jointly; before training for the filter without inputs and features.

    With many regressors of its own in each regime the joint likelihood cuts the data into regimes that only
    these tell apart, from which a filter does not recover.
    """
    if options.objective != "filter":
        return joint(data)
    memo = {} if options.memo is None else options.memo
    if len(data.z) not in memo:
        memo[len(data.z)] = joint(replace(data, further=None))
    return _widened(memo[len(data.z)], data)


def _widened(found: Found, data: TrainingData) -> Found:
    """Return what a joint search found, with inputs and features that have no effect yet if it had none."""
    estimate, posterior, trace, converged = found
    gaussian = estimate.gaussian
    if not isinstance(gaussian, RegressionEstimate) or gaussian.window == data.window:
        return found
    return Estimate(estimate.chain, gaussian.widened(data.window)), posterior, trace, converged


def served(
    estimate: Estimate,
    posterior: Posterior,
    search: Callable[[TrainingData, Options], Found],
    make: Callable[[Estimate | Settled, Posterior, TrainingData], Any],
    shares: FloatArray,
    n_nodes: int,
    data: TrainingData,
    options: Options,
) -> tuple[Estimate | Settled, Posterior, FilterTraining | None]:
    """Go on from the joint fit by what serves the filter, if that was asked for and is better."""
    if options.objective == "joint":
        return estimate, posterior, None

    def start(one: Estimate, seen: Posterior, rows: TrainingData) -> Start:
        model = make(one, seen, rows)
        assert isinstance(one.gaussian, RegressionEstimate)  # no other form has this objective
        return Start(one.gaussian, _numbers(model, n_nodes), model.placed(n_nodes))

    def fit_before(rows: TrainingData) -> Start:
        guess = None if options.guess is None else options.guess[: len(rows.z)]
        one, seen, *_ = search(rows, replace(options, guess=guess))
        return start(one, seen, rows)

    begun = start(estimate, posterior, data)
    trained = train_for_filter(begun, data, fit_before, options.tick)
    if isinstance(trained, FilterTraining):
        return estimate, posterior, trained
    law = begun.system.chain if trained.law is None else trained.law
    chain = law if isinstance(law, SwitchChain) else law.discretize(n_nodes)
    settled = Settled(law, chain, trained.estimate, trained.tilt if trained.tilt.size else None)
    return settled, expectation(settled, shares, data, transition_vectors(data)), trained.training


def _numbers(model: CGOFMSModel | CGOMSModel, n_nodes: int) -> LawNumbers | None:
    """Return the free numbers of the law of the switch; one regime that stays has none."""
    if isinstance(model, CGOFMSModel):
        return model.law.free_numbers(n_nodes)
    return ChainNumbers(model.placed().chain) if model.n_classes > 1 else None

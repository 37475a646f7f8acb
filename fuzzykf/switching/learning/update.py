"""Going on with new rows from what was learned, so that a model can follow the seasons.

With S the statistics of the rows so far, f the factor by which a row is forgotten and n the number of new
rows, learning goes on by raising

    log p(new rows; theta) + f^n E[log p(rows so far, their switch; theta)] + log prior(theta),

where the expectation is fixed: of the rows so far there are only the statistics, as their last expectation
step found them.  So each iteration is one of expectation-maximisation over the new rows, and the
maximisation sees f^n S and the statistics of the new rows together.  At the end they become the S of the next
time.  The objective never falls, and one new row costs the same however many there were before.

References
----------
R. M. Neal, G. E. Hinton, "A view of the EM algorithm that justifies incremental, sparse, and other variants",
in M. I. Jordan (ed.), Learning in Graphical Models (1998): expectations of some rows at a time.

O. Cappé, E. Moulines, "On-line expectation-maximization algorithm for latent data models", Journal of the
Royal Statistical Society B 71 (2009): statistics that are discounted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_real
from fuzzykf.results import bic
from fuzzykf.switching.learning.data import MIN_TRANSITIONS, gather, irregular
from fuzzykf.switching.learning.em import run_em
from fuzzykf.switching.learning.fit import CREEP, Fitted, fuzzy_model, hard_model
from fuzzykf.switching.learning.likelihood import log_likelihood
from fuzzykf.switching.learning.notes import (
    instability,
    left_for_good,
    no_shorter,
    one_name,
    scant_statistics,
    scarcity,
    stuck,
    unfinished,
    ways,
)
from fuzzykf.switching.learning.present import present
from fuzzykf.switching.learning.statistics import Learned, Statistics
from fuzzykf.switching.learning.tilt import n_free

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.results import FitResult
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.learning.data import Earlier, TrainingData
    from fuzzykf.switching.learning.em import Posterior

__all__ = ["Continuation", "why_not"]


def why_not(options: Mapping[str, Any], *, knows_switch: bool) -> str:
    """Say why a fit leaves no statistics to go on from; nothing if it does.

    Parameters
    ----------
    options : mapping
        Of the fit; its form is the one that was learned.
    knows_switch : bool
    """
    if knows_switch:
        return "with r; expected one with a hidden switch, r=None"
    if options.get("objective", "joint") == "filter":
        return "with objective='filter'; expected one with objective='joint'"
    if options["form"] == "covariance":
        return "in the form 'covariance'; expected one with form='regression'"
    return ""


@dataclass(frozen=True)
class Continuation:
    """Learns from new rows; see `fuzzykf.results.FitResult.update`.

    Attributes
    ----------
    learned : Learned or None
    earlier : Earlier
        Units and names of the first fit.
    options : mapping
        Of the first fit: the largest number of iterations, the tolerance, whether the state has feedback.
    obstacle : str
        Why there is nothing that was learned, see `why_not`.
    """

    learned: Learned | None
    earlier: Earlier
    options: Mapping[str, Any]
    obstacle: str = ""

    def __call__(self, x: Any, y: Any, forget: Any, inputs: Any = None) -> FitResult[Any]:
        """Learn from new rows, those before being forgotten in part."""
        if self.learned is None:
            raise ParameterError(f"update: this result was learned {self.obstacle}")
        factor = as_real("forget", forget, "a number in ]0, 1]")
        if not 0.0 < factor <= 1.0:
            raise ParameterError(f"forget: got {forget}, expected a number in ]0, 1]")
        feedback = self.options.get("state_feedback", True)
        _check_inputs(inputs, self.earlier)
        further = self.earlier.further
        features = None if further is None else further.features
        data = gather(x, y, state_feedback=feedback, earlier=self.earlier, inputs=inputs, features=features)
        fitted = _learn(self.learned, data, factor, self.options)
        notes = [*irregular(x, y), *one_name(self.earlier.labels), *fitted.warnings]
        value = bic(fitted.n_parameters, len(data.z), fitted.log_likelihood)
        return present(
            replace(fitted, warnings=notes),
            {"regression": value},
            data,
            x,
            continuation=replace(self, learned=fitted.learned),
        )


def _check_inputs(inputs: Any, earlier: Earlier) -> None:
    """Raise unless there are inputs where the first fit had some."""
    names = () if earlier.further is None else earlier.further.inputs
    if inputs is None and names:
        raise ParameterError(f"inputs: missing; the first fit had {', '.join(names)}")
    if inputs is not None and not names:
        raise ParameterError("inputs: got some, but the first fit had none; expected None")


def _learn(learned: Learned, data: TrainingData, forget: float, options: Mapping[str, Any]) -> Fitted:
    before = learned.statistics.discounted(forget**data.n_rows)
    _check_weight(before, data)
    start = learned.start(before)
    shares = start.chain.class_weights
    max_iter, tolerance = options["max_iter"], options["tolerance"]
    estimate, posterior, trace, converged = run_em(
        start,
        shares,
        data,
        max_iter=max_iter,
        tolerance=tolerance,
        accelerate=tolerance < CREEP,
        before=before.counts,
    )
    statistics = before.joined(Statistics.of(posterior, shares, data))
    is_hard = learned.law is None
    make = hard_model if is_hard else fuzzy_model
    model: Any = make(estimate, statistics.rows, data.scale, data.further)
    system = model.placed() if is_hard else model.placed(learned.n_nodes)
    n_parameters = estimate.gaussian.n_parameters + estimate.chain.n_parameters + n_free(estimate.tilt)
    weights = posterior.gamma @ shares
    notes = _notes(statistics, n_parameters, posterior, system, data) + unfinished(converged, max_iter)
    if not is_hard:
        notes += no_shorter(model.law, learned.n_nodes) + left_for_good(system.chain, weights)
    K = shares.shape[1]
    return Fitted(
        model,
        log_likelihood(system, data),
        n_parameters,
        trace,
        converged,
        notes,
        weights @ np.arange(K, dtype=np.float64) if is_hard or K == 2 else None,
        weights,
        learned=learned.moved(estimate, statistics),
    )


def _check_weight(before: Statistics, data: TrainingData) -> None:
    """Raise if so much is forgotten that the state could not be learned from what is left and new."""
    old, new = float(before.steps.state.weight.sum()), int(data.has_state.sum())
    if old + new < MIN_TRANSITIONS:
        raise ParameterError(
            f"forget: leaves the earlier rows the weight of {old:.3g} steps with a measured state, and the "
            f"new ones have {new}; expected at least {MIN_TRANSITIONS} together: more rows, or a number "
            "nearer to 1"
        )


def _notes(
    statistics: Statistics,
    n_parameters: int,
    posterior: Posterior,
    system: SwitchingSystem,
    data: TrainingData,
) -> list[str]:
    """Say what the rows that count cannot support."""
    (steps, steps_with_state), (rows, rows_with_state) = statistics.steps, statistics.rows
    K = rows.shares.shape[1]
    pairs, state_pairs = ((one.weight @ one.shares).reshape(K, K) for one in (steps, steps_with_state))
    m, q = data.dim_x, int(data.z.shape[1]) - data.dim_x
    n_numbers = m * float(rows_with_state.weight.sum()) + q * float(rows.weight.sum())
    notes = scarcity(rows.weight @ rows.shares, pairs, state_pairs, ways(system.chain))
    notes += instability(system) + stuck(posterior.gamma, system, data)
    return notes + scant_statistics(n_parameters, n_numbers)

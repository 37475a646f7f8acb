"""Learning that serves the filter: from the joint fit on, with an end that rows kept back decide.

The last fifth of the measured states is kept back.  On the rows before it the joint fit is made again, and
goes on by L-BFGS on the objective of `filter_objective`; every few iterations the filter is scored on the
rows kept back.  What scored best tells how many iterations to make, and by how much to widen the noise of the
state.  Then all rows are learned from, with as many iterations.  The joint fit stays unless something scored
better by more than the standard error of the difference, and what came of it scores the states that it
learned from better, too: where rows are few, those kept back may lead astray.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.results import FilterTraining
from fuzzykf.switching.learning.data import component
from fuzzykf.switching.learning.filter_objective import FilterObjective, stretches

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.laws.law_numbers import LawNumbers
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.filter_objective import Stretch
    from fuzzykf.switching.learning.gaussians import RegressionEstimate

__all__ = ["Start", "Trained", "train_for_filter"]

#: Share of the measured states that is kept back.
KEPT_BACK = 0.2

#: Iterations at most, how often the filter is scored, and how many iterations without a better score end it.
MOST, LOOK, PATIENCE = 120, 5, 25

#: What the noise of the state may be widened by.
INFLATIONS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0)

#: Fewest measured states that are kept back: fewer decide nothing.
LEAST_KEPT = 20

#: Batches of them of which the scores are compared.
BATCHES = 10

#: Standard deviation, in that of all rows, from which a component varies in those before.
LEAST_SPREAD = 1e-6

#: How much worse than at the start the objective is told to be where there is none.
BEYOND = 1e3


class Start(NamedTuple):
    """A joint fit, from which the search begins."""

    estimate: RegressionEstimate
    law: LawNumbers | None
    system: SwitchingSystem


class Trained(NamedTuple):
    """What was learned for the filter."""

    training: FilterTraining
    estimate: RegressionEstimate
    law: Any  # None where it has nothing to move
    tilt: FloatArray  # (K, k): how inputs act on transitions, in standard units


def train_for_filter(
    start: Start,
    data: TrainingData,
    fit_before: Callable[[TrainingData], Start],
    tick: Callable[[], None] | None = None,
) -> Trained | FilterTraining:
    """Learn for the filter.

    Parameters
    ----------
    start : Start
        The joint fit on all rows.
    data : TrainingData
    fit_before : callable
        Makes the joint fit on the first rows alone.
    tick : callable, optional
        Called after each iteration.

    Returns
    -------
    Trained or FilterTraining
        How it was learned alone, if the joint fit is better.

    Raises
    ------
    ParameterError
        If too few states were measured to keep some back.
    """
    measured = np.flatnonzero(data.known)
    n_kept = int(KEPT_BACK * measured.size)
    if n_kept < LEAST_KEPT:
        raise ParameterError(
            f"objective: got 'filter', which keeps back a fifth of the measured states, {n_kept} of "
            f"{measured.size:,}; expected at least {LEAST_KEPT}, or 'joint'"
        )
    cut = int(measured[-n_kept])
    try:
        first = fit_before(_checked(_until(data, cut)))
    except (FuzzykfError, np.linalg.LinAlgError) as reason:
        return FilterTraining("joint", np.nan, np.nan, np.nan, 0, 1.0, n_kept, note=str(reason))
    objective = FilterObjective(
        first.estimate, first.law, first.system.chain, stretches(data, first.system, cut)
    )
    kept_back = _KeptBack(objective, stretches(data, first.system), n_kept)
    numbers, trace = _ascend(objective, MOST, tick, kept_back.look)
    if len(trace) > 1:
        kept_back.score(len(trace) - 1, numbers)  # where it ended by itself
    inflation, best = kept_back.widened()
    unit = float(np.log(data.scale.std[: data.dim_x]).sum())
    joint = kept_back.scores[0]
    error = kept_back.standard_error(inflation)
    training = FilterTraining(
        kept="filter" if kept_back.best_trained and best - joint > error else "joint",
        score_joint=joint - unit,
        score_filter=best - unit,
        standard_error=error,
        n_iterations=kept_back.best_trained,
        inflation=inflation,
        n_kept_back=n_kept,
    )
    if training.kept == "joint":
        return training
    objective = FilterObjective(start.estimate, start.law, start.system.chain, stretches(data, start.system))
    numbers, trace = _ascend(objective, training.n_iterations, tick)
    if not objective.mean_score(numbers, inflation) > objective.mean_score(objective.start):
        return replace(training, kept="joint")
    return Trained(replace(training, trace=tuple(trace)), *objective.at(numbers, inflation))


class _KeptBack:
    """The scores of a search on the states that it does not see."""

    def __init__(self, objective: FilterObjective, data: list[Stretch], n_kept: int) -> None:
        self._objective, self._data = objective, data
        measured = np.concatenate([np.isfinite(one.x).all(axis=1) for one in data])
        self._rows = np.flatnonzero(measured)[-n_kept:]
        self.scores: dict[int, float] = {}
        self._numbers: dict[int, FloatArray] = {}
        self.score(0, objective.start)

    @property
    def best(self) -> int:
        """The iteration of the best score, of equal ones the first; 0 is the joint fit."""
        return max(self.scores, key=lambda k: (self.scores[k], -k))

    @property
    def best_trained(self) -> int:
        """Likewise, of the iterations after the joint fit; 0 if there are none."""
        return max(self.scores, key=lambda k: (k > 0, self.scores[k], -k))

    def score(self, iteration: int, numbers: FloatArray) -> None:
        """Score the filter, once for each iteration."""
        if iteration not in self.scores:
            self.scores[iteration], self._numbers[iteration] = self._score(numbers), numbers.copy()

    def look(self, iteration: int, numbers: FloatArray) -> bool:
        """Score the filter now and then; tell whether to go on."""
        if iteration % LOOK == 0:
            self.score(iteration, numbers)
        return iteration - self.best < PATIENCE

    def widened(self) -> tuple[float, float]:
        """Return by how much to widen the noise of the state after training, and the score of that."""
        numbers = self._numbers[self.best_trained]
        scores = {factor: self._score(numbers, factor) for factor in INFLATIONS}
        factor = max(scores, key=lambda one: scores[one])
        return factor, scores[factor]

    def standard_error(self, inflation: float) -> float:
        """Return that of the difference of the scores after training and before, from means of batches.

        States that follow one another are scored alike, so single ones would make it too small.
        """
        trained, joint = (
            self._densities(self._numbers[self.best_trained], inflation),
            self._densities(self._numbers[0]),
        )
        means = [batch.mean() for batch in np.array_split(trained - joint, BATCHES)]
        error = float(np.std(means, ddof=1) / np.sqrt(BATCHES))
        return error if np.isfinite(error) else 0.0

    def _score(self, numbers: FloatArray, inflation: float = 1.0) -> float:
        score = float(self._densities(numbers, inflation).mean())
        return score if np.isfinite(score) else -np.inf

    def _densities(self, numbers: FloatArray, inflation: float = 1.0) -> FloatArray:
        try:
            density = np.concatenate(self._objective.scores(numbers, self._data, inflation))
        except (FuzzykfError, np.linalg.LinAlgError):
            return np.full(len(self._rows), -np.inf)
        return density[self._rows]


def _ascend(
    objective: FilterObjective,
    most: int,
    tick: Callable[[], None] | None,
    look: Callable[[int, FloatArray], bool] | None = None,
) -> tuple[FloatArray, list[float]]:
    """Make so many iterations of L-BFGS, or as many as there are; return the numbers, and the objective."""
    from scipy.optimize import minimize

    def judged(numbers: FloatArray) -> tuple[float, FloatArray]:
        try:
            value, slope = objective.value(numbers)
        except (FuzzykfError, np.linalg.LinAlgError):
            return np.nan, numbers
        return (value if np.isfinite(slope).all() else np.nan), slope

    trace = [judged(objective.start)[0]]

    def loss(numbers: FloatArray) -> tuple[float, FloatArray]:
        value, slope = judged(numbers)
        if not np.isfinite(value):
            return abs(trace[0]) + BEYOND, np.zeros_like(numbers)  # a step too far is taken back
        return -value, -slope

    def after(intermediate_result: Any) -> None:
        trace.append(-float(intermediate_result.fun))
        if tick is not None:
            tick()
        if look is not None and not look(len(trace) - 1, intermediate_result.x):
            raise StopIteration

    if not most or not np.isfinite(trace[0]):
        return objective.start, trace
    found = minimize(
        loss, objective.start, method="L-BFGS-B", jac=True, callback=after, options={"maxiter": most}
    )
    return found.x, trace


def _checked(rows: TrainingData) -> TrainingData:
    """Return rows, unless a component hardly varies in them."""
    spread = np.concatenate(
        [rows.z[rows.known, : rows.dim_x].std(axis=0), rows.z[:, rows.dim_x :].std(axis=0)]
    )
    if not (spread > LEAST_SPREAD).all():
        raise ParameterError(f"{component(int(np.argmin(spread)), rows.dim_x)}: is constant")
    return rows


def _until(data: TrainingData, end: int) -> TrainingData:
    """Return the rows before one."""
    inside = data.after < end
    return replace(
        data,
        z=data.z[:end],
        before=data.before[inside],
        after=data.after[inside],
        starts=data.starts[data.starts < end],
        r=None if data.r is None else data.r[:end],
        kept=data.kept[:end],
        known=data.known[:end],
        has_state=data.has_state[inside],
        further=None if data.further is None else data.further.rows(inside),
    )

"""Run the methods on a task, score them, and say who won and whether that means anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import LearningPart
from fuzzykf.comparison.methods import main_methods, restore
from fuzzykf.comparison.scores import INTERVAL_FACTOR, LIMITS, Score, bootstrap_rmse, difference_in_words
from fuzzykf.errors import FuzzykfError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.comparison.candidates import Candidate
    from fuzzykf.comparison.methods import Restoration
    from fuzzykf.comparison.prepare import Task

__all__ = ["Comparison", "compare", "score"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """The scores of all methods on one task, and how far the best two are apart.

    Attributes
    ----------
    task : Task
    restorations : tuple of Restoration
        What each method said.
    scores : tuple of Score
        In the same order.
    baseline_rmse : float
        Error of somebody who always answers the mean of the learning part.
    best, second : str
        The methods of the least, and the next to least, RMSE.
    difference, difference_low, difference_high : float
        RMSE of ``second`` less that of ``best``, and its interval of 95 % by the paired
        block bootstrap.
    block_length : int
        Steps in a block of the bootstrap.
    """

    task: Task
    restorations: tuple[Restoration, ...]
    scores: tuple[Score, ...]
    baseline_rmse: float
    best: str
    second: str
    difference: float
    difference_low: float
    difference_high: float
    block_length: int

    @property
    def is_certain(self) -> bool:
        """Whether the difference between the best two exceeds its uncertainty."""
        return self.difference_low > 0.0

    def verdict(self, unit: str = "") -> str:
        """Say in one sentence which method won and whether the difference means anything.

        Parameters
        ----------
        unit : str
            Unit of the state.
        """
        rmse = next(score.rmse for score in self.scores if score.name == self.best)
        limits = self.difference_low, self.difference_high
        return difference_in_words(self.best, rmse, self.second, self.difference, limits, unit) + "."


def compare(
    task: Task,
    rng: np.random.Generator,
    *,
    methods: Sequence[Candidate] | None = None,
    n_nodes: int = 5,
    n_resamples: int = 2000,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Restore the second part of a task by several methods and score them.

    The methods are `OFSRFilter` on fuzzy switches, `CGOMSMFilter` on two hard regimes,
    `IMMEstimator` on one linear model per regime, filterpy's KalmanFilter on the best single
    linear model, and regressions: on the observation, and on earlier ones as well, straight
    and piecewise-linear.

    Parameters
    ----------
    task : Task
    rng : numpy.random.Generator
        For the bootstrap.
    methods : sequence of Candidate
        By default those of `main_methods`.
    n_nodes : int
        Nodes of the fuzzy switch between 0 and 1; time grows as ``(n_nodes + 2) ** 2``.
    n_resamples : int
        Resamples of the bootstrap.
    progress : callable
        Is told the name of each piece of work before it begins: all pieces of all methods,
        and the bootstrap.

    Returns
    -------
    Comparison

    Raises
    ------
    MissingDependencyError
        If filterpy is not installed.
    FuzzykfError
        If a method cannot be learned, or finds numbers that are not finite.

    Notes
    -----
    The log-likelihoods are those of the same observations, in the same unit, given the
    earlier ones, so they may be compared; regressions have none.
    """
    n = task.n_train
    x, y = task.state[:, None], task.observation[:, None]
    r = None if task.switch is None else task.switch[:n]
    part = LearningPart(x=x[:n], y=y[:n], r=r, n_nodes=n_nodes, progress=progress)
    restorations = []
    for method in main_methods() if methods is None else methods:
        progress(method.name)
        try:
            learned = method.learn(part)
        except FuzzykfError as error:
            raise FuzzykfError(f"{method.name}: {error}") from error
        restorations.append(restore(method.name, learned, y[:n], y[n:]))
        _check_finite(restorations[-1])
    progress("bootstrap")
    return score(task, tuple(restorations), rng, n_resamples=n_resamples)


def _check_finite(restoration: Restoration) -> None:
    for quantity in ("mean", "std", "log_likelihood"):
        values = getattr(restoration, quantity)
        if values is not None and not np.isfinite(values).all():
            step = int(np.flatnonzero(~np.isfinite(values))[0])
            raise FuzzykfError(f"{restoration.name}: its {quantity} at step {step} is {values[step]}")


def score(
    task: Task, restorations: tuple[Restoration, ...], rng: np.random.Generator, *, n_resamples: int = 2000
) -> Comparison:
    """Score what methods said of the part to be restored.

    Parameters
    ----------
    task : Task
    restorations : tuple of Restoration
        Two at least.
    rng : numpy.random.Generator
        For the bootstrap.
    n_resamples : int
        Resamples of the bootstrap.

    Returns
    -------
    Comparison

    Raises
    ------
    ParameterError
        If ``n_resamples`` is less than 100: quantiles of 2.5 % would mean nothing.
    """
    truth = task.state[task.n_train :]
    errors = np.column_stack([r.mean - truth for r in restorations])
    found = bootstrap_rmse(errors**2, n_resamples, rng)
    low, high = np.quantile(found.resampled, LIMITS, axis=0)
    scores = tuple(
        Score(
            name=r.name,
            rmse=float(found.rmse[k]),
            rmse_low=float(low[k]),
            rmse_high=float(high[k]),
            coverage=float((np.abs(errors[:, k]) <= INTERVAL_FACTOR * r.std).mean()),
            log_likelihood=None if r.log_likelihood is None else float(r.log_likelihood.mean()),
            microseconds=r.microseconds,
        )
        for k, r in enumerate(restorations)
    )
    best, second = (int(k) for k in np.argsort(found.rmse, kind="stable")[:2])
    difference_low, difference_high = found.difference(second, best)
    baseline = task.state[: task.n_train].mean()
    return Comparison(
        task=task,
        restorations=restorations,
        scores=scores,
        baseline_rmse=float(np.sqrt(((truth - baseline) ** 2).mean())),
        best=restorations[best].name,
        second=restorations[second].name,
        difference=float(found.rmse[second] - found.rmse[best]),
        difference_low=difference_low,
        difference_high=difference_high,
        block_length=found.block_length,
    )

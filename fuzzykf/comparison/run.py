"""All of `compare`: candidates on the rows of a task that are held out, fold by fold, and who won."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import LearningPart, Restoration
from fuzzykf.comparison.candidates.boosting import check_installed
from fuzzykf.comparison.candidates.linear import learn_kalman
from fuzzykf.comparison.candidates.registry import candidate, chosen
from fuzzykf.comparison.candidates.switching import LAWS
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.comparison.evaluation import Fold, HeldOut, ModelComparison, checked, microseconds, summarise
from fuzzykf.comparison.folds import Round, cut_folds, go_through
from fuzzykf.comparison.prepare import MIN_TEST
from fuzzykf.comparison.verdict import about_baseline, about_error, about_feedback, about_log_score
from fuzzykf.errors import FuzzykfError, MissingDependencyError, ParameterError
from fuzzykf.gaussian import as_count, brief, check_generator

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Candidate
    from fuzzykf.comparison.prepare import Task

__all__ = ["RIVALS", "Comparison", "Restoration", "compare", "main_methods", "score", "worthwhile_jobs"]

#: Rows with a hidden switch from which it pays to share the folds between processes, of which each takes
#: about two seconds to start.
MANY_ROWS = 2000

#: What `compare` sets beside the filter on a fuzzy switch, in the order of its table.
RIVALS = (
    # switching models that are learned jointly with their switch
    "hard2",
    "hard2-memoryless",
    # likewise, and then for what the filter says
    "hard2-filter",
    # and with the clock and features of the window
    "pool-inputs",
    # filters with feedback
    "imm",
    "kalman",
    # no model of the dynamics
    "line",
    "regression",
    "piecewise",
    "boosting",
    # no observation either; it needs times
    "daily-profile",
)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(ModelComparison):
    """The scores of all methods on one task, and how far the best two are apart.

    All of a `ModelComparison`, and:

    Attributes
    ----------
    task : Task
    restorations : tuple of Restoration
        What each method said, of all folds one after the other.
    truth : ndarray, shape (n_test,)
        The states that were held out; less their profile, if there is one, that of each fold.
    """

    task: Task
    restorations: tuple[Restoration, ...]
    truth: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def second(self) -> str:
        """The method of the next to least RMSE."""
        return self.ranked[1].name

    @property
    def difference(self) -> float:
        """RMSE of ``second`` less that of ``best``."""
        return self.ranked[1].difference

    @property
    def difference_low(self) -> float:
        """Lower end of its interval of 95 % by the paired block bootstrap."""
        return self.ranked[1].difference_low

    @property
    def difference_high(self) -> float:
        """Upper end of this interval."""
        return self.ranked[1].difference_high

    def verdict(self, unit: str = "") -> str:
        """Say what wins on error and what on log score, and whether the differences are significant.

        Parameters
        ----------
        unit : str
            Unit of the state.
        """
        given: object = unit
        if not isinstance(given, str):
            raise ParameterError(f"unit: got {brief(given)}, expected a text")
        sentences = (
            about_error(self.ranked, "title", unit),
            about_feedback(self.ranked, self.learned[-1], "title"),
            about_log_score(self.scores, "title"),
            about_baseline(self.baseline_rmse, unit),
        )
        return " ".join(filter(None, sentences))

    def against(self, rival: str, unit: str = "") -> str:
        """Say how far a method is behind the winners, on error and on log score, and how sure that is.

        Parameters
        ----------
        rival : str
            Name of the candidate.
        unit : str
            Unit of the state.

        Raises
        ------
        ParameterError
            If no candidate of this name was compared.
        """
        return self._against(rival, unit, "title")


def main_methods(law: str = "auto", *, times: bool = True) -> tuple[Candidate, ...]:
    """Return the candidates that `compare` sets side by side, in the order of its table.

    Parameters
    ----------
    law : {"auto", "fmc1", "fmc2", "free"}
        Family of the law of the fuzzy switch; "auto" is the one whose filter gives the state the best
        log score on rolling blocks of the learning part, which takes some times as long.
    times : bool
        Whether the times of the rows are known; without them the mean of the time of day is left out.

    Raises
    ------
    ParameterError
        If ``law`` is none of these.
    MissingDependencyError
        If filterpy or scikit-learn is not installed.
    """
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError as error:
        raise MissingDependencyError(
            "the comparison needs filterpy: pip install 'fuzzykf[compare]'"
        ) from error
    if law not in ("auto", *LAWS):
        raise ParameterError(f"law: got {law!r}, expected 'auto', {', '.join(map(repr, LAWS))}")
    fuzzy = candidate("fuzzy")
    if law != "auto":
        fuzzy = replace(candidate(law), title=fuzzy.title)
    check_installed()
    rivals = {name: candidate(name) for name in RIVALS if times or name != "daily-profile"}
    learn = partial(learn_kalman, kalman_filter=KalmanFilter)  # whose time of a step is of interest
    rivals["kalman"] = replace(rivals["kalman"], learn=learn, title="KalmanFilter (filterpy)")
    return (fuzzy, *rivals.values())


def compare(
    task: Task,
    rng: np.random.Generator,
    *,
    methods: Sequence[str | Candidate] | None = None,
    n_folds: int = 5,
    n_nodes: int = 5,
    n_resamples: int = 2000,
    n_jobs: int = 1,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Restore the held-out rows of a task by several methods, fold by fold, and score them.

    The rows after the first ``n_train`` are cut into folds.  Before each of them all methods learn anew,
    on all rows before it; then they restore its states from its observations.  All errors together make
    the scores.

    The methods are `OFSRFilter` on fuzzy switches, `CGOMSMFilter` on two hard regimes, with and without
    memory of the state, `IMMEstimator` on one linear model per regime, filterpy's KalmanFilter on the
    best single linear model, regressions on the observation and on earlier ones, straight and
    piecewise-linear, gradient boosting, and the mean of the time of day.

    Parameters
    ----------
    task : Task
    rng : numpy.random.Generator
        For the bootstrap.
    methods : sequence of str or Candidate
        By default those of `main_methods`; see `candidate_names`.
    n_folds : int
        Folds of equal size; 1 learns once, on the first part alone.
    n_nodes : int
        Nodes of the fuzzy switch between 0 and 1; time grows with the steps between them.
    n_resamples : int
        Resamples of the bootstrap.
    n_jobs : int
        Processes between which the folds are shared; results do not depend on it.  With more than one, a
        script keeps its work below ``if __name__ == "__main__"``, as always with `multiprocessing`.
    progress : callable
        Is told the name of each piece of work before it begins: all pieces of all methods in all
        folds, and the bootstrap.

    Returns
    -------
    Comparison
        A method that fails in some fold is not in it, but in its ``failures``.

    Raises
    ------
    ParameterError
        If there are more folds than rows to hold out, or fewer than 50 states of them are known.
    MissingDependencyError
        If filterpy, or a package that a method needs, is not installed.
    FuzzykfError
        If fewer than two methods can be learned.

    Notes
    -----
    The log-likelihoods are those of the same observations, in the same unit, given the
    earlier ones, so they may be compared; regressions have none.
    """
    check_generator(rng)
    as_count("n_resamples", n_resamples, 100)
    chosen_methods = chosen(main_methods(times=task.clock is not None) if methods is None else methods)
    folds = cut_folds(len(task.state), task.n_train, n_folds)
    rounds = [_round(task, number, fold, n_folds, n_nodes) for number, fold in enumerate(folds, 1)]
    known = sum(int(np.isfinite(one.truth).sum()) for one in rounds)
    if known < MIN_TEST:
        raise ParameterError(f"state: {known} held-out states are known, expected at least {MIN_TEST}")
    parts = go_through(rounds, chosen_methods, progress, n_jobs=n_jobs, titles=True)
    progress("bootstrap")
    failed = {name for part in parts for name in part.failures}
    for method in chosen_methods:
        if method.name not in failed:  # here, where nothing else is at work beside it
            _time_step(parts[-1], rounds[-1], method.name)
    found = summarise(chosen_methods, folds, parts, np.ones(1), n_resamples, rng)
    if len(found.scores) < 2:
        told = "; ".join(f"{name}, {why}" for name, why in found.failures.items())
        raise FuzzykfError(f"there is nothing to compare {found.best} with" + (f": {told}" if told else ""))
    return Comparison(
        **vars(found),
        task=task,
        restorations=tuple(_joined(parts, one.name) for one in chosen_methods if one.name not in failed),
        truth=np.concatenate([part.truth[:, 0] for part in parts]),
    )


def worthwhile_jobs(task: Task, n_folds: int) -> int:
    """Return between how many processes it pays to share the folds: no more than there are processors.

    Parameters
    ----------
    task : Task
    n_folds : int
    """
    if task.switch is not None or len(task.state) < MANY_ROWS:
        return 1
    has_affinity = hasattr(os, "sched_getaffinity")  # the processors that this process may use
    return min(n_folds, len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1)


def _round(task: Task, number: int, fold: Fold, n_folds: int, n_nodes: int) -> Round:
    """Return what is learned on, and what is held out, in a fold."""
    learned, held_out = slice(fold.split), slice(fold.split, fold.end)
    x, y = task.target(fold.split, fold.end)[:, None], task.observation[:, None]
    return Round(
        name=f"fold {number} of {n_folds}" if n_folds > 1 else "",
        part=LearningPart(
            x=x[learned],
            y=y[learned],
            r=None if task.switch is None else task.switch[learned],
            clock=None if task.clock is None else task.clock[learned],
            n_nodes=n_nodes,
        ),
        truth=x[held_out],
        zs=y[held_out],
        clock=None if task.clock is None else task.clock[held_out],
    )


def _time_step(part: HeldOut, of: Round, name: str) -> None:
    found = part.found[name]
    if found.learned is not None:
        step = found.learned.at(of.clock).told(of.inputs).stepper()
        part.found[name] = replace(found, microseconds=microseconds(step, of.zs))


def _joined(parts: Sequence[HeldOut], name: str) -> Restoration:
    """Return what a method said of all folds, as of one stretch."""
    found = [part.found[name] for part in parts]
    likelihoods = [one.log_likelihood for one in found if one.log_likelihood is not None]
    densities = [one.density for one in found if one.density is not None]
    switches = [one.switch for one in found if one.switch is not None]
    return replace(
        found[-1],
        mean=np.concatenate([one.mean[:, 0] for one in found]),
        std=np.concatenate([one.std[:, 0] for one in found]),
        density=NormalMixture.joined(densities) if len(densities) == len(found) else None,
        log_likelihood=np.concatenate(likelihoods) if len(likelihoods) == len(found) else None,
        switch=np.concatenate(switches) if len(switches) == len(found) else None,
        choices=tuple(choice for one in found for choice in one.choices),
        seconds=sum(one.seconds for one in found),
    )


def score(
    task: Task, restorations: tuple[Restoration, ...], rng: np.random.Generator, *, n_resamples: int = 2000
) -> Comparison:
    """Score what methods said of the part to be restored, learned on the first part alone.

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
        If there is one restoration alone, or two have one name, or one is incomplete or of another length,
        or a standard deviation is NaN, infinite or below 0, or ``n_resamples`` is less than 100:
        quantiles of 2.5 % would mean nothing.
    """
    check_generator(rng)
    names = [one.name for one in restorations]
    if len(names) < 2 or len(set(names)) < len(names):
        raise ParameterError(f"restorations: got {names}, expected two at least and each name once")
    for one in restorations:
        try:
            checked(one, task.n_test, 1)
        except FuzzykfError as error:
            raise ParameterError(f"restorations: got {one.name}, {error}") from error
        wrong = one.std[~(np.isfinite(one.std) & (one.std >= 0.0))]
        if wrong.size:
            raise ParameterError(
                f"restorations: got a std of {wrong[0]:g} from {one.name}, expected finite numbers "
                "of at least 0"
            )
    n = task.n_train
    part = HeldOut(
        truth=task.state[n:, None],
        zs=task.observation[n:, None],
        centre=np.nanmean(task.state[:n], keepdims=True),
        found={one.name: one for one in restorations},
    )
    fold = Fold(begin=0, split=n, end=len(task.state))
    found = summarise(restorations, (fold,), [part], np.ones(1), n_resamples, rng)
    return Comparison(**vars(found), task=task, restorations=restorations, truth=task.state[n:])

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
from fuzzykf.comparison.prepare import check_known
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
    """Scores of all methods on one task.

    A `ModelComparison`, with further attributes:

    Attributes
    ----------
    task : Task
        The task.
    restorations : tuple of Restoration
        Estimates of each method, for all folds one after the other.
    truth : ndarray, shape (n_test,)
        States of the test rows, minus the profile of each fold if there is one.
    """

    task: Task
    restorations: tuple[Restoration, ...]
    truth: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def second(self) -> str:
        """Name of the method with the second lowest RMSE."""
        return self.ranked[1].name

    @property
    def difference(self) -> float:
        """RMSE of ``second`` minus that of ``best``."""
        return self.ranked[1].difference

    @property
    def difference_low(self) -> float:
        """Lower bound of the 95 % interval of ``difference``, by the paired block bootstrap."""
        return self.ranked[1].difference_low

    @property
    def difference_high(self) -> float:
        """Upper bound of the 95 % interval of ``difference``."""
        return self.ranked[1].difference_high

    def verdict(self, unit: str = "") -> str:
        """Describe the winners on RMSE and on log score, and whether their leads are significant.

        Parameters
        ----------
        unit : str
            Unit of the state.

        Returns
        -------
        str
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
        """Describe how far a method is behind the winners, on RMSE and on log score, with intervals.

        Parameters
        ----------
        rival : str
            Name of the candidate.
        unit : str
            Unit of the state.

        Returns
        -------
        str

        Raises
        ------
        ParameterError
            If no candidate of this name was compared.
        """
        return self._against(rival, unit, "title")


def main_methods(law: str = "auto", *, times: bool = True) -> tuple[Candidate, ...]:
    """Return the default methods of `compare`, in the order of its table.

    Parameters
    ----------
    law : {"auto", "fmc1", "fmc2", "free"}
        Law of the fuzzy switch; "auto" chooses the one with the best log score on rolling blocks of the
        training rows, which takes several times as long.
    times : bool
        Whether the times of the rows are known; if not, the mean by time of day is omitted.

    Returns
    -------
    tuple of Candidate

    Raises
    ------
    ParameterError
        If ``law`` is unknown.
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
    """Estimate the states of the test rows by several methods, fold by fold, and score them.

    The rows after the first ``n_train`` are split into folds.  Before each fold, all methods are trained on
    all earlier rows; then they estimate its states from its observations.  The errors of all folds together
    make the scores.

    The default methods are `OFSRFilter` with a fuzzy switch, `CGOMSMFilter` with two hard regimes, both with
    and without state feedback, `IMMEstimator` with one linear model per regime, filterpy's KalmanFilter,
    linear and piecewise-linear regressions with lags, gradient boosting, and the mean by time of day.

    Parameters
    ----------
    task : Task
    rng : numpy.random.Generator
        For the bootstrap.
    methods : sequence of str or Candidate
        By default those of `main_methods`; see `candidate_names`.
    n_folds : int
        Number of folds of equal size; with 1, methods are trained once.
    n_nodes : int
        Number of nodes of the fuzzy switch between 0 and 1.
    n_resamples : int
        Resamples of the bootstrap.
    n_jobs : int
        Number of processes for the folds; results do not depend on it.  With more than one, protect scripts
        by ``if __name__ == "__main__"``, as usual with ``multiprocessing``.
    progress : callable
        Called with the name of each piece of work before it starts.

    Returns
    -------
    Comparison
        Methods that fail in some fold are in its ``failures``.

    Raises
    ------
    ParameterError
        If there are more folds than test rows, or fewer than 50 known states in them.
    MissingDependencyError
        If filterpy, or a package that a method needs, is not installed.
    FuzzykfError
        If fewer than two methods can be trained.

    See Also
    --------
    compare_models : The same for arrays; with an example.

    Notes
    -----
    Log-likelihoods of all methods are of the same observations, so they can be compared; regressions define
    none.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import compare, prepare
    >>> rng = np.random.default_rng(0)
    >>> y = rng.normal(size=400)
    >>> task = prepare(np.abs(y) + 0.1 * rng.normal(size=400), y)
    >>> compare(task, rng, methods=["regression", "piecewise"], n_folds=1).best
    'piecewise'
    """
    check_generator(rng)
    as_count("n_resamples", n_resamples, 100)
    chosen_methods = chosen(main_methods(times=task.clock is not None) if methods is None else methods)
    folds = cut_folds(len(task.state), task.n_train, n_folds)
    rounds = [_round(task, number, fold, n_folds, n_nodes) for number, fold in enumerate(folds, 1)]
    known = sum(int(np.isfinite(one.truth).sum()) for one in rounds)
    check_known("state", known, task.state, task.n_train)
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
    """Return a useful number of processes for the folds, at most the number of processors.

    Parameters
    ----------
    task : Task
    n_folds : int
        Number of folds.

    Returns
    -------
    int

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import prepare, worthwhile_jobs
    >>> y = np.random.default_rng(0).normal(size=400)
    >>> worthwhile_jobs(prepare(np.abs(y), y), n_folds=5)
    1
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
    """Score estimates of the test rows by methods that were trained on the training rows only.

    Parameters
    ----------
    task : Task
    restorations : tuple of Restoration
        Estimates of at least two methods.
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
        If there are fewer than two restorations, names repeat, or one is incomplete or has the wrong length;
        if a standard deviation is negative or not finite; if ``n_resamples`` is less than 100, too few for
        2.5 % quantiles.

    See Also
    --------
    compare : Train methods and score them.
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

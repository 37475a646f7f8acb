"""All of `compare`: candidates on one held-out part, and who won."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import LearningPart, Restoration
from fuzzykf.comparison.candidates.linear import learn_kalman
from fuzzykf.comparison.candidates.registry import candidate, chosen
from fuzzykf.comparison.candidates.switching import LAWS
from fuzzykf.comparison.evaluation import Fold, HeldOut, ModelComparison, restore, summarise
from fuzzykf.errors import FuzzykfError, MissingDependencyError, ParameterError
from fuzzykf.gaussian import check_generator

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.comparison.candidates import Candidate
    from fuzzykf.comparison.prepare import Task

__all__ = ["RIVALS", "Comparison", "Restoration", "compare", "main_methods", "score"]

#: What `compare` sets beside the filter on a fuzzy switch, in the order of its table.
RIVALS = ("hard2", "imm", "kalman", "line", "regression", "piecewise")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(ModelComparison):
    """The scores of all methods on one task, and how far the best two are apart.

    All of a `ModelComparison` of one fold, and:

    Attributes
    ----------
    task : Task
    restorations : tuple of Restoration
        What each method said.
    """

    task: Task
    restorations: tuple[Restoration, ...]

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
        """Say in one sentence which method won and whether the difference means anything.

        Parameters
        ----------
        unit : str
            Unit of the state.
        """
        return self._lead("title", unit) + "."


def main_methods(law: str = "auto") -> tuple[Candidate, ...]:
    """Return the candidates that `compare` sets side by side, in the order of its table.

    Parameters
    ----------
    law : {"auto", "fmc1", "fmc2", "free"}
        Family of the law of the fuzzy switch; "auto" is the one that filters best on
        the last quarter of the learning part, which takes four times as long.

    Raises
    ------
    ParameterError
        If ``law`` is none of these.
    MissingDependencyError
        If filterpy is not installed.
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
    rivals = {name: candidate(name) for name in RIVALS}
    learn = partial(learn_kalman, kalman_filter=KalmanFilter)  # whose time of a step is of interest
    rivals["kalman"] = replace(rivals["kalman"], learn=learn, title="KalmanFilter (filterpy)")
    return (fuzzy, *rivals.values())


def compare(
    task: Task,
    rng: np.random.Generator,
    *,
    methods: Sequence[str | Candidate] | None = None,
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
    methods : sequence of str or Candidate
        By default those of `main_methods`; see `candidate_names`.
    n_nodes : int
        Nodes of the fuzzy switch between 0 and 1; time grows with the steps between them.
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
        If filterpy, or a package that a method needs, is not installed.
    FuzzykfError
        If a method cannot be learned, or finds numbers that are not finite.

    Notes
    -----
    The log-likelihoods are those of the same observations, in the same unit, given the
    earlier ones, so they may be compared; regressions have none.
    """
    check_generator(rng)
    n = task.n_train
    x, y = task.state[:, None], task.observation[:, None]
    r = None if task.switch is None else task.switch[:n]
    part = LearningPart(x=x[:n], y=y[:n], r=r, n_nodes=n_nodes, progress=progress)
    restorations = []
    for method in chosen(main_methods() if methods is None else methods):
        progress(method.title)
        try:
            found = restore(method, part, y[n:], step="step", timed=True)
        except MissingDependencyError:
            raise  # says nothing of the data, and what to do
        except FuzzykfError as error:
            raise FuzzykfError(f"{method.title}: {error}") from error
        restorations.append(replace(found, mean=found.mean[:, 0], std=found.std[:, 0]))
    progress("bootstrap")
    return score(task, tuple(restorations), rng, n_resamples=n_resamples)


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
        If there is one restoration alone, or two have one name, or a standard deviation is
        NaN, infinite or below 0, or ``n_resamples`` is less than 100: quantiles of 2.5 % would
        mean nothing.
    """
    check_generator(rng)
    names = [one.name for one in restorations]
    if len(names) < 2 or len(set(names)) < len(names):
        raise ParameterError(f"restorations: got {names}, expected two at least and each name once")
    for one in restorations:
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
        centre=task.state[:n].mean(keepdims=True),
        found={one.name: one for one in restorations},
    )
    fold = Fold(begin=0, split=n, end=len(task.state))
    found = summarise(restorations, (fold,), [part], np.ones(1), n_resamples, rng)
    return Comparison(**vars(found), task=task, restorations=restorations)

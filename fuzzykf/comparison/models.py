"""Which model?  Candidates judged by the error of their filters on data that they have not seen.

A larger likelihood need not mean a better filter: in the exact switching models observations
never correct the state, so errors of the state equation go on unseen.  So `compare_models`
judges by what a filter is for, beside simple rivals, with the uncertainty that dependent
errors leave.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.comparison.candidates import LearningPart
from fuzzykf.comparison.candidates.registry import chosen
from fuzzykf.comparison.clock import Clock
from fuzzykf.comparison.evaluation import Fold, summarise
from fuzzykf.comparison.folds import Round, cut_folds, go_through
from fuzzykf.comparison.prepare import MIN_TEST, MIN_TRAIN, check_known
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_choice, as_count, as_flag, as_real, check_generator
from fuzzykf.observations import check_aligned
from fuzzykf.preprocessing import DailyProfile, as_columns, as_days, as_times, mean_and_scale
from fuzzykf.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Candidate
    from fuzzykf.comparison.evaluation import ModelComparison
    from fuzzykf.times import Times

__all__ = ["CANDIDATES", "compare_models"]

#: The candidates of `compare_models`, unless others are named.
CANDIDATES = ("hard1", "hard2", "hard3", "fmc1", "fmc2", "free", "imm", "kalman", "regression", "piecewise")

#: Those that join them where there are inputs.
WITH_INPUTS = ("pool-inputs",)


def compare_models(
    x: ArrayLike,
    y: ArrayLike,
    rng: np.random.Generator,
    *,
    candidates: Sequence[str | Candidate] = CANDIDATES,
    n_folds: int = 5,
    first: float = 0.5,
    window: Literal["expanding", "sliding"] = "expanding",
    profile: bool = False,
    time: Any = None,
    workday: ArrayLike | None = None,
    inputs: ArrayLike | None = None,
    n_nodes: int = 5,
    max_iter: int = 200,
    tolerance: float = 1e-5,
    n_resamples: int = 2000,
    n_jobs: int = 1,
    progress: bool | None = None,
) -> ModelComparison:
    """Compare models of a state by the error of their filters on later, held-out data.

    The rows after the first part are split into ``n_folds`` folds.  Before each fold, all candidates are
    trained on the earlier rows only; then they estimate its states from its observations and a few
    earlier ones.  The errors of all folds together make the score.

    Parameters
    ----------
    x, y : array_like, shapes (n, m) and (n, q), or (n,)
        States and observations, in time order; NaN where missing.  Rows without x are not used in training
        and scores; rows without y are gaps.
    rng : numpy.random.Generator
        For the bootstrap.
    candidates : sequence of str or Candidate
        Names such as "kalman", "hard2" or "fmc1" (see `fuzzykf.comparison.candidate_names`), or your own
        `fuzzykf.comparison.Candidate`.  With ``inputs``, the default includes "pool-inputs".
    n_folds : int
        Number of held-out folds.
    first : float
        Share of the rows used for training before the first fold.
    window : {"expanding", "sliding"}
        Train on all earlier rows, or on the latest ones, as many as for the first fold: better
        if the system changes.
    profile : bool
        Subtract the daily profile from x, learned again in each fold (see `DailyProfile`).
    time, workday : array_like, shape (n,), optional
        For the profile, and for candidates that use the time of day ("boosting", "daily-profile").  For the
        profile, the default is the index of x, and Mondays to Fridays.  Times are read as in
        `DailyProfile.fit` and must increase.
    inputs : array_like, shape (n, k) or (n,), optional
        Known variables besides the clock: calendar, controls, external forecasts.  Used by "hard2-inputs",
        "pool-inputs" and "pool-boosting", regressions and boosting; ignored by other candidates.
    n_nodes, max_iter, tolerance
        As in `CGOFMSModel.fit`.
    n_resamples : int
        Number of bootstrap resamples.
    n_jobs : int
        Number of processes for the folds; results do not depend on it.  With more than one, protect scripts
        by ``if __name__ == "__main__"``, as usual with ``multiprocessing``.
    progress : bool, optional
        Whether to show a progress bar (needs rich).  By default one appears after two seconds if
        standard error is a terminal, or in a notebook.

    Returns
    -------
    ModelComparison
        With ``verdict()``, ``to_dataframe()``, ``best`` and ``failures``.

    Raises
    ------
    ShapeError, ParameterError
        If shapes do not agree, a name is unknown, there are too few rows, or one of several columns
        of x is constant in the training rows of the first fold.
    FuzzykfError
        If no candidate could be learned.
    MissingDependencyError
        If a candidate needs a package that is not installed.

    Notes
    -----
    Intervals come from a circular block bootstrap of the squared errors, with the same blocks for
    all candidates.  They describe the variation over similar data, not over conditions that no fold
    contains.  The best of
    many candidates looks slightly better than it is: test the winner on data that were not part of the
    comparison.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import compare_models
    >>> rng = np.random.default_rng(0)
    >>> y = rng.normal(size=600)
    >>> x = np.abs(y) + 0.1 * rng.normal(size=600)
    >>> found = compare_models(x, y, rng, candidates=["kalman", "regression", "piecewise"])
    >>> found.best, found.is_certain
    ('piecewise', True)
    """
    check_generator(rng)
    check_aligned(x=x, y=y, workday=workday, time=time, inputs=inputs)
    states, observations = as_columns("x", x), as_columns("y", y)
    n = len(states)
    if len(observations) != n:
        raise ShapeError(f"y: got {len(observations)} rows, expected {n}, as many as x has")
    told = None if inputs is None else _inputs(inputs, n)
    if told is not None and candidates is CANDIDATES:
        candidates = (*CANDIDATES, *WITH_INPUTS)
    methods = chosen(candidates)
    folds = _folds(n, n_folds, first, window)
    times = as_times(time, x, n) if profile or time is not None else None
    days = None if workday is None else as_days(workday, n)
    if n_resamples < 100:
        raise ParameterError(f"n_resamples: got {n_resamples}, expected at least 100")
    scale = np.ones(1) if states.shape[1] == 1 else mean_and_scale("x", states[: folds[0].split])[1]

    n_jobs = as_count("n_jobs", n_jobs, 1)
    progress = None if progress is None else as_flag("progress", progress)
    pieces = n_folds * sum(method.pieces for method in methods) + 1
    clock = None if times is None else Clock.of(times, days)
    rounds = []
    for number, fold in enumerate(folds, 1):
        target = states[fold.begin : fold.end]
        if profile and times is not None:
            target = _without_profile(target, times, days, fold)
        split = fold.split - fold.begin
        part = LearningPart(
            x=target[:split],
            y=observations[fold.begin : fold.split],
            clock=None if clock is None else clock[fold.begin : fold.split],
            inputs=None if told is None else told[fold.begin : fold.split],
            n_nodes=n_nodes,
            max_iter=max_iter,
            tolerance=tolerance,
        )
        rounds.append(
            Round(
                name=f"fold {number} of {n_folds}",
                part=part,
                truth=target[split:],
                zs=observations[fold.split : fold.end],
                clock=None if clock is None else clock[fold.split : fold.end],
                inputs=None if told is None else told[fold.split : fold.end],
            )
        )
    with progress_bar(pieces, progress) as tell:
        parts = go_through(rounds, methods, tell, n_jobs=n_jobs)
        tell("bootstrap")
        known = sum(int(part.known.sum()) for part in parts)
        check_known("x", known, states, folds[0].split)
        return summarise(methods, folds, parts, scale, n_resamples, rng, no_law=float("nan"))


# --------------------------------------------------------------------------- arguments


def _inputs(inputs: Any, n: int) -> FloatArray:
    """Return inputs (n, k), which have no gaps."""
    found = as_columns("inputs", inputs)
    if len(found) != n:
        raise ShapeError(f"inputs: got {len(found)} rows, expected {n}, as many as x has")
    if not np.isfinite(found).all():
        row = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
        raise ParameterError(
            f"inputs: got {found[row].tolist()} at {row}, expected finite numbers: inputs are known at all "
            "times"
        )
    return found


def _folds(n: int, n_folds: int, first: float, window: str) -> tuple[Fold, ...]:
    as_count("n_folds", n_folds, 1)
    if not 0.0 < as_real("first", first, "a share between 0 and 1") < 1.0:
        raise ParameterError(f"first: got {first:g}, expected a share between 0 and 1")
    as_choice("window", window, ("expanding", "sliding"))
    start = round(first * n)
    if start < MIN_TRAIN or n - start < max(MIN_TEST, n_folds):
        raise ParameterError(
            f"first: {first:g} of {n} rows are {start} to learn on at first and {n - start} to hold out, "
            f"expected at least {MIN_TRAIN} and {max(MIN_TEST, n_folds)}"
        )
    return cut_folds(n, start, n_folds, window)


def _without_profile(target: FloatArray, time: Times, workday: Any, fold: Fold) -> FloatArray:
    """Take the daily profile of the rows to learn on from all rows of a fold."""
    split = fold.split - fold.begin
    moments = time[fold.begin : fold.end]
    days = None if workday is None else workday[fold.begin : fold.end]
    profile = DailyProfile().fit(target[:split], moments[:split], None if days is None else days[:split])
    result: FloatArray = profile.transform(target, moments, days)
    return result

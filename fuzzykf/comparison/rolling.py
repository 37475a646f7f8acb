"""Candidates on several held-out parts, one after the other: what they learn, and how they do."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.prepare import MIN_TEST
from fuzzykf.comparison.scores import INTERVAL_FACTOR, LIMITS, bootstrap_rmse, difference_in_words
from fuzzykf.errors import FuzzykfError, MissingDependencyError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Candidate, Estimates, Learned, LearningPart

__all__ = ["Fold", "ModelComparison", "ModelScore", "Round", "summarise"]


@dataclass(frozen=True)
class Fold:
    """Rows that one round learns on, and the rows after them that it is judged on.

    Attributes
    ----------
    begin, split, end : int
        Rows ``begin`` to ``split - 1`` are learned on, ``split`` to ``end - 1`` held out.
    """

    begin: int
    split: int
    end: int


@dataclass(frozen=True, kw_only=True)
class ModelScore:
    """How well one candidate restored the held-out states.

    Attributes
    ----------
    name : str
    rmse : float
        Root mean squared error over all folds: in the unit of the state if it has one
        component, else in standard deviations of each (in the first part learned on).
    rmse_low, rmse_high : float
        Its interval of 95 % by the block bootstrap.
    difference : float
        RMSE less that of the best candidate.
    difference_low, difference_high : float
        Its interval of 95 % by the paired block bootstrap.
    coverage : float
        Share of the states inside the candidate's own interval of nominal 90 %.
    log_likelihood : float
        Mean over the steps of the log-density of each held-out observation given the earlier
        ones; NaN for a candidate that has no law of the observation.
    seconds : float
        Time of learning, over all folds.
    """

    name: str
    rmse: float
    rmse_low: float
    rmse_high: float
    difference: float
    difference_low: float
    difference_high: float
    coverage: float
    log_likelihood: float
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelComparison:
    """What `compare_models` found.

    Attributes
    ----------
    scores : tuple of ModelScore
        In the order of the candidates, without those that failed.
    failures : mapping of str to str
        Candidates that could not be learned in some fold, and why.
    folds : tuple of Fold
    fold_rmse : ndarray, shape (folds, candidates)
        The error of each of `scores` in each fold.
    learned : tuple of mapping
        For each fold, what each candidate learned; see `fuzzykf.comparison.Learned`.
    baseline_rmse : float
        Error of somebody who always answers the mean of the part learned on.
    block_length : int
        Steps in a block of the bootstrap.
    """

    scores: tuple[ModelScore, ...]
    failures: Mapping[str, str] = field(default_factory=dict)
    folds: tuple[Fold, ...]
    fold_rmse: FloatArray
    learned: tuple[Mapping[str, Learned], ...]
    baseline_rmse: float
    block_length: int

    @property
    def best(self) -> str:
        """The candidate of least error."""
        return self._ranked()[0].name

    @property
    def is_certain(self) -> bool:
        """Whether the lead of the best candidate exceeds its uncertainty."""
        return len(self.scores) > 1 and self._ranked()[1].difference_low > 0.0

    def verdict(self, unit: str = "") -> str:
        """Say in one sentence what wins, and whether the difference exceeds its uncertainty.

        Parameters
        ----------
        unit : str
            Unit of the state.
        """
        best, *others = self._ranked()
        if not others:
            space = f" {unit}" if unit else ""
            return f"{best.name} is the only candidate, with an RMSE of {best.rmse:.4g}{space}."
        second = others[0]
        limits = second.difference_low, second.difference_high
        told = difference_in_words(best.name, best.rmse, second.name, second.difference, limits, unit)
        with_law = [score for score in self.scores if not np.isnan(score.log_likelihood)]
        if with_law:
            likeliest = max(with_law, key=lambda score: score.log_likelihood).name
            told += f"; the observations are likeliest under {likeliest}"
        return told + "."

    def notes(self) -> dict[str, tuple[str, ...]]:
        """Return what a reader should know before trusting a candidate: notes of its last fold."""
        return {name: learned.notes for name, learned in self.learned[-1].items() if learned.notes}

    def to_dataframe(self, *, by_fold: bool = False) -> pd.DataFrame:
        """Return the scores as a pandas DataFrame, one row per candidate, best first.

        Parameters
        ----------
        by_fold : bool
            Return the RMSE of each candidate (columns) in each fold (rows) instead.

        Raises
        ------
        MissingDependencyError
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingDependencyError("to_dataframe needs pandas: pip install 'fuzzykf[cli]'") from error
        if by_fold:
            rows = pd.Index([fold.split for fold in self.folds], name="first_held_out")
            return pd.DataFrame(self.fold_rmse, index=rows, columns=[score.name for score in self.scores])
        return pd.DataFrame([vars(score) for score in self._ranked()]).set_index("name")

    def _ranked(self) -> list[ModelScore]:
        return sorted(self.scores, key=lambda score: score.rmse)


class Round:
    """What the candidates make of one fold.

    Parameters
    ----------
    part : LearningPart
    truth, zs : ndarray, shapes (n, m) and (n, q)
        States and observations held out.
    scale : ndarray, shape (m,) or (1,)
        Units of the errors.
    methods : sequence of Candidate

    Attributes
    ----------
    learned, failures : dict
        By name of the candidate.
    squared, inside : dict of str to ndarray
        Squared error, and share of the components inside their intervals, at each held-out
        row; NaN where the state is missing.
    log_likelihood : dict of str to ndarray
        At the rows where something was observed.
    seconds : dict of str to float
    baseline : ndarray
        Squared error of the mean of the part learned on.
    """

    def __init__(
        self,
        part: LearningPart,
        truth: FloatArray,
        zs: FloatArray,
        scale: FloatArray,
        methods: Sequence[Candidate],
    ) -> None:
        self.learned: dict[str, Learned] = {}
        self.failures: dict[str, str] = {}
        self.squared: dict[str, FloatArray] = {}
        self.inside: dict[str, FloatArray] = {}
        self.log_likelihood: dict[str, FloatArray] = {}
        self.seconds: dict[str, float] = {}
        if not np.isfinite(part.x).any(axis=0).all():
            raise ParameterError(f"x: a component is missing in all {len(part)} rows to learn on")
        self.known = np.isfinite(truth).any(axis=1)
        truth = truth[self.known]
        self.baseline = np.nanmean(((truth - np.nanmean(part.x, axis=0)) / scale) ** 2, axis=1)
        observed = np.isfinite(zs).any(axis=1)
        for method in methods:
            part.progress(method.name)
            begun = time.perf_counter()
            try:
                learned = method.learn(part)
                self.seconds[method.name] = time.perf_counter() - begun
                found = _finite(learned.restore(part.y, zs))
            except FuzzykfError as error:
                self.failures[method.name] = str(error)
                continue
            error_ = found.mean[self.known] - truth
            self.learned[method.name] = learned
            self.squared[method.name] = np.nanmean((error_ / scale) ** 2, axis=1)
            within = np.abs(error_) <= INTERVAL_FACTOR * found.std[self.known]
            self.inside[method.name] = np.nanmean(np.where(np.isnan(error_), np.nan, within), axis=1)
            if found.log_likelihood is not None:
                self.log_likelihood[method.name] = found.log_likelihood[observed]


def _finite(found: Estimates) -> Estimates:
    for quantity in ("mean", "std", "log_likelihood"):
        values = getattr(found, quantity)
        if values is not None and not np.isfinite(values).all():
            step = int(np.argwhere(~np.isfinite(values))[0, 0])
            raise FuzzykfError(f"its {quantity} at held-out step {step} is {values[step]}")
    return found


def summarise(
    methods: Sequence[Candidate],
    folds: tuple[Fold, ...],
    rounds: Sequence[Round],
    n_resamples: int,
    rng: np.random.Generator,
) -> ModelComparison:
    """Score the candidates on all folds together.

    Parameters
    ----------
    methods : sequence of Candidate
    folds : tuple of Fold
    rounds : sequence of Round
        One for each fold.
    n_resamples : int
    rng : numpy.random.Generator

    Raises
    ------
    FuzzykfError
        If every candidate failed in some fold.
    ParameterError
        If too few of the held-out states are known.
    """
    failures = {
        name: f"fold {number}: {reason}"
        for number, r in reversed(list(enumerate(rounds, 1)))
        for name, reason in r.failures.items()
    }
    names = [method.name for method in methods if method.name not in failures]
    if not names:
        reasons = "; ".join(f"{name}, {reason}" for name, reason in failures.items())
        raise FuzzykfError(f"no candidate could be learned: {reasons}")
    if sum(r.known.sum() for r in rounds) < MIN_TEST:
        raise ParameterError(
            f"x: {sum(r.known.sum() for r in rounds)} held-out states are known, expected at least {MIN_TEST}"
        )
    squared = np.concatenate([np.column_stack([r.squared[name] for name in names]) for r in rounds])
    found = bootstrap_rmse(squared, n_resamples, rng)
    best = int(np.argmin(found.rmse))
    low, high = np.quantile(found.resampled, LIMITS, axis=0)
    scores = []
    for k, name in enumerate(names):
        difference_low, difference_high = found.difference(k, best)
        steps = [r.log_likelihood[name] for r in rounds if name in r.log_likelihood]
        scores.append(
            ModelScore(
                name=name,
                rmse=float(found.rmse[k]),
                rmse_low=float(low[k]),
                rmse_high=float(high[k]),
                difference=float(found.rmse[k] - found.rmse[best]),
                difference_low=difference_low,
                difference_high=difference_high,
                coverage=float(np.concatenate([r.inside[name] for r in rounds]).mean()),
                log_likelihood=float(np.concatenate(steps).mean()) if steps else float("nan"),
                seconds=sum(r.seconds[name] for r in rounds),
            )
        )
    fold_rmse = np.array(  # a fold without a known state has no error
        [[np.sqrt(r.squared[n].mean()) if r.known.any() else np.nan for n in names] for r in rounds]
    )
    return ModelComparison(
        scores=tuple(scores),
        failures=failures,
        folds=folds,
        fold_rmse=fold_rmse,
        learned=tuple(r.learned for r in rounds),
        baseline_rmse=float(np.sqrt(np.concatenate([r.baseline for r in rounds]).mean())),
        block_length=found.block_length,
    )

"""The one way in which candidates are judged, on one held-out part or on several.

They learn on a part (`restore`), say what the states of a later one were, from its observations,
and their errors there make the scores (`summarise`).
"""

from __future__ import annotations

import textwrap
import time
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.comparison.candidates import Estimates, Learned, Restoration
from fuzzykf.comparison.density import NormalMixture, normal_log_score
from fuzzykf.comparison.scores import LIMITS, Score, behind, bootstrap_rmse, row_of
from fuzzykf.comparison.verdict import (
    about_baseline,
    about_error,
    about_feedback,
    about_likelihood,
    about_log_score,
    about_rival,
    by_log_score,
)
from fuzzykf.errors import FuzzykfError, MissingDependencyError, ParameterError
from fuzzykf.gaussian import as_flag, brief
from fuzzykf.reprs import WIDTH, cut, html_table, reprs, shown, shown_html, text_table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.comparison.candidates import Candidate, LearningPart, Named
    from fuzzykf.comparison.clock import Clock

__all__ = [
    "Fold",
    "HeldOut",
    "ModelComparison",
    "ModelScore",
    "checked",
    "log_score",
    "microseconds",
    "restore",
    "summarise",
]

#: A method's time per step is the least of this many passes over this many steps.
TIMED_PASSES, TIMED_STEPS = 5, 500

#: Columns of the table that a comparison is shown as.
HEADER = ("candidate", "RMSE", "95 % interval", "90 % covers", "log score", "log-lik.", "behind the best")

#: Rows of it, candidates that failed, and lines of the verdict: no more are shown than these.
MOST_ROWS, MOST_FAILURES, MOST_VERDICT = 18, 4, 8

#: Longest name of a candidate in it.
MOST_NAME = 18

#: Rows of it in a notebook.
MOST_HTML = 50

#: The scores of `compare_models` are those of `compare`.
ModelScore = Score


@reprs()
@dataclass(frozen=True)
class Fold:
    """Training rows of one fold, and the test rows after them.

    Attributes
    ----------
    begin, split, end : int
        Rows ``begin`` to ``split - 1`` are for training, ``split`` to ``end - 1`` for testing.

    Examples
    --------
    >>> from fuzzykf.comparison import Fold
    >>> Fold(begin=0, split=300, end=360)
    Fold(begin=0, split=300, end=360)
    """

    begin: int
    split: int
    end: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ModelComparison:
    """Scores and verdict of `compare_models`.

    Attributes
    ----------
    scores : tuple of Score
        Scores in the order of the candidates, without those that failed.
    failures : mapping of str to str
        Candidates that failed in some fold, with the reason.
    folds : tuple of Fold
    fold_rmse : ndarray, shape (folds, candidates)
        RMSE of each of ``scores`` in each fold.
    learned : tuple of mapping
        For each fold, the trained candidates by name; see `fuzzykf.comparison.Learned`.
    baseline_rmse : float
        RMSE of the mean of the training rows.
    block_length : int
        Number of steps in a block of the bootstrap.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import compare_models
    >>> rng = np.random.default_rng(0)
    >>> y = rng.normal(size=600)
    >>> x = np.abs(y) + 0.1 * rng.normal(size=600)
    >>> found = compare_models(x, y, rng, candidates=["kalman", "piecewise"])
    >>> found.best, found.is_certain
    ('piecewise', True)
    >>> len(found.folds), found.fold_rmse.shape
    (5, (5, 2))
    """

    scores: tuple[Score, ...]
    failures: Mapping[str, str] = field(default_factory=dict)
    folds: tuple[Fold, ...]
    fold_rmse: FloatArray
    learned: tuple[Mapping[str, Learned], ...]
    baseline_rmse: float
    block_length: int

    @property
    def ranked(self) -> tuple[Score, ...]:
        """The scores, lowest RMSE first."""
        return tuple(sorted(self.scores, key=lambda score: score.rmse))

    @property
    def best(self) -> str:
        """Name of the candidate with the lowest RMSE."""
        return self.ranked[0].name

    @property
    def is_certain(self) -> bool:
        """Whether the lead of the best candidate on RMSE is significant."""
        return len(self.scores) > 1 and self.ranked[1].difference_low > 0.0

    @property
    def best_on_log_score(self) -> str:
        """Name of the candidate with the highest log score of the state."""
        return by_log_score(self.scores)[0].name

    @property
    def is_certain_on_log_score(self) -> bool:
        """Whether the lead of the best candidate on log score is significant."""
        return len(self.scores) > 1 and by_log_score(self.scores)[1].log_score_behind_low > 0.0

    def verdict(self, unit: str = "") -> str:
        """Describe the winners on RMSE and on log score, and whether their leads are significant.

        Parameters
        ----------
        unit : str
            Unit of the state, for the text.

        Returns
        -------
        str
        """
        given: Any = unit
        if not isinstance(given, str):
            raise ParameterError(f"unit: got {brief(given)}, expected a text")
        sentences = (
            about_error(self.ranked, "name", unit),
            about_feedback(self.ranked, self.learned[-1], "name"),
            about_log_score(self.scores, "name"),
            about_baseline(self.baseline_rmse, unit),
            about_likelihood(self.scores),
        )
        return " ".join(filter(None, sentences))

    def against(self, rival: str, unit: str = "") -> str:
        """Describe how far a candidate is behind the winners, on RMSE and on log score, with intervals.

        Parameters
        ----------
        rival : str
            Name of the candidate.
        unit : str
            Unit of the state, for the text.

        Returns
        -------
        str

        Raises
        ------
        ParameterError
            If no candidate of this name was compared.
        """
        return self._against(rival, unit, "name")

    def _against(self, rival: str, unit: str, label: Literal["name", "title"]) -> str:
        names = [score.name for score in self.scores]
        if rival not in names:
            failed = f"; it failed: {self.failures[rival]}" if rival in self.failures else ""
            raise ParameterError(f"rival: got {brief(rival)}, expected one of {', '.join(names)}{failed}")
        return about_rival(self.scores, rival, label, unit)

    def notes(self) -> dict[str, tuple[str, ...]]:
        """Return warnings about each candidate, from its last fold.

        Returns
        -------
        dict of str to tuple of str
        """
        return {name: learned.notes for name, learned in self.learned[-1].items() if learned.notes}

    def to_dataframe(self, *, by_fold: bool = False) -> pd.DataFrame:
        """Return the scores as a pandas DataFrame, one row per candidate, best first.

        Parameters
        ----------
        by_fold : bool
            Return the RMSE of each candidate (columns) in each fold (rows) instead.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        MissingDependencyError
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingDependencyError("to_dataframe needs pandas: pip install 'fuzzykf[cli]'") from error
        if as_flag("by_fold", by_fold):
            rows = pd.Index([fold.split for fold in self.folds], name="first_held_out")
            return pd.DataFrame(self.fold_rmse, index=rows, columns=[score.name for score in self.scores])
        found = pd.DataFrame([vars(score) for score in self.ranked]).set_index("name").drop(columns="title")
        return found.drop(columns="microseconds") if found["microseconds"].isna().all() else found

    @shown
    def __repr__(self) -> str:
        rows = self._rows()[:MOST_ROWS]
        hidden = len(self.scores) - len(rows)
        lines = [self._title(), *text_table(HEADER, rows)]
        lines += [f"  ... and {hidden} more"] * (hidden > 0)
        failed = list(self.failures.items())[:MOST_FAILURES]
        lines += [cut(f"  failed: {name}, {why}", WIDTH) for name, why in failed]
        more = len(self.failures) - len(failed)
        lines += [f"  ... and {more} more that failed"] * (more > 0)
        return "\n".join(
            lines + textwrap.wrap(cut(self.verdict(), MOST_VERDICT * WIDTH), WIDTH)[:MOST_VERDICT]
        )

    @shown_html
    def _repr_html_(self) -> str:
        failed = [
            cut(f"failed: {name}, {why}", 4 * WIDTH) for name, why in list(self.failures.items())[:MOST_HTML]
        ]
        return html_table(
            self._title(), HEADER, self._rows()[:MOST_HTML], [cut(self.verdict(), 8 * WIDTH), *failed]
        )

    def _title(self) -> str:
        folds = "1 fold" if len(self.folds) == 1 else f"{len(self.folds)} folds"
        return f"{type(self).__name__} of {len(self.scores)} candidates in {folds}, least error first"

    def _rows(self) -> list[tuple[str, ...]]:
        """Return a row of `HEADER` for each candidate, best first."""
        return [(cut(one.name, MOST_NAME), *row_of(one), behind(one)) for one in self.ranked]


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """One held-out part, and what the candidates say of it.

    Attributes
    ----------
    truth, zs : ndarray, shapes (n, m) and (n, q)
        States and observations, NaN where missing.
    centre : ndarray, shape (m,)
        Mean of the states learned on.
    found : dict of str to Restoration
        By name of the candidate.
    failures : dict of str to str
        Why a candidate found nothing.
    """

    truth: FloatArray
    zs: FloatArray
    centre: FloatArray
    found: dict[str, Restoration] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def known(self) -> BoolArray:
        """Rows of which something of the state is known, shape (n,)."""
        known: BoolArray = np.asarray(np.isfinite(self.truth).any(axis=1))
        return known

    def squared(self, mean: FloatArray, scale: FloatArray) -> FloatArray:
        """Return the squared error of an estimate at each known row."""
        squared: FloatArray = np.nanmean((self._error(mean) / scale) ** 2, axis=1)
        return squared

    def inside(self, found: Restoration) -> FloatArray:
        """Return the share of the components inside their intervals, at each known row."""
        truth = self.truth[self.known]
        lower, upper = (end.reshape(self.truth.shape)[self.known] for end in found.interval(0.9))
        within = np.where(np.isnan(truth), np.nan, (lower <= truth) & (truth <= upper))
        share: FloatArray = np.nanmean(within, axis=1)
        return share

    def log_score(self, found: Restoration, scale: FloatArray) -> FloatArray:
        """Return the log-density of the state under the law that is claimed, at each known row."""
        return log_score(found, self.truth, scale)[self.known]

    def normal_log_score(self, found: Restoration, scale: FloatArray) -> FloatArray:
        """Return the same under the normal law of mean and standard deviation, whatever is claimed."""
        std = found.std.reshape(self.truth.shape)[self.known]
        return normal_log_score(self._error(found.mean) / scale, std / scale)

    def log_likelihood(self, found: Restoration) -> FloatArray:
        """Return the log-density of each observation that there is; empty without a law of them."""
        if found.log_likelihood is None:
            return np.empty(0)
        return found.log_likelihood[np.isfinite(self.zs).any(axis=1)]

    def _error(self, mean: FloatArray) -> FloatArray:
        return (mean.reshape(self.truth.shape) - self.truth)[self.known]


def checked(found: Any, n: int, m: int) -> Estimates:
    """Return what a method says of ``n`` states of ``m`` components, if it has the form of that.

    Of one component mean and standard deviation may have the shape (n,).

    Raises
    ------
    FuzzykfError
        If it is none of `Estimates`, or a part of it is missing or of another shape; the message follows on
        the name of a candidate.
    """
    if not isinstance(found, Estimates):
        raise FuzzykfError(f"its restore returns {brief(found)}, expected Estimates")
    given: dict[str, Any] = {"mean": found.mean, "std": found.std}
    for name, values in given.items():
        if values is None:
            raise FuzzykfError(f"its {name} is None, expected an array of shape {(n, m)}")
        if np.shape(values) not in ((n, m), (n,) if m == 1 else (n, m)):
            raise FuzzykfError(f"its {name} has shape {np.shape(values)}, expected {(n, m)}")
    if found.log_likelihood is not None and np.shape(found.log_likelihood) != (n,):
        raise FuzzykfError(f"its log_likelihood has shape {np.shape(found.log_likelihood)}, expected {(n,)}")
    law: Any = found.density
    if law is not None and not isinstance(law, NormalMixture):
        raise FuzzykfError(f"its density is {brief(law)}, expected a NormalMixture or None")
    if law is not None and (len(law), law.dim_x) != (n, m):
        raise FuzzykfError(
            f"its density is of {len(law)} steps and {law.dim_x} components, expected {n} and {m}"
        )
    mean, std = (np.asarray(values, dtype=np.float64).reshape(n, m) for values in given.values())
    return replace(found, mean=mean, std=std)


def log_score(found: Estimates, truth: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the log-density of the true state under the law that is claimed, in a unit of one's choice.

    Parameters
    ----------
    found : Estimates
        Its density is that of the `NormalMixture`, if there is one, else the normal law of its mean and
        standard deviation.
    truth : ndarray, shape (n, m)
        NaN where unknown: such components do not count.
    scale : ndarray, shape (m,) or (1,)
        Unit of each component, in the unit of the states: x = scale u has log p(u) = log p(x) + log scale.

    Returns
    -------
    ndarray of shape (n,)
    """
    if found.density is None:
        error, std = (found.mean.reshape(truth.shape) - truth) / scale, found.std.reshape(truth.shape) / scale
        return normal_log_score(error, std)
    units: FloatArray = np.where(np.isnan(truth), 0.0, np.log(scale)).sum(axis=1)
    return found.density.log_density(truth) + units


def restore(
    candidate: Candidate,
    part: LearningPart,
    zs: FloatArray,
    clock: Clock | None = None,
    inputs: FloatArray | None = None,
) -> Restoration:
    """Let a candidate learn, and say what the states of the rows after that part were.

    Parameters
    ----------
    candidate : Candidate
    part : LearningPart
    zs : ndarray, shape (n, q)
        Observations of the held-out part.
    clock : Clock or None
        Their hours and days.
    inputs : ndarray, shape (n, k), or None
        What else is known of them.

    Raises
    ------
    FuzzykfError
        If it cannot learn, or what it finds is incomplete, of another shape, not finite, or has a standard
        deviation below 0.
    """
    begun = time.perf_counter()
    learned = candidate.learn(part)
    seconds = time.perf_counter() - begun
    given: Any = learned
    if not isinstance(given, Learned):
        raise FuzzykfError(f"its learn returns {brief(given)}, expected something Learned")
    found = checked(learned.at(clock).told(inputs).restore(part.y, zs), len(zs), part.x.shape[1])
    for quantity in ("mean", "std", "log_likelihood"):
        values = getattr(found, quantity)
        if values is None:
            continue
        wrong = ~np.isfinite(values) | ((values < 0.0) & (quantity == "std"))
        if wrong.any():
            k = int(np.argwhere(wrong)[0, 0])
            raise FuzzykfError(f"its {quantity} at held-out step {k} is {np.squeeze(values[k])}")
    return Restoration(
        name=candidate.name,
        title=candidate.title,
        **{one.name: getattr(found, one.name) for one in fields(Estimates)},
        notes=learned.notes,
        description=learned.description,
        choices=(learned.choice,) if learned.choice else (),
        learned=learned,
        seconds=seconds,
    )


def microseconds(step: Callable[[FloatArray], object], zs: FloatArray) -> float:
    """Time of one call of ``step``: the least mean over several passes, in microseconds."""
    values = list(zs[:TIMED_STEPS])
    passes = []
    for _ in range(TIMED_PASSES):
        start = time.perf_counter()
        for z in values:
            step(z)
        passes.append(time.perf_counter() - start)
    return 1e6 * min(passes) / len(values)


def summarise(
    candidates: Sequence[Named],
    folds: tuple[Fold, ...],
    parts: Sequence[HeldOut],
    scale: FloatArray,
    n_resamples: int,
    rng: np.random.Generator,
    *,
    no_law: float | None = None,
) -> ModelComparison:
    """Score the candidates on all held-out parts together.

    Parameters
    ----------
    candidates : sequence of Candidate or Restoration
        Whose names and titles are wanted.
    folds : tuple of Fold
    parts : sequence of HeldOut
        One for each fold.
    scale : ndarray, shape (m,) or (1,)
        Units of the errors.
    n_resamples : int
    rng : numpy.random.Generator
    no_law : float or None
        What stands for the log-likelihood of a candidate that has no law of the observation.

    Raises
    ------
    FuzzykfError
        If every candidate failed in some fold.
    """
    failures = {
        name: f"fold {number}: {reason}"
        for number, part in reversed(list(enumerate(parts, 1)))
        for name, reason in part.failures.items()
    }
    left = [one for one in candidates if one.name not in failures]
    if not left:
        reasons = "; ".join(f"{name}, {reason}" for name, reason in failures.items())
        raise FuzzykfError(f"no candidate could be learned: {reasons}")
    squared = [
        np.column_stack([part.squared(part.found[one.name].mean, scale) for one in left]) for part in parts
    ]
    scored = np.concatenate(
        [np.column_stack([part.log_score(part.found[one.name], scale) for one in left]) for part in parts]
    )
    has_error = np.isfinite(scored).all(axis=0)  # else it is infinite, and nothing is to be resampled
    bootstrap = bootstrap_rmse(
        np.concatenate(squared), n_resamples, rng, beside=np.where(has_error, scored, 0.0)
    )
    best = int(np.argmin(bootstrap.rmse))
    low, high = np.quantile(bootstrap.resampled, LIMITS, axis=0)
    log_scores = _log_scores(scored, bootstrap.beside, has_error)
    scores = []
    for k, one in enumerate(left):
        found = [(part, part.found[one.name]) for part in parts]
        difference_low, difference_high = bootstrap.difference(k, best)
        steps = np.concatenate([part.log_likelihood(said) for part, said in found])
        scores.append(
            Score(
                name=one.name,
                title=one.title,
                rmse=float(bootstrap.rmse[k]),
                rmse_low=float(low[k]),
                rmse_high=float(high[k]),
                difference=float(bootstrap.rmse[k] - bootstrap.rmse[best]),
                difference_low=difference_low,
                difference_high=difference_high,
                coverage=float(np.concatenate([part.inside(said) for part, said in found]).mean()),
                **log_scores[k],
                normal_log_score=_mean([part.normal_log_score(said, scale) for part, said in found]),
                density="mixture" if any(_is_mixture(said) for _, said in found) else "normal",
                log_likelihood=float(steps.mean()) if steps.size else no_law,
                seconds=sum(said.seconds for _, said in found),
                microseconds=found[-1][1].microseconds,
            )
        )
    mean = [part.squared(np.broadcast_to(part.centre, part.truth.shape), scale) for part in parts]
    return ModelComparison(
        scores=tuple(scores),
        failures=failures,
        folds=folds,
        fold_rmse=np.array(  # a fold without a known state has no error
            [[np.sqrt(column.mean()) if len(rows) else np.nan for column in rows.T] for rows in squared]
        ),
        learned=tuple(
            {name: said.learned for name, said in part.found.items() if said.learned is not None}
            for part in parts
        ),
        baseline_rmse=float(np.sqrt(np.concatenate(mean).mean())),
        block_length=bootstrap.block_length,
    )


def _is_mixture(found: Estimates) -> bool:
    return found.density is not None and found.density.n_components > 1


def _mean(parts: Sequence[FloatArray]) -> float:
    """Return the mean of rows of several parts; minus infinity where one is that, whatever the others are."""
    rows = np.concatenate(parts)
    return -np.inf if np.isneginf(rows).any() else float(rows.mean())


def _log_scores(scored: FloatArray, resampled: FloatArray, has_error: BoolArray) -> list[dict[str, float]]:
    """Return the fields of `Score` on the log score, for each column of rows (n, k) and their resamples."""
    means = np.array([_mean([column]) for column in scored.T])
    best = int(np.argmax(np.where(has_error, means, -np.inf)))
    low, high = np.quantile(resampled, LIMITS, axis=0)
    behind_low, behind_high = np.quantile(resampled[:, [best]] - resampled, LIMITS, axis=0)
    spread = np.std(resampled, axis=0, ddof=1)
    found = []
    for k, mean in enumerate(means):
        known = bool(has_error[k])  # else it is infinite, and so is every difference
        fields = {
            "log_score_standard_error": spread[k],
            "log_score_low": low[k],
            "log_score_high": high[k],
            "log_score_behind": means[best] - mean if known else np.nan,
            "log_score_behind_low": behind_low[k],
            "log_score_behind_high": behind_high[k],
        }
        found.append(
            {"log_score": float(mean)} | {n: float(v) if known else float("nan") for n, v in fields.items()}
        )
    return found

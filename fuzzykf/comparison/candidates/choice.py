"""How a candidate chooses while it learns: on rolling blocks inside the rows to learn on.

One last stretch decides by chance: what wins there need not win on the next.  So each option is
learned several times, always on the rows before a block, and judged on all blocks together.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np

from fuzzykf.comparison.evaluation import checked, log_score
from fuzzykf.comparison.scores import significance, standard_error
from fuzzykf.errors import FuzzykfError, MissingDependencyError
from fuzzykf.preprocessing import mean_and_scale

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Estimates, Learned, LearningPart

__all__ = ["BLOCKS", "Choice", "choose", "rolling_blocks"]

#: Blocks on which options are judged.
BLOCKS = 3

Option = TypeVar("Option")


def rolling_blocks(n: int, n_blocks: int = BLOCKS) -> tuple[tuple[int, int], ...]:
    """Cut the second half of ``n`` rows into blocks: the first row of each, and the one after its last.

    Examples
    --------
    >>> rolling_blocks(600)
    ((300, 400), (400, 500), (500, 600))
    """
    bounds = np.linspace(n / 2, n, n_blocks + 1).round().astype(int).tolist()
    return tuple(pairwise(bounds))


@dataclass(frozen=True, eq=False)
class Choice(Generic[Option]):
    """What was chosen, and how sure that is.

    Attributes
    ----------
    best : object
    tried : tuple
        The options that could be learned, in their order.
    rmse : ndarray, shape (k,)
        Of each over all blocks, in standard deviations of the state.
    log_score : ndarray, shape (k,)
        Of each: mean log-density of the state under the law that it claims, in the same unit.  NaN where
        nothing is claimed.
    by : {"log score", "squared error"}
        What decided.
    lead, lead_error : float
        By how much the mean of it is better than that of the next best, and the standard error of this
        difference; NaN without another.
    errors : ndarray, shape (rows, m)
        Of the best in all blocks, in the unit of the state; NaN where it is unknown.
    failures : mapping of str to str
        Why an option could not be learned.
    """

    best: Option
    tried: tuple[Option, ...]
    rmse: FloatArray
    log_score: FloatArray
    by: Literal["log score", "squared error"]
    lead: float
    lead_error: float
    errors: FloatArray
    failures: Mapping[str, str]

    def told(self, label: str) -> str:
        """Say in words what was chosen, from what, and how sure it is."""
        names = [str(one) for one in self.tried]
        numbers = len(self.tried) > 2 and all(isinstance(one, int) for one in self.tried)
        span = f"{names[0]}-{names[-1]}" if numbers else ", ".join(names)
        text = f"{label}: {self.best} (chosen from {span} on {BLOCKS} rolling blocks by {self.by}"
        if len(self.tried) > 1:
            best, second = self._first_two()
            rmse = f"RMSE {self.rmse[best]:.3g} against {self.rmse[second]:.3g} std"
            scores = f"{self.log_score[best]:.3f} against {self.log_score[second]:.3f}"
            decided, beside = (scores, rmse) if self.by == "log score" else (rmse, f"log score {scores}")
            sure = significance(abs(self.lead) > 1.96 * self.lead_error)
            text += (
                f": {decided} with {self.tried[second]}, difference {self.lead:.2g} ± {self.lead_error:.2g}, "
                f"{sure}"
            )
            if np.isfinite(self.log_score[[best, second]]).all():
                text += f"; {beside}"
        failed = "".join(f"; {name} could not be learned: {why}" for name, why in self.failures.items())
        return f"{text}{failed})"

    def _first_two(self) -> tuple[int, int]:
        loss = -self.log_score if self.by == "log score" else self.rmse
        best, second = np.argsort(loss, kind="stable")[:2].tolist()
        return best, second


def choose(
    part: LearningPart,
    options: Sequence[Option],
    learn: Callable[[LearningPart, Option], Learned],
    *,
    by: Literal["log score", "squared error"],
    tell: Callable[[Option], None] = lambda _: None,
) -> Choice[Option]:
    """Choose by the mean over all rows of several blocks, each judged by what was learned before it.

    Parameters
    ----------
    part : LearningPart
    options : sequence
    learn : callable
        From rows and an option to what is learned with it on them.
    by : {"log score", "squared error"}
        Of the state: the density that a method gives it (a mixture of normal laws if it tells one, else the
        normal law of its mean and standard deviation), or the error of its mean alone.
    tell : callable
        Is told each option before it is tried.

    Returns
    -------
    Choice

    Raises
    ------
    MissingDependencyError
        If a package is not installed.
    FuzzykfError
        If no option can be learned, or no state is known in the blocks.
    """
    blocks = rolling_blocks(len(part))
    first = blocks[0][0]
    truth = part.x[first:]
    known = np.isfinite(truth).any(axis=1)
    if not known.any():
        raise FuzzykfError(
            f"the state is missing in all of the last {len(truth)} rows to learn on, on which is chosen"
        )
    scale = mean_and_scale("x", part.x)[1]
    errors: list[FloatArray] = []
    losses: list[FloatArray] = []
    rmse, scores, tried, failures = [], [], [], {}
    for option in options:
        tell(option)
        try:
            said = _trials(part, blocks, option, learn)
        except MissingDependencyError:
            raise  # says nothing of the option
        except FuzzykfError as error:
            failures[str(option)] = str(error)
            continue
        error_of = truth - np.concatenate([one.mean for one in said])
        squared = np.nanmean((error_of[known] / scale) ** 2, axis=1)
        scored = np.concatenate(
            [log_score(one, part.x[split:end], scale) for one, (split, end) in zip(said, blocks, strict=True)]
        )[known]
        tried.append(option)
        errors.append(error_of)
        losses.append(-scored if by == "log score" else squared)
        rmse.append(float(np.sqrt(squared.mean())))
        claims = all(np.isfinite(one.std).all() for one in said)
        scores.append(float(scored.mean()) if claims else float("nan"))
    if not tried:
        reasons = set(failures.values())
        told = [*reasons] if len(reasons) == 1 else [f"{name}: {why}" for name, why in failures.items()]
        raise FuzzykfError("; ".join(told))
    means = np.array([loss.mean() for loss in losses])
    best, *others = np.argsort(means, kind="stable").tolist()
    lead = lead_error = float("nan")
    if others and np.isfinite(means[[best, others[0]]]).all():
        difference = losses[others[0]] - losses[best]
        lead, lead_error = float(difference.mean()), standard_error(difference)
    return Choice(
        best=tried[best],
        tried=tuple(tried),
        rmse=np.array(rmse),
        log_score=np.array(scores),
        by=by,
        lead=lead,
        lead_error=lead_error,
        errors=errors[best],
        failures=failures,
    )


def _trials(
    part: LearningPart,
    blocks: Sequence[tuple[int, int]],
    option: Any,
    learn: Callable[[LearningPart, Any], Learned],
) -> list[Estimates]:
    """Return what is said of each block, by what was learned on the rows before it."""
    found = []
    for split, end in blocks:
        clock = None if part.clock is None else part.clock[split:end]
        inputs = None if part.inputs is None else part.inputs[split:end]
        learned = learn(part.first(split), option).at(clock).told(inputs)
        said = checked(learned.restore(part.y[:split], part.y[split:end]), end - split, part.x.shape[1])
        if not np.isfinite(said.mean).all():
            raise FuzzykfError(f"its estimate is not finite in the rows from {split} to {end}")
        found.append(said)
    return found

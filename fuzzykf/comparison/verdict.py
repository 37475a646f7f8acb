"""Verdict in words: the winner on RMSE and on log score, its significance, and a likely reason."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from fuzzykf.comparison.scores import significance

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.comparison.candidates import Learned
    from fuzzykf.comparison.scores import Score

__all__ = [
    "about_baseline",
    "about_error",
    "about_feedback",
    "about_likelihood",
    "about_log_score",
    "about_rival",
    "by_log_score",
]

#: Candidates with a switch and with feedback, which are worth a try where feedback wins.
SWITCHING_WITH_FEEDBACK = ("switching-ssm", "switching-ssm-hard")


def by_log_score(scores: Sequence[Score]) -> list[Score]:
    """Return the scores, the largest log score first; those without one last."""
    return sorted(scores, key=lambda one: np.inf if np.isnan(one.log_score) else -one.log_score)


def about_error(ranked: Sequence[Score], label: Literal["name", "title"], unit: str) -> str:
    """Say which candidate has the lowest RMSE, and whether its lead is significant."""
    space = f" {unit}" if unit else ""
    best, *others = ranked
    told = f"{best.rmse:.4g}{space} (95 % interval {best.rmse_low:#.3g} to {best.rmse_high:#.3g})"
    if not others:
        return f"{getattr(best, label)} is the only candidate, with an RMSE of {told}."
    second = others[0]
    return (
        f"{getattr(best, label)} has the lowest RMSE, {told}. Next is {getattr(second, label)}, "
        f"{second.difference:.2g}{space} behind (95 % interval {second.difference_low:.2g} to "
        f"{second.difference_high:.2g}): {significance(second.difference_low > 0.0)}."
    )


def about_feedback(
    ranked: Sequence[Score], learned: Mapping[str, Learned], label: Literal["name", "title"]
) -> str:
    """Say why a Kalman filter or an IMM estimator is ahead of the exact switching filters, and what to try.

    Empty unless the candidate of least error has feedback, and its lead over the best of those that filter
    without is significant.
    """
    has = {name: one.feedback for name, one in learned.items()}
    best = ranked[0]
    without = [score for score in ranked if has.get(score.name) is False]
    if not has.get(best.name) or not without or not without[0].difference_low > 0.0:
        return ""
    told = (
        f"A likely reason is feedback: in {getattr(best, label)} each observation corrects the state that "
        f"went before it, in {getattr(without[0], label)} it does not."
    )
    if set(has) & set(SWITCHING_WITH_FEEDBACK):
        return told
    return (
        f"{told} SwitchingStateSpace has regimes and feedback: try {' and '.join(SWITCHING_WITH_FEEDBACK)}."
    )


def about_log_score(scores: Sequence[Score], label: Literal["name", "title"]) -> str:
    """Say which candidate has the largest log score of the state; empty where there is none to name."""
    best, *others = by_log_score(scores)
    if not others or not np.isfinite(best.log_score):
        return ""
    told = f"{getattr(best, label)} has the highest log score, {best.log_score:.3f}"
    if np.isfinite(best.log_score_low):
        told += f" (95 % interval {best.log_score_low:.3f} to {best.log_score_high:.3f})"
    if best.density == "mixture":
        told += ", for its mixture of normal distributions"
    second = others[0]
    if not np.isfinite(second.log_score):
        return f"{told}. No other log score is finite."
    return (
        f"{told}. Next is {getattr(second, label)}, {second.log_score_behind:.2g} behind (95 % interval "
        f"{second.log_score_behind_low:.2g} to {second.log_score_behind_high:.2g}): "
        f"{significance(second.log_score_behind_low > 0.0)}."
    )


def about_rival(scores: Sequence[Score], rival: str, label: Literal["name", "title"], unit: str) -> str:
    """Say how far a candidate is behind the winners on error and on log score, by the paired bootstrap."""
    behind = f" {unit} behind" if unit else " behind"
    one = next(score for score in scores if score.name == rival)
    first, highest = min(scores, key=lambda score: score.rmse), by_log_score(scores)[0]
    if one is first:
        error = f"{getattr(one, label)} has the lowest RMSE"
    else:
        error = (
            f"{getattr(one, label)} is {one.difference:.2g}{behind} {getattr(first, label)} on RMSE "
            f"(95 % interval {one.difference_low:.2g} to {one.difference_high:.2g}): "
            f"{significance(one.difference_low > 0.0)}"
        )
    if one is highest:
        return f"{error}; it has the highest log score."
    if not np.isfinite(one.log_score_behind):
        return f"{error}; its log score is {one.log_score:g}."
    return (
        f"{error}; on log score {one.log_score_behind:.2g} behind {getattr(highest, label)} (95 % interval "
        f"{one.log_score_behind_low:.2g} to {one.log_score_behind_high:.2g}): "
        f"{significance(one.log_score_behind_low > 0.0)}."
    )


def about_baseline(rmse: float, unit: str) -> str:
    """Say the RMSE of the mean of the training rows."""
    return f"Baseline (training mean): RMSE {rmse:.4g}{f' {unit}' if unit else ''}."


def about_likelihood(scores: Sequence[Score]) -> str:
    """Say which candidate gives the observations the highest likelihood; empty if none defines one."""
    likelihood = np.array([score.log_likelihood for score in scores], dtype=np.float64)
    if len(scores) < 2 or np.isnan(likelihood).all():
        return ""
    told = f"The observations are likeliest under {scores[int(np.nanargmax(likelihood))].name}"
    return told + ("; regressions define no likelihood." if np.isnan(likelihood).any() else ".")

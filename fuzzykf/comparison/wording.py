"""What a comparison says in words, on the terminal and in the report alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf.comparison.scores import COLUMNS, cells
from fuzzykf.comparison.verdict import about_baseline

if TYPE_CHECKING:
    from fuzzykf.comparison.candidates import Restoration
    from fuzzykf.comparison.run import Comparison

__all__ = ["about_choices", "about_failures", "about_intervals", "about_task", "cells", "labels"]


def labels(unit: str) -> tuple[str, ...]:
    """Return what stands above the `cells`; the RMSE has a unit, if there is one."""
    rmse, *others = COLUMNS
    return (f"{rmse}\n({unit})" if unit else rmse, *others)


def about_task(comparison: Comparison, unit: str) -> str:
    """Say what was learned on and compared on, and how hard the task is."""
    task, folds = comparison.task, comparison.folds
    when = "" if task.time is None else f", from {task.time[task.n_train].astype('datetime64[m]')}"
    rows = f"Trained on {task.n_train:,} rows, tested on {task.n_test:,}{when}"
    if len(folds) > 1:
        rows = (
            f"Trained on at least {task.n_train:,} rows, tested on {task.n_test:,} in {len(folds)} "
            f"folds{when}; "
            "trained again before each fold, on all earlier rows"
        )
    return f"{rows}. Switch: {task.switch_source}. {about_baseline(comparison.baseline_rmse, unit)}"


def about_intervals(comparison: Comparison) -> str:
    """Say where intervals, log scores and log-likelihoods come from."""
    folds = "" if len(comparison.folds) == 1 else "over all folds, "
    mixtures = [score.title for score in comparison.scores if score.density == "mixture"]
    normal = "under a normal distribution with the mean and standard deviation of the method"
    if mixtures:
        others = f"; of the others {normal}" if len(mixtures) < len(comparison.scores) else ""
        normal = f"under the mixture of normal distributions of the method ({'; '.join(mixtures)}){others}"
    return (
        f"Intervals of 95 %: block bootstrap, {folds}blocks of {comparison.block_length} steps. Log score: "
        f"log-density of the state {normal}. "
        "Log-likelihoods of the observations are not shown: regressions define no likelihood."
    )


def about_choices(comparison: Comparison) -> tuple[str, ...]:
    """Say what was chosen while learning, and what a reader should know before trusting a method."""
    found = comparison.restorations
    last = " (last fold)" if len(comparison.folds) > 1 else ""
    choices = [f"{one.title}{last}: {one.description}.{_by_fold(one)}" for one in found if one.description]
    notes = [f"Note on {one.title}{last}: {note}." for one in found for note in one.notes]
    return (*choices, *notes)


def about_failures(comparison: Comparison) -> tuple[str, ...]:
    """Say which methods could not be compared, and why."""
    return tuple(f"Not compared: {name}, {why}." for name, why in comparison.failures.items())


def _by_fold(one: Restoration) -> str:
    if len(one.choices) < 2:
        return ""
    if len(set(one.choices)) == 1:
        return f" The same in all {len(one.choices)} folds."
    return f" In folds 1 to {len(one.choices)}: {', '.join(one.choices)}."

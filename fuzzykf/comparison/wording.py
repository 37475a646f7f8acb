"""What a comparison says in words, on the terminal and in the report alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf.comparison.scores import COLUMNS, cells

if TYPE_CHECKING:
    from fuzzykf.comparison.run import Comparison

__all__ = ["about_choices", "about_intervals", "about_task", "cells", "labels"]


def labels(unit: str) -> tuple[str, ...]:
    """Return what stands above the `cells`; the RMSE has a unit, if there is one."""
    rmse, *others = COLUMNS
    return (f"{rmse}\n({unit})" if unit else rmse, *others)


def about_task(comparison: Comparison, unit: str) -> str:
    """Say what was learned on and compared on, and how hard the task is."""
    task = comparison.task
    when = "" if task.time is None else f", from {task.time[task.n_train].astype('datetime64[m]')}"
    space = f" {unit}" if unit else ""
    return (
        f"Learned on {task.n_train:,} rows, compared on {task.n_test:,}{when}. "
        f"Switch: {task.switch_source}. "
        f"Always answering the mean of the learning part would have an RMSE of "
        f"{comparison.baseline_rmse:.4g}{space}."
    )


def about_intervals(comparison: Comparison) -> str:
    """Say where intervals, log scores and log-likelihoods come from."""
    return (
        f"Intervals: block bootstrap, blocks of {comparison.block_length} steps. Log score: log-density of "
        "the state under the method's mean and standard deviation, ± its standard error by the same blocks. "
        "Log-likelihood: of the observations, each given the earlier ones; regressions have no law of them."
    )


def about_choices(comparison: Comparison) -> tuple[str, ...]:
    """Say what was chosen while learning, and what a reader should know before trusting a method."""
    found = comparison.restorations
    choices = [f"{one.title}: {one.description}." for one in found if one.description]
    notes = [f"Note on {one.title}: {note}." for one in found for note in one.notes]
    return (*choices, *notes)

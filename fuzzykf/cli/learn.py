"""What ``fuzzykf fit`` learns from rows of a file, and how the filter does on the others."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.cli.columns import named_columns
from fuzzykf.cli.law import notes_of_fades
from fuzzykf.switching.laws.base import NODES
from fuzzykf.texts import counted

if TYPE_CHECKING:
    from fuzzykf.cli.columns import Rows
    from fuzzykf.estimation import LikelihoodFit
    from fuzzykf.results import FitResult
    from fuzzykf.switching.laws.base import Law as LawOfSwitch

__all__ = ["Form", "Kind", "Objective", "judge_filter", "learn_pairwise", "learn_state_space", "told_rows"]


class Kind(StrEnum):
    """Kind of the model."""

    PAIRWISE = "pairwise"
    SSM = "ssm"


class Objective(StrEnum):
    """What a pairwise model is learned for."""

    JOINT = "joint"
    FILTER = "filter"


class Form(StrEnum):
    """Form of the Gaussian part."""

    AUTO = "auto"
    REGRESSION = "regression"
    COVARIANCE = "covariance"


def learn_pairwise(
    rows: Rows,
    n_train: int,
    law: str | LawOfSwitch,
    regimes: int | None,
    nodes: int | None,
    options: dict[str, Any],
) -> FitResult[Any]:
    """Learn a pairwise model from the first rows."""
    from fuzzykf import CGOFMSModel, CGOMSModel

    x, y = rows.values["--state"][:n_train], rows.values["--obs"][:n_train]
    options |= {"inputs": None if rows.inputs is None else rows.inputs[:n_train]}
    if regimes is not None:
        return CGOMSModel.fit(x, y, n_regimes=regimes, **options)
    return CGOFMSModel.fit(x, y, law=law, n_nodes=nodes, **options)


def learn_state_space(
    rows: Rows,
    n_train: int,
    law: str | LawOfSwitch | None,
    regimes: int | None,
    nodes: int | None,
    options: dict[str, Any],
) -> LikelihoodFit[Any]:
    """Learn a state-space model: half of the starts begin with offsets of the sensors, half with noises."""
    from fuzzykf.comparison.candidates.state_space import fading_law, hard_law
    from fuzzykf.switching.laws.registry import LAWS
    from fuzzykf.switching.learning.state_space.start import learn_from_states

    n_nodes = NODES if nodes is None else nodes
    begin: Any = law
    if regimes is not None:
        begin = hard_law(regimes)
    elif law is None:
        begin = fading_law(n_nodes)
    elif isinstance(law, str):
        begin = LAWS[law].by_name(n_nodes)
    x, y = rows.values["--state"][:n_train], rows.values["--obs"][:n_train]
    return learn_from_states(
        x,
        y,
        begin,
        n_nodes=nodes,
        n_starts=(options["n_starts"] + 1) // 2,
        rng=options["rng"],
        max_iter=options["max_iter"],
        tolerance=options["tolerance"] * n_train,
        progress=False,
    )


def judge_filter(
    rows: Rows, n_train: int, fit: FitResult[Any], nodes: int | None, kind: Kind
) -> tuple[str, tuple[str, ...]]:
    """Say how the filter does on the other rows, and what to know about the model."""
    from fuzzykf.comparison.candidates.state_space import LearnedStateSpace
    from fuzzykf.comparison.candidates.switching import LearnedSwitching
    from fuzzykf.comparison.evaluation import log_score

    given: Any = fit
    learned: Any = LearnedStateSpace(given, nodes) if kind == Kind.SSM else LearnedSwitching(fit, nodes)
    notes = learned.notes
    if fit.model.is_fuzzy:
        notes = (*notes, *notes_of_fades(fit.model.law, fit.model.filter(nodes).n_nodes))
    truth, zs = rows.values["--state"][n_train:], rows.values["--obs"]
    n, n_known = len(truth), int(np.isfinite(truth).any(axis=1).sum())
    if not n_known:
        nothing = (
            f"None of the {counted(n, 'row')} that follow has a state, so that the filter cannot be tested."
        )
        return nothing if n else "", notes
    tested = "" if n_known == n else f", of which {n_known:,} {'has' if n_known == 1 else 'have'} a state"
    told = {} if rows.inputs is None else {"us": rows.inputs}
    found = learned.restore(zs[:n_train], zs[n_train:], **told)
    missed = found.mean - truth
    rmse = ", ".join(f"{v:.4g}" for v in np.sqrt(np.nanmean(missed**2, axis=0)))
    known = np.isfinite(truth)
    lower, upper = found.interval(0.9)
    inside = ((lower <= truth) & (truth <= upper))[known].mean()
    scored = log_score(found, truth, np.ones(1))[known.any(axis=1)].mean()
    return (
        f"Test on the {counted(n, 'row')} that follow{tested}: RMSE {rmse}; 90 % intervals contain "
        f"{100 * inside:.1f} % of the states; log score {scored:.4g} per row."
    ), notes


def told_rows(rows: Rows, n: int, fit: FitResult[Any]) -> str:
    """Say how many rows were learned on, and in how many each column is missing."""
    missing: list[str] = []
    for name, values in named_columns(rows, fit.model.labels):
        gaps = np.count_nonzero(np.isnan(values[:n]))
        if gaps:
            missing.append(f"{name} {'missing ' if not missing else ''}in {gaps:,}")
    used = "" if fit.n_observations == n else f", {fit.n_observations:,} of them used"
    told = f": {', '.join(missing)}" if missing else ""
    return f"{counted(n, 'row')} of {rows.source}{used}{told}"

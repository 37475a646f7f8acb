"""The exact switching filters as candidates, with a switch that is given or hidden."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.candidates import WARM_UP, Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.choice import choose
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.errors import FuzzykfError
from fuzzykf.switching.laws.registry import learned_laws
from fuzzykf.switching.models.base import given_regimes

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart
    from fuzzykf.results import FitResult
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem

__all__ = [
    "CANDIDATES",
    "LAWS",
    "TRIED",
    "LearnedSwitching",
    "growth_notes",
    "hard_candidate",
    "learn_chosen_law",
    "learn_fuzzy",
    "learn_hard",
]

#: Families of laws of a fuzzy switch.
LAWS = learned_laws()

#: Those that are tried where none is asked for: between two classes "graph" is "fmc1" but for its corners.
TRIED = tuple(law for law in LAWS if law != "graph")

#: Tolerance of the trials in which a law is chosen.
TRIAL_TOLERANCE = 1e-4


class LearnedSwitching(Learned):
    """A learned switching model and its filter.

    Parameters
    ----------
    fit : FitResult
    n_nodes : int, optional
        Nodes of a fuzzy switch; by default those of the model.
    description : str

    Attributes
    ----------
    fit : FitResult
    filter : OFSRFilter or CGOMSMFilter
    """

    feedback: bool | None = False

    def __init__(self, fit: FitResult[Any], n_nodes: int | None, description: str = "") -> None:
        self.fit, self.filter = fit, fit.model.filter(n_nodes)
        self.notes = (*fit.warnings, *growth_notes(fit.model.placed(n_nodes)))
        self.description = description

    def restore(self, before: FloatArray, zs: FloatArray, us: Any = None) -> Estimates:
        """Filter, beginning a little earlier; the density is the mixture over the nodes.

        A model with inputs is told those of all rows, ``us``.
        """
        warm = before[-WARM_UP:]
        told = {} if us is None else {"us": us[len(before) - len(warm) :]}
        result = self.filter.filter(np.concatenate([warm, zs]), **told, keep_nodes=True)
        part = slice(len(warm), None)
        return Estimates(
            mean=result.x[part],
            std=np.sqrt(np.diagonal(result.P[part], axis1=-2, axis2=-1)),
            log_likelihood=result.log_likelihood[part],
            switch=None if result.switch_mean is None else result.switch_mean[part],
            density=NormalMixture.of(result, part),
        )

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return the filter's ``step``."""
        step: Callable[[FloatArray], object] = self.filter.step
        return step


def learn_fuzzy(part: LearningPart, law: str) -> Learned:
    """Learn a fuzzy model with a law of this family."""
    return LearnedSwitching(part.fuzzy(law), part.n_nodes, f"law: {law}")


def learn_hard(part: LearningPart, n_switches: int | None = None, *, n_regimes: int | None = None) -> Learned:
    """Learn a model of so many hard regimes (two names of one number)."""
    return LearnedSwitching(part.hard(n_switches, n_regimes=n_regimes), part.n_nodes)


def learn_chosen_law(part: LearningPart) -> Learned:
    """Learn a fuzzy model with the law whose filter gives held-out states the best log score.

    Each law is learned before each of several rolling blocks of the part and judged on all of them
    (`choose`); the winner then learns on all rows.  The likelihood could not decide: the state has no
    feedback from the observations, so a better likelihood may well go with a worse filter.  A
    given switch needs no law but the first.

    Raises
    ------
    FuzzykfError
        If no law can be learned.
    """
    if part.r is not None:
        return learn_fuzzy(part, TRIED[0])

    def trial(rows: LearningPart, law: str) -> Learned:
        cheap = replace(rows, tolerance=max(rows.tolerance, TRIAL_TOLERANCE))
        return LearnedSwitching(cheap.fuzzy(law), rows.n_nodes)

    def tell(law: str) -> None:
        if law != TRIED[0]:
            part.progress(f"trying the law {law}")

    try:
        found = choose(part, TRIED, trial, by="log score", tell=tell)
    except FuzzykfError as error:
        raise FuzzykfError(f"no law of the switch could be learned ({error})") from error
    part.progress(f"learning with the law {found.best}")
    learned = LearnedSwitching(part.fuzzy(found.best), part.n_nodes, found.told("law"))
    learned.choice = found.best
    return learned


def growth_notes(system: SwitchingSystem) -> list[str]:
    """Say whether the error of the state grows while the switch stays where it is.

    The observation does not depend on the state before it, so the filter of the state has no
    feedback: what it errs is multiplied by Axx at each step.  A learned Axx above one makes it
    drift for as long as the switch is believed to stay.

    Parameters
    ----------
    system : SwitchingSystem

    Returns
    -------
    list of str
        Empty, or one sentence about the worst node.
    """
    n_nodes = len(system.chain.nodes)
    stay = system.pair_tables(0).pairs.Axx[np.arange(n_nodes), np.arange(n_nodes)]
    growth = np.abs(np.linalg.eigvals(stay)).max(axis=-1)
    worst = int(np.argmax(growth))
    if growth[worst] < 1.0:
        return []
    return [
        f"while the switch stays at {system.chain.describe(worst)}, the error of the state grows by "
        f"{growth[worst] - 1.0:.2g} of itself in a step, and no observation corrects it"
    ]


def hard_candidate(n_switches: int | None = None, *, n_regimes: int | None = None) -> Candidate:
    """Return the candidate of so many hard regimes (two names of one number)."""
    K = given_regimes(n_switches, n_regimes)
    title = "CGOMSMFilter" if K == 2 else f"CGOMSMFilter, K = {K}"
    return Candidate(f"hard{K}", partial(learn_hard, n_switches=K), title=title)


CANDIDATES = (
    *map(hard_candidate, (1, 2, 3)),
    *(Candidate(law, partial(learn_fuzzy, law=law), title=f"OFSRFilter, {law}") for law in LAWS),
    Candidate("fuzzy", learn_chosen_law, pieces=len(TRIED) + 1, title="OFSRFilter"),
)

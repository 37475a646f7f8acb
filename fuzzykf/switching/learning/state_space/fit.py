"""From series of observations to the parameters of a switching state-space model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.estimation.result import maximum_likelihood
from fuzzykf.gaussian import as_count, as_flag
from fuzzykf.progress import progress_bar
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.learning.notes import SCARCE, no_shorter, one_name
from fuzzykf.switching.learning.state_space.data import labels_read, read_data
from fuzzykf.switching.learning.state_space.problem import SpaceProblem, read_free_numbers
from fuzzykf.texts import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.estimation.result import LikelihoodFit, LocalMaximum
    from fuzzykf.switching.state_space.model import SwitchingStateSpace

__all__ = ["fit_state_space"]

#: Maxima are those of exchanged classes if log-likelihoods, and relative to their size numbers, are so close.
EXCHANGED = 1e-3


def fit_state_space(
    model: SwitchingStateSpace,
    zs: Any,
    xs: Any = None,
    *,
    free: Any,
    us: Any = None,
    n_nodes: int | None = None,
    progress: bool | None = None,
    **options: Any,
) -> LikelihoodFit[SwitchingStateSpace]:
    """See `SwitchingStateSpace.fit`."""
    if progress is not None:
        progress = as_flag("progress", progress)
    nodes = model._nodes(None if n_nodes is None else as_count("n_nodes", n_nodes, 0))
    if not isinstance(model.law, SwitchChain):
        model.law.discretize(nodes)  # the error that says how many there can be
    model = model._with_labels(labels_read(model, zs, xs))
    data = read_data(model, zs, xs, us)
    problem = SpaceProblem(model, nodes, data, read_free_numbers(model, free, nodes, data))
    problem.check_start()
    with progress_bar(None, progress) as tell:
        iterations = count(1)
        return _learned(problem, tick=lambda: tell(f"learning, {next(iterations)} iterations"), **options)


def _learned(problem: SpaceProblem, **options: Any) -> LikelihoodFit[SwitchingStateSpace]:
    found = maximum_likelihood(
        problem.log_likelihood,
        problem.free,
        problem.model_of,
        problem.data.n_observations,
        is_known=_is_exchanged,
        **options,
    )
    visits, law = problem.visits(found.numbers), found.model.law
    notes = one_name(found.model.labels) + _unvisited(visits) + _exchanged(found.maxima)
    if "law" in problem.free.blocks and not isinstance(law, SwitchChain):
        notes += no_shorter(law, problem.n_nodes)
    kept: dict[str, Any] = {name: options[name] for name in ("max_iter", "tolerance") if name in options}
    return replace(
        found,
        warnings=tuple(dict.fromkeys((*found.warnings, *notes))),
        occupancy=visits / visits.sum(),
        replicate=_Replicate(problem, found.numbers, kept),
    )


def _unvisited(visits: FloatArray) -> list[str]:
    """Say in which classes the switch hardly is."""
    return [
        f"class {k}: rarely visited, in {steps:.2g} of {counted(round(visits.sum()), 'step')} "
        f"(expected at least {SCARCE:g}); its parameters are poorly determined"
        for k, steps in enumerate(visits.tolist())
        if steps < SCARCE
    ]


def _exchanged(maxima: Sequence[LocalMaximum]) -> list[str]:
    """Say which other maxima are the best one with its classes in another order."""
    number = sum(_is_exchanged(one, maxima[0]) for one in maxima[1:])
    if not number:
        return []
    which = "another maximum has" if number == 1 else f"{number} other maxima have"
    return [f"{which} the same numbers in another order: its classes are exchanged, and it tells nothing new"]


def _is_exchanged(one: LocalMaximum, best: LocalMaximum) -> bool:
    if one.log_likelihood < best.log_likelihood - EXCHANGED:
        return False
    pairs = zip(sorted(one.estimates.values()), sorted(best.estimates.values()), strict=True)
    return all(abs(a - b) <= EXCHANGED * abs(b) for a, b in pairs)


@dataclass(frozen=True)
class _Replicate:
    """Draws series from what was learned, and learns from them; a class, since closures cannot be pickled."""

    problem: SpaceProblem
    numbers: FloatArray
    options: Mapping[str, Any]

    def __call__(self, rng: np.random.Generator) -> LikelihoodFit[SwitchingStateSpace]:
        problem = self.problem.simulated(self.numbers, rng)
        begin = np.where(np.isneginf(self.numbers), problem.free.start, self.numbers)
        return _learned(problem, prepare=partial(_instead, begin), **self.options)


def _instead(begin: FloatArray, _: FloatArray) -> FloatArray:
    return begin

"""Switching filters with the clock as an input and with features of the window, alone and as a pool."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.clock import made_inputs, names_of_clock
from fuzzykf.comparison.candidates import WARM_UP, Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.filter_trained import training_told
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.errors import FuzzykfError
from fuzzykf.switching import FilterPool, WindowFeatures
from fuzzykf.switching.learning.window import LAGS
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Self

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart
    from fuzzykf.comparison.clock import Clock

__all__ = [
    "CANDIDATES",
    "MAPS",
    "LearnedWithInputs",
    "clock_columns",
    "learn_chosen_map",
    "learn_pool_of_maps",
]

#: The maps of the members of a pool.
MAPS: Mapping[str, WindowFeatures] = {
    "lags": WindowFeatures(**LAGS),
    "lags and hinges": WindowFeatures(**LAGS, hinges=3),
    "lags, hinges and products": WindowFeatures(**LAGS, hinges=3, products=True),
}

#: Fewer rows to learn on for each observation that a map looks back at, and it does not look back: a window
#: has to be wholly observed, and what is left has to teach the coefficients.
ROWS_PER_LAG = 20

#: Of the day, sine and cosine of so many.
HARMONICS = 3


def clock_columns(clock: Clock | None) -> FloatArray | None:
    """Return what a clock tells a model, (n, k); None without a clock."""
    if clock is None:
        return None
    workday = np.asarray(clock.workday, dtype=np.float64)
    return made_inputs(names_of_clock(HARMONICS, "workday"), clock.times, {"workday": workday})


class _Known(NamedTuple):
    """What is known of rows at all times."""

    clock: Clock | None
    inputs: FloatArray | None

    def columns(self) -> FloatArray | None:
        """Return it as inputs (n, k); None where there are none."""
        parts = [one for one in (clock_columns(self.clock), self.inputs) if one is not None]
        n = min((len(one) for one in parts), default=0)
        return np.concatenate([one[:n] for one in parts], axis=1) if parts else None

    def latest(self, n: int) -> _Known:
        """Return what is known of the last rows."""
        parts: Any = (None if one is None else one[-n:] for one in self)
        return _Known(*parts)


class _Columns:
    """From what is known of rows to inputs: those columns that vary in the rows to learn on.

    Parameters
    ----------
    part : LearningPart
    """

    def __init__(self, part: LearningPart) -> None:
        columns = _Known(part.clock, part.inputs).columns()
        self._varies = np.empty(0, dtype=bool) if columns is None else np.ptp(columns, axis=0) > 0.0

    def of(self, known: _Known) -> FloatArray | None:
        """Return inputs (n, k); None where there are none, or not all of them."""
        found = known.columns()
        if found is None or not self._varies.size or found.shape[1] != self._varies.size:
            return None
        return found[:, self._varies]


class LearnedWithInputs(Learned):
    """Learned models with inputs and features, and their filter: that of the one, or a pool of them.

    Parameters
    ----------
    fits : mapping of str to FitResult
        By the name of what they were learned with.
    part : LearningPart
        The rows that were learned on, which end where the next ones begin.
    description : str
    """

    feedback: bool | None = False

    def __init__(
        self,
        fits: Mapping[str, Any],
        part: LearningPart,
        description: str = "",
    ) -> None:
        self.fits, self.description = dict(fits), description
        filters = [fit.model.filter() for fit in fits.values()]
        self.filter = filters[0] if len(filters) == 1 else FilterPool(filters)
        lead = "" if len(filters) == 1 else "{name}: "
        self.notes = tuple(
            lead.format(name=name) + note for name, fit in fits.items() for note in fit.warnings
        )
        self._columns = _Columns(part)
        self._before = _Known(part.clock, part.inputs).latest(WARM_UP)
        self._now = _Known(None, None)

    def at(self, clock: Clock | None) -> Self:
        """Return the same for rows of a clock."""
        other = copy(self)
        other._now = self._now._replace(clock=clock)
        return other

    def told(self, inputs: FloatArray | None) -> Self:
        """Return the same for rows with inputs."""
        other = copy(self)
        other._now = self._now._replace(inputs=inputs)
        return other

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Filter, beginning a little earlier; the density is the mixture over the nodes of all members.

        Raises
        ------
        FuzzykfError
            If it has learned with times, and those of these rows are not told (`at`).
        """
        warm = before[-WARM_UP:]
        told: Any = self._told(len(warm), len(zs))
        result = self.filter.filter(np.concatenate([warm, zs]), keep_nodes=True, **told)
        part = slice(len(warm), None)
        return Estimates(
            mean=result.x[part],
            std=np.sqrt(np.diagonal(result.P[part], axis1=-2, axis2=-1)),
            log_likelihood=result.log_likelihood[part],
            density=NormalMixture.of(result, part),
        )

    def _told(self, n_before: int, n: int) -> dict[str, FloatArray]:
        """Return inputs of the rows before and of those to restore, as arguments of `filter`."""
        before = self._columns.of(self._before)
        if before is None:
            return {}
        now = self._columns.of(self._now)
        if now is None or len(now) != n or len(before) < n_before:
            got = 0 if now is None else len(now)
            raise FuzzykfError(
                f"the model has learned with times or inputs, and needs those of the {n} rows to restore: "
                f"got {got}"
            )
        return {"us": np.concatenate([before[len(before) - n_before :], now])}

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return the filter's ``step``, with the inputs of the first row to restore."""
        now = self._columns.of(self._now)
        told = {} if now is None else {"u": now[0]}
        return lambda z: self.filter.step(z, **told)


def learn_chosen_map(part: LearningPart) -> Learned:
    """Learn two hard regimes for the filter, with the map of the window that scores best on states kept back.

    Of `WindowFeatures` "auto" tries a few; the clock is an input where times are known.
    """
    us = _Columns(part).of(_Known(part.clock, part.inputs))
    fit = part.hard(n_regimes=2, objective="filter", inputs=us, features="auto")
    form = fit.model.form
    name = repr(form.features) if hasattr(form, "features") else "no features"
    told = f"{name} (chosen from {len(fit.score_of_features)} maps); {training_told(fit)}"
    learned = LearnedWithInputs({"": fit}, part, told)
    learned.choice = name
    return learned


def _maps_for(n: int) -> dict[str, WindowFeatures]:
    """Return the maps that so many rows can teach, by what they have."""
    found = {}
    for name, one in MAPS.items():
        if n >= ROWS_PER_LAG * one.n_past:
            found[name] = one
            continue
        left = [part for part, has in {"hinges": one.n_hinges, "products": one.products}.items() if has]
        found[listed(left) or "the latest observation"] = WindowFeatures(
            hinges=one.n_hinges, products=one.products
        )
    return found


def learn_pool_of_maps(part: LearningPart) -> Learned:
    """Learn two hard regimes for the filter with each of `MAPS`, and pool the filters.

    Nothing is chosen: which map is the right one, a few months of data do not tell.
    """
    us = _Columns(part).of(_Known(part.clock, part.inputs))
    fits: dict[str, Any] = {}
    for name, features in _maps_for(len(part)).items():
        if features.products and us is None:
            continue
        if fits:
            part.progress(f"learning with {name}, a member of the pool")
        given = None if us is None and features.is_trivial else features
        fits[name] = part.hard(n_regimes=2, objective="filter", inputs=us, features=given)
    description = "; ".join(f"{name}: {training_told(fit)}" for name, fit in fits.items())
    return LearnedWithInputs(fits, part, description)


CANDIDATES = (
    Candidate("hard2-inputs", learn_chosen_map, title="CGOMSMFilter, clock and features"),
    Candidate("pool-inputs", learn_pool_of_maps, pieces=len(MAPS), title="FilterPool, clock and features"),
)

"""What every method that is compared has in common: it learns on one part and restores another.

A module of this folder holds a family of candidates; `registry` knows them all by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.density import NormalMixture, normal_interval
from fuzzykf.errors import FuzzykfError
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable
    from typing import Self

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.clock import Clock
    from fuzzykf.results import FitResult
    from fuzzykf.switching import CGOFMSModel, CGOMSModel

__all__ = [
    "WARM_UP",
    "Candidate",
    "Estimates",
    "Learned",
    "LearningPart",
    "Restoration",
]

#: A filter is run over so many observations before those that it is judged on, so that it
#: does not matter where it starts.
WARM_UP = 100


def _quiet(_: str) -> None:
    """Tell nobody."""


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class LearningPart:
    """Data to learn on, and how long the learning of a hidden switch may take.

    Attributes
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        States and observations, NaN where missing.
    r : ndarray, shape (n,), or None
        The switch, if it is given; else it is learned as well.
    clock : Clock or None
        Hours and days of the rows, if they are known.
    inputs : ndarray, shape (n, k), or None
        What else is known at all times, of later rows as well.
    n_nodes : int
        Nodes of a fuzzy switch between 0 and 1; time grows with the steps between them.
    max_iter : int
        Largest number of iterations.
    tolerance : float
        Gain in log-likelihood per observation at which to stop; the error of the filter
        settles long before the likelihood does.
    progress : callable
        Is told the name of each further piece of work before it begins.
    """

    x: FloatArray
    y: FloatArray
    r: FloatArray | None = None
    clock: Clock | None = None
    inputs: FloatArray | None = None
    n_nodes: int = 5
    max_iter: int = 200
    tolerance: float = 1e-5
    progress: Callable[[str], None] = _quiet
    _learned: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.x)

    def first(self, n: int) -> LearningPart:
        """Return the first ``n`` rows as a part of their own."""
        r = None if self.r is None else self.r[:n]
        clock = None if self.clock is None else self.clock[:n]
        inputs = None if self.inputs is None else self.inputs[:n]
        return replace(self, x=self.x[:n], y=self.y[:n], r=r, clock=clock, inputs=inputs, _learned={})

    def once(self, key: Hashable, learn: Callable[[], Any]) -> Any:
        """Return what ``learn`` returns; a second call with this key returns the same, without learning."""
        if key not in self._learned:
            self._learned[key] = learn()
        return self._learned[key]

    def fuzzy(
        self, law: str, *, state_feedback: bool = True, objective: str = "joint"
    ) -> FitResult[CGOFMSModel]:
        """Learn a fuzzy model with a law of this family; without `state_feedback` its Axx is zero.

        A second call returns the same.  For the objective "filter" a switch is hidden, also where it is
        given.
        """
        from fuzzykf.switching import CGOFMSModel

        r = self.r if objective == "joint" else None
        options: Any = {"law": law, "n_nodes": self.n_nodes}
        options |= {"state_feedback": state_feedback, "objective": objective} | self._effort
        fit: FitResult[CGOFMSModel] = self.once(
            ("fuzzy", *sorted(options.items())),
            lambda: _numerical(lambda: CGOFMSModel.fit(self.x, self.y, r, **options)),
        )
        return fit

    def hard(
        self,
        n_switches: int | None = None,
        *,
        n_regimes: int | None = None,
        state_feedback: bool = True,
        objective: str = "joint",
        inputs: FloatArray | None = None,
        features: Any = None,
    ) -> FitResult[CGOMSModel]:
        """Learn a model of so many hard regimes (two names of one number); a second call returns the same.

        A given switch, of two regimes, is rounded; for the objective "filter" it is hidden.  Without
        `state_feedback` Axx is zero.  Inputs (n, k) and features are as in `CGOMSModel.fit`.
        """
        from fuzzykf.switching import CGOMSModel
        from fuzzykf.switching.models.base import given_regimes

        K = given_regimes(n_switches, n_regimes)
        told = self.r if K == 2 and objective == "joint" else None
        r = None if told is None else (told >= 0.5).astype(np.float64)
        options: Any = {"n_regimes": K, "state_feedback": state_feedback, "objective": objective}
        options |= self._effort
        fit: FitResult[CGOMSModel] = self.once(
            ("hard", *sorted(options.items()), repr(features), inputs is None),
            lambda: _numerical(
                lambda: CGOMSModel.fit(self.x, self.y, r, inputs=inputs, features=features, **options)
            ),
        )
        return fit

    @property
    def _effort(self) -> dict[str, Any]:
        quiet = {"progress": False}  # the comparison has a bar of its own
        return {"form": "regression", "max_iter": self.max_iter, "tolerance": self.tolerance} | quiet


def _numerical(fit: Callable[[], Any]) -> Any:
    """Turn a breakdown of linear algebra, which data can cause, into an error that says so."""
    try:
        return fit()
    except np.linalg.LinAlgError as error:
        raise FuzzykfError(
            f"the likelihood has no maximum that could be found on these data ({error}): a regime, or a "
            "step between two of them, is so rare that its noise vanishes; try fewer regimes"
        ) from error


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """What a method says of a stretch of observations, each from it and the earlier ones.

    Attributes
    ----------
    mean, std : ndarray, shape (n, m)
        Estimate of the state, and the standard deviation that the method claims.
    log_likelihood : ndarray, shape (n,), or None
        Logarithm of the density of each observation given the earlier ones; None from a
        method that has no law of the observation.
    switch : ndarray, shape (n,), or None
        Posterior mean of the switch; there is none between more than two classes.
    density : NormalMixture or None
        The density of the state, where the method claims more than mean and standard deviation; then log
        score and coverage are those of it.  None: a normal law, of independent components.
    """

    mean: FloatArray
    std: FloatArray
    log_likelihood: FloatArray | None = None
    switch: FloatArray | None = None
    density: NormalMixture | None = None

    def interval(self, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the central interval of each component, of the shape of `mean`.

        Raises
        ------
        ParameterError
            If ``level`` is outside ]0, 1[.
        """
        if self.density is None:
            return normal_interval(self.mean, self.std, level)
        lower, upper = self.density.interval(level)
        return lower.reshape(self.mean.shape), upper.reshape(self.mean.shape)

    def as_mixture(self) -> NormalMixture:
        """Return the density, whatever is claimed."""
        return NormalMixture.normal(self.mean, self.std) if self.density is None else self.density


@reprs("description", "notes")
class Learned(ABC):
    """What a method has learned; it sees no state any more.

    Attributes
    ----------
    notes : tuple of str
        What a reader should know before trusting it.
    description : str
        What was chosen while learning, in words, and how; may be empty.
    choice : str
        What was chosen, in a word: a law, a number of lags; empty where nothing was.
    feedback : bool or None
        Whether each observation corrects the state that went before it; None where there are no dynamics.
    """

    notes: tuple[str, ...] = ()
    description: str = ""
    choice: str = ""
    feedback: bool | None = None

    def at(self, clock: Clock | None) -> Self:
        """Return this for rows of a clock: those that are restored next, one for each row.

        Who knows no times ignores them, and is the same.

        Parameters
        ----------
        clock : Clock or None
            None where times are not known.
        """
        return self

    def told(self, inputs: FloatArray | None) -> Self:
        """Return this for rows of which inputs (n, k) are known: those that are restored next.

        Who has no use for them ignores them, and is the same.
        """
        return self

    @abstractmethod
    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Estimate the states of ``zs``, shape (n, q), from it alone.

        Parameters
        ----------
        before : ndarray, shape (k, q)
            The observations just before; k may be zero.
        zs : ndarray, shape (n, q)
            NaN where missing.
        """

    @abstractmethod
    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that takes the next observation, as in real time."""


@dataclass(frozen=True, eq=False)
class Named:
    """Something of a candidate: its name, and what readers of tables and pictures know it as.

    Attributes
    ----------
    name : str
    title : str
        The name, unless said otherwise.
    """

    name: str
    title: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        """Let the name be the title where there is no other."""
        object.__setattr__(self, "title", self.title or self.name)


@reprs()
@dataclass(frozen=True)
class Candidate(Named):
    """A method by name.

    Attributes
    ----------
    name : str
    learn : callable
        From a `LearningPart` to a `Learned`.  It must not look elsewhere.
    pieces : int
        Of work, as it tells them to ``LearningPart.progress``; the first is told by the caller.
    title : str
        What tables and pictures of `compare` call it; the name, unless said otherwise.
    """

    learn: Callable[[LearningPart], Learned]
    pieces: int = 1


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class Restoration(Estimates, Named):
    """What one candidate says of a held-out part.

    Attributes
    ----------
    name, title : str
        Of the candidate; the name is the title unless said otherwise.
    mean, std : ndarray, shape (n,) or (n, m)
        Its estimate of the state, and the standard deviation that it claims.
    log_likelihood : ndarray, shape (n,), or None
        Logarithm of the density of each observation given the earlier ones.
    switch : ndarray, shape (n,), or None
        Posterior mean of the switch.
    density : NormalMixture or None
        The density of the state, where it claims more than these two.
    notes : tuple of str
        What a reader should know before trusting the method.
    description : str
        What was chosen while learning, in words; may be empty.  Over several folds, that of the last one.
    choices : tuple of str
        What was chosen, in a word, in each fold.
    learned : Learned or None
        What it has learned, if it is known; over several folds, in the last one.
    seconds, microseconds : float
        Time of learning, and of one step; NaN if it was not measured.  What an earlier candidate has learned
        on the same rows is not learned again.
    """

    notes: tuple[str, ...] = ()
    description: str = ""
    choices: tuple[str, ...] = ()
    learned: Learned | None = None
    seconds: float = float("nan")
    microseconds: float = float("nan")

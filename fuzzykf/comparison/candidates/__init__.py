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
    """Do nothing with the name of a piece of work."""


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class LearningPart:
    """Training data, and settings of the search for a hidden switch.

    Attributes
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        States and observations, NaN where missing.
    r : ndarray, shape (n,), or None
        The switch, if it is given; otherwise it is learned.
    clock : Clock or None
        Times and working days of the rows, if known.
    inputs : ndarray, shape (n, k), or None
        Other known variables, also for later rows.
    n_nodes : int
        Number of nodes of a fuzzy switch between 0 and 1.
    max_iter : int
        Largest number of iterations.
    tolerance : float
        Stop when an iteration gains less than this in log-likelihood per observation.
    progress : callable
        Called with the name of each further piece of work before it starts.
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
        """Return the first ``n`` rows as training data.

        Parameters
        ----------
        n : int

        Returns
        -------
        LearningPart
        """
        r = None if self.r is None else self.r[:n]
        clock = None if self.clock is None else self.clock[:n]
        inputs = None if self.inputs is None else self.inputs[:n]
        return replace(self, x=self.x[:n], y=self.y[:n], r=r, clock=clock, inputs=inputs, _learned={})

    def once(self, key: Hashable, learn: Callable[[], Any]) -> Any:
        """Return ``learn()``; a second call with the same key returns the stored result.

        Parameters
        ----------
        key : hashable
        learn : callable

        Returns
        -------
        object
        """
        if key not in self._learned:
            self._learned[key] = learn()
        return self._learned[key]

    def fuzzy(
        self, law: str, *, state_feedback: bool = True, objective: str = "joint"
    ) -> FitResult[CGOFMSModel]:
        """Learn a fuzzy model; a second call returns the stored result.

        With the objective "filter", a given switch is ignored and learned as hidden.

        Parameters
        ----------
        law : str
            Family of the law.
        state_feedback : bool
        objective : {"joint", "filter"}
            As in `CGOFMSModel.fit`.

        Returns
        -------
        FitResult
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
        """Learn a model with hard regimes; a second call returns the stored result.

        A given switch between two regimes is rounded.  With the objective "filter", it is ignored and learned
        as hidden.

        Parameters
        ----------
        n_switches, n_regimes : int
            Number of regimes, under either name.
        state_feedback, objective, inputs, features
            As in `CGOMSModel.fit`.

        Returns
        -------
        FitResult
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
    """Filtered estimates of a method for consecutive observations.

    Attributes
    ----------
    mean, std : ndarray, shape (n, m)
        Estimate of the state, and its standard deviation.
    log_likelihood : ndarray, shape (n,), or None
        Log-density of each observation given the earlier ones; None if the method defines none.
    switch : ndarray, shape (n,), or None
        Posterior mean of the switch; None for more than two classes.
    density : NormalMixture or None
        Density of the state, for log score and coverage.  None means normal with independent components.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import Estimates
    >>> lower, upper = Estimates(mean=np.zeros((1, 1)), std=np.ones((1, 1))).interval(0.95)
    >>> upper.round(2)
    array([[1.96]])
    """

    mean: FloatArray
    std: FloatArray
    log_likelihood: FloatArray | None = None
    switch: FloatArray | None = None
    density: NormalMixture | None = None

    def interval(self, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Return the central interval of each component.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        lower, upper : ndarray, shape (n, m)

        Raises
        ------
        ParameterError
            If ``level`` is not between 0 and 1.
        """
        if self.density is None:
            return normal_interval(self.mean, self.std, level)
        lower, upper = self.density.interval(level)
        return lower.reshape(self.mean.shape), upper.reshape(self.mean.shape)

    def as_mixture(self) -> NormalMixture:
        """Return the density as a mixture.

        Returns
        -------
        NormalMixture
        """
        return NormalMixture.normal(self.mean, self.std) if self.density is None else self.density


@reprs("description", "notes")
class Learned(ABC):
    """A trained method, which estimates states from observations.

    Attributes
    ----------
    notes : tuple of str
        Warnings.
    description : str
        Choices made in training, in words; may be empty.
    choice : str
        The choice in a word, such as a law or a number of lags; may be empty.
    feedback : bool or None
        Whether each observation corrects the estimated state; None without dynamics.
    """

    notes: tuple[str, ...] = ()
    description: str = ""
    choice: str = ""
    feedback: bool | None = None

    def at(self, clock: Clock | None) -> Self:
        """Return the method for rows with given times; methods that do not use times return themselves.

        Parameters
        ----------
        clock : Clock or None
            Times of the rows to estimate next; None if unknown.

        Returns
        -------
        Learned
        """
        return self

    def told(self, inputs: FloatArray | None) -> Self:
        """Return the method for rows with given inputs; methods that do not use inputs return themselves.

        Parameters
        ----------
        inputs : ndarray, shape (n, k), or None
            Inputs of the rows to estimate next.

        Returns
        -------
        Learned
        """
        return self

    @abstractmethod
    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Estimate the states of test rows from their observations.

        Parameters
        ----------
        before : ndarray, shape (k, q)
            Observations immediately before; k may be zero.
        zs : ndarray, shape (n, q)
            Observations; NaN where missing.

        Returns
        -------
        Estimates
        """

    @abstractmethod
    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that processes one observation, for timing.

        Returns
        -------
        callable
        """


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
    """A method that can be compared, with its name.

    Attributes
    ----------
    name : str
        Name of the method.
    learn : callable
        Maps a `LearningPart` to a `Learned`.  It must not use other data.
    pieces : int
        Number of pieces of work, for the progress bar.
    title : str
        Title in tables and plots of `compare`; by default the name.
    """

    learn: Callable[[LearningPart], Learned]
    pieces: int = 1


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class Restoration(Estimates, Named):
    """Estimates of one candidate for the test rows.

    Attributes
    ----------
    name, title : str
        Name and title of the candidate.
    mean, std : ndarray, shape (n,) or (n, m)
        Estimate of the state, and its standard deviation.
    log_likelihood : ndarray, shape (n,), or None
        Log-density of each observation given the earlier ones.
    switch : ndarray, shape (n,), or None
        Posterior mean of the switch.
    density : NormalMixture or None
        Density of the state, if it is not normal.
    notes : tuple of str
        Warnings.
    description : str
        Choices made in training, in words; for several folds, those of the last one.
    choices : tuple of str
        The choice in a word, for each fold.
    learned : Learned or None
        The trained method; for several folds, of the last one.
    seconds, microseconds : float
        Time of training, and of one step; NaN if not measured.  Models shared with an earlier candidate are
        not trained again.
    """

    notes: tuple[str, ...] = ()
    description: str = ""
    choices: tuple[str, ...] = ()
    learned: Learned | None = None
    seconds: float = float("nan")
    microseconds: float = float("nan")

"""Gradient boosting on the latest observations and the clock: trees of scikit-learn, no dynamics."""

from __future__ import annotations

from copy import copy
from functools import cache
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.choice import choose
from fuzzykf.comparison.candidates.regression import LAGS, lagged, possible_lags
from fuzzykf.errors import FuzzykfError, MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Self

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart
    from fuzzykf.comparison.clock import Clock

__all__ = ["CANDIDATES", "LEAST_ROWS", "LagBoosting", "check_installed", "learn_boosting"]

#: Fewest rows to learn on: two leaves of the size that scikit-learn asks for by default.
LEAST_ROWS = 40

#: Decides nothing but the rows that scikit-learn sets aside, of more than 10,000, to stop in time.
RANDOM_STATE = 0


@cache
def _library() -> tuple[Any, Any]:
    """Return scikit-learn's regressor, and what holds its threads; it is the one place that imports them."""
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor
        from threadpoolctl import ThreadpoolController
    except ImportError as error:
        raise MissingDependencyError(
            "the candidate 'boosting' needs scikit-learn: pip install 'fuzzykf[compare]'"
        ) from error
    return HistGradientBoostingRegressor, ThreadpoolController()


def check_installed() -> None:
    """Refuse, before any work is done, to go on without scikit-learn.

    Raises
    ------
    MissingDependencyError
    """
    _library()


def _one_thread() -> Any:
    """Hold scikit-learn to one thread: on a busy machine more are many times slower than one."""
    return _library()[1].limit(limits=1, user_api="openmp")


class LagBoosting(Learned):
    """Trees that are grown on the error of those before, from the observation, earlier ones and the clock.

    Each component of the state has trees of its own.  A missing observation is a value like
    others to a tree, and is not replaced.

    Parameters
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        The learning part.  Rows in which a component of x is missing do not count for it.
    lags : int
        Number of earlier observations.
    std : ndarray, shape (m,)
        The standard deviation that it claims.  Errors on the rows learned on would be too
        small, so it has to come from others.
    clock : Clock, optional
        Hour, day of the week and kind of day of each row; then those of the rows to restore are needed
        too (`at`).
    inputs : ndarray, shape (n, k), optional
        Likewise (`told`).

    Raises
    ------
    MissingDependencyError
        If scikit-learn is not installed.
    FuzzykfError
        If there are fewer rows than two leaves need.

    Notes
    -----
    It has no law of the observation, and so no likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> y = np.random.default_rng(0).normal(size=(500, 1))
    >>> learned = LagBoosting(np.sign(y), y, lags=0, std=np.ones(1))
    >>> learned.restore(y[:0], np.array([[-1.0], [1.0]])).mean.round(1)
    array([[-1.],
           [ 1.]])
    """

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        lags: int,
        std: FloatArray,
        clock: Clock | None = None,
        inputs: FloatArray | None = None,
    ) -> None:
        self.lags, self.size, self.std = lags, y.shape[1], std
        self.has_clock, self._clock = clock is not None, None if clock is None else clock[lags:]
        self.n_inputs = 0 if inputs is None else inputs.shape[1]
        self._inputs = None if inputs is None else inputs[lags:]
        design, target = self._design(lagged(y, lags)), x[lags:]
        self._trees = []
        for k, column in enumerate(target.T):
            used = np.isfinite(column)
            if (rows := int(used.sum())) < LEAST_ROWS:
                raise FuzzykfError(
                    f"boosting needs {LEAST_ROWS} rows at least in which component {k} of the state is "
                    f"known, and has {rows}"
                )
            trees = _library()[0](random_state=RANDOM_STATE)  # as the library has it, but for the seed
            with _one_thread():
                self._trees.append(trees.fit(design[used], column[used]))
        self._clock = self._inputs = None

    def at(self, clock: Clock | None) -> Self:
        """Return the same trees for rows of a clock."""
        other = copy(self)
        other._clock = clock
        return other

    def told(self, inputs: FloatArray | None) -> Self:
        """Return the same trees for rows with inputs."""
        other = copy(self)
        other._inputs = inputs
        return other

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Apply the trees; the observations before serve as lags, and are missing before the first.

        Raises
        ------
        FuzzykfError
            If the trees know the time of day, and that of these rows is not told (`at`).
        """
        unknown = np.full((self.lags, self.size), np.nan)
        known = np.concatenate([unknown, before, zs])
        mean = self._mean(self._design(lagged(known[len(known) - len(zs) - self.lags :], self.lags)))
        return Estimates(mean=mean, std=np.tile(self.std, (len(zs), 1)))

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that keeps the latest observations and applies the trees.

        Calls are for the rows of the clock one after the other, and begin anew after the last.
        """
        size = self.size * (1 + self.lags)
        beside = self._beside()
        row = np.full((1, size + beside.shape[1]), np.nan)
        rows = cycle(beside)

        def step(z: FloatArray) -> FloatArray:
            row[0, self.size : size] = row[0, : size - self.size].copy()
            row[0, : self.size] = z
            if beside.shape[1]:
                row[0, size:] = next(rows)
            mean: FloatArray = self._mean(row)[0]
            return mean

        return step

    def _design(self, columns: FloatArray) -> FloatArray:
        beside = self._beside()
        if not beside.shape[1]:
            return columns
        if len(beside) != len(columns):
            raise FuzzykfError(
                f"boosting has learned with times or inputs, and needs those of the {len(columns)} rows to "
                f"restore: got {len(beside)}"
            )
        return np.concatenate([columns, beside], axis=1)

    def _beside(self) -> FloatArray:
        """Return what is known of rows beside observations: hands of the clock, and inputs."""
        parts = [self._hands(self._clock)] if self.has_clock else []
        if self.n_inputs:
            parts.append(np.empty((0, self.n_inputs)) if self._inputs is None else self._inputs)
        n = min((len(one) for one in parts), default=0)
        return np.concatenate([one[:n] for one in parts], axis=1) if parts else np.empty((0, 0))

    @staticmethod
    def _hands(clock: Clock | None) -> FloatArray:
        """Return hour, day of the week, and whether it is a working day, (n, 3)."""
        if clock is None:
            return np.empty((0, 3))
        return np.column_stack([clock.hour, clock.weekday, clock.workday])

    def _mean(self, design: FloatArray) -> FloatArray:
        if not len(design):  # which scikit-learn refuses
            return np.empty((0, len(self._trees)))
        with _one_thread():
            mean: FloatArray = np.column_stack([trees.predict(design) for trees in self._trees])
        return mean


def learn_boosting(part: LearningPart, lags: Sequence[int] = LAGS) -> Learned:
    """Learn trees, with the number of lags of least squared error on rolling blocks.

    It is chosen as `learn_regression` chooses it.  The standard deviation is that of the errors on the
    same blocks, each of trees that were grown before it; then all rows are learned on.  Where times are
    known, hour, day of the week and kind of day are seen as well.

    Parameters
    ----------
    part : LearningPart
    lags : sequence of int
        Numbers to choose from.

    Raises
    ------
    MissingDependencyError
        If scikit-learn is not installed.
    FuzzykfError
        If there are too few rows, or a component of the state is missing in all blocks.
    """
    learned: Learned = part.once(("boosting", *lags), lambda: _learn_boosting(part, lags))
    return learned


def _learn_boosting(part: LearningPart, lags: Sequence[int]) -> Learned:
    unknown = np.full(part.x.shape[1], np.nan)
    found = choose(
        part,
        possible_lags(len(part), lags, part.y.shape[1]),
        lambda rows, k: LagBoosting(rows.x, rows.y, k, unknown, rows.clock, rows.inputs),
        by="squared error",
    )
    missing = np.isnan(found.errors).all(axis=0)
    if missing.any():
        raise FuzzykfError(
            f"component {int(np.argmax(missing))} of the state is missing in all of the last "
            f"{len(found.errors)} rows, on which boosting is judged"
        )
    std = np.sqrt(np.nanmean(found.errors**2, axis=0))
    learned = LagBoosting(part.x, part.y, found.best, std, part.clock, part.inputs)
    if len(lags) > 1:
        learned.choice, learned.description = str(found.best), found.told("lags")
    return learned


CANDIDATES = (Candidate("boosting", learn_boosting, title="gradient boosting with lags"),)

"""Gradient boosting on the latest observations: trees of scikit-learn, no model of the dynamics."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.regression import LAGS, chosen_lags, lagged, trial_rows
from fuzzykf.errors import FuzzykfError, MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart

__all__ = ["CANDIDATES", "LEAST_ROWS", "LagBoosting", "learn_boosting"]

#: Fewest rows to learn on: two leaves of the size that scikit-learn asks for by default.
LEAST_ROWS = 40

#: Decides nothing but the rows that scikit-learn sets aside, of more than 10,000, to stop in time.
RANDOM_STATE = 0


@cache
def _library() -> tuple[Any, Any]:
    """Return scikit-learn's regressor, and what holds its threads."""
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor
        from threadpoolctl import ThreadpoolController
    except ImportError as error:
        raise MissingDependencyError(
            "the candidate 'boosting' needs scikit-learn: pip install 'fuzzykf[compare]'"
        ) from error
    return HistGradientBoostingRegressor, ThreadpoolController()


def _one_thread() -> Any:
    """Hold scikit-learn to one thread: on a busy machine more are many times slower than one."""
    return _library()[1].limit(limits=1, user_api="openmp")


class LagBoosting(Learned):
    """Trees that are grown on the error of those before, from the observation and earlier ones.

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

    def __init__(self, x: FloatArray, y: FloatArray, lags: int, std: FloatArray) -> None:
        self.lags, self.size, self.std = lags, y.shape[1], std
        design, target = lagged(y, lags), x[lags:]
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

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Apply the trees; the observations before serve as lags, and are missing before the first."""
        unknown = np.full((self.lags, self.size), np.nan)
        known = np.concatenate([unknown, before, zs])
        mean = self._mean(lagged(known[len(known) - len(zs) - self.lags :], self.lags))
        return Estimates(mean=mean, std=np.tile(self.std, (len(zs), 1)))

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that keeps the latest observations and applies the trees."""
        row = np.full((1, self.size * (1 + self.lags)), np.nan)

        def step(z: FloatArray) -> FloatArray:
            row[0, self.size :] = row[0, : row.size - self.size].copy()
            row[0, : self.size] = z
            mean: FloatArray = self._mean(row)[0]
            return mean

        return step

    def _mean(self, design: FloatArray) -> FloatArray:
        if not len(design):  # which scikit-learn refuses
            return np.empty((0, len(self._trees)))
        with _one_thread():
            mean: FloatArray = np.column_stack([trees.predict(design) for trees in self._trees])
        return mean


def learn_boosting(part: LearningPart, lags: Sequence[int] = LAGS) -> Learned:
    """Learn trees, with the number of lags that does best on the end of the learning part.

    It is chosen as `learn_regression` chooses it.  The standard deviation is the error on the same
    last quarter of the trees learned on the rest; then all rows are learned on.  The time of day is
    not seen: a part holds no times.

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
        If there are too few rows, or a component of the state is missing in all of the last quarter.
    """
    cut, m = trial_rows(part), part.x.shape[1]
    unknown = np.isnan(part.x[cut:]).all(axis=0)
    if unknown.any():
        raise FuzzykfError(
            f"component {int(np.argmax(unknown))} of the state is missing in all of the last "
            f"{len(part) - cut} rows, on which boosting is judged"
        )
    trial = cache(lambda k: LagBoosting(part.x[:cut], part.y[:cut], k, np.full(m, np.nan)))
    best, description = chosen_lags(part, lags, part.y.shape[1], trial)
    missed = trial(best).restore(part.y[:cut], part.y[cut:]).mean - part.x[cut:]
    found = LagBoosting(part.x, part.y, best, np.sqrt(np.nanmean(missed**2, axis=0)))
    found.description = description
    return found


CANDIDATES = (Candidate("boosting", learn_boosting, title="gradient boosting with lags"),)

"""Regression of the state on the latest observations: no model of the dynamics, no switch."""

from __future__ import annotations

from copy import copy
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.comparison.candidates import Candidate, Estimates, Learned
from fuzzykf.comparison.candidates.choice import choose
from fuzzykf.errors import FuzzykfError
from fuzzykf.preprocessing import Standardizer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Self

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart

__all__ = [
    "CANDIDATES",
    "LAGS",
    "LagRegression",
    "lagged",
    "learn_regression",
    "possible_lags",
]

#: Numbers of earlier observations between which a regression with lags chooses.
LAGS = (0, 1, 2, 4, 8, 16, 32, 64)

#: Knots of the piecewise-linear regression, at the quartiles of the observation.
KNOTS = 3

#: A regression has at least this many rows per coefficient.
ROWS_PER_COEFFICIENT = 10


def lagged(values: FloatArray, lags: int) -> FloatArray:
    """Return each row that has ``lags`` others before it, followed by these, the latest first.

    Parameters
    ----------
    values : ndarray, shape (n, k)
    lags : int

    Returns
    -------
    ndarray of shape (max(n - lags, 0), k (1 + lags))

    Examples
    --------
    >>> import numpy as np
    >>> lagged(np.arange(4.0)[:, None], 2)
    array([[2., 1., 0.],
           [3., 2., 1.]])
    """
    n = max(len(values) - lags, 0)
    return np.concatenate([values[lags - lag : lags - lag + n] for lag in range(lags + 1)], axis=1)


class LagRegression(Learned):
    """Least squares of the state on the observation, earlier ones, and hinges of each.

    x_n = c + sum over l = 0..lags of b_l(y_{n-l}), where b_l is linear between knots.

    Parameters
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        The learning part.  Where y is missing, its latest value stands in; rows in which x
        is missing do not count.
    lags : int
        Number of earlier observations.
    n_knots : int
        Knots of each piecewise-linear function, at the quantiles of y that cut it into
        parts of equal size; none for straight lines.
    inputs : ndarray, shape (n, k), optional
        What is known at all times; then that of the rows to restore is needed too (`told`).

    Raises
    ------
    FuzzykfError
        If there are fewer rows than coefficients.

    Notes
    -----
    It has no law of the observation, and so no likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> y = np.random.default_rng(0).normal(size=(500, 1))
    >>> x = np.abs(y)
    >>> bent = (
    ...     LagRegression(x, y, lags=0, n_knots=1)
    ...     .restore(y[:0], np.array([[-2.0], [2.0]]))
    ...     .mean
    ... )
    >>> bool(abs(bent - 2.0).max() < 0.1)
    True
    """

    def __init__(
        self, x: FloatArray, y: FloatArray, lags: int, n_knots: int, inputs: FloatArray | None = None
    ) -> None:
        self.lags, self.n_knots = lags, n_knots
        self.n_inputs = 0 if inputs is None else inputs.shape[1]
        self._inputs = None if inputs is None else inputs[lags:]
        self._scale = Standardizer().fit(y)
        standard = self._held(y)
        shares = np.arange(1, n_knots + 1) / (n_knots + 1)
        self._knots = np.quantile(standard, shares, axis=0)  # (n_knots, q)
        design = self._design(standard)
        target = x[lags:]
        used = np.isfinite(target).all(axis=1)
        rows, size = int(used.sum()), design.shape[1]
        if rows <= size:
            raise FuzzykfError(f"a regression of {size} coefficients needs more than the {rows} rows it has")
        self._coefficients, *_ = np.linalg.lstsq(design[used], target[used])
        residual = target[used] - design[used] @ self._coefficients
        self.std: FloatArray = np.sqrt((residual**2).sum(axis=0) / (rows - size))
        self._inputs = None

    def told(self, inputs: FloatArray | None) -> Self:
        """Return the same regression for rows with inputs."""
        other = copy(self)
        other._inputs = inputs
        return other

    def _held(self, y: FloatArray) -> FloatArray:
        """Observations in standard units, the latest known one where one is missing."""
        standard: FloatArray = self._scale.transform(y)
        there = ~np.isnan(standard)
        latest = np.maximum.accumulate(np.where(there, np.arange(len(y))[:, None], -1), axis=0)
        held = np.take_along_axis(standard, np.maximum(latest, 0), axis=0)
        return np.where(latest >= 0, held, 0.0)  # the mean, before the first one

    def _basis(self, standard: FloatArray) -> FloatArray:
        """Observations and their hinges max(0, y - knot), (n, q (1 + n_knots))."""
        hinges = np.maximum(standard[:, None, :] - self._knots, 0.0)
        return np.concatenate([standard, hinges.reshape(len(standard), -1)], axis=1)

    def _design(self, standard: FloatArray) -> FloatArray:
        """One row for each observation that has ``lags`` others before it."""
        columns = lagged(self._basis(standard), self.lags)
        design = np.concatenate([np.ones((len(columns), 1)), columns], axis=1)
        if not self.n_inputs:
            return design
        got = 0 if self._inputs is None else len(self._inputs)
        if self._inputs is None or got != len(design):
            raise FuzzykfError(
                f"the regression has learned with inputs, and needs those of the {len(design)} rows to "
                f"restore: got {got}"
            )
        return np.concatenate([design, self._inputs], axis=1)

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Apply the regression; the observations before serve as lags."""
        standard = self._held(np.concatenate([before, zs]))
        short = self.lags - len(before)
        if short > 0:  # before the first observation, the mean
            standard = np.concatenate([np.zeros((short, standard.shape[1])), standard])
        mean = self._design(standard[len(standard) - len(zs) - self.lags :]) @ self._coefficients
        return Estimates(mean=mean, std=np.tile(self.std, (len(zs), 1)))

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return a function that keeps the latest observations and applies the regression."""
        unknown = self._basis(np.zeros((1, self._scale.mean_.size)))[0]  # the mean
        size = unknown.size
        row = np.concatenate([[1.0], np.tile(unknown, 1 + self.lags)])
        coefficients = self._coefficients[: row.size]
        known = np.zeros((1, self.n_inputs)) if self._inputs is None else self._inputs
        rows = cycle(known @ self._coefficients[row.size :])

        def step(z: FloatArray) -> FloatArray:
            row[1 + size :] = row[1:-size].copy()
            row[1 : 1 + size] = self._basis((z[None] - self._scale.mean_) / self._scale.scale_)[0]
            mean: FloatArray = row @ coefficients + next(rows)
            return mean

        return step


def learn_regression(part: LearningPart, lags: Sequence[int] = LAGS, n_knots: int = 0) -> Learned:
    """Learn a regression, with the number of lags of least squared error on rolling blocks.

    Numbers that leave fewer than ten rows per coefficient are not tried.

    Parameters
    ----------
    part : LearningPart
    lags : sequence of int
        Numbers to choose from.
    n_knots : int
        See `LagRegression`.
    """
    possible = possible_lags(len(part), lags, part.y.shape[1] * (1 + n_knots))
    if len(possible) == 1:
        found = LagRegression(part.x, part.y, possible[0], n_knots, part.inputs)
        found.choice, found.description = _only(possible[0], lags)
        return found
    chosen = choose(
        part,
        possible,
        lambda rows, k: LagRegression(rows.x, rows.y, k, n_knots, rows.inputs),
        by="squared error",
    )
    found = LagRegression(part.x, part.y, chosen.best, n_knots, part.inputs)
    found.choice, found.description = str(chosen.best), chosen.told("lags")
    return found


def _only(one: int, lags: Sequence[int]) -> tuple[str, str]:
    """Return a choice that was none, and its words; both empty where none was asked for."""
    if len(lags) == 1:
        return "", ""
    return str(one), f"lags: {one} (more would leave fewer than {ROWS_PER_COEFFICIENT} rows per coefficient)"


def possible_lags(n: int, lags: Sequence[int], per_lag: int) -> list[int]:
    """Return the numbers of earlier observations that so many rows can tell apart.

    Parameters
    ----------
    n : int
    lags : sequence of int
    per_lag : int
        Columns that an observation takes.

    Returns
    -------
    list of int
        Those that leave ten rows per column at least; the smallest one in any case.

    Examples
    --------
    >>> possible_lags(140, (0, 1, 2, 4), per_lag=4)
    [0, 1, 2]
    """
    return [k for k in lags if ROWS_PER_COEFFICIENT * (1 + per_lag * (k + 1)) <= n - k] or [min(lags)]


CANDIDATES = (
    Candidate("line", partial(learn_regression, lags=(0,)), title="linear regression"),
    Candidate("regression", learn_regression, title="regression with lags"),
    Candidate("piecewise", partial(learn_regression, n_knots=KNOTS), title="piecewise-linear with lags"),
)

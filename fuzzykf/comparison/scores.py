"""Scores of a restored state, with the uncertainty that dependent errors leave."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan
from typing import TYPE_CHECKING, Literal

import numpy as np

from fuzzykf.comparison.candidates import Named
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_count, as_numbers, brief, check_generator, is_whole
from fuzzykf.preprocessing import is_constant
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = [
    "COLUMNS",
    "LIMITS",
    "Bootstrap",
    "Score",
    "behind",
    "block_length",
    "bootstrap_rmse",
    "cells",
    "circular_block_means",
    "row_of",
    "significance",
    "standard_error",
]

#: Shares of the resamples below the ends of an interval of 95 %.
LIMITS = (0.025, 0.975)

#: Columns of numbers of the table, those of `cells`, with a break of the line where it may be narrow.
COLUMNS = ("RMSE", "95 %\ninterval", "90 %\ncovers", "log\nscore", "95 %\ninterval", "µs per\nstep")


@reprs()
@dataclass(frozen=True, kw_only=True)
class Score(Named):
    """Scores of one candidate on the test rows.

    Attributes
    ----------
    name, title : str
        Name and title of the candidate.
    rmse : float
        Root mean squared error, in the unit of the state; for several components, in standard deviations of
        each in the first training rows.
    rmse_low, rmse_high : float
        95 % interval of ``rmse``, by the block bootstrap.
    difference : float
        RMSE minus that of the best candidate.
    difference_low, difference_high : float
        95 % interval of ``difference``, by the paired block bootstrap.
    coverage : float
        Share of the states inside the 90 % intervals of the candidate.
    log_score : float
        Mean log-density of the known states, in the unit of ``rmse``; larger is better.  The density is the
        mixture of the candidate if it has one (`Estimates.density`), otherwise normal with its mean and
        standard deviation and independent components.
    log_score_standard_error : float
        Standard error of ``log_score``, by the block bootstrap; NaN if the score is infinite.
    log_score_low, log_score_high : float
        95 % interval of ``log_score``, by the block bootstrap.
    log_score_behind : float
        Highest log score of all candidates minus this one.
    log_score_behind_low, log_score_behind_high : float
        95 % interval of ``log_score_behind``, by the paired block bootstrap.
    normal_log_score : float
        Log score under a normal distribution with mean and standard deviation of the candidate.
    density : {"normal", "mixture"}
        Kind of density behind ``log_score`` and ``coverage``.
    log_likelihood : float or None
        Mean log-density per step of the test observations given the earlier ones.  If the candidate defines
        none, None in a `Comparison` and NaN in a `ModelComparison`.
    seconds : float
        Time of training, over all folds.
    microseconds : float
        Time of one step; NaN if not measured.

    See Also
    --------
    ModelComparison.to_dataframe : All scores as a table.
    """

    rmse: float
    rmse_low: float
    rmse_high: float
    difference: float = float("nan")
    difference_low: float = float("nan")
    difference_high: float = float("nan")
    coverage: float
    log_score: float = float("nan")
    log_score_standard_error: float = float("nan")
    log_score_low: float = float("nan")
    log_score_high: float = float("nan")
    log_score_behind: float = float("nan")
    log_score_behind_low: float = float("nan")
    log_score_behind_high: float = float("nan")
    normal_log_score: float = float("nan")
    density: Literal["normal", "mixture"] = "normal"
    log_likelihood: float | None
    seconds: float = field(default=float("nan"), compare=False)
    microseconds: float = field(default=float("nan"), compare=False)


def cells(score: Score) -> tuple[str, str, str, str, str, str]:
    """Return the numbers of a row of the table, as they are shown, in the order of `COLUMNS`."""
    has_interval = not isnan(score.log_score_low)
    return (
        f"{score.rmse:.4g}",
        f"{score.rmse_low:#.3g}–{score.rmse_high:#.3g}",
        f"{100 * score.coverage:.1f} %",
        f"{score.log_score:.3f}",
        f"{score.log_score_low:.2f} to {score.log_score_high:.2f}" if has_interval else "",
        f"{score.microseconds:.2g}" if score.microseconds < 10 else f"{score.microseconds:.0f}",
    )


def row_of(score: Score) -> tuple[str, str, str, str, str]:
    """Return a row without the time of a step: error, interval, coverage, log score, log-likelihood."""
    value, error = score.log_likelihood, score.log_score_standard_error
    rmse, interval, coverage, log_score, *_ = cells(score)
    return (
        rmse,
        interval,
        coverage,
        log_score + ("" if isnan(error) else f" ± {error:.2g}"),
        "none" if value is None or isnan(value) else f"{value:.3f}",
    )


def behind(score: Score) -> str:
    """Return by how much a candidate is behind the best: the interval of 95 %, nothing for the best.

    Examples
    --------
    >>> common = {
    ...     "rmse": 1.2,
    ...     "rmse_low": 1.1,
    ...     "rmse_high": 1.3,
    ...     "coverage": 0.9,
    ...     "log_likelihood": None,
    ... }
    >>> behind(
    ...     Score(
    ...         "kalman", difference=0.2, difference_low=0.1, difference_high=0.3, **common
    ...     )
    ... )
    '0.10 to 0.30'
    """
    if not score.difference > 0.0:
        return ""
    return f"{score.difference_low:#.2g} to {score.difference_high:#.2g}"


def block_length(series: FloatArray) -> int:
    """Choose the block length for a bootstrap of the mean of a dependent series.

    The rule of Politis and White (2004) for the circular block bootstrap, with the
    correction of Patton, Politis and White (2009).

    Parameters
    ----------
    series : ndarray, shape (n,)

    Returns
    -------
    int
        Between 1 and the smaller of 3 sqrt(n) and n/3.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.normal(size=4000)
    >>> block_length(noise) < block_length(np.convolve(noise, np.ones(50)))
    True
    """
    series = _finite("series", series, 1)
    n = len(series)
    longest = int(min(np.ceil(3.0 * np.sqrt(n)), np.ceil(n / 3.0)))
    deviation = series - series.mean()
    largest = np.abs(deviation).max()
    if not 1e-100 < largest < 1e100:  # squares would leave the range of double precision
        deviation = deviation / (largest or 1.0)
    if is_constant(series):
        return 1
    run = int(max(5, np.ceil(np.sqrt(np.log10(n)))))
    last = min(int(np.ceil(np.sqrt(n))) + run, n - 1)
    covariance = np.array([deviation[k:] @ deviation[: n - k] for k in range(last + 1)]) / n
    small = np.abs(covariance[1:] / covariance[0]) < 2.0 * np.sqrt(np.log10(n) / n)
    quiet = np.convolve(small, np.ones(run), mode="valid") == run  # [m]: lags m + 1 to m + run are small
    m = int(np.argmax(quiet)) if quiet.any() else last
    bandwidth = min(2 * max(m, 1), last)
    lags = np.arange(bandwidth + 1)
    window = np.clip(2.0 * (1.0 - lags / bandwidth), 0.0, 1.0)  # the flat-top window
    weighted = window * covariance[: bandwidth + 1]
    slope = 2.0 * (lags * weighted).sum()
    spectrum = weighted[0] + 2.0 * weighted[1:].sum()
    if spectrum <= 0.0:  # the estimate of the spectrum at zero failed: take the longest
        return longest
    length = (2.0 * slope**2 / (4.0 / 3.0 * spectrum**2)) ** (1.0 / 3.0) * n ** (1.0 / 3.0)
    return int(np.clip(np.ceil(length), 1, longest))


def _finite(name: str, value: ArrayLike, ndim: int) -> FloatArray:
    """Return an array of finite numbers, and of at least two rows."""
    array = as_numbers(name, value)
    if array.ndim != ndim or len(array) < 2:
        raise ShapeError(
            f"{name}: got shape {array.shape}, expected {'(n,)' if ndim == 1 else '(n, k)'}, n > 1"
        )
    if not np.isfinite(array).all():
        raise ParameterError(f"{name}: got NaN or infinity, expected finite numbers")
    return array


def circular_block_means(
    series: FloatArray, length: int, n_resamples: int, rng: np.random.Generator
) -> FloatArray:
    """Return means of series, resampled by the circular block bootstrap.

    All columns share the blocks, so that differences between columns are paired.

    Parameters
    ----------
    series : ndarray, shape (n, k)
    length : int
        Length of the blocks, between 1 and n.
    n_resamples : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of shape (n_resamples, k)

    Raises
    ------
    ParameterError
        If ``length`` is outside 1..n.

    Notes
    -----
    Politis and Romano (1992).  Sums over blocks are differences of cumulative sums, so
    the cost does not depend on the block length.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import circular_block_means
    >>> circular_block_means(np.ones((10, 2)), 3, 5, np.random.default_rng(0)).shape
    (5, 2)
    """
    check_generator(rng)
    series = _finite("series", series, 2)
    n, k = series.shape
    if not is_whole(length) or not 1 <= length <= n:
        raise ParameterError(f"length: got {brief(length)}, expected 1 to {n}")
    length, n_resamples = int(length), as_count("n_resamples", n_resamples)
    centre = series.mean(axis=0)  # running sums of deviations lose no digits
    deviation = series - centre
    running = np.concatenate([np.zeros((1, k)), np.cumsum(np.concatenate([deviation, deviation]), axis=0)])
    whole, rest = divmod(n, length)
    starts = rng.integers(n, size=(n_resamples, whole + (rest > 0)))
    lengths = np.full(starts.shape[1], length)
    if rest:
        lengths[-1] = rest
    sums = running[starts + lengths] - running[starts]
    means: FloatArray = centre + sums.sum(axis=1) / n
    return means


def standard_error(series: FloatArray) -> float:
    """Return the standard error of the mean of a dependent series.

    It is the spread that the circular block bootstrap would give the mean (`circular_block_means`,
    with blocks of `block_length`), without drawing: that of the means of all circular blocks of L rows is
    known, and n / L of them make the mean.

    Parameters
    ----------
    series : ndarray, shape (n,)

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=10_000)
    >>> bool(abs(standard_error(noise) - 0.01) < 0.001)
    True
    """
    length, n = block_length(series), len(series)
    deviation = series - series.mean()
    running = np.concatenate([[0.0], np.cumsum(np.concatenate([deviation, deviation[: length - 1]]))])
    means = (running[length:] - running[:-length]) / length  # n of them
    return float(np.sqrt((means**2).mean() * length / n))


def significance(is_certain: bool) -> str:
    """Return the words for a difference whose interval of 95 % holds zero, or does not."""
    return "a significant difference" if is_certain else "not a significant difference"


@reprs()
@dataclass(frozen=True, eq=False)
class Bootstrap:
    """RMSE of several methods on the same steps, with bootstrap resamples.

    Attributes
    ----------
    rmse : ndarray, shape (k,)
    resampled : ndarray, shape (n_resamples, k)
        All methods share the blocks, so that differences are paired.
    block_length : int
        Steps in a block.
    beside : ndarray, shape (n_resamples, j)
        Resampled means of other quantities of the same steps, from the same blocks.

    See Also
    --------
    bootstrap_rmse : Create one; with an example.
    """

    rmse: FloatArray
    resampled: FloatArray
    block_length: int
    beside: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def difference(self, a: int, b: int) -> tuple[float, float]:
        """Return the 95 % interval of the RMSE of method ``a`` minus that of ``b``.

        Parameters
        ----------
        a, b : int
            Indices of the methods.

        Returns
        -------
        lower, upper : float
        """
        low, high = np.quantile(self.resampled[:, a] - self.resampled[:, b], LIMITS)
        return float(low), float(high)


def bootstrap_rmse(
    squared: FloatArray,
    n_resamples: int,
    rng: np.random.Generator,
    *,
    beside: FloatArray | None = None,
) -> Bootstrap:
    """Resample RMSEs by the circular block bootstrap.

    Parameters
    ----------
    squared : ndarray, shape (n, k)
        Squared errors of k methods at n steps.
    n_resamples : int
    rng : numpy.random.Generator
    beside : ndarray, shape (n, j), optional
        Other quantities of the same steps, whose means are resampled with the same blocks; they do not affect
        the block length.

    Returns
    -------
    Bootstrap
        With the block length of the most dependent column.

    Raises
    ------
    ParameterError
        If ``n_resamples`` is less than 100, too few for 2.5 % quantiles.
    ShapeError
        If ``beside`` has the wrong number of rows.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import bootstrap_rmse
    >>> rng = np.random.default_rng(0)
    >>> errors = rng.normal(size=(500, 2)) * [1.0, 2.0]
    >>> found = bootstrap_rmse(errors**2, 200, rng)
    >>> lower, upper = found.difference(1, 0)
    >>> 0.0 < lower < upper
    True
    """
    n_resamples = as_count("n_resamples", n_resamples, 100)
    squared = _finite("squared", squared, 2)
    if squared.shape[1] == 0 or (squared < 0.0).any():
        raise ParameterError(f"squared: got shape {squared.shape}, expected columns of numbers of at least 0")
    length = max(block_length(column) for column in squared.T)
    k, columns = squared.shape[1], squared
    if beside is not None:
        beside = _finite("beside", beside, 2)
        if len(beside) != len(squared):
            raise ShapeError(
                f"beside: got {len(beside)} rows, expected {len(squared)}, as many as squared has"
            )
        columns = np.concatenate([squared, beside], axis=1)
    means = circular_block_means(columns, length, n_resamples, rng)
    resampled = np.sqrt(np.maximum(means[:, :k], 0.0))  # rounding
    return Bootstrap(np.sqrt(squared.mean(axis=0)), resampled, length, means[:, k:])

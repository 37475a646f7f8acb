"""The bootstrap has the spread that dependent errors have, and pairs what belongs together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from fuzzykf.comparison import block_length, bootstrap_rmse, circular_block_means
from fuzzykf.comparison.density import normal_log_score
from fuzzykf.comparison.evaluation import _log_scores
from fuzzykf.comparison.scores import COLUMNS, Score, cells, row_of, standard_error
from fuzzykf.errors import ParameterError, ShapeError


def autoregression(n: int, coefficient: float, rng: np.random.Generator) -> np.ndarray:
    series = np.empty(n)
    series[0] = rng.normal() / np.sqrt(1 - coefficient**2)
    noise = rng.normal(size=n)
    for k in range(1, n):
        series[k] = coefficient * series[k - 1] + noise[k]
    return series


@settings(max_examples=50, deadline=None)
@given(n=st.integers(2, 40), length=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_resampled_means_are_those_of_the_blocks_written_out(n, length, seed) -> None:
    # Oracle: the blocks drawn by the same generator, laid end to end and cut at n.
    length = min(length, n)
    series = np.random.default_rng(seed).normal(3.0, 2.0, size=(n, 2))
    means = circular_block_means(series, length, 20, np.random.default_rng(seed))
    starts = np.random.default_rng(seed).integers(n, size=(20, -(-n // length)))
    for row, first in zip(means, starts, strict=True):
        index = np.concatenate([(s + np.arange(length)) % n for s in first])[:n]
        np.testing.assert_allclose(row, series[index].mean(axis=0), rtol=1e-12, atol=1e-12)


def test_columns_are_resampled_together() -> None:
    rng = np.random.default_rng(3)
    series = rng.normal(size=500)
    means = circular_block_means(np.column_stack([series, series + 1.0]), 20, 300, rng)
    np.testing.assert_allclose(means[:, 1] - means[:, 0], 1.0)


def test_the_spread_of_the_bootstrap_is_that_of_the_mean_of_dependent_data() -> None:
    # Oracle: the variance of the mean of an autoregression, 1 / (n (1 - a)^2) for large n. A bootstrap
    # of single rows would find a quarter of it.
    rng = np.random.default_rng(4)
    n, a = 4000, 0.6
    expected = 1.0 / (np.sqrt(n) * (1 - a))
    found = []
    for _ in range(20):
        series = autoregression(n, a, rng)
        means = circular_block_means(series[:, None], block_length(series), 400, rng)
        found.append(means.std())
    assert np.mean(found) == pytest.approx(expected, rel=0.15)
    single = circular_block_means(series[:, None], 1, 400, rng).std()
    assert single < 0.6 * expected


def test_the_length_of_blocks_is_that_of_the_theory() -> None:
    # Oracle: the optimal length for an autoregression, from its exact covariances:
    # G = sum |k| R(k) = 2 a / ((1 - a)^2 (1 - a^2)), g(0) = 1 / (1 - a)^2.
    rng = np.random.default_rng(5)
    n, a = 8000, 0.7
    slope = 2 * a / ((1 - a) ** 2 * (1 - a**2))
    optimum = (2 * slope**2 / (4 / 3 / (1 - a) ** 4)) ** (1 / 3) * n ** (1 / 3)
    lengths = [block_length(autoregression(n, a, rng)) for _ in range(100)]
    assert np.mean(lengths) == pytest.approx(optimum, rel=0.06)


def test_white_noise_needs_short_blocks_and_a_trend_long_ones() -> None:
    rng = np.random.default_rng(6)
    assert np.mean([block_length(rng.normal(size=3000)) for _ in range(20)]) < 8
    assert 100 < block_length(np.arange(3000.0)) <= np.ceil(3 * np.sqrt(3000))


@pytest.mark.parametrize("n", [2, 3, 10, 57])
def test_short_and_constant_series_have_a_length(n) -> None:
    assert block_length(np.full(n, 7.0)) == 1
    assert 1 <= block_length(np.random.default_rng(n).normal(size=n)) <= n


@pytest.mark.parametrize("length", [0, 11])
def test_a_block_longer_than_the_series_or_empty_is_refused(length) -> None:
    with pytest.raises(ParameterError, match=f"length: got {length}, expected 1 to 10"):
        circular_block_means(np.zeros((10, 1)), length, 5, np.random.default_rng(0))


# ------------------------------------------------------------------ the log score


def test_the_log_score_is_the_density_of_the_normal_law_of_what_is_known() -> None:
    # Oracle: scipy's density, component by component.
    rng = np.random.default_rng(8)
    error, std = rng.normal(size=(40, 3)), rng.uniform(0.1, 3.0, size=(40, 3))
    error[5, 1] = error[6, :2] = np.nan
    expected = np.nansum(norm.logpdf(error, scale=std), axis=1)
    np.testing.assert_allclose(normal_log_score(error, std), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("error", "std", "expected"),
    [
        ([0.0], [0.0], np.inf),
        ([1.0], [0.0], -np.inf),
        ([0.0, 1.0], [0.0, 0.0], -np.inf),  # right of one and wrong of another
        ([1.0, 1.0], [0.0, 1.0], -np.inf),
        ([1e200], [1e-200], -np.inf),
        ([np.nan, 0.0], [0.0, 1.0], norm.logpdf(0.0)),
    ],
)
def test_certainty_has_a_score_too(error, std, expected) -> None:
    assert normal_log_score(np.array([error]), np.array([std]))[0] == pytest.approx(expected)


def test_other_figures_are_resampled_with_the_blocks_of_the_errors_and_change_none_of_them() -> None:
    rng = np.random.default_rng(9)
    squared = np.stack([autoregression(300, a, rng) ** 2 for a in (0.2, 0.8)], axis=1)
    trend = np.arange(300.0)[:, None]  # which would need longer blocks
    alone, both = (
        bootstrap_rmse(squared, 200, np.random.default_rng(1), beside=beside)
        for beside in (None, np.hstack([squared[:, :1], trend]))
    )
    assert alone.block_length == both.block_length
    np.testing.assert_array_equal(alone.resampled, both.resampled)
    np.testing.assert_allclose(both.beside[:, 0], both.resampled[:, 0] ** 2)
    assert alone.beside.shape == (200, 0)
    with pytest.raises(ShapeError, match="beside: got 299 rows, expected 300"):
        bootstrap_rmse(squared, 200, rng, beside=trend[1:])


@pytest.mark.parametrize(
    ("log_score", "error", "shown"),
    [(-0.4834, 0.02149, "-0.483 ± 0.021"), (-np.inf, np.nan, "-inf"), (np.nan, np.nan, "nan")],
)
def test_the_table_shows_the_log_score_beside_coverage(log_score, error, shown) -> None:
    common = {"rmse": 1.2, "rmse_low": 1.1, "rmse_high": 1.3, "coverage": 0.9, "log_likelihood": None}
    ends = {"log_score_low": log_score - error, "log_score_high": log_score + error}
    score = Score("kalman", log_score=log_score, log_score_standard_error=error, **common, **ends)
    row, at = cells(score), COLUMNS.index("log\nscore")
    assert len(row) == len(COLUMNS)
    assert row[at : at + 2] == (shown.split(" ")[0], "" if np.isnan(error) else "-0.50 to -0.46")
    assert row_of(score)[3:] == (shown, "none")


@pytest.mark.parametrize("coefficient", [0.3, 0.7])
def test_the_standard_error_is_the_spread_of_the_bootstrap(coefficient) -> None:
    # Oracle: the block bootstrap itself, drawn, with blocks that make up the series without a rest.
    rng = np.random.default_rng(10)
    series = autoregression(600, coefficient, rng)
    length = block_length(series)
    series = series[: len(series) // length * length]
    drawn = circular_block_means(series[:, None], block_length(series), 4000, rng).std()
    assert standard_error(series) == pytest.approx(drawn, rel=0.05)
    assert standard_error(np.ones(50)) == 0.0


@pytest.mark.filterwarnings("error")
def test_of_scores_without_end_none_is_behind_another() -> None:
    scored = np.array([[-np.inf, 0.0, -np.inf], [1.0, 2.0, -np.inf]])
    first, best, last = _log_scores(scored, np.zeros((5, 3)), np.array([False, True, False]))
    assert (first["log_score"], best["log_score"], last["log_score"]) == (-np.inf, 1.0, -np.inf)
    assert best["log_score_behind"] == 0.0
    assert np.isnan([first["log_score_behind"], last["log_score_behind"]]).all()

"""Regressions with lags are least squares on the rows they should be, and choose lags where they may."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FuzzykfError
from fuzzykf.comparison import LearningPart
from fuzzykf.comparison.candidates.regression import LagRegression, learn_regression


def moving_average(n, weights, seed=0):
    rng = np.random.default_rng(seed)
    y = rng.normal(5.0, 3.0, n)
    x = np.convolve(y, weights, "full")[:n] + 0.1 * rng.normal(size=n)
    return x[:, None], y[:, None]


def test_without_lags_and_knots_it_is_the_least_squares_line() -> None:
    x, y = moving_average(400, [1.0, 0.5])
    found = LagRegression(x[:300], y[:300], 0, 0).restore(y[:300], y[300:])
    coefficients, (square_sum,), *_ = np.polyfit(y[:300, 0], x[:300, 0], 1, full=True)
    np.testing.assert_allclose(found.mean[:, 0], np.polyval(coefficients, y[300:, 0]))
    np.testing.assert_allclose(found.std, np.sqrt(square_sum / 298))
    assert found.log_likelihood is None


def test_lags_and_hinges_are_those_of_the_definition() -> None:
    # Oracle: the design matrix written out row by row, in the units of the data.
    rng = np.random.default_rng(1)
    y, x = rng.normal(size=(300, 2)), rng.normal(size=(300, 1))
    knots = np.quantile(y[:250], [1 / 3, 2 / 3], axis=0)

    def row(k):
        lags = [y[k - lag] for lag in range(4)]
        return [1.0, *(v for z in lags for v in (*z, *np.maximum(z - knots, 0.0).ravel()))]

    design = np.array([row(k) for k in range(3, 300)])
    coefficients, *_ = np.linalg.lstsq(design[:247], x[3:250])
    found = LagRegression(x[:250], y[:250], 3, 2).restore(y[:250], y[250:])
    np.testing.assert_allclose(found.mean, design[247:] @ coefficients, atol=1e-9)


def test_the_lags_of_the_first_rows_come_from_the_observations_before() -> None:
    x, y = moving_average(300, [0.0, 0.0, 1.0])
    learned = LagRegression(x[:200], y[:200], 2, 0)
    assert np.abs(learned.restore(y[:200], y[200:]).mean - x[200:]).max() < 0.5
    # Without any, the mean of the learning part stands in.
    cold = learned.restore(y[:0], y[200:])
    np.testing.assert_allclose(cold.mean[:2, 0], x[:200].mean(), atol=0.1)
    np.testing.assert_allclose(cold.mean[2:], learned.restore(y[:200], y[200:]).mean[2:])


def test_the_latest_observation_stands_in_for_a_missing_one_and_rows_without_state_do_not_count() -> None:
    x, y = moving_average(300, [1.0, 0.5])
    held, gaps = y.copy(), y.copy()
    gaps[[20, 21, 250]] = np.nan
    held[[20, 21]], held[250] = y[19], y[249]
    one, two = (LagRegression(x[:200], v[:200], 1, 1) for v in (held, gaps))
    two._scale = one._scale  # the scale of the gappy one has seen two values less
    np.testing.assert_allclose(two._held(gaps), one._held(held))
    x[50:60] = np.nan
    assert np.isfinite(LagRegression(x[:200], gaps[:200], 1, 1).restore(gaps[:200], gaps[200:]).mean).all()


def test_steps_in_real_time_agree_with_the_series() -> None:
    x, y = moving_average(200, [1.0, -0.5, 0.3])
    learned = LagRegression(x, y, 4, 2)
    step = learned.stepper()
    np.testing.assert_allclose([step(z) for z in y[:30]][4:], learned.restore(y[:0], y[:30]).mean[4:])


def test_the_number_of_lags_is_chosen_on_rolling_blocks() -> None:
    x, y = moving_average(1200, [1.0, 0.5, -0.5, 0.8])
    learned = learn_regression(LearningPart(x=x[:1000], y=y[:1000]), lags=(0, 1, 2, 3, 64))
    assert learned.lags == 3
    assert learned.choice == "3"
    assert learned.description.startswith(
        "lags: 3 (chosen from 0-64 on 3 rolling blocks by squared error: RMSE "
    )
    error = learned.restore(y[:1000], y[1000:]).mean - x[1000:]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(0.1, rel=0.2)


def test_a_short_series_is_not_offered_more_lags_than_it_can_tell_apart() -> None:
    x, y = moving_average(140, [1.0, 0.5])
    learned = learn_regression(LearningPart(x=x, y=y), n_knots=3)
    assert learned.description.startswith("lags: 2 (chosen from 0-2 on")
    assert learned.lags == 2  # thirteen coefficients; with 4 lags 21, for 136 rows
    shorter = learn_regression(LearningPart(x=x[:60], y=y[:60]), n_knots=3)
    assert shorter.description == "lags: 0 (more would leave fewer than 10 rows per coefficient)"
    assert learn_regression(LearningPart(x=x, y=y), lags=(1,)).description == ""


def test_more_coefficients_than_rows_are_refused() -> None:
    x, y = moving_average(30, [1.0])
    with pytest.raises(FuzzykfError, match="17 coefficients needs more than the 15 rows"):
        LagRegression(x, y, 15, 0)

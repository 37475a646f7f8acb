"""What is known at all times reaches those candidates that have a use for it, each row its own."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import compare_models
from fuzzykf.comparison.candidates.boosting import LagBoosting
from fuzzykf.comparison.candidates.regression import LagRegression
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError

N = 400


def series():
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(N, 2)), rng.normal(size=N)
    return y + u @ [2.0, -1.0] + 0.1 * rng.normal(size=N), y, u


def test_inputs_reach_the_candidates_that_use_them() -> None:
    x, y, u = series()
    names = ["regression", "boosting", "kalman"]
    found = {
        told: compare_models(x, y, np.random.default_rng(0), candidates=names, n_folds=2, inputs=given)
        for told, given in (("without", None), ("with", u), ("shifted", np.roll(u, 1, axis=0)))
    }
    rmse = {told: {score.name: score.rmse for score in one.scores} for told, one in found.items()}
    assert rmse["with"]["regression"] == pytest.approx(0.1, rel=0.2)
    assert rmse["with"]["boosting"] < 0.7 * rmse["without"]["boosting"]
    assert rmse["shifted"]["regression"] > 2.0  # each row has its own
    assert rmse["with"]["kalman"] == rmse["without"]["kalman"]


@pytest.mark.parametrize(
    ("inputs", "error", "text"),
    [
        (np.zeros(N - 1), ShapeError, "inputs: got 399 rows, expected 400"),
        (np.full(N, np.nan), ParameterError, r"inputs: got \[nan\] at 0, expected finite numbers"),
    ],
)
def test_inputs_have_no_gaps(inputs, error, text) -> None:
    x, y, _ = series()
    with pytest.raises(error, match=text):
        compare_models(x, y, np.random.default_rng(0), candidates=["regression"], n_folds=2, inputs=inputs)


@pytest.mark.parametrize("kind", ["regression", "boosting"])
def test_a_step_is_a_row_of_the_series(kind) -> None:
    x, y, u = series()
    part, rest = slice(300), slice(300, N)
    if kind == "regression":
        learned = LagRegression(x[part, None], y[part, None], 2, 1, u[part])
    else:
        learned = LagBoosting(x[part, None], y[part, None], 2, np.ones(1), None, u[part])
    with pytest.raises(FuzzykfError, match="needs those of the 100 rows to restore: got 0"):
        learned.restore(y[part, None], y[rest, None])
    told = learned.told(u[rest])
    whole = told.restore(y[part, None], y[rest, None]).mean
    step = told.stepper()
    stepped = np.array([np.reshape(step(z), 1) for z in y[rest, None]])
    np.testing.assert_allclose(stepped[2:], whole[2:], rtol=1e-10)

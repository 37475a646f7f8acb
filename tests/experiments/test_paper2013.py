"""The experiment of the 2013 paper, made small: its filters against the package's own, step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzzykf import CGOMSModel, KalmanFilter, KnownSwitchFilter
from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2013 import SWITCHING_STATE_SPACE, kalman_told, make_cglssm, restore_told

READINGS = ["literal", "correlation"]


@pytest.fixture(scope="module")
def outcome():
    """The experiment with few runs, of 500 steps instead of 1000: what runs cost is their steps."""
    pieces = {name: {**piece, "n": 500} for name, piece in SWITCHING_STATE_SPACE.pieces.items()}
    return perform(replace(SWITCHING_STATE_SPACE, pieces=pieces), runs=6, seed=2)


def drawn(cglssm, runs=3, n=40):
    series = [cglssm.simulate(n, np.random.default_rng(k)) for k in range(runs)]
    return np.stack([one.y[:, 0] for one in series]), np.stack([one.r for one in series])


@pytest.mark.parametrize("reading", READINGS)
def test_the_kalman_filter_told_the_switch_is_the_package_s_with_changing_matrices(reading) -> None:
    cglssm = make_cglssm(0.7, reading)
    y, r = drawn(cglssm)
    for series, switches, found in zip(y, r.astype(int), kalman_told(cglssm, y, r), strict=True):
        kf = KalmanFilter(1, 1, P=cglssm.initial_covariance[switches[0]])
        kf.x = np.zeros((1, 1))
        for n, (z, j) in enumerate(zip(series, switches, strict=True)):
            if n:
                kf.predict(F=cglssm.A[j], Q=cglssm.C[j] @ cglssm.C[j].T)
            kf.update(z, H=cglssm.B[j], R=cglssm.D[j] @ cglssm.D[j].T)
            assert found[n] == pytest.approx(kf.x.item(), abs=1e-12)


@pytest.mark.parametrize("construction", ["gain", "markov_x"])
def test_the_filter_told_the_switch_is_the_known_switch_filter(construction) -> None:
    cglssm = make_cglssm(0.7, "literal")
    matrices = (cglssm.transition, cglssm.A, cglssm.B, cglssm.C, cglssm.D)
    model = CGOMSModel.from_cglssm(*matrices, construction=construction)
    y, r = drawn(cglssm)
    expected = KnownSwitchFilter(model).filter_many(y, keep=("x",), r=r).x[..., 0]
    assert restore_told(model, y, r) == pytest.approx(expected, abs=1e-12)


def test_as_a_correlation_the_variances_are_those_that_the_paper_names() -> None:
    cglssm = make_cglssm(0.5, "correlation")
    var_x = cglssm.initial_covariance.ravel()
    assert var_x == pytest.approx([1.0, 2.0])
    B, D = cglssm.B.ravel(), cglssm.D.ravel()
    assert B**2 * var_x + D**2 == pytest.approx([2.0, 4.0])
    assert B * np.sqrt(var_x / [2.0, 4.0]) == pytest.approx([0.5, 0.2])


def test_as_printed_the_variances_are_not_those_that_the_paper_names() -> None:
    cglssm = make_cglssm(0.5, "literal")
    assert cglssm.C.ravel() ** 2 == pytest.approx([0.91, 1.28])
    assert cglssm.D.ravel() ** 2 == pytest.approx([1.5, 3.84])
    assert not np.allclose(cglssm.initial_covariance.ravel(), [1.0, 2.0], atol=1e-3)


def test_no_filter_is_better_than_the_one_that_is_told_everything(outcome) -> None:
    for name, values in outcome.samples.items():
        if name.endswith("b1 = 0.95"):
            assert values["kalman"].mean() < values["gain"].mean()
            assert values["kalman"].mean() < values["imm"].mean()


def test_the_printed_model_does_not_exist_at_the_end_of_the_sweep(outcome) -> None:
    rows = {row.quantity: row for row in outcome.rows if "exists" in row.quantity}
    assert len(rows) == 14
    missing = [quantity for quantity, row in rows.items() if row.verdict == "not reproduced"]
    assert missing == ["correlation, b1 = 0.95: the model (20)-(23) exists (1) or not (0)"]
    assert "markov_x" not in outcome.samples["correlation b1 = 0.95"]
    assert "markov_x" in outcome.samples["literal b1 = 0.95"]


def test_with_equal_observations_the_unknown_switch_costs_nothing(outcome) -> None:
    for reading in READINGS:
        values = outcome.samples[f"{reading} b1 = 0.2"]
        assert values["gain"].mean() == pytest.approx(values["gain_told"].mean(), rel=0.01)


def test_the_converted_filter_is_neither_better_nor_worse_than_imm(outcome) -> None:
    for values in outcome.samples.values():
        assert values["gain"] == pytest.approx(values["imm"], rel=0.01)


def test_the_picture_shows_both_readings(outcome, tmp_path) -> None:
    assert write(outcome, tmp_path)[2].stat().st_size > 10_000
    figure = outcome.experiment.draw(outcome.samples)
    assert [axes.get_ylabel() for axes in figure.axes] == ["MSE of the state", "", "jump error rate", ""]
    assert [len(axes.lines) for axes in figure.axes] == [5, 5, 3, 3]

"""Switching state-space models as candidates: learned from states and observations, run on these alone."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw, SwitchingStateSpace, compare_models, engine
from fuzzykf.comparison import LearningPart, candidate
from fuzzykf.comparison.candidates.state_space import fading_law, hard_law, learn_state_space

pytestmark = pytest.mark.skipif(engine.info().name == "numpy", reason="a fit takes long on NumPy")


@pytest.fixture(scope="module")
def sun():
    """A sensor in the sun: its gain fades while a bias and more noise come up."""
    R = np.array([0.2, 0.6])[:, None, None] ** 2
    model = SwitchingStateSpace(
        FadeLaw.between(40, 8), F=0.95, H=[[[1.0]], [[0.4]]], Q=0.09, R=R, d=[[0.0], [2.0]], mix="log"
    )
    return model.simulate(600, np.random.default_rng(0))


def part(data, n=400, **more):
    return LearningPart(x=data.x[:n], y=data.y[:n], n_nodes=1, **more)


@pytest.fixture(scope="module")
def learned(sun):
    return {name: candidate(name).learn(part(sun)) for name in ("switching-ssm", "switching-ssm-hard")}


def test_estimates_are_those_of_the_filter_run_from_a_little_earlier(sun, learned) -> None:
    for one in learned.values():
        found = one.restore(sun.y[:400], sun.y[400:])
        whole = one.filter.filter(sun.y[300:])
        np.testing.assert_array_equal(found.mean, whole.x[100:])
        np.testing.assert_array_equal(found.std, np.sqrt(whole.P[100:, :, 0]))
        np.testing.assert_array_equal(found.log_likelihood, whole.log_likelihood[100:])
        np.testing.assert_array_equal(found.switch, whole.switch_mean[100:])


def test_sensors_are_found(learned) -> None:
    """That with more gain has no bias; classes may come in either order."""
    fit = learned["switching-ssm"].fit
    H, d = (fit.model.form.parameters[name].values.reshape(2) for name in "Hd")
    good = int(H.argmax())
    assert H[[good, 1 - good]] == pytest.approx([1.0, 0.4], abs=0.1)
    assert d[[good, 1 - good]] == pytest.approx([0.0, 2.0], abs=0.2)
    assert fit.log_likelihood > learned["switching-ssm-hard"].fit.log_likelihood


def test_one_regime_is_the_regression(sun) -> None:
    fit = learn_state_space(part(sun), n_regimes=1).fit
    slope, offset = np.polyfit(sun.x[:400, 0], sun.y[:400, 0], 1)
    assert fit.estimates["H[0, 0]"] == pytest.approx(slope, rel=1e-4)
    assert fit.estimates["d[0]"] == pytest.approx(offset, rel=1e-4)
    assert fit.n_parameters == 6


def test_they_are_compared_by_name(sun) -> None:
    names = ["switching-ssm-hard", "kalman"]
    found = compare_models(
        sun.x, sun.y, np.random.default_rng(0), candidates=names, n_folds=1, n_resamples=100
    )
    assert [score.name for score in found.scores] == names
    assert found.scores[0].rmse < found.scores[1].rmse


def test_a_given_switch_is_not_used_and_that_is_said(sun) -> None:
    alone = learn_state_space(part(sun, 120), n_regimes=2)
    told = learn_state_space(part(sun, 120, r=sun.r[:120]), n_regimes=2)
    assert told.fit.estimates == alone.fit.estimates
    assert told.notes[0].startswith("the given switch was ignored")


def test_searches_begin_with_room_for_the_nodes() -> None:
    assert fading_law(9).discretize(9).n_classes == 2
    assert hard_law(1) == [[1.0]]
    np.testing.assert_allclose(hard_law(3), 0.9625 * np.eye(3) + 0.0125)

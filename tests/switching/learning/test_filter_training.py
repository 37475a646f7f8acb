"""Learning for the filter: what is kept, what the result says of it, and that it filters better."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, engine
from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning import filter_training
from fuzzykf.switching.learning.filter_objective import Stretch
from fuzzykf.switching.learning.filter_training import INFLATIONS, LOOK, PATIENCE, _ascend, _KeptBack

N = 1200


def slow(n=N, seed=0):
    """A slow state, seen through noise: joint learning leans on the state before."""
    rng = np.random.default_rng(seed)
    r = (np.arange(n) // 40) % 2
    x, y = np.zeros((2, n))
    for k in range(1, n):
        x[k] = 0.9 * x[k - 1] + 0.3 * rng.normal()
        y[k] = (1.0, -0.6)[r[k]] * x[k] + 3.0 * r[k] + 0.5 * rng.normal()
    return x, y


def held_out(model, x, y, begin):
    """Error, and mean log score of the normal law, of the filter from a row on."""
    found = model.filter().filter(y)
    error, std = (x - found.x[:, 0])[begin:], np.sqrt(found.P[begin:, 0, 0])
    return np.sqrt(np.mean(error**2)), np.mean(-0.5 * (error / std) ** 2 - np.log(std))


FITS = {
    "hard": lambda x, y, **o: CGOMSModel.fit(x, y, n_regimes=2, form="regression", n_starts=2, **o),
    "fmc1": lambda x, y, **o: CGOFMSModel.fit(
        x, y, law="fmc1", form="regression", n_nodes=1, n_starts=1, tolerance=1e-4, **o
    ),
}


@pytest.fixture
def short(monkeypatch):
    """Two looks at the score, where what is tested does not depend on how long the search is."""
    monkeypatch.setattr(filter_training, "MOST", 2 * LOOK)


#: One whole search, of "hard", is made on NumPy as well.
compiled = pytest.mark.skipif(
    engine.info().name == "numpy", reason="its gradients are tested by themselves, and a search takes long"
)


@pytest.mark.parametrize("name", ["hard", pytest.param("fmc1", marks=compiled)])
def test_it_filters_better_where_joint_learning_leans_on_the_state_before(name, monkeypatch) -> None:
    monkeypatch.setattr(filter_training, "MOST", 30)  # there it scores best: the rest is patience
    x, y = slow()
    joint = FITS[name](x[:800], y[:800])
    fit = FITS[name](x[:800], y[:800], objective="filter")
    training = fit.training
    assert joint.training is None
    assert training.kept == "filter"
    assert training.score_filter > training.score_joint
    assert training.n_kept_back == 160
    assert 0 < training.n_iterations <= filter_training.MOST
    assert training.trace[-1] > training.trace[0]
    assert training.inflation in INFLATIONS
    error, score = held_out(fit.model, x, y, 800)
    joint_error, joint_score = held_out(joint.model, x, y, 800)
    assert error < 0.95 * joint_error
    assert score > joint_score
    assert "filter; kept the filter fit" in str(fit.summary())
    assert fit.switch_mean.shape == (800,)
    assert fit.n_parameters == joint.n_parameters


def test_units_and_repetition_change_nothing(short) -> None:
    x, y = slow(400)
    one = FITS["hard"](x, y, objective="filter")
    other = FITS["hard"](1000.0 * x - 7.0, 0.01 * y, objective="filter")
    assert one.training == FITS["hard"](x, y, objective="filter").training
    assert other.training.n_iterations == one.training.n_iterations
    shift = np.log(1000.0)  # of a log-density in other units
    assert other.training.score_filter == pytest.approx(one.training.score_filter - shift, abs=1e-4)
    assert other.training.score_joint == pytest.approx(one.training.score_joint - shift, abs=1e-4)


def test_the_joint_fit_stays_where_nothing_scores_better(short, monkeypatch) -> None:
    x, y = slow(400)
    monkeypatch.setattr(_KeptBack, "_score", lambda self, numbers, inflation=1.0: -float(len(self.scores)))
    fit = FITS["hard"](x, y, objective="filter")
    joint = FITS["hard"](x, y)
    assert fit.training.kept == "joint"
    assert fit.training.trace == ()
    assert fit.training.inflation == 1.0
    assert "kept the joint fit" in str(fit.summary())
    assert fit.log_likelihood == joint.log_likelihood
    np.testing.assert_array_equal(fit.model.transition, joint.model.transition)


class Parabola:
    """An objective with one number, and scores that fall from some iteration on."""

    def __init__(self, best):
        self.start, self._best, self.looks = np.array([30.0]), best, 0

    def value(self, numbers):
        # far from quadratic, so that there are many iterations
        return -float(np.log1p(numbers[0] ** 4)), -4.0 * numbers**3 / (1.0 + numbers**4)

    def scores(self, numbers, stretches, inflation=1.0):
        if inflation == 1.0:
            self.looks += 1
        at = (self.looks - 1) * LOOK if inflation == 1.0 else self._best
        return [np.array([5.0, np.nan, -abs(at - self._best) - abs(inflation - 2.0)])]


def kept_back(best):
    objective = Parabola(best)
    nothing = np.zeros((2, 0))
    x = np.array([[0.0], [np.nan], [1.0]])
    series = [Stretch(x, np.zeros((3, 1)), nothing, nothing, nothing, SimpleNamespace())]
    return objective, _KeptBack(objective, series, 1)


def test_a_search_ends_when_it_has_been_worse_for_long() -> None:
    _, kept = kept_back(2 * LOOK)
    went_on = [kept.look(k, np.array([float(k)])) for k in range(1, 10 * LOOK)]
    assert kept.best == 2 * LOOK
    assert all(went_on[: 2 * LOOK + PATIENCE - 1])
    assert not went_on[2 * LOOK + PATIENCE - 1]
    assert kept.scores[0] == -2.0 * LOOK - 1.0  # of the last measured state alone


def test_noise_is_widened_by_what_scores_best() -> None:
    _, kept = kept_back(LOOK)
    kept.look(LOOK, np.array([1.0]))
    assert kept.widened() == (2.0, 0.0)
    assert kept.scores == {0: -LOOK - 1.0, LOOK: -1.0}


def test_as_many_iterations_as_there_are_to_be() -> None:
    for most in (0, 1, 2):
        numbers, trace = _ascend(Parabola(0), most, None)
        assert len(trace) == most + 1
        assert trace == sorted(trace)
        assert (numbers == 30.0).all() == (most == 0)


def test_where_there_is_no_objective_a_step_is_taken_back() -> None:
    class Cliff(Parabola):
        def value(self, numbers):
            if abs(numbers[0]) < 3.0:
                raise np.linalg.LinAlgError("singular")
            return super().value(numbers)

    numbers, trace = _ascend(Cliff(0), 20, None)
    assert 3.0 <= abs(numbers[0]) < 30.0
    assert trace[-1] > trace[0]
    nowhere = Cliff(0)
    nowhere.start = np.array([1.0])
    numbers, trace = _ascend(nowhere, 20, None)
    assert numbers[0] == 1.0
    assert np.isnan(trace).tolist() == [True]


def test_what_cannot_be_is_refused() -> None:
    x, y = slow(400)
    with pytest.raises(ParameterError, match=r"^objective: got 'state', expected 'joint' or 'filter'"):
        FITS["hard"](x, y, objective="state")
    with pytest.raises(ParameterError, match=r"^r: got a switch with objective='filter'"):
        CGOMSModel.fit(x, y, (y > 0.0).astype(int), objective="filter")
    with pytest.raises(ParameterError, match=r"^objective: got 'filter' with form='covariance'"):
        CGOMSModel.fit(x, y, form="covariance", objective="filter")
    with pytest.raises(
        ParameterError, match="a fifth of the measured states, 18 of 90; expected at least 20"
    ):
        CGOMSModel.fit(x[:90], y[:90], objective="filter")


def test_it_is_learned_again_in_the_same_way(short) -> None:
    x, y = slow(300)
    fit = FITS["hard"](x, y, objective="filter")
    (again,) = fit.bootstrap(1, np.random.default_rng(0))
    assert again.training is not None


def test_states_that_were_measured_now_and_then_will_do(short) -> None:
    x, y = slow(900)
    x[np.arange(900) % 3 > 0] = np.nan
    fit = FITS["hard"](x, y, objective="filter", state_feedback=False)
    assert fit.training.n_kept_back == 60
    assert np.isfinite(fit.training.score_filter)
    assert not fit.model.placed().pair_tables(0).pairs.Axx.any()


@compiled
def test_no_variance_goes_to_zero_where_states_are_alike() -> None:
    x, y = slow(400)
    x = np.where(np.random.default_rng(0).random(400) < 0.8, 0.0, np.abs(x))
    fit = FITS["hard"](x, y, objective="filter")
    noise = fit.model.placed().pair_tables(0).pairs.C
    if fit.training.kept == "filter":
        assert noise.min() > 1e-5 * x.var()
    found = fit.model.filter().filter(y)
    assert np.isfinite(found.x).all()


def test_rows_that_cannot_be_learned_from_leave_the_joint_fit() -> None:
    x, y = slow(500)
    x[:400] = 1.0  # constant up to the states kept back
    fit = FITS["hard"](x, y, objective="filter")
    assert fit.training.kept == "joint"
    assert np.isnan(fit.training.score_joint)
    assert any("the rows before the 100 validation states are not sufficient" in w for w in fit.warnings)
    assert "kept the joint fit" in str(fit.summary())


def test_the_joint_score_is_that_of_a_fit_on_the_rows_before() -> None:
    # of one regime what the filter says of the state is a normal law
    x, y = slow(400)
    options = {"n_regimes": 1, "form": "regression"}
    training = CGOMSModel.fit(x, y, objective="filter", **options).training
    before = CGOMSModel.fit(x[:320], y[:320], **options).model
    found = before.filter().filter(y)
    z = (x - found.x[:, 0])[320:] / (std := np.sqrt(found.P[320:, 0, 0]))
    expected = np.mean(-0.5 * z**2 - np.log(std) - 0.5 * np.log(2.0 * np.pi))
    assert training.score_joint == pytest.approx(expected, abs=1e-3)  # a weak prior knows other units


def test_the_joint_fit_stays_where_the_states_learned_from_would_score_worse(monkeypatch) -> None:
    x, y = slow(800)
    assert FITS["hard"](x, y, objective="filter").training.kept == "filter"
    falling = iter((-1.0, -0.5))  # of what was trained, and of the joint fit
    monkeypatch.setattr(filter_training.FilterObjective, "mean_score", lambda *_: next(falling))
    fit = FITS["hard"](x, y, objective="filter")
    assert fit.training.kept == "joint"
    assert fit.training.score_filter > fit.training.score_joint


def test_the_joint_fit_stays_within_the_standard_error(monkeypatch) -> None:
    x, y = slow(800)
    lead = FITS["hard"](x, y, objective="filter").training
    assert lead.kept == "filter"
    gain = lead.score_filter - lead.score_joint
    for error, kept in ((0.99 * gain, "filter"), (1.01 * gain, "joint")):
        monkeypatch.setattr(_KeptBack, "standard_error", lambda *_, error=error: error)
        assert FITS["hard"](x, y, objective="filter").training.kept == kept

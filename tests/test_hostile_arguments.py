"""Arguments that are no good are refused by name, before they cost time or memory."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGOMSMFilter,
    DailyProfile,
    FuzzyMarkovLaw,
    GaussianMembership,
    GridMembership,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    Standardizer,
    TriangularMembership,
    compare_models,
    io,
)
from fuzzykf.base import as_many, as_observation, as_observations, check_keep
from fuzzykf.comparison import block_length, candidate, prepare
from fuzzykf.comparison.scores import bootstrap_rmse
from fuzzykf.errors import FuzzykfError, NumericalRangeError, ParameterError
from fuzzykf.kalman import predict, rts_smoother
from fuzzykf.possibility import RuleBase, compose, fuzzify
from fuzzykf.possibility.memberships import sampled
from fuzzykf.possibility.norms import MAX, PRODUCT, as_t_conorm, as_t_norm
from fuzzykf.results import bic, field_shapes
from fuzzykf.switching import CGLSSM


def cglssm():
    one = [[[0.5]], [[0.9]]]
    return CGLSSM([[0.9, 0.1], [0.2, 0.8]], A=one, B=one, C=one, D=one)


@pytest.mark.parametrize(
    "call",
    [
        lambda fuzzy, hard, rng: fuzzy.simulate(5, rng),
        lambda fuzzy, hard, rng: hard.simulate(5, rng),
        lambda fuzzy, hard, rng: cglssm().simulate(5, rng),
        lambda fuzzy, hard, rng: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).sample(5, rng),
        lambda fuzzy, hard, rng: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).sample(5, rng, 3),
        lambda fuzzy, hard, rng: fuzzy.law.discretize(3).sample(5, rng),
        lambda fuzzy, hard, rng: compare_models(np.zeros(500), np.zeros(500), rng),
        lambda fuzzy, hard, rng: bootstrap_rmse(np.ones((500, 2)), 100, rng),
    ],
)
@pytest.mark.parametrize("rng", [0, None, "seed", np.random])
def test_what_is_no_generator_is_named(call, rng, fuzzy_model, hard_model):
    with pytest.raises(ParameterError, match=r"rng: got \w+, expected a numpy.random.Generator") as raised:
        call(fuzzy_model, hard_model, rng)
    assert ("default_rng(0)" in str(raised.value)) == (rng == 0)


@pytest.mark.parametrize("n", [-1, 2.5, "3", None, True, np.nan, 10**15, 10**400])
def test_lengths_are_whole_and_not_too_large(n, fuzzy_model, hard_model):
    rng = np.random.default_rng(0)
    for draw in (fuzzy_model.simulate, hard_model.simulate, cglssm().simulate, fuzzy_model.law.sample):
        with pytest.raises(ParameterError, match=r"n: got .*, expected (a whole|at most)"):
            draw(n, rng)


@pytest.mark.parametrize("steps", [0, -1, 2.5, "3", None, True, np.nan, 10**15, 10**400])
def test_forecasts_are_of_a_length_that_can_be_kept(steps, fuzzy_model, hard_model):
    for f in (OFSRFilter(fuzzy_model, 3), CGOMSMFilter(hard_model)):
        with pytest.raises(ParameterError, match=r"steps: got .*, expected (a whole|at most)"):
            f.forecast(steps)


@pytest.mark.parametrize("threads", [0, -1, 2.5, "3", None, True, 10**8, 10**400])
def test_threads_are_no_more_than_a_machine_has(threads, fuzzy_model):
    with pytest.raises(ParameterError, match=r"threads: got .*, expected (a whole|at most 1,024)"):
        OFSRFilter(fuzzy_model, 3).filter_many(np.zeros((4, 5)), threads=threads)


@pytest.mark.parametrize("n_nodes", [-1, 2.5, "3", np.nan, True, 100_000, 10**400])
def test_nodes_are_no_more_than_memory_holds(n_nodes, fuzzy_model):
    message = "n_nodes: got .*, expected (a whole number of at least 0|at most 1000)"
    for call in (fuzzy_model.filter, fuzzy_model.law.discretize, lambda n: OFSRFilter(fuzzy_model, n)):
        with pytest.raises(ParameterError, match=message):
            call(n_nodes)


COMPLEX, HUGE = np.array([1 + 1j]), 10**400


def kalman():
    return KalmanFilter(2, 1, H=[[1.0, 0.0]])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: as_observation(COMPLEX, 1), "z"),
        (lambda: as_observation(HUGE, 1), "z"),
        (lambda: as_observations(3.0, 1), "zs"),
        (lambda: as_observations(np.array(3.0, dtype=object), 1), "zs"),
        (lambda: as_observations(COMPLEX, 1), "zs"),
        (lambda: as_many(COMPLEX, 1), "zs"),
        (lambda: check_keep(3, ("x",)), "keep"),
        (lambda: check_keep([[]], ("x",)), "keep"),
        (lambda: kalman().filter([1.0], us=3.0), "us"),
        (lambda: kalman().filter([1.0], us="text"), "us"),
        (lambda: kalman().batch_filter(None), "zs"),
        (lambda: kalman().batch_filter([1.0], Hs=object()), "Hs"),
        (lambda: kalman().predict(F=np.full((2, 2), np.nan)), "F"),
        (lambda: kalman().update(1.0, H=np.full((1, 2), np.inf)), "H"),
        (lambda: kalman().update(1.0, R=COMPLEX[0]), "R"),
        (lambda: kalman().update_sequential("", 1.0), "start"),
        (lambda: kalman().measurement_of_state([[np.inf], [0.0]]), "x"),
        (lambda: kalman().rts_smoother(3.0, np.ones((1, 2, 2))), "Xs"),
        (lambda: rts_smoother(np.full((2, 1), np.nan), np.ones((2, 1, 1)), [1.0] * 2, [1.0] * 2), "Xs"),
        (lambda: rts_smoother(np.ones((2, 1)), np.ones((2, 1, 1)), 1.0, [1.0] * 2), "Fs"),
        (lambda: predict(0.0, 1.0, alpha=None), "alpha"),
        (lambda: IMMEstimator(3, [0.5, 0.5], np.eye(2)), "filters"),
        (lambda: IMMEstimator([1.0, 2.0], [0.5, 0.5], np.eye(2)), "filters"),
        (lambda: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).joint_density([0.1, 0.2], [0.1] * 3), "r1, r2"),
        (lambda: FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).discretize(3, np.empty(0)), "rule"),
        (lambda: FuzzyMarkovLaw.from_density(np.eye(2) / 2, 0.1, 0.1, kinks=3.0), "kinks"),
        (lambda: GaussianMembership(0.0, 1.0).cost(np.zeros((1, 1)), 3), "t_norm"),
        (lambda: PRODUCT.renormalise(np.zeros(1), "1"), "best"),
        (lambda: GaussianMembership(0.0, 1.0).reach(np.array([-1.0])), "levels"),
        (lambda: GaussianMembership(HUGE, 1.0), "mean"),
        (lambda: TriangularMembership(-1.0, 0.0, 1.0).alpha_cut(np.array([0.5])), "level"),
        (lambda: GridMembership(np.inf, [0.0, 1.0]), "axes"),
        (lambda: sampled(3.0), "membership"),
        (lambda: fuzzify([0.0], "gaussian", COMPLEX), "scale|covariance"),
        (lambda: PRODUCT([0.1, 0.2], [0.1, 0.2, 0.3]), "memberships"),
        (lambda: PRODUCT.cost(-1.0), "membership"),
        (lambda: MAX([0.1, 0.2], axis=1.5), "axis"),
        (lambda: as_t_norm(np.zeros(2)), "t_norm"),
        (lambda: as_t_conorm([]), "t_conorm"),
        (lambda: compose({"a": 1.0}, [[1.0]]), "fuzzy_set"),
        (lambda: RuleBase.from_function(lambda x: x, [0.0]).predict(3, [[0.0], [0.0]]), "sets"),
        (lambda: RuleBase.from_function(lambda x: x, [0.0]).relation(3), "universes"),
        (lambda: Standardizer().fit(np.empty((0, 1))), "values"),
        (lambda: block_length([1.0, np.nan]), "series"),
        (lambda: candidate([]), "candidates"),
        (lambda: prepare(np.arange(200.0), np.arange(200.0), train={}), "train"),
        (lambda: bic(HUGE, 3, 0.0), "n_parameters"),
        (lambda: field_shapes(3.0), "names"),
        (lambda: io.save_model(3.0, "here"), "model"),
        (lambda: io.save_filter(None, "here"), "filter_"),
        (lambda: io.load_model(10**9), "path"),
        (lambda: cglssm().save(1), "path"),
    ],
)  # fmt: skip
def test_what_is_of_no_use_is_named(call, name):
    with pytest.raises(FuzzykfError, match=rf"(^|\W)({name})(\W|$)"):
        call()


@pytest.mark.parametrize("flag", ["yes", np.empty(0), [True, False], 2])
def test_flags_are_true_or_false(flag, fuzzy_model):
    for verb in ("filter", "smooth"):
        with pytest.raises(ParameterError, match=r"keep_nodes: got .*, expected True or False"):
            getattr(OFSRFilter(fuzzy_model, 3), verb)([0.1, 0.2], keep_nodes=flag)


def test_a_step_that_fails_leaves_what_was_predicted(fuzzy_model, hard_model):
    filters = [OFSRFilter(fuzzy_model, 3), CGOMSMFilter(hard_model), KnownSwitchFilter(fuzzy_model)]
    for f in filters:
        r = (0.0,) if isinstance(f, KnownSwitchFilter) else ()
        for z in (0.1, 0.2, 0.3):
            f.step(z, *r)
        twin = f.copy()
        for one in (f, twin):
            if not r:  # a known switch cannot be told twice
                one.predict()
        with pytest.raises(NumericalRangeError):
            f.step(1e300, *r)
        np.testing.assert_array_equal(f.S, twin.S)
        np.testing.assert_array_equal(f.step(0.4, *r), twin.step(0.4, *r))
        assert f.log_likelihood == twin.log_likelihood


def test_a_number_is_no_file_even_if_one_is_open(tmp_path, capsys):
    with pytest.raises(ParameterError, match="path: got int"):
        cglssm().save(1)
    assert capsys.readouterr().out == ""


RAGGED = [[1.0, 2.0], [1.0]]
HOURS = np.datetime64("2014-01-06T00:00", "s") + np.arange(4) * np.timedelta64(3600, "s")


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: GaussianMembership(0.0, RAGGED), "covariance"),
        (lambda: GaussianMembership(RAGGED, 1.0), "mean"),
        (lambda: GridMembership(RAGGED, [1.0, 1.0]), "axes"),
        (lambda: GridMembership([[1.0, [2.0]], 3.0], [1.0, 1.0]), "axes"),
        (lambda: GridMembership([1.0, 2.0], RAGGED), "values"),
        (lambda: DailyProfile().fit(np.arange(4.0), HOURS).at([["2014-01-06"], []]), "time"),
        (lambda: DailyProfile().fit(np.arange(4.0), HOURS).at("2014-01-06"), "time"),
        (lambda: DailyProfile().fit(np.arange(4.0), HOURS, RAGGED), "workday"),
        (lambda: KalmanFilter(2, 1).update(RAGGED), "z"),
    ],
)
def test_ragged_lists_are_named(call, name):
    with pytest.raises(FuzzykfError, match=rf"^{name}: "):
        call()

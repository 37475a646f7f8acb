"""The verbs of the switching filters: order, refusal, copies, series, what users read."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from filterpy.common import Saver

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
    engine,
)
from fuzzykf.errors import NumericalRangeError, ParameterError, QuadratureError, SequenceError, ShapeError
from fuzzykf.switching import EXACT, SwitchingFilter

ATTRIBUTES = (
    "x",
    "P",
    "x_prior",
    "P_prior",
    "mu",
    "switch",
    "switch_mean",
    "log_likelihood",
    "y",
    "S",
    "nis",
)


def snapshot(f):
    return {name: np.array(getattr(f, name)) for name in ATTRIBUTES}


def assert_same_state(a, b):
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.fixture(params=["fuzzy", "hard", "known"])
def make(request, fuzzy_model, hard_model):
    """A factory of filters, a series of observations, and how to give one to `step`."""
    if request.param == "fuzzy":
        data = fuzzy_model.simulate(12, np.random.default_rng(0))
        return lambda: OFSRFilter(fuzzy_model, 3), data.y, lambda f, k: f.step(data.y[k])
    if request.param == "hard":
        data = hard_model.simulate(12, np.random.default_rng(0))
        return lambda: CGOMSMFilter(hard_model), data.y, lambda f, k: f.step(data.y[k])
    data = fuzzy_model.simulate(12, np.random.default_rng(0))
    return lambda: KnownSwitchFilter(fuzzy_model), data.y, lambda f, k: f.step(data.y[k], data.r[k])


@pytest.fixture
def f(fuzzy_model):
    return OFSRFilter(fuzzy_model, 3)


@pytest.fixture
def y(fuzzy_model):
    return fuzzy_model.simulate(12, np.random.default_rng(0)).y[:, 0]


# --------------------------------------------------------------------------- order of verbs


def test_before_the_first_observation(f, fuzzy_model):
    # the initial law: moments of the mixture over the nodes
    chain = fuzzy_model.law.discretize(3)
    mean, covariance = fuzzy_model.form.marginal(chain.class_weights)
    x = chain.initial @ mean[:, 0]
    P = chain.initial @ (covariance[:, 0, 0] + (mean[:, 0] - x) ** 2)
    assert f.x.shape == (1, 1)
    assert f.x[0, 0] == pytest.approx(x)
    assert f.P[0, 0] == pytest.approx(P)
    np.testing.assert_array_equal(f.mu, chain.initial)
    np.testing.assert_array_equal(f.nodes, chain.nodes)
    assert f.log_likelihood == 0.0
    assert np.isnan(f.z).all()
    assert f.nis == f.mahalanobis == 0.0
    np.testing.assert_array_equal(f.y, [[0.0]])
    np.testing.assert_array_equal(f.S, [[0.0]])


def test_a_leading_predict_is_idempotent(f, y):
    before = snapshot(f)
    for _ in range(3):
        f.predict()
        assert_same_state(snapshot(f), before)
    f.update(y[0])
    g = f.copy()
    g.reset()
    g.update(y[0])  # the leading predict may be left out, too
    assert_same_state(snapshot(f), snapshot(g))


def test_two_updates_in_a_row_are_an_error(f, y):
    f.step(y[0])
    before = snapshot(f)
    with pytest.raises(SequenceError, match="update: called twice without a predict in between"):
        f.update(y[1])
    assert_same_state(snapshot(f), before)
    f.predict()
    f.update(y[1])


def test_after_predict_the_next_state_is_shown(f, y):
    f.step(y[0])
    mu = f.mu
    f.predict()
    np.testing.assert_array_equal(f.x, f.x_prior)
    np.testing.assert_array_equal(f.P, f.P_prior)
    np.testing.assert_allclose(f.mu, mu @ f.model.law.discretize(3).transition, rtol=1e-12)
    assert f.switch_mean == pytest.approx(f.mu @ f.nodes)
    prior = f.x, f.P
    np.testing.assert_array_equal(f.z, [[y[0]]])
    f.update(y[1])
    np.testing.assert_array_equal(f.x_prior, prior[0])
    np.testing.assert_array_equal(f.P_prior, prior[1])


@pytest.mark.parametrize(
    ("z", "error", "message"),
    [
        ([1.0, 2.0], ShapeError, r"z: got shape \(2,\), expected a scalar, \(1,\) or \(1, 1\)"),
        ("abc", ShapeError, "z: expected 1 number, got 'abc'"),
        (np.inf, ParameterError, r"z: got \[inf\], expected finite numbers"),
    ],
)
def test_refused_observations_leave_the_filter_as_it_was(make, y, z, error, message):
    factory, series, step = make
    if series.shape[1] != 1:
        pytest.skip("the messages are those of scalar observations")
    f = factory()
    for k in range(3):
        step(f, k)
        before = snapshot(f)
        arguments = (0.5,) if isinstance(f, KnownSwitchFilter) else ()
        with pytest.raises(error, match=message):
            f.step(z, *arguments)
        assert_same_state(snapshot(f), before)
        f.predict(*arguments)
        before = snapshot(f)
        with pytest.raises(error, match=message):
            f.update(z)
        assert_same_state(snapshot(f), before)
        f.update(series[k])
    # the whole series is refused before anything changes
    before = snapshot(f)
    with pytest.raises(error):
        f.filter([0.0, z], *([[0.5, 0.5]] if isinstance(f, KnownSwitchFilter) else []))
    assert_same_state(snapshot(f), before)


# --------------------------------------------------------------------------- copies, reset, reuse


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_an_absurd_step_after_a_predict_leaves_the_filter_as_it_was(make, steps):
    factory, _, step = make
    f = factory()  # the predict that was called already stands for a gap, which the step takes first
    arguments = (0.5,) if isinstance(f, KnownSwitchFilter) else ()
    for k in range(steps):
        step(f, k)
    f.predict(*arguments)
    before, twin = snapshot(f), f.copy()
    with pytest.raises(NumericalRangeError):
        f.step(np.full(f.dim_z, 1e300), *arguments)
    assert_same_state(snapshot(f), before)
    z = np.full(f.dim_z, 0.2)
    np.testing.assert_array_equal(f.step(z, *arguments), twin.step(z, *arguments))
    assert_same_state(snapshot(f), snapshot(twin))


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda f: f.copy(),
                                       lambda f: pickle.loads(pickle.dumps(f))])  # fmt: skip
def test_copies_go_their_own_way(make, duplicate):
    factory, _series, step = make
    f = factory()
    for start in (0, 1, 4):  # before, and after updates
        f.reset()
        for k in range(start):
            step(f, k)
        before = snapshot(f)
        g = duplicate(f)
        assert_same_state(snapshot(g), before)
        for k in range(start, 8):
            step(g, k)
        assert_same_state(snapshot(f), before)
        for k in range(start, 8):
            step(f, k)
        assert_same_state(snapshot(f), snapshot(g))


def test_copies_share_the_model(make):
    f = make[0]()
    for g in (f.copy(), copy.deepcopy(f)):
        assert g.model is f.model
        assert g._system is f._system or isinstance(f, KnownSwitchFilter)


def test_copying_between_predict_and_update(f, y):
    f.step(y[0])
    f.predict()
    g = pickle.loads(pickle.dumps(f))
    assert_same_state(snapshot(f), snapshot(g))
    for one in (f, g):
        one.update(y[1])
    assert_same_state(snapshot(f), snapshot(g))


def test_reset_returns_to_the_start(make):
    factory, _series, step = make
    f, fresh = factory(), snapshot(factory())
    for k in range(5):
        step(f, k)
    after = snapshot(f)
    f.reset()
    assert_same_state(snapshot(f), fresh)
    f.predict(*([0.3] if isinstance(f, KnownSwitchFilter) else []))
    f.reset()
    assert_same_state(snapshot(f), fresh)
    for k in range(5):
        step(f, k)
    assert_same_state(snapshot(f), after)


def test_filter_starts_anew_and_ends_at_the_last_observation(f, y):
    g = f.copy()
    for z in y[:4]:
        f.step(z)
    result = f.filter(y)
    for z in y:
        g.step(z)
    for name in ATTRIBUTES:
        np.testing.assert_allclose(getattr(f, name), getattr(g, name), rtol=1e-12, atol=1e-13, err_msg=name)
    np.testing.assert_allclose(f.x[:, 0], result.x[-1], rtol=1e-13)
    with pytest.raises(SequenceError):
        f.update(0.0)
    f.predict()
    f.update(0.3)
    g.step(0.3)
    np.testing.assert_allclose(f.x, g.x, rtol=1e-12)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4])
def test_short_series(f, y, n):
    result = f.filter(y[:n])
    assert (result.x.shape, result.P.shape, result.mu.shape) == ((n, 1), (n, 1, 1), (n, 5))
    assert (result.x_prior.shape, result.P_prior.shape) == ((n, 1), (n, 1, 1))
    assert (result.switch.shape, result.switch_mean.shape, result.log_likelihood.shape) == ((n,), (n,), (n,))
    assert len(result) == n
    g = f.copy()
    g.reset()
    for z in y[:n]:
        g.step(z)
    np.testing.assert_allclose(f.step(0.2), g.step(0.2), rtol=1e-12)


# --------------------------------------------------------------------------- what goes in and comes out


@pytest.mark.parametrize(
    "convert",
    [
        list,
        tuple,
        iter,
        lambda y: (z for z in y),
        lambda y: y[:, None],
        lambda y: y[:, None, None],
        lambda y: [[z] for z in y],
        lambda y: [np.array([[z]]) for z in y],
        lambda y: y.astype(object),
        pd.Series,
        lambda y: pd.DataFrame({"temperature": y}),
    ],
)
def test_spellings_of_a_series(f, y, convert):
    expected = f.filter(y)
    result = f.filter(convert(y))
    for name in ("x", "P", "mu", "log_likelihood"):
        np.testing.assert_array_equal(getattr(result, name), getattr(expected, name))


def test_pandas_keep_their_index(make):
    factory, series, _ = make
    f, index = factory(), pd.date_range("2014-01-01", periods=12, freq="h")
    extra = [np.linspace(0, 1, 12)] if isinstance(f, KnownSwitchFilter) else []
    result = f.filter(pd.DataFrame(series, index=index), *extra)
    assert result.index is index or result.index.equals(index)
    frame = result.to_dataframe()
    assert frame.index.equals(index)
    np.testing.assert_array_equal(frame["log_likelihood"], result.log_likelihood)
    assert f.filter(series, *extra).to_dataframe().index.tolist() == list(range(12))


def test_observations_of_any_shape(f, hard_model):
    for z in (0.5, np.float32(0.5), [0.5], [[0.5]], np.array(0.5), np.array([[0.5]])):
        g = f.copy()
        assert g.step(z).shape == (1, 1)
        assert g.z == pytest.approx(0.5)
    with pytest.raises(
        ShapeError, match=r"zs: got shape \(3, 2\), expected \(n, 1\) or \(n, 1, 1\) or \(n,\)"
    ):
        f.filter(np.zeros((3, 2)))
    h = CGOMSMFilter(hard_model)
    assert h.step(1).shape == (2, 1)
    assert (h.P.shape, h.y.shape, h.S.shape, h.mu.shape) == ((2, 2), (1, 1), (1, 1), (3,))


def test_results_do_not_share_memory_with_the_filter(f, y):
    given = y.copy()
    result = f.filter(given)
    x, mu = f.x, f.mu
    for array in (result.x, result.P, result.mu, f.x, f.P, f.mu, f.y, f.S, f.z, given):
        array[:] = 99.0
    np.testing.assert_array_equal(f.x, x)
    np.testing.assert_array_equal(f.mu, mu)
    assert f.z[0, 0] == y[-1]
    assert f.step(0.1)[0, 0] == pytest.approx(f.copy().filter([*y, 0.1]).x[-1, 0], rel=1e-12)


def test_filterpy_saver(make):
    # it reads every attribute and property, before and after updates
    factory, _series, step = make
    f = factory()
    saver = Saver(f)
    for k in range(6):
        step(f, k)
        saver.save()
    saver.to_array()
    assert saver.x.shape == (6, f.dim_x, 1)
    assert saver.P.shape == (6, f.dim_x, f.dim_x)
    assert np.isfinite(saver.log_likelihood).all()
    np.testing.assert_array_equal(saver.x[-1], f.x)
    g = factory()
    saver = Saver(g)
    saver.save()  # before anything happened
    assert len(saver.x) == 1


def test_a_system_of_your_own(fuzzy_model, y):
    # any object that answers initial() and pair_tables(n) can be filtered
    class Twice:
        """Tables that depend on time: those of the paper at even steps, the same later."""

        def __init__(self, steady_from):
            self.inner = fuzzy_model.on_nodes(3)
            self.chain, self.dim_x, self.dim_z, self.order = self.inner.chain, 1, 1, 1
            self.steady_from, self.asked = steady_from, []

        def initial(self):
            return self.inner.initial()

        def pair_tables(self, n):
            self.asked.append(n)
            return self.inner.pair_tables(n)

    expected = OFSRFilter(fuzzy_model, 3).filter(y)
    for steady_from in (None, 0, 3, 50):
        system = Twice(steady_from)
        result = SwitchingFilter(system).filter(y)
        np.testing.assert_allclose(result.x, expected.x, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(result.x_prior, expected.x_prior, rtol=1e-11, atol=1e-13)
        needed = set(range(11)) if steady_from in (None, 50) else set(range(steady_from + 1))
        assert needed <= set(system.asked) <= set(range(11))


# --------------------------------------------------------------------------- numbers at the edge


def test_a_node_whose_probability_underflows(fuzzy_model):
    # an outlier makes all but one node impossible in floating point; moments stay right
    f = OFSRFilter(fuzzy_model, 3)
    for z in (0.0, 400.0, -400.0, 1e6, 0.5):
        f.step(z)
        assert f.mu.sum() == pytest.approx(1.0, abs=1e-9)
        assert np.isfinite(f.x).all()
        assert np.isfinite(f.log_likelihood)
        assert f.P[0, 0] > 0
    assert (f.filter([0.0, 1e6]).mu[-1] == 0.0).any()


def test_log_likelihood_of_a_distant_observation(fuzzy_model):
    # the densest node dominates: log N of it plus its weight, to first order in 1e6^2
    f = OFSRFilter(fuzzy_model, 0)
    f.step(1e6)
    chain = fuzzy_model.law.discretize(0)
    candidates = [np.log(p) - 0.5 * ((1e6 - m) ** 2 / v + np.log(2 * np.pi * v))
                  for p, m, v in zip(chain.initial, [3.0, 0.0], [1.0, 0.5], strict=True)]  # fmt: skip
    assert f.log_likelihood == pytest.approx(max(candidates), rel=1e-14)


def separate_regimes(distance):
    """Two regimes that are never left, with observations N(distance, 1) and N(0, 1)."""
    one = np.ones((2, 2, 1, 1))
    return CGOMSModel.from_regressions(
        np.eye(2), initial=[0.5, 0.5],
        Ayy=0 * one, Ny=[[[distance], [0.0]]] * 2, Qyy=one,
        Axx=0 * one, H=0 * one, G=0 * one, c=0 * one[..., 0], C=one,
        means=[[0.0, distance], [1.0, 0.0]], covariances=[np.eye(2)] * 2,
    )  # fmt: skip


@pytest.mark.parametrize("distance", [37.5, 38.0, 38.5, 39.0, 60.0])
def test_a_regime_comes_back_from_underflow(distance):
    # exp(-distance^2 / 2) is subnormal or zero in floating point, its logarithm is not: after
    # as strong an argument for the other regime both are as probable as at first
    model = separate_regimes(distance)
    f = CGOMSMFilter(model)
    for z in (distance / 2, distance, 0.0):
        f.step(z)
    np.testing.assert_allclose(f.mu, [0.5, 0.5], rtol=1e-11)
    np.testing.assert_allclose(f.filter([distance / 2, distance, 0.0]).mu[-1], [0.5, 0.5], rtol=1e-11)


def test_the_first_state_may_be_determined_by_its_observation():
    # Var(X | Y) = 0, computed as a difference: never negative
    for b, v in np.random.default_rng(0).uniform(0.5, 2.0, (40, 2)):
        one = np.ones((1, 1, 1, 1))
        model = CGOMSModel.from_regressions(
            [[1.0]], Ayy=one / 2, Ny=one[0], Qyy=one, Axx=one / 2, H=one, G=one, c=0 * one[0], C=one,
            means=[[0.0, 0.0]], covariances=[[[b * b * v, b * v], [b * v, v]]],
        )  # fmt: skip
        f = CGOMSMFilter(model)
        assert f.step(2.0)[0, 0] == pytest.approx(2 * b)
        assert 0.0 <= f.P[0, 0] < 1e-14


@pytest.mark.parametrize(
    ("n_nodes", "outlier", "first_bad", "message"),
    [
        (15, 8.0, 4, r"interpolant has a negative mass of 0\.09\d+ \(at most"),
        (20, 1e6, 3, "has no positive mass"),
    ],
)
def test_a_rule_that_is_too_coarse_says_so(n_nodes, outlier, first_bad, message):
    # the interpolant of the rule 'product' becomes negative: no number is better than a wrong one
    law = FuzzyMarkovLaw.fmc2(0.1, 0.8 / 1.71, 0.3)
    Z = np.array([[1.0, 0.5], [0.5, 1.0]])
    gamma = np.broadcast_to(np.block([[Z, 0.8 * Z], [0.8 * Z, Z]]), (2, 2, 4, 4))
    f = OFSRFilter(CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], gamma, 1), n_nodes, "product")
    y = [1.0, 2.0, 3.0, outlier, 0.0]
    fresh = snapshot(f)
    with pytest.raises(QuadratureError, match=message):
        f.filter(y)
    assert_same_state(snapshot(f), fresh)
    for z in y[:first_bad]:
        f.step(z)
    before = snapshot(f)
    with pytest.raises(QuadratureError, match=message):
        f.step(y[first_bad])
    assert_same_state(snapshot(f), before)
    f.predict()
    before = snapshot(f)
    with pytest.raises(QuadratureError, match=message):
        f.update(y[first_bad])
    assert_same_state(snapshot(f), before)


def test_series_and_steps_agree_to_rounding(fuzzy_model):
    # whole series carry masses that are not normalised at each step; nothing is lost by that
    y = np.random.default_rng(0).normal(1.5, 1.5, 4000)
    for n_nodes in (0, 5):
        f = OFSRFilter(fuzzy_model, n_nodes)
        series = f.filter(y).log_likelihood
        f.reset()
        steps = []
        for z in y:
            f.step(z)
            steps.append(f.log_likelihood)
        np.testing.assert_allclose(series, steps, rtol=0, atol=2e-13)


@pytest.mark.parametrize("m", [1, 2])
def test_regimes_that_no_path_reaches_have_no_influence(m, make_transitions):
    # an explosive regime of probability zero must not overflow, nor touch the result
    P = [[0.9, 0.1, 0.0], [0.1, 0.9, 0.0], [0.3, 0.3, 0.4]]
    A, Q, means, Sigma = make_transitions(3, m, 1, seed=3)
    y = np.random.default_rng(0).normal(size=600)
    y[200:500] = np.nan
    results = []
    for a in (0.5, 50.0):
        A[2, 2] = a * np.eye(m + 1)
        f = CGOMSMFilter(CGOMSModel.from_transitions(P, A, Q, means, Sigma, m))
        results.append(f.filter(y))
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        a, b = (getattr(result, name) for result in results)
        assert np.isfinite(a).all()
        np.testing.assert_allclose(a, b, rtol=1e-12, err_msg=name)
    assert (results[0].mu[:, 2] == 0).all()


def test_a_million_steps(fuzzy_model):
    n = 1_000_000 if engine.info().name == "compiled" else 100_000  # NumPy takes thirty times as long
    y = np.random.default_rng(3).normal(1.5, 1.5, n)
    f = OFSRFilter(fuzzy_model, 5)
    result = f.filter(y)
    assert np.isfinite(result.log_likelihood).all()
    assert result.P.min() > 0.1
    assert result.P.max() < 10.0
    assert result.P_prior.min() > 0.1
    assert np.abs(result.mu.sum(axis=1) - 1).max() < 1e-12
    # the last stretch does not remember the beginning: no error has piled up
    again = OFSRFilter(fuzzy_model, 5).filter(y[-2000:])
    np.testing.assert_allclose(result.x[-1000:], again.x[-1000:], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(result.log_likelihood[-1000:], again.log_likelihood[-1000:], rtol=1e-9)


def test_many_steps_of_a_vector_keep_symmetry(hard_model):
    y = np.random.default_rng(3).normal(0.0, 2.0, 20_000)
    result = CGOMSMFilter(hard_model).filter(y, keep_nodes=True)
    for P in (result.P, result.P_prior, result.node_P):
        np.testing.assert_array_equal(P, np.swapaxes(P, -1, -2))
    assert np.linalg.eigvalsh(result.P).min() > 1e-3
    assert np.linalg.eigvalsh(result.P_prior).min() > 1e-3


def test_a_filter_does_not_hold_on_to_a_series(hard_model):
    f = CGOMSMFilter(hard_model)
    f.filter(np.zeros(1000))
    for mixture in (f._mixture, f._before.mixture):
        assert mixture.table.base is None
        assert mixture.window.base is None


def test_a_method_of_ones_own(hard_model):
    class Counting(type(EXACT)):
        """Exact, but it counts."""

        def __init__(self):
            self.calls = []

        def first(self, law, y):
            self.calls.append("first")
            return super().first(law, y)

        def advance(self, tables, mixture, y, width):
            self.calls.append("advance")
            return super().advance(tables, mixture, y, width)

    method, ys = Counting(), [0.1, 0.4, None, -0.2]
    system = hard_model.placed()
    f, g = SwitchingFilter(system, method), SwitchingFilter(system)
    for y in ys:
        np.testing.assert_allclose(f.step(y), g.step(y), rtol=1e-13)
    assert method.calls == ["first", "advance", "advance", "advance"]
    np.testing.assert_allclose(f.filter(ys).x, g.filter(ys).x, rtol=1e-13)
    np.testing.assert_allclose(f.forecast(2).P, g.forecast(2).P, rtol=1e-13)
    assert f.copy()._method.calls == method.calls
    assert g.copy()._method is EXACT


def test_a_state_survives_a_change_of_engine(tmp_path):
    # written by one engine, read by the other, in either direction
    code = """
import pickle, sys
import numpy as np
from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter, engine
z = np.array([[1.0, 0.5], [0.5, 1.0]])
pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
model = CGOFMSModel(law, [[0.0, 0.0], [3.0, 3.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)
path, write = sys.argv[1], sys.argv[2] == "write"
if write:
    f = OFSRFilter(model)
    for y in (0.1, 2.0, -0.4, 1.0):
        f.step(y)
    with open(path, "wb") as file:
        pickle.dump(f, file)
else:
    with open(path, "rb") as file:
        f = pickle.load(file)
print(engine.info().name, f._n, f.x.item(), f.P.item(), f.step(0.7).item(), f.log_likelihood)
"""

    def run(engine_name, path, verb):
        environment = {**os.environ, "FUZZYKF_ENGINE": engine_name}
        command = [sys.executable, "-c", code, str(path), verb]
        told = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
        name, *numbers = told.split()
        assert name == engine_name
        return [float(number) for number in numbers]

    if engine.info().name == "numpy":
        pytest.skip("one engine alone")
    for one, other in (("numpy", "compiled"), ("compiled", "numpy")):
        written = run(one, tmp_path / one, "write")
        np.testing.assert_allclose(run(other, tmp_path / one, "read"), written, rtol=1e-12)


def test_many_series_through_a_chain_with_negative_weights(fuzzy_model):
    law, form = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2), fuzzy_model.form
    f = OFSRFilter(CGOFMSModel(law, form.means, form.covariances, 1), 8, "product")
    assert (f.model.placed(8, "product").chain.transition < 0.0).any()
    ys = fuzzy_model.simulate(30, np.random.default_rng(5)).y[:, 0].reshape(3, 10)
    many = f.filter_many(ys, keep=("x", "mu"))
    for k, one in enumerate(ys):
        np.testing.assert_allclose(many.x[k], f.filter(one).x, rtol=1e-12)
        np.testing.assert_allclose(many.mu[k], f.filter(one).mu, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("verb", ["filter", "smooth"])
def test_a_series_of_one_observation_leaves_what_a_step_leaves(verb, fuzzy_model, hard_model):
    for make in (lambda: OFSRFilter(fuzzy_model, 3), lambda: CGOMSMFilter(hard_model)):
        for series in ([0.4], [np.nan]):
            stepped, filtered = make(), make()
            stepped.step(series[0])
            getattr(filtered, verb)(series)
            for name in (
                "x",
                "P",
                "x_prior",
                "P_prior",
                "mu",
                "y",
                "S",
                "nis",
                "mahalanobis",
                "log_likelihood",
            ):
                one, other = getattr(filtered, name), getattr(stepped, name)
                np.testing.assert_allclose(one, other, rtol=1e-12, err_msg=name)

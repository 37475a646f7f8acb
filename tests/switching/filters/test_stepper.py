"""The compiled step of a switching filter does what its verbs and whole series do."""

from __future__ import annotations

import copy
import pickle
import sys

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FuzzyMarkovLaw,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
    engine,
)
from fuzzykf.errors import NumericalRangeError, ParameterError

pytestmark = [
    pytest.mark.usefixtures("instructions"),
    pytest.mark.skipif(engine.info().name == "numpy", reason="the tests run on the NumPy engine"),
]


def vector_model(m, q):
    rng = np.random.default_rng(6)
    d = m + q
    root = rng.normal(size=(2 * d, 2 * d)) * 0.3 + np.eye(2 * d)
    pair = root @ root.T
    pair[d:, d:] = pair[:d, :d]
    pair[d:, :d] = 0.3 * pair[:d, :d]
    pair[:d, d:] = pair[d:, :d].T
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(d), np.ones(d)], np.broadcast_to(pair, (2, 2, 2 * d, 2 * d)), m)


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (4, 2)])
def test_steps_filter_and_verbs_agree(size) -> None:
    # three ways to the same numbers: the compiled step, the compiled series, the verbs in Python
    model = vector_model(*size)
    y = model.simulate(60, np.random.default_rng(0)).y
    y[20] *= 40.0  # an outlier: the fast step hands over to logarithms and back
    whole = OFSRFilter(model).filter(y)
    f, g = OFSRFilter(model), OFSRFilter(model)
    for k, z in enumerate(y):
        x = f.step(z if k % 2 else (float(z[0]) if z.size == 1 else z.tolist()))
        g.predict()
        g.update(z)
        np.testing.assert_array_equal(x, f.x)
        for one in (f, g):
            for name in ("x", "P", "x_prior", "P_prior", "mu", "switch_mean", "log_likelihood"):
                value = np.squeeze(getattr(one, name))
                np.testing.assert_allclose(value, np.squeeze(getattr(whole, name)[k]), rtol=1e-9, atol=1e-11)


def test_reading_copying_and_saving_do_not_change_what_follows(tmp_path, fuzzy_model) -> None:
    y = fuzzy_model.simulate(40, np.random.default_rng(1)).y
    plain, read = OFSRFilter(fuzzy_model), OFSRFilter(fuzzy_model)
    for k, z in enumerate(y):
        assert plain.step(z) == read.step(z)
        _ = read.P, read.mu, read.x_prior, read.log_likelihood
        if k % 4 == 1:
            read = copy.deepcopy(read)
        elif k % 4 == 2:
            read = pickle.loads(pickle.dumps(read))
        elif k % 4 == 3:
            read.save(tmp_path / "f.json")
            read = OFSRFilter.load(tmp_path / "f.json")
    assert plain.log_likelihood == read.log_likelihood
    np.testing.assert_array_equal(plain.P, read.P)


def test_the_compiled_step_takes_over_and_hands_back(monkeypatch, fuzzy_model) -> None:
    slow = []
    original = OFSRFilter._step_any
    monkeypatch.setattr(OFSRFilter, "_step_any", lambda self, z: slow.append(z) or original(self, z))
    f = OFSRFilter(fuzzy_model)
    for z in (1.0, 2.0, 3.0, 0.5, None, 1.0, float("nan"), np.array([np.nan]), 2.0, 3.0):
        f.step(z)
    assert slow == [1.0, 2.0]  # the first has no tables, the second hands over
    with pytest.raises(ValueError, match="z: got"):
        f.step([1.0, 2.0])
    with pytest.raises(ValueError, match="z: got"):
        f.step(float("inf"))
    f.step(3.0)
    assert f.z == 3.0


def test_a_subclass_that_overrides_a_verb_is_not_bypassed(fuzzy_model) -> None:
    class Counting(OFSRFilter):
        count = 0

        def _take(self, y):
            self.count += 1
            super()._take(y)

    f = Counting(fuzzy_model)
    for z in range(5):
        f.step(float(z))
    assert f.count == 5


#: What can be read of a filter.
READ = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood", "z", "y", "S", "nis")


def are_alike(f, g) -> None:
    """Whether two filters say the same, and know the same of what is missing."""
    for name in READ:
        np.testing.assert_allclose(getattr(f, name), getattr(g, name), rtol=1e-12, atol=1e-12, err_msg=name)
    for one, other in ((f._mixture, g._mixture), (f._before.mixture, g._before.mixture)):
        assert (one.unknown, one.branches is None) == (other.unknown, other.branches is None)
        np.testing.assert_array_equal(one.window, other.window)
        np.testing.assert_allclose(one.table, other.table, rtol=1e-11, atol=1e-12)
        if one.branches is not None:
            np.testing.assert_allclose(one.branches.table, other.branches.table, rtol=1e-11, atol=1e-12)


def gappy(model, n=28):
    """Observations with single gaps, a long one, parts missing and an outlier, the first two complete."""
    y = model.simulate(n, np.random.default_rng(8)).y
    gone = np.random.default_rng(9).random(y.shape) < 0.3
    gone[:2], gone[14:18], gone[18], gone[22] = False, True, False, False
    y[22] *= 40.0
    return np.where(gone, np.nan, y)


def of_order_two():
    one = [[[0.8]], [[0.5]]]
    return CGOMSModel.from_cglssm([[0.9, 0.1], [0.25, 0.75]], one, one, one, one, order=2)


@pytest.mark.parametrize(
    ("make", "model"),
    [
        (OFSRFilter, vector_model(1, 1)),
        (OFSRFilter, vector_model(2, 2)),
        (CGOMSMFilter, of_order_two()),
    ],
    ids=["scalar", "vectors", "order 2"],
)
def test_steps_in_gaps_are_those_of_the_verbs(make, model) -> None:
    # whatever is read in between, and however often the state leaves the compiled core in a gap
    y = gappy(model)
    read, unread, copied, verbs = make(model), make(model), make(model), make(model)
    for k, z in enumerate(y):
        for f in (read, unread):
            f.step(None if np.isnan(z).all() and k % 2 else z)
        copied = pickle.loads(pickle.dumps(copied)) if k % 3 else copy.copy(copied)
        copied.step(z)
        verbs.predict()
        if k != 15:  # a predict after a predict stands for a missing observation
            verbs.update(z)
            if k > 0:
                are_alike(copied if k % 4 == 0 else read, verbs)
    are_alike(unread, verbs)


@pytest.mark.parametrize("size", [(1, 1), (2, 2)])
@pytest.mark.parametrize("way", ["from the start", "copied", "pickled", "loaded", "left by filter"])
def test_the_engine_takes_over_in_a_gap(size, way, tmp_path) -> None:
    f = OFSRFilter(vector_model(*size))
    y = f.model.simulate(14, np.random.default_rng(1)).y
    y[3:7] = np.nan
    begun = 5
    if way == "from the start":
        y[:5], begun = np.nan, 0
    for z in y[:begun]:
        f.step(z)
    g = f.copy()
    if way == "pickled":
        g = pickle.loads(pickle.dumps(f))
    elif way == "loaded":
        f.save(tmp_path / "f.json")
        g = OFSRFilter.load(tmp_path / "f.json")
    elif way == "left by filter":
        g = OFSRFilter(f.model)
        g.filter(y[:begun])
    calls = []  # of functions in Python
    for k, z in enumerate(y[begun:]):
        calls.clear()
        sys.setprofile(lambda _, event, __: calls.append(event) if event == "call" else None)
        try:
            x = g.step(z)
        finally:
            sys.setprofile(None)
        f.predict()
        f.update(z)
        np.testing.assert_allclose(x, f.x, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(g.P, f.P, rtol=1e-11, atol=1e-13)
        assert g.log_likelihood == pytest.approx(f.log_likelihood, rel=1e-11, abs=1e-13)
        if k > 1:  # the first two hand over
            assert not calls


def test_a_predict_in_a_gap_goes_on_from_what_the_engine_knows(fuzzy_model) -> None:
    f, g = OFSRFilter(fuzzy_model), OFSRFilter(fuzzy_model)
    for z in (0.4, 1.0, 0.2, None):
        f.step(z)
        g.predict()
        g.update(z)
    for one in (f, g):
        one.predict()
        one.predict()
    are_alike(f, g)
    f.update(0.7)  # at the time of the second predict
    g.update(0.7)
    are_alike(f, g)


@pytest.mark.parametrize("in_gap", [False, True])
def test_a_refused_step_leaves_a_gap_as_it_was(in_gap, fuzzy_model) -> None:
    f, g = OFSRFilter(fuzzy_model), OFSRFilter(fuzzy_model)
    for one in (f, g):
        for z in (0.4, 1.0, 0.2, 0.3, None, *[0.1] * (not in_gap)):
            one.step(z)
    before = pickle.dumps(g)
    for z in (np.inf, 1e200, [1.0, 2.0], np.array([np.nan, 1.0])):
        with pytest.raises((ParameterError, NumericalRangeError), match="got"):
            f.step(z)
        assert pickle.dumps(f) == before
    for z in (None, 0.4, 0.1):
        np.testing.assert_allclose(f.step(z), g.step(z), rtol=1e-13)


def test_an_outlier_after_a_gap_keeps_its_digits(fuzzy_model) -> None:
    # the core leaves it to the verbs, from the state before
    f, g = OFSRFilter(fuzzy_model), OFSRFilter(fuzzy_model)
    for z in (0.4, 1.0, 0.2, None, 1e4, 0.3, None, 0.2):
        f.step(z)
        g.predict()
        g.update(z)
        assert np.isfinite(f.log_likelihood)
        if g._before is not None:
            are_alike(f, g)


@pytest.mark.parametrize("method", ["imm", "gpb2"])
def test_steps_on_nodes_take_gaps(method, monkeypatch) -> None:
    H = [[1.0, 0.0], [0.3, 1.0]]
    model = SwitchingStateSpace(
        FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
        [[[0.9, 0.1], [0.0, 0.8]], [[0.5, 0.0], [0.2, 0.7]]],
        H,
        [0.1 * np.eye(2), np.eye(2)],
        0.2 * np.eye(2),
    )
    f, g = (SwitchingKalmanFilter(model, method=method) for _ in range(2))
    slow = []
    original = SwitchingKalmanFilter._step_any
    monkeypatch.setattr(
        SwitchingKalmanFilter, "_step_any", lambda self, z: slow.append(z) or original(self, z)
    )
    y = np.random.default_rng(0).normal(size=(30, 2))
    y[np.random.default_rng(1).random(y.shape) < 0.3] = np.nan
    y[:2] = 0.1
    for k, z in enumerate(y):
        f.step(None if np.isnan(z).all() else z)
        g.predict()
        g.update(z)
        if k:
            are_alike(f, g)
    assert len(slow) == 2


@pytest.mark.parametrize("size", [(1, 1), (4, 2)])
def test_many_series_do_not_depend_on_threads_nor_on_company(size) -> None:
    model = vector_model(*size)
    rng = np.random.default_rng(2)
    ys = np.stack([model.simulate(30, rng).y for _ in range(7)])
    ys[3, 12] = np.nan  # goes alone
    f = OFSRFilter(model)
    keep = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")
    one, three = f.filter_many(ys, keep), f.filter_many(ys, keep, threads=3)
    for name in keep:
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))
        np.testing.assert_array_equal(getattr(one, name)[1], getattr(OFSRFilter(model).filter(ys[1]), name))


def test_a_summarised_series_is_that_of_the_states(hard_model) -> None:
    # `keep_nodes` goes the other way, through the states of all nodes
    from fuzzykf import CGOMSMFilter

    assert isinstance(hard_model, CGOMSModel)
    y = hard_model.simulate(80, np.random.default_rng(3)).y
    short, long = CGOMSMFilter(hard_model).filter(y), CGOMSMFilter(hard_model).filter(y, keep_nodes=True)
    for name in ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood"):
        np.testing.assert_allclose(getattr(short, name), getattr(long, name), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("mode", [{"order": 2}, {"mode": "time_varying", "initial_probability": [1.0, 0.0]}])
def test_a_series_alone_goes_the_way_of_many(mode) -> None:
    # while tables still change, a thread with one series must not step where one with several filters
    one = [[[0.8]], [[0.5]]]
    model = CGOMSModel.from_cglssm(
        [[0.9, 0.1], [0.25, 0.75]], A=one, B=[[[1.0]], [[1.0]]], C=one, D=one, **mode
    )
    f, ys = CGOMSMFilter(model), np.random.default_rng(0).normal(size=(5, 20))
    many, exact = f.filter_many(ys).P, engine.info().name == "compiled"
    for k, alone in enumerate((f.filter_many(ys, threads=5).P, [f.filter_many(y[None]).P[0] for y in ys])):
        np.testing.assert_allclose(alone, many, rtol=0.0 if exact else 1e-13, err_msg=str(k))


def test_one_model_serves_many_threads(fuzzy_model) -> None:
    from concurrent.futures import ThreadPoolExecutor

    y = fuzzy_model.simulate(200, np.random.default_rng(4)).y[:, 0].tolist()

    def work(_):
        f = OFSRFilter(fuzzy_model)
        return [f.step(z)[0, 0] for z in y]

    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(work, range(8))
    assert all(one == first for one in others)

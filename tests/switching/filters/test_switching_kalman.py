"""The filter of switching state-space models: verbs, what they are told, series, files, what is refused."""

from __future__ import annotations

import copy
import functools
import pickle

import filterpy.common
import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    FadeLaw,
    FuzzyMarkovLaw,
    GraphLaw,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import (
    FileFormatError,
    NotPositiveDefiniteError,
    NumericalRangeError,
    ParameterError,
    SequenceError,
    ShapeError,
)
from fuzzykf.switching import GPB2, IMM, SwitchingFilter
from fuzzykf.switching.inference.series import SHOWN
from fuzzykf.testing import check_filter

METHODS = ["imm", "gpb2"]
T = [[0.9, 0.1], [0.3, 0.7]]
RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})
LAWS = {
    "matrix": T,
    "one regime": [[1.0]],
    "fades": FadeLaw.between(40, 10),
    "fmc1": FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    "ring": RING,
    "graph": GraphLaw.from_masses([0.3, 0.3, 0.2], {(0, 1): 0.12, (1, 2): 0.08}),
    "chain": RING.discretize(2),
}
NAN = np.nan

#: A law whose weights by the rule "product" are negative in part, on eight nodes.
SIGNED = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)


def made(law="fades", m=2, q=2, k=1, seed=0, **change):
    """A model without symmetries."""
    given = LAWS.get(law, law) if isinstance(law, str) else law
    K = getattr(given, "n_classes", len(given) if isinstance(given, list) else None)
    rng = np.random.default_rng(seed)

    def definite(*shape):
        root = 0.4 * rng.normal(size=shape) + np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    parameters = {
        "F": 0.4 * rng.normal(size=(K, m, m)) + 0.3 * np.eye(m),
        "H": rng.normal(size=(K, q, m)),
        "Q": definite(K, m, m),
        "R": definite(K, q, q),
        "b": rng.normal(size=(K, m)),
        "d": 2.0 * rng.normal(size=(K, q)),
        "B": rng.normal(size=(K, m, k)),
    }
    return SwitchingStateSpace(given, **(parameters | change))


usual = functools.cache(made)  # a model never changes


def filters(law="fades", method="imm", **change):
    model = made(law, **change) if change else usual(law)
    return SwitchingKalmanFilter(model, method=method, n_nodes=3)


def data(q=2, n=12, gaps=True, seed=1):
    zs = 2.0 * np.random.default_rng(seed).normal(size=(n, q))
    if gaps:
        zs[[3, 4]], zs[6, 0], zs[8, -1] = NAN, NAN, NAN
    return zs


def state(f):
    names = ("x", "P", "x_prior", "P_prior", "mu", "class_weights", "y", "S")
    return [np.array(getattr(f, name)) for name in names] + [np.array([f.log_likelihood, f.nis])]


def same(f, g, **tolerance):
    for a, b in zip(state(f), state(g), strict=True):
        np.testing.assert_allclose(a, b, **({"rtol": 1e-10, "atol": 1e-12} | tolerance))


# --------------------------------------------------------------------------- promises of filters


@pytest.mark.parametrize(
    ("law", "method", "q"), [("matrix", "imm", 2), ("fades", "gpb2", 1), ("ring", "imm", 1)]
)
def test_it_keeps_the_contract_of_filters(law, method, q):
    # six observations are the fewest that will do
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None] + 0.7 * np.arange(q))
    model = made(law, q=q)
    report = check_filter(lambda: SwitchingKalmanFilter(model, method=method, n_nodes=2), zs)
    assert {"saver", "save", "resume", "filter_many", "outlier"} <= set(report.passed)


@pytest.mark.parametrize("method", METHODS)
def test_the_reference_cases_by_steps_by_series_and_by_many(method, ssm_cases):
    for case, model in ssm_cases:
        ys, expected = np.array(case["y"]), case["expected"][method]
        f = SwitchingKalmanFilter(model, method=method, n_nodes=case["n_nodes"])
        one, many = f.filter(ys), f.filter_many([ys, ys[::-1]], SHOWN)
        f.reset()
        steps = []
        for y in ys:
            f.step(y)
            steps.append((f.x[:, 0], f.P, f.class_weights, f.log_likelihood))
        fields = ("x", "P", "class_weights", "log_likelihood")
        for name, stepped in zip(fields, zip(*steps, strict=True), strict=True):
            wanted = expected["weights" if name == "class_weights" else name]
            for got in (stepped, getattr(one, name), getattr(many, name)[0]):
                np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-10, err_msg=case["id"])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", LAWS)
def test_verbs_series_and_many_series_agree_in_every_field(law, method):
    f, zs = filters(law, method), data()
    us = np.linspace(-1.0, 1.0, 12)
    one = f.filter(zs, us, keep_nodes=True)
    many = f.filter_many(np.stack([zs, zs[::-1], 0.5 * zs]), SHOWN, us)
    g = filters(law, method)
    for n, z in enumerate(zs):
        g.step(z, us[n])
        for name in SHOWN:
            value = getattr(g, name)
            if value is not None:
                found = np.reshape(value, np.shape(getattr(one, name)[n]))
                np.testing.assert_allclose(found, getattr(one, name)[n], rtol=1e-9, atol=1e-11, err_msg=name)
    same(f, g)
    for name in SHOWN:
        if getattr(one, name) is not None:
            np.testing.assert_array_equal(getattr(many, name)[0], getattr(one, name), err_msg=name)
    assert one.node_x.shape == (12, len(f.mu), 2)
    assert one.interval(0.9)[0].shape == (12, 2)


# --------------------------------------------------------------------------- what they are told


@pytest.mark.parametrize("method", METHODS)
def test_a_control_moves_the_state_of_each_node_by_its_own_matrix(method):
    model = made(seed=3)
    f, g = (SwitchingKalmanFilter(model, method=method, n_nodes=3) for _ in range(2))
    f.step([0.1, 0.2], 7.0)  # to the first observation nothing moves
    g.step([0.1, 0.2])
    same(f, g)
    f.predict(2.0)
    g.predict()
    off = (f.mu @ (model.placed(3).B @ [2.0]))[:, None]
    np.testing.assert_allclose(f.x - g.x, off, rtol=1e-10)
    g.predict([[0.0]])  # the observation in between is missing
    f.predict()
    assert np.abs(f.x - g.x).max() > 0.1  # which the control moved all the same
    np.testing.assert_array_equal(f.z, np.full((2, 1), NAN))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("form", ["number", "matrix", "classes", "function"])
def test_noise_and_matrix_of_an_observation_stand_for_those_of_the_model(method, form):
    each = np.array([0.5 * np.eye(2), [[2.0, 0.1], [0.1, 1.0]]])
    R = {"number": 3.0, "matrix": each[1], "classes": each, "function": lambda w: np.tensordot(w, each, 1)}[
        form
    ]
    H = np.array([[1.0, 0.5], [0.0, 1.0]])
    wanted = {"number": 3.0 * np.eye(2), "matrix": each[1]}.get(form, each)
    f, g = filters(method=method), filters(method=method, R=wanted, H=H)
    h = filters(method=method)
    zs = data()
    for n in range(5):
        before = copy.deepcopy(h)
        h.step(zs[n], R=R, H=H)
        f.step(zs[n])
        # one step of the model that has them, from where the other stands
        g._mixture, g._n = before._mixture, before._n
        g._before, g._predicted = None, False
        g.step(zs[n])
        same(h, g)
    many = f.filter_many(zs[None, :5], SHOWN, Rs=[R] * 5, Hs=[H] * 5)
    one = f.filter(zs[:5], Rs=[R] * 5, Hs=[H] * 5)
    same(f, h)
    for name in SHOWN:
        np.testing.assert_array_equal(getattr(many, name)[0], getattr(one, name), err_msg=name)


def test_where_nothing_is_told_of_a_step_the_model_stands():
    f, g, zs = filters(), filters(), data()
    f.filter(zs, us=[None, 1.0, None, 2.0, *[None] * 8], Rs=[None, 2.0, *[None] * 10], Hs=[None] * 12)
    for n, z in enumerate(zs):
        g.step(z, {1: 1.0, 3: 2.0}.get(n), R=2.0 if n == 1 else None)
    same(f, g)
    np.testing.assert_array_equal(
        filters().filter(zs, Rs=np.array([np.eye(2)] * 12)).x, filters().filter(zs, Rs=[1.0] * 12).x
    )


def test_the_first_control_is_not_used_so_that_it_may_be_missing():
    f, zs, us = filters(), data(), np.ones((12, 1))
    expected = f.filter(zs, us).x
    us[0] = NAN
    np.testing.assert_array_equal(f.filter(zs, us).x, expected)
    np.testing.assert_array_equal(f.filter_many(zs[None], us=us[None]).x[0], expected)
    f.step(zs[0])
    with pytest.raises(ParameterError, match=r"us: row 0 is \[nan\], expected finite"):
        f.filter(zs, us, resume=True)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cut", [0, 1, 4, 7])
@pytest.mark.parametrize("skips", [False, True])
def test_parts_of_a_series_give_what_the_whole_gives(method, cut, skips):
    f, g, zs = filters(method=method), filters(method=method), data()
    us = np.linspace(-1.0, 1.0, 12)
    Rs = [1.0 + n for n in range(12)]
    if skips and cut:
        zs[cut], Rs[cut] = NAN, None
    whole = f.filter(zs, us, Rs)
    if cut:
        g.filter(zs[:cut], us[:cut], Rs[:cut])
    start = cut
    if skips:
        g.predict(us[cut])
        start = cut + 1 if cut else 0
    h = copy.deepcopy(g)
    rest = g.filter(zs[start:], us[start:], Rs[start:], resume=True)
    many = h.filter_many(zs[None, start:], SHOWN, us[start:], Rs[start:], resume=True)
    for name in SHOWN:
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[start:], err_msg=name)
        np.testing.assert_array_equal(getattr(many, name)[0], getattr(whole, name)[start:], err_msg=name)
    same(f, g)
    if skips and cut:  # a control that was told before the series moves it, also where that has none
        g, h = filters(method=method), filters(method=method)
        g.filter(zs[:cut])
        h.filter(zs[:cut])
        g.predict(5.0)
        g.filter(zs[start:], resume=True)
        for n, z in enumerate(zs[cut:]):
            h.step(z, None if n else 5.0)
        same(g, h)


def test_series_of_any_length_have_controls_of_their_own():
    f, zs = filters(), data(gaps=False)
    us = np.random.default_rng(2).normal(size=(3, 12))
    lengths = (12, 5, 9)
    series = {name: zs[:n] for name, n in zip("abc", lengths, strict=True)}
    controls = {name: us[k, :n] for k, (name, n) in enumerate(zip("abc", lengths, strict=True))}
    found = f.filter_many(series, SHOWN, controls)
    for k, n in enumerate(lengths):
        one = f.filter(zs[:n], us[k, :n])
        np.testing.assert_array_equal(found.x[k, :n], one.x)
        np.testing.assert_array_equal(found.log_likelihood[k, :n], one.log_likelihood)
        assert np.isnan(found.x[k, n:]).all()
    shared = f.filter_many(np.stack([zs, zs]), us=pd.Series(us[1]))
    np.testing.assert_array_equal(shared.x[0], f.filter(zs, us[1]).x)
    both = f.filter_many(np.stack([zs, zs]), us=us[:2, :, None])
    np.testing.assert_array_equal(both.x[1], f.filter(zs, us[1]).x)


def test_a_changed_verb_is_told_what_a_series_is_told():
    class Doubting(SwitchingKalmanFilter):
        def update(self, z, R=None, H=None):
            super().update(z, R=4.0 if R is None else 2.0 * R, H=H)

    f, g = Doubting(made(), n_nodes=3), filters()
    zs, us, Rs = data(), np.linspace(-1.0, 1.0, 12), [None, *np.linspace(1.0, 2.0, 11)]
    found = f.filter(zs, us, Rs)
    expected = g.filter(zs, us, [4.0, *2.0 * np.linspace(1.0, 2.0, 11)])
    many = f.filter_many(zs[None], SHOWN, us, Rs)
    for name in SHOWN:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-11)
        np.testing.assert_array_equal(getattr(many, name)[0], getattr(found, name))


def test_tables_go_by_their_names_and_their_index():
    model = made().labelled(observations=["a", "b"])
    f, zs = SwitchingKalmanFilter(model, n_nodes=3), data()
    times = pd.date_range("2026-01-01", periods=12, freq="h")
    frame = pd.DataFrame({"b": zs[:, 1], "a": zs[:, 0]}, index=times)
    us = pd.Series(np.ones(12), index=times)
    found = f.filter(frame, us)
    np.testing.assert_array_equal(found.x, f.filter(zs, np.ones(12)).x)
    assert found.index.equals(times)
    f.filter(frame, us)
    ahead = pd.Series([1.0, 2.0], index=times[-1] + pd.to_timedelta([1, 2], unit="h"))
    assert f.forecast(2).index[0] == times[-1] + pd.Timedelta("1h")
    np.testing.assert_array_equal(f.forecast(2, ahead).x, f.forecast(2, ahead.to_numpy()).x)
    with pytest.raises(ParameterError, match="forecast, us: rows of different indexes"):
        f.forecast(2, ahead.set_axis(times[:2]))
    with pytest.raises(ParameterError, match="zs, us: rows of different indexes"):
        f.filter(frame, us[::-1])
    f.step({"b": 1.0, "a": 2.0})


# --------------------------------------------------------------------------- forecasts


@pytest.mark.parametrize("method", METHODS)
def test_a_forecast_is_a_series_of_nothing(method):
    f, zs, us = filters(method=method), data(), np.linspace(-1.0, 1.0, 4)
    f.filter(zs)
    found = f.forecast(4, us)
    g = copy.deepcopy(f)
    for n in range(4):
        g.predict(us[n])
        np.testing.assert_allclose(found.x[n], g.x[:, 0], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(found.P[n], g.P, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(found.mu[n], g.mu, rtol=1e-10, atol=1e-12)
    ahead = copy.deepcopy(g)
    ahead.update(zs[0])
    np.testing.assert_allclose(found.S[3], ahead.S, rtol=1e-10)
    np.testing.assert_allclose(zs[0] - found.z_prior[3], ahead.y[:, 0], rtol=1e-10)
    f.predict(us[0])
    np.testing.assert_allclose(f.forecast(1).x[0], found.x[0], rtol=1e-12)
    start = filters(method=method)
    np.testing.assert_allclose(start.forecast(2, [NAN, 1.0]).x[0], start.x[:, 0], rtol=1e-12)


# --------------------------------------------------------------------------- copies and files


SEEN = [0, 1, 2, 6]

#: Each law and each number of observations, by the methods in turn: each method meets all of either.
STOOD = [(law, METHODS[(i + j) % 2], seen) for i, law in enumerate(LAWS) for j, seen in enumerate(SEEN)]


@pytest.mark.parametrize(("law", "method", "seen"), STOOD)
def test_files_and_pickles_keep_where_it_stands(law, method, seen, tmp_path):
    f, zs = filters(law, method), data()
    for n in range(seen):
        f.step(zs[n], 0.5 * n, R=2.0 + n, H=np.eye(2))
    if seen == 6:
        f.predict(3.0)
    f.save(tmp_path / "filter.json")
    others = (
        SwitchingKalmanFilter.load(tmp_path / "filter.json"),
        io.load_filter(tmp_path / "filter.json"),
        pickle.loads(pickle.dumps(f)),
        copy.deepcopy(f),
    )
    for g in others:
        assert g._method is {"imm": IMM, "gpb2": GPB2}[method]
        same(f, g, rtol=0, atol=0)
        h = copy.deepcopy(f)
        for one in (g, h):
            one.update(zs[7]) if seen == 6 else one.step(zs[7], 1.0)
        same(g, h, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"u": [1.0, 2.0]}, "u: got"),
        ({"R": [[[1.0]]]}, "R: got shape"),
        ({"before_told": {"b": [[1.0]]}}, "before_told b: got shape"),
        ({"before_told": {"H": [[1.0]]}}, "damaged"),
    ],
)
def test_damaged_files_are_refused(change, message, tmp_path):
    f = filters()
    f.filter(data())
    f.predict(1.0)
    document = f.to_dict()
    document["state"] |= change
    io.write_document(tmp_path / "f.json", "SwitchingKalmanFilter", document)
    with pytest.raises(FileFormatError, match=message):
        SwitchingKalmanFilter.load(tmp_path / "f.json")


def test_filterpys_saver_records_it():
    f, zs, us = filters(), data(), np.ones(12)
    saver = filterpy.common.Saver(f)
    for n, z in enumerate(zs):  # what is told at some steps alone does not stand in its way
        f.predict(*([us[n]] if n % 3 else []))
        saver.save()
        f.update(z, R=2.0 if n % 2 else None, H=np.eye(2) if n % 4 else None)
        saver.save()
    saver.to_array()
    assert saver.x.shape == (24, 2, 1)
    np.testing.assert_allclose(saver.class_weights.sum(axis=1), 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_any_system_on_nodes_meets_the_method(method):
    model, zs = made(), data()
    f = SwitchingFilter(model.placed(3), {"imm": IMM, "gpb2": GPB2}[method])
    expected = filters(method=method).filter(zs)
    for name in SHOWN:
        np.testing.assert_array_equal(getattr(f.filter(zs), name), getattr(expected, name))
    assert repr(f._method) == method.upper()


# --------------------------------------------------------------------------- what is refused


@functools.cache
def stepped(method):
    f = filters(method=method)
    f.filter(data())
    f.predict()
    return f


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda f: f.update([1.0, 2.0], R=-1.0), NotPositiveDefiniteError, "R: .*the eigenvalue -1"),
        (
            lambda f: f.update([1.0, 2.0], R=np.eye(3)),
            ShapeError,
            r"R: got shape \(3, 3\), expected \(2, 2\)",
        ),
        (
            lambda f: f.update([1.0, 2.0], R=[[1.0], [1.0, 2.0]]),
            ShapeError,
            "R: expected an array of numbers",
        ),
        (lambda f: f.update([1.0, 2.0], R="one"), ShapeError, "R: expected an array of numbers"),
        (
            lambda f: f.update([1.0, 2.0], H=np.eye(2)[0]),
            ShapeError,
            r"H: got shape \(2,\), expected \(2, 2\)",
        ),
        (lambda f: f.update([1.0, 2.0], H=[[NAN, 0], [0, 1]]), ParameterError, r"H: entry \(0, 0\) is nan"),
        (
            lambda f: f.update([1.0, 2.0], H=lambda w: 3.0),
            ShapeError,
            r"H at the class weights .*: got shape",
        ),
        (lambda f: f.update(1.0), ShapeError, r"z: got shape \(\)"),
        (lambda f: f.update([1.0, np.inf]), ParameterError, "z: got"),
        (lambda f: f.update([1e200, 0.0]), NumericalRangeError, "observation: got"),
        (lambda f: f.predict([1.0, 2.0]), ShapeError, r"u: got shape \(2,\), expected \(1,\) or \(1, 1\)"),
        (lambda f: f.predict(NAN), ParameterError, r"u: entry \(0,\) is nan"),
        (lambda f: f.predict("fast"), ShapeError, "u: expected an array of numbers"),
        (lambda f: f.step([1.0, 2.0], NAN), ParameterError, "u: entry"),
        (lambda f: f.step([1.0, 2.0], R=-1.0), NotPositiveDefiniteError, "R: "),
        (
            lambda f: f.step([1.0, 2.0], H=np.zeros((2, 2)), R=0.0),
            NotPositiveDefiniteError,
            r"S = H P H' \+ R at the node 0: expected a positive definite matrix, got the eigenvalue 0",
        ),
        (lambda f: f.filter(data(), np.ones(11)), ShapeError, r"us: got shape \(11,\), expected \(12, 1\)"),
        (lambda f: f.filter(data(), 3.0), ShapeError, r"us: got shape \(\)"),
        (lambda f: f.filter(data(), [1.0] * 11 + [np.inf]), ParameterError, r"us: row 11 is \[inf\]"),
        (
            lambda f: f.filter(data(), Rs=[1.0] * 11),
            ShapeError,
            "Rs: got 11 values, expected one for each of",
        ),
        (lambda f: f.filter(data(), Rs=2.0), ShapeError, "Rs: got 2.0, expected one for each of the 12"),
        (lambda f: f.filter(data(), Rs=[1.0] * 11 + [-1.0]), NotPositiveDefiniteError, r"Rs\[11\]: .*-1"),
        (lambda f: f.filter(data(), Hs=[np.eye(3)] * 12), ShapeError, r"Hs\[0\]: got shape \(3, 3\)"),
        (
            lambda f: f.filter(data(), Hs=[np.zeros((2, 2))] * 12, Rs=[0.0] * 12),
            NotPositiveDefiniteError,
            "at the node 0",
        ),
        (
            lambda f: f.filter(
                data(), Hs=[None] * 7 + [np.zeros((2, 2))] + [None] * 4, Rs=[None] * 7 + [0.0] * 5
            ),
            NotPositiveDefiniteError,
            "at the node 0",
        ),
        (
            lambda f: f.filter(
                data(), Hs=[None] * 6 + [[[1, 1], [0, 0]]] + [None] * 5, Rs=[None] * 6 + [0.0] * 6
            ),
            NotPositiveDefiniteError,
            "at the node 0: .*the eigenvalue 0",  # of what is there of it: the first component is missing
        ),
        (lambda f: f.filter([*data(), [1e200, 0.0]]), NumericalRangeError, "observation: got"),
        (lambda f: f.filter_many(data()[None], us=np.ones((2, 12))), ShapeError, "us: got 2 series of 12"),
        (
            lambda f: f.filter_many(data()[None], us=np.full((1, 12), NAN)),
            ParameterError,
            r"us: row 1 is \[nan",
        ),
        (lambda f: f.filter(1e200 + data()), NumericalRangeError, "observation: got"),
        (lambda f: f.filter_many(data()[None], us=3.0), ShapeError, "us: got shape"),
        (lambda f: f.filter_many(data()[None], us="on"), ShapeError, "us: "),
        (lambda f: f.filter_many(data()[None], threads=0), ParameterError, "threads: got 0"),
        (lambda f: f.filter_many(data()[None], keep="z"), ParameterError, "keep: got 'z'"),
        (lambda f: f.forecast(3, np.ones(2)), ShapeError, r"us: got shape \(2,\), expected \(3, 1\)"),
        (lambda f: f.forecast(0), ParameterError, "steps: got 0"),
        (lambda f: f.smooth(data(), weights="Kim"), ParameterError, "weights: got 'Kim'"),
        (lambda f: f.smooth(data(), us=3.0), ShapeError, "us: got shape"),
        (lambda f: f.smooth(1e200 + data()), NumericalRangeError, "observation: got"),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_calls_that_are_refused_leave_it_as_it_was(call, error, message, method):
    f, g = (copy.deepcopy(stepped(method)) for _ in range(2))
    with pytest.raises(error, match=message):
        call(f)
    same(f, g, rtol=0, atol=0)
    f.update([0.5, 1.0])
    g.update([0.5, 1.0])
    same(f, g, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: SwitchingKalmanFilter(3), ParameterError, "model: got int, expected a SwitchingStateSpace"),
        (
            lambda: SwitchingKalmanFilter(made(), method="exact"),
            ParameterError,
            "method: got 'exact', expected",
        ),
        (lambda: SwitchingKalmanFilter(made(), n_nodes=11), ParameterError, "n_nodes: got 11"),
        (lambda: SwitchingKalmanFilter(made(), rule="gauss"), ParameterError, "rule: got 'gauss'"),
        (
            lambda: SwitchingKalmanFilter(made(SIGNED), n_nodes=8, rule="product"),
            ParameterError,
            "rule: got 'product', by which some transition probabilities are negative",
        ),
        (
            lambda: made(SIGNED.discretize(8, "product")),
            ParameterError,
            "law: got a chain, by which some transition probabilities are negative; expected others",
        ),
        (lambda: filters(B=None).predict(1.0), ParameterError, "u: got 1.0, but the model has no B"),
        (lambda: filters(B=None).filter(data(), np.ones(12)), ParameterError, "us: got .* has no B"),
        (
            lambda: filters(B=None).filter_many(data()[None], us=np.ones(12)),
            ParameterError,
            "us: got .* no B",
        ),
        (lambda: (lambda f: [f.update([1, 2]), f.update([1, 2])])(filters()), SequenceError, "called twice"),
        (
            lambda: filters(R=np.zeros((2, 2)), H=np.zeros((2, 2))).step([1.0, 2.0]),
            NotPositiveDefiniteError,
            r"S = H P H' \+ R at the node 0",
        ),
        (
            lambda: SwitchingKalmanFilter(made("fmc1", R=lambda w: np.eye(2) * (w[0] - 0.9 * w[1] + 0.01))),
            NotPositiveDefiniteError,
            r"R at the class weights \(0.\d+, 0.\d+\)|R at the class weights \(0, 1\)",
        ),
    ],
)
def test_what_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_singular_noise_of_the_motion_is_valid():
    f = filters(Q=np.diag([1.0, 0.0]))
    found = f.filter(data())
    assert np.isfinite(found.x).all()
    assert np.linalg.eigvalsh(found.P).min() >= 0.0
    still = filters(Q=np.zeros((2, 2)), x0=[1.0, 2.0], P0=np.zeros((2, 2)), H=np.eye(2))
    assert np.isfinite(still.filter(data()).log_likelihood).all()

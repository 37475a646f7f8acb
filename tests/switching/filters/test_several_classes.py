"""What the filters of a fuzzy switch between more than two classes take, show, keep and refuse."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, FadeLaw, GraphLaw, KnownSwitchFilter, OFSRFilter
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.io import load_model
from fuzzykf.switching.inference.series import SHOWN
from fuzzykf.testing import check_filter

K = 3
LAWS = {
    "ring": FadeLaw(K, {(0, 1): (0.1, 6), (1, 2): (0.1, 5), (2, 0): (0.2, 4)}, jumps={(0, 2): 0.02}),
    "turning": FadeLaw(
        K, {(0, 1): (0.2, 6), (1, 0): (0.1, 6), (1, 2): (0.1, 8), (2, 1): (0.1, 6)}, turn_back=0.1
    ),
    "path": GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.5, (1, 2): 0.5}, jumps={(0, 1): 0.1}),
    "band": GraphLaw.from_masses(
        [3, 3, 2],
        {(0, 1): 1.5, (1, 2): 0.8},
        family="band",
        crossings={((0, 1), (1, 2)): (0.05, 0.3)},
    ),
}


def model_of(law, m=1, q=1):
    """Classes that differ in mean and spread, in any of the laws."""
    rng = np.random.default_rng(5)
    d = m + q
    root = np.eye(d) + 0.15 * rng.normal(size=(K, d, d))
    z = root @ np.swapaxes(root, 1, 2)
    pairs = [[np.block([[z[i], 0.4 * z[i]], [0.4 * z[i], z[j]]]) for j in range(K)] for i in range(K)]
    return CGOFMSModel(law, 2.0 * rng.normal(size=(K, d)), pairs, m)


@pytest.fixture(params=LAWS)
def model(request):
    return model_of(LAWS[request.param])


@pytest.fixture
def ring():
    return model_of(LAWS["ring"], 2, 1)


def weights_of(n, seed=0):
    """Any weights, and some that are a class."""
    u = np.random.default_rng(seed).dirichlet(np.ones(K), n)
    u[1::3] = np.eye(K)[np.arange(len(u[1::3])) % K]
    return u


# --------------------------------------------------------------------------- the switch unknown


@pytest.mark.parametrize("law", ["ring", "band"])
def test_the_contract_of_filters_holds(law):
    model = model_of(LAWS[law])
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None])  # as few as will do
    report = check_filter(lambda: OFSRFilter(model, 1), zs)
    assert {"mode_probabilities", "filter_many", "smooth", "save", "resume"} <= set(report.passed)


def test_shapes(model):
    f = OFSRFilter(model, 2)
    y = model.simulate(12, np.random.default_rng(1)).y
    result, smoothed, ahead = f.filter(y), f.smooth(y), f.forecast(3)
    M = len(f.nodes)
    for found, n in ((result, 12), (smoothed, 12), (ahead, 3)):
        assert found.class_weights.shape == found.switch.shape == (n, K)
        assert found.mu.shape == (n, M)
        assert found.nodes.shape == (M, K)
        assert found.switch_mean is None
        assert not found.is_many
        np.testing.assert_allclose(found.class_weights, found.mu @ found.nodes, rtol=1e-12, atol=1e-14)
        assert (found.switch[:, None] == found.nodes).all(axis=2).any(axis=1).all()
    assert smoothed.switch_path.shape == (12, K)
    assert f.nodes.shape == (M, K)
    assert f.switch.shape == f.class_weights.shape == (K,)
    assert f.switch_mean is None


FIELDS = tuple(name for name in SHOWN if name != "switch_mean")


@pytest.mark.parametrize("gaps", [False, True])
def test_verbs_steps_and_series_agree(model, gaps):
    y = model.simulate(25, np.random.default_rng(3)).y
    if gaps:
        y[4], y[11:13] = np.nan, np.nan
    whole, many = (
        OFSRFilter(model, 2).filter(y),
        OFSRFilter(model, 2).filter_many(np.stack([y, y[::-1], y]), keep=FIELDS, threads=2),
    )
    by_verbs, by_step = OFSRFilter(model, 2), OFSRFilter(model, 2)
    for n, z in enumerate(y):
        by_verbs.predict()
        by_verbs.update(z)
        by_step.step(z)
        for name in FIELDS:
            expected = getattr(whole, name)[n]
            for found in (getattr(by_verbs, name), getattr(by_step, name), getattr(many, name)[2, n]):
                np.testing.assert_allclose(
                    np.reshape(found, expected.shape), expected, rtol=1e-8, atol=1e-10, err_msg=name
                )


def test_the_switch_is_the_best_of_the_largest_stratum(model):
    f = OFSRFilter(model, 3)
    result = f.filter(model.simulate(200, np.random.default_rng(2)).y)
    chain = model.law.discretize(3)
    for p, switch in zip(result.mu, result.switch, strict=True):
        strata = {}
        for k, u in enumerate(chain.nodes):
            between = tuple(np.flatnonzero(u)) if not chain.atoms[k] else ()
            value = strata.setdefault(between, {})
            mass, density = value.get(tuple(u.round(9)), (0.0, 0.0))
            value[tuple(u.round(9))] = mass + p[k], density + p[k] / chain.weights[k]
        best = max(strata.values(), key=lambda values: sum(mass for mass, _ in values.values()))
        np.testing.assert_allclose(switch, max(best, key=lambda u: best[u][1]), atol=1e-9)


def test_a_forecast_goes_where_the_chain_goes(model):
    f = OFSRFilter(model, 2)
    f.filter(model.simulate(30, np.random.default_rng(1)).y)
    chain, p = model.law.discretize(2), f.mu
    for weights in f.forecast(40).class_weights:
        p = p @ chain.transition
        np.testing.assert_allclose(weights, p @ chain.nodes, rtol=1e-10)


def test_models_and_filters_are_saved(model, tmp_path):
    y = model.simulate(20, np.random.default_rng(1)).y
    model.save(tmp_path / "model.json")
    loaded = load_model(tmp_path / "model.json")
    assert loaded.law.to_dict() == model.law.to_dict()
    f = OFSRFilter(model, 2)
    f.filter(y[:10])
    f.predict()
    f.save(tmp_path / "filter.json")
    g = OFSRFilter.load(tmp_path / "filter.json")
    for name in ("x", "mu", "class_weights", "switch"):
        np.testing.assert_array_equal(getattr(g, name), getattr(f, name))
    f.update(y[10])
    g.update(y[10])
    np.testing.assert_array_equal(g.class_weights, f.class_weights)
    np.testing.assert_array_equal(OFSRFilter(loaded, 2).filter(y).x, OFSRFilter(model, 2).filter(y).x)


def test_a_series_goes_on(model):
    y = model.simulate(40, np.random.default_rng(1)).y
    y[7], y[30] = np.nan, np.nan
    f = OFSRFilter(model, 2)
    whole = f.filter(y)
    for cut in (1, 8, 25):
        f.filter(y[:cut])
        many = f.filter_many(np.stack([y[cut:], y[cut:]]), keep=("class_weights", "switch"), resume=True)
        rest = f.filter(y[cut:], resume=True)
        for name in ("x", "class_weights", "switch", "mu"):
            np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[cut:], err_msg=name)
        for name in ("class_weights", "switch"):
            np.testing.assert_allclose(getattr(many, name)[1], getattr(rest, name), rtol=1e-9, atol=1e-12)


def test_many_series(model):
    long, short = (model.simulate(n, np.random.default_rng(n)).y[:, 0] for n in (15, 9))
    f = OFSRFilter(model, 2)
    result = f.filter_many({"a": long, "b": short}, keep=("class_weights", "switch"))
    assert result.class_weights.shape == result.switch.shape == (2, 15, K)
    assert result.is_many
    assert result.shape == (2, 15)
    assert (result.x, result.switch_mean) == (None, None)
    assert np.isnan(result.class_weights[1, 9:]).all()
    for name, y in (("a", long), ("b", short)):
        one, alone = result.one(name), f.filter(y)
        np.testing.assert_allclose(one.class_weights, alone.class_weights, rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(one.switch, alone.switch)
    frame = result.to_dataframe()
    assert list(frame) == [f"{name}{k}" for name in ("class_weights", "switch") for k in range(K)]
    assert len(frame) == 24
    # values of the switch alone still are values, not many series of numbers
    switch = f.filter_many([long, short], keep=["switch"])
    assert (switch.shape, switch.one(1).shape) == ((2, 15), (9,))
    assert f.filter_many([long, short], keep=["switch_mean"]).switch_mean is None


def test_tables(model):
    hours = pd.date_range("2026-03-01", periods=8, freq="h", name="hour")
    y = pd.Series(model.simulate(8, np.random.default_rng(1)).y[:, 0], hours)
    f = OFSRFilter(model, 2)
    result, smoothed = f.filter(y), f.smooth(y)
    shared = ["x", "x_std", *(f"{name}{k}" for name in ("class_weights", "switch") for k in range(K))]
    frame = result.to_dataframe()
    assert set(shared) <= set(frame)
    assert "switch_mean" not in frame
    assert frame.index.equals(hours)
    np.testing.assert_array_equal(frame["class_weights2"], result.class_weights[:, 2])
    np.testing.assert_array_equal(frame["switch0"], result.switch[:, 0])
    assert {f"switch_path{k}" for k in range(K)} <= set(smoothed.to_dataframe())
    dataset = smoothed.to_xarray()
    for name in ("class_weights", "switch", "switch_path"):
        assert dataset[name].dims == ("hour", "class")
    assert dataset.class_weights_of_node.dims == ("node", "class")
    many = f.filter_many({"a": y, "b": y}, keep=("class_weights", "switch")).to_xarray()
    assert many.switch.dims == many.class_weights.dims == ("series", "hour", "class")


def test_on_a_cycle_the_direction_of_fades_is_worth_a_quarter_of_the_error():
    law = FadeLaw(4, {(0, 1): (1 / 26, 8), (1, 2): (1 / 8, 6), (2, 3): (1 / 24, 8), (3, 0): (1 / 10, 6)})
    z = np.array([[0.5, 0.4], [0.4, 1.0]])
    pair = np.broadcast_to(np.block([[z, 0.5 * z], [0.5 * z, z]]), (4, 4, 4, 4))
    cycle = CGOFMSModel(law, [[4.0, 10.0], [8.0, 13.0], [6.0, 20.0], [9.0, 16.0]], pair, 1)
    days = [cycle.simulate(480, np.random.default_rng(seed)) for seed in range(8)]
    x, y, r = (np.stack([getattr(one, name) for one in days]) for name in ("x", "y", "r"))
    errors = []
    for f in (cycle.filter(), cycle.harden().filter()):
        found = f.filter_many(y, keep=("x", "class_weights"))
        errors.append([np.mean((found.x - x) ** 2), np.mean((found.class_weights - r) ** 2)])
    known = np.mean((KnownSwitchFilter(cycle).filter_many(y, r=r).x - x) ** 2)
    fuzzy, hard = np.array(errors)
    assert (fuzzy <= 0.75 * hard).all()
    assert known < fuzzy[0]


# --------------------------------------------------------------------------- the switch known

#: The number of a class, and its weights.
SAME = [(1, [0, 1, 0]), (2.0, np.array([[0.0], [0.0], [1.0]]))]


def test_weights_are_told_with_each_observation(ring):
    u, y = weights_of(9), ring.simulate(9, np.random.default_rng(1)).y
    y[5] = np.nan
    f = KnownSwitchFilter(ring)
    result = f.filter(y, u)
    by_step, early, late = (KnownSwitchFilter(ring) for _ in range(3))
    for n in range(9):
        np.testing.assert_array_equal(by_step.step(y[n], r=u[n]), by_step.x)
        early.predict(u[n])
        np.testing.assert_allclose(early.x[:, 0], result.x_prior[n], rtol=1e-12)
        np.testing.assert_array_equal(early.switch, u[n])
        early.update(y[n])
        late.predict()
        assert np.isnan(late.class_weights).all()
        assert late.nodes.shape == (1, K)
        late.update(y[n], u[n])
        for g in (by_step, early, late):
            np.testing.assert_allclose(g.x[:, 0], result.x[n], rtol=1e-12)
            np.testing.assert_array_equal(g.class_weights, u[n])
            np.testing.assert_array_equal(g.nodes, u[n : n + 1])
            assert g.switch_mean is None
    for found in (result, f.smooth(y, u)):
        for name in ("class_weights", "switch"):
            np.testing.assert_array_equal(getattr(found, name), u)
        assert found.switch_mean is None
        assert found.shape == (9,)
        assert {"class_weights2", "switch2"} <= set(found.to_dataframe())
        assert found.to_xarray().switch.dims == ("step", "class")
    np.testing.assert_array_equal(f.smooth(y, u).x[-1], f.filter(y, u).x[-1])


@pytest.mark.parametrize(("label", "weights"), SAME)
def test_a_class_stands_for_its_weights(label, weights, ring):
    f, g = KnownSwitchFilter(ring), KnownSwitchFilter(ring)
    for z in (0.3, None, 1.2):
        np.testing.assert_array_equal(f.step(z, label), g.step(z, weights))
    np.testing.assert_array_equal(f.class_weights, np.ravel(weights))
    f.predict(label)
    f.predict(weights)  # the observation between is missing
    y, labels = ring.simulate(7, np.random.default_rng(1)).y, np.array([0, 1, 2, 2, 0, 1, 1])
    for verb in ("filter", "smooth"):
        found, expected = getattr(f, verb)(y, labels), getattr(f, verb)(y, np.eye(K)[labels])
        for name in ("x", "P", "class_weights", "switch"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_known_switch_goes_on(ring):
    u, y = weights_of(9), ring.simulate(9, np.random.default_rng(1)).y
    f = KnownSwitchFilter(ring)
    whole = f.filter(y, u)
    for cut in (1, 4):
        f.filter(y[:cut], u[:cut])
        rest = f.filter(y[cut:], u[cut:], resume=True)
        np.testing.assert_array_equal(rest.x, whole.x[cut:])
        np.testing.assert_array_equal(rest.class_weights, u[cut:])


def frames(y, u, lengths):
    """Series with their weights as rows of one frame, the columns of weights in another order."""
    parts = [
        pd.DataFrame({"w2": w[:n, 2], "z": z[:n], "w0": w[:n, 0], "w1": w[:n, 1], "k": name})
        for z, w, n, name in zip(y, u, lengths, "ab", strict=True)
    ]
    return pd.concat(parts)


def columns_of(u):
    """Series with pairs of columns (series, class)."""
    return pd.concat({name: pd.DataFrame(w) for name, w in zip("ab", u, strict=True)}, axis=1)


#: In what form many series and their weights come: (zs, r, options) of (2, n) and (2, n, K).
FORMS = {
    "arrays": lambda y, u: (y, u, {}),
    "nested lists": lambda y, u: (y.tolist(), u.tolist(), {}),
    "lists of arrays": lambda y, u: ([y[0], y[1, :5]], [u[0], u[1, :5]], {}),
    "lists of frames": lambda y, u: ([y[0], y[1, :5]], [pd.DataFrame(u[0]), pd.DataFrame(u[1, :5])], {}),
    "mappings": lambda y, u: (dict(zip("ab", y, strict=True)), dict(zip("ab", u, strict=True)), {}),
    "frames": lambda y, u: (pd.DataFrame(dict(zip("ab", y, strict=True))), columns_of(u), {}),
    "rows": lambda y, u: (frames(y, u, (7, 5)), ["w0", "w1", "w2"], {"by": "k"}),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("patched", [False, True])
def test_weights_of_many_series(form, patched, ring):
    class Own(KnownSwitchFilter):
        def update(self, z, r=None):
            super().update(z, r)

    y = np.stack([ring.simulate(7, np.random.default_rng(seed)).y[:, 0] for seed in (1, 2)])
    u = np.stack([weights_of(7, 3), weights_of(7, 4)])
    f = (Own if patched else KnownSwitchFilter)(ring)
    zs, r, options = FORMS[form](y, u)
    found = f.filter_many(zs, keep=("x", "class_weights", "switch"), r=r, **options)
    for k, n in enumerate((7, 7) if found.lengths is None else (7, 5)):
        alone = f.copy().filter(y[k, :n], u[k, :n])
        np.testing.assert_allclose(found.x[k, :n], alone.x, rtol=1e-12, atol=1e-14)
        for name in ("class_weights", "switch"):
            np.testing.assert_array_equal(getattr(found, name)[k, :n], u[k, :n])
    switch = f.filter_many(zs, keep=["switch"], r=r, **options)
    assert switch.shape == (2, 7)
    assert switch.one(found.names[0] if found.names is not None else 0).shape == (7,)


@pytest.mark.parametrize("form", ["arrays", "lists", "rows"])
def test_classes_of_many_series(form, ring):
    # as many rows as classes: numbers of classes stay numbers, whatever their count
    y, r = np.array([[0.1, 0.4, 1.0], [0.0, -0.3, 0.2]]), np.array([[0, 1, 2], [2, 2, 0]])
    f = KnownSwitchFilter(ring)
    expected = f.filter_many(y, keep=("x", "class_weights"), r=np.eye(K)[r])
    if form == "rows":
        rows = pd.DataFrame({"z": y.ravel(), "valve": r.ravel(), "k": [*"aaabbb"]})
        found = f.filter_many(rows, keep=("x", "class_weights"), by="k", r="valve")
    else:
        found = f.filter_many(y, keep=("x", "class_weights"), r=r if form == "arrays" else list(map(list, r)))
    np.testing.assert_array_equal(found.class_weights, np.eye(K)[r])
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-12, atol=1e-14)


#: What is no value of a switch between three classes, and what is said of it.
NO_VALUES = [
    ([0.5, 0.4, 0.2], r"r: got the class weights \(0\.5, 0\.4, 0\.2\), expected some .* that sum to 1"),
    ([1.5, -0.5, 0.0], r"r: got the class weights \(1\.5, -0\.5, 0\), expected some of at least 0"),
    ([np.nan, 0.5, 0.5], "r: "),
    (3, r"r: got 3, expected regimes 0 to 2, or class weights of shape \(n, K\)"),
    (0.5, r"r: got 0\.5, expected regimes 0 to 2"),
    (-1, r"r: got -1, expected regimes 0 to 2"),
    (np.nan, "r: "),
    ("x", "r: "),
]


@pytest.mark.parametrize(("r", "message"), NO_VALUES)
def test_no_values_of_the_switch(r, message, ring):
    f = KnownSwitchFilter(ring)
    f.step(1.0, 0)
    before = f.x
    for call in (f.predict, lambda r: f.step(1.0, r), lambda r: f.filter([1.0, 2.0], [r, r])):
        with pytest.raises(FuzzykfError, match=message):
            call(r)
        np.testing.assert_array_equal(f.x, before)
        np.testing.assert_array_equal(f.switch, [1, 0, 0])
    with pytest.raises(FuzzykfError, match=message):
        f.filter_many([[1.0, 2.0]], r=[[r, r]])
    f.predict()
    with pytest.raises(FuzzykfError, match=message):
        f.update(1.0, r)
    f.update(1.0, 1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda f: f.step(1.0, [0.5, 0.5]),
            r"r: got shape \(2,\), expected one .*, class weights \(3,\) or a",
        ),
        (
            lambda f: f.filter([1.0, 2.0], np.eye(2)),
            r"r: got shape \(2, 2\), expected class weights \(n, 3\)",
        ),
        (lambda f: f.filter([1.0, 2.0], np.eye(3)), "r: got 3 values, expected 2, one per observation"),
        (lambda f: f.filter([1.0, 2.0], [0, 1, 2]), "r: got 3 values, expected 2, one per observation"),
        (lambda f: f.filter_many(np.zeros((2, 4)), r=np.zeros((2, 4, 2))), r"r: got shape \(2, 4, 2\)"),
        (lambda f: f.filter_many(np.zeros((2, 4)), r=np.zeros((2, 3, 3))), "r: got 2 series of 3, expected"),
        (lambda f: f.filter_many(np.zeros((2, 4)), r=[]), "r: got no series|r: "),
        (lambda f: f.filter_many(np.zeros((2, 4))), r"r: got nothing, expected the switches, shape \(2, 4\)"),
    ],
)
def test_switches_of_another_shape(call, message, ring):
    with pytest.raises(ShapeError, match=message):
        call(KnownSwitchFilter(ring))


@pytest.mark.parametrize("r", [["w0", "w1"], ["w0", "w1", "w3"], ["w0", "w1", "w1"], ["w0", "w1", "k"], "w3"])
def test_columns_of_other_weights(r, ring):
    rows = frames(np.zeros((2, 4)), np.full((2, 4, 3), 1 / 3), (4, 4))
    with pytest.raises(ParameterError, match="or 3 of class weights, as 'by' is given"):
        KnownSwitchFilter(ring).filter_many(rows, by="k", r=r)


def test_the_switch_is_given_once(ring):
    f = KnownSwitchFilter(ring)
    f.predict([0.2, 0.3, 0.5])
    f.predict([0.2, 0.3, 0.5])
    with pytest.raises(ParameterError, match="the switch is given once per observation"):
        f.update(1.0, [0.2, 0.5, 0.3])
    f.update(1.0)
    np.testing.assert_array_equal(f.switch, [0.2, 0.3, 0.5])


def test_results_print(model):
    result = OFSRFilter(model, 1).filter([0.1, 0.2])
    text = " ".join(repr(result).split())
    assert "class_weights (2, 3), switch (2, 3)" in text
    assert "switch_mean" not in text

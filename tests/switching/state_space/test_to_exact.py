"""State-space models on the nodes of their switch, converted: what they keep, files, warnings, refusals."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

from fuzzykf import (
    CGLSSM,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    GraphLaw,
    KalmanFilter,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import (
    ClosenessWarning,
    FileFormatError,
    NotPositiveDefiniteError,
    NotStableError,
    ParameterError,
)
from fuzzykf.switching.state_space.space_on_nodes import SpaceOnNodes
from fuzzykf.testing import check_filter

RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})
LAWS = {
    "matrix": [[0.9, 0.1], [0.3, 0.7]],
    "one regime": [[1.0]],
    "fades": FadeLaw.between(40, 10),
    "fmc1": FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    "ring": RING,
    "graph": GraphLaw.from_masses([0.3, 0.3, 0.2], {(0, 1): 0.12, (1, 2): 0.08}),
    "chain": RING.discretize(2),
}
pytestmark = pytest.mark.filterwarnings("ignore::fuzzykf.errors.ClosenessWarning")


def made(law="fades", m=1, q=1, moving=False, **change):
    """A model with offsets, stationary or not."""
    given = LAWS[law]
    K = getattr(given, "n_classes", len(given) if isinstance(given, list) else None)
    rng = np.random.default_rng(0)
    parameters = {
        "F": 0.5 * np.eye(m) + 0.1 * rng.normal(size=(K, m, m)),
        "H": rng.normal(size=(K, q, m)),
        "Q": np.eye(m) * rng.uniform(0.5, 2.0, (K, 1, 1)),
        "R": np.eye(q) * rng.uniform(0.5, 2.0, (K, 1, 1)),
        "b": rng.normal(size=(K, m)),
        "d": 3.0 * rng.normal(size=(K, q)),
    }
    if moving:
        parameters |= {"x0": np.full(m, 5.0), "P0": 4.0 * np.eye(m)}
    return SwitchingStateSpace(given, **(parameters | change))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_the_filter_shows_nodes_and_class_weights_of_the_switch(law, moving):
    model = made(law, moving=moving)
    chain = model.placed(2).chain
    f = CGOMSMFilter(model.to_exact(2, n_nodes=2))
    result = f.filter(model.simulate(30, np.random.default_rng(1)).y)
    np.testing.assert_array_equal(f.nodes, chain.nodes)
    assert result.class_weights.shape == (30, model.n_classes)
    np.testing.assert_allclose(result.class_weights, result.mu @ chain.class_weights, atol=1e-12)
    np.testing.assert_allclose(f.class_weights, result.class_weights[-1], atol=1e-14)
    assert f.model.p_hard == pytest.approx(chain.initial[chain.atoms].sum())
    assert f.model.exactness == "exact: Y alone is Markov given the switch"
    numbers = f.model.simulate(50, np.random.default_rng(2)).r  # the regimes are the nodes
    assert set(numbers) <= set(range(len(chain)))
    np.testing.assert_array_equal(f.model.class_weights(numbers), chain.class_weights[numbers.astype(int)])
    assert f.smooth(result.x[:, :1]).x.shape == (30, 1)


def test_a_fuzzy_switch_is_described_as_one():
    assert made().to_exact(1, n_nodes=2).describe_switch() == "fuzzy switch, a chain on 6 nodes"
    assert (
        made("matrix").to_exact(1).describe_switch() == "2 hard regimes, which stay with probability 0.9, 0.7"
    )


def test_names_go_along():
    model = made().labelled(states=["level"], observations=["sensor"])
    assert model.to_exact(1, n_nodes=1).labels == model.labels


@pytest.mark.parametrize("mode", ["stationary", "time_varying"])
@pytest.mark.parametrize("order", [1, 3])
def test_of_a_cglssm_it_is_from_cglssm(mode, order):
    given = {"A": [[[0.9]], [[0.5]]], "B": [[[1.0]], [[0.4]]], "C": [[[0.3]], [[1.0]]], "D": [[[0.5]]] * 2}
    start = {} if mode == "stationary" else {"initial_covariance": [[[2.0]], [[1.0]]]}
    T = LAWS["matrix"]
    one = CGOMSModel.from_cglssm(T, **given, **start, order=order, mode=mode).placed()
    other = CGLSSM(T, **given, **start).to_exact(order).placed()
    assert one.steady_from == other.steady_from
    for n in (0, 1, 5):
        for a, b in zip(one.pair_tables(n).pairs, other.pair_tables(n).pairs, strict=True):
            np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("law", ["fades", "matrix"])
def test_offsets_that_all_classes_share_change_nothing_but_means(law):
    plain = made(law, F=0.5, b=np.zeros(1), d=np.zeros(1), H=1.0)
    moved = made(law, F=0.5, b=[2.0], d=[-7.0], H=1.0)
    models = [model.to_exact(2, 1) for model in (plain, moved)]
    assert models[1].closeness() == pytest.approx(models[0].closeness(), rel=1e-9)
    ys = plain.simulate(40, np.random.default_rng(3)).y
    one, other = (CGOMSMFilter(a).filter(zs) for a, zs in zip(models, (ys, ys + 4.0 - 7.0), strict=True))
    np.testing.assert_allclose(other.x, one.x + 4.0, rtol=1e-9)
    for name in ("P", "mu", "log_likelihood"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("far", [1.0, 1e6])
def test_means_far_apart_keep_their_digits(far):
    # the offset of the observation tells the regimes apart, so that the filter is that of the known switch
    model = made("matrix", d=[[0.0], [1e3 * far]], H=1.0, F=0.5, b=np.zeros(1))
    data = model.simulate(30, np.random.default_rng(4))
    found = CGOMSMFilter(model.to_exact(1)).filter(data.y)
    known = KnownSwitchFilter(model.to_exact(1)).filter(data.y, data.r)
    np.testing.assert_array_equal(found.mu[:, 1].round(), data.r)
    np.testing.assert_allclose(found.x, known.x, rtol=1e-6, atol=1e-8 * far)


def test_it_gets_nearer_with_each_order():
    nothing = {"b": np.zeros(1), "d": np.zeros(1)}
    model = made("matrix", F=0.95, Q=0.05, H=1.0, R=1.0, **nothing)
    near = [model.to_exact(k).closeness() for k in (1, 3, 8, 20)]
    assert near == sorted(near, reverse=True)
    assert near[0] > 1.1
    assert near[-1] == pytest.approx(1.0, abs=0.01)
    # a regime is no longer in doubt where nothing tells them apart: the Kalman filter
    ys = model.simulate(60, np.random.default_rng(0)).y
    one = made("one regime", F=0.95, Q=0.05, H=1.0, R=1.0, **nothing)
    kf = KalmanFilter(1, 1, F=[[0.95]], H=[[1.0]], Q=0.05, R=1.0, x=[0.0], P=0.05 / (1.0 - 0.95**2))
    kf.P = (kf.P - 0.05) / 0.95**2  # before the first predict
    found = CGOMSMFilter(one.to_exact(64)).filter(ys)
    np.testing.assert_allclose(found.x[:, 0], kf.filter(ys).x[:, 0], rtol=1e-9, atol=1e-9)


def test_who_calls_is_warned():
    model = made("matrix", F=0.95, Q=0.05, H=1.0, R=1.0)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        model.to_exact(1)
        model.to_exact(20)
    assert [one.category for one in seen] == [ClosenessWarning]
    assert seen[0].filename == __file__
    assert str(seen[0].message).endswith("(warned above 1.25); a larger order comes nearer")


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("n", [0, 1, 3, 70])
def test_models_and_filters_come_back(moving, n, tmp_path):
    model = made("fmc1", m=2, q=1, moving=moving).to_exact(3, n_nodes=1)
    model.save(tmp_path / "model.json")
    for again in (io.load_model(tmp_path / "model.json"), pickle.loads(pickle.dumps(model))):
        assert again.to_dict() == model.to_dict()
    zs = model.simulate(n + 5, np.random.default_rng(1)).y
    f = CGOMSMFilter(model)
    f.filter(zs[:n])
    f.save(tmp_path / "filter.json")
    g, h = io.load_filter(tmp_path / "filter.json"), pickle.loads(pickle.dumps(f))
    one = f.filter(zs[n:], resume=True)
    for other in (g.filter(zs[n:], resume=True), h.filter(zs[n:], resume=True)):
        for name in ("x", "P", "mu", "class_weights", "log_likelihood"):
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name), err_msg=name)


@pytest.mark.parametrize("damage", ["gone", "short", "nan"])
def test_a_file_without_the_means_of_its_law_is_refused(damage):
    model = made("matrix", moving=True).to_exact(2)
    f = CGOMSMFilter(model)
    f.filter(model.simulate(80, np.random.default_rng(0)).y)
    values = f.to_dict()
    law = values["state"]["law"]
    if damage == "gone":
        del law["mean"]
    else:
        law["mean"] = law["mean"][:1] if damage == "short" else [[float("nan")] * 3] * 2
    with pytest.raises((FileFormatError, KeyError, ValueError)):
        CGOMSMFilter.from_dict(values)


@pytest.mark.parametrize("moving", [False, True])
def test_it_keeps_the_contract_of_filters(moving):
    model = made("fmc1", moving=moving).to_exact(2, n_nodes=1)
    report = check_filter(lambda: CGOMSMFilter(model), 0.5 * np.sin(1.3 * np.arange(6)[:, None]))
    assert {"saver", "save", "resume", "filter_many", "outlier"} <= set(report.passed)


def test_simulated_steps_follow_the_tables():
    model = made("matrix", m=2, q=1).to_exact(2)
    data, pairs = model.simulate(6000, np.random.default_rng(5)), model.placed().pair_tables(5).pairs
    i, j = data.r[1:-1].astype(int), data.r[2:].astype(int)
    window = np.concatenate([data.y[1:-1], data.y[:-2]], axis=1)
    Axx, H, G, c, C, Ayy, Ny, Qyy = (part[i, j] for part in pairs)
    v = data.y[2:] - np.einsum("nkl,nl->nk", Ayy, window) - Ny
    u = data.x[2:] - np.einsum("nkl,nl->nk", Axx, data.x[1:-1]) - np.einsum("nkl,nl->nk", H, window) - c
    u -= np.einsum("nkl,nl->nk", G, data.y[2:])
    white = np.concatenate(
        [v / np.sqrt(Qyy[:, 0]), np.linalg.solve(np.linalg.cholesky(C), u[..., None])[..., 0]], axis=1
    )
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=4 / np.sqrt(6000))
    np.testing.assert_allclose(white.T @ white / 6000, np.eye(3), atol=4 * np.sqrt(2 / 6000))


@pytest.mark.parametrize(
    ("change", "arguments", "error", "message"),
    [
        ({}, {"order": 0}, ParameterError, "order: got 0, expected a whole number of at least 1"),
        ({}, {"order": 1.5}, ParameterError, "order: got 1.5"),
        ({}, {"order": 65}, ParameterError, "order: got 65, expected at most 64"),
        ({}, {"order": "2"}, ParameterError, "order: got '2'"),
        ({}, {"order": 1, "n_nodes": -1}, ParameterError, "n_nodes: got -1"),
        ({}, {"order": 1, "n_nodes": 50}, ParameterError, "n_nodes: got 50|T: got"),
        ({"B": [[1.0]]}, {"order": 1}, ParameterError, "B: got a model with 1 controls, expected one with"),
        ({"R": 0.0, "Q": 0.0, "x0": [0.0], "P0": 0.0}, {"order": 1}, NotPositiveDefiniteError,
         r"covariance of the first observation in the regime 0"),
        ({"F": 1e80, "x0": [1.0], "P0": 1.0}, {"order": 1}, NotStableError,
         "the covariance of the state has grown beyond"),
    ],
)  # fmt: skip
def test_bad_arguments(change, arguments, error, message):
    with pytest.raises(error, match=message):
        made(**change).to_exact(**arguments)


@pytest.mark.parametrize(
    ("change", "stationary"),
    [
        ({}, True),
        ({"x0": [0.0]}, False),
        ({"P0": 1.0}, False),
        ({"initial": [1.0, 0.0]}, False),
    ],
)
def test_only_a_stationary_start_is_taken_for_one(change, stationary):
    model = made("matrix", **change)
    given = SpaceOnNodes.of(model.placed())
    assert given.starts_stationary is stationary
    assert (model.to_exact(2).placed().steady_from is not None) is stationary
    if not stationary:
        with pytest.raises(ParameterError, match="initial_mean, initial_covariance: expected the stationary"):
            given.check_stationary()
    # the stationary moments, given as numbers, are as good
    law = SpaceOnNodes.of(made("matrix").placed())
    same = made("matrix", x0=law.initial_mean, P0=law.initial_covariance)
    assert SpaceOnNodes.of(same.placed()).starts_stationary


@pytest.mark.parametrize("units", [1e-6, 1.0, 1e6])
def test_a_start_is_judged_whatever_the_units(units):
    plain = made("matrix", m=2)
    law, t = SpaceOnNodes.of(plain.placed()), plain.placed().tables
    sd = np.sqrt(np.diagonal(law.initial_covariance, axis1=1, axis2=2))

    def starts(mean, covariance):
        given = {"F": t.F, "H": t.H / units, "Q": units**2 * t.Q, "R": t.R, "b": units * t.b, "d": t.d}
        model = SwitchingStateSpace(LAWS["matrix"], **given, x0=units * mean, P0=units**2 * covariance)
        return SpaceOnNodes.of(model.placed()).starts_stationary

    assert starts(law.initial_mean, law.initial_covariance)
    assert not starts(law.initial_mean, law.initial_covariance * (1.0 + 1e-6))
    assert not starts(law.initial_mean + 1e-6 * sd, law.initial_covariance)


def test_a_node_that_never_is_has_no_say_in_what_is_stationary():
    T = np.array([[0.9, 0.1, 0.0], [0.3, 0.7, 0.0], [0.5, 0.5, 0.0]])
    chain = SwitchChain([0.0, 1.0, 0.5], np.ones(3), [0.75, 0.25, 0.0], T)
    model = SwitchingStateSpace(chain, F=[[[0.5]], [[0.8]]], H=1.0, Q=0.3, R=0.2, b=[1.0])
    assert SpaceOnNodes.of(model.placed()).starts_stationary
    assert model.to_exact(2).placed().steady_from == 1

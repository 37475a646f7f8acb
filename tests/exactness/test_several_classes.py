"""Fuzzy switches between three classes equal the enumeration of all paths of the nodes.

What a step does at a pair of class weights is written down here from the definitions of the three
forms, one class after the other; `enumerate_sequences` and `enumerate_paths` do the rest.
"""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pytest
import scipy.linalg

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    FadeLaw,
    FuzzyMarkovLaw,
    GraphLaw,
    KnownSwitchFilter,
    OFSRFilter,
)

TOLERANCE = {"rtol": 1e-10, "atol": 1e-11}
K = 3


# --------------------------------------------------------------------------- forms by definition


def bilinear(values, u, v):
    """The sum over the pairs of classes of u_i v_j values_ij."""
    return sum(u[i] * v[j] * values[i][j] for i in range(len(u)) for j in range(len(v)))


def linear(values, u):
    return sum(u[i] * values[i] for i in range(len(u)))


def covariance_step(means, gamma, m, u, v):
    """Condition the interpolated Gaussian of (Z_1, Z_2), after setting Cov(Y_2, X_1), on Z_1."""
    d = means.shape[1]
    G = bilinear(gamma, u, v)
    Sigma, cross, after = G[:d, :d], G[d:, :d].copy(), G[d:, d:]
    cross[m:, :m] = cross[m:, m:] @ np.linalg.inv(Sigma[m:, m:]) @ Sigma[m:, :m]
    A = cross @ np.linalg.inv(Sigma)
    return A, linear(means, v) - A @ linear(means, u), after - A @ Sigma @ A.T


def transition_step(means, A, Q, u, v):
    """Interpolate transition and symmetric root of the noise of the pairs of classes."""
    root = bilinear([[scipy.linalg.sqrtm(Q[i, j]) for j in range(len(v))] for i in range(len(u))], u, v)
    mixed = bilinear(A, u, v)
    return mixed, linear(means, v) - mixed @ linear(means, u), root @ root.T


def log_interpolation(matrices, weights):
    """Interpolate each component's regression on the earlier ones, and the log of its residual variance."""
    d = matrices[0].shape[-1]
    L, variances = np.eye(d), np.ones(d)
    for k in range(d):
        for w, V in zip(weights, matrices, strict=True):
            coefficients = np.linalg.inv(V[:k, :k]) @ V[:k, k]
            L[k, :k] -= w * coefficients
            variances[k] *= (V[k, k] - V[k, :k] @ coefficients) ** w
    inverse = np.linalg.inv(L)
    return inverse @ np.diag(variances) @ inverse.T


def regression_step(p, u, v):
    """Interpolate the regressions of Y' on Y and of X' on (X, Y, Y'); covariances in their logarithm."""
    mix = {name: bilinear(p[name], u, v) for name in ("Ayy", "Ny", "Axx", "H", "G", "c")}
    pairs = list(itertools.product(range(len(u)), range(len(v))))
    C, V = (
        log_interpolation([p[name][ij] for ij in pairs], [u[i] * v[j] for i, j in pairs]) for name in "CV"
    )
    G, m, q = mix["G"], len(mix["Axx"]), len(mix["Ayy"])
    A = np.block([[mix["Axx"], mix["H"] + G @ mix["Ayy"]], [np.zeros((q, m)), mix["Ayy"]]])
    return A, np.r_[mix["c"] + G @ mix["Ny"], mix["Ny"]], np.block([[C + G @ V @ G.T, G @ V], [V @ G.T, V]])


def regressions(m, q, seed):
    """Parameters of a regression form; V stands for Qyy."""
    rng = np.random.default_rng(seed)

    def covariances(*shape):
        root = 0.4 * rng.normal(size=shape) + 0.7 * np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return {
        "Ayy": rng.normal(size=(K, K, q, q)) * 0.4,
        "Ny": rng.normal(size=(K, K, q)),
        "V": covariances(K, K, q, q),
        "Axx": rng.normal(size=(K, K, m, m)) * 0.5,
        "H": rng.normal(size=(K, K, m, q)),
        "G": rng.normal(size=(K, K, m, q)),
        "c": rng.normal(size=(K, K, m)),
        "C": covariances(K, K, m, m),
        "means": rng.normal(size=(K, m + q)),
        "covariances": covariances(K, m + q, m + q),
    }


def stationary_parameters(m, q, make_transitions, seed=1):
    """Means, covariances of pairs, and A, Q and Sigma of the pairs of classes."""
    A, _, means, Sigma = make_transitions(K, m, q, seed=seed)
    A = 0.3 * A
    gamma = np.empty((K, K, 2 * (m + q), 2 * (m + q)))
    Q = np.empty_like(A)
    for i, j in itertools.product(range(K), repeat=2):
        cross = A[i, j] @ Sigma[i]
        gamma[i, j] = np.block([[Sigma[i], cross.T], [cross, Sigma[j]]])
        Q[i, j] = Sigma[j] - cross @ A[i, j].T
    return means, gamma, A, Q, Sigma


def make(form, law, m, q, make_transitions):
    """A model, and by definition its step and its first moments at any class weights."""
    if form == "regression":
        p = regressions(m, q, seed=4)
        given = {"Qyy" if name == "V" else name: value for name, value in p.items()}
        model = CGOFMSModel.from_regressions(law, **given)
        return (
            model,
            partial(regression_step, p),
            lambda u: (linear(p["means"], u), log_interpolation(p["covariances"], u)),
        )
    means, gamma, A, Q, Sigma = stationary_parameters(m, q, make_transitions)
    step = (
        partial(covariance_step, means, gamma, m)
        if form == "covariance"
        else partial(transition_step, means, A, Q)
    )
    model = CGOFMSModel(law, means, gamma, m, interpolation=form)
    return model, step, lambda u: (linear(means, u), linear(Sigma, u))


def tables(step, weights):
    """Arrays of A, N and Q for all pairs of class weights."""
    parts = [[step(u, v) for v in weights] for u in weights]
    return tuple(np.array([[pair[k] for pair in row] for row in parts]) for k in range(3))


def first_moments(first, weights):
    return tuple(np.array(part) for part in zip(*map(first, weights), strict=True))


def nodes_of(law, F):
    """The classes, then the cells of each way, from its first class to its second."""
    ways = list(law.fades) if isinstance(law, FadeLaw) else law.edges
    cells = [((1 - t) * np.eye(K)[a] + t * np.eye(K)[b]) for a, b in ways for t in (np.arange(F) + 0.5) / F]
    return np.array([*np.eye(K), *cells])


# --------------------------------------------------------------------------- filters and smoothers

RING = FadeLaw(3, {(0, 1): (0.3, 3), (1, 2): (0.2, 4), (2, 0): (0.4, 2.5)}, jumps={(0, 2): 0.1})
TURNING = FadeLaw(
    3,
    {(0, 1): (0.3, 4), (1, 0): (0.2, 5), (1, 2): (0.1, 6), (2, 1): (0.25, 4)},
    jumps={(2, 0): 0.05},
    turn_back=0.2,
)
PATH = GraphLaw.from_masses([0.3, 0.3, 0.2], {(0, 1): 0.25, (1, 2): 0.15}, jumps={(0, 1): 0.03})
CROSSED = GraphLaw.from_masses(
    [0.3, 0.3, 0.2],
    {(0, 1): 0.25, (2, 1): 0.2},
    jumps={(0, 2): 0.02},
    family="band",
    shape=0.4,
    crossings={((0, 1), (2, 1)): (0.02, 0.5)},
)

#: (law, cells, m, q, N): as many paths as can be enumerated in a moment
CASES = {
    "ring": (RING, 1, 1, 1, 5),
    "ring of two cells": (RING, 2, 2, 1, 4),
    "ring, two observations": (RING, 1, 1, 2, 4),
    "turning back": (TURNING, 1, 1, 1, 5),
    "turning back, two cells": (TURNING, 2, 1, 2, 3),
    "path": (PATH, 2, 1, 1, 4),
    "path, two states": (PATH, 1, 2, 1, 4),
    "crossings": (CROSSED, 2, 1, 1, 4),
    "crossings, two of each": (CROSSED, 1, 2, 2, 3),
}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.mark.parametrize("form", ["covariance", "transition", "regression"])
def test_filters_are_exact(form, case, make_transitions, enumerate_sequences):
    law, F, m, q, N = case
    model, step, first = make(form, law, m, q, make_transitions)
    chain, weights = law.discretize(F), nodes_of(law, F)
    y = model.simulate(N, np.random.default_rng(3), F).y
    truth = enumerate_sequences(
        chain.initial, chain.transition, first_moments(first, weights), tables(step, weights), y, m
    )
    truth["class_weights"] = truth["mu"] @ weights
    f = OFSRFilter(model, F)
    np.testing.assert_allclose(f.nodes, weights, rtol=0, atol=1e-15)
    names = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood", "class_weights")
    whole, many = f.filter(y), f.filter_many(np.stack([y, y + 0.5, y]), keep=(*names, "switch"))
    for name in names:
        np.testing.assert_allclose(getattr(whole, name), truth[name], **TOLERANCE, err_msg=name)
        for k in (0, 2):
            np.testing.assert_allclose(getattr(many, name)[k], truth[name], **TOLERANCE, err_msg=name)
    assert whole.switch_mean is None
    np.testing.assert_array_equal(many.switch[0], whole.switch)
    assert whole.switch.shape == (N, K)
    f.reset()
    for n, z in enumerate(y):
        f.step(z)
        np.testing.assert_allclose(f.x[:, 0], truth["x"][n], **TOLERANCE)
        for name in names[1:]:
            got = getattr(f, name)
            expected = truth[name][n].reshape(np.shape(got))
            np.testing.assert_allclose(got, expected, **TOLERANCE, err_msg=name)
        np.testing.assert_array_equal(f.switch, whole.switch[n])
        assert f.switch_mean is None


@pytest.mark.parametrize("form", ["covariance", "transition", "regression"])
def test_smoothers_are_exact(form, case, make_transitions, enumerate_paths):
    law, F, m, q, N = case
    model = make(form, law, m, q, make_transitions)[0]
    y = model.simulate(N, np.random.default_rng(5), F).y
    truth, weights = enumerate_paths(model.placed(F), y), nodes_of(law, F)
    result = OFSRFilter(model, F).smooth(y)
    np.testing.assert_allclose(result.x, truth.mean, **TOLERANCE)
    np.testing.assert_allclose(result.P, truth.covariance, **TOLERANCE)
    np.testing.assert_allclose(result.mu, truth.probability, **TOLERANCE)
    np.testing.assert_allclose(result.class_weights, truth.probability @ weights, **TOLERANCE)
    np.testing.assert_allclose(result.switch_path, weights[truth.best_path], rtol=0, atol=1e-15)
    assert result.log_likelihood.sum() == pytest.approx(truth.log_likelihood, rel=1e-10)
    assert result.switch_mean is None


@pytest.mark.parametrize("missing", [0, 4])
def test_gaps_at_the_ends_are_exact(missing, make_transitions, enumerate_paths):
    # after a gap in between two observations only moments are carried on, for any number of classes
    model = make("covariance", RING, 1, 1, make_transitions)[0]
    y = model.simulate(5, np.random.default_rng(5), 1).y
    y[missing] = np.nan
    f = OFSRFilter(model, 1)
    result, smoothed = f.filter(y), f.smooth(y)
    last = enumerate_paths(model.placed(1), y)
    np.testing.assert_allclose(smoothed.class_weights, last.probability @ nodes_of(RING, 1), **TOLERANCE)
    for n in range(5):
        truth = enumerate_paths(model.placed(1), y, n + 1)
        np.testing.assert_allclose(result.x[n], truth.mean[n], **TOLERANCE)
        np.testing.assert_allclose(
            result.class_weights[n], truth.probability[n] @ nodes_of(RING, 1), **TOLERANCE
        )


@pytest.mark.parametrize("form", ["covariance", "transition", "regression"])
def test_known_weights_are_one_path(form, make_transitions, enumerate_sequences):
    # weights anywhere on the simplex, also where the law never goes
    u = np.array([[0.2, 0.5, 0.3], [0, 0, 1], [0.6, 0.4, 0], [1, 0, 0], [0, 0.1, 0.9]])
    model, step, first = make(form, RING, 2, 1, make_transitions)
    y, M = model.simulate(len(u), np.random.default_rng(3), 2).y, len(u)
    chain = np.eye(M)[0], np.roll(np.eye(M), 1, axis=1)  # it visits them in turn
    truth = enumerate_sequences(*chain, first_moments(first, u), tables(step, u), y, 2)
    f = KnownSwitchFilter(model)
    result = f.filter(y, u)
    f.reset()
    for n in range(M):
        f.step(y[n], u[n])
        np.testing.assert_allclose(f.x[:, 0], truth["x"][n], **TOLERANCE)
        np.testing.assert_allclose(f.P_prior, truth["P_prior"][n], **TOLERANCE)
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        np.testing.assert_allclose(getattr(result, name), truth[name], **TOLERANCE, err_msg=name)
    np.testing.assert_array_equal(result.class_weights, u)


# --------------------------------------------------------------------------- other names, other laws


def renamed(law, order):
    """The same law, its class ``k`` called ``order[k]``."""
    if isinstance(law, FadeLaw):
        fades = {(order[a], order[b]): value for (a, b), value in law.fades.items()}
        jumps = {(order[a], order[b]): p for (a, b), p in law.jumps.items()}
        return FadeLaw(K, fades, jumps=jumps, turn_back=law.turn_back)
    corners = np.empty((K, K))
    corners[np.ix_(order, order)] = law.corners
    crossings = {
        tuple(tuple(order[k] for k in edge) for edge in pair): value for pair, value in law.crossings.items()
    }
    edges, densities = [(order[a], order[b]) for a, b in law.edges], law.parameters["parameters"]
    return GraphLaw(K, edges, corners, family=law.family, parameters=densities, crossings=crossings)


@pytest.mark.parametrize("order", list(itertools.permutations(range(K)))[1:])
@pytest.mark.parametrize("law", [RING, TURNING, PATH, CROSSED], ids=["ring", "turning", "path", "crossed"])
def test_names_of_classes_do_not_matter(law, order, make_transitions):
    means, gamma, *_ = stationary_parameters(2, 1, make_transitions, seed=2)
    order = list(order)
    other_means, other_gamma = np.empty_like(means), np.empty_like(gamma)
    other_means[order], other_gamma[np.ix_(order, order)] = means, gamma
    model = CGOFMSModel(law, means, gamma, 2)
    other = CGOFMSModel(renamed(law, order), other_means, other_gamma, 2)
    y = model.simulate(60, np.random.default_rng(1), 2).y
    for verb in ("filter", "smooth"):
        result, found = (getattr(OFSRFilter(one, 2), verb)(y) for one in (model, other))
        for name in ("x", "P", "log_likelihood"):
            np.testing.assert_allclose(getattr(found, name), getattr(result, name), **TOLERANCE)
        for name in ("class_weights", "switch"):
            np.testing.assert_allclose(getattr(found, name)[:, order], getattr(result, name), **TOLERANCE)
    np.testing.assert_allclose(other.harden().transition[np.ix_(order, order)], model.harden().transition)


JUMPS = {(0, 1): 0.1, (1, 2): 0.2, (2, 0): 0.15, (2, 1): 0.05}


@pytest.mark.parametrize(
    ("law", "n_nodes"),
    [
        (FadeLaw(3, {}, jumps=JUMPS), 5),
        (FadeLaw(3, dict.fromkeys(JUMPS, (0.0, 6.0)), jumps=JUMPS), 5),  # fades that never begin
        (FadeLaw(3, {pair: (p, 6.0) for pair, p in JUMPS.items()}), 0),  # of no cells: at once
        (GraphLaw.from_masses([3, 3, 2], {}, jumps={(0, 1): 0.4, (1, 2): 0.2}), 5),
        (GraphLaw.from_masses([3, 3, 2], {(0, 2): 0.5}, jumps={(0, 1): 0.4, (1, 2): 0.2}), 0),
    ],
    ids=["jumps", "rate zero", "no cells", "no edges", "edges without cells"],
)
def test_what_never_fades_is_the_hard_model(law, n_nodes, make_transitions):
    means, gamma, *_ = stationary_parameters(1, 2, make_transitions)
    model = CGOFMSModel(law, means, gamma, 1)
    hard = model.harden(0)
    y = model.simulate(80, np.random.default_rng(1), n_nodes).y
    for verb in ("filter", "smooth"):
        result, expected = getattr(OFSRFilter(model, n_nodes), verb)(y), getattr(CGOMSMFilter(hard), verb)(y)
        for name in ("x", "P", "log_likelihood", "class_weights"):
            np.testing.assert_allclose(getattr(result, name), getattr(expected, name), **TOLERANCE)
        np.testing.assert_array_equal(result.switch, np.eye(K)[expected.switch.astype(int)])


@pytest.mark.parametrize(
    ("law", "family", "densities"),
    [
        (FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), "linear", (0.16, 0.05)),
        (FuzzyMarkovLaw.fmc2(0.12, 0.3, 0.4), "band", (0.3, 0.4)),
    ],
    ids=["fmc1", "fmc2"],
)
@pytest.mark.parametrize("n_nodes", [0, 1, 4, 5])
def test_graphs_of_two_classes_are_the_laws_of_the_paper(law, family, densities, n_nodes, fuzzy_model):
    form = fuzzy_model.form
    graph = GraphLaw(2, [(0, 1)], law.corners, family=family, parameters=[densities])
    one, other = (CGOFMSModel(each, form.means, form.covariances, 1) for each in (law, graph))
    y = one.simulate(60, np.random.default_rng(1)).y
    result, expected = OFSRFilter(other, n_nodes).filter(y), OFSRFilter(one, n_nodes).filter(y)
    for name in ("x", "P", "log_likelihood", "class_weights", "switch_mean"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), **TOLERANCE)


def test_fades_of_two_classes_without_cells_are_jumps(fuzzy_model):
    # the only law of the paper that a fade can be: FMC1 without anything between its corners
    form = fuzzy_model.form
    law = FuzzyMarkovLaw.fmc1(0.4, 0.0, 0.0)  # leaves a corner with beta = .1: one step in five
    assert law.p_hard == pytest.approx(1.0)
    y = fuzzy_model.simulate(60, np.random.default_rng(1)).y
    expected = OFSRFilter(CGOFMSModel(law, form.means, form.covariances, 1), 3).filter(y)
    for fades, n_nodes in ((FadeLaw.between(5, 4), 0), (FadeLaw.between(5, 4, jump=0.2), 3)):
        result = OFSRFilter(CGOFMSModel(fades, form.means, form.covariances, 1), n_nodes).filter(y)
        for name in ("x", "P", "log_likelihood", "switch_mean"):
            np.testing.assert_allclose(getattr(result, name), getattr(expected, name), **TOLERANCE)

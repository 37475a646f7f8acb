"""The filters equal the enumeration of all sequences of nodes, without any recursion.

Pair by pair the system Z' = A Z + N + N(0, Q) is written down here from the definitions
of the three forms, independently of the code under test; `enumerate_sequences` does the
rest.
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
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchChain,
)
from fuzzykf.switching import SwitchingFilter
from fuzzykf.switching.dynamics.forms import TransitionForm
from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

TOLERANCE = {"rtol": 1e-9, "atol": 1e-11}


def check(f, y, truth):
    """Compare whole series and single steps with the enumeration."""
    result = f.filter(y)
    for name in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood"):
        np.testing.assert_allclose(getattr(result, name), truth[name], **TOLERANCE, err_msg=name)
    np.testing.assert_allclose(result.switch_mean, truth["mu"] @ f.nodes, **TOLERANCE)
    f.reset()
    for n, z in enumerate(y):
        f.predict()
        np.testing.assert_allclose(f.x[:, 0], truth["x_prior"][n], **TOLERANCE)
        np.testing.assert_allclose(f.P, truth["P_prior"][n], **TOLERANCE)
        f.update(z)
        np.testing.assert_allclose(f.x[:, 0], truth["x"][n], **TOLERANCE)
        np.testing.assert_allclose(f.P, truth["P"][n], **TOLERANCE)
        np.testing.assert_allclose(f.x_prior[:, 0], truth["x_prior"][n], **TOLERANCE)
        np.testing.assert_allclose(f.P_prior, truth["P_prior"][n], **TOLERANCE)
        np.testing.assert_allclose(f.mu, truth["mu"][n], **TOLERANCE)
        assert f.log_likelihood == pytest.approx(truth["log_likelihood"][n], rel=1e-9, abs=1e-11)
        e, S = z - truth["y_prior"][n], truth["S"][n]
        np.testing.assert_allclose(f.y[:, 0], e, **TOLERANCE)
        np.testing.assert_allclose(f.S, S, **TOLERANCE)
        assert f.nis == pytest.approx(e @ np.linalg.inv(S) @ e, rel=1e-8)
        assert f.mahalanobis == pytest.approx(np.sqrt(e @ np.linalg.inv(S) @ e), rel=1e-8)


# --------------------------------------------------------------------------- systems by definition


def bilinear(values, r1, r2):
    """(1 - r1)(1 - r2) v00 + (1 - r1) r2 v01 + r1 (1 - r2) v10 + r1 r2 v11."""
    return (1 - r1) * ((1 - r2) * values[0, 0] + r2 * values[0, 1]) + r1 * (
        (1 - r2) * values[1, 0] + r2 * values[1, 1]
    )


def linear(values, r):
    return (1 - r) * values[0] + r * values[1]


def covariance_step(means, gamma, m, r1, r2):
    """Condition the interpolated Gaussian of (Z_1, Z_2), after setting Cov(Y_2, X_1), on Z_1."""
    d = means.shape[1]
    G = bilinear(gamma, r1, r2)
    Sigma, K, after = G[:d, :d], G[d:, :d].copy(), G[d:, d:]
    K[m:, :m] = K[m:, m:] @ np.linalg.inv(Sigma[m:, m:]) @ Sigma[m:, :m]
    A = K @ np.linalg.inv(Sigma)
    return A, linear(means, r2) - A @ linear(means, r1), after - A @ Sigma @ A.T


def transition_step(means, A, Q, r1, r2):
    root = bilinear(np.array([[scipy.linalg.sqrtm(Q[i, j]) for j in range(2)] for i in range(2)]), r1, r2)
    A = bilinear(A, r1, r2)
    return A, linear(means, r2) - A @ linear(means, r1), root @ root.T


def triangular_interpolation(matrices, weights):
    """Interpolate each component's regression on the earlier ones, and the log of its residual variance."""
    d = matrices.shape[-1]
    L, variances = np.eye(d), np.zeros(d)
    for k in range(d):
        coefficients = [np.linalg.inv(V[:k, :k]) @ V[:k, k] for V in matrices]
        residual = [V[k, k] - V[k, :k] @ b for V, b in zip(matrices, coefficients, strict=True)]
        L[k, :k] = -sum(w * b for w, b in zip(weights, coefficients, strict=True))
        variances[k] = np.prod([v**w for w, v in zip(weights, residual, strict=True)])
    inverse = np.linalg.inv(L)
    return inverse @ np.diag(variances) @ inverse.T


def regression_step(p, r1, r2):
    mix = {k: bilinear(p[k], r1, r2) for k in ("Ayy", "Ny", "Axx", "H", "G", "c")}
    weights = [(1 - r1) * (1 - r2), (1 - r1) * r2, r1 * (1 - r2), r1 * r2]
    C, V = (triangular_interpolation(p[k].reshape(4, *p[k].shape[2:]), weights) for k in ("C", "Qyy"))
    G, m, q = mix["G"], len(mix["Axx"]), len(mix["Ayy"])
    A = np.block([[mix["Axx"], mix["H"] + G @ mix["Ayy"]], [np.zeros((q, m)), mix["Ayy"]]])
    return A, np.r_[mix["c"] + G @ mix["Ny"], mix["Ny"]], np.block([[C + G @ V @ G.T, G @ V], [V @ G.T, V]])


def gamma_from(A, Sigma):
    """Covariances of (Z_1, Z_2) for Z_2 = A Z_1 + noise, with the covariance of Z_2 prescribed."""
    pairs = itertools.product(range(len(Sigma)), repeat=2)
    d = Sigma.shape[-1]
    gamma = np.empty((len(Sigma), len(Sigma), 2 * d, 2 * d))
    for i, j in pairs:
        K = A[i, j] @ Sigma[i]
        gamma[i, j] = np.block([[Sigma[i], K.T], [K, Sigma[j]]])
    return gamma


def moments(means, Sigma, nodes):
    """Mean and covariance of the first Z at each node, of the stationary forms."""
    return np.array([linear(means, r) for r in nodes]), np.array([linear(Sigma, r) for r in nodes])


def regression_moments(p, nodes):
    matrices = [triangular_interpolation(p["covariances"], [1 - r, r]) for r in nodes]
    return np.array([linear(p["means"], r) for r in nodes]), np.array(matrices)


def tables(step, nodes):
    """Arrays of A, N and Q for all pairs of nodes."""
    parts = [[step(r1, r2) for r2 in nodes] for r1 in nodes]
    return tuple(np.array([[pair[k] for pair in row] for row in parts]) for k in range(3))


def observations(model, n, seed=3):
    return model.simulate(n, np.random.default_rng(seed)).y


LAWS = {
    "fmc1": FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    "fmc2": FuzzyMarkovLaw.fmc2(0.12, 0.3, 0.4),
}

#: (m, q, F, N): (F + 2)^N sequences
SIZES = [(1, 1, 2, 6), (2, 2, 1, 5), (1, 2, 1, 5), (2, 1, 1, 5)]


def nodes_of(F):
    return np.r_[0.0, (np.arange(F) + 0.5) / F, 1.0]


def chain_of(law, F):
    """The midpoint chain, J_ij proportional to W_i W_j p(r_i, r_j), from the definition."""
    nodes, W = nodes_of(F), np.r_[1.0, np.full(F, 1.0 / F), 1.0]
    p = law.parameters

    def density(a, b):
        if {a, b} <= {0.0, 1.0}:
            return p["alpha"] if a == b else law.beta
        if law.kind == "fmc1":
            return p["eta"] + (p["delta"] - p["eta"]) * abs(a - b)
        return p["gamma"] if abs(a - b) <= p["delta"] + 1e-12 else 0.0

    J = np.array([[W[i] * W[j] * density(a, b) for j, b in enumerate(nodes)] for i, a in enumerate(nodes)])
    J /= J.sum()
    return J.sum(axis=1), J / J.sum(axis=1)[:, None]


@pytest.mark.parametrize(
    ("law", "m", "q", "F", "N"),
    [("fmc1", *size) for size in SIZES] + [("fmc2", m, q, 3, 4) for m, q, *_ in SIZES],  # 1/3 < .4, the band
)
def test_covariance_form(law, m, q, F, N, make_transitions, enumerate_sequences):
    A, _, means, Sigma = make_transitions(2, m, q, seed=1)
    gamma = gamma_from(0.6 * A, Sigma)
    gamma[..., m + q + m :, :m] += 0.1  # ignored: set at each pair of nodes
    gamma[..., :m, m + q + m :] += 0.1
    model = CGOFMSModel(LAWS[law], means, gamma, m)
    y, nodes = observations(model, N), nodes_of(F)
    step = tables(partial(covariance_step, means, gamma, m), nodes)
    assert not step[0][..., m:, :m].round(12).any()
    truth = enumerate_sequences(*chain_of(LAWS[law], F), moments(means, Sigma, nodes), step, y, m)
    check(OFSRFilter(model, F, "midpoint"), y, truth)


@pytest.mark.parametrize(("m", "q", "F", "N"), SIZES)
def test_transition_form(m, q, F, N, make_transitions, enumerate_sequences):
    law = LAWS["fmc1"]
    A, _, means, Sigma = make_transitions(2, m, q, seed=2)
    A = 0.6 * A
    gamma = gamma_from(A, Sigma)
    Q = np.array([[Sigma[j] - A[i, j] @ Sigma[i] @ A[i, j].T for j in range(2)] for i in range(2)])
    model = CGOFMSModel(law, means, gamma, m, interpolation="transition")
    y, nodes = observations(model, N), nodes_of(F)
    step = tables(partial(transition_step, means, A, Q), nodes)
    truth = enumerate_sequences(*chain_of(law, F), moments(means, Sigma, nodes), step, y, m)
    check(OFSRFilter(model, F, "midpoint"), y, truth)


def regression_parameters(m, q, seed):
    rng = np.random.default_rng(seed)

    def covariances(*shape):
        root = 0.4 * rng.normal(size=shape) + 0.7 * np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return {
        "Ayy": rng.normal(size=(2, 2, q, q)) * 0.4,
        "Ny": rng.normal(size=(2, 2, q)),
        "Qyy": covariances(2, 2, q, q),
        "Axx": rng.normal(size=(2, 2, m, m)) * 0.5,
        "H": rng.normal(size=(2, 2, m, q)),
        "G": rng.normal(size=(2, 2, m, q)),
        "c": rng.normal(size=(2, 2, m)),
        "C": covariances(2, 2, m, m),
        "means": rng.normal(size=(2, m + q)),
        "covariances": covariances(2, m + q, m + q),
    }


@pytest.mark.parametrize(("m", "q", "F", "N"), SIZES)
def test_regression_form(m, q, F, N, enumerate_sequences):
    law, p = LAWS["fmc1"], regression_parameters(m, q, seed=4)
    model = CGOFMSModel.from_regressions(law, **p)
    y, nodes = observations(model, N), nodes_of(F)
    step = tables(partial(regression_step, p), nodes)
    truth = enumerate_sequences(*chain_of(law, F), regression_moments(p, nodes), step, y, m)
    check(OFSRFilter(model, F, "midpoint"), y, truth)


@pytest.mark.parametrize(
    ("m", "q", "F", "N"), [(1, 1, 1, 5), (1, 1, 2, 5), (1, 1, 4, 3), (2, 1, 2, 4), (1, 2, 1, 5)]
)
@pytest.mark.parametrize(
    "law",
    [
        FadeLaw.between(6, 5),
        FadeLaw(2, {(0, 1): (0.2, 4.5), (1, 0): (0.1, 8)}, jumps={(1, 0): 0.1}),
        FadeLaw.between(5, 7, jump=0.05, turn_back=0.25),
    ],
    ids=["plain", "uneven", "turning"],
)
def test_fades(law, m, q, F, N, make_transitions, enumerate_sequences):
    # two directions on the same values, and most pairs of nodes impossible
    A, _, means, Sigma = make_transitions(2, m, q, seed=1)
    gamma = gamma_from(0.6 * A, Sigma)
    model = CGOFMSModel(law, means, gamma, m)
    y, chain = model.simulate(N, np.random.default_rng(3), F).y, law.discretize(F)
    assert (chain.transition == 0.0).any()
    step = tables(partial(covariance_step, means, gamma, m), chain.nodes)
    first = moments(means, Sigma, chain.nodes)
    truth = enumerate_sequences(chain.initial, chain.transition, first, step, y, m)
    check(OFSRFilter(model, F), y, truth)


@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 1), (1, 2), (2, 2), (3, 1)])
def test_three_hard_regimes(m, q, make_transitions, enumerate_sequences):
    A, Q, means, Sigma = make_transitions(3, m, q, seed=7)
    P = np.array([[0.8, 0.2, 0.0], [0.1, 0.7, 0.2], [0.3, 0.1, 0.6]])  # with an impossible pair
    initial = np.array([0.5, 0.2, 0.3])
    model = CGOMSModel.from_transitions(P, A, Q, means, Sigma, m, initial=initial)
    y = observations(model, 5)
    N = means[None] - np.einsum("ijkl,il->ijk", A, means)
    truth = enumerate_sequences(initial, P, (means, Sigma), (A, N, Q), y, m)
    check(CGOMSMFilter(model), y, truth)


def test_singular_state_noise(make_transitions, enumerate_sequences):
    # X' is determined by (X, Y, Y') in one regime: a valid, singular noise covariance
    A, Q, means, Sigma = make_transitions(2, 1, 1, seed=9)
    Q[:, 1, 0, 0] = Q[:, 1, 0, 1] ** 2 / Q[:, 1, 1, 1]
    P, initial = np.array([[0.6, 0.4], [0.3, 0.7]]), np.array([0.5, 0.5])
    model = CGOMSModel.from_transitions(P, A, Q, means, Sigma, 1, initial=initial)
    y = observations(model, 6)
    N = means[None] - np.einsum("ijkl,il->ijk", A, means)
    truth = enumerate_sequences(initial, P, (means, Sigma), (A, N, Q), y, 1)
    check(CGOMSMFilter(model), y, truth)


@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 2)])
def test_one_class_is_one_joint_gaussian(m, q, make_transitions, enumerate_sequences):
    A, Q, means, Sigma = make_transitions(1, m, q, seed=11)
    model = CGOMSModel.from_transitions([[1.0]], A, Q, means, Sigma, m)
    y = observations(model, 30)
    N = means[None] - np.einsum("ijkl,il->ijk", A, means)
    one = np.ones(1), np.ones((1, 1))
    truth = enumerate_sequences(*one, (means, Sigma), (A, N, Q), y, m)
    f = CGOMSMFilter(model)
    check(f, y, truth)
    np.testing.assert_array_equal(f.mu, [1.0])


@pytest.mark.parametrize("form", ["covariance", "transition", "regression"])
def test_known_switch_is_one_path(form, make_transitions, enumerate_sequences):
    # the values of the switch are no nodes; the oracle sees one path with its own tables
    m, q = 2, 1
    A, _, means, Sigma = make_transitions(2, m, q, seed=13)
    A, p = 0.3 * A, regression_parameters(m, q, seed=14)
    gamma = gamma_from(A, Sigma)
    Q = np.array([[Sigma[j] - A[i, j] @ Sigma[i] @ A[i, j].T for j in range(2)] for i in range(2)])
    stationary = partial(moments, means, Sigma)
    if form == "regression":
        model = CGOFMSModel.from_regressions(LAWS["fmc1"], **p)
        step = partial(regression_step, p)
        stationary = partial(regression_moments, p)
    else:
        model = CGOFMSModel(LAWS["fmc1"], means, gamma, m, interpolation=form)
        covariance, transition = (
            partial(covariance_step, means, gamma, m),
            partial(transition_step, means, A, Q),
        )
        step = covariance if form == "covariance" else transition
    r = np.array([0.3, 0.0, 1.0, 0.77, 0.77, 0.1, 1.0])
    y = observations(model, len(r))
    # a chain that visits the nodes r_1, r_2, ... in turn
    M = len(r)
    chain = np.eye(M)[0], np.roll(np.eye(M), 1, axis=1)
    truth = enumerate_sequences(*chain, stationary(r), tables(step, r), y, m)
    f = KnownSwitchFilter(model)
    result = f.filter(y, r)
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        np.testing.assert_allclose(getattr(result, name), truth[name], **TOLERANCE, err_msg=name)
    f.reset()
    for n in range(M):  # the switch told at the update: no moments before it
        f.predict()
        f.update(y[n], r[n])
        np.testing.assert_allclose(f.x[:, 0], truth["x"][n], **TOLERANCE)
        np.testing.assert_allclose(f.S, truth["S"][n], **TOLERANCE)
        np.testing.assert_allclose(f.y[:, 0], y[n] - truth["y_prior"][n], **TOLERANCE)
        assert np.isnan(f.x_prior).all()
        assert np.isnan(f.P_prior).all()


@pytest.mark.parametrize("rule", ["gauss", "cell", "product"])
def test_other_rules_are_exact_for_their_chain(rule, fuzzy_model, enumerate_sequences):
    # product: transition weights of either sign, for which the sums hold all the same
    F = 2
    chain = fuzzy_model.law.discretize(F, rule)
    form = fuzzy_model.form
    y, nodes = observations(fuzzy_model, 6), chain.nodes
    step = tables(partial(covariance_step, form.means, form.covariances, 1), nodes)
    Sigma = form.covariances[[0, 1], [0, 1], :2, :2]
    first = moments(form.means, Sigma, nodes)
    truth = enumerate_sequences(chain.initial, chain.transition, first, step, y, 1)
    check(OFSRFilter(fuzzy_model, F, rule), y, truth)


@pytest.mark.parametrize("m", [1, 2])
def test_negative_masses(m, make_transitions, enumerate_sequences):
    # a chain with small negative weights, which lead to nodes of negative mass and back
    A, Q, means, Sigma = make_transitions(2, m, 1, seed=15)
    means[:, m] = 0.0
    chain = SwitchChain([0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [[1.001, -0.001], [0.7, 0.3]])

    class System:
        dim_x, dim_z, order, steady_from = m, 1, 1, 0

        def __init__(self):
            self.chain = chain
            self.form = TransitionForm(A, Q, means, Sigma, m)
            u = np.eye(2)
            self.tables = PairTables(chain.transition, self.form.pairs(u[:, None], u[None, :], str))

        def initial(self):
            return InitialLaw(chain.initial, means, Sigma)

        def pair_tables(self, n):
            return self.tables

    y = np.array([[0.1], [0.3], [-0.2], [0.4], [0.0], [-0.1]])
    N = means[None] - np.einsum("ijkl,il->ijk", A, means)
    truth = enumerate_sequences(chain.initial, chain.transition, (means, Sigma), (A, N, Q), y, m)
    assert (truth["mu"][1:] < 0).any()
    check(SwitchingFilter(System()), y, truth)

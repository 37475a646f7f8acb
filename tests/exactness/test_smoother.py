"""The smoother equals the enumeration of all paths of the nodes: moments, probabilities, best path."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
)

TOLERANCE = {"rtol": 1e-8, "atol": 1e-10}
LAW = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)


def regressions(K, m, q, seed):
    rng = np.random.default_rng(seed)

    def covariances(*shape):
        root = 0.4 * rng.normal(size=shape) + 0.7 * np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return {
        "Ayy": rng.normal(size=(K, K, q, q)) * 0.5,
        "Ny": rng.normal(size=(K, K, q)),
        "Qyy": covariances(K, K, q, q),
        "Axx": rng.normal(size=(K, K, m, m)) * 0.6,
        "H": rng.normal(size=(K, K, m, q)),
        "G": rng.normal(size=(K, K, m, q)),
        "c": rng.normal(size=(K, K, m)),
        "C": covariances(K, K, m, m),
        "means": rng.normal(size=(K, m + q)),
        "covariances": covariances(K, m + q, m + q),
    }


def fuzzy(form, m, q, make_transitions):
    """A fuzzy filter of one node between the hard values, in a form by name."""
    if form == "regression":
        return OFSRFilter(CGOFMSModel.from_regressions(LAW, **regressions(2, m, q, 4)), 1)
    A, _, means, Sigma = make_transitions(2, m, q, seed=1)
    cross = 0.3 * A @ Sigma[:, None]
    gamma = np.block(
        [
            [np.broadcast_to(Sigma[:, None], cross.shape), np.swapaxes(cross, -1, -2)],
            [cross, np.broadcast_to(Sigma[None], cross.shape)],
        ]
    )
    return OFSRFilter(CGOFMSModel(LAW, means, gamma, m, interpolation=form), 1)


def check(f, ys, truth):
    result = f.smooth(ys, keep_nodes=True)
    np.testing.assert_allclose(result.x, truth.mean, **TOLERANCE)
    np.testing.assert_allclose(result.P, truth.covariance, **TOLERANCE)
    np.testing.assert_allclose(result.mu, truth.probability, **TOLERANCE)
    np.testing.assert_allclose(result.log_likelihood.sum(), truth.log_likelihood, rtol=1e-10)
    np.testing.assert_array_equal(result.switch_path, f.nodes[truth.best_path])
    np.testing.assert_allclose(result.switch_mean, truth.probability @ f.nodes, **TOLERANCE)
    # nothing is left that belongs to the filter alone
    assert result.x_prior is None
    assert result.P_prior is None
    # and the filter stays at the last observation, as after filter()
    again = type(f)(f.model, **f._options()) if hasattr(f, "_options") else type(f)(f.model)
    again.filter(ys)
    np.testing.assert_array_equal(f.x, again.x)
    return result


@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize("form", ["covariance", "transition", "regression"])
def test_fuzzy_switches(form, m, q, make_transitions, enumerate_paths):
    f = fuzzy(form, m, q, make_transitions)
    ys = f.model.simulate(6, np.random.default_rng(2)).y
    check(f, ys, enumerate_paths(f.model.on_nodes(1), ys))


@pytest.mark.parametrize("turn_back", [0.0, 0.2])
@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 1), (1, 2)])
def test_fades(turn_back, m, q, enumerate_paths):
    law = FadeLaw.between(5, 4, jump=0.05, turn_back=turn_back)
    model = CGOFMSModel.from_regressions(law, **regressions(2, m, q, 4))
    ys = model.simulate(5, np.random.default_rng(2), 2).y
    check(OFSRFilter(model, 2), ys, enumerate_paths(model.placed(2), ys))


@pytest.mark.parametrize("n_nodes", [0, 3])
def test_scalar_model_of_the_paper(n_nodes, fuzzy_model, enumerate_paths):
    f = OFSRFilter(fuzzy_model, n_nodes)
    ys = fuzzy_model.simulate(5 if n_nodes else 11, np.random.default_rng(2)).y
    check(f, ys, enumerate_paths(fuzzy_model.on_nodes(n_nodes), ys))


@pytest.mark.parametrize(("K", "N"), [(1, 12), (2, 9), (3, 6)])
@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 2)])
def test_hard_switches(K, N, m, q, enumerate_paths):
    transition = np.random.default_rng(K).dirichlet(np.ones(K), K)
    model = CGOMSModel.from_regressions(transition, **regressions(K, m, q, 8), initial=np.ones(K) / K)
    ys = model.simulate(N, np.random.default_rng(3)).y
    check(CGOMSMFilter(model), ys, enumerate_paths(model.on_nodes(), ys))


def test_forbidden_transitions(hard_model, enumerate_paths):
    # a zero in the transition matrix, and a first regime that is certain
    P = [[0.7, 0.3, 0.0], [0.0, 0.6, 0.4], [0.5, 0.0, 0.5]]
    model = CGOMSModel._from_form(P, hard_model.form, [1.0, 0.0, 0.0])
    ys = model.simulate(7, np.random.default_rng(3)).y
    result = check(CGOMSMFilter(model), ys, enumerate_paths(model.on_nodes(), ys))
    np.testing.assert_array_equal(result.mu[0], [1.0, 0.0, 0.0])


def test_negative_weights(fuzzy_model, enumerate_paths):
    # product integration: weights of either sign, for which the sums hold all the same
    law = FuzzyMarkovLaw.fmc2(0.15, 0.16, 0.45)
    model = CGOFMSModel(law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    system = model.on_nodes(7, "product")
    ys = model.simulate(4, np.random.default_rng(4)).y
    assert system.chain.is_signed
    truth = enumerate_paths(system, ys)
    result = OFSRFilter(model, 7, "product").smooth(ys)
    np.testing.assert_allclose(result.x, truth.mean, **TOLERANCE)
    np.testing.assert_allclose(result.P, truth.covariance, **TOLERANCE)
    np.testing.assert_allclose(result.mu, truth.probability, **TOLERANCE)


@pytest.mark.parametrize(("order", "K"), [(1, 2), (2, 2), (3, 2), (3, 1), (2, 3)])
@pytest.mark.parametrize("mode", ["stationary", "time_varying"])
@pytest.mark.filterwarnings("ignore::fuzzykf.errors.ClosenessWarning")
def test_converted_models(order, K, mode, enumerate_paths):
    rng = np.random.default_rng(order)
    first = {"initial_covariance": [np.diag([2.0, 0.3])] * K} if mode == "time_varying" else {}
    model = CGOMSModel.from_cglssm(
        0.6 * np.eye(K) + 0.4 / K,
        0.35 * rng.normal(size=(K, 2, 2)),
        rng.normal(size=(K, 1, 2)),
        rng.normal(size=(K, 2, 2)),
        rng.uniform(0.5, 1.0, size=(K, 1, 1)),
        order=order,
        mode=mode,
        **first,
    )
    ys = model.simulate(6, rng).y
    check(CGOMSMFilter(model), ys, enumerate_paths(model.on_nodes(), ys))


@pytest.mark.parametrize("N", [1, 600])
def test_one_class_of_any_length(N, make_transitions):
    # longer than the blocks in which weights are held: compare with the filter, which is exact here,
    # since with one class no later observation tells anything about X_n
    A, Q, means, Sigma = make_transitions(1, 2, 1, seed=11)
    model = CGOMSModel.from_transitions([[1.0]], A, Q, means, Sigma, 2)
    ys = model.simulate(N, np.random.default_rng(5)).y
    f = CGOMSMFilter(model)
    smoothed, filtered = f.smooth(ys), f.filter(ys)
    np.testing.assert_allclose(smoothed.x, filtered.x, rtol=1e-12)
    np.testing.assert_allclose(smoothed.P, filtered.P, rtol=1e-12)


def test_blocks_do_not_show(fuzzy_model):
    # 1,300 steps go through three blocks; a plain backward recursion over the whole series agrees
    ys = fuzzy_model.simulate(1300, np.random.default_rng(6)).y
    system = fuzzy_model.on_nodes(3)
    f = OFSRFilter(fuzzy_model, 3)
    result, filtered = f.smooth(ys), f.filter(ys, keep_nodes=True)
    pairs, P = system.tables.pairs, system.chain.transition
    gamma, best = filtered.mu.copy(), np.log(filtered.mu[0])
    back = []
    weights = []
    for n in range(len(ys) - 1):
        e = ys[n + 1, 0] - pairs.Ayy[..., 0, 0] * ys[n, 0] - pairs.Ny[..., 0]
        S = pairs.Qyy[..., 0, 0]
        weights.append(P * np.exp(-0.5 * e * e / S) / np.sqrt(S))
        scores = best[:, None] + np.log(weights[-1])
        back.append(scores.argmax(axis=0))
        best = scores.max(axis=0) - scores.max()
    for n in range(len(ys) - 2, -1, -1):
        joint = filtered.mu[n][:, None] * weights[n]
        gamma[n] = (joint / joint.sum(axis=0)) @ gamma[n + 1]
    path = [int(best.argmax())]
    for pointers in reversed(back):
        path.append(int(pointers[path[-1]]))
    np.testing.assert_allclose(result.mu, gamma, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(result.x[:, 0], (gamma * filtered.node_x[..., 0]).sum(axis=1), rtol=1e-9)
    np.testing.assert_array_equal(result.switch_path, system.chain.nodes[path[::-1]])


def joint_of_path(model, r, ys):
    """Posterior of X along a known path: one joint Gaussian, conditioned on all observations."""
    shares = model.class_weights(r)
    N, m, q = len(r), model.dim_x, model.dim_z
    d = m + q
    first_mean, first = model.form.marginal(shares[:1])
    L, D, b = np.eye(N * d), np.zeros((N * d, N * d)), np.zeros(N * d)
    b[:d], D[:d, :d] = first_mean[0], first[0]
    for n in range(1, N):
        s = model.form.pairs(shares[n - 1], shares[n], lambda _: "")
        A = np.block([[s.Axx, s.H + s.G @ s.Ayy], [np.zeros((q, m)), s.Ayy]])
        Q = np.block([[s.C + s.G @ s.Qyy @ s.G.T, s.G @ s.Qyy], [s.Qyy @ s.G.T, s.Qyy]])
        here, there = slice(n * d, (n + 1) * d), slice((n - 1) * d, n * d)
        L[here, there], D[here, here] = -A, Q
        b[here] = np.concatenate([s.c + s.G @ s.Ny, s.Ny])
    inverse = np.linalg.inv(L)
    mean, S = inverse @ b, inverse @ D @ inverse.T
    at = np.arange(N * d).reshape(N, d)[:, m:][~np.isnan(ys)]
    gain = np.linalg.solve(S[np.ix_(at, at)], S[at]).T
    mean = mean + gain @ (ys[~np.isnan(ys)] - mean[at])
    S = S - gain @ S[at]
    blocks = [slice(n * d, n * d + m) for n in range(N)]
    return np.array([mean[k] for k in blocks]), np.array([S[k, k] for k in blocks])


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 2)])
def test_known_switch_is_one_joint_gaussian(m, q, gaps):
    # exact with gaps as well: along a known path there is but one class
    model = CGOFMSModel.from_regressions(LAW, **regressions(2, m, q, 9))
    r = np.array([0.3, 0.0, 1.0, 0.77, 0.77, 0.1, 1.0, 0.0, 0.5])
    ys = model.simulate(9, np.random.default_rng(7)).y
    if gaps:
        ys[[0, 3, 4, 8]] = np.nan
        ys[6, 0] = np.nan
    x, P = joint_of_path(model, r, ys)
    result = KnownSwitchFilter(model).smooth(ys, r, keep_nodes=True)
    np.testing.assert_allclose(result.x, x, **TOLERANCE)
    np.testing.assert_allclose(result.P, P, **TOLERANCE)
    np.testing.assert_array_equal(result.switch_path, r)
    np.testing.assert_allclose(result.node_x[:, 0], x, **TOLERANCE)


@pytest.mark.parametrize("where", [0, 3, 8])
@pytest.mark.parametrize("size", [200.0, 1e6])
def test_an_outlier_leaves_everything_finite(where, size, fuzzy_model):
    ys = fuzzy_model.simulate(9, np.random.default_rng(8)).y
    ys[where] += size
    result = OFSRFilter(fuzzy_model, 3).smooth(ys, keep_nodes=True)
    for name in ("x", "P", "mu", "switch_mean", "switch_path", "node_x", "node_P"):
        assert np.isfinite(getattr(result, name)).all(), name
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-9)

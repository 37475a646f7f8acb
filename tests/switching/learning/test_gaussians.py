"""The maximisation of the Gaussian parts: gradient-free checks that nothing near is better.

Likelihoods are written down here from the definitions of the forms, cell by cell.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.em import pair_shares
from fuzzykf.switching.learning.gaussians import RegressionEstimate, positions, transition_vectors
from fuzzykf.switching.learning.regression import (
    PRIOR_COUNT,
    Cells,
    Evidence,
    fit_regression,
    join,
    prior_cells,
)
from fuzzykf.switching.learning.vine import VineEstimate, vine_moments


def random_cells(c, B, f, seed, n=6):
    """Cells of n vectors each, with shares that are neither hard nor all alike."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(c, n, f)) @ (np.eye(f) + 0.3 * rng.normal(size=(f, f)))
    v[..., 0] = 1.0
    shares = rng.dirichlet(np.full(B, 0.5), c)
    return Cells(shares, rng.uniform(0.5, 3.0, c), np.einsum("cnf,cng->cfg", v, v) / n)


def evidence(cells):
    """Cells of data in which the state is known everywhere."""
    return Evidence(cells, cells)


# --------------------------------------------------------------------------- regressions


def regression_likelihood(cells, targets, regressors, fit):
    """Sum of the log-densities of targets given regressors, from second moments, all cells at once."""
    shares, weights, S = cells
    beta, T, g = np.tensordot(shares, fit.beta, 1), np.tensordot(shares, fit.T, 1), shares @ fit.g
    root = np.linalg.inv(T)
    V = (root * np.exp(g)[:, None]) @ np.swapaxes(root, 1, 2)
    tt, tp, pp = (S[:, a][:, :, b] for a, b in ((targets, targets), (targets, regressors), (regressors,) * 2))
    cross = beta @ np.swapaxes(tp, 1, 2)
    R = tt - cross - np.swapaxes(cross, 1, 2) + beta @ pp @ np.swapaxes(beta, 1, 2)
    spread = np.trace(np.linalg.solve(V, R), axis1=1, axis2=2) + np.log(np.linalg.det(2 * np.pi * V))
    return -0.5 * weights @ spread


@pytest.mark.parametrize(("t", "p", "B"), [(1, 1, 1), (2, 1, 2), (1, 3, 4), (2, 3, 4), (3, 2, 2)])
def test_regressions_cannot_be_improved_upon(t, p, B):
    cells = random_cells(60, B, 1 + t + p, seed=t)
    cells = join(cells, prior_cells(cells))
    targets, regressors = list(range(1, 1 + t)), [0, *range(1 + t, t + p)]
    fit = fit_regression(cells, targets, regressors, n_rounds=400, tolerance=1e-15)
    best = regression_likelihood(cells, targets, regressors, fit)
    rng = np.random.default_rng(9)
    for _ in range(60):
        size = 10.0 ** rng.uniform(-4, -1)
        moved = fit._replace(
            beta=fit.beta + size * rng.normal(size=fit.beta.shape),
            T=fit.T + size * np.tril(rng.normal(size=fit.T.shape), -1),
            g=fit.g + size * rng.normal(size=fit.g.shape),
        )
        assert regression_likelihood(cells, targets, regressors, moved) < best + 1e-6


def test_rounds_never_lower_the_likelihood():
    cells = random_cells(50, 4, 6, seed=3)
    cells = join(cells, prior_cells(cells))
    targets, regressors = [1, 2], [0, 3, 4, 5]
    values = [
        regression_likelihood(
            cells, targets, regressors, fit_regression(cells, targets, regressors, n_rounds=n, tolerance=0.0)
        )
        for n in range(1, 12)
    ]
    assert (np.diff(values) > -1e-9).all()
    assert values[-1] > values[0]


def test_one_regime_is_least_squares():
    rng = np.random.default_rng(4)
    v = np.concatenate([np.ones((200, 1)), rng.normal(size=(200, 3))], axis=1)
    v[:, 3] += 2.0 * v[:, 1] - 0.5
    cells = Cells(np.ones((200, 1)), np.ones(200), v[:, :, None] * v[:, None, :])
    fit = fit_regression(cells, [3], [0, 1, 2])
    beta, residual, *_ = np.linalg.lstsq(v[:, :3], v[:, 3], rcond=None)
    np.testing.assert_allclose(fit.beta[0, 0], beta, rtol=1e-9)
    assert fit.covariance[0, 0, 0] == pytest.approx(residual[0] / 200, rel=1e-9)


def test_hard_regimes_are_separate_regressions():
    cells = random_cells(80, 3, 5, seed=5)
    hard = cells._replace(shares=np.eye(3)[np.arange(80) % 3])
    fit = fit_regression(hard, [1, 2], [0, 3, 4])
    for k in range(3):
        own = Cells(np.ones((len(hard.weight[k::3]), 1)), hard.weight[k::3], hard.moment[k::3])
        alone = fit_regression(own, [1, 2], [0, 3, 4])
        np.testing.assert_allclose(fit.beta[k], alone.beta[0], rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(fit.covariance[k], alone.covariance[0], rtol=1e-6, atol=1e-9)


def test_the_prior_is_a_fraction_of_an_average_observation():
    cells = random_cells(30, 4, 5, seed=6)
    prior = prior_cells(cells)
    average = np.einsum("c,cfg->fg", cells.weight, cells.moment) / cells.weight.sum()
    np.testing.assert_array_equal(prior.shares, np.eye(4))
    np.testing.assert_array_equal(prior.weight, np.full(4, PRIOR_COUNT))
    for moment in prior.moment:
        np.testing.assert_allclose(moment, average, rtol=1e-12)


def test_a_regime_that_occurs_once_stays_finite():
    # its regression fits without error; the prior bounds the variance from below
    cells = random_cells(40, 2, 4, seed=7, n=30)
    shares = np.eye(2)[np.zeros(40, dtype=int)]
    shares[13] = [0.0, 1.0]
    v = np.array([1.0, 0.3, -0.2, 0.7])
    cells.moment[13] = np.outer(v, v)
    cells.weight[13] = 1.0
    cells = join(cells._replace(shares=shares), prior_cells(cells))
    fit = fit_regression(cells, [1], [0, 2, 3])
    pooled = fit.covariance[0, 0, 0]
    assert 1e-2 * PRIOR_COUNT * pooled < fit.covariance[1, 0, 0] < 10 * PRIOR_COUNT * pooled


def test_a_regime_that_never_occurs_follows_the_average():
    cells = random_cells(40, 2, 4, seed=8, n=30)
    cells = cells._replace(shares=np.tile([1.0, 0.0], (40, 1)))
    fit = fit_regression(join(cells, prior_cells(cells)), [1], [0, 2, 3])
    np.testing.assert_allclose(fit.beta[1], fit.beta[0], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(fit.covariance[1], fit.covariance[0], rtol=1e-3)


# --------------------------------------------------------------------------- the covariance form


def random_theta(K, seed):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(size=4 * K) * 0.3, rng.normal(size=K + 3 * K * K) * 0.5])


def vine(K, seed, cells=None):
    prior = prior_cells(cells if cells is not None else random_cells(5, K * K, 5, 0))
    return VineEstimate(random_theta(K, seed), K, evidence(prior), np.eye(K * K))


@pytest.mark.parametrize("K", [1, 2, 3])
def test_every_vine_is_a_valid_model(K):
    for seed in range(5):
        mean, gamma = vine_moments(3.0 * random_theta(K, seed), K)
        assert mean.shape == (K, 2)
        np.testing.assert_allclose(gamma, np.swapaxes(gamma, -1, -2), rtol=1e-14)
        sd = np.sqrt(np.diagonal(gamma, axis1=-2, axis2=-1))
        assert (np.linalg.eigvalsh(gamma / (sd[..., :, None] * sd[..., None, :])) > 0.0).all()
        for i, j in itertools.product(range(K), repeat=2):
            np.testing.assert_allclose(gamma[i, j, :2, :2], gamma[i, i, :2, :2])
            np.testing.assert_allclose(gamma[i, j, 2:, 2:], gamma[j, j, :2, :2])
            # Y2 and X1 are independent given Y1
            assert gamma[i, j, 3, 0] == pytest.approx(
                gamma[i, j, 3, 1] * gamma[i, j, 1, 0] / gamma[i, j, 1, 1]
            )


def conditional_density(theta, K, u1, u2, z1, z2):
    """Log p(z2 | z1, pair) from the interpolated joint Gaussian, after setting Cov(Y2, X1)."""
    mean, gamma = vine_moments(theta, K)
    m1, m2 = u1 @ mean, u2 @ mean
    S = np.einsum("i,j,ijab->ab", u1, u2, gamma)
    S[0, 3] = S[3, 0] = S[1, 3] * S[0, 1] / S[1, 1]
    A = S[2:, :2] @ np.linalg.inv(S[:2, :2])
    return multivariate_normal(m2 + A @ (z1 - m1), S[2:, 2:] - A @ S[:2, 2:]).logpdf(z2)


@pytest.mark.parametrize("K", [1, 2, 3])
def test_rows_and_loss_are_the_density(K):
    rng = np.random.default_rng(10)
    estimate = vine(K, 11)
    n = 20
    u1, u2 = rng.dirichlet(np.ones(K), n), rng.dirichlet(np.ones(K), n)
    z1, z2 = rng.normal(size=(n, 2)), rng.normal(size=(n, 2))
    v = np.stack([np.ones(n), z1[:, 1], z2[:, 1], z1[:, 0], z2[:, 0]], axis=1)
    shares = (u1[:, :, None] * u2[:, None, :]).reshape(n, -1)
    truth = np.array(
        [conditional_density(estimate.theta, K, *args) for args in zip(u1, u2, z1, z2, strict=True)]
    )
    W, constant = estimate.rows(shares)
    white = np.einsum("nij,nj->ni", W, v)
    np.testing.assert_allclose(constant - 0.5 * (white**2).sum(axis=1), truth, rtol=1e-9, atol=1e-9)
    cells = Cells(shares, np.ones(n), v[:, :, None] * v[:, None])
    assert estimate.loss(estimate.theta, cells)[0] == pytest.approx(-truth.mean(), rel=1e-10)
    assert estimate.log_likelihood(evidence(cells)) == pytest.approx(truth.sum(), rel=1e-10)


@pytest.mark.parametrize("K", [1, 2, 3])
def test_gradient_of_the_loss(K):
    cells = random_cells(30, K * K, 5, seed=12)
    estimate = vine(K, 13)
    _, gradient = estimate.loss(estimate.theta, cells)
    h = 1e-6 * np.eye(estimate.theta.size)
    numeric = [
        (estimate.loss(estimate.theta + d, cells)[0] - estimate.loss(estimate.theta - d, cells)[0]) / 2e-6
        for d in h
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("K", [1, 2])
def test_vines_cannot_be_improved_upon(K):
    # gradient-free: no small change of the free numbers raises the likelihood, prior included
    cells = random_cells(60, K * K, 5, seed=14, n=10)
    estimate, seen = vine(K, 15, cells), evidence(cells)
    for _ in range(5):
        estimate = estimate.maximise(seen, {"maxiter": 300})
    best = estimate.log_likelihood(seen) + estimate.log_prior
    rng = np.random.default_rng(16)
    for _ in range(200):
        moved = estimate._with(
            estimate.theta + 10.0 ** rng.uniform(-4, -1) * rng.normal(size=estimate.theta.size)
        )
        assert moved.log_likelihood(seen) + moved.log_prior < best + 1e-4 * cells.weight.sum() / 100


def test_one_class_recovers_its_moments():
    # a single regime: the maximum is found from the moments themselves
    rng = np.random.default_rng(17)
    truth = random_theta(1, 18)
    mean, gamma = vine_moments(truth, 1)
    z = rng.multivariate_normal(np.tile(mean[0], 2), gamma[0, 0], size=200_000)
    v = np.concatenate([np.ones((len(z), 1)), z[:, [1, 3, 0, 2]]], axis=1)
    cells = Cells(np.ones((1, 1)), np.array([float(len(z))]), (v.T @ v / len(z))[None])
    w = np.concatenate([np.ones((len(z), 1)), z[:, :2]], axis=1)
    single = Cells(np.ones((1, 1)), np.array([float(len(z))]), (w.T @ w / len(z))[None])
    estimate = VineEstimate.start(evidence(cells), evidence(single), 1, 1, np.ones((1, 1)))
    found_mean, found = vine_moments(estimate.theta, 1)
    np.testing.assert_allclose(found_mean, mean, atol=0.02)
    np.testing.assert_allclose(found, gamma, atol=0.02)


def test_an_estimate_stays_valid_between_the_regimes():
    # bilinear interpolation between valid pairs may leave the valid region; an estimate must not
    r = np.linspace(0.0, 1.0, 9)
    proof = pair_shares(np.stack([1.0 - r, r], axis=1))
    cells = random_cells(40, 4, 5, seed=19)
    rng = np.random.default_rng(20)
    theta = np.concatenate([0.5 * rng.normal(size=8), 1.2 * rng.normal(size=14)])
    theta[18:] = 1.0 + np.abs(theta[18:])  # little noise
    outside = VineEstimate(theta, 2, evidence(prior_cells(cells)), proof)
    assert (outside.noise_share(np.eye(4)) > 0.0).all()
    assert not outside.is_valid
    mended = outside._towards(np.zeros_like(theta))
    assert mended.is_valid
    assert not np.array_equal(mended.theta, np.zeros_like(theta))
    assert mended.maximise(evidence(cells)).is_valid
    value, gradient = outside.loss(
        theta, Cells(proof, np.ones(len(proof)), np.repeat(cells.moment[:1], len(proof), 0))
    )
    assert value == 1e10
    assert not gradient.any()


# --------------------------------------------------------------------------- both, in the user's units


@pytest.mark.parametrize(
    ("m", "q", "kind"), [(1, 1, VineEstimate), (1, 1, RegressionEstimate), (2, 2, RegressionEstimate)]
)
def test_forms_are_in_the_units_of_the_data(m, q, kind):
    # the density of a transition in the user's units is that in standard units by the Jacobian
    rng = np.random.default_rng(21)
    N, d = 300, m + q
    units, shift = 10.0 ** rng.uniform(-3, 3, d), rng.normal(size=d) * 50.0
    raw = np.cumsum(rng.normal(size=(N, d)) * 0.4, axis=0) * 0.2 + rng.normal(size=(N, d))
    raw = raw * units + shift
    data = gather(raw[:, :m], raw[:, m:])
    v = transition_vectors(data)
    at = positions(m, q)
    np.testing.assert_allclose(v[:, at["y'"]], data.z[1:, m:])
    np.testing.assert_allclose(v[:, at["x"]], data.z[:-1, :m])
    r = rng.random(N)
    shares = np.stack([1.0 - r, r], axis=1)
    w = np.concatenate([np.ones((N, 1)), data.z], axis=1)
    single = Cells(shares, np.ones(N), w[:, :, None] * w[:, None])
    both = (shares[:-1, :, None] * shares[1:, None, :]).reshape(N - 1, 4)
    cells = Cells(both, np.ones(N - 1), v[:, :, None] * v[:, None])
    estimate = kind.start(evidence(cells), evidence(single), m, q, np.eye(4))
    W, constant = estimate.rows(both)
    white = np.einsum("nij,nj->ni", W, v)
    standard = constant - 0.5 * (white**2).sum(axis=1) - np.log(data.scale.std).sum()
    form = estimate.form(evidence(single), data.scale)
    s = form.pairs(shares[:-1], shares[1:], lambda _: "")
    for n in range(0, N - 1, 25):
        x, y, x1, y1 = raw[n, :m], raw[n, m:], raw[n + 1, :m], raw[n + 1, m:]
        a = multivariate_normal(s.Ayy[n] @ y + s.Ny[n], s.Qyy[n], allow_singular=True).logpdf(y1)
        b = multivariate_normal(s.Axx[n] @ x + s.H[n] @ y + s.G[n] @ y1 + s.c[n], s.C[n], allow_singular=True)
        assert a + b.logpdf(x1) == pytest.approx(standard[n], rel=1e-7, abs=1e-6)
    # the law of the first (X, Y) has the moments of the data at either regime's share
    mean, covariance = form.marginal(shares)
    assert mean.shape == (N, d)
    np.testing.assert_allclose(mean.mean(axis=0), raw.mean(axis=0), rtol=0, atol=0.2 * raw.std(axis=0).max())
    assert (np.diagonal(covariance, axis1=1, axis2=2) > 0.0).all()


@pytest.mark.parametrize(("m", "q", "K", "expected"), [(1, 1, 2, 4 * 8 + 2 * 5), (3, 2, 2, 4 * 39 + 2 * 20)])
def test_parameters_of_regressions_are_counted(m, q, K, expected):
    # per pair: Ayy, Ny, Qyy and Axx, H, G, c, C; per class: mean and covariance of Z
    estimate = object.__new__(RegressionEstimate)
    estimate.dim_x, estimate.dim_z, estimate.n_classes, estimate.window = m, q, K, (0, 0)
    assert estimate.n_parameters == expected

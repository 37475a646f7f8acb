"""Series along known paths, against the joint Gaussian of the whole series, conditioned at once."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.known_paths import filter_known_pairs, known_steps
from fuzzykf.gaussian import covariance_root

S, N, M, Q = 4, 5, 2, 2
D = M + Q


@pytest.fixture
def pairs():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, S, N - 1, 2, 2))
    C, Qyy = noise @ np.swapaxes(noise, -1, -2) + 0.1 * np.eye(2)
    Axx, H, G, Ayy = 0.5 * rng.normal(size=(4, S, N - 1, 2, 2))
    c, Ny = rng.normal(size=(2, S, N - 1, 2))
    return Axx, H, G, c, C, Ayy, Ny, Qyy


def joint(pairs, k):
    """Mean (n, d) and covariance (n, d, n, d) of Z_1..n of series ``k``, from what the regressions are."""
    Axx, H, G, c, C, Ayy, Ny, Qyy = (one[k] for one in pairs)
    mean, covariance = np.zeros((N, D)), np.zeros((N, D, N, D))
    covariance[0, :, 0] = np.eye(D) + 0.2
    for n in range(1, N):
        t = n - 1
        # Y' = Ayy Y + Ny + e and X' = Axx X + H Y + G Y' + c + f
        A = np.block([[Axx[t], H[t] + G[t] @ Ayy[t]], [np.zeros((Q, M)), Ayy[t]]])
        L = np.block([[np.eye(M), G[t]], [np.zeros((Q, M)), np.eye(Q)]])
        noise = L @ np.block([[C[t], np.zeros((M, Q))], [np.zeros((Q, M)), Qyy[t]]]) @ L.T
        mean[n] = A @ mean[n - 1] + L @ np.concatenate([c[t], Ny[t]])
        covariance[n, :, :n] = np.einsum("ab,bnc->anc", A, covariance[n - 1, :, :n])
        covariance[:n, :, n] = np.moveaxis(covariance[n, :, :n], 0, 2)
        covariance[n, :, n] = A @ covariance[n - 1, :, n - 1] @ A.T + noise
    return mean, covariance


def given(mean, covariance, ys, upto, n):
    """Mean and covariance of X_n given what is there of y_1..upto, and the log-density of that."""
    seen = ys.copy()
    seen[upto:] = np.nan
    at = np.arange(N * D).reshape(N, D)[:, M:][~np.isnan(seen)]
    own = n * D + np.arange(M)
    flat, full = mean.reshape(-1), covariance.reshape(N * D, N * D)
    S_, e = full[np.ix_(at, at)], seen[~np.isnan(seen)] - flat[at]
    gain = np.linalg.solve(S_, full[np.ix_(at, own)]).T
    log_density = -0.5 * (e @ np.linalg.solve(S_, e) + np.linalg.slogdet(2 * np.pi * S_)[1])
    return flat[own] + gain @ e, full[np.ix_(own, own)] - gain @ full[np.ix_(at, own)], log_density


def test_every_series_is_conditioned_on_what_is_there_of_it(pairs):
    ys = np.random.default_rng(1).normal(size=(S, N, Q))
    ys[1, 2], ys[1, 0, 0], ys[2, :3, 1], ys[2, 4, 0], ys[3, :2] = (np.nan,) * 5
    shapes = {"x": (M,), "P": (M, M), "x_prior": (M,), "P_prior": (M, M), "log_likelihood": ()}
    out = {name: np.empty((S, N, *shape)) for name, shape in shapes.items()}
    root = np.repeat(covariance_root(np.eye(D) + 0.2)[None], S, axis=0)
    mean, _ = filter_known_pairs(known_steps(pairs), True, np.zeros((S, D)), root, ys, out)
    for k in range(S):
        law, before = joint(pairs, k), 0.0
        for n in range(N):
            x, P, total = given(*law, ys[k], n + 1, n)
            np.testing.assert_allclose(out["x"][k, n], x, rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(out["P"][k, n], P, rtol=1e-11, atol=1e-12)
            assert out["log_likelihood"][k, n] == pytest.approx(total - before, rel=1e-10, abs=1e-12)
            before = total
            x, P, _ = given(*law, ys[k], n, n)
            np.testing.assert_allclose(out["x_prior"][k, n], x, rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(out["P_prior"][k, n], P, rtol=1e-11, atol=1e-12)
        there = ~np.isnan(ys[k, -1])
        np.testing.assert_array_equal(mean[k, M:][there], ys[k, -1][there])
    assert set(out) == set(shapes)


def test_an_observation_without_any_spread_has_no_density(pairs):
    ys, root = np.zeros((S, 1, Q)), np.zeros((S, D, D))
    with pytest.raises(np.linalg.LinAlgError, match="without any spread"):
        filter_known_pairs(None, True, np.zeros((S, D)), root, ys, {})
    filter_known_pairs(None, True, np.zeros((S, D)), root, np.full_like(ys, np.nan), {})

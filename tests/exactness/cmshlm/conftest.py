"""The oracle of converted models: definitions, sums over all sequences of regimes, plain inverses.

The joint Gaussian of all states and observations is written down for each sequence of
regimes.  Moments of the state-space model given a regime are sums over sequences, tables are
the formulas as they stand, and posteriors come from conditioning one big vector: no recursion
over time, and no function of the package.
"""

from __future__ import annotations

import itertools
from unittest import mock

import numpy as np
import pytest

from fuzzykf import CGOMSModel


@pytest.fixture(scope="session")
def make_oracle():
    """The oracle: (T, A, B, C, D, p0, G0, construction, noise, order) -> object."""
    return Oracle


@pytest.fixture(scope="session")
def convert():
    """The same conversion by the package: oracle -> CGOMSModel."""
    return _convert


@pytest.fixture(scope="session")
def random_parameters():
    """Random models: (K, m, q, seed, scale=, zeros=) -> T, A, B, C, D, p0, G0."""
    return _random_parameters


class Oracle:
    """A switching state-space model ("Model 1") and what it is converted to ("Model 2")."""

    def __init__(self, T, A, B, C, D, p0, G0, construction="gain", noise="pair", order=1):
        self.T, self.A, self.B, self.C, self.D = (np.array(a, dtype=float) for a in (T, A, B, C, D))
        self.p0, self.G0 = np.array(p0, dtype=float), np.array(G0, dtype=float)
        self.construction, self.noise, self.order = construction, noise, order
        self.K, self.m, self.q = len(self.T), self.A.shape[1], self.B.shape[1]
        self._tables = {}

    def paths(self, n):
        """All sequences of n regimes of positive probability, and their probabilities."""
        every = np.array(list(itertools.product(range(self.K), repeat=n)))
        p = self.p0[every[:, 0]] * np.prod(self.T[every[:, :-1], every[:, 1:]], axis=1)
        return every[p > 0], p[p > 0]

    def joint_1(self, paths):
        """Covariance of (X_0, Y_0, X_1, Y_1, ...) in Model 1 along each of paths (..., n)."""
        paths = np.asarray(paths)
        *shape, n = paths.shape
        m, q, s, t = self.m, self.q, self.C.shape[2], self.D.shape[2]
        e, v = np.linalg.eigh(self.G0)
        root = v * np.sqrt(np.maximum(e, 0.0))[:, None, :]
        F = np.zeros((*shape, n * (m + q), m + n * (s + t)))  # rows: what X and Y are in white noise
        for k in range(n):
            j, at, noise = paths[..., k], k * (m + q), m + k * (s + t)
            if k == 0:
                F[..., :m, :m] = root[j]
            else:
                F[..., at : at + m, :] = self.A[j] @ F[..., at - m - q : at - q, :]
                F[..., at : at + m, noise : noise + s] += self.C[j]
            F[..., at + m : at + m + q, :] = self.B[j] @ F[..., at : at + m, :]
            F[..., at + m : at + m + q, noise + s : noise + s + t] += self.D[j]
        return F @ np.swapaxes(F, -1, -2)

    def window(self, n):
        """Components of (X_n, w_n) in the joint vector, newest observation first."""
        d, m = self.m + self.q, self.m
        x = np.arange(n * d, n * d + m)
        ys = [np.arange(k * d + m, (k + 1) * d) for k in range(n, max(-1, n - self.order), -1)]
        return np.concatenate([x, *ys])

    def window_covariance(self, n):
        """Cov((X_n, w_n) | r_n = i) in Model 1 for each i that can occur."""
        paths, p = self.paths(n + 1)
        pick = self.window(n)
        total = {}
        for i in set(paths[:, -1].tolist()):
            mine = paths[:, -1] == i
            covariances = self.joint_1(paths[mine])[:, pick[:, None], pick]
            total[i] = np.einsum("p,pkl->kl", p[mine] / p[mine].sum(), covariances)
        return total

    def tables(self, n):
        """(A2, Q2) of the step n -> n + 1 for each pair that can occur: (X, w) -> (X', Y')."""
        if n in self._tables:
            return self._tables[n]
        m, out = self.m, {}
        p = self.p0 @ np.linalg.matrix_power(self.T, n)
        for i, S in self.window_covariance(n).items():
            J = S[:m, m:] @ np.linalg.inv(S[m:, m:])
            P = S[:m, :m] - J @ S[m:, :m]
            for j in np.flatnonzero(self.T[i]):
                A, B, C, D = self.A[j], self.B[j], self.C[j], self.D[j]
                E = B @ A @ J
                prior = C @ C.T + A @ P @ A.T
                V = B @ prior @ B.T + D @ D.T
                gain = prior @ B.T @ np.linalg.inv(V)
                post = prior - gain @ B @ prior
                At = self.state_matrix(A, (np.eye(m) - gain @ B) @ A, P, post)
                A2 = np.block([[At, (A - At) @ J], [np.zeros((self.q, m)), E]])
                Q2 = np.block([[gain @ V @ gain.T + post - At @ P @ At.T, gain @ V], [V @ gain.T, V]])
                out[i, j] = A2, Q2
        if self.noise == "averaged":
            for j in {j for _, j in out}:
                before = [i for i, k in out if k == j]
                weights = np.array([p[i] * self.T[i, j] for i in before])
                mean = sum(w * out[i, j][1] for w, i in zip(weights / weights.sum(), before, strict=True))
                for i in before:
                    out[i, j] = out[i, j][0], mean
        self._tables[n] = out
        return out

    def state_matrix(self, A, gain, P, post):
        if self.construction == "markov_x":
            return A
        if self.construction == "gain":
            return gain
        (e, u), (f, v) = np.linalg.eigh(P), np.linalg.eigh(post)
        root, root_post = (u * np.sqrt(e)) @ u.T, (v * np.sqrt(f)) @ v.T
        a, s, b = np.linalg.svd(np.linalg.inv(root_post) @ A @ root)
        return root_post @ (a * np.minimum(s, 1.0)) @ b @ np.linalg.inv(root)

    def joint_2(self, paths):
        """Covariance of (X_0, Y_0, X_1, Y_1, ...) in Model 2 along each of paths (..., n)."""
        paths = np.asarray(paths)
        *shape, n = paths.shape
        d = self.m + self.q
        L = np.broadcast_to(np.eye(n * d), (*shape, n * d, n * d)).copy()
        noise = np.zeros_like(L)
        noise[..., :d, :d] = self.joint_1(paths[..., :1])
        for k in range(n - 1):
            window, here = self.window(k), np.arange((k + 1) * d, (k + 2) * d)
            A2 = np.full((self.K, self.K, d, len(window)), np.nan)
            Q2 = np.full((self.K, self.K, d, d), np.nan)
            for pair, tables in self.tables(k).items():
                A2[pair], Q2[pair] = tables
            pairs = paths[..., k], paths[..., k + 1]
            L[..., here[:, None], window] = -A2[pairs]
            noise[..., here[:, None], here] = Q2[pairs]
        inverse = np.linalg.inv(L)
        return inverse @ noise @ np.swapaxes(inverse, -1, -2)

    def posterior(self, ys, n, joint=None):
        """Posterior of X_n and the path given all of ``ys``: mean, covariance, paths, weights, log p(ys)."""
        d, m = self.m + self.q, self.m
        paths, p = self.paths(len(ys))
        seen = np.concatenate([np.arange(k * d + m, (k + 1) * d) for k in range(len(ys))])
        hidden, y = np.arange(n * d, n * d + m), ys.reshape(-1)
        S = (joint or self.joint_2)(paths)
        Syy, Syx = S[:, seen[:, None], seen], S[:, seen[:, None], hidden]
        gain = np.swapaxes(np.linalg.solve(Syy, Syx), 1, 2)
        means = gain @ y
        covariances = S[:, hidden[:, None], hidden] - gain @ Syx
        squares = np.linalg.solve(Syy, np.broadcast_to(y[:, None], (len(S), len(y), 1)))[..., 0] @ y
        logs = np.log(p) - 0.5 * (squares + np.linalg.slogdet(2 * np.pi * Syy)[1])
        total = logs.max() + np.log(np.exp(logs - logs.max()).sum())
        weights = np.exp(logs - total)
        mean = weights @ means
        deviation = means - mean
        covariance = np.einsum("p,pkl->kl", weights, covariances) + np.einsum(
            "p,pk,pl->kl", weights, deviation, deviation
        )
        return mean, covariance, paths, weights, total

    def filter(self, ys):
        """Mean, covariance, regime probabilities and log-likelihood after each observation."""
        out, before = [], 0.0
        for n in range(len(ys)):
            mean, covariance, paths, weights, total = self.posterior(ys[: n + 1], n)
            mu = np.bincount(paths[:, -1], weights, minlength=self.K)
            out.append((mean, covariance, mu, total - before))
            before = total
        return [np.array(values) for values in zip(*out, strict=True)]


def _convert(oracle, mode="time_varying"):
    """The same conversion by the package."""
    # how near the model is makes 256 steps of its own for a warning that is not wanted here
    with mock.patch("fuzzykf.switching.models.hard.warn_if_far"):
        return CGOMSModel.from_cglssm(
            oracle.T,
            oracle.A,
            oracle.B,
            oracle.C,
            oracle.D,
            initial_probability=oracle.p0,
            initial_covariance=oracle.G0 if mode == "time_varying" else None,
            construction=oracle.construction,
            noise=oracle.noise,
            order=oracle.order,
            mode=mode,
        )


def _random_parameters(K, m, q, seed, *, scale=0.8, zeros=False):
    """A random model; with ``zeros``, regimes that cannot follow one another, or not come first."""
    rng = np.random.default_rng(seed)
    T = rng.dirichlet(np.full(K, 2.0), K) + np.eye(K)
    p0 = rng.dirichlet(np.full(K, 2.0))
    if zeros and K > 1:
        T[rng.integers(K), :] *= rng.permutation([0.0] + [1.0] * (K - 1))
        T[T.sum(axis=1) == 0.0] = 1.0
        p0[rng.integers(K)] = 0.0
    A = rng.normal(size=(K, m, m))
    A *= scale * rng.uniform(0.5, 1.0, (K, 1, 1)) / np.linalg.norm(A, 2, axis=(1, 2), keepdims=True)
    B = rng.normal(size=(K, q, m))
    C = rng.normal(size=(K, m, m)) * 0.7
    D = rng.normal(size=(K, q, q)) * 0.3 + np.eye(q)
    root = rng.normal(size=(K, m, m))
    G0 = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(m)
    return T / T.sum(axis=1, keepdims=True), A, B, C, D, p0 / p0.sum(), G0

"""Oracles for the Kalman filters: conditioning in the joint law of everything."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal


class JointGaussian:
    """All states and observations of a linear Gaussian system as one normal vector.

    It knows nothing of recursions: every answer is a textbook conditioning.
    """

    def __init__(self, x0, P0, F, Q, H, R, n, controls=None):
        d, m = len(x0), len(H)
        mean, blocks = np.zeros(n * d), np.zeros((n * d, (n + 1) * d))
        state, path = np.asarray(x0, dtype=float), np.zeros((d, (n + 1) * d))
        path[:, :d] = np.eye(d)
        for k in range(n):
            state = F @ state + (0.0 if controls is None else controls[k])
            path = F @ path
            path[:, (k + 1) * d : (k + 2) * d] += np.eye(d)
            mean[k * d : (k + 1) * d], blocks[k * d : (k + 1) * d] = state, path
        sources = np.zeros(((n + 1) * d, (n + 1) * d))
        sources[:d, :d] = P0
        for k in range(1, n + 1):
            sources[k * d : (k + 1) * d, k * d : (k + 1) * d] = Q
        observe = np.kron(np.eye(n), H)
        self.d, self.m, self.n = d, m, n
        self.mean, self.P = mean, blocks @ sources @ blocks.T
        self.z_mean, self.cross = observe @ mean, self.P @ observe.T
        self.S = observe @ self.P @ observe.T + np.kron(np.eye(n), R)

    def state(self, k, zs, upto):
        """Mean and covariance of x_k given the observations 0 .. upto - 1; NaN is missing."""
        seen = np.flatnonzero(~np.isnan(zs[:upto].ravel()))
        part = slice(k * self.d, (k + 1) * self.d)
        if len(seen) == 0:
            return self.mean[part], self.P[part, part]
        gain = np.linalg.solve(self.S[np.ix_(seen, seen)], self.cross[part][:, seen].T).T
        residual = zs.ravel()[seen] - self.z_mean[seen]
        return self.mean[part] + gain @ residual, self.P[part, part] - gain @ self.cross[part][:, seen].T

    def log_likelihood(self, zs, upto):
        """Log-density of the observations 0 .. upto - 1."""
        seen = np.flatnonzero(~np.isnan(zs[:upto].ravel()))
        if len(seen) == 0:
            return 0.0
        return multivariate_normal(self.z_mean[seen], self.S[np.ix_(seen, seen)]).logpdf(zs.ravel()[seen])

    def filtered(self, zs):
        """Filtered x, P and log-likelihoods of the single observations."""
        moments = [self.state(k, zs, k + 1) for k in range(self.n)]
        total = [self.log_likelihood(zs, k) for k in range(self.n + 1)]
        return *(np.array(part) for part in zip(*moments, strict=True)), np.diff(total)

    def smoothed(self, zs):
        """Smoothed x and P."""
        moments = [self.state(k, zs, self.n) for k in range(self.n)]
        return tuple(np.array(part) for part in zip(*moments, strict=True))


@pytest.fixture
def joint_gaussian():
    return JointGaussian


@pytest.fixture
def system():
    """A stable random system of three states and two observations, and a series with gaps."""
    rng = np.random.default_rng(7)
    F = 0.5 * rng.normal(size=(3, 3))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    A, C = rng.normal(size=(3, 3)), rng.normal(size=(2, 2))
    zs = 2.0 * rng.normal(size=(9, 2))
    zs[2] = np.nan
    zs[4, 0] = np.nan
    zs[6, 1] = np.nan
    return {
        "x": rng.normal(size=3),
        "P": np.eye(3) + 0.3,
        "F": F,
        "Q": A @ A.T,
        "H": rng.normal(size=(2, 3)),
        "R": C @ C.T + 0.1 * np.eye(2),
        "zs": zs,
    }

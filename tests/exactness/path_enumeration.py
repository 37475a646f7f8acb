"""An oracle without recursion: every path of the nodes, each with its joint Gaussian.

For a path the vector (Z_1, ..., Z_N) is Gaussian; it is conditioned on whatever was
observed, as a whole.  Cost M^N, so for short series only.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr


@dataclass
class Posterior:
    """Exact posterior of (R, X) given any observed part of Y."""

    mean: np.ndarray  # (N, m)
    covariance: np.ndarray  # (N, m, m)
    probability: np.ndarray  # (N, M)
    log_likelihood: float
    best_path: np.ndarray  # (N,)
    weights: np.ndarray  # (p,): of the paths
    means: np.ndarray  # (p, N, d): of Z given the path
    covariances: np.ndarray  # (p, N, d, d)

    def mass_below(self, n, value, component=0):
        """P(X_n <= value | observations): the posterior is a mixture over paths."""
        mean = self.means[:, n, component]
        std = np.sqrt(self.covariances[:, n, component, component])
        return float(self.weights @ ndtr((value - mean) / std))


@lru_cache(maxsize=2)  # a filter asks for the posterior after each observation of the same series
def joint_gaussian(system, N):
    """All paths of positive probability (p, N), their probabilities, and the moments along them."""
    chain = system.chain
    paths = np.array(list(itertools.product(range(len(chain)), repeat=N)))
    p = chain.initial[paths[:, 0]] * np.prod(chain.transition[paths[:, :-1], paths[:, 1:]], axis=1)
    paths, p = paths[p != 0.0], p[p != 0.0]
    return paths, p, *moments(paths, system, N)


def moments(paths, system, N):
    """Mean (p, N, d) and covariance (p, N, d, N, d) of Z_1..N given paths of nodes (p, N)."""
    initial = system.initial()
    d = initial.mean.shape[1]
    q = system.dim_z
    m = d - q
    mean, covariance = np.zeros((len(paths), N, d)), np.zeros((len(paths), N, d, N, d))
    mean[:, 0] = initial.mean[paths[:, 0]]
    covariance[:, 0, :, 0] = initial.covariance[paths[:, 0]]
    for n in range(1, N):
        Axx, H, G, c, C, Ayy, Ny, Qyy = (
            part[paths[:, n - 1], paths[:, n]] for part in system.pair_tables(n - 1).pairs
        )
        lags = H.shape[-1] // q
        # rows of Z_n on (Z_1, ..., Z_n-1)
        A = np.zeros((len(paths), d, n, d))
        A[:, :m, n - 1, :m] = Axx
        for lag in range(lags):
            part = slice(lag * q, (lag + 1) * q)
            A[:, :m, n - 1 - lag, m:] = H[..., part] + G @ Ayy[..., part]
            A[:, m:, n - 1 - lag, m:] = Ayy[..., part]
        GQ = G @ Qyy
        Q = np.concatenate(
            [
                np.concatenate([C + GQ @ np.swapaxes(G, -1, -2), GQ], axis=-1),
                np.concatenate([np.swapaxes(GQ, -1, -2), Qyy], axis=-1),
            ],
            axis=-2,
        )
        offset = np.concatenate([c + (G @ Ny[..., None])[..., 0], Ny], axis=-1)
        mean[:, n] = np.einsum("pakb,pkb->pa", A, mean[:, :n]) + offset
        cross = np.einsum("pakb,pkblc->palc", A, covariance[:, :n, :, :n])
        covariance[:, n, :, :n] = cross
        covariance[:, :n, :, n] = np.moveaxis(cross, 1, 3)
        covariance[:, n, :, n] = np.einsum("palc,pblc->pab", cross, A) + Q
    return mean, covariance


def enumerate_paths(system, ys, upto=None):
    """Posterior given y_1..upto (all by default), NaN where missing."""
    ys = np.asarray(ys, dtype=float).reshape(len(ys), -1)
    N, q = ys.shape
    chain = system.chain
    paths, p, mean, covariance = joint_gaussian(system, N)
    d = mean.shape[2]
    m = d - q
    seen = ys.copy()
    seen[N if upto is None else upto :] = np.nan
    at = np.arange(N * d).reshape(N, d)[:, m:][~np.isnan(seen)]
    flat, full = mean.reshape(-1, N * d), covariance.reshape(-1, N * d, N * d)
    log_w = np.log(np.abs(p))
    if at.size:
        S = full[:, at[:, None], at]
        residual = seen[~np.isnan(seen)] - flat[:, at]
        white = np.linalg.solve(S, residual[..., None])[..., 0]
        log_w -= 0.5 * ((residual * white).sum(axis=1) + np.linalg.slogdet(2 * np.pi * S)[1])
        rows = full[:, at]
        flat = flat + (np.swapaxes(rows, 1, 2) @ white[..., None])[..., 0]
        full = full - np.swapaxes(rows, 1, 2) @ np.linalg.solve(S, rows)
    means = flat.reshape(-1, N, d)
    covariances = np.stack([full[:, n * d : (n + 1) * d, n * d : (n + 1) * d] for n in range(N)], axis=1)
    top = log_w.max()
    weights = np.sign(p) * np.exp(log_w - top)
    total = weights.sum()
    weights = weights / total
    probability = np.zeros((N, len(chain)))
    for n in range(N):
        np.add.at(probability[n], paths[:, n], weights)
    x, P = means[..., :m], covariances[..., :m, :m]
    centre = np.einsum("p,pnk->nk", weights, x)
    off = x - centre
    spread = np.einsum("p,pnkl->nkl", weights, P) + np.einsum("p,pnk,pnl->nkl", weights, off, off)
    return Posterior(
        centre,
        spread,
        probability,
        float(top + np.log(total)),
        paths[int(np.argmax(log_w))],
        weights,
        means,
        covariances,
    )

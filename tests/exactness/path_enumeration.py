"""An oracle without recursion: every path of the nodes, each with its joint Gaussian.

For a path the vector (Z_1, ..., Z_N) is Gaussian; it is conditioned on whatever was
observed, as a whole.  Cost M^N, so for short series only.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np


@dataclass
class Posterior:
    """Exact posterior of (R, X) given any observed part of Y."""

    mean: np.ndarray  # (N, m)
    covariance: np.ndarray  # (N, m, m)
    probability: np.ndarray  # (N, M)
    log_likelihood: float
    best_path: tuple[int, ...]
    components: list[tuple[float, np.ndarray, np.ndarray]]  # weight, mean (N, d), covariance (N, d, d)


def joint_gaussian(path, initial, pairs):
    """Mean (N, d) and covariance (N, d, N, d) of Z_1..N given a path of nodes."""
    N, d = len(path), initial.mean.shape[1]
    m = pairs.Axx.shape[-1]
    mean = np.zeros((N, d))
    covariance = np.zeros((N, d, N, d))
    mean[0] = initial.mean[path[0]]
    covariance[0, :, 0] = initial.covariance[path[0]]
    for n in range(1, N):
        k = (path[n - 1], path[n])
        G, Ayy, Qyy = pairs.G[k], pairs.Ayy[k], pairs.Qyy[k]
        A = np.zeros((d, d))
        A[:m, :m], A[:m, m:], A[m:, m:] = pairs.Axx[k], pairs.H[k] + G @ Ayy, Ayy
        offset = np.concatenate([pairs.c[k] + G @ pairs.Ny[k], pairs.Ny[k]])
        Q = np.block([[pairs.C[k] + G @ Qyy @ G.T, G @ Qyy], [Qyy @ G.T, Qyy]])
        mean[n] = A @ mean[n - 1] + offset
        for other in range(n):
            covariance[n, :, other] = A @ covariance[n - 1, :, other]
            covariance[other, :, n] = covariance[n, :, other].T
        covariance[n, :, n] = A @ covariance[n - 1, :, n - 1] @ A.T + Q
    return mean, covariance


def enumerate_paths(system, ys, upto=None):
    """Posterior given y_1..upto (all by default), NaN where missing."""
    ys = np.asarray(ys, dtype=float).reshape(len(ys), -1)
    N, q = ys.shape
    upto = N if upto is None else upto
    initial, pairs, chain = system.initial(), system.pair_tables(0).pairs, system.chain
    M, d = len(chain), initial.mean.shape[1]
    m = d - q
    seen = ys.copy()
    seen[upto:] = np.nan
    index = np.arange(N * d).reshape(N, d)
    at = index[:, m:][~np.isnan(seen)]
    values = seen[~np.isnan(seen)]
    log_weights, paths, components = [], [], []
    for path in itertools.product(range(M), repeat=N):
        p = chain.initial[path[0]] * np.prod([chain.transition[a, b] for a, b in itertools.pairwise(path)])
        if p == 0.0:
            continue
        mean, covariance = joint_gaussian(path, initial, pairs)
        flat, full = mean.reshape(-1), covariance.reshape(N * d, N * d)
        log_w = np.log(p)
        if at.size:
            S = full[np.ix_(at, at)]
            residual = values - flat[at]
            gain = np.linalg.solve(S, full[at]).T
            log_w += -0.5 * (residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(2 * np.pi * S)[1])
            flat = flat + gain @ residual
            full = full - gain @ full[at]
        blocks = np.stack([full[n * d : n * d + m, n * d : n * d + m] for n in range(N)])
        components.append((flat.reshape(N, d)[:, :m], blocks))
        log_weights.append(log_w)
        paths.append(path)
    log_weights = np.array(log_weights)
    top = log_weights.max()
    weights = np.exp(log_weights - top)
    total = weights.sum()
    weights /= total
    probability = np.zeros((N, M))
    for w, path in zip(weights, paths, strict=True):
        probability[np.arange(N), path] += w
    means = np.array([c[0] for c in components])
    covariances = np.array([c[1] for c in components])
    mean = np.einsum("p,pnk->nk", weights, means)
    off = means - mean
    covariance = np.einsum("p,pnkl->nkl", weights, covariances) + np.einsum(
        "p,pnk,pnl->nkl", weights, off, off
    )
    return Posterior(
        mean,
        covariance,
        probability,
        float(top + np.log(total)),
        paths[int(np.argmax(log_weights))],
        [(w, c[0], c[1]) for w, c in zip(weights, components, strict=True)],
    )

"""The oracles of the exactness tests: enumeration of all sequences of nodes."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def enumerate_paths():
    """The exact posterior given any part of the observations, see path_enumeration.py."""
    spec = importlib.util.spec_from_file_location(
        "path_enumeration", Path(__file__).with_name("path_enumeration.py")
    )
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.enumerate_paths


@pytest.fixture(scope="session")
def enumerate_sequences():
    """The exact posterior by enumeration, see `_enumerate`."""
    return _enumerate


def _enumerate(initial, transition, first, step, y, m):
    """Filter by summing over all sequences of nodes; no recursion over time anywhere.

    For each sequence r_1..n the joint Gaussian of (Z_1, ..., Z_n) is written down from
    L z = b + e with L = I - (A below the diagonal), and conditioned on the observations
    as one Gaussian vector.

    Parameters
    ----------
    initial, transition : (M,), (M, M)
    first : mean (M, d) and covariance (M, d, d) of Z_1 given r_1
    step : A (M, M, d, d), N (M, M, d), Q (M, M, d, d) of Z' = A Z + N + N(0, Q)
    y : (n, q)

    Returns
    -------
    dict of arrays with the fields of FilterResult, and y_prior, S: moments of each
    observation before it is seen.
    """
    out = {k: [] for k in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood", "y_prior", "S")}
    total_before = 0.0
    for n in range(1, len(y) + 1):
        paths = _paths(initial, transition, n)
        p = initial[paths[:, 0]] * np.prod(transition[paths[:, :-1], paths[:, 1:]], axis=1)
        sign, log_p = np.sign(p), np.log(np.abs(p))  # a rule of quadrature may have negative weights
        mean, cov = _joint(paths, first, step)
        d = first[0].shape[1]
        hidden = np.arange((n - 1) * d, (n - 1) * d + m)
        seen = np.concatenate([np.arange(k * d + m, (k + 1) * d) for k in range(n)])
        q = d - m
        # before and after the last observation is seen; target is Z_n before, X_n after
        before = _condition(mean, cov, np.arange((n - 1) * d, n * d), seen[:-q], y[: n - 1].ravel())
        weights = _normalise(log_p + before[2], sign)
        centre, spread = _mix(weights, *before[:2])
        out["x_prior"].append(centre[:m])
        out["P_prior"].append(spread[:m, :m])
        out["y_prior"].append(centre[m:])
        out["S"].append(spread[m:, m:])
        x, P, log_w = _condition(mean, cov, hidden, seen, y[:n].ravel())
        log_w = log_w + log_p
        weights = _normalise(log_w, sign)
        centre, spread = _mix(weights, x, P)
        out["x"].append(centre)
        out["P"].append(spread)
        out["mu"].append([weights[paths[:, -1] == j].sum() for j in range(len(initial))])
        total = log_w.max() + np.log((sign * np.exp(log_w - log_w.max())).sum())
        out["log_likelihood"].append(total - total_before)
        total_before = total
    return {name: np.array(values) for name, values in out.items()}


def _paths(initial, transition, n):
    """All sequences of n nodes that can occur, one a row."""
    paths = np.flatnonzero(initial)[:, None]
    for _ in range(n - 1):
        before, new = np.nonzero(transition[paths[:, -1]])
        paths = np.concatenate([paths[before], new[:, None]], axis=1)
    return paths


def _joint(paths, first, step):
    """Mean and covariance of (Z_1, ..., Z_n) for every path."""
    count, n = paths.shape
    d = first[0].shape[1]
    L = np.broadcast_to(np.eye(n * d), (count, n * d, n * d)).copy()
    D = np.zeros_like(L)
    b = np.zeros((count, n * d))
    b[:, :d], D[:, :d, :d] = first[0][paths[:, 0]], first[1][paths[:, 0]]
    for k in range(1, n):
        here, there = slice(k * d, (k + 1) * d), slice((k - 1) * d, k * d)
        i, j = paths[:, k - 1], paths[:, k]
        L[:, here, there] = -step[0][i, j]
        b[:, here], D[:, here, here] = step[1][i, j], step[2][i, j]
    inverse = np.linalg.inv(L)
    return (inverse @ b[..., None])[..., 0], inverse @ D @ np.swapaxes(inverse, 1, 2)


def _condition(mean, cov, target, seen, y):
    """Moments of the target given the seen components, and the log-density of these."""
    if seen.size == 0:
        return mean[:, target], cov[:, target[:, None], target], np.zeros(len(mean))
    Syy = cov[:, seen[:, None], seen]
    gain = cov[:, target[:, None], seen] @ np.linalg.inv(Syy)
    e = y - mean[:, seen]
    x = mean[:, target] + np.einsum("pij,pj->pi", gain, e)
    P = cov[:, target[:, None], target] - gain @ cov[:, seen[:, None], target]
    quadratic = np.einsum("pi,pij,pj->p", e, np.linalg.inv(Syy), e)
    log_density = -0.5 * (quadratic + np.linalg.slogdet(2 * np.pi * Syy)[1])
    return x, P, log_density


def _normalise(log_w, sign):
    w = sign * np.exp(log_w - log_w.max())
    return w / w.sum()


def _mix(w, x, P):
    centre = w @ x
    spread = np.einsum("p,pij->ij", w, P + (x - centre)[:, :, None] * (x - centre)[:, None, :])
    return centre, spread

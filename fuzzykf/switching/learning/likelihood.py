"""Likelihood of (x, y) with the switch hidden: a forward pass over the nodes.

On the nodes (R, Z) is a hidden Markov chain with emission p(z_{n+1} | z_n, r_n, r_{n+1}),
so the likelihood of a stretch of data is exact.  Where states are missing their factors are left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import LOG_ZERO
from fuzzykf.gaussian import cholesky, log_density, logsumexp
from fuzzykf.switching.dynamics.pairs import log_probability
from fuzzykf.switching.learning.tilt import tilted

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.further import Further

__all__ = ["emissions", "forward", "log_likelihood"]

#: Transitions whose densities are held at once.
_CHUNK = 1024


def emissions(
    system: SwitchingSystem,
    now: FloatArray,
    then: FloatArray,
    has_state: BoolArray | None = None,
    window: FloatArray | None = None,
) -> FloatArray:
    """Log p(z_{n+1} | z_n, r_n = i, r_{n+1} = j) for n transitions, (n, M, M).

    Parameters
    ----------
    now, then : ndarray, shape (n, d)
        Z before and after each transition.
    has_state : ndarray of bool, shape (n,), optional
        Transitions of which the state counts: of others it is log p(y_{n+1} | y_n, i, j).  By default all.
    window : ndarray, shape (n, w), optional
        What the regressions take in the place of y_n, where there are inputs or features.
    """
    m = system.dim_x
    pairs = system.pair_tables(0).pairs
    x, x1, y1 = now[:, :m], then[:, :m], then[:, m:]
    y = now[:, m:] if window is None else window
    factor_y = cholesky(pairs.Qyy, lambda k: f"noise covariance of the observation, pair {k}")
    factor_x = cholesky(pairs.C, lambda k: f"noise covariance of the state, pair {k}")
    mean_y = np.einsum("ijkl,nl->nijk", pairs.Ayy, y) + pairs.Ny
    mean_x = (
        np.einsum("ijkl,nl->nijk", pairs.Axx, x)
        + np.einsum("ijkl,nl->nijk", pairs.H, y)
        + np.einsum("ijkl,nl->nijk", pairs.G, y1)
        + pairs.c
    )
    density = log_density(y1[:, None, None] - mean_y, factor_y)
    density_x = log_density(x1[:, None, None] - mean_x, factor_x)
    if has_state is not None:
        density_x[~has_state] = 0.0
    return density + density_x


def forward(log_transition: FloatArray, log_first: FloatArray, log_emission: FloatArray) -> FloatArray:
    """Log-likelihood of a stretch, and log p(r_n | z_1..n) after every observation.

    Parameters
    ----------
    log_transition : ndarray, shape (M, M) or (n, M, M)
    log_first : ndarray, shape (M,)
        log p(r_1) + log p(z_1 | r_1).
    log_emission : ndarray, shape (n, M, M)

    Returns
    -------
    ndarray, shape (n + 1,)
        log p(z_n | z_1..n-1) of each observation.
    """
    steps = np.empty(len(log_emission) + 1)
    steps[0] = logsumexp(log_first)
    log_p = log_first - steps[0]
    moves = log_emission + log_transition
    for n, move in enumerate(moves, 1):
        weights = log_p[:, None] + move
        top = weights.max(axis=0)
        log_p = np.log(np.exp(weights - top).sum(axis=0)) + top
        steps[n] = logsumexp(log_p)
        log_p -= steps[n]
    return steps


def log_likelihood(system: SwitchingSystem, data: TrainingData) -> float:
    """Log p(x, y) of all stretches, in the units of the data.

    Where states are missing it is the sum over the paths of the switch of the products of those factors that
    are known: p(y' | y, i, j) of every transition, p(x' | x, y, y', i, j) of those that have a state
    (`TrainingData.has_state`), and of the first row of a stretch p(y | i), and p(x | y, i) if x is known.  If
    the state does not depend on the one before, this is the likelihood of all that was measured.  If it does,
    it is the likelihood of y and of each x whose predecessor is known, the first x after a gap being given.
    """
    z = data.z * data.scale.std + data.scale.mean
    z = np.where(np.isnan(z), data.scale.mean, z)  # read by no factor that counts
    m = system.dim_x
    law = system.initial()
    factor = cholesky(law.covariance, lambda k: f"covariance of Z in node {k[0]}")
    factor_y = cholesky(law.covariance[:, m:, m:], lambda k: f"covariance of Y in node {k[0]}")
    log_transition = log_probability(np.maximum(system.chain.transition, 0.0))
    windows = None if data.further is None else data.further.windows(z[data.before, m:])
    push = None if data.further is None else _push(system, data.further)
    total, done = 0.0, 0
    stops = np.append(data.starts[1:], len(z))
    for start, stop in zip(data.starts, stops, strict=True):
        off = z[start] - law.mean
        density = log_density(off, factor) if data.known[start] else log_density(off[:, m:], factor_y)
        first = np.maximum(log_probability(law.probability), LOG_ZERO) + density
        steps = slice(done, done + stop - start - 1)
        window = None if windows is None else windows[steps]
        moves = log_transition
        if data.further is not None and push is not None:
            moves = moves + tilted(system.chain.transition, push, data.further.us[steps])
        total += _stretch(system, moves, first, z[start:stop], data.has_state[steps], window)
        done += stop - start - 1
    return total


def _stretch(
    system: SwitchingSystem,
    log_transition: FloatArray,
    log_first: FloatArray,
    z: FloatArray,
    has_state: BoolArray,
    window: FloatArray | None = None,
) -> float:
    blocks = [
        emissions(
            system,
            z[k:end],
            z[k + 1 : end + 1],
            has_state[k:end],
            None if window is None else window[k:end],
        )
        for k in range(0, len(z) - 1, _CHUNK)
        for end in [min(k + _CHUNK, len(z) - 1)]
    ]
    M = log_transition.shape[-1]
    emission = np.concatenate(blocks) if blocks else np.empty((0, M, M))
    return float(forward(log_transition, log_first, emission).sum())


def _push(system: Any, further: Further) -> FloatArray | None:
    """Return how inputs in standard units push each node, (M, k)."""
    push = getattr(system, "push", None)
    return None if push is None else push * further.std[: len(further.inputs)]

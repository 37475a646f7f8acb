"""Where expectation-maximisation begins: guesses of the switch from the data alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.learning.data import TrainingData

__all__ = ["guesses"]


def guesses(data: TrainingData, n_starts: int, rng: np.random.Generator | None) -> list[FloatArray]:
    """Sequences in [0, 1] that follow the data, each a guess of the switch.

    The first ones are ranks of the first principal component of y, of (x, y), of x, and
    of the size of the steps; the others are ranks of random directions.

    Parameters
    ----------
    data : TrainingData
    n_starts : int
    rng : numpy.random.Generator, optional
        For more than four starts.

    Returns
    -------
    list of ndarray, shape (N,)
        Each oriented so that it rises with the first component of y.
    """
    m = data.dim_x
    z = data.z
    steps = np.zeros(len(z))
    steps[data.after] = np.linalg.norm(z[data.after] - z[data.before], axis=1)
    scores = [_principal(z[:, m:]), _principal(z), _principal(z[:, :m]), steps]
    while len(scores) < n_starts and rng is not None:
        scores.append(z @ rng.standard_normal(z.shape[1]))
    return [_oriented(_rank(s), z[:, m]) for s in scores[:n_starts]]


def spread(rank: FloatArray) -> FloatArray:
    """Turn ranks into a switch that is hard in half of the data."""
    r: FloatArray = np.clip((rank - 0.25) / 0.5, 0.0, 1.0)
    return r


def classes(rank: FloatArray, K: int) -> FloatArray:
    """Turn ranks into regimes of equal size."""
    regime = np.minimum((rank * K).astype(int), K - 1)
    return soften(np.eye(K)[regime])


def soften(one_hot: FloatArray) -> FloatArray:
    """Turn regimes into shares of which none is excluded."""
    shares: FloatArray = 0.9 * one_hot + 0.1 / one_hot.shape[1]
    return shares


def _principal(values: FloatArray) -> FloatArray:
    centred = values - values.mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    score: FloatArray = centred @ direction
    return score


def _rank(values: FloatArray) -> FloatArray:
    order = np.empty(len(values))
    order[np.argsort(values, kind="stable")] = np.arange(len(values))
    return (order + 0.5) / len(values)


def _oriented(rank: FloatArray, y: FloatArray) -> FloatArray:
    return rank if np.corrcoef(rank, y)[0, 1] >= 0.0 else 1.0 - rank

"""Weights of pairs many standard deviations from an observation, with their digits kept; NumPy.

The log-density l of an observation d standard deviations off is about -d^2/2.  Added to log p + log P
it would round those away: at 1e6 standard deviations to 1e-4, at 1e8 to nothing.  So differences of l are
taken first, and the small terms added after.  Where z is the whitened residual, l = -|z|^2 + constants and

    l_a - l_b = -(z_a - z_b)'(z_a + z_b),

with z_a - z_b from differences of the coefficients of z: what two pairs have in common cancels
before it is multiplied by a large observation.  Each column j has a reference of its own, the best of
its pairs; columns are compared through their references.  Pairs that cannot be do not take part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.numpy.tables import Kernel

__all__ = [
    "FARTHEST",
    "NEAR",
    "QUIET",
    "far_nodes",
    "far_pairs",
    "far_parts",
    "far_weights",
    "relative_weights",
]

#: Below this a log-density comes near the end of the range of numbers; weights are NaN then.
FARTHEST = -1e303

#: Factors of covariances, and coefficients, that differ by less, relatively, are one.
_ALIKE = 1e-14

#: How often a better reference is looked for.
_ROUNDS = 4

#: What overflows is told by weights that are NaN, not by a warning on the way to them.
QUIET = np.errstate(over="ignore", invalid="ignore")

#: Logarithms of weights above this keep their digits (to 1e-13) beside one another.
NEAR = -500.0


def far_weights(rows: FloatArray, small: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Weigh the pairs (i, j) at an observation.

    Parameters
    ----------
    rows : ndarray, shape (q, M1, M2, n)
        Coefficients of the whitened residuals z, divided by sqrt(2).
    small : ndarray, shape (M1, M2)
        Everything but -|z|^2 in the log-weight; below `DEAD` where a pair cannot be.
    u : ndarray, shape (n,)
        What the coefficients are multiplied by.

    Returns
    -------
    log_w : ndarray, shape (M1, M2)
        Relative to the reference of the column.
    reference : ndarray, shape (M2,)
        Log-weights of the references of the columns, relative to ``best``.
    best : float
        The largest of them.
    """

    def minus(i: IntArray, j: IntArray) -> FloatArray:
        """Z - z[:, i, j]; coefficients that differ by their rounding alone do not differ."""
        apart = rows - rows[:, i, j][:, None]
        residual: FloatArray = np.where(np.abs(apart) <= _ALIKE * np.abs(rows), 0.0, apart) @ u
        return residual

    return relative_weights(rows @ u, small, minus)


def relative_weights(
    z: FloatArray, small: FloatArray, minus: Callable[[IntArray, IntArray], FloatArray]
) -> tuple[FloatArray, FloatArray, float]:
    """Do `far_weights` with residuals z (q, M1, M2).

    ``minus(i, j)`` is (q, M1, M2), z - z[:, i, j] with digits kept; i and j broadcast against (M2,).
    """
    possible, columns = small > DEAD, np.arange(z.shape[2])
    total = np.where(possible, small - (z * z).sum(axis=0), -np.inf)
    i = total.argmax(axis=0)
    is_there = total[i, columns] > -np.inf
    best = float(total.max())
    if not best > FARTHEST:
        return np.full_like(small, np.nan), np.zeros(columns.size), np.nan
    better = i
    for _ in range(_ROUNDS):  # the best by its digits is found among those that seemed to be
        i = better
        less = (minus(i, columns) * (z + z[:, i, columns][:, None])).sum(axis=0)
        log_w = np.where(possible, small - small[i, columns] - less, LOG_ZERO)
        ahead = log_w.max(axis=0) > 0.0
        if not ahead.any():
            break
        better = np.where(ahead, log_w.argmax(axis=0), i)
    j = np.array([np.where(is_there, total[i, columns], -np.inf).argmax()])
    for _ in range(_ROUNDS):
        off = minus(i[j], j)[:, i, columns]
        less = (off * (z[:, i, columns] + z[:, i[j], j])).sum(axis=0)
        reference = np.where(is_there, small[i, columns] - small[i[j], j] - less, 0.0)
        best = float(total[i[j], j][0])
        if not reference.max() > 0.0:
            break
        j = np.array([reference.argmax()])
    peak = float((log_w.max(axis=0) + reference)[is_there].max())
    return log_w, reference - peak, best + peak


def far_pairs(kernel: Kernel, log_p: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Weigh the pairs at an observation that is far off, see `far_weights`; ``u`` begins with (1, w, y').

    M1 stands for the slots of the kernel.
    """
    _, M2, _, q = kernel.shape
    rows = kernel.rows[: q * kernel.depth * M2].reshape(q, kernel.depth, M2, -1)
    small = kernel.log_scale.reshape(-1, M2) + log_p[kernel.nodes]
    return far_weights(rows, small, u[: rows.shape[-1]])


def far_nodes(
    small: FloatArray, mean: FloatArray, factor: FloatArray, y: FloatArray
) -> tuple[FloatArray, float]:
    """Weigh nodes (M,) at a first observation y (q,), given the mean (M, q) and the factor of each node.

    Returns their log-weights relative to the log-density of the closest, and that.
    """
    M, q = mean.shape
    there = np.concatenate([-mean[..., None], np.broadcast_to(np.eye(q), (M, q, q))], axis=-1)
    rows = np.moveaxis(np.linalg.solve(factor, there) * np.sqrt(0.5), 1, 0)[:, :, None]
    log_w, _, best = far_weights(rows, small[:, None], np.concatenate((np.ones(1), y)))
    return log_w[:, 0], best


def far_parts(
    white: FloatArray, small: FloatArray, mean: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Do `far_weights` for the parts of an observation that are there.

    Parameters
    ----------
    white : ndarray, shape (M1, M2, k)
        Whitened residuals.
    small : ndarray, shape (M1, M2)
    mean, factor : ndarray, shapes (M1, M2, k) and (M1, M2, k, k)
        Of those parts; factors are those of Cholesky.
    """
    z = np.moveaxis(white, -1, 0) * np.sqrt(0.5)

    def minus(i: IntArray, j: IntArray) -> FloatArray:
        """Return z - z[:, i, j]; where both have one covariance, from the difference of the means."""
        off = np.linalg.solve(factor, (mean[i, j] - mean)[..., None])[..., 0] * np.sqrt(0.5)
        alike = (np.abs(factor - factor[i, j]) <= _ALIKE * np.abs(factor)).all(axis=(-1, -2))
        less: FloatArray = np.where(alike, np.moveaxis(off, -1, 0), z - z[:, i, j][:, None])
        return less

    return relative_weights(z, small, minus)

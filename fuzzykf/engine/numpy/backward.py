"""NumPy kernels that go back along a filtered series, or find the most likely path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.outliers import NEAR, far_pairs
from fuzzykf.engine.numpy.switching import are_far, slot_logs
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.numpy.tables import Kernel

__all__ = ["best_path", "smooth_back"]

#: Steps whose pair weights are held at once.
_CHUNK = 512


def smooth_back(kernel: Kernel, log_p: FloatArray, U: FloatArray, after: FloatArray) -> FloatArray:
    """Carry the smoothed probabilities of the nodes back through n steps with the same tables.

    gamma_t = o_t gamma_{t+1} with o_ij = p(r_t = i | r_{t+1} = j, y_1..t+1), (14).

    Parameters
    ----------
    kernel : Kernel
        Without negative weights.
    log_p : ndarray, shape (n, M)
        Filtered log-probabilities at the start of each step.
    U : ndarray, shape (n, 1 + w + q)
        Rows (1, w, y').
    after : ndarray, shape (M,)
        Smoothed probabilities after the last step.

    Returns
    -------
    ndarray, shape (n, M)
        Smoothed probabilities at the start of each step.
    """
    (M1, M2), slots = kernel.shape[:2], kernel.slots
    gamma = np.empty((len(U), M1))
    for stop in range(len(U), 0, -_CHUNK):
        start = max(0, stop - _CHUNK)
        log_w = slot_logs(kernel, U[start:stop]).reshape(-1, kernel.depth, M2)
        log_w += log_p[start:stop][(slice(None), *kernel.nodes)]
        top = log_w.max(axis=1)
        for far in np.flatnonzero(((top < NEAR) & (top > DEAD)).any(axis=1)):
            log_w[far] = far_pairs(kernel, log_p[start + far], U[start + far])[0]
            top[far] = log_w[far].max(axis=0)
        w = np.exp(log_w - top[:, None])
        w /= w.sum(axis=1, keepdims=True)
        for t in range(stop - 1, start - 1, -1):
            after = w[t - start] @ after if slots is None else slots.sums(w[t - start] * after, M1)
            gamma[t] = after = after / after.sum()  # one, but for rounding, which would add up
    return gamma


def best_path(
    kernel: Kernel,
    score: FloatArray,
    U: FloatArray,
    given: tuple[IntArray, FloatArray, IntArray] | None = None,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Viterbi's recursion through n steps with the same tables.

    Parameters
    ----------
    kernel : Kernel
        Without negative weights.
    score : ndarray, shape (M,)
        Log-density of the best path to each node, up to a constant.
    U : ndarray, shape (n, 1 + w + q)
    given : tuple of ndarray, shapes (g,), (g, depth, M) and (depth, M), optional
        The steps whose log-densities of pairs do not follow from U, in their order; these, slot by slot; and
        the node before in each slot.

    Returns
    -------
    score : ndarray, shape (M,)
        The same after the last step; its maximum is zero.
    pointers : ndarray, shape (n, M)
        The node before, on the best path to each node.
    """
    M2, slots = kernel.shape[1], kernel.slots
    pointers = np.empty((len(U), M2), dtype=np.int64)
    columns = np.arange(M2)
    told = {} if given is None else dict(zip(given[0].tolist(), given[1], strict=True))
    for start in range(0, len(U), _CHUNK):
        for t, pairs in enumerate(slot_logs(kernel, U[start : start + _CHUNK]), start):
            if given is not None and t in told:
                total = score[given[2]] + told[t]
                best = total.argmax(axis=0)
                pointers[t] = given[2][best, columns]
                score = total[best, columns]
                score = np.maximum(score - score.max(), LOG_ZERO)
                continue
            total = score[kernel.nodes] + pairs.reshape(-1, M2)
            if are_far(total.max(axis=0)):
                total, reference, _ = far_pairs(kernel, score, U[t])
                total += reference
            best = total.argmax(axis=0)
            score = total[best, columns]
            score = score - score.max()
            if slots is not None:
                best = slots.source[best, columns]
                np.maximum(score, LOG_ZERO, out=score)  # where no path leads nothing adds up
            pointers[t] = best
    return score, pointers

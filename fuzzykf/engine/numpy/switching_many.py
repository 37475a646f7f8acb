"""NumPy kernel of the switching recursion for many series side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy.switching import log_pairs

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.numpy.switching import Kernel

__all__ = ["step_many"]


def step_many(kernel: Kernel, table: FloatArray, U: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Run `fuzzykf.engine.numpy.switching.step` for many series side by side; no negative weights.

    Parameters
    ----------
    kernel : Kernel
    table : ndarray, shape (s, 1 + m + m*m, M1)
    U : ndarray, shape (s, 1 + w + q)
        Rows (1, w, y').

    Returns
    -------
    table : ndarray, shape (s, 1 + m + m*m, M2)
    log_likelihood : ndarray, shape (s,)
    """
    M1, M2, m, q = kernel.shape
    s = len(U)
    w = log_pairs(kernel, U).reshape(s, M1, M2)
    w += table[:, 0, :, None]
    top = w.max(axis=1)
    w -= top[:, None]
    np.exp(w, out=w)
    column = w.sum(axis=1)
    w /= column[:, None]
    offset = (U @ kernel.rows[q * M1 * M2 :].T).reshape(s, m, M1, M2)
    new = np.empty((s, 1 + m + m * m, M2))
    if m == 1:
        a, C = kernel.Axx[..., 0, 0], kernel.C[..., 0, 0]
        x = offset[:, 0]
        x += a * table[:, 1, :, None]
        new[:, 1] = np.einsum("sij,sij->sj", w, x)
        x -= new[:, 1, None]
        x *= x
        x += a * a * table[:, 2, :, None] + C
        new[:, 2] = np.einsum("sij,sij->sj", w, x)
    else:
        moments = np.swapaxes(table[:, 1:], 1, 2)
        x_node, P_node = moments[..., :m], moments[..., m:].reshape(s, M1, 1, m, m)
        x_pair = (kernel.Axx @ x_node[:, :, None, :, None])[..., 0] + np.moveaxis(offset, 1, -1)
        P_pair = kernel.Axx @ P_node @ np.swapaxes(kernel.Axx, -1, -2) + kernel.C
        mean = np.einsum("sij,sijk->sjk", w, x_pair)
        x_pair -= mean[:, None]
        P = np.einsum("sij,sijkl->sjkl", w, P_pair)
        P += np.einsum("sijk,sijl->sjkl", w[..., None] * x_pair, x_pair)
        P = 0.5 * (P + np.swapaxes(P, -1, -2))
        new[:, 1 : 1 + m] = np.swapaxes(mean, 1, 2)
        new[:, 1 + m :] = np.swapaxes(P.reshape(s, M2, m * m), 1, 2)
    log_p = np.log(column) + top
    peak = log_p.max(axis=1, keepdims=True)
    log_likelihood = np.log(np.exp(log_p - peak).sum(axis=1)) + peak[:, 0]
    new[:, 0] = log_p - log_likelihood[:, None]
    return new, log_likelihood

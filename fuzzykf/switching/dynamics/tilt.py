"""How inputs act on a chain: P_ij(n) prop. to P_ij exp(w_j), with weights w of the nodes of the new time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["log_totals", "tilted_transition"]

#: Weights that differ by less than this are exponentiated side by side: exp(-600) is 1e-261.
_CLOSE = 600.0


def log_totals(transition: FloatArray, weight: FloatArray) -> FloatArray:
    """Return log sum_j P_ij exp(w_j) of each node i.

    Where weights are far apart, the reference of a row is the largest one that the row can reach: against the
    largest of all, everything that it can reach may underflow.

    Parameters
    ----------
    transition : ndarray, shape (M, M)
        A row that is zero gives minus infinity.
    weight : ndarray, shape (..., M)

    Returns
    -------
    ndarray, shape (..., M)
    """
    top = weight.max(axis=-1, keepdims=True)
    with np.errstate(divide="ignore"):
        if (top - weight).max(initial=0.0) < _CLOSE:
            close: FloatArray = np.log(np.exp(weight - top) @ transition.T) + top
            return close
        reached = np.where(transition > 0.0, weight[..., None, :], -np.inf)
        top = reached.max(axis=-1)
        top = np.where(np.isfinite(top), top, 0.0)
        total: FloatArray = np.log((transition * np.exp(reached - top[..., None])).sum(axis=-1)) + top
        return total


def tilted_transition(transition: FloatArray, weight: FloatArray) -> FloatArray:
    """Return P_ij(n), (M, M), rows summing to one; a row that is zero stays so.

    Parameters
    ----------
    transition : ndarray, shape (M, M)
    weight : ndarray, shape (M,)
    """
    possible = transition > 0.0
    off = np.where(possible, weight - log_totals(transition, weight)[:, None], 0.0)
    moved: FloatArray = np.where(possible, np.exp(np.log(np.where(possible, transition, 1.0)) + off), 0.0)
    rows = moved.sum(axis=1, keepdims=True)
    sound: FloatArray = np.divide(moved, rows, out=np.zeros_like(moved), where=rows > 0.0)
    return sound

"""What linear models show of their state, and where their noise can take it; on arrays alone.

Two initial states a and b show the same measurements with a possibility chi that depends on d = a - b.
With quadratic costs chi = g^-1(d' W d / 2); with bounded noise it is a question of a linear program whether
d_(k+1) - F d_k and H d_k can stay within the widths of the noises.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import NumericalRangeError
from fuzzykf.gaussian import symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = [
    "bounded_widths",
    "can_differ",
    "can_reach",
    "information",
    "observability_matrix",
    "reachable",
    "row_space",
    "widths_in",
]

#: Singular values below this part of the largest are zero, of rows of length one.
RANK = 1e-10

#: A component of a direction below this is none.
NONE = 1e-8


def observability_matrix(F: FloatArray, H: FloatArray, n: int) -> FloatArray:
    """Stack H, H F, ..., H F^(n - 1); what more than m of them show, m show.

    Parameters
    ----------
    F, H : ndarray, shapes (m, m) and (q, m)
    n : int
        Number of measurements.

    Returns
    -------
    ndarray, shape (min(n, m) q, m)
    """
    rows = [H]
    for _ in range(min(n, F.shape[0]) - 1):
        row = rows[-1] @ F
        size = np.abs(row).max(initial=0.0)
        rows.append(row / size if size > 0.0 else row)  # lengths of rows do not matter
    return np.vstack(rows)


def row_space(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split space into what some rows see and what they do not.

    Ranks are judged on rows of length one, with components in units of their columns.

    Parameters
    ----------
    rows : ndarray, shape (k, m)

    Returns
    -------
    seen : ndarray, shape (m, r)
        Columns that span the rows.
    unseen : ndarray, shape (m - r, m)
        Orthonormal rows v with rows v = 0.

    Examples
    --------
    >>> seen, unseen = row_space(np.array([[1.0, 0.0], [2.0, 0.0]]))
    >>> np.abs(seen), np.abs(unseen)
    (array([[1.],
           [0.]]), array([[0., 1.]]))
    """
    unit = np.linalg.norm(rows, axis=0)
    unit = np.where(unit > 0.0, unit, 1.0)
    scaled = rows / unit
    length = np.linalg.norm(scaled, axis=1)
    scaled = scaled[length > 0.0] / length[length > 0.0, None]
    m = rows.shape[1]
    if not scaled.size:
        return np.zeros((m, 0)), np.eye(m)
    _, size, vectors = np.linalg.svd(scaled)
    rank = int((size > RANK * size[0]).sum())
    seen = np.linalg.qr((vectors[:rank] * unit).T)[0]
    unseen = np.linalg.qr((vectors[rank:] / unit).T)[0].T
    return seen, unseen


def information(F: FloatArray, H: FloatArray, Q: FloatArray, R: FloatArray, n: int) -> FloatArray:
    """Return what 1, ..., n measurements tell of the initial state.

    W <- H' R^-1 H + F' W (I + Q W)^-1 F, from W = 0.

    Parameters
    ----------
    F, H : ndarray, shapes (m, m) and (q, m)
    Q, R : ndarray, shapes (m, m) and (q, q)
        R positive definite.
    n : int

    Returns
    -------
    ndarray, shape (n, m, m)

    Raises
    ------
    NumericalRangeError
        If double precision cannot hold it.

    Examples
    --------
    >>> one = np.eye(1)
    >>> information(one, one, one, one, 2).ravel()
    array([1. , 1.5])
    """
    m = F.shape[0]
    seen = H.T @ np.linalg.solve(R, H)
    W, found = np.zeros((m, m)), np.empty((n, m, m))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n):
            W = symmetrize(seen + F.T @ W @ np.linalg.solve(np.eye(m) + Q @ W, F))
            found[k] = W
    if not np.isfinite(found).all():
        raise NumericalRangeError(
            f"n: got {n}, over which the powers of F leave the range of double precision; expected fewer"
        )
    return found


def widths_in(W: FloatArray, seen: FloatArray, unseen: FloatArray, level: float) -> FloatArray:
    """Largest components of the d with d' W d <= level, infinite where nothing bounds them.

    Parameters
    ----------
    W : ndarray, shape (m, m)
    seen, unseen : ndarray
        See `row_space`: the range of W and what is orthogonal to it.
    level : float

    Returns
    -------
    ndarray, shape (m,)
    """
    inverse = seen @ np.linalg.solve(seen.T @ W @ seen, seen.T) if seen.size else np.zeros_like(W)
    return np.where(_is_open(unseen), np.inf, np.sqrt(level * np.maximum(np.diag(inverse), 0.0)))


def _is_open(unseen: FloatArray) -> np.ndarray:
    """Which components some unseen direction has."""
    return np.asarray((np.abs(unseen) > NONE).any(axis=0))


def _differences(
    F: FloatArray, H: FloatArray, w: FloatArray, v: FloatArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Inequalities A d <= b of (d_0, ..., d_(n-1)): |d_(k+1) - F d_k| <= w, |H d_k| <= v."""
    (q, m), rows, most = H.shape, [], []
    for k in range(n):
        row = np.zeros((q, n * m))
        row[:, k * m : (k + 1) * m] = H
        rows.append(row)
        most.append(v)
        if k:
            row = np.zeros((m, n * m))
            row[:, k * m : (k + 1) * m] = np.eye(m)
            row[:, (k - 1) * m : k * m] = -F
            rows.append(row)
            most.append(w)
    A, b = np.vstack(rows), np.concatenate(most)
    return np.vstack([A, -A]), np.concatenate([b, b])


def bounded_widths(
    F: FloatArray, H: FloatArray, w: FloatArray, v: FloatArray, n: int, unseen: FloatArray
) -> FloatArray:
    """Largest components of the differences that n measurements need not show, by linear programs.

    Parameters
    ----------
    F, H : ndarray, shapes (m, m) and (q, m)
    w, v : ndarray, shapes (m,) and (q,)
        Widths of process and measurement noise, from end to end.
    n : int
        Number of measurements.
    unseen : ndarray
        See `row_space`.

    Returns
    -------
    ndarray, shape (m,)
        Infinite where nothing bounds them.

    Examples
    --------
    >>> one = np.eye(1)
    >>> bounded_widths(one, one, np.array([0.0]), np.array([2.0]), 5, np.zeros((0, 1)))
    array([2.])
    """
    m, is_open = F.shape[0], _is_open(unseen)
    A, b = _differences(F, H, w, v, n)
    found = np.full(m, np.inf)
    for i in np.flatnonzero(~is_open):
        target = np.zeros(n * m)
        target[i] = -1.0
        solved = _solved(target, A_ub=A, b_ub=b, bounds=(None, None))
        if solved.status != 0:
            raise NumericalRangeError(
                f"n: got {n}, for which the linear program of component {i} has no solution in double "
                f"precision ({solved.message}); expected fewer measurements"
            )
        found[i] = -solved.fun
    return found


def can_differ(
    F: FloatArray, H: FloatArray, w: FloatArray, v: FloatArray, n: int, difference: FloatArray
) -> bool:
    """Whether n measurements need not show that two initial states differ by ``difference`` (m,)."""
    A, b = _differences(F, H, w, v, n)
    m = F.shape[0]
    fixed = [(d, d) for d in difference] + [(None, None)] * ((n - 1) * m)
    return bool(_solved(np.zeros(n * m), A_ub=A, b_ub=b, bounds=fixed).status == 0)


def _solved(target: FloatArray, **constraints: Any) -> Any:
    """Solve a linear program; its solver takes long to import, and most users never need it."""
    from scipy.optimize import linprog

    return linprog(target, method="highs", **constraints)


def reachable(F: FloatArray, Q: FloatArray, n: int) -> FloatArray:
    """Add F^k Q F'^k over k < 1, ..., n: where so many noises take a state that is known.

    Returns
    -------
    ndarray, shape (n, m, m)

    Raises
    ------
    NumericalRangeError
        If double precision cannot hold it.
    """
    found, P = np.empty((n, *Q.shape)), np.zeros_like(Q)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n):
            P = symmetrize(F @ P @ F.T + Q)
            found[k] = P
    if not np.isfinite(found).all():
        raise NumericalRangeError(
            f"n: got {n}, over which the powers of F leave the range of double precision; expected fewer"
        )
    return found


def can_reach(F: FloatArray, lower: FloatArray, upper: FloatArray, n: int, way: FloatArray) -> bool:
    """Whether n noises within bounds (m,) can add up to ``way`` (m,): way = sum of F^(n-1-k) w_k."""
    powers = [np.eye(F.shape[0])]
    for _ in range(n - 1):
        powers.append(F @ powers[-1])
    A = np.hstack(powers)
    bounds = np.tile(np.stack([lower, upper], axis=1), (n, 1))
    return bool(_solved(np.zeros(A.shape[1]), A_eq=A, b_eq=way, bounds=bounds).status == 0)

"""NumPy kernels of many series whose switches are known, side by side: one node, and a pair for each step.

Given its path Z = (X, Y) is Gaussian, of order one: what is known after an observation is mean and
covariance of (X, Y), and of Y nothing remains open but what is missing.  Covariances go through this as
roots, by the same transformations as in `fuzzykf.engine.numpy.gaps`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.gaps import noise_root
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import LOG_2PI, lower_factor, solve_lower, square, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

__all__ = ["KnownSteps", "filter_known_pairs", "known_steps"]


class KnownSteps(NamedTuple):
    """Z' = F Z + b + noise of steps k of series s."""

    F: FloatArray  # (s, n, d, d)
    b: FloatArray  # (s, n, d)
    root: FloatArray  # (s, n, d, d): of the covariance of the noise


def known_steps(pairs: tuple[FloatArray, ...]) -> KnownSteps:
    """Turn regressions of X' and Y', those of `PairCoefficients` with axes (s, n, ...), into steps of Z."""
    Axx, H, G, c, _, Ayy, Ny, _ = pairs
    m, q = G.shape[-2:]
    F = np.zeros((*G.shape[:-2], m + q, m + q))
    F[..., :m, :m], F[..., :m, m:], F[..., m:, m:] = Axx, H + G @ Ayy, Ayy
    b = np.concatenate([c + (G @ Ny[..., None])[..., 0], Ny], axis=-1)
    return KnownSteps(F, b, noise_root(pairs))


@QUIET
def filter_known_pairs(
    steps: KnownSteps | None,
    begins: bool,
    mean: FloatArray,
    root: FloatArray,
    ys: FloatArray,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Filter several series.

    Parameters
    ----------
    steps : KnownSteps or None
        To these observations; if they begin a series to all but the first, None if that is all there is.
    begins : bool
        Whether the first of these observations is the first of all, before which nothing moves.
    mean, root : ndarray, shapes (s, d) and (s, d, r)
        Mean of Z and a root of its covariance before them, or of Z_1 before its Y is seen.
    ys : ndarray, shape (s, n, q)
        NaN where missing.
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in: ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, as far as they are there.

    Returns
    -------
    mean, root : ndarray, shapes (s, d) and (s, d, d)
        After the last observation.

    Raises
    ------
    numpy.linalg.LinAlgError
        If what is there of an observation has no spread.
    """
    m = mean.shape[-1] - ys.shape[-1]
    for k in range(ys.shape[1]):
        if steps is not None and not (begins and k == 0):
            F, b, noise = (part[:, k - begins] for part in steps)
            mean = (F @ mean[..., None])[..., 0] + b
            root = np.concatenate([F @ root, noise], axis=-1)
        _store(out, k, "x_prior", "P_prior", mean[:, :m], root[:, :m])
        mean, root, log_density = _seen(mean, root, ys[:, k])
        _store(out, k, "x", "P", mean[:, :m], root[:, :m])
        if "log_likelihood" in out:
            out["log_likelihood"][:, k] = log_density
    return mean, root


def _store(out: dict[str, FloatArray], k: int, x: str, P: str, mean: FloatArray, root: FloatArray) -> None:
    """Fill in the moments of X at observation ``k``."""
    if x in out:
        out[x][:, k] = mean
    if P in out:
        out[P][:, k] = symmetrize(square(root))


def _seen(mean: FloatArray, root: FloatArray, ys: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition Z of each series on what is there of its observation (s, q).

    Returns means, roots (s, d, d), and log-densities of what is there, 0 of nothing.
    """
    s, d = mean.shape
    there = ~np.isnan(ys)
    mean, left, log_density = mean.copy(), np.zeros((s, d, d)), np.zeros(s)
    patterns, which = np.unique(there, axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        rows: IntArray = np.flatnonzero(which.reshape(-1) == number)
        if not pattern.any():
            left[rows] = lower_factor(root[rows])
            continue
        at = d - ys.shape[1] + np.flatnonzero(pattern)
        rest, k, each = np.delete(np.arange(d), at), at.size, rows[:, None]
        # [L 0; cross left]: a root of the covariance of what is there of Y and the rest says all
        whole = lower_factor(root[rows][:, np.concatenate([at, rest])])
        factor, cross = whole[:, :k, :k], whole[:, k:, :k]
        diagonal = np.diagonal(factor, axis1=-2, axis2=-1)
        if not diagonal.all():
            raise np.linalg.LinAlgError("an observation without any spread")
        white = solve_lower(factor, (ys[rows][:, pattern] - mean[each, at])[..., None])
        mean[each, rest] += (cross @ white)[..., 0]
        mean[each, at] = ys[rows][:, pattern]
        left[each, rest, : d - k] = whole[:, k:, k:]
        log_density[rows] = -0.5 * ((white * white).sum(axis=(-1, -2)) + k * LOG_2PI)
        log_density[rows] -= np.log(diagonal).sum(axis=-1)
    return mean, left, log_density

"""From a switching state-space model to one with an exact filter: means and offsets.

With offsets, X' = A_j X + b_j + C_j U and Y' = B_j X' + d_j + D_j V, the regressions of
`fuzzykf.switching.state_space.conversion` stay as they are, for what is left after the means.  With omega_i
and xi_i the means of the window w and of X given r_n = i,

    xi_ij = A_j xi_i + b_j,    eta_ij = B_j xi_ij + d_j,    e_ij = eta_ij - E_ij omega_i,

    Y' = E w + e + N(0, V),
    X' = (I - K B_j) (A_j X + b_j) + K (Y' - d_j) + N(0, R)        (the construction 'gain').

The means of a node are mixed from those of the pairs that lead there, and what lies between these is a part
of its covariance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairCoefficients
    from fuzzykf.switching.state_space.conversion import PairMoments, StateSpace

__all__ = ["Offsets", "PairMeans", "first_mean", "mixed_means", "pair_means", "with_offsets"]


class Offsets(NamedTuple):
    """Offsets of motion and observation, one of each per regime."""

    b: FloatArray  # (K, m)
    d: FloatArray  # (K, q)


class PairMeans(NamedTuple):
    """Means given the pair (i, j) of regimes."""

    eta: FloatArray  # (K, K, q): of Y'
    omega: FloatArray  # (K, w): of the window, given i
    xi: FloatArray  # (K, K, m): of X'


def first_mean(mean: FloatArray, B: FloatArray, d: FloatArray) -> FloatArray:
    """Mean (K, q + m) of (y_1, X_1) given each regime, from that of X_1 (K, m)."""
    return np.concatenate([_times(B, mean) + d, mean], axis=-1)


def pair_means(mean: FloatArray, space: StateSpace, offsets: Offsets) -> PairMeans:
    """Means of a step, from those of (w, X) given each regime (K, w + m)."""
    m = space.A.shape[-1]
    xi = _times(space.A, mean[:, None, -m:]) + offsets.b
    return PairMeans(_times(space.B, xi) + offsets.d, mean[:, :-m], xi)


def mixed_means(means: PairMeans, kernel: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
    """Mean (K, length + m) of (Y', w, X') given each regime, and what pairs are off it (K, K, length + m).

    Parameters
    ----------
    means : PairMeans
    kernel : ndarray, shape (K, K)
        p(r_n = i | r_{n+1} = j).
    length : int
        Components of the window to keep, those of Y' included.
    """
    K, _, q = means.eta.shape
    kept = np.broadcast_to(means.omega[:, None, : length - q], (K, K, length - q))
    each = np.concatenate([means.eta, kept, means.xi], axis=-1)
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    first = each[kernel.argmax(axis=0), np.arange(K)]
    off = each - first
    beyond = np.einsum("ij,ijk->jk", kernel, off)
    return first + beyond, off - beyond


def with_offsets(
    pairs: PairCoefficients, moments: PairMoments, means: PairMeans, space: StateSpace, offsets: Offsets
) -> PairCoefficients:
    """Add to the coefficients of the construction 'gain' what comes of means and offsets."""
    K, q, m = len(means.omega), means.eta.shape[-1], means.xi.shape[-1]
    e = means.eta - _times(moments.E, means.omega[:, None])
    remaining = np.eye(m) - moments.K @ space.B
    c = _times(remaining, np.broadcast_to(offsets.b, (K, K, m)))
    c = c - _times(moments.K, np.broadcast_to(offsets.d, (K, K, q)))
    return pairs._replace(c=c, Ny=e)


def _times(A: FloatArray, v: FloatArray) -> FloatArray:
    product: FloatArray = (A @ v[..., None])[..., 0]
    return product

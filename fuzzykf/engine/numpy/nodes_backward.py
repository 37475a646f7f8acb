"""NumPy kernel of the smoothers of IMM and GPB2 on the nodes of a switch, backward from the last observation.

What comes after n + 1 tells of X_{n+1}, given the node j of that time, by a factor: the smoothed law at j
over the filtered one, Gaussians both.  In coordinates z in which the filtered law is N(0, I), along the axes
of the smoothed covariance, with e its variance and v its mean on one of them,

    g_j(z) = exp(-(1 - e) / (2 e) z^2 + v / e z).

Merging may bring e above 1.  Where several histories meet in j it is then taken for 1: none of them is known
less well for what comes later.  (The factor of a single history is relative to just that one, and stays.)
For a history that is wider than what was merged e is at most 1 / (1 + v^2), see `_cautious`.

For each pair (i, j) the state and the next one,

    X = N(x_i, P_i),    X' = F_j X + b_j + N(0, Q_j),

are conditioned together on the observation at n + 1 and on g_j, one component after the other.  The integrals
of these likelihoods weigh the pair,

    p(i | j) = c mu_i T_ij N(y' | i, j) E[g_j | i, j, y'],

times the smoothed weight of j, and pairs are merged over j.  Kim's weights (1994) are mu_i T_ij alone.  For
one history that is the smoother of Rauch, Tung and Striebel.  Their step from the smoothed moments of j to
those of each pair takes the wider law that several histories have in common for what is known of each one; a
motion with hardly any noise then loses itself, as what is too wide grows backwards in time.

Covariances of pairs are carried as roots, from which Potter's update (1963) takes what it may and no more.
What the filter knows without error is in no z, and needs no case of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.nodes import Pairs, merged, reached, unpacked
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.engine.numpy.tables import LOG_ZERO
from fuzzykf.gaussian import LOG_2PI

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray
    from fuzzykf.engine.numpy.nodes import NodeKernel

__all__ = ["smooth_nodes"]

#: A variance given other components that is a smaller part of its own, for each state, is rounding error.
CERTAIN = 4.0 * float(np.finfo(np.float64).eps)

#: Where something is divided by it, so much more is lost.
DIVISOR = 16.0 * CERTAIN

#: A variance that is no larger part of another is as large but for rounding.
ALIKE = 1.0 + 1e-6

#: A variance that is a smaller part of what it was before an observation is rounding error.
SEEN = 1e-24

#: Columns whose cosine is smaller are at right angles.
STRAIGHT = float(np.finfo(np.float64).eps)

#: Rounds of rotations: convergence is quadratic.
SWEEPS = 30


class Factor(NamedTuple):
    """What later observations tell of X' at each of N nodes or pairs, along m axes that are independent."""

    rows: FloatArray  # (N, m, m): z = rows (x' - centre)
    centre: FloatArray  # (N, m)
    mean: FloatArray  # (N, m): v
    variance: FloatArray  # (N, m): e

    def take(self, nodes: IntArray) -> Factor:
        """Return those of some nodes."""
        return Factor(*(one[nodes] for one in self))


@QUIET
def smooth_nodes(
    kernel: NodeKernel, table: FloatArray, ys: FloatArray, by_density: bool
) -> tuple[FloatArray, IntArray]:
    """Smooth a series that has been filtered.

    Parameters
    ----------
    kernel : NodeKernel
        Of the steps into each of the observations, or of one step like all others.
    table : ndarray, shape (n, 1 + m + m*m, M)
        States after each observation.
    ys : ndarray, shape (n, q)
        NaN where missing.
    by_density : bool
        Whether weights have the likelihoods of what comes after, and are not Kim's.

    Returns
    -------
    table : ndarray, shape (n, 1 + m + m*m, M)
        States given all observations.
    path : ndarray of int, shape (n,)
        Numbers of the nodes of the most likely path.
    """
    n, _, M = table.shape
    i, j = np.nonzero(kernel.log_transition > -np.inf)  # sorted by i, which they are merged in
    pairs = Pairs(j, i, np.searchsorted(i, np.arange(M)))
    log_p, x, P = unpacked(table)
    m, smoothed, next_nodes = x.shape[-1], table.copy(), np.empty((n, M), dtype=np.intp)
    log_mu, xs, Ps = log_p[-1], x[-1], P[-1]
    score = log_mu
    for k in range(n - 2, -1, -1):
        F, b, Q, H, d, R = (one[0] for one in kernel.space.at(k + 1).take())
        met = np.bincount(j[log_p[k][i] > -np.inf], minlength=M) > 1
        factor = _factor(x[k + 1], P[k + 1], xs, Ps, _size(P[k], F, Q, i, j), met)
        pair = _joint(x[k], P[k], F, b, Q, i, j)
        log_density = _see(pair, ys[k + 1], H, d, R, j) + _look_ahead(pair, factor.take(j))
        log_w = np.full((M, M), -np.inf)
        log_w[i, j] = log_density if by_density else 0.0
        log_w[:, np.isneginf(log_mu)] = log_w[np.isneginf(log_p[k])] = -np.inf
        top = log_w.max(axis=0)
        log_w -= np.where(np.isneginf(top), 0.0, top)  # what may be large, before the weights
        log_w += log_p[k][:, None] + kernel.log_transition
        log_w -= _sum(log_w, 0)  # p(i | j)
        total = score + log_w
        next_nodes[k] = total.argmax(axis=1)
        score = total.max(axis=1)
        log_w += log_mu
        log_mu = _sum(log_w, 1)[:, 0]
        share = np.exp(log_w - np.where(np.isneginf(log_mu), 0.0, log_mu)[:, None])[i, j]
        mean, root = pair.mean[:, m:], pair.root[:, m:]
        moments = merged(share[None], mean[None], (root @ np.swapaxes(root, -1, -2))[None], pairs)
        xs, Ps = reached(log_mu, *(one[0] for one in moments))
        smoothed[k, 0] = np.maximum(log_mu, LOG_ZERO)
        smoothed[k, 1:] = np.concatenate([xs.T, Ps.reshape(M, -1).T])
    path = np.empty(n, dtype=np.intp)
    path[0] = score.argmax()
    for k in range(1, n):
        path[k] = next_nodes[k - 1, path[k - 1]]
    return smoothed, path


def _sum(log_w: FloatArray, axis: int) -> FloatArray:
    """Logarithms of sums of weights along an axis, which stays; 0 of no weight along the first."""
    top = log_w.max(axis=axis, keepdims=True)
    floor = np.where(np.isneginf(top), 0.0, top)
    total = np.exp(log_w - floor).sum(axis=axis, keepdims=True)
    none = 0.0 if axis == 0 else -np.inf  # who is not reached is divided by one
    return np.where(total > 0.0, np.log(np.where(total > 0.0, total, 1.0)) + floor, none)


# --------------------------------------------------------------------------- X' and X in pairs


class _Pair(NamedTuple):
    """The law of (X', X) in each of N pairs; conditioned in place."""

    mean: FloatArray  # (N, 2m)
    root: FloatArray  # (N, 2m, 2m): its covariance is root root'

    def along(self, row: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f = root' row and its square, the variance of row X' (rows (N, m))."""
        f = (row[:, None] @ self.root[:, : row.shape[-1]])[:, 0]
        return f, (f * f).sum(axis=-1)

    def condition(
        self, f: FloatArray, noise: FloatArray, weight: FloatArray | float, off: FloatArray
    ) -> FloatArray:
        """Take in a likelihood of one component, and return T = noise + weight f'f, which it is divided by.

        Potter's update: of root (I - weight f f' / T) root' that is root (I - c f f'), where c is
        weight / T / (1 + sqrt(noise / T)).  What is certain, and seen without noise, tells nothing.
        """
        T: FloatArray = noise + weight * (f * f).sum(axis=-1)
        over = np.divide(1.0, T, out=np.zeros_like(T), where=T > 0.0)
        reach = (self.root @ f[..., None])[..., 0]
        self.mean[...] += reach * (off * over)[:, None]
        factor = weight * over / (1.0 + np.sqrt(noise * over))
        self.root[...] -= (factor[:, None] * reach)[..., None] * f[:, None]
        return T


def _joint(
    x: FloatArray, P: FloatArray, F: FloatArray, b: FloatArray, Q: FloatArray, i: IntArray, j: IntArray
) -> _Pair:
    """Return the law of (X', X) in pairs (i, j), from X given i and the parameters of j."""
    m, lower = x.shape[-1], _root(P)[i]
    mean = np.concatenate([(F[j] @ x[i][..., None])[..., 0] + b[j], x[i]], axis=-1)
    root = np.zeros((len(i), 2 * m, 2 * m))
    root[:, :m, :m], root[:, :m, m:], root[:, m:, :m] = F[j] @ lower, _root(Q)[j], lower
    return _Pair(mean, root)


def _see(pair: _Pair, y: FloatArray, H: FloatArray, d: FloatArray, R: FloatArray, j: IntArray) -> FloatArray:
    """Condition pairs on what is there of an observation (q,); its log-densities (N,)."""
    log_density = np.zeros(len(j))
    seen = np.flatnonzero(~np.isnan(y))
    if not seen.size:
        return log_density
    noise = R[:, seen[:, None], seen]
    L, D = _factored(noise)
    H, y = _solved(L, H[:, seen]), _solved(L, (y[seen] - d[:, seen])[..., None])[..., 0]
    m = H.shape[-1]
    for a in range(seen.size):
        row = H[j, a]
        f, _ = pair.along(row)
        off = y[j, a] - (row * pair.mean[:, :m]).sum(axis=-1)
        T = pair.condition(f, D[j, a], 1.0, off)
        there = T > 0.0
        T = np.where(there, T, 1.0)
        log_density -= np.where(there, 0.5 * (off * off / T + np.log(T) + LOG_2PI), 0.0)
    return log_density


def _look_ahead(pair: _Pair, factor: Factor) -> FloatArray:
    """Condition pairs on what comes later; logarithms (N,) of its likelihood, up to a number of each node.

    With t and s the mean and the variance of an axis and T = e + (1 - e) s, that is
    -(log T + ((1 - e) (t - v)^2 - v^2 (s - e)) / T) / 2 + e v t / T.
    """
    m = factor.mean.shape[-1]
    value = np.zeros(len(factor.mean))
    for a in range(m):
        row, v, e = factor.rows[:, a], factor.mean[:, a], factor.variance[:, a]
        f, s = pair.along(row)
        t = (row * (pair.mean[:, :m] - factor.centre)).sum(axis=-1)
        e = _cautious(e, v, s)
        T = pair.condition(f, e, 1.0 - e, v - (1.0 - e) * t)
        there = T > 0.0
        T = np.where(there, T, 1.0)
        part = np.log(T) + ((1.0 - e) * (t - v) ** 2 - v * v * (s - e) - 2.0 * e * v * t) / T
        value -= np.where(there, 0.5 * part, 0.0)
    return value


# --------------------------------------------------------------------------- what later observations tell


def _factor(
    x: FloatArray, P: FloatArray, xs: FloatArray, Ps: FloatArray, size: FloatArray, met: BoolArray
) -> Factor:
    """Smoothed laws over filtered ones, of M nodes.

    ``size`` (M, m) are variances before the observation; ``met`` (M,) says where several histories meet.
    """
    L, D = _factored(P, SEEN * size, DIVISOR)
    there = D > 0.0
    scale = np.where(there, 1.0 / np.sqrt(np.where(there, D, 1.0)), 0.0)
    rows = _solved(L, np.broadcast_to(np.eye(x.shape[-1]), P.shape)) * scale[..., None]
    A = rows @ Ps @ np.swapaxes(rows, -1, -2) + np.where(there, 0.0, 1.0)[..., None] * np.eye(x.shape[-1])
    axes, variance = _axes(_root(A))
    rows = np.swapaxes(axes, -1, -2) @ rows
    variance = np.where(met[:, None], np.minimum(variance, 1.0), variance)
    return Factor(rows, x, (rows @ (xs - x)[..., None])[..., 0], variance)


def _size(P: FloatArray, F: FloatArray, Q: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """Largest variances (M, m) of X' at each node, of which those after the observation are the rest."""
    deviation = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    moved = (np.abs(F[j]) @ deviation[i][..., None])[..., 0] ** 2
    size = np.diagonal(Q, axis1=-2, axis2=-1).copy()
    np.maximum.at(size, j, moved + size[j])
    return size


def _cautious(e: FloatArray, v: FloatArray, s: FloatArray) -> FloatArray:
    """Return e of a factor (N,) as it counts for laws of variance s on its axis.

    Under the model the mean of v^2 is 1 - e: what moves a mean by v has told about v^2 of its variance,
    though the merged moments may say less.  A law as wide as the filtered one, s = 1, they carry by v and no
    more.  A wider one would be carried off by exp(v z) if nothing held it.
    """
    least = np.minimum(e, 1.0 / (1.0 + v * v))
    wider = 1.0 - ALIKE / np.maximum(s, ALIKE)
    return np.divide(e * least, least + (e - least) * wider, out=np.zeros_like(e), where=e > 0.0)


def _axes(root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return axes V (N, m, m) and variances e (N, m) of root root' = V diag(e) V'.

    One-sided rotations (Hestenes, 1958), by which small variances keep their digits.
    """
    m = root.shape[-1]
    G, V = np.swapaxes(root, -1, -2).copy(), np.broadcast_to(np.eye(m), root.shape).copy()
    for _ in range(SWEEPS if m > 1 else 0):
        turned = False
        for p in range(m - 1):
            for q in range(p + 1, m):
                a, b = (G[..., p] ** 2).sum(axis=-1), (G[..., q] ** 2).sum(axis=-1)
                g = (G[..., p] * G[..., q]).sum(axis=-1)
                turn = np.abs(g) > STRAIGHT * np.sqrt(a * b)
                if not turn.any():
                    continue
                turned = True
                zeta = (b - a) / (2.0 * np.where(turn, g, 1.0))
                t = np.where(turn, np.copysign(1.0, zeta) / (np.abs(zeta) + np.hypot(1.0, zeta)), 0.0)
                c = 1.0 / np.hypot(1.0, t)
                for one in (G, V):
                    first = one[..., p] * c[..., None] - one[..., q] * (c * t)[..., None]
                    one[..., q] = one[..., p] * (c * t)[..., None] + one[..., q] * c[..., None]
                    one[..., p] = first
        if not turned:
            break
    return V, (G * G).sum(axis=-2)


def _root(S: FloatArray) -> FloatArray:
    """L (N, m, m) with L L' = S, its columns zero where components are certain."""
    L, D = _factored(S)
    return L * np.sqrt(D)[..., None, :]


def _factored(
    S: FloatArray, floor: FloatArray | float = 0.0, certain: float = CERTAIN
) -> tuple[FloatArray, FloatArray]:
    """L (N, m, m) and D (N, m) of S = L D L', L with ones in the diagonal.

    Pivots that are rounding error, or not above ``floor`` (N, m), are zero: the components before such a one
    say all of it.
    """
    m, floor = S.shape[-1], np.broadcast_to(floor, S.shape[:-1])
    L, D = np.broadcast_to(np.eye(m), S.shape).copy(), np.zeros(S.shape[:-1])
    for a in range(m):
        pivot = S[..., a, a].copy()
        for t in range(a):
            known = (L[..., a, :t] * L[..., t, :t] * D[..., :t]).sum(axis=-1)
            there = D[..., t] > 0.0
            L[..., a, t] = np.where(there, (S[..., a, t] - known) / np.where(there, D[..., t], 1.0), 0.0)
            pivot -= L[..., a, t] ** 2 * D[..., t]
        least = np.maximum(certain * m * S[..., a, a], floor[..., a])
        D[..., a] = np.where(pivot > least, pivot, 0.0)
    return L, D


def _solved(L: FloatArray, A: FloatArray) -> FloatArray:
    """L^-1 A for L (N, m, m) with ones in the diagonal."""
    X = A.copy()
    for a in range(1, A.shape[1]):
        X[:, a] -= (L[:, a, :a, None] * X[:, :a]).sum(axis=1)
    return X

"""NumPy kernel of the gradient of the log-likelihood of IMM on the nodes of a switch, in reverse mode.

The derivative is that of the recursion of `nodes` itself, the merging of moments included.  The way back
carries, for each node j, the derivatives g of all that follows by log p_j and by the mean and the covariance
of X given the node.  With x, P before an observation, x+, P+ after it, S = H P H' + R, K = P H' S^-1,
A = I - K H, w = S^-1 (y - H x - d) and h = H' w, the differentials of these and of the log-density l are

    dx+ = A dx + A dP h + P+ dH' w - K (dH x+ + dR w + dd),
    dP+ = A dP A' + K dR K' - K dH P+ - P+ dH' K',
    dl  = w' (H dx + dH x + dd) + tr[(w w' - S^-1) dS] / 2.

Those of the moments x, P that are merged for a node, with s_i the share of node i, are with v_i = x_i - x

    dx = sum_i (s_i dx_i + ds_i v_i),
    dP = sum_i (s_i (dP_i + dx_i v_i' + v_i dx_i') + ds_i (P_i + v_i v_i')).

Weights are logarithms: what is differentiated by a logarithm is divided by the probability at the end alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.nodes import NodeSpace, filter_nodes, moved, reached, unpacked
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.gaussian import mixture_moments, solve_lower, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.numpy.nodes import NodeKernel

__all__ = ["NodeGradient", "node_gradient"]


class NodeGradient(NamedTuple):
    """A log-likelihood, and its derivatives by everything it depends on, each of the shape of that."""

    log_likelihood: float
    space: NodeSpace  # summed over the steps that share a parameter
    transition: FloatArray  # (M, M)
    probability: FloatArray  # (M,): of the first node
    mean: FloatArray  # (M, m): of X_1 given the first node
    covariance: FloatArray  # (M, m, m)


class _State(NamedTuple):
    """What is known of each node, or derivatives by it."""

    log_p: FloatArray  # (M,)
    x: FloatArray  # (M, m)
    P: FloatArray  # (M, m, m)


@QUIET
def node_gradient(kernel: NodeKernel, table: FloatArray, ys: FloatArray) -> NodeGradient:
    """Differentiate the log-likelihood that IMM gives a series.

    Entries are differentiated as if each were free, those of covariances as if they stay symmetric:
    for a symmetric change dQ, the sum of all products of entries of the gradient and dQ.

    Parameters
    ----------
    kernel : NodeKernel
        Of the steps into each of the observations, or of one step like all others; of one series.
    table : ndarray, shape (1 + m + m*m, M)
        The law of the first node and of X_1.
    ys : ndarray, shape (n, q)
        NaN where missing, n of at least one.

    Returns
    -------
    NodeGradient
        Zero by the probabilities, and by the parameters, of what has a probability of zero.  NaN, and the
        log-likelihood with it, if no node gives an observation a density.

    Raises
    ------
    ValueError
        If parameters are those of several series, or of another number of steps.
    numpy.linalg.LinAlgError
        If the covariance of an observation is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.engine.numpy.nodes import NodeSpace, pack_nodes
    >>> one = np.ones((1, 1, 1, 1, 1))  # a random walk, observed with noise
    >>> space = NodeSpace(F=one, b=0 * one[..., 0], Q=one, H=one, d=0 * one[..., 0], R=one)
    >>> law = np.array([[0.0], [0.0], [1.0]])
    >>> gradient = node_gradient(
    ...     pack_nodes(space, np.zeros((1, 1))), law, np.array([[2.0]])
    ... )
    >>> [
    ...     round(one, 3)
    ...     for one in (
    ...         gradient.log_likelihood,
    ...         gradient.mean.item(),
    ...         gradient.space.R.item(),
    ...     )
    ... ]
    [-2.266, 1.0, 0.25]
    """
    space, log_T = kernel.space, kernel.log_transition
    check_series(space, table, ys)
    tables, log_likelihood = _filtered(kernel, table, ys)
    if not np.isfinite(log_likelihood):
        return no_gradient(space)
    g_space = NodeSpace(*(np.zeros_like(one, dtype=np.float64) for one in space))
    g_log_T = np.zeros_like(log_T)
    states = [_State(*of_step) for of_step in zip(*unpacked(tables), strict=True)]
    first = _State(*(one[0] for one in unpacked(table[None])))
    g = _State(*(np.zeros_like(one) for one in first))
    for k in range(len(ys) - 1, -1, -1):
        F, b, Q, H, d, R = (one[0] for one in space.at(k).take())
        if k > 0:
            share, x, P = _mixed(states[k - 1], log_T)
            prior = moved(x, P, F, b, Q)
        else:
            prior = first.x, first.P
        seen = ~np.isnan(ys[k])
        g = _weighed_back(g, states[k].log_p, is_seen=bool(seen.any()))
        g, by_H, by_d, by_R = _updated_back(g, states[k], *prior, ys[k], H, d, R)
        for total, one in zip(g_space[3:], (by_H, by_d, by_R), strict=True):
            total[0, k % total.shape[1]] += one  # of this step, or of all
        if k == 0:
            break
        by_F = 2.0 * g.P @ F @ P + g.x[:, :, None] * x[:, None, :]
        for total, one in zip(g_space[:3], (by_F, g.x, g.P), strict=True):
            total[0, k % total.shape[1]] += one
        back = np.swapaxes(F, -1, -2)
        g = _State(g.log_p, (back @ g.x[..., None])[..., 0], symmetrize(back @ g.P @ F))
        g, by_log_T = _mixed_back(g, states[k - 1], share, x)
        g_log_T += by_log_T
    by_T, by_p = _by_probability(g_log_T, log_T), _by_probability(g.log_p, first.log_p)
    return NodeGradient(log_likelihood, g_space, by_T, by_p, g.x, g.P)


def check_series(space: NodeSpace, table: FloatArray, ys: FloatArray) -> None:
    """Refuse what does not belong to one series of one observation at least."""
    M, q, m = space.H.shape[2:]
    if ys.ndim != 2 or len(ys) < 1 or ys.shape[1] != q:
        raise ValueError(f"ys: got shape {ys.shape}, expected (n, {q}), n of at least one")
    if table.shape != (1 + m + m * m, M):
        raise ValueError(f"table: got shape {table.shape}, expected {(1 + m + m * m, M)}")
    n = len(ys)
    for name, one in zip(space._fields, space, strict=True):
        if one.shape[0] != 1 or one.shape[1] not in (1, n):
            raise ValueError(
                f"{name}: got parameters of {one.shape[:2]} series and steps, expected (1, 1) or {(1, n)}"
            )


def no_gradient(space: NodeSpace) -> NodeGradient:
    """Return what stands where there is no log-likelihood: NaN."""
    M, m = space.b.shape[2:]
    by_space = NodeSpace(*(np.full(one.shape, np.nan) for one in space))
    shapes = (M, M), (M,), (M, m), (M, m, m)
    return NodeGradient(np.nan, by_space, *(np.full(shape, np.nan) for shape in shapes))


def _filtered(kernel: NodeKernel, table: FloatArray, ys: FloatArray) -> tuple[FloatArray, float]:
    """Return the states after each of the observations (n, 1 + m + m*m, M), and the log-likelihood."""
    M = table.shape[-1]
    out = {"table": np.empty((1, len(ys), *table.shape)), "log_likelihood": np.empty((1, len(ys)))}
    order = np.array([np.arange(M), np.full(M, 2)])  # an estimate of the switch is not asked for
    switch = np.arange(M, dtype=np.float64), np.ones(M), np.ones(M, dtype=bool), order
    filter_nodes(kernel, False, table[None], True, ys[None], out, switch)
    return out["table"][0], float(out["log_likelihood"].sum())


def _by_probability(g: FloatArray, log_p: FloatArray) -> FloatArray:
    """Turn derivatives by logarithms into those by what they are of, zero where that is."""
    p = np.exp(log_p)
    return np.divide(g, p, out=np.zeros_like(g), where=p > 0.0)


# --------------------------------------------------------------------------- weights, and observations


def _weighed_back(g: _State, log_p: FloatArray, *, is_seen: bool) -> _State:
    """From log p of nodes given an observation to the sum of the logs of its density and of p before it.

    What is not seen has no part in the log-likelihood.
    """
    return g._replace(log_p=g.log_p + np.exp(log_p) * (is_seen - g.log_p.sum()))


def _updated_back(
    g: _State,
    after: _State,
    x: FloatArray,
    P: FloatArray,
    y: FloatArray,
    H: FloatArray,
    d: FloatArray,
    R: FloatArray,
) -> tuple[_State, FloatArray, FloatArray, FloatArray]:
    """From states after an observation to those before it, (M, m) and (M, m, m), and H, d and R."""
    m, q = x.shape[1], len(y)
    possible = after.log_p > -np.inf
    counts = possible[:, None] & ~np.isnan(y)  # (M, q)
    both = counts[:, :, None] & counts[:, None, :]
    # rows of zero, of what does not count, make gains and derivatives of zero
    v = np.where(counts, y - (H @ x[..., None])[..., 0] - d, 0.0)
    H = np.where(counts[..., None], H, 0.0)
    across = H @ P
    L = np.linalg.cholesky(np.where(both, symmetrize(across @ np.swapaxes(H, -1, -2) + R), np.eye(q)))
    root = solve_lower(L, np.broadcast_to(np.eye(q), L.shape))
    precision = np.where(both, np.swapaxes(root, -1, -2) @ root, 0.0)
    w = (precision @ v[..., None])[..., 0]
    gain_t = precision @ across  # K'
    gain = np.swapaxes(gain_t, -1, -2)
    A = np.eye(m) - gain @ H
    A_t, H_t = np.swapaxes(A, -1, -2), np.swapaxes(H, -1, -2)

    by_l = g.log_p[:, None]
    seen_x = (gain_t @ g.x[..., None])[..., 0]
    by_d = by_l * w - seen_x
    near_x, h = (A_t @ g.x[..., None])[..., 0], (H_t @ w[..., None])[..., 0]
    fit = 0.5 * by_l[..., None] * (_outer(w, w) - precision)
    by_P = A_t @ g.P @ A + _outer(near_x, h) + H_t @ fit @ H
    by_R = gain_t @ g.P @ gain - _outer(seen_x, w) + fit
    moved_x = (after.P @ g.x[..., None])[..., 0]
    by_H = _outer(by_d, after.x) + _outer(w, moved_x)
    by_H -= gain_t @ (2.0 * g.P @ after.P + by_l[..., None] * np.eye(m))
    return _State(g.log_p, near_x + by_l * h, symmetrize(by_P)), by_H, by_d, symmetrize(by_R)


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products a b' of vectors (M, ...)."""
    return a[:, :, None] * b[:, None, :]


# --------------------------------------------------------------------------- mixtures


def _mixed(before: _State, log_T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares (M, M) of nodes i in what leads to nodes j, and its means and covariances; zero of nothing."""
    log_w = before.log_p[:, None] + log_T
    top = log_w.max(axis=0)
    w = np.exp(log_w - np.where(np.isneginf(top), 0.0, top))
    total = w.sum(axis=0)
    share = w / np.where(total > 0.0, total, 1.0)
    M = len(share)
    x, P = (np.broadcast_to(one, (M, *one.shape)) for one in before[1:])
    return share, *reached(top, *mixture_moments(share.T, x, P))


def _mixed_back(g: _State, before: _State, share: FloatArray, x: FloatArray) -> tuple[_State, FloatArray]:
    """From merged states to those that are merged, and to the logarithms of transitions (M, M)."""
    off = before.x[:, None] - x  # (M, M, m), from i to j
    turned = (g.P @ off[..., None])[..., 0]
    # by the log of a share, less what all the shares of a node have in common, as they sum to one
    value = ((g.x + turned) * off).sum(axis=-1) + np.einsum("jab,iab->ij", g.P, before.P)
    value -= (share * value).sum(axis=0)
    by_log_w = share * (value + g.log_p)
    by_x = (share[..., None] * (g.x + 2.0 * turned)).sum(axis=1)
    return _State(by_log_w.sum(axis=1), by_x, np.einsum("ij,jab->iab", share, g.P)), by_log_w

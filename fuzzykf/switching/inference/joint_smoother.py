"""The smoother of pairwise models on the nodes of a switch, from the last observation backwards.

For a pair (i, j) of nodes at n and n + 1, with the moments z_i, P_i of Z_n and zs_j, Ps_j of Z_{n+1} given
all of y:

*Settled* nodes j are those behind which nothing of Z_n tells of the observations after n + 1, beside
y_1..n+1.  Where y_n and y_{n+1} are complete, Z_n given the pair then depends on y_1..n+1 alone:

    W_ij proportional to p_i P_ij N(y'; yhat_ij, V_ij),
    z_ij = z_i + K_ij (y' - yhat_ij),    K_ij = P_i A_j(y, .)' V_ij^-1.

For any other the step of Rauch, Tung and Striebel in each pair:

    W_ij proportional to p_i P_ij N(zs_j; zhat_ij, Phat_ij),
    z_ij = z_i + G_ij (zs_j - zhat_ij),    G_ij = P_i A_j' Phat_ij^-1.

The weights are those of p(r_{n+1} = j | y_1..N), normalised over i; then pairs are merged over j.  The first
is exact in a model whose filter is, the second if one history alone leads to j: of a single regime, and along
a known switch, whatever is missing.  Elsewhere, in a gap between several regimes or in a model that has no
exact filter, it is an approximation: Z_{n+1} is taken to be independent of i given j and y_1..N.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.fixed_lag import Nodes
from fuzzykf.gaussian import LOG_2PI, RANK_TOLERANCE, mixture_moments, symmetrize
from fuzzykf.switching.inference.method import Smoothed, out_of_range

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray
    from fuzzykf.switching.dynamics.nodes import NodeTables
    from fuzzykf.switching.inference.method import Known
    from fuzzykf.switching.inference.series import Trajectory

__all__ = ["look_back", "smooth_joint"]


@engine.QUIET
def smooth_joint(system: Any, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
    """Smooth a series that has been filtered.

    Parameters
    ----------
    system : JointSystem or JointPath
    trajectory : Trajectory
        What the filter knew, with the field ``joint``.
    ys : ndarray, shape (n, q)
        NaN where missing.

    Returns
    -------
    Smoothed
        Moments of X alone.
    """
    table = trajectory.fields["joint"]
    found = _back_through(system, table, ys, system.pair_tables)
    return Smoothed(*found, _most_likely_path(system, table, system.dim_x + system.dim_z, ys))


@engine.QUIET
def look_back(system: Any, states: Sequence[Known]) -> Nodes:
    """Smooth what was known after some observations in a row.

    Parameters
    ----------
    system : JointSystem or JointPath
    states : sequence of Known
        With tables of all of Z.

    Returns
    -------
    Nodes
        Moments of X alone.
    """
    table, ys = np.array([one.mixture.table for one in states]), np.array([one.y for one in states])
    return _back_through(system, table, ys, lambda k: states[k + 1].tables)


def _back_through(system: Any, table: FloatArray, ys: FloatArray, tables: Callable[[int], Any]) -> Nodes:
    """Go back from the last observation; ``tables`` are those of the step from each."""
    m, d = system.dim_x, system.dim_x + system.dim_z
    log_p = table[:, 0]
    z, P = (np.array(one) for one in engine.node_moments(table, d))
    mu = np.exp(log_p)
    missing = np.isnan(ys)
    seen = np.flatnonzero(~missing.all(axis=1))
    last = int(seen[-1]) if seen.size else 0  # nothing can be learned after the last observation
    for k in range(last - 1, -1, -1):
        settled = system.settled & (not missing[k : k + 2].any())
        after = mu[k + 1], z[k + 1], P[k + 1]
        mu[k], z[k], P[k] = step_back(tables(k), settled, log_p[k], z[k], P[k], ys[k + 1], *after)
    if not all(np.isfinite(part).all() for part in (mu, z, P)):
        raise out_of_range(ys[np.nanargmax(np.abs(ys).max(axis=1, where=~missing, initial=0.0))], 1e100)
    return Nodes(mu, z[..., :m], P[..., :m, :m])


def step_back(
    tables: NodeTables,
    settled: BoolArray,
    log_p: FloatArray,
    z: FloatArray,
    P: FloatArray,
    y: FloatArray,
    mu_after: FloatArray,
    z_after: FloatArray,
    P_after: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step back from n + 1 to n.

    Parameters
    ----------
    tables : NodeTables
        Of the step from n, Z being the state.
    settled : ndarray of bool, shape (M,)
        The nodes j at n + 1 to which the first form applies.
    log_p, z, P : ndarray, shapes (M,), (M, d) and (M, d, d)
        What the filter knew at n.
    y : ndarray, shape (q,)
        The observation at n + 1, NaN where missing.
    mu_after, z_after, P_after : ndarray, shapes (M,), (M, d) and (M, d, d)
        Smoothed, at n + 1.

    Returns
    -------
    mu, z, P : ndarray, shapes (M,), (M, d) and (M, d, d)
        Smoothed, at n.
    """
    log_w = log_p[:, None] + tables.log_transition
    possible = (log_p > 0.5 * engine.LOG_ZERO)[:, None] & np.isfinite(tables.log_transition)
    value = np.zeros(log_w.shape)
    means, covariances = (np.broadcast_to(a[:, None], (*log_w.shape, *a.shape[1:])).copy() for a in (z, P))
    for columns, told in ((np.flatnonzero(settled), True), (np.flatnonzero(~settled), False)):
        if columns.size:
            part = tables.F[columns], tables.b[columns], tables.Q[columns]
            after = None if told else (z_after[columns], P_after[columns])
            found = _pairs_back(*part, z, P, y, after)
            value[:, columns], means[:, columns], covariances[:, columns] = found
    # what is large is subtracted first, per column: an outlier would round the weights away
    best = np.where(possible, value, -np.inf).max(axis=0)
    log_w = np.where(possible, value - np.where(np.isfinite(best), best, 0.0) + log_w, -np.inf)
    top = log_w.max(axis=0)
    share = np.exp(log_w - np.where(np.isfinite(top), top, 0.0))
    total = share.sum(axis=0)
    joint = share / np.where(total > 0.0, total, 1.0) * mu_after
    mu = joint.sum(axis=1)
    mu /= mu.sum()
    # a node that is impossible by now keeps what the filter knew
    there = mu > 0.0
    weights = joint[there] / joint[there].sum(axis=1, keepdims=True)
    z, P = z.copy(), P.copy()
    z[there], P[there] = mixture_moments(weights, means[there], covariances[there])
    return mu, z, P


def _pairs_back(
    F: FloatArray,
    b: FloatArray,
    Q: FloatArray,
    z: FloatArray,
    P: FloatArray,
    y: FloatArray,
    after: tuple[FloatArray, FloatArray] | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-densities (M, J) and moments of Z_n in pairs (i, j), by the smoothed law after, or by y alone.

    Covariances in Joseph's form: I - K F times P_i, and what the noise and the later law add.
    """
    predicted, Phat = _moved(F, b, Q, z, P)
    across = P[:, None] @ np.swapaxes(F, -1, -2)  # Cov(Z_n, Z_n+1)
    if after is None:
        at = np.flatnonzero(~np.isnan(y)) - y.size  # from the end, where Y stands
        residual, spread = y[at] - predicted[..., at], Phat[..., at[:, None], at]
        gain, value = _regressed(across[..., at], spread, residual)
        H, noise = F[:, at], Q[:, at[:, None], at]
    else:
        residual, H, noise = after[0] - predicted, F, Q + after[1]
        gain, value = _regressed(across, Phat, residual, after[1])
    rest = np.eye(z.shape[-1]) - gain @ H
    covariance = rest @ P[:, None] @ np.swapaxes(rest, -1, -2) + gain @ noise @ np.swapaxes(gain, -1, -2)
    return value, z[:, None] + (gain @ residual[..., None])[..., 0], symmetrize(covariance)


def _moved(
    F: FloatArray, b: FloatArray, Q: FloatArray, z: FloatArray, P: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of Z_n+1 in each pair, (M, J, d) and (M, J, d, d)."""
    mean = (F @ z[:, None, :, None])[..., 0] + b
    return mean, F @ P[:, None] @ np.swapaxes(F, -1, -2) + Q


def _regressed(
    across: FloatArray, spread: FloatArray, residual: FloatArray, known: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Gain across spread^-1, and log N(residual; 0, spread), in the directions in which there is a spread.

    In the others the density is that with the covariance ``known`` of what is compared, if that is given:
    units then count for nothing where the ranks of several differ.
    """
    deviation = np.sqrt(np.maximum(np.diagonal(spread, axis1=-2, axis2=-1), 0.0))
    unit = np.where(deviation > 0.0, deviation, 1.0)
    eigenvalues, vectors = np.linalg.eigh(spread / unit[..., :, None] / unit[..., None, :])
    there = eigenvalues > RANK_TOLERANCE
    scale = np.where(there, 1.0 / np.sqrt(np.where(there, eigenvalues, 1.0)), 0.0)
    white = np.swapaxes(vectors, -1, -2) / unit[..., None, :] * scale[..., None]  # white spread white' = I
    distance = ((white @ residual[..., None])[..., 0] ** 2).sum(axis=-1)
    log_det = np.log(np.where(there, eigenvalues, 1.0)).sum(axis=-1) + 2.0 * np.log(unit).sum(axis=-1)
    value: FloatArray = -0.5 * (distance + there.sum(axis=-1) * LOG_2PI + log_det)
    if known is not None and not there.all():
        rows = np.swapaxes(vectors, -1, -2) / unit[..., None, :]
        certain = ~there[..., :, None] & ~there[..., None, :]
        variances, axes = np.linalg.eigh(np.where(certain, rows @ known @ np.swapaxes(rows, -1, -2), 0.0))
        off = np.swapaxes(axes, -1, -2) @ np.where(there[..., None], 0.0, rows @ residual[..., None])
        open_ = variances > RANK_TOLERANCE * variances.max(axis=-1, keepdims=True, initial=0.0)
        variances = np.where(open_, variances, 1.0)
        part = off[..., 0] ** 2 / variances + np.log(variances) + LOG_2PI
        value = value - 0.5 * np.where(open_, part, 0.0).sum(axis=-1)
    gain: FloatArray = across @ np.swapaxes(white, -1, -2) @ white
    return gain, value


def _most_likely_path(system: Any, table: FloatArray, d: int, ys: FloatArray) -> IntArray:
    """Viterbi's algorithm on (R, Y), by the density of each observation in each pair."""
    n, M = len(ys), table.shape[-1]
    path = np.zeros(n, dtype=np.int64)
    if n == 0:
        return path
    z, P = engine.node_moments(table, d)
    score, pointers = table[0, 0], np.empty((n - 1, M), dtype=np.int64)
    for k in range(n - 1):
        tables = system.pair_tables(k)
        predicted, Phat = _moved(tables.F, tables.b, tables.Q, z[k], P[k])
        at = np.flatnonzero(~np.isnan(ys[k + 1])) - ys.shape[1]
        value = np.zeros((len(score), M))
        if at.size:
            spread, residual = Phat[..., at[:, None], at], ys[k + 1, at] - predicted[..., at]
            _, value = _regressed(spread[..., :0, :], spread, residual)
        total = score[:, None] + (tables.log_transition + value)
        pointers[k] = total.argmax(axis=0)
        score = total.max(axis=0)
        score = score - score.max()
    path[-1] = int(score.argmax())
    for k in range(n - 2, -1, -1):
        path[k] = pointers[k, path[k + 1]]
    return path

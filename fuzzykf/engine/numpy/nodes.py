"""NumPy kernels of IMM and GPB2 on the nodes of a switch: state-space models whose parameters follow it.

The state of a filter is what is known of every node j after the latest observation, as in `switching`:
``table`` (1 + m + m*m, M) holds the logarithm of its probability, the mean and the covariance of X given the
node.  With the parameters F, b, Q, H, d, R of the node of arrival j, and i the node before,

    X' = F_j X + b_j + N(0, Q_j),    Y' = H_j X' + d_j + N(0, R_j).

IMM merges what leads to one node before it moves (mix, predict, update, weigh); GPB2 moves and updates
every pair (i, j) and merges what ends in one node after that.  Missing components are NaN, in any
pattern, and count for nothing; so series with and without gaps go side by side.

Weights are logarithms.  Differences of the log-densities of an observation come first and what is small is
added after, in each column to that of its own best pair: an outlier would round the rest away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.imm import weigh_modes
from fuzzykf.engine.numpy.kalman import PIVOT_TOLERANCE
from fuzzykf.engine.numpy.outliers import QUIET
from fuzzykf.engine.numpy.series import summarise
from fuzzykf.engine.numpy.tables import DEAD, LOG_ZERO
from fuzzykf.gaussian import LOG_2PI, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "NodeKernel",
    "NodeSpace",
    "before_node_step",
    "filter_nodes",
    "first_node_step",
    "node_step",
    "pack_nodes",
]

#: Numbers that the states of a chunk of observations, which are summarised at once, may hold.
_NUMBERS = 1 << 18

#: Numbers that the pairs of nodes of a block of series may hold.
_BLOCK = 1 << 20


class NodeSpace(NamedTuple):
    """Parameters of steps: axes s for series and n for steps are of length 1 where they are shared."""

    F: FloatArray  # (s, n, M, m, m)
    b: FloatArray  # (s, n, M, m)
    Q: FloatArray  # (s, n, M, m, m)
    H: FloatArray  # (s, n, M, q, m)
    d: FloatArray  # (s, n, M, q)
    R: FloatArray  # (s, n, M, q, q)

    def at(self, step: int, series: slice = slice(None)) -> NodeSpace:
        """Return the parameters of one step of some series, with an axis of length 1 for it."""
        parts = (one[series] if len(one) > 1 else one for one in self)
        return NodeSpace(*(one[:, step, None] if one.shape[1] > 1 else one for one in parts))

    def take(self, nodes: IntArray | slice = slice(None)) -> tuple[FloatArray, ...]:
        """Return the parameters of one step, without its axis, at some nodes: (s, len(nodes), ...)."""
        return tuple(one[:, 0, nodes] for one in self)


class NodeKernel(NamedTuple):
    """Parameters of steps, and who leads where: made once, whatever the number of steps."""

    space: NodeSpace
    log_transition: FloatArray  # (M, M)
    pairs: Pairs


class Pairs(NamedTuple):
    """The pairs of nodes that can follow one another, sorted by the node of arrival."""

    before: IntArray  # (N,)
    after: IntArray  # (N,)
    begins: IntArray  # (M,): of the pairs of each node; each has one


# --------------------------------------------------------------------------- steps


def pack_nodes(space: NodeSpace, log_transition: FloatArray) -> NodeKernel:
    """Bring parameters into the form that steps read.

    Parameters
    ----------
    space : NodeSpace
        Of one step, or of those into each of a number of observations; of one series, or of each.
    log_transition : ndarray, shape (M, M)
        From row i to column j; minus infinity where impossible.
    """
    return NodeKernel(space, log_transition, _pairs_of(log_transition))


@QUIET
def first_node_step(kernel: NodeKernel, table: FloatArray, ys: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Condition the law of the first node and of X_1 on the first observation of each of several series.

    Parameters
    ----------
    kernel : NodeKernel
        Of one step, of which H, d and R count.
    table : ndarray, shape (s, 1 + m + m*m, M)
        The law before it.
    ys : ndarray, shape (s, q)
        NaN where missing.

    Returns
    -------
    table : ndarray, shape (s, 1 + m + m*m, M)
    log_likelihood : ndarray, shape (s,)
        Of what is there of the observation; 0 if nothing is.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance of an observation is not positive definite.
    """
    return _begun(kernel.space, table, ys)


@QUIET
def node_step(
    kernel: NodeKernel, every_pair: bool, table: FloatArray, ys: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move the states of several series to their next observations.

    Parameters
    ----------
    kernel : NodeKernel
        Of one step.
    every_pair : bool
        Whether every pair of nodes is updated (GPB2), and not every node (IMM).
    table, ys
        As in `first_node_step`.

    Returns
    -------
    table, log_likelihood
        As from `first_node_step`.

    Raises
    ------
    numpy.linalg.LinAlgError
        As from `first_node_step`.
    """
    predicted = _predicted(kernel, kernel.space, every_pair, table)
    return _seen(kernel.space, kernel.pairs, every_pair, predicted, ys)


@QUIET
def before_node_step(kernel: NodeKernel, table: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Say what is known of the next time before its observation is seen: the same for IMM and GPB2.

    Parameters
    ----------
    kernel, table
        As in `node_step`.

    Returns
    -------
    mu : ndarray, shape (s, M)
    x, P : ndarray, shapes (s, M, m) and (s, M, m, m)
        Given each node.
    """
    log_c, x, P = _predicted(kernel, kernel.space, False, table)
    return np.exp(log_c), x, P


# --------------------------------------------------------------------------- whole series


@QUIET
def filter_nodes(
    kernel: NodeKernel,
    every_pair: bool,
    table: FloatArray,
    begins: bool,
    ys: FloatArray,
    out: dict[str, FloatArray],
    switch: tuple[FloatArray, FloatArray, BoolArray, IntArray],
) -> tuple[FloatArray, FloatArray]:
    """Filter several series.

    One series gives the same numbers to the bit whether it is filtered at once or in parts.

    Parameters
    ----------
    kernel : NodeKernel
        Of the steps into these observations.
    every_pair
        As in `node_step`.
    table : ndarray, shape (s, 1 + m + m*m, M)
        The state of each series before them, or the law of the first node and of X_1.
    begins : bool
        Whether the first of these observations is the first of all, before which nothing moves.
    ys : ndarray, shape (s, n, q)
        NaN where missing, n of at least one.
    out : dict of str to ndarray, shape (s, n, ...)
        Filled in: fields of a result, and ``table``.
    switch : tuple
        The arguments of `most_likely` beside the probabilities.

    Returns
    -------
    before, last : ndarray, shape (s, 1 + m + m*m, M)
        The states before and after the last observation.

    Raises
    ------
    numpy.linalg.LinAlgError
        As from `first_node_step`.
    """
    s, n, _ = ys.shape
    rows, M = table.shape[1:]
    space, pairs = kernel.space, kernel.pairs
    size = max(1, _BLOCK // (rows * len(pairs.after)))
    before, last = np.empty_like(table), np.empty_like(table)
    for a in range(0, s, size):
        block = slice(a, min(a + size, s))
        part = {name: values[block] for name, values in out.items()}
        chunk = max(1, _NUMBERS // ((block.stop - a) * rows * M))
        now = table[block]
        for start in range(0, n, chunk):
            stop = min(start + chunk, n)
            tables = np.empty((len(now), stop - start, rows, M))
            log_likelihood = np.empty(tables.shape[:2])
            for k in range(start, stop):
                here, y = space.at(k, block), ys[block, k]
                before[block] = now
                if begins and k == 0:
                    _store_prior(part, k, unpacked(now))
                    now, found = _begun(here, now, y)
                else:
                    predicted = _predicted(kernel, here, every_pair, now)
                    _store_prior(part, k, predicted)
                    now, found = _seen(here, pairs, every_pair, predicted, y)
                tables[:, k - start], log_likelihood[:, k - start] = now, found
            summarise(part, slice(start, stop), tables, None, log_likelihood, switch)
        last[block] = now
    return before, last


def _store_prior(
    out: dict[str, FloatArray], k: int, predicted: tuple[FloatArray, FloatArray, FloatArray]
) -> None:
    """Fill in the moments of the state before observation ``k``."""
    if "x_prior" not in out and "P_prior" not in out:
        return
    log_w, x, P = predicted
    one = np.zeros(log_w.shape[1], dtype=np.intp)
    moments = merged(np.exp(log_w), x, P, Pairs(one, one, one[:1]))
    for name, moment in zip(("x_prior", "P_prior"), moments, strict=True):
        if name in out:
            out[name][:, k] = moment[:, 0]


# --------------------------------------------------------------------------- parts of a step


def unpacked(table: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-probabilities (s, M), minus infinity of zero, means (s, M, m) and covariances (s, M, m, m)."""
    moments = np.swapaxes(table[:, 1:], 1, 2)
    s, M, size = moments.shape
    m = int((np.sqrt(4.0 * size + 1.0) - 1.0) / 2.0 + 0.5)
    log_p = np.where(table[:, 0] <= DEAD, -np.inf, table[:, 0])
    return log_p, moments[..., :m], moments[..., m:].reshape(s, M, m, m)


def _begun(space: NodeSpace, table: FloatArray, ys: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take first observations into account, before which nothing moves."""
    log_p, x, P = unpacked(table)
    _, _, _, H, d, R = space.take()
    return _weighed(log_p, *_updated(x, P, ys, H, d, R, log_p > -np.inf), ys)


def moved(
    x: FloatArray, P: FloatArray, F: FloatArray, b: FloatArray, Q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean F x + b and covariance F P F' + Q of the state after a step."""
    return (F @ x[..., None])[..., 0] + b, symmetrize(F @ P @ np.swapaxes(F, -1, -2) + Q)


def reached(log_p: FloatArray, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Moments of nodes, of zero where no path leads: they might grow without bound."""
    lost = np.isneginf(log_p)
    if not lost.any():
        return x, P
    return np.where(lost[..., None], 0.0, x), np.where(lost[..., None, None], 0.0, P)


def _predicted(
    kernel: NodeKernel, space: NodeSpace, every_pair: bool, table: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move states (GPB2: of every pair) to the next time; log-probabilities, means and covariances there.

    What leads to one node is merged before it moves (IMM), or not at all yet (GPB2).
    """
    log_p, x, P = unpacked(table)
    i, j, _ = kernel.pairs
    log_w, x, P = log_p[:, i] + kernel.log_transition[i, j], x[:, i], P[:, i]
    if not every_pair:
        log_w, share = _shares(log_w, kernel.pairs)
        x, P = merged(share, x, P, kernel.pairs)
    F, b, Q, *_ = space.take(j if every_pair else slice(None))
    x, P = moved(x, P, F, b, Q)
    return log_w, *((x, P) if every_pair else reached(log_w, x, P))


def _seen(
    space: NodeSpace,
    pairs: Pairs,
    every_pair: bool,
    predicted: tuple[FloatArray, FloatArray, FloatArray],
    ys: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Take observations (s, q) into account, and merge the pairs that end in one node (GPB2)."""
    log_w, x, P = predicted
    j = pairs.after
    _, _, _, H, d, R = space.take(j if every_pair else slice(None))
    possible = log_w > -np.inf
    x, P, log_density = _updated(x, P, ys, H, d, R, possible)
    if every_pair:
        best = np.maximum.reduceat(np.where(possible, log_density, -np.inf), pairs.begins, axis=1)
        best = np.where(np.isneginf(best), 0.0, best)
        log_w, share = _shares(log_w + (log_density - best[:, j]), pairs)
        x, P = merged(share, x, P, pairs)
        log_density = best
    return _weighed(log_w, x, P, log_density, ys)


def _shares(log_w: FloatArray, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Logarithms of the sums of weights (s, N) that end in each node, (s, M), and their shares in these.

    A node that no path reaches takes over its first pair, whatever that is.
    """
    _, j, begins = pairs
    top = np.maximum.reduceat(log_w, begins, axis=1)
    there = ~np.isneginf(top)
    floor = np.where(there, top, 0.0)
    share = np.exp(log_w - floor[:, j])
    total = np.add.reduceat(share, begins, axis=1)
    if there.all():
        return np.log(total) + floor, share / total[:, j]
    first = np.zeros_like(share)
    first[:, begins] = 1.0
    share = np.where(there[:, j], share / np.where(there, total, 1.0)[:, j], first)
    return np.where(there, np.log(np.where(there, total, 1.0)) + floor, -np.inf), share


def merged(share: FloatArray, x: FloatArray, P: FloatArray, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Mean (s, M, m) and covariance of the pairs that end in each node, by central moments."""
    _, j, begins = pairs
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    likeliest = share >= np.maximum.reduceat(share, begins, axis=1)[:, j]
    number = np.where(likeliest, np.arange(len(j)), len(j))
    reference = np.minimum(np.minimum.reduceat(number, begins, axis=1), len(j) - 1)  # where all is NaN
    centre = np.take_along_axis(x, reference[..., None], axis=1)
    off = x - centre[:, j]
    beyond = np.add.reduceat(share[..., None] * off, begins, axis=1)
    off -= beyond[:, j]
    spread = P + off[..., :, None] * off[..., None, :]
    return centre + beyond, np.add.reduceat(share[..., None, None] * spread, begins, axis=1)


def _updated(
    x: FloatArray,
    P: FloatArray,
    ys: FloatArray,
    H: FloatArray,
    d: FloatArray,
    R: FloatArray,
    possible: BoolArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition states (s, N, ...) on what is there of observations (s, q).

    Returns means, covariances in Joseph's form, and log-densities of the observations (s, N).  What is
    impossible is not asked to have a density.
    """
    m, q = x.shape[-1], ys.shape[-1]
    y = ys[:, None] - (H @ x[..., None])[..., 0] - d
    across = H @ P  # Cov(Y, X)
    S = symmetrize(across @ np.swapaxes(H, -1, -2) + R)
    count: FloatArray | int = q
    seen: BoolArray = ~np.isnan(ys)
    if not seen.all():
        y = np.where(seen[:, None], y, 0.0)
        across = np.where(seen[:, None, :, None], across, 0.0)
        S = np.where((seen[:, :, None] & seen[:, None, :])[:, None], S, np.eye(q))
        count = seen.sum(axis=1)[:, None].astype(np.float64)
    if not possible.all():
        S = np.where(possible[..., None, None], S, np.eye(q))
    if q == 1:
        variance = S[..., 0, 0]
        if not (variance > 0.0).all():
            raise np.linalg.LinAlgError("the covariance of an observation is not positive definite")
        gain = np.swapaxes(across, -1, -2) / S
        distance, log_det = y[..., 0] ** 2 / variance, np.log(variance)
    else:
        L = np.linalg.cholesky(S)
        pivots = np.diagonal(L, axis1=-2, axis2=-1) ** 2
        if not (pivots > PIVOT_TOLERANCE * np.diagonal(S, axis1=-2, axis2=-1)).all():
            raise np.linalg.LinAlgError("the covariance of an observation is singular, to rounding error")
        white = np.linalg.solve(L, np.concatenate([y[..., None], across], axis=-1))
        gain = np.swapaxes(np.linalg.solve(np.swapaxes(L, -1, -2), white[..., 1:]), -1, -2)
        distance = (white[..., 0] ** 2).sum(axis=-1)
        log_det = 2.0 * np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(axis=-1)
    rest = np.eye(m) - gain @ H
    # a gain of zero where nothing is seen leaves R there out of account
    P = symmetrize(rest @ P @ np.swapaxes(rest, -1, -2) + gain @ R @ np.swapaxes(gain, -1, -2))
    log_density: FloatArray = -0.5 * (distance + count * LOG_2PI + log_det)
    return x + (gain @ y[..., None])[..., 0], P, log_density


def _weighed(
    log_prior: FloatArray, x: FloatArray, P: FloatArray, log_density: FloatArray, ys: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bayes' rule for the nodes; the states that follow, and the log-likelihoods of the observations."""
    log_p, log_likelihood = weigh_modes(log_prior, log_density)
    log_p = log_p - np.log(np.exp(log_p).sum(axis=1, keepdims=True))  # rounding of large differences
    nothing = np.isnan(ys).all(axis=1)
    s, M, m = x.shape
    x, P = reached(log_p, x, P)
    table = np.empty((s, 1 + m + m * m, M))
    table[:, 0] = np.maximum(log_p, LOG_ZERO)  # NaN, where no node gives the observation a density, stays
    table[:, 1 : 1 + m] = np.swapaxes(x, 1, 2)
    table[:, 1 + m :] = np.swapaxes(P.reshape(s, M, m * m), 1, 2)
    return table, np.where(nothing, 0.0, log_likelihood)


def _pairs_of(log_transition: FloatArray) -> Pairs:
    """Return the pairs that can be; of a node that none leads to, the one with itself."""
    possible = log_transition > -np.inf
    lost = np.flatnonzero(~possible.any(axis=0))
    possible[lost, lost] = True
    after, before = np.nonzero(possible.T)
    return Pairs(before, after, np.searchsorted(after, np.arange(len(log_transition))))

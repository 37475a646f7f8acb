"""The exact recursion of every switching filter (2020 paper, section IV; math of a step).

State per node i: log p(r_n = i | y_1..n), and mean and covariance of X_n given
(r_n = i, y_1..n).  With the tables of a step (`fuzzykf.switching.dynamics.pairs`), the
window w of the latest observations and the new observation y':

    log w_ij = log p_i + log P_ij + log N(y'; Ayy w + Ny, Qyy)                  (10)
    log p(y' | y_1..n) = logsumexp of all log w_ij                              (11)
    p'_j = sum_i w_ij / sum of all w                                            (13)
    o_ij = w_ij / sum_k w_kj                                                    (14)
    x_ij = Axx x_i + H w + G y' + c,    P_ij = Axx P_i Axx' + C            (15)-(18)
    x'_j = sum_i o_ij x_ij                                                      (19)
    P'_j = sum_i o_ij (P_ij + (x_ij - x'_j)(x_ij - x'_j)')                      (20)
    x = sum_j p'_j x'_j, and P likewise                                    (21)-(22)

Second moments are central, unlike in the paper, where they cancel.  The arithmetic
is in `fuzzykf.engine`; the functions here give it its meaning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import QuadratureError
from fuzzykf.gaussian import cholesky, mixture_moments, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = [
    "NodeState",
    "advance",
    "advance_all",
    "first_observation",
    "node_moments",
    "node_probabilities",
    "posterior_mean",
    "posterior_moments",
    "predict_observation",
    "predict_state",
]

#: Largest total of negative masses that a rule with negative weights may produce.
NEGATIVE_MASS = 1e-2


class NodeState(NamedTuple):
    """What is known of each node after an observation; leading shape (...)."""

    table: FloatArray  # (..., 1 + m + m*m, M): log-probability, mean, covariance
    sign: FloatArray | None = None  # (..., M), only for chains with negative weights
    mass: FloatArray | None = None  # (..., M): the probabilities, where the engine carries them, too


def first_observation(law: InitialLaw, y: FloatArray) -> tuple[NodeState, float]:
    """Condition the law of (r_1, Z_1) on y_1; there are no dynamics before it."""
    from fuzzykf.switching.dynamics.pairs import log_probability

    m = law.mean.shape[1] - y.size
    factor = cholesky(
        law.covariance[:, m:, m:], lambda k: f"covariance of the first observation, node {k[0]}"
    )
    table, log_likelihood = engine.first_step(
        log_probability(law.probability), law.mean, law.covariance, factor, y
    )
    return NodeState(table), log_likelihood


def advance(
    tables: PairTables, state: NodeState, window: FloatArray, y: FloatArray
) -> tuple[NodeState, float]:
    """Take the next observation ``y`` (q,) into account, given the window (w,) before it."""
    table, sign, log_likelihood = engine.step(tables.kernel, state.table, state.sign, window, y)
    new = NodeState(table, sign)
    if sign is not None:
        _check_masses(new)
    return new, log_likelihood


def advance_all(
    tables: PairTables, state: NodeState, windows: FloatArray, ys: FloatArray
) -> tuple[NodeState, FloatArray]:
    """Run `advance` along n observations with constant tables.

    Parameters
    ----------
    windows, ys : ndarray, shapes (n, w) and (n, q)

    Returns
    -------
    states : NodeState
        With leading shape (n,).
    log_likelihood : ndarray, shape (n,)
    """
    U = np.concatenate([np.ones((len(ys), 1)), windows, ys], axis=1)
    table, sign, log_likelihood = engine.run(tables.kernel, state.table, state.sign, U)
    states = NodeState(table, sign)
    if sign is not None:
        _check_masses(states)
    return states, log_likelihood


def log_pair_weights(tables: PairTables, windows: FloatArray, ys: FloatArray) -> FloatArray:
    """Log |P_ij| + log N(y'; Ayy w + Ny, Qyy) of n steps with the same tables, (n, M1, M2)."""
    U = np.concatenate([np.ones((len(ys), 1)), windows, ys], axis=1)
    return engine.log_pairs(tables.kernel, U).reshape(len(ys), *tables.transition.shape)


def _check_masses(state: NodeState) -> None:
    negative = np.maximum(-node_probabilities(state), 0.0).sum(axis=-1)
    if not (negative <= NEGATIVE_MASS).all():  # NaN where the total is not positive
        worst = f"a negative mass of {np.max(negative):.3g} (at most {NEGATIVE_MASS} is tolerated)"
        if np.isnan(negative).any():
            worst = "no positive mass"
        raise QuadratureError(
            "the rule 'product' is too coarse for this law and these observations: its interpolant has "
            f"{worst}; use more nodes or the rule 'cell', whose weights are never negative"
        )


# --------------------------------------------------------------------------- summaries


def node_probabilities(state: NodeState) -> FloatArray:
    """p(r_n = i | y_1..n), shape (..., M)."""
    if state.mass is not None:
        return state.mass.copy()
    p = np.exp(state.table[..., 0, :])
    return p if state.sign is None else p * state.sign


def node_moments(state: NodeState, m: int) -> tuple[FloatArray, FloatArray]:
    """Means (..., M, m) and covariances (..., M, m, m) of X_n given each node."""
    flat = np.swapaxes(state.table[..., 1:, :], -1, -2)
    return flat[..., :m], flat[..., m:].reshape(*flat.shape[:-1], m, m)


def posterior_mean(state: NodeState, m: int) -> FloatArray:
    """Mean (m,) of X_n given y_1..n (eq. 21), for a single state."""
    return engine.node_mean(node_probabilities(state), state.table[1 : 1 + m])


def posterior_moments(state: NodeState, m: int) -> tuple[FloatArray, FloatArray]:
    """Mean (..., m) and covariance (..., m, m) of X_n given y_1..n (eqs. 21 and 22)."""
    return mixture_moments(node_probabilities(state), *node_moments(state, m))


def predict_state(tables: PairTables, state: NodeState, window: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (..., m) and covariance (..., m, m) of X_{n+1} given y_1..n.

    Parameters
    ----------
    tables : PairTables
    state : NodeState
        Leading shape (...).
    window : ndarray, shape (..., w)
    """
    m, (M1, M2), prior = tables.pairs.dim_x, tables.transition.shape, tables.prior
    p = node_probabilities(state)
    x, P = node_moments(state, m)
    lead = p.shape[:-1]
    # x_ij of each pair, and the central moments of their mixture
    constant = prior.offset[0] + window @ prior.offset[1:]
    mean = (constant + x.reshape(*lead, M1 * m) @ prior.carried).reshape(*lead, M1 * M2, m)
    weights = (p[..., :, None] * tables.transition).reshape(*lead, M1 * M2)
    centre = np.einsum("...p,...pk->...k", weights, mean)
    mean -= centre[..., None, :]
    between = np.einsum("...pk,...pl->...kl", weights[..., None] * mean, mean)
    within = (p[..., None, None] * P).reshape(*lead, -1) @ prior.twice + p @ prior.noise
    return centre, symmetrize(between + within.reshape(*lead, m, m))


def predict_observation(
    tables: PairTables, state: NodeState, window: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (q,) and covariance (q, q) of Y_{n+1} given y_1..n."""
    pairs = tables.pairs
    weights = node_probabilities(state)[:, None] * tables.transition
    mean = pairs.Ayy @ window + pairs.Ny
    q, M = pairs.dim_z, weights.size
    return mixture_moments(weights.reshape(M), mean.reshape(M, q), pairs.Qyy.reshape(M, q, q))


def predict_probabilities(tables: PairTables, state: NodeState) -> FloatArray:
    """p(r_{n+1} = j | y_1..n), shape (M2,)."""
    p: FloatArray = node_probabilities(state) @ tables.transition
    return p


# --------------------------------------------------------------------------- the switch


def most_likely_switch(chain: SwitchChain, mu: FloatArray) -> FloatArray:
    """MPM estimate of the switch, by the rule of the paper (section VI-B).

    If the hard values together have more than half of the probability, the likelier of
    them; else the node in between with the largest density (mass divided by weight).

    Parameters
    ----------
    chain : SwitchChain
    mu : ndarray, shape (..., M)

    Returns
    -------
    ndarray, shape (...)
    """
    hard_nodes = chain.atoms
    atoms, inner = np.flatnonzero(hard_nodes)[::-1], np.flatnonzero(~hard_nodes)
    # on a tie the paper's rule takes the regime 1, hence the reversed order
    hard = soft = np.empty(0)
    if atoms.size:
        hard = chain.nodes[atoms][np.argmax(mu[..., atoms], axis=-1)]
    if inner.size:
        soft = chain.nodes[inner][np.argmax(mu[..., inner] / chain.weights[inner], axis=-1)]
    if not (atoms.size and inner.size):
        return hard if atoms.size else soft
    estimate: FloatArray = np.where(mu[..., atoms].sum(axis=-1) > 0.5, hard, soft)
    return estimate

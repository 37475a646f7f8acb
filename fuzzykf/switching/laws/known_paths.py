"""Laws from paths of a switch that is known: by their density, or by the cells that the values are in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chain import value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["count_nodes", "maximise_density"]

_SEARCH = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 4000, "maxfev": 4000}

#: At most so many simplices, until one gains no more than this in the mean log-likelihood.
_SIMPLICES, _LITTLE = 20, 1e-9


def maximise_density(
    make: Callable[[FloatArray], Any], n_free: int, before: FloatArray, after: FloatArray
) -> Any:
    """Return the law of largest likelihood of transitions: the product of p(r_n+1 | r_n).

    Parameters
    ----------
    make : callable
        From ``n_free`` numbers to a law.
    n_free : int
    before, after : ndarray, shape (n,)
        The switch before and after each transition, hard and fuzzy.
    """
    from scipy.optimize import minimize

    pairs, counts = np.unique(np.stack([before, after]), axis=1, return_counts=True)

    def loss(logits: FloatArray) -> float:
        law = make(np.clip(logits, -40.0, 40.0))
        joint, marginal = law.joint_density(pairs[0], pairs[1]), law.marginal_density(pairs[0])
        with np.errstate(divide="ignore"):
            log_p = np.log(np.maximum(joint, 1e-300)) - np.log(marginal)
        return -float(counts @ log_p) / float(counts.sum())

    x, best = np.zeros(n_free), np.inf
    for _ in range(_SIMPLICES):  # a simplex may collapse on a slope; one that starts anew goes on from there
        found = minimize(loss, x, method="Nelder-Mead", options=_SEARCH)
        gained, x, best = best - found.fun, found.x, float(found.fun)
        if gained <= _LITTLE:
            break
    return make(np.clip(x, -40.0, 40.0))


def count_nodes(paths: Sequence[FloatArray], chain: SwitchChain) -> tuple[FloatArray, FloatArray]:
    """Count the transitions between the nodes of a chain, each value being taken for the nearest node.

    Parameters
    ----------
    paths : sequence of ndarray, shape (n, K)
        Class weights along the switch.
    chain : SwitchChain
        Of which no two nodes have one value.

    Returns
    -------
    pairs : ndarray, shape (M, M)
    first : ndarray, shape (M,)
        How often a path begins in each node.

    Raises
    ------
    ParameterError
        If a value is between classes between which the chain has no node, or a step is impossible.
    """
    M = len(chain)
    if len(chain.by_value(chain.initial)[0]) < M:
        raise ParameterError(
            "law: got one with several nodes of one value, which a known switch does not tell apart; "
            "expected a law of one node a value, or a FadeLaw"
        )
    pairs, first = np.zeros((M, M)), np.zeros(M)
    for path in paths:
        nodes = _nearest(path, chain.class_weights)
        np.add.at(pairs, (nodes[:-1], nodes[1:]), 1.0)
        first[nodes[0]] += 1.0
    impossible = (pairs > 0.0) & (chain.transition == 0.0)
    if impossible.any():
        i, j = np.argwhere(impossible)[0]
        raise ParameterError(
            f"r: goes from about {value_of(chain.class_weights[i])} to {value_of(chain.class_weights[j])} "
            "in a step, which the law says is impossible; expected a law that has such steps"
        )
    return pairs, first


def _nearest(path: FloatArray, class_weights: FloatArray) -> IntArray:
    """Return the number of the node nearest to each value, among those between the same classes."""
    between, there = path > 0.0, class_weights > 0.0
    alike = (between[:, None] == there).all(axis=-1)
    off = ~alike.any(axis=1)
    if off.any():
        row = int(off.argmax())
        raise ParameterError(
            f"r: got {value_of(path[row])}, a value between classes that do not fade into one another in the "
            "law; expected values at the classes and on the ways between them that the law has"
        )
    away = np.abs(path[:, None] - class_weights).sum(axis=-1)
    found: IntArray = np.where(alike, away, np.inf).argmin(axis=1)
    return found

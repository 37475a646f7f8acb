"""Where expectation-maximisation begins: guesses of the switch from the data alone."""

from __future__ import annotations

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.switching.laws.base import NODES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.laws.base import Law
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.em import Posterior

__all__ = ["arrangements", "classes", "faded", "guesses", "named_guesses", "passages", "soften", "spread"]

#: Classes of which all orders are looked through; of more, those to which no exchange of two adds anything.
ALL_ORDERS = 7

#: How many ways to name the classes a search begins with.
WAYS = 4

#: Fades of at least so many steps on average are looked for.
GRADUAL = 3.0

#: How long fades are guessed to be where a law says nothing of them.
USUAL = 8

#: Guesses that differ by less, on average over rows and classes, are one.
ALIKE = 0.01

#: A probability of less is what rounding left of zero.
ROUNDING = 1e-14

#: What a law says is impossible counts as this likely where classes are named.
UNLIKELY = 1e-6


def guesses(data: TrainingData, n_starts: int, rng: np.random.Generator | None) -> list[FloatArray]:
    """Sequences in [0, 1] that follow the data, each a guess of the switch.

    The first ones are ranks of the first principal component of y, of (x, y), of x, and
    of the size of the steps; the others are ranks of random directions.  Where x is not known, what y says
    of it linearly stands for it.

    Parameters
    ----------
    data : TrainingData
    n_starts : int
    rng : numpy.random.Generator, optional
        For more than four starts.

    Returns
    -------
    list of ndarray, shape (N,)
        Each oriented so that it rises with the first component of y.
    """
    m = data.dim_x
    z = data.z if data.is_complete else _completed(data)
    steps = np.zeros(len(z))
    steps[data.after] = np.linalg.norm(z[data.after] - z[data.before], axis=1)
    scores = [_principal(z[:, m:]), _principal(z), _principal(z[:, :m]), steps]
    while len(scores) < n_starts and rng is not None:
        scores.append(z @ rng.standard_normal(z.shape[1]))
    return [_oriented(_rank(s), z[:, m]) for s in scores[:n_starts]]


def _completed(data: TrainingData) -> FloatArray:
    """Put the linear regression of x on y in the place of states that are not known."""
    m, known = data.dim_x, data.known
    design = np.concatenate([np.ones((len(data.z), 1)), data.z[:, m:]], axis=1)
    coefficients = np.linalg.lstsq(design[known], data.z[known, :m], rcond=None)[0]
    z = data.z.copy()
    z[~known, :m] = design[~known] @ coefficients
    return z


def spread(rank: FloatArray) -> FloatArray:
    """Turn ranks into a switch that is hard in half of the data."""
    r: FloatArray = np.clip((rank - 0.25) / 0.5, 0.0, 1.0)
    return r


def classes(rank: FloatArray, K: int) -> FloatArray:
    """Turn ranks into regimes of equal size."""
    regime = np.minimum((rank * K).astype(int), K - 1)
    return soften(np.eye(K)[regime])


def arrangements(pairs: FloatArray, joint: FloatArray) -> list[tuple[int, ...]]:
    """Return the likeliest ways to name hidden regimes after the classes of a law.

    Names matter only as far as the law does: of all that put the regimes at the same places of its graph
    there is one, the likeliest.

    Parameters
    ----------
    pairs : ndarray, shape (K, K)
        Expected numbers of transitions between the regimes.
    joint : ndarray, shape (K, K)
        Joint probabilities of two consecutive classes in the law.

    Returns
    -------
    list of tuple of int
        Regime k is class ``names[k]``; the likeliest first.

    Examples
    --------
    >>> import numpy as np
    >>> pairs = np.array([[90, 0, 9], [9, 90, 0], [0, 9, 90]])
    >>> ring = np.array([[0.3, 0.03, 0], [0, 0.3, 0.03], [0.04, 0, 0.3]])
    >>> [
    ...     np.round(ring[np.ix_(names, names)], 2).tolist()
    ...     for names in arrangements(pairs, ring)
    ... ][0]
    [[0.3, 0.0, 0.03], [0.04, 0.3, 0.0], [0.0, 0.03, 0.3]]
    """
    K = len(joint)
    rows = joint / np.maximum(joint.sum(axis=1, keepdims=True), 1e-300)
    log_p = np.log(np.maximum(rows, UNLIKELY))

    def score(names: tuple[int, ...]) -> float:
        value = float((pairs * log_p[np.ix_(names, names)]).sum())
        return float(f"{value:.9g}")  # equal ones are to be equal, whatever the order of the sum

    orders = [*permutations(range(K))] if K <= ALL_ORDERS else _matched(pairs, log_p)
    best: dict[bytes, tuple[int, ...]] = {}
    for names in sorted(orders, key=lambda one: -score(one)):
        best.setdefault((joint[np.ix_(names, names)] > 0.0).tobytes(), names)
    return [*best.values()][:WAYS]


def _matched(pairs: FloatArray, log_p: FloatArray) -> list[tuple[int, ...]]:
    """Return likely orders of many classes: quadratic assignments, from two places."""
    from scipy.optimize import quadratic_assignment

    K = len(pairs)
    options = {"maximize": True, "rng": np.random.default_rng(0)}  # from which neither of them draws
    found = []
    for start in (np.arange(K), quadratic_assignment(pairs, log_p, "faq", options).col_ind):
        fixed = np.stack([np.arange(K), start], axis=1)
        better = quadratic_assignment(pairs, log_p, "2opt", {**options, "partial_guess": fixed})
        found.append(tuple(better.col_ind.tolist()))
    return found


def named_guesses(posteriors: Sequence[Posterior], law: Law, data: TrainingData) -> list[FloatArray]:
    """Turn what is known of hard regimes into guesses of the shares of the classes of a law.

    The regimes fade into one another as long as the law does, half as long (a search may begin with fades
    that are too long), or, where it says nothing of long fades, for `USUAL` steps and not at all.

    Parameters
    ----------
    posteriors : sequence of Posterior
        Of K hard regimes, the likeliest first.
    law : Law
        Of K classes.
    data : TrainingData

    Returns
    -------
    list of ndarray, shape (N, K)
    """
    K, length = law.n_classes, law.mean_fade()
    joint = passages(law)
    gradual = GRADUAL <= length < np.inf
    if not gradual and K == 2:  # ranks are guesses of such a switch
        return [posteriors[0].gamma]
    windows = (round(length), round(0.5 * length)) if gradual else (1, USUAL)
    found: list[FloatArray] = []
    for posterior in posteriors:
        gamma, pairs = posterior.gamma, posterior.pairs
        # what the law leaves open: classes in the order of the first component of y
        order = np.argsort(data.z[:, data.dim_x] @ gamma / np.maximum(gamma.sum(axis=0), 1e-300))
        gamma, pairs = gamma[:, order], pairs[np.ix_(order, order)]
        for names in arrangements(pairs, joint):
            named = gamma[:, np.argsort(names)]
            hard = np.eye(K)[named.argmax(axis=1)]
            for window in windows:
                guess = named if window == 1 else faded(hard, data.starts, window)
                if all(np.abs(guess - other).mean() > ALIKE for other in found):
                    found.append(guess)
    return found


def passages(law: Law) -> FloatArray:
    """Return how likely the switch is at a class, and at which one it is next, however long it is in between.

    A law that is hardened does not do: what is in the middle between classes goes nowhere.

    Returns
    -------
    ndarray, shape (K, K)
        Of a law without a node at each class, or that does not lead to one, the joint probabilities of
        two hard regimes.

    Examples
    --------
    >>> from fuzzykf import FadeLaw
    >>> passages(FadeLaw(3, {(0, 1): (0.1, 5), (1, 2): (0.1, 5), (2, 0): (0.1, 5)})) > 0.0
    array([[ True,  True, False],
           [False,  True,  True],
           [ True, False,  True]])
    """
    chain = law.discretize(law.nodes_up_to(NODES))
    hard = chain.atoms
    if sorted(chain.class_weights[hard].argmax(axis=1).tolist()) != list(range(law.n_classes)):
        return law.harden()
    P = chain.transition
    inside = np.eye(int((~hard).sum())) - P[np.ix_(~hard, ~hard)]
    try:
        through = np.linalg.solve(inside, P[np.ix_(~hard, hard)])
    except np.linalg.LinAlgError:  # some nodes never lead to a class
        return law.harden()
    joint = chain.initial[hard][:, None] * (P[np.ix_(hard, hard)] + P[np.ix_(hard, ~hard)] @ through)
    order = chain.class_weights[hard].argmax(axis=1).argsort()
    found: FloatArray = np.where(joint > ROUNDING, joint, 0.0)[np.ix_(order, order)]
    return found


def faded(shares: FloatArray, starts: IntArray, window: int) -> FloatArray:
    """Let a switch that jumps fade as long: the mean over so many steps around each.

    Parameters
    ----------
    shares : ndarray, shape (N, K)
    starts : ndarray of int
        Rows at which a stretch begins.
    window : int

    Examples
    --------
    >>> import numpy as np
    >>> faded(np.eye(2)[[0, 0, 0, 1, 1, 1]], np.array([0]), 4)[:, 1]
    array([0.  , 0.  , 0.25, 0.5 , 0.75, 1.  ])
    """
    parts = []
    for part in np.split(shares, starts[1:]):
        n = len(part)
        total = np.concatenate([np.zeros((1, part.shape[1])), np.cumsum(part, axis=0)])
        low = np.clip(np.arange(n) - window // 2, 0, n)
        high = np.clip(np.arange(n) - window // 2 + window, 0, n)
        parts.append((total[high] - total[low]) / (high - low)[:, None])
    return np.concatenate(parts)


def soften(one_hot: FloatArray) -> FloatArray:
    """Turn regimes into shares of which none is excluded."""
    shares: FloatArray = 0.9 * one_hot + 0.1 / one_hot.shape[1]
    return shares


def _principal(values: FloatArray) -> FloatArray:
    centred = values - values.mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    score: FloatArray = centred @ direction
    return score


def _rank(values: FloatArray) -> FloatArray:
    order = np.empty(len(values))
    order[np.argsort(values, kind="stable")] = np.arange(len(values))
    return (order + 0.5) / len(values)


def _oriented(rank: FloatArray, y: FloatArray) -> FloatArray:
    return rank if np.corrcoef(rank, y)[0, 1] >= 0.0 else 1.0 - rank

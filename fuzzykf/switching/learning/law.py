"""Parameters of a fuzzy law, or of a hard chain, from observed transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.registry import either
from fuzzykf.switching.laws.base import ParametricLaw
from fuzzykf.switching.laws.registry import LAWS

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray

__all__ = ["count_transitions", "fit_law", "known_switch_laws"]


def fit_law(kind: str, before: FloatArray, after: FloatArray) -> Any:
    """Estimate a law from transitions of a switch that is known, by maximum likelihood.

    All transitions are used, hard and fuzzy: the product of p(r_n+1 | r_n).

    Parameters
    ----------
    kind : str
        A family of laws with a few parameters, see `known_switch_laws`.
    before, after : ndarray, shape (n,)
        The switch before and after each transition.

    Raises
    ------
    ParameterError
        If the transitions cannot come from the law.
    """
    if kind not in known_switch_laws():
        raise ParameterError(f"law: got {kind!r}, expected {either(known_switch_laws())}")
    make, n_free = LAWS[kind].given(before, after)
    return _maximise(make, n_free, before, after) if n_free else make(np.empty(0))


def known_switch_laws() -> list[str]:
    """Return the kinds of laws that can be learned from a switch that is known."""
    return [kind for kind, law in LAWS.items() if issubclass(law, ParametricLaw)]


def _maximise(make: Callable[[FloatArray], Any], n_free: int, before: FloatArray, after: FloatArray) -> Any:
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


_SEARCH = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 4000, "maxfev": 4000}

#: At most so many simplices, until one gains no more than this in the mean log-likelihood.
_SIMPLICES, _LITTLE = 20, 1e-9


def count_transitions(before: FloatArray, after: FloatArray, K: int) -> FloatArray:
    """Count the transitions between K regimes, (K, K)."""
    counts = np.zeros((K, K))
    np.add.at(counts, (before.astype(int), after.astype(int)), 1.0)
    return counts

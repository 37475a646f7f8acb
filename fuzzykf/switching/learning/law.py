"""Parameters of a fuzzy law, or of a hard chain, from observed transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.law import FuzzyMarkovLaw

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray

__all__ = ["count_transitions", "fit_law", "fmc1_from_logits", "fmc2_from_logits"]


def softmax(logits: FloatArray) -> FloatArray:
    """Map k numbers to k + 1 positive ones that sum to one; the first logit is zero."""
    full = np.concatenate([[0.0], logits])
    weights = np.exp(full - full.max())
    shares: FloatArray = weights / weights.sum()
    return shares


def fmc1_from_logits(logits: FloatArray) -> FuzzyMarkovLaw:
    """FMC1 from three free numbers: shares 2 alpha, 2 beta, 8 eta / 3 and 7 delta / 3 of the mass."""
    a, _, e, d = softmax(logits)
    return FuzzyMarkovLaw.fmc1(alpha=a / 2.0, delta=3.0 * d / 7.0, eta=3.0 * e / 8.0)


def fmc2_from_logits(logits: FloatArray, delta: float) -> FuzzyMarkovLaw:
    """FMC2 from two free numbers: shares 2 alpha, 2 beta and gamma delta (6 - delta) of the mass."""
    a, _, band = softmax(logits)
    area = delta * (6.0 - delta)
    return FuzzyMarkovLaw.fmc2(alpha=a / 2.0, gamma=band / area if area else 0.0, delta=delta)


def fit_law(kind: str, before: FloatArray, after: FloatArray) -> FuzzyMarkovLaw:
    """Estimate a law from transitions of a switch that is known, by maximum likelihood.

    All transitions are used, hard and fuzzy: the product of p(r_n+1 | r_n).

    Parameters
    ----------
    kind : {"fmc1", "fmc2"}
    before, after : ndarray, shape (n,)
        The switch before and after each transition.

    Raises
    ------
    ParameterError
        If the transitions cannot come from the law.
    """
    if kind == "fmc1":
        return _maximise(fmc1_from_logits, 3, before, after)
    if kind != "fmc2":
        raise ParameterError(f"law: got {kind!r}, expected 'fmc1' or 'fmc2'")
    hard = np.isin(before, (0.0, 1.0)) & np.isin(after, (0.0, 1.0))
    steps = np.abs(after - before)[~hard]
    if steps.size == 0:
        return fmc2_from_logits(_hard_logits(before, after), 0.0)
    # the likelihood falls with delta, and is zero below the largest step
    delta = float(steps.max())
    if delta >= 0.5:
        k = int(np.argmax(np.where(hard, 0.0, np.abs(after - before))))
        raise ParameterError(
            f"law: the switch moves from {before[k]:.6g} to {after[k]:.6g} in one step; FMC2 allows gradual "
            "steps of less than 0.5 only (use 'fmc1')"
        )
    return _maximise(lambda logits: fmc2_from_logits(logits, delta), 2, before, after)


def _hard_logits(before: FloatArray, after: FloatArray) -> FloatArray:
    stay = float((before == after).mean())
    return np.array([np.log(max(1.0 - stay, 1e-9) / max(stay, 1e-9)), -50.0])


def _maximise(
    make: Callable[[FloatArray], FuzzyMarkovLaw], n_free: int, before: FloatArray, after: FloatArray
) -> FuzzyMarkovLaw:
    from scipy.optimize import minimize

    pairs, counts = np.unique(np.stack([before, after]), axis=1, return_counts=True)

    def loss(logits: FloatArray) -> float:
        law = make(np.clip(logits, -40.0, 40.0))
        joint, marginal = law.joint_density(pairs[0], pairs[1]), law.marginal_density(pairs[0])
        with np.errstate(divide="ignore"):
            log_p = np.log(np.maximum(joint, 1e-300)) - np.log(marginal)
        return -float(counts @ log_p) / float(counts.sum())

    found = minimize(loss, np.zeros(n_free), method="Nelder-Mead", options=_SEARCH)
    again = minimize(loss, found.x, method="Nelder-Mead", options=_SEARCH)
    return make(np.clip(again.x, -40.0, 40.0))


_SEARCH = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 4000, "maxfev": 4000}


def count_transitions(before: FloatArray, after: FloatArray, K: int) -> FloatArray:
    """Count the transitions between K regimes, (K, K)."""
    counts = np.zeros((K, K))
    np.add.at(counts, (before.astype(int), after.astype(int)), 1.0)
    return counts

"""What a search says of itself and of the data, in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.texts import counted, listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.estimation.ascent import Maximum
    from fuzzykf.estimation.free import FreeNumbers

__all__ = ["at_their_bound", "boundless", "fewer", "several", "unfinished"]

#: Maxima whose log-likelihoods are closer than this explain the data about as well.
NEAR = 3.0

#: A log-variance that has gone down by this and does not settle has no maximum.
VANISHED = 60.0


def at_their_bound(free: FreeNumbers, numbers: FloatArray) -> list[str]:
    """Say which variances are zero at the maximum, or which leave a covariance singular."""
    estimates, notes = free.estimates(numbers), []
    for k in np.flatnonzero(np.isneginf(numbers)):
        name = free.names[k]
        if estimates[k] == 0.0:
            notes.append(f"{name}: at its bound; the estimate is 0, and there is no standard error")
        else:
            notes.append(
                f"{name}: at its bound; given the components before it its variance is 0, and standard "
                "errors are those among singular covariances"
            )
    return notes


def boundless(best: Maximum, free: FreeNumbers) -> list[str]:
    """Say that there is no maximum, since variances that vanish make the likelihood as large as they like."""
    if best.converged:
        return []
    vanishing = free.is_variance & np.isfinite(best.numbers) & (best.numbers < free.start - VANISHED)
    names = [free.names[k] for k in np.flatnonzero(vanishing)]
    if not names:
        return []
    return [
        f"{listed(names)}: the log-likelihood grows without bound towards zero; are observations constant, "
        "or computed from one another?"
    ]


def several(maxima: Sequence[Maximum], free: FreeNumbers) -> list[str]:
    """Say which other maxima explain the data about as well as the best one."""
    best, *others = maxima
    top = free.estimates(best.numbers)
    notes = []
    for one in others:
        less = best.log_likelihood - one.log_likelihood
        if less < NEAR:
            there = free.estimates(one.numbers)
            away = np.abs(there - top) / np.maximum(np.maximum(np.abs(there), np.abs(top)), 1e-300)
            order = np.argsort(-away)[:3]
            where = [
                f"{free.names[k]} {there[k]:.4g} instead of {top[k]:.4g}" for k in order if away[k] > 0.0
            ]
            notes.append(
                f"another maximum has a log-likelihood that is less by {less:.2g} only: {listed(where)}"
            )
    return notes


def unfinished(best: Maximum, max_iter: int) -> list[str]:
    """Say that the search was cut short."""
    if best.converged:
        return []
    return [
        f"not converged after {counted(max(len(best.trace) - 1, 0), 'iteration')} (max_iter = {max_iter}): "
        f"one more step promises {best.gain:.2g} in log-likelihood; raise max_iter, or begin elsewhere"
    ]


def fewer(made: int, asked: int) -> list[str]:
    """Say that some starts could not be made."""
    if made == asked:
        return []
    return [f"of {asked} starts {asked - made} had no finite log-likelihood wherever they were drawn"]

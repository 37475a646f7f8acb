"""Whether a smoother is likely to make a filter worse.

Under the model of the filter the state moves by x^f - x^s when the later observations are known, and its
covariance is P^f - P^s: what the filter did not know and the smoother does.  So

    ratio = sum (x^f - x^s)^2 / P^f  over  sum (P^f - P^s) / P^f

over all times and components is about 1.  If the model is wrong, say a hard switch where a sensor fades, the
filter is sure of what is false, and the smoother carries that back.  On 100 series of 200 to 300
observations of each of six systems whose sensor or motion changes at once or over 20 steps the ratio was
above `LARGEST` in at most 5 of 100 where the switch was a fade, and the squared error of the smoother .26 to
.74 of the filter's; with a hard switch where a gain or an offset fades it was so in 65 to 97 of 100, and the
smoother was worse than the filter in 78 to 99.  Under a true model a filter may lose the switch too, where it
changes what is observed of the state: the ratio tells that, and the smoother is often still the better one.

What hardly moves is not worth a word, whatever the ratio: with next to no noise in the state the two sums are
small, and their ratio is chance.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import HindsightWarning

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FilterResult

__all__ = ["hindsight_ratio", "warn_of_hindsight"]

#: Above this the model is taken to be wrong.
LARGEST = 2.0

#: Of fewer observations nothing is said: by chance the ratio is anything.
FEWEST = 50

#: Nor of states that move by less than this part of their variances, on average.
SMALLEST = 0.5


def hindsight_ratio(x: FloatArray, P: FloatArray, xs: FloatArray, Ps: FloatArray) -> float:
    """How far states move in hindsight, by what the model admits; about 1 if it is right.

    Parameters
    ----------
    x, P : ndarray, shapes (n, m) and (n, m, m)
        What the filter knew.
    xs, Ps : ndarray
        What the smoother knows.

    Returns
    -------
    float
        Infinite if the smoother knows something else, and no more than the filter did; 0 if nothing moved.
    """
    before, after = (np.diagonal(one, axis1=-2, axis2=-1) for one in (P, Ps))
    open_ = before > 0.0
    all_moved, learned = moved(x, P, xs).sum(), ((before - after)[open_] / before[open_]).sum()
    if all_moved <= np.finfo(np.float64).eps * max(1.0, open_.sum()):
        return 0.0
    return float(all_moved / learned) if learned > 0.0 else np.inf


def moved(x: FloatArray, P: FloatArray, xs: FloatArray) -> FloatArray:
    """By how much of its variance each component moves in hindsight, squared (n, m); 0 of what is certain."""
    before = np.diagonal(P, axis1=-2, axis2=-1)
    return np.divide((x - xs) ** 2, before, out=np.zeros_like(x), where=before > 0.0)


def warn_of_hindsight(fields: Mapping[str, FloatArray], smoothed: FilterResult, level: int = 3) -> None:
    """Warn if a smoother has moved states by more than the model admits.

    Parameters
    ----------
    fields : mapping
        ``x`` and ``P`` of the filter.
    smoothed : FilterResult
    level : int
        How many calls lie between the user and here, this one counted: whose line the warning names.
    """
    x, P = fields["x"], fields["P"]
    if len(x) < FEWEST or moved(x, P, smoothed.x).mean() < SMALLEST:
        return
    ratio = hindsight_ratio(x, P, smoothed.x, smoothed.P)
    if ratio > LARGEST:
        warnings.warn(
            f"smooth: later observations move the states {ratio:.3g} times as far, in squares, as the model "
            f"admits (expected at most {LARGEST:g}): the model is wrong, or the filter has lost the switch, "
            "and smoothing may be worse than filtering; try a law that fades or jumps, or in Python "
            'method="gpb2"',
            HindsightWarning,
            stacklevel=level,
        )

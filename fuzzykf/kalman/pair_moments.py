"""What GPB2 keeps of plain Kalman filters between a prediction and its update."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["PairMoments"]


class PairMoments(NamedTuple):
    """Moments of all pairs of a mode i before and a mode j now, after a prediction.

    Attributes
    ----------
    log_joint : ndarray, shape (N, N)
        log P(mode i before, mode j now).
    xs, Ps : ndarray, shapes (N, N, n) and (N, N, n, n)
        Moments of the pairs (i, j).
    merged_xs, merged_Ps : ndarray, shapes (N, n) and (N, n, n)
        What the filters were given: by it one sees whether anybody has written into them since.
    """

    log_joint: FloatArray
    xs: FloatArray
    Ps: FloatArray
    merged_xs: FloatArray
    merged_Ps: FloatArray

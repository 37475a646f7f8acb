"""Prediction and update of an interval or a box, and the way back, whichever way its functions are given."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.possibility.intervals import monotone as intervals
from fuzzykf.possibility.mapping import matrix_of
from fuzzykf.possibility.memberships import IntervalMembership

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.mapping import Mapping

__all__ = ["intersect", "is_reachable", "predict", "restart", "retrace", "update"]

#: Relative error of a measurement: a true state on the bound of its interval must not be lost by it.
ROUNDING = 4.0 * float(np.finfo(float).eps)


def predict(box: IntervalMembership, move: Mapping, noise: IntervalMembership) -> IntervalMembership:
    """Image of a box under the map, enlarged by the noise.

    Notes
    -----
    Layne and Passino (2001), equations (52)-(55).
    """
    if move.has_interval:
        lower, upper = move.interval(box.lower, box.upper)
    elif box.dim == 1:
        lower, upper = intervals.monotone_image(_component(move, 0), box.lower, box.upper, move.name)
    else:
        lower, upper = intervals.linear_image(matrix_of(move), box.lower, box.upper)
        lower, upper = lower + move.shift, upper + move.shift
    return IntervalMembership(lower + noise.lower, upper + noise.upper)


def update(
    box: IntervalMembership, measure: Mapping, noise: IntervalMembership, z: FloatArray
) -> IntervalMembership | None:
    """Part of a box that explains a measurement; None if there is none.

    Notes
    -----
    Layne and Passino (2001), equations (62)-(65), corrected: h(x) is in
    [z - upper noise, z - lower noise].
    """
    return _restricted(box, measure, *_explained(noise, z))


def retrace(
    box: IntervalMembership, move: Mapping, noise: IntervalMembership, later: IntervalMembership
) -> IntervalMembership | None:
    """Part of a box from which the map and its noise lead into a later one; None if there is none.

    Parameters
    ----------
    box : IntervalMembership
        Before the prediction.
    move : Mapping
    noise : IntervalMembership
    later : IntervalMembership
        What is known of the state after it.

    Notes
    -----
    f(x) is in [lower - upper noise, upper - lower noise]: the same for increasing and decreasing f.
    """
    size = np.maximum(np.abs(noise.lower), np.abs(noise.upper))
    slack = ROUNDING * (np.maximum(np.abs(later.lower), np.abs(later.upper)) + size)
    return _restricted(box, move, later.lower - noise.upper - slack, later.upper - noise.lower + slack)


def intersect(one: IntervalMembership, other: IntervalMembership) -> IntervalMembership | None:
    """Part that two boxes share; None if there is none."""
    lower, upper = np.maximum(one.lower, other.lower), np.minimum(one.upper, other.upper)
    return IntervalMembership(lower, upper) if (lower <= upper).all() else None


def _restricted(
    box: IntervalMembership, mapping: Mapping, least: FloatArray, most: FloatArray
) -> IntervalMembership | None:
    """Part of a box that a map takes into [least, most]; None if there is none."""
    found: tuple[FloatArray, FloatArray] | None = box.lower, box.upper
    if mapping.has_interval:
        found = intervals.shave(mapping.interval, box.lower, box.upper, least, most)
    elif box.dim == 1:
        for k in range(least.size):
            if found is not None:
                found = intervals.monotone_restriction(
                    _component(mapping, k), found[0], found[1], least[k], most[k], mapping.name
                )
    else:
        shift = mapping.shift
        found = intervals.contract(matrix_of(mapping), box.lower, box.upper, least - shift, most - shift)
    return None if found is None else IntervalMembership(*found)


def is_reachable(box: IntervalMembership, measure: Mapping, noise: IntervalMembership, z: FloatArray) -> bool:
    """Whether any state at all, possible or not, could explain the measurement.

    It is answered for scalar functions; elsewhere the answer is yes.
    """
    if measure.has_interval or box.dim > 1:
        return True
    ranges = [intervals.monotone_range(_component(measure, k), box.lower, box.upper) for k in range(z.size)]
    low, high = np.array(ranges).T
    least, most = _explained(noise, z)
    return bool((most >= low).all() and (least <= high).all())


def restart(
    box: IntervalMembership, measure: Mapping, noise: IntervalMembership, z: FloatArray
) -> IntervalMembership | None:
    """All states that explain a measurement; components it does not depend on keep their bounds.

    None if they are unbounded, or cannot be found (a function with an interval
    extension has no inverse).
    """
    least, most = _explained(noise, z)
    if measure.has_interval:
        return None
    if box.dim == 1:
        ends = [
            intervals.monotone_preimage(_component(measure, k), box.lower, box.upper, least[k], most[k])
            for k in range(z.size)
        ]
        lower, upper = np.max([e[0] for e in ends], axis=0), np.min([e[1] for e in ends], axis=0)
        bounded = np.isfinite(lower).all() and np.isfinite(upper).all() and (lower <= upper).all()
        return IntervalMembership(lower, upper) if bounded else None
    A = matrix_of(measure)
    seen = np.flatnonzero((A != 0.0).any(axis=0))
    if seen.size == 0 or np.linalg.matrix_rank(A[:, seen]) < seen.size:
        return None
    inverse = np.asarray(np.linalg.pinv(A[:, seen]))
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[seen], upper[seen] = intervals.linear_image(inverse, least - measure.shift, most - measure.shift)
    return update(IntervalMembership(lower, upper), measure, noise, z)


def _explained(noise: IntervalMembership, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bounds of what h may be, widened by the rounding errors of z, of h and of the difference."""
    slack = ROUNDING * (np.abs(z) + np.maximum(np.abs(noise.lower), np.abs(noise.upper)))
    return z - noise.upper - slack, z - noise.lower + slack


def _component(mapping: Mapping, k: int) -> Callable[[FloatArray], FloatArray]:
    """Return component k of a map of scalars as an element-wise function of an array (n,)."""
    return lambda x: mapping(x[:, None])[:, k]

"""Prediction and update of an interval or a box, and the way back, whichever way its functions are given.

Bounds of the state are `Box` and those of noises whatever has ``lower`` and ``upper``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.possibility.intervals import monotone as intervals
from fuzzykf.possibility.intervals.box import Box
from fuzzykf.possibility.intervals.linear import contract, has_single_entries, linear_image
from fuzzykf.possibility.intervals.rounding import sum_above, sum_below
from fuzzykf.possibility.mapping import matrix_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import IntervalMembership

__all__ = ["intersect", "is_reachable", "moments", "predict", "restart", "retrace", "tells_no_more", "update"]

#: Relative error of a measurement: a true state on the bound of its interval must not be lost by it.
ROUNDING = 4.0 * float(np.finfo(float).eps)


def predict(box: Box, move: Mapping, noise: IntervalMembership) -> Box:
    """Image of a box under the map, enlarged by the noise.

    Notes
    -----
    Layne and Passino (2001), equations (52)-(55).
    """
    if move.has_interval:
        lower, upper = move.interval(box.lower, box.upper)
    elif box.dim == 1 and move.matrix is None:
        lower, upper = intervals.monotone_image(_component(move, 0), box.lower, box.upper, move.name)
    else:
        lower, upper = linear_image(matrix_of(move), box.lower, box.upper)
        if move.shift.any():
            lower, upper = _widened(lower, upper, move.shift, move.shift)
    return Box(*_widened(lower, upper, noise.lower, noise.upper))


def _widened(
    lower: FloatArray, upper: FloatArray, below: FloatArray, above: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return lower + below and upper + above, rounded outwards."""
    low = [sum_below(a, b) for a, b in zip(lower.tolist(), below.tolist(), strict=True)]
    high = [sum_above(a, b) for a, b in zip(upper.tolist(), above.tolist(), strict=True)]
    return np.array(low), np.array(high)


def update(box: Box, measure: Mapping, noise: IntervalMembership, z: FloatArray) -> Box | None:
    """Part of a box that explains a measurement; None if there is none.

    Notes
    -----
    Layne and Passino (2001), equations (62)-(65), corrected: h(x) is in
    [z - upper noise, z - lower noise].
    """
    return _restricted(box, measure, *_explained(noise, z))


def retrace(box: Box, move: Mapping, noise: IntervalMembership, later: Box) -> Box | None:
    """Part of a box from which the map and its noise lead into a later one; None if there is none.

    Parameters
    ----------
    box : Box
        Before the prediction.
    move : Mapping
    noise : IntervalMembership
    later : Box
        What is known of the state after it.

    Notes
    -----
    f(x) is in [lower - upper noise, upper - lower noise]: the same for increasing and decreasing f.
    """
    bounds = zip(*(side.tolist() for side in (*later, noise.lower, noise.upper)), strict=True)
    least, most = [], []
    for low, high, below, above in bounds:
        slack = ROUNDING * (max(abs(low), abs(high)) + max(abs(below), abs(above)))
        least.append(low - above - slack)
        most.append(high - below + slack)
    return _restricted(box, move, np.array(least), np.array(most))


def intersect(one: Box, other: Box) -> Box | None:
    """Part that two boxes share; None if there is none."""
    lower, upper = np.maximum(one.lower, other.lower), np.minimum(one.upper, other.upper)
    return Box(lower, upper) if not (lower > upper).any() else None


def tells_no_more(measure: Mapping) -> bool:
    """Whether a measurement has bounded a box once for all, whatever is learned of it later.

    It has if each of its components is one of the state.
    """
    return measure.matrix is not None and has_single_entries(measure.matrix)


def moments(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Center (d,) of a box, and the variances width^2 / 12 (d, d) of a uniform density on it."""
    P = np.zeros((lower.size, lower.size))
    P.flat[:: lower.size + 1] = (upper - lower) ** 2 / 12.0
    return 0.5 * lower + 0.5 * upper, P


def _restricted(box: Box, mapping: Mapping, least: FloatArray, most: FloatArray) -> Box | None:
    """Part of a box that a map takes into [least, most]; None if there is none."""
    found: tuple[FloatArray, FloatArray] | None = box.lower, box.upper
    if mapping.has_interval:
        found = intervals.shave(mapping.interval, box.lower, box.upper, least, most)
    elif box.dim == 1 and mapping.matrix is None:
        for k in range(least.size):
            if found is not None:
                found = intervals.monotone_restriction(
                    _component(mapping, k), found[0], found[1], least[k], most[k], mapping.name
                )
    else:
        if mapping.shift.any():
            least, most = least - mapping.shift, most - mapping.shift
        found = contract(matrix_of(mapping), box.lower, box.upper, least, most)
    return None if found is None else Box(*found)


def is_reachable(box: Box, measure: Mapping, noise: IntervalMembership, z: FloatArray) -> bool:
    """Whether any state at all, possible or not, could explain the measurement.

    It is answered for scalar functions; elsewhere the answer is yes.
    """
    if measure.has_interval or box.dim > 1:
        return True
    ranges = [intervals.monotone_range(_component(measure, k), box.lower, box.upper) for k in range(z.size)]
    low, high = np.array(ranges).T
    least, most = _explained(noise, z)
    return bool((most >= low).all() and (least <= high).all())


def restart(box: Box, measure: Mapping, noise: IntervalMembership, z: FloatArray) -> Box | None:
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
        return Box(lower, upper) if bounded else None
    A = matrix_of(measure)
    seen = np.flatnonzero((A != 0.0).any(axis=0))
    if seen.size == 0 or np.linalg.matrix_rank(A[:, seen]) < seen.size:
        return None
    inverse = np.asarray(np.linalg.pinv(A[:, seen]))
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[seen], upper[seen] = linear_image(inverse, least - measure.shift, most - measure.shift)
    return update(Box(lower, upper), measure, noise, z)


def _explained(noise: IntervalMembership, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bounds of what h may be, widened by the rounding errors of z, of h and of the difference."""
    slack = ROUNDING * (np.abs(z) + np.maximum(np.abs(noise.lower), np.abs(noise.upper)))
    return z - noise.upper - slack, z - noise.lower + slack


def _component(mapping: Mapping, k: int) -> Callable[[FloatArray], FloatArray]:
    """Return component k of a map of scalars as an element-wise function of an array (n,)."""
    return lambda x: mapping(x[:, None])[:, k]

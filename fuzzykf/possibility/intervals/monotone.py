"""Intervals and boxes under functions: images and pre-images with guaranteed bounds.

Crisp memberships are the same under every t-norm.  For scalar monotone functions the
bounds are exact; for functions with an interval extension in several dimensions they are
boxes around the exact sets.  Linear maps have a module of their own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from fuzzykf.arrays import FloatArray

    Function: TypeAlias = Callable[[FloatArray], FloatArray]
    Bounds: TypeAlias = tuple[FloatArray, FloatArray]

__all__ = [
    "monotone_image",
    "monotone_preimage",
    "monotone_range",
    "monotone_restriction",
    "shave",
]

#: Points at which a function is checked for being monotone.
PROBES = 65

#: Largest number of sweeps and slices of the contractors.
SWEEPS = 100


def monotone_image(f: Function, lower: FloatArray, upper: FloatArray, name: str) -> Bounds:
    """Image of an interval under a continuous monotone function.

    Parameters
    ----------
    f : callable
        Element-wise on arrays (n,).
    lower, upper : ndarray, shape (1,)
    name : str
        Name of the function, for messages.

    Returns
    -------
    lower, upper : ndarray, shape (1,)

    Raises
    ------
    ParameterError
        If the function is found not to be monotone on the interval, or not finite.

    Notes
    -----
    Layne and Passino (2001), equations (52)-(55), without the noise.
    """
    values = _probe(f, lower, upper, name)
    return np.minimum(values[:1], values[-1:]), np.maximum(values[:1], values[-1:])


def _probe(f: Function, lower: FloatArray, upper: FloatArray, name: str) -> FloatArray:
    """Values of ``f`` along an interval, after checking that they are monotone."""
    points = np.linspace(lower[0], upper[0], PROBES if upper[0] > lower[0] else 1)
    with np.errstate(all="ignore"):
        values = f(points)
    if not np.isfinite(values).all():
        k = int(np.argmin(np.isfinite(values)))
        raise ParameterError(f"{name}: returned {values[k]} at {points[k]:.6g}, expected a finite number")
    change = np.diff(values)
    rounding = 8.0 * np.finfo(float).eps * np.abs(values).max()
    if change.min(initial=0.0) < -rounding and change.max(initial=0.0) > rounding:
        raise ParameterError(
            f"{name}: is not monotone on [{lower[0]:.6g}, {upper[0]:.6g}]; intervals need a monotone scalar "
            f"function or an interval extension ({name}_interval); points=... asks for a grid instead"
        )
    return values


def monotone_restriction(
    g: Function, lower: FloatArray, upper: FloatArray, least: float, most: float, name: str
) -> Bounds | None:
    """Part of an interval on which a continuous monotone function is in [least, most].

    Parameters
    ----------
    g : callable
        Element-wise on arrays (n,).
    lower, upper : ndarray, shape (1,)
    least, most : float
    name : str
        Name of the function, for messages.

    Returns
    -------
    lower, upper : ndarray, shape (1,), or None
        Rounded outwards; None if there is no such part.

    Raises
    ------
    ParameterError
        If the function is found not to be monotone on the interval, or not finite.

    Notes
    -----
    Layne and Passino (2001), equations (62)-(65), which are misprinted: with
    least = z - b_v and most = z - a_v the bounds are g^-1(least) and g^-1(most).
    """
    values = _probe(g, lower, upper, name)
    if max(values[0], values[-1]) < least or min(values[0], values[-1]) > most:
        return None
    if values[-1] < values[0]:
        return monotone_restriction(lambda x: -g(x), lower, upper, -most, -least, name)
    new_lower = lower if values[0] >= least else _below(g, lower[0], upper[0], least)
    if values[-1] <= most:
        return new_lower, upper
    return new_lower, -_below(lambda x: -g(-x), -upper[0], -lower[0], -most)


def _below(g: Function, low: float, high: float, level: float) -> FloatArray:
    """Largest number (1,) below which an increasing function is below ``level``, by bisection."""
    while low < (middle := 0.5 * low + 0.5 * high) < high:
        if g(np.array([middle]))[0] < level:
            low = middle
        else:
            high = middle
    return np.array([low])


def _expansion(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Points from an interval outwards to both ends of the real line."""
    center, width = 0.5 * (lower[0] + upper[0]), upper[0] - lower[0]
    unit = max(width, abs(center), 1e-3)
    with np.errstate(over="ignore"):
        steps = unit * 2.0 ** np.arange(-10.0, 980.0)
    steps = steps[steps < 1e300]
    return np.concatenate([center - steps[::-1], [center], center + steps])


def monotone_range(g: Function, lower: FloatArray, upper: FloatArray) -> tuple[float, float]:
    """Least and largest value of a monotone function on the real line (where it is a number)."""
    with np.errstate(all="ignore"):
        values = g(_expansion(lower, upper))
    values = values[~np.isnan(values)]
    return float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))


def monotone_preimage(g: Function, lower: FloatArray, upper: FloatArray, least: float, most: float) -> Bounds:
    """All x with g(x) in [least, most]; infinite on a side on which g never leaves it.

    Parameters
    ----------
    g : callable
        Monotone on the real line, or where it is a number; element-wise.
    lower, upper : ndarray, shape (1,)
        An interval of the usual size of x, from which the search starts.
    least, most : float

    Returns
    -------
    lower, upper : ndarray, shape (1,)
        Rounded outwards.
    """
    points = _expansion(lower, upper)
    with np.errstate(all="ignore"):
        values = g(points)
        points, values = points[~np.isnan(values)], values[~np.isnan(values)]
        if values[-1] < values[0]:
            high, low = monotone_preimage(lambda x: g(-x), -upper, -lower, least, most)
            return -low, -high
        below, above = np.flatnonzero(values < least), np.flatnonzero(values > most)
        lower, upper = np.array([-np.inf]), np.array([np.inf])
        if below.size:
            k = int(below[-1])
            lower = _below(g, points[k], points[k + 1], least) if k + 1 < points.size else upper
        if above.size:
            k = int(above[0])
            upper = -_below(lambda x: -g(-x), -points[k], -points[k - 1], -most) if k else -upper
    return lower, upper


def shave(
    g: Callable[[FloatArray, FloatArray], Bounds],
    lower: FloatArray,
    upper: FloatArray,
    least: FloatArray,
    most: FloatArray,
) -> Bounds | None:
    """Box around the points of a box that a function with an interval extension maps into another.

    Slices are cut off the sides as long as the extension proves that none of their
    points is mapped into [least, most].

    Parameters
    ----------
    g : callable
        Maps the bounds of a box to bounds of its image.
    lower, upper : ndarray, shape (m,)
    least, most : ndarray, shape (q,)

    Returns
    -------
    lower, upper : ndarray, or None
        None if there is certainly no such point.
    """

    def excluded(a: FloatArray, b: FloatArray) -> bool:
        low, high = g(a, b)
        return bool((low > most).any() or (high < least).any())

    lower, upper = lower.copy(), upper.copy()
    if excluded(lower, upper):
        return None
    for _ in range(SWEEPS):
        before = upper - lower
        for k in range(lower.size):
            for side in (-1, 1):
                part = 0.5
                while part > 1e-6 and upper[k] > lower[k]:
                    slice_lower, slice_upper = lower.copy(), upper.copy()
                    cut = part * (upper[k] - lower[k])
                    if side < 0:
                        slice_upper[k] = lower[k] + cut
                    else:
                        slice_lower[k] = upper[k] - cut
                    if excluded(slice_lower, slice_upper):
                        lower[k], upper[k] = (
                            (slice_upper[k], upper[k]) if side < 0 else (lower[k], slice_lower[k])
                        )
                    else:
                        part *= 0.5
        if excluded(lower, upper):
            return None
        if (upper - lower >= 0.99 * before).all():
            break
    return lower, upper

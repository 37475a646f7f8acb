"""How well estimates are known: observed information, standard errors, and what the data do not tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.estimation.free import FreeNumbers

    #: Log-likelihood and gradient at numbers (p,); no finite value where there is none.
    LogLikelihood: TypeAlias = Callable[[FloatArray], tuple[float, FloatArray]]

__all__ = ["Uncertainty", "curvature", "observed_information", "uncertainty", "units"]

#: A direction is weakly identified if its standard error is more than this many large changes.
WEAK = 2.0

#: Curvature, in standard errors of numbers given all others, without which there is no standard error.
NONE = 1e-7

#: What has less than this part in a direction is not named with it.
PART = 0.3

#: A variance given other components is named as such if it is less than this part of the variance.
REST = 0.5

#: Step of the differences, in standard errors of one number given the others.
STEP = 1e-2


def observed_information(
    f: LogLikelihood, numbers: FloatArray, step: FloatArray, moving: BoolArray | None = None
) -> FloatArray:
    """Return minus the second derivatives of a log-likelihood, by central differences of its gradient.

    Parameters
    ----------
    f : callable
        Of numbers (p,), log-likelihood and gradient.
    numbers : ndarray, shape (p,)
    step : ndarray, shape (p,)
        Of the differences.
    moving : ndarray of bool, shape (p,), optional
        Which numbers count, by default the finite ones; beside others there are zeros.

    Returns
    -------
    ndarray, shape (p, p)
        By differences of one side where the other has no log-likelihood; NaN where neither has one.

    Examples
    --------
    >>> import numpy as np
    >>> A = np.array([[2.0, 1.0], [1.0, 3.0]])
    >>> observed_information(
    ...     lambda z: (-0.5 * z @ A @ z, -A @ z), np.zeros(2), np.full(2, 0.1)
    ... ).round(9)
    array([[2., 1.],
           [1., 3.]])
    """
    moving = np.isfinite(numbers) if moving is None else moving
    found = np.zeros((len(numbers),) * 2)
    for k in np.flatnonzero(moving):
        ahead, behind = numbers.copy(), numbers.copy()
        ahead[k] += step[k]
        behind[k] -= step[k]
        below, above = f(behind)[1], f(ahead)[1]
        if not (np.isfinite(below).all() and np.isfinite(above).all()):
            here, is_below = f(numbers)[1], bool(np.isfinite(below).all())
            behind, below = (behind, below) if is_below else (numbers, here)
            ahead, above = (numbers, here) if is_below else (ahead, above)
        found[k] = (below - above) / (ahead[k] - behind[k])
    found[:, ~moving] = 0.0
    symmetric: FloatArray = 0.5 * (found + found.T)
    return symmetric


def units(information: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the standard error of each number given all others, but no more than a large change."""
    known = np.maximum(np.diagonal(information), scale**-2.0)
    found: FloatArray = 1.0 / np.sqrt(known)
    return found


def curvature(f: LogLikelihood, free: FreeNumbers, numbers: FloatArray) -> FloatArray:
    """Return about what the `observed_information` is, by steps that are small beside standard errors.

    Parameters
    ----------
    f : callable
    free : FreeNumbers
    numbers : ndarray, shape (p,)

    Returns
    -------
    ndarray, shape (p, p)
    """
    scale = free.scale(numbers)
    step = 1e-4 * scale
    for _ in range(4):
        information = observed_information(f, numbers, step)
        if not np.isfinite(information).all():
            break
        known = STEP * units(information, scale)
        if (step <= 10.0 * known).all():
            break
        step = np.minimum(step, known)
    return information


class Uncertainty(NamedTuple):
    """How well estimates are known.

    Attributes
    ----------
    covariance : ndarray, shape (p, p)
        Of the estimates; NaN beside what has no standard error.
    notes : list of str
        What the data do not tell.
    """

    covariance: FloatArray
    notes: list[str]


def uncertainty(
    f: LogLikelihood, free: FreeNumbers, numbers: FloatArray, about: FloatArray | None = None
) -> Uncertainty:
    """Return the covariance of the estimates at a maximum: the inverse information, by the delta method.

    Variances that are zero have none, nor have covariances beside them, nor has what depends on a direction
    in which the log-likelihood is flat, or does not bend down.  Beside what makes a covariance singular
    errors are those among singular ones.

    Parameters
    ----------
    f : callable
    free : FreeNumbers
    numbers : ndarray, shape (p,)
        Minus infinity for variances that are zero.
    about : ndarray, shape (p, p), optional
        About what the information is, for the steps of its differences.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.estimation.free import read_free
    >>> free = read_free({"b": "full"}, {"b": np.zeros(2)}, covariances=[], vectors=["b"])
    >>> def f(z):  # of which the data know the first
    ...     return -2.0 * float(z[0] ** 2), np.array([-4.0 * z[0], 0.0])
    >>> found = uncertainty(f, free, np.zeros(2))
    >>> found.covariance.round(6)
    array([[0.25,  nan],
           [ nan,  nan]])
    >>> found.notes
    ['b[1]: weakly identified, the log-likelihood does not change along it']
    """
    moving, scale = np.isfinite(numbers), free.scale(numbers)
    about = curvature(f, free, numbers) if about is None else about
    information = observed_information(f, numbers, STEP * units(about, scale))
    if not np.isfinite(information).all():
        nothing = np.full((len(numbers),) * 2, np.nan)
        return Uncertainty(nothing, ["no standard errors: beside the maximum there is no log-likelihood"])
    unit = units(information, scale)[moving]
    bent, ways = np.linalg.eigh(unit[:, None] * information[np.ix_(moving, moving)] * unit)
    known = bent > NONE

    jacobian = free.jacobian(numbers)[:, moving] * unit
    root = jacobian @ (ways[:, known] / np.sqrt(bent[known]))
    covariance = root @ root.T
    # an estimate that moves along what is not known is not known
    size = np.linalg.norm(jacobian, axis=1)
    unknown = np.linalg.norm(jacobian @ ways[:, ~known], axis=1) > 1e-3 * size
    unknown |= size == 0.0  # a variance at its bound, and what is in its column
    covariance[unknown] = covariance[:, unknown] = np.nan
    names = [name for name, moves in zip(_numbers_named(free, numbers), moving, strict=True) if moves]
    return Uncertainty(covariance, _weak(names, bent, (unit / scale[moving])[:, None] * ways, known))


def _numbers_named(free: FreeNumbers, numbers: FloatArray) -> list[str]:
    """Return what the numbers of a search are: of a covariance they are variances given components before."""
    estimates = free.estimates(numbers)
    with np.errstate(over="ignore"):
        given = free.is_variance & free.is_positive & (np.exp(numbers) < REST * estimates)
    return [
        f"what {name} has of its own" if rest else name for name, rest in zip(free.names, given, strict=True)
    ]


def _weak(names: list[str], bent: FloatArray, ways: FloatArray, known: BoolArray) -> list[str]:
    """Say along which ways, in units of large changes, the log-likelihood bends too little."""
    notes = []
    for k in range(len(bent)):
        size = float(np.linalg.norm(ways[:, k]))
        if known[k] and size < WEAK * np.sqrt(bent[k]):
            continue
        part = np.abs(ways[:, k])
        along = [name for name, own in zip(names, part, strict=True) if own > PART * part.max()]
        what = "it" if len(along) == 1 else "them together"
        how = f"a large change of {what} costs {0.5 * bent[k] / size**2:.2g} in log-likelihood only"
        if not known[k]:
            how = f"the log-likelihood does not change along {what}"
        notes.append(f"{listed(along)}: weakly identified, {how}")
    return notes

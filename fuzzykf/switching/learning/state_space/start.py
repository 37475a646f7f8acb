"""State-space models from measured states: where a search begins, and the search."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.switching.state_space.model import SwitchingStateSpace
from fuzzykf.texts import counted

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.estimation.result import LikelihoodFit

__all__ = ["learn_from_states", "starts"]

#: What is learned: one motion, and a sensor for each class.
FREE = {"F": "full", "b": "full", "Q": "full", "H": "full", "d": "full", "R": "full"}

#: How far the classes of a start are apart: offsets in standard deviations, noise as a factor of these.
OFFSET, NOISE = 1.0, 3.0

#: Rows for each number of a regression, at least.
ROWS = 5


class _Regression(NamedTuple):
    """z = offset + slope x + N(0, noise)."""

    slope: FloatArray
    offset: FloatArray
    noise: FloatArray


def learn_from_states(x: FloatArray, y: FloatArray, law: Any, **options: Any) -> LikelihoodFit[Any]:
    """Learn a model whose classes share the motion, and have a sensor each.

    The search begins at the regressions of one class, once with sensors of several offsets and once with
    sensors of several noises; the likelier model is returned.

    Parameters
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        States as far as they are measured, and observations; NaN where missing.
    law : Law or array_like, shape (K, K)
        Where the law of the switch begins.
    **options
        Of `SwitchingStateSpace.fit`.

    Raises
    ------
    FuzzykfError
        If there are too few rows, or neither search comes to an end.
    """
    found, errors = [], []
    for start in starts(x, y, law):
        free = FREE | ({"law": True} if start.n_classes > 1 else {})
        try:
            found.append(start.fit(y, x, free=free, **options))
        except FuzzykfError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    return max(found, key=lambda fit: fit.log_likelihood)


def starts(x: FloatArray, y: FloatArray, law: Any) -> list[SwitchingStateSpace]:
    """Return the models at which searches begin.

    Parameters
    ----------
    x, y, law
        As in `learn_from_states`.

    Raises
    ------
    ParameterError
        If there are too few rows for a regression, or noise is lacking.
    """
    motion = _regression("x", x[:-1], x[1:])
    sensor = _regression("x, y", x, y)
    there = x[np.isfinite(x).all(axis=1)]
    first = {"x0": there.mean(axis=0), "P0": np.atleast_2d(np.cov(there.T))}
    # of one class as many as of several; the model says how many the law has
    one = SwitchingStateSpace(law, motion.slope, sensor.slope, motion.noise, sensor.noise, **first)
    K = one.n_classes
    apart = np.linspace(-1.0, 1.0, K) if K > 1 else np.zeros(1)
    std = np.sqrt(np.diagonal(sensor.noise))
    offsets = sensor.offset + OFFSET * apart[:, None] * std
    noises = sensor.noise * NOISE ** (2.0 * apart[:, None, None])
    alike = np.repeat(sensor.slope[None], K, axis=0)
    same = np.repeat(sensor.offset[None], K, axis=0), np.repeat(sensor.noise[None], K, axis=0)
    made = []
    for d, R in [(same[0], same[1])] if K == 1 else [(offsets, same[1]), (same[0], noises)]:
        shared = {"b": motion.offset, "d": d} | first
        made.append(SwitchingStateSpace(law, motion.slope, alike, motion.noise, R, mix="log", **shared))
    return made


def _regression(names: str, x: FloatArray, z: FloatArray) -> _Regression:
    """Regress on a constant and x, by the rows in which all is there."""
    complete = np.isfinite(x).all(axis=1) & np.isfinite(z).all(axis=1)
    needed = ROWS * (x.shape[1] + 1 + z.shape[1])
    if complete.sum() < needed:
        raise ParameterError(
            f"{names}: got {counted(int(complete.sum()), 'row')} in which all is measured, expected at least "
            f"{needed} to begin with"
        )
    design = np.column_stack([np.ones(complete.sum()), x[complete]])
    coefficients, *_ = np.linalg.lstsq(design, z[complete])
    residual = z[complete] - design @ coefficients
    noise = residual.T @ residual / complete.sum()
    return _Regression(coefficients[1:].T, coefficients[0], noise)

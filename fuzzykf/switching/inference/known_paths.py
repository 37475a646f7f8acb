"""Many series along known paths of the switch, side by side: each step is done for all series at once.

Given its path a series is that of a Kalman filter, whose numbers are those of `KnownSwitchFilter.filter` but
for rounding.  Parts may be missing in any pattern.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import covariance_root
from fuzzykf.results import field_shapes
from fuzzykf.switching.inference.method import out_of_range

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.placed import GaussianPaths
    from fuzzykf.switching.inference.series import Stand

__all__ = ["MOMENTS", "SIDE_BY_SIDE", "Spaces", "filter_pairs", "filter_spaces"]

#: What is found for every observation.
MOMENTS = ("x", "P", "x_prior", "P_prior", "log_likelihood")

#: Numbers that the tables of a chunk of steps may hold.
_NUMBERS = 1 << 20


class Spaces(Protocol):
    """What a state-space model says along known paths of the switch."""

    dim_x: int

    def first(self) -> FloatArray:
        """Return the laws of the first states as engines take them, (s, 1 + m + m*m, 1)."""

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of the steps to values start, ..., start + n - 1, (s, n, 1, ...)."""


def filter_spaces(paths: Spaces, series: FloatArray, stand: Stand | None = None) -> dict[str, FloatArray]:
    """Filter series (s, n, q) of a state-space model from their first laws on, or from where a filter stands.

    Parameters
    ----------
    paths : Spaces
        Of the values of the switch at these observations, before which stands that at the latest one if the
        filter stands anywhere.
    series : ndarray, shape (s, n, q)
        NaN where missing; s and n of at least one.
    stand : Stand, optional

    Returns
    -------
    dict of str to ndarray, shape (s, n, ...)
        What `MOMENTS` names.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance of an observation is not positive definite.
    NumericalRangeError
        If what follows from an observation cannot be held.
    """
    s = len(series)
    out = _allocate(series, paths.dim_x)
    begins = stand is None
    table = paths.first() if stand is None else np.repeat(stand.mixture.table[None], s, axis=0)
    one, always, ranking = np.ones(1), np.zeros((1, 1)), np.array([[0], [2]])
    for start, stop in _chunks(series, paths.dim_x):
        kernel = engine.pack_nodes(engine.NodeSpace(*paths.steps(start + (not begins), stop - start)), always)
        ys, first, switch = series[:, start:stop], begins and start == 0, (one, one, one == 1.0, ranking)
        part = _allocate(ys, paths.dim_x)
        _, table = engine.filter_nodes(kernel, False, table, first, ys, part, switch)
        for name, values in part.items():
            out[name][:, start:stop] = values
    _check_range(out, engine.is_in_range(table), series)
    return out


def filter_pairs(
    paths: GaussianPaths, series: FloatArray, stand: Stand | None = None
) -> dict[str, FloatArray]:
    """Filter series of a pairwise model; parameters, and what is returned, are those of `filter_spaces`."""
    s, _, q = series.shape
    m, out = paths.dim_x, _allocate(series, paths.dim_x)
    begins = stand is None
    if stand is None:
        mean, covariance = paths.first()
        root = covariance_root(covariance)
    else:
        known = stand.mixture
        mean, covariance = engine.window_moments(known.table, known.window)
        root = engine.window_root(covariance, known.root, known.window)
        mean, root = (np.repeat(one, s, axis=0) for one in (mean, root))
    for start, stop in _chunks(series, m + q):
        first = begins and start == 0
        # nothing moves to the first observation of all
        to, count = start + 1 if first or not begins else start, stop - start - first
        steps = engine.known_steps(paths.steps(to, count)) if count else None
        part = {name: values[:, start:stop] for name, values in out.items()}
        mean, root = engine.filter_known_pairs(steps, first, mean, root, series[:, start:stop], part)
    _check_range(out, np.ones(s, dtype=bool), series)
    return out


#: How series go side by side, by the method that is exact along a known path.
SIDE_BY_SIDE: dict[str, Callable[[Any, FloatArray, Stand | None], dict[str, FloatArray]]] = {
    "exact": filter_pairs,
    "imm": filter_spaces,
}


def _allocate(series: FloatArray, m: int) -> dict[str, FloatArray]:
    shapes = field_shapes(MOMENTS, state=m, node=1)
    return {name: np.empty((*series.shape[:2], *shape)) for name, shape in shapes.items()}


def _chunks(series: FloatArray, d: int) -> list[tuple[int, int]]:
    """Return where stretches of steps begin and end whose tables are held at once."""
    s, n, q = series.shape
    size = max(1, _NUMBERS // (s * 4 * (d + q) ** 2))
    return [(start, min(start + size, n)) for start in range(0, n, size)]


def _check_range(out: dict[str, FloatArray], fits: np.ndarray, series: FloatArray) -> None:
    """Raise unless what was found of series (s, n, q) are numbers, which NaN and infinity are not."""
    for name, limit in {"x": engine.LARGEST_MEAN, "P": np.finfo(np.float64).max}.items():
        fits = fits & (np.abs(out[name]) <= limit).reshape(len(series), -1).all(axis=1)
    fits = fits & (out["log_likelihood"] > engine.FARTHEST).all(axis=1)
    if not fits.all():
        seen = np.where(np.isnan(series), 0.0, series)[int(fits.argmin())]
        raise out_of_range(seen[np.abs(seen).max(axis=1).argmax()])

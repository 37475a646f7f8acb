"""Memberships given by their values on a grid, or by a Python function."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_flag, as_numbers, brief
from fuzzykf.possibility.memberships.base import (
    Membership,
    as_components,
    as_level,
    as_levels,
    as_vector,
)
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["FunctionMembership", "GridMembership"]

#: A membership function whose largest value is below 1 by more than this never reaches 1.
PEAK_TOLERANCE = 1e-6

#: Nodes per axis on which the peak of a function is sought first.
SEARCH_NODES = {1: 4001, 2: 151, 3: 41}


@reprs("axes", "values")
class GridMembership(Membership):
    """Membership given on the nodes of a grid, linear in between and zero outside.

    Parameters
    ----------
    axes : sequence of array_like
        Increasing coordinates along each axis; an axis of length one means a
        component that is known exactly.  In one dimension, a single array is enough.
    values : array_like, shape (n_1, ..., n_dim)
        Memberships of the nodes, in [0, 1] with maximum 1.
    normalise : bool
        Divide by the largest value.

    Attributes
    ----------
    axes : tuple of ndarray
    values : ndarray, shape (n_1, ..., n_dim)

    Raises
    ------
    ShapeError, ParameterError
        If shapes do not agree, an axis is not increasing, or values are not in [0, 1] with maximum 1.

    Examples
    --------
    >>> membership = GridMembership([0.0, 1.0, 2.0], [0.0, 1.0, 0.5])
    >>> membership([0.5, 1.5, 3.0])
    array([0.5 , 0.75, 0.  ])
    """

    def __init__(
        self, axes: Sequence[ArrayLike] | ArrayLike, values: ArrayLike, *, normalise: bool = False
    ) -> None:
        array = as_numbers("values", values).copy()
        self.dim = array.ndim
        given: Any = axes
        if not hasattr(given, "__len__") or not hasattr(given, "__getitem__") or len(given) == 0:
            raise ShapeError(f"axes: got {brief(axes)}, expected the coordinates of each dimension")
        single = (
            array.ndim == 1
            and not isinstance(axes, tuple)
            and (np.isscalar(given[0]) or getattr(given[0], "shape", None) == ())
        )
        coordinates: list[ArrayLike] = [axes] if single else list(axes)  # type: ignore[list-item, arg-type]
        if array.ndim == 0 or len(coordinates) != array.ndim:
            raise ShapeError(
                f"axes: got {len(coordinates)}, expected one per dimension of values of shape {array.shape}"
            )
        self.axes = tuple(
            as_array(f"axes[{k}]", axis, (array.shape[k],)) for k, axis in enumerate(coordinates)
        )
        for k, axis in enumerate(self.axes):
            if axis.size == 0 or (np.diff(axis) <= 0.0).any():
                raise ParameterError(f"axes[{k}]: expected increasing coordinates")
        self.values = _checked_values(array, as_flag("normalise", normalise))

    @property
    def peak(self) -> FloatArray:
        """The first node of largest membership (dim,)."""
        best = np.unravel_index(int(self.values.argmax()), self.values.shape)
        return np.array([axis[k] for axis, k in zip(self.axes, best, strict=True)])

    def _evaluate(self, x: FloatArray) -> FloatArray:
        inside = np.ones(x.shape[:-1], dtype=bool)
        lower, fraction = [], []
        for k, axis in enumerate(self.axes):
            u = x[..., k]
            inside &= (u >= axis[0]) & (u <= axis[-1])
            node = np.clip(np.searchsorted(axis, u, side="right") - 1, 0, max(axis.size - 2, 0))
            lower.append(node)
            width = axis[node + 1] - axis[node] if axis.size > 1 else 1.0
            fraction.append(np.clip((u - axis[node]) / width, 0.0, 1.0))
        value = np.zeros(x.shape[:-1])
        for corner in product(*((0, 1) if axis.size > 1 else (0,) for axis in self.axes)):
            weight = np.ones(x.shape[:-1])
            for k, step in enumerate(corner):
                weight = weight * (fraction[k] if step else 1.0 - fraction[k])
            value += (
                weight * self.values[tuple(node + step for node, step in zip(lower, corner, strict=True))]
            )
        return np.where(inside, np.minimum(value, 1.0), 0.0)

    def support(self, level: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the points whose membership is at least ``level``.

        Parameters
        ----------
        level : float
            In [0, 1]; 0 means all possible points.

        Returns
        -------
        lower, upper : ndarray, shape (dim,)
            Bounds; infinite where unbounded.
        """
        level = as_level("level", level, or_zero=True)
        lower, upper = np.empty(self.dim), np.empty(self.dim)
        for k, axis in enumerate(self.axes):
            others = tuple(m for m in range(self.dim) if m != k)
            profile = self.values.max(axis=others)
            lower[k] = _first_reaching(axis, profile, level)
            upper[k] = -_first_reaching(-axis[::-1], profile[::-1], level)
        return lower, upper

    def project(self, components: Sequence[int]) -> GridMembership:
        """Return the membership of some components: the maximum over the others.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        GridMembership
        """
        kept = as_components(components, self.dim)
        others = tuple(k for k in range(self.dim) if k not in kept)
        return GridMembership([self.axes[k] for k in kept], self.values.max(axis=others))


def _first_reaching(axis: FloatArray, profile: FloatArray, level: float) -> float:
    """Where the piecewise linear profile first reaches ``level`` (or, for 0, leaves zero)."""
    k = int(np.argmax(profile >= level if level > 0.0 else profile > 0.0))
    if k == 0:
        return float(axis[0])
    fraction = (level - profile[k - 1]) / (profile[k] - profile[k - 1])
    return float(axis[k - 1] + fraction * (axis[k] - axis[k - 1]))


def _checked_values(values: FloatArray, normalise: bool) -> FloatArray:
    """Check memberships of nodes, after division by the largest if so wished."""
    largest = float(values.max()) if values.size and np.isfinite(values).all() else np.nan
    if not (largest > 0.0 and values.min() >= 0.0):
        raise ParameterError("values: expected finite memberships in [0, 1], the largest 1")
    if normalise:
        return values / largest
    if abs(largest - 1.0) > PEAK_TOLERANCE:
        relation = "never reach 1" if largest < 1.0 else "exceed 1"
        raise ParameterError(
            f"values: the memberships {relation}, the largest is {largest:.6g}; "
            "expected a largest value of 1 (normalise=True divides by it)"
        )
    return np.minimum(values, 1.0)


@reprs("function", "lower", "upper")
class FunctionMembership(Membership):
    """Membership given by any Python function with bounded support.

    Parameters
    ----------
    function : callable
        Maps an array (n, dim) to n memberships in [0, 1].  In one dimension, it may also be an element-wise
        function such as ``lambda x: np.exp(-abs(x))``, or a function of a single number, which is called
        once per number.
    support : (lo, hi) or ((lo, hi), ...)
        Bounds of the box outside which the membership is zero.
    normalise : bool
        Divide by the largest value.

    Attributes
    ----------
    lower, upper : ndarray, shape (dim,)
        The support.

    Raises
    ------
    ShapeError, ParameterError
        If shapes are wrong, the support is infinite or empty, or values are NaN, outside [0, 1], or never
        1.

    Notes
    -----
    The peak is found on a grid and refined by a local search; a peak narrower
    than 1/4000 of the support (1/150 in two dimensions, 1/40 in three) may be missed.

    Examples
    --------
    >>> import numpy as np
    >>> membership = FunctionMembership(lambda x: np.exp(-abs(x - 1.0)), (-4.0, 6.0))
    >>> round(membership(2.0), 4), membership(7.0)
    (0.3679, 0.0)
    """

    def __init__(
        self,
        function: Callable[[FloatArray], ArrayLike],
        support: Sequence[float] | Sequence[Sequence[float]],
        *,
        normalise: bool = False,
    ) -> None:
        if not callable(function):
            raise ParameterError(f"function: got {type(function).__name__}, expected a function of points")
        bounds = as_numbers("support", support).copy()
        if bounds.shape == (2,):
            bounds = bounds[None]
        if bounds.ndim != 2 or bounds.shape[1] != 2:
            raise ShapeError(f"support: got shape {bounds.shape}, expected (2,) or (dim, 2)")
        self.lower = as_vector("support", bounds[:, 0])
        self.upper = as_vector("support", bounds[:, 1])
        if (self.lower >= self.upper).any():
            raise ParameterError(f"support: got {bounds.tolist()}, expected lo < hi for every component")
        self.dim = self.lower.size
        self.function = function
        self._one_by_one = self.dim == 1 and _takes_single_numbers(function, self.lower, self.upper)
        self._factor = 1.0
        self._peak, largest = self._find_peak()
        if as_flag("normalise", normalise) and largest > 0.0:
            self._factor = 1.0 / largest
        elif largest < 1.0 - PEAK_TOLERANCE:
            raise ParameterError(
                f"function: the membership never reaches 1 on its support, the largest value found is "
                f"{largest:.6g} at {self._peak.tolist()} (normalise=True divides by it)"
            )
        elif largest > 1.0 + PEAK_TOLERANCE:
            raise ParameterError(
                f"function: the membership is {largest:.6g} at {self._peak.tolist()}, expected at most 1"
            )

    @property
    def peak(self) -> FloatArray:
        """A point (dim,) of membership 1."""
        return self._peak

    def _call(self, points: FloatArray) -> FloatArray:
        """Values of the function (n,) at points (n, dim), checked."""
        if self._one_by_one:
            value = np.array([self.function(x) for x in points[:, 0].tolist()], dtype=np.float64)
        else:
            value = np.asarray(self.function(points), dtype=np.float64)
        if value.shape == (points.shape[0], 1) and self.dim == 1:
            value = value[:, 0]
        if value.shape != (points.shape[0],):
            raise ShapeError(
                f"function: returned shape {value.shape} for points of shape {points.shape}, "
                f"expected ({points.shape[0]},)"
            )
        if not (value >= 0.0).all():
            worst = int(np.argmin(np.where(np.isnan(value), -np.inf, value)))
            raise ParameterError(
                f"function: returned {value[worst]} at {points[worst].tolist()}, expected a number in [0, 1]"
            )
        return value

    def _search_axes(self) -> list[FloatArray]:
        nodes = SEARCH_NODES.get(self.dim, 15)
        return [np.linspace(a, b, nodes) for a, b in zip(self.lower, self.upper, strict=True)]

    def _find_peak(self) -> tuple[FloatArray, float]:
        axes = self._search_axes()
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dim)
        values = self._call(points)
        best = int(values.argmax())
        peak, largest = points[best], float(values[best])
        width = np.array([axis[1] - axis[0] for axis in axes])
        for _ in range(60):  # shrink a box of 3^dim trial points around the best so far
            offsets = np.array(list(product((-1.0, 0.0, 1.0), repeat=self.dim)))
            trial = np.clip(peak + offsets * width, self.lower, self.upper)
            values = self._call(trial)
            best = int(values.argmax())
            if values[best] > largest:
                peak, largest = trial[best], float(values[best])
            else:
                width = 0.5 * width
        return peak, largest

    def _evaluate(self, x: FloatArray) -> FloatArray:
        inside = ((x >= self.lower) & (x <= self.upper)).all(axis=-1)
        value = np.zeros(x.shape[:-1])
        if inside.any():
            value[inside] = np.minimum(self._factor * self._call(x[inside]), 1.0)
        return value

    def support(self, level: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the points whose membership is at least ``level``.

        Parameters
        ----------
        level : float
            In [0, 1]; 0 means all possible points.

        Returns
        -------
        lower, upper : ndarray, shape (dim,)
            Bounds; infinite where unbounded.
        """
        level = as_level("level", level, or_zero=True)
        if level == 0.0:
            return self.lower, self.upper
        level = min(level, 1.0 - PEAK_TOLERANCE)
        # Nodes next to those that reach it are outside, or at the edge; the peak may be between nodes.
        axes = [np.union1d(axis, peak) for axis, peak in zip(self._search_axes(), self._peak, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        reaches = self._evaluate(points) >= level
        lower, upper = np.empty(self.dim), np.empty(self.dim)
        for k, axis in enumerate(axes):
            there = np.flatnonzero(reaches.any(axis=tuple(m for m in range(self.dim) if m != k)))
            lower[k], upper[k] = axis[max(there[0] - 1, 0)], axis[min(there[-1] + 1, axis.size - 1)]
        if self.dim == 1:
            inner = axes[0][np.flatnonzero(reaches)[[0, -1]]]
            return self._edge(inner[0], lower[0], level), self._edge(inner[1], upper[0], level)
        return lower, upper

    def _edge(self, inside: float, outside: float, level: float) -> FloatArray:
        """Where between two points (scalar x) the membership falls below ``level``, by bisection."""
        if self._evaluate(np.array([outside])) >= level:
            return np.array([outside])
        for _ in range(60):
            middle = 0.5 * (inside + outside)
            if self._evaluate(np.array([middle])) >= level:
                inside = middle
            else:
                outside = middle
        return np.array([outside])

    def reach(self, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the whole support, for every level.

        Parameters
        ----------
        levels : ndarray, shape (n,)

        Returns
        -------
        lower, upper : ndarray, shape (n, dim)
            Bounds, one row per level.
        """
        shape = (as_levels("levels", levels).size, self.dim)
        return np.broadcast_to(self.lower, shape), np.broadcast_to(self.upper, shape)


def _takes_single_numbers(
    function: Callable[[FloatArray], ArrayLike], lower: FloatArray, upper: FloatArray
) -> bool:
    """Whether a function fails on an array of points but not on a number."""
    try:
        function(np.stack([lower, upper]))
    except (TypeError, ValueError):
        try:
            float(function(float(lower[0])))  # type: ignore[arg-type]
        except (TypeError, ValueError):
            return False
        return True
    return False

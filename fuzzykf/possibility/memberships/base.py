"""What every membership function can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, as_real, is_whole
from fuzzykf.possibility.norms import as_t_norm
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.memberships.bounded import IntervalMembership
    from fuzzykf.possibility.memberships.derived import CutMembership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Membership", "as_components", "as_level", "as_levels", "as_points", "as_vector"]


@reprs("dim")
class Membership(ABC):
    """Membership function m(x) in [0, 1] with peak 1, on vectors of ``dim`` components.

    Memberships are immutable.  A subclass sets ``dim`` and implements ``_evaluate``, ``support`` and
    ``peak``; it may override other methods for speed or accuracy.

    Attributes
    ----------
    dim : int
        Number of components of x.

    Examples
    --------
    >>> from fuzzykf import GaussianMembership
    >>> wide = GaussianMembership(0.0, 4.0)
    >>> round(wide(2.0), 4)
    0.6065
    >>> wide.alpha_cut(0.5)
    IntervalMembership(lower=[-2.35482005], upper=[2.35482005])
    """

    dim: int

    @abstractmethod
    def _evaluate(self, x: FloatArray) -> FloatArray:
        """Memberships (...) of points (..., dim)."""

    @abstractmethod
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

        Raises
        ------
        ParameterError
            If the level is not in [0, 1].
        """

    @property
    @abstractmethod
    def peak(self) -> FloatArray:
        """A point (dim,) of membership 1."""

    def __call__(self, x: ArrayLike) -> Any:
        """Return the membership of points.

        Parameters
        ----------
        x : array_like
            Shape (..., dim).  If ``dim`` is 1, a number or an array of numbers will
            do as well.

        Returns
        -------
        float or ndarray
            One number per point, in [0, 1].

        Raises
        ------
        ShapeError
            If the last axis does not have length ``dim``.
        """
        points = as_numbers("x", x)
        if self.dim == 1 and (points.ndim < 2 or points.shape[-1] != 1):
            points = points[..., None]
        points = as_points(points, self.dim)
        with np.errstate(over="ignore", invalid="ignore"):
            value = self._evaluate(points)
        beyond = np.isinf(points).any(axis=-1)
        if beyond.any():  # differences of infinities are no numbers
            value = np.where(beyond & np.isnan(value), 0.0, value)
        return float(value) if value.ndim == 0 else value

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Return minus the logarithm of the membership; it does not underflow.

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        with np.errstate(divide="ignore"):
            return -np.log(self._evaluate(as_points(x, self.dim)))

    def cost(self, x: FloatArray, t_norm: TNorm) -> FloatArray:
        """Return the membership on the scale in which ``t_norm`` is additive.

        Parameters
        ----------
        x : ndarray, shape (..., dim)
        t_norm : TNorm

        Returns
        -------
        ndarray, shape (...)
        """
        return as_t_norm(t_norm).cost_of_log(self.negative_log(x))

    @property
    def is_bounded(self) -> bool:
        """Whether the set of possible points is bounded."""
        lower, upper = self.support()
        return bool(np.isfinite(lower).all() and np.isfinite(upper).all())

    def reach(self, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the points that reach each of several levels.

        Parameters
        ----------
        levels : ndarray, shape (n,)

        Returns
        -------
        lower, upper : ndarray, shape (n, dim)
            Bounds, one row per level; they may be wider than those of `support`.
        """
        levels = as_levels("levels", levels)
        lower, upper = self.support(float(levels.min(initial=1.0)))
        shape = (levels.size, self.dim)
        return np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)

    def alpha_cut(self, level: float) -> IntervalMembership:
        """Return the alpha-cut: the points whose membership is at least ``level``, or the box around them.

        Parameters
        ----------
        level : float
            In ]0, 1].

        Returns
        -------
        IntervalMembership

        Raises
        ------
        ParameterError
            If the level is not in ]0, 1].
        """
        from fuzzykf.possibility.memberships.bounded import IntervalMembership

        return IntervalMembership(*self.support(as_level("level", level)))

    def cut(self, level_or_bounds: float | Sequence[float] | Sequence[Sequence[float]]) -> CutMembership:
        """Return the same membership, set to zero outside a level set or a box.

        Parameters
        ----------
        level_or_bounds : float, (lo, hi) or ((lo, hi), ...)
            A level in ]0, 1], below which memberships become zero; or bounds, one pair per component, outside
            which they become zero.  The box must contain the peak.

        Returns
        -------
        CutMembership
            With the bounds ``lower`` and ``upper`` of the remaining points.
        """
        from fuzzykf.possibility.memberships.derived import CutMembership

        return CutMembership(self, level_or_bounds)

    def project(self, components: Sequence[int]) -> Membership:
        """Return the membership of some components: the supremum over the others.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        Membership
            Of ``len(components)`` dimensions.

        Raises
        ------
        ParameterError
            If there are none, they are not increasing, or out of range.
        """
        from fuzzykf.possibility.memberships.derived import sampled

        kept = as_components(components, self.dim)
        return self if len(kept) == self.dim else sampled(self).project(kept)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the membership: a curve in one dimension, a heat map in two.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_membership`: components, level, estimate, truth,
            label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.memberships import plot_membership

        return plot_membership(self, ax, **options)


def as_level(name: str, level: float, *, or_zero: bool = False) -> float:
    """Check a level of membership.

    Raises
    ------
    ParameterError
        If it is not in ]0, 1], or in [0, 1] where zero asks for all that is possible.
    """
    expected = f"a number in {'[' if or_zero else ']'}0, 1]"
    number = as_real(name, level, expected)
    if not (0.0 <= number <= 1.0 and (or_zero or number > 0.0)):
        raise ParameterError(f"{name}: got {level}, expected {expected}")
    return number


def as_levels(name: str, levels: ArrayLike) -> FloatArray:
    """Check several levels of membership, in [0, 1]."""
    values = as_numbers(name, levels)
    if values.ndim != 1 or not ((values >= 0.0) & (values <= 1.0)).all():
        raise ParameterError(f"{name}: got {values.tolist()}, expected a flat array of numbers in [0, 1]")
    return values


def as_points(x: ArrayLike, dim: int) -> FloatArray:
    """Check points (..., dim)."""
    points = as_numbers("x", x)
    if points.ndim == 0 or points.shape[-1] != dim:
        raise ShapeError(f"x: got shape {points.shape}, expected (..., {dim})")
    return points


def as_components(components: Sequence[int], dim: int) -> list[int]:
    """Check which of ``dim`` components are asked for.

    Raises
    ------
    ParameterError
        If they are none, not in increasing order, or not there.
    """
    try:
        asked = list(components)
    except TypeError:
        asked = []
    rising = all(map(is_whole, asked)) and all(
        a < b for a, b in zip([-1, *asked], [*asked, dim], strict=True)
    )
    if not asked or not rising:
        raise ParameterError(
            f"components: got {components!r}, expected some of 0 to {dim - 1}, in increasing order"
        )
    return [int(k) for k in asked]


def as_vector(name: str, value: ArrayLike, dim: int | None = None) -> FloatArray:
    """Copy a number or a flat, row or column vector into a finite vector (dim,).

    Raises
    ------
    ShapeError, ParameterError
        Wrong shape; not finite.
    """
    array = as_numbers(name, value)
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    return as_array(name, np.atleast_1d(array), (dim,))

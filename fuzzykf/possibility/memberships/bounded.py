"""Memberships that are not smooth: triangles, intervals and boxes, points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.possibility.memberships.base import Membership, as_components, as_level, as_levels, as_vector
from fuzzykf.reprs import reprs, shown, value_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["BoxMembership", "IntervalMembership", "SingletonMembership", "TriangularMembership"]


@reprs("left", "peak", "right")
class TriangularMembership(Membership):
    """Triangular membership that rises from ``left`` to ``peak`` and falls to ``right``.

    In several dimensions, it is the minimum over the components, a pyramid whose level sets are boxes.

    Parameters
    ----------
    left, peak, right : float or array_like, shape (dim,)
        Corners, with left <= peak <= right and left < right.

    Raises
    ------
    ShapeError, ParameterError
        If the shape is wrong, or the corners are not finite or not in this order.

    Examples
    --------
    >>> triangle = TriangularMembership(-1.0, 0.0, 2.0)
    >>> triangle([-0.5, 1.0, 3.0])
    array([0.5, 0.5, 0. ])
    >>> triangle.alpha_cut(0.5)
    IntervalMembership(lower=[-0.5], upper=[1.])
    """

    def __init__(self, left: ArrayLike, peak: ArrayLike, right: ArrayLike) -> None:
        self.left = as_vector("left", left)
        self.dim = self.left.size
        self._peak = as_vector("peak", peak, self.dim)
        self.right = as_vector("right", right, self.dim)
        if not ((self.left <= self._peak) & (self._peak <= self.right) & (self.left < self.right)).all():
            raise ParameterError(
                f"left, peak, right: got {self.left.tolist()}, {self._peak.tolist()}, {self.right.tolist()}, "
                "expected left <= peak <= right and left < right (for a point, use SingletonMembership)"
            )

    @property
    def peak(self) -> FloatArray:
        """The point of membership 1, (dim,)."""
        return self._peak

    def _evaluate(self, x: FloatArray) -> FloatArray:
        # A side of length zero is a jump: nothing beyond it is possible.
        rise, fall = self._peak - self.left, self.right - self._peak
        with np.errstate(divide="ignore", invalid="ignore"):
            below = np.where(x < self._peak, (x - self.left) / rise, 1.0)
            above = np.where(x > self._peak, (self.right - x) / fall, 1.0)
        return np.asarray(np.clip(np.minimum(below, above), 0.0, 1.0).min(axis=-1))

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
        lower = self.left + level * (self._peak - self.left)
        return lower, self.right - level * (self.right - self._peak)

    def reach(self, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the points that reach each of several levels.

        Parameters
        ----------
        levels : ndarray, shape (n,)

        Returns
        -------
        lower, upper : ndarray, shape (n, dim)
            Bounds, one row per level.
        """
        levels = as_levels("levels", levels)
        lower = self.left + np.outer(levels, self._peak - self.left)
        return lower, self.right - np.outer(levels, self.right - self._peak)

    def project(self, components: Sequence[int]) -> TriangularMembership:
        """Return the membership of some components.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        TriangularMembership
        """
        index = as_components(components, self.dim)
        return TriangularMembership(self.left[index], self._peak[index], self.right[index])


@reprs("lower", "upper")
class IntervalMembership(Membership):
    """A crisp interval or box: membership 1 inside, 0 outside.

    Parameters
    ----------
    lower, upper : float or array_like, shape (dim,)
        Bounds, lower <= upper; equal bounds are allowed.

    Attributes
    ----------
    lower, upper : ndarray, shape (dim,)
        The bounds.

    Raises
    ------
    ShapeError, ParameterError
        If the shape is wrong, a bound is not finite, or lower > upper.

    Notes
    -----
    Layne and Passino (2001), equations (47)-(49).

    Examples
    --------
    >>> interval = IntervalMembership(-3.0, 3.0)
    >>> interval(2.0), interval(4.0)
    (1.0, 0.0)
    """

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        self.lower = as_vector("lower", lower)
        self.dim = self.lower.size
        self.upper = as_vector("upper", upper, self.dim)
        if (self.lower > self.upper).any():
            k = int(np.argmax(self.lower > self.upper))
            raise ParameterError(
                f"lower, upper: component {k} is [{self.lower[k]:.6g}, {self.upper[k]:.6g}], "
                "expected lower <= upper"
            )

    @property
    def peak(self) -> FloatArray:
        """The center (dim,)."""
        center: FloatArray = 0.5 * self.lower + 0.5 * self.upper
        return center

    def _evaluate(self, x: FloatArray) -> FloatArray:
        inside = np.asarray((x >= self.lower) & (x <= self.upper)).all(axis=-1)
        return np.asarray(inside, dtype=np.float64)

    def support(self, level: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return the bounds; they do not depend on the level.

        Parameters
        ----------
        level : float
            In [0, 1]; 0 means all possible points.

        Returns
        -------
        lower, upper : ndarray, shape (dim,)
            Bounds; infinite where unbounded.
        """
        as_level("level", level, or_zero=True)
        return self.lower, self.upper

    def project(self, components: Sequence[int]) -> IntervalMembership:
        """Return the membership of some components.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        IntervalMembership
        """
        index = as_components(components, self.dim)
        return IntervalMembership(self.lower[index], self.upper[index])


class SingletonMembership(IntervalMembership):
    """A single point: membership 1 there, 0 elsewhere.

    Parameters
    ----------
    point : float or array_like, shape (dim,)
        The only possible point.

    Notes
    -----
    Layne and Passino (2001), equation (19).

    Examples
    --------
    >>> SingletonMembership([0.0, 0.0])([[0.0, 0.0], [0.0, 1.0]])
    array([1., 0.])
    """

    def __init__(self, point: ArrayLike) -> None:
        vector = as_vector("point", point)
        super().__init__(vector, vector)

    @property
    def point(self) -> FloatArray:
        """The only possible point (dim,)."""
        return self.lower

    @shown
    def __repr__(self) -> str:
        return f"{type(self).__name__}({value_text(self.lower)})"


@reprs("lower", "upper")
class BoxMembership(Membership):
    """A crisp box that may be unbounded: membership 1 inside, 0 outside.

    Use it as the constraint of a state; for states and noises, use `IntervalMembership`, which is bounded.

    Parameters
    ----------
    lower, upper : float or array_like, shape (dim,)
        Bounds, lower <= upper; -inf and inf where unbounded.

    Attributes
    ----------
    lower, upper : ndarray, shape (dim,)
        The bounds.

    Raises
    ------
    ShapeError, ParameterError
        If the shape is wrong, a bound is NaN, or lower > upper.

    Examples
    --------
    >>> import numpy as np
    >>> BoxMembership(0.0, np.inf)([-1.0, 0.0, 1e9])
    array([0., 1., 1.])
    """

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        self.lower, self.upper = (
            np.atleast_1d(as_numbers(name, value)).astype(np.float64)
            for name, value in (("lower", lower), ("upper", upper))
        )
        self.dim = self.lower.size
        if self.lower.ndim != 1 or self.upper.shape != self.lower.shape or not self.dim:
            raise ShapeError(
                f"lower, upper: got shapes {self.lower.shape} and {self.upper.shape}, expected (dim,) twice"
            )
        wrong = ~((self.lower <= self.upper) & (self.lower < np.inf) & (self.upper > -np.inf))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise ParameterError(
                f"lower, upper: component {k} is [{self.lower[k]:.6g}, {self.upper[k]:.6g}], "
                "expected lower <= upper"
            )

    @property
    def peak(self) -> FloatArray:
        """A point (dim,) inside the box."""
        finite_lower, finite_upper = np.isfinite(self.lower), np.isfinite(self.upper)
        lower, upper = np.where(finite_lower, self.lower, 0.0), np.where(finite_upper, self.upper, 0.0)
        beside = np.where(finite_lower, lower + 1.0 + np.abs(lower), upper - 1.0 - np.abs(upper))
        open_ = np.where(finite_lower | finite_upper, beside, 0.0)
        return np.where(finite_lower & finite_upper, 0.5 * lower + 0.5 * upper, open_)

    def _evaluate(self, x: FloatArray) -> FloatArray:
        inside = np.asarray((x >= self.lower) & (x <= self.upper)).all(axis=-1)
        return np.asarray(inside, dtype=np.float64)

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
        as_level("level", level, or_zero=True)
        return self.lower, self.upper

    def project(self, components: Sequence[int]) -> BoxMembership:
        """Return the membership of some components.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        BoxMembership
        """
        index = as_components(components, self.dim)
        return BoxMembership(self.lower[index], self.upper[index])

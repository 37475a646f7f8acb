"""What every membership function can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import MissingDependencyError, ParameterError, ShapeError
from fuzzykf.gaussian import as_array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray
    from fuzzykf.possibility.memberships.bounded import IntervalMembership
    from fuzzykf.possibility.memberships.derived import CutMembership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Membership", "as_level", "as_vector"]


class Membership(ABC):
    """A membership function m(x) in [0, 1] with peak 1 on a space of ``dim`` dimensions.

    Memberships are immutable values.  A subclass sets ``dim`` and implements `_evaluate`
    and `support`; it may override the rest where it knows better.

    Attributes
    ----------
    dim : int
        Number of components of x.
    """

    dim: int

    @abstractmethod
    def _evaluate(self, x: FloatArray) -> FloatArray:
        """Memberships (...) of points (..., dim)."""

    @abstractmethod
    def support(self, level: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Bounds of the box around all points whose membership reaches ``level``.

        Parameters
        ----------
        level : float
            In [0, 1]; 0 asks for the points that are possible at all.

        Returns
        -------
        lower, upper : ndarray, shape (dim,)
            Infinite where unbounded.
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
        points = np.asarray(x, dtype=np.float64)
        if self.dim == 1 and (points.ndim < 2 or points.shape[-1] != 1):
            points = points[..., None]
        if points.ndim == 0 or points.shape[-1] != self.dim:
            raise ShapeError(f"x: got shape {points.shape}, expected (..., {self.dim})")
        value = self._evaluate(points)
        return float(value) if value.ndim == 0 else value

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Minus the logarithm of the memberships of points (..., dim); it may exceed 745."""
        with np.errstate(divide="ignore"):
            return -np.log(self._evaluate(x))

    def cost(self, x: FloatArray, t_norm: TNorm) -> FloatArray:
        """Memberships of points (..., dim) in the scale in which ``t_norm`` adds."""
        return t_norm.cost_of_log(self.negative_log(x))

    @property
    def is_bounded(self) -> bool:
        """Whether only a bounded set of points is possible."""
        lower, upper = self.support()
        return bool(np.isfinite(lower).all() and np.isfinite(upper).all())

    def reach(self, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds, component by component, of the points reaching each of many levels.

        Returns
        -------
        lower, upper : ndarray, shape (n, dim)
            Possibly wider than `support` would say.
        """
        lower, upper = self.support(float(levels.min(initial=1.0)))
        shape = (levels.size, self.dim)
        return np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)

    def alpha_cut(self, level: float) -> IntervalMembership:
        """Return the (smallest box around the) set of points whose membership reaches ``level``.

        Parameters
        ----------
        level : float
            In ]0, 1].

        Raises
        ------
        ParameterError
            If the level is not in ]0, 1].
        """
        from fuzzykf.possibility.memberships.bounded import IntervalMembership

        return IntervalMembership(*self.support(as_level("level", level)))

    def cut(self, level_or_bounds: float | Sequence[float] | Sequence[Sequence[float]]) -> CutMembership:
        """Return the same membership, set to zero outside a cut.

        Parameters
        ----------
        level_or_bounds : float, (lo, hi) or ((lo, hi), ...)
            A level in ]0, 1]: memberships below it become zero.  Bounds, one pair per
            component: so do those outside the box, which must hold the peak.

        Returns
        -------
        CutMembership
            It has ``lower`` and ``upper``, the bounds of what is left.
        """
        from fuzzykf.possibility.memberships.derived import CutMembership

        return CutMembership(self, level_or_bounds)

    def project(self, components: Sequence[int]) -> Membership:
        """Return the membership of some components: the supremum over the others.

        Parameters
        ----------
        components : sequence of int
            In increasing order.
        """
        from fuzzykf.possibility.memberships.derived import sampled

        return self if list(components) == list(range(self.dim)) else sampled(self).project(components)

    def plot(self, ax: Axes | None = None, *, level: float = 1e-3) -> Axes:
        """Draw the membership: a curve in one dimension, filled contours in two.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            A new one by default.
        level : float
            The picture shows what reaches this membership.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        MissingDependencyError
            If matplotlib is not installed.
        ParameterError
            If there are more than two dimensions; `project` them.
        """
        if self.dim > 2:
            raise ParameterError(f"plot: got {self.dim} dimensions, expected 1 or 2; project the others away")
        try:
            import matplotlib.pyplot as plt
        except ImportError as error:
            raise MissingDependencyError("plot needs matplotlib: pip install 'fuzzykf[cli]'") from error
        if ax is None:
            ax = plt.subplots()[1]
        lower, upper = self.support(as_level("level", level))
        margin = 0.05 * (upper - lower) + np.where(upper > lower, 0.0, 1.0)
        axes = [np.linspace(a, b, 301) for a, b in zip(lower - margin, upper + margin, strict=True)]
        if self.dim == 1:
            ax.plot(axes[0], self._evaluate(axes[0][:, None]))
            ax.set(xlabel="x", ylabel="membership", ylim=(-0.02, 1.05))
        else:
            points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            levels = np.linspace(0.0, 1.0, 11)
            filled = ax.contourf(axes[0], axes[1], self._evaluate(points).T, levels, cmap="viridis")
            ax.figure.colorbar(filled, ax=ax, label="membership")
            ax.set(xlabel="$x_1$", ylabel="$x_2$")
        return ax


def as_level(name: str, level: float) -> float:
    """Check a level of membership.

    Raises
    ------
    ParameterError
        If it is not in ]0, 1].
    """
    if not 0.0 < level <= 1.0:
        raise ParameterError(f"{name}: got {level}, expected a number in ]0, 1]")
    return float(level)


def as_vector(name: str, value: ArrayLike, dim: int | None = None) -> FloatArray:
    """Copy a number or a flat, row or column vector into a finite vector (dim,).

    Raises
    ------
    ShapeError, ParameterError
        Wrong shape; not finite.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name}: expected a vector of numbers, got {value!r}") from error
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    return as_array(name, np.atleast_1d(array), (dim,))

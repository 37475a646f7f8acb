"""Memberships of a quadratic form: Gaussian, Cauchy and parabolic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, check_covariance, whitening
from fuzzykf.possibility.memberships.base import (
    Membership,
    as_components,
    as_level,
    as_levels,
    as_points,
    as_vector,
)
from fuzzykf.possibility.norms import as_t_norm
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.norms import TNorm

__all__ = ["CauchyMembership", "EllipticalMembership", "GaussianMembership", "ParabolicMembership"]

#: A point is off the range of a singular matrix if it is off by more than this rounding error.
OFF_RANGE = 1e-12

#: Scales are squared.
LARGEST_SCALE = 1e154


@reprs("center", "matrix")
class EllipticalMembership(Membership):
    """Base class: decreasing function of q(x) = (x - center)' matrix^-1 (x - center).

    The matrix may be singular: points outside its range have membership zero.

    Attributes
    ----------
    center : ndarray, shape (dim,)
        The peak.
    matrix : ndarray, shape (dim, dim)
        Positive semi-definite.

    Examples
    --------
    >>> from fuzzykf import CauchyMembership
    >>> from fuzzykf.possibility.memberships import EllipticalMembership
    >>> isinstance(CauchyMembership(0.0, 1.0), EllipticalMembership)
    True
    """

    #: Name of the closed family, as in `TNorm.family`.
    family: str

    def __init__(self, center: FloatArray, matrix: FloatArray) -> None:
        self.dim = center.size
        self.center = center
        self.matrix = matrix
        self._whiten, self._null = whitening(matrix)

    @property
    def peak(self) -> FloatArray:
        """The center (dim,)."""
        return self.center

    def quadratic(self, x: FloatArray) -> FloatArray:
        """Return the quadratic form q; infinite outside the range of a singular matrix.

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        x = as_points(x, self.dim)
        with np.errstate(over="ignore", invalid="ignore"):
            value = self._quadratic(x)
        if not np.isnan(value).any():
            return value
        # differences of infinities are no numbers: a point without end is infinitely far off
        return np.where(np.isinf(x).any(axis=-1) & np.isnan(value), np.inf, value)

    def _quadratic(self, x: FloatArray) -> FloatArray:
        if self.dim == 1 and self._whiten.size:
            scaled: FloatArray = (x[..., 0] - self.center[0]) * self._whiten[0, 0]
            return scaled * scaled
        residual = x - self.center
        value: FloatArray = ((residual @ self._whiten.T) ** 2).sum(axis=-1)
        if self._null.size:
            allowed = OFF_RANGE * (np.abs(x) + np.abs(self.center)) @ np.abs(self._null).T
            value = np.where((np.abs(residual @ self._null.T) > allowed).any(axis=-1), np.inf, value)
        return value

    def _evaluate(self, x: FloatArray) -> FloatArray:
        return np.exp(-self.negative_log(x))

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
        at = np.array(as_level("level", level, or_zero=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.sqrt(np.diag(self.matrix) * self._quadratic_at(at))
        half = np.where(np.diag(self.matrix) > 0.0, half, 0.0)
        return self.center - half, self.center + half

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
        half = np.sqrt(np.outer(self._quadratic_at(as_levels("levels", levels)), np.diag(self.matrix)))
        return self.center - half, self.center + half

    def _quadratic_at(self, level: FloatArray) -> FloatArray:
        """Value of q at which the membership falls to ``level``."""
        raise NotImplementedError

    def with_matrix(self, center: FloatArray, matrix: FloatArray) -> Self:
        """Return a membership of the same class with another center and matrix.

        Parameters
        ----------
        center : ndarray, shape (dim,)
        matrix : ndarray, shape (dim, dim)

        Returns
        -------
        EllipticalMembership
            Of the same class.
        """
        new = type(self).__new__(type(self))
        EllipticalMembership.__init__(new, center, matrix)
        return new

    def project(self, components: Sequence[int]) -> Self:
        """Return the membership of some components, with their block of the matrix.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        EllipticalMembership
            Of the same class.
        """
        index = as_components(components, self.dim)
        return self.with_matrix(self.center[index], self.matrix[np.ix_(index, index)])


@reprs("mean", "covariance")
class GaussianMembership(EllipticalMembership):
    """Gaussian membership exp(-q/2), with q = (x - mean)' covariance^-1 (x - mean).

    Parameters
    ----------
    mean : float or array_like, shape (dim,)
        The peak.
    covariance : float or array_like, shape (dim, dim)
        Positive semi-definite; in one dimension, the variance.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If the shape is wrong, or the covariance is not finite, symmetric and positive semi-definite.

    Notes
    -----
    Layne and Passino (2001), equation (31).

    Examples
    --------
    >>> membership = GaussianMembership(1.0, 4.0)
    >>> round(membership(3.0), 4)
    0.6065
    >>> membership.support(0.5)
    (array([-1.35482005]), array([3.35482005]))
    """

    family = "gaussian"

    def __init__(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        center = as_vector("mean", mean)
        given = as_numbers("covariance", covariance)
        matrix = given.reshape(1, 1) if given.ndim == 0 else given
        super().__init__(center, check_covariance("covariance", matrix, (center.size, center.size)))

    @property
    def mean(self) -> FloatArray:
        """The peak (dim,)."""
        return self.center

    @property
    def covariance(self) -> FloatArray:
        """The matrix of the quadratic form (dim, dim)."""
        return self.matrix

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Return q / 2.

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        return 0.5 * self.quadratic(x)

    def _quadratic_at(self, level: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            return -2.0 * np.log(level)


class _ScaledMembership(EllipticalMembership):
    """An elliptical membership given by center and scale."""

    def __init__(self, center: ArrayLike, scale: ArrayLike) -> None:
        vector = as_vector("center", center)
        super().__init__(vector, _scale_matrix(scale, vector.size))

    @property
    def scale(self) -> Any:
        """The scale: a number in one dimension, else the matrix of the quadratic form."""
        return float(np.sqrt(self.matrix[0, 0])) if self.dim == 1 else self.matrix


@reprs("center", "scale")
class CauchyMembership(_ScaledMembership):
    """Cauchy membership 1 / (1 + q), with q = |x - center|^2 / scale^2.

    Parameters
    ----------
    center : float or array_like, shape (dim,)
        The peak.
    scale : float or array_like
        A nonnegative number or vector (dim,) of scales; or, as for the
        multivariate t distribution, a positive semi-definite scale matrix
        (dim, dim) in squared units: q = (x - center)' scale^-1 (x - center).

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If the shape is wrong, or the scale is not finite and nonnegative.

    Notes
    -----
    Layne and Passino (2001), equations (92) and (93).

    If state and noises all have this shape and the t-norm is Hamacher's, the estimator has a closed form.
    That form is not robust to outliers; on a grid it is (see `FuzzyRelationEstimator`).

    Examples
    --------
    >>> CauchyMembership(0.0, 15.0)(15.0)
    0.5
    """

    family = "cauchy"

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Return log(1 + q).

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        return np.log1p(self.quadratic(x))

    def _evaluate(self, x: FloatArray) -> FloatArray:
        return 1.0 / (1.0 + self.quadratic(x))

    def _quadratic_at(self, level: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            return 1.0 / level - 1.0


@reprs("center", "scale")
class ParabolicMembership(_ScaledMembership):
    """Parabolic membership max(0, 1 - q), with q = |x - center|^2 / scale^2.

    Parameters
    ----------
    center : float or array_like, shape (dim,)
        The peak.
    scale : float or array_like
        A nonnegative number or vector (dim,): the distance at which the membership becomes
        zero; or a positive semi-definite matrix (dim, dim) in squared
        units: q = (x - center)' scale^-1 (x - center).

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If the shape is wrong, or the scale is not finite and nonnegative.

    Examples
    --------
    >>> ParabolicMembership([0.0, 0.0], [1.0, 2.0])([0.0, 1.0])
    0.75
    """

    family = "parabolic"

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Return -log(1 - q); infinite for q >= 1.

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        with np.errstate(divide="ignore"):
            return -np.log(self._evaluate(x))

    def _evaluate(self, x: FloatArray) -> FloatArray:
        return np.maximum(0.0, 1.0 - self.quadratic(x))

    def cost(self, x: FloatArray, t_norm: TNorm) -> FloatArray:
        """Return costs; for Łukasiewicz, the quadratic form itself, also above 1.

        All costs of at least one are impossible, but quadratic costs can be interpolated across the edge of
        the support without error.

        Parameters
        ----------
        x : ndarray, shape (..., dim)
        t_norm : TNorm

        Returns
        -------
        ndarray, shape (...)
        """
        t_norm = as_t_norm(t_norm)
        own = t_norm.additive and t_norm.scale == "complement"
        return self.quadratic(x) if own else super().cost(x, t_norm)

    def _quadratic_at(self, level: FloatArray) -> FloatArray:
        return 1.0 - level


def _scale_matrix(scale: ArrayLike, dim: int) -> FloatArray:
    """Turn a scale, scales or a scale matrix into the matrix of the quadratic form."""
    value = as_numbers("scale", scale).copy()
    if value.ndim == 2:
        return check_covariance("scale", value, (dim, dim))
    if value.ndim > 2 or value.shape not in {(), (dim,)}:
        raise ShapeError(f"scale: got shape {value.shape}, expected (), ({dim},) or ({dim}, {dim})")
    if not ((value >= 0.0) & (value <= LARGEST_SCALE)).all():
        raise ParameterError(
            f"scale: got {value.tolist()}, expected numbers from 0 to {LARGEST_SCALE:g}, as they are squared"
        )
    return np.diag(np.broadcast_to(value, (dim,)) ** 2)

"""Memberships made from others: cut, joined component by component, or sampled."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.possibility.memberships.base import (
    Membership,
    as_components,
    as_level,
    as_levels,
    as_points,
)
from fuzzykf.possibility.memberships.bounded import BoxMembership, IntervalMembership, SingletonMembership
from fuzzykf.possibility.memberships.sampled import GridMembership
from fuzzykf.possibility.norms import as_t_norm
from fuzzykf.reprs import ENTRIES, reprs, shown, value_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.norms import TNorm

__all__ = ["CutMembership", "JointMembership", "as_box", "as_membership", "sampled"]

#: Memberships on the very edge of a cut may fall below its level by rounding.
ROUNDING = 1e-12

#: Nodes per axis of a sampled membership, by number of dimensions.
NODES = {1: 2001, 2: 201}


@reprs("base", "level", "lower", "upper")
class CutMembership(Membership):
    """Membership set to zero outside a level set or a box, from `Membership.cut`.

    Parameters
    ----------
    base : Membership
        Membership to cut.
    level_or_bounds : float, (lo, hi) or ((lo, hi), ...)
        See `Membership.cut`.

    Attributes
    ----------
    base : Membership
        Membership before the cut.
    level : float
        Level below which memberships are zero; 0 for a cut by bounds.
    lower, upper : ndarray, shape (dim,)
        Bounds of the remaining points.

    Raises
    ------
    ParameterError
        If the level is not in ]0, 1], or the cut removes the peak.

    Examples
    --------
    >>> from fuzzykf import CauchyMembership
    >>> noise = CauchyMembership(0.0, 15.0).cut(0.5)
    >>> noise.lower, noise.upper, noise([15.0, 16.0])
    (array([-15.]), array([15.]), array([0.5, 0. ]))
    """

    def __init__(
        self, base: Membership, level_or_bounds: float | Sequence[float] | Sequence[Sequence[float]]
    ) -> None:
        if not isinstance(base, Membership):
            raise ParameterError(f"base: got {type(base).__name__}, expected a membership")
        self.base = base
        self.dim = base.dim
        given: Any = level_or_bounds
        single = isinstance(given, str) or not hasattr(given, "__len__")
        bounds = np.empty(0) if single else as_numbers("bounds", given).copy()
        if single or bounds.ndim == 0:
            self.level = as_level("level", given)
            self.lower, self.upper = base.support(self.level)
        else:
            if self.dim == 1 and bounds.shape == (2,):
                bounds = bounds[None]
            if bounds.shape != (self.dim, 2):
                raise ShapeError(
                    f"bounds: got shape {bounds.shape}, expected one pair (lo, hi) for each of "
                    f"{self.dim} components"
                )
            self.level = 0.0
            lower, upper = base.support()
            self.lower, self.upper = np.maximum(lower, bounds[:, 0]), np.minimum(upper, bounds[:, 1])
        self._peak = np.clip(base.peak, self.lower, self.upper)
        if not (self.lower <= self.upper).all() or float(base._evaluate(self._peak)) < 1.0 - ROUNDING:
            raise ParameterError(
                f"bounds: got {level_or_bounds}, which cuts off the peak at {base.peak.tolist()}; "
                "the membership would never reach 1"
            )

    @property
    def peak(self) -> FloatArray:
        """A point (dim,) of membership 1."""
        return self._peak

    def _kept(self, x: FloatArray, value: FloatArray, least: float) -> NDArray[np.bool_]:
        slack = ROUNDING * np.maximum(np.abs(self.lower), np.abs(self.upper))
        inside = ((x >= self.lower - slack) & (x <= self.upper + slack)).all(axis=-1)
        return inside & (value >= least * (1.0 - ROUNDING))

    def _evaluate(self, x: FloatArray) -> FloatArray:
        value = self.base._evaluate(x)
        return np.where(self._kept(x, value, self.level), value, 0.0)

    def cost(self, x: FloatArray, t_norm: TNorm) -> FloatArray:
        """Return costs of the base inside the cut, and of impossible points outside.

        Parameters
        ----------
        x : ndarray, shape (..., dim)
        t_norm : TNorm

        Returns
        -------
        ndarray, shape (...)
        """
        x, t_norm = as_points(x, self.dim), as_t_norm(t_norm)
        value = self.base._evaluate(x)
        return np.where(self._kept(x, value, self.level), self.base.cost(x, t_norm), t_norm.impossible)

    def negative_log(self, x: FloatArray) -> FloatArray:
        """Return minus the logarithm of the membership.

        Parameters
        ----------
        x : ndarray, shape (..., dim)

        Returns
        -------
        ndarray, shape (...)
        """
        x = as_points(x, self.dim)
        value = self.base._evaluate(x)
        return np.where(self._kept(x, value, self.level), self.base.negative_log(x), np.inf)

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
        lower, upper = self.base.support(max(as_level("level", level, or_zero=True), self.level))
        return np.maximum(lower, self.lower), np.minimum(upper, self.upper)

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
        lower, upper = self.base.reach(np.maximum(as_levels("levels", levels), self.level))
        return np.maximum(lower, self.lower), np.minimum(upper, self.upper)

    def project(self, components: Sequence[int]) -> Membership:
        """Return the membership of some components: the supremum over the others.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        Membership
        """
        if self.level > 0.0:
            return CutMembership(self.base.project(components), self.level)
        return super().project(components)


class JointMembership(Membership):
    """Scalar memberships, one per component, joined by a t-norm.

    Parameters
    ----------
    components : sequence of Membership
        Each of dimension 1.
    t_norm : TNorm
        T-norm that combines them.

    Examples
    --------
    >>> from fuzzykf import GaussianMembership, IntervalMembership
    >>> from fuzzykf.possibility.norms import PRODUCT
    >>> joint = JointMembership(
    ...     [GaussianMembership(0.0, 1.0), IntervalMembership(0.0, 1.0)], PRODUCT
    ... )
    >>> round(joint([1.0, 0.5]), 4), joint([1.0, 2.0])
    (0.6065, 0.0)
    """

    def __init__(self, components: Sequence[Membership], t_norm: TNorm) -> None:
        try:
            self.components = tuple(components)
        except TypeError as error:
            raise ParameterError(
                f"components: got {brief(components)}, expected scalar memberships"
            ) from error
        self.t_norm = as_t_norm(t_norm)
        self.dim = len(self.components)
        if not self.components:
            raise ShapeError("components: got none, expected at least one scalar membership")
        for k, component in enumerate(self.components):
            if not isinstance(component, Membership):
                raise ParameterError(
                    f"components: number {k} is {brief(component)}, expected a scalar membership"
                )
            if component.dim != 1:
                raise ShapeError(f"components: number {k} has {component.dim} dimensions, expected 1")

    @property
    def peak(self) -> FloatArray:
        """The peaks of the components (dim,)."""
        return np.concatenate([component.peak for component in self.components])

    def _evaluate(self, x: FloatArray) -> FloatArray:
        return self.t_norm(*(c._evaluate(x[..., k : k + 1]) for k, c in enumerate(self.components)))

    def cost(self, x: FloatArray, t_norm: TNorm) -> FloatArray:
        """Return costs, without loss of accuracy if ``t_norm`` is that of the components.

        Parameters
        ----------
        x : ndarray, shape (..., dim)
        t_norm : TNorm

        Returns
        -------
        ndarray, shape (...)
        """
        x, t_norm = as_points(x, self.dim), as_t_norm(t_norm)
        if t_norm != self.t_norm:
            return super().cost(x, t_norm)
        costs = (c.cost(x[..., k : k + 1], t_norm) for k, c in enumerate(self.components))
        return reduce(t_norm.combine, costs)

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
        bounds = [component.support(level) for component in self.components]
        return np.concatenate([b[0] for b in bounds]), np.concatenate([b[1] for b in bounds])

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
        bounds = [component.reach(levels) for component in self.components]
        return np.hstack([b[0] for b in bounds]), np.hstack([b[1] for b in bounds])

    def project(self, components: Sequence[int]) -> JointMembership:
        """Return the membership of some components.

        Parameters
        ----------
        components : sequence of int
            In increasing order.

        Returns
        -------
        JointMembership
        """
        return JointMembership([self.components[k] for k in as_components(components, self.dim)], self.t_norm)

    @shown
    def __repr__(self) -> str:
        inner = ", ".join(map(value_text, self.components[:ENTRIES]))
        more = len(self.components) - ENTRIES
        told = f"{inner}, and {more} more" if more > 0 else inner
        return f"{type(self).__name__}([{told}], t_norm={self.t_norm.name!r})"


def as_membership(
    name: str, value: Membership | Sequence[Membership | None] | None, dim: int, t_norm: TNorm
) -> Membership:
    """Turn what a user gave for a state or a noise into one membership of that dimension.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : Membership, sequence of Membership or None, or None
        One membership, or one scalar membership or None (no noise) per component.
    dim : int
    t_norm : TNorm
        How the components combine.

    Raises
    ------
    ParameterError
        If the dimension or the number of components is another.
    """
    if value is None:
        return SingletonMembership(np.zeros(dim))
    if isinstance(value, Membership):
        if value.dim != dim:
            raise ParameterError(f"{name}: got a membership of {value.dim} dimensions, expected {dim}")
        if isinstance(value, BoxMembership):
            raise ParameterError(
                f"{name}: got {value!r}, which a constraint may be; expected an IntervalMembership or "
                "another membership"
            )
        return value
    try:
        components: list[Any] = list(value)
    except TypeError as error:
        raise ParameterError(
            f"{name}: got {value!r}, expected a membership, or a sequence of memberships or None"
        ) from error
    if len(components) != dim:
        raise ParameterError(f"{name}: got {len(components)} components, expected {dim}")
    for k, component in enumerate(components):
        if component is not None and not (isinstance(component, Membership) and component.dim == 1):
            raise ParameterError(f"{name}[{k}]: got {component!r}, expected a scalar membership or None")
    filled = [SingletonMembership(0.0) if c is None else c for c in components]
    return filled[0] if dim == 1 else JointMembership(filled, t_norm)


def as_box(membership: Membership) -> IntervalMembership | None:
    """Return a crisp membership as a box; None if it is not crisp."""
    if isinstance(membership, IntervalMembership):
        return membership
    if isinstance(membership, JointMembership):
        boxes = [
            component for component in membership.components if isinstance(component, IntervalMembership)
        ]
        if len(boxes) == membership.dim:
            lower, upper = membership.support()
            return IntervalMembership(lower, upper)
    return None


def sampled(membership: Membership, level: float = 1e-8) -> GridMembership:
    """Return a membership sampled on a grid over its support.

    Parameters
    ----------
    membership : Membership
        Membership to sample.
    level : float
        If the support is unbounded, memberships below this level are omitted.

    Returns
    -------
    GridMembership

    Examples
    --------
    >>> from fuzzykf import GaussianMembership
    >>> from fuzzykf.possibility.memberships import sampled
    >>> round(sampled(GaussianMembership(0.0, 1.0))(1.0), 3)
    0.607
    """
    if not isinstance(membership, Membership):
        raise ParameterError(f"membership: got {brief(membership)}, expected a membership")
    lower, upper = membership.support(0.0 if membership.is_bounded else level)
    nodes = NODES.get(membership.dim, 41)
    axes = [
        np.unique(np.append(np.linspace(a, b, nodes), peak)) if b > a else np.array([a])
        for a, b, peak in zip(lower, upper, membership.peak, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return GridMembership(axes, membership._evaluate(points))

"""Which representation an estimator uses: decided once, from what it was given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, check_covariance
from fuzzykf.possibility.grid.lattice import Universe
from fuzzykf.possibility.memberships import (
    BoxMembership,
    CauchyMembership,
    EllipticalMembership,
    GaussianMembership,
    IntervalMembership,
    JointMembership,
    Membership,
    ParabolicMembership,
    SingletonMembership,
)
from fuzzykf.possibility.memberships.derived import as_box, as_membership

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray, Numbers
    from fuzzykf.possibility.norms import TNorm

__all__ = [
    "FAMILIES",
    "Choice",
    "Representation",
    "as_box",
    "as_center",
    "as_matrix",
    "as_quadratic",
    "as_used",
    "check_constraint",
    "choose",
    "no_matrix",
    "required_box",
    "required_quadratic",
    "universe_of",
]

Representation: TypeAlias = Literal["gaussian", "cauchy", "parabolic", "interval", "grid"]

#: Memberships of the closed families.
FAMILIES: dict[str, type[EllipticalMembership]] = {
    "gaussian": GaussianMembership,
    "cauchy": CauchyMembership,
    "parabolic": ParabolicMembership,
}

#: Nodes per axis unless given, by number of state dimensions.
POINTS = {1: 401, 2: 101, 3: 41}

#: Default floor of a moving grid: six standard deviations of a Gaussian, or, with an uncut
#: Cauchy membership, ten times its scale.
FLOOR, HEAVY_FLOOR = float(np.exp(-18.0)), 0.01


@dataclass(frozen=True, eq=False)
class Choice:
    """What `choose` decided.

    Attributes
    ----------
    representation : str
    state, process_noise, measurement_noise : Membership
        Defaults filled in.
    """

    representation: Representation
    state: Membership
    process_noise: Membership
    measurement_noise: Membership


def choose(
    dim_x: int,
    dim_z: int,
    t_norm: TNorm,
    *,
    state: Any,
    process_noise: Any,
    measurement_noise: Any,
    nonlinear: bool,
    enclosed: bool,
    grid: bool,
) -> Choice:
    """Choose the representation (the rule stands in `FuzzyRelationEstimator`).

    Parameters
    ----------
    dim_x, dim_z : int
    t_norm : TNorm
    state, process_noise, measurement_noise : Membership, sequence or None
        As given by the user.
    nonlinear : bool
        Whether fx or hx was given.
    enclosed : bool
        Whether intervals can be mapped: all functions given are scalar, or have an
        interval extension.
    grid : bool
        Whether a grid was asked for.

    Raises
    ------
    ParameterError
        If a membership is missing, or of the wrong dimension.
    """
    given = [
        None if value is None else as_membership(name, value, dim, t_norm)
        for name, value, dim in (
            ("state", state, dim_x),
            ("process_noise", process_noise, dim_x),
            ("measurement_noise", measurement_noise, dim_z),
        )
    ]
    there = [membership for membership in given if membership is not None]
    crisp = all(as_box(membership) is not None for membership in there)
    family = t_norm.family
    linear = not (grid or nonlinear)
    complete = given[0] is not None and given[2] is not None
    closed = family and all(as_quadratic(membership, family) is not None for membership in there)
    if linear and family and closed and not (crisp and complete):
        unit = FAMILIES[family]
        filled = [
            unit(np.zeros(dim), np.eye(dim)) if membership is None else membership
            for membership, dim in zip(given, (dim_x, dim_x, dim_z), strict=True)
        ]
        return Choice(family, *filled)
    start, noise, error = given
    if start is None or error is None:
        name = "state" if start is None else "measurement_noise"
        raise ParameterError(f"{name}: got None, expected a membership (only linear models have a default)")
    if noise is None:
        noise = SingletonMembership(np.zeros(dim_x))
    if crisp and not grid and (enclosed or not nonlinear):
        boxes = [as_box(membership) for membership in (start, noise, error)]
        return Choice("interval", *(box for box in boxes if box is not None))
    return Choice("grid", start, noise, error)


def as_quadratic(membership: Membership, family: str) -> tuple[FloatArray, FloatArray] | None:
    """Center and matrix of a membership of a closed family; None if it is none.

    A point belongs to every family, with a zero matrix.
    """
    if isinstance(membership, EllipticalMembership) and membership.family == family:
        return membership.center, membership.matrix
    if isinstance(membership, JointMembership) and membership.t_norm.family == family:
        parts = [as_quadratic(component, family) for component in membership.components]
        found = [part for part in parts if part is not None]
        if len(found) == len(parts):
            return np.concatenate([c for c, _ in found]), np.diag([float(m[0, 0]) for _, m in found])
    box = as_box(membership)
    if box is not None and np.array_equal(box.lower, box.upper):
        return box.lower, np.zeros((box.dim, box.dim))
    return None


def required_box(name: str, membership: Membership) -> IntervalMembership:
    """Return a crisp membership as a box.

    Raises
    ------
    ParameterError
        If it is not crisp.
    """
    box = as_box(membership)
    if box is None:
        raise ParameterError(f"{name}: this estimator keeps intervals, expected a crisp membership")
    return box


def required_quadratic(name: str, membership: Membership, family: str) -> tuple[FloatArray, FloatArray]:
    """Center and matrix of a membership of a closed family.

    Raises
    ------
    ParameterError
        If it is none.
    """
    found = as_quadratic(membership, family)
    if found is None:
        raise ParameterError(f"{name}: this estimator keeps {family} memberships, expected one of that shape")
    return found


def as_used(name: str, noise: Membership, representation: Representation) -> Membership:
    """Bring a noise into the form in which a representation uses it.

    Raises
    ------
    ParameterError
        If the noise has no such form.
    """
    if representation == "grid":
        return noise
    if representation == "interval":
        return required_box(name, noise)
    return FAMILIES[representation](*required_quadratic(name, noise, representation))


def no_matrix(name: str, representation: str, instead: str) -> ParameterError:
    """Return the error for a matrix (or center) that a representation does not have."""
    return ParameterError(
        f"{name}: has no meaning of its own in the representation {representation!r}; use {instead}"
    )


def check_constraint(constraint: Membership, representation: Representation) -> None:
    """Raise unless a representation keeps its shape under a constraint.

    Raises
    ------
    ParameterError
        Names the representations that do.
    """
    if representation == "grid":
        return
    grid = "a grid does (give points, with state and measurement_noise)"
    if representation == "interval":
        if not isinstance(constraint, IntervalMembership | BoxMembership):
            raise ParameterError(
                f"constraint: got {constraint!r}, which does not leave an interval an interval; {grid}, and "
                "a box (lower, upper) will do"
            )
    elif as_quadratic(constraint, representation) is None:
        family = FAMILIES[representation].__name__
        raise ParameterError(
            f"constraint: got {constraint!r}, which a {representation} membership does not keep its shape "
            f"under; {grid}, intervals do for a box, and here a {family} will do"
        )


def as_matrix(name: str, value: Any, dim: int) -> FloatArray:
    """Check a covariance-like matrix; a number stands for that multiple of the identity.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        Wrong shape; not finite or not symmetric; indefinite.
    """
    array = as_numbers(name, value)
    return check_covariance(name, array * np.eye(dim) if array.ndim == 0 else array, (dim, dim))


def as_center(value: Numbers, dim: int) -> FloatArray:
    """Copy a state that a user assigns, flat or a column; a number will do in one dimension.

    Raises
    ------
    ShapeError, ParameterError
        Wrong shape; not finite.
    """
    array = as_numbers("x", value).copy()
    if array.ndim == 0 and dim == 1:
        array = array.reshape(1, 1)
    if array.shape not in {(dim,), (dim, 1)}:
        raise ShapeError(f"x: got shape {array.shape}, expected ({dim}, 1) or ({dim},)")
    if not np.isfinite(array).all():
        raise ParameterError(f"x: got {array.ravel().tolist()}, expected finite numbers")
    return array


def universe_of(
    choice: Choice,
    t_norm: TNorm,
    points: int | Sequence[int] | None,
    domain: Sequence[Sequence[float]] | None,
    floor: float | None,
) -> Universe:
    """Check the size and place of the grid that a user asked for.

    Raises
    ------
    ParameterError
        More than three dimensions; fewer than five points; a domain without width or of
        another dimension; a floor outside ]0, 1[; a measurement without noise.
    """
    d = choice.state.dim
    if d > 3:
        raise ParameterError(f"dim_x: got {d}, expected at most 3 where a grid is needed")
    counts = np.array(POINTS[d] if points is None else points)
    if counts.shape not in {(), (d,)} or counts.dtype.kind not in "iu" or (counts < 5).any():
        raise ParameterError(f"points: got {points!r}, expected a whole number of at least 5, or {d} of them")
    box = None
    if domain is not None:
        box = as_numbers("domain", domain)
        box = box[None] if d == 1 and box.shape == (2,) else box
        if box.shape != (d, 2) or not np.isfinite(box).all() or (box[:, 0] >= box[:, 1]).any():
            raise ParameterError(
                f"domain: got {domain!r}, expected one finite pair (lo, hi) with lo < hi for each of {d} "
                "components"
            )
        peak = choice.state.peak
        if ((peak < box[:, 0]) | (peak > box[:, 1])).any():
            raise ParameterError(f"state: its peak {peak.tolist()} lies outside the domain {box.tolist()}")
    if floor is None:
        floor = HEAVY_FLOOR if _is_heavy(choice.state) or _is_heavy(choice.process_noise) else FLOOR
    if not 0.0 < floor < 1.0:
        raise ParameterError(f"floor: got {floor}, expected a number between 0 and 1")
    lower, upper = choice.measurement_noise.support()
    if (lower == upper).any():
        k = int(np.argmax(lower == upper))
        raise ParameterError(
            f"measurement_noise: component {k} is a single point; on a grid it needs some width, since no "
            "node explains a measurement exactly"
        )
    limit = float(t_norm.cost(floor))
    bounded = choice.state.is_bounded and choice.process_noise.is_bounded
    return Universe(tuple(int(n) for n in np.broadcast_to(counts, (d,))), box, limit, bounded)


def _is_heavy(membership: Membership) -> bool:
    """Whether the tails are those of an uncut Cauchy membership."""
    if isinstance(membership, JointMembership):
        return any(_is_heavy(component) for component in membership.components)
    return isinstance(membership, CauchyMembership)

"""Process noise on a grid: one kernel per axis, in coordinates in which it has axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.possibility.memberships import (
    CauchyMembership,
    CutMembership,
    EllipticalMembership,
    IntervalMembership,
    JointMembership,
    SingletonMembership,
    TriangularMembership,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Kernel", "Noise", "as_noise", "decompose"]


@dataclass(frozen=True, eq=False)
class Kernel:
    """A scalar noise membership as the kernel of a convolution, its peak moved to zero.

    Attributes
    ----------
    membership : Membership
    t_norm : TNorm
    lower, upper : float
        Bounds of the offsets that are possible.
    curvature : float or None
        If the cost is curvature * offset^2.
    reciprocal_scale : float or None
        If the membership is 1/(1 + (offset/scale)^2) and costs are logarithms.
    kinks : tuple of float
        Offsets at which the cost is not smooth.
    """

    membership: Membership
    t_norm: TNorm
    lower: float = field(init=False)
    upper: float = field(init=False)
    curvature: float | None = field(init=False, default=None)
    reciprocal_scale: float | None = field(init=False, default=None)
    kinks: tuple[float, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        shape, peak = self.membership, self.membership.peak[0]
        lower, upper = shape.support()
        object.__setattr__(self, "lower", float(lower[0] - peak))
        object.__setattr__(self, "upper", float(upper[0] - peak))
        if isinstance(shape, EllipticalMembership):
            if shape.family == self.t_norm.family:
                half = 0.5 if shape.family == "gaussian" else 1.0
                object.__setattr__(self, "curvature", half / float(shape.matrix[0, 0]))
            elif isinstance(shape, CauchyMembership) and self.t_norm.name == "product":
                object.__setattr__(self, "reciprocal_scale", float(shape.scale))
        if isinstance(shape, TriangularMembership):
            object.__setattr__(self, "kinks", (0.0,))

    def cost(self, offset: FloatArray) -> FloatArray:
        """Costs of offsets from the peak."""
        return self.membership.cost((offset + self.membership.peak[0])[..., None], self.t_norm)

    def reach(self, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds of the offsets whose memberships reach each of many levels."""
        lower, upper = self.membership.reach(levels)
        return lower[:, 0] - self.membership.peak[0], upper[:, 0] - self.membership.peak[0]


@dataclass(frozen=True, eq=False)
class Noise:
    """Additive noise of the state.

    Attributes
    ----------
    peak : ndarray, shape (d,)
        The likeliest noise, a mere shift.
    kernels : tuple of (Kernel or None)
        What is left of it along each axis of the coordinates u = basis^-1 x; None
        where there is no noise.
    basis : ndarray, shape (d, d), or None
        Triangular but for the order of axes; None for the axes of x themselves.
    joint : Membership or None
        A noise without such coordinates; then there are no kernels.
    """

    peak: FloatArray
    kernels: tuple[Kernel | None, ...]
    basis: FloatArray | None = None
    joint: Membership | None = None

    @property
    def is_bounded(self) -> bool:
        """Whether only bounded noise is possible."""
        if self.joint is not None:
            return self.joint.is_bounded
        return all(k is None or np.isfinite([k.lower, k.upper]).all() for k in self.kernels)


def as_noise(
    name: str, noise: Membership | Sequence[Membership | None] | None, dim: int, t_norm: TNorm
) -> Membership:
    """Turn what a user gave for a noise into one membership of that dimension.

    Parameters
    ----------
    name : str
        Name of the argument.
    noise : Membership, sequence of Membership or None, or None
        One membership, or one scalar membership or None (no noise) per component.
    dim : int
    t_norm : TNorm
        How the components combine.

    Raises
    ------
    ParameterError
        If the dimension or the number of components is another.
    """
    from fuzzykf.possibility.memberships import Membership

    if noise is None:
        return SingletonMembership(np.zeros(dim))
    if isinstance(noise, Membership):
        if noise.dim != dim:
            raise ParameterError(f"{name}: got a membership of {noise.dim} dimensions, expected {dim}")
        return noise
    try:
        components: list[Any] = list(noise)
    except TypeError as error:
        raise ParameterError(
            f"{name}: got {noise!r}, expected a membership, or a sequence of memberships or None"
        ) from error
    if len(components) != dim:
        raise ParameterError(f"{name}: got {len(components)} components, expected {dim}")
    for k, component in enumerate(components):
        if component is not None and not (isinstance(component, Membership) and component.dim == 1):
            raise ParameterError(f"{name}[{k}]: got {component!r}, expected a scalar membership or None")
    filled = [SingletonMembership(0.0) if c is None else c for c in components]
    return filled[0] if dim == 1 else JointMembership(filled, t_norm)


def decompose(noise: Membership, t_norm: TNorm, spread: FloatArray) -> Noise:
    """Find coordinates in which a noise membership combines from scalar ones.

    Interval boxes and per-component noises have the axes of the state.  Where costs
    are quadratic forms v' M^-1 v, M = L D L' gives the coordinates u = L^-1 v, in which
    they are sums of u_k^2 / D_k.  Everything else is left as a joint noise.

    Parameters
    ----------
    noise : Membership
    t_norm : TNorm
    spread : ndarray, shape (d,)
        Extent of the state along each axis: L is chosen to shear it little.
    """
    components = _components(noise, t_norm)
    if components is not None:
        kernels = tuple(None if _is_point(c) else Kernel(c, t_norm) for c in components)
        return Noise(noise.peak, kernels)
    if isinstance(noise, EllipticalMembership) and noise.family == t_norm.family:
        basis, diagonal = _ldl(noise.matrix, spread)
        scalars = [noise.with_matrix(np.zeros(1), np.array([[d]])) for d in diagonal]
        kernels = tuple(
            Kernel(c, t_norm) if d > 0.0 else None for c, d in zip(scalars, diagonal, strict=True)
        )
        return Noise(noise.peak, kernels, basis)
    return Noise(noise.peak, (), joint=noise)


def _is_point(membership: Membership) -> bool:
    lower, upper = membership.support()
    return np.array_equal(lower, upper)


def _components(noise: Membership, t_norm: TNorm) -> list[Membership] | None:
    """Scalar memberships that combine into the noise under the t-norm, if there are."""
    d = noise.dim
    if d == 1:
        return [noise]
    if isinstance(noise, JointMembership) and noise.t_norm == t_norm:
        return list(noise.components)
    if isinstance(noise, IntervalMembership):
        return [noise.project([k]) for k in range(d)]
    if isinstance(noise, TriangularMembership) and t_norm.name == "min":
        return [noise.project([k]) for k in range(d)]
    if isinstance(noise, EllipticalMembership) and noise.family == t_norm.family:
        diagonal = np.diag(noise.matrix)
        if np.array_equal(noise.matrix, np.diag(diagonal)):
            return [noise.project([k]) for k in range(d)]
    if isinstance(noise, CutMembership) and noise.level == 0.0:
        parts = _components(noise.base, t_norm)
        if parts is not None:
            bounds = zip(noise.lower, noise.upper, strict=True)
            return [p if _is_point(p) else p.cut(b) for p, b in zip(parts, bounds, strict=True)]
    return None


def _ldl(matrix: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factors of a positive semi-definite matrix L diag(D) L', L triangular but for the order of axes.

    Axes come in the order of their remaining noise relative to the spread of the state.
    """
    d = matrix.shape[0]
    rest, L, D = matrix.copy(), np.eye(d), np.zeros(d)
    left = list(range(d))
    scale = np.where(spread > 0.0, spread, np.sqrt(np.diag(matrix).max()) * 1e-3) ** 2
    while left:
        k = max(left, key=lambda i: rest[i, i] / scale[i])
        left.remove(k)
        if rest[k, k] > 1e-13 * matrix[k, k]:
            D[k] = rest[k, k]
            L[left, k] = rest[left, k] / D[k]
            rest = rest - D[k] * np.outer(L[:, k], L[:, k])
    return L, D

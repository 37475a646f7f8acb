"""Process noise on a grid: one kernel per axis, in coordinates in which it has axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.possibility.memberships import (
    CutMembership,
    EllipticalMembership,
    IntervalMembership,
    JointMembership,
    TriangularMembership,
)

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Kernel", "Noise", "decompose", "shear"]


class Kernel:
    """A scalar noise membership as the kernel of a convolution, its peak moved to zero.

    Attributes
    ----------
    t_norm : TNorm
    lower, upper : float
        Bounds of the offsets that are possible.
    curvature : float or None
        If the cost is curvature * offset^2.
    kinks : tuple of float
        Offsets at which the cost is not smooth.
    """

    def __init__(self, membership: Membership, t_norm: TNorm) -> None:
        self.t_norm = t_norm
        self._membership, self._peak = membership, float(membership.peak[0])
        self.lower, self.upper = (float(bound[0]) - self._peak for bound in membership.support())
        self.kinks = (0.0,) if isinstance(membership, TriangularMembership) else ()
        self.curvature: float | None = None
        if isinstance(membership, EllipticalMembership) and membership.family == t_norm.family:
            half = 0.5 if membership.family == "gaussian" else 1.0
            self.curvature = half / float(membership.matrix[0, 0])

    def cost(self, offset: FloatArray) -> FloatArray:
        """Costs of offsets from the peak."""
        if self.curvature is not None:
            return self.curvature * (offset * offset)
        return self._membership.cost((offset + self._peak)[..., None], self.t_norm)

    def reach(self, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds of the offsets that cost no more than each of many costs."""
        if self.curvature is not None:
            half = np.sqrt(np.maximum(cost, 0.0) / self.curvature)
            return -half, half
        level = np.clip(self.t_norm.membership(cost), np.finfo(float).tiny, 1.0)
        lower, upper = self._membership.reach(level)
        return lower[:, 0] - self._peak, upper[:, 0] - self._peak


@dataclass(frozen=True, eq=False)
class Noise:
    """Additive noise of the state.

    Attributes
    ----------
    membership : Membership
    peak : ndarray, shape (d,)
        The likeliest noise, a mere shift.
    kernels : tuple of (Kernel or None), or None
        What is left of it along each axis, None where there is no noise.  There are none
        at all if the noise does not combine from scalar ones along the axes of the state.
    """

    membership: Membership
    peak: FloatArray
    kernels: tuple[Kernel | None, ...] | None


def decompose(noise: Membership, t_norm: TNorm) -> Noise:
    """Find the scalar memberships from which a noise combines, if there are."""
    components = _components(noise, t_norm)
    kernels = None
    if components is not None:
        kernels = tuple(None if _is_point(c) else Kernel(c, t_norm) for c in components)
    return Noise(noise, noise.peak, kernels)


def shear(
    noise: Membership, t_norm: TNorm, spread: FloatArray
) -> tuple[FloatArray, tuple[Kernel | None, ...]] | None:
    """Find oblique coordinates in which a noise combines from scalar ones.

    Where costs are quadratic forms v' M^-1 v, M = L D L' gives the coordinates
    u = L^-1 v, in which they are sums of u_k^2 / D_k.

    Parameters
    ----------
    noise : Membership
    t_norm : TNorm
    spread : ndarray, shape (d,)
        Extent of the state along each axis: L is chosen to shear it little.

    Returns
    -------
    basis : ndarray, shape (d, d)
        L, triangular but for the order of axes.
    kernels : tuple of (Kernel or None)
        Along the axes of u.  All is None if there are no such coordinates.
    """
    if not (isinstance(noise, EllipticalMembership) and noise.family == t_norm.family):
        return None
    basis, diagonal = _ldl(noise.matrix, spread)
    scalars = (noise.with_matrix(np.zeros(1), np.array([[d]])) if d > 0.0 else None for d in diagonal)
    return basis, tuple(None if c is None else Kernel(c, t_norm) for c in scalars)


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
    if isinstance(noise, CutMembership) and noise.level == 0.0:
        parts = _components(noise.base, t_norm)
        if parts is not None:
            bounds = zip(noise.lower, noise.upper, strict=True)
            return [p if _is_point(p) else p.cut(b) for p, b in zip(parts, bounds, strict=True)]
    diagonal = isinstance(noise, IntervalMembership)
    if isinstance(noise, TriangularMembership):
        diagonal = t_norm.name == "min"
    elif isinstance(noise, EllipticalMembership):
        diagonal = noise.family == t_norm.family and np.array_equal(
            noise.matrix, np.diag(np.diag(noise.matrix))
        )
    return [noise.project([k]) for k in range(d)] if diagonal else None


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

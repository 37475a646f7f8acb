"""From which scalar kernels a process noise combines: one per axis, in coordinates in which it has axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.possibility.grid.lattice import Kernel
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

__all__ = ["Noise", "decompose", "shear"]


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
    return basis, tuple(Kernel.quadratic(d, t_norm) if d > 0.0 else None for d in diagonal.tolist())


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

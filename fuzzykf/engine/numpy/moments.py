"""Moments of memberships on a lattice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["moments_about"]


def moments_about(
    mass: FloatArray, axes: tuple[FloatArray, ...], center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First and second moments about a point, by the trapezoidal rule.

    Parameters
    ----------
    mass : ndarray, shape (n_1, ..., n_d)
        Of which some is positive.
    axes : tuple of ndarray
        Coordinates of the nodes.
    center : ndarray, shape (d,)
        A point within the spread of the mass, so that nothing cancels.

    Returns
    -------
    first : ndarray, shape (d,)
    second : ndarray, shape (d, d)
    """
    for axis, c in zip(reversed(axes), reversed(center), strict=True):
        weight = np.ones(axis.size)
        weight[[0, -1]] *= 0.5
        deviation = axis - c
        basis = np.stack([weight, weight * deviation, weight * deviation**2], axis=1)
        mass = np.moveaxis(mass @ basis, -1, 0)
    d = len(axes)
    unit = np.eye(d, dtype=np.intp)
    mass = mass / mass[(0,) * d]
    first = np.array([mass[tuple(unit[k])] for k in range(d)])
    return first, np.array([[mass[tuple(unit[j] + unit[k])] for j in range(d)] for k in range(d)])

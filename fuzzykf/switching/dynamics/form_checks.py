"""What has to hold for the parameters of a Gaussian form; each failure has its own message."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import check_definite, is_whole, symmetrize

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["checked_classes", "consistent_blocks", "dimensions", "prove_observable", "symmetric"]

#: Blocks of the same covariance given twice may differ by this much, relatively.
CONSISTENCY_TOLERANCE = 1e-8


def checked_classes(K: int) -> int:
    """Return the number of regimes, which is not zero."""
    if K == 0:
        raise ParameterError("means: got no regime, expected at least one")
    return K


def prove_observable(name: str, covariances: FloatArray, m: int) -> None:
    """Raise unless the first observation has a density in every regime."""
    observed = covariances[..., m:, m:]
    check_definite(observed, lambda k: f"{name}[{k[0]}], its block of the observation", strict=True)


def dimensions(dim_x: int, d: int) -> tuple[int, int]:
    """Split the number d of components of Z into those of X and of Y."""
    if d < 2:
        raise ShapeError(f"means: got {d} column, expected at least 2, of the state and of the observation")
    if not is_whole(dim_x) or not 1 <= dim_x < d:
        raise ParameterError(
            f"dim_x: got {dim_x!r}, expected a whole number from 1 to {d - 1}, since means has {d} columns "
            "(state and observation)"
        )
    return int(dim_x), d - int(dim_x)


def symmetric(name: str, matrices: FloatArray) -> FloatArray:
    """Return the symmetric part of matrices that are symmetric but for rounding."""
    error = np.abs(matrices - np.swapaxes(matrices, -1, -2))
    excess = error - CONSISTENCY_TOLERANCE * sizes(matrices)
    if (excess > 0.0).any():
        where = tuple(int(k) for k in np.unravel_index(np.argmax(excess), error.shape))
        mirrored = (*where[:-2], where[-1], where[-2])
        raise ParameterError(
            f"{name}: expected symmetric matrices, got {matrices[where]:.6g} at {where} but "
            f"{matrices[mirrored]:.6g} at {mirrored}"
        )
    return symmetrize(matrices)


def sizes(covariance: FloatArray) -> FloatArray:
    """Bounds of the entries of covariances, whatever the units: products of standard deviations."""
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    product: FloatArray = sd[..., :, None] * sd[..., None, :]
    return product


def consistent_blocks(gamma: FloatArray, d: int) -> FloatArray:
    """Covariances of Z given each regime, after checking that the pairs agree on them."""
    K = gamma.shape[0]
    sigma = np.stack([gamma[i, i, :d, :d] for i in range(K)])
    check_definite(sigma, lambda k: f"covariance of Z in the regime {k[0]}", strict=True)
    for i in range(K):
        for j in range(K):
            for name, block, k in (("first", gamma[i, j, :d, :d], i), ("second", gamma[i, j, d:, d:], j)):
                error = np.abs(block - sigma[k])
                excess = error - CONSISTENCY_TOLERANCE * sizes(sigma[k])
                if (excess > 0.0).any():
                    row, column = (int(v) for v in np.unravel_index(np.argmax(excess), error.shape))
                    raise ParameterError(
                        f"covariances[{i}, {j}]: the {name} diagonal block is the covariance of Z in regime "
                        f"{k} and has to equal that of covariances[{k}, {k}]; entry ({row}, {column}) is "
                        f"{block[row, column]:.6g} instead of {sigma[k][row, column]:.6g}"
                    )
    return sigma

"""What one step of a switching system needs, per pair of nodes, in the notation of the papers.

Z = (X, Y) with X hidden and Y observed; i is a value of r_n and j one of r_{n+1}.
Given the pair and the window w of the latest observations (y_n alone, unless the
model is of higher order),

    Y' = Ayy w + Ny + N(0, Qyy)
    X' = Axx X + H w + G Y' + c + N(0, C).

In a model given by Z' = A Z + N + N(0, Q) with A = [[Axx, Axy], [0, Ayy]] these are
G = Qxy Qyy^-1, H = Axy - G Ayy, c = Nx - G Ny and C = Qxx - G Qyx.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np

from fuzzykf.engine.numpy.switching import LOG_ZERO
from fuzzykf.engine.selected import Kernel, pack
from fuzzykf.gaussian import check_definite, cholesky, symmetrize

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

    Describe = Callable[[tuple[int, ...]], str]

__all__ = ["InitialLaw", "PairCoefficients", "PairTables", "SwitchingSystem", "regress"]


class PairCoefficients(NamedTuple):
    """The Gaussian part of a step for an array of pairs; leading shape (...)."""

    Axx: FloatArray  # (..., m, m)
    H: FloatArray  # (..., m, w)
    G: FloatArray  # (..., m, q)
    c: FloatArray  # (..., m)
    C: FloatArray  # (..., m, m)
    Ayy: FloatArray  # (..., q, w)
    Ny: FloatArray  # (..., q)
    Qyy: FloatArray  # (..., q, q)

    @property
    def dim_x(self) -> int:
        """Number m of components of the state."""
        return int(self.Axx.shape[-1])

    @property
    def dim_z(self) -> int:
        """Number q of components of an observation."""
        return int(self.Qyy.shape[-1])


def regress(
    A: FloatArray,
    N: FloatArray,
    Q: FloatArray,
    dim_x: int,
    describe: Describe,
    where: np.ndarray | None = None,
    scale: FloatArray | None = None,
) -> PairCoefficients:
    """Turn Z' = A Z + N + N(0, Q) into the regressions of Y' on Y and of X' on (X, Y, Y').

    Parameters
    ----------
    A : ndarray, shape (..., d, d)
        Its lower left block is taken to be zero.
    N : ndarray, shape (..., d)
    Q : ndarray, shape (..., d, d)
    dim_x : int
    describe : callable
        Maps the index of a pair to its name in error messages.
    where : ndarray of bool, shape (...), optional
        Which pairs can occur; the others are not checked and get a harmless noise.
    scale : ndarray, shape (..., d), optional
        Standard deviations of Z', to which the rounding errors of Q are relative.

    Raises
    ------
    NotPositiveDefiniteError
        If Q is indefinite, or its block of Y not positive definite, at a pair.
    """
    m = dim_x
    if where is not None:
        Q = np.where(where[..., None, None], Q, np.eye(Q.shape[-1]))
    check_definite(Q, lambda k: f"noise covariance of the {describe(k)}", scale=scale)
    Qyy, Qxy = Q[..., m:, m:], Q[..., :m, m:]
    check_definite(
        Qyy,
        lambda k: f"noise covariance of the observation for the {describe(k)}",
        strict=True,
        scale=None if scale is None else scale[..., m:],
    )
    G = np.swapaxes(np.linalg.solve(Qyy, np.swapaxes(Qxy, -1, -2)), -1, -2)
    Ayy, Ny = A[..., m:, m:], N[..., m:]
    H = A[..., :m, m:] - G @ Ayy
    c = N[..., :m] - (G @ Ny[..., None])[..., 0]
    C = drop_rounding(symmetrize(Q[..., :m, :m] - G @ np.swapaxes(Qxy, -1, -2)))
    return PairCoefficients(A[..., :m, :m], H, G, c, C, Ayy, Ny, Qyy)


def drop_rounding(C: FloatArray) -> FloatArray:
    """Remove eigenvalues of semi-definite matrices that are negative by rounding only.

    To be called after semi-definiteness has been proved, within its tolerance.
    """
    if C.shape[-1] == 1:
        return np.maximum(C, 0.0)
    variances = np.diagonal(C, axis1=-2, axis2=-1)
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))  # whatever the units
    scale = scale[..., :, None] * scale[..., None, :]
    eigenvalues, vectors = np.linalg.eigh(C / scale)
    if eigenvalues.size == 0 or eigenvalues.min() >= 0.0:
        return C
    repaired = (vectors * np.maximum(eigenvalues, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2) * scale
    return np.where((eigenvalues[..., 0] < 0.0)[..., None, None], symmetrize(repaired), C)


class InitialLaw(NamedTuple):
    """The law of the first node and of Z_1 given it."""

    probability: FloatArray  # (M,)
    mean: FloatArray  # (M, d)
    covariance: FloatArray  # (M, d, d)


class PriorTables(NamedTuple):
    """Matrices that carry node probabilities and moments to those of X' before Y' is seen."""

    offset: FloatArray  # (1 + w, M1 M2 m): (1, w) to the part of the mean that observations make
    carried: FloatArray  # (M1 m, M1 M2 m): x_i to Axx x_i
    twice: FloatArray  # (M1 m m, m m): p_i P_i to its share of the sum of P_ij Axx P_i Axx'
    noise: FloatArray  # (M1, m m): p_i to its share of the noise


@dataclass(frozen=True, eq=False)
class PairTables:
    """Everything the recursion needs for one step n -> n + 1.

    Attributes
    ----------
    transition : ndarray, shape (M1, M2)
        Probability of node j at n + 1 given node i at n.
    pairs : PairCoefficients
        With leading shape (M1, M2).
    """

    transition: FloatArray
    pairs: PairCoefficients

    @cached_property
    def kernel(self) -> Kernel:
        """The tables in the layout of the numeric kernels, made once."""
        factor = cholesky(self.pairs.Qyy, lambda k: f"noise covariance of the observation for the pair {k}")
        return pack(self.transition, factor, *self.pairs[:5], *self.pairs[5:7])

    @cached_property
    def prior(self) -> PriorTables:
        """What the moments of X' before Y' is seen need, made once."""
        Axx, H, G, c, C, Ayy, Ny, Qyy = self.pairs
        M1, M2, m = *self.transition.shape, self.pairs.dim_x
        Qxx = symmetrize(C + G @ Qyy @ np.swapaxes(G, -1, -2))
        offset = np.concatenate([(c + (G @ Ny[..., None])[..., 0])[..., None], H + G @ Ayy], axis=-1)
        twice = np.einsum("ijkl,ijrs->ijkrls", Axx, Axx).reshape(M1, M2, m * m, m * m)
        carried = np.zeros((M1, m, M1, M2, m))
        for i in range(M1):
            carried[i, :, i] = np.moveaxis(Axx[i], -1, 0)
        return PriorTables(
            offset=np.moveaxis(offset, -1, 0).reshape(offset.shape[-1], -1),
            carried=carried.reshape(M1 * m, M1 * M2 * m),
            twice=np.swapaxes(np.einsum("ij,ijkl->ikl", self.transition, twice), -1, -2).reshape(-1, m * m),
            noise=np.einsum("ij,ijkl->ikl", self.transition, Qxx).reshape(M1, m * m),
        )

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        return type(self), (self.transition, self.pairs)  # what is cached belongs to one engine

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class SwitchingSystem(Protocol):
    """A model placed on the nodes of a chain: all that the recursion asks.

    Attributes
    ----------
    chain : SwitchChain
    dim_x, dim_z : int
    order : int
        How many past observations a step conditions on, at most.
    steady_from : int or None
        From which n on `pair_tables` is always the same; None if it never is.
    """

    chain: SwitchChain
    dim_x: int
    dim_z: int
    order: int
    steady_from: int | None

    def initial(self) -> InitialLaw:
        """Return the law of (r_1, Z_1)."""

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n`` to ``n + 1`` (n = 0, 1, ...)."""


def log_probability(p: FloatArray) -> FloatArray:
    """Logarithm with a finite stand-in for log 0, so that no difference becomes NaN."""
    with np.errstate(divide="ignore"):
        return np.maximum(np.log(p), LOG_ZERO)

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
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, Self
from weakref import WeakKeyDictionary

import numpy as np

from fuzzykf.engine.selected import (
    LOG_ZERO,
    GapTables,
    Kernel,
    SlotPairs,
    Summary,
    in_slots,
    noise_root,
    pack,
    pack_gaps,
)
from fuzzykf.gaussian import check_definite, cholesky, mixture_moments, symmetrize
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

    Describe = Callable[[tuple[int, ...]], str]

__all__ = ["InitialLaw", "PairCoefficients", "PairTables", "SwitchingSystem", "regress"]


@reprs()
class PairCoefficients(NamedTuple):
    """Regression coefficients of one step, for an array of pairs of nodes with shape (...).

    Attributes
    ----------
    Axx, H, G : ndarray, shapes (..., m, m), (..., m, q) and (..., m, q)
        Coefficients of X, Y and Y' in the equation of X'.
    c, C : ndarray, shapes (..., m) and (..., m, m)
        Offset and noise covariance of X'.
    Ayy, Ny, Qyy : ndarray, shapes (..., q, q), (..., q) and (..., q, q)
        Coefficient of Y, offset and noise covariance in the equation of Y'.
    """

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
        harmless = np.eye(Q.shape[-1]) * (1.0 if scale is None else scale[..., None] ** 2)
        Q = np.where(where[..., None, None], Q, harmless)
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


class Ahead(NamedTuple):
    """What is known of a time before its observation is seen."""

    mu: FloatArray  # (M,): probabilities of the nodes
    x: FloatArray  # (m,)
    P: FloatArray  # (m, m)
    z: FloatArray  # (q,): mean of the observation
    S: FloatArray  # (q, q)


@reprs()
@dataclass(frozen=True, eq=False)
class InitialLaw:
    """Law of the first node, and of Z_1 = (X_1, Y_1) given that node.

    Attributes
    ----------
    probability : ndarray, shape (M,)
        Probabilities of the nodes.
    mean, covariance : ndarray, shapes (M, d) and (M, d, d)
        Moments of Z_1 given each node.

    See Also
    --------
    SwitchingSystem.initial : Returns one.
    """

    probability: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @cached_property
    def _starts(self) -> dict[int, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        return {}

    def start(self, q: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return what conditioning on the first observation, of ``q`` numbers, needs; made once.

        Log-probabilities, means, covariances, and Cholesky factors of the covariances of Y_1.
        """
        if q not in self._starts:
            factor = cholesky(
                self.covariance[:, -q:, -q:], lambda k: f"covariance of the first observation, node {k[0]}"
            )
            self._starts[q] = log_probability(self.probability), self.mean, self.covariance, factor
        return self._starts[q]

    def ahead(self, m: int) -> Ahead:
        """Say what is known of the first time before its observation is seen; X has ``m`` components.

        Parameters
        ----------
        m : int
            Number of components of the state.

        Returns
        -------
        Ahead
        """
        mean, covariance = self._moments
        return Ahead(self.probability.copy(), mean[:m], covariance[:m, :m], mean[m:], covariance[m:, m:])

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        return mixture_moments(self.probability, self.mean, self.covariance)


@reprs()
@dataclass(frozen=True, eq=False)
class PairTables:
    """Everything the recursion needs for the step from n to n + 1.

    Attributes
    ----------
    transition : ndarray, shape (M1, M2)
        Probability of node j at n + 1 given node i at n.
    pairs : PairCoefficients
        With leading shape (M1, M2).
    """

    transition: FloatArray
    pairs: PairCoefficients
    #: Whether the window is more than the latest observations: see `fuzzykf.switching.dynamics.inputs`.
    is_driven: ClassVar[bool] = False

    @cached_property
    def kernel(self) -> Kernel:
        """The tables in the layout of the engine, made once."""
        return pack(self.transition, self._noise_factor(), *self.pairs[:5], *self.pairs[5:7])

    @cached_property
    def in_slots(self) -> SlotPairs:
        """The tables slot by slot, made once; without pairs of probability zero where there are many."""
        return in_slots(self.transition, self.pairs)

    @cached_property
    def noise_root(self) -> FloatArray:
        """Root of the covariance of the noise of (X', Y') by slot, made once; what gaps need."""
        self._noise_factor()  # the error that names the pair
        return noise_root(self.in_slots.pairs)

    @cached_property
    def gaps(self) -> GapTables:
        """The tables in the layout of the kernel for gaps, made once."""
        return pack_gaps(self.in_slots, self.noise_root, len(self.transition))

    def _noise_factor(self) -> FloatArray:
        return cholesky(self.pairs.Qyy, lambda k: f"noise covariance of the observation for the pair {k}")

    @cached_property
    def _summaries(self) -> WeakKeyDictionary[SwitchChain, Summary]:
        return WeakKeyDictionary()

    def summary(self, chain: SwitchChain) -> Summary:
        """Return what the engine needs to tell of a step on the nodes of a chain, made once.

        Parameters
        ----------
        chain : SwitchChain

        Returns
        -------
        Summary
        """
        found = self._summaries.get(chain)
        if found is None:
            found = self._summaries[chain] = self._summarise(chain)
        return found

    def _summarise(self, chain: SwitchChain) -> Summary:
        Axx, H, G, c, C, Ayy, Ny, Qyy = self.pairs
        M1, M2, m = *self.transition.shape, self.pairs.dim_x
        Qxx = symmetrize(C + G @ Qyy @ np.swapaxes(G, -1, -2))
        offset = np.concatenate([(c + (G @ Ny[..., None])[..., 0])[..., None], H + G @ Ayy], axis=-1)
        twice = np.einsum("ijkl,ijrs->ijkrls", Axx, Axx).reshape(M1, M2, m * m, m * m)
        return Summary(
            self.kernel,
            self.transition,
            np.ascontiguousarray(np.moveaxis(offset, -1, 0)).reshape(offset.shape[-1], -1),
            np.swapaxes(np.einsum("ij,ijkl->ikl", self.transition, twice), -1, -2).reshape(-1, m * m),
            np.einsum("ij,ijkl->ikl", self.transition, Qxx).reshape(M1, m * m),
            chain.keys,
            chain.weights,
            chain.atoms,
            chain.ranking,
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
        """Return the law of (r_1, Z_1).

        Returns
        -------
        InitialLaw
        """

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n`` to ``n + 1`` (n = 0, 1, ...).

        Parameters
        ----------
        n : int
            Index of the observation before the step.

        Returns
        -------
        PairTables
        """


def log_probability(p: FloatArray) -> FloatArray:
    """Logarithm with a finite stand-in for log 0, so that no difference becomes NaN."""
    with np.errstate(divide="ignore"):
        return np.maximum(np.log(p), LOG_ZERO)

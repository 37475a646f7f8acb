"""How far the filter of a converted model is from the Kalman filter of the model it stands for.

Both filters are told the regimes and run on data of the CGLSSM.  What is compared is
their mean squared error in the long run.

The converted filter is linear along a path of regimes, and its error e = X - x obeys,
with (i, j) the regimes and the tables of the step,

    e' = Axx e + [(I - G B_j) A_j - Axx] X - H w + (I - G B_j) C_j U - G D_j V,

so second moments of (e, X, w) given the regime follow exactly, as in (18): those of
each pair are mixed over i with p(i | j).

The covariance of the Kalman filter depends on the whole path.  Its mean given the two
latest regimes is carried: one step of Riccati's equation for each triple (h, i, j),
mixed over h with p(h | i).  That step is concave, so the mean comes out a little too
large (by less than 1 % in the tests), and the ratio as much too small.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ClosenessWarning, NotPositiveDefiniteError, NotStableError, ParameterError
from fuzzykf.gaussian import as_array, square, symmetrize
from fuzzykf.switching.state_space.conversion import StateSpace, backward_kernel

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.switching.dynamics.pairs import PairCoefficients
    from fuzzykf.switching.state_space.converted import ConvertedSystem

__all__ = ["CLOSENESS_LEVEL", "error_ratio", "error_step", "kalman_step", "warn_if_far"]

#: A ratio above this is worth a warning: an error a quarter larger than it could be.
CLOSENESS_LEVEL = 1.25

#: The recursions run until both errors change by less than this, relatively, from n to 2 n steps ...
_SETTLED = 1e-6

#: ... n being at least and at most (with constant tables, with others) these.
_SHORTEST, _LONGEST_CONSTANT, _LONGEST = 16, 4096, 256

#: An error of so small a part of the variance of the state is none.
_ROUNDING = 1e-14


def error_ratio(system: ConvertedSystem, weights: ArrayLike) -> float:
    """Mean squared error of the converted filter by that of the Kalman filter, in the long run.

    Parameters
    ----------
    system : ConvertedSystem
    weights : array_like, shape (m,)
        Of the squared errors of the components of the state.

    Returns
    -------
    float
        The ratio of means over the steps n/2 to n, for the first n = 16, 32, ... at which both
        errors have settled, but at most n = 256 where tables vary with time, and 4096 elsewhere.

    Raises
    ------
    ParameterError
        If weights are negative, or all zero.
    NotPositiveDefiniteError, NotStableError
        If a time-varying model ceases to exist before that: if the noise of 'markov_x'
        becomes indefinite, or the covariance of the state exceeds floating-point numbers.
    """
    chosen = as_array("weights", weights, (system.dim_x,))
    if (chosen < 0.0).any() or not chosen.any():
        raise ParameterError(f"weights: got {chosen}, expected numbers of at least 0, not all of them 0")
    errors = _mean_squared_errors(system, chosen)
    longest = _LONGEST if system.steady_from is None else _LONGEST_CONSTANT
    seen = np.empty((longest, 2))
    n, means = 0, np.full(2, np.nan)
    while n < longest:
        goal, before = max(_SHORTEST, 2 * n), means
        seen[n:goal] = [next(errors) for _ in range(n, goal)]
        n = goal
        # halves, not single steps, so that they settle for a periodic chain as well
        means = seen[n // 2 : n].mean(axis=0)
        if (np.abs(means - before) <= _SETTLED * means).all():
            break
    converted, kalman = means
    without_kalman_error = np.inf if converted > 0.0 else 1.0
    return float(converted / kalman) if kalman > 0.0 else without_kalman_error


def warn_if_far(system: ConvertedSystem, stacklevel: int = 3) -> None:
    """Warn the caller of who calls this, or one farther above, if the ratio is above `CLOSENESS_LEVEL`."""
    try:
        ratio = error_ratio(system, np.ones(system.dim_x))
    except (NotPositiveDefiniteError, NotStableError) as error:
        message = f"in the long run this model does not exist: {error}"
    else:
        if ratio <= CLOSENESS_LEVEL:
            return
        way = "a larger order" if system.construction == "gain" else "construction='gain' with a larger order"
        message = (
            f"with known regimes, the mean squared error of this model's filter is {ratio:.3g} times that of "
            f"the Kalman filter (warned above {CLOSENESS_LEVEL:g}); {way} comes nearer"
        )
    warnings.warn(message, ClosenessWarning, stacklevel=stacklevel)


def _mean_squared_errors(system: ConvertedSystem, weights: FloatArray) -> Iterator[tuple[float, ...]]:
    """Yield the weighted errors of the converted and of the Kalman filter, from the second observation on."""
    space, transition, m = system.cglssm.space, system.chain.transition, system.dim_x
    law = system.law(0)
    w = law.factor.shape[-1] - m
    rows_x, rows_e = law.factor[:, w:], law.factor[:, w:].copy()
    rows_e[:, :, :w] = 0.0
    M = square(np.concatenate([rows_e, rows_x, law.factor[:, :w]], axis=1))
    P = M[:, :m, :m]
    kernel: FloatArray | None = None
    n = 0
    while True:
        law, before = system.law(n), kernel
        kernel, log_next = backward_kernel(law.log_p, transition)
        length = min(n + 2, system.order) * system.dim_z
        M = error_step(M, system.pair_tables(n).pairs, space, kernel, length)
        P = riccati(P[:, None], space) if before is None else kalman_step(P, space, before, transition > 0.0)
        variances = np.diagonal(M, axis1=1, axis2=2)
        p = np.exp(log_next)
        converted, total = p @ (variances[:, :m] @ weights), p @ (variances[:, m : 2 * m] @ weights)
        joint = np.exp(law.log_p)[:, None] * transition
        kalman = np.sum(joint * (np.diagonal(P, axis1=2, axis2=3) @ weights))
        # a state that is seen without noise leaves rounding errors, not errors
        yield tuple(float(v) if v > _ROUNDING * total else 0.0 for v in (converted, kalman))
        n += 1


def error_step(
    M: FloatArray, pairs: PairCoefficients, space: StateSpace, kernel: FloatArray, length: int
) -> FloatArray:
    """Second moments of (e', X', w') given each regime, from those of (e, X, w).

    Parameters
    ----------
    M : ndarray, shape (K, 2 m + w, 2 m + w)
    pairs : PairCoefficients
        Tables of the step.
    space : StateSpace
        The CGLSSM.
    kernel : ndarray, shape (K, K)
        p(r_n = i | r_{n+1} = j).
    length : int
        Components of w' to keep.
    """
    A, B, C, D = (np.broadcast_to(a, (len(kernel), *a.shape)) for a in space)
    m, q, w = pairs.dim_x, pairs.dim_z, pairs.H.shape[-1]
    remaining = np.eye(m) - pairs.G @ B
    T = np.zeros((*kernel.shape, 2 * m + length, 2 * m + w))
    N = np.zeros((*kernel.shape, 2 * m + length, C.shape[-1] + D.shape[-1]))
    e, x, y = slice(0, m), slice(m, 2 * m), slice(2 * m, 2 * m + q)
    u, v = slice(0, C.shape[-1]), slice(C.shape[-1], None)
    T[..., e, e], T[..., e, x], T[..., e, 2 * m :] = pairs.Axx, remaining @ A - pairs.Axx, -pairs.H
    T[..., x, x], T[..., y, x] = A, B @ A
    kept = np.arange(length - q)
    T[..., 2 * m + q + kept, 2 * m + kept] = 1.0
    N[..., e, u], N[..., e, v] = remaining @ C, -pairs.G @ D
    N[..., x, u], N[..., y, u], N[..., y, v] = C, B @ C, D
    each = T @ M[:, None] @ np.swapaxes(T, -1, -2) + square(N)
    mixed: FloatArray = np.einsum("ij,ijkl->jkl", kernel, each)
    return mixed


def kalman_step(
    P: FloatArray, space: StateSpace, kernel: FloatArray, where: BoolArray | None = None
) -> FloatArray:
    """Mean covariance of the Kalman filter given the regimes (r_n, r_{n+1}), from that given (r_{n-1}, r_n).

    Parameters
    ----------
    P : ndarray, shape (K, K, m, m)
    space : StateSpace
    kernel : ndarray, shape (K, K)
        p(r_{n-1} = h | r_n = i).
    where : ndarray of bool, shape (K, K), optional
        Which pairs (r_n, r_{n+1}) can occur; the others are left out, and come out as zero.
    """
    possible = (kernel > 0.0)[:, :, None] & (True if where is None else where)
    h, i, j = np.nonzero(possible)
    each = riccati(P[h, i], StateSpace(*(one[j] for one in space)))
    mean = np.zeros((*kernel.shape, *P.shape[2:]))
    np.add.at(mean, (i, j), kernel[h, i, None, None] * each)
    return mean


def riccati(P: FloatArray, space: StateSpace) -> FloatArray:
    """One step of the Kalman filter's covariance, in Joseph's form, into each regime: (..., K, m, m)."""
    A, B, C, D = space
    S = A @ P @ np.swapaxes(A, -1, -2) + square(C)
    SB = S @ np.swapaxes(B, -1, -2)
    V = symmetrize(B @ SB + square(D))
    K = SB @ np.linalg.pinv(V, hermitian=True)  # V is singular once the state is known without error
    remaining = np.eye(A.shape[-1]) - K @ B
    return remaining @ S @ np.swapaxes(remaining, -1, -2) + square(K @ D)

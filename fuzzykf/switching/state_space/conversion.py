"""From a switching state-space model to one with an exact filter: the equations of a step.

The CGLSSM (conditionally Gaussian linear state-space model) is, with j = r_{n+1},

    X' = A_j X + C_j U,    Y' = B_j X' + D_j V,

U and V standard normal.  It has no exact filter of bounded cost, because Y' depends on
all of the past through X.  The CMSHLM (conditionally Markov switching hidden linear
model; 2013 paper) keeps the law of Y' given a window w of the latest observations and
forgets the rest: given the regimes (i, j),

    Y' = E w + N(0, V),
    X' = At X + (A_j - At) J w + K (Y' - E w) + N(0, P' - At P At'),

where, with Sigma = Cov((w, X) | r_n = i) in the CGLSSM,

    J = Sigma_xw Sigma_ww^-1,    P = Sigma_xx - J Sigma_wx,    E = B_j A_j J,
    S = C_j C_j' + A_j P A_j',   V = B_j S B_j' + D_j D_j',
    K = S B_j' V^-1,             P' = (I - K B_j) S.

The constructions differ in At alone, and exist where P' - At P At' is positive
semi-definite.  For w = y_n this is the notation of the paper, its (22) corrected.

Covariances are carried as lower triangular factors and mixed by orthogonal
triangularisation: no covariance is ever subtracted from another, so that nearly
singular and very large ones keep their digits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.gaussian import check_definite, logsumexp, lower_factor, square, symmetrize
from fuzzykf.switching.dynamics.pairs import PairCoefficients, regress

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import Describe

__all__ = [
    "PairMoments",
    "StateSpace",
    "WindowLaw",
    "advance_window",
    "average_noise",
    "backward_kernel",
    "clip_coefficients",
    "first_window",
    "gain_coefficients",
    "markov_x_coefficients",
    "moment_operator",
    "noise_covariance",
    "pair_moments",
    "prove_noise",
    "stationary_covariance",
    "transition_matrix",
]


class StateSpace(NamedTuple):
    """Matrices of the CGLSSM, one of each per regime."""

    A: FloatArray  # (K, m, m)
    B: FloatArray  # (K, q, m)
    C: FloatArray  # (K, m, .)
    D: FloatArray  # (K, q, .)


class WindowLaw(NamedTuple):
    """Moments of the window w = (y_n, y_{n-1}, ...) and of X_n given each regime.

    A regime that cannot occur has an identity for a factor, which is never used.
    """

    log_p: FloatArray  # (K,): log p(r_n)
    factor: FloatArray  # (K, w + m, w + m): lower triangular, rows w, X
    mean: FloatArray | None = None  # (K, w + m); None where all means are zero


class PairMoments(NamedTuple):
    """What the constructions share, for pairs (i, j) of regimes; J and Lx depend on i alone."""

    J: FloatArray  # (K, m, w)
    E: FloatArray  # (K, K, q, w)
    K: FloatArray  # (K, K, m, q)
    Lx: FloatArray  # (K, m, m): factor of P
    Ly: FloatArray  # (K, K, q, q): factor of V
    Lnew: FloatArray  # (K, K, m, m): factor of P'

    @property
    def V(self) -> FloatArray:
        """Covariance of Y' given w, (K, K, q, q)."""
        return square(self.Ly)


def right_divide(B: FloatArray, L: FloatArray) -> FloatArray:
    """B L^-1."""
    return np.swapaxes(np.linalg.solve(np.swapaxes(L, -1, -2), np.swapaxes(B, -1, -2)), -1, -2)


# --------------------------------------------------------------------------- moments of the CGLSSM


def backward_kernel(log_p: FloatArray, transition: FloatArray) -> tuple[FloatArray, FloatArray]:
    """p(r_n = i | r_{n+1} = j), (K, K), and log p(r_{n+1}), (K,).

    Columns of regimes that cannot occur at n + 1 are zero.

    Parameters
    ----------
    log_p : ndarray, shape (K,)
        log p(r_n), minus infinity where zero.
    transition : ndarray, shape (K, K)
    """
    with np.errstate(divide="ignore"):
        log_joint = log_p[:, None] + np.log(transition)
    log_next = logsumexp(log_joint, axis=0)
    there = np.isfinite(log_next)
    kernel: FloatArray = np.exp(log_joint - np.where(there, log_next, 0.0))
    return kernel, log_next


def moment_operator(kernel: FloatArray, A: FloatArray) -> FloatArray:
    """Matrix (K m^2, K m^2) of the linear part of recursion (18).

    Block row j, column i is p(i | j) A_j (x) A_j.  The CGLSSM is mean-square stable
    if, and only if, its spectral radius is below one.
    """
    K, m, _ = A.shape
    twice = np.einsum("jab,jcd->jacbd", A, A)
    operator: FloatArray = np.einsum("ij,jacbd->jacibd", kernel, twice).reshape(K * m * m, K * m * m)
    return operator


def stationary_covariance(kernel: FloatArray, A: FloatArray, C: FloatArray) -> FloatArray:
    """Solve (18) for its fixed point G (K, m, m): G(j) = A_j [sum_i p(i | j) G(i)] A_j' + C_j C_j'.

    The spectral radius of `moment_operator` has to be below one.
    """
    K, m, _ = A.shape
    system = np.eye(K * m * m) - moment_operator(kernel, A)
    G = np.linalg.solve(system, square(C).reshape(-1)).astype(np.float64, copy=False)
    return symmetrize(G.reshape(K, m, m))


def first_window(
    log_p: FloatArray, root: FloatArray, B: FloatArray, D: FloatArray, mean: FloatArray | None = None
) -> WindowLaw:
    """Law of (y_1, X_1) given each regime.

    Parameters
    ----------
    log_p : ndarray, shape (K,)
    root : ndarray, shape (K, m, .)
        Any factor of the covariance of X_1.
    B, D : ndarray, shapes (K, q, m) and (K, q, .)
    mean : ndarray, shape (K, q + m), optional
        Of (y_1, X_1); zero by default.
    """
    below = np.zeros((*root.shape[:2], D.shape[-1]))
    rows = np.concatenate(
        [np.concatenate([B @ root, D], axis=-1), np.concatenate([root, below], axis=-1)], axis=-2
    )
    return _or_identity(log_p, lower_factor(rows), mean)


def pair_moments(law: WindowLaw, space: StateSpace, describe: Describe, where: np.ndarray) -> PairMoments:
    """Law of (Y', X') given the window, for each pair (i, j) of regimes.

    Parameters
    ----------
    law : WindowLaw
    space : StateSpace
    describe : callable
        Maps a pair to its name in messages.
    where : ndarray of bool, shape (K, K)
        Which pairs can occur; the others get a harmless law.

    Raises
    ------
    NotPositiveDefiniteError
        If V is singular at a pair that can occur.
    """
    A, B, C, D = space
    K, m, _ = A.shape
    q, w = B.shape[1], law.factor.shape[-1] - m
    Lw, Lxw, Lx = law.factor[:, :w, :w], law.factor[:, w:, :w], law.factor[:, w:, w:]
    J = right_divide(Lxw, Lw)
    carried = A @ Lx[:, None]  # (i, j): a factor of A_j P A_j'
    noise = np.broadcast_to(C, (K, *C.shape))
    rest = np.zeros((K, K, m, D.shape[-1]))
    rows_x = np.concatenate([carried, noise, rest], axis=-1)
    rows_y = np.concatenate([B @ carried, B @ noise, np.broadcast_to(D, (K, *D.shape))], axis=-1)
    L = lower_factor(np.concatenate([rows_y, rows_x], axis=-2))
    Ly = np.where(where[..., None, None], L[..., :q, :q], np.eye(q))
    check_definite(square(Ly), describe, strict=True)
    return PairMoments(
        J=J,
        E=(B @ A) @ J[:, None],
        K=right_divide(L[..., q:, :q], Ly),
        Lx=Lx,
        Ly=Ly,
        Lnew=L[..., q:, q:],
    )


def advance_window(
    law: WindowLaw,
    moments: PairMoments,
    A: FloatArray,
    kernel: FloatArray,
    log_next: FloatArray,
    length: int,
    means: tuple[FloatArray, FloatArray] | None = None,
) -> WindowLaw:
    """Carry the law of the window one step on; for X alone this is recursion (18).

    The joint law of (Y', w, X') given (i, j) is mixed over i with p(i | j), and all but
    the ``length`` newest components of the window are dropped.

    Parameters
    ----------
    law, moments
        At n, and of the step from n.
    A : ndarray, shape (K, m, m)
    kernel, log_next
        As returned by `backward_kernel`.
    length : int
        Components of the window to keep.
    means : tuple of ndarray, optional
        As returned by `fuzzykf.switching.state_space.offsets.mixed_means`, if means are not zero.
    """
    K, m, w = moments.J.shape
    q = moments.Ly.shape[-1]
    Lw = np.broadcast_to(law.factor[:, None, :w, :w], (K, K, w, w))
    keep = Lw[:, :, : length - q]
    rows_y = np.concatenate([moments.E @ Lw, moments.Ly, np.zeros((K, K, q, m))], axis=-1)
    rows_w = np.concatenate([keep, np.zeros((*keep.shape[:-1], q + m))], axis=-1)
    rows_x = np.concatenate([A @ law.factor[:, None, w:, :w], moments.K @ moments.Ly, moments.Lnew], axis=-1)
    rows = np.concatenate([rows_y, rows_w, rows_x], axis=-2)
    mean = None
    if means is not None:
        mean, off = means
        rows = np.concatenate([rows, off[..., None]], axis=-1)
    rows = rows * np.sqrt(kernel)[..., None, None]
    side_by_side = np.moveaxis(rows, 0, 2).reshape(K, rows.shape[2], -1)
    return _or_identity(log_next, lower_factor(side_by_side), mean)


def _or_identity(log_p: FloatArray, factor: FloatArray, mean: FloatArray | None) -> WindowLaw:
    there = np.isfinite(log_p)[:, None]
    factor = np.where(there[..., None], factor, np.eye(factor.shape[-1]))
    return WindowLaw(log_p, factor, None if mean is None else np.where(there, mean, 0.0))


# --------------------------------------------------------------------------- the constructions


def gain_coefficients(moments: PairMoments, space: StateSpace) -> PairCoefficients:
    """At = (I - K B_j) A_j: the new observation corrects the state, as in a Kalman filter.

    Then X' = At X + K Y' + N(0, R) with R = (I - K B_j) C_j C_j' (I - K B_j)' + K D_j D_j' K',
    whatever the window.  Exists always.
    """
    A, B, C, D = space
    remaining = np.eye(A.shape[-1]) - moments.K @ B
    root = np.concatenate([remaining @ C, moments.K @ D], axis=-1)
    H = np.zeros((*moments.K.shape[:3], moments.J.shape[-1]))
    return _coefficients(moments, remaining @ A, H, square(root))


def markov_x_coefficients(moments: PairMoments, space: StateSpace) -> PairCoefficients:
    """At = A_j, the construction of the paper, (12), (13) and (21): X stays a Markov chain.

    The noise covariance may come out indefinite: prove it with `prove_noise`.
    """
    carried = space.A @ moments.Lx[:, None]
    C = square(moments.Lnew) - square(carried)
    return _coefficients(moments, np.broadcast_to(space.A, C.shape), -moments.K @ moments.E, C)


def clip_coefficients(
    moments: PairMoments, space: StateSpace, describe: Describe, where: np.ndarray
) -> PairCoefficients:
    """At as near to A_j as a positive semi-definite noise covariance allows.

    With factors P = L L' and P' = M M', At = M T L^-1, where T is M^-1 A_j L with its
    singular values limited to one.  Which factors are taken makes no difference.

    Raises
    ------
    NotPositiveDefiniteError
        If P or P' is singular at a pair that can occur.
    """
    L, M = np.broadcast_to(moments.Lx[:, None], moments.Lnew.shape), moments.Lnew
    for factor, name in ((L, "X_n given its window"), (M, "X_n+1 given its window")):
        check_definite(square(factor), _of(f"covariance of {name}", describe), strict=True, where=where)
    there = where[..., None, None]
    L, M = np.where(there, L, np.eye(L.shape[-1])), np.where(there, M, np.eye(L.shape[-1]))
    U, s, Vt = np.linalg.svd(np.linalg.solve(M, space.A @ L))
    limited = np.minimum(s, 1.0)[..., None, :]
    At = right_divide(M @ (U * limited) @ Vt, L)
    root = M @ (U * np.sqrt((1.0 - limited) * (1.0 + limited)))
    H = (space.A - At) @ moments.J[:, None] - moments.K @ moments.E
    return _coefficients(moments, At, H, square(root))


def _of(what: str, describe: Describe) -> Describe:
    return lambda index: f"{describe(index)}: {what}"


def _coefficients(moments: PairMoments, At: FloatArray, H: FloatArray, C: FloatArray) -> PairCoefficients:
    K, _, m, q = moments.K.shape
    zero_x, zero_y = np.zeros((K, K, m)), np.zeros((K, K, q))
    return PairCoefficients(At, H, moments.K, zero_x, C, moments.E, zero_y, moments.V)


def transition_matrix(pairs: PairCoefficients) -> FloatArray:
    """A2 = [[At, (A_j - At) J], [0, E]] of (21), which takes (X, w) to the mean of (X', Y')."""
    below = np.zeros((*pairs.Ayy.shape[:-1], pairs.dim_x))
    return np.block([[pairs.Axx, pairs.H + pairs.G @ pairs.Ayy], [below, pairs.Ayy]])


def noise_covariance(pairs: PairCoefficients) -> FloatArray:
    """Q2 = [[K V K' + P' - At P At', K V], [V K', V]] of (13) and (23)."""
    cross = pairs.G @ pairs.Qyy
    Qxx = pairs.C + cross @ np.swapaxes(pairs.G, -1, -2)
    return symmetrize(np.block([[Qxx, cross], [np.swapaxes(cross, -1, -2), pairs.Qyy]]))


def prove_noise(
    pairs: PairCoefficients, moments: PairMoments, describe: Describe, where: np.ndarray
) -> PairCoefficients:
    """Check the noise covariance Q2 of the pairs that can occur, and remove rounding errors from C.

    Raises
    ------
    NotPositiveDefiniteError
        If Q2 is indefinite at such a pair.
    """
    A2, Q2 = transition_matrix(pairs), noise_covariance(pairs)
    scale = np.sqrt(_variances(moments))
    return regress(A2, np.zeros(Q2.shape[:-1]), Q2, pairs.dim_x, describe, where, scale)


def _variances(moments: PairMoments) -> FloatArray:
    """Variances of (X', Y') given w and the regimes, (K, K, m + q): what Q2 is a difference of."""
    of_x = (moments.Lnew**2).sum(axis=-1) + ((moments.K @ moments.Ly) ** 2).sum(axis=-1)
    variances = np.concatenate([of_x, (moments.Ly**2).sum(axis=-1)], axis=-1)
    return np.where(variances > 0.0, variances, 1.0)


def average_noise(
    pairs: PairCoefficients,
    moments: PairMoments,
    kernel: FloatArray,
    describe: Describe,
    where: np.ndarray,
) -> PairCoefficients:
    """One noise covariance per regime j, as (23) is printed: Q2(j) = sum_i p(i | j) Q2(i, j).

    Parameters
    ----------
    pairs, moments
        The pairs as constructed, and from what.
    kernel : ndarray, shape (K, K)
        p(i | j).
    describe : callable
        Maps (j,) to its name in messages.
    where : ndarray of bool, shape (K, K)

    Raises
    ------
    NotPositiveDefiniteError
        If Q2(j) is indefinite for a regime that can be reached.
    """
    average = np.einsum("ij,ijkl->jkl", kernel, noise_covariance(pairs))
    scale = np.sqrt(np.einsum("ij,ijk->jk", kernel, _variances(moments)))
    scale = np.where(scale > 0.0, scale, 1.0)
    Q2 = np.broadcast_to(average, (len(kernel), *average.shape))
    return regress(
        transition_matrix(pairs),
        np.zeros(Q2.shape[:-1]),
        Q2,
        pairs.dim_x,
        lambda pair: describe(pair[1:]),
        where,
        np.broadcast_to(scale, Q2.shape[:-1]),
    )

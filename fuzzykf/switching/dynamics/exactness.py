"""When filtering is exact: the condition on models in which the state may act on the next observation.

With k the regime of arrival, Z = (X, Y) and A_k = [[Axx, Axy], [Ayx, Ayy]],

    X' = Axx X + Axy Y + b + U,    Y' = Ayx X + Ayy Y + d + V,    (U, V) ~ N(0, noise_k).

M = Cov(U, V) Var(V)^-1 corrects the state by the new observation, and Abar = Axx - M Ayx is what is left
of the state before:

    X' = Abar X + (Axy - M Ayy) Y + M (Y' - d) + b + (U - M V).

Where several histories meet in a regime j, what is known of the state before j is a mixture of them.  The
next observation does not see it, so that mean and covariance per regime suffice, if

    Ayx_k Abar_j = 0    for every k that may follow j.

Regimes in which no two histories ever meet need no condition: a single regime is the Kalman filter, and
regimes that never change are a bank of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["EXACT_TOLERANCE", "Exactness", "corrected", "feedback", "judged", "mixed_regimes"]

#: A product that is smaller than this part of its factors is zero but for rounding.
EXACT_TOLERANCE = 1e-10


class Exactness(NamedTuple):
    """Whether a model has an exact filter, and the reason in words.

    Attributes
    ----------
    holds : bool
    words : str
    """

    holds: bool
    words: str


def corrected(A: FloatArray, noise: FloatArray, m: int) -> tuple[FloatArray, FloatArray]:
    """Return the gains M (K, m, q) of an observation, and Abar (K, m, m).

    Parameters
    ----------
    A, noise : ndarray, shape (K, d, d)
        The blocks of Y in ``noise`` are positive definite.
    m : int
        Number of components of the state.
    """
    M = np.swapaxes(np.linalg.solve(noise[:, m:, m:], noise[:, m:, :m]), -1, -2)
    return M, A[:, :m, :m] - M @ A[:, m:, :m]


def feedback(A: FloatArray, noise: FloatArray, m: int) -> FloatArray:
    """How far Ayx_k Abar_j is from zero, as a part of |Ayx_k| |Abar_j|: (K, K), rows j and columns k.

    Absolute values of entries are multiplied, before anything cancels, so that units do not matter: 0 where
    the product vanishes, at most 1.  Parameters are those of `corrected`.
    """
    M, Abar = corrected(A, noise, m)
    C = A[:, m:, :m]
    size = np.abs(A[:, :m, :m]) + np.abs(M) @ np.abs(C)
    product, bound = np.abs(C @ Abar[:, None]), np.abs(C) @ size[:, None]
    part: FloatArray = (product / np.where(bound > 0.0, bound, 1.0)).max(axis=(-1, -2))
    return part


def mixed_regimes(chain: SwitchChain) -> BoolArray:
    """Which nodes several histories lead to, at once or by way of another such node: (M,)."""
    arrows = (chain.transition != 0.0) & chain.reachable[:, None]
    mixed: BoolArray = arrows.sum(axis=0) > 1
    while True:
        more = mixed | arrows[mixed].any(axis=0)
        if (more == mixed).all():
            return mixed
        mixed = more


def judged(A: FloatArray, noise: FloatArray, m: int, chain: SwitchChain) -> Exactness:
    """Say whether a model has an exact filter on a chain of regimes.

    Parameters
    ----------
    A, noise, m
        As in `corrected`.
    chain : SwitchChain
        On the K regimes.
    """
    if not A[:, m:, :m].any():
        return Exactness(True, "exact: the state does not act on the next observation (A_yx = 0)")
    mixed = mixed_regimes(chain)
    if not mixed.any():
        one = "a single regime" if chain.reachable.sum() == 1 else "regimes in which no two histories meet"
        return Exactness(True, f"exact: {one}, which the Kalman filter serves")
    asked = mixed[:, None] & (chain.transition != 0.0)
    missed = np.where(asked, feedback(A, noise, m), 0.0)
    # the first pair of the largest, whatever rounding makes of equal ones
    j, k = (int(one) for one in np.argwhere(missed >= (1.0 - 1e-9) * missed.max())[0])
    if missed[j, k] <= EXACT_TOLERANCE:
        return Exactness(True, "exact: A_yx[k] Abar[j] = 0 for every regime k that may follow a regime j")
    return Exactness(
        False,
        "not exact: A_yx[k] Abar[j] has to be zero for every regime k that may follow a regime j, and is "
        f"off by {missed[j, k]:.3g} of |A_yx| |Abar| for j = {j} and k = {k}",
    )

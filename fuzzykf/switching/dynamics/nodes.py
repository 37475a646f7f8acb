"""What one step needs where its parameters are those of the value of the switch it arrives at.

X is the state and Y what is observed of it, j a node of the switch at the new time.  Given it,

    X' = F X + b + N(0, Q)
    Y' = H X' + d + N(0, R).

Unlike in `fuzzykf.switching.dynamics.pairs`, the past of Y says nothing beside X.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.gaussian import symmetrize
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.pairs import InitialLaw

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["NodeLaw", "NodeTables"]


@reprs()
@dataclass(frozen=True, eq=False)
class NodeTables:
    """Everything the recursion needs for one step n -> n + 1.

    Attributes
    ----------
    transition : ndarray, shape (M1, M2)
        Probability of node j at n + 1 given node i at n.
    F, b, Q : ndarray, shapes (M2, m, m), (M2, m), (M2, m, m)
        How the state moves to node j; a control is a part of b.
    H, d, R : ndarray, shapes (M2, q, m), (M2, q), (M2, q, q)
        What is seen of it there.
    """

    transition: FloatArray
    F: FloatArray
    b: FloatArray
    Q: FloatArray
    H: FloatArray
    d: FloatArray
    R: FloatArray

    @cached_property
    def log_transition(self) -> FloatArray:
        """Logarithm of the transition probabilities, minus infinity of zero; made once."""
        with np.errstate(divide="ignore"):
            return np.log(self.transition)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


@reprs()
@dataclass(frozen=True, eq=False)
class NodeLaw(InitialLaw):
    """The law of the first node and of Z_1 = (X_1, Y_1) given it, and how Y_1 comes from X_1.

    Attributes
    ----------
    probability : ndarray, shape (M,)
    mean, covariance : ndarray, shapes (M, m + q) and (M, m + q, m + q)
    H, d, R : ndarray, shapes (M, q, m), (M, q), (M, q, q)
    """

    H: FloatArray
    d: FloatArray
    R: FloatArray

    @classmethod
    def of_state(
        cls,
        probability: FloatArray,
        mean: FloatArray,
        covariance: FloatArray,
        H: FloatArray,
        d: FloatArray,
        R: FloatArray,
    ) -> Self:
        """Make it from mean (M, m) and covariance (M, m, m) of X_1 alone."""
        return cls(probability, *joint_moments(mean, covariance, H, d, R), H, d, R)


def joint_moments(
    mean: FloatArray, covariance: FloatArray, H: FloatArray, d: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (..., m + q) and covariance of (X, Y), Y = H X + d + N(0, R), from those of X."""
    across = H @ covariance
    seen = symmetrize(across @ np.swapaxes(H, -1, -2) + R)
    upper = np.concatenate([covariance, np.swapaxes(across, -1, -2)], axis=-1)
    rows = np.concatenate([upper, np.concatenate([across, seen], axis=-1)], axis=-2)
    return np.concatenate([mean, (H @ mean[..., None])[..., 0] + d], axis=-1), rows
